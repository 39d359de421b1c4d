//! Cramér-Rao bounds of where the other of a pair is and how it is turned, from distances and both odometries: of a window
//! of distances, and of all of them one after the other. Linearised at the truth: they know neither of wrong minima nor of
//! anything else that is not near.
//!
//! Information is of three numbers: where the other is for the one that localises, in that one's newest frame but along
//! the axes of the world (x, y, m), and how it is turned against that one (rad). So a turn of the frame turns nothing
//! here, and with `a`, `b` the places of both and `n` the direction from `a` to `b`, `z x (x, y) = (-y, x)`:
//!
//! ```text
//! distance   d = |b - a|:            dd/dp = n          dd/dphi = 0
//! motion     a -> a', b -> b':       dp' = dp + z x (b' - b) dphi - t_a + t_b - z x (b' - a') w_a
//!                                    dphi' = dphi + w_b - w_a
//! ```
//!
//! where `t`, `w` are the errors of the odometries.

use super::pair::Places;
use crate::planar_swarm::SwarmNoise;
use nalgebra::{DMatrix, Matrix3, Vector2, Vector3};
use std::f64::consts::PI;

/// What the least square errors are that a Gaussian allows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeastSquares {
    /// Of the position, with the bearing going around (m^2): never more than anywhere on the circle.
    pub position_m2: f64,
    /// Of the position along the tangent (m^2): the trace of the covariance, without limit.
    pub tangent_m2: f64,
    /// Of the orientation, which goes around (rad^2): never more than that of any angle.
    pub orientation_rad2: f64,
}

/// Numbers of a pose in the plane.
pub const UNKNOWNS: usize = 3;

/// Information that is none but makes every matrix invertible (per rad^2).
const NONE: f64 = 1e-6;

/// The information (1/m^2, 1/(m rad), 1/rad^2) of a window of distances, oldest first, at its newest: equation 2 of
/// Cornejo & Nagpal, `d_j = |p + R(phi) v_j - u_j|`, where the errors of both odometries, which add up backwards, are
/// part of the noise: `H^T S^-1 H`. As both odometries say nothing else, nothing is lost by that.
#[must_use]
pub fn windowed(window: &[Places], noise: &SwarmNoise) -> Matrix3<f64> {
    let count = window.len();
    let sights: Vec<Vector2<f64>> = window.iter().map(line_of_sight).collect();
    // How the distance j changes when a robot's odometry turns by more about its place at i.
    let lever = |robot: usize, j: usize, i: usize| {
        let arm_m = window[j][robot].position_m - window[i][robot].position_m;
        sights[j].dot(&quarter_turned(&arm_m))
    };
    let h = DMatrix::from_fn(count, UNKNOWNS, |j, number| match number {
        0 | 1 => sights[j][number],
        _ => lever(1, j, count - 1),
    });
    // Both have made the motions after the later one of two distances since both.
    let s = DMatrix::from_fn(count, count, |j, l| {
        let measured = if j == l {
            variance(noise.range_sigma_m)
        } else {
            0.0
        };
        let moved = (j.max(l) + 1..count).map(|i| {
            let shifted = 2.0 * sights[j].dot(&sights[l]);
            let turned = lever(0, j, i) * lever(0, l, i) + lever(1, j, i) * lever(1, l, i);
            variance(noise.translation_sigma_m) * shifted
                + variance(noise.rotation_sigma_rad) * turned
        });
        measured + moved.sum::<f64>()
    });
    let solved = s.cholesky().map(|factor| h.transpose() * factor.solve(&h));
    solved.map_or_else(Matrix3::zeros, |solved| {
        symmetric(&solved.fixed_view::<3, 3>(0, 0).into_owned())
    })
}

/// The same after both have moved: `(F L^-1 F^T + Q)^-1`. Who stands still measures nothing wrong.
#[must_use]
pub fn moved(
    information: &Matrix3<f64>,
    before: &Places,
    now: &Places,
    noise: &SwarmNoise,
) -> Matrix3<f64> {
    let turned_m = quarter_turned(&(now[1].position_m - before[1].position_m));
    let mut backwards = Matrix3::identity();
    backwards[(0, 2)] = -turned_m.x;
    backwards[(1, 2)] = -turned_m.y;
    let carried = backwards.transpose() * information * backwards;
    let around_m = quarter_turned(&apart_m(now));
    // What a turn of either odometry does.
    let turns = [
        Vector3::new(-around_m.x, -around_m.y, -1.0),
        Vector3::new(0.0, 0.0, 1.0),
    ];
    let mut q = Matrix3::zeros();
    for (robot, turn) in turns.iter().enumerate() {
        if before[robot] != now[robot] {
            q += turn * turn.transpose() * variance(noise.rotation_sigma_rad);
            q[(0, 0)] += variance(noise.translation_sigma_m);
            q[(1, 1)] += variance(noise.translation_sigma_m);
        }
    }
    // (L^-1 + Q)^-1 = (1 + L Q)^-1 L, which asks for no inverse of what may be singular.
    let sum = Matrix3::identity() + carried * q;
    sum.try_inverse()
        .map_or_else(Matrix3::zeros, |inverse| symmetric(&(inverse * carried)))
}

/// The same after a distance.
#[must_use]
pub fn measured(information: &Matrix3<f64>, places: &Places, noise: &SwarmNoise) -> Matrix3<f64> {
    let sight = line_of_sight(places);
    let sight = Vector3::new(sight.x, sight.y, 0.0);
    information + sight * sight.transpose() / variance(noise.range_sigma_m)
}

/// The information at every distance of a filter that starts from what a window of the first so many says, and then takes
/// motion by motion and distance by distance. None before.
#[must_use]
pub fn recursive(way: &[Places], ranges: usize, noise: &SwarmNoise) -> Vec<Option<Matrix3<f64>>> {
    let mut information = None;
    let mut all = Vec::with_capacity(way.len());
    for (index, places) in way.iter().enumerate() {
        information = match information {
            Some(known) => {
                let carried = moved(&known, &way[index - 1], places, noise);
                Some(measured(&carried, places, noise))
            }
            None if index + 1 >= ranges => Some(windowed(&way[..=index], noise)),
            None => None,
        };
        all.push(information);
    }
    all
}

/// The least mean square errors with some information, for places of that truth. The Gaussian is one of distance,
/// bearing and orientation, in which what a few distances leave open is straight: of a bearing of variance `s`, the mean
/// square error across is `2 d^2 (1 - exp(-s / 2))`.
#[must_use]
pub fn least_squares(information: &Matrix3<f64>, truth: &Places) -> LeastSquares {
    let apart_m = apart_m(truth);
    let distance_m = apart_m.norm();
    let along = line_of_sight(truth);
    let across_m = quarter_turned(&apart_m);
    let position_by_polar = Matrix3::new(
        along.x, across_m.x, 0.0, along.y, across_m.y, 0.0, 0.0, 0.0, 1.0,
    );
    let polar = position_by_polar.transpose() * information * position_by_polar;
    let unsaid = Matrix3::from_diagonal(&Vector3::new(NONE, NONE, NONE));
    let variances = (polar + unsaid)
        .cholesky()
        .map_or(Vector3::repeat(1.0 / NONE), |factor| {
            factor.inverse().diagonal()
        });
    let square_m2 = distance_m * distance_m;
    LeastSquares {
        position_m2: variances.x + 2.0 * square_m2 * -(-0.5 * variances.y).exp_m1(),
        tangent_m2: variances.x + square_m2 * variances.y,
        orientation_rad2: wrapped_variance(variances.z),
    }
}

/// The mean square of an angle that goes around (rad^2), of which the variance would be this (rad^2) if it did not.
fn wrapped_variance(variance: f64) -> f64 {
    // Beyond six standard deviations nothing goes around.
    if variance < 0.25 {
        return variance;
    }
    // The wrapped normal's cosines, times those of the angle's square.
    let cosines = (1..=12).map(|n| {
        let n2 = f64::from(n * n);
        let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
        sign / n2 * (-0.5 * n2 * variance).exp()
    });
    PI * PI / 3.0 + 4.0 * cosines.sum::<f64>()
}

fn apart_m(places: &Places) -> Vector2<f64> {
    places[1].position_m - places[0].position_m
}

/// From the one that localises to the other; along x where both are at one place.
fn line_of_sight(places: &Places) -> Vector2<f64> {
    apart_m(places)
        .try_normalize(1e-9)
        .unwrap_or_else(Vector2::x)
}

fn quarter_turned(vector: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-vector.y, vector.x)
}

fn variance(sigma: f64) -> f64 {
    sigma * sigma
}

fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    0.5 * (matrix + matrix.transpose())
}

#[cfg(test)]
mod tests;
