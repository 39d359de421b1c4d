//! The results of levelling as people read them.

use super::simulated::CaseResult;
use super::{GAINS, RecordingResult};
use crate::plot::{self, Panel, PlotError, Trace};
use std::fmt::Write;

/// A table, one line a recording.
#[must_use]
pub fn recordings(results: &[RecordingResult]) -> String {
    let mut text = format!(
        "{:<36} {:>8} {:>9} {:>9} {:>9} {:>6}  RMSE of a fixed gain of",
        "tilt, deg", "asked", "RMSE", "mean", "largest", "NEES"
    );
    for gain in GAINS {
        let _ = write!(text, " {gain:>6.2}/s");
    }
    text.push('\n');
    for result in results {
        let asked = result.goal_rmse_deg;
        let _ = write!(
            text,
            "{:<36} {:>8} {:>9.2} {:>9.2} {:>9.2} {:>6.2}  {:>23}",
            result.name,
            asked.map_or_else(|| "-".to_owned(), |goal| format!("{goal:.2}")),
            result.tilt.rmse_deg,
            result.tilt.mean_deg,
            result.tilt.max_deg,
            result.nees,
            "",
        );
        for fixed in &result.fixed_gain {
            let _ = write!(text, " {:>8.2}", fixed.rmse_deg);
        }
        text.push('\n');
    }
    text
}

/// A table, one line a case.
#[must_use]
pub fn cases(results: &[CaseResult]) -> String {
    let mut text = format!(
        "{:<24} {:>15} {:>7} {:>6} {:>6} {:>14}  mean of a fixed gain of",
        "tilt, deg", "mean", "RMSE", "NEES", "gain", "drift deg/min"
    );
    for gain in GAINS {
        let _ = write!(text, " {gain:>6.2}/s");
    }
    text.push('\n');
    for result in results {
        let _ = write!(
            text,
            "{:<24} {:>15} {:>7.3} {:>6.2} {:>6.3} {:>14.2}  {:>23}",
            result.case,
            format!("{:.3} +- {:.3}", result.mean_deg, result.mean_stderr_deg),
            result.rmse_deg,
            result.nees,
            result.gain,
            result.drift_deg_per_min,
            "",
        );
        for mean in result.fixed_gain_mean_deg {
            let _ = write!(text, " {mean:>8.2}");
        }
        text.push('\n');
    }
    text
}

/// The error of every recording over time. Fails when there is none.
pub fn figure(results: &[RecordingResult]) -> Result<String, PlotError> {
    let panel = |result: &RecordingResult| Panel {
        name: format!("{}: tilt error, deg", result.name),
        shown: (0.0, 1.05 * result.tilt.max_deg),
        traces: vec![Trace {
            label: "gyro, and force integrated twice".to_owned(),
            points: result.trace.clone(),
        }],
    };
    let panels: Vec<Panel> = results.iter().map(panel).collect();
    plot::panels("Levelling of real recordings", 2, &panels)
}
