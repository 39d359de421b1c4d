//! The 12-number exchange of Knuth & Barooah: one vehicle's prior of one round, and what it measured of the addressee.

use crate::check;
use crate::codec::{Body, DecodeError};
use crate::limits::{MEASURED_PER_EXCHANGE_MAX, PACKET_BYTES_MAX};
use crate::measured::Measured;
use serde::{Deserialize, Serialize};

/// Body of a packet on `x/exchange/{to}`. The envelope's time is the round's instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exchange {
    /// When this packet was sent, in nanoseconds of the sender's clock.
    #[serde(with = "crate::le")]
    pub sent_ns: i64,
    /// Code of the sender's [`crate::status::Status`].
    pub status: u8,
    /// The addressee's last packet that the sender heard; absent when it has heard none.
    pub echo: Option<Echo>,
    /// `world_from_body` at the round's instant *before* the round is solved: rotation vector (rad), then translation
    /// (m). Absent when the sender has no estimate that others should use.
    pub prior: Option<[f64; 6]>,
    /// What the sender measured of the addressee in this round, at most one of each kind.
    pub measured: Vec<Measured>,
}

/// Two of the four time stamps of a clock offset: your packet as I heard it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Echo {
    /// `sent_ns` of that packet: nanoseconds of *your* clock.
    #[serde(with = "crate::le")]
    pub heard_ns: i64,
    /// When it reached me, in nanoseconds of my clock.
    #[serde(with = "crate::le")]
    pub received_ns: i64,
}

impl Body for Exchange {
    const BYTES_MAX: usize = PACKET_BYTES_MAX;
    fn check(&self) -> Result<(), DecodeError> {
        if let Some(prior) = &self.prior {
            check::pose("prior", prior)?;
        }
        check::at_most("measured", &self.measured, MEASURED_PER_EXCHANGE_MAX)?;
        self.measured.iter().try_for_each(Measured::check)
    }
}
