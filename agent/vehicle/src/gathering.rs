//! Everything that a round's star is made of: who was measured or heard, with which prior, and both ends of each
//! measurement in the body frames of the two vehicles' instants.

use std::collections::BTreeSet;

use skein_estimation::cooperative::{Contact, Kernel, Measurement};
use skein_estimation::odometry::Gap;
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, World};
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::name::Name;

use crate::clock::PeerStamp;
use crate::dead_reckoning::{DeadReckoning, motion};
use crate::neighbours::{Boot, HeardExchange, Neighbours};
use crate::refused::Refused;
use crate::rounds::{ROUNDS_LATE_MAX, Round};
use crate::translate::{self, Sighting};
use crate::trust::{Mark, Trust};

/// A reading so near to an instant is taken for one at it: no odometry is needed, and a clock offset's jitter moves
/// nothing (at 10 m/s by 2 mm).
pub(crate) const AT_THE_INSTANT: Span = Span::micros(200);
/// Acceleration for which the error of interpolated odometry is allowed for, |a| P^2 / 8.
pub(crate) const INTERPOLATED_ACCELERATION_M_S2: f64 = 1.0;

/// What a round is gathered from.
pub(crate) struct Material<'a, 'r> {
    pub(crate) round: &'r Round,
    pub(crate) neighbours: &'a Neighbours,
    pub(crate) reckoning: &'a DeadReckoning,
    /// Where others' sensors see this vehicle.
    pub(crate) body_from_target: Transform<Body, Sensor>,
    pub(crate) period: Span,
    /// The kernel of the mode, if it has one.
    pub(crate) kernel: Option<Kernel>,
    /// Since when this vehicle has a pose.
    pub(crate) placed_since: Mark,
    /// The trust in its fixes.
    pub(crate) fix_trust: Trust,
    /// Whether what is missing will no longer be waited for.
    pub(crate) deadline_passed: bool,
}

/// A round with everything that can be used of it.
pub(crate) struct Gathered<'a> {
    pub(crate) round: &'a Round,
    pub(crate) spokes: Vec<Spoke>,
    /// Measurements that cannot be used, and of or by whom they are.
    pub(crate) refused: Vec<(Name, Refused)>,
    /// `body@instant_from_body@solved` of this vehicle: the star is solved at the mean time of its readings.
    pub(crate) instant_from_solved: Transform<Body, Body>,
    /// What fixes are judged by.
    pub(crate) fix_contact: Contact,
}

/// Why a round is not gathered now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NotYet;

/// Which way a measurement went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Direction {
    Mine,
    Theirs,
}

/// A neighbour with all measurements between it and this vehicle.
pub(crate) struct Spoke {
    pub(crate) name: Name,
    /// `body@instant_from_body@solved` of the neighbour, as in [`Gathered`].
    pub(crate) instant_from_solved: Transform<Body, Body>,
    /// Its instant, on our clock.
    pub(crate) taken: Stamp,
    pub(crate) prior: Transform<World, Body>,
    pub(crate) ties: Vec<Tie>,
    /// What its measurements are judged by.
    pub(crate) contact: Contact,
    /// Its measurements are judged, but not used.
    pub(crate) quarantined: bool,
}

/// A measurement with both its ends, each in the body frame of that vehicle's instant, and when it was taken after
/// either instant.
pub(crate) struct Tie {
    pub(crate) direction: Direction,
    pub(crate) sighting: Sighting,
    pub(crate) own_end: Transform<Body, Sensor>,
    pub(crate) their_end: Transform<Body, Sensor>,
    pub(crate) own_offset: Span,
    pub(crate) their_offset: Span,
}

/// Why a measurement has no end.
enum NoEnd {
    Wait,
    Never(Refused),
}

impl Gathered<'_> {
    /// How many distances between this vehicle and a neighbour there are in the round.
    pub(crate) fn distances_of(&self, name: Name) -> u64 {
        let spokes = self.spokes.iter().filter(|spoke| spoke.name == name);
        let ties = spokes.flat_map(|spoke| &spoke.ties);
        ties.filter(|tie| matches!(tie.sighting.measurement, Measurement::Distance(_)))
            .count() as u64
    }
}

/// How many of these measurements want a pose of both ends: not distances, which `ranging` reads.
fn want_poses(measured: &[Measured]) -> usize {
    let is_distance = |one: &&Measured| matches!(one.value, MeasuredValue::Distance { .. });
    measured.iter().filter(|one| !is_distance(one)).count()
}

impl<'r> Material<'_, 'r> {
    /// Gathers the round. Waits, unless the deadline has passed, for neighbours who were told something and have not
    /// answered, and for odometry around measurements.
    pub(crate) fn gather(&self) -> Result<Gathered<'r>, NotYet> {
        self.wait_for_answers()?;
        let mut refused = Vec::new();
        let spokes = self.spokes(&mut refused)?;
        let own_offsets = spokes
            .iter()
            .flat_map(|spoke| &spoke.ties)
            .map(|tie| tie.own_offset);
        let own_offset =
            mean(own_offsets.chain(self.round.fixes.iter().map(|fix| fix.taken_offset)));
        let instant_from_solved = self
            .own_motion(self.round.instant + own_offset)
            .unwrap_or_else(|_| Transform::identity());
        Ok(Gathered {
            round: self.round,
            spokes,
            refused,
            instant_from_solved,
            fix_contact: self.contact(&self.fix_trust),
        })
    }

    fn contact(&self, trust: &Trust) -> Contact {
        let judged = self.kernel.zip(self.round.odometry.as_ref());
        judged.map_or(Contact::FRESH, |(kernel, point)| {
            trust.contact(point, self.period, &self.placed_since, &kernel)
        })
    }

    /// Everybody whom this vehicle measured in the round, or who was heard in it.
    fn spokes(&self, refused: &mut Vec<(Name, Refused)>) -> Result<Vec<Spoke>, NotYet> {
        let heard = self.neighbours.iter().filter(|(_, neighbour)| {
            neighbour
                .usable()
                .is_some_and(|boot| boot.exchanges.contains_key(&self.round.index))
        });
        let heard = heard.map(|(name, _)| name);
        let names: BTreeSet<Name> = self.round.measured.keys().copied().chain(heard).collect();
        // The nearest first: a star has room for so many.
        let distance_m = |name: &Name| {
            let neighbour = self.neighbours.get(*name);
            neighbour.map_or(f64::INFINITY, |neighbour| neighbour.distance_m())
        };
        let mut names: Vec<Name> = names.into_iter().collect();
        names.sort_by(|a, b| distance_m(a).total_cmp(&distance_m(b)).then(a.cmp(b)));
        let mut spokes = Vec::new();
        for name in names {
            spokes.extend(self.spoke(name, refused)?);
        }
        Ok(spokes)
    }

    /// Whoever was told something this round is expected to answer, if its clock is known so that the answer is of use.
    fn wait_for_answers(&self) -> Result<(), NotYet> {
        let answered = |name: &Name| {
            let boot = self
                .neighbours
                .get(*name)
                .and_then(|neighbour| neighbour.usable());
            boot.is_none_or(|boot| boot.exchanges.contains_key(&self.round.index))
        };
        if self.deadline_passed || self.round.told.iter().all(answered) {
            Ok(())
        } else {
            Err(NotYet)
        }
    }

    fn spoke(
        &self,
        name: Name,
        refused: &mut Vec<(Name, Refused)>,
    ) -> Result<Option<Spoke>, NotYet> {
        let mine = self
            .round
            .measured
            .get(&name)
            .map_or(&[][..], Vec::as_slice);
        let mut refuse = |why: Refused, times: usize| {
            refused.extend(std::iter::repeat_n((name, why), times));
        };
        let neighbour = self.neighbours.get(name);
        let usable = neighbour.and_then(|neighbour| Some((neighbour, neighbour.usable()?)));
        let Some((neighbour, boot)) = usable else {
            refuse(Refused::ClockUnknown, mine.len());
            return Ok(None);
        };
        let Some(exchange) = boot.exchanges.get(&self.round.index) else {
            let lost = if neighbour.is_located() {
                mine.len()
            } else {
                want_poses(mine)
            };
            refuse(Refused::NoPrior, lost);
            return Ok(None);
        };
        let Some(prior) = exchange.prior else {
            refuse(
                Refused::NoPrior,
                want_poses(mine) + want_poses(&exchange.measured),
            );
            return Ok(None);
        };
        let mine = mine.iter().map(|measured| (Direction::Mine, measured));
        let theirs = exchange
            .measured
            .iter()
            .map(|measured| (Direction::Theirs, measured));
        let mut ties = Vec::new();
        for (direction, measured) in mine.chain(theirs) {
            match self.tie(direction, measured, boot, exchange) {
                Ok(tie) => ties.push(tie),
                Err(NoEnd::Wait) if !self.deadline_passed => return Err(NotYet),
                Err(NoEnd::Wait) => refuse(Refused::NoOdometry, 1),
                Err(NoEnd::Never(why)) => refuse(why, 1),
            }
        }
        let taken = boot
            .clock
            .to_mine(exchange.instant)
            .unwrap_or(self.round.instant);
        let their_offset = mean(ties.iter().map(|tie| tie.their_offset));
        let solved = exchange.instant.plus(their_offset);
        let instant_from_solved =
            their_motion(boot, exchange.instant, solved).unwrap_or_else(|_| Transform::identity());
        Ok((!ties.is_empty()).then_some(Spoke {
            name,
            instant_from_solved,
            taken,
            prior,
            ties,
            contact: self.contact(&neighbour.trust),
            quarantined: neighbour.trust.is_quarantined(),
        }))
    }

    /// Both ends of a measurement. The measuring end comes with it; the measured end is that vehicle's motion between
    /// its round and the reading, then its target.
    fn tie(
        &self,
        direction: Direction,
        measured: &Measured,
        boot: &Boot,
        exchange: &HeardExchange,
    ) -> Result<Tie, NoEnd> {
        let mut sighting = translate::sighting(&measured.value).map_err(NoEnd::Never)?;
        let offset = Span::micros(i64::from(measured.taken_offset_us));
        if offset > Span::ZERO {
            return Err(NoEnd::Never(Refused::FromTheFuture));
        }
        if -offset > self.period * (ROUNDS_LATE_MAX + 1) {
            return Err(NoEnd::Never(Refused::TooLate));
        }
        let unknown = NoEnd::Never(Refused::ClockUnknown);
        let (own_end, their_end, own_offset, their_offset) = match direction {
            Direction::Mine => {
                let taken = boot
                    .clock
                    .to_peer(self.round.instant + offset)
                    .ok_or(unknown)?;
                let their_end =
                    their_motion(boot, exchange.instant, taken)? * boot.body_from_target;
                (
                    sighting.from_end,
                    their_end,
                    offset,
                    taken.since(exchange.instant),
                )
            }
            Direction::Theirs => {
                let taken = boot
                    .clock
                    .to_mine(exchange.instant.plus(offset))
                    .ok_or(unknown)?;
                let own_end = self.own_motion(taken)? * self.body_from_target;
                (
                    own_end,
                    sighting.from_end,
                    taken - self.round.instant,
                    offset,
                )
            }
        };
        if offset != Span::ZERO && sighting.noise.translation > 0.0 {
            let period_s = self.period.as_secs_f64();
            let interpolation_m = INTERPOLATED_ACCELERATION_M_S2 * period_s * period_s / 8.0;
            sighting.noise.translation = sighting.noise.translation.hypot(interpolation_m);
        }
        Ok(Tie {
            direction,
            sighting,
            own_end,
            their_end,
            own_offset,
            their_offset,
        })
    }

    /// `body@round_from_body@taken` of this vehicle.
    fn own_motion(&self, taken: Stamp) -> Result<Transform<Body, Body>, NoEnd> {
        if (taken - self.round.instant).abs() <= AT_THE_INSTANT {
            return Ok(Transform::identity());
        }
        let at_round = self
            .round
            .odometry
            .as_ref()
            .ok_or(NoEnd::Never(Refused::NoOdometry))?;
        let at_taken = self.reckoning.near(taken).map_err(no_end)?;
        motion(at_round, &at_taken).ok_or(NoEnd::Never(Refused::NoOdometry))
    }
}

/// The mean of some spans; nothing of none.
fn mean(spans: impl Iterator<Item = Span>) -> Span {
    let (sum, count) = spans.fold((0i64, 0i64), |(sum, count), span| {
        (sum.saturating_add(span.as_nanos()), count + 1)
    });
    Span::from_nanos(sum.checked_div(count).unwrap_or(0))
}

/// `body@round_from_body@taken` of a neighbour, by its records.
fn their_motion(
    boot: &Boot,
    instant: PeerStamp,
    taken: PeerStamp,
) -> Result<Transform<Body, Body>, NoEnd> {
    if taken.since(instant).abs() <= AT_THE_INSTANT {
        return Ok(Transform::identity());
    }
    let at_round = boot.odometry_at(instant).map_err(no_end)?;
    let at_taken = boot.odometry_at(taken).map_err(no_end)?;
    motion(&at_round, &at_taken).ok_or(NoEnd::Never(Refused::NoOdometry))
}

const fn no_end(gap: Gap) -> NoEnd {
    match gap {
        Gap::NotYet => NoEnd::Wait,
        Gap::Before | Gap::Interrupted => NoEnd::Never(Refused::NoOdometry),
    }
}
