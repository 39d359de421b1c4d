//! How far estimated trajectories are from the truth: of a team at every instant, and of one vehicle over time.

mod alignment;

pub use alignment::{Space, align};

use crate::truth::{Pose, relative_position_m, wrapped_rad, yaw_rad};
use crate::tum::StampedPose;
use crate::world::transform;
use nalgebra::{Matrix3, Matrix6, Vector3};
use skein_estimation::{Body, Transform, se3};
use skein_proto::document::CovarianceDocument;

/// One vehicle's true and estimated pose at one instant, both `world_from_body`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scored {
    /// The truth.
    pub truth: Pose,
    /// The estimate.
    pub estimate: Pose,
}

/// The errors of a team over many instants.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TeamScore {
    /// How many poses were scored.
    pub n_poses: usize,
    /// Root mean square of the position error, metres.
    pub position_rmse_m: f64,
    /// Mean of the position error's length, metres.
    pub position_mean_m: f64,
    /// Root mean square of the heading (yaw) error, radians.
    pub heading_rmse_rad: f64,
    /// Root mean square of the whole attitude's error, radians.
    pub orientation_rmse_rad: f64,
    /// Root mean square of the position error after the team was moved onto the truth rigidly at each instant, metres:
    /// the error of its shape. NaN when no instant has two vehicles.
    pub instant_rmse_m: f64,
    /// Root mean square of the error of j's position in i's frame over all ordered pairs, metres; NaN likewise.
    pub relative_rmse_m: f64,
}

/// Scores a team: each instant holds, for every vehicle, its poses or nothing when it cannot be scored there (no
/// truth, no estimate). None when there is no pose at all.
#[must_use]
pub fn score_team(instants: &[Vec<Option<Scored>>], space: Space) -> Option<TeamScore> {
    let mut position = Mean::default();
    let mut position_squared = Mean::default();
    let mut heading_squared = Mean::default();
    let mut orientation_squared = Mean::default();
    let mut instant_squared = Mean::default();
    let mut relative_squared = Mean::default();
    for instant in instants {
        let scored: Vec<Scored> = instant.iter().flatten().copied().collect();
        for Scored { truth, estimate } in &scored {
            let error_m = (estimate.translation.vector - truth.translation.vector).norm();
            position.add(error_m);
            position_squared.add(error_m.powi(2));
            heading_squared.add(wrapped_rad(yaw_rad(estimate) - yaw_rad(truth)).powi(2));
            orientation_squared.add(truth.rotation.angle_to(&estimate.rotation).powi(2));
        }
        if scored.len() < 2 {
            continue;
        }
        let truths: Vec<Vector3<f64>> = scored
            .iter()
            .map(|pair| pair.truth.translation.vector)
            .collect();
        let estimates: Vec<Vector3<f64>> = scored
            .iter()
            .map(|pair| pair.estimate.translation.vector)
            .collect();
        let truth_from_estimate = align(&estimates, &truths, space);
        for (estimate, truth) in estimates.iter().zip(&truths) {
            let moved = truth_from_estimate * nalgebra::Point3::from(*estimate);
            instant_squared.add((moved.coords - truth).norm_squared());
        }
        for (i, from) in scored.iter().enumerate() {
            for (_, to) in scored.iter().enumerate().filter(|(j, _)| *j != i) {
                let truth = relative_position_m(&from.truth, &to.truth);
                let estimate = relative_position_m(&from.estimate, &to.estimate);
                relative_squared.add((estimate - truth).norm_squared());
            }
        }
    }
    (position.n > 0).then(|| TeamScore {
        n_poses: position.n,
        position_rmse_m: position_squared.value().sqrt(),
        position_mean_m: position.value(),
        heading_rmse_rad: heading_squared.value().sqrt(),
        orientation_rmse_rad: orientation_squared.value().sqrt(),
        instant_rmse_m: instant_squared.value().sqrt(),
        relative_rmse_m: relative_squared.value().sqrt(),
    })
}

/// A published covariance of a pose as a matrix: of a twist on the body's side, rotation (rad) before translation (m).
/// None when the numbers are not as many as a triangle has.
#[must_use]
pub fn covariance_of(document: &CovarianceDocument) -> Option<Matrix6<f64>> {
    let numbers = &document.body_twist_rotation_first;
    let upper = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    let mut matrix = Matrix6::zeros();
    for ((row, column), number) in upper.zip(numbers) {
        matrix[(row, column)] = *number;
        matrix[(column, row)] = *number;
    }
    (numbers.len() == 21).then_some(matrix)
}

/// Squared error of a pose by its covariance, a degree of freedom: heading and two lengths, for what keeps to the floor.
/// The covariance is of a twist on the body's side, rotation (rad) before translation (m). None when it has no inverse.
#[must_use]
pub fn planar_nees(estimate: &Pose, covariance: &Matrix6<f64>, truth: &Pose) -> Option<f64> {
    /// Rotation about z, translation along x and y.
    const PLANAR: [usize; 3] = [2, 3, 4];
    let off: Transform<Body, Body> = transform(&(estimate.inverse() * truth));
    let error = se3::log(&off);
    let error = Vector3::from_fn(|row, _| error[PLANAR[row]]);
    let covariance = Matrix3::from_fn(|row, column| covariance[(PLANAR[row], PLANAR[column])]);
    Some(error.dot(&(covariance.try_inverse()? * error)) / PLANAR.len() as f64)
}

/// The absolute trajectory error of one estimated trajectory.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TrajectoryScore {
    /// How many poses found a true pose near in time.
    pub n_matches: usize,
    /// Root mean square of the position error after rigid alignment, metres.
    pub rmse_m: f64,
    /// Mean of the position error's length after rigid alignment, metres.
    pub mean_m: f64,
    /// Its largest value, metres.
    pub max_m: f64,
}

/// The absolute trajectory error after rigid alignment (no scale), with every pose of the shorter trajectory matched
/// to the other's nearest in time, at most `apart_s_max` apart. Both must be in the order of time. None when fewer than
/// three match.
#[must_use]
pub fn absolute_trajectory_error(
    truth: &[StampedPose],
    estimate: &[StampedPose],
    apart_s_max: f64,
) -> Option<TrajectoryScore> {
    let matched: Vec<(Vector3<f64>, Vector3<f64>)> = if estimate.len() <= truth.len() {
        nearest_in_time(estimate, truth, apart_s_max)
    } else {
        nearest_in_time(truth, estimate, apart_s_max)
            .into_iter()
            .map(|(truth, estimate)| (estimate, truth))
            .collect()
    };
    if matched.len() < 3 {
        return None;
    }
    let (estimates, truths): (Vec<_>, Vec<_>) = matched.into_iter().unzip();
    let truth_from_estimate = align(&estimates, &truths, Space::Spatial);
    let errors_m = estimates.iter().zip(&truths).map(|(estimate, truth)| {
        ((truth_from_estimate * nalgebra::Point3::from(*estimate)).coords - truth).norm()
    });
    let n = truths.len() as f64;
    Some(TrajectoryScore {
        n_matches: truths.len(),
        rmse_m: (errors_m.clone().map(|error_m| error_m.powi(2)).sum::<f64>() / n).sqrt(),
        mean_m: errors_m.clone().sum::<f64>() / n,
        max_m: errors_m.fold(0.0, f64::max),
    })
}

/// For every pose of `of` the position of the nearest in time of `among`, if that is near enough.
fn nearest_in_time(
    of: &[StampedPose],
    among: &[StampedPose],
    apart_s_max: f64,
) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let mut matches = Vec::new();
    for pose in of {
        let next = among.partition_point(|other| other.time_s < pose.time_s);
        let around = &among[next.saturating_sub(1)..among.len().min(next + 1)];
        let apart_s = |other: &StampedPose| (other.time_s - pose.time_s).abs();
        let nearest = around
            .iter()
            .min_by(|a, b| apart_s(a).total_cmp(&apart_s(b)));
        if let Some(nearest) = nearest.filter(|other| apart_s(other) <= apart_s_max) {
            matches.push((
                pose.pose.translation.vector,
                nearest.pose.translation.vector,
            ));
        }
    }
    matches
}

/// A mean that is built up value by value; NaN of none.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f64,
    n: usize,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.n += 1;
    }

    fn value(&self) -> f64 {
        self.sum / self.n as f64
    }
}

#[cfg(test)]
mod tests;
