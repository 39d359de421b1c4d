//! The radio of a virtual flight: which packet arrives, and when. Only rules; whoever asks holds the packets.

use crate::bounded::{finite, not_negative, positive, probability};
use crate::streams::{Purpose, Streams};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A time during which packets do not get through.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Silence {
    /// When it begins, seconds since the start of the motion.
    #[serde(deserialize_with = "finite")]
    pub from_s: f64,
    /// When it is over, seconds.
    #[serde(deserialize_with = "finite")]
    pub to_s: f64,
    /// Which vehicles are cut off, by their index; everyone when empty.
    #[serde(default)]
    pub vehicles: Vec<usize>,
}

impl Silence {
    fn silences(&self, now_s: f64, from: usize, to: usize) -> bool {
        let everyone = self.vehicles.is_empty();
        let concerned = everyone || self.vehicles.contains(&from) || self.vehicles.contains(&to);
        concerned && (self.from_s..self.to_s).contains(&now_s)
    }
}

/// The radio's rules; by default perfect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RadioSettings {
    /// How far it reaches, metres; everywhere when not given.
    #[serde(deserialize_with = "reach", skip_serializing_if = "Option::is_none")]
    pub range_m: Option<f64>,
    /// The probability that a packet in range is lost, independently of every other.
    #[serde(deserialize_with = "probability")]
    pub loss: f64,
    /// How long a packet takes, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub delay_s: f64,
    /// When nothing gets through.
    pub silences: Vec<Silence>,
}

fn reach<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    positive(deserializer).map(Some)
}

impl RadioSettings {
    /// Whether one of two vehicles is silenced at a time, in seconds since the start of the motion.
    #[must_use]
    pub fn is_silenced(&self, now_s: f64, from: usize, to: usize) -> bool {
        self.silences
            .iter()
            .any(|silence| silence.silences(now_s, from, to))
    }
}

impl Default for RadioSettings {
    fn default() -> Self {
        Self {
            range_m: None,
            loss: 0.0,
            delay_s: 0.0,
            silences: Vec::new(),
        }
    }
}

/// Why a packet was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// The receiver was out of the radio's range.
    OutOfRange,
    /// One end was silenced.
    Silenced,
    /// By chance.
    Chance,
}

/// What becomes of one packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It arrives.
    Deliver {
        /// When, nanoseconds of the simulation's clock.
        at_ns: i64,
    },
    /// It never arrives.
    Lost(Reason),
}

/// What one directed link has carried so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCount {
    /// Packets handed to the radio.
    pub sent: u64,
    /// Their bytes.
    pub sent_bytes: u64,
    /// Packets that arrive.
    pub delivered: u64,
    /// Packets lost because the receiver was out of range.
    pub out_of_range: u64,
    /// Packets lost because one end was silenced.
    pub silenced: u64,
    /// Packets lost by chance.
    pub lost: u64,
}

impl std::ops::AddAssign for LinkCount {
    fn add_assign(&mut self, other: Self) {
        self.sent += other.sent;
        self.sent_bytes += other.sent_bytes;
        self.delivered += other.delivered;
        self.out_of_range += other.out_of_range;
        self.silenced += other.silenced;
        self.lost += other.lost;
    }
}

/// All links of a fleet, each with its own random stream.
#[derive(Clone, Debug)]
pub struct Radio {
    settings: RadioSettings,
    delay_ns: i64,
    streams: Streams,
    links: BTreeMap<(usize, usize), Link>,
}

#[derive(Clone, Debug)]
struct Link {
    chance: ChaCha8Rng,
    count: LinkCount,
}

impl Radio {
    /// A radio with these rules that has carried nothing yet.
    #[must_use]
    pub fn new(settings: &RadioSettings, streams: Streams) -> Self {
        Self {
            delay_ns: (settings.delay_s * 1e9).round() as i64,
            settings: settings.clone(),
            streams,
            links: BTreeMap::new(),
        }
    }

    /// Changes the rules during a flight; packets under way keep the delay they were sent with.
    pub fn change(&mut self, settings: &RadioSettings) {
        self.delay_ns = (settings.delay_s * 1e9).round() as i64;
        self.settings = settings.clone();
    }

    /// Sends one packet at `now_ns` (nanoseconds since the start of the motion, negative before it) over the link
    /// between two vehicles, by their indices, that are `distance_m` apart.
    pub fn transmit(
        &mut self,
        now_ns: i64,
        from: usize,
        to: usize,
        distance_m: f64,
        bytes: usize,
    ) -> Verdict {
        let streams = &self.streams;
        let link = self.links.entry((from, to)).or_insert_with(|| Link {
            chance: streams.pair(from, to, Purpose::Radio),
            count: LinkCount::default(),
        });
        link.count.sent += 1;
        link.count.sent_bytes += bytes as u64;
        // Drawn for every packet, so that range and silences do not shift the luck of later packets.
        let unlucky = link.chance.random::<f64>() < self.settings.loss;
        let now_s = now_ns as f64 * 1e-9;
        if self
            .settings
            .range_m
            .is_some_and(|range_m| distance_m >= range_m)
        {
            link.count.out_of_range += 1;
            Verdict::Lost(Reason::OutOfRange)
        } else if self.settings.is_silenced(now_s, from, to) {
            link.count.silenced += 1;
            Verdict::Lost(Reason::Silenced)
        } else if unlucky {
            link.count.lost += 1;
            Verdict::Lost(Reason::Chance)
        } else {
            link.count.delivered += 1;
            Verdict::Deliver {
                at_ns: now_ns + self.delay_ns,
            }
        }
    }

    /// What the link between two vehicles has carried, by their indices.
    #[must_use]
    pub fn count(&self, from: usize, to: usize) -> LinkCount {
        self.links
            .get(&(from, to))
            .map_or_else(LinkCount::default, |link| link.count)
    }

    /// Every link that was used, in the order (from, to), with what it carried.
    pub fn counts(&self) -> impl Iterator<Item = ((usize, usize), LinkCount)> + '_ {
        self.links.iter().map(|(ends, link)| (*ends, link.count))
    }

    /// What all links together have carried.
    #[must_use]
    pub fn total(&self) -> LinkCount {
        let mut total = LinkCount::default();
        for link in self.links.values() {
            total += link.count;
        }
        total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn radio(settings: &RadioSettings) -> Radio {
        Radio::new(settings, Streams::new(9, 0))
    }

    #[test]
    fn the_loss_asked_for_is_the_loss_counted() {
        for loss in [0.0, 0.3, 0.6, 1.0] {
            let mut radio = radio(&RadioSettings {
                loss,
                ..RadioSettings::default()
            });
            let n = 20_000;
            let arrived = (0..n)
                .filter(|k| {
                    matches!(
                        radio.transmit(k * 1000, 0, 1, 3.0, 100),
                        Verdict::Deliver { .. }
                    )
                })
                .count() as f64;
            let count = radio.count(0, 1);
            assert!(
                (arrived / n as f64 - (1.0 - loss)).abs() < 0.011,
                "loss {loss}: {arrived} of {n}"
            );
            assert_eq!(count.delivered as f64, arrived);
            assert_eq!(
                (count.sent, count.delivered + count.lost),
                (n as u64, n as u64)
            );
            assert_eq!(count.sent_bytes, 100 * n as u64);
        }
    }

    #[test]
    fn the_two_directions_and_every_pair_lose_independently() {
        let mut radio = radio(&RadioSettings {
            loss: 0.5,
            ..RadioSettings::default()
        });
        let n = 10_000;
        let together = (0..n)
            .filter(|k| {
                let forth = radio.transmit(*k, 0, 1, 1.0, 1);
                let back = radio.transmit(*k, 1, 0, 1.0, 1);
                forth == Verdict::Lost(Reason::Chance) && back == Verdict::Lost(Reason::Chance)
            })
            .count() as f64;
        assert!((together / n as f64 - 0.25).abs() < 0.02, "{together}");
    }

    #[test]
    fn a_packet_takes_the_delay_asked_for() {
        let mut radio = radio(&RadioSettings {
            delay_s: 0.1,
            ..RadioSettings::default()
        });
        assert_eq!(
            radio.transmit(-50, 0, 1, 1.0, 1),
            Verdict::Deliver { at_ns: 99_999_950 }
        );
    }

    #[test]
    fn the_reach_ends_at_its_range() {
        let mut radio = radio(&RadioSettings {
            range_m: Some(7.0),
            ..RadioSettings::default()
        });
        assert_eq!(
            radio.transmit(0, 0, 1, 6.999, 1),
            Verdict::Deliver { at_ns: 0 }
        );
        assert_eq!(
            radio.transmit(0, 0, 1, 7.0, 1),
            Verdict::Lost(Reason::OutOfRange)
        );
        assert_eq!(radio.count(0, 1).out_of_range, 1);
    }

    #[test]
    fn a_silence_cuts_off_its_vehicles_in_both_directions_and_ends() {
        let silence = Silence {
            from_s: 4.0,
            to_s: 14.0,
            vehicles: vec![2],
        };
        let mut radio = radio(&RadioSettings {
            silences: vec![silence],
            ..RadioSettings::default()
        });
        let second = 1_000_000_000;
        let silenced = Verdict::Lost(Reason::Silenced);
        assert_eq!(radio.transmit(5 * second, 2, 0, 1.0, 1), silenced);
        assert_eq!(radio.transmit(5 * second, 0, 2, 1.0, 1), silenced);
        assert_ne!(radio.transmit(5 * second, 0, 1, 1.0, 1), silenced);
        assert_ne!(radio.transmit(14 * second, 0, 2, 1.0, 1), silenced);
        assert_eq!(radio.total().silenced, 2);
    }
}
