//! A neighbour that distances located, and what it tells of either vehicle's pose in the common frame.

use nalgebra::{Matrix3, Matrix4, SMatrix, Vector3};
use skein_estimation::{Body, Transform, World};
use skein_proto::limits::SIGMA_MAX;

use crate::told_pose::ToldPose;

/// How well a located neighbour is taken to know where it is: nobody says it of the pose that an exchange carries.
const NEIGHBOUR_ROTATION_SIGMA_RAD: f64 = 0.02;
/// See [`NEIGHBOUR_ROTATION_SIGMA_RAD`].
const NEIGHBOUR_TRANSLATION_SIGMA_M: f64 = 0.1;

/// A neighbour that was located, at some moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub(crate) body_from_neighbour: Transform<Body, Body>,
    /// Covariance of its position and yaw in this vehicle's level frame (m, rad).
    pub(crate) covariance: Matrix4<f64>,
}

impl Found {
    /// Where this vehicle is, by where the neighbour is, and how sure that is: the neighbour's own error and that of the
    /// pair, which turns about the neighbour.
    pub(crate) fn own_pose(&self, world_from_neighbour: &Transform<World, Body>) -> ToldPose {
        let away_m = self.body_from_neighbour.translation;
        let (rotation_sigma_rad, translation_sigma_m) = self.sigmas(&away_m);
        ToldPose {
            world_from_body: *world_from_neighbour * self.body_from_neighbour.inverse(),
            rotation_sigma_rad,
            translation_sigma_m,
        }
    }

    /// Where the neighbour is, by where this vehicle is.
    pub(crate) fn neighbour_pose(&self, world_from_body: &Transform<World, Body>) -> ToldPose {
        let (rotation_sigma_rad, translation_sigma_m) = self.sigmas(&Vector3::zeros());
        ToldPose {
            world_from_body: *world_from_body * self.body_from_neighbour,
            rotation_sigma_rad,
            translation_sigma_m,
        }
    }

    /// Greatest standard deviations of rotation (rad) and translation (m) of one vehicle seen from the other, where an
    /// error of the yaw turns it about a point so far away.
    fn sigmas(&self, arm_m: &Vector3<f64>) -> (f64, f64) {
        // d(position) - yaw error x arm, in the level frame.
        let mut jacobian = SMatrix::<f64, 3, 4>::zeros();
        jacobian
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&Matrix3::identity());
        jacobian[(0, 3)] = arm_m.y;
        jacobian[(1, 3)] = -arm_m.x;
        let position = jacobian * self.covariance * jacobian.transpose();
        let greatest = position.symmetric_eigenvalues().max().max(0.0);
        let rotation = self.covariance[(3, 3)].max(0.0);
        let combined = |variance: f64, sigma: f64| (variance + sigma * sigma).sqrt().min(SIGMA_MAX);
        (
            combined(rotation, NEIGHBOUR_ROTATION_SIGMA_RAD),
            combined(greatest, NEIGHBOUR_TRANSLATION_SIGMA_M),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn an_uncertain_heading_moves_a_vehicle_that_is_placed_from_far_away() {
        let mut covariance = Matrix4::zeros();
        covariance[(3, 3)] = 0.01;
        let found = Found {
            body_from_neighbour: Transform::new(
                UnitQuaternion::identity(),
                Vector3::new(20.0, 0.0, 0.0),
            ),
            covariance,
        };
        let here = Transform::identity();
        let (own, neighbour) = (found.own_pose(&here), found.neighbour_pose(&here));
        assert!((own.translation_sigma_m - 2.0).abs() < 0.01, "{own:?}");
        assert!(neighbour.translation_sigma_m < 0.11, "{neighbour:?}");
        assert!((own.rotation_sigma_rad - 0.1).abs() < 0.01);
        assert!((own.world_from_body.translation.x + 20.0).abs() < 1e-9);
    }
}
