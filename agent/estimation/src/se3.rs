//! SE(3): exponential and logarithm between transforms and twists (rotation first, then translation), with the
//! Jacobians between the two, and the constant-twist path between two poses.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::so3;
use crate::transform::Transform;

/// Below this angle the coefficients of the coupling block come from their series: the closed forms divide by its
/// fifth power.
const SERIES_BELOW_ANGLE_RAD: f64 = 0.5;

/// The transform reached by following the twist `(w, v)` for unit time: rotation `exp(w)`, translation `Jl(w) v`.
#[must_use]
pub fn exp<To, From>(twist: &Vector6<f64>) -> Transform<To, From> {
    let (w, v) = split(twist);
    Transform::new(so3::exp(&w), so3::left_jacobian(&w) * v)
}

/// The twist `(w, v)` of a transform, with `|w|` in [0, pi].
#[must_use]
pub fn log<To, From>(transform: &Transform<To, From>) -> Vector6<f64> {
    let w = so3::log(&transform.rotation);
    join(
        &w,
        &(so3::left_jacobian_inverse(&w) * transform.translation),
    )
}

/// The adjoint: `T exp(x) = exp(Ad(T) x) T`.
#[must_use]
pub fn adjoint<To, From>(transform: &Transform<To, From>) -> Matrix6<f64> {
    let rotation = transform.rotation.to_rotation_matrix().into_inner();
    lower_triangular(&rotation, &(so3::hat(&transform.translation) * rotation))
}

/// `Jl(x)` with `exp(x + d) = exp(Jl(x) d) exp(x)` to first order.
#[must_use]
pub fn left_jacobian(twist: &Vector6<f64>) -> Matrix6<f64> {
    let (w, v) = split(twist);
    lower_triangular(&so3::left_jacobian(&w), &coupling(&w, &v))
}

/// `Jr(x)` with `exp(x + d) = exp(x) exp(Jr(x) d)` to first order.
#[must_use]
pub fn right_jacobian(twist: &Vector6<f64>) -> Matrix6<f64> {
    left_jacobian(&-twist)
}

/// The inverse of [`left_jacobian`]; finite for every angle below 2 pi.
#[must_use]
pub fn left_jacobian_inverse(twist: &Vector6<f64>) -> Matrix6<f64> {
    let (w, v) = split(twist);
    let inverse = so3::left_jacobian_inverse(&w);
    lower_triangular(&inverse, &(-inverse * coupling(&w, &v) * inverse))
}

/// The inverse of [`right_jacobian`]: the derivative of `log(T exp(d))` at `x = log(T)`.
#[must_use]
pub fn right_jacobian_inverse(twist: &Vector6<f64>) -> Matrix6<f64> {
    left_jacobian_inverse(&-twist)
}

/// The pose at `fraction` of the way from `a` (0) to `b` (1), along the path of constant body twist.
///
/// Fractions outside [0, 1] continue the same twist. Half a turn between `a` and `b` is ambiguous; the way round is
/// then the one of [`so3::log`].
#[must_use]
pub fn interpolate<To, From>(
    a: &Transform<To, From>,
    b: &Transform<To, From>,
    fraction: f64,
) -> Transform<To, From> {
    let twist = log(&(a.inverse() * *b));
    *a * exp(&(twist * fraction))
}

fn split(twist: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (
        twist.fixed_rows::<3>(0).into_owned(),
        twist.fixed_rows::<3>(3).into_owned(),
    )
}

fn join(w: &Vector3<f64>, v: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(w.x, w.y, w.z, v.x, v.y, v.z)
}

/// `[[diagonal, 0], [corner, diagonal]]`.
fn lower_triangular(diagonal: &Matrix3<f64>, corner: &Matrix3<f64>) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(diagonal);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(diagonal);
    matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(corner);
    matrix
}

/// How a rotation increment bends the translation in `Jl`: the block usually called Q (Barfoot, State Estimation for
/// Robotics, eq. 7.86).
fn coupling(w: &Vector3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
    let s = w.norm_squared();
    let angle = s.sqrt();
    // c1 = (a - sin a)/a^3, c2 = (a^2/2 + cos a - 1)/a^4, c3 = (c2 + 3 (a - sin a - a^3/6)/a^5) / 2.
    let (c1, c2, c3) = if angle < SERIES_BELOW_ANGLE_RAD {
        (
            (1.0 - s / 20.0
                * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0 * (1.0 - s / 156.0)))))
                / 6.0,
            (1.0 - s / 30.0
                * (1.0 - s / 56.0 * (1.0 - s / 90.0 * (1.0 - s / 132.0 * (1.0 - s / 182.0)))))
                / 24.0,
            // The sum of the two series, term by term: 1/120 - s/2520 + s^2/120960 - s^3/9979200 + ...
            1.0 / 120.0 - s / 2520.0 + s * s / 120_960.0 - s * s * s / 9_979_200.0
                + s * s * s * s / 1_245_404_160.0,
        )
    } else {
        let (sine, cosine) = angle.sin_cos();
        let c2 = (0.5 * s + cosine - 1.0) / (s * s);
        let c = (angle - sine - angle * s / 6.0) / (s * s * angle);
        ((angle - sine) / (s * angle), c2, 0.5 * (c2 + 3.0 * c))
    };
    let (w, v) = (so3::hat(w), so3::hat(v));
    let (wv, vw) = (w * v, v * w);
    let wvw = wv * w;
    0.5 * v + c1 * (wv + vw + wvw) + c2 * (w * wv + vw * w - 3.0 * wvw) + c3 * (wvw * w + w * wvw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lie_laws::lie_laws;
    use crate::transform::World;

    type Element = Transform<World, World>;

    lie_laws! {
        group: Element,
        dimension: 6,
        exp: |x: &Vector6<f64>| exp::<World, World>(x),
        log: |g: &Element| log(g),
        compose: |a: &Element, b: &Element| *a * *b,
        inverse: |a: &Element| a.inverse(),
        right_jacobian: |x: &Vector6<f64>| right_jacobian(x),
        right_jacobian_inverse: |x: &Vector6<f64>| right_jacobian_inverse(x),
        left_jacobian: |x: &Vector6<f64>| left_jacobian(x),
        left_jacobian_inverse: |x: &Vector6<f64>| left_jacobian_inverse(x),
    }

    #[test]
    fn a_quarter_circle_ends_where_the_circle_says() {
        // Radius 2 m, a quarter turn to the left at arc length pi: ends at (2, 2), heading +y.
        let twist = Vector6::new(
            0.0,
            0.0,
            std::f64::consts::FRAC_PI_2,
            std::f64::consts::PI,
            0.0,
            0.0,
        );
        let end: Element = exp(&twist);
        assert!((end.translation - Vector3::new(2.0, 2.0, 0.0)).norm() < 1e-14);
    }

    #[test]
    fn the_adjoint_moves_a_twist_from_the_right_to_the_left() {
        let transform: Element = exp(&Vector6::new(0.4, -0.7, 1.1, 3.0, -2.0, 0.5));
        let x = Vector6::new(0.1, 0.2, -0.3, 0.4, -0.5, 0.6);
        let right: Element = transform * exp::<World, World>(&x);
        let left: Element = exp::<World, World>(&(adjoint(&transform) * x)) * transform;
        assert!(log(&(right.inverse() * left)).norm() < 1e-13);
    }

    #[test]
    fn interpolation_starts_at_a_ends_at_b_and_keeps_one_twist() {
        let a: Element = exp(&Vector6::new(0.4, -0.7, 1.1, 3.0, -2.0, 0.5));
        let b: Element = exp(&Vector6::new(-0.2, 0.9, 0.1, 1.0, 2.0, -4.0));
        let apart = |p: &Element, q: &Element| log(&(p.inverse() * *q));
        assert!(apart(&interpolate(&a, &b, 0.0), &a).norm() < 1e-13);
        assert!(apart(&interpolate(&a, &b, 1.0), &b).norm() < 1e-13);
        let third = interpolate(&a, &b, 1.0 / 3.0);
        assert!((3.0 * apart(&a, &third) - apart(&a, &b)).norm() < 1e-12);
    }
}
