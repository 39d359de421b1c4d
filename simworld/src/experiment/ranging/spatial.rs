//! Algorithm 1 in space: pairs of drones, levelled by gravity, of which each round tells how far they are from each other
//! and how both have moved. Where is the other, and which way does it look? What follows it is what the daemon follows a
//! neighbour with.

mod drone;
pub mod report;

use super::following::{Off, Shares, Spread, Told};
use crate::planar_swarm::SwarmNoise;
use crate::statistics::{mean_and_stderr, ratio_and_stderr};
use crate::streams::{Purpose, Streams};
use drone::Drone;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::ranging::neighbour::NeighbourSettings;
use skein_estimation::ranging::{Dimension, Neighbour, RangeSample};
use skein_estimation::time::{Span, Stamp};

/// Rounds of a flight, the first without a motion before it.
pub const ROUNDS: usize = 40;

/// A place that is farther off (m) is another place.
pub const WRONG_M: f64 = 3.0;

/// A kind of flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// What it is called.
    pub name: &'static str,
    /// Both climb and sink; otherwise each keeps its height.
    pub climbs: bool,
    /// What the sensors add.
    pub noise: SwarmNoise,
}

/// The cells, in the order of the table.
pub const CELLS: [Cell; 3] = [
    Cell {
        name: "climbing",
        climbs: true,
        noise: SwarmNoise::USUAL,
    },
    Cell {
        name: "climbing, half the noise",
        climbs: true,
        noise: SwarmNoise {
            range_sigma_m: 0.05,
            translation_sigma_m: 0.025,
            rotation_sigma_rad: 0.005,
            outliers: 0.0,
        },
    },
    Cell {
        name: "each at its height",
        climbs: false,
        noise: SwarmNoise::USUAL,
    },
];

/// The pairs of a cell: one object of the JSON output. Errors are of the places that were told.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellResult {
    /// The flights.
    #[serde(flatten)]
    pub cell: Cell,
    /// Pairs.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// What was told, of all rounds.
    pub told: Shares,
    /// The standard error of the share of rounds in which a place was told, a pair a draw.
    pub place_stderr: f64,
    /// Of the pairs, those to which a place was ever told.
    pub ever: f64,
    /// Median round of the first place that was told, of those pairs.
    pub first_round: f64,
    /// Mean squared position error (m^2).
    pub position_mse_m2: f64,
    /// Its standard error, a pair a draw.
    pub position_mse_stderr_m2: f64,
    /// Median position error (m).
    pub position_median_m: f64,
    /// Mean squared yaw error (rad^2).
    pub yaw_mse_rad2: f64,
    /// Its standard error.
    pub yaw_mse_stderr_rad2: f64,
    /// Median yaw error (rad).
    pub yaw_median_rad: f64,
    /// Share of them that are more than 3 m off.
    pub wrong: f64,
    /// Pairs to which such a place was ever told.
    pub wrong_pairs: usize,
    /// Squared error over its covariance per dimension.
    pub nees: Spread,
    /// The standard error of its mean.
    pub nees_stderr: f64,
    /// By round, the share of pairs to which a place was told.
    pub place_by_round: Vec<f64>,
    /// By round, the median position error of those (m); none where no place was told.
    pub median_by_round_m: Vec<Option<f64>>,
}

/// Flies the pairs of a cell. `flown` is called after each, from any thread.
#[must_use]
pub fn run(cell: &Cell, samples: u64, seed: u64, flown: impl Fn() + Sync) -> CellResult {
    let pairs: Vec<Vec<Told>> = (0..samples)
        .into_par_iter()
        .map(|sample| {
            let told = fly(cell, &Streams::new(seed, sample));
            flown();
            told
        })
        .collect();
    CellResult::of(cell, &pairs, seed)
}

/// By round, what one drone tells of the other.
fn fly(cell: &Cell, streams: &Streams) -> Vec<Told> {
    let drone = |index| Drone::new(index, cell.climbs, cell.noise, streams);
    let (mut own, mut other) = (drone(0), drone(1));
    let mut follower = Neighbour::new(NeighbourSettings::SPATIAL);
    let mut rng = streams.pair(0, 1, Purpose::Measurement);
    let mut told = Vec::with_capacity(ROUNDS);
    for round in 0..ROUNDS {
        if round > 0 {
            own.step();
            other.step();
        }
        let gauss: f64 = StandardNormal.sample(&mut rng);
        let distance_m = (other.position_m() - own.position_m()).norm();
        let sample = RangeSample {
            taken: Stamp::default() + Span::secs(round as i64),
            range_m: distance_m + cell.noise.range_sigma_m * gauss,
            sigma_m: cell.noise.range_sigma_m,
            own: own.odometry(),
            neighbour: other.odometry(),
        };
        // A distance below zero, of two that are within the noise of each other, is refused and nothing changes.
        let _ = follower.handle(&sample);
        let truth = own.sees(&other);
        told.push(Told::of(&follower.estimate(), &truth, Dimension::Spatial));
    }
    told
}

impl CellResult {
    fn of(cell: &Cell, pairs: &[Vec<Told>], seed: u64) -> Self {
        let offs: Vec<Vec<Off>> = pairs
            .iter()
            .map(|told| told.iter().filter_map(Told::off).collect())
            .collect();
        let all = || offs.iter().flatten();
        let firsts = pairs.iter();
        let firsts = firsts.filter_map(|told| told.iter().position(|one| one.off().is_some()));
        // Of all places, not of pairs' means: pairs to which few were told count little.
        let pooled = |of: &dyn Fn(&Off) -> f64| ratio(&offs, of);
        let (position_mse_m2, position_mse_stderr_m2) = pooled(&|off| off.position_m.powi(2));
        let (yaw_mse_rad2, yaw_mse_stderr_rad2) = pooled(&|off| off.yaw_rad.powi(2));
        let is_wrong = |off: &Off| off.position_m > WRONG_M;
        let of_round = |round: usize| pairs.iter().map(move |told| told[round]);
        let share = |round: usize| Shares::of(of_round(round).collect::<Vec<_>>().iter()).place;
        let median = |round: usize| {
            let offs = of_round(round).filter_map(|told| told.off());
            let median = Spread::of(offs.map(|off| off.position_m)).median;
            median.is_finite().then_some(median)
        };
        Self {
            cell: *cell,
            samples: pairs.len() as u64,
            seed,
            told: Shares::of(pairs.iter().flatten()),
            place_stderr: mean_and_stderr(pairs.iter().map(|told| Shares::of(told.iter()).place)).1,
            ever: firsts.clone().count() as f64 / pairs.len() as f64,
            first_round: Spread::of(firsts.map(|round| round as f64)).median,
            position_mse_m2,
            position_mse_stderr_m2,
            position_median_m: Spread::of(all().map(|off| off.position_m)).median,
            yaw_mse_rad2,
            yaw_mse_stderr_rad2,
            yaw_median_rad: Spread::of(all().map(|off| off.yaw_rad)).median,
            wrong: all().filter(|off| is_wrong(off)).count() as f64 / all().count() as f64,
            wrong_pairs: offs.iter().filter(|offs| offs.iter().any(is_wrong)).count(),
            nees: Spread::of(all().map(|off| off.nees)),
            nees_stderr: pooled(&|off| off.nees).1,
            place_by_round: (0..ROUNDS).map(share).collect(),
            median_by_round_m: (0..ROUNDS).map(median).collect(),
        }
    }
}

/// Mean over all places, and its standard error where a pair is a draw: that of a ratio of sums.
fn ratio(pairs: &[Vec<Off>], of: &dyn Fn(&Off) -> f64) -> (f64, f64) {
    let sums: Vec<f64> = pairs.iter().map(|offs| offs.iter().map(of).sum()).collect();
    let places: Vec<f64> = pairs.iter().map(|offs| offs.len() as f64).collect();
    ratio_and_stderr(&sums, &places)
}

#[cfg(test)]
mod tests;
