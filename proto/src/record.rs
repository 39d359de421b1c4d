//! The round record: raw information of one vehicle for everybody, so that each can estimate for itself.
//!
//! Cumulative odometry with its covariance growth, what was measured in the round, and the last rounds repeated:
//! a lost packet loses nothing. It holds no estimate.

use crate::check;
use crate::codec::{Body, DecodeError};
use crate::limits::{
    ECHOES_PER_RECORD_MAX, MEASURED_PER_ROUND_MAX, PACKET_BYTES_MAX, ROUNDS_PER_RECORD_MAX,
};
use crate::measured::Measured;
use serde::{Deserialize, Serialize};

/// Body of a packet on `x/odometry`. The envelope's time is the instant of the newest round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoundRecord {
    /// When this packet was sent, in nanoseconds of the sender's clock.
    #[serde(with = "crate::le")]
    pub sent_ns: i64,
    /// The sender's round period in microseconds.
    #[serde(with = "crate::le")]
    pub period_us: u32,
    /// Code of the sender's [`crate::status::Status`].
    pub status: u8,
    /// `body_from_target` of the sender: where others' sensors see it (its tag, its antenna). Absent: its body.
    pub body_from_target: Option<[f64; 6]>,
    /// State of the motion schedule (Cornejo & Nagpal, algorithm 3). Absent when the sender takes no part.
    pub schedule: Option<Schedule>,
    /// Echoes of some neighbours, in rotation.
    pub echoes: Vec<PeerEcho>,
    /// The newest round first, then as many of the rounds before it as fit.
    pub rounds: Vec<Round>,
}

/// One round: where odometry says the sender was, and what it measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Periods before the envelope's time.
    pub back: u8,
    /// Rises when odometry was interrupted for longer than can be bridged: across two segments it says nothing.
    pub segment: u8,
    /// Cumulative odometry at the round's instant, `odometry_from_body`, never reset within a boot.
    pub odometry_from_body: [f64; 6],
    /// Covariance that odometry has gathered since the boot.
    pub growth: Growth,
    /// What was measured in this round, nearest neighbours first.
    pub measured: Vec<Addressed>,
}

/// Additive covariance of cumulative odometry, in the odometry frame (rotation first).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Growth {
    /// The driver gave no noise.
    Unknown,
    /// Isotropic increments: `a, b[3], upper triangle of M[6], c` with
    /// `Sigma_ww = a I`, `Sigma_vw = [b]x`, `Sigma_vv = tr(M) I - M + c I`.
    Isotropic([f64; 11]),
    /// Any increments: the upper triangle of the 6 x 6 matrix, row by row.
    Full([f64; 21]),
}

/// A measurement together with whom it is of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Addressed {
    /// Hash of the measured vehicle's name.
    #[serde(with = "crate::le")]
    pub to: u64,
    /// The measurement.
    pub measured: Measured,
}

/// An echo together with whose packet was heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PeerEcho {
    /// Hash of that vehicle's name.
    #[serde(with = "crate::le")]
    pub to: u64,
    /// `sent_ns` of its packet: nanoseconds of *its* clock.
    #[serde(with = "crate::le")]
    pub heard_ns: i64,
    /// When it reached the sender, in nanoseconds of the sender's clock.
    #[serde(with = "crate::le")]
    pub received_ns: i64,
}

/// One vehicle's state in the motion schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Schedule {
    /// Motion round.
    #[serde(with = "crate::le")]
    pub round: u32,
    /// Phase of the round's election.
    #[serde(with = "crate::le")]
    pub phase: u16,
    /// 0 out, 1 taking part, 2 in the set (moves), 3 beaten (stays).
    pub state: u8,
    /// The random value of this phase.
    #[serde(with = "crate::le")]
    pub draw: u64,
    /// Moves made since the boot.
    #[serde(with = "crate::le")]
    pub moves: u32,
}

impl Body for RoundRecord {
    const BYTES_MAX: usize = PACKET_BYTES_MAX;
    fn check(&self) -> Result<(), DecodeError> {
        if let Some(mount) = &self.body_from_target {
            check::pose("body_from_target", mount)?;
        }
        check::at_most("echoes", &self.echoes, ECHOES_PER_RECORD_MAX)?;
        check::at_most("rounds", &self.rounds, ROUNDS_PER_RECORD_MAX)?;
        self.rounds.iter().try_for_each(Round::check)
    }
}

impl Round {
    fn check(&self) -> Result<(), DecodeError> {
        check::pose("odometry", &self.odometry_from_body)?;
        match &self.growth {
            Growth::Unknown => {}
            Growth::Isotropic(numbers) => check::finite("growth", numbers)?,
            Growth::Full(numbers) => check::finite("growth", numbers)?,
        }
        check::at_most("measured", &self.measured, MEASURED_PER_ROUND_MAX)?;
        self.measured
            .iter()
            .try_for_each(|addressed| addressed.measured.check())
    }
}
