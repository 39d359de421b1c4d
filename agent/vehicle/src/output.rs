//! What a vehicle wants done: packets sent, documents published, and to be woken.

use crate::checkpoint::Checkpoint;
use crate::input::PacketKey;
use skein_estimation::time::Stamp;
use skein_proto::document::{EstimateDocument, HealthDocument};
use skein_proto::name::Name;

use crate::work::Work;

/// One wish. [`crate::Vehicle::poll`] hands them out in order and ends with [`Output::WakeAt`].
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Send a packet to the other vehicles: best effort, at once.
    Send {
        /// Under which key, without the fleet.
        key: PacketKey,
        /// The encoded packet.
        bytes: Vec<u8>,
    },
    /// The newest estimate: publish it and keep it for queries.
    Estimate {
        /// The binary form: an envelope and a [`skein_proto::estimate::Estimate`].
        packet: Vec<u8>,
        /// The JSON form.
        document: Box<EstimateDocument>,
    },
    /// The newest health: publish it and keep it for queries.
    Health(Box<HealthDocument>),
    /// Where the vehicle is, to be kept for a restart. Only a pose that can be told is ever written down.
    Checkpoint(Checkpoint),
    /// Ask a neighbour for its last rounds. Each reply comes back as an [`crate::Input::Packet`].
    Ask {
        /// Whom.
        to: Name,
        /// Which boot of it.
        boot: u64,
        /// Only rounds after this, in nanoseconds of its clock.
        since_ns: i64,
    },
    /// Reply to an [`crate::Input::Asked`].
    Answer {
        /// The shell's number for the question.
        query: u64,
        /// The encoded packets, in this order; none when the question was for nobody.
        packets: Vec<Vec<u8>>,
    },
    /// Run a long computation somewhere else, and bring what comes of it as an [`crate::Input::Done`]. One that is dropped
    /// is missed by nobody: a newer one follows.
    Work(Box<Work>),
    /// Nothing more to do until this instant, or the next input. Always the last.
    WakeAt(Stamp),
}
