//! What turns the commands and readings of planar robots into measurements: scales, biases, lags and noises. They
//! belong to the robots, hence into a file of the user's; without one everything is taken as recorded.

use crate::bounded::{finite, not_negative, positive};
use crate::mrclam::{Command, RangeBearing, RobotRecord, Subject};
use crate::truth::{Pose, pose_from_euler};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// How a robot's commands become its motion and its camera's numbers become range and bearing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Calibration {
    /// True turn rate per commanded turn rate.
    #[serde(deserialize_with = "positive")]
    pub turn_scale: f64,
    /// What is added to the scaled turn rate while a command holds that moves the robot, radians per second.
    #[serde(deserialize_with = "finite")]
    pub turn_bias_radps: f64,
    /// True speed per commanded speed while going straight.
    #[serde(deserialize_with = "positive")]
    pub speed_scale_straight: f64,
    /// True speed per commanded speed while turning.
    #[serde(deserialize_with = "positive")]
    pub speed_scale_turning: f64,
    /// Above which commanded turn rate the robot counts as turning, radians per second.
    #[serde(deserialize_with = "not_negative")]
    pub turning_above_radps: f64,
    /// How long after its time stamp a command takes effect, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub command_lag_s: f64,
    /// How long before its time stamp an image was taken, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub camera_lag_s: f64,
    /// What is subtracted from a range, metres.
    #[serde(deserialize_with = "finite")]
    pub range_bias_m: f64,
    /// The noises.
    pub noise: PlanarNoise,
}

/// Standard deviations of planar odometry and of range and bearing. The defaults are round numbers that suit no robot
/// in particular.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanarNoise {
    /// Of the heading, growing with the root of time, radians per square root of a second.
    #[serde(deserialize_with = "not_negative")]
    pub yaw_rad_per_root_s: f64,
    /// Of the heading, growing with the root of the angle turned, radians per square root of a radian.
    #[serde(deserialize_with = "not_negative")]
    pub yaw_rad_per_root_rad: f64,
    /// Of the way, growing with the root of time, metres per square root of a second.
    #[serde(deserialize_with = "not_negative")]
    pub along_m_per_root_s: f64,
    /// Across the way, likewise.
    #[serde(deserialize_with = "not_negative")]
    pub across_m_per_root_s: f64,
    /// Of a range, the part that is the same at every range, metres.
    #[serde(deserialize_with = "not_negative")]
    pub range_m: f64,
    /// Of a range, the part that grows with it, metres per metre; the two add up in variance.
    #[serde(deserialize_with = "not_negative")]
    pub range_share: f64,
    /// Of a bearing, radians.
    #[serde(deserialize_with = "not_negative")]
    pub bearing_rad: f64,
}

impl Default for Calibration {
    /// Everything as recorded.
    fn default() -> Self {
        Self {
            turn_scale: 1.0,
            turn_bias_radps: 0.0,
            speed_scale_straight: 1.0,
            speed_scale_turning: 1.0,
            turning_above_radps: 0.0,
            command_lag_s: 0.0,
            camera_lag_s: 0.0,
            range_bias_m: 0.0,
            noise: PlanarNoise::default(),
        }
    }
}

impl Default for PlanarNoise {
    fn default() -> Self {
        Self {
            yaw_rad_per_root_s: 0.02,
            yaw_rad_per_root_rad: 0.1,
            along_m_per_root_s: 0.02,
            across_m_per_root_s: 0.01,
            range_m: 0.2,
            range_share: 0.0,
            bearing_rad: 0.02,
        }
    }
}

/// A planar odometry increment over an interval, with its noise in the frame of its earlier pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarIncrement {
    /// Its beginning, nanoseconds since 1970.
    pub from_ns: i64,
    /// Its end.
    pub to_ns: i64,
    /// `earlier_from_later` of the body: forward and left in metres, and the turn; z, roll and pitch are 0.
    pub earlier_from_later: Pose,
    /// The turn with its full turns, radians.
    pub yaw_rad: f64,
    /// Standard deviation of the turn, radians.
    pub yaw_std_rad: f64,
    /// Standard deviation along the way, metres.
    pub along_std_m: f64,
    /// Standard deviation across the way, metres.
    pub across_std_m: f64,
}

/// A robot's reading of another robot, or of a landmark, calibrated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibratedReading {
    /// When the image was taken, nanoseconds since 1970.
    pub time_ns: i64,
    /// Whom it shows.
    pub subject: Subject,
    /// The range, metres, not negative.
    pub range_m: f64,
    /// Its standard deviation, metres.
    pub range_std_m: f64,
    /// The bearing in the body frame, radians counter-clockwise from the heading.
    pub bearing_rad: f64,
    /// Its standard deviation, radians.
    pub bearing_std_rad: f64,
}

/// Which readings are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Readings {
    /// Of robots only.
    #[default]
    OfRobots,
    /// Of landmarks as well.
    OfRobotsAndLandmarks,
}

impl Calibration {
    /// Reads a calibration from TOML text. Fails with the place and the key.
    pub fn parse(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text)
    }

    /// A robot's motion from one time to another (nanoseconds since 1970, `from_ns <= to_ns`), by its commands in the
    /// order of time. A command holds until the next; before the first the robot stands.
    #[must_use]
    pub fn increment(&self, commands: &[Command], from_ns: i64, to_ns: i64) -> PlanarIncrement {
        assert!(from_ns <= to_ns, "an increment goes forward in time");
        let lag_ns = nanoseconds(self.command_lag_s);
        let mut pose = Pose::identity();
        let (mut yaw_rad, mut turned_rad) = (0.0, 0.0);
        let mut time_ns = from_ns;
        // The command that is in effect at `from_ns` is the last one before or at it.
        let mut next = commands.partition_point(|command| command.time_ns + lag_ns <= from_ns);
        while time_ns < to_ns {
            let until_ns = commands
                .get(next)
                .map_or(to_ns, |command| (command.time_ns + lag_ns).min(to_ns));
            let elapsed_s = (until_ns - time_ns) as f64 * 1e-9;
            if let Some(current) = next.checked_sub(1).map(|index| &commands[index]) {
                let (speed_mps, turn_radps) = self.velocity(current);
                pose *= arc(speed_mps * elapsed_s, turn_radps * elapsed_s);
                yaw_rad += turn_radps * elapsed_s;
                turned_rad += (turn_radps * elapsed_s).abs();
            }
            time_ns = until_ns;
            next += 1;
        }
        let elapsed_s = (to_ns - from_ns) as f64 * 1e-9;
        let noise = &self.noise;
        let yaw_variance = noise.yaw_rad_per_root_s.powi(2) * elapsed_s
            + noise.yaw_rad_per_root_rad.powi(2) * turned_rad;
        PlanarIncrement {
            from_ns,
            to_ns,
            earlier_from_later: pose,
            yaw_rad,
            yaw_std_rad: yaw_variance.sqrt(),
            along_std_m: noise.along_m_per_root_s * elapsed_s.sqrt(),
            across_std_m: noise.across_m_per_root_s * elapsed_s.sqrt(),
        }
    }

    /// True forward speed and turn rate under a command.
    fn velocity(&self, command: &Command) -> (f64, f64) {
        let turning = command.turn_radps.abs() > self.turning_above_radps;
        let scale = if turning {
            self.speed_scale_turning
        } else {
            self.speed_scale_straight
        };
        // A robot that is told to stand does not creep round.
        let moves = command.forward_mps.abs() + command.turn_radps.abs() > 0.0;
        let bias_radps = if moves { self.turn_bias_radps } else { 0.0 };
        (
            scale * command.forward_mps,
            self.turn_scale * command.turn_radps + bias_radps,
        )
    }

    /// The robot's readings in the order of time.
    pub fn readings(
        &self,
        robot: &RobotRecord,
        wanted: Readings,
    ) -> impl Iterator<Item = CalibratedReading> {
        let is_wanted = move |reading: &&RangeBearing| {
            wanted == Readings::OfRobotsAndLandmarks || matches!(reading.subject, Subject::Robot(_))
        };
        robot
            .readings
            .iter()
            .filter(is_wanted)
            .map(|reading| self.reading(reading))
    }

    /// One reading, calibrated.
    #[must_use]
    pub fn reading(&self, reading: &RangeBearing) -> CalibratedReading {
        let range_m = (reading.range_m - self.range_bias_m).max(0.0);
        CalibratedReading {
            time_ns: reading.time_ns - nanoseconds(self.camera_lag_s),
            subject: reading.subject,
            range_m,
            range_std_m: self.noise.range_m.hypot(self.noise.range_share * range_m),
            bearing_rad: reading.bearing_rad,
            bearing_std_rad: self.noise.bearing_rad,
        }
    }

    /// Dead reckoning by commands alone, from a pose at a time, at later times in their order (nanoseconds since 1970).
    #[must_use]
    pub fn dead_reckoning(
        &self,
        commands: &[Command],
        start: &Pose,
        start_ns: i64,
        times_ns: impl IntoIterator<Item = i64>,
    ) -> Vec<Pose> {
        let mut world_from_body = *start;
        let mut from_ns = start_ns;
        times_ns
            .into_iter()
            .map(|to_ns| {
                world_from_body *= self.increment(commands, from_ns, to_ns).earlier_from_later;
                from_ns = to_ns;
                world_from_body
            })
            .collect()
    }
}

/// The motion along an arc of this length that turns by this angle, exactly.
fn arc(length_m: f64, turn_rad: f64) -> Pose {
    // sin(a)/a and (1 - cos(a))/a, by their series where the quotients lose their digits.
    let (ahead, aside) = if turn_rad.abs() < 1e-4 {
        (1.0 - turn_rad.powi(2) / 6.0, turn_rad / 2.0)
    } else {
        (turn_rad.sin() / turn_rad, (1.0 - turn_rad.cos()) / turn_rad)
    };
    pose_from_euler(
        Vector3::new(length_m * ahead, length_m * aside, 0.0),
        turn_rad,
        0.0,
        0.0,
    )
}

fn nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

#[cfg(test)]
mod tests;
