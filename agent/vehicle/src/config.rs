//! What a vehicle is told before it starts. Checked values only: texts and files are parsed elsewhere.

use skein_estimation::cooperative::{Mode, Optimiser};
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
    /// The sensors whose frames are taken.
    pub sensors: Vec<SensorConfig>,
    /// Where others' sensors see this vehicle: its tag, its antenna.
    pub body_from_target: Transform<Body, Sensor>,
    /// How long a neighbour counts as present after its last packet.
    pub presence_timeout: Span,
    /// How many earlier rounds each round record repeats.
    pub repeats: usize,
    /// Whether round records say where the vehicle was told to be and what it fixed of itself, for neighbours that smooth the
    /// whole team. It takes room from repeated rounds.
    pub tell_absolute: bool,
    /// Whether a neighbour that was out of reach is asked for the rounds that were missed.
    pub ask_backlog: bool,
    /// Shortest time between two published estimates.
    pub estimate_spacing: Span,
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
