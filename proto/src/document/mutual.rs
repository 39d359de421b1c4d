//! What mutual localisation says in JSON: where a neighbour is relative to this vehicle, who a feature is, and how the
//! pipeline fares.

use super::PoseDocument;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Where a neighbour is, as found from anonymous bearings and both vehicles' inertial sensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MutualDocument {
    /// How far its place is known.
    pub status: MutualStatus,
    /// At how many places it may be; 1 when converged, 0 when unknown.
    pub modes: u64,
    /// When it was there, in nanoseconds on this vehicle's clock.
    pub taken_ns: i64,
    /// `body_from_neighbour`: the likeliest of its places.
    pub pose: Option<PoseDocument>,
    /// The same reduced to what is estimated, in this vehicle's level frame (its body's origin, z up, x along its
    /// heading).
    pub reduced: Option<ReducedDocument>,
    /// Probability that the feature that is held to be this neighbour is it; 0 when none is.
    pub identity_probability: f64,
}

/// A reduced relative pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReducedDocument {
    /// Where the neighbour is (m).
    pub position_level_m: [f64; 3],
    /// How it moves relative to this vehicle, not counting this vehicle's turning (m/s).
    pub velocity_level_m_s: [f64; 3],
    /// Its heading minus this vehicle's, counter-clockwise (rad).
    pub yaw_rad: f64,
    /// Upper triangle of the covariance of position (m), velocity (m/s) and yaw (rad), row by row, 28 numbers; absent
    /// from an estimator that supplies none that was tested.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub covariance_position_velocity_yaw: Option<Vec<f64>>,
}

/// Numbers in the upper triangle of a 7 x 7 matrix.
const TRIANGLE: usize = 28;
/// Where the variances of the position stand in it, row by row.
const POSITION_VARIANCES: [usize; 3] = [0, 7, 13];
/// Where the variance of the yaw stands.
const YAW_VARIANCE: usize = 27;

impl ReducedDocument {
    /// How far off the position is to be expected (m): the root of the sum of its variances. None without a covariance.
    pub fn position_sigma_m(&self) -> Option<f64> {
        let numbers = self.covariance()?;
        let sum: f64 = POSITION_VARIANCES.iter().map(|place| numbers[*place]).sum();
        (sum >= 0.0 && sum.is_finite()).then(|| sum.sqrt())
    }

    /// How far off the yaw is to be expected (rad). None without a covariance.
    pub fn yaw_sigma_rad(&self) -> Option<f64> {
        let variance = self.covariance()?[YAW_VARIANCE];
        (variance >= 0.0 && variance.is_finite()).then(|| variance.sqrt())
    }

    fn covariance(&self) -> Option<&[f64]> {
        let numbers = self.covariance_position_velocity_yaw.as_deref();
        numbers.filter(|numbers| numbers.len() == TRIANGLE)
    }
}

/// How far a neighbour's place is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MutualStatus {
    /// Not at all.
    Unknown,
    /// It is at one of several places, or not yet surely the one that is seen there.
    Ambiguous,
    /// It is at one place.
    Converged,
}

impl MutualDocument {
    /// How far its place is known, in words.
    pub fn words(&self) -> String {
        match self.status {
            MutualStatus::Unknown => "unknown".to_owned(),
            MutualStatus::Ambiguous => format!("ambiguous ({})", self.modes),
            MutualStatus::Converged => "converged".to_owned(),
        }
    }
}

/// One feature of the newest camera frame, and who it may be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureDocument {
    /// Direction in this vehicle's level frame, a unit vector.
    pub direction_level: [f64; 3],
    /// Probability of each neighbour that it may be; what is missing to one is everything else.
    pub identities: BTreeMap<String, f64>,
}

/// How mutual localisation fares.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MutualHealth {
    /// The way it goes: `persistent` or `published`.
    pub way: String,
    /// When nobody can be located: why, and what to do.
    pub why: Option<String>,
    /// Whether roll and pitch have settled.
    pub attitude_settled: bool,
    /// Roll of the body (degrees).
    pub roll_deg: Option<f64>,
    /// Pitch of the body, positive nose down (degrees).
    pub pitch_deg: Option<f64>,
    /// Estimated bias of the gyroscopes, in body axes (rad/s).
    pub gyroscope_bias_rad_s: Option<[f64; 3]>,
    /// Camera frames that became feature sets.
    pub sets_told: u64,
    /// Feature sets of neighbours that were used.
    pub sets_heard: u64,
    /// Tracks followed now.
    pub tracks: u64,
    /// Bearings that were given to the cooperative estimate with an identity.
    pub bearings_identified: u64,
    /// Long computations handed out, and taken back; less are those that are under way or were dropped.
    pub work_begun: u64,
    /// See [`MutualHealth::work_begun`].
    pub work_done: u64,
    /// Things that were cut because a bound was reached, by what.
    pub cut: BTreeMap<String, u64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_covariance_says_how_far_off_position_and_yaw_are() {
        let mut numbers = vec![1e3; TRIANGLE];
        (numbers[0], numbers[7], numbers[13], numbers[27]) = (0.01, 0.04, 0.04, 0.0001);
        let mut reduced = ReducedDocument {
            position_level_m: [0.0; 3],
            velocity_level_m_s: [0.0; 3],
            yaw_rad: 0.0,
            covariance_position_velocity_yaw: Some(numbers),
        };
        assert!((reduced.position_sigma_m().unwrap() - 0.3).abs() < 1e-12);
        assert!((reduced.yaw_sigma_rad().unwrap() - 0.01).abs() < 1e-12);
        reduced.covariance_position_velocity_yaw = Some(vec![1.0; 27]);
        assert_eq!(
            reduced.position_sigma_m(),
            None,
            "27 numbers are no triangle"
        );
        reduced.covariance_position_velocity_yaw = None;
        assert_eq!(reduced.yaw_sigma_rad(), None);
    }
}
