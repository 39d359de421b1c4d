//! An absolute fix on the wire, reduced to the body of the vehicle that took it, at its round.
//!
//! As with what is measured of a neighbour, that vehicle folds its mount and its own motion since the reading in before
//! sending: a pose or orientation comes out as that of its body, a position as the point of the body that is there.

use crate::{check, codec::DecodeError};
use serde::{Deserialize, Serialize};

/// One fix of the vehicle that sends it, at the instant of its round. Tags are the order below, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Fixed {
    /// The whole pose.
    Pose {
        /// Rotation vector (rad), then translation (m).
        world_from_body: [f64; 6],
        /// Standard deviation of the rotation per axis (rad).
        rotation_sigma_rad: f32,
        /// Standard deviation of the translation per axis (m).
        translation_sigma_m: f32,
    },
    /// Where one point of the body is. A surveyed landmark is one whose point is where the sensor saw it.
    Position {
        /// In the world (m).
        position_m: [f64; 3],
        /// The point that is there, in the body frame at the round's instant (m).
        point_m: [f64; 3],
        /// Standard deviation per axis (m).
        sigma_m: f32,
    },
    /// How the body is turned.
    Orientation {
        /// Rotation vector of `world_from_body` (rad).
        rotation_vector_rad: [f64; 3],
        /// Standard deviation per axis (rad).
        sigma_rad: f32,
    },
}

impl Fixed {
    /// Refuses numbers that are not finite or outside their range.
    pub fn check(&self) -> Result<(), DecodeError> {
        match self {
            Self::Pose {
                world_from_body,
                rotation_sigma_rad,
                translation_sigma_m,
            } => {
                check::pose("fixed pose", world_from_body)?;
                check::sigma("fixed pose: rotation sigma", f64::from(*rotation_sigma_rad))?;
                check::sigma(
                    "fixed pose: translation sigma",
                    f64::from(*translation_sigma_m),
                )
            }
            Self::Position {
                position_m,
                point_m,
                sigma_m,
            } => {
                check::position("fixed position", position_m)?;
                check::position("fixed position: point", point_m)?;
                check::sigma("fixed position: sigma", f64::from(*sigma_m))
            }
            Self::Orientation {
                rotation_vector_rad,
                sigma_rad,
            } => {
                check::rotation_vector("fixed orientation", rotation_vector_rad)?;
                check::sigma("fixed orientation: sigma", f64::from(*sigma_rad))
            }
        }
    }
}
