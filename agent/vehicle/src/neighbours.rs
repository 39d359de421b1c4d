//! The other vehicles: which boots of them are there, what was heard, and what is known of their clocks.

use std::collections::BTreeMap;

use nalgebra::Matrix6;
use skein_estimation::odometry::{Gap, OdometryPoint, Track};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, World};
use skein_proto::document::{GatedDocument, NeighbourHealth};
use skein_proto::exchange::Echo;
use skein_proto::keys::boot_text;
use skein_proto::measured::Measured;
use skein_proto::name::Name;
use skein_proto::status::Status;

use crate::asking::Asking;
use crate::clock::{FourStamps, Observed, PeerClock, PeerStamp};
use crate::counters::{Counters, Rate};
use crate::duplicates::{BOOTS_MAX, HANDOVER, Life, Namesakes, SILENCE};
use crate::heard_rounds::HeardRounds;
use crate::refused::Refused;
use crate::sequence::Sequences;
use crate::trust::Trust;

/// Vehicles known at most; the ones beyond are counted and ignored.
pub(crate) const NEIGHBOURS_MAX: usize = 64;
/// Rounds of exchanges kept of one neighbour.
pub(crate) const EXCHANGES_MAX: usize = 16;
/// How long a measurement, either way, makes a neighbour a partner of the exchange.
const PARTNER_FOR: Span = Span::secs(2);

/// Everybody else.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbours {
    vehicles: BTreeMap<Name, Neighbour>,
    /// Others who bear this vehicle's own name.
    pub(crate) namesakes: Namesakes,
    /// Whether something was found that the health should tell at once.
    pub(crate) alarmed: bool,
}

/// One other vehicle.
#[derive(Clone, Debug, Default)]
pub(crate) struct Neighbour {
    boots: Vec<Boot>,
    /// The boot that is the vehicle.
    in_office: Option<u64>,
    /// Boots that are refused because more than one of them is alive.
    duplicates: Vec<u64>,
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
    /// Of a twist on the neighbour's side, where the estimator supplies one.
    pub(crate) covariance: Option<Matrix6<f64>>,
}

/// One process of a neighbour.
#[derive(Clone, Debug)]
pub(crate) struct Boot {
    pub(crate) id: u64,
    pub(crate) token: bool,
    pub(crate) clock: PeerClock,
    /// Its echoes as proof that it is alive.
    pub(crate) life: Life,
    pub(crate) sequences: Sequences,
    pub(crate) heard_at: Option<Stamp>,
    /// The newest packet of it, for it to learn our clock.
    pub(crate) to_echo: Option<Echo>,
    /// Since its clock stepped: whatever is older is of another clock.
    pub(crate) stepped_at: Option<PeerStamp>,
    pub(crate) status: Option<Status>,
    pub(crate) period: Option<Span>,
    pub(crate) body_from_target: Transform<Body, Sensor>,
    /// Its odometry, on its own clock.
    pub(crate) track: Track,
    /// Its raw rounds, on its own clock.
    pub(crate) rounds: HeardRounds,
    /// When the last of them came from a relay.
    pub(crate) relayed_at: Option<Stamp>,
    /// What is missing of them.
    pub(crate) asking: Asking,
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
    /// The boot that is the vehicle.
    pub(crate) fn current(&self) -> Option<&Boot> {
        self.boots
            .iter()
            .find(|boot| self.in_office == Some(boot.id))
    }

    /// Whether a boot is the vehicle, and if not, why.
    pub(crate) fn is_in_office(&self, boot: u64) -> Result<(), Refused> {
        let counts_since = |boot: &Boot| boot.life.counts_since();
        match (self.current(), self.known_boot(boot).and_then(counts_since)) {
            (Some(current), _) if current.id == boot => Ok(()),
            (_, None) => Err(Refused::UnprovenBoot),
            (Some(current), since) if since < counts_since(current) => Err(Refused::OldBoot),
            _ => Err(Refused::NewBoot),
        }
    }

    /// The boot of that id, if it is known.
    pub(crate) fn known_boot(&self, id: u64) -> Option<&Boot> {
        self.boots.iter().find(|boot| boot.id == id)
    }

    /// The boot of that id, made if it is new; the one that proved itself longest ago, or never, makes room.
    pub(crate) fn boot(&mut self, id: u64) -> &mut Boot {
        let at = match self.boots.iter().position(|boot| boot.id == id) {
            Some(at) => at,
            None => {
                if self.boots.len() >= BOOTS_MAX {
                    let worth = |boot: &Boot| {
                        let in_office = self.in_office == Some(boot.id);
                        (in_office, boot.life.last(), boot.token, boot.heard_at)
                    };
                    let least = self
                        .boots
                        .iter()
                        .enumerate()
                        .min_by_key(|(_, boot)| worth(boot));
                    let least = least.map_or(0, |(at, _)| at);
                    self.boots.remove(least);
                }
                self.boots.push(Boot::new(id));
                self.boots.len() - 1
            }
        };
        &mut self.boots[at]
    }

    /// Says who of the boots is the vehicle, after `heard` was heard. A boot counts once it has proved that it is
    /// alive, and the one in office stays until a newer one counts and it has left: its token is gone, or it is silent
    /// while the newer one has told its clock. So an intruder finds the place taken until both are found out, and a
    /// process that is started again under the token of a dead one waits for no more than its own echoes.
    pub(crate) fn settle(&mut self, now: Stamp, heard: u64) {
        let Some(challenger) = self.known_boot(heard) else {
            return;
        };
        let takes_over = match self.current() {
            None => true,
            Some(current) if current.id == heard => false,
            Some(current) => match (current.life.counts_since(), challenger.life.counts_since()) {
                // Nobody has proved anything: whoever speaks, and of two, who is announced.
                (None, None) => challenger.token || !current.token,
                (None, Some(_)) => true,
                (Some(_), None) => false,
                (Some(old), Some(new)) if new > old => {
                    let known = challenger.clock.is_known();
                    !current.token || (known && current.life.is_silent(now, HANDOVER))
                }
                // A paused process comes back after the one that took its place has gone.
                (Some(_), Some(_)) => current.life.is_silent(now, SILENCE),
            },
        };
        if takes_over {
            self.in_office = Some(heard);
        }
    }

    /// Says who of the boots is the vehicle, after a relay told of one: as it proves nothing, only in the place of nobody or
    /// of one that has been silent for so long that it is gone.
    pub(crate) fn settle_relayed(&mut self, now: Stamp, told: u64) {
        let is_gone = |current: &Boot| current.life.is_silent(now, SILENCE);
        if self.current().is_none_or(is_gone) {
            self.in_office = Some(told);
        }
    }

    /// Whether a packet of this boot is refused because two boots of this name are alive. Both are refused until no
    /// more than one is left, which begins again as if it were new.
    pub(crate) fn judge(&mut self, now: Stamp, heard: u64) -> Result<(), Refused> {
        if self.duplicates.is_empty() {
            let Some(life) = self.known_boot(heard).map(|boot| boot.life) else {
                return Ok(());
            };
            let newer = self
                .boots
                .iter()
                .filter(|boot| life.outlives(&boot.life, now));
            self.duplicates = newer.map(|boot| boot.id).collect();
            if self.duplicates.is_empty() {
                return Ok(());
            }
            self.duplicates.insert(0, heard);
            return Err(Refused::DuplicateId);
        }
        let lives = |boot: &&Boot| !boot.life.is_silent(now, SILENCE);
        if let Some(third) = self.known_boot(heard).filter(lives).map(|boot| boot.id)
            && !self.duplicates.contains(&third)
        {
            self.duplicates.push(third);
        }
        if self.living_duplicates(now).count() > 1 {
            return Err(Refused::DuplicateId);
        }
        let survivor = self.living_duplicates(now).next();
        let gone = std::mem::take(&mut self.duplicates);
        self.boots
            .retain(|boot| Some(boot.id) == survivor || !gone.contains(&boot.id));
        if let Some(boot) = self.boots.iter_mut().find(|boot| Some(boot.id) == survivor) {
            boot.begin_again();
        }
        self.in_office = survivor;
        Ok(())
    }

    pub(crate) const fn is_duplicated(&self) -> bool {
        !self.duplicates.is_empty()
    }

    fn living_duplicates(&self, now: Stamp) -> impl Iterator<Item = u64> {
        self.boots
            .iter()
            .filter(move |boot| self.duplicates.contains(&boot.id))
            .filter(move |boot| !boot.life.is_silent(now, SILENCE))
            .map(|boot| boot.id)
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

    /// The newest packet, to be echoed: of a boot that counts, or before any does, of one that is announced. The many
    /// that a stranger may claim to be take nobody's turn.
    pub(crate) fn to_echo(&self) -> Option<Echo> {
        self.boots
            .iter()
            .filter(|boot| boot.token || boot.life.counts_since().is_some())
            .max_by_key(|boot| (boot.life.counts_since().is_some(), boot.heard_at))
            .and_then(|boot| boot.to_echo)
    }

    pub(crate) fn is_present(&self, now: Stamp, timeout: Span) -> bool {
        self.current()
            .is_some_and(|boot| boot.token && boot.heard_at.is_some_and(|at| now - at <= timeout))
    }

    /// Whether it is out of reach, but relays told of it within `timeout`.
    pub(crate) fn is_relayed(&self, now: Stamp, timeout: Span) -> bool {
        let lately = |boot: &Boot| boot.relayed_at.is_some_and(|at| now - at <= timeout);
        !self.is_present(now, timeout) && self.current().is_some_and(lately)
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

    /// What it is to be asked for now: of which boot, and after which of its instants.
    pub(crate) fn ask(&mut self, now: Stamp) -> Option<(u64, PeerStamp)> {
        let boot = self.usable()?.id;
        if self.is_duplicated() {
            return None;
        }
        Some((boot, self.boot(boot).asking.ask(now)?))
    }

    /// The distance at the last solved round; infinite when unknown.
    pub(crate) fn distance_m(&self) -> f64 {
        self.relative.map_or(f64::INFINITY, |relative| {
            relative.body_from_neighbour.translation.norm()
        })
    }

    /// The boots that are refused, while more than one of them is alive.
    fn duplicate_boots(&self, now: Stamp) -> Vec<String> {
        let living: Vec<u64> = self.living_duplicates(now).collect();
        if living.len() < 2 {
            return Vec::new();
        }
        living.into_iter().map(boot_text).collect()
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
            clock_error_s: current
                .and_then(|boot| boot.clock.error_bound(now))
                .map(Span::as_secs_f64),
            clock_stepped: current.map_or(0, |boot| boot.clock.steps()),
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
            team: None,
            refused: self.counts.refused.to_document(),
            bytes: self.counts.bytes,
            duplicate_boots: self.duplicate_boots(now),
        }
    }
}

impl Boot {
    fn new(id: u64) -> Self {
        Self {
            id,
            token: false,
            clock: PeerClock::default(),
            life: Life::default(),
            sequences: Sequences::default(),
            heard_at: None,
            to_echo: None,
            stepped_at: None,
            status: None,
            period: None,
            body_from_target: Transform::identity(),
            track: Track::new(),
            rounds: HeardRounds::default(),
            relayed_at: None,
            asking: Asking::default(),
            exchanges: BTreeMap::new(),
            last_round: None,
        }
    }

    /// Forgets all but who it is and that it lives.
    fn begin_again(&mut self) {
        *self = Self {
            token: self.token,
            life: self.life,
            sequences: self.sequences,
            ..Self::new(self.id)
        };
    }

    /// A packet of it was received: its echo will tell it our clock. Of two that were sent at one time, as an exchange and
    /// the record of its round are, the first to arrive tells it better: the other one only took longer.
    pub(crate) fn note_for_echo(&mut self, sent: PeerStamp, received: Stamp) {
        let heard_ns = sent.on_its_own_clock().as_nanos();
        if self.to_echo.is_none_or(|echo| echo.heard_ns != heard_ns) {
            self.to_echo = Some(Echo {
                heard_ns,
                received_ns: received.as_nanos(),
            });
        }
    }

    /// Takes the four stamps of an echo. What it said before a step of its clock, or of ours, was of another time.
    pub(crate) fn observe(&mut self, stamps: FourStamps) {
        let observed = self.clock.observe(stamps);
        self.note_step(observed, stamps.echoed);
    }

    /// Takes what a relay said of its clock at an instant of it.
    pub(crate) fn tell_clock(&mut self, now: Stamp, at: PeerStamp, offset: Span, error: Span) {
        let observed = self.clock.tell(now, offset, error);
        self.note_step(observed, at);
    }

    fn note_step(&mut self, observed: Observed, at: PeerStamp) {
        if observed == Observed::Stepped {
            self.stepped_at = Some(at);
            self.track = Track::new();
            self.rounds = HeardRounds::default();
            self.asking = Asking::default();
            self.exchanges.clear();
            self.last_round = None;
        }
    }

    /// Whether an instant lies before the last step of its clock.
    pub(crate) fn is_before_step(&self, instant: PeerStamp) -> bool {
        self.stepped_at.is_some_and(|stepped| instant < stepped)
    }

    /// Its odometry at an instant of its own clock.
    pub(crate) fn odometry_at(&self, instant: PeerStamp) -> Result<OdometryPoint, Gap> {
        self.track.near(instant.on_its_own_clock())
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

    impl Neighbour {
        fn is_current(&self, boot: u64) -> bool {
            self.is_in_office(boot).is_ok()
        }
    }
    use crate::clock::ECHOES_MIN;

    fn set_clock(boot: &mut Boot, offset_ms: i64) {
        for _ in 0..ECHOES_MIN {
            let peer = PeerStamp::from_nanos(offset_ms * 1_000_000);
            let now = Stamp::default();
            boot.observe(FourStamps {
                sent: now,
                heard: peer,
                echoed: peer,
                received: now,
            });
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

    fn at(millis: i64) -> Stamp {
        Stamp::default() + Span::millis(millis)
    }

    /// A boot names a stamp that was just sent.
    fn proof(neighbour: &mut Neighbour, boot: u64, millis: i64) -> Result<(), Refused> {
        let proven = neighbour.boot(boot);
        proven.life.prove(at(millis), at(millis - 10));
        let verdict = neighbour.judge(at(millis), boot);
        neighbour.settle(at(millis), boot);
        verdict
    }

    #[test]
    fn a_boot_that_proves_nothing_never_takes_the_place_of_one_that_did() {
        let mut neighbour = Neighbour::default();
        proof(&mut neighbour, 1, 0).unwrap();
        for id in 2..10_000 {
            neighbour.boot(id).heard_at = Some(at(9));
            neighbour.settle(at(10_000), id);
        }
        assert_eq!(neighbour.is_in_office(9_999), Err(Refused::UnprovenBoot));
        assert!(neighbour.is_current(1));
        assert_eq!(neighbour.boots.len(), BOOTS_MAX);
    }

    #[test]
    fn when_the_token_of_the_one_in_office_is_gone_the_next_proof_takes_over() {
        let mut neighbour = Neighbour::default();
        neighbour.boot(1).token = true;
        proof(&mut neighbour, 1, 0).unwrap();
        proof(&mut neighbour, 2, 100).unwrap();
        assert!(neighbour.is_current(1));
        neighbour.lose_token(1);
        proof(&mut neighbour, 2, 300).unwrap();
        assert!(neighbour.is_current(2));
    }

    #[test]
    fn under_a_lingering_token_the_next_one_takes_over_once_its_clock_is_known() {
        let mut neighbour = Neighbour::default();
        neighbour.boot(1).token = true;
        proof(&mut neighbour, 1, 0).unwrap();
        set_clock(neighbour.boot(2), 0);
        proof(&mut neighbour, 2, 499).unwrap();
        assert!(neighbour.is_current(1), "it may only be late");
        proof(&mut neighbour, 2, 500).unwrap();
        assert!(neighbour.is_current(2));
        assert_eq!(proof(&mut neighbour, 1, 1_000), Err(Refused::DuplicateId));
    }

    #[test]
    fn duplicates_are_refused_until_one_has_been_silent_for_five_seconds() {
        let mut neighbour = Neighbour::default();
        neighbour.boot(1).token = true;
        proof(&mut neighbour, 1, 0).unwrap();
        proof(&mut neighbour, 2, 100).unwrap();
        proof(&mut neighbour, 1, 500).unwrap();
        assert_eq!(proof(&mut neighbour, 1, 600), Err(Refused::DuplicateId));
        assert_eq!(proof(&mut neighbour, 2, 700), Err(Refused::DuplicateId));
        // A third one is one more.
        assert_eq!(proof(&mut neighbour, 3, 800), Err(Refused::DuplicateId));
        assert_eq!(neighbour.duplicate_boots(at(800)).len(), 3);
        for millis in (1_000..5_800).step_by(200) {
            assert_eq!(proof(&mut neighbour, 1, millis), Err(Refused::DuplicateId));
        }
        assert_eq!(proof(&mut neighbour, 1, 5_800), Ok(()));
        assert!(neighbour.is_current(1) && neighbour.duplicate_boots(at(5_800)).is_empty());
        // The intruder was only out of reach.
        proof(&mut neighbour, 2, 6_000).unwrap();
        assert_eq!(proof(&mut neighbour, 1, 6_600), Err(Refused::DuplicateId));
    }

    #[test]
    fn a_process_that_was_paused_comes_back_when_the_one_in_its_place_has_gone() {
        let mut neighbour = Neighbour::default();
        proof(&mut neighbour, 1, 0).unwrap();
        proof(&mut neighbour, 2, 1_000).unwrap();
        proof(&mut neighbour, 2, 1_200).unwrap();
        assert!(neighbour.is_current(2));
        proof(&mut neighbour, 1, 6_200).unwrap();
        assert!(neighbour.is_current(1));
    }
}
