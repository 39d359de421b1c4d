//! Puts one round together as the local star of the cooperative pipeline: my pose at my instant, each neighbour's pose
//! at *its* instant nearest to mine, and what either measured of the other, each at the time it was taken.

use std::collections::BTreeSet;

use skein_estimation::cooperative::{Contact, NeighbourIndex, Star};
use skein_estimation::odometry::Gap;
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, World};
use skein_proto::measured::Measured;
use skein_proto::name::Name;

use crate::clock::PeerStamp;
use crate::dead_reckoning::{DeadReckoning, motion};
use crate::neighbours::{Boot, HeardExchange, Neighbours};
use crate::refused::Refused;
use crate::rounds::{ROUNDS_LATE_MAX, Round};
use crate::translate::{self, Sighting};

/// A reading so near to an instant is taken for one at it: no odometry is needed, and a clock offset's jitter moves
/// nothing (at 10 m/s by 2 mm).
const AT_THE_INSTANT: Span = Span::micros(200);
/// Acceleration for which the error of interpolated odometry is allowed for, |a| P^2 / 8.
const INTERPOLATED_ACCELERATION_M_S2: f64 = 1.0;

/// What a star is built from.
pub(crate) struct Material<'a> {
    pub(crate) round: &'a Round,
    pub(crate) neighbours: &'a Neighbours,
    pub(crate) reckoning: &'a DeadReckoning,
    /// Where others' sensors see this vehicle.
    pub(crate) body_from_target: Transform<Body, Sensor>,
    pub(crate) period: Span,
    /// Whether what is missing will no longer be waited for.
    pub(crate) deadline_passed: bool,
}

/// A star that was built, and what went into it.
#[derive(Clone, Debug)]
pub(crate) struct Built {
    pub(crate) used: Vec<Used>,
    /// Measurements that were not used, and of or by whom they are.
    pub(crate) refused: Vec<(Name, Refused)>,
    pub(crate) fixes: usize,
    /// Fixes that were not used, and of which sensor they are.
    pub(crate) fixes_refused: Vec<(Name, Refused)>,
    /// `body@instant_from_body@solved` of this vehicle: the star is solved at the mean time of its readings.
    pub(crate) instant_from_solved: Transform<Body, Body>,
}

/// One neighbour in a star.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Used {
    pub(crate) name: Name,
    pub(crate) index: NeighbourIndex,
    pub(crate) edges: u64,
    /// Its instant, on our clock.
    pub(crate) taken: Stamp,
    /// The same as [`Built::instant_from_solved`], of the neighbour.
    pub(crate) instant_from_solved: Transform<Body, Body>,
}

impl Default for Built {
    fn default() -> Self {
        Self {
            used: Vec::new(),
            refused: Vec::new(),
            fixes: 0,
            fixes_refused: Vec::new(),
            instant_from_solved: Transform::identity(),
        }
    }
}

impl Built {
    pub(crate) fn edges(&self) -> u64 {
        self.used.iter().map(|used| used.edges).sum::<u64>() + self.fixes as u64
    }
}

/// Why a star is not built now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NotYet;

/// Which way a measurement went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Mine,
    Theirs,
}

/// A neighbour with all measurements between it and this vehicle.
struct Spoke<'a> {
    name: Name,
    boot: &'a Boot,
    exchange: &'a HeardExchange,
    /// Its instant, on our clock.
    taken: Stamp,
    prior: Transform<World, Body>,
    ties: Vec<Tie>,
}

/// A measurement with both its ends, each in the body frame of that vehicle's instant, and when it was taken after
/// either instant.
struct Tie {
    direction: Direction,
    sighting: Sighting,
    own_end: Transform<Body, Sensor>,
    their_end: Transform<Body, Sensor>,
    own_offset: Span,
    their_offset: Span,
}

/// Why a measurement has no end.
enum NoEnd {
    Wait,
    Never(Refused),
}

impl Material<'_> {
    /// Fills `star` with the round, around `prior`. Waits, unless the deadline has passed, for neighbours who were told
    /// something and have not answered, and for odometry around measurements.
    ///
    /// Each vehicle's unknown is its pose at its instant, but its anchor stands at the mean time of its readings: held
    /// at the instant, a prior resists that a turn at the time of the readings also moves the vehicle since then, and
    /// late readings cost a third of the accuracy (0.185 m against 0.140 m for readings 150 ms late).
    pub(crate) fn build(
        &self,
        star: &mut Star,
        prior: Transform<World, Body>,
    ) -> Result<Built, NotYet> {
        let mut built = Built::default();
        self.wait_for_answers()?;
        let spokes = self.spokes(&mut built)?;
        let own_offsets = spokes
            .iter()
            .flat_map(|spoke| &spoke.ties)
            .map(|tie| tie.own_offset);
        let own_offset =
            mean(own_offsets.chain(self.round.fixes.iter().map(|fix| fix.taken_offset)));
        built.instant_from_solved = self
            .own_motion(self.round.instant + own_offset)
            .unwrap_or_else(|_| Transform::identity());
        if star
            .restart((prior * built.instant_from_solved).reframe())
            .is_err()
        {
            return Ok(built);
        }
        for spoke in spokes {
            add(star, &spoke, &mut built);
        }
        let solved_from_instant = built.instant_from_solved.inverse();
        for fix in &self.round.fixes {
            let end = solved_from_instant * fix.body_from_sensor;
            let added = translate::fix(&fix.value).and_then(|fixed| {
                let end = end * fixed.sensor_from_point;
                Ok(star.fix(fixed.measurement, fixed.noise, end)?)
            });
            match added {
                Ok(()) => built.fixes += 1,
                Err(why) => built.fixes_refused.push((fix.sensor, why)),
            }
        }
        Ok(built)
    }

    /// Everybody whom this vehicle measured in the round, or who was heard in it.
    fn spokes(&self, built: &mut Built) -> Result<Vec<Spoke<'_>>, NotYet> {
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
            spokes.extend(self.spoke(name, built)?);
        }
        Ok(spokes)
    }

    /// What becomes of a round of a vehicle that has no pose: nothing of it can be used.
    pub(crate) fn without_prior(&self) -> Built {
        let why = if self.round.odometry.is_some() {
            Refused::Unplaced
        } else {
            Refused::NoOdometry
        };
        let lost = |(name, list): (&Name, &Vec<Measured>)| vec![(*name, why.clone()); list.len()];
        let fixes = self.round.fixes.iter();
        Built {
            refused: self.round.measured.iter().flat_map(lost).collect(),
            fixes_refused: fixes.map(|fix| (fix.sensor, why.clone())).collect(),
            ..Built::default()
        }
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

    fn spoke(&self, name: Name, built: &mut Built) -> Result<Option<Spoke<'_>>, NotYet> {
        let mine = self
            .round
            .measured
            .get(&name)
            .map_or(&[][..], Vec::as_slice);
        let mut refuse = |why: Refused, times: usize| {
            built
                .refused
                .extend(std::iter::repeat_n((name, why), times));
        };
        let Some(boot) = self
            .neighbours
            .get(name)
            .and_then(|neighbour| neighbour.usable())
        else {
            refuse(Refused::ClockUnknown, mine.len());
            return Ok(None);
        };
        let Some(exchange) = boot.exchanges.get(&self.round.index) else {
            refuse(Refused::NoPrior, mine.len());
            return Ok(None);
        };
        let Some(prior) = exchange.prior else {
            refuse(Refused::NoPrior, mine.len() + exchange.measured.len());
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
        Ok((!ties.is_empty()).then_some(Spoke {
            name,
            boot,
            exchange,
            taken,
            prior,
            ties,
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
        let at_taken = self.reckoning.at(taken).map_err(no_end)?;
        motion(at_round, &at_taken).ok_or(NoEnd::Never(Refused::NoOdometry))
    }
}

/// Puts a neighbour and all its measurements into a star whose centre is solved at `built.instant_from_solved`.
fn add(star: &mut Star, spoke: &Spoke<'_>, built: &mut Built) {
    let their_offset = mean(spoke.ties.iter().map(|tie| tie.their_offset));
    let instant = spoke.exchange.instant;
    let instant_from_solved = their_motion(spoke.boot, instant, instant.plus(their_offset))
        .unwrap_or_else(|_| Transform::identity());
    let index = match star.add_neighbour(
        (spoke.prior * instant_from_solved).reframe(),
        Contact::FRESH,
    ) {
        Ok(index) => index,
        Err(why) => {
            let why = Refused::from(why);
            built
                .refused
                .extend(spoke.ties.iter().map(|_| (spoke.name, why.clone())));
            return;
        }
    };
    let (own_back, their_back) = (
        built.instant_from_solved.inverse(),
        instant_from_solved.inverse(),
    );
    let mut edges = 0;
    for tie in &spoke.ties {
        let Sighting {
            measurement, noise, ..
        } = tie.sighting;
        let (own_end, their_end) = (own_back * tie.own_end, their_back * tie.their_end);
        let added = match tie.direction {
            Direction::Mine => star.measured_by_me(index, measurement, noise, own_end, their_end),
            Direction::Theirs => {
                star.measured_by_neighbour(index, measurement, noise, own_end, their_end)
            }
        };
        match added {
            Ok(()) => edges += 1,
            Err(why) => built.refused.push((spoke.name, why.into())),
        }
    }
    built.used.push(Used {
        name: spoke.name,
        index,
        edges,
        taken: spoke.taken,
        instant_from_solved,
    });
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
