//! Where descents begin, so that the best minimum is among those that they end in.
//!
//! For a given yaw `psi`, differences of squared ranges are linear in the position: with `a_j = R dv_j - du_j` against a
//! range taken as reference and `q = p + R v - u` there, `q . a_j = b_j = (d_j^2 - d^2 - |a_j|^2) / 2`. Two such
//! equations in the plane, three in space, give `q = N(psi) / D(psi)`, and `|N|^2 = d^2 D^2` leaves a polynomial in
//! `e^{i psi}`: of degree six from three ranges in the plane, of degree eight from four in space.

mod closed_form;

use super::geometry::Geometry;
use super::{Dimension, Loss, RelativePose, WindowSettings};
use crate::ranging::pose::turned;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{PI, TAU};

/// Most sets of ranges that are solved in closed form.
const SETS_MAX: usize = 5;
/// The same when some ranges may be wrong: for any one of them there must be a set without it.
const SETS_MAX_ROBUST: usize = 10;
/// Yaws of the scan.
const SCAN: usize = 36;
/// Bearings and yaws of the grid.
const GRID: usize = 6;

/// All starts of an exhaustive search.
pub(super) fn exhaustive(
    geometry: &Geometry,
    settings: &WindowSettings,
    start: &mut impl FnMut(&RelativePose),
) {
    let sets = if settings.loss == Loss::Square {
        SETS_MAX
    } else {
        SETS_MAX_ROBUST
    };
    closed_form::starts(geometry, settings.dimension, sets, start);
    scan(geometry, settings, start);
    grid(geometry, settings, GRID, start);
}

/// At so many bearings and yaws, at the newest range.
pub(super) fn grid(
    geometry: &Geometry,
    settings: &WindowSettings,
    side: usize,
    start: &mut impl FnMut(&RelativePose),
) {
    let elevations_rad: &[f64] = match settings.dimension {
        Dimension::Planar => &[0.0],
        Dimension::Spatial => &[-0.9, 0.0, 0.9],
    };
    for elevation in elevations_rad {
        let (sin, cos) = elevation.sin_cos();
        for i in 0..side {
            let bearing = TAU * i as f64 / side as f64;
            let across = Vector3::new(cos * bearing.cos(), cos * bearing.sin(), sin);
            for k in 0..side {
                let yaw = TAU * (k as f64 + 0.5) / side as f64;
                start(&RelativePose::new(across * geometry.newest_m(), yaw));
            }
        }
    }
}

/// For each of many yaws the position that all differences of squared ranges fit best; of these, where the ranges
/// themselves fit better than at the yaws beside.
fn scan(geometry: &Geometry, settings: &WindowSettings, start: &mut impl FnMut(&RelativePose)) {
    let mut poses = [RelativePose::new(Vector3::zeros(), 0.0); SCAN];
    let mut misfit = [f64::INFINITY; SCAN];
    for i in 0..SCAN {
        let yaw = TAU * i as f64 / SCAN as f64 - PI;
        if let Some(position) = fitted(geometry, settings.dimension, yaw) {
            poses[i] = RelativePose::new(position, yaw);
            misfit[i] = misfit_of(geometry, &poses[i]);
        }
    }
    for i in 0..SCAN {
        let (before, after) = (misfit[(i + SCAN - 1) % SCAN], misfit[(i + 1) % SCAN]);
        if misfit[i].is_finite() && misfit[i] <= before && misfit[i] < after {
            start(&poses[i]);
        }
    }
}

/// The position (m) that fits the differences of squared ranges to the newest best, brought to the newest range.
fn fitted(geometry: &Geometry, dimension: Dimension, yaw_rad: f64) -> Option<Vector3<f64>> {
    let mut normal = Matrix3::identity() * 1e-6;
    let mut right = Vector3::zeros();
    let newest = geometry.newest_m();
    for j in 0..geometry.count - 1 {
        let apart = turned(&geometry.neighbour[j].place_m, yaw_rad) - geometry.own[j].place_m;
        let difference =
            0.5 * (geometry.range_m[j].powi(2) - newest.powi(2) - apart.norm_squared());
        normal += apart * apart.transpose();
        right += apart * difference;
    }
    if dimension == Dimension::Planar {
        normal[(2, 2)] = 1.0;
    }
    let position = normal.cholesky()?.solve(&right);
    let length = position.norm();
    (length > 1e-9 && length.is_finite()).then(|| position * (newest / length))
}

/// Squared residuals over variances, each bounded so that a few wrong ranges do not hide a fit.
fn misfit_of(geometry: &Geometry, pose: &RelativePose) -> f64 {
    (0..geometry.count)
        .map(|j| {
            let apart = pose.position_m + turned(&geometry.neighbour[j].place_m, pose.yaw_rad)
                - geometry.own[j].place_m;
            let square = (geometry.range_m[j] - apart.norm()).powi(2) / geometry.apart_m2[j];
            square / (1.0 + square / 400.0)
        })
        .sum()
}
