//! One hypothesis against finite differences and against a linear answer.

use super::*;
use crate::mutual::filter::mixture::{Answer, Tempering};
use crate::mutual::propagation::propagated;

fn at(azimuth_rad: f64, zenith_rad: f64) -> Answer {
    Answer {
        direction: direction::from_angles(azimuth_rad, zenith_rad),
        yaw_rad: 1.1,
        covariance_rad2: Matrix3::new(0.01, 0.002, 0.0, 0.002, 0.006, 0.0, 0.0, 0.0, 0.02),
        log_likelihood: 0.0,
        own_feature: None,
    }
}

fn hypothesis() -> Hypothesis {
    let mixture = Mixture::new(&[at(0.4, 1.2)], &[], &Tempering::CAUTIOUS).unwrap();
    let mut new = Hypothesis::new(
        &mixture.components()[0],
        3.0f64.ln(),
        0.2,
        &BankSettings::QUADROTOR,
        1.0,
    );
    new.scaled_velocity = Vector3::new(0.2, -0.3, 0.1);
    new.bias_m_s2 = Vector3::new(0.05, -0.1, 0.02);
    new
}

fn motions() -> (Motion, Motion) {
    let motion = |by: f64| Motion {
        elapsed_s: 0.3,
        yaw_rad: 0.4 * by,
        velocity_m_s: Vector3::new(0.6, -0.4, 0.2) * by,
        position_m: Vector3::new(0.2, 0.3, -0.2) * by,
    };
    (motion(1.0), motion(-0.8))
}

fn stepped(from: &Hypothesis, i: usize, by: f64) -> Hypothesis {
    let mut stepped = from.clone();
    let mut error = Error::zeros();
    error[i] = by;
    stepped.step(&error);
    stepped
}

fn between(from: &Hypothesis, to: &Hypothesis) -> Error {
    let mut error = Error::zeros();
    error
        .fixed_rows_mut::<2>(0)
        .copy_from(&direction::difference(&from.direction, &to.direction));
    error[LOG_DISTANCE] = to.log_distance - from.log_distance;
    error
        .fixed_rows_mut::<3>(VELOCITY)
        .copy_from(&(to.scaled_velocity - from.scaled_velocity));
    error[YAW] = direction::wrapped(to.yaw_rad - from.yaw_rad);
    error
        .fixed_rows_mut::<3>(BIAS)
        .copy_from(&(to.bias_m_s2 - from.bias_m_s2));
    error
}

#[test]
fn the_derivative_of_a_step_is_that_of_finite_differences() {
    let hypothesis = hypothesis();
    let (own, neighbour) = motions();
    let (after, jacobian) = hypothesis.moved(&own, &neighbour, 10.0);
    for i in 0..N {
        let small = 1e-6;
        let (more, _) = stepped(&hypothesis, i, small).moved(&own, &neighbour, 10.0);
        let (less, _) = stepped(&hypothesis, i, -small).moved(&own, &neighbour, 10.0);
        let numeric = (between(&after, &more) - between(&after, &less)) / (2.0 * small);
        assert!((numeric - jacobian.column(i)).norm() < 1e-7, "column {i}");
    }
}

#[test]
fn without_bias_it_moves_as_the_state_does() {
    let mut hypothesis = hypothesis();
    hypothesis.bias_m_s2 = Vector3::zeros();
    let (own, neighbour) = motions();
    let expected = propagated(&hypothesis.relative(), &own, &neighbour);
    let moved = hypothesis.moved(&own, &neighbour, 10.0).0.relative();
    assert!((moved.position_m - expected.position_m).norm() < 1e-12);
    assert!((moved.velocity_m_s - expected.velocity_m_s).norm() < 1e-12);
    assert!((moved.yaw_rad - expected.yaw_rad).abs() < 1e-12);
}

#[test]
fn the_cartesian_covariance_is_that_of_finite_differences() {
    let hypothesis = hypothesis();
    let mut jacobian = SMatrix::<f64, 7, N>::zeros();
    for i in 0..N {
        let small = 1e-6;
        let (more, less) = (
            stepped(&hypothesis, i, small).relative(),
            stepped(&hypothesis, i, -small).relative(),
        );
        let mut column = SVector::<f64, 7>::zeros();
        column
            .fixed_rows_mut::<3>(0)
            .copy_from(&(more.position_m - less.position_m));
        column
            .fixed_rows_mut::<3>(3)
            .copy_from(&(more.velocity_m_s - less.velocity_m_s));
        column[6] = more.yaw_rad - less.yaw_rad;
        jacobian.set_column(i, &(column / (2.0 * small)));
    }
    let numeric = jacobian * hypothesis.covariance * jacobian.transpose();
    let difference = (numeric - hypothesis.covariance_of_relative()).norm();
    assert!(difference < 1e-6 * numeric.norm(), "{difference}");
}

#[test]
fn one_sure_answer_corrects_as_a_kalman_filter_does() {
    let mut hypothesis = hypothesis();
    let before = hypothesis.covariance;
    let answer = at(0.42, 1.22);
    let sure = Tempering {
        floor: 0.0,
        ..Tempering::CAUTIOUS
    };
    let measured = Mixture::new(&[answer], &[], &sure).unwrap();
    hypothesis.correct(&measured);
    // Direction and yaw start with the covariance that the answer has: half of it is left.
    for i in MEASURED {
        assert!((hypothesis.covariance[(i, i)] / before[(i, i)] - 0.5).abs() < 1e-3);
    }
    let left = direction::difference(&hypothesis.direction, &answer.direction);
    assert!((left.norm() - 0.5 * (0.02f64 * 1.2f64.sin()).hypot(0.02)).abs() < 1e-3);
}

#[test]
fn an_answer_elsewhere_changes_nothing_but_the_likelihood() {
    let mut hypothesis = hypothesis();
    let before = hypothesis.covariance;
    let measured = Mixture::new(&[at(2.5, 1.2)], &[], &Tempering::CAUTIOUS).unwrap();
    let corrected = hypothesis.correct(&measured);
    assert!((hypothesis.covariance - before).norm() < 1e-15);
    assert_eq!(corrected.likelihood, measured.floor_density());
}
