//! A relative measurement on the wire, reduced to the measuring vehicle's body at its round.
//!
//! The measuring vehicle alone knows its mount and its own motion between the reading and the round, so it folds both
//! in before sending: rotations and positions come out in its body frame, a bearing or distance carries the point it
//! was taken from. So every kind stays within six numbers, and nobody needs to know anybody's mounts.

use crate::{check, codec::DecodeError};
use serde::{Deserialize, Serialize};

/// One measurement of a neighbour, by the vehicle that sends it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// When the reading was taken, in microseconds after the round's instant (negative: before), sender's clock.
    #[serde(with = "crate::le")]
    pub taken_offset_us: i32,
    /// What was measured, in the sender's body frame *at the round's instant*.
    pub value: MeasuredValue,
}

/// The five kinds of Knuth & Barooah, each with its standard deviation per axis. Tags are the order below, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum MeasuredValue {
    /// Relative pose: `body_from_neighbour`.
    Pose {
        /// Rotation vector (rad), then translation (m).
        body_from_neighbour: [f64; 6],
        /// Standard deviation of the rotation per axis (rad).
        rotation_sigma_rad: f32,
        /// Standard deviation of the translation per axis (m).
        translation_sigma_m: f32,
    },
    /// Relative orientation.
    Orientation {
        /// Rotation vector of `body_from_neighbour` (rad).
        rotation_vector_rad: [f64; 3],
        /// Standard deviation per axis (rad).
        sigma_rad: f32,
    },
    /// Relative position.
    Position {
        /// The neighbour's position in the sender's body frame (m).
        position_m: [f64; 3],
        /// Standard deviation per axis (m).
        sigma_m: f32,
    },
    /// Bearing: the direction from the sensor to the neighbour.
    Bearing {
        /// Unit vector in the sender's body frame.
        direction: [f64; 3],
        /// Where the sensor was, in the sender's body frame (m).
        origin_m: [f64; 3],
        /// Standard deviation across the direction, per axis (rad).
        sigma_rad: f32,
    },
    /// Distance from the sensor to the neighbour.
    Distance {
        /// Distance (m).
        distance_m: f64,
        /// Where the sensor was, in the sender's body frame (m).
        origin_m: [f64; 3],
        /// Standard deviation (m).
        sigma_m: f32,
    },
}

impl Measured {
    /// Refuses numbers that are not finite or outside their range.
    pub fn check(&self) -> Result<(), DecodeError> {
        match &self.value {
            MeasuredValue::Pose {
                body_from_neighbour,
                rotation_sigma_rad,
                translation_sigma_m,
            } => {
                check::pose("measured pose", body_from_neighbour)?;
                check::sigma(
                    "measured pose: rotation sigma",
                    f64::from(*rotation_sigma_rad),
                )?;
                check::sigma(
                    "measured pose: translation sigma",
                    f64::from(*translation_sigma_m),
                )
            }
            MeasuredValue::Orientation {
                rotation_vector_rad,
                sigma_rad,
            } => {
                check::rotation_vector("measured orientation", rotation_vector_rad)?;
                check::sigma("measured orientation: sigma", f64::from(*sigma_rad))
            }
            MeasuredValue::Position {
                position_m,
                sigma_m,
            } => {
                check::position("measured position", position_m)?;
                check::sigma("measured position: sigma", f64::from(*sigma_m))
            }
            MeasuredValue::Bearing {
                direction,
                origin_m,
                sigma_rad,
            } => {
                check::unit("measured bearing", direction)?;
                check::position("measured bearing: origin", origin_m)?;
                check::sigma("measured bearing: sigma", f64::from(*sigma_rad))
            }
            MeasuredValue::Distance {
                distance_m,
                origin_m,
                sigma_m,
            } => {
                check::distance("measured distance", *distance_m)?;
                check::position("measured distance: origin", origin_m)?;
                check::sigma("measured distance: sigma", f64::from(*sigma_m))
            }
        }
    }
}
