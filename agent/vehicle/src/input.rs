//! What a vehicle is given: readings, packets, comings and goings, and the passing of time.

use serde::{Deserialize, Serialize};
use skein_proto::keys::Key;
use skein_proto::name::Name;

use crate::work::Done;

/// One event. It reaches [`crate::Vehicle::handle`] together with its arrival time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Input {
    /// A driver's frame, in either form of [`skein_proto::frame`].
    Frame {
        /// Which of the configured sensors it is from.
        sensor: Name,
        /// The encoded frame, not yet checked.
        bytes: Vec<u8>,
    },
    /// A packet from another vehicle of the fleet.
    Packet {
        /// The key it came under, without the fleet.
        key: PacketKey,
        /// The packet, not yet checked.
        bytes: Vec<u8>,
    },
    /// A liveliness token appeared.
    Appeared {
        /// Whose.
        vehicle: Name,
        /// Of which boot.
        boot: u64,
    },
    /// A liveliness token is gone.
    Vanished {
        /// Whose.
        vehicle: Name,
        /// Of which boot.
        boot: u64,
    },
    /// The time that [`crate::Output::WakeAt`] asked for has come.
    Wake,
    /// An operator says where the vehicle is.
    SetPose {
        /// `world_from_body`: rotation vector (rad), then translation (m).
        world_from_body: [f64; 6],
        /// How well the operator knows its rotation: standard deviation per axis (rad).
        rotation_sigma_rad: f64,
        /// How well the operator knows its translation: standard deviation per axis (m).
        translation_sigma_m: f64,
    },
    /// A long computation that [`crate::Output::Work`] asked for has ended.
    Done {
        /// Its number.
        number: u64,
        /// What came of it. It is not written into input logs: whoever repeats one runs the computation again.
        #[serde(skip)]
        done: Option<Box<Done>>,
    },
    /// Somebody asks for this vehicle's last rounds. It is answered by [`crate::Output::Answer`].
    Asked {
        /// The shell's number for the question.
        query: u64,
        /// Only rounds after this, in nanoseconds of this vehicle's clock.
        since_ns: i64,
        /// The boot that is asked.
        boot: u64,
    },
}

/// The keys under which vehicles send each other packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum PacketKey {
    /// An exchange addressed to one vehicle.
    Exchange {
        /// Sender.
        from: Name,
        /// Addressee.
        to: Name,
    },
    /// A round record.
    Odometry {
        /// Sender.
        from: Name,
    },
    /// An anonymous feature set.
    Features {
        /// Sender.
        from: Name,
    },
    /// A reply to [`crate::Output::Ask`].
    Backlog {
        /// Who was asked.
        from: Name,
    },
    /// Rounds of others, repeated.
    Relay {
        /// Who repeats them.
        from: Name,
    },
}

impl PacketKey {
    /// The packet key of a contract key; none for keys that carry no packets between vehicles.
    pub fn of(key: &Key) -> Option<Self> {
        match *key {
            Key::Exchange { from, to } => Some(Self::Exchange { from, to }),
            Key::Odometry { from } => Some(Self::Odometry { from }),
            Key::Features { from } => Some(Self::Features { from }),
            Key::Backlog { of } => Some(Self::Backlog { from: of }),
            Key::Relay { from } => Some(Self::Relay { from }),
            _ => None,
        }
    }

    /// The contract key.
    pub fn key(&self) -> Key {
        match *self {
            Self::Exchange { from, to } => Key::Exchange { from, to },
            Self::Odometry { from } => Key::Odometry { from },
            Self::Features { from } => Key::Features { from },
            Self::Backlog { from } => Key::Backlog { of: from },
            Self::Relay { from } => Key::Relay { from },
        }
    }

    /// Who sent it, as the key says.
    pub fn from(&self) -> Name {
        match *self {
            Self::Exchange { from, .. }
            | Self::Odometry { from }
            | Self::Features { from }
            | Self::Backlog { from }
            | Self::Relay { from } => from,
        }
    }
}
