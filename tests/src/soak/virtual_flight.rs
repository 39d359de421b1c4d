//! Four vehicles that hover in virtual time while everything goes wrong: a bad radio, partitions, processes that die and
//! come back under new boots, forged packets, tokens of strangers and wrong measurements.

use super::Footprint;
use crate::stories::{Altered, altered, name};
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skein_estimation::cooperative::Mode;
use skein_proto::frame::{Frame, RelativeValue};
use skein_simworld::fleet::{Fleet, LoggedValue};
use skein_simworld::radio::{Burst, Duplicate, Partition, RadioSettings, Reorder};
use skein_simworld::scenario::Scenario;
use skein_simworld::world::{Delivery, World, nanos};
use skein_vehicle::{Config, Input, PacketKey, Start};
use std::fmt::Write;

/// How often something happens that nobody planned for, in seconds.
const TURN_S: f64 = 1.0;
/// Turns after which a process dies, and after which it comes back.
const KILLED_EVERY: u64 = 20;
const DEAD_FOR: u64 = 3;
/// Turns after which the fleet is split, and for how long, in seconds.
const SPLIT_EVERY: u64 = 60;
const SPLIT_FOR_S: f64 = 10.0;
/// Forged packets in a turn.
const FORGED: usize = 20;
/// One measurement in so many is wrong by metres.
const WRONG_ONE_IN: u32 = 20;
/// Honest packets that forgeries are made of.
const TAPED_MAX: usize = 500;

type Change = Box<dyn FnMut(&World, usize, i64, &mut Vec<Delivery>)>;

/// The flight.
pub struct Virtual {
    fleet: Fleet<Altered<Change>>,
    chance: ChaCha8Rng,
    taped: Vec<(PacketKey, Vec<u8>)>,
    turns: u64,
    dead: Option<(usize, u64)>,
}

/// What the flight has come to.
#[derive(Clone, Copy, Debug)]
pub struct VirtualSample {
    /// Seconds since the start of the motion.
    pub flown_s: f64,
    /// What the process costs.
    pub footprint: Option<Footprint>,
    /// The length of everything that the fleet remembers, written out as text: histories, queues, counters and all.
    pub written_bytes: usize,
    /// The length of the longest health document as JSON.
    pub health_bytes: usize,
    /// The most neighbours that a vehicle knows.
    pub neighbours: usize,
    /// How many vehicles have a pose, of those alive.
    pub placed: usize,
    /// The worst position error of a placed vehicle, metres.
    pub error_m: f64,
    /// Packets that vehicles refused, and that they accepted, since their boots.
    pub refused: u64,
    /// See above.
    pub accepted: u64,
}

/// Counts what is written to it.
struct Counted(usize);

impl Write for Counted {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.0 += text.len();
        Ok(())
    }
}

/// Metres of error in some measurements.
fn wrong(seed: u64) -> Change {
    let mut chance = ChaCha8Rng::seed_from_u64(seed);
    Box::new(move |_, _, _, deliveries| {
        for delivery in deliveries {
            if let Frame::Relative(frame) = &mut delivery.frame
                && let RelativeValue::Pose {
                    sensor_from_target, ..
                } = &mut frame.value
                && chance.random_ratio(1, WRONG_ONE_IN)
            {
                sensor_from_target[3] += chance.random_range(-20.0..20.0);
            }
        }
    })
}

impl Virtual {
    /// The flight of a seed in a mode, before its first turn.
    pub fn new(seed: u64, mode: Mode) -> Self {
        let mut scenario = Scenario::built_in("hover").expect("it is built in");
        scenario.radio = RadioSettings {
            loss: 0.2,
            delay_s: 0.02,
            jitter_s: 0.02,
            burst: Some(Burst {
                share: 0.05,
                mean_s: 1.0,
                loss: 1.0,
            }),
            reorder: Some(Reorder {
                probability: 0.05,
                delay_s: 0.2,
            }),
            duplicate: Some(Duplicate {
                probability: 0.05,
                delay_s: 0.1,
            }),
            ..RadioSettings::default()
        };
        let in_mode = |_, config| Config { mode, ..config };
        let mut fleet = altered(&scenario, seed, in_mode, wrong(seed));
        fleet.log();
        fleet.run_until(0);
        fleet.run_until(nanos(2.0));
        let packet = |entry: skein_simworld::fleet::Logged| match entry.what {
            LoggedValue::Input(Input::Packet { key, bytes }) => Some((key, bytes)),
            _ => None,
        };
        let taped = fleet.take_log().into_iter().filter_map(packet);
        Self {
            taped: taped.take(TAPED_MAX).collect(),
            fleet,
            chance: ChaCha8Rng::seed_from_u64(seed),
            turns: 0,
            dead: None,
        }
    }

    /// Flies for some virtual seconds.
    pub fn fly_s(&mut self, seconds: f64) {
        let until_ns = self.fleet.now_ns() + nanos(seconds);
        while self.fleet.now_ns() < until_ns {
            self.turns += 1;
            self.split();
            self.kill_and_restart();
            for _ in 0..FORGED {
                self.forge();
            }
            self.fleet.run_s(TURN_S);
        }
    }

    /// From time to time the first two vehicles do not hear the others.
    fn split(&mut self) {
        if !self.turns.is_multiple_of(SPLIT_EVERY) {
            return;
        }
        let from_s = self.fleet.now_ns() as f64 * 1e-9;
        let settings = self.fleet.stage().world.scenario().radio.clone();
        self.fleet.change_radio(&RadioSettings {
            partitions: vec![Partition {
                from_s,
                to_s: from_s + SPLIT_FOR_S,
                groups: vec![vec![0, 1], vec![2, 3]],
            }],
            ..settings
        });
    }

    /// One after another dies without a word; its token is sometimes seen for longer than it lives. It comes back from
    /// its checkpoint, or knowing nothing.
    fn kill_and_restart(&mut self) {
        if let Some((vehicle, killed)) = self.dead
            && self.turns - killed >= DEAD_FOR
        {
            let start = match self.fleet.checkpoint(vehicle) {
                Some(checkpoint) if self.chance.random() => Start::Checkpoint(checkpoint),
                _ => Start::Unknown,
            };
            self.fleet.restart(vehicle, start);
            self.dead = None;
        }
        if self.dead.is_none() && self.turns.is_multiple_of(KILLED_EVERY) {
            let vehicle = (self.turns / KILLED_EVERY) as usize % self.fleet.len();
            let lingers_s = if self.chance.random() { 0.0 } else { 6.0 };
            self.fleet.kill_under_a_lingering_token(vehicle, lingers_s);
            self.dead = Some((vehicle, self.turns));
        }
    }

    /// Somebody who is no vehicle of the fleet says something: a tape of another time, under any name and boot, whole or
    /// damaged; or appears and vanishes.
    fn forge(&mut self) {
        let chance = &mut self.chance;
        let victim = chance.random_range(0..self.fleet.len());
        let stranger = name(&format!("s{}", chance.random::<u32>()));
        if chance.random_ratio(1, 10) {
            let (vehicle, boot) = (stranger, chance.random());
            self.fleet.give(victim, Input::Appeared { vehicle, boot });
            self.fleet.give(victim, Input::Vanished { vehicle, boot });
            return;
        }
        let Some((key, bytes)) = self.taped.choose(chance) else {
            return;
        };
        let mut bytes = bytes.clone();
        let from = if chance.random() {
            stranger
        } else {
            key.from()
        };
        bytes[16..24].copy_from_slice(&from.hash().to_le_bytes());
        if chance.random() {
            bytes[8..16].copy_from_slice(&chance.random::<u64>().to_le_bytes());
        }
        if chance.random_ratio(1, 4) {
            let at = chance.random_range(0..bytes.len());
            bytes[at] ^= 1 << chance.random_range(0..8);
        }
        let key = match key {
            PacketKey::Odometry { .. } => PacketKey::Odometry { from },
            PacketKey::Features { .. } => PacketKey::Features { from },
            PacketKey::Backlog { .. } => PacketKey::Backlog { from },
            PacketKey::Relay { .. } => PacketKey::Relay { from },
            PacketKey::Exchange { .. } => PacketKey::Exchange {
                from,
                to: self.fleet.config(victim).vehicle,
            },
        };
        self.fleet.inject(victim, key, bytes);
    }

    /// What it has come to.
    pub fn sample(&self) -> VirtualSample {
        let mut written = Counted(0);
        write!(written, "{:?}", self.fleet).expect("counting cannot fail");
        let healths = || (0..self.fleet.len()).filter_map(|vehicle| self.fleet.health(vehicle));
        let bytes = |health| serde_json::to_vec(health).map_or(0, |json| json.len());
        let neighbours = || healths().flat_map(|health| health.neighbours.values());
        let strangers = healths().flat_map(|health| health.refused.values());
        let refused = neighbours().flat_map(|neighbour| neighbour.refused.values());
        let errors = (0..self.fleet.len())
            .map(|vehicle| self.fleet.position_error_m(vehicle))
            .filter(|error_m| error_m.is_finite());
        VirtualSample {
            flown_s: self.fleet.now_ns() as f64 * 1e-9,
            footprint: Footprint::now(),
            written_bytes: written.0,
            health_bytes: healths().map(bytes).max().unwrap_or_default(),
            neighbours: healths()
                .map(|health| health.neighbours.len())
                .max()
                .unwrap_or_default(),
            placed: errors.clone().count(),
            error_m: errors.fold(0.0, f64::max),
            refused: strangers.chain(refused).sum(),
            accepted: neighbours()
                .flat_map(|neighbour| neighbour.accepted.values())
                .sum(),
        }
    }
}
