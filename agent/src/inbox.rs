//! The one way into the vehicle: a bounded queue of inputs with their arrival times, in three lanes with a limit each.
//!
//! The drop rule: comings and goings, frames and packets each have a lane, so none can push out another. In a full lane
//! the newest entry of whoever holds most of it is dropped: a flooding sender loses its own packets, not its neighbours'.

use crate::clock::real_now;
use skein_estimation::time::Stamp;
use skein_proto::document::QueueHealth;
use skein_proto::name::Name;
use skein_vehicle::input::Input;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Entries that each lane holds at most.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    pub(crate) presence: usize,
    pub(crate) packets: usize,
    pub(crate) frames: usize,
}

impl Limits {
    /// A second of 16 neighbours at the fastest round, several times over; frames of an inertial unit for a second.
    pub(crate) const LIVE: Self = Self {
        presence: 1_024,
        packets: 2_048,
        frames: 2_048,
    };
}

/// Shared by callbacks, drivers and the worker.
#[derive(Clone)]
pub(crate) struct Inbox {
    shared: Arc<Shared>,
}

struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    entries: VecDeque<Entry>,
    lanes: [Lane; 3],
    closed: bool,
}

struct Entry {
    arrival: Stamp,
    source: Source,
    input: Input,
}

#[derive(Clone, Copy, PartialEq, Eq)]
struct Source {
    lane: LaneKind,
    name: Name,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LaneKind {
    Presence,
    Packets,
    Frames,
}

struct Lane {
    capacity: usize,
    held: BTreeMap<Name, usize>,
    count: usize,
    most: usize,
    dropped: u64,
}

/// What [`Inbox::pop_until`] brought.
#[derive(Debug, PartialEq)]
pub(crate) enum Popped {
    Input { arrival: Stamp, input: Input },
    TimedOut,
    Closed,
}

impl Inbox {
    pub(crate) fn new(limits: Limits) -> Self {
        let lane = |capacity| Lane {
            capacity,
            held: BTreeMap::new(),
            count: 0,
            most: 0,
            dropped: 0,
        };
        Self {
            shared: Arc::new(Shared {
                state: Mutex::new(State {
                    entries: VecDeque::with_capacity(256),
                    lanes: [
                        lane(limits.presence),
                        lane(limits.packets),
                        lane(limits.frames),
                    ],
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

    /// Puts an input at the end; never blocks. [`Input::Wake`] is the worker's own and never comes this way.
    pub(crate) fn push(&self, arrival: Stamp, input: Input) {
        let Some(source) = Source::of(&input) else {
            return;
        };
        let mut state = self.state();
        if state.closed || !state.make_room_for(source) {
            return;
        }
        let lane = &mut state.lanes[source.lane as usize];
        *lane.held.entry(source.name).or_insert(0) += 1;
        lane.count += 1;
        lane.most = lane.most.max(lane.count);
        state.entries.push_back(Entry {
            arrival,
            source,
            input,
        });
        drop(state);
        self.shared.changed.notify_one();
    }

    /// The oldest input; waits for one until `deadline`.
    pub(crate) fn pop_until(&self, deadline: Instant) -> Popped {
        let mut state = self.state();
        loop {
            if state.closed {
                return Popped::Closed;
            }
            if let Some(entry) = state.entries.pop_front() {
                state.forget(entry.source);
                return Popped::Input {
                    arrival: entry.arrival,
                    input: entry.input,
                };
            }
            let left = deadline.saturating_duration_since(real_now());
            if left.is_zero() {
                return Popped::TimedOut;
            }
            (state, _) = self
                .shared
                .changed
                .wait_timeout(state, left)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Ends it: nothing comes in, nothing comes out.
    pub(crate) fn close(&self) {
        self.state().closed = true;
        self.shared.changed.notify_all();
    }

    /// One entry a lane, for the health.
    pub(crate) fn health(&self) -> Vec<(&'static str, QueueHealth)> {
        let state = self.state();
        ["presence", "packets", "frames"]
            .into_iter()
            .zip(&state.lanes)
            .map(|(name, lane)| {
                let health = QueueHealth {
                    capacity: lane.capacity as u64,
                    most: lane.most as u64,
                    dropped: lane.dropped,
                };
                (name, health)
            })
            .collect()
    }
}

impl State {
    /// Whether there is room for one more of this source; drops somebody else's newest entry if that is the rule.
    fn make_room_for(&mut self, source: Source) -> bool {
        let lane = &mut self.lanes[source.lane as usize];
        if lane.count < lane.capacity {
            return true;
        }
        lane.dropped += 1;
        let own = lane.held.get(&source.name).copied().unwrap_or(0);
        let Some((&heaviest, &most)) = lane.held.iter().max_by_key(|(_, count)| **count) else {
            return false;
        };
        if own >= most {
            return false;
        }
        let victim = Source {
            lane: source.lane,
            name: heaviest,
        };
        if let Some(index) = self.entries.iter().rposition(|e| e.source == victim) {
            self.entries.remove(index);
            self.forget(victim);
        }
        true
    }

    fn forget(&mut self, source: Source) {
        let lane = &mut self.lanes[source.lane as usize];
        lane.count -= 1;
        if let Some(count) = lane.held.get_mut(&source.name) {
            *count -= 1;
            if *count == 0 {
                lane.held.remove(&source.name);
            }
        }
    }
}

impl Source {
    fn of(input: &Input) -> Option<Self> {
        let (lane, name) = match input {
            Input::Frame { sensor, .. } => (LaneKind::Frames, *sensor),
            Input::Packet { key, .. } => (LaneKind::Packets, key.from()),
            Input::Appeared { vehicle, .. } | Input::Vanished { vehicle, .. } => {
                (LaneKind::Presence, *vehicle)
            }
            // An operator is one source among those that come and go.
            Input::SetPose { .. } => (LaneKind::Presence, Name::parse("operator").ok()?),
            // So is everybody who asks: their number is bounded before they come here.
            Input::Asked { .. } => (LaneKind::Presence, Name::parse("backlog").ok()?),
            Input::Done { .. } => (LaneKind::Presence, Name::parse("work").ok()?),
            Input::Wake => return None,
        };
        Some(Self { lane, name })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skein_vehicle::input::PacketKey;
    use std::time::Duration;

    const LIMITS: Limits = Limits {
        presence: 2,
        packets: 4,
        frames: 2,
    };

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn packet(from: &str, content: u8) -> Input {
        Input::Packet {
            key: PacketKey::Odometry { from: name(from) },
            bytes: vec![content],
        }
    }

    fn drain(inbox: &Inbox) -> Vec<Input> {
        let now = real_now();
        std::iter::from_fn(|| match inbox.pop_until(now) {
            Popped::Input { input, .. } => Some(input),
            _ => None,
        })
        .collect()
    }

    fn dropped(inbox: &Inbox, lane: usize) -> u64 {
        inbox.health()[lane].1.dropped
    }

    #[test]
    fn a_flooding_sender_loses_its_own_newest_packets() {
        let inbox = Inbox::new(LIMITS);
        for content in 0..10 {
            inbox.push(Stamp::from_nanos(0), packet("flood", content));
        }
        inbox.push(Stamp::from_nanos(0), packet("quiet", 77));
        assert_eq!(
            drain(&inbox),
            [
                packet("flood", 0),
                packet("flood", 1),
                packet("flood", 2),
                packet("quiet", 77)
            ]
        );
        assert_eq!(dropped(&inbox, 1), 7);
    }

    #[test]
    fn a_full_lane_keeps_what_came_first_of_its_only_sender() {
        let inbox = Inbox::new(LIMITS);
        for content in 0..5 {
            inbox.push(Stamp::from_nanos(0), packet("flood", content));
        }
        let kept: Vec<Input> = (0..4).map(|content| packet("flood", content)).collect();
        assert_eq!(drain(&inbox), kept);
    }

    #[test]
    fn packets_push_out_neither_frames_nor_comings_and_goings() {
        let inbox = Inbox::new(LIMITS);
        for content in 0..100 {
            inbox.push(Stamp::from_nanos(0), packet("flood", content));
        }
        let frame = Input::Frame {
            sensor: name("tags"),
            bytes: vec![],
        };
        let appeared = Input::Appeared {
            vehicle: name("v2"),
            boot: 1,
        };
        inbox.push(Stamp::from_nanos(1), frame.clone());
        inbox.push(Stamp::from_nanos(2), appeared.clone());
        let inputs = drain(&inbox);
        assert_eq!(inputs.len(), 6);
        assert_eq!(inputs[4..], [frame, appeared]);
        assert_eq!((dropped(&inbox, 0), dropped(&inbox, 2)), (0, 0));
    }

    #[test]
    fn a_closed_inbox_wakes_whoever_waits() {
        let inbox = Inbox::new(LIMITS);
        let other = inbox.clone();
        let waiting =
            std::thread::spawn(move || other.pop_until(real_now() + Duration::from_secs(60)));
        inbox.close();
        assert_eq!(waiting.join().unwrap(), Popped::Closed);
    }
}
