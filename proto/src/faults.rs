//! Radio faults as simworld dictates them: loss, delay and who is out of range. The same rule live and virtual.

use crate::name::Name;
use serde::{Deserialize, Serialize};

/// JSON of `@sim/faults`: what the simulated radio does to every packet between vehicles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Faults {
    /// Probability that a packet is lost, drawn for each receiver.
    #[serde(default)]
    pub loss: f64,
    /// Seconds by which every packet is late.
    #[serde(default)]
    pub delay_s: f64,
    /// Pairs that cannot hear each other.
    #[serde(default)]
    pub silent: Vec<(Name, Name)>,
}

/// What becomes of one packet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// It arrives after so many seconds.
    Deliver {
        /// Delay in seconds.
        delay_s: f64,
    },
    /// It is lost by chance.
    Lost,
    /// The receiver is out of the sender's range.
    OutOfRange,
}

/// Why faults were refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultsError {
    /// Loss outside 0..1.
    #[error("loss must lie between 0 and 1")]
    Loss,
    /// A delay that is negative, infinite or beyond [`DELAY_MAX_S`].
    #[error("delay_s must lie between 0 and {DELAY_MAX_S}")]
    Delay,
    /// Not JSON of this form.
    #[error("not a faults document")]
    Malformed,
}

/// Longest delay that can be asked for, in seconds.
pub const DELAY_MAX_S: f64 = 10.0;

impl Faults {
    /// Parses and checks the JSON form.
    pub fn parse(bytes: &[u8]) -> Result<Self, FaultsError> {
        let faults: Self = serde_json::from_slice(bytes).map_err(|_| FaultsError::Malformed)?;
        faults.check()?;
        Ok(faults)
    }

    /// Checks the ranges.
    pub fn check(&self) -> Result<(), FaultsError> {
        if !(0.0..=1.0).contains(&self.loss) {
            return Err(FaultsError::Loss);
        }
        if !(0.0..=DELAY_MAX_S).contains(&self.delay_s) {
            return Err(FaultsError::Delay);
        }
        Ok(())
    }

    /// Judges one packet from one vehicle to another; `draw` is uniform in `[0, 1)`.
    pub fn judge(&self, from: Name, to: Name, draw: f64) -> Verdict {
        if self
            .silent
            .iter()
            .any(|&(a, b)| (a, b) == (from, to) || (b, a) == (from, to))
        {
            Verdict::OutOfRange
        } else if draw < self.loss {
            Verdict::Lost
        } else {
            Verdict::Deliver {
                delay_s: self.delay_s,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn range_comes_before_chance_and_both_ways() {
        let (a, b, c) = (
            Name::parse("a").unwrap(),
            Name::parse("b").unwrap(),
            Name::parse("c").unwrap(),
        );
        let faults = Faults {
            loss: 0.3,
            delay_s: 0.1,
            silent: vec![(a, b)],
        };
        assert_eq!(faults.judge(b, a, 0.9), Verdict::OutOfRange);
        assert_eq!(faults.judge(a, c, 0.29), Verdict::Lost);
        assert_eq!(faults.judge(a, c, 0.3), Verdict::Deliver { delay_s: 0.1 });
    }

    #[test]
    fn absurd_faults_are_refused() {
        assert_eq!(Faults::parse(br#"{"loss": 1.5}"#), Err(FaultsError::Loss));
        assert_eq!(
            Faults::parse(br#"{"delay_s": -1}"#),
            Err(FaultsError::Delay)
        );
        assert_eq!(
            Faults::parse(br#"{"los": 0.5}"#),
            Err(FaultsError::Malformed)
        );
    }
}
