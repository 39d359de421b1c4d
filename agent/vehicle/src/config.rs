//! What a vehicle is told before it starts. Checked values only: texts and files are parsed elsewhere.

use skein_estimation::cooperative::{Mode, Optimiser};
use skein_estimation::ranging::Dimension;
use skein_estimation::time::Span;
use skein_estimation::{Body, Sensor, Transform};
use skein_proto::name::Name;

use crate::checkpoint::Checkpoint;
use crate::told_pose::ToldPose;

/// Everything that makes one vehicle. There are no defaults here: whoever builds it says what it means.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Its name in the fleet.
    pub vehicle: Name,
    /// Drawn at random for this process.
    pub boot: u64,
    /// Period of the rounds; the paper's is 0.2 s.
    pub period: Span,
    /// How long after its instant a round is solved at the latest, whoever has not been heard.
    pub round_wait: Span,
    /// Where the vehicle is when it starts.
    pub start: Start,
    /// How rounds are weighed.
    pub mode: Mode,
    /// How rounds are solved.
    pub optimiser: Optimiser,
    /// How neighbours are located by anonymous bearings.
    pub mutual: MutualConfig,
    /// How neighbours are located by distances alone.
    pub ranging: RangingConfig,
    /// The sensors whose frames are taken.
    pub sensors: Vec<SensorConfig>,
    /// Where others' sensors see this vehicle: its tag, its antenna.
    pub body_from_target: Transform<Body, Sensor>,
    /// How long a neighbour counts as present after its last packet.
    pub presence_timeout: Span,
    /// How many earlier rounds each round record repeats.
    pub repeats: usize,
    /// Whether it repeats what it hears, for those who are out of its tellers' reach.
    pub relay: bool,
    /// Shortest time between two published estimates.
    pub estimate_spacing: Span,
}

/// How neighbours are located by anonymous bearings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MutualConfig {
    /// By which of the two ways.
    pub way: MutualWay,
    /// Whether a bearing whose neighbour is known is also a measurement of the cooperative pipeline.
    pub bearings_to_cooperative: bool,
}

impl MutualConfig {
    /// What a vehicle does that is told nothing of it.
    pub const DEFAULT: Self = Self {
        way: MutualWay::Persistent,
        bearings_to_cooperative: true,
    };
}

/// How neighbours are located by distances alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RangingConfig {
    /// Whether all vehicles stay in one plane.
    pub dimension: Dimension,
    /// Whether the vehicle takes part in the motion schedule.
    pub schedule: bool,
}

impl RangingConfig {
    /// What a vehicle does that is told nothing of it.
    pub const DEFAULT: Self = Self {
        dimension: Dimension::Planar,
        schedule: false,
    };
}

/// The two ways of mutual localisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MutualWay {
    /// Who is who is held over time, and all neighbours are estimated jointly.
    Persistent,
    /// As published: each moment's bearings are registered, and one particle filter a neighbour follows.
    Published,
}

impl MutualWay {
    /// One word for configurations and the health.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Persistent => "persistent",
            Self::Published => "published",
        }
    }
}

/// One sensor: its name is the key of its driver, its mount is where it sits.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorConfig {
    /// Its name.
    pub name: Name,
    /// What drives it, for `info`.
    pub driver: String,
    /// Its mount.
    pub body_from_sensor: Transform<Body, Sensor>,
}

/// What is known of the pose at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// The pose at the first odometry.
    Pose(ToldPose),
    /// What a process before this one wrote down: shown with its age until others, or a fix, have placed the vehicle.
    Checkpoint(Checkpoint),
    /// Nothing: others, or a fix, must place this vehicle.
    Unknown,
}
