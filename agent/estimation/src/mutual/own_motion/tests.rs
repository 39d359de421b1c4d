//! The integrals against closed forms, and what is told.

use super::*;
use crate::mutual::feature_set::Motion;
use std::f64::consts::TAU;

const GRAVITY_M_S2: f64 = 9.80665;

/// A filter that trusts its gyro and its first tilt without end, so that nothing but integration is seen.
fn unquestioned() -> OwnMotion {
    let mut settings = Settings::standard();
    settings.first_tilt_sigma_rad = 0.0;
    settings.rate.noise = 0.0;
    settings.rate.scale_error = 0.0;
    settings.rate.bias_sigma_rad_s = 0.0;
    settings.rate.bias_walk = 0.0;
    settings.rest.first_bias_max_rad_s = 0.0;
    settings.force.bias_sigma_m_s2 = 0.0;
    settings.force.bias_walk = 0.0;
    OwnMotion::new(settings)
}

/// Feeds readings (rate, force) of a function of time, after one at rest which sets the tilt, and gives the motion from
/// 0 s to the end.
fn flown(
    own: &mut OwnMotion,
    step_s: f64,
    steps: usize,
    reading: impl Fn(f64) -> (Vector3<f64>, Vector3<f64>),
) -> Motion {
    own.update(0.0, &Vector3::zeros(), &(Vector3::z() * GRAVITY_M_S2));
    let mut begin = Inertial::zero();
    for step in 0..=steps {
        let (rate, force) = reading(step as f64 * step_s);
        own.update(step_s, &rate, &force);
        if step == 0 {
            begin = own.tell().inertial;
        }
    }
    own.tell().inertial.since(&begin)
}

#[test]
fn constant_rate_and_acceleration_are_integrated_exactly() {
    let (rate, ahead) = (0.8, Vector3::new(1.5, -0.7, 0.4));
    let mut own = unquestioned();
    let motion = flown(&mut own, 0.0025, 8000, |_| {
        (Vector3::z() * rate, ahead + Vector3::z() * GRAVITY_M_S2)
    });
    // v = integral of Rz(rate s) a, p = integral of v, with u = rate t.
    let t_s: f64 = 20.0;
    let (sin, cos) = (rate * t_s).sin_cos();
    let turned = |along: f64, across: f64| {
        Vector3::new(
            along * ahead.x - across * ahead.y,
            across * ahead.x + along * ahead.y,
            0.0,
        )
    };
    let velocity = turned(sin / rate, (1.0 - cos) / rate) + Vector3::z() * (ahead.z * t_s);
    let position = turned(
        (1.0 - cos) / rate.powi(2),
        (rate * t_s - sin) / rate.powi(2),
    ) + Vector3::z() * (0.5 * ahead.z * t_s * t_s);
    assert!((motion.elapsed_s - t_s).abs() < 1e-9);
    assert!((motion.yaw_rad - rate * t_s).abs() < 1e-9);
    assert!((motion.velocity_m_s - velocity).norm() < 1e-9, "{motion:?}");
    assert!((motion.position_m - position).norm() < 1e-9, "{motion:?}");
}

/// Weaves and turns its heading while level, for 20 s: position 1.2 sin(2 pi t/7), 0.9 sin(2 pi t/5).
fn woven(step_s: f64) -> f64 {
    let (east, north) = (TAU / 7.0, TAU / 5.0);
    let heading = |t_s: f64| 0.8 * (0.6 * t_s).sin();
    let motion = flown(
        &mut unquestioned(),
        step_s,
        (20.0 / step_s).round() as usize,
        |t_s| {
            let acceleration = Vector3::new(
                -1.2 * east * east * (east * t_s).sin(),
                -0.9 * north * north * (north * t_s).sin(),
                0.0,
            );
            (
                Vector3::z() * (0.48 * (0.6 * t_s).cos()),
                about_vertical(-heading(t_s)) * acceleration + Vector3::z() * GRAVITY_M_S2,
            )
        },
    );
    let velocity = Vector3::new(1.2 * east, 0.9 * north, 0.0);
    let position = Vector3::new(1.2 * (east * 20.0).sin(), 0.9 * (north * 20.0).sin(), 0.0);
    (motion.position_m - (position - velocity * 20.0)).norm()
}

#[test]
fn a_woven_flight_is_integrated_to_second_order() {
    let (coarse_m, fine_m) = (woven(0.0025), woven(0.00125));
    assert!(coarse_m < 1e-4, "{coarse_m}");
    assert!((coarse_m / fine_m - 4.0).abs() < 0.1, "{coarse_m} {fine_m}");
}

#[test]
fn the_mean_acceleration_is_that_since_something_was_told() {
    let mut own = unquestioned();
    assert_eq!(own.tell().acceleration_m_s2, Vector3::z() * GRAVITY_M_S2);
    let ahead = Vector3::new(0.3, 0.1, 0.0);
    let turning = |_| (Vector3::z() * 0.5, ahead + Vector3::z() * GRAVITY_M_S2);
    flown(&mut own, 0.0025, 40, turning);
    let (rate, force) = turning(0.0);
    for _ in 0..20 {
        own.update(0.0025, &rate, &force);
    }
    // The level frame turns with the vehicle, so an acceleration that is constant in the body is its own mean.
    let told = own.tell();
    assert!((told.acceleration_m_s2 - force).norm() < 1e-6, "{told:?}");
    assert!((told.yaw_rate_rad_s - 0.5).abs() < 1e-9);
    assert_eq!(own.tell().acceleration_m_s2, Vector3::z() * GRAVITY_M_S2);
}

#[test]
fn a_gap_takes_its_time_and_keeps_the_velocity() {
    let mut own = unquestioned();
    let force = Vector3::new(0.5, 0.0, GRAVITY_M_S2);
    flown(&mut own, 0.0025, 400, |_| (Vector3::zeros(), force));
    let before = own.tell().inertial;
    own.update(2.0, &Vector3::zeros(), &force);
    let motion = own.tell().inertial.since(&before);
    assert_eq!(motion.elapsed_s, 2.0);
    assert_eq!(motion.velocity_m_s, Vector3::zeros());
    assert!(motion.position_m.norm() < 1e-12);
}

#[test]
fn a_direction_is_levelled_by_roll_and_pitch_alone() {
    let mut own = unquestioned();
    // The nose is 0.4 rad down: what it points at is 0.4 rad below the horizon, straight ahead.
    let force = Vector3::new(-(0.4_f64.sin()), 0.0, 0.4_f64.cos()) * GRAVITY_M_S2;
    own.update(0.0, &Vector3::zeros(), &force);
    assert!((own.tell().pitch_rad - 0.4).abs() < 1e-9);
    let levelled = own.levelled(&Vector3::x_axis());
    assert!(
        (levelled.into_inner() - Vector3::new(0.4_f64.cos(), 0.0, -(0.4_f64.sin()))).norm() < 1e-9
    );
}
