//! Two vehicles in their level frames, and as bodies in space.

use nalgebra::{UnitQuaternion, Vector3};
use skein_estimation::odometry::OdometryPoint;
use skein_estimation::ranging::{LevelOdometry, RelativePose};
use skein_estimation::{Body, Odometry, Transform};

/// A point of the body, in the odometry frame (m).
pub(super) fn point(
    odometry_from_body: &Transform<Odometry, Body>,
    in_body_m: &Vector3<f64>,
) -> Vector3<f64> {
    odometry_from_body.rotation * in_body_m + odometry_from_body.translation
}

/// Odometry of a point of a vehicle, with the vehicle's heading.
pub(super) fn levelled(at: &OdometryPoint, position_m: Vector3<f64>) -> LevelOdometry {
    LevelOdometry {
        segment: at.segment,
        position_m,
        yaw_rad: yaw_rad(&at.odometry_from_body.rotation),
        growth: at.growth,
    }
}

/// Odometry of a vehicle's body.
pub(super) fn level(at: &OdometryPoint) -> LevelOdometry {
    levelled(at, at.odometry_from_body.translation)
}

/// The heading of a rotation: yaw of yaw, pitch and roll.
fn yaw_rad(rotation: &UnitQuaternion<f64>) -> f64 {
    rotation.euler_angles().2
}

/// The neighbour's body in this vehicle's at these points of their odometries, by a relative pose of two ends `at`, this
/// vehicle's and the neighbour's.
pub(super) fn body_from_body(
    at: [&LevelOdometry; 2],
    relative: &RelativePose,
    own: &OdometryPoint,
    neighbour: &OdometryPoint,
) -> Transform<Body, Body> {
    let about_z = |angle_rad| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad);
    let [own_end, neighbour_end] = at;
    let own_turn = about_z(own_end.yaw_rad);
    let turn = own_turn * about_z(relative.yaw_rad - neighbour_end.yaw_rad);
    let odometry_from_odometry = Transform::<Odometry, Odometry>::new(
        turn,
        own_end.position_m + own_turn * relative.position_m - turn * neighbour_end.position_m,
    );
    own.odometry_from_body.inverse() * odometry_from_odometry * neighbour.odometry_from_body
}

#[cfg(test)]
mod tests {
    use super::*;
    use skein_estimation::World;
    use skein_estimation::odometry::Growth;
    use skein_estimation::time::Stamp;

    fn turned(yaw_rad: f64, pitch_rad: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(0.0, pitch_rad, yaw_rad)
    }

    /// What odometry says of a vehicle that is there in the world, when it began there.
    fn odometry(began: &Transform<World, Odometry>, is: &Transform<World, Body>) -> OdometryPoint {
        OdometryPoint {
            taken: Stamp::default(),
            segment: 0,
            odometry_from_body: began.inverse() * *is,
            growth: Growth::zero(),
        }
    }

    #[test]
    fn a_place_found_between_two_antennas_holds_for_both_bodies_wherever_they_went_since() {
        let began = [
            Transform::new(turned(0.4, 0.0), Vector3::new(3.0, -1.0, 0.2)),
            Transform::new(turned(-2.0, 0.0), Vector3::new(-4.0, 2.0, 1.0)),
        ];
        let then = [
            Transform::new(turned(1.0, 0.1), Vector3::new(5.0, 0.0, 0.5)),
            Transform::new(turned(2.5, -0.2), Vector3::new(-2.0, 4.0, 1.5)),
        ];
        let antennas = [Vector3::new(0.2, 0.0, 0.5), Vector3::new(-0.3, 0.1, 0.4)];
        let in_world = [0, 1].map(|n: usize| then[n].rotation * antennas[n] + then[n].translation);
        let level = |n: usize| {
            let point = odometry(&began[n], &then[n]);
            levelled(
                &point,
                super::point(&point.odometry_from_body, &antennas[n]),
            )
        };
        let headings = [0, 1].map(|n: usize| yaw_rad(&then[n].rotation));
        let relative = RelativePose::new(
            turned(-headings[0], 0.0) * (in_world[1] - in_world[0]),
            headings[1] - headings[0],
        );

        let now = [
            Transform::new(turned(-0.5, 0.2), Vector3::new(6.0, 1.0, 0.0)),
            Transform::new(turned(0.1, 0.0), Vector3::new(0.0, 5.0, 1.0)),
        ];
        let found = body_from_body(
            [&level(0), &level(1)],
            &relative,
            &odometry(&began[0], &now[0]),
            &odometry(&began[1], &now[1]),
        );
        let truth = now[0].inverse() * now[1];
        assert!((found.translation - truth.translation).norm() < 1e-9);
        assert!(found.rotation.angle_to(&truth.rotation) < 1e-9);
    }
}
