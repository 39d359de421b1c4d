//! One flight of a scenario as its vehicles' drivers see it: truth turned into driver frames, round by round.
//!
//! The same world feeds a virtual fleet, live agents and the bare solver, so all three fly the same sample.

mod aboard;
mod turns;

use self::aboard::Aboard;
use self::turns::Turns;
use crate::scenario::{Scenario, Start};
use crate::sensor::{Noise, Odometry, Reading, RelativeSensor, Sight};
use crate::stage::Stage;
use crate::streams::{Purpose, Streams};
use crate::truth::Pose;
use rand::RngExt;
use skein_estimation::cooperative::{Mode, Optimiser};
use skein_estimation::ranging::Dimension;
use skein_estimation::time::Span;
use skein_estimation::{Body, Sensor, Transform};
use skein_proto::document::{EstimateDocument, Permit};
use skein_proto::frame::{Frame, OdometryFrame, RelativeFrame, RelativeValue};
use skein_proto::name::Name;
use skein_vehicle::{Config, MutualConfig, RangingConfig, SensorConfig, ToldPose};

/// UNIX time of the start of the motion, on a clock that is not ahead: some day in 2027.
const EPOCH_NS: i64 = 1_800_000_000_000_000_000;
/// Name of every vehicle's odometry.
pub const ODOMETRY: &str = "odometry";
/// Name of every vehicle's relative sensor.
pub const RELATIVE: &str = "relative";
/// Name of every vehicle's inertial sensor.
pub const IMU: &str = "imu";
/// Name of every vehicle's camera.
pub const CAMERA: &str = "camera";

/// Truth and sensors of one sample of a scenario. Times are nanoseconds since the start of the motion.
#[derive(Debug)]
pub struct World {
    scenario: Scenario,
    streams: Streams,
    period_ns: i64,
    epoch_ns: i64,
    vehicles: Vec<Simulated>,
}

#[derive(Debug)]
struct Simulated {
    name: Name,
    ahead_ns: i64,
    odometry: Odometry,
    sensor: RelativeSensor,
    aboard: Aboard,
    dead_reckoning: Pose,
    turns: Turns,
    /// The end of the last round that its drivers were asked for.
    made_ns: i64,
}

/// A frame that a vehicle's driver brings at some time.
#[derive(Clone, Debug, PartialEq)]
pub struct Delivery {
    /// When, in nanoseconds since the start of the motion.
    pub at_ns: i64,
    /// From which of the vehicle's sensors.
    pub sensor: Name,
    /// What it says, on the vehicle's clock.
    pub frame: Frame,
}

/// A name that is known to be one.
fn fixed(name: &str) -> Name {
    Name::parse(name).expect("lower-case letters only")
}

impl World {
    /// The world of one sample.
    #[must_use]
    pub fn new(scenario: &Scenario, sample: u64) -> Self {
        let streams = scenario.streams(sample);
        let period_ns = nanos(scenario.period_s);
        let team = scenario.team.vehicles();
        let vehicles = team.iter().enumerate().map(|(index, vehicle)| Simulated {
            name: Name::parse(&vehicle.name).expect("a scenario checks its names"),
            ahead_ns: scenario.clock_ahead_ns(sample, index),
            odometry: Odometry::new(scenario.odometry, scenario.period_s, index, &streams),
            sensor: RelativeSensor::new(&scenario.sensor, index, team.len(), streams),
            aboard: Aboard::new(scenario, index, streams),
            dead_reckoning: vehicle.trajectory.pose_at(0.0),
            turns: Turns::default(),
            made_ns: 0,
        });
        Self {
            vehicles: vehicles.collect(),
            scenario: scenario.clone(),
            streams,
            period_ns,
            // A multiple of the period, so that clocks that are not ahead have a round at k = 0.
            epoch_ns: EPOCH_NS.div_euclid(period_ns) * period_ns,
        }
    }

    /// The same world begun at another UNIX time of k = 0, rounded down to a whole period: for a live flight.
    #[must_use]
    pub const fn at_unix_time(mut self, zero_ns: i64) -> Self {
        self.epoch_ns = zero_ns.div_euclid(self.period_ns) * self.period_ns;
        self
    }

    /// How far a vehicle's clock is ahead of the simulation's.
    #[must_use]
    pub fn clock_ahead_ns(&self, vehicle: usize) -> i64 {
        self.vehicles[vehicle].ahead_ns
    }

    /// Sets a vehicle's clock forward, or back.
    pub fn step_clock(&mut self, vehicle: usize, by_ns: i64) {
        self.vehicles[vehicle].ahead_ns += by_ns;
    }

    /// What is flown.
    #[must_use]
    pub const fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// A vehicle's name.
    #[must_use]
    pub fn name(&self, vehicle: usize) -> Name {
        self.vehicles[vehicle].name
    }

    /// When the flight begins (everyone stands) and ends.
    #[must_use]
    pub fn span_ns(&self) -> (i64, i64) {
        (
            -nanos(self.scenario.standstill_s),
            nanos(self.scenario.duration_s),
        )
    }

    /// Where a vehicle is.
    #[must_use]
    pub fn pose(&self, vehicle: usize, at_ns: i64) -> Pose {
        self.scenario.team.vehicles()[vehicle]
            .trajectory
            .pose_at(seconds(self.vehicles[vehicle].turns.path_ns(at_ns)))
    }

    /// Where its odometry alone says that it is, at the last round that was made.
    #[must_use]
    pub fn dead_reckoning(&self, vehicle: usize) -> &Pose {
        &self.vehicles[vehicle].dead_reckoning
    }

    fn odometry(&mut self, vehicle: usize, instant_ns: i64) -> Delivery {
        let since_ns = instant_ns - self.period_ns;
        let trajectory = &self.scenario.team.vehicles()[vehicle].trajectory;
        let simulated = &mut self.vehicles[vehicle];
        let motion = simulated.odometry.between(
            trajectory,
            seconds(simulated.turns.path_ns(since_ns)),
            seconds(simulated.turns.path_ns(instant_ns)),
        );
        simulated.dead_reckoning *= motion;
        let noise = &self.scenario.odometry;
        let frame = OdometryFrame {
            since_ns: self.stamp_ns(vehicle, since_ns),
            taken_ns: self.stamp_ns(vehicle, instant_ns),
            motion: numbers(&motion),
            rotation_sigma_rad: noise.rotation_concentration.angle_std_rad(),
            translation_sigma_m: noise.translation_std_m,
        };
        Delivery {
            at_ns: instant_ns,
            sensor: fixed(ODOMETRY),
            frame: Frame::Odometry(frame),
        }
    }

    /// Nobody measures while the team stands: k = 0 is known.
    fn measure(&mut self, vehicle: usize, instant_ns: i64) -> Vec<Delivery> {
        if instant_ns <= 0 {
            return Vec::new();
        }
        let taken_s = self.vehicles[vehicle]
            .sensor
            .begin_round(seconds(instant_ns), seconds(self.period_ns));
        if taken_s <= 0.0 {
            return Vec::new();
        }
        let delay_ns = nanos(self.scenario.sensor.delivery_delay_s);
        let taken_ns = nanos(taken_s);
        let observer = self.pose(vehicle, taken_ns);
        let targets: Vec<(usize, Pose)> = (0..self.vehicles.len())
            .filter(|target| *target != vehicle)
            .map(|target| (target, self.pose(target, taken_ns)))
            .collect();
        let simulated = &mut self.vehicles[vehicle];
        let mut seen: Vec<(usize, Reading)> = Vec::new();
        for (target, world_from_target) in &targets {
            let sight = simulated
                .sensor
                .observe(taken_s, &observer, *target, world_from_target);
            if let Sight::Seen { reading, .. } = sight {
                seen.push((*target, reading));
            }
        }
        seen.extend(simulated.sensor.phantoms(taken_s, &observer));
        let stamp = self.stamp_ns(vehicle, taken_ns);
        let noise = self.scenario.sensor.noise;
        let delivery = |(target, reading): (usize, Reading)| Delivery {
            at_ns: taken_ns + delay_ns,
            sensor: fixed(RELATIVE),
            frame: Frame::Relative(RelativeFrame {
                taken_ns: stamp,
                target: self.vehicles[target].name,
                value: value(&reading, &noise),
            }),
        };
        seen.into_iter().map(delivery).collect()
    }

    /// The random streams of this sample.
    #[must_use]
    pub const fn streams(&self) -> Streams {
        self.streams
    }
}

impl Stage for World {
    fn vehicles(&self) -> usize {
        self.vehicles.len()
    }

    fn begins_ns(&self) -> i64 {
        self.span_ns().0
    }

    fn period_ns(&self) -> i64 {
        self.period_ns
    }

    fn stamp_ns(&self, vehicle: usize, at_ns: i64) -> i64 {
        self.epoch_ns + at_ns + self.vehicles[vehicle].ahead_ns
    }

    fn time_ns(&self, vehicle: usize, stamp_ns: i64) -> i64 {
        stamp_ns - self.epoch_ns - self.vehicles[vehicle].ahead_ns
    }

    fn truth(&self, vehicle: usize, at_ns: i64) -> Option<Pose> {
        Some(self.pose(vehicle, at_ns))
    }

    /// What it measured in the round, then its odometry, then what it felt and saw.
    fn round(&mut self, vehicle: usize, instant_ns: i64) -> Vec<Delivery> {
        self.vehicles[vehicle].made_ns = instant_ns;
        let mut deliveries = self.measure(vehicle, instant_ns);
        deliveries.push(self.odometry(vehicle, instant_ns));
        deliveries.extend(self.felt_and_seen(vehicle, instant_ns));
        deliveries
    }

    /// A vehicle that takes turns obeys from the next round on that its drivers have not been asked for yet.
    fn told(&mut self, vehicle: usize, estimate: &EstimateDocument) {
        if let Some(motion) = &estimate.motion {
            let simulated = &mut self.vehicles[vehicle];
            let from_ns = simulated.made_ns.max(0);
            simulated.turns.told(from_ns, motion.permit == Permit::Move);
        }
    }

    /// What its user would have written.
    fn config(&self, vehicle: usize, boot: u64) -> Config {
        let entry = &self.scenario.team.vehicles()[vehicle];
        let period = Span::from_nanos(self.period_ns);
        let sensor = |name: &str, mount: &Pose| SensorConfig {
            name: fixed(name),
            driver: "simworld".to_owned(),
            body_from_sensor: transform::<Body, Sensor>(mount),
        };
        let mut sensors = vec![
            sensor(ODOMETRY, &Pose::identity()),
            sensor(RELATIVE, self.vehicles[vehicle].sensor.body_from_sensor()),
        ];
        if self.scenario.imu.is_some() {
            sensors.push(sensor(IMU, &Pose::identity()));
        }
        if self.scenario.camera.is_some() {
            sensors.push(sensor(CAMERA, &Pose::identity()));
        }
        Config {
            vehicle: self.vehicles[vehicle].name,
            boot,
            period,
            round_wait: Span::from_nanos(self.period_ns / 2 * 3),
            start: match entry.start {
                Start::Pose => {
                    let place = transform(&entry.trajectory.pose_at(0.0));
                    skein_vehicle::Start::Pose(ToldPose::exact(place))
                }
                Start::Unknown => skein_vehicle::Start::Unknown,
            },
            mode: Mode::default(),
            optimiser: Optimiser::gauss_newton(),
            mutual: MutualConfig::DEFAULT,
            ranging: RangingConfig {
                dimension: if self.scenario.planar {
                    Dimension::Planar
                } else {
                    Dimension::Spatial
                },
                schedule: self.scenario.schedule,
            },
            sensors,
            body_from_target: Transform::identity(),
            presence_timeout: Span::secs(3),
            repeats: 3,
            relay: false,
            estimate_spacing: Span::ZERO,
        }
    }

    fn boot(&self, vehicle: usize, start: usize) -> u64 {
        let mut stream = self.streams.vehicle(vehicle, Purpose::VehicleSoftware);
        (0..=start)
            .map(|_| stream.random())
            .last()
            .unwrap_or_default()
    }
}

/// Whole nanoseconds of a number of seconds.
#[must_use]
pub fn nanos(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

/// Seconds of whole nanoseconds. Times of rounds come out as near to `0.2 k` as a float can be.
#[must_use]
pub fn seconds(nanos: i64) -> f64 {
    nanos as f64 / 1e9
}

/// Rotation vector, then translation.
#[must_use]
pub fn numbers(pose: &Pose) -> [f64; 6] {
    let w = pose.rotation.scaled_axis();
    let t = pose.translation.vector;
    [w.x, w.y, w.z, t.x, t.y, t.z]
}

/// Truth as the estimators write it.
#[must_use]
pub fn transform<To, From>(pose: &Pose) -> Transform<To, From> {
    Transform::new(pose.rotation, pose.translation.vector)
}

/// An estimator's pose as truth writes it.
#[must_use]
pub fn from_transform<To, From>(transform: &Transform<To, From>) -> Pose {
    Pose::from_parts(transform.translation.into(), transform.rotation)
}

fn value(reading: &Reading, noise: &Noise) -> RelativeValue {
    let rotation_sigma_rad = noise.rotation_concentration.angle_std_rad();
    let translation_sigma_m = noise.translation_std_m;
    match reading {
        Reading::Pose(sensor_from_target) => RelativeValue::Pose {
            sensor_from_target: numbers(sensor_from_target),
            rotation_sigma_rad,
            translation_sigma_m,
        },
        Reading::Orientation(rotation) => RelativeValue::Orientation {
            rotation_vector_rad: rotation.scaled_axis().into(),
            sigma_rad: rotation_sigma_rad,
        },
        Reading::Position(position) => RelativeValue::Position {
            position_m: (*position).into(),
            sigma_m: translation_sigma_m,
        },
        Reading::Bearing(direction) => RelativeValue::Bearing {
            direction: direction.into_inner().into(),
            sigma_rad: noise.bearing_concentration.angle_std_rad(),
        },
        Reading::Distance(distance_m) => RelativeValue::Distance {
            distance_m: *distance_m,
            sigma_m: noise.distance_std_m,
        },
    }
}
