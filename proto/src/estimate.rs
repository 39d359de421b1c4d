//! The newest estimate of one vehicle in bytes; its JSON form is [`crate::document::EstimateDocument`].

use crate::check;
use crate::codec::{Body, DecodeError};
use crate::limits::{ESTIMATE_BYTES_MAX, NEIGHBOURS_MAX, RATE_MAX_RAD_S, SPEED_MAX_M_S};
use serde::{Deserialize, Serialize};

/// Body of a reply on `state/estimate` to a query that asks for `encoding=postcard`. The envelope's time is when the
/// vehicle was where the estimate says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Code of the [`crate::status::Status`].
    pub status: u8,
    /// `world_from_body`: rotation vector (rad), then translation (m).
    pub world_from_body: Option<[f64; 6]>,
    /// How it moves.
    pub velocity: Option<Velocity>,
    /// Covariance of the pose, when an estimator supplies one that was tested.
    pub covariance: Option<Covariance>,
    /// Where the neighbours are.
    pub neighbours: Vec<NeighbourEstimate>,
}

/// Velocity over the last odometry increment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Velocity {
    /// Of the body's origin, in world axes (m/s).
    pub linear_world_m_s: [f64; 3],
    /// Of the body, in body axes (rad/s).
    pub angular_body_rad_s: [f64; 3],
}

/// Covariance of a pose, named by its tangent. The tag leaves room for others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Covariance {
    /// Body twist, rotation (rad) then translation (m): upper triangle of the 6 x 6 matrix, row by row.
    BodyTwistRotationFirst([f64; 21]),
}

/// One neighbour as seen from this vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NeighbourEstimate {
    /// Hash of its name.
    #[serde(with = "crate::le")]
    pub vehicle: u64,
    /// Code of the [`crate::status::Status`] that it reports of itself.
    pub status: u8,
    /// When it was there, in microseconds after the envelope's time (negative: before).
    #[serde(with = "crate::le")]
    pub taken_offset_us: i32,
    /// `body_from_neighbour`: rotation vector (rad), then translation (m).
    pub body_from_neighbour: Option<[f64; 6]>,
    /// Covariance of that relative pose, when an estimator supplies one that was tested.
    pub covariance: Option<Covariance>,
}

impl Body for Estimate {
    const BYTES_MAX: usize = ESTIMATE_BYTES_MAX;
    fn check(&self) -> Result<(), DecodeError> {
        if let Some(pose) = &self.world_from_body {
            check::pose("estimate", pose)?;
        }
        if let Some(velocity) = &self.velocity {
            check::within("linear velocity", &velocity.linear_world_m_s, SPEED_MAX_M_S)?;
            check::within(
                "angular velocity",
                &velocity.angular_body_rad_s,
                RATE_MAX_RAD_S,
            )?;
        }
        self.covariance.iter().try_for_each(Covariance::check)?;
        check::at_most("neighbours", &self.neighbours, NEIGHBOURS_MAX)?;
        for neighbour in &self.neighbours {
            if let Some(pose) = &neighbour.body_from_neighbour {
                check::pose("neighbour", pose)?;
            }
            neighbour
                .covariance
                .iter()
                .try_for_each(Covariance::check)?;
        }
        Ok(())
    }
}

impl Covariance {
    fn check(&self) -> Result<(), DecodeError> {
        let Self::BodyTwistRotationFirst(numbers) = self;
        check::finite("covariance", numbers)
    }
}
