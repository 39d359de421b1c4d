//! The angle between a levelled vertical and the true one, over a recording.

use crate::inertial_recording::InertialReading;
use nalgebra::Vector3;
use serde::Serialize;

/// How long one point of a trace stands for (s).
const TRACE_STEP_S: f64 = 0.25;

/// Errors of the tilt in a few numbers, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TiltScore {
    /// How many readings were scored.
    pub readings: usize,
    /// The root of the mean square.
    pub rmse_deg: f64,
    /// The mean.
    pub mean_deg: f64,
    /// The largest.
    pub max_deg: f64,
}

/// The score, and the error over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Scored {
    /// In numbers.
    pub tilt: TiltScore,
    /// Time (s) and error (deg), thinned out.
    pub trace: Vec<(f64, f64)>,
}

/// Feeds all readings to a filter, which gives straight up in the body for each. None when nothing is scored.
pub fn score(
    readings: &[InertialReading],
    mut level: impl FnMut(f64, &InertialReading) -> Vector3<f64>,
) -> Option<Scored> {
    let mut before_s = readings.first()?.time_s;
    let mut errors_deg: Vec<f64> = Vec::new();
    let mut trace: Vec<(f64, f64)> = Vec::new();
    for reading in readings {
        let up = level(reading.time_s - before_s, reading);
        before_s = reading.time_s;
        let Some(truth) = reading.up.filter(|_| reading.is_scored) else {
            continue;
        };
        let error_deg = up.angle(&truth).to_degrees();
        errors_deg.push(error_deg);
        if trace
            .last()
            .is_none_or(|(at_s, _)| reading.time_s - at_s >= TRACE_STEP_S)
        {
            trace.push((reading.time_s, error_deg));
        }
    }
    let n = errors_deg.len();
    (n > 0).then(|| Scored {
        tilt: TiltScore {
            readings: n,
            rmse_deg: (errors_deg.iter().map(|error| error * error).sum::<f64>() / n as f64).sqrt(),
            mean_deg: errors_deg.iter().sum::<f64>() / n as f64,
            max_deg: errors_deg.iter().copied().fold(0.0, f64::max),
        },
        trace,
    })
}
