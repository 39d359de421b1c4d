//! The round record: raw information of one vehicle for everybody, so that each can estimate for itself.
//!
//! Cumulative odometry with its covariance growth, what was measured in the round, where the sender was told to be, and
//! the last rounds repeated: a lost packet loses nothing. It holds no estimate.

use crate::anchor::Anchor;
use crate::check;
use crate::codec::{Body, DecodeError};
use crate::fixed::Fixed;
use crate::growth::Growth;
use crate::limits::{
    ECHOES_PER_RECORD_MAX, FIXES_PER_RECORD_MAX, MEASURED_PER_ROUND_MAX, PACKET_BYTES_MAX,
    ROUNDS_PER_RECORD_MAX,
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
    /// Where the sender was told that it was; absent when nobody told it, and in most records. Since version 1.1.
    pub anchor: Option<Anchor>,
    /// Absolute fixes of the rounds above, newest first. Since version 1.1.
    pub fixes: Vec<RoundFix>,
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

/// An absolute fix together with its round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoundFix {
    /// Which round, as [`Round::back`]; it is in the record.
    pub back: u8,
    /// The fix.
    pub fix: Fixed,
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
        self.rounds.iter().try_for_each(Round::check)?;
        self.anchor.iter().try_for_each(Anchor::check)?;
        check::at_most("fixes", &self.fixes, FIXES_PER_RECORD_MAX)?;
        self.fixes.iter().try_for_each(|fix| self.check_fix(fix))
    }
    fn appended_since(minor: u8) -> usize {
        // The anchor and the fixes.
        if minor < 1 { 2 } else { 0 }
    }
}

impl RoundRecord {
    fn check_fix(&self, fix: &RoundFix) -> Result<(), DecodeError> {
        if self.rounds.iter().any(|round| round.back == fix.back) {
            fix.fix.check()
        } else {
            Err(DecodeError::OutOfRange {
                field: "fixes: back",
            })
        }
    }
}

impl Round {
    pub(crate) fn check(&self) -> Result<(), DecodeError> {
        check::pose("odometry", &self.odometry_from_body)?;
        self.growth.check("growth")?;
        check::at_most("measured", &self.measured, MEASURED_PER_ROUND_MAX)?;
        self.measured
            .iter()
            .try_for_each(|addressed| addressed.measured.check())
    }
}
