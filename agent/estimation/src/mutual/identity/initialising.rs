//! A neighbour's way into the joint filter and out again: when its identity and yaw are sure a bank of ranges is started,
//! when that agrees for a while the neighbour is let in, and when the pair models contradict for long it is put out.

use super::range_bank::{PairSight, RangeBank};
use super::sight::{CHANCE_MIN, FEATURE_WIDENED, GATE, NONE_WEIGHT, SOFTENED_MAX, Sight};
use super::talker::Talker;
use crate::mutual::assignment::assign;
use crate::mutual::direction::{difference, turned, wrapped};
use crate::mutual::feature_set::Motion;
use crate::mutual::located::Reduced;
use nalgebra::UnitVector3;

/// Probability of identity and yaw above which a neighbour is initialised.
const SURE: f64 = 0.7;
/// Probability above which the pair models contradict a filter.
const CERTAIN: f64 = 0.8;
/// Epochs in a row that must be sure before a bank starts, and must agree with it before the neighbour is let in.
const EPOCHS_TO_START: u8 = 2;
const EPOCHS_TO_ENTER: u8 = 4;
/// A bank and the pair model agree within this (rad).
const AGREEING_RAD: f64 = 0.25;
/// A bank is inconsistent beyond so much (rad), and up to so much more if it is unsure itself.
const INCONSISTENT_RAD: f64 = 12.0 * std::f64::consts::PI / 180.0;
const INCONSISTENT_UNSURE_MAX_RAD: f64 = 11.5 * std::f64::consts::PI / 180.0;
/// The joint filter is inconsistent beyond this (rad).
const JOINT_INCONSISTENT_RAD: f64 = 0.3;
/// So many more inconsistent than consistent epochs, and it is begun anew.
const INCONSISTENT_EPOCHS: u8 = 6;

/// One neighbour.
#[derive(Clone, Debug)]
pub(super) struct Initialising {
    bank: Option<RangeBank>,
    sure: u8,
    agreeing: u8,
    bank_inconsistent: u8,
    joint_inconsistent: u8,
}

/// What one epoch says of a neighbour, in the own level frame.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    pub(super) yaw_rad: f64,
    pub(super) yaw_probability: f64,
    /// Where the likeliest of the own tracks is, and how likely it is.
    pub(super) direction: Option<(UnitVector3<f64>, f64)>,
    /// What the joint filter holds, if the neighbour is in it.
    pub(super) joint: Option<Reduced>,
}

/// What is to be done with the joint filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// Nothing.
    Keep,
    /// Let the neighbour in.
    Insert(Reduced),
    /// Put it out.
    Remove,
}

impl Initialising {
    pub(super) fn new() -> Self {
        Self {
            bank: None,
            sure: 0,
            agreeing: 0,
            bank_inconsistent: 0,
            joint_inconsistent: 0,
        }
    }

    /// Where the bank of ranges holds the neighbour to be; none while its identity has not been sure.
    pub(super) fn state(&self) -> Option<Reduced> {
        self.bank.as_ref().map(RangeBank::state)
    }

    /// The pair models have contradicted the joint filter lately, and not by a slip of one epoch.
    pub(super) fn doubted(&self) -> bool {
        self.joint_inconsistent > 1
    }

    pub(super) fn predict(
        &mut self,
        dt_s: f64,
        own: &Motion,
        neighbour: &Motion,
        unheard: (f64, f64),
    ) {
        if let Some(bank) = &mut self.bank {
            bank.predict(dt_s, own, neighbour, unheard);
        }
    }

    pub(super) fn epoch(&mut self, evidence: &Evidence) -> Verdict {
        let seen = evidence
            .direction
            .filter(|(_, chance)| *chance > SURE && evidence.yaw_probability > SURE);
        self.supervise_bank(evidence);
        match (&self.bank, seen) {
            (None, Some((direction, _))) => {
                self.sure += 1;
                if self.sure >= EPOCHS_TO_START {
                    self.bank = Some(RangeBank::new(&direction, evidence.yaw_rad));
                    (self.sure, self.agreeing, self.bank_inconsistent) = (0, 0, 0);
                }
            }
            (None, None) => self.sure = 0,
            (Some(bank), Some((direction, _))) => {
                let state = bank.state();
                let agrees = wrapped(state.yaw_rad - evidence.yaw_rad).abs() < AGREEING_RAD
                    && away_rad(&state, &direction) < AGREEING_RAD;
                self.agreeing = if agrees {
                    self.agreeing.saturating_add(1)
                } else {
                    0
                };
            }
            (Some(_), None) => self.agreeing = 0,
        }
        match (&evidence.joint, &self.bank) {
            (Some(joint), _) => self.supervise_joint(joint, evidence),
            (None, Some(bank)) if self.agreeing >= EPOCHS_TO_ENTER => {
                self.joint_inconsistent = 0;
                Verdict::Insert(bank.state())
            }
            _ => Verdict::Keep,
        }
    }

    fn supervise_bank(&mut self, evidence: &Evidence) {
        let Some(bank) = &self.bank else { return };
        let limit_rad =
            INCONSISTENT_RAD + (3.0 * bank.across_rad()).min(INCONSISTENT_UNSURE_MAX_RAD);
        let contradiction = contradicts(&bank.state(), evidence, limit_rad);
        count(&mut self.bank_inconsistent, contradiction);
        if self.bank_inconsistent >= INCONSISTENT_EPOCHS {
            self.bank = None;
            self.bank_inconsistent = 0;
        }
    }

    fn supervise_joint(&mut self, joint: &Reduced, evidence: &Evidence) -> Verdict {
        count(
            &mut self.joint_inconsistent,
            contradicts(joint, evidence, JOINT_INCONSISTENT_RAD),
        );
        if self.joint_inconsistent < INCONSISTENT_EPOCHS {
            return Verdict::Keep;
        }
        (self.joint_inconsistent, self.agreeing) = (0, 0);
        Verdict::Remove
    }
}

/// Gives the banks what one talker saw `age_s` ago: the own features are shared out among the neighbours, a neighbour's
/// are searched for this vehicle. Tracks that are held to be others compete.
pub(super) fn observe(
    neighbours: &mut [Initialising],
    observer: &Talker,
    talker: usize,
    age_s: f64,
    sights: &[Sight],
) {
    let by_neighbour = talker != 0;
    let targets: Vec<usize> = if by_neighbour {
        vec![talker]
    } else {
        (1..=neighbours.len()).collect()
    };
    let targets: Vec<usize> = targets
        .into_iter()
        .filter(|target| neighbours[target - 1].bank.is_some())
        .collect();
    if targets.is_empty() {
        return;
    }
    let seen_as = |target: usize| if by_neighbour { 0 } else { target };
    let pair_sight = |sight: &Sight| PairSight {
        by_neighbour,
        direction: sight.direction,
        age_s,
        variance_rad2: FEATURE_WIDENED * sight.variance_rad2,
    };
    let back_rad = -observer.yaw_rad();
    let claimed = |sight: &Sight| -> f64 {
        targets
            .iter()
            .map(|target| sight.chances[seen_as(*target)])
            .sum()
    };
    let competitors: Vec<(UnitVector3<f64>, f64)> = observer
        .tracks()
        .iter()
        .map(|(_, direction, variance_rad2)| (turned(direction, back_rad), *variance_rad2))
        .collect();
    let cost = |row: usize, column: usize| {
        let sight = &sights[column];
        if let Some(target) = targets.get(row) {
            let bank = neighbours[target - 1].bank.as_ref();
            let distance = bank.map_or(f64::INFINITY, |bank| bank.distance(&pair_sight(sight)));
            return gated(distance, sight.chances[seen_as(*target)]);
        }
        let (direction, variance_rad2) = &competitors[row - targets.len()];
        let distance = difference(direction, &sight.direction).norm_squared()
            / (variance_rad2 + FEATURE_WIDENED * sight.variance_rad2);
        gated(distance, 1.0 - claimed(sight))
    };
    let assigned = assign(targets.len() + competitors.len(), sights.len(), GATE, cost);
    for (target, sight) in targets.iter().zip(assigned) {
        let (Some(sight), Some(bank)) = (sight, &mut neighbours[target - 1].bank) else {
            continue;
        };
        let sight = &sights[sight];
        let chance = sight.chances[seen_as(*target)].max(CHANCE_MIN);
        let none = (1.0 - claimed(sight)).max(CHANCE_MIN);
        bank.update(
            &pair_sight(sight),
            (1.0 + NONE_WEIGHT * none / chance).min(SOFTENED_MAX),
        );
    }
}

fn gated(squared_distance: f64, chance: f64) -> f64 {
    if squared_distance < GATE {
        squared_distance - 2.0 * chance.max(CHANCE_MIN).ln()
    } else {
        f64::INFINITY
    }
}

fn away_rad(state: &Reduced, direction: &UnitVector3<f64>) -> f64 {
    UnitVector3::try_new(state.position_m, 1e-9)
        .map_or(0.0, |outward| difference(&outward, direction).norm())
}

/// Whether the pair models, where they are certain, say otherwise.
fn contradicts(state: &Reduced, evidence: &Evidence, limit_rad: f64) -> bool {
    let yaw = evidence.yaw_probability > CERTAIN
        && wrapped(state.yaw_rad - evidence.yaw_rad).abs() > limit_rad;
    let direction = evidence.direction.is_some_and(|(direction, chance)| {
        chance > CERTAIN && away_rad(state, &direction) > limit_rad
    });
    yaw || direction
}

fn count(counter: &mut u8, bad: bool) {
    *counter = if bad {
        counter.saturating_add(1)
    } else {
        counter.saturating_sub(1)
    };
}
