//! What one agent is started with. Checked values: a file becomes this in `config`, a program may build it directly.

use crate::clock::Clock;
use crate::network::NetworkSettings;
use skein_estimation::time::Stamp;
use skein_proto::frame::Frame;
use skein_proto::name::Name;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Everything that makes one agent.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The fleet that the vehicle belongs to: the first chunk of every key.
    pub fleet: Name,
    /// The vehicle itself.
    pub vehicle: skein_vehicle::Config,
    /// What drives each sensor. A configured sensor that is missing here is [`DriverSettings::Process`].
    pub drivers: BTreeMap<Name, DriverSettings>,
    /// How it reaches the others.
    pub network: NetworkSettings,
    /// The process's clock.
    pub clock: Clock,
    /// Where the input log goes, when one is wanted.
    pub log: Option<PathBuf>,
    /// Where the vehicle writes down where it is, to resume from after a restart; a usable one found there at the start
    /// takes the place of the configured start pose.
    pub checkpoint: Option<PathBuf>,
    /// Whether queries under `@rpc` have an effect.
    pub rpc: bool,
    /// Present when simulated radio faults are obeyed; never beside TLS.
    pub faults: Option<FaultSettings>,
}

/// Where the frames of a sensor come from.
#[derive(Clone, Debug)]
pub enum DriverSettings {
    /// From the program that runs this agent, through [`crate::Agent::driver`].
    Process,
    /// From any program, under the sensor's `@driver` key.
    Zenoh,
    /// From a recording in JSON lines, played on the clock.
    Recording(PathBuf),
    /// From memory, played on the clock. Arrivals must not go back in time.
    Frames(Arc<[TimedFrame]>),
}

impl DriverSettings {
    /// One word for `info`.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Process => "process",
            Self::Zenoh => "zenoh",
            Self::Recording(_) | Self::Frames(_) => "replay",
        }
    }
}

/// A frame and when it reaches the vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct TimedFrame {
    /// Arrival on the process's clock.
    pub arrival: Stamp,
    /// The frame.
    pub frame: Frame,
}

/// How simulated faults are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultSettings {
    /// Seed of the chance that loses packets; each sender has its own stream of it.
    pub seed: u64,
}

/// A boot id: drawn from the system's randomness, so that no two processes share one.
pub fn new_boot() -> u64 {
    use rand::TryRng;
    rand::rngs::SysRng
        .try_next_u64()
        .expect("the operating system has randomness, or no encryption would work either")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_boots_share_an_id() {
        assert_ne!(new_boot(), new_boot());
    }
}
