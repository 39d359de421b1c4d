//! Which relative yaw of a pair is the likeliest, and how many others there are.

use super::closure::Readout;
use super::pair_model::{YAW_BIN_RAD, YAW_BINS};
use crate::mutual::direction::wrapped;

/// Bins to both sides of the likeliest yaw that count as that yaw.
const REACH_BINS: i64 = 3;

/// The likeliest relative yaw of a pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct LikeliestYaw {
    pub(super) yaw_rad: f64,
    pub(super) probability: f64,
}

/// The likeliest yaw with the probability around it.
pub(super) fn likeliest_yaw(readout: &Readout) -> LikeliestYaw {
    let mut best = (0, f64::NEG_INFINITY);
    for middle in 0..YAW_BINS as i64 {
        let probability = around(readout, middle);
        if probability > best.1 {
            best = (middle, probability);
        }
    }
    let (middle, probability) = best;
    let moment: f64 = (-REACH_BINS..=REACH_BINS)
        .map(|off| off as f64 * at(readout, middle + off))
        .sum();
    LikeliestYaw {
        yaw_rad: wrapped(
            (middle as f64 + moment / probability.max(f64::MIN_POSITIVE)) * YAW_BIN_RAD,
        ),
        probability: probability.min(1.0),
    }
}

/// Yaws that are likely and likelier than those near them.
pub(super) fn modes(readout: &Readout) -> usize {
    const LIKELY: f64 = 0.1;
    let peak = |middle: i64| {
        let here = around(readout, middle);
        here > LIKELY
            && (1..=2 * REACH_BINS).all(|off| {
                here > around(readout, middle - off) && here >= around(readout, middle + off)
            })
    };
    (0..YAW_BINS as i64)
        .filter(|middle| peak(*middle))
        .count()
        .max(2)
}

/// Probability of a bin; they go round.
fn at(readout: &Readout, bin: i64) -> f64 {
    readout.yaw[bin.rem_euclid(YAW_BINS as i64) as usize]
}

/// Probability of a bin and those within reach.
fn around(readout: &Readout, middle: i64) -> f64 {
    (middle - REACH_BINS..=middle + REACH_BINS)
        .map(|bin| at(readout, bin))
        .sum()
}
