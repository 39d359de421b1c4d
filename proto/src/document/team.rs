//! What a vehicle's health says of the estimator of mode `team`: of its window, its noise scales, and each member.

use serde::{Deserialize, Serialize};

/// The state of the estimator of the whole team; absent in other modes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TeamHealth {
    /// How much noisier than they say odometry and measurements turned out to be.
    pub noise_scales: NoiseScales,
    /// Rounds between the newest pose and the oldest that is still estimated.
    pub lag_rounds: u64,
    /// Unknown poses in the window.
    pub poses: u64,
    /// Vehicles in the window, this one included.
    pub members: u64,
    /// Edges in the window.
    pub edges: u64,
    /// Edges that the last round brought.
    pub new_edges: u64,
    /// Of these, the ones that failed the gate.
    pub gated: u64,
    /// Edges that failed the gate so far.
    pub gated_total: u64,
    /// Edges brought so far.
    pub edges_total: u64,
    /// Edges left out so far, because they were beyond the nearest that the window has room for.
    pub left_out: u64,
    /// Members given up so far, because the window had no room for them.
    pub evicted: u64,
    /// How often the estimator had to begin again.
    pub restarts: u64,
    /// How far off the own position is to be expected (m): root of the sum of its variances along the three axes.
    pub position_sigma_m: Option<f64>,
    /// How far off the own orientation is to be expected (rad): root of the sum of its variances about the three axes.
    pub rotation_sigma_rad: Option<f64>,
}

/// By how much the standard deviations that sensors state are multiplied: above 1, they promise too much.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseScales {
    /// Of the rotation in odometry.
    pub odometry_rotation: f64,
    /// Of the translation in odometry.
    pub odometry_translation: f64,
    /// Of angles in relative measurements.
    pub measurement_rotation: f64,
    /// Of lengths in relative measurements.
    pub measurement_translation: f64,
}

impl Default for NoiseScales {
    /// As stated.
    fn default() -> Self {
        Self {
            odometry_rotation: 1.0,
            odometry_translation: 1.0,
            measurement_rotation: 1.0,
            measurement_translation: 1.0,
        }
    }
}

impl NoiseScales {
    /// Each with its name, in the order of the fields.
    pub fn by_name(&self) -> [(&'static str, f64); 4] {
        [
            ("odometry rotation", self.odometry_rotation),
            ("odometry translation", self.odometry_translation),
            ("measured rotation", self.measurement_rotation),
            ("measured translation", self.measurement_translation),
        ]
    }
}

/// What the estimator of the whole team has learnt of one neighbour; absent in other modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TeamMemberHealth {
    /// Share, from 0 to 1, of its measurements whose robust weight was below one half; old ones are forgotten.
    pub doubted_share: f64,
    /// Residuals of its odometry in the solution over what was to be expected, last 5 rounds: 1 is as stated.
    pub odometry_ratio: f64,
    /// How fast its gyroscope seems to turn when it does not (rad/s, body axes).
    pub gyro_bias_rad_s: [f64; 3],
    /// Scale error of its odometer: 0.02 when it moves 2 % farther than it says.
    pub odometer_scale: f64,
    /// Its odometry goes on contradicting what others measure.
    pub odometry_liar: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::{NeighbourHealth, RoundsHealth};

    #[test]
    fn what_mode_team_says_is_read_as_it_was_written_and_other_modes_say_nothing_of_it() {
        let rounds = RoundsHealth {
            team: Some(TeamHealth {
                noise_scales: NoiseScales {
                    odometry_rotation: 1.25,
                    ..NoiseScales::default()
                },
                gated: 3,
                position_sigma_m: Some(0.5),
                ..TeamHealth::default()
            }),
            ..RoundsHealth::default()
        };
        let neighbour = NeighbourHealth {
            team: Some(TeamMemberHealth {
                gyro_bias_rad_s: [0.0, 0.0, -0.25],
                odometry_liar: true,
                ..TeamMemberHealth::default()
            }),
            ..NeighbourHealth::default()
        };
        let json = serde_json::to_string(&(&rounds, &neighbour)).unwrap();
        let read: (RoundsHealth, NeighbourHealth) = serde_json::from_str(&json).unwrap();
        assert_eq!(read, (rounds, neighbour));

        let silent = (RoundsHealth::default(), NeighbourHealth::default());
        let json = serde_json::to_string(&silent).unwrap();
        assert!(!json.contains("team"), "{json}");
        let read: (RoundsHealth, NeighbourHealth) = serde_json::from_str(&json).unwrap();
        assert_eq!(read, silent);
    }
}
