//! Simulated radio faults on the receiving side: loses or delays packets between vehicles before the vehicle sees them.
//!
//! Only with `[simulation] enabled = true`. Drivers, tools and liveliness are left alone: it is the radio that is bad.

use crate::clock::{Clock, real_now};
use crate::inbox::Inbox;
use crate::settings::FaultSettings;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skein_estimation::time::{Span, Stamp};
use skein_proto::faults::{Faults, FaultsError, Verdict};
use skein_proto::name::Name;
use skein_vehicle::Input;
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Packets that are held back at one time at most: 32 neighbours at 20 packets a second for six seconds.
const DELAYED_MAX: usize = 4_096;
/// Senders with a stream of chance of their own.
const SENDERS_MAX: usize = 256;

/// Judges every packet between vehicles. Copies share the faults and the streams.
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
    streams: BTreeMap<Name, ChaCha8Rng>,
    /// By due time, then by order of coming.
    delayed: BTreeMap<(Stamp, u64), Input>,
    came: u64,
    dropped: u64,
    closed: bool,
}

/// What to do with a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Now,
    Late,
    Never,
}

impl FaultFilter {
    pub(crate) fn new(to: Name, settings: FaultSettings) -> Self {
        Self {
            shared: Arc::new(Shared {
                to,
                seed: settings.seed,
                state: Mutex::new(State {
                    faults: Faults::default(),
                    streams: BTreeMap::new(),
                    delayed: BTreeMap::new(),
                    came: 0,
                    dropped: 0,
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

    /// Obeys other faults from now on.
    pub(crate) fn set(&self, faults: Faults) -> Result<(), FaultsError> {
        faults.check()?;
        self.state().faults = faults;
        Ok(())
    }

    /// Lets a packet through to the inbox, now or later, or takes it away.
    pub(crate) fn pass(&self, arrival: Stamp, from: Name, packet: Input, inbox: &Inbox) {
        let mut state = self.state();
        let (fate, due) = state.judge(arrival, from, self.shared.to, self.shared.seed);
        match fate {
            Fate::Now => {
                drop(state);
                inbox.push(arrival, packet);
            }
            Fate::Never => state.dropped += 1,
            Fate::Late if state.delayed.len() >= DELAYED_MAX => state.dropped += 1,
            Fate::Late => {
                let order = state.came;
                state.delayed.insert((due, order), packet);
                drop(state);
                self.shared.changed.notify_all();
            }
        }
    }

    /// Hands on delayed packets when they are due, until [`FaultFilter::close`].
    pub(crate) fn deliver_delayed(&self, clock: &Clock, inbox: &Inbox) {
        let mut state = self.state();
        while !state.closed {
            let Some((&(due, _), _)) = state.delayed.first_key_value() else {
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
            if let Some((_, packet)) = state.delayed.pop_first() {
                inbox.push(due, packet);
            }
        }
    }

    pub(crate) fn close(&self) {
        self.state().closed = true;
        self.shared.changed.notify_all();
    }

    /// Packets taken away so far.
    pub(crate) fn dropped(&self) -> u64 {
        self.state().dropped
    }
}

impl State {
    fn judge(&mut self, arrival: Stamp, from: Name, to: Name, seed: u64) -> (Fate, Stamp) {
        self.came += 1;
        if self.streams.len() >= SENDERS_MAX && !self.streams.contains_key(&from) {
            return (Fate::Never, arrival);
        }
        // A stream for each pair, so that what one sender loses does not depend on how often others speak.
        let stream = self.streams.entry(from).or_insert_with(|| {
            ChaCha8Rng::seed_from_u64(seed ^ from.hash() ^ to.hash().rotate_left(32))
        });
        match self.faults.judge(from, to, stream.random()) {
            Verdict::Lost | Verdict::OutOfRange => (Fate::Never, arrival),
            Verdict::Deliver { delay_s } if delay_s > 0.0 => {
                (Fate::Late, arrival + Span::from_secs_f64(delay_s))
            }
            Verdict::Deliver { .. } => (Fate::Now, arrival),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inbox::{Limits, Popped};
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
}
