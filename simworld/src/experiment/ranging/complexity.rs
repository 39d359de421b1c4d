//! The paper's table of complexity, measured: what one robot sends in a round, and how long it computes, by how many
//! neighbours it has.

use super::election::MESSAGE_BYTES;
use super::trilateration::turtle;
use crate::planar_swarm::{Drive, PlanarSwarm, SwarmNoise, SwarmSettings};
use crate::streams::Streams;
use serde::Serialize;
use skein_estimation::VehicleId;
use skein_estimation::ranging::schedule::{Message, PHASES, Scheduler, Slot, State};
use skein_estimation::ranging::trilateration::{Bank, Noise, PairMotion, Trilaterator};
use std::fmt::Write;

/// Neighbours of which there are rows.
pub const NEIGHBOURS: [usize; 5] = [1, 2, 4, 8, 16];

/// Bytes of an odometry: two lengths, an angle and the round, four bytes each.
const ODOMETRY_BYTES: usize = 16;

/// Bytes of one neighbour's position estimate: who, and two lengths.
const POSITION_BYTES: usize = 16;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Algorithm 2, the paper's way.
    Trilateration,
    /// Algorithm 2 with a bank, which needs nobody's estimates.
    Bank,
    /// Algorithm 3: one round of the schedule.
    Schedule,
}

/// All of them, in the order of the table.
pub const ALGORITHMS: [Algorithm; 3] = [
    Algorithm::Trilateration,
    Algorithm::Bank,
    Algorithm::Schedule,
];

/// One row: one object of the JSON output.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Which algorithm.
    pub algorithm: Algorithm,
    /// How many neighbours.
    pub neighbours: usize,
    /// Messages that a robot sends in a round.
    pub messages: usize,
    /// Bytes that it sends in a round, without key and envelope.
    pub bytes: usize,
    /// Time that it computes in a round, microseconds, on whatever else the machine was doing.
    pub time_us: f64,
    /// Rounds that were timed.
    pub rounds: u32,
}

/// Measures one row over so many rounds. `clock_s`: seconds since any instant.
#[must_use]
pub fn run(
    algorithm: Algorithm,
    neighbours: usize,
    rounds: u32,
    seed: u64,
    clock_s: &dyn Fn() -> f64,
) -> Row {
    let time_s = match algorithm {
        Algorithm::Trilateration | Algorithm::Bank => {
            localising_s(algorithm, neighbours, rounds, seed, clock_s)
        }
        Algorithm::Schedule => scheduling_s(neighbours, rounds, clock_s),
    };
    let (messages, bytes) = match algorithm {
        Algorithm::Trilateration => (1, ODOMETRY_BYTES + POSITION_BYTES * neighbours),
        Algorithm::Bank => (1, ODOMETRY_BYTES),
        Algorithm::Schedule => (usize::from(PHASES), usize::from(PHASES) * MESSAGE_BYTES),
    };
    Row {
        algorithm,
        neighbours,
        messages,
        bytes,
        time_us: 1e6 * time_s / f64::from(rounds.max(1)),
        rounds,
    }
}

/// Seconds of one robot that localises its neighbours in all rounds; robots move in turn.
fn localising_s(
    algorithm: Algorithm,
    neighbours: usize,
    rounds: u32,
    seed: u64,
    clock_s: &dyn Fn() -> f64,
) -> f64 {
    let settings = SwarmSettings {
        has_walls: true,
        ..SwarmSettings::section_v(neighbours + 1, SwarmNoise::USUAL)
    };
    let mut swarm = PlanarSwarm::new(settings, &Streams::new(seed, 0));
    let noise = Noise {
        range_sigma_m: settings.noise.range_sigma_m,
        translation_sigma_m: settings.noise.translation_sigma_m,
        rotation_sigma_rad: settings.noise.rotation_sigma_rad,
    };
    let mut plain: Vec<Trilaterator> = (0..neighbours).map(|_| Trilaterator::new()).collect();
    let mut banks: Vec<Option<Bank>> = vec![None; neighbours];
    // The banks' start is over when everybody has moved twice.
    let warm_up = 2 * (neighbours as u32 + 1) + 2;
    let mut time_s = 0.0;
    for round in 0..warm_up + rounds {
        let mover = round as usize % (neighbours + 1);
        swarm.step(|robot| {
            if robot == mover {
                Drive::Random
            } else {
                Drive::Stay
            }
        });
        let moved: Vec<_> = (0..=neighbours)
            .map(|robot| turtle(swarm.odometry(robot)))
            .collect();
        let ranges: Vec<_> = (1..=neighbours)
            .filter_map(|robot| swarm.range_m(0, robot))
            .collect();
        let begun_s = clock_s();
        for (index, range_m) in ranges.iter().enumerate() {
            let motion = PairMotion {
                own: moved[0],
                theirs: moved[index + 1],
            };
            // Honest readings are taken.
            match (algorithm, &mut banks[index]) {
                (Algorithm::Bank, Some(bank)) => {
                    let _ = bank.update(&motion, Some(*range_m), &noise);
                }
                (Algorithm::Bank, bank) => *bank = Bank::new(*range_m, &noise).ok(),
                _ => {
                    let _ = plain[index].update(&motion, *range_m, None);
                }
            }
        }
        if round >= warm_up {
            time_s += clock_s() - begun_s;
        }
    }
    time_s
}

/// Seconds of one robot in all rounds of the schedule, its neighbours resting.
fn scheduling_s(neighbours: usize, rounds: u32, clock_s: &dyn Fn() -> f64) -> f64 {
    let mut own = Scheduler::new(VehicleId(0));
    let begun_s = clock_s();
    for round in 1..=rounds {
        for phase in 0..PHASES {
            let Some(slot) = Slot::new(round, phase) else {
                continue;
            };
            own.begin_phase(slot, round);
            for neighbour in 1..=neighbours as u64 {
                let message = Message {
                    round,
                    phase,
                    state: State::Resting.code(),
                    value: 0,
                    moved: 0,
                };
                let _ = own.hear(VehicleId(neighbour), &message);
            }
        }
    }
    clock_s() - begun_s
}

impl Algorithm {
    /// What it is called.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Trilateration => "trilateration",
            Self::Bank => "bank",
            Self::Schedule => "schedule",
        }
    }
}

/// The rows as people read them.
#[must_use]
pub fn table(rows: &[Row]) -> String {
    let mut text =
        String::from("algorithm       neighbours  messages  bytes   time us   us a neighbour\n");
    for row in rows {
        let _ = writeln!(
            text,
            "{:<15} {:>10} {:>9} {:>6} {:>9.2} {:>16.3}",
            row.algorithm.name(),
            row.neighbours,
            row.messages,
            row.bytes,
            row.time_us,
            row.time_us / row.neighbours as f64
        );
    }
    text
}

/// The rows as spreadsheets read them.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    let mut text = String::from("algorithm,neighbours,messages,bytes,time_us,rounds\n");
    for row in rows {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{}",
            row.algorithm.name(),
            row.neighbours,
            row.messages,
            row.bytes,
            row.time_us,
            row.rounds
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_grows_with_the_neighbours_only_where_their_positions_are_told() {
        let bytes = |algorithm, neighbours| run(algorithm, neighbours, 1, 1, &|| 0.0).bytes;
        assert_eq!(bytes(Algorithm::Trilateration, 8), 16 + 8 * 16);
        assert_eq!(bytes(Algorithm::Bank, 8), bytes(Algorithm::Bank, 1));
        assert_eq!(bytes(Algorithm::Schedule, 8), bytes(Algorithm::Schedule, 1));
    }
}
