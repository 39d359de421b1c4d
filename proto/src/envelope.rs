//! The 32 bytes that every packet between vehicles opens with: version, length, sequence, boot, sender, time taken.

use serde::{Deserialize, Serialize};

/// Length of an encoded envelope.
pub const ENVELOPE_BYTES: usize = 32;

/// What every packet opens with. All integers little end first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Envelope {
    /// [`crate::VERSION_MAJOR`] of the sender; another one is refused.
    pub major: u8,
    /// [`crate::VERSION_MINOR`] of the sender; a newer one may append bytes to a body.
    pub minor: u8,
    /// Length of the body that follows.
    #[serde(with = "crate::le")]
    pub body_bytes: u16,
    /// Rises by one with every packet of this boot and kind of message.
    #[serde(with = "crate::le")]
    pub sequence: u32,
    /// Drawn at random when the sender's process started.
    #[serde(with = "crate::le")]
    pub boot: u64,
    /// [`crate::name::Name::hash`] of the sender; must fit the key that the packet came under.
    #[serde(with = "crate::le")]
    pub sender: u64,
    /// The instant that the content speaks of, in nanoseconds of the sender's clock.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
}
