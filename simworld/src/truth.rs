//! Where a vehicle really is. Poses here are nalgebra's own isometries and nothing of the estimators, so that a sign
//! error in their geometry meets a second opinion.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// A rigid transform; a vehicle's truth is `world_from_body` (world ENU, body FLU, metres).
pub type Pose = Isometry3<f64>;

/// The pose at `position_m` with the attitude `Rz(yaw) Ry(pitch) Rx(roll)`, angles in radians.
#[must_use]
pub fn pose_from_euler(
    position_m: Vector3<f64>,
    yaw_rad: f64,
    pitch_rad: f64,
    roll_rad: f64,
) -> Pose {
    // nalgebra's order of arguments is roll, pitch, yaw, for exactly this product.
    pose(
        UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad),
        position_m,
    )
}

/// The pose with this rotation and this translation, metres.
#[must_use]
pub fn pose(rotation: UnitQuaternion<f64>, translation_m: Vector3<f64>) -> Pose {
    Pose::from_parts(Translation3::from(translation_m), rotation)
}

/// The position of `b` seen from `a`, in the frame of `a`, metres.
#[must_use]
pub fn relative_position_m(world_from_a: &Pose, world_from_b: &Pose) -> Vector3<f64> {
    world_from_a.inv_mul(world_from_b).translation.vector
}

/// The yaw of a pose, radians in (-pi, pi], of the order `Rz(yaw) Ry(pitch) Rx(roll)`.
#[must_use]
pub fn yaw_rad(world_from_body: &Pose) -> f64 {
    world_from_body.rotation.euler_angles().2
}

/// The same angle within [-pi, pi].
#[must_use]
pub fn wrapped_rad(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_positive_yaw_turns_the_nose_from_east_to_north() {
        let world_from_body = pose_from_euler(Vector3::zeros(), FRAC_PI_2, 0.0, 0.0);
        let nose_in_world = world_from_body * Vector3::x();
        assert!((nose_in_world - Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn a_positive_pitch_lowers_the_nose_and_a_positive_roll_lowers_the_right_side() {
        // Front-left-up: a rotation by the right-hand rule about the left axis takes the nose down.
        let pitched = pose_from_euler(Vector3::zeros(), 0.0, 0.3, 0.0) * Vector3::x();
        assert!((pitched.z + 0.3_f64.sin()).abs() < 1e-12);
        let rolled = pose_from_euler(Vector3::zeros(), 0.0, 0.0, 0.3) * -Vector3::y();
        assert!((rolled.z + 0.3_f64.sin()).abs() < 1e-12);
    }

    #[test]
    fn euler_angles_multiply_as_yaw_then_pitch_then_roll() {
        let product = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7)
            * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -0.4)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.2);
        let pose = pose_from_euler(Vector3::zeros(), 0.7, -0.4, 0.2);
        assert!(pose.rotation.angle_to(&product) < 1e-12);
        assert!((yaw_rad(&pose) - 0.7).abs() < 1e-12);
    }

    #[test]
    fn what_is_ahead_of_a_vehicle_that_looks_north_has_a_positive_x() {
        let observer = pose_from_euler(Vector3::new(1.0, 0.0, 0.0), FRAC_PI_2, 0.0, 0.0);
        let target = pose_from_euler(Vector3::new(1.0, 5.0, 0.0), 0.0, 0.0, 0.0);
        assert!(
            (relative_position_m(&observer, &target) - Vector3::new(5.0, 0.0, 0.0)).norm() < 1e-12
        );
    }
}
