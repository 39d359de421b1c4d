//! Flocking by heading averaging (Cornejo & Nagpal, section V-A), a reference controller on top of estimated orientations:
//! each round every robot turns to the mean of its own heading and those that it estimates its neighbours to have. Until
//! there is an estimate it drives at random.

use crate::planar_swarm::{Drive, PlanarSwarm, SwarmNoise, SwarmSettings};
use crate::plot::{self, Panel, PlotError, Trace};
use crate::statistics::mean_and_stderr;
use crate::streams::{Purpose, Streams};
use nalgebra::Vector2;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt::Write;

/// Rounds of a flight.
pub const ROUNDS: usize = 30;

/// Where the robots get their orientations from.
pub trait Orientations {
    /// A round has gone by.
    fn observe(&mut self, swarm: &mut PlanarSwarm);

    /// The heading of `robot` less that of `observer`, as the observer estimates it (rad).
    fn relative_rad(&mut self, swarm: &PlanarSwarm, observer: usize, robot: usize) -> Option<f64>;
}

/// The truth with noise, from a round on: what no estimator says, to see what noise alone does to a flock.
#[derive(Debug)]
pub struct NoisyTruth {
    sigma_rad: f64,
    rounds: usize,
    rng: ChaCha8Rng,
}

/// Rounds after which the stand-in knows orientations: as many distances as the smallest window has that is unique.
const ROUNDS_TO_KNOW: usize = 3;

impl NoisyTruth {
    /// With this standard deviation.
    #[must_use]
    pub fn new(sigma_rad: f64, streams: &Streams) -> Self {
        Self {
            sigma_rad,
            rounds: 0,
            rng: streams.vehicle(0, Purpose::Measurement),
        }
    }
}

impl Orientations for NoisyTruth {
    fn observe(&mut self, _: &mut PlanarSwarm) {
        self.rounds += 1;
    }

    fn relative_rad(&mut self, swarm: &PlanarSwarm, observer: usize, robot: usize) -> Option<f64> {
        let gauss: f64 = StandardNormal.sample(&mut self.rng);
        let truth_rad = swarm.relative(observer, robot).heading_rad;
        (self.rounds >= ROUNDS_TO_KNOW).then_some(truth_rad + self.sigma_rad * gauss)
    }
}

/// A kind of flock.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// What it is called.
    pub name: &'static str,
    /// How many robots.
    pub robots: usize,
    /// Side of the square in which they start (m).
    pub side_m: f64,
    /// How many others a robot reaches; all when none is given.
    pub degree: Option<f64>,
    /// They are turned back by walls.
    pub has_walls: bool,
    /// Standard deviation of an orientation (rad).
    pub orientation_sigma_rad: f64,
}

/// The cells, in the order of the table.
pub const CELLS: [Cell; 6] = [
    Cell {
        name: "exact",
        robots: 10,
        side_m: 10.0,
        degree: None,
        has_walls: false,
        orientation_sigma_rad: 0.0,
    },
    Cell {
        name: "0.1 rad",
        robots: 10,
        side_m: 10.0,
        degree: None,
        has_walls: false,
        orientation_sigma_rad: 0.1,
    },
    Cell {
        name: "0.5 rad",
        robots: 10,
        side_m: 10.0,
        degree: None,
        has_walls: false,
        orientation_sigma_rad: 0.5,
    },
    Cell {
        name: "0.1 rad, walls",
        robots: 10,
        side_m: 10.0,
        degree: None,
        has_walls: true,
        orientation_sigma_rad: 0.1,
    },
    Cell {
        name: "0.1 rad, 6 near",
        robots: 30,
        side_m: 40.0,
        degree: Some(6.0),
        has_walls: false,
        orientation_sigma_rad: 0.1,
    },
    Cell {
        name: "0.5 rad, 6 near",
        robots: 30,
        side_m: 40.0,
        degree: Some(6.0),
        has_walls: false,
        orientation_sigma_rad: 0.5,
    },
];

/// The flocks of a cell: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellResult {
    /// The flocks.
    #[serde(flatten)]
    pub cell: Cell,
    /// How many.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// By round: how much of one mind they are, the length of their mean heading, from 0 to 1.
    pub order: Vec<f64>,
    /// Its standard error.
    pub order_stderr: Vec<f64>,
}

/// The length of the mean of all headings as unit vectors: 1 when all drive one way.
#[must_use]
pub fn order(swarm: &PlanarSwarm) -> f64 {
    let headings = (0..swarm.robots()).map(|robot| unit(swarm.pose(robot).heading_rad));
    headings.sum::<Vector2<f64>>().norm() / swarm.robots() as f64
}

/// By round from the first, the order of one flock.
pub fn fly(swarm: &mut PlanarSwarm, orientations: &mut impl Orientations) -> Vec<f64> {
    let robots = swarm.robots();
    let mut orders = vec![order(swarm)];
    for _ in 1..ROUNDS {
        let turns: Vec<Option<f64>> = (0..robots)
            .map(|observer| {
                let others = (0..robots).filter(|robot| swarm.are_linked(observer, *robot));
                let headings: Vec<f64> = others
                    .filter_map(|robot| orientations.relative_rad(swarm, observer, robot))
                    .collect();
                let sum = headings
                    .iter()
                    .map(|angle| unit(*angle))
                    .sum::<Vector2<f64>>()
                    + unit(0.0);
                (!headings.is_empty()).then(|| sum.y.atan2(sum.x))
            })
            .collect();
        swarm.step(|robot| turns[robot].map_or(Drive::Random, Drive::Turn));
        orientations.observe(swarm);
        orders.push(order(swarm));
    }
    orders
}

/// Flies the flocks of a cell. `flown` is called after each, from any thread.
#[must_use]
pub fn run(cell: &Cell, samples: u64, seed: u64, flown: impl Fn() + Sync) -> CellResult {
    let flocks: Vec<Vec<f64>> = (0..samples)
        .into_par_iter()
        .map(|sample| {
            let streams = Streams::new(seed, sample);
            let mut settings = SwarmSettings::section_v(cell.robots, SwarmNoise::USUAL);
            settings.has_walls = cell.has_walls;
            settings.side_m = cell.side_m;
            if let Some(degree) = cell.degree {
                settings = settings.with_mean_degree(degree);
            }
            let mut swarm = PlanarSwarm::new(settings, &streams);
            let mut orientations = NoisyTruth::new(cell.orientation_sigma_rad, &streams);
            let orders = fly(&mut swarm, &mut orientations);
            flown();
            orders
        })
        .collect();
    let of_round = |round: usize| mean_and_stderr(flocks.iter().map(move |orders| orders[round]));
    let (order, order_stderr) = (0..ROUNDS).map(of_round).unzip();
    CellResult {
        cell: *cell,
        samples,
        seed,
        order,
        order_stderr,
    }
}

/// Rounds that the table shows.
const SHOWN: [usize; 6] = [0, 2, 4, 5, 10, 29];

/// The results as people read them.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut text = format!("{:<18}", "order at round");
    for round in SHOWN {
        let _ = write!(text, " {round:>15}");
    }
    text += "   (a stand-in for the estimator: true orientations with noise)\n";
    for one in results {
        let _ = write!(text, "{:<18}", one.cell.name);
        for round in SHOWN {
            let _ = write!(
                text,
                "  {:.3} +- {:.3}",
                one.order[round], one.order_stderr[round]
            );
        }
        text.push('\n');
    }
    text
}

/// Every cell and round, one row each.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    let mut text =
        String::from("cell,robots,orientation_sigma_rad,samples,seed,round,order,order_stderr\n");
    for one in results {
        for (round, (order, stderr)) in one.order.iter().zip(&one.order_stderr).enumerate() {
            let _ = writeln!(
                text,
                "\"{}\",{},{},{},{},{round},{order},{stderr}",
                one.cell.name,
                one.cell.robots,
                one.cell.orientation_sigma_rad,
                one.samples,
                one.seed,
            );
        }
    }
    text
}

/// The order over rounds. Fails when there are no results.
pub fn figure(results: &[CellResult]) -> Result<String, PlotError> {
    let trace = |one: &CellResult| Trace {
        label: one.cell.name.to_owned(),
        points: (0..)
            .map(f64::from)
            .zip(one.order.iter().copied())
            .collect(),
    };
    let panel = Panel {
        name: "order (time: rounds)".to_owned(),
        shown: (0.0, 1.02),
        traces: results.iter().map(trace).collect(),
    };
    plot::panels("Flocking by heading averaging", 1, &[panel])
}

fn unit(angle_rad: f64) -> Vector2<f64> {
    Vector2::new(angle_rad.cos(), angle_rad.sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flock_that_knows_its_headings_drives_one_way_and_one_that_does_not_never_does() {
        let streams = Streams::new(1, 0);
        let settings = SwarmSettings::section_v(10, SwarmNoise::NONE);
        let mut swarm = PlanarSwarm::new(settings, &streams);
        let orders = fly(&mut swarm, &mut NoisyTruth::new(0.0, &streams));
        assert!(orders[ROUNDS_TO_KNOW] < 0.9, "{orders:?}");
        assert!(orders[ROUNDS_TO_KNOW + 1] > 0.999, "{orders:?}");

        struct Blind;
        impl Orientations for Blind {
            fn observe(&mut self, _: &mut PlanarSwarm) {}
            fn relative_rad(&mut self, _: &PlanarSwarm, _: usize, _: usize) -> Option<f64> {
                None
            }
        }
        let mut swarm = PlanarSwarm::new(settings, &streams);
        let orders = fly(&mut swarm, &mut Blind);
        assert!(orders.iter().all(|order| *order < 0.95), "{orders:?}");
    }
}
