//! Three agents over real Zenoh on the loopback address while everything goes wrong: radio faults that change, agents
//! that stop and start again under new boots, queries right and wrong, forged packets and strangers' tokens.

use super::Footprint;
use crate::stories::name;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skein_agent::{Agent, Clock, FaultSettings, FrameSender, NetworkSettings, Settings, new_boot};
use skein_estimation::cooperative::{Mode, Optimiser};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::transform::Transform;
use skein_proto::faults::{Burst, Duplicate, Faults, Reorder};
use skein_proto::frame::{Frame, OdometryFrame, RelativeFrame, RelativeValue};
use skein_proto::keys::Key;
use skein_proto::name::Name;
use skein_proto::status::Status;
use skein_vehicle::{Config, MutualConfig, RangingConfig, SensorConfig, Start, ToldPose};
use std::collections::BTreeMap;
use std::time::Duration;
use zenoh::Wait;

const TEAM: usize = 3;
const FLEET: &str = "soaking";
const OPEN_WITHIN: Duration = Duration::from_secs(20);
/// A tick of the drivers.
const TICK: Span = Span::millis(50);
const TICKS_PER_S: u64 = 20;
/// Seconds after which one of the agents is stopped and started again.
const RESTARTED_EVERY: u64 = 5;
/// Seconds after which the radio changes.
const RADIO_EVERY: u64 = 3;

/// Tokens that the stranger shows in turn. Zenoh 1.10.2 keeps about 1 kB in every process for each other key that a link
/// ever announced and withdrew, until that link closes; a vehicle announces one as long as it lives.
const STRANGERS_TOKENS: u64 = 100;

/// The flight.
pub struct Live {
    clock: Clock,
    chance: ChaCha8Rng,
    agents: Vec<Agent>,
    senders: Vec<[FrameSender; 2]>,
    stranger: zenoh::Session,
    taken: Stamp,
    ticks: u64,
    restarts: u64,
    /// Drops of agents that were stopped.
    dropped_before: u64,
}

/// What the flight has come to.
#[derive(Clone, Copy, Debug)]
pub struct LiveSample {
    /// Seconds flown.
    pub flown_s: u64,
    /// What the process costs; three agents and a stranger.
    pub footprint: Option<Footprint>,
    /// Inputs, publications and queries that a full queue dropped, of all agents so far.
    pub dropped: u64,
    /// Agents whose newest estimate is corrected by others.
    pub tracking: usize,
    /// Agents started beyond the first three.
    pub restarts: u64,
}

fn nth_name(nth: usize) -> Name {
    name(&format!("v{}", nth + 1))
}

fn settings(nth: usize, clock: Clock, connect: Vec<String>, start: Start) -> Settings {
    let sensor = |text: &str| SensorConfig {
        name: name(text),
        driver: "process".to_owned(),
        body_from_sensor: Transform::identity(),
    };
    Settings {
        fleet: name(FLEET),
        vehicle: Config {
            vehicle: nth_name(nth),
            boot: new_boot(),
            period: Span::millis(200),
            round_wait: Span::millis(300),
            start,
            mode: Mode::default(),
            optimiser: Optimiser::default(),
            mutual: MutualConfig::DEFAULT,
            ranging: RangingConfig::DEFAULT,
            sensors: vec![sensor("odometry"), sensor("tags")],
            body_from_target: Transform::identity(),
            presence_timeout: Span::secs(2),
            repeats: 3,
            relay: false,
            estimate_spacing: Span::millis(50),
        },
        drivers: BTreeMap::new(),
        network: NetworkSettings::loopback(connect),
        clock,
        log: None,
        checkpoint: None,
        rpc: true,
        faults: Some(FaultSettings { seed: nth as u64 }),
    }
}

/// Side by side, one metre apart.
fn start_pose(nth: usize) -> Start {
    let place = nalgebra::Vector3::new(0.0, nth as f64, 0.0);
    let there = Transform::new(nalgebra::UnitQuaternion::identity(), place);
    Start::Pose(ToldPose::by_hand(there))
}

fn senders(agent: &Agent) -> [FrameSender; 2] {
    ["odometry", "tags"].map(|sensor| agent.driver(name(sensor)).expect("it is configured"))
}

fn dropped(agent: &Agent) -> u64 {
    let health = agent.latest_health();
    let process = health.as_ref().and_then(|health| health.process.as_ref());
    process.map_or(0, |process| {
        process.queues.values().map(|queue| queue.dropped).sum()
    })
}

impl Live {
    /// Starts three agents and a stranger. Fails with what Zenoh says.
    pub fn start(seed: u64) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let clock = Clock::real();
        let mut agents: Vec<Agent> = Vec::new();
        for nth in 0..TEAM {
            let connect = agents.iter().flat_map(Agent::locators).collect();
            let agent = Agent::start(settings(nth, clock, connect, start_pose(nth)))?;
            if !agent.wait_open(OPEN_WITHIN) {
                return Err("the Zenoh session does not open".into());
            }
            agents.push(agent);
        }
        let network = NetworkSettings::loopback(agents[0].locators());
        let stranger = zenoh::open(network.zenoh()?).wait()?;
        Ok(Self {
            clock,
            chance: ChaCha8Rng::seed_from_u64(seed),
            senders: agents.iter().map(senders).collect(),
            agents,
            stranger,
            taken: clock.now(),
            ticks: 0,
            restarts: 0,
            dropped_before: 0,
        })
    }

    /// Flies for some real seconds. Fails with what Zenoh says.
    pub fn fly_s(&mut self, seconds: u64) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        for _ in 0..seconds * TICKS_PER_S {
            std::thread::sleep(Duration::from_millis(50));
            self.drive();
            self.disturb()?;
            if self.ticks.is_multiple_of(TICKS_PER_S * RADIO_EVERY) {
                self.change_radio()?;
            }
            if self.ticks.is_multiple_of(TICKS_PER_S * RESTARTED_EVERY) {
                self.restart()?;
            }
        }
        Ok(())
    }

    /// Everybody hovers: odometry 20 times a second, poses of the others five times, one in twenty of them wrong.
    fn drive(&mut self) {
        self.ticks += 1;
        // A busy machine may come late; the increments then speak of the time that was.
        let (since, taken) = (self.taken, self.clock.now().max(self.taken + TICK));
        self.taken = taken;
        for nth in 0..TEAM {
            let [odometry, tags] = &self.senders[nth];
            odometry.send(&Frame::Odometry(OdometryFrame {
                since_ns: since.as_nanos(),
                taken_ns: taken.as_nanos(),
                motion: [0.0; 6],
                rotation_sigma_rad: 0.001,
                translation_sigma_m: 0.002,
            }));
            for other in (0..TEAM).filter(|other| *other != nth && self.ticks.is_multiple_of(4)) {
                let is_wrong = self.chance.random_ratio(1, 20);
                let error_m = if is_wrong { 15.0 } else { 0.0 };
                tags.send(&Frame::Relative(RelativeFrame {
                    taken_ns: taken.as_nanos(),
                    target: nth_name(other),
                    value: RelativeValue::Pose {
                        sensor_from_target: [
                            0.0,
                            0.0,
                            0.0,
                            error_m,
                            other as f64 - nth as f64,
                            0.0,
                        ],
                        rotation_sigma_rad: 0.01,
                        translation_sigma_m: 0.02,
                    },
                }));
            }
        }
    }

    /// A stranger in the fleet's network: garbage under the names of vehicles and of nobody, a token that comes and goes,
    /// questions, and wishes without a meaning.
    fn disturb(&mut self) -> zenoh::Result<()> {
        let fleet = name(FLEET);
        let from = if self.chance.random() {
            nth_name(self.chance.random_range(0..TEAM))
        } else {
            name(&format!("s{}", self.chance.random::<u32>()))
        };
        let mut garbage = vec![0; self.chance.random_range(0..1_400)];
        self.chance.fill_bytes(&mut garbage);
        let to = nth_name(self.chance.random_range(0..TEAM));
        let key = if self.chance.random() {
            Key::Odometry { from }
        } else {
            Key::Exchange { from, to }
        };
        self.stranger.put(key.in_fleet(fleet), garbage).wait()?;
        let boot = self.ticks % STRANGERS_TOKENS;
        let of = name(&format!("s{boot}"));
        let token = Key::Alive { of, boot }.in_fleet(fleet);
        self.stranger
            .liveliness()
            .declare_token(token)
            .wait()?
            .undeclare()
            .wait()?;
        let verb = name("set_pose");
        let asked = match self.ticks % 4 {
            0 => format!("{}?form=xml", Key::Health { of: to }.in_fleet(fleet)),
            1 => Key::Rpc { on: to, verb }.in_fleet(fleet),
            2 => Key::Estimate { of: to }.in_fleet(fleet),
            _ => Key::Info { of: to }.in_fleet(fleet),
        };
        // The answers are thrown away unread.
        self.stranger
            .get(asked)
            .timeout(Duration::from_millis(500))
            .callback(drop)
            .wait()
    }

    fn change_radio(&mut self) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let is_split = self.chance.random_ratio(1, 3);
        let split = || vec![vec![nth_name(0)], vec![nth_name(1), nth_name(2)]];
        let faults = Faults {
            loss: self.chance.random_range(0.0..0.5),
            delay_s: self.chance.random_range(0.0..0.1),
            jitter_s: 0.02,
            burst: Some(Burst {
                share: 0.05,
                mean_s: 0.5,
                loss: 1.0,
            }),
            reorder: Some(Reorder {
                probability: 0.05,
                delay_s: 0.1,
            }),
            duplicate: Some(Duplicate {
                probability: 0.05,
                delay_s: 0.1,
            }),
            partitions: if is_split { vec![split()] } else { vec![] },
            ..Faults::default()
        };
        for agent in &self.agents {
            agent.take_faults(faults.clone())?;
        }
        Ok(())
    }

    /// One after another is stopped and started again under a new boot, not knowing where it is.
    fn restart(&mut self) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let nth = self.restarts as usize % TEAM;
        self.restarts += 1;
        let gone = self.agents.remove(nth);
        self.dropped_before += dropped(&gone);
        gone.stop();
        let connect = self.agents.iter().flat_map(Agent::locators).collect();
        let agent = Agent::start(settings(nth, self.clock, connect, Start::Unknown))?;
        self.senders[nth] = senders(&agent);
        self.agents.insert(nth, agent);
        Ok(())
    }

    /// What it has come to.
    pub fn sample(&self) -> LiveSample {
        let is_tracking = |agent: &&Agent| {
            agent
                .latest_estimate()
                .is_some_and(|estimate| estimate.document.status == Status::Tracking)
        };
        LiveSample {
            flown_s: self.ticks / TICKS_PER_S,
            footprint: Footprint::now(),
            dropped: self.dropped_before + self.agents.iter().map(dropped).sum::<u64>(),
            tracking: self.agents.iter().filter(is_tracking).count(),
            restarts: self.restarts,
        }
    }

    /// Ends it.
    pub fn stop(self) -> zenoh::Result<()> {
        self.agents.into_iter().for_each(Agent::stop);
        self.stranger.close().wait()
    }
}
