//! The errors study: how far off both algorithms are on pairs, in position and orientation, against the noise of
//! distances, of translations and of turns, beside their bounds.
//!
//! ```text
//! pair: a world's truth and readings ─> localiser: answers ─┐
//!                                   └─> bound: information ─┴─> score: one trial ─> results ─> report
//! ```
//! A trial has the same pairs at all noises, with the same draws scaled, so that what differs between two noises is theirs.

pub mod bound;
pub mod localiser;
pub mod pair;
pub mod report;
pub mod score;

use self::bound::UNKNOWNS;
use self::localiser::{ALTERNATING_ROUNDS, Method, ROUNDS};
use self::pair::{Pair, Turns};
use self::score::{Scored, Trial};
use crate::planar_swarm::SwarmNoise;
use crate::streams::Streams;
use rayon::prelude::*;
use serde::Serialize;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Pairs a noise.
    pub samples: u64,
    /// Seed of all random streams.
    pub seed: u64,
}

/// A noise that is varied while the others are [`SwarmNoise::USUAL`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// Of distances.
    Range,
    /// Of odometry's translation.
    Translation,
    /// Of odometry's turn.
    Rotation,
}

/// All of them.
pub const AXES: [Axis; 3] = [Axis::Range, Axis::Translation, Axis::Rotation];

/// Lengths of the windows.
pub const WINDOWS: [usize; 5] = [3, 4, 5, 6, 9];

/// Distances from which banks start: the fewest, and a vehicle's.
pub const BANKS: [usize; 2] = [4, 6];

/// Squares beyond this are of answers that are somewhere else: one in 65 000 of honest ones (chi-square, 3).
const ASTRAY_SQUARE: f64 = 25.0;

/// A mean and its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Its standard error, a trial a draw.
    pub stderr: f64,
}

/// The errors of one method at one noise: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodResult {
    /// Which.
    pub method: Method,
    /// What the sensors added.
    pub noise: SwarmNoise,
    /// Pairs.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// The first round that is scored; the first distance is that of round 0.
    pub scored_from: usize,
    /// Share of the scored rounds without an answer; they are left out of all other numbers, the bounds' too.
    pub unanswered: f64,
    /// Mean square error of the position (m^2).
    pub position_m2: Estimate,
    /// The least that it may be, the bearing going around (m^2).
    pub position_bound_m2: Estimate,
    /// The one over the other.
    pub position_ratio: Estimate,
    /// The least that it may be along the tangent, where a bearing that is open has no end (m^2).
    pub position_tangent_bound_m2: Estimate,
    /// The error over that.
    pub position_tangent_ratio: Estimate,
    /// Mean square error of the orientation (rad^2).
    pub orientation_rad2: Estimate,
    /// The least that it may be (rad^2).
    pub orientation_bound_rad2: Estimate,
    /// The one over the other.
    pub orientation_ratio: Estimate,
    /// Median error of the position (m).
    pub position_median_m: f64,
    /// Median error of the orientation (rad).
    pub orientation_median_rad: f64,
    /// Whether its covariance is honest, for those who tell one.
    pub nees: Option<Nees>,
}

/// Squared errors of distance, bearing and orientation over their covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Nees {
    /// Mean, per degree of freedom: 1 of honest ones.
    pub mean: f64,
    /// Its standard error.
    pub stderr: f64,
    /// Median of the whole, 2.37 of honest ones.
    pub median: f64,
    /// Share of answers that are somewhere else altogether: more than 25.
    pub astray: f64,
}

impl Axis {
    /// The noises of it (m, m, rad), the usual one in the middle.
    #[must_use]
    pub const fn values(self) -> [f64; 5] {
        match self {
            Self::Range => [0.02, 0.05, 0.1, 0.2, 0.5],
            Self::Translation => [0.01, 0.02, 0.05, 0.1, 0.2],
            Self::Rotation => [0.002, 0.005, 0.01, 0.02, 0.05],
        }
    }

    /// The usual noise but for this one.
    #[must_use]
    pub const fn at(self, value: f64) -> SwarmNoise {
        let mut noise = SwarmNoise::USUAL;
        match self {
            Self::Range => noise.range_sigma_m = value,
            Self::Translation => noise.translation_sigma_m = value,
            Self::Rotation => noise.rotation_sigma_rad = value,
        }
        noise
    }

    /// What it is called, with its unit.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Range => "distance noise, m",
            Self::Translation => "translation noise, m",
            Self::Rotation => "turn noise, rad",
        }
    }
}

/// All noises, the usual one first and once.
#[must_use]
pub fn noises() -> Vec<SwarmNoise> {
    let mut noises = vec![SwarmNoise::USUAL];
    for axis in AXES {
        let others = axis.values().map(|value| axis.at(value));
        noises.extend(
            others
                .into_iter()
                .filter(|noise| *noise != SwarmNoise::USUAL),
        );
    }
    noises
}

/// Who localises at a noise, in the order of the table. Tracked windows are to be compared with the others, at the usual
/// noise.
#[must_use]
pub fn methods(noise: &SwarmNoise) -> Vec<Method> {
    let mut methods: Vec<Method> = WINDOWS.map(Method::Window).to_vec();
    if *noise == SwarmNoise::USUAL {
        methods.extend(WINDOWS.map(Method::Tracked));
    }
    methods.extend(BANKS.map(Method::Bank));
    methods.extend([Method::Trilateration, Method::TrilaterationBank]);
    methods
}

/// Runs the methods on the same pairs. `flown` is called after each pair, from any thread.
#[must_use]
pub fn run(
    methods: &[Method],
    noise: SwarmNoise,
    request: Request,
    flown: impl Fn() + Sync,
) -> Vec<MethodResult> {
    let pairs: Vec<Vec<Trial>> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let streams = Streams::new(request.seed, sample);
            let together = Pair::gone(Turns::Together, ROUNDS, noise, &streams);
            let count = ALTERNATING_ROUNDS + 1;
            let alternating = Pair::gone(Turns::Alternating, count, noise, &streams);
            let trials = methods.iter().map(|method| {
                let pair = match method.turns() {
                    Turns::Together => &together,
                    Turns::Alternating => &alternating,
                };
                Trial::of(*method, pair)
            });
            let trials = trials.collect();
            flown();
            trials
        })
        .collect();
    let result = |(index, method): (usize, &Method)| {
        let trials: Vec<Trial> = pairs.iter().map(|trials| trials[index].clone()).collect();
        summed_up(*method, noise, request, &trials)
    };
    methods.iter().enumerate().map(result).collect()
}

fn summed_up(
    method: Method,
    noise: SwarmNoise,
    request: Request,
    trials: &[Trial],
) -> MethodResult {
    let estimate = |(mean, stderr)| Estimate { mean, stderr };
    let mean = |of: fn(&Scored) -> f64| estimate(score::mean(trials, of));
    let ratio =
        |of: fn(&Scored) -> f64, to: fn(&Scored) -> f64| estimate(score::ratio(trials, of, to));
    let asked: usize = trials.iter().map(|trial| trial.asked).sum();
    let answered: usize = trials.iter().map(|trial| trial.answers.len()).sum();
    MethodResult {
        method,
        noise,
        samples: request.samples,
        seed: request.seed,
        scored_from: method.scored_from(),
        unanswered: 1.0 - answered as f64 / asked as f64,
        position_m2: mean(|one| one.off_m.powi(2)),
        position_bound_m2: mean(|one| one.least.position_m2),
        position_ratio: ratio(|one| one.off_m.powi(2), |one| one.least.position_m2),
        position_tangent_bound_m2: mean(|one| one.least.tangent_m2),
        position_tangent_ratio: ratio(|one| one.off_m.powi(2), |one| one.least.tangent_m2),
        orientation_rad2: mean(|one| one.off_rad.powi(2)),
        orientation_bound_rad2: mean(|one| one.least.orientation_rad2),
        orientation_ratio: ratio(|one| one.off_rad.powi(2), |one| one.least.orientation_rad2),
        position_median_m: score::median(trials, |one| Some(one.off_m)),
        orientation_median_rad: score::median(trials, |one| Some(one.off_rad)),
        nees: nees(trials),
    }
}

fn nees(trials: &[Trial]) -> Option<Nees> {
    let mut answers = trials.iter().flat_map(|trial| &trial.answers);
    answers.any(|one| one.square.is_some()).then(|| {
        let told = |one: &Scored| f64::from(u8::from(one.square.is_some()));
        let square = |one: &Scored| one.square.unwrap_or(0.0) / UNKNOWNS as f64;
        let astray = |one: &Scored| f64::from(u8::from(one.square > Some(ASTRAY_SQUARE)));
        let (mean, stderr) = score::ratio(trials, square, told);
        Nees {
            mean,
            stderr,
            median: score::median(trials, |one| one.square),
            astray: score::ratio(trials, astray, told).0,
        }
    })
}

#[cfg(test)]
mod tests;
