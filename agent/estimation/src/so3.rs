//! SO(3): exponential and logarithm between unit quaternions and rotation vectors (radians), and the Jacobians between
//! the two. Knows nothing of frames; `transform.rs` adds those.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Below this squared angle the closed forms are replaced by their series: there `1 - cos` has lost half its digits.
const SERIES_BELOW_ANGLE_SQUARED: f64 = 0.04;

/// The rotation by `|w|` radians about `w`.
#[must_use]
pub fn exp(w: &Vector3<f64>) -> UnitQuaternion<f64> {
    // sin(h)/h and cos(h) with h = |w|/2; the series are exact to the last digit below h = 0.1.
    let s = 0.25 * w.norm_squared();
    let (cosine, sine_over_half) = if s < 0.01 {
        (
            1.0 - s / 2.0
                * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0)))),
            1.0 - s / 6.0
                * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))),
        )
    } else {
        let half = s.sqrt();
        (half.cos(), half.sin() / half)
    };
    let vector = w * (0.5 * sine_over_half);
    UnitQuaternion::new_unchecked(Quaternion::from_parts(cosine, vector))
}

/// The rotation vector of `rotation`, with length in [0, pi].
///
/// Exact to rounding near zero and near pi. At pi itself the two opposite vectors describe one rotation; the one along
/// the stored quaternion's vector part is given, so the answer is finite and the same every time.
#[must_use]
pub fn log(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let vector = rotation.imag();
    let (scalar, vector) = if rotation.w < 0.0 {
        (-rotation.w, -vector)
    } else {
        (rotation.w, vector)
    };
    // angle / sin(angle / 2). Near zero the series of 2 asin(x)/x, to the last digit below x = 0.1.
    let s = vector.norm_squared();
    let scale = if s < 0.01 {
        let series = 1.0
            + s * (1.0 / 6.0
                + s * (3.0 / 40.0
                    + s * (5.0 / 112.0
                        + s * (35.0 / 1152.0
                            + s * (63.0 / 2816.0
                                + s * (231.0 / 13_312.0 + s * 143.0 / 10_240.0))))));
        2.0 * series
    } else {
        let sine = s.sqrt();
        2.0 * sine.atan2(scalar) / sine
    };
    vector * scale
}

/// The matrix of the cross product: `hat(a) b = a x b`.
#[must_use]
pub fn hat(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// `Jl(w)` with `exp(w + d) = exp(Jl(w) d) exp(w)` to first order.
#[must_use]
pub fn left_jacobian(w: &Vector3<f64>) -> Matrix3<f64> {
    let (b, c) = jacobian_coefficients(w.norm_squared());
    polynomial(w, b, c)
}

/// `Jr(w)` with `exp(w + d) = exp(w) exp(Jr(w) d)` to first order.
#[must_use]
pub fn right_jacobian(w: &Vector3<f64>) -> Matrix3<f64> {
    let (b, c) = jacobian_coefficients(w.norm_squared());
    polynomial(w, -b, c)
}

/// The inverse of [`left_jacobian`]. Finite for every length below 2 pi, at pi too: there it is
/// `I - hat(w)/2 + hat(w)^2 / pi^2`.
#[must_use]
pub fn left_jacobian_inverse(w: &Vector3<f64>) -> Matrix3<f64> {
    polynomial(w, -0.5, inverse_coefficient(w.norm_squared()))
}

/// The inverse of [`right_jacobian`]: the derivative of `log(R exp(d))` at `w = log(R)`. Finite at pi too, as
/// [`left_jacobian_inverse`].
#[must_use]
pub fn right_jacobian_inverse(w: &Vector3<f64>) -> Matrix3<f64> {
    polynomial(w, 0.5, inverse_coefficient(w.norm_squared()))
}

/// `Jr^-T(w) Jr^-1(w)`, the normal matrix of a rotation residual: symmetric, and the same for the left Jacobian.
#[must_use]
pub fn right_jacobian_inverse_gram(w: &Vector3<f64>) -> Matrix3<f64> {
    // (I - W/2 + c W^2)(I + W/2 + c W^2) with W^4 = -|w|^2 W^2.
    let s = w.norm_squared();
    let c = inverse_coefficient(s);
    polynomial(w, 0.0, 2.0 * c - 0.25 - c * c * s)
}

/// `I + b hat(w) + c hat(w)^2`, with `hat(w)^2 = w w^T - |w|^2 I`.
fn polynomial(w: &Vector3<f64>, b: f64, c: f64) -> Matrix3<f64> {
    let diagonal = 1.0 - c * w.norm_squared();
    let (x, y, z) = (b * w.x, b * w.y, b * w.z);
    let (xy, xz, yz) = (c * w.x * w.y, c * w.x * w.z, c * w.y * w.z);
    Matrix3::new(
        diagonal + c * w.x * w.x,
        xy - z,
        xz + y,
        xy + z,
        diagonal + c * w.y * w.y,
        yz - x,
        xz - y,
        yz + x,
        diagonal + c * w.z * w.z,
    )
}

/// `(1 - cos a) / a^2` and `(a - sin a) / a^3`.
fn jacobian_coefficients(angle_squared: f64) -> (f64, f64) {
    let s = angle_squared;
    if s < SERIES_BELOW_ANGLE_SQUARED {
        (
            0.5 - s / 24.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0))),
            (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0,
        )
    } else {
        let angle = s.sqrt();
        ((1.0 - angle.cos()) / s, (angle - angle.sin()) / (s * angle))
    }
}

/// `1/a^2 - cot(a/2) / (2 a)`.
fn inverse_coefficient(angle_squared: f64) -> f64 {
    let s = angle_squared;
    if s < SERIES_BELOW_ANGLE_SQUARED {
        1.0 / 12.0 + s / 720.0 * (1.0 + s / 42.0 * (1.0 + s / 40.0 * (1.0 + s / 39.6)))
    } else {
        let half = 0.5 * s.sqrt();
        (1.0 - half / half.tan()) / s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lie_laws::lie_laws;

    lie_laws! {
        group: UnitQuaternion<f64>,
        dimension: 3,
        exp: |x: &SVector<f64, 3>| exp(x),
        log: |g: &UnitQuaternion<f64>| log(g),
        compose: |a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>| a * b,
        inverse: |a: &UnitQuaternion<f64>| a.inverse(),
        right_jacobian: |x: &SVector<f64, 3>| right_jacobian(x),
        right_jacobian_inverse: |x: &SVector<f64, 3>| right_jacobian_inverse(x),
        left_jacobian: |x: &SVector<f64, 3>| left_jacobian(x),
        left_jacobian_inverse: |x: &SVector<f64, 3>| left_jacobian_inverse(x),
    }

    #[test]
    fn the_hat_matrix_is_the_cross_product() {
        let (a, b) = (Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.5, 4.0, -1.0));
        assert!((hat(&a) * b - a.cross(&b)).norm() < 1e-15);
    }

    #[test]
    fn the_normal_matrix_is_the_product_of_the_jacobians() {
        for angle in [0.0, 1e-6, 0.1, 1.0, 3.0, std::f64::consts::PI] {
            let w = Vector3::new(0.6, -0.48, 0.64) * angle;
            let j = right_jacobian_inverse(&w);
            assert!((right_jacobian_inverse_gram(&w) - j.transpose() * j).norm() < 1e-13);
        }
    }

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let rotated = exp(&Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2)) * Vector3::x();
        assert!((rotated - Vector3::y()).norm() < 1e-15);
    }

    #[test]
    fn at_exactly_half_a_turn_everything_is_finite() {
        let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.6, 0.0, 0.8));
        let w = log(&half_turn);
        assert!((w - Vector3::new(0.6, 0.0, 0.8) * std::f64::consts::PI).norm() < 1e-12);
        let stated = Matrix3::identity() + 0.5 * hat(&w) + hat(&w) * hat(&w) / w.norm_squared();
        assert!((right_jacobian_inverse(&w) - stated).norm() < 1e-12);
    }
}
