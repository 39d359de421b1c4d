//! The schedule study: how long swarms of 10 to 1000 robots wait to move when maximal independent sets do, beside round
//! robin; and long runs of small swarms that drive, lose messages, crash and come back, in which no two that know each
//! other may move together.

pub mod report;

use super::election::{Counts, Election, Fate, MESSAGE_BYTES, Wait};
use crate::planar_swarm::{PlanarSwarm, SwarmNoise, SwarmSettings};
use crate::statistics::mean_and_stderr;
use crate::streams::Streams;
use rayon::prelude::*;
use serde::Serialize;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Swarms a cell.
    pub samples: u64,
    /// Seed of all random streams.
    pub seed: u64,
    /// Rounds of each long run.
    pub rounds: u32,
}

/// A swarm that stands still on a plane, to see how long everybody waits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// How many robots.
    pub robots: usize,
    /// How many others a robot in the middle reaches.
    pub degree: f64,
    /// Share of messages that are lost.
    pub loss: f64,
    /// How often each is sent.
    pub repeats: u32,
}

/// The waits in swarms of one cell: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WaitResult {
    /// The swarms.
    #[serde(flatten)]
    pub cell: Cell,
    /// How many swarms.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// Neighbours a robot had, on average.
    pub degree_mean: f64,
    /// Rounds after which all had moved, on average.
    pub all_moved_rounds: f64,
    /// Its standard error.
    pub all_moved_rounds_stderr: f64,
    /// The same of the worst swarm.
    pub all_moved_rounds_max: u32,
    /// Share of the robots that move in a round.
    pub moving: f64,
    /// Its standard error.
    pub moving_stderr: f64,
    /// The longest wait since eligible, rounds.
    pub wait_rounds_max: u32,
    /// Robots that waited before their first move for more rounds than they have neighbours, per thousand.
    pub first_waits_beyond_degree: f64,
    /// Waits since eligible that were longer than that, per thousand.
    pub waits_beyond_degree: f64,
    /// Round robin: rounds after which all have moved.
    pub round_robin_rounds: usize,
    /// Bytes that one robot sends in a round, without key and envelope.
    pub bytes_per_round: usize,
}

/// A long run: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LongRun {
    /// Share of messages that are lost.
    pub loss: f64,
    /// Robots of the swarm.
    pub robots: usize,
    /// Rounds.
    pub rounds: u64,
    /// Seed of all random streams.
    pub seed: u64,
    /// Share of the present that move in a round.
    pub moving: f64,
    /// Crashes.
    pub crashes: u64,
    /// Starts after a crash.
    pub joins: u64,
    /// Pairs that moved together though they knew each other.
    pub conflicts: u64,
    /// Pairs that met while both moved.
    pub met_while_moving: u64,
    /// Pairs that moved together and had not heard each other yet.
    pub not_yet_known: u64,
    /// Of both, those that moved together in the next round too.
    pub unresolved: u64,
}

/// The cells, in the order of the table.
#[must_use]
pub fn cells() -> Vec<Cell> {
    let cell = |robots, loss, repeats| Cell {
        robots,
        degree: 8.0,
        loss,
        repeats,
    };
    let mut cells: Vec<Cell> = [10, 30, 100, 300, 1000]
        .map(|robots| cell(robots, 0.0, 1))
        .to_vec();
    let lossy = [(0.2, 1), (0.2, 2), (0.4, 1), (0.4, 2)];
    cells.extend(lossy.map(|(loss, repeats)| cell(100, loss, repeats)));
    cells.push(cell(1000, 0.2, 2));
    cells
}

/// Losses of the long runs.
pub const LOSSES: [f64; 3] = [0.0, 0.2, 0.4];

/// Rounds of a standing swarm that are flown.
const STANDING_ROUNDS: u32 = 60;

/// Robots of a long run.
const LONG_RUN_ROBOTS: usize = 16;

/// One standing swarm.
struct Standing {
    degree: f64,
    all_moved: u32,
    moving: f64,
    first: Vec<Wait>,
    waits: Vec<Wait>,
}

/// The waits in the swarms of a cell. `flown` is called after each, from any thread.
#[must_use]
pub fn run(cell: &Cell, request: &Request, flown: impl Fn() + Sync) -> WaitResult {
    let swarms: Vec<Standing> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let standing = stand(cell, &Streams::new(request.seed, sample));
            flown();
            standing
        })
        .collect();
    let all = swarms.iter().map(|one| f64::from(one.all_moved));
    let (all_moved_rounds, all_moved_rounds_stderr) = mean_and_stderr(all);
    let (moving, moving_stderr) = mean_and_stderr(swarms.iter().map(|one| one.moving));
    let waits = || swarms.iter().flat_map(|one| &one.waits);
    let first = || swarms.iter().flat_map(|one| &one.first);
    WaitResult {
        cell: *cell,
        samples: request.samples,
        seed: request.seed,
        degree_mean: mean_and_stderr(swarms.iter().map(|one| one.degree)).0,
        all_moved_rounds,
        all_moved_rounds_stderr,
        all_moved_rounds_max: swarms.iter().map(|one| one.all_moved).max().unwrap_or(0),
        moving,
        moving_stderr,
        wait_rounds_max: waits().map(|one| one.rounds).max().unwrap_or(0),
        first_waits_beyond_degree: per_thousand_beyond_degree(first()),
        waits_beyond_degree: per_thousand_beyond_degree(waits()),
        round_robin_rounds: cell.robots,
        bytes_per_round: bytes_per_round(cell.repeats),
    }
}

/// Bytes that one robot sends in a round when each message is sent so often.
#[must_use]
pub const fn bytes_per_round(repeats: u32) -> usize {
    MESSAGE_BYTES * skein_estimation::ranging::schedule::PHASES as usize * repeats as usize
}

fn per_thousand_beyond_degree<'a>(waits: impl Iterator<Item = &'a Wait> + Clone) -> f64 {
    let beyond = waits.clone().filter(|one| one.rounds > one.degree).count();
    1e3 * beyond as f64 / waits.count().max(1) as f64
}

fn stand(cell: &Cell, streams: &Streams) -> Standing {
    let settings = SwarmSettings::section_v(cell.robots, SwarmNoise::NONE);
    let swarm = PlanarSwarm::new(settings.with_mean_degree(cell.degree), streams);
    let fate = Fate {
        loss: cell.loss,
        repeats: cell.repeats,
        ..Fate::KIND
    };
    let mut election = Election::new(swarm, fate, streams);
    for _ in 0..STANDING_ROUNDS {
        election.round(false);
    }
    let first: Vec<Wait> = election.first_waits().iter().flatten().copied().collect();
    let all_moved = if first.len() == cell.robots {
        // The round of the move itself counts.
        first.iter().map(|one| one.rounds + 1).max().unwrap_or(0)
    } else {
        STANDING_ROUNDS
    };
    let counts = election.counts();
    Standing {
        degree: first.iter().map(|one| f64::from(one.degree)).sum::<f64>() / first.len() as f64,
        all_moved,
        moving: share_moving(counts),
        waits: election.waits().to_vec(),
        first,
    }
}

fn share_moving(counts: &Counts) -> f64 {
    counts.moves as f64 / counts.present.max(1) as f64
}

/// One long run with so much loss: 16 robots between walls, each reaching about five others, crash once in 200 rounds and
/// are away for 5.
#[must_use]
pub fn long_run(loss: f64, rounds: u32, seed: u64, flown: impl Fn()) -> LongRun {
    let streams = Streams::new(seed, 0);
    let settings = SwarmSettings {
        has_walls: true,
        side_m: 20.0,
        ..SwarmSettings::section_v(LONG_RUN_ROBOTS, SwarmNoise::NONE)
    };
    let swarm = PlanarSwarm::new(settings.with_mean_degree(6.0), &streams);
    let fate = Fate {
        loss,
        repeats: 1,
        crash: 1.0 / 200.0,
        away_rounds: 5,
    };
    let mut election = Election::new(swarm, fate, &streams);
    for _ in 0..rounds {
        election.round(true);
        flown();
    }
    let counts = election.counts();
    LongRun {
        loss,
        robots: LONG_RUN_ROBOTS,
        rounds: counts.rounds,
        seed,
        moving: share_moving(counts),
        crashes: counts.crashes,
        joins: counts.joins,
        conflicts: counts.conflicts,
        met_while_moving: counts.met_while_moving,
        not_yet_known: counts.not_yet_known,
        unresolved: counts.unresolved,
    }
}

#[cfg(test)]
mod tests;
