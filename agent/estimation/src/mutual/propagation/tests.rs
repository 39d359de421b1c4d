//! Propagation against closed forms and against a path whose truth is known.

use super::weaving::{GRAVITY_M_S2, Weaving};
use super::*;

fn position_error_after_20_s(rate_hz: u32) -> f64 {
    let (own, neighbour) = (Weaving::one(), Weaving::other());
    let step_s = 1.0 / f64::from(rate_hz);
    let mut state = neighbour.seen_from(&own, 0.0);
    for step in 0..20 * rate_hz {
        let (from, to) = (f64::from(step) * step_s, f64::from(step + 1) * step_s);
        let motion =
            |vehicle: &Weaving| motion_between(&vehicle.drive(from), &vehicle.drive(to), step_s);
        state = propagated(&state, &motion(&own), &motion(&neighbour));
    }
    (state.position_m - neighbour.seen_from(&own, 20.0).position_m).norm()
}

#[test]
fn without_noise_a_tenth_of_a_millimetre_is_lost_in_20_s_at_most() {
    assert!(position_error_after_20_s(400) < 1e-4);
}

#[test]
fn half_the_step_leaves_a_quarter_of_the_error() {
    let ratio = position_error_after_20_s(100) / position_error_after_20_s(200);
    assert!((3.8..4.2).contains(&ratio), "{ratio}");
}

#[test]
fn constant_drives_are_integrated_exactly() {
    // The own vehicle flies a circle: constant in its level frame, its acceleration points to the centre and its yaw
    // follows the path. The neighbour climbs at constant acceleration without turning.
    let (radius_m, rate_rad_s, climb_m_s2) = (3.0, 0.6, 0.2);
    let own = Drive {
        acceleration_m_s2: Vector3::new(0.0, radius_m * rate_rad_s * rate_rad_s, GRAVITY_M_S2),
        yaw_rate_rad_s: rate_rad_s,
    };
    let neighbour = Drive {
        acceleration_m_s2: Vector3::new(0.0, 0.0, GRAVITY_M_S2 + climb_m_s2),
        yaw_rate_rad_s: 0.0,
    };
    let truth = |t: f64| {
        let own_m =
            Vector3::new((rate_rad_s * t).sin(), 1.0 - (rate_rad_s * t).cos(), 0.0) * radius_m;
        let neighbour_m = Vector3::new(4.0, 2.0, 1.0 + climb_m_s2 * t * t / 2.0);
        about_vertical(-rate_rad_s * t) * (neighbour_m - own_m)
    };
    let start = Reduced {
        position_m: truth(0.0),
        velocity_m_s: Vector3::new(-radius_m * rate_rad_s, 0.0, 0.0),
        yaw_rad: 0.0,
    };
    for step_s in [0.0025, 0.05, 1.0, 5.0] {
        let mut state = start;
        let steps = (20.0f64 / step_s).round() as usize;
        let own = motion_between(&own, &own, step_s);
        let neighbour = motion_between(&neighbour, &neighbour, step_s);
        for _ in 0..steps {
            state = propagated(&state, &own, &neighbour);
        }
        assert!(
            (state.position_m - truth(20.0)).norm() < 1e-9,
            "step {step_s}"
        );
    }
}

#[test]
fn two_steps_are_the_one_step_of_their_sum() {
    let (own, neighbour) = (Weaving::one(), Weaving::other());
    let motion = |vehicle: &Weaving, from: f64, to: f64| {
        motion_between(&vehicle.drive(from), &vehicle.drive(to), to - from)
    };
    let sum = |vehicle: &Weaving| {
        let half = advanced(&Inertial::zero(), &motion(vehicle, 0.0, 0.4));
        advanced(&half, &motion(vehicle, 0.4, 1.0)).since(&Inertial::zero())
    };
    let start = neighbour.seen_from(&own, 0.0);
    let half = propagated(
        &start,
        &motion(&own, 0.0, 0.4),
        &motion(&neighbour, 0.0, 0.4),
    );
    let two = propagated(
        &half,
        &motion(&own, 0.4, 1.0),
        &motion(&neighbour, 0.4, 1.0),
    );
    let one = propagated(&start, &sum(&own), &sum(&neighbour));
    assert!((two.position_m - one.position_m).norm() < 1e-12);
    assert!((two.velocity_m_s - one.velocity_m_s).norm() < 1e-12);
    assert!((two.yaw_rad - one.yaw_rad).abs() < 1e-12);
}

#[test]
fn small_and_larger_angles_meet() {
    for yaw in [SERIES_BELOW_RAD, -SERIES_BELOW_RAD] {
        for integrated in [once_integrated, twice_integrated] {
            let (below, above) = (integrated(yaw * 0.999_999), integrated(yaw * 1.000_001));
            assert!((below.0 - above.0).abs() < 1e-7 && (below.1 - above.1).abs() < 1e-7);
        }
    }
}

fn set_of(inertial: Inertial) -> FeatureSet {
    FeatureSet {
        taken: Stamp::from_nanos((inertial.elapsed_s * 1e9).round() as i64),
        roll_rad: 0.0,
        pitch_rad: 0.0,
        yaw_rate_rad_s: 0.0,
        acceleration_m_s2: Vector3::z() * GRAVITY_M_S2,
        inertial,
        features: Vec::new(),
        tracks: Vec::new(),
    }
}

#[test]
fn a_vehicle_that_accelerates_evenly_is_where_it_is_expected_to_be() {
    let drive = Drive {
        acceleration_m_s2: Vector3::new(0.3, -0.2, 0.1),
        yaw_rate_rad_s: 0.0,
    };
    let at = |t: f64| advanced(&Inertial::zero(), &motion_between(&drive, &drive, t));
    let (before, newest) = (set_of(at(1.0)), set_of(at(1.05)));
    let expected = inertial_at(Stamp::from_nanos(1_150_000_000), &newest, Some(&before));
    assert!((expected.position_m - at(1.15).position_m).norm() < 1e-9);
    assert!((expected.velocity_m_s - at(1.15).velocity_m_s).norm() < 1e-9);
}

#[test]
fn two_sets_of_one_instant_are_no_reason_for_infinite_acceleration() {
    let set = set_of(Inertial::zero());
    let later = inertial_at(Stamp::from_nanos(50_000_000), &set, Some(&set));
    assert_eq!(later.velocity_m_s, Vector3::zeros());
}
