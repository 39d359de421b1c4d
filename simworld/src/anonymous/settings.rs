//! What an anonymous camera is like.

use crate::bounded::{not_negative, positive, probability};
use crate::sensor::FieldOfView;
use serde::{Deserialize, Serialize};

/// The defaults are the detector of Cognetti et al., section IV.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Images a second.
    #[serde(deserialize_with = "positive")]
    pub rate_hz: f64,
    /// Standard deviation of the time at which an image is taken, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub jitter_s: f64,
    /// Standard deviation of azimuth and of zenith distance, each, in the body frame, degrees.
    #[serde(deserialize_with = "not_negative")]
    pub noise_deg: f64,
    /// What is in view; everything when not given.
    pub view: Option<FieldOfView>,
    /// How far it sees, metres.
    #[serde(deserialize_with = "positive")]
    pub range_m: f64,
    /// How often a gap begins in which one robot is not seen (for each directed pair, 1/s).
    #[serde(deserialize_with = "not_negative")]
    pub gaps_per_s: f64,
    /// The longest such gap, seconds; its length is uniform.
    #[serde(deserialize_with = "not_negative")]
    pub gap_s_max: f64,
    /// Probability that a robot is missing in an image, each on its own.
    #[serde(deserialize_with = "probability")]
    pub miss_probability: f64,
    /// Moving things that look like a robot to this camera only.
    pub phantoms: usize,
    /// Mean number of directions in an image in which there is nothing.
    #[serde(deserialize_with = "not_negative")]
    pub false_alarms: f64,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self {
            rate_hz: 20.0,
            jitter_s: 0.004,
            noise_deg: 5.0,
            view: None,
            range_m: 1e3,
            gaps_per_s: 0.1,
            gap_s_max: 3.0,
            miss_probability: 0.0,
            phantoms: 0,
            false_alarms: 0.0,
        }
    }
}

impl CameraSettings {
    /// A camera that errs in nothing and misses nobody.
    #[must_use]
    pub fn perfect() -> Self {
        Self {
            noise_deg: 0.0,
            gaps_per_s: 0.0,
            ..Self::default()
        }
    }
}
