//! One directed link of a bad radio: judges packet after packet. The same rule in a virtual flight and in a live agent.
//!
//! It knows neither a clock nor chance: the time and the draws are arguments. A packet passes, in this order, whatever
//! bars the link, the sender's rate limit, loss by chance, loss in a burst, and then takes its time.

use super::impairments::{Burst, Impairments, RateLimit};
use serde::{Deserialize, Serialize};

/// What keeps everything from a link for now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Barrier {
    /// The receiver is out of the sender's range.
    OutOfRange,
    /// One end, or this direction, is silenced.
    Silenced,
    /// The two ends are in different groups of a partition.
    Partitioned,
}

/// Why a packet was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// Nothing gets through for now.
    Barred(Barrier),
    /// More was sent than the link carries, and the queue is full.
    RateLimited,
    /// By chance.
    Chance,
    /// In a burst.
    Burst,
}

/// What holds for a link at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkRule {
    /// What it does to packets.
    pub impairments: Impairments,
    /// What keeps all of them from it.
    pub barrier: Option<Barrier>,
}

/// What becomes of one packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It arrives.
    Deliver {
        /// When, nanoseconds of the caller's clock.
        at_ns: i64,
        /// When it comes a second time, if it does; not before the first.
        copy_at_ns: Option<i64>,
    },
    /// It never arrives.
    Lost(Reason),
}

/// The luck of one packet, each draw uniform in `[0, 1)`. Every packet has all of them, whatever is switched on, so that
/// no setting shifts the luck of later packets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draws {
    /// Decides on loss by chance.
    pub loss: f64,
    /// Decides whether the link is bad.
    pub burst: f64,
    /// Decides on loss while it is bad.
    pub burst_loss: f64,
    /// Its part of the jitter.
    pub jitter: f64,
    /// Decides whether it is held back.
    pub reorder: f64,
    /// Decides whether it comes twice.
    pub duplicate: f64,
}

impl Draws {
    /// Draws for one packet: one from the stream of the loss by chance and five from another, so that loss by chance
    /// stays the same whatever else is drawn.
    pub fn take(chance: &mut impl FnMut() -> f64, others: &mut impl FnMut() -> f64) -> Self {
        Self {
            loss: chance(),
            burst: others(),
            burst_loss: others(),
            jitter: others(),
            reorder: others(),
            duplicate: others(),
        }
    }
}

/// What one directed link has carried so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct LinkCount {
    /// Packets handed to the radio.
    pub sent: u64,
    /// Their bytes.
    pub sent_bytes: u64,
    /// Packets that arrive, copies not counted.
    pub delivered: u64,
    /// Packets lost because the receiver was out of range.
    pub out_of_range: u64,
    /// Packets lost because one end, or this direction, was silenced.
    pub silenced: u64,
    /// Packets lost between the groups of a partition.
    pub partitioned: u64,
    /// Packets that the rate limit dropped.
    pub rate_limited: u64,
    /// Packets lost by chance.
    pub lost: u64,
    /// Packets lost in a burst.
    pub burst: u64,
    /// Packets that arrive twice.
    pub duplicated: u64,
    /// Packets that arrive before one that was sent earlier.
    pub reordered: u64,
}

impl LinkCount {
    /// Packets that never arrive, whatever the reason.
    #[must_use]
    pub const fn taken(&self) -> u64 {
        self.out_of_range
            + self.silenced
            + self.partitioned
            + self.rate_limited
            + self.lost
            + self.burst
    }

    /// What happened to packets beside arriving once and in order, by its name in JSON.
    #[must_use]
    pub const fn by_reason(&self) -> [(&'static str, u64); 8] {
        [
            ("lost", self.lost),
            ("burst", self.burst),
            ("silenced", self.silenced),
            ("partitioned", self.partitioned),
            ("out_of_range", self.out_of_range),
            ("rate_limited", self.rate_limited),
            ("duplicated", self.duplicated),
            ("reordered", self.reordered),
        ]
    }

    fn lose(&mut self, reason: Reason) {
        let count = match reason {
            Reason::Barred(Barrier::OutOfRange) => &mut self.out_of_range,
            Reason::Barred(Barrier::Silenced) => &mut self.silenced,
            Reason::Barred(Barrier::Partitioned) => &mut self.partitioned,
            Reason::RateLimited => &mut self.rate_limited,
            Reason::Chance => &mut self.lost,
            Reason::Burst => &mut self.burst,
        };
        *count += 1;
    }
}

impl std::ops::AddAssign for LinkCount {
    fn add_assign(&mut self, other: Self) {
        self.sent += other.sent;
        self.sent_bytes += other.sent_bytes;
        self.delivered += other.delivered;
        self.out_of_range += other.out_of_range;
        self.silenced += other.silenced;
        self.partitioned += other.partitioned;
        self.rate_limited += other.rate_limited;
        self.lost += other.lost;
        self.burst += other.burst;
        self.duplicated += other.duplicated;
        self.reordered += other.reordered;
    }
}

/// The state of one directed link: whether it is bad, how full its bucket is, what it has carried.
#[derive(Clone, Debug, Default)]
pub struct Link {
    weather: Option<Weather>,
    bucket: Option<Bucket>,
    latest_arrival_ns: Option<i64>,
    count: LinkCount,
}

/// Whether the link was bad, and when that was seen last.
#[derive(Clone, Copy, Debug)]
struct Weather {
    seen_ns: i64,
    bad: bool,
}

/// Bytes that pass at once; what waits counts against them, so that they may be negative.
#[derive(Clone, Copy, Debug)]
struct Bucket {
    filled_ns: i64,
    bytes: f64,
}

impl Link {
    /// What it has carried.
    #[must_use]
    pub const fn count(&self) -> LinkCount {
        self.count
    }

    /// Judges a packet of `bytes` bytes that is sent at `now_ns`, nanoseconds of the caller's clock. The settings of
    /// `rule` are as [`Impairments::check`] wants them, and may change between packets.
    pub fn judge(&mut self, rule: &LinkRule, now_ns: i64, bytes: usize, draws: &Draws) -> Verdict {
        self.count.sent += 1;
        self.count.sent_bytes += bytes as u64;
        match self.fate(rule, now_ns, bytes, draws) {
            Ok(delay_s) => self.deliver(&rule.impairments, now_ns, delay_s, draws),
            Err(reason) => {
                self.count.lose(reason);
                Verdict::Lost(reason)
            }
        }
    }

    /// How many seconds the packet takes, or why it is lost.
    fn fate(
        &mut self,
        rule: &LinkRule,
        now_ns: i64,
        bytes: usize,
        draws: &Draws,
    ) -> Result<f64, Reason> {
        let impairments = &rule.impairments;
        // The weather changes also while nothing gets through.
        let bad = self.is_bad(impairments.burst.as_ref(), now_ns, draws.burst);
        if let Some(barrier) = rule.barrier {
            return Err(Reason::Barred(barrier));
        }
        let wait_s = self.wait_s(impairments.rate_limit.as_ref(), now_ns, bytes)?;
        if draws.loss < impairments.loss {
            return Err(Reason::Chance);
        }
        if bad.is_some_and(|burst| draws.burst_loss < burst.loss) {
            return Err(Reason::Burst);
        }
        let jitter_s = impairments.jitter_s * (2.0 * draws.jitter - 1.0);
        let held_back_s = impairments
            .reorder
            .filter(|reorder| draws.reorder < reorder.probability)
            .map_or(0.0, |reorder| reorder.delay_s);
        Ok(wait_s + (impairments.delay_s + jitter_s).max(0.0) + held_back_s)
    }

    /// The burst that is on, if there is one. Between two looks `dt` apart the chain that stays bad for `mean_s` on
    /// average and is bad for `share` of the time forgets with the time constant `mean_s (1 - share)`:
    /// `P(bad) = share + (was bad - share) exp(-dt / (mean_s (1 - share)))`.
    fn is_bad<'a>(
        &mut self,
        burst: Option<&'a Burst>,
        now_ns: i64,
        draw: f64,
    ) -> Option<&'a Burst> {
        let Some(burst) = burst else {
            self.weather = None;
            return None;
        };
        let (seen_ns, chance) = match self.weather {
            None => (now_ns, burst.share),
            Some(before) => {
                let was = if before.bad { 1.0 } else { 0.0 };
                let memory_s = burst.mean_s * (1.0 - burst.share);
                let memory = (-elapsed_s(before.seen_ns, now_ns) / memory_s).exp();
                let chance = burst.share + (was - burst.share) * memory;
                (before.seen_ns.max(now_ns), chance)
            }
        };
        let bad = draw < chance;
        self.weather = Some(Weather { seen_ns, bad });
        bad.then_some(burst)
    }

    /// How many seconds the packet waits for its turn.
    fn wait_s(
        &mut self,
        limit: Option<&RateLimit>,
        now_ns: i64,
        bytes: usize,
    ) -> Result<f64, Reason> {
        let Some(limit) = limit else {
            self.bucket = None;
            return Ok(0.0);
        };
        let before = self.bucket.unwrap_or(Bucket {
            filled_ns: now_ns,
            bytes: limit.bucket_bytes,
        });
        let flowed = limit.bytes_per_s * elapsed_s(before.filled_ns, now_ns);
        let filled = Bucket {
            filled_ns: before.filled_ns.max(now_ns),
            bytes: (before.bytes + flowed).min(limit.bucket_bytes),
        };
        let left = filled.bytes - bytes as f64;
        if left < -limit.queue_bytes {
            self.bucket = Some(filled);
            return Err(Reason::RateLimited);
        }
        self.bucket = Some(Bucket {
            bytes: left,
            ..filled
        });
        Ok((-left).max(0.0) / limit.bytes_per_s)
    }

    fn deliver(
        &mut self,
        impairments: &Impairments,
        now_ns: i64,
        delay_s: f64,
        draws: &Draws,
    ) -> Verdict {
        let at_ns = now_ns.saturating_add(nanos(delay_s));
        let copy_at_ns = impairments
            .duplicate
            .filter(|duplicate| draws.duplicate < duplicate.probability)
            .map(|duplicate| at_ns.saturating_add(nanos(duplicate.delay_s)));
        self.count.delivered += 1;
        self.count.duplicated += u64::from(copy_at_ns.is_some());
        let latest_ns = self.latest_arrival_ns.unwrap_or(at_ns);
        self.count.reordered += u64::from(at_ns < latest_ns);
        self.latest_arrival_ns = Some(latest_ns.max(at_ns));
        Verdict::Deliver { at_ns, copy_at_ns }
    }
}

/// Seconds between two times; none when the clock was read in another order.
fn elapsed_s(from_ns: i64, to_ns: i64) -> f64 {
    to_ns.saturating_sub(from_ns).max(0) as f64 * 1e-9
}

fn nanos(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::{Duplicate, Reorder};

    const SECOND_NS: i64 = 1_000_000_000;
    /// Luck in the middle of everything.
    const MIDDLE: Draws = Draws {
        loss: 0.5,
        burst: 0.5,
        burst_loss: 0.5,
        jitter: 0.5,
        reorder: 0.5,
        duplicate: 0.5,
    };

    fn rule(impairments: Impairments) -> LinkRule {
        LinkRule {
            impairments,
            barrier: None,
        }
    }

    fn arrives(at_ns: i64) -> Verdict {
        Verdict::Deliver {
            at_ns,
            copy_at_ns: None,
        }
    }

    #[test]
    fn a_perfect_link_delivers_at_once() {
        let mut link = Link::default();
        assert_eq!(
            link.judge(&LinkRule::default(), -7, 100, &MIDDLE),
            arrives(-7)
        );
        assert_eq!((link.count().sent, link.count().sent_bytes), (1, 100));
    }

    #[test]
    fn what_bars_a_link_comes_before_its_rate_and_chance() {
        let mut link = Link::default();
        let impairments = Impairments {
            loss: 1.0,
            rate_limit: Some(RateLimit {
                bytes_per_s: 1.0,
                bucket_bytes: 1_000.0,
                queue_bytes: 0.0,
            }),
            ..Impairments::default()
        };
        let barred = LinkRule {
            impairments,
            barrier: Some(Barrier::Partitioned),
        };
        let mut judge = |rule: &LinkRule| link.judge(rule, 0, 800, &MIDDLE);
        let partitioned = Verdict::Lost(Reason::Barred(Barrier::Partitioned));
        assert_eq!(judge(&barred), partitioned);
        // The bucket is still full; a packet that is then lost by chance has used its bytes.
        assert_eq!(judge(&rule(impairments)), Verdict::Lost(Reason::Chance));
        assert_eq!(
            judge(&rule(impairments)),
            Verdict::Lost(Reason::RateLimited)
        );
        let count = link.count();
        assert_eq!(
            (count.partitioned, count.lost, count.rate_limited),
            (1, 1, 1)
        );
        assert_eq!((count.taken(), count.sent), (3, 3));
    }

    #[test]
    fn jitter_lies_about_the_delay_but_never_before_the_sending() {
        let impairments = Impairments {
            delay_s: 0.1,
            jitter_s: 0.3,
            ..Impairments::default()
        };
        let arrival_ns = |jitter: f64| {
            let draws = Draws { jitter, ..MIDDLE };
            match Link::default().judge(&rule(impairments), 5, 1, &draws) {
                Verdict::Deliver { at_ns, .. } => at_ns,
                Verdict::Lost(reason) => panic!("{reason:?}"),
            }
        };
        assert_eq!(arrival_ns(0.0), 5);
        assert_eq!(arrival_ns(0.5), 100_000_005);
        assert_eq!(arrival_ns(0.75), 250_000_005);
    }

    #[test]
    fn a_packet_held_back_is_overtaken_by_the_next_and_a_copy_comes_behind_its_packet() {
        let impairments = Impairments {
            delay_s: 0.1,
            reorder: Some(Reorder {
                probability: 0.4,
                delay_s: 0.3,
            }),
            duplicate: Some(Duplicate {
                probability: 0.4,
                delay_s: 0.05,
            }),
            ..Impairments::default()
        };
        let mut link = Link::default();
        let held_back = Draws {
            reorder: 0.39,
            ..MIDDLE
        };
        let twice = Draws {
            duplicate: 0.39,
            ..MIDDLE
        };
        let rule = rule(impairments);
        assert_eq!(
            link.judge(&rule, 0, 1, &held_back),
            arrives(4 * SECOND_NS / 10)
        );
        assert_eq!(
            link.judge(&rule, SECOND_NS / 10, 1, &twice),
            Verdict::Deliver {
                at_ns: SECOND_NS / 5,
                copy_at_ns: Some(SECOND_NS / 4),
            }
        );
        let count = link.count();
        assert_eq!(
            (count.delivered, count.reordered, count.duplicated),
            (2, 1, 1)
        );
    }

    #[test]
    fn a_bucket_lets_a_burst_through_queues_what_fits_and_drops_the_rest() {
        let impairments = Impairments {
            rate_limit: Some(RateLimit {
                bytes_per_s: 1_000.0,
                bucket_bytes: 2_000.0,
                queue_bytes: 500.0,
            }),
            ..Impairments::default()
        };
        let mut link = Link::default();
        let mut send = |now_ns| link.judge(&rule(impairments), now_ns, 1_000, &MIDDLE);
        assert_eq!((send(0), send(0)), (arrives(0), arrives(0)));
        // The bucket is empty: 500 bytes may wait, 1000 do not fit.
        assert_eq!(send(0), Verdict::Lost(Reason::RateLimited));
        // Half a second later half of it has room, and the packet waits for the other half.
        assert_eq!(send(SECOND_NS / 2), arrives(SECOND_NS));
        // A long pause fills the bucket, and no more than that.
        assert_eq!(send(60 * SECOND_NS), arrives(60 * SECOND_NS));
        assert_eq!(send(60 * SECOND_NS), arrives(60 * SECOND_NS));
        assert_eq!(send(60 * SECOND_NS), Verdict::Lost(Reason::RateLimited));
    }

    #[test]
    fn the_weather_holds_for_a_moment_and_is_forgotten_after_long() {
        let impairments = Impairments {
            burst: Some(Burst {
                share: 0.2,
                mean_s: 1.0,
                loss: 1.0,
            }),
            ..Impairments::default()
        };
        let mut link = Link::default();
        let mut lost = |now_ns, burst| {
            let draws = Draws { burst, ..MIDDLE };
            link.judge(&rule(impairments), now_ns, 1, &draws) == Verdict::Lost(Reason::Burst)
        };
        assert!(lost(0, 0.19), "at first it is bad with the share");
        assert!(lost(1, 0.999_999), "a nanosecond changes nothing");
        // After its memory of 0.8 s: 0.2 + 0.8 / e = 0.4943.
        assert!(lost(800_000_001, 0.494));
        assert!(!lost(1_600_000_001, 0.495));
        assert!(!lost(1_600_000_001, 1e-6), "and no time nothing");
        assert!(!lost(1_000_000_000, 1e-6), "nor does time run back");
        assert!(
            lost(1_000 * SECOND_NS, 0.199),
            "later it is bad with the share again"
        );
    }

    #[test]
    fn settings_that_nobody_checked_and_times_at_the_end_of_time_do_no_harm() {
        let absurd = |number: f64| Impairments {
            loss: number,
            delay_s: number,
            jitter_s: number,
            burst: Some(Burst {
                share: number,
                mean_s: number,
                loss: number,
            }),
            reorder: Some(Reorder {
                probability: number,
                delay_s: number,
            }),
            duplicate: Some(Duplicate {
                probability: number,
                delay_s: number,
            }),
            rate_limit: Some(RateLimit {
                bytes_per_s: number,
                bucket_bytes: number,
                queue_bytes: number,
            }),
        };
        let mut link = Link::default();
        for number in [f64::NAN, f64::INFINITY, -1e300, 0.0, 1e300] {
            for now_ns in [i64::MIN, 0, i64::MAX, i64::MIN] {
                link.judge(&rule(absurd(number)), now_ns, 1 << 40, &MIDDLE);
            }
        }
        assert_eq!(link.count().taken() + link.count().delivered, 20);
    }
}
