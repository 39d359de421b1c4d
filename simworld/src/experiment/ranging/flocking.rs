//! Flocking by heading averaging (Cornejo & Nagpal, section V-A), a reference controller on top of estimated orientations:
//! each round every robot turns to the mean of its own heading and those that it estimates its neighbours to have. Until
//! there is an estimate it drives at random.

mod orientations;

pub use orientations::{Orientations, Source};

use crate::planar_swarm::{Drive, PlanarSwarm, SwarmNoise, SwarmSettings};
use crate::plot::{self, Panel, PlotError, Trace};
use crate::statistics::mean_and_stderr;
use crate::streams::Streams;
use nalgebra::Vector2;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt::Write;

/// Rounds of a flight.
pub const ROUNDS: usize = 30;

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
    /// What the sensors add.
    pub noise: SwarmNoise,
    /// Where the robots get their orientations from.
    pub source: Source,
}

const ALL: Cell = Cell {
    name: "",
    robots: 10,
    side_m: 10.0,
    degree: None,
    has_walls: false,
    noise: SwarmNoise::USUAL,
    source: Source::Windows(4),
};

/// The cells, in the order of the table.
pub const CELLS: [Cell; 7] = [
    Cell {
        name: "exact, windows of 4",
        noise: SwarmNoise::NONE,
        ..ALL
    },
    Cell {
        name: "windows of 4",
        ..ALL
    },
    Cell {
        name: "windows of 6",
        source: Source::Windows(6),
        ..ALL
    },
    Cell {
        name: "windows of 9",
        source: Source::Windows(9),
        ..ALL
    },
    Cell {
        name: "follower",
        source: Source::Follower,
        ..ALL
    },
    Cell {
        name: "windows of 6, walls",
        has_walls: true,
        source: Source::Windows(6),
        ..ALL
    },
    Cell {
        name: "windows of 6, 6 near",
        robots: 30,
        side_m: 40.0,
        degree: Some(6.0),
        source: Source::Windows(6),
        ..ALL
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
pub fn fly(swarm: &mut PlanarSwarm, orientations: &mut Orientations) -> Vec<f64> {
    let robots = swarm.robots();
    let mut orders = vec![order(swarm)];
    orientations.observe(swarm);
    for _ in 1..ROUNDS {
        let turns: Vec<Option<f64>> = (0..robots)
            .map(|observer| {
                let others = (0..robots).filter(|robot| swarm.are_linked(observer, *robot));
                let headings: Vec<f64> = others
                    .filter_map(|robot| orientations.relative_rad(observer, robot))
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
            let mut settings = SwarmSettings::section_v(cell.robots, cell.noise);
            settings.has_walls = cell.has_walls;
            settings.side_m = cell.side_m;
            if let Some(degree) = cell.degree {
                settings = settings.with_mean_degree(degree);
            }
            let mut swarm = PlanarSwarm::new(settings, &streams);
            let mut orientations = Orientations::new(cell.source, cell.robots);
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
    let mut text = format!("{:<22}", "order at round");
    for round in SHOWN {
        let _ = write!(text, " {round:>15}");
    }
    text.push('\n');
    for one in results {
        let _ = write!(text, "{:<22}", one.cell.name);
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
        String::from("cell,robots,range_sigma_m,samples,seed,round,order,order_stderr\n");
    for one in results {
        for (round, (order, stderr)) in one.order.iter().zip(&one.order_stderr).enumerate() {
            let _ = writeln!(
                text,
                "\"{}\",{},{},{},{},{round},{order},{stderr}",
                one.cell.name, one.cell.robots, one.cell.noise.range_sigma_m, one.samples, one.seed,
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

    fn flown(name: &str) -> CellResult {
        let cell = CELLS.iter().find(|cell| cell.name == name).unwrap();
        run(cell, 5, 1, || {})
    }

    #[test]
    fn a_flock_that_measures_exactly_is_of_one_mind_from_its_fourth_distance_on() {
        let exact = flown("exact, windows of 4").order;
        assert!(exact[3] < 0.9, "{exact:?}");
        assert!(exact[4..].iter().all(|order| *order > 0.99), "{exact:?}");
    }

    #[test]
    fn a_flock_with_noise_comes_together_and_one_that_knows_nothing_never_does() {
        let noisy = flown("windows of 6").order;
        assert!(noisy[ROUNDS - 1] > 0.98, "{noisy:?}");

        let settings = SwarmSettings::section_v(10, SwarmNoise::USUAL);
        let mut swarm = PlanarSwarm::new(settings, &Streams::new(1, 0));
        let orders = fly(&mut swarm, &mut Orientations::new(Source::Windows(0), 10));
        assert!(orders.iter().all(|order| *order < 0.95), "{orders:?}");
    }
}
