//! Quadrotors: positions, attitudes and readings that belong together.

use super::*;
use crate::mutual_scenario::{Flight, MutualScenario};
use crate::streams::Streams;
use crate::truth::yaw_rad;
use nalgebra::Matrix3;

/// Every robot of both teams on every kind of course.
fn every_course() -> Vec<Course> {
    let mut courses = Vec::new();
    for scenario in [MutualScenario::square(), MutualScenario::eight()] {
        for flight in [Flight::Weave, Flight::Round, Flight::Legs] {
            courses.extend(
                MutualScenario {
                    flight,
                    ..scenario.clone()
                }
                .courses(0),
            );
        }
    }
    courses
}

#[test]
fn velocity_acceleration_and_heading_rate_are_the_derivatives_of_the_course() {
    let h = 1e-5;
    for course in every_course() {
        for step in 0..300 {
            let t_s = 0.05 + f64::from(step) * 0.1;
            let (before, at, after) = (
                course.place_at(t_s - h),
                course.place_at(t_s),
                course.place_at(t_s + h),
            );
            let velocity = (after.position_m - before.position_m) / (2.0 * h);
            let acceleration = (after.velocity_m_s - before.velocity_m_s) / (2.0 * h);
            let heading_rate = (after.heading_rad - before.heading_rad) / (2.0 * h);
            assert!(
                (velocity - at.velocity_m_s).norm() < 1e-7,
                "{course:?} at {t_s}"
            );
            assert!(
                (acceleration - at.acceleration_m_s2).norm() < 1e-4,
                "{course:?} at {t_s}"
            );
            assert!(
                (heading_rate - at.heading_rate_rad_s).abs() < 1e-7,
                "{course:?} at {t_s}"
            );
        }
    }
}

#[test]
fn everyone_hovers_level_for_two_seconds() {
    for course in every_course() {
        let (start, later) = (Motion::at(&course, 0.0), Motion::at(&course, 1.9));
        assert_eq!(start.pose, later.pose);
        assert_eq!((start.roll_rad, start.pitch_rad), (0.0, 0.0));
        assert!((start.specific_force_m_s2() - Vector3::z() * GRAVITY_M_S2).norm() < 1e-12);
        assert_eq!(start.angular_rate_rad_s, Vector3::zeros());
    }
}

#[test]
fn the_thrust_carries_accelerates_and_overcomes_the_air() {
    for course in every_course() {
        let motion = Motion::at(&course, 9.3);
        let needed = motion.acceleration_m_s2
            + Vector3::z() * GRAVITY_M_S2
            + motion.velocity_m_s * DRAG_PER_S;
        let up = motion.pose.rotation * Vector3::z();
        assert!((up - needed.normalize()).norm() < 1e-12);
        let turns = (yaw_rad(&motion.pose) - motion.heading_rad) / std::f64::consts::TAU;
        assert!((turns - turns.round()).abs() < 1e-12);
    }
}

#[test]
fn integrating_what_a_perfect_sensor_feels_is_the_flight() {
    // Neither the attitude nor the rate comes from the formulas that made them, only from the body's rates.
    for course in every_course().into_iter().step_by(5) {
        let imu = Imu::new(ImuSettings::perfect(), 0, 0.0, Streams::new(1, 0));
        let start = Motion::at(&course, 0.0);
        let (mut rotation, mut velocity) = (start.pose.rotation, start.velocity_m_s);
        let mut position = start.pose.translation.vector;
        let dt = 1.0 / 400.0;
        let gravity = Vector3::z() * GRAVITY_M_S2;
        for index in 0..4000 {
            let (now, next) = (imu.sample(&course, index), imu.sample(&course, index + 1));
            let turn = (now.rate_rad_s + next.rate_rad_s) * (0.5 * dt);
            let turned = rotation * nalgebra::UnitQuaternion::from_scaled_axis(turn);
            let (a, b) = (
                rotation * now.force_m_s2 - gravity,
                turned * next.force_m_s2 - gravity,
            );
            position += velocity * dt + (a * 2.0 + b) * (dt * dt / 6.0);
            velocity += (a + b) * (0.5 * dt);
            rotation = turned;
        }
        let end = Motion::at(&course, 10.0);
        assert!(rotation.angle_to(&end.pose.rotation) < 1e-5, "{course:?}");
        assert!((velocity - end.velocity_m_s).norm() < 1e-4, "{course:?}");
        assert!(
            (position - end.pose.translation.vector).norm() < 5e-4,
            "{course:?}"
        );
    }
}

#[test]
fn the_square_stands_on_its_corners_two_and_a_half_metres_high() {
    // North-east-down (-2, -2), (2, -2), (2, 2), (-2, 2), 2.5 m up.
    let corners = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)];
    for (course, (north, east)) in MutualScenario::square().courses(0).iter().zip(corners) {
        assert_eq!(
            course.place_at(0.0).position_m,
            Vector3::new(east, north, 2.5)
        );
    }
}

#[test]
fn attitude_is_the_same_by_the_formulas_of_north_east_down() {
    // z_B = -(p'' - g e3 + 0.25 v)/|.|, z_C = Rz(-psi) z_B, phi = -asin(z_C.y), theta = atan2(z_C.x, z_C.z), and then
    // over: roll the same, pitch negated.
    let ned_from_enu = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let frd_from_flu = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    for course in every_course() {
        let motion = Motion::at(&course, 7.7);
        let acceleration = ned_from_enu * motion.acceleration_m_s2;
        let velocity = ned_from_enu * motion.velocity_m_s;
        let psi = std::f64::consts::FRAC_PI_2 - motion.heading_rad;
        let down = -(acceleration - Vector3::z() * GRAVITY_M_S2 + velocity * 0.25).normalize();
        let level = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), -psi) * down;
        let (phi, theta) = (-level.y.asin(), level.x.atan2(level.z));
        assert!((motion.roll_rad - phi).abs() < 1e-12);
        assert!((motion.pitch_rad + theta).abs() < 1e-12);
        let ned_from_frd = nalgebra::Rotation3::from_euler_angles(phi, theta, psi);
        let enu_from_flu = motion.pose.rotation.to_rotation_matrix();
        let over = ned_from_enu * enu_from_flu.matrix() * frd_from_flu;
        assert!((ned_from_frd.matrix() - over).norm() < 1e-12);
    }
}

#[test]
fn noise_is_as_large_as_stated_and_samples_lie_on_the_grid() {
    let settings = ImuSettings {
        rate_bias_deg_s: 0.2,
        ..ImuSettings::default()
    };
    let course = &MutualScenario::square().courses(0)[0];
    let imu = Imu::new(settings, 3, 0.0, Streams::new(5, 0));
    // While it hovers.
    let samples: Vec<_> = (0..700).map(|index| imu.sample(course, index)).collect();
    let n = samples.len() as f64;
    let spread = |of: fn(&ImuSample) -> f64| {
        let mean = samples.iter().map(of).sum::<f64>() / n;
        let variance = samples.iter().map(|s| (of(s) - mean).powi(2)).sum::<f64>() / n;
        (mean, variance.sqrt())
    };
    let (mean, sigma) = spread(|s| s.force_m_s2.z);
    assert!(
        (mean - GRAVITY_M_S2).abs() < 0.1 && (sigma / 0.775 - 1.0).abs() < 0.1,
        "{mean} {sigma}"
    );
    let (mean, sigma) = spread(|s| s.rate_rad_s.x.to_degrees());
    assert!(
        (mean.abs() - 0.2).abs() < 0.1 && (sigma / 0.80 - 1.0).abs() < 0.1,
        "{mean} {sigma}"
    );
    for sample in &samples {
        let steps = sample.force_m_s2.x / 0.019;
        assert!((steps - steps.round()).abs() < 1e-9);
    }
    let read_as_std = ImuSettings {
        stated: Stated::StandardDeviation,
        ..settings
    };
    assert_eq!(read_as_std.force_sigma_m_s2().z, 0.6);
}

#[test]
fn who_flies_from_point_to_point_meets_nobody() {
    let scenario = MutualScenario {
        flight: Flight::Legs,
        ..MutualScenario::eight()
    };
    for sample in 0..5 {
        let courses = scenario.courses(sample);
        for step in 0..600 {
            let at = f64::from(step) * 0.1;
            let places: Vec<_> = courses
                .iter()
                .map(|course| course.place_at(at).position_m)
                .collect();
            for (index, place) in places.iter().enumerate() {
                for other in &places[..index] {
                    assert!((place - other).norm() > 0.9, "sample {sample} at {at} s");
                }
            }
        }
    }
}
