//! Simulated radio faults on the receiving side: packets between vehicles are lost, late, out of order or doubled before
//! the vehicle sees them. What happens to each is decided by [`skein_proto::faults`], as in a virtual flight.
//!
//! Only with `[simulation] enabled = true`. Drivers, tools and liveliness are left alone: it is the radio that is bad.

use crate::clock::{Clock, real_now};
use crate::inbox::Inbox;
use crate::settings::FaultSettings;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skein_estimation::time::Stamp;
use skein_proto::document::QueueHealth;
use skein_proto::faults::{Draws, Faults, FaultsError, Link, LinkCount, LinkRule, Verdict};
use skein_proto::name::Name;
use skein_vehicle::Input;
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Packets that are held back at one time at most: 32 neighbours at 20 packets a second for six seconds.
const DELAYED_MAX: usize = 4_096;
/// Senders with a link of their own; packets of any other are taken away.
const SENDERS_MAX: usize = 256;

/// Judges every packet between vehicles. Copies share the faults and the links.
#[derive(Clone)]
pub(crate) struct FaultFilter {
    shared: Arc<Shared>,
}

struct Shared {
    to: Name,
    seed: u64,
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    faults: Faults,
    links: BTreeMap<Name, Incoming>,
    strangers: u64,
    delayed: Delayed,
    closed: bool,
}

/// The link from one sender to this vehicle, with its luck.
struct Incoming {
    link: Link,
    /// What the faults say of it; looked up when they have changed.
    rule: Option<LinkRule>,
    chance: ChaCha8Rng,
    others: ChaCha8Rng,
}

/// Packets under way.
#[derive(Default)]
struct Delayed {
    /// By due time, then by order of coming.
    packets: BTreeMap<(Stamp, u64), Input>,
    came: u64,
    most: usize,
    dropped: u64,
}

impl FaultFilter {
    pub(crate) fn new(to: Name, settings: FaultSettings) -> Self {
        Self {
            shared: Arc::new(Shared {
                to,
                seed: settings.seed,
                state: Mutex::new(State {
                    faults: Faults::default(),
                    links: BTreeMap::new(),
                    strangers: 0,
                    delayed: Delayed::default(),
                    closed: false,
                }),
                changed: Condvar::new(),
            }),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.shared
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Obeys other faults from now on. What the links have come to, bursts and queues, goes on.
    pub(crate) fn set(&self, faults: Faults) -> Result<(), FaultsError> {
        faults.check()?;
        let mut state = self.state();
        if state.faults != faults {
            state.faults = faults;
            for link in state.links.values_mut() {
                link.rule = None;
            }
        }
        Ok(())
    }

    /// Lets a packet through to the inbox, now or later or both, or takes it away.
    pub(crate) fn pass(&self, arrival: Stamp, from: Name, packet: Input, inbox: &Inbox) {
        let mut state = self.state();
        let verdict = state.judge(arrival, from, &packet, &self.shared);
        let Some(Verdict::Deliver { at_ns, copy_at_ns }) = verdict else {
            return;
        };
        let due = Stamp::from_nanos(at_ns);
        let copy = copy_at_ns.map(|at_ns| (Stamp::from_nanos(at_ns), packet.clone()));
        // The packet itself first: when only one more fits, it is not the copy.
        let now = if due > arrival {
            state.delayed.hold(due, packet);
            None
        } else {
            Some(packet)
        };
        if let Some((due, packet)) = copy {
            state.delayed.hold(due, packet);
        }
        drop(state);
        self.shared.changed.notify_all();
        if let Some(packet) = now {
            inbox.push(arrival, packet);
        }
    }

    /// Hands on delayed packets when they are due, until [`FaultFilter::close`].
    pub(crate) fn deliver_delayed(&self, clock: &Clock, inbox: &Inbox) {
        let mut state = self.state();
        while !state.closed {
            let Some((&(due, _), _)) = state.delayed.packets.first_key_value() else {
                state = self
                    .shared
                    .changed
                    .wait(state)
                    .unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            if clock.now() < due {
                let left = clock.instant_of(due).saturating_duration_since(real_now());
                (state, _) = self
                    .shared
                    .changed
                    .wait_timeout(state, left)
                    .unwrap_or_else(PoisonError::into_inner);
                continue;
            }
            if let Some((_, packet)) = state.delayed.packets.pop_first() {
                inbox.push(due, packet);
            }
        }
    }

    pub(crate) fn close(&self) {
        self.state().closed = true;
        self.shared.changed.notify_all();
    }

    /// Packets taken away so far, for whatever reason.
    pub(crate) fn dropped(&self) -> u64 {
        let state = self.state();
        state.count().taken() + state.strangers + state.delayed.dropped
    }

    /// What became of all packets, by reason.
    pub(crate) fn count(&self) -> LinkCount {
        self.state().count()
    }

    /// The packets under way, for the health.
    pub(crate) fn queue(&self) -> QueueHealth {
        let state = self.state();
        QueueHealth {
            capacity: DELAYED_MAX as u64,
            most: state.delayed.most as u64,
            dropped: state.delayed.dropped,
        }
    }
}

impl State {
    /// What becomes of a packet; nothing when there are too many senders already.
    fn judge(
        &mut self,
        arrival: Stamp,
        from: Name,
        packet: &Input,
        shared: &Shared,
    ) -> Option<Verdict> {
        if self.links.len() >= SENDERS_MAX && !self.links.contains_key(&from) {
            self.strangers += 1;
            return None;
        }
        let incoming = self
            .links
            .entry(from)
            .or_insert_with(|| Incoming::new(from, shared));
        let rule = *incoming
            .rule
            .get_or_insert_with(|| self.faults.rule(from, shared.to));
        let bytes = match packet {
            Input::Packet { bytes, .. } => bytes.len(),
            _ => 0,
        };
        let draws = incoming.draw();
        let verdict = incoming
            .link
            .judge(&rule, arrival.as_nanos(), bytes, &draws);
        Some(verdict)
    }

    fn count(&self) -> LinkCount {
        let mut total = LinkCount::default();
        for incoming in self.links.values() {
            total += incoming.link.count();
        }
        total
    }
}

impl Incoming {
    fn new(from: Name, shared: &Shared) -> Self {
        // Streams for each pair, so that what one sender loses does not depend on how often others speak.
        let seed = shared.seed ^ from.hash() ^ shared.to.hash().rotate_left(32);
        let mut others = ChaCha8Rng::seed_from_u64(seed);
        others.set_stream(1);
        Self {
            link: Link::default(),
            rule: None,
            chance: ChaCha8Rng::seed_from_u64(seed),
            others,
        }
    }

    fn draw(&mut self) -> Draws {
        Draws::take(&mut || self.chance.random(), &mut || self.others.random())
    }
}

impl Delayed {
    /// Keeps a packet until it is due; drops and counts it when there are too many.
    fn hold(&mut self, due: Stamp, packet: Input) {
        if self.packets.len() >= DELAYED_MAX {
            self.dropped += 1;
            return;
        }
        self.came += 1;
        self.packets.insert((due, self.came), packet);
        self.most = self.most.max(self.packets.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inbox::{Limits, Popped};
    use skein_estimation::time::Span;
    use skein_proto::faults::{Burst, Duplicate, RateLimit, Reorder};
    use skein_vehicle::PacketKey;
    use std::time::Duration;

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn packet(from: &str) -> Input {
        Input::Packet {
            key: PacketKey::Odometry { from: name(from) },
            bytes: vec![],
        }
    }

    fn received(inbox: &Inbox) -> usize {
        let now = real_now();
        std::iter::from_fn(|| match inbox.pop_until(now) {
            Popped::Input { .. } => Some(()),
            _ => None,
        })
        .count()
    }

    #[test]
    fn the_loss_that_is_asked_for_is_the_loss_that_is_counted() {
        let filter = FaultFilter::new(name("v2"), FaultSettings { seed: 7 });
        filter
            .set(Faults {
                loss: 0.3,
                ..Faults::default()
            })
            .unwrap();
        let inbox = Inbox::new(Limits {
            packets: 10_000,
            ..Limits::LIVE
        });
        for _ in 0..10_000 {
            filter.pass(Stamp::from_nanos(0), name("v1"), packet("v1"), &inbox);
        }
        let received = received(&inbox);
        assert_eq!(received as u64 + filter.dropped(), 10_000);
        // Four standard deviations of a binomial count.
        assert!(
            (filter.dropped() as f64 - 3_000.0).abs() < 4.0 * 45.9,
            "{}",
            filter.dropped()
        );
    }

    #[test]
    fn one_senders_losses_do_not_depend_on_how_often_another_speaks() {
        let lost = |others: usize| {
            let filter = FaultFilter::new(name("v2"), FaultSettings { seed: 7 });
            filter
                .set(Faults {
                    loss: 0.5,
                    ..Faults::default()
                })
                .unwrap();
            let inbox = Inbox::new(Limits::LIVE);
            (0..64)
                .map(|_| {
                    for _ in 0..others {
                        filter.pass(Stamp::from_nanos(0), name("v3"), packet("v3"), &inbox);
                    }
                    let before = filter.dropped();
                    filter.pass(Stamp::from_nanos(0), name("v1"), packet("v1"), &inbox);
                    filter.dropped() > before
                })
                .collect::<Vec<bool>>()
        };
        assert_eq!(lost(0), lost(3));
    }

    #[test]
    fn a_delayed_packet_comes_when_it_is_due() {
        let clock = Clock::scaled(Stamp::from_nanos(0), 100.0);
        let filter = FaultFilter::new(name("v2"), FaultSettings { seed: 7 });
        filter
            .set(Faults {
                delay_s: 1.0,
                ..Faults::default()
            })
            .unwrap();
        let inbox = Inbox::new(Limits::LIVE);
        let delivering = {
            let (filter, inbox) = (filter.clone(), inbox.clone());
            std::thread::spawn(move || filter.deliver_delayed(&clock, &inbox))
        };
        let sent = clock.now();
        filter.pass(sent, name("v1"), packet("v1"), &inbox);
        let popped = inbox.pop_until(real_now() + Duration::from_secs(10));
        assert!(clock.now() >= sent + Span::secs(1));
        let Popped::Input { arrival, .. } = popped else {
            panic!("it never came: {popped:?}")
        };
        assert_eq!(arrival, sent + Span::secs(1));
        filter.close();
        delivering.join().unwrap();
    }

    /// Every packet under way in the order of its coming, with when it is due.
    fn under_way(filter: &FaultFilter) -> Vec<(Stamp, Input)> {
        let state = filter.state();
        let packets = state.delayed.packets.iter();
        packets
            .map(|((due, _), packet)| (*due, packet.clone()))
            .collect()
    }

    #[test]
    fn packets_meet_what_a_link_of_the_common_rule_decides() {
        let faults = Faults {
            loss: 0.2,
            delay_s: 0.1,
            jitter_s: 0.05,
            burst: Some(Burst {
                share: 0.2,
                mean_s: 0.4,
                loss: 0.9,
            }),
            reorder: Some(Reorder {
                probability: 0.1,
                delay_s: 0.2,
            }),
            duplicate: Some(Duplicate {
                probability: 0.2,
                delay_s: 0.05,
            }),
            rate_limit: Some(RateLimit {
                bytes_per_s: 1_500.0,
                bucket_bytes: 2_000.0,
                queue_bytes: 500.0,
            }),
            ..Faults::default()
        };
        let (from, to, seed) = (name("v1"), name("v2"), 7);
        let filter = FaultFilter::new(to, FaultSettings { seed });
        filter.set(faults.clone()).unwrap();
        let inbox = Inbox::new(Limits::LIVE);
        let seed = seed ^ from.hash() ^ to.hash().rotate_left(32);
        let mut chance = ChaCha8Rng::seed_from_u64(seed);
        let mut others = ChaCha8Rng::seed_from_u64(seed);
        others.set_stream(1);
        let mut link = Link::default();
        let mut expected = Vec::new();
        for k in 0..2_000_i64 {
            let packet = Input::Packet {
                key: PacketKey::Odometry { from },
                bytes: k.to_le_bytes().repeat(12),
            };
            let now = Stamp::from_nanos(k * 50_000_000);
            let draws = Draws::take(&mut || chance.random(), &mut || others.random());
            let rule = faults.rule(from, to);
            if let Verdict::Deliver { at_ns, copy_at_ns } =
                link.judge(&rule, now.as_nanos(), 96, &draws)
            {
                expected.push((Stamp::from_nanos(at_ns), packet.clone()));
                expected.extend(copy_at_ns.map(|at| (Stamp::from_nanos(at), packet.clone())));
            }
            filter.pass(now, from, packet, &inbox);
            // The world repeats itself: this must not start the links anew.
            filter.set(faults.clone()).unwrap();
        }
        expected.sort_by_key(|(due, _)| *due);
        assert_eq!(under_way(&filter), expected);
        assert_eq!(filter.count(), link.count());
        assert_eq!(filter.dropped(), link.count().taken());
        let count = link.count();
        let happened = [
            count.lost,
            count.burst,
            count.rate_limited,
            count.reordered,
            count.duplicated,
        ];
        assert!(happened.iter().all(|n| *n > 20), "{count:?}");
    }

    #[test]
    fn a_copy_of_a_packet_that_is_not_late_comes_after_it() {
        let filter = FaultFilter::new(name("v2"), FaultSettings { seed: 7 });
        filter
            .set(Faults {
                duplicate: Some(Duplicate {
                    probability: 1.0,
                    delay_s: 0.5,
                }),
                ..Faults::default()
            })
            .unwrap();
        let inbox = Inbox::new(Limits::LIVE);
        filter.pass(Stamp::from_nanos(3), name("v1"), packet("v1"), &inbox);
        assert_eq!(received(&inbox), 1);
        let due = Stamp::from_nanos(500_000_003);
        assert_eq!(under_way(&filter), [(due, packet("v1"))]);
    }

    #[test]
    fn a_change_of_the_faults_holds_from_the_next_packet() {
        let filter = FaultFilter::new(name("v2"), FaultSettings { seed: 7 });
        let inbox = Inbox::new(Limits::LIVE);
        let heard = |faults: Faults| {
            filter.set(faults).unwrap();
            filter.pass(Stamp::from_nanos(0), name("v1"), packet("v1"), &inbox);
            received(&inbox)
        };
        let split = || Faults {
            partitions: vec![vec![vec![name("v1")], vec![name("v2")]]],
            ..Faults::default()
        };
        let heard: Vec<usize> = [Faults::default(), split(), split(), Faults::default()]
            .into_iter()
            .map(heard)
            .collect();
        assert_eq!(heard, [1, 0, 0, 1]);
        assert_eq!(filter.count().partitioned, 2);
    }

    #[test]
    fn what_is_under_way_and_who_sends_it_is_bounded_and_counted() {
        let filter = FaultFilter::new(name("v2"), FaultSettings { seed: 7 });
        filter
            .set(Faults {
                delay_s: 10.0,
                ..Faults::default()
            })
            .unwrap();
        let inbox = Inbox::new(Limits::LIVE);
        let send = |from: &str| {
            filter.pass(Stamp::from_nanos(0), name(from), packet(from), &inbox);
            filter.dropped()
        };
        for _ in 0..DELAYED_MAX {
            assert_eq!(send("v1"), 0);
        }
        assert_eq!(send("v1"), 1);
        let queue = filter.queue();
        assert_eq!((queue.most, queue.dropped), (DELAYED_MAX as u64, 1));
        filter.set(Faults::default()).unwrap();
        for sender in 1..SENDERS_MAX {
            assert_eq!(send(&format!("s{sender}")), 1);
        }
        assert_eq!(send("one_too_many"), 2);
        assert_eq!(received(&inbox), SENDERS_MAX - 1);
    }
}
