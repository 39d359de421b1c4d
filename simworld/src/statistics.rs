//! What many repetitions of one flight say about the error of an estimate, every number by its own name. What the
//! figures of Knuth & Barooah call bias is the mean of |e|, not the length of the mean of e.

use crate::truth::Pose;
use nalgebra::Vector3;

/// The error of one estimated pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Estimate less truth, world frame, metres.
    pub position_m: Vector3<f64>,
    /// The angle between the two attitudes, radians, from 0 to pi.
    pub orientation_rad: f64,
}

impl PoseError {
    /// The error of `estimate` (both `world_from_body`).
    #[must_use]
    pub fn between(truth: &Pose, estimate: &Pose) -> Self {
        Self {
            position_m: estimate.translation.vector - truth.translation.vector,
            orientation_rad: truth.rotation.angle_to(&estimate.rotation),
        }
    }
}

/// The errors of n samples in a few numbers.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ErrorSummary {
    /// How many samples.
    pub n: usize,
    /// The mean of |e|, metres: what the paper's figures call bias.
    pub mean_norm_m: f64,
    /// The standard error of `mean_norm_m`, metres.
    pub mean_norm_stderr_m: f64,
    /// The square root of the trace of the covariance of e, metres: the paper's standard deviation.
    pub std_m: f64,
    /// The standard error of `std_m`, metres.
    pub std_stderr_m: f64,
    /// The root of the mean of |e|^2, metres.
    pub rmse_m: f64,
    /// The length of the mean of e, metres: what a statistician calls bias.
    pub norm_of_mean_m: f64,
    /// The mean angle between true and estimated attitude, radians.
    pub mean_orientation_rad: f64,
    /// The standard error of `mean_orientation_rad`, radians.
    pub mean_orientation_stderr_rad: f64,
}

impl ErrorSummary {
    /// The summary of independent samples; nothing of fewer than two, which have no spread.
    #[must_use]
    pub fn of(errors: &[PoseError]) -> Option<Self> {
        let n = errors.len();
        if n < 2 {
            return None;
        }
        let count = n as f64;
        let mean = errors
            .iter()
            .map(|error| error.position_m)
            .sum::<Vector3<f64>>()
            / count;
        let (mean_norm_m, mean_norm_stderr_m) =
            mean_and_stderr(errors.iter().map(|error| error.position_m.norm()));
        // tr cov is n/(n-1) times the mean of d = |e - mean|^2. Its standard error is that of the mean of d, and the
        // root's by the delta method: d sqrt(v) = dv / (2 sqrt(v)).
        let (mean_deviation, deviation_stderr) = mean_and_stderr(
            errors
                .iter()
                .map(|error| (error.position_m - mean).norm_squared()),
        );
        let std_m = (mean_deviation * count / (count - 1.0)).sqrt();
        let std_stderr_m = if std_m > 0.0 {
            deviation_stderr / (2.0 * std_m)
        } else {
            0.0
        };
        let mean_square = errors
            .iter()
            .map(|error| error.position_m.norm_squared())
            .sum::<f64>()
            / count;
        let (mean_orientation_rad, mean_orientation_stderr_rad) =
            mean_and_stderr(errors.iter().map(|error| error.orientation_rad));
        Some(Self {
            n,
            mean_norm_m,
            mean_norm_stderr_m,
            std_m,
            std_stderr_m,
            rmse_m: mean_square.sqrt(),
            norm_of_mean_m: mean.norm(),
            mean_orientation_rad,
            mean_orientation_stderr_rad,
        })
    }
}

/// The mean of at least two values and its standard error.
pub(crate) fn mean_and_stderr(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// The ratio of the sums of two lists, of which the nth numbers are of one repetition, and its standard error (delta
/// method). With counts below, it is a mean over groups of different size.
pub(crate) fn ratio_and_stderr(above: &[f64], below: &[f64]) -> (f64, f64) {
    let n = above.len().min(below.len()) as f64;
    let whole = below.iter().sum::<f64>();
    let ratio = above.iter().sum::<f64>() / whole;
    let off = above.iter().zip(below);
    let off = off.map(|(above, below)| (above - ratio * below).powi(2));
    (ratio, (off.sum::<f64>() * n / (n - 1.0)).sqrt() / whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use crate::sensor::Odometry;
    use crate::streams::{Purpose, Streams};
    use rand::Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn error(x: f64, y: f64, z: f64) -> PoseError {
        PoseError {
            position_m: Vector3::new(x, y, z),
            orientation_rad: 0.1,
        }
    }

    fn normal_errors(n: usize, rng: &mut impl Rng) -> Vec<PoseError> {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        (0..n)
            .map(|_| error(1.0 + normal(), 2.0 * normal(), 0.5 * normal()))
            .collect()
    }

    #[test]
    fn two_samples_give_what_a_calculation_by_hand_gives() {
        let summary = ErrorSummary::of(&[error(3.0, 4.0, 0.0), error(1.0, 0.0, 0.0)]).unwrap();
        assert_eq!(summary.n, 2);
        assert!((summary.mean_norm_m - 3.0).abs() < 1e-12);
        // |e| is 5 and 1: variance 8, standard error sqrt(8 / 2).
        assert!((summary.mean_norm_stderr_m - 2.0).abs() < 1e-12);
        // The mean is (2, 2, 0); the deviations squared are 5 each; tr cov = 10 / 1.
        assert!((summary.std_m - 10_f64.sqrt()).abs() < 1e-12);
        assert!((summary.rmse_m - 13_f64.sqrt()).abs() < 1e-12);
        assert!((summary.norm_of_mean_m - 8_f64.sqrt()).abs() < 1e-12);
        assert!((summary.mean_orientation_rad - 0.1).abs() < 1e-12);
        assert_eq!(ErrorSummary::of(&[error(1.0, 0.0, 0.0)]), None);
    }

    #[test]
    fn a_ratio_of_sums_is_as_uncertain_as_repetitions_differ_in_it() {
        let (mean, stderr) = ratio_and_stderr(&[1.0, 3.0, 8.0], &[1.0, 1.0, 1.0]);
        assert_eq!((mean, stderr), mean_and_stderr([1.0, 3.0, 8.0].into_iter()));
        // Where all have one ratio there is no doubt, however large they are.
        assert_eq!(ratio_and_stderr(&[2.0, 6.0], &[1.0, 3.0]), (2.0, 0.0));
        // 2, off by 1 - 2 and 5 - 4: sqrt(2 * 2) / 3.
        let (ratio, stderr) = ratio_and_stderr(&[1.0, 5.0], &[1.0, 2.0]);
        assert!((ratio - 2.0).abs() < 1e-12 && (stderr - 2.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn the_standard_errors_are_the_spread_of_repeated_experiments() {
        let mut rng = Streams::new(21, 0).vehicle(0, Purpose::Measurement);
        let summaries: Vec<_> = (0..600)
            .map(|_| ErrorSummary::of(&normal_errors(200, &mut rng)).unwrap())
            .collect();
        let spread = |of: fn(&ErrorSummary) -> f64| {
            let mean = summaries.iter().map(of).sum::<f64>() / 600.0;
            (summaries
                .iter()
                .map(|summary| (of(summary) - mean).powi(2))
                .sum::<f64>()
                / 599.0)
                .sqrt()
        };
        let mean = |of: fn(&ErrorSummary) -> f64| summaries.iter().map(of).sum::<f64>() / 600.0;
        let mean_norm =
            mean(|summary| summary.mean_norm_stderr_m) / spread(|summary| summary.mean_norm_m);
        let std = mean(|summary| summary.std_stderr_m) / spread(|summary| summary.std_m);
        let expected_std = (1.0_f64 + 4.0 + 0.25).sqrt();
        assert!(
            (mean_norm - 1.0).abs() < 0.1 && (std - 1.0).abs() < 0.1,
            "{mean_norm} {std}"
        );
        assert!((mean(|summary| summary.std_m) - expected_std).abs() < 0.02);
    }

    #[test]
    fn dead_reckoning_in_section_v_is_as_bad_as_an_independent_simulation_found() {
        // Mean |e| 3.03 m and standard deviation 3.38 m at k = 100 for robot 1, each known to 2 %: a check of path,
        // odometry noise and statistics together.
        let scenario = Scenario::built_in("section-v").unwrap();
        let path = &scenario.team.vehicles()[0].trajectory;
        let errors: Vec<_> = (0..2000)
            .map(|sample| {
                let mut odometry = Odometry::new(
                    scenario.odometry,
                    scenario.period_s,
                    0,
                    &scenario.streams(sample),
                );
                let rounds = (0..100).map(|k| (0.2 * f64::from(k), 0.2 * f64::from(k + 1)));
                let estimate = rounds.fold(path.pose_at(0.0), |pose, (from_s, to_s)| {
                    pose * odometry.between(path, from_s, to_s)
                });
                PoseError::between(&path.pose_at(20.0), &estimate)
            })
            .collect();
        let summary = ErrorSummary::of(&errors).unwrap();
        println!("dead reckoning, section V, robot 1, k = 100: {summary:?}");
        assert!(
            (summary.mean_norm_m / 3.03 - 1.0).abs() < 0.06,
            "{summary:?}"
        );
        assert!((summary.std_m / 3.38 - 1.0).abs() < 0.06, "{summary:?}");
    }
}
