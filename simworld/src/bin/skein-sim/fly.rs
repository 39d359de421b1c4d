//! `skein-sim fly`: a scenario live over Zenoh, with agents in this process or in others.

use crate::air::Air;
use crate::mode_name::ModeName;
use crate::output::{print, print_json};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, miette};
use nalgebra::Vector3;
use serde::Serialize;
use skein_agent::{
    Agent, Clock, DriverSettings, FaultSettings, FrameSender, NetworkSettings, Settings, new_boot,
};
use skein_estimation::time::{Span, Stamp};
use skein_proto::faults::{Faults, LinkCount};
use skein_proto::name::Name;
use skein_proto::status::Status;
use skein_simworld::fleet::pose_of;
use skein_simworld::radio::RadioSettings;
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::statistics::PoseError;
use skein_simworld::world::{Delivery, World, nanos, seconds};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

/// Agents need this long to open their sessions, find each other and learn each other's clocks.
const STANDSTILL_MIN_S: f64 = 4.0;
/// How long one agent may take to open its session.
const OPEN_TIMEOUT: Duration = Duration::from_secs(20);
/// How often agents are told of the radio's faults, also when they have not changed: one may have just joined.
const FAULTS_EVERY_NS: i64 = 200_000_000;

/// Options of `fly`.
#[derive(Debug, Args)]
pub(crate) struct FlyArguments {
    /// A built-in scenario (section-v, section-v-lossy, section-v-harsh, section-v-partition, section-v-mounted,
    /// parallel-lines, hover, square, eight, ranges) or a TOML file.
    scenario: String,
    /// Fly the world only: the agents are other processes with `zenoh` drivers named `odometry` and `relative`
    /// (of `square` and `eight` also `imu` and `camera`), and `[simulation] enabled = true`.
    #[arg(long)]
    world_only: bool,
    /// Name of the fleet.
    #[arg(long, default_value = "sim")]
    fleet: Name,
    /// Zenoh endpoints to connect to, with --world-only.
    #[arg(long)]
    connect: Vec<String>,
    /// Zenoh endpoints to listen on, with --world-only.
    #[arg(long)]
    listen: Vec<String>,
    /// Length of the flight in seconds, instead of the scenario's.
    #[arg(long)]
    duration: Option<f64>,
    /// Share of packets lost, instead of the scenario's.
    #[arg(long)]
    loss: Option<f64>,
    /// Seconds by which packets are late, instead of the scenario's.
    #[arg(long)]
    delay: Option<f64>,
    /// Which sample of the scenario's random streams to fly.
    #[arg(long, default_value_t = 0)]
    sample: u64,
    /// How the agents weigh their rounds.
    #[arg(long, value_enum, default_value_t = ModeName::Team)]
    mode: ModeName,
    /// Leave the sensor mounts out of the agents' configuration, to see what that costs.
    #[arg(long)]
    without_mounts: bool,
    /// Keep the bearings whose robots were found out from the agents' own poses, to see what those give.
    #[arg(long)]
    without_bearings: bool,
    /// Write an input log of every agent into this folder.
    #[arg(long)]
    log: Option<PathBuf>,
    /// Print JSON instead of the table.
    #[arg(long)]
    json: bool,
}

/// How one vehicle did.
#[derive(Clone, Debug, Serialize)]
struct VehicleResult {
    vehicle: Name,
    status: String,
    /// Position error at the end, in metres.
    final_m: Option<f64>,
    /// Root mean square of the position error over the motion, in metres.
    rmse_m: Option<f64>,
    /// Mean orientation error over the motion, in radians.
    orientation_rad: Option<f64>,
    /// Odometry alone at the end.
    dead_reckoning_final_m: f64,
    /// Odometry alone over the motion.
    dead_reckoning_rmse_m: f64,
    /// How far it travelled, in metres.
    path_m: f64,
    neighbours: usize,
    rounds_solved: u64,
    packets_lost: u64,
    /// What the simulated radio did to the packets that were sent to it, by reason.
    radio: LinkCount,
}

#[derive(Clone, Debug, Serialize)]
struct FlightResult {
    scenario: String,
    seed: u64,
    sample: u64,
    vehicles: Vec<VehicleResult>,
    team_rmse_m: Option<f64>,
    team_dead_reckoning_rmse_m: f64,
    /// The same of all vehicles together.
    radio: LinkCount,
}

pub(crate) fn run(arguments: &FlyArguments) -> miette::Result<()> {
    let scenario = scenario(arguments)?;
    let result = Flight::prepare(&scenario, arguments)?.fly(&scenario)?;
    if arguments.json {
        print_json(&result)?;
    } else {
        print(&table(&result))?;
    }
    if result.team_rmse_m.is_none() {
        return Err(miette!(
            help = "see `skein status` of each vehicle: it says why there is no estimate",
            "not one estimate was heard"
        ));
    }
    Ok(())
}

fn scenario(arguments: &FlyArguments) -> miette::Result<Scenario> {
    let mut scenario = named_scenario(&arguments.scenario)?;
    scenario.standstill_s = scenario.standstill_s.max(STANDSTILL_MIN_S);
    scenario.duration_s = arguments.duration.unwrap_or(scenario.duration_s);
    scenario.radio.loss = arguments.loss.unwrap_or(scenario.radio.loss);
    scenario.radio.delay_s = arguments.delay.unwrap_or(scenario.radio.delay_s);
    scenario.radio.impairments().check().into_diagnostic()?;
    if !scenario.duration_s.is_finite() || scenario.duration_s <= 0.0 {
        return Err(miette!("--duration must be a positive number of seconds"));
    }
    Ok(scenario)
}

/// A built-in scenario by its name, or one from a TOML file.
fn named_scenario(name_or_file: &str) -> miette::Result<Scenario> {
    if let Some(scenario) = Scenario::built_in(name_or_file) {
        return Ok(scenario);
    }
    let text = std::fs::read_to_string(name_or_file).map_err(|error| {
        let known: Vec<&str> = Scenario::built_in_names().collect();
        miette!(
            help = format!("built in are: {}", known.join(", ")),
            "{name_or_file} is neither a built-in scenario nor a file that can be read: {error}"
        )
    })?;
    Ok(Scenario::parse(&text, name_or_file)?)
}

/// Everything in place, and the time at which the motion starts.
struct Flight {
    world: World,
    agents: Vec<Agent>,
    drivers: Vec<BTreeMap<Name, FrameSender>>,
    air: Air,
    clock: Clock,
    zero: Stamp,
    sample: u64,
}

impl Flight {
    fn prepare(scenario: &Scenario, arguments: &FlyArguments) -> miette::Result<Self> {
        let world = World::new(scenario, arguments.sample);
        let clock = Clock::real();
        let agents = if arguments.world_only {
            Vec::new()
        } else {
            start_agents(&world, clock, arguments)?
        };
        let network = match agents.first() {
            Some(first) => NetworkSettings::loopback(first.locators()),
            None => NetworkSettings {
                listen: arguments.listen.clone(),
                connect: arguments.connect.clone(),
                ..NetworkSettings::default()
            },
        };
        let air = Air::join(arguments.fleet, &network)?;
        let zero = clock.now() + Span::from_secs_f64(scenario.standstill_s);
        let world = world.at_unix_time(zero.as_nanos());
        let zero = Stamp::from_nanos(world.stamp_ns(0, 0) - world.clock_ahead_ns(0));
        let sensors = |agent: &Agent, vehicle: usize| -> BTreeMap<Name, FrameSender> {
            let names = world
                .config(vehicle, 0)
                .sensors
                .into_iter()
                .map(|sensor| sensor.name);
            names
                .filter_map(|name| Some((name, agent.driver(name)?)))
                .collect()
        };
        let drivers = agents
            .iter()
            .enumerate()
            .map(|(vehicle, agent)| sensors(agent, vehicle))
            .collect();
        Ok(Self {
            world,
            agents,
            drivers,
            air,
            clock,
            zero,
            sample: arguments.sample,
        })
    }

    /// Plays the world in real time and keeps score.
    fn fly(mut self, scenario: &Scenario) -> miette::Result<FlightResult> {
        let (_, end_ns) = self.world.span_ns();
        let vehicles = self.world.vehicles();
        let mut score = Score::new(vehicles);
        let progress = ProgressBar::new(scenario.duration_s.ceil() as u64).with_style(
            ProgressStyle::with_template("{wide_bar} {pos}/{len} s  {msg}").into_diagnostic()?,
        );
        progress.set_message("the vehicles find each other");
        let mut events: BTreeMap<(i64, u64), Event> = BTreeMap::new();
        let mut order = 0;
        let mut push = |events: &mut BTreeMap<(i64, u64), Event>, at_ns: i64, event: Event| {
            order += 1;
            events.insert((at_ns, order), event);
        };
        let begin_ns = self.now_ns();
        for vehicle in 0..vehicles {
            let instant_ns = self
                .world
                .first_instant_ns(vehicle, begin_ns + self.world.period_ns());
            push(
                &mut events,
                begin_ns,
                Event::Prepare {
                    vehicle,
                    instant_ns,
                },
            );
        }
        push(&mut events, begin_ns, Event::Dictate { again: true });
        // Silences and partitions begin and end on time, not at the next repetition.
        for turn_ns in scenario.radio.turns_s().map(nanos) {
            if turn_ns > begin_ns {
                push(&mut events, turn_ns, Event::Dictate { again: false });
            }
        }
        push(&mut events, self.world.period_ns(), Event::Score);
        while let Some(((at_ns, _), event)) = events.pop_first() {
            if at_ns > end_ns + self.world.period_ns() {
                break;
            }
            self.sleep_until(at_ns);
            match event {
                Event::Prepare {
                    vehicle,
                    instant_ns,
                } => {
                    if let Some(estimate) = self.air.estimate(self.world.name(vehicle)) {
                        self.world.told(vehicle, &estimate);
                    }
                    for delivery in self.world.round(vehicle, instant_ns) {
                        push(
                            &mut events,
                            delivery.at_ns,
                            Event::Bring { vehicle, delivery },
                        );
                    }
                    score.reckon(&self.world, vehicle, instant_ns);
                    let next_ns = instant_ns + self.world.period_ns();
                    push(
                        &mut events,
                        instant_ns,
                        Event::Prepare {
                            vehicle,
                            instant_ns: next_ns,
                        },
                    );
                }
                Event::Bring { vehicle, delivery } => self.bring(vehicle, &delivery)?,
                Event::Dictate { again } => {
                    self.air.dictate(&self.faults(&scenario.radio, at_ns))?;
                    if again {
                        push(
                            &mut events,
                            at_ns + FAULTS_EVERY_NS,
                            Event::Dictate { again },
                        );
                    }
                }
                Event::Score => {
                    let error_m = score.take(&self.world, &self.air);
                    progress.set_position(seconds(at_ns.max(0)) as u64);
                    progress.set_message(format!("team error {error_m:.2} m"));
                    push(&mut events, at_ns + self.world.period_ns(), Event::Score);
                }
            }
        }
        progress.finish_and_clear();
        // One more health, so that it tells of the whole flight.
        self.sleep_until(end_ns + 1_200_000_000);
        let result = score.result(&self.world, &self.air, scenario, self.sample);
        for agent in self.agents {
            agent.stop();
        }
        Ok(result)
    }

    fn now_ns(&self) -> i64 {
        (self.clock.now() - self.zero).as_nanos()
    }

    fn sleep_until(&self, at_ns: i64) {
        let wait = self
            .clock
            .real_time(Span::from_nanos(at_ns - self.now_ns()));
        std::thread::sleep(wait);
    }

    fn bring(&self, vehicle: usize, delivery: &Delivery) -> miette::Result<()> {
        match self
            .drivers
            .get(vehicle)
            .and_then(|sensors| sensors.get(&delivery.sensor))
        {
            Some(driver) => {
                driver.send(&delivery.frame);
                Ok(())
            }
            None => self.air.drive(
                self.world.name(vehicle),
                delivery.sensor,
                delivery.frame.encode(),
            ),
        }
    }

    /// What the radio does now, with who is out of whose range, silenced or in another part of the fleet.
    fn faults(&self, radio: &RadioSettings, at_ns: i64) -> Faults {
        let vehicles = 0..self.world.vehicles();
        let names: Vec<Name> = vehicles.map(|vehicle| self.world.name(vehicle)).collect();
        let place = |vehicle| self.world.pose(vehicle, at_ns).translation.vector;
        radio.faults(seconds(at_ns), &names, |a, b| (place(a) - place(b)).norm())
    }
}

enum Event {
    Prepare {
        vehicle: usize,
        instant_ns: i64,
    },
    Bring {
        vehicle: usize,
        delivery: Delivery,
    },
    /// Tells the agents what the radio does now, and perhaps again after a while.
    Dictate {
        again: bool,
    },
    Score,
}

/// One agent a vehicle, each dialling those before it.
fn start_agents(
    world: &World,
    clock: Clock,
    arguments: &FlyArguments,
) -> miette::Result<Vec<Agent>> {
    let mut agents: Vec<Agent> = Vec::new();
    for vehicle in 0..world.vehicles() {
        let connect = agents.iter().flat_map(Agent::locators).collect();
        let mut config = world.config(vehicle, new_boot());
        config.estimate_spacing = Span::millis(20);
        config.mode = arguments.mode.mode();
        config.mutual.bearings_to_cooperative &= !arguments.without_bearings;
        if arguments.without_mounts {
            for sensor in &mut config.sensors {
                sensor.body_from_sensor = skein_estimation::Transform::identity();
            }
        }
        let ahead = Span::from_nanos(world.clock_ahead_ns(vehicle));
        let drivers = config
            .sensors
            .iter()
            .map(|sensor| (sensor.name, DriverSettings::Process))
            .collect();
        let log = arguments
            .log
            .as_ref()
            .map(|folder| folder.join(format!("{}.mcap", config.vehicle)));
        let agent = Agent::start(Settings {
            fleet: arguments.fleet,
            vehicle: config,
            drivers,
            network: NetworkSettings::loopback(connect),
            clock: if ahead == Span::ZERO {
                clock
            } else {
                Clock::scaled(clock.now() + ahead, 1.0)
            },
            log,
            checkpoint: None,
            rpc: false,
            faults: Some(FaultSettings {
                seed: world.streams().seed.wrapping_add(vehicle as u64),
            }),
        })?;
        if !agent.wait_open(OPEN_TIMEOUT) {
            return Err(miette!(
                help = "run with RUST_LOG=zenoh=debug to see what Zenoh says",
                "the Zenoh session of {} did not open within {OPEN_TIMEOUT:?}",
                world.name(vehicle)
            ));
        }
        agents.push(agent);
    }
    Ok(agents)
}

/// The errors of every vehicle, round by round.
struct Score {
    estimated: Vec<Vec<PoseError>>,
    reckoned: Vec<Vec<f64>>,
    /// Where each was last, metres, and how far it has come until then.
    travelled: Vec<Option<(Vector3<f64>, f64)>>,
    statuses: Vec<Option<Status>>,
}

impl Score {
    fn new(vehicles: usize) -> Self {
        Self {
            estimated: vec![Vec::new(); vehicles],
            reckoned: vec![Vec::new(); vehicles],
            travelled: vec![None; vehicles],
            statuses: vec![None; vehicles],
        }
    }

    fn reckon(&mut self, world: &World, vehicle: usize, instant_ns: i64) {
        if instant_ns > 0 {
            let truth = world.pose(vehicle, instant_ns).translation.vector;
            let apart = world.dead_reckoning(vehicle).translation.vector - truth;
            self.reckoned[vehicle].push(apart.norm());
            let path_m =
                self.travelled[vehicle].map_or(0.0, |(was, path_m)| path_m + (truth - was).norm());
            self.travelled[vehicle] = Some((truth, path_m));
        }
    }

    /// Scores the newest estimates; gives the team's present error in metres.
    fn take(&mut self, world: &World, air: &Air) -> f64 {
        let mut squares = Vec::new();
        for (vehicle, errors) in self.estimated.iter_mut().enumerate() {
            let Some(document) = air.estimate(world.name(vehicle)) else {
                continue;
            };
            self.statuses[vehicle] = Some(document.status);
            let Some(pose) = document.pose else { continue };
            let truth = world.pose(vehicle, world.time_ns(vehicle, document.taken_ns));
            let error = PoseError::between(&truth, &pose_of(&pose));
            squares.push(error.position_m.norm_squared());
            errors.push(error);
        }
        root_mean(squares.into_iter()).unwrap_or(f64::NAN)
    }

    fn result(&self, world: &World, air: &Air, scenario: &Scenario, sample: u64) -> FlightResult {
        let vehicles = (0..world.vehicles()).map(|vehicle| {
            let errors = &self.estimated[vehicle];
            let health = air.health(world.name(vehicle));
            let present = |health: &skein_proto::document::HealthDocument| {
                health
                    .neighbours
                    .values()
                    .filter(|neighbour| neighbour.present)
                    .count()
            };
            let reckoned = &self.reckoned[vehicle];
            let process = health.as_ref().and_then(|health| health.process.as_ref());
            VehicleResult {
                vehicle: world.name(vehicle),
                status: self.statuses[vehicle]
                    .map_or("silent", Status::words)
                    .to_owned(),
                final_m: errors.last().map(|error| error.position_m.norm()),
                rmse_m: root_mean(errors.iter().map(|error| error.position_m.norm_squared())),
                orientation_rad: (!errors.is_empty()).then(|| {
                    errors
                        .iter()
                        .map(|error| error.orientation_rad)
                        .sum::<f64>()
                        / errors.len() as f64
                }),
                dead_reckoning_final_m: reckoned.last().copied().unwrap_or(f64::NAN),
                dead_reckoning_rmse_m: root_mean(reckoned.iter().map(|e| e * e))
                    .unwrap_or(f64::NAN),
                path_m: self.travelled[vehicle].map_or(0.0, |(_, path_m)| path_m),
                neighbours: health.as_ref().map_or(0, present),
                rounds_solved: health.as_ref().map_or(0, |health| health.rounds.solved),
                packets_lost: process.map_or(0, |process| process.faults_dropped),
                radio: process
                    .and_then(|process| process.faults)
                    .unwrap_or_default(),
            }
        });
        let vehicles: Vec<VehicleResult> = vehicles.collect();
        let mut radio = LinkCount::default();
        for vehicle in &vehicles {
            radio += vehicle.radio;
        }
        let estimated = self
            .estimated
            .iter()
            .flatten()
            .map(|error| error.position_m.norm_squared());
        let reckoned = self.reckoned.iter().flatten().map(|error| error * error);
        FlightResult {
            scenario: scenario.name.clone(),
            seed: scenario.seed,
            sample,
            vehicles,
            team_rmse_m: root_mean(estimated),
            team_dead_reckoning_rmse_m: root_mean(reckoned).unwrap_or(f64::NAN),
            radio,
        }
    }
}

/// The root of the mean; none of nothing.
fn root_mean(squares: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = squares.fold((0.0, 0usize), |(sum, count), square| {
        (sum + square, count + 1)
    });
    (count > 0).then(|| (sum / count as f64).sqrt())
}

fn table(result: &FlightResult) -> String {
    let metres = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
    let mut text = format!(
        "{} (seed {}, sample {})\n\n",
        result.scenario, result.seed, result.sample
    );
    text.push_str("                             position error, m       odometry alone, m\n");
    text.push_str("vehicle  status              final       RMSE       final       RMSE   path, m  neighbours  rounds\n");
    for row in &result.vehicles {
        let _ = writeln!(
            text,
            "{:<8} {:<15} {:>9} {:>10} {:>11.3} {:>10.3} {:>9.1} {:>11} {:>7}",
            row.vehicle.as_str(),
            row.status,
            metres(row.final_m),
            metres(row.rmse_m),
            row.dead_reckoning_final_m,
            row.dead_reckoning_rmse_m,
            row.path_m,
            row.neighbours,
            row.rounds_solved,
        );
    }
    let _ = writeln!(
        text,
        "\nteam RMSE over the flight: {} m; by odometry alone: {:.3} m",
        metres(result.team_rmse_m),
        result.team_dead_reckoning_rmse_m,
    );
    let by_reason: Vec<String> = result
        .radio
        .by_reason()
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(reason, count)| format!(", {reason} {count}"))
        .collect();
    let _ = writeln!(
        text,
        "radio: {} packets sent, {} arrived{}",
        result.radio.sent,
        result.radio.delivered,
        by_reason.concat()
    );
    text
}
