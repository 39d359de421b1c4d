//! The rounds: instants kP of this vehicle's own clock. Which measurements belong to which, which are open, which is
//! to be solved next. There is no fleet clock and no leader.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use skein_estimation::odometry::{Gap, OdometryPoint};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, World};
use skein_proto::frame::{FixValue, RelativeValue};
use skein_proto::limits::MEASURED_PER_EXCHANGE_MAX;
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::name::Name;

use crate::dead_reckoning::{DeadReckoning, motion};
use crate::refused::Refused;
use crate::translate;

/// How many rounds a measurement may come late, and a neighbour's round may lie ahead of ours.
pub(crate) const ROUNDS_LATE_MAX: i64 = 5;
/// Readings that wait for their round.
const WAITING_MAX: usize = 256;
/// Rounds open at a time; beyond, the oldest is solved with what there is.
pub(crate) const OPEN_MAX: usize = 16;

/// The rounds of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Rounds {
    period: Span,
    wait: Span,
    next: i64,
    closed: i64,
    pub(crate) open: VecDeque<Round>,
    waiting: Vec<Waiting>,
}

/// One round, from its opening (the neighbours are told) to its solution.
#[derive(Clone, Debug)]
pub(crate) struct Round {
    pub(crate) index: i64,
    pub(crate) instant: Stamp,
    /// None when odometry does not reach the instant: the vehicle then speaks, but does not solve.
    pub(crate) odometry: Option<OdometryPoint>,
    /// What this vehicle measured, as it crosses the wire.
    pub(crate) measured: BTreeMap<Name, Vec<Measured>>,
    pub(crate) fixes: Vec<Fix>,
    /// To whom an exchange was sent.
    pub(crate) told: BTreeSet<Name>,
}

/// An absolute fix with its lever arm at the round's instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fix {
    pub(crate) sensor: Name,
    pub(crate) value: FixValue,
    pub(crate) body_from_sensor: Transform<Body, Sensor>,
    pub(crate) taken_offset: Span,
}

/// A reading that waits for its round.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    sensor: Name,
    taken: Stamp,
    body_from_sensor: Transform<Body, Sensor>,
    value: WaitingValue,
}

#[derive(Clone, Copy, Debug)]
enum WaitingValue {
    Relative { target: Name, value: RelativeValue },
    Fix(FixValue),
}

/// Something that was not used, and whom or which sensor it concerns.
#[derive(Clone, Debug)]
pub(crate) struct Loss {
    pub(crate) sensor: Name,
    pub(crate) target: Option<Name>,
    pub(crate) why: Refused,
}

/// Which rounds can still take what is heard.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Horizon {
    closed: i64,
    newest: i64,
}

impl Horizon {
    pub(crate) fn admits(self, round: i64) -> Result<(), Refused> {
        if round <= self.closed {
            Err(Refused::TooLate)
        } else if round > self.newest.saturating_add(ROUNDS_LATE_MAX) {
            Err(Refused::FromTheFuture)
        } else {
            Ok(())
        }
    }
}

impl Rounds {
    pub(crate) fn new(now: Stamp, period: Span, wait: Span) -> Self {
        let closed = now.as_nanos().div_euclid(period.as_nanos());
        Self {
            period,
            wait,
            next: closed + 1,
            closed,
            open: VecDeque::new(),
            waiting: Vec::new(),
        }
    }

    pub(crate) fn horizon(&self, now: Stamp) -> Horizon {
        let newest = now.as_nanos().div_euclid(self.period.as_nanos());
        Horizon {
            closed: self.closed,
            newest: newest.max(self.next),
        }
    }

    /// Keeps a reading until its round: the first at or after its time that is not yet open.
    pub(crate) fn keep_relative(
        &mut self,
        sensor: Name,
        taken: Stamp,
        body_from_sensor: Transform<Body, Sensor>,
        target: Name,
        value: RelativeValue,
    ) -> Result<(), Refused> {
        self.keep(Waiting {
            sensor,
            taken,
            body_from_sensor,
            value: WaitingValue::Relative { target, value },
        })
    }

    /// Keeps a fix until its round.
    pub(crate) fn keep_fix(
        &mut self,
        sensor: Name,
        taken: Stamp,
        body_from_sensor: Transform<Body, Sensor>,
        value: FixValue,
    ) -> Result<(), Refused> {
        self.keep(Waiting {
            sensor,
            taken,
            body_from_sensor,
            value: WaitingValue::Fix(value),
        })
    }

    fn keep(&mut self, reading: Waiting) -> Result<(), Refused> {
        if reading.taken < self.instant(self.next - ROUNDS_LATE_MAX) {
            return Err(Refused::TooLate);
        }
        if self.waiting.len() >= WAITING_MAX {
            return Err(Refused::Full);
        }
        self.waiting.push(reading);
        Ok(())
    }

    fn instant(&self, index: i64) -> Stamp {
        Stamp::default() + self.period * index
    }

    /// Opens the next round if its instant has come and odometry reaches it, or will not reach it in time.
    pub(crate) fn open_next(
        &mut self,
        now: Stamp,
        reckoning: &DeadReckoning,
        losses: &mut Vec<Loss>,
    ) -> Option<Round> {
        self.skip_ages(now);
        let instant = self.instant(self.next);
        if now < instant {
            return None;
        }
        let odometry = match reckoning.at(instant) {
            Ok(point) => Some(point),
            Err(Gap::NotYet) if now < instant + self.wait => return None,
            Err(_) => None,
        };
        let mut round = Round {
            index: self.next,
            instant,
            odometry,
            measured: BTreeMap::new(),
            fixes: Vec::new(),
            told: BTreeSet::new(),
        };
        self.next += 1;
        self.fill(&mut round, reckoning, losses);
        Some(round)
    }

    /// After a pause (a debugger, a suspended machine) there is nothing to gain from rounds long gone.
    fn skip_ages(&mut self, now: Stamp) {
        let oldest_useful = now.as_nanos().div_euclid(self.period.as_nanos()) - OPEN_MAX as i64;
        self.next = self.next.max(oldest_useful);
    }

    /// Gives a round the readings that belong to it.
    fn fill(&mut self, round: &mut Round, reckoning: &DeadReckoning, losses: &mut Vec<Loss>) {
        let too_late = self.instant(round.index - ROUNDS_LATE_MAX);
        let mut waiting = std::mem::take(&mut self.waiting);
        waiting.retain(|reading| {
            if reading.taken > round.instant {
                return true;
            }
            if round.odometry.is_none() && reading.taken >= too_late {
                return true;
            }
            let lost = |why| Loss {
                sensor: reading.sensor,
                target: reading.target(),
                why,
            };
            match reading.reduce(round, reckoning) {
                _ if reading.taken < too_late && round.odometry.is_some() => {
                    losses.push(lost(Refused::TooLate));
                }
                Err(why) => losses.push(lost(why)),
                Ok(Reduced::Fix(fix)) => round.fixes.push(fix),
                Ok(Reduced::Relative(target, measured)) => {
                    if !round.take(target, measured) {
                        losses.push(lost(Refused::Superseded));
                    }
                }
            }
            false
        });
        self.waiting = waiting;
    }

    /// When the round at hand must be solved, whoever is missing.
    pub(crate) fn deadline(&self, round: &Round) -> Stamp {
        round.instant + self.wait
    }

    /// When the round at hand is solved at the earliest, though everybody told has answered: a quarter of a period after
    /// its instant, so that what comes from somebody not told yet, a first contact, still counts.
    pub(crate) fn earliest(&self, round: &Round) -> Stamp {
        round.instant + Span::from_nanos(self.period.as_nanos() / 4)
    }

    /// The round at hand is solved, or given up.
    pub(crate) fn close(&mut self, index: i64) {
        self.closed = index;
    }

    /// When something is due without any input.
    pub(crate) fn wake_at(&self, now: Stamp) -> Stamp {
        let opening = self.instant(self.next);
        let opening = if opening > now {
            opening
        } else {
            opening + self.wait
        };
        self.open.front().map_or(opening, |round| {
            let earliest = self.earliest(round);
            let due = if earliest > now {
                earliest.min(self.deadline(round))
            } else {
                self.deadline(round)
            };
            opening.min(due)
        })
    }
}

/// A reading in the body frame of its round's instant.
enum Reduced {
    Relative(Name, Measured),
    Fix(Fix),
}

impl Waiting {
    fn target(&self) -> Option<Name> {
        match self.value {
            WaitingValue::Relative { target, .. } => Some(target),
            WaitingValue::Fix(_) => None,
        }
    }

    /// `body@round_from_sensor@taken`: the motion since the reading, then the mount.
    fn reduce(&self, round: &Round, reckoning: &DeadReckoning) -> Result<Reduced, Refused> {
        let at_round = round.odometry.as_ref().ok_or(Refused::NoOdometry)?;
        // Everybody uses the time as it crosses the wire.
        let taken_offset_us = i32::try_from((self.taken - round.instant).as_micros_rounded())
            .map_err(|_| Refused::TooLate)?;
        let at_taken = match reckoning.at(round.instant + Span::micros(i64::from(taken_offset_us)))
        {
            Ok(point) => point,
            Err(Gap::Before) => return Err(Refused::TooLate),
            Err(Gap::NotYet | Gap::Interrupted) => return Err(Refused::NoOdometry),
        };
        let body_from_sensor =
            motion(at_round, &at_taken).ok_or(Refused::NoOdometry)? * self.body_from_sensor;
        match self.value {
            WaitingValue::Relative { target, value } => {
                let measured = Measured {
                    taken_offset_us,
                    value: translate::fold(&value, &body_from_sensor),
                };
                measured.check()?;
                Ok(Reduced::Relative(target, measured))
            }
            WaitingValue::Fix(value) => Ok(Reduced::Fix(Fix {
                sensor: self.sensor,
                value,
                body_from_sensor,
                taken_offset: Span::micros(i64::from(taken_offset_us)),
            })),
        }
    }
}

impl Fix {
    /// The body's pose at the round's instant, by a fix of the whole pose.
    pub(crate) fn world_from_body(&self) -> Option<Transform<World, Body>> {
        let FixValue::Pose {
            world_from_sensor, ..
        } = &self.value
        else {
            return None;
        };
        let world_from_sensor = translate::transform::<World, Sensor>(world_from_sensor).ok()?;
        Some(world_from_sensor * self.body_from_sensor.inverse())
    }
}

impl Round {
    /// Takes a measurement: one of each kind, the nearest to the instant, and no more kinds than an exchange holds.
    /// False when one, this or another, was left out.
    fn take(&mut self, target: Name, measured: Measured) -> bool {
        let list = self.measured.entry(target).or_default();
        let same_kind = |other: &Measured| kind(&other.value) == kind(&measured.value);
        if let Some(other) = list.iter_mut().find(|other| same_kind(other)) {
            if measured.taken_offset_us.unsigned_abs() < other.taken_offset_us.unsigned_abs() {
                *other = measured;
            }
            return false;
        }
        let room = list.len() < MEASURED_PER_EXCHANGE_MAX;
        if room {
            list.push(measured);
        }
        room
    }
}

fn kind(value: &MeasuredValue) -> std::mem::Discriminant<MeasuredValue> {
    std::mem::discriminant(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Start;
    use crate::told_pose::ToldPose;
    use skein_proto::frame::OdometryFrame;

    fn at(millis: i64) -> Stamp {
        Stamp::default() + Span::millis(millis)
    }

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    /// One metre a second forward until `until_ms`.
    fn driving(until_ms: i64) -> DeadReckoning {
        let mut reckoning = DeadReckoning::new(Start::Pose(ToldPose::exact(Transform::identity())));
        for start in (0..until_ms).step_by(100) {
            let frame = OdometryFrame {
                since_ns: start * 1_000_000,
                taken_ns: (start + 100) * 1_000_000,
                motion: [0.0, 0.0, 0.0, 0.1, 0.0, 0.0],
                rotation_sigma_rad: 0.01,
                translation_sigma_m: 0.01,
            };
            reckoning
                .add(name("wheels"), &Transform::identity(), &frame)
                .unwrap();
        }
        reckoning
    }

    fn rounds() -> Rounds {
        Rounds::new(at(0), Span::millis(200), Span::millis(300))
    }

    fn distance(metres: f64) -> RelativeValue {
        RelativeValue::Distance {
            distance_m: metres,
            sigma_m: 0.1,
        }
    }

    #[test]
    fn a_reading_belongs_to_the_first_round_at_or_after_its_time_and_is_brought_to_its_instant() {
        let (mut rounds, mut losses) = (rounds(), Vec::new());
        rounds
            .keep_relative(
                name("uwb"),
                at(150),
                Transform::identity(),
                name("v2"),
                distance(5.0),
            )
            .unwrap();
        let round = rounds
            .open_next(at(200), &driving(200), &mut losses)
            .unwrap();
        let measured = round.measured[&name("v2")][0];
        assert_eq!(measured.taken_offset_us, -50_000);
        let MeasuredValue::Distance { origin_m, .. } = measured.value else {
            panic!("{measured:?}")
        };
        assert!(
            (origin_m[0] + 0.05).abs() < 1e-12,
            "the sensor was 5 cm behind where the body is now"
        );
        assert!(losses.is_empty());
    }

    #[test]
    fn a_reading_that_comes_after_its_round_was_opened_goes_to_the_next_one() {
        let (mut rounds, mut losses) = (rounds(), Vec::new());
        rounds
            .open_next(at(200), &driving(400), &mut losses)
            .unwrap();
        rounds
            .keep_relative(
                name("uwb"),
                at(150),
                Transform::identity(),
                name("v2"),
                distance(5.0),
            )
            .unwrap();
        let round = rounds
            .open_next(at(400), &driving(400), &mut losses)
            .unwrap();
        assert_eq!(round.measured[&name("v2")][0].taken_offset_us, -250_000);
    }

    #[test]
    fn five_rounds_late_is_taken_and_more_is_too_late() {
        let (mut rounds, mut losses) = (rounds(), Vec::new());
        for _ in 0..9 {
            rounds
                .open_next(at(1800), &driving(1800), &mut losses)
                .unwrap();
        }
        let mut keep = |ms| {
            rounds.keep_relative(
                name("uwb"),
                at(ms),
                Transform::identity(),
                name("v2"),
                distance(1.0),
            )
        };
        assert_eq!(keep(1000), Ok(()), "round 10 lies at 2000 ms");
        assert_eq!(keep(999), Err(Refused::TooLate));
    }

    #[test]
    fn a_round_waits_for_odometry_and_no_longer_than_its_wait() {
        let (mut rounds, mut losses) = (rounds(), Vec::new());
        assert!(
            rounds
                .open_next(at(499), &driving(100), &mut losses)
                .is_none()
        );
        assert!(
            rounds
                .open_next(at(500), &driving(100), &mut losses)
                .unwrap()
                .odometry
                .is_none()
        );
    }

    #[test]
    fn of_two_readings_of_one_kind_the_one_nearer_to_the_instant_is_used() {
        let (mut rounds, mut losses) = (rounds(), Vec::new());
        for (taken, metres) in [(120, 1.0), (180, 2.0), (160, 3.0)] {
            let kept = rounds.keep_relative(
                name("uwb"),
                at(taken),
                Transform::identity(),
                name("v2"),
                distance(metres),
            );
            kept.unwrap();
        }
        let round = rounds
            .open_next(at(200), &driving(200), &mut losses)
            .unwrap();
        let [measured] = round.measured[&name("v2")][..] else {
            panic!("{round:?}")
        };
        assert!(matches!(
            measured.value,
            MeasuredValue::Distance {
                distance_m: 2.0,
                ..
            }
        ));
        assert_eq!(
            losses
                .iter()
                .filter(|loss| loss.why == Refused::Superseded)
                .count(),
            2
        );
    }

    #[test]
    fn waiting_readings_are_bounded() {
        let mut rounds = rounds();
        let mut keep = || {
            rounds.keep_relative(
                name("uwb"),
                at(150),
                Transform::identity(),
                name("v2"),
                distance(1.0),
            )
        };
        for _ in 0..WAITING_MAX {
            keep().unwrap();
        }
        assert_eq!(keep(), Err(Refused::Full));
    }

    #[test]
    fn after_a_long_pause_the_rounds_long_gone_are_left_out() {
        let (mut rounds, mut losses) = (rounds(), Vec::new());
        let round = rounds
            .open_next(at(3_600_000), &driving(100), &mut losses)
            .unwrap();
        assert_eq!(round.index, 18_000 - OPEN_MAX as i64);
    }
}
