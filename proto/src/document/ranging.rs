//! What range-only localisation says in JSON: where a neighbour is relative to this vehicle, whether this vehicle may move,
//! and how the pipeline fares.

use super::PoseDocument;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Where a neighbour is, as found from distances and both vehicles' odometry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RangingDocument {
    /// How far its place is known.
    pub status: RangingStatus,
    /// At how many places it may be; 1 when converged, 0 when unknown or imprecise.
    pub modes: u64,
    /// When it is not converged: why, and what movement would tell more.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub why: Option<String>,
    /// Which distances say so; absent while it is at no place.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub by: Option<RangedBy>,
    /// When it was there, in nanoseconds on this vehicle's clock.
    pub taken_ns: i64,
    /// `body_from_neighbour`: the likeliest of its places.
    pub pose: Option<PoseDocument>,
    /// The same reduced to what is estimated, in this vehicle's level frame (its body's origin, z up, x along its
    /// heading).
    pub reduced: Option<RangedDocument>,
}

/// Which distances a place follows from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangedBy {
    /// Those between this vehicle and the neighbour.
    Pair,
    /// Those of all pairs that are heard, while the neighbour's own leave its place open.
    All,
}

/// A reduced relative pose without velocity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RangedDocument {
    /// Where the neighbour is (m).
    pub position_level_m: [f64; 3],
    /// Its heading minus this vehicle's, counter-clockwise (rad).
    pub yaw_rad: f64,
    /// Upper triangle of the covariance of position (m) and yaw (rad), row by row, 10 numbers; absent while there is more
    /// than one place.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub covariance_position_yaw: Option<[f64; 10]>,
}

impl RangedDocument {
    /// How far off the position is to be expected (m): the root of the sum of its variances. None without a covariance.
    pub fn position_sigma_m(&self) -> Option<f64> {
        let [x, _, _, _, y, _, _, z, _, _] = self.covariance_position_yaw?;
        let sum = x + y + z;
        (sum >= 0.0 && sum.is_finite()).then(|| sum.sqrt())
    }

    /// How far off the yaw is to be expected (rad). None without a covariance.
    pub fn yaw_sigma_rad(&self) -> Option<f64> {
        let variance = self.covariance_position_yaw?[9];
        (variance >= 0.0 && variance.is_finite()).then(|| variance.sqrt())
    }
}

/// How far a neighbour's place is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangingStatus {
    /// Not at all.
    Unknown,
    /// It is at one of several places.
    Ambiguous,
    /// It is at one place, which is not yet known to a metre.
    Imprecise,
    /// It is at one place.
    Converged,
}

/// Whether the vehicle may move now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MotionDocument {
    /// What the controller is asked to do until it is told otherwise.
    pub permit: Permit,
    /// Round of the motion schedule.
    pub round: u32,
}

/// A motion permit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Permit {
    /// Stand still: a neighbour may be moving.
    Stay,
    /// Move: every neighbour stands.
    Move,
}

impl Permit {
    /// Its code in a binary estimate, where 0 is no part in any schedule.
    pub const fn code(self) -> u8 {
        match self {
            Self::Stay => 1,
            Self::Move => 2,
        }
    }
}

/// How range-only localisation fares.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RangingHealth {
    /// Distances that were used.
    pub used: u64,
    /// Distances that wait for odometry of their time.
    pub waiting: u64,
    /// Distances that were not used, by reason.
    pub refused: BTreeMap<String, u64>,
    /// How often this vehicle's pose came from a neighbour that it had located by distances.
    pub placed: u64,
    /// The search for where all are at once; absent while no neighbour tells of distances to another.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub formation: Option<FormationHealth>,
    /// The motion schedule; absent when the vehicle takes no part.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub schedule: Option<ScheduleHealth>,
}

/// How the search for where all are at once fares.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FormationHealth {
    /// Neighbours that take part.
    pub neighbours: u64,
    /// Distances between neighbours that were used.
    pub used: u64,
    /// Distances between neighbours that wait for odometry of their time.
    pub waiting: u64,
    /// Distances between neighbours that were not used, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Searches handed out.
    pub work_begun: u64,
    /// Searches taken back.
    pub work_done: u64,
    /// Searches that did not come back in time.
    pub work_dropped: u64,
    /// Searches whose best formation does not fit the distances: one of them, or what somebody tells, is wrong.
    pub unfit: u64,
}

/// How the motion schedule fares.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScheduleHealth {
    /// Its round.
    pub round: u32,
    /// Rounds in which this vehicle moved.
    pub moves: u64,
    /// Neighbours that take part: it waits for them.
    pub neighbours: Vec<String>,
    /// Schedule states of others that were not used, by reason.
    pub refused: BTreeMap<String, u64>,
}

impl RangingDocument {
    /// How far its place is known, in words.
    pub fn words(&self) -> String {
        match self.status {
            RangingStatus::Unknown => "unknown".to_owned(),
            RangingStatus::Ambiguous => format!("ambiguous ({})", self.modes),
            RangingStatus::Imprecise => "imprecise".to_owned(),
            RangingStatus::Converged => "converged".to_owned(),
        }
    }
}
