//! Where a team-mate is, as seen from this vehicle, and how sure that is.

use crate::vehicle_id::VehicleId;
use nalgebra::{SMatrix, UnitQuaternion, Vector3};

/// The reduced relative pose with its velocity (Cognetti et al., eq. 7, 8 and 18), in this vehicle's level frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reduced {
    /// Where the neighbour is (m).
    pub position_m: Vector3<f64>,
    /// How it moves relative to this vehicle, as an observer that does not turn sees it (m/s).
    pub velocity_m_s: Vector3<f64>,
    /// Its heading relative to this vehicle's (rad), counter-clockwise.
    pub yaw_rad: f64,
}

/// How far a neighbour's place is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Nothing is known.
    Unknown,
    /// It is at one of several places.
    Ambiguous {
        /// How many, as far as they were told apart.
        modes: usize,
    },
    /// It is at one place.
    Converged,
}

/// One team-mate.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// Who.
    pub vehicle: VehicleId,
    /// How far its place is known.
    pub status: Status,
    /// The likeliest place; none while [`Status::Unknown`].
    pub relative: Option<Reduced>,
    /// Covariance of that: position, velocity, yaw (m, m/s, rad); none from an estimator that has none that is tested.
    pub covariance: Option<SMatrix<f64, 7, 7>>,
    /// Probability that the feature held to be this neighbour is it; zero when none is.
    pub identity_probability: f64,
}

impl Reduced {
    /// The full relative pose `body_from_neighbour` (paper, after eq. 8, corrected): rotation and translation (m), from
    /// the two attitudes (`level_from_body` of each).
    #[must_use]
    pub fn in_body(
        &self,
        own: &UnitQuaternion<f64>,
        neighbour: &UnitQuaternion<f64>,
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let level_from_level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw_rad);
        (
            own.inverse() * level_from_level * neighbour,
            own.inverse() * self.position_m,
        )
    }
}
