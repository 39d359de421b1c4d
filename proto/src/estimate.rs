//! The newest estimate of one vehicle in bytes; its JSON form is [`crate::document::EstimateDocument`].

use crate::check;
use crate::codec::{Body, DecodeError};
use crate::limits::{
    ESTIMATE_BYTES_MAX, NEIGHBOURS_MAX, RATE_MAX_RAD_S, ROTATION_VECTOR_MAX_RAD, SPEED_MAX_M_S,
};
use serde::{Deserialize, Serialize};

/// The greatest code of [`Estimate::permit`].
const PERMIT_MAX: u8 = 2;

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
    /// Where they are by anonymous bearings. Since version 1.2.
    pub mutual: Vec<MutualEstimate>,
    /// Where they are by distances alone. Since version 1.2.
    pub ranging: Vec<RangingEstimate>,
    /// Whether the motion schedule lets the vehicle move: 0 it takes no part, 1 stay, 2 move. Since version 1.2.
    pub permit: u8,
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

/// One neighbour as mutual localisation sees it, in this vehicle's level frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MutualEstimate {
    /// Hash of its name.
    #[serde(with = "crate::le")]
    pub vehicle: u64,
    /// At how many places it may be: 0 unknown, 1 converged, more ambiguous.
    pub modes: u8,
    /// When it was there, in microseconds after the envelope's time (negative: before).
    #[serde(with = "crate::le")]
    pub taken_offset_us: i32,
    /// Probability that the feature that is held to be it is it.
    pub identity_probability: f32,
    /// Position (m), velocity (m/s), yaw (rad).
    pub reduced: Option<[f64; 7]>,
    /// Upper triangle of the covariance of that, row by row.
    pub covariance: Option<MutualCovariance>,
}

/// Covariance of a reduced relative pose, named by its tangent. The tag leaves room for others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum MutualCovariance {
    /// Position (m), velocity (m/s), yaw (rad) in the level frame: upper triangle of the 7 x 7 matrix, row by row, in two
    /// parts.
    PositionVelocityYaw([f64; 14], [f64; 14]),
}

/// One neighbour as range-only localisation sees it, in this vehicle's level frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RangingEstimate {
    /// Hash of its name.
    #[serde(with = "crate::le")]
    pub vehicle: u64,
    /// At how many places it may be: 0 unknown, or with a place imprecise; 1 converged, more ambiguous.
    pub modes: u8,
    /// When it was there, in microseconds after the envelope's time (negative: before).
    #[serde(with = "crate::le")]
    pub taken_offset_us: i32,
    /// Position (m), yaw (rad).
    pub reduced: Option<[f64; 4]>,
    /// Upper triangle of the covariance of that, row by row.
    pub covariance: Option<RangingCovariance>,
}

/// Covariance of a reduced relative pose without velocity, named by its tangent. The tag leaves room for others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum RangingCovariance {
    /// Position (m), yaw (rad) in the level frame: upper triangle of the 4 x 4 matrix, row by row.
    PositionYaw([f64; 10]),
}

impl Body for Estimate {
    const BYTES_MAX: usize = ESTIMATE_BYTES_MAX;
    fn appended_since(minor: u8) -> usize {
        // What anonymous bearings say, what distances say, and the permit.
        if minor < 2 { 3 } else { 0 }
    }
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
        check::at_most("mutual", &self.mutual, NEIGHBOURS_MAX)?;
        self.mutual.iter().try_for_each(MutualEstimate::check)?;
        check::at_most("ranging", &self.ranging, NEIGHBOURS_MAX)?;
        self.ranging.iter().try_for_each(RangingEstimate::check)?;
        if self.permit > PERMIT_MAX {
            return Err(DecodeError::OutOfRange { field: "permit" });
        }
        Ok(())
    }
}

impl RangingEstimate {
    fn check(&self) -> Result<(), DecodeError> {
        if let Some([x, y, z, yaw_rad]) = self.reduced {
            check::position("ranging position", &[x, y, z])?;
            check::within("ranging yaw", &[yaw_rad], ROTATION_VECTOR_MAX_RAD)?;
        }
        if let Some(RangingCovariance::PositionYaw(numbers)) = &self.covariance {
            check::finite("ranging covariance", numbers)?;
        }
        Ok(())
    }
}

impl MutualEstimate {
    fn check(&self) -> Result<(), DecodeError> {
        check::within(
            "identity_probability",
            &[self.identity_probability.into()],
            1.0,
        )?;
        if let Some([x, y, z, vx, vy, vz, yaw_rad]) = self.reduced {
            check::position("mutual position", &[x, y, z])?;
            check::within("mutual velocity", &[vx, vy, vz], SPEED_MAX_M_S)?;
            check::within("mutual yaw", &[yaw_rad], ROTATION_VECTOR_MAX_RAD)?;
        }
        if let Some(MutualCovariance::PositionVelocityYaw(first, second)) = &self.covariance {
            check::finite("mutual covariance", first)?;
            check::finite("mutual covariance", second)?;
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
