//! Stories of levelling: resting, turning, accelerating for long, starting in the air, and readings that are none.

use super::*;
use nalgebra::Rotation3;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const STEP_S: f64 = 0.005;

/// A vehicle whose attitude and acceleration are functions of time, and what its sensor says.
struct Flight {
    attitude: fn(f64) -> Rotation3<f64>,
    /// World frame (m/s^2).
    acceleration: fn(f64) -> Vector3<f64>,
    rate_bias_rad_s: Vector3<f64>,
    /// Standard deviation of a reading's rate (rad/s) and force (m/s^2).
    noise: (f64, f64),
}

impl Flight {
    fn still(attitude: fn(f64) -> Rotation3<f64>) -> Self {
        Self {
            attitude,
            acceleration: |_| Vector3::zeros(),
            rate_bias_rad_s: Vector3::zeros(),
            noise: (0.0, 0.0),
        }
    }

    fn rate_rad_s(&self, t_s: f64) -> Vector3<f64> {
        const HALF_S: f64 = 1e-4;
        let turn = (self.attitude)(t_s - HALF_S).inverse() * (self.attitude)(t_s + HALF_S);
        turn.scaled_axis() / (2.0 * HALF_S)
    }

    fn force_m_s2(&self, t_s: f64) -> Vector3<f64> {
        let gravity = Vector3::z() * Settings::standard().gravity_m_s2;
        (self.attitude)(t_s).inverse() * ((self.acceleration)(t_s) + gravity)
    }

    /// Feeds the readings from one time to another, and gives the largest error of the tilt (rad) after `scored_s`.
    fn fly(&self, filter: &mut Attitude, from_s: f64, until_s: f64, scored_s: f64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut worst_rad: f64 = 0.0;
        let steps = ((until_s - from_s) / STEP_S).round() as usize;
        for step in 0..=steps {
            let t_s = from_s + step as f64 * STEP_S;
            let mut drawn = |sigma: f64| {
                Vector3::from_fn(|_, _| {
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    sigma * normal
                })
            };
            let rate = self.rate_rad_s(t_s) + self.rate_bias_rad_s + drawn(self.noise.0);
            let force = self.force_m_s2(t_s) + drawn(self.noise.1);
            filter.update(STEP_S, &rate, &force);
            if t_s >= scored_s {
                worst_rad = worst_rad.max(self.tilt_error_rad(filter, t_s));
            }
        }
        worst_rad
    }

    fn tilt_error_rad(&self, filter: &Attitude, t_s: f64) -> f64 {
        let truth = (self.attitude)(t_s).inverse() * Vector3::z();
        truth.angle(&(filter.gyro_from_body().inverse() * Vector3::z()))
    }
}

fn slanted(_: f64) -> Rotation3<f64> {
    Rotation3::from_euler_angles(0.5, -0.3, 2.0)
}

/// From 0 at 5 s to 1 at 8 s, without a jolt.
fn grown(t_s: f64) -> f64 {
    let s = ((t_s - 5.0) / 3.0).clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

/// Rolls, pitches and turns, after five seconds of rest.
fn swaying(t_s: f64) -> Rotation3<f64> {
    Rotation3::from_euler_angles(
        0.4 * grown(t_s) * (1.1 * t_s).sin(),
        0.3 * grown(t_s) * (0.7 * t_s).cos(),
        1.5 * grown(t_s) * (0.4 * t_s).sin(),
    )
}

/// The acceleration of flying to and fro, after five seconds of rest: up to a third of gravity.
fn rushing(t_s: f64) -> Vector3<f64> {
    const STEP_S: f64 = 1e-3;
    let place_m = |t_s: f64| {
        let place_m = Vector3::new(
            (1.3 * t_s).sin(),
            (0.9 * t_s).cos(),
            0.5 * (2.1 * t_s).sin(),
        );
        place_m * (1.8 * grown(t_s))
    };
    (place_m(t_s + STEP_S) - place_m(t_s) * 2.0 + place_m(t_s - STEP_S)) / (STEP_S * STEP_S)
}

#[test]
fn a_vehicle_that_rests_is_levelled_and_its_gyro_calibrated_however_large_the_bias() {
    let flight = Flight {
        rate_bias_rad_s: Vector3::new(0.03, -0.04, 0.06),
        noise: (0.01, 0.3),
        ..Flight::still(slanted)
    };
    let mut filter = Attitude::new(Settings::standard());
    assert!(!filter.is_settled());
    let worst_rad = flight.fly(&mut filter, 0.0, 20.0, 10.0);
    assert!(worst_rad < 0.25_f64.to_radians(), "{worst_rad}");
    let off = filter.rate_bias_rad_s() - flight.rate_bias_rad_s;
    assert!(off.norm() < 1e-3, "{off}");
    assert!(filter.is_settled() && filter.tilt_sigma_rad() < 0.01);
    assert!((filter.roll_rad() - 0.5).abs() < 0.005 && (filter.pitch_rad() + 0.3).abs() < 0.005);
}

#[test]
fn acceleration_that_lasts_does_not_tip_it() {
    let flight = Flight {
        acceleration: rushing,
        rate_bias_rad_s: Vector3::new(0.004, -0.004, 0.004),
        ..Flight::still(swaying)
    };
    let mut filter = Attitude::new(Settings::standard());
    let worst_rad = flight.fly(&mut filter, 0.0, 60.0, 5.0);
    // The force itself is up to 17 degrees off the vertical.
    assert!(worst_rad < 1.0_f64.to_radians(), "{worst_rad}");
}

#[test]
fn in_the_air_from_the_beginning_it_finds_the_vertical_within_a_minute() {
    let flight = Flight {
        acceleration: rushing,
        rate_bias_rad_s: Vector3::new(0.004, -0.004, 0.004),
        ..Flight::still(swaying)
    };
    let mut filter = Attitude::new(Settings::standard());
    let worst_rad = flight.fly(&mut filter, 20.0, 110.0, 80.0);
    assert!(worst_rad < 1.0_f64.to_radians(), "{worst_rad}");
}

#[test]
fn a_steady_turn_after_a_rest_is_no_rest() {
    let turning = |t_s: f64| Rotation3::from_euler_angles(0.0, 0.0, 0.06 * (t_s - 5.0).max(0.0));
    let mut filter = Attitude::new(Settings::standard());
    Flight::still(turning).fly(&mut filter, 0.0, 30.0, 0.0);
    assert!(filter.rate_bias_rad_s().norm() < 1e-3);
    assert!((filter.yaw_rad() - 0.06 * 25.0).abs() < 0.02);
}

#[test]
fn the_yaw_counts_whole_turns_and_its_rate_is_that_of_the_heading() {
    let turning = |t_s: f64| {
        Rotation3::from_euler_angles(0.3 * t_s.sin(), 0.4 * (1.3 * t_s).sin(), 1.2 * t_s)
    };
    let flight = Flight::still(turning);
    let mut filter = Attitude::new(Settings::standard());
    flight.fly(&mut filter, 0.0, 15.0, 0.0);
    let (before_rad, rate) = (filter.yaw_rad(), filter.yaw_rate_rad_s());
    flight.fly(&mut filter, 15.0 + STEP_S, 15.0 + STEP_S, 0.0);
    let seen = (filter.yaw_rad() - before_rad) / STEP_S;
    assert!((before_rad - 18.0).abs() < 0.05, "{before_rad}");
    assert!((rate - 1.2).abs() < 0.03 && (seen - 1.2).abs() < 0.03);
}

#[test]
fn the_yaw_rate_mixes_pitch_rate_and_yaw_rate_of_a_rolled_body() {
    // Rolled by 90 degrees to the right a pitch rate is a turn to the right (paper, eq. 15, in our frames).
    let mut filter = Attitude::new(Settings::standard());
    let force = Vector3::new(0.0, 9.8, 0.0);
    filter.update(0.0, &Vector3::new(0.1, 0.2, 0.3), &force);
    assert!((filter.roll_rad() - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    assert!((filter.yaw_rate_rad_s() - 0.2).abs() < 1e-9);
}

#[test]
fn after_a_gap_the_tilt_begins_anew_and_heading_and_biases_stay() {
    let flight = Flight {
        rate_bias_rad_s: Vector3::new(0.02, 0.01, 0.03),
        ..Flight::still(swaying)
    };
    let mut filter = Attitude::new(Settings::standard());
    flight.fly(&mut filter, 0.0, 20.0, 0.0);
    let (yaw_rad, bias) = (filter.yaw_rad(), filter.rate_bias_rad_s());
    let force = slanted(0.0).inverse() * Vector3::z() * 9.8;
    let levelled = filter.update(GAP_S + 0.1, &bias, &force);
    assert_eq!(
        levelled,
        Levelled::Begun {
            after_s: GAP_S + 0.1
        }
    );
    let up = filter.gyro_from_body().inverse() * Vector3::z();
    assert!(up.angle(&(force - filter.force_bias_m_s2())) < 1e-7);
    assert_eq!(filter.yaw_rad(), yaw_rad);
    assert_eq!(filter.rate_bias_rad_s(), bias);
    assert!(!filter.is_settled());
    assert_eq!(filter.age_s(), 0.0);
}

#[test]
fn what_is_no_reading_changes_nothing_but_takes_its_time() {
    let flight = Flight::still(swaying);
    let mut filter = Attitude::new(Settings::standard());
    flight.fly(&mut filter, 0.0, 6.0, 0.0);
    let attitude = filter.gyro_from_body();
    let (zero, force) = (Vector3::zeros(), Vector3::z() * 9.8);
    let nan = Vector3::new(0.0, f64::NAN, 0.0);
    let far = Vector3::x() * 1e9;
    for (elapsed_s, rate, force) in [
        (0.005, nan, force),
        (0.005, far, force),
        (0.005, zero, nan),
        (0.005, zero, far),
        (0.0, zero, force),
        (-1.0, zero, force),
        (f64::NAN, zero, force),
        (f64::INFINITY, zero, force),
    ] {
        assert_eq!(filter.update(elapsed_s, &rate, &force), Levelled::Refused);
    }
    assert_eq!(filter.gyro_from_body(), attitude);
    let Levelled::Moved(moved) = filter.update(0.005, &zero, &force) else {
        panic!("a good reading moves it");
    };
    assert!((moved.elapsed_s - 5.0 * 0.005).abs() < 1e-12);
}

#[test]
fn free_fall_from_the_beginning_has_some_attitude() {
    let mut filter = Attitude::new(Settings::standard());
    for _ in 0..1000 {
        filter.update(STEP_S, &Vector3::zeros(), &Vector3::zeros());
    }
    assert!(filter.level_from_body().coords.norm().is_finite());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn whatever_is_read_the_attitude_is_one(
        readings in prop::collection::vec(
            (1e-4..0.6f64, prop::array::uniform3(-200.0..200.0f64), prop::array::uniform3(-2000.0..2000.0f64)),
            1..400,
        ),
    ) {
        let mut filter = Attitude::new(Settings::standard());
        for (elapsed_s, rate, force) in readings {
            filter.update(elapsed_s, &Vector3::from(rate), &Vector3::from(force));
            prop_assert!((filter.gyro_from_body().coords.norm() - 1.0).abs() < 1e-6);
            prop_assert!(filter.tilt_sigma_rad() > 0.0 && filter.tilt_sigma_rad().is_finite());
            prop_assert!(filter.yaw_rad().is_finite() && filter.yaw_rate_rad_s().is_finite());
            prop_assert!(filter.rate_bias_rad_s().norm().is_finite() && filter.force_bias_m_s2().norm().is_finite());
        }
    }
}
