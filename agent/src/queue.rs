//! A bounded, counted queue between threads. Pushing never blocks; what does not fit is dropped and counted.

use skein_proto::document::QueueHealth;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Which entry goes when the queue is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WhenFull {
    /// The one that has waited longest: the newest data are the best.
    DropOldest,
    /// The one that comes: what is held stays without a gap.
    DropNewest,
}

/// The two ends of one queue; copies share it.
pub(crate) struct Queue<T> {
    shared: Arc<Shared<T>>,
}

struct Shared<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    capacity: usize,
    when_full: WhenFull,
}

struct State<T> {
    entries: VecDeque<T>,
    most: usize,
    dropped: u64,
    closed: bool,
}

impl<T> Clone for Queue<T> {
    fn clone(&self) -> Self {
        Self {
            shared: Arc::clone(&self.shared),
        }
    }
}

impl<T> Queue<T> {
    pub(crate) fn new(capacity: usize, when_full: WhenFull) -> Self {
        assert!(capacity > 0, "a queue holds at least one entry");
        Self {
            shared: Arc::new(Shared {
                state: Mutex::new(State {
                    entries: VecDeque::with_capacity(capacity.min(1_024)),
                    most: 0,
                    dropped: 0,
                    closed: false,
                }),
                changed: Condvar::new(),
                capacity,
                when_full,
            }),
        }
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        self.shared
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts an entry at the end. False when an entry, this or the oldest, was dropped for it.
    pub(crate) fn push(&self, entry: T) -> bool {
        let mut state = self.state();
        if state.closed {
            return false;
        }
        let full = state.entries.len() >= self.shared.capacity;
        if full {
            state.dropped += 1;
            if self.shared.when_full == WhenFull::DropNewest {
                return false;
            }
            state.entries.pop_front();
        }
        state.entries.push_back(entry);
        state.most = state.most.max(state.entries.len());
        drop(state);
        self.shared.changed.notify_one();
        !full
    }

    /// The oldest entry; waits for one. None when the queue is closed and empty.
    pub(crate) fn pop(&self) -> Option<T> {
        let mut state = self.state();
        loop {
            if let Some(entry) = state.entries.pop_front() {
                return Some(entry);
            }
            if state.closed {
                return None;
            }
            state = self
                .shared
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The oldest entry, if there is one now.
    pub(crate) fn try_pop(&self) -> Option<T> {
        self.state().entries.pop_front()
    }

    /// Takes nothing more; what is held can still be popped.
    pub(crate) fn close(&self) {
        self.state().closed = true;
        self.shared.changed.notify_all();
    }

    /// How full it was, and what it dropped.
    pub(crate) fn health(&self) -> QueueHealth {
        let state = self.state();
        QueueHealth {
            capacity: self.shared.capacity as u64,
            most: state.most as u64,
            dropped: state.dropped,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_its_limit_it_drops_nothing_and_one_past_it_the_oldest() {
        let queue = Queue::new(2, WhenFull::DropOldest);
        assert!(queue.push(1) && queue.push(2));
        assert_eq!(queue.health().dropped, 0);
        assert!(!queue.push(3));
        assert_eq!((queue.pop(), queue.pop()), (Some(2), Some(3)));
        assert_eq!((queue.health().most, queue.health().dropped), (2, 1));
    }

    #[test]
    fn a_queue_that_keeps_its_prefix_drops_what_comes() {
        let queue = Queue::new(2, WhenFull::DropNewest);
        assert!(queue.push(1) && queue.push(2) && !queue.push(3));
        queue.close();
        assert!(!queue.push(4));
        assert_eq!(
            (queue.pop(), queue.pop(), queue.pop()),
            (Some(1), Some(2), None)
        );
    }
}
