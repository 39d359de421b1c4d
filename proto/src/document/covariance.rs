//! The covariance of a pose as documents have it, and how far the pose may be off in one number.

use serde::{Deserialize, Serialize};

/// Where the variances of the three rotations stand in the upper triangle of a 6 x 6 matrix, row by row.
const ROTATION_VARIANCES: [usize; 3] = [0, 6, 11];
/// Where the variances of the three translations stand.
const TRANSLATION_VARIANCES: [usize; 3] = [15, 18, 20];
/// Numbers in that triangle.
const TRIANGLE: usize = 21;

/// A covariance, named by its tangent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CovarianceDocument {
    /// Body twist, rotation (rad) then translation (m): upper triangle of the 6 x 6 matrix, row by row.
    ///
    /// The twist stands on the body side of the pose, `pose * exp(twist)`: of `world_from_body` in the axes of the body,
    /// of `body_from_neighbour` in those of the neighbour.
    pub body_twist_rotation_first: Vec<f64>,
}

impl CovarianceDocument {
    /// How far off the position is to be expected (m): the root of the sum of its variances along the three axes, so the
    /// root mean square of the distance to the truth, whichever way the body is turned. None when the numbers are no
    /// covariance of a pose.
    pub fn position_sigma_m(&self) -> Option<f64> {
        self.root_of_sum(TRANSLATION_VARIANCES)
    }

    /// How far off the orientation is to be expected (rad): the root of the sum of its variances about the three axes, so
    /// the root mean square of the angle to the truth. None when the numbers are no covariance of a pose.
    pub fn rotation_sigma_rad(&self) -> Option<f64> {
        self.root_of_sum(ROTATION_VARIANCES)
    }

    fn root_of_sum(&self, places: [usize; 3]) -> Option<f64> {
        let numbers = &self.body_twist_rotation_first;
        if numbers.len() != TRIANGLE || places.iter().any(|place| numbers[*place] < 0.0) {
            return None;
        }
        let sum: f64 = places.iter().map(|place| numbers[*place]).sum();
        sum.is_finite().then(|| sum.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rotation known to 0.01, 0.02, 0.02 rad about its axes, position to 0.1, 0.2, 0.2 m along them; all else is filled
    /// with a number that would show.
    fn covariance() -> CovarianceDocument {
        let sigmas = [0.01, 0.02, 0.02, 0.1, 0.2, 0.2];
        let mut numbers = Vec::new();
        for (row, sigma) in sigmas.iter().enumerate() {
            numbers.push(sigma * sigma);
            numbers.extend((row + 1..6).map(|_| 1e3));
        }
        CovarianceDocument {
            body_twist_rotation_first: numbers,
        }
    }

    #[test]
    fn a_covariance_says_how_far_off_position_and_orientation_are() {
        let position_sigma_m = covariance().position_sigma_m().unwrap();
        let rotation_sigma_rad = covariance().rotation_sigma_rad().unwrap();
        assert!((position_sigma_m - 0.3).abs() < 1e-12, "{position_sigma_m}");
        assert!(
            (rotation_sigma_rad - 0.03).abs() < 1e-12,
            "{rotation_sigma_rad}"
        );
    }

    #[test]
    fn numbers_that_are_no_covariance_of_a_pose_say_nothing() {
        for length in [0, TRIANGLE - 1, TRIANGLE + 1, 36] {
            let other = CovarianceDocument {
                body_twist_rotation_first: vec![1.0; length],
            };
            assert_eq!(other.position_sigma_m(), None, "{length} numbers");
            assert_eq!(other.rotation_sigma_rad(), None, "{length} numbers");
        }
        for wrong in [-1.0, f64::NAN, f64::INFINITY] {
            let mut broken = covariance();
            broken.body_twist_rotation_first[18] = wrong;
            assert_eq!(broken.position_sigma_m(), None, "{wrong}");
            assert!(broken.rotation_sigma_rad().is_some(), "{wrong}");
        }
    }
}
