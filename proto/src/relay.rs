//! Rounds of others, repeated once by a vehicle that heard them from their tellers, for those who are out of their reach.
//! Beside each stands what the relay knows of its teller's clock, as nobody can exchange echoes with who does not hear him.

use crate::anchor::Anchor;
use crate::check;
use crate::codec::{Body, DecodeError};
use crate::fixed::Fixed;
use crate::limits::{FIXES_PER_RECORD_MAX, PACKET_BYTES_MAX, RELAYED_PER_PACKET_MAX};
use crate::name::Name;
use crate::record::Round;
use serde::{Deserialize, Serialize};

/// Body of a packet on `x/relay`. The envelope is the relay's; its time is the instant of its own round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Relay {
    /// When this packet was sent, in nanoseconds of the relay's clock.
    #[serde(with = "crate::le")]
    pub sent_ns: i64,
    /// What others told the relay itself; nothing that was relayed to it.
    pub rounds: Vec<RelayedRound>,
}

/// One round of another vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RelayedRound {
    /// Who told it.
    pub of: Name,
    /// Which boot of it.
    #[serde(with = "crate::le")]
    pub boot: u64,
    /// The round's instant, in nanoseconds of the teller's clock.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// The teller's clock minus the relay's, nanoseconds.
    #[serde(with = "crate::le")]
    pub clock_offset_ns: i64,
    /// How far off that can be, nanoseconds.
    #[serde(with = "crate::le")]
    pub clock_error_ns: i64,
    /// The teller's round period in microseconds.
    #[serde(with = "crate::le")]
    pub period_us: u32,
    /// Code of the teller's [`crate::status::Status`].
    pub status: u8,
    /// Where others' sensors see the teller. Absent: its body.
    pub body_from_target: Option<[f64; 6]>,
    /// What its round record said; its `back` is 0.
    pub round: Round,
    /// Absolute fixes of this round.
    pub fixes: Vec<Fixed>,
    /// Where the teller was told that it was; absent in most.
    pub anchor: Option<Anchor>,
}

/// Longest clock error that is relayed, nanoseconds: that of the longest echo that is believed.
const CLOCK_ERROR_MAX_NS: i64 = 5_000_000_000;

impl Body for Relay {
    const BYTES_MAX: usize = PACKET_BYTES_MAX;
    fn check(&self) -> Result<(), DecodeError> {
        check::at_most("rounds", &self.rounds, RELAYED_PER_PACKET_MAX)?;
        self.rounds.iter().try_for_each(RelayedRound::check)
    }
}

impl RelayedRound {
    fn check(&self) -> Result<(), DecodeError> {
        let out_of_range = |field| Err(DecodeError::OutOfRange { field });
        if !(0..=CLOCK_ERROR_MAX_NS).contains(&self.clock_error_ns) {
            return out_of_range("clock_error_ns");
        }
        if self.round.back != 0 {
            return out_of_range("rounds: back");
        }
        if let Some(mount) = &self.body_from_target {
            check::pose("body_from_target", mount)?;
        }
        self.round.check()?;
        check::at_most("fixes", &self.fixes, FIXES_PER_RECORD_MAX)?;
        self.fixes.iter().try_for_each(Fixed::check)?;
        self.anchor.iter().try_for_each(Anchor::check)
    }
}
