//! What the stories of live teams share: vehicles that fly in line abreast, one metre apart, each seeing the others.
#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each story is a crate of its own and uses what it needs; outside of tests nobody reads this"
)]

use skein_agent::{Agent, Clock, FaultSettings, NetworkSettings, Settings, new_boot};
use skein_estimation::cooperative::{Mode, Optimiser};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::transform::Transform;
use skein_proto::document::NeighbourHealth;
use skein_proto::frame::{Frame, OdometryFrame, RelativeFrame, RelativeValue};
use skein_proto::name::Name;
use skein_proto::status::Status;
use skein_vehicle::{Config, MutualConfig, RangingConfig, SensorConfig, Start, ToldPose};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long anything may take for which nothing shorter is promised.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);
/// Zenoh's lease as the network settings set it: what is silent for longer is gone.
pub(crate) const LEASE: Duration = Duration::from_secs(2);
/// The sensors of every vehicle of the team.
pub(crate) const SENSORS: [&str; 2] = ["odometry", "tags"];

pub(crate) fn name(text: &str) -> Name {
    Name::parse(text).unwrap()
}

/// The name of the nth vehicle, from 0.
pub(crate) fn nth_name(nth: usize) -> Name {
    name(&format!("v{}", nth + 1))
}

/// Where the nth vehicle starts: the others are to its left.
pub(crate) fn nth_place(nth: usize) -> Transform<skein_estimation::World, skein_estimation::Body> {
    Transform::new(
        nalgebra::UnitQuaternion::identity(),
        nalgebra::Vector3::new(0.0, nth as f64, 0.0),
    )
}

/// The nth vehicle on a network of its own, with simulated faults obeyed.
pub(crate) fn settings(fleet: &str, nth: usize, network: NetworkSettings) -> Settings {
    let mut settings = settings_of(fleet, nth_name(nth).as_str(), network);
    settings.vehicle.start = Start::Pose(ToldPose::by_hand(nth_place(nth)));
    settings.faults = Some(FaultSettings { seed: 1 });
    settings
}

/// A vehicle of any name on a network of its own. It starts at the origin.
pub(crate) fn settings_of(fleet: &str, vehicle: &str, network: NetworkSettings) -> Settings {
    let sensor = |text: &str| SensorConfig {
        name: name(text),
        driver: "process".to_owned(),
        body_from_sensor: Transform::identity(),
    };
    Settings {
        fleet: name(fleet),
        vehicle: Config {
            vehicle: name(vehicle),
            boot: new_boot(),
            period: Span::millis(200),
            round_wait: Span::millis(300),
            start: Start::Pose(ToldPose::by_hand(Transform::identity())),
            mode: Mode::default(),
            optimiser: Optimiser::default(),
            mutual: MutualConfig::DEFAULT,
            ranging: RangingConfig::DEFAULT,
            sensors: SENSORS.map(sensor).to_vec(),
            body_from_target: Transform::identity(),
            presence_timeout: Span::secs(2),
            repeats: 3,
            relay: false,
            estimate_spacing: Span::millis(50),
        },
        drivers: BTreeMap::new(),
        network,
        clock: Clock::real(),
        log: None,
        checkpoint: None,
        rpc: false,
        faults: None,
    }
}

pub(crate) fn started(settings: Settings) -> Agent {
    let agent = Agent::start(settings).unwrap();
    assert!(agent.wait_open(PATIENCE), "no session");
    agent
}

/// Real time since something happened.
#[derive(Clone, Copy)]
pub(crate) struct Since(Instant);

impl Since {
    #[expect(
        clippy::disallowed_methods,
        reason = "a test that watches real processes measures real time"
    )]
    pub(crate) fn now() -> Self {
        Self(Instant::now())
    }

    pub(crate) fn elapsed(self) -> Duration {
        self.0.elapsed()
    }

    /// How long after something before it.
    pub(crate) fn after(self, before: Self) -> Duration {
        self.0.saturating_duration_since(before.0)
    }
}

/// Waits until something holds and tells how long that took; fails with `what` when it does not `within` that time.
pub(crate) fn within(within: Duration, what: &str, mut holds: impl FnMut() -> bool) -> Duration {
    let since = Since::now();
    loop {
        let took = since.elapsed();
        if holds() {
            return took;
        }
        assert!(took < within, "{what}: not within {within:?}");
        pause();
    }
}

/// Waits until something holds that nothing promises a time for.
pub(crate) fn until(what: &str, holds: impl FnMut() -> bool) -> Duration {
    within(PATIENCE, what, holds)
}

pub(crate) fn pause() {
    std::thread::sleep(Duration::from_millis(5));
}

pub(crate) fn status(agent: &Agent) -> Option<Status> {
    Some(agent.latest_estimate()?.document.status)
}

pub(crate) fn neighbour(agent: &Agent, of: &str) -> NeighbourHealth {
    agent
        .latest_health()
        .and_then(|health| health.neighbours.get(of).cloned())
        .unwrap_or_default()
}

/// A vehicle's drivers, in a thread until it is dropped.
pub(crate) struct Flight {
    landed: Arc<AtomicBool>,
    drivers: Option<JoinHandle<()>>,
}

impl Flight {
    /// The nth of `team` vehicles flies ahead at 1 m/s: odometry 20 times a second, a pose of each other five times.
    pub(crate) fn of(
        nth: usize,
        team: usize,
        clock: Clock,
        mut send: impl FnMut(&str, &Frame) + Send + 'static,
    ) -> Self {
        let landed = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&landed);
        let drivers = std::thread::spawn(move || {
            let mut since = clock.now();
            for tick in 1_u64.. {
                std::thread::sleep(Duration::from_millis(50));
                if over.load(Ordering::Relaxed) {
                    return;
                }
                let taken = clock.now();
                send("odometry", &odometry(since, taken));
                since = taken;
                if tick.is_multiple_of(4) {
                    for other in (0..team).filter(|other| *other != nth) {
                        send("tags", &seen(taken, nth, other));
                    }
                }
            }
        });
        Self {
            landed,
            drivers: Some(drivers),
        }
    }

    /// The same, for an agent in this process.
    pub(crate) fn in_process(nth: usize, team: usize, clock: Clock, agent: &Agent) -> Self {
        let senders = SENSORS.map(|sensor| (sensor, agent.driver(name(sensor)).unwrap()));
        Self::of(nth, team, clock, move |sensor, frame| {
            let (_, sender) = senders.iter().find(|(name, _)| *name == sensor).unwrap();
            sender.send(frame);
        })
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        self.landed.store(true, Ordering::Relaxed);
        if let Some(drivers) = self.drivers.take() {
            drivers.join().unwrap();
        }
    }
}

fn odometry(since: Stamp, taken: Stamp) -> Frame {
    let moved_m = (taken - since).as_secs_f64();
    Frame::Odometry(OdometryFrame {
        since_ns: since.as_nanos(),
        taken_ns: taken.as_nanos(),
        motion: [0.0, 0.0, 0.0, moved_m, 0.0, 0.0],
        rotation_sigma_rad: 0.001,
        translation_sigma_m: 0.002,
    })
}

fn seen(taken: Stamp, nth: usize, other: usize) -> Frame {
    let to_the_left_m = other as f64 - nth as f64;
    Frame::Relative(RelativeFrame {
        taken_ns: taken.as_nanos(),
        target: nth_name(other),
        value: RelativeValue::Pose {
            sensor_from_target: [0.0, 0.0, 0.0, 0.0, to_the_left_m, 0.0],
            rotation_sigma_rad: 0.01,
            translation_sigma_m: 0.02,
        },
    })
}
