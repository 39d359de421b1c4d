//! How far a levelled vertical is off: on recordings of real sensors and on virtual quadrotors, all with one set of
//! settings, beside filters that average the direction of the force with a fixed gain.

pub mod fixed_gain;
pub mod report;
pub mod score;
pub mod simulated;

use crate::inertial_recording::InertialReading;
use fixed_gain::FixedGain;
use nalgebra::Vector3;
use score::{Scored, TiltScore, score};
use serde::Serialize;
use skein_estimation::mutual::attitude::{Attitude, Settings};

/// Gains of the filters beside ours (1/s).
pub const GAINS: [f64; 3] = [0.74, 0.2, 0.05];

/// What is asked of a recording, where something is: tilt RMSE in degrees, by the name of the row.
pub const GOALS: [(&str, f64); 6] = [
    ("02_undisturbed_slow_rotation_B", 0.54),
    ("10_undisturbed_slow_translation_A", 0.81),
    ("15_undisturbed_fast_translation_A", 6.50),
    ("21_undisturbed_fast_combined", 3.28),
    (EUROC, 1.2),
    (EUROC_CALIBRATED, 0.5),
];

/// The row of the EuRoC flight.
pub const EUROC: &str = "euroc_v1_01";
/// The row of the same flight with the accelerometer's bias given.
pub const EUROC_CALIBRATED: &str = "euroc_v1_01, force calibrated";

/// One recording, levelled: one object of the JSON output.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingResult {
    /// Its name.
    pub name: String,
    /// What is asked for: tilt RMSE, degrees.
    pub goal_rmse_deg: Option<f64>,
    /// Ours.
    #[serde(flatten)]
    pub tilt: TiltScore,
    /// Squared error over variance, of each axis, on average: 1 where the filter knows how sure it is.
    pub nees: f64,
    /// Filters of the fixed gains [`GAINS`].
    pub fixed_gain: Vec<TiltScore>,
    /// Time (s) and error (deg), ours, thinned out.
    #[serde(skip)]
    pub trace: Vec<(f64, f64)>,
}

/// Levels a recording. None when no row of it is scored.
#[must_use]
pub fn level(
    name: &str,
    readings: &[InertialReading],
    settings: &Settings,
) -> Option<RecordingResult> {
    let mut nees = Vec::new();
    let Scored { tilt, trace } = {
        let mut attitude = Attitude::new(settings.clone());
        score(readings, |elapsed_s, reading| {
            attitude.update(elapsed_s, &reading.rate_rad_s, &reading.force_m_s2);
            let up = attitude.gyro_from_body().inverse() * Vector3::z();
            if let Some(truth) = reading.up.filter(|_| reading.is_scored) {
                let over_sigma = up.angle(&truth) / attitude.tilt_sigma_rad();
                nees.push(0.5 * over_sigma * over_sigma);
            }
            up
        })?
    };
    let fixed_gain = GAINS.iter().filter_map(|gain| {
        let mut filter = FixedGain::new(*gain);
        let scored = score(readings, |elapsed_s, reading| {
            filter.update(elapsed_s, &reading.rate_rad_s, &reading.force_m_s2)
        });
        scored.map(|scored| scored.tilt)
    });
    Some(RecordingResult {
        name: name.to_owned(),
        goal_rmse_deg: GOALS
            .iter()
            .find(|(of, _)| *of == name)
            .map(|(_, goal)| *goal),
        tilt,
        nees: nees.iter().sum::<f64>() / nees.len().max(1) as f64,
        fixed_gain: fixed_gain.collect(),
        trace,
    })
}

#[cfg(test)]
mod tests;
