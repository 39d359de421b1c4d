//! Is the neighbour's place known now, and if not, what can it be confused with?
//!
//! A test of singular values alone sees no flip: each of two mirror images may be sharp.

use super::geometry::Geometry;
use super::modes::Modes;
use super::{RelativePose, WINDOW_MAX};
use crate::ranging::pose::{turned, wrapped};
use crate::ranging::trail::Past;
use nalgebra::Vector3;

/// What a neighbour's place is confused with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ambiguity {
    /// With its mirror image: both moved along straight lines, or one did while the other stood.
    Flip,
    /// With every place around: one stood still or moved as the other did.
    Rotation,
    /// With where the vehicle is for the neighbour: both moved alike, each in its own frame.
    Exchange,
    /// With another place for no simple reason: too few ranges, or too noisy ones.
    Several,
}

/// When a place counts as known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Criterion {
    /// The standard deviation of the position (m), from the information matrix, must be less.
    pub position_sigma_max_m: f64,
    /// The cost of the best other minimum must be so much more.
    pub cost_gap: f64,
    /// An angle less certain than this (rad) is any angle.
    pub any_angle_rad: f64,
}

impl Criterion {
    /// As simulated: one metre, and three standard deviations of one number.
    pub const DEFAULT: Self = Self {
        position_sigma_max_m: 1.0,
        cost_gap: 9.0,
        any_angle_rad: 0.6,
    };
}

/// Whether the neighbour's place is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Observability {
    /// Nothing is known: too few ranges.
    Unknown,
    /// It may be at several places.
    Ambiguous {
        /// Why.
        which: Ambiguity,
        /// How many minima fit about as well.
        modes: usize,
    },
    /// It is about at one place, but not to the precision asked for.
    Imprecise,
    /// It is at one place.
    Observable,
}

/// A motion of less than this times the variance of a range and both odometries is none.
const STILL: f64 = 9.0;

/// Why the two likeliest modes both fit, or why one that seems to fit alone does by accident.
pub(super) fn between(geometry: &Geometry, modes: &Modes) -> Ambiguity {
    let mut likeliest = modes.as_slice();
    if modes
        .best()
        .is_some_and(|best| is_still(geometry, best.pose.yaw_rad))
    {
        return Ambiguity::Rotation;
    }
    match (likeliest.next(), likeliest.next()) {
        (Some(best), Some(other)) => of_places(geometry, &best.pose, &other.pose),
        _ => Ambiguity::Several,
    }
}

/// Why two places both fit.
pub(super) fn of_places(
    geometry: &Geometry,
    best: &RelativePose,
    other: &RelativePose,
) -> Ambiguity {
    if is_near(&best.inverse(), other) {
        return Ambiguity::Exchange;
    }
    let flips = [mirrored(geometry, best), below(best)];
    let flipped = flips.iter().flatten().any(|flip| is_near(flip, other));
    if flipped {
        Ambiguity::Flip
    } else {
        Ambiguity::Several
    }
}

/// Whether one stood still or moved as the other did, as far as the noise lets tell: then noise alone seems to say where
/// the neighbour is.
fn is_still(geometry: &Geometry, yaw_rad: f64) -> bool {
    let still = |moved: &dyn Fn(usize) -> Vector3<f64>| {
        (0..geometry.count).all(|j| moved(j).norm_squared() < STILL * geometry.apart_m2[j])
    };
    let own = |j: usize| geometry.own[j].place_m;
    let neighbour = |j: usize| geometry.neighbour[j].place_m;
    let apart = |j: usize| turned(&neighbour(j), yaw_rad) - own(j);
    still(&own) || still(&neighbour) || still(&apart)
}

/// About the same place, as far as the noise that made it a little different may go.
fn is_near(a: &RelativePose, b: &RelativePose) -> bool {
    let off = (a.position_m - b.position_m).norm();
    off < 0.5 + 0.25 * a.distance_m() && wrapped(a.yaw_rad - b.yaw_rad).abs() < 0.5
}

/// The mirror image across the vertical plane along which the vehicle moved. None when it did not.
fn mirrored(geometry: &Geometry, pose: &RelativePose) -> Option<RelativePose> {
    let own = heading_rad(&geometry.own, geometry.count);
    let neighbour = heading_rad(&geometry.neighbour, geometry.count);
    let (line, yaw_rad) = match (own, neighbour) {
        (Some(own), Some(neighbour)) => (own, 2.0 * (own - neighbour) - pose.yaw_rad),
        (Some(own), None) => (own, pose.yaw_rad),
        // Seen along the line of the neighbour, the vehicle's place is mirrored.
        (None, Some(neighbour)) => (pose.yaw_rad + neighbour, pose.yaw_rad),
        (None, None) => return None,
    };
    let (sin, cos) = (2.0 * line).sin_cos();
    let place = &pose.position_m;
    let mirrored = Vector3::new(
        cos * place.x + sin * place.y,
        sin * place.x - cos * place.y,
        place.z,
    );
    Some(RelativePose::new(mirrored, yaw_rad))
}

/// The image below or above, when there is a height to mirror.
fn below(pose: &RelativePose) -> Option<RelativePose> {
    let height = pose.position_m.z;
    let mirrored = Vector3::new(pose.position_m.x, pose.position_m.y, -height);
    (height != 0.0).then(|| RelativePose::new(mirrored, pose.yaw_rad))
}

/// The direction of the line that fits the places best (rad). None when they are one place.
fn heading_rad(past: &[Past; WINDOW_MAX], count: usize) -> Option<f64> {
    let places = || past[..count].iter().map(|one| one.place_m.xy());
    let centre = places().sum::<nalgebra::Vector2<f64>>() / count as f64;
    let (mut along, mut across) = (0.0, 0.0);
    for place in places() {
        let off = place - centre;
        along += off.x * off.x - off.y * off.y;
        across += 2.0 * off.x * off.y;
    }
    let spread = along.hypot(across);
    (spread > 1e-4 * count as f64).then(|| 0.5 * across.atan2(along))
}
