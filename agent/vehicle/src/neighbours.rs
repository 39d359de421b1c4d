//! The other vehicles: which boots of them are there, what was heard, and what is known of their clocks.

use std::collections::BTreeMap;

use skein_estimation::odometry::{Gap, OdometryPoint, Track};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, World};
use skein_proto::document::{GatedDocument, NeighbourHealth};
use skein_proto::exchange::Echo;
use skein_proto::keys::boot_text;
use skein_proto::measured::Measured;
use skein_proto::name::Name;
use skein_proto::status::Status;

use crate::clock::{PeerClock, PeerStamp};
use crate::counters::{Counters, Rate};
use crate::trust::Trust;

/// Vehicles known at most; the ones beyond are counted and ignored.
pub(crate) const NEIGHBOURS_MAX: usize = 64;
/// Boots of one vehicle known at most.
const BOOTS_MAX: usize = 4;
/// Rounds of exchanges kept of one neighbour.
pub(crate) const EXCHANGES_MAX: usize = 16;
/// How long a measurement, either way, makes a neighbour a partner of the exchange.
const PARTNER_FOR: Span = Span::secs(2);

/// Everybody else.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    vehicles: BTreeMap<Name, Neighbour>,
}

/// One other vehicle.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbour {
    boots: Vec<Boot>,
    pub(crate) counts: Counts,
    /// When this vehicle last measured it.
    pub(crate) measured_at: Option<Stamp>,
    /// When it last measured this vehicle.
    pub(crate) measured_me_at: Option<Stamp>,
    /// When it was last sent an exchange.
    pub(crate) spoken_to_at: Option<Stamp>,
    /// Where it was at the last solved round.
    pub(crate) relative: Option<Relative>,
    /// How far what is measured between the two of us is trusted.
    pub(crate) trust: Trust,
}

/// What was counted of one neighbour.
#[derive(Clone, Debug, Default)]
pub(crate) struct Counts {
    pub(crate) rate: Rate,
    pub(crate) accepted: Counters,
    pub(crate) refused: Counters,
    pub(crate) fused: u64,
    pub(crate) quarantines: u64,
    pub(crate) bytes: u64,
}

/// A neighbour's pose in this vehicle's body frame at one instant of our clock.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relative {
    pub(crate) taken: Stamp,
    pub(crate) body_from_neighbour: Transform<Body, Body>,
}

/// One process of a neighbour.
#[derive(Clone, Debug)]
pub(crate) struct Boot {
    pub(crate) id: u64,
    pub(crate) token: bool,
    pub(crate) clock: PeerClock,
    pub(crate) heard_at: Option<Stamp>,
    pub(crate) echoed_at: Option<Stamp>,
    /// The newest packet of it, for it to learn our clock.
    pub(crate) to_echo: Option<Echo>,
    pub(crate) sequences: BTreeMap<&'static str, u32>,
    pub(crate) status: Option<Status>,
    pub(crate) period: Option<Span>,
    pub(crate) body_from_target: Transform<Body, Sensor>,
    /// Its odometry, on its own clock.
    pub(crate) track: Track,
    /// What it said of each of *our* rounds.
    pub(crate) exchanges: BTreeMap<i64, HeardExchange>,
    /// The last of our rounds that one of its instants was laid to.
    pub(crate) last_round: Option<(i64, PeerStamp)>,
}

/// An exchange, decoded and laid to one of our rounds.
#[derive(Clone, Debug)]
pub(crate) struct HeardExchange {
    /// The sender's instant.
    pub(crate) instant: PeerStamp,
    pub(crate) prior: Option<Transform<World, Body>>,
    pub(crate) measured: Vec<Measured>,
}

impl Neighbours {
    /// The neighbour of that name. Where there is no room, the one that is not announced and was heard longest ago
    /// makes some.
    pub(crate) fn entry(&mut self, name: Name) -> Option<&mut Neighbour> {
        if self.vehicles.len() >= NEIGHBOURS_MAX && !self.vehicles.contains_key(&name) {
            let absent = self
                .vehicles
                .iter()
                .filter(|(_, neighbour)| !neighbour.has_token());
            let oldest = absent
                .min_by_key(|(_, neighbour)| neighbour.heard_at())
                .map(|(name, _)| *name)?;
            self.vehicles.remove(&oldest);
        }
        Some(self.vehicles.entry(name).or_default())
    }

    pub(crate) fn get(&self, name: Name) -> Option<&Neighbour> {
        self.vehicles.get(&name)
    }

    pub(crate) fn get_mut(&mut self, name: Name) -> Option<&mut Neighbour> {
        self.vehicles.get_mut(&name)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (Name, &Neighbour)> {
        self.vehicles
            .iter()
            .map(|(name, neighbour)| (*name, neighbour))
    }

    /// Those who are announced and were heard within `timeout`.
    pub(crate) fn present(
        &self,
        now: Stamp,
        timeout: Span,
    ) -> impl Iterator<Item = (Name, &Neighbour)> {
        self.iter()
            .filter(move |(_, neighbour)| neighbour.is_present(now, timeout))
    }

    /// Everybody is judged as if nothing had been measured yet.
    pub(crate) fn forget_trust(&mut self) {
        for neighbour in self.vehicles.values_mut() {
            neighbour.trust = Trust::default();
        }
    }

    /// Forgets exchanges of rounds up to `solved`.
    pub(crate) fn forget_exchanges(&mut self, solved: i64) {
        for boot in self
            .vehicles
            .values_mut()
            .flat_map(|neighbour| &mut neighbour.boots)
        {
            boot.exchanges = boot.exchanges.split_off(&(solved + 1));
        }
    }
}

impl Neighbour {
    /// The boot that counts: of those that echoed a stamp of ours, the one that did so last; before any has, the one
    /// heard last.
    pub(crate) fn current(&self) -> Option<&Boot> {
        self.boots
            .iter()
            .max_by_key(|boot| (boot.echoed_at, boot.heard_at, boot.token))
    }

    pub(crate) fn is_current(&self, boot: u64) -> bool {
        self.current().is_some_and(|current| current.id == boot)
    }

    /// The boot of that id, made if it is new; the one heard longest ago makes room.
    pub(crate) fn boot(&mut self, id: u64) -> &mut Boot {
        let at = match self.boots.iter().position(|boot| boot.id == id) {
            Some(at) => at,
            None => {
                if self.boots.len() >= BOOTS_MAX {
                    let oldest = self
                        .boots
                        .iter()
                        .enumerate()
                        .min_by_key(|(_, boot)| (boot.echoed_at, boot.token, boot.heard_at));
                    let oldest = oldest.map_or(0, |(at, _)| at);
                    self.boots.remove(oldest);
                }
                self.boots.push(Boot::new(id));
                self.boots.len() - 1
            }
        };
        &mut self.boots[at]
    }

    /// A token is gone. A boot that is not known stays unknown.
    pub(crate) fn lose_token(&mut self, id: u64) {
        for boot in self.boots.iter_mut().filter(|boot| boot.id == id) {
            boot.token = false;
        }
    }

    fn has_token(&self) -> bool {
        self.boots.iter().any(|boot| boot.token)
    }

    fn heard_at(&self) -> Option<Stamp> {
        self.boots.iter().filter_map(|boot| boot.heard_at).max()
    }

    /// The newest packet of any boot, to be echoed.
    pub(crate) fn to_echo(&self) -> Option<Echo> {
        self.boots
            .iter()
            .max_by_key(|boot| boot.heard_at)
            .and_then(|boot| boot.to_echo)
    }

    pub(crate) fn is_present(&self, now: Stamp, timeout: Span) -> bool {
        self.boots
            .iter()
            .any(|boot| boot.token && boot.heard_at.is_some_and(|heard| now - heard <= timeout))
    }

    /// Whether it was measured, or measured us, so lately that it is told everything each round.
    pub(crate) fn is_partner(&self, now: Stamp) -> bool {
        let lately = |at: Option<Stamp>| at.is_some_and(|at| now - at <= PARTNER_FOR);
        lately(self.measured_at) || lately(self.measured_me_at)
    }

    /// Whether it says that it has a pose that others may use.
    pub(crate) fn is_located(&self) -> bool {
        self.current()
            .and_then(|boot| boot.status)
            .is_some_and(Status::is_located)
    }

    /// Whether anything of it may be used: a boot that counts, whose clock is known.
    pub(crate) fn usable(&self) -> Option<&Boot> {
        self.current().filter(|boot| boot.clock.is_known())
    }

    /// The distance at the last solved round; infinite when unknown.
    pub(crate) fn distance_m(&self) -> f64 {
        self.relative.map_or(f64::INFINITY, |relative| {
            relative.body_from_neighbour.translation.norm()
        })
    }

    pub(crate) fn to_document(&self, now: Stamp, period: Span, timeout: Span) -> NeighbourHealth {
        let current = self.current();
        NeighbourHealth {
            present: self.is_present(now, timeout),
            boot: current.map(|boot| boot_text(boot.id)),
            status: current.and_then(|boot| boot.status),
            age_s: current
                .and_then(|boot| boot.heard_at)
                .map(|heard| (now - heard).as_secs_f64()),
            rate_hz: self.counts.rate.per_second(now),
            echoes: current.map_or(0, |boot| boot.clock.echoes()),
            clock_offset_s: current
                .and_then(|boot| boot.clock.offset())
                .map(Span::as_secs_f64),
            round_trip_s: current
                .and_then(|boot| boot.clock.round_trip())
                .map(Span::as_secs_f64),
            other_period_s: current
                .and_then(|boot| boot.period)
                .filter(|theirs| *theirs != period)
                .map(Span::as_secs_f64),
            accepted: self.counts.accepted.to_document(),
            fused: self.counts.fused,
            kernel_widening: None,
            last_gated: self.trust.last_rejected.map(|apart| GatedDocument {
                rotation_rad: apart.rotation_rad,
                translation_m: apart.translation_m,
            }),
            quarantined: self.trust.is_quarantined(),
            quarantines: self.counts.quarantines,
            refused: self.counts.refused.to_document(),
            bytes: self.counts.bytes,
        }
    }
}

impl Boot {
    fn new(id: u64) -> Self {
        Self {
            id,
            token: false,
            clock: PeerClock::default(),
            heard_at: None,
            echoed_at: None,
            to_echo: None,
            sequences: BTreeMap::new(),
            status: None,
            period: None,
            body_from_target: Transform::identity(),
            track: Track::new(),
            exchanges: BTreeMap::new(),
            last_round: None,
        }
    }

    /// Its odometry at an instant of its own clock.
    pub(crate) fn odometry_at(&self, instant: PeerStamp) -> Result<OdometryPoint, Gap> {
        self.track.at(instant.on_its_own_clock())
    }

    /// Which of our rounds one of its instants belongs to: the nearest. Phases that differ by half a period would
    /// jump to and fro with the noise of the clock offset, so the last answer is kept until it is clearly wrong.
    pub(crate) fn round_of(&mut self, instant: PeerStamp, period: Span) -> Option<i64> {
        const KEEP_WITHIN: f64 = 0.6;
        let mine = self.clock.to_mine(instant)?;
        let period_ns = period.as_nanos();
        let nearest = (mine + Span::from_nanos(period_ns / 2))
            .as_nanos()
            .div_euclid(period_ns);
        let kept = self.last_round.map(|(round, then)| {
            let rounds = instant.since(then).as_nanos() as f64 / period_ns as f64;
            round.saturating_add(rounds.round() as i64)
        });
        let kept = kept.filter(|round| {
            let off = mine.as_nanos() as f64 - *round as f64 * period_ns as f64;
            off.abs() <= KEEP_WITHIN * period_ns as f64
        });
        let round = kept.unwrap_or(nearest);
        self.last_round = Some((round, instant));
        Some(round)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{ECHOES_MIN, FourStamps};

    fn set_clock(boot: &mut Boot, offset_ms: i64) {
        for _ in 0..ECHOES_MIN {
            let peer = PeerStamp::from_nanos(offset_ms * 1_000_000);
            let now = Stamp::default();
            assert!(boot.clock.observe(FourStamps {
                sent: now,
                heard: peer,
                echoed: peer,
                received: now
            }));
        }
    }

    #[test]
    fn instants_half_a_period_apart_keep_their_round_while_the_offset_jitters() {
        let mut boot = Boot::new(1);
        let mut rounds = Vec::new();
        for k in 0..20 {
            // Their instants lie 0.1 s after ours, give or take a millisecond of clock error.
            set_clock(&mut boot, if k % 2 == 0 { 101 } else { 99 });
            let instant = PeerStamp::from_nanos((k * 200 + 200) * 1_000_000);
            rounds.push(boot.round_of(instant, Span::millis(200)).unwrap());
        }
        let steps: Vec<i64> = rounds.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(steps.iter().all(|step| *step == 1), "{rounds:?}");
    }

    #[test]
    fn the_boot_that_echoed_last_counts_and_a_silent_one_makes_room() {
        let mut neighbour = Neighbour::default();
        neighbour.boot(1).echoed_at = Some(Stamp::from_nanos(5));
        neighbour.boot(2).heard_at = Some(Stamp::from_nanos(9));
        assert!(neighbour.is_current(1), "heard is not enough");
        neighbour.boot(2).echoed_at = Some(Stamp::from_nanos(9));
        assert!(neighbour.is_current(2));
        for id in 3..=7 {
            neighbour.boot(id);
        }
        assert_eq!(neighbour.boots.len(), BOOTS_MAX);
        assert!(neighbour.is_current(2));
    }
}
