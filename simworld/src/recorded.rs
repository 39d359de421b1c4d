//! Real robots flown again: a recording as the drivers of its robots would have brought it, and the score against
//! motion capture. Truth gives the start poses and the score; the vehicles see nothing else of it.

mod scoring;

pub use scoring::{Flown, ReplayScore, Reported, RobotScore, Score};

use crate::calibration::{CalibratedReading, Calibration, Readings};
use crate::fleet::pose_of;
use crate::mrclam::{Recording, Subject};
use crate::radio::{Radio, RadioSettings};
use crate::stage::Stage;
use crate::streams::Streams;
use crate::truth::Pose;
use crate::world::{Delivery, numbers, transform};
use nalgebra::Point3;
use serde::Serialize;
use skein_estimation::Transform;
use skein_estimation::cooperative::{Mode, Optimiser};
use skein_estimation::time::Span;
use skein_proto::document::EstimateDocument;
use skein_proto::frame::{FixFrame, FixValue, Frame, OdometryFrame, RelativeFrame, RelativeValue};
use skein_proto::name::Name;
use skein_vehicle::{Config, MutualConfig, RangingConfig, SensorConfig, Start, ToldPose};

/// Length of one odometry increment, made from the commands that held in it.
const ODOMETRY_NS: i64 = 50_000_000;
/// Truth is not interpolated across longer gaps.
const TRUTH_GAP_NS: i64 = 500_000_000;
/// The recordings are used from here on: every robot has truth and moves.
const SKIPPED_NS: i64 = 10_000_000_000;
/// Smallest standard deviation of an increment in rad and m: a robot that stands still is sure, not certain.
const SIGMA_MIN: f64 = 1e-4;
/// The rounds of the vehicles, as everywhere.
const PERIOD_NS: i64 = 200_000_000;
/// How many seconds the vehicles are given to find each other before the recording moves.
const STANDSTILL_NS: i64 = 3_000_000_000;
/// What packets take in virtual time. Any delay gives the same result; none at all would let vehicles hear of a round
/// before they have opened their own, which no radio does.
const RADIO_DELAY_S: f64 = 0.002;
const ODOMETRY: &str = "odometry";
const CAMERA: &str = "camera";

/// How the vehicles know which robot a reading is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Identities {
    /// By the barcode, as recorded.
    #[default]
    Recorded,
    /// Not at all: each reading is laid to the robot whose published estimate is nearest to what was seen, as a camera
    /// does that sees robots but not which. In virtual time only.
    Nearest,
}

/// How often the nearest robot was the right one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Assigned {
    /// Readings of robots.
    pub readings: u64,
    /// Laid to the robot that it was.
    pub right: u64,
    /// Nobody had an estimate yet.
    pub dropped: u64,
}

/// As what a reading of a robot is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    /// As a position, equally noisy in all directions.
    Position,
    /// As a bearing and a range.
    BearingAndRange,
}

/// A recording, cut at the start and turned into frames. Zero is its first common time; until then everyone stands.
#[derive(Debug)]
pub struct Recorded {
    recording: Recording,
    calibration: Calibration,
    start_ns: i64,
    end_ns: i64,
    starts: Vec<Pose>,
    frames: Vec<Vec<Delivery>>,
    next: Vec<usize>,
    mode: Mode,
    readings: Readings,
    identities: Identities,
    /// The newest published poses.
    published: Vec<Option<Pose>>,
    assigned: Assigned,
}

/// A recording that cannot be flown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("robot {robot} has no truth at the common start, 10 s into the recording")]
pub struct NoStart {
    /// Which robot, from 1.
    pub robot: usize,
}

fn fixed(name: &str) -> Name {
    Name::parse(name).expect("lower-case letters only")
}

impl Recorded {
    /// Prepares a recording with the readings that are wanted. Fails when a robot has no truth to start from.
    pub fn new(
        recording: Recording,
        calibration: Calibration,
        readings: Readings,
    ) -> Result<Self, NoStart> {
        let start_ns = (recording.start_ns() + SKIPPED_NS).div_euclid(PERIOD_NS) * PERIOD_NS;
        let end_ns = recording.end_ns();
        let start = |(robot, record): (usize, &crate::mrclam::RobotRecord)| {
            record
                .truth
                .pose_at(start_ns, TRUTH_GAP_NS)
                .ok_or(NoStart { robot: robot + 1 })
        };
        let starts: Vec<Pose> = recording
            .robots
            .iter()
            .enumerate()
            .map(start)
            .collect::<Result<_, _>>()?;
        let mut recorded = Self {
            next: vec![0; starts.len()],
            published: vec![None; starts.len()],
            assigned: Assigned::default(),
            mode: Mode::default(),
            identities: Identities::default(),
            frames: Vec::new(),
            readings,
            recording,
            calibration,
            start_ns,
            end_ns,
            starts,
        };
        recorded.tell();
        Ok(recorded)
    }

    /// The same, flown in another mode.
    #[must_use]
    pub fn in_mode(mut self, mode: Mode) -> Self {
        self.mode = mode;
        self.tell();
        self
    }

    /// The same with identities known otherwise.
    #[must_use]
    pub fn with_identities(mut self, identities: Identities) -> Self {
        self.identities = identities;
        self.tell();
        self
    }

    /// Makes everybody's frames.
    fn tell(&mut self) {
        let frames = (0..self.starts.len()).map(|robot| self.make_frames(robot, self.readings));
        self.frames = frames.collect();
    }

    /// A mode that weighs measurements by their noise is told bearing and range, each with its own; the others a position,
    /// and whoever has to find out by the place which robot a reading is of.
    fn told(&self) -> Told {
        match (self.mode, self.identities) {
            (Mode::Team, Identities::Recorded) => Told::BearingAndRange,
            _ => Told::Position,
        }
    }

    /// How often readings were laid to the right robot, when their identities were dropped.
    #[must_use]
    pub fn assigned(&self) -> Option<Assigned> {
        (self.identities == Identities::Nearest).then_some(self.assigned)
    }

    /// Lays a reading to the robot that is thought to be nearest to what was seen. False when there is none.
    fn identify(&mut self, observer: usize, frame: &mut RelativeFrame) -> bool {
        let RelativeValue::Position { position_m, .. } = frame.value else {
            return true;
        };
        let Some(own) = &self.published[observer] else {
            self.assigned.dropped += 1;
            return false;
        };
        let seen = own * Point3::from(position_m);
        let apart_m = |robot: usize| {
            let place = self.published[robot].as_ref()?.translation.vector;
            Some((seen.coords - place).xy().norm())
        };
        let others = (0..self.starts.len()).filter(|robot| *robot != observer);
        let nearest = others
            .filter_map(|robot| Some((robot, apart_m(robot)?)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((robot, _)) = nearest else {
            self.assigned.dropped += 1;
            return false;
        };
        let name = self.name(robot);
        self.assigned.readings += 1;
        self.assigned.right += u64::from(frame.target == name);
        frame.target = name;
        true
    }

    /// The radio of a flight in virtual time.
    #[must_use]
    pub fn radio() -> Radio {
        let settings = RadioSettings {
            delay_s: RADIO_DELAY_S,
            ..RadioSettings::default()
        };
        Radio::new(&settings, Streams::new(1, 0))
    }

    /// Length of the flight, the standstill not counted.
    #[must_use]
    pub const fn duration_ns(&self) -> i64 {
        self.end_ns - self.start_ns
    }

    /// UNIX time of its zero.
    #[must_use]
    pub const fn start_unix_ns(&self) -> i64 {
        self.start_ns
    }

    /// All frames of one robot in the order of their arrival.
    #[must_use]
    pub fn frames(&self, robot: usize) -> &[Delivery] {
        &self.frames[robot]
    }

    fn make_frames(&self, robot: usize, readings: Readings) -> Vec<Delivery> {
        let record = &self.recording.robots[robot];
        let mut frames = Vec::new();
        let mut from_ns = self.start_ns - STANDSTILL_NS;
        while from_ns + ODOMETRY_NS <= self.end_ns {
            let to_ns = from_ns + ODOMETRY_NS;
            let moves = to_ns > self.start_ns;
            let increment = self.calibration.increment(&record.commands, from_ns, to_ns);
            let motion = if moves {
                increment.earlier_from_later
            } else {
                Pose::identity()
            };
            let frame = OdometryFrame {
                since_ns: from_ns,
                taken_ns: to_ns,
                motion: numbers(&motion),
                rotation_sigma_rad: increment.yaw_std_rad.max(SIGMA_MIN),
                translation_sigma_m: increment.along_std_m.max(SIGMA_MIN),
            };
            frames.push(Delivery {
                at_ns: to_ns - self.start_ns,
                sensor: fixed(ODOMETRY),
                frame: Frame::Odometry(frame),
            });
            from_ns = to_ns;
        }
        let readings = self.calibration.readings(record, readings);
        let lag_ns = crate::world::nanos(self.calibration.camera_lag_s);
        let flown = self.start_ns + 1..self.end_ns;
        for reading in readings.filter(|reading| flown.contains(&reading.time_ns)) {
            for frame in self.sighting(&reading) {
                frames.push(Delivery {
                    at_ns: reading.time_ns + lag_ns - self.start_ns,
                    sensor: fixed(CAMERA),
                    frame,
                });
            }
        }
        frames.sort_by_key(|delivery| delivery.at_ns);
        frames
    }

    /// What the camera saw, as frames; none for a landmark that was not surveyed.
    fn sighting(&self, reading: &CalibratedReading) -> Vec<Frame> {
        let (sin, cos) = reading.bearing_rad.sin_cos();
        // The robots stand on one floor, and their cameras and all barcodes at one height.
        let direction = [cos, sin, 0.0];
        let position_m = direction.map(|axis| axis * reading.range_m);
        let across_m = reading.range_m * reading.bearing_std_rad;
        let sigma_m = reading.range_std_m.max(across_m).max(SIGMA_MIN);
        let taken_ns = reading.time_ns;
        match reading.subject {
            Subject::Robot(target) => {
                let values = match self.told() {
                    Told::Position => vec![RelativeValue::Position {
                        position_m,
                        sigma_m,
                    }],
                    Told::BearingAndRange => vec![
                        RelativeValue::Bearing {
                            direction,
                            sigma_rad: reading.bearing_std_rad.max(SIGMA_MIN),
                        },
                        RelativeValue::Distance {
                            distance_m: reading.range_m,
                            sigma_m: reading.range_std_m.max(SIGMA_MIN),
                        },
                    ],
                };
                let target = self.name(target);
                let frame = |value| {
                    Frame::Relative(RelativeFrame {
                        taken_ns,
                        target,
                        value,
                    })
                };
                values.into_iter().map(frame).collect()
            }
            Subject::Landmark(subject) => {
                let landmarks = &self.recording.landmarks;
                let Some(landmark) = landmarks.iter().find(|known| known.subject == subject) else {
                    return Vec::new();
                };
                let value = FixValue::Landmark {
                    landmark_m: [landmark.x_m, landmark.y_m, 0.0],
                    position_m,
                    sigma_m,
                };
                vec![Frame::Fix(FixFrame { taken_ns, value })]
            }
        }
    }

    /// A robot's name in the fleet.
    #[must_use]
    pub fn name(&self, robot: usize) -> Name {
        Name::parse(&format!("robot{}", robot + 1)).expect("letters and a digit")
    }

    /// Dead reckoning by a robot's odometry alone at later times, each after the one before.
    #[must_use]
    pub fn dead_reckoning(&self, robot: usize, at_ns: &[i64]) -> Vec<Pose> {
        let times = at_ns.iter().map(|at| at + self.start_ns);
        let record = &self.recording.robots[robot];
        self.calibration
            .dead_reckoning(&record.commands, &self.starts[robot], self.start_ns, times)
    }
}

impl Stage for Recorded {
    fn vehicles(&self) -> usize {
        self.starts.len()
    }

    fn begins_ns(&self) -> i64 {
        -STANDSTILL_NS
    }

    fn period_ns(&self) -> i64 {
        PERIOD_NS
    }

    fn stamp_ns(&self, _: usize, at_ns: i64) -> i64 {
        self.start_ns + at_ns
    }

    fn time_ns(&self, _: usize, stamp_ns: i64) -> i64 {
        stamp_ns - self.start_ns
    }

    fn truth(&self, vehicle: usize, at_ns: i64) -> Option<Pose> {
        self.recording.robots[vehicle]
            .truth
            .pose_at(self.start_ns + at_ns, TRUTH_GAP_NS)
    }

    fn boot(&self, vehicle: usize, start: usize) -> u64 {
        (vehicle as u64 + 1) << 32 | start as u64
    }

    fn config(&self, vehicle: usize, boot: u64) -> Config {
        let sensor = |name| SensorConfig {
            name: fixed(name),
            driver: "replay".to_owned(),
            body_from_sensor: Transform::identity(),
        };
        Config {
            vehicle: self.name(vehicle),
            boot,
            period: Span::from_nanos(PERIOD_NS),
            round_wait: Span::from_nanos(PERIOD_NS / 2 * 3),
            start: Start::Pose(ToldPose::exact(transform(&self.starts[vehicle]))),
            mode: self.mode,
            optimiser: Optimiser::gauss_newton(),
            mutual: MutualConfig::DEFAULT,
            ranging: RangingConfig::DEFAULT,
            sensors: vec![sensor(ODOMETRY), sensor(CAMERA)],
            body_from_target: Transform::identity(),
            presence_timeout: Span::secs(3),
            repeats: 3,
            relay: false,
            estimate_spacing: Span::millis(20),
        }
    }

    fn round(&mut self, vehicle: usize, instant_ns: i64) -> Vec<Delivery> {
        let from = self.next[vehicle];
        let frames = &self.frames[vehicle][from..];
        let count = frames.partition_point(|delivery| delivery.at_ns <= instant_ns);
        self.next[vehicle] = from + count;
        let mut frames = frames[..count].to_vec();
        if self.identities == Identities::Nearest {
            frames.retain_mut(|delivery| match &mut delivery.frame {
                Frame::Relative(frame) => self.identify(vehicle, frame),
                _ => true,
            });
        }
        frames
    }

    fn told(&mut self, vehicle: usize, estimate: &EstimateDocument) {
        self.published[vehicle] = estimate.pose.as_ref().map(pose_of);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::datasets;
    use crate::fleet::Fleet;

    fn fly(readings: Readings) -> Option<ReplayScore> {
        let recording = datasets::read_mrclam(&datasets::find("mrclam6")?).unwrap();
        let recorded = Recorded::new(recording, Calibration::default(), readings).unwrap();
        let end_ns = recorded.duration_ns();
        let mut fleet = Fleet::on(recorded, Recorded::radio(), |_, config| config);
        let mut flown = Flown::default();
        let mut at_ns = 0;
        while at_ns <= end_ns {
            fleet.run_until(at_ns + 1);
            let newest = |robot| Reported::of(fleet.estimate(robot)?, fleet.stage(), robot);
            flown.push((0..fleet.len()).map(newest).collect());
            at_ns += PERIOD_NS;
        }
        flown.score(fleet.stage())
    }

    #[test]
    fn five_real_robots_hold_each_other_far_better_than_their_wheels_do() {
        let Some(score) = fly(Readings::OfRobots) else {
            return;
        };
        println!("{:?}", score.team);
        assert!(score.team.position_rmse_m < 1.35, "{score:?}");
        assert!(score.team.relative_rmse_m < 0.85, "{score:?}");
    }

    #[test]
    fn surveyed_landmarks_take_more_than_half_of_the_drift_away() {
        let flights = fly(Readings::OfRobots).zip(fly(Readings::OfRobotsAndLandmarks));
        let Some((without, with)) = flights else {
            return;
        };
        println!("{:?}", with.team);
        assert!(
            with.team.position_rmse_m < 0.5 * without.team.position_rmse_m,
            "{with:?}"
        );
    }
}
