//! Whom to doubt: a vehicle whose measurements fit nobody, and one whose odometry does not fit what is measured.

use std::collections::{BTreeMap, VecDeque};

use crate::VehicleId;

/// Measurements that count as one a round later.
const FORGETTING: f64 = 0.9;
/// Share of a vehicle's measurements that weigh less than one half, above which it is put into quarantine.
const DOUBTED_ABOVE: f64 = 0.6;
/// Measurements, with forgetting, without which nobody is judged.
const COUNT_MIN: f64 = 4.0;
/// Share of the innovations of a vehicle in quarantine that fail the gate, below which it is taken back.
const TRUSTED_BELOW: f64 = 0.2;
/// Bad measurements, with forgetting, that are not of the one vehicle of which most are bad, below which it is a line of
/// sight that is bad and not who looks along it.
const ELSEWHERE_MIN: f64 = 1.5;
/// Innovations, with forgetting, without which nobody is taken back.
const TRUSTED_COUNT_MIN: f64 = 6.0;
/// What is left of bad measurements of somebody before they are no more kept.
const FORGOTTEN: f64 = 0.01;
/// Rounds over which odometry is judged.
const ODOMETRY_ROUNDS: usize = 5;
/// Odometry residuals over their expectation above which a vehicle's biases are found anew; honest vehicles stay below
/// 3.6.
const BIASED_ABOVE: f64 = 4.0;
/// The same above which it lies, if its biases have just been found anew.
const LYING_ABOVE: f64 = 9.0;
/// Degrees of freedom without which odometry is not judged: nobody measured the vehicle.
const EXPECTED_MIN: f64 = 0.5;
/// Rounds in a row below [`BIASED_ABOVE`] after which odometry is believed again.
const BELIEVED_AFTER: u32 = 20;
/// Rounds that new biases are given to explain the odometry.
const NEW_BIASES_ROUNDS: u32 = 10;
/// Rounds within which a vehicle that is misplaced twice is so by its odometry.
const AGAIN_ROUNDS: u32 = 30;
/// Standard deviations of where a vehicle is that is found misplaced, radians and metres.
pub(super) const MISPLACED_BY: (f64, f64) = (0.5, 5.0);
/// The stated noise of odometry that lies is taken this many times.
pub(super) const LYING_NOISE: f64 = 10.0;

/// What speaks against the measurements of one vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Doubt {
    bad: f64,
    all: f64,
    /// The bad ones by whom they are of.
    bad_of: BTreeMap<VehicleId, f64>,
    pub(super) is_quarantined: bool,
}

impl Doubt {
    /// The share of its measurements that are bad.
    pub(super) fn share(&self) -> f64 {
        if self.all > 0.0 {
            self.bad / self.all
        } else {
            0.0
        }
    }

    /// Whether there is enough to judge by, and nothing that speaks against it.
    pub(super) fn is_trusted(&self) -> bool {
        !self.is_quarantined && self.all > COUNT_MIN && self.share() < TRUSTED_BELOW
    }

    /// Whether it should be put into quarantine.
    pub(super) fn is_doubted(&self) -> bool {
        let most = self.bad_of.values().copied().fold(0.0, f64::max);
        !self.is_quarantined
            && self.all > COUNT_MIN
            && self.share() > DOUBTED_ABOVE
            && self.bad - most > ELSEWHERE_MIN
    }

    /// A round's measurements: of whom, and whether they are bad, by their weights or, in quarantine, by the gate.
    pub(super) fn note(&mut self, measured: &[(VehicleId, bool)]) {
        if measured.is_empty() {
            return;
        }
        self.bad *= FORGETTING;
        self.all *= FORGETTING;
        self.bad_of.values_mut().for_each(|bad| *bad *= FORGETTING);
        self.bad_of.retain(|_, bad| *bad > FORGOTTEN);
        for (of, is_bad) in measured {
            self.all += 1.0;
            if *is_bad {
                self.bad += 1.0;
                *self.bad_of.entry(*of).or_default() += 1.0;
            }
        }
        if self.is_quarantined && self.all > TRUSTED_COUNT_MIN && self.share() < TRUSTED_BELOW {
            *self = Self::default();
        }
    }

    /// What speaks against it until now was no fault of its measurements.
    pub(super) fn forgive(&mut self) {
        *self = Self {
            is_quarantined: self.is_quarantined,
            ..Self::default()
        };
    }

    pub(super) fn quarantine(&mut self) {
        *self = Self {
            is_quarantined: true,
            ..Self::default()
        };
    }
}

/// What speaks against where a vehicle is taken to be: what it measures and what is measured of it both fail the gate.
/// A liar is not misplaced, as what others measure of it passes.
///
/// Odometry that slipped once, by more than it says, would otherwise keep its vehicle apart for good: every measurement
/// that could bring it back fails the gate, and nothing tests its odometry any more.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Misplaced {
    by: Share,
    of: Share,
    /// Rounds since it was last found out.
    found: Option<u32>,
}

/// How many of how many are bad, with forgetting.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Share {
    bad: f64,
    all: f64,
}

impl Share {
    fn note(&mut self, (bad, all): (u32, u32)) {
        if all > 0 {
            self.bad = FORGETTING * self.bad + f64::from(bad);
            self.all = FORGETTING * self.all + f64::from(all);
        }
    }

    fn is_bad(&self) -> bool {
        self.bad > DOUBTED_ABOVE * self.all
    }
}

impl Misplaced {
    /// A round's new measurements by it and of it: how many failed the gate, of how many.
    pub(super) fn note(&mut self, by: (u32, u32), of: (u32, u32)) {
        self.by.note(by);
        self.of.note(of);
    }

    /// What follows.
    pub(super) fn judge(&mut self) -> Place {
        if let Some(rounds) = &mut self.found {
            *rounds = rounds.saturating_add(1);
        }
        let measures_nothing = self.by.all == 0.0;
        if self.of.all <= COUNT_MIN || !self.of.is_bad() || !(measures_nothing || self.by.is_bad())
        {
            return Place::Believed;
        }
        let again = self.found.is_some_and(|rounds| rounds < AGAIN_ROUNDS);
        *self = Self {
            found: Some(0),
            ..Self::default()
        };
        if again {
            Place::OftenWrong
        } else {
            Place::Wrong
        }
    }
}

/// What to think of where a vehicle is taken to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// It is there.
    Believed,
    /// It is somewhere else.
    Wrong,
    /// It was somewhere else just before, too: its odometry leads it astray.
    OftenWrong,
}

/// What speaks against the odometry of one vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct OdometryDoubt {
    rounds: VecDeque<(f64, f64)>,
    /// Rounds since its biases were found anew.
    new_biases: Option<u32>,
    pub(super) lies: bool,
    believable: u32,
}

/// What to do about a vehicle's odometry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Remedy {
    /// Nothing.
    None,
    /// Give its biases room.
    NewBiases,
    /// Believe it no more.
    Disbelieve,
    /// Believe it again.
    Believe,
}

impl OdometryDoubt {
    /// Residuals over their expectation, over the last rounds.
    pub(super) fn ratio(&self) -> f64 {
        let (squares, expected) = self
            .rounds
            .iter()
            .fold((0.0, 0.0), |sum, round| (sum.0 + round.0, sum.1 + round.1));
        if expected > EXPECTED_MIN {
            squares / expected
        } else {
            0.0
        }
    }

    /// Whether it may be why its vehicle's measurements fit nobody.
    pub(super) fn is_under_suspicion(&self) -> bool {
        self.ratio() > BIASED_ABOVE
            || self
                .new_biases
                .is_some_and(|rounds| rounds < NEW_BIASES_ROUNDS)
    }

    /// A round's residuals, of the stated noise: their squares and what was expected of them.
    pub(super) fn note(&mut self, squares: f64, expected: f64) {
        let inflated = if self.lies {
            LYING_NOISE * LYING_NOISE
        } else {
            1.0
        };
        self.rounds.push_back((squares * inflated, expected));
        if self.rounds.len() > ODOMETRY_ROUNDS {
            self.rounds.pop_front();
        }
    }

    /// It is believed no more.
    pub(super) fn disbelieve(&mut self) {
        self.lies = true;
        self.believable = 0;
    }

    /// What follows, for a vehicle whose ratio is the largest of all or not, and in a team in which it shows who errs: of
    /// two vehicles it could be either.
    pub(super) fn judge(&mut self, is_largest: bool, it_shows: bool) -> Remedy {
        let ratio = self.ratio();
        if let Some(rounds) = &mut self.new_biases {
            *rounds += 1;
        }
        if self.lies {
            self.believable = if ratio < BIASED_ABOVE {
                self.believable + 1
            } else {
                0
            };
            if self.believable >= BELIEVED_AFTER {
                *self = Self::default();
                return Remedy::Believe;
            }
            return Remedy::None;
        }
        if self.rounds.len() < ODOMETRY_ROUNDS || !is_largest {
            return Remedy::None;
        }
        match self.new_biases {
            Some(rounds) if rounds < NEW_BIASES_ROUNDS => Remedy::None,
            Some(_) if ratio > LYING_ABOVE && it_shows => {
                self.disbelieve();
                Remedy::Disbelieve
            }
            Some(rounds) if rounds > 10 * NEW_BIASES_ROUNDS => {
                self.new_biases = None;
                Remedy::None
            }
            None if ratio > BIASED_ABOVE => {
                self.new_biases = Some(0);
                Remedy::NewBiases
            }
            _ => Remedy::None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAD: [(VehicleId, bool); 2] = [(VehicleId(1), true), (VehicleId(2), true)];
    const GOOD: [(VehicleId, bool); 2] = [(VehicleId(1), false), (VehicleId(2), false)];

    #[test]
    fn most_of_its_measurements_must_be_bad_and_enough_of_them_before_a_vehicle_is_doubted() {
        let mut doubt = Doubt::default();
        doubt.note(&BAD);
        assert!(!doubt.is_doubted(), "too few");
        doubt.note(&BAD);
        doubt.note(&BAD);
        assert!(doubt.is_doubted());
        doubt.note(&GOOD);
        doubt.note(&GOOD);
        assert!(!doubt.is_doubted());
    }

    #[test]
    fn whoever_is_wrong_about_one_other_alone_is_not_doubted() {
        let mut doubt = Doubt::default();
        for _ in 0..20 {
            doubt.note(&BAD[..1]);
            assert!(!doubt.is_doubted(), "{doubt:?}");
        }
        doubt.note(&BAD[1..]);
        doubt.note(&BAD[1..]);
        assert!(doubt.is_doubted(), "about another, too");
    }

    #[test]
    fn in_quarantine_it_comes_back_when_its_innovations_pass() {
        let mut doubt = Doubt::default();
        doubt.quarantine();
        doubt.note(&BAD);
        for round in 0..40 {
            if !doubt.is_quarantined {
                assert!(round >= 4, "a few good ones are not enough");
                return;
            }
            doubt.note(&GOOD);
        }
        panic!("it never came back");
    }

    #[test]
    fn a_vehicle_is_misplaced_when_nothing_fits_that_is_measured_by_it_or_of_it() {
        let found = |by: (u32, u32), of: (u32, u32)| {
            let mut misplaced = Misplaced::default();
            (0..60)
                .map(|_| {
                    misplaced.note(by, of);
                    misplaced.judge()
                })
                .filter(|place| *place != Place::Believed)
                .take(2)
                .collect::<Vec<_>>()
        };
        let twice = [Place::Wrong, Place::OftenWrong];
        assert_eq!(found((1, 1), (1, 1)), twice);
        assert_eq!(found((0, 0), (3, 3)), twice, "it measures nothing");
        assert_eq!(found((3, 3), (0, 3)), [], "it lies, and the others see it");
        assert_eq!(found((0, 3), (1, 3)), [], "one of them lies");
        assert_eq!(found((0, 0), (0, 0)), []);
    }

    #[test]
    fn odometry_is_given_new_biases_first_and_disbelieved_when_those_explain_nothing() {
        let mut doubt = OdometryDoubt::default();
        let mut remedies = Vec::new();
        for _ in 0..30 {
            doubt.note(60.0, 6.0);
            remedies.push(doubt.judge(true, true));
        }
        let at = |remedy| remedies.iter().position(|found| *found == remedy);
        assert_eq!(at(Remedy::NewBiases), Some(4));
        assert_eq!(at(Remedy::Disbelieve), Some(14));
        for round in 0..40 {
            doubt.note(6.0 / (LYING_NOISE * LYING_NOISE), 6.0);
            if doubt.judge(true, true) == Remedy::Believe {
                assert!(round > 19);
                return;
            }
        }
        panic!("it was never believed again");
    }
}
