//! One checker for all kinds: residual, cost, gradient and Jacobian must be derivatives of each other wherever the
//! residual is smooth, and each kind is computed once by hand.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{DMatrix, DVector, UnitQuaternion};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::*;

const SEED: u64 = 7;

fn vector(rng: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..size))
}

fn rotation(rng: &mut ChaCha8Rng, angle: f64) -> UnitQuaternion<f64> {
    so3::exp(&(vector(rng, 1.0).normalize() * angle))
}

fn end(rng: &mut ChaCha8Rng) -> End {
    let angle = rng.random_range(0.0..PI);
    End::new(rotation(rng, angle), vector(rng, 5.0))
}

/// The measurement of each kind that these ends would give, spoilt by a turn and a shift.
fn measured(
    from: &End,
    to: &End,
    turn: &UnitQuaternion<f64>,
    shift: &Vector3<f64>,
) -> Vec<Measurement> {
    let truth: Transform<Sensor, Sensor> = from.inverse() * *to;
    let translation = truth.translation + shift;
    vec![
        Measurement::pose(Transform::new(truth.rotation * turn, translation)).unwrap(),
        Measurement::orientation(truth.rotation * turn).unwrap(),
        Measurement::position(translation).unwrap(),
        Measurement::bearing(
            (turn * truth.translation)
                .try_normalize(1e-300)
                .unwrap_or(Vector3::x()),
        )
        .unwrap(),
        Measurement::distance(translation.norm()).unwrap(),
    ]
}

/// Residual and Jacobian of either form of any kind, as dynamic matrices.
fn linearised(
    measurement: &Measurement,
    from: &End,
    to: &End,
    second_form: bool,
) -> (DVector<f64>, DMatrix<f64>) {
    fn join<const D: usize>(
        residual: &[f64],
        jacobian: &Jacobian<D>,
    ) -> (DVector<f64>, DMatrix<f64>) {
        let mut both = DMatrix::zeros(D, 12);
        both.columns_mut(0, 6).copy_from(&jacobian.from);
        both.columns_mut(6, 6).copy_from(&jacobian.to);
        (DVector::from_column_slice(residual), both)
    }
    match (measurement, second_form) {
        (Measurement::Pose(m), false) => {
            join(m.residual(from, to).as_slice(), &m.jacobian(from, to))
        }
        (Measurement::Pose(m), true) => join(
            m.twist_residual(from, to).as_slice(),
            &m.twist_jacobian(from, to),
        ),
        (Measurement::Orientation(m), _) => {
            join(m.residual(from, to).as_slice(), &m.jacobian(from, to))
        }
        (Measurement::Position(m), _) => {
            join(m.residual(from, to).as_slice(), &m.jacobian(from, to))
        }
        (Measurement::Bearing(m), false) => {
            join(m.residual(from, to).as_slice(), &m.jacobian(from, to))
        }
        (Measurement::Bearing(m), true) => join(
            m.residual_on_sphere(from, to).as_slice(),
            &m.jacobian_on_sphere(from, to),
        ),
        (Measurement::Distance(m), _) => join(&[m.residual(from, to)], &m.jacobian(from, to)),
    }
}

/// Both ends moved along axis `k` of the twelve.
fn moved(from: &End, to: &End, k: usize, step: f64) -> (End, End) {
    let mut by = Vector6::zeros();
    by[k % 6] = step;
    let (w, delta) = (
        by.fixed_rows::<3>(0).into_owned(),
        by.fixed_rows::<3>(3).into_owned(),
    );
    if k < 6 {
        (from.retract(&w, &delta), *to)
    } else {
        (*from, to.retract(&w, &delta))
    }
}

fn check_jacobian(measurement: &Measurement, from: &End, to: &End, step: f64, tolerance: f64) {
    for second_form in [false, true] {
        let (residual, jacobian) = linearised(measurement, from, to, second_form);
        for k in 0..12 {
            let (ahead_from, ahead_to) = moved(from, to, k, step);
            let (behind_from, behind_to) = moved(from, to, k, -step);
            let ahead = linearised(measurement, &ahead_from, &ahead_to, second_form).0;
            let behind = linearised(measurement, &behind_from, &behind_to, second_form).0;
            let numeric = (ahead - behind) / (2.0 * step);
            let error = (&numeric - jacobian.column(k)).norm();
            assert!(
                error < tolerance,
                "seed {SEED}, {measurement:?}, second form {second_form}, column {k}: {error}"
            );
        }
        if !second_form {
            // g = r.r, so its gradient is 2 J^T r: ties the paper's closed forms to the Jacobian.
            assert!(
                (measurement.cost(from, to) - residual.norm_squared()).abs()
                    < 1e-12 * (1.0 + residual.norm_squared())
            );
            let Gradient {
                from: by_from,
                to: by_to,
            } = measurement.gradient(from, to);
            let expected = 2.0 * jacobian.tr_mul(&residual);
            let both = DVector::from_iterator(12, by_from.iter().chain(by_to.iter()).copied());
            assert!(
                (both - &expected).norm() < 1e-9 * (1.0 + expected.norm()),
                "seed {SEED}, {measurement:?}"
            );
        }
    }
}

#[test]
fn jacobians_and_gradients_hold_at_random_poses() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for _ in 0..60 {
        let (from, to) = (end(&mut rng), end(&mut rng));
        let angle = rng.random_range(0.0..3.0);
        let (turn, shift) = (rotation(&mut rng, angle), vector(&mut rng, 2.0));
        for measurement in measured(&from, &to, &turn, &shift) {
            check_jacobian(&measurement, &from, &to, 1e-6, 2e-7);
        }
    }
}

#[test]
fn jacobians_and_gradients_hold_near_zero() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for size in [0.0, 1e-12, 1e-8, 1e-4] {
        let (from, to) = (end(&mut rng), end(&mut rng));
        let (turn, shift) = (rotation(&mut rng, size), vector(&mut rng, 1.0) * size);
        for measurement in measured(&from, &to, &turn, &shift) {
            check_jacobian(&measurement, &from, &to, 1e-6, 2e-8);
        }
    }
}

#[test]
fn jacobians_and_gradients_hold_near_half_a_turn() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for short_of_pi in [1e-1, 1e-3, 1e-4] {
        for _ in 0..10 {
            let (from, to) = (end(&mut rng), end(&mut rng));
            let (turn, shift) = (rotation(&mut rng, PI - short_of_pi), vector(&mut rng, 1.0));
            for measurement in measured(&from, &to, &turn, &shift) {
                check_jacobian(&measurement, &from, &to, 1e-6, 1e-6);
            }
        }
    }
}

#[test]
fn jacobians_and_gradients_hold_near_coincidence() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for distance in [1e-1, 1e-3, 1e-5] {
        let from = end(&mut rng);
        let mut to = end(&mut rng);
        to.translation = from.translation + vector(&mut rng, 1.0).normalize() * distance;
        let turn = rotation(&mut rng, 0.3);
        for measurement in measured(&from, &to, &turn, &Vector3::new(0.1, 0.2, 0.3)) {
            // Directions turn over a length of `distance`: the step must stay well below it.
            check_jacobian(&measurement, &from, &to, 1e-4 * distance, 1e-4 / distance);
        }
    }
}

#[test]
fn at_coincidence_and_at_half_a_turn_all_numbers_are_finite() {
    let from = End::new(UnitQuaternion::identity(), Vector3::new(1.0, 2.0, 3.0));
    let to = End::new(so3::exp(&Vector3::new(0.0, 0.0, PI)), from.translation);
    let away = End::new(UnitQuaternion::identity(), Vector3::zeros());
    let nothing = UnitQuaternion::identity();
    let mut all = measured(&from, &from, &nothing, &Vector3::zeros());
    all.extend(measured(&from, &away, &nothing, &Vector3::zeros()));
    for measurement in all {
        for second_form in [false, true] {
            let (residual, jacobian) = linearised(&measurement, &from, &to, second_form);
            assert!(
                residual
                    .iter()
                    .chain(jacobian.iter())
                    .all(|number| number.is_finite()),
                "{measurement:?}"
            );
        }
        let gradient = measurement.gradient(&from, &to);
        assert!(
            gradient
                .from
                .iter()
                .chain(gradient.to.iter())
                .all(|number| number.is_finite())
        );
    }
}

/// i at (1, 0, 0) turned a quarter about z; j at (1, 2, 0), not turned. So d = (0, 2, 0) and v = (2, 0, 0).
fn by_hand() -> (End, End) {
    (
        End::new(
            so3::exp(&Vector3::new(0.0, 0.0, FRAC_PI_2)),
            Vector3::new(1.0, 0.0, 0.0),
        ),
        End::new(UnitQuaternion::identity(), Vector3::new(1.0, 2.0, 0.0)),
    )
}

fn assert_gradient(gradient: Gradient, from: [f64; 6], to: [f64; 6]) {
    assert!(
        (gradient.from - Vector6::from(from)).norm() < 1e-12,
        "from {}",
        gradient.from
    );
    assert!(
        (gradient.to - Vector6::from(to)).norm() < 1e-12,
        "to {}",
        gradient.to
    );
}

#[test]
fn orientation_by_hand() {
    // R_i^T R_j is a turn of -90 degrees about z; measured as -90 + 0.1 rad: phi = (0, 0, -0.1).
    let (from, to) = by_hand();
    let seen = Orientation::new(so3::exp(&Vector3::new(0.0, 0.0, 0.1 - FRAC_PI_2))).unwrap();
    assert!((seen.residual(&from, &to) - Vector3::new(0.0, 0.0, -0.1)).norm() < 1e-15);
    assert!((seen.cost(&from, &to) - 0.01).abs() < 1e-15);
    assert_gradient(
        seen.gradient(&from, &to),
        [0.0, 0.0, 0.2, 0.0, 0.0, 0.0],
        [0.0, 0.0, -0.2, 0.0, 0.0, 0.0],
    );
}

#[test]
fn position_by_hand() {
    // Measured (2, 1, 0) where (2, 0, 0) is: residual (0, 1, 0), which is (-1, 0, 0) in the world.
    let (from, to) = by_hand();
    let seen = Position::new(Vector3::new(2.0, 1.0, 0.0)).unwrap();
    assert!((seen.residual(&from, &to) - Vector3::y()).norm() < 1e-15);
    assert!((seen.cost(&from, &to) - 1.0).abs() < 1e-15);
    // w_i = 2 v x that = 2 (2,0,0) x (2,1,0) = (0,0,4).
    assert_gradient(
        seen.gradient(&from, &to),
        [0.0, 0.0, 4.0, -2.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 2.0, 0.0, 0.0],
    );
}

#[test]
fn pose_by_hand() {
    let (from, to) = by_hand();
    let relative = Transform::new(
        so3::exp(&Vector3::new(0.0, 0.0, 0.1 - FRAC_PI_2)),
        Vector3::new(2.0, 1.0, 0.0),
    );
    let seen = Pose::new(relative).unwrap();
    assert!(
        (seen.residual(&from, &to) - Vector6::new(0.0, 0.0, -0.1, 0.0, 1.0, 0.0)).norm() < 1e-15
    );
    assert!((seen.cost(&from, &to) - 1.01).abs() < 1e-15);
    assert_gradient(
        seen.gradient(&from, &to),
        [0.0, 0.0, 4.2, -2.0, 0.0, 0.0],
        [0.0, 0.0, -0.2, 2.0, 0.0, 0.0],
    );
    // As a twist: the rotation is the same, the shift is Jl^-1 Rhat^T (v - that), of length a little above one.
    let twist = seen.twist_residual(&from, &to);
    assert!((twist.fixed_rows::<3>(0) - Vector3::new(0.0, 0.0, -0.1)).norm() < 1e-15);
    // At an angle a in the plane |Jl^-1 x| = |x| (a/2)/sin(a/2).
    assert!((twist.fixed_rows::<3>(3).norm() - 0.05 / 0.05_f64.sin()).abs() < 1e-14);
}

#[test]
fn bearing_by_hand() {
    // Seen along (0, 1, 0) where (1, 0, 0) is, at 2 m: residual (0, 2, 0) - (2, 0, 0).
    let (from, to) = by_hand();
    let seen = Bearing::new(Vector3::y()).unwrap();
    assert!((seen.residual(&from, &to) - Vector3::new(-2.0, 2.0, 0.0)).norm() < 1e-15);
    assert!((seen.cost(&from, &to) - 8.0).abs() < 1e-14);
    // w_i = 2 rho v x tau = 4 (0,0,2); R_i tau = (-1,0,0), tau.v = 0: delta_j = 2 [(0,4,0) + (2,0,0)].
    assert_gradient(
        seen.gradient(&from, &to),
        [0.0, 0.0, 8.0, -4.0, -8.0, 0.0],
        [0.0, 0.0, 0.0, 4.0, 8.0, 0.0],
    );
    assert!((seen.residual_on_sphere(&from, &to) - Vector3::new(-1.0, 1.0, 0.0)).norm() < 1e-15);
}

#[test]
fn distance_by_hand() {
    let (from, to) = by_hand();
    let seen = Distance::new(5.0).unwrap();
    assert!((seen.residual(&from, &to) - 3.0).abs() < 1e-15);
    assert!((seen.cost(&from, &to) - 9.0).abs() < 1e-14);
    assert_gradient(
        seen.gradient(&from, &to),
        [0.0, 0.0, 0.0, 0.0, 6.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, -6.0, 0.0],
    );
}

#[test]
fn what_is_no_measurement_is_refused_with_its_reason() {
    let nan = Vector3::new(0.0, f64::NAN, 0.0);
    let stretched = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(2.0, 0.0, 0.0, 0.0));
    let broken = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(f64::NAN, 0.0, 0.0, 0.0));
    assert!(matches!(
        Measurement::position(nan),
        Err(Refusal::NotFinite { .. })
    ));
    assert!(matches!(
        Measurement::bearing(nan),
        Err(Refusal::NotFinite { .. })
    ));
    assert!(matches!(
        Measurement::distance(f64::INFINITY),
        Err(Refusal::NotFinite { .. })
    ));
    assert!(matches!(
        Measurement::orientation(broken),
        Err(Refusal::NotFinite { .. })
    ));
    assert!(matches!(
        Measurement::orientation(stretched),
        Err(Refusal::NotUnit { .. })
    ));
    assert!(matches!(
        Measurement::bearing(Vector3::zeros()),
        Err(Refusal::NotUnit { .. })
    ));
    assert!(matches!(
        Measurement::pose(Transform::new(stretched, Vector3::zeros())),
        Err(Refusal::NotUnit { .. })
    ));
    assert!(matches!(
        Measurement::pose(Transform::new(UnitQuaternion::identity(), nan)),
        Err(Refusal::NotFinite { .. })
    ));
    assert_eq!(
        Measurement::distance(-0.1),
        Err(Refusal::NegativeDistance { metres: -0.1 })
    );
    assert!(matches!(
        Measurement::distance(2e6),
        Err(Refusal::TooFar { .. })
    ));
    assert!(matches!(
        Measurement::position(Vector3::new(1e200, 0.0, 0.0)),
        Err(Refusal::TooFar { .. })
    ));
    assert!(Measurement::distance(0.0).is_ok());
    assert!(Measurement::distance(RANGE_LIMIT_M).is_ok());
}

#[test]
fn only_the_noise_that_a_kind_uses_is_looked_at() {
    let angular = Noise {
        rotation_rad: 0.1,
        translation: f64::NAN,
    };
    assert!(angular.check(Kind::Bearing).is_ok());
    assert!(angular.check(Kind::Orientation).is_ok());
    assert_eq!(
        angular.check(Kind::Distance),
        Err(Refusal::BadNoise {
            kind: Kind::Distance
        })
    );
    assert_eq!(
        angular.check(Kind::Pose),
        Err(Refusal::BadNoise { kind: Kind::Pose })
    );
    let exact = Noise {
        rotation_rad: 0.0,
        translation: 0.0,
    };
    assert_eq!(
        exact.check(Kind::Bearing),
        Err(Refusal::BadNoise {
            kind: Kind::Bearing
        })
    );
}
