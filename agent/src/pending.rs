//! Questions that wait until somebody has the answer: bounded, and none for long. What is given up is dropped and counted.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Questions that wait at most; a new one beyond is turned away.
const PENDING_MAX: usize = 64;
/// How long one waits; who asked has given up by then.
const WAIT_MAX: Duration = Duration::from_secs(2);

/// The questions, by their numbers; copies share them.
pub(crate) struct Pending<T> {
    state: Arc<Mutex<State<T>>>,
}

struct State<T> {
    waiting: VecDeque<Waiting<T>>,
    next: u64,
}

struct Waiting<T> {
    number: u64,
    since: Instant,
    question: T,
}

impl<T> Clone for Pending<T> {
    fn clone(&self) -> Self {
        Self {
            state: Arc::clone(&self.state),
        }
    }
}

impl<T> Default for Pending<T> {
    fn default() -> Self {
        Self {
            state: Arc::new(Mutex::new(State {
                waiting: VecDeque::new(),
                next: 0,
            })),
        }
    }
}

impl<T> Pending<T> {
    fn state(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps a question and says its number; gives it back where there is no room.
    pub(crate) fn keep(&self, now: Instant, question: T) -> Result<u64, T> {
        let mut state = self.state();
        if state.waiting.len() >= PENDING_MAX {
            return Err(question);
        }
        let number = state.next;
        state.next += 1;
        state.waiting.push_back(Waiting {
            number,
            since: now,
            question,
        });
        Ok(number)
    }

    /// The question of a number, which is now answered.
    pub(crate) fn take(&self, number: u64) -> Option<T> {
        let mut state = self.state();
        let at = state.waiting.iter().position(|w| w.number == number)?;
        state.waiting.remove(at).map(|waiting| waiting.question)
    }

    /// The questions that have waited too long, which wait no more.
    pub(crate) fn give_up(&self, now: Instant) -> Vec<T> {
        let mut state = self.state();
        let over = |waiting: &Waiting<T>| now.saturating_duration_since(waiting.since) > WAIT_MAX;
        let count = state.waiting.iter().take_while(|w| over(w)).count();
        let given_up = state.waiting.drain(..count);
        given_up.map(|waiting| waiting.question).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::real_now;

    #[test]
    fn a_question_is_answered_once() {
        let pending = Pending::default();
        let first = pending.keep(real_now(), "first").unwrap();
        let second = pending.keep(real_now(), "second").unwrap();
        assert_eq!(pending.take(second), Some("second"));
        assert_eq!(pending.take(second), None);
        assert_eq!(pending.take(first), Some("first"));
    }

    #[test]
    fn so_many_wait_and_one_more_is_turned_away() {
        let pending = Pending::default();
        for nth in 0..PENDING_MAX {
            assert!(pending.keep(real_now(), nth).is_ok());
        }
        assert_eq!(pending.keep(real_now(), 999), Err(999));
    }

    #[test]
    fn nobody_waits_longer_than_two_seconds() {
        let pending = Pending::default();
        let now = real_now();
        let old = pending.keep(now, "old").unwrap();
        pending.keep(now + Duration::from_secs(1), "young").unwrap();
        assert!(pending.give_up(now + WAIT_MAX).is_empty());
        let later = now + WAIT_MAX + Duration::from_millis(1);
        assert_eq!(pending.give_up(later), ["old"]);
        assert_eq!(pending.take(old), None);
    }
}
