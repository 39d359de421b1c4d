//! What a radio does to the packets of one directed link: plain numbers with their ranges. [`super::link`] obeys them.

use super::FaultsError;
use crate::envelope::ENVELOPE_BYTES;
use crate::limits::PACKET_BYTES_MAX;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Longest delay, jitter or holding back that can be asked for, each in seconds.
pub const DELAY_MAX_S: f64 = 10.0;
/// Shortest and longest mean length of a burst, in seconds.
pub const BURST_MEAN_S: RangeInclusive<f64> = 1e-3..=3_600.0;
/// Largest share of the time that bursts may take: a link that is always bad has a loss, not bursts.
pub const BURST_SHARE_MAX: f64 = 0.99;
/// Lowest and highest rate of a link, in bytes a second.
pub const RATE_BYTES_PER_S: RangeInclusive<f64> = 1.0..=1e9;
/// Smallest bucket: the longest packet must get through. The largest is [`BUCKET_BYTES_MAX`].
pub const BUCKET_BYTES_MIN: f64 = (ENVELOPE_BYTES + PACKET_BYTES_MAX) as f64;
/// Largest bucket, and largest queue, in bytes.
pub const BUCKET_BYTES_MAX: f64 = 1e9;

/// Everything that a link does to packets by chance or by their number; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Impairments {
    /// The probability that a packet is lost, independently of every other.
    pub loss: f64,
    /// How long a packet takes, seconds.
    pub delay_s: f64,
    /// It takes up to this much less or more, uniformly, but never less than nothing: seconds.
    pub jitter_s: f64,
    /// Losses that come together.
    pub burst: Option<Burst>,
    /// Packets held back, so that later ones overtake them.
    pub reorder: Option<Reorder>,
    /// Packets that come twice.
    pub duplicate: Option<Duplicate>,
    /// How many bytes fit through.
    pub rate_limit: Option<RateLimit>,
}

/// Losses in bursts, after Gilbert (1960) and Elliott (1963): the link is good or bad, and changes by itself.
///
/// The chain lives in time, not in packets, so its bursts last as long for a link that is hardly used as for a busy one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Burst {
    /// The share of all time in which the link is bad.
    pub share: f64,
    /// How long it stays bad on average, seconds.
    pub mean_s: f64,
    /// The probability that a packet is lost while it is bad, on top of the loss that holds always.
    #[serde(default = "certain")]
    pub loss: f64,
}

/// Packets that are held back.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reorder {
    /// The probability that a packet is held back.
    pub probability: f64,
    /// How much longer it then takes, seconds.
    pub delay_s: f64,
}

/// Packets that come twice.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Duplicate {
    /// The probability that a packet which arrives comes again.
    pub probability: f64,
    /// How long after the first the copy comes, seconds.
    pub delay_s: f64,
}

/// A token bucket on one directed link: what exceeds it waits in a bounded queue, what does not fit there is dropped.
/// What is lost later, in the air, has used its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateLimit {
    /// The rate in the long run, bytes a second.
    pub bytes_per_s: f64,
    /// What passes at once after a pause, bytes.
    pub bucket_bytes: f64,
    /// What waits at most, bytes; without it everything beyond the rate is dropped.
    #[serde(default)]
    pub queue_bytes: f64,
}

/// Settings of one directed link that differ from everyone's. `V` names a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkOverride<V> {
    /// Who speaks.
    pub from: V,
    /// Who hears; the other way is another link.
    pub to: V,
    /// [`Impairments::loss`] of this link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss: Option<f64>,
    /// [`Impairments::delay_s`] of this link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_s: Option<f64>,
    /// [`Impairments::jitter_s`] of this link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_s: Option<f64>,
    /// Whether nothing gets through this way.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub silent: bool,
}

fn certain() -> f64 {
    1.0
}

impl Impairments {
    /// The same with what a link has of its own.
    #[must_use]
    pub fn with<V>(self, own: &LinkOverride<V>) -> Self {
        Self {
            loss: own.loss.unwrap_or(self.loss),
            delay_s: own.delay_s.unwrap_or(self.delay_s),
            jitter_s: own.jitter_s.unwrap_or(self.jitter_s),
            ..self
        }
    }

    /// Checks every range. Fails with the first number that lies outside.
    pub fn check(&self) -> Result<(), FaultsError> {
        probability("loss", self.loss)?;
        delay("delay_s", self.delay_s)?;
        delay("jitter_s", self.jitter_s)?;
        self.burst.as_ref().map_or(Ok(()), Burst::check)?;
        self.reorder.as_ref().map_or(Ok(()), Reorder::check)?;
        self.duplicate.as_ref().map_or(Ok(()), Duplicate::check)?;
        self.rate_limit.as_ref().map_or(Ok(()), RateLimit::check)
    }
}

impl Burst {
    /// Checks every range.
    pub fn check(&self) -> Result<(), FaultsError> {
        within("burst.share", self.share, 0.0..=BURST_SHARE_MAX)?;
        within("burst.mean_s", self.mean_s, BURST_MEAN_S)?;
        probability("burst.loss", self.loss)
    }
}

impl Reorder {
    /// Checks every range.
    pub fn check(&self) -> Result<(), FaultsError> {
        probability("reorder.probability", self.probability)?;
        delay("reorder.delay_s", self.delay_s)
    }
}

impl Duplicate {
    /// Checks every range.
    pub fn check(&self) -> Result<(), FaultsError> {
        probability("duplicate.probability", self.probability)?;
        delay("duplicate.delay_s", self.delay_s)
    }
}

impl RateLimit {
    /// Checks every range, and that nothing waits longer than [`DELAY_MAX_S`].
    pub fn check(&self) -> Result<(), FaultsError> {
        let buckets = BUCKET_BYTES_MIN..=BUCKET_BYTES_MAX;
        within("rate_limit.bytes_per_s", self.bytes_per_s, RATE_BYTES_PER_S)?;
        within("rate_limit.bucket_bytes", self.bucket_bytes, buckets)?;
        let longest = (self.bytes_per_s * DELAY_MAX_S).min(BUCKET_BYTES_MAX);
        within("rate_limit.queue_bytes", self.queue_bytes, 0.0..=longest)
    }
}

impl<V: PartialEq> LinkOverride<V> {
    /// Checks every range, and that it joins two vehicles.
    pub fn check(&self) -> Result<(), FaultsError> {
        if self.from == self.to {
            return Err(FaultsError::Contradiction {
                field: "links",
                why: "a link joins two vehicles, not one with itself",
            });
        }
        probability("links.loss", self.loss.unwrap_or(0.0))?;
        delay("links.delay_s", self.delay_s.unwrap_or(0.0))?;
        delay("links.jitter_s", self.jitter_s.unwrap_or(0.0))
    }
}

fn probability(field: &'static str, value: f64) -> Result<(), FaultsError> {
    within(field, value, 0.0..=1.0)
}

fn delay(field: &'static str, value: f64) -> Result<(), FaultsError> {
    within(field, value, 0.0..=DELAY_MAX_S)
}

/// A number within its range; what is no number lies in none.
fn within(field: &'static str, value: f64, range: RangeInclusive<f64>) -> Result<(), FaultsError> {
    if range.contains(&value) {
        Ok(())
    } else {
        Err(FaultsError::OutOfRange {
            field,
            value,
            least: *range.start(),
            most: *range.end(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One setting put at a value.
    type Set = fn(&mut Impairments, f64);

    const BURST: Burst = Burst {
        share: 0.1,
        mean_s: 1.0,
        loss: 1.0,
    };
    const REORDER: Reorder = Reorder {
        probability: 0.1,
        delay_s: 0.1,
    };
    const DUPLICATE: Duplicate = Duplicate {
        probability: 0.1,
        delay_s: 0.1,
    };
    const RATE_LIMIT: RateLimit = RateLimit {
        bytes_per_s: 1_000.0,
        bucket_bytes: 2_000.0,
        queue_bytes: 0.0,
    };

    #[test]
    fn every_number_has_a_range_whose_ends_are_allowed_and_one_step_beyond_is_not() {
        let cases: [(&str, f64, f64, Set); 13] = [
            ("loss", 0.0, 1.0, |i, v| i.loss = v),
            ("delay_s", 0.0, 10.0, |i, v| i.delay_s = v),
            ("jitter_s", 0.0, 10.0, |i, v| i.jitter_s = v),
            ("burst.share", 0.0, 0.99, |i, v| {
                i.burst = Some(Burst { share: v, ..BURST });
            }),
            ("burst.mean_s", 1e-3, 3_600.0, |i, v| {
                i.burst = Some(Burst { mean_s: v, ..BURST });
            }),
            ("burst.loss", 0.0, 1.0, |i, v| {
                i.burst = Some(Burst { loss: v, ..BURST });
            }),
            ("reorder.probability", 0.0, 1.0, |i, v| {
                i.reorder = Some(Reorder {
                    probability: v,
                    ..REORDER
                });
            }),
            ("reorder.delay_s", 0.0, 10.0, |i, v| {
                i.reorder = Some(Reorder {
                    delay_s: v,
                    ..REORDER
                });
            }),
            ("duplicate.probability", 0.0, 1.0, |i, v| {
                i.duplicate = Some(Duplicate {
                    probability: v,
                    ..DUPLICATE
                });
            }),
            ("duplicate.delay_s", 0.0, 10.0, |i, v| {
                i.duplicate = Some(Duplicate {
                    delay_s: v,
                    ..DUPLICATE
                });
            }),
            ("rate_limit.bytes_per_s", 1.0, 1e9, |i, v| {
                i.rate_limit = Some(RateLimit {
                    bytes_per_s: v,
                    ..RATE_LIMIT
                });
            }),
            ("rate_limit.bucket_bytes", BUCKET_BYTES_MIN, 1e9, |i, v| {
                i.rate_limit = Some(RateLimit {
                    bucket_bytes: v,
                    ..RATE_LIMIT
                });
            }),
            // Ten seconds of the rate.
            ("rate_limit.queue_bytes", 0.0, 10_000.0, |i, v| {
                i.rate_limit = Some(RateLimit {
                    queue_bytes: v,
                    ..RATE_LIMIT
                });
            }),
        ];
        for (name, least, most, set) in cases {
            let judged = |value: f64| {
                let mut impairments = Impairments::default();
                set(&mut impairments, value);
                impairments.check()
            };
            assert_eq!((judged(least), judged(most)), (Ok(()), Ok(())), "{name}");
            let beyond = [
                least.next_down(),
                most.next_up(),
                f64::NAN,
                f64::INFINITY,
                f64::NEG_INFINITY,
            ];
            for value in beyond {
                assert!(
                    matches!(judged(value), Err(FaultsError::OutOfRange { field, .. }) if field == name),
                    "{name} = {value}: {:?}",
                    judged(value)
                );
            }
        }
    }

    #[test]
    fn a_link_takes_over_what_it_does_not_set_itself() {
        let everyones = Impairments {
            loss: 0.1,
            delay_s: 0.2,
            jitter_s: 0.05,
            burst: Some(BURST),
            ..Impairments::default()
        };
        let own = LinkOverride {
            from: 0,
            to: 1,
            loss: Some(0.9),
            delay_s: None,
            jitter_s: None,
            silent: false,
        };
        let expected = Impairments {
            loss: 0.9,
            ..everyones
        };
        assert_eq!(everyones.with(&own), expected);
    }
}
