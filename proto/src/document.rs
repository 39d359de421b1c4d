//! What people and tools read in JSON: the estimate, the health and the description of a vehicle.

mod covariance;
mod mutual;
mod ranging;
mod team;

pub use covariance::CovarianceDocument;
pub use mutual::{FeatureDocument, MutualDocument, MutualHealth, MutualStatus, ReducedDocument};
pub use ranging::{
    FormationHealth, MotionDocument, Permit, RangedBy, RangedDocument, RangingDocument,
    RangingHealth, RangingStatus, ScheduleHealth,
};
pub use team::{NoiseScales, TeamHealth, TeamMemberHealth};

use crate::faults::LinkCount;
use crate::name::Name;
use crate::status::Status;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// JSON of `state/estimate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateDocument {
    /// Whose estimate this is.
    pub vehicle: Name,
    /// Boot id in hexadecimal.
    pub boot: String,
    /// When the vehicle was there, in nanoseconds of UNIX time on its clock.
    pub taken_ns: i64,
    /// How good it is.
    pub status: Status,
    /// `world_from_body` in the common frame (ENU, FLU).
    pub pose: Option<PoseDocument>,
    /// How it moves.
    pub velocity: Option<VelocityDocument>,
    /// Covariance of the pose, when an estimator supplies one that was tested.
    pub covariance: Option<CovarianceDocument>,
    /// Where the neighbours are, in this vehicle's body frame.
    pub neighbours: Vec<NeighbourDocument>,
    /// The robots that the camera saw last, and who they may be.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub features: Vec<FeatureDocument>,
    /// Whether the vehicle may move now; absent when it takes no part in a motion schedule.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub motion: Option<MotionDocument>,
    /// When there is no estimate: why, and what to do.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub why: Option<String>,
}

/// A pose in the forms that people and programs use.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseDocument {
    /// Position (m): east, north, up in the world; forward, left, up in a body.
    pub position_m: [f64; 3],
    /// Unit quaternion, scalar first.
    pub quaternion_wxyz: [f64; 4],
    /// Yaw, pitch, roll in degrees (rotations about z, y', x'').
    pub yaw_pitch_roll_deg: [f64; 3],
    /// Rotation vector (rad).
    pub rotation_vector_rad: [f64; 3],
}

/// A velocity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VelocityDocument {
    /// Of the body's origin, in world axes (m/s).
    pub linear_world_m_s: [f64; 3],
    /// Of the body, in body axes (rad/s).
    pub angular_body_rad_s: [f64; 3],
}

/// One neighbour as seen from this vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NeighbourDocument {
    /// Its name.
    pub vehicle: Name,
    /// What it says of itself; absent when it has said nothing or a newer version's word.
    pub status: Option<Status>,
    /// When it was there, in nanoseconds on this vehicle's clock.
    pub taken_ns: Option<i64>,
    /// `body_from_neighbour`.
    pub pose: Option<PoseDocument>,
    /// Covariance of that pose, when an estimator supplies one that was tested.
    pub covariance: Option<CovarianceDocument>,
    /// Where it is by anonymous bearings; absent where this vehicle has no camera and no inertial sensor for that.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mutual: Option<MutualDocument>,
    /// Where it is by distances alone; absent where none was measured while either of the two had no pose.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ranging: Option<RangingDocument>,
}

/// JSON of `state/health`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HealthDocument {
    /// Whose health this is.
    pub vehicle: Name,
    /// Boot id in hexadecimal.
    pub boot: String,
    /// When this was written, in nanoseconds of UNIX time on the vehicle's clock.
    pub taken_ns: i64,
    /// Seconds since the process started.
    pub uptime_s: f64,
    /// State of the own estimate.
    pub status: Status,
    /// When there is no estimate, or a poor one: why, and what to do.
    pub why: Option<String>,
    /// The estimator's rounds.
    pub rounds: RoundsHealth,
    /// Localisation by anonymous bearings; absent without an inertial sensor.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub mutual: Option<MutualHealth>,
    /// Localisation by distances alone; absent where none was measured that it uses, and without a motion schedule.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ranging: Option<RangingHealth>,
    /// One entry a configured sensor.
    pub sensors: BTreeMap<String, SensorHealth>,
    /// One entry a vehicle that was heard or announced.
    pub neighbours: BTreeMap<String, NeighbourHealth>,
    /// Packets and frames that could be laid to nobody, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Boot id in hexadecimal of another process that flies under this vehicle's name now.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub namesake_boot: Option<String>,
    /// What the process around the estimator counts; absent in a virtual fleet.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub process: Option<ProcessHealth>,
}

/// How the estimator's rounds went.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RoundsHealth {
    /// The mode that solves them.
    pub mode: String,
    /// Period in seconds.
    pub period_s: f64,
    /// Rounds solved with at least one measurement.
    pub solved: u64,
    /// Rounds in which there was nothing to solve: odometry alone.
    pub coasted: u64,
    /// Rounds that could not be entered, by reason.
    pub skipped: BTreeMap<String, u64>,
    /// Solved rounds that ended otherwise than converged, by the solver's status.
    pub troubled: BTreeMap<String, u64>,
    /// Seconds from the instant of the last solved round to its solution.
    pub last_latency_s: Option<f64>,
    /// Edges in the last solved round.
    pub last_edges: u64,
    /// Things that were cut because a bound was reached, by what.
    pub cut: BTreeMap<String, u64>,
    /// The estimator of the whole team; absent in other modes than `team`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub team: Option<TeamHealth>,
}

/// What came from one sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorHealth {
    /// Frames taken.
    pub accepted: u64,
    /// Frames refused, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Seconds since the last accepted reading was taken.
    pub age_s: Option<f64>,
    /// Frames a second, over the last seconds.
    pub rate_hz: f64,
}

/// What is known of one neighbour.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NeighbourHealth {
    /// Announced by a liveliness token and heard lately.
    pub present: bool,
    /// Boot id in hexadecimal, of the boot that counts.
    pub boot: Option<String>,
    /// What it says of itself.
    pub status: Option<Status>,
    /// Seconds since the last packet.
    pub age_s: Option<f64>,
    /// Packets a second, over the last seconds.
    pub rate_hz: f64,
    /// Echoes of our stamps: below 4 its clock is unknown and nothing of it is used.
    pub echoes: u64,
    /// Its clock minus ours, in seconds.
    pub clock_offset_s: Option<f64>,
    /// How far off that can be, in seconds.
    #[serde(default)]
    pub clock_error_s: Option<f64>,
    /// How often its clock, or ours, stepped within this boot.
    #[serde(default)]
    pub clock_stepped: u64,
    /// Round trip of the last echo, in seconds.
    pub round_trip_s: Option<f64>,
    /// Its round period, when it differs from ours.
    pub other_period_s: Option<f64>,
    /// Packets accepted, by kind.
    pub accepted: BTreeMap<String, u64>,
    /// Measurements of it or by it that went into a solution.
    pub fused: u64,
    /// By how much the robust kernel's scale of lengths is widened for it: 1 in good contact, more after silence. Absent
    /// in mode `paper`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub kernel_widening: Option<f64>,
    /// The last measurement of it or by it that the kernel rejected.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub last_gated: Option<GatedDocument>,
    /// It goes on disagreeing while others agree: nothing of it is used until it agrees again.
    #[serde(skip_serializing_if = "std::ops::Not::not", default)]
    pub quarantined: bool,
    /// How often it was put into quarantine.
    #[serde(skip_serializing_if = "is_zero", default)]
    pub quarantines: u64,
    /// What the estimator of the whole team has learnt of it; absent in other modes than `team`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub team: Option<TeamMemberHealth>,
    /// Packets and measurements refused, by reason.
    pub refused: BTreeMap<String, u64>,
    /// Bytes received, envelopes included.
    pub bytes: u64,
    /// Boot ids in hexadecimal of processes that are alive under this one name: all of them are refused meanwhile.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub duplicate_boots: Vec<String>,
}

/// How far a rejected measurement was from everything else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GatedDocument {
    /// In radians, when it says something of angles.
    pub rotation_rad: Option<f64>,
    /// In metres, when it says something of lengths.
    pub translation_m: Option<f64>,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde passes fields by reference"
)]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// What the process around the estimator counts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProcessHealth {
    /// Zenoh peers connected.
    pub peers: u64,
    /// Whether a Zenoh session is open.
    pub session_open: bool,
    /// One entry a queue.
    pub queues: BTreeMap<String, QueueHealth>,
    /// Packets that an injected fault took away.
    pub faults_dropped: u64,
    /// What injected faults did to packets, by reason; absent where none are obeyed.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub faults: Option<LinkCount>,
    /// Whether the input log, if any, is complete.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub log_complete: Option<bool>,
}

/// One bounded queue.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct QueueHealth {
    /// Entries it holds at most.
    pub capacity: u64,
    /// Most entries it has held.
    pub most: u64,
    /// Entries dropped because it was full.
    pub dropped: u64,
}

/// JSON of `info`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InfoDocument {
    /// Who this is.
    pub vehicle: Name,
    /// Boot id in hexadecimal.
    pub boot: String,
    /// Version of the program.
    pub program: String,
    /// Version of the wire contract, `major.minor`.
    pub wire: String,
    /// Round period in seconds.
    pub period_s: f64,
    /// What it can do: pipelines and their modes.
    pub capabilities: Vec<String>,
    /// Configured sensors and their drivers.
    pub sensors: BTreeMap<String, String>,
    /// Bounds that others may want to know.
    pub limits: BTreeMap<String, u64>,
}

/// The JSON error of an `@rpc` query or of a query that was not understood.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ErrorDocument {
    /// One word for programs.
    pub code: String,
    /// A sentence for people.
    pub message: String,
}
