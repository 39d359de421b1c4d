//! What drivers say: one frame of one sensor. Any program in any language can be the driver.
//!
//! A frame comes in one of two forms, told apart by its first byte: JSON (`{`), or the version byte 1 followed by the
//! postcard form. Times are nanoseconds of UNIX time at the moment the reading was *taken*.

use crate::codec::DecodeError;
use crate::limits::{
    ACCELERATION_MAX_M_S2, FEATURES_PER_FRAME_MAX, FRAME_BYTES_MAX, RATE_MAX_RAD_S, SPEED_MAX_M_S,
};
use crate::{VERSION_MAJOR, check, name::Name};
use serde::{Deserialize, Serialize};

/// One reading of one sensor. Binary tags are the order below, from 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Frame {
    /// How the vehicle moved between two instants.
    Odometry(OdometryFrame),
    /// What the vehicle measured of an identified team-mate.
    Relative(RelativeFrame),
    /// Where the vehicle is, from outside (GNSS, motion capture, a surveyed tag).
    Fix(FixFrame),
    /// Distances to identified team-mates.
    Ranges(RangesFrame),
    /// Directions to robots that cannot be told apart.
    Bearings(BearingsFrame),
    /// One inertial sample.
    Imu(ImuFrame),
}

/// An odometry increment. Increments of one sensor follow each other: `since_ns` is the `taken_ns` before.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OdometryFrame {
    /// Start of the motion.
    #[serde(with = "crate::le")]
    pub since_ns: i64,
    /// End of the motion.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// `sensor@since_from_sensor@taken`: rotation vector (rad), then translation (m).
    pub motion: [f64; 6],
    /// Standard deviation of the rotation per axis over the whole increment (rad).
    pub rotation_sigma_rad: f64,
    /// Standard deviation of the translation per axis over the whole increment (m).
    pub translation_sigma_m: f64,
}

/// A relative measurement, as the sensor saw it, in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RelativeFrame {
    /// When the reading was taken.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// Whom it is of.
    pub target: Name,
    /// What was measured.
    pub value: RelativeValue,
}

/// The five kinds, in the sensor's frame. Binary tags are the order below, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum RelativeValue {
    /// Relative pose.
    Pose {
        /// Rotation vector (rad), then translation (m).
        sensor_from_target: [f64; 6],
        /// Standard deviation of the rotation per axis (rad).
        rotation_sigma_rad: f64,
        /// Standard deviation of the translation per axis (m).
        translation_sigma_m: f64,
    },
    /// Relative orientation.
    Orientation {
        /// Rotation vector of `sensor_from_target` (rad).
        rotation_vector_rad: [f64; 3],
        /// Standard deviation per axis (rad).
        sigma_rad: f64,
    },
    /// Relative position.
    Position {
        /// The target's position in the sensor's frame (m).
        position_m: [f64; 3],
        /// Standard deviation per axis (m).
        sigma_m: f64,
    },
    /// Direction to the target.
    Bearing {
        /// Unit vector in the sensor's frame.
        direction: [f64; 3],
        /// Standard deviation across the direction, per axis (rad).
        sigma_rad: f64,
    },
    /// Distance to the target.
    Distance {
        /// Distance (m).
        distance_m: f64,
        /// Standard deviation (m).
        sigma_m: f64,
    },
}

/// An absolute fix in the common world frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixFrame {
    /// When it was taken.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// What is known.
    pub value: FixValue,
}

/// What an absolute fix tells. Binary tags are the order below, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FixValue {
    /// The sensor's pose.
    Pose {
        /// Rotation vector (rad), then translation (m).
        world_from_sensor: [f64; 6],
        /// Standard deviation of the rotation per axis (rad).
        rotation_sigma_rad: f64,
        /// Standard deviation of the translation per axis (m).
        translation_sigma_m: f64,
    },
    /// The sensor's position.
    Position {
        /// East, north, up (m).
        position_m: [f64; 3],
        /// Standard deviation per axis (m).
        sigma_m: f64,
    },
    /// The sensor's orientation.
    Orientation {
        /// Rotation vector of `world_from_sensor` (rad).
        rotation_vector_rad: [f64; 3],
        /// Standard deviation per axis (rad).
        sigma_rad: f64,
    },
    /// Where the sensor sees a point whose place is known: a surveyed tag, a beacon.
    Landmark {
        /// The landmark in the world: east, north, up (m).
        landmark_m: [f64; 3],
        /// The landmark in the sensor's frame (m).
        position_m: [f64; 3],
        /// Standard deviation per axis (m).
        sigma_m: f64,
    },
}

/// Distances to identified team-mates, read at one instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangesFrame {
    /// When they were taken.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// At most 32.
    pub ranges: Vec<TargetRange>,
}

/// The distance to one team-mate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetRange {
    /// Whom it is of.
    pub target: Name,
    /// Distance (m).
    pub distance_m: f64,
    /// Standard deviation (m).
    pub sigma_m: f64,
}

/// Directions to robots that cannot be told apart, from one image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BearingsFrame {
    /// When the image was taken.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// Standard deviation across each direction, per axis (rad).
    pub sigma_rad: f64,
    /// Unit vectors in the sensor's frame, at most 32.
    pub directions: Vec<[f64; 3]>,
}

/// One inertial sample, in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuFrame {
    /// When it was taken.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// Angular rate (rad/s).
    pub angular_rate_rad_s: [f64; 3],
    /// Specific force (m/s^2): at rest it points up.
    pub specific_force_m_s2: [f64; 3],
    /// Standard deviation of the rate per axis (rad/s).
    pub rate_sigma_rad_s: f64,
    /// Standard deviation of the force per axis (m/s^2).
    pub force_sigma_m_s2: f64,
}

impl Frame {
    /// Decodes a frame in either form. Fails with the reason; never panics.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        if bytes.len() > FRAME_BYTES_MAX {
            return Err(DecodeError::TooLong {
                bytes: bytes.len(),
                max: FRAME_BYTES_MAX,
            });
        }
        let frame = match bytes.split_first() {
            None => {
                return Err(DecodeError::Truncated {
                    bytes: 0,
                    needed: 1,
                });
            }
            Some((b'{', _)) => serde_json::from_slice(bytes).map_err(|_| DecodeError::Malformed)?,
            Some((&VERSION_MAJOR, body)) => {
                let (frame, rest) =
                    postcard::take_from_bytes(body).map_err(|_| DecodeError::Malformed)?;
                if !rest.is_empty() {
                    return Err(DecodeError::Trailing { bytes: rest.len() });
                }
                frame
            }
            Some((&major, _)) => return Err(DecodeError::Version { major, minor: 0 }),
        };
        Self::check(&frame)?;
        Ok(frame)
    }

    /// The binary form.
    pub fn encode(&self) -> Vec<u8> {
        postcard::to_extend(self, vec![VERSION_MAJOR]).expect("a vector takes any frame")
    }

    /// When the reading was taken, in nanoseconds.
    pub fn taken_ns(&self) -> i64 {
        match self {
            Self::Odometry(frame) => frame.taken_ns,
            Self::Relative(frame) => frame.taken_ns,
            Self::Fix(frame) => frame.taken_ns,
            Self::Ranges(frame) => frame.taken_ns,
            Self::Bearings(frame) => frame.taken_ns,
            Self::Imu(frame) => frame.taken_ns,
        }
    }

    /// Refuses numbers that are not finite or outside their range. [`Frame::decode`] has done so already; a driver
    /// inside the process is checked at the same place.
    pub fn check(&self) -> Result<(), DecodeError> {
        match self {
            Self::Odometry(frame) => frame.check(),
            Self::Relative(frame) => frame.value.check(),
            Self::Fix(frame) => frame.value.check(),
            Self::Ranges(frame) => frame.check(),
            Self::Bearings(frame) => frame.check(),
            Self::Imu(frame) => frame.check(),
        }
    }
}

impl OdometryFrame {
    fn check(&self) -> Result<(), DecodeError> {
        if self.since_ns >= self.taken_ns {
            return Err(DecodeError::OutOfRange { field: "since_ns" });
        }
        check::pose("motion", &self.motion)?;
        // A step that no vehicle makes in its time would be taken for a speed.
        let seconds = (self.taken_ns.saturating_sub(self.since_ns)) as f64 * 1e-9;
        let [rx, ry, rz, x, y, z] = self.motion;
        let turned = [rx, ry, rz].map(|turn| turn / seconds);
        let moved = [x, y, z].map(|step| step / seconds);
        check::within("motion: angular rate", &turned, RATE_MAX_RAD_S)?;
        check::within("motion: speed", &moved, SPEED_MAX_M_S)?;
        check::sigma("rotation_sigma_rad", self.rotation_sigma_rad)?;
        check::sigma("translation_sigma_m", self.translation_sigma_m)
    }
}

impl RelativeValue {
    fn check(&self) -> Result<(), DecodeError> {
        match self {
            Self::Pose {
                sensor_from_target,
                rotation_sigma_rad,
                translation_sigma_m,
            } => {
                check::pose("sensor_from_target", sensor_from_target)?;
                check::sigma("rotation_sigma_rad", *rotation_sigma_rad)?;
                check::sigma("translation_sigma_m", *translation_sigma_m)
            }
            Self::Orientation {
                rotation_vector_rad,
                sigma_rad,
            } => {
                check::rotation_vector("rotation_vector_rad", rotation_vector_rad)?;
                check::sigma("sigma_rad", *sigma_rad)
            }
            Self::Position {
                position_m,
                sigma_m,
            } => {
                check::position("position_m", position_m)?;
                check::sigma("sigma_m", *sigma_m)
            }
            Self::Bearing {
                direction,
                sigma_rad,
            } => {
                check::unit("direction", direction)?;
                check::sigma("sigma_rad", *sigma_rad)
            }
            Self::Distance {
                distance_m,
                sigma_m,
            } => {
                check::distance("distance_m", *distance_m)?;
                check::sigma("sigma_m", *sigma_m)
            }
        }
    }
}

impl FixValue {
    fn check(&self) -> Result<(), DecodeError> {
        match self {
            Self::Pose {
                world_from_sensor,
                rotation_sigma_rad,
                translation_sigma_m,
            } => {
                check::pose("world_from_sensor", world_from_sensor)?;
                check::sigma("rotation_sigma_rad", *rotation_sigma_rad)?;
                check::sigma("translation_sigma_m", *translation_sigma_m)
            }
            Self::Position {
                position_m,
                sigma_m,
            } => {
                check::position("position_m", position_m)?;
                check::sigma("sigma_m", *sigma_m)
            }
            Self::Orientation {
                rotation_vector_rad,
                sigma_rad,
            } => {
                check::rotation_vector("rotation_vector_rad", rotation_vector_rad)?;
                check::sigma("sigma_rad", *sigma_rad)
            }
            Self::Landmark {
                landmark_m,
                position_m,
                sigma_m,
            } => {
                check::position("landmark_m", landmark_m)?;
                check::position("position_m", position_m)?;
                check::sigma("sigma_m", *sigma_m)
            }
        }
    }
}

impl RangesFrame {
    fn check(&self) -> Result<(), DecodeError> {
        check::at_most("ranges", &self.ranges, FEATURES_PER_FRAME_MAX)?;
        for range in &self.ranges {
            check::distance("distance_m", range.distance_m)?;
            check::sigma("sigma_m", range.sigma_m)?;
        }
        Ok(())
    }
}

impl BearingsFrame {
    fn check(&self) -> Result<(), DecodeError> {
        check::at_most("directions", &self.directions, FEATURES_PER_FRAME_MAX)?;
        check::sigma("sigma_rad", self.sigma_rad)?;
        self.directions
            .iter()
            .try_for_each(|direction| check::unit("directions", direction))
    }
}

impl ImuFrame {
    fn check(&self) -> Result<(), DecodeError> {
        check::within(
            "angular_rate_rad_s",
            &self.angular_rate_rad_s,
            RATE_MAX_RAD_S,
        )?;
        check::within(
            "specific_force_m_s2",
            &self.specific_force_m_s2,
            ACCELERATION_MAX_M_S2,
        )?;
        check::sigma("rate_sigma_rad_s", self.rate_sigma_rad_s)?;
        check::sigma("force_sigma_m_s2", self.force_sigma_m_s2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bearing() -> Frame {
        Frame::Relative(RelativeFrame {
            taken_ns: 1_000_000_000,
            target: Name::parse("v2").unwrap(),
            value: RelativeValue::Bearing {
                direction: [0.6, 0.8, 0.0],
                sigma_rad: 0.02,
            },
        })
    }

    #[test]
    fn a_driver_may_write_json() {
        let text = r#"{"relative":{"taken_ns":1000000000,"target":"v2","value":{"bearing":{"direction":[0.6,0.8,0.0],"sigma_rad":0.02}}}}"#;
        assert_eq!(Frame::decode(text.as_bytes()).unwrap(), bearing());
        assert_eq!(serde_json::to_string(&bearing()).unwrap(), text);
    }

    #[test]
    fn a_driver_may_write_bytes() {
        assert_eq!(Frame::decode(&bearing().encode()).unwrap(), bearing());
    }

    #[test]
    fn a_direction_that_is_no_unit_vector_is_refused_by_name() {
        let text = r#"{"relative":{"taken_ns":1,"target":"v2","value":{"bearing":{"direction":[1.0,1.0,0.0],"sigma_rad":0.02}}}}"#;
        assert_eq!(
            Frame::decode(text.as_bytes()),
            Err(DecodeError::OutOfRange { field: "direction" })
        );
    }

    #[test]
    fn odometry_must_go_forward_in_time() {
        let frame = OdometryFrame {
            since_ns: 5,
            taken_ns: 5,
            motion: [0.0; 6],
            rotation_sigma_rad: 0.1,
            translation_sigma_m: 0.1,
        };
        assert_eq!(
            Frame::decode(&Frame::Odometry(frame).encode()),
            Err(DecodeError::OutOfRange { field: "since_ns" })
        );
    }

    #[test]
    fn the_list_bound_holds_at_its_limit_and_one_past_it() {
        let with = |n| {
            Frame::Bearings(BearingsFrame {
                taken_ns: 1,
                sigma_rad: 0.1,
                directions: vec![[1.0, 0.0, 0.0]; n],
            })
        };
        assert!(Frame::decode(&with(FEATURES_PER_FRAME_MAX).encode()).is_ok());
        assert!(matches!(
            Frame::decode(&with(FEATURES_PER_FRAME_MAX + 1).encode()),
            Err(DecodeError::TooMany { .. })
        ));
    }
}
