//! Algorithm 2 on pairs of robots that take turns to move: the paper's way, with and without what the neighbour tells, and
//! the bank.

use crate::planar_swarm::{
    Drive, PlanarMotion, PlanarPose, PlanarSwarm, SwarmNoise, SwarmSettings, wrapped_rad,
};
use crate::statistics::mean_and_stderr;
use crate::streams::Streams;
use nalgebra::Vector2;
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::ranging::trilateration::{
    Bank, Noise, PairMotion, Refusal, Relative, Trilaterator, Turtle,
};
use std::fmt::Write;

/// Rounds of a trial: twice those of algorithm 1, as one of the two moves in each.
const ROUNDS: usize = 40;

/// Rounds that are not scored: three moves of each robot.
const UNSCORED_ROUNDS: usize = 6;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Trials a method.
    pub samples: u64,
    /// Seed of all random streams.
    pub seed: u64,
}

/// Who localises.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The paper's way, by distances and odometry alone.
    Plain,
    /// The paper's way with its exchange of positions.
    Told,
    /// The bank.
    Bank,
}

/// All of them, in the order of the table.
pub const METHODS: [Method; 3] = [Method::Plain, Method::Told, Method::Bank];

/// The errors of one method: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodResult {
    /// Which.
    pub method: Method,
    /// What the sensors added.
    pub noise: SwarmNoise,
    /// Trials.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// Mean of the squared position error (m^2).
    pub position_mse_m2: f64,
    /// Its standard error, a trial a draw.
    pub position_mse_stderr_m2: f64,
    /// Mean of the squared orientation error (rad^2).
    pub orientation_mse_rad2: f64,
    /// Its standard error.
    pub orientation_mse_stderr_rad2: f64,
    /// Median over all scored rounds of the position error (m).
    pub position_median_m: f64,
}

/// What a robot of the pair makes of the other.
enum Localiser {
    Plain(Trilaterator),
    Bank(Option<Bank>),
}

impl Localiser {
    fn update(
        &mut self,
        motion: &PairMotion,
        range_m: f64,
        told_m: Option<Vector2<f64>>,
        noise: &Noise,
    ) -> Result<(), Refusal> {
        match self {
            Self::Plain(plain) => plain.update(motion, range_m, told_m),
            Self::Bank(Some(bank)) => bank.update(motion, Some(range_m), noise),
            Self::Bank(bank) => {
                *bank = Some(Bank::new(range_m, noise)?);
                Ok(())
            }
        }
    }

    fn estimate(&self) -> Option<Relative> {
        match self {
            Self::Plain(plain) => plain.estimate(),
            Self::Bank(bank) => bank.as_ref()?.estimate().map(|mode| mode.at),
        }
    }
}

/// Runs one method. `flown` is called after each trial, from any thread.
#[must_use]
pub fn run(
    method: Method,
    noise: SwarmNoise,
    request: Request,
    flown: impl Fn() + Sync,
) -> MethodResult {
    let trials: Vec<Vec<(f64, f64)>> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let errors = trial(method, noise, &Streams::new(request.seed, sample));
            flown();
            errors
        })
        .collect();
    let trials: Vec<Vec<(f64, f64)>> = trials.into_iter().filter(|one| !one.is_empty()).collect();
    let mse = |of: fn(&(f64, f64)) -> f64| {
        mean_and_stderr(trials.iter().map(move |errors| {
            errors.iter().map(|one| of(one).powi(2)).sum::<f64>() / errors.len() as f64
        }))
    };
    let (position_mse_m2, position_mse_stderr_m2) = mse(|one| one.0);
    let (orientation_mse_rad2, orientation_mse_stderr_rad2) = mse(|one| one.1);
    let mut all_m: Vec<f64> = trials.iter().flatten().map(|one| one.0).collect();
    all_m.sort_by(f64::total_cmp);
    MethodResult {
        method,
        noise,
        samples: request.samples,
        seed: request.seed,
        position_mse_m2,
        position_mse_stderr_m2,
        orientation_mse_rad2,
        orientation_mse_stderr_rad2,
        position_median_m: all_m.get(all_m.len() / 2).copied().unwrap_or(f64::NAN),
    }
}

/// Errors (m, rad) of both robots in every scored round.
fn trial(method: Method, noise: SwarmNoise, streams: &Streams) -> Vec<(f64, f64)> {
    let mut pair = PlanarSwarm::new(SwarmSettings::section_v(2, noise), streams);
    let told_noise = Noise {
        range_sigma_m: noise.range_sigma_m,
        translation_sigma_m: noise.translation_sigma_m,
        rotation_sigma_rad: noise.rotation_sigma_rad,
    };
    let localiser = || match method {
        Method::Plain | Method::Told => Localiser::Plain(Trilaterator::new()),
        Method::Bank => Localiser::Bank(None),
    };
    let mut localisers = [localiser(), localiser()];
    let mut errors = Vec::new();
    for round in 0..=ROUNDS {
        let mover = round % 2;
        if round > 0 {
            pair.step(|robot| {
                if robot == mover {
                    Drive::Random
                } else {
                    Drive::Stay
                }
            });
        }
        let moved = [0, 1].map(|robot| turtle(pair.odometry(robot)));
        // Both ends hear one distance.
        let Some(range_m) = pair.range_m(0, 1) else {
            continue;
        };
        let told = [1, 0].map(|robot: usize| {
            let estimate = localisers[robot].estimate().map(|at| at.position_m);
            estimate.filter(|_| method == Method::Told)
        });
        for robot in [0, 1] {
            let motion = PairMotion {
                own: moved[robot],
                theirs: moved[1 - robot],
            };
            // Honest readings are taken; nothing of a refused one would change.
            let _ = localisers[robot].update(&motion, range_m, told[robot], &told_noise);
            if round > UNSCORED_ROUNDS
                && let Some(at) = localisers[robot].estimate()
            {
                errors.push(error(&at, &pair.relative(robot, 1 - robot)));
            }
        }
    }
    errors
}

/// Odometry as the estimators take it.
#[must_use]
pub fn turtle(motion: PlanarMotion) -> Turtle {
    Turtle {
        translation_m: motion.translation_m,
        rotation_rad: motion.rotation_rad,
    }
}

/// How far an estimate is off: metres, and radians from 0 to pi.
#[must_use]
pub fn error(at: &Relative, truth: &PlanarPose) -> (f64, f64) {
    let off_rad = wrapped_rad(at.orientation_rad - truth.heading_rad).abs();
    ((at.position_m - truth.position_m).norm(), off_rad)
}

impl Method {
    /// What it is called.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Told => "told",
            Self::Bank => "bank",
        }
    }
}

/// The results as people read them.
#[must_use]
pub fn table(results: &[MethodResult]) -> String {
    let mut text = String::from(
        "method   samples   position MSE m2        orientation MSE rad2     median m   (both robots, rounds 7 to 40)\n",
    );
    for one in results {
        let _ = writeln!(
            text,
            "{:<8} {:>7} {:>10.3} +- {:<8.3} {:>12.4} +- {:<8.4} {:>9.3}",
            one.method.name(),
            one.samples,
            one.position_mse_m2,
            one.position_mse_stderr_m2,
            one.orientation_mse_rad2,
            one.orientation_mse_stderr_rad2,
            one.position_median_m,
        );
    }
    text
}

/// One row a method.
#[must_use]
pub fn csv(results: &[MethodResult]) -> String {
    let mut text = String::from(
        "method,range_sigma_m,translation_sigma_m,rotation_sigma_rad,samples,seed,position_mse_m2,\
         position_mse_stderr_m2,orientation_mse_rad2,orientation_mse_stderr_rad2,position_median_m\n",
    );
    for one in results {
        let noise = &one.noise;
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{}",
            one.method.name(),
            noise.range_sigma_m,
            noise.translation_sigma_m,
            noise.rotation_sigma_rad,
            one.samples,
            one.seed,
            one.position_mse_m2,
            one.position_mse_stderr_m2,
            one.orientation_mse_rad2,
            one.orientation_mse_stderr_rad2,
            one.position_median_m,
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bank_is_within_a_few_metres_where_plain_trilateration_runs_away() {
        let request = Request {
            samples: 30,
            seed: 1,
        };
        let of = |method| run(method, SwarmNoise::USUAL, request, || {});
        let (plain, bank) = (of(Method::Plain), of(Method::Bank));
        assert!(bank.position_mse_m2 < 2.5, "{bank:?}");
        assert!(
            plain.position_mse_m2 > 5.0 * bank.position_mse_m2,
            "{plain:?}"
        );
    }
}
