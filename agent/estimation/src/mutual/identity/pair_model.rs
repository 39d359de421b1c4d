//! Which track of one vehicle is the other, which of the other's is the first, and how their headings differ: an exact
//! hidden Markov model of one pair.
//!
//! In frames that do not turn with their vehicles the relative yaw of two vehicles is a constant. A true pair of sights of
//! each other keeps `azimuth - azimuth' + pi` at that constant and the two zenith distances at a sum of pi for ever; a
//! wrong pair drifts away. So time tells what the noise of one image cannot.

use crate::mutual::direction::wrapped;
use std::f64::consts::{PI, TAU};

/// Bins of the relative yaw.
pub(super) const YAW_BINS: usize = 120;
/// Width of a bin (rad).
pub(super) const YAW_BIN_RAD: f64 = TAU / YAW_BINS as f64;
/// Lanes (tracks followed by the model) of one vehicle; confirmed tracks beyond are not considered.
pub(super) const LANES_MAX: usize = 20;

/// Probability per bin of the relative yaw; bin n is centred at n [`YAW_BIN_RAD`].
pub(super) type YawBelief = [f64; YAW_BINS];

/// Per epoch, a track loses its identity (the tracker swapped it) with this probability ...
const LEAK: f64 = 0.02;
/// ... and a vehicle without a track has got one ...
const REACQUIRED: f64 = 0.15;
/// ... which is so much rarer one that the model has known for longer than so many epochs (2 s): that was somebody else all
/// the time, a robot that says nothing or a phantom, which only passes where the other would be if it were in sight.
const REACQUIRED_OLD: f64 = 0.15;
const YOUNG_EPOCHS: u8 = 8;
/// Per epoch, the model forgets the tracks and the yaw altogether: the floor from which a wrong mode is left. Without it
/// wrong modes of symmetric formations last for half a minute.
const FORGOTTEN: f64 = 0.003;
/// Most that two tracks that cross are mixed.
const CROSSING_MIXED: f64 = 0.15;
/// Likelihood ratio of a pair that disagrees, before tempering.
const OUTLIER: f64 = 0.02;
/// Exponent of the likelihood ratio: successive epochs see the same noise.
const TEMPERED: f64 = 0.45;
/// Variance by which the angles of a pair disagree beyond the tracks' own (rad^2): attitude and gyro.
const ANGLE_FLOOR_RAD2: f64 = (PI / 180.0) * (PI / 180.0);
/// Spread of the sum of zenith distances of tracks that are no pair (rad), and most of its exponent that counts.
const UNRELATED_ZENITH_RAD: f64 = 0.45;
const UNRELATED_EXPONENT_MAX: f64 = 3.0;
/// Ratio when one of the two does not see the other, for each that does not.
const UNSEEN: f64 = 0.6;
/// Diffusion of the relative yaw to each neighbouring bin per epoch: drift of the gyros.
const YAW_DIFFUSED: f64 = 0.003;
/// Beyond so many standard deviations a pair's agreement adds nothing to [`OUTLIER`].
const WINDOW_SIGMAS: f64 = 5.5;
/// Least squared sine of a zenith distance by which an azimuth's variance is divided.
const SIN2_MIN: f64 = 0.02;

/// One vehicle's lanes at one epoch.
#[derive(Clone, Debug)]
pub(super) struct Side<'a> {
    /// The lanes.
    pub(super) sights: &'a [Sight],
    /// For each lane its index at the epoch before; none for a new one.
    pub(super) before: &'a [Option<usize>],
    /// Pairs of lanes that come near each other, and how much they are mixed.
    pub(super) crossings: &'a [(usize, usize, f64)],
}

/// A track in the gyro frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sight {
    pub(super) azimuth_rad: f64,
    pub(super) zenith_rad: f64,
    /// Per axis across the direction (rad^2).
    pub(super) variance_rad2: f64,
}

/// How much two lanes of one vehicle are mixed: `arc2_rad2` is the squared angle between them, `variance_rad2` the sum of
/// their variances and half that of a feature.
pub(super) fn crossing(arc2_rad2: f64, variance_rad2: f64) -> f64 {
    CROSSING_MIXED * (-0.5 * arc2_rad2 / variance_rad2).exp()
}

/// The model of one pair of vehicles, first and second: probability of (lane of the first that is the second, or none) x
/// (lane of the second that is the first, or none) x relative yaw between their gyro frames.
#[derive(Clone, Debug)]
pub(super) struct PairModel {
    first: usize,
    second: usize,
    /// By lane of the first, then of the second, then yaw; index 0 is none, lane n is n + 1.
    mass: Vec<f64>,
    /// For how many epochs each lane of either has been known to this model.
    ages: [Vec<u8>; 2],
}

impl PairModel {
    /// Nothing is known.
    pub(super) fn new() -> Self {
        Self {
            first: 0,
            second: 0,
            mass: vec![1.0 / YAW_BINS as f64; YAW_BINS],
            ages: [Vec::new(), Vec::new()],
        }
    }

    /// Takes one epoch. `exclusive` is, for each lane of each vehicle, how well it is not already someone else.
    pub(super) fn step(
        &mut self,
        first: &Side<'_>,
        second: &Side<'_>,
        exclusive: [&[f64]; 2],
        evidence: bool,
    ) {
        self.grow_older([first.before, second.before]);
        self.take_over(first.before, second.before);
        self.mix(first.crossings, second.crossings);
        self.leak();
        if evidence {
            self.weigh(first.sights, second.sights, exclusive);
        }
        self.diffuse();
    }

    /// Probability of the relative yaw.
    pub(super) fn yaw(&self) -> YawBelief {
        let mut belief = [0.0; YAW_BINS];
        for cell in self.mass.chunks_exact(YAW_BINS) {
            for (sum, mass) in belief.iter_mut().zip(cell) {
                *sum += mass;
            }
        }
        belief
    }

    /// Probabilities that each lane of the first is the second and each of the second the first, when the yaw is as
    /// likely as `weight` says beside the model; none of either sums to more than one.
    pub(super) fn lanes(&self, weight: &YawBelief) -> [Vec<f64>; 2] {
        let (mut of_first, mut of_second) = (vec![0.0; self.first], vec![0.0; self.second]);
        let mut total = 0.0;
        for (index, cell) in self.mass.chunks_exact(YAW_BINS).enumerate() {
            let (a, b) = (index / (self.second + 1), index % (self.second + 1));
            let mass: f64 = cell
                .iter()
                .zip(weight)
                .map(|(mass, weight)| mass * weight)
                .sum();
            total += mass;
            if a > 0 {
                of_first[a - 1] += mass;
            }
            if b > 0 {
                of_second[b - 1] += mass;
            }
        }
        for mass in of_first.iter_mut().chain(&mut of_second) {
            *mass /= total.max(f64::MIN_POSITIVE);
        }
        [of_first, of_second]
    }

    fn grow_older(&mut self, before: [&[Option<usize>]; 2]) {
        for (ages, before) in self.ages.iter_mut().zip(before) {
            let age = |from: &Option<usize>| {
                from.and_then(|from| ages.get(from))
                    .map_or(0, |age| age.saturating_add(1))
            };
            *ages = before.iter().map(age).collect();
        }
    }

    /// The lanes of now from those of before: what has died is none again.
    fn take_over(&mut self, first: &[Option<usize>], second: &[Option<usize>]) {
        let unchanged = |lanes: &[Option<usize>], before: usize| {
            lanes.len() == before
                && lanes
                    .iter()
                    .enumerate()
                    .all(|(lane, from)| *from == Some(lane))
        };
        if unchanged(first, self.first) && unchanged(second, self.second) {
            return;
        }
        let now_at = |lanes: &[Option<usize>], before: usize| {
            let mut to = vec![0; before + 1];
            for (lane, from) in lanes.iter().enumerate() {
                if let Some(from) = from.filter(|from| *from < before) {
                    to[from + 1] = lane + 1;
                }
            }
            to
        };
        let (to_first, to_second) = (now_at(first, self.first), now_at(second, self.second));
        let mut mass = vec![0.0; (first.len() + 1) * (second.len() + 1) * YAW_BINS];
        for (index, cell) in self.mass.chunks_exact(YAW_BINS).enumerate() {
            let (a, b) = (index / (self.second + 1), index % (self.second + 1));
            let at = (to_first[a] * (second.len() + 1) + to_second[b]) * YAW_BINS;
            for (sum, mass) in mass[at..at + YAW_BINS].iter_mut().zip(cell) {
                *sum += mass;
            }
        }
        (self.first, self.second, self.mass) = (first.len(), second.len(), mass);
    }

    /// Tracks that cross may have been swapped.
    fn mix(&mut self, first: &[(usize, usize, f64)], second: &[(usize, usize, f64)]) {
        let (row, column) = ((self.second + 1) * YAW_BINS, YAW_BINS);
        for &(a, c, share) in first {
            for offset in 0..row {
                self.exchange((a + 1) * row + offset, (c + 1) * row + offset, share);
            }
        }
        for &(b, d, share) in second {
            for a in 0..=self.first {
                for yaw in 0..column {
                    self.exchange(
                        a * row + (b + 1) * column + yaw,
                        a * row + (d + 1) * column + yaw,
                        share,
                    );
                }
            }
        }
    }

    fn exchange(&mut self, one: usize, other: usize, share: f64) {
        let (a, b) = (self.mass[one], self.mass[other]);
        self.mass[one] = a + share * (b - a);
        self.mass[other] = b + share * (a - b);
    }

    /// Tracks lose their identity without a sign of it, and who had none gets one.
    fn leak(&mut self) {
        let row = (self.second + 1) * YAW_BINS;
        let [first, second] = self.ages.each_ref().map(|ages| reacquired(ages));
        for offset in 0..row {
            leak_along(&mut self.mass, offset, row, &first);
        }
        for a in 0..=self.first {
            for yaw in 0..YAW_BINS {
                leak_along(&mut self.mass, a * row + yaw, YAW_BINS, &second);
            }
        }
    }

    /// Bayes: the likelihood of the two directions if they are a pair, over that if they are not.
    fn weigh(&mut self, first: &[Sight], second: &[Sight], exclusive: [&[f64]; 2]) {
        let disagreeing = OUTLIER.powf(TEMPERED);
        for a in 0..=self.first {
            for b in 0..=self.second {
                let at = (a * (self.second + 1) + b) * YAW_BINS;
                let cell = &mut self.mass[at..at + YAW_BINS];
                let seen = |lane: usize, side: usize| match lane {
                    0 => UNSEEN,
                    lane => exclusive[side].get(lane - 1).copied().unwrap_or(1.0),
                };
                let constant = seen(a, 0) * seen(b, 1);
                if a == 0 || b == 0 {
                    cell.iter_mut().for_each(|mass| *mass *= constant);
                    continue;
                }
                cell.iter_mut()
                    .for_each(|mass| *mass *= constant * disagreeing);
                agree(cell, &first[a - 1], &second[b - 1]);
            }
        }
    }

    /// The yaw drifts, and with a small probability all was wrong; then probabilities sum to one.
    fn diffuse(&mut self) {
        for cell in self.mass.chunks_exact_mut(YAW_BINS) {
            let (mut before, first) = (cell[YAW_BINS - 1], cell[0]);
            for yaw in 0..YAW_BINS {
                let now = cell[yaw];
                let next = if yaw + 1 < YAW_BINS {
                    cell[yaw + 1]
                } else {
                    first
                };
                cell[yaw] = (1.0 - 2.0 * YAW_DIFFUSED) * now + YAW_DIFFUSED * (before + next);
                before = now;
            }
        }
        let total: f64 = self.mass.iter().sum();
        if !(total > f64::MIN_POSITIVE && total.is_finite()) {
            // All was impossible at once: nothing is known.
            self.mass.fill(0.0);
            self.mass[..YAW_BINS].fill(1.0 / YAW_BINS as f64);
            return;
        }
        let kept = (1.0 - FORGOTTEN) / total;
        self.mass.iter_mut().for_each(|mass| *mass *= kept);
        self.mass[..YAW_BINS]
            .iter_mut()
            .for_each(|mass| *mass += FORGOTTEN / YAW_BINS as f64);
    }
}

/// For each lane of these ages the probability that a vehicle that was none of the lanes is this one now.
fn reacquired(ages: &[u8]) -> Vec<f64> {
    let share = REACQUIRED / ages.len().max(1) as f64;
    ages.iter()
        .map(|age| {
            if *age < YOUNG_EPOCHS {
                share
            } else {
                REACQUIRED_OLD * share
            }
        })
        .collect()
}

/// Leaks along one axis: index 0 is none, `stride` apart the lanes follow, which get these parts of what was none.
fn leak_along(mass: &mut [f64], none: usize, stride: usize, parts: &[f64]) {
    let before = mass[none];
    let (mut lost, mut got) = (0.0, 0.0);
    for (lane, part) in parts.iter().enumerate() {
        let at = none + (lane + 1) * stride;
        lost += LEAK * mass[at];
        got += part * before;
        mass[at] = (1.0 - LEAK) * mass[at] + part * before;
    }
    mass[none] = before - got + lost;
}

/// Multiplies the bins near the yaw at which two sights are a pair by how well they agree, over what is already in there
/// for a pair that does not.
fn agree(cell: &mut [f64], first: &Sight, second: &Sight) {
    let sin2 = |sight: &Sight| sight.zenith_rad.sin().powi(2).max(SIN2_MIN);
    let yaw_variance = first.variance_rad2 / sin2(first)
        + second.variance_rad2 / sin2(second)
        + ANGLE_FLOOR_RAD2
        + YAW_BIN_RAD * YAW_BIN_RAD / 12.0;
    let zenith_variance = first.variance_rad2 + second.variance_rad2 + ANGLE_FLOOR_RAD2;
    // In level frames the one's zenith distance is the other's from straight down.
    let zenith2 = (first.zenith_rad + second.zenith_rad - PI).powi(2);
    let unrelated2 = UNRELATED_ZENITH_RAD * UNRELATED_ZENITH_RAD;
    let zenith_ratio = (unrelated2 / zenith_variance).sqrt()
        * (-0.5 * zenith2 / zenith_variance
            + (0.5 * zenith2 / unrelated2).min(UNRELATED_EXPONENT_MAX))
        .exp();
    let peak = zenith_ratio * TAU / (TAU * yaw_variance).sqrt();
    if peak.is_nan() || peak <= 1e-3 * OUTLIER {
        return;
    }
    let yaw = wrapped(first.azimuth_rad - second.azimuth_rad + PI);
    let reach = ((WINDOW_SIGMAS * yaw_variance.sqrt() / YAW_BIN_RAD).ceil() as i64)
        .min(YAW_BINS as i64 / 2 - 1);
    let middle = (yaw / YAW_BIN_RAD).round() as i64;
    for bin in middle - reach..=middle + reach {
        let off = bin as f64 * YAW_BIN_RAD - yaw;
        let ratio = peak * (-0.5 * off * off / yaw_variance).exp() / OUTLIER;
        let at = bin.rem_euclid(YAW_BINS as i64) as usize;
        cell[at] *= (TEMPERED * ratio.ln_1p()).exp();
    }
}

#[cfg(test)]
mod tests;
