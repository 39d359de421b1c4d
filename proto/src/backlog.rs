//! The last raw rounds of one vehicle, for a neighbour that has missed some: the question, and a packet of the answer.

use crate::codec::{Body, DecodeError};
use crate::fixed::Fixed;
use crate::keys::{boot_text, parse_boot};
use crate::limits::{BACKLOG_BYTES_MAX, BACKLOG_ROUNDS_PER_PACKET_MAX, FIXES_PER_RECORD_MAX};
use crate::record::Round;
use crate::{check, name::Name};
use serde::{Deserialize, Serialize};

/// Body of a reply to a query for `x/backlog`. The envelope's time is the instant of its newest round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Backlog {
    /// Rounds of this answer that come in the replies after this one.
    #[serde(with = "crate::le")]
    pub remaining: u16,
    /// The oldest first.
    pub rounds: Vec<BacklogRound>,
}

/// One round with its instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BacklogRound {
    /// Its instant, in nanoseconds of the sender's clock.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// What the round record said; its `back` is 0.
    pub round: Round,
    /// Absolute fixes of this round.
    pub fixes: Vec<Fixed>,
}

/// What a query for `x/backlog` asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Question {
    /// Only rounds later than this, in nanoseconds of the asked vehicle's clock.
    pub since_ns: i64,
    /// The boot that is asked; another one has nothing to say.
    pub boot: u64,
}

impl Body for Backlog {
    const BYTES_MAX: usize = BACKLOG_BYTES_MAX;
    fn check(&self) -> Result<(), DecodeError> {
        check::at_most("rounds", &self.rounds, BACKLOG_ROUNDS_PER_PACKET_MAX)?;
        let out_of_range = |field| Err(DecodeError::OutOfRange { field });
        if !self.rounds.is_sorted_by(|a, b| a.taken_ns < b.taken_ns) {
            return out_of_range("rounds: taken_ns");
        }
        if self.rounds.iter().any(|entry| entry.round.back != 0) {
            return out_of_range("rounds: back");
        }
        self.rounds.iter().try_for_each(BacklogRound::check)
    }
}

impl BacklogRound {
    fn check(&self) -> Result<(), DecodeError> {
        self.round.check()?;
        check::at_most("fixes", &self.fixes, FIXES_PER_RECORD_MAX)?;
        self.fixes.iter().try_for_each(Fixed::check)
    }
}

impl Question {
    /// As it stands behind the `?` of a selector.
    pub fn to_parameters(&self) -> String {
        format!("since_ns={};boot={}", self.since_ns, boot_text(self.boot))
    }

    /// The selector by which a vehicle is asked.
    pub fn selector(&self, fleet: Name, of: Name) -> String {
        let key = crate::keys::Key::Backlog { of }.in_fleet(fleet);
        format!("{key}?{}", self.to_parameters())
    }

    /// Parses the parameters of a query. Those of Zenoh itself, which begin with an underscore, are let through; any other,
    /// and one that is missing or no number, makes it no question.
    pub fn parse(parameters: &str) -> Option<Self> {
        let (mut since_ns, mut boot) = (None, None);
        for parameter in parameters.split(';').filter(|p| !p.is_empty()) {
            match parameter.split_once('=')? {
                ("since_ns", value) => since_ns = Some(value.parse().ok()?),
                ("boot", value) => boot = Some(parse_boot(value).ok()?),
                (own, _) if own.starts_with('_') => {}
                _ => return None,
            }
        }
        Some(Self {
            since_ns: since_ns?,
            boot: boot?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_question_is_read_as_it_was_asked_and_half_a_question_is_none() {
        let question = Question {
            since_ns: -5,
            boot: 0xab,
        };
        let parameters = question.to_parameters();
        assert_eq!(parameters, "since_ns=-5;boot=00000000000000ab");
        assert_eq!(Question::parse(&parameters), Some(question));
        let with_own = format!("_time=[now(-1s)..];{parameters}");
        assert_eq!(Question::parse(&with_own), Some(question));
        for wrong in [
            "",
            "since_ns=5",
            "boot=00000000000000ab",
            "since_ns=now;boot=00000000000000ab",
            "since_ns=5;boot=ab",
            "since_ns=5;boot=00000000000000ab;until_ns=6",
        ] {
            assert_eq!(Question::parse(wrong), None, "{wrong}");
        }
    }
}
