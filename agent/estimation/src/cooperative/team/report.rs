//! What a round says of itself and of everybody in it.

use crate::VehicleId;
use crate::cooperative::measurement::Kind;

/// What became of a round.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Of each measurement that was new.
    pub verdicts: Vec<Verdict>,
    /// Something was not determined, or not finite: the estimate stays as it was.
    pub undetermined: bool,
}

/// What became of one measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// Who measured.
    pub by: VehicleId,
    /// Whom.
    pub of: VehicleId,
    /// What.
    pub kind: Kind,
    /// Whether it was of the world: an absolute fix.
    pub is_fix: bool,
    /// Whether it weighs at least one half.
    pub accepted: bool,
    /// Whether it failed the gate.
    pub failed_gate: bool,
}

/// What was counted since the start, and how large the window is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Rounds that the window holds.
    pub lag_rounds: u64,
    /// Poses in it.
    pub poses: u64,
    /// Vehicles in it.
    pub members: u64,
    /// Measurements in it.
    pub edges: u64,
    /// Measurements taken.
    pub edges_total: u64,
    /// Of those, how many failed the gate.
    pub gated_total: u64,
    /// Measurements left out, as their ends are not among the nearest.
    pub left_out: u64,
    /// Vehicles given up for room.
    pub evicted: u64,
    /// Vehicles put into quarantine.
    pub quarantines: u64,
    /// Vehicles found elsewhere than their odometry said.
    pub misplaced: u64,
    /// Rounds that could not be solved.
    pub undetermined: u64,
}

/// What is thought of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemberReport {
    /// Its measurements are not used.
    pub quarantined: bool,
    /// Share of its measurements that weigh less than one half; in quarantine, that fail the gate.
    pub doubted_share: f64,
    /// Odometry residuals over their expectation, over the last rounds.
    pub odometry_ratio: f64,
    /// Its odometry fits nothing that was measured: it is taken for ten times as noisy as it says.
    pub odometry_lies: bool,
    /// It turns faster than it says by so much, rad/s in its own axes.
    pub gyro_bias_rad_s: [f64; 3],
    /// It moves farther than it says by this share.
    pub odometer_scale: f64,
}
