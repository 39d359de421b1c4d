//! What all threads of one agent watch: whether it is stopping, and whether its Zenoh session is open.

use crate::clock::real_now;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use zenoh::Session;

/// Shared by the threads of one agent.
#[derive(Clone, Default)]
pub(crate) struct Life {
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    stopping: bool,
    session: Option<Session>,
    trouble: Option<String>,
}

impl Life {
    fn state(&self) -> MutexGuard<'_, State> {
        // The state is whole at every moment, so a thread that panicked elsewhere has not broken it.
        self.shared
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells everybody to end.
    pub(crate) fn stop(&self) {
        self.state().stopping = true;
        self.shared.changed.notify_all();
    }

    pub(crate) fn is_stopping(&self) -> bool {
        self.state().stopping
    }

    /// Waits until `instant`; false when the agent is stopping.
    pub(crate) fn wait_until(&self, instant: Instant) -> bool {
        let mut state = self.state();
        loop {
            let left = instant.saturating_duration_since(real_now());
            if state.stopping || left.is_zero() {
                return !state.stopping;
            }
            (state, _) = self
                .shared
                .changed
                .wait_timeout(state, left)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Everything is declared on this session: drivers and queries may use it.
    pub(crate) fn set_session(&self, session: Session) {
        let mut state = self.state();
        state.session = Some(session);
        state.trouble = None;
        drop(state);
        self.shared.changed.notify_all();
    }

    /// Takes the session away, for closing it.
    pub(crate) fn clear_session(&self) {
        let session = self.state().session.take();
        drop(session);
    }

    /// The open session, if it is open.
    pub(crate) fn session(&self) -> Option<Session> {
        self.state().session.clone()
    }

    /// Waits for the session; none when the agent is stopping.
    pub(crate) fn wait_for_session(&self) -> Option<Session> {
        let mut state = self.state();
        loop {
            if state.stopping {
                return None;
            }
            if let Some(session) = &state.session {
                return Some(session.clone());
            }
            state = self
                .shared
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Waits at most so long for the session; whether it is open.
    pub(crate) fn wait_open(&self, timeout: Duration) -> bool {
        let deadline = real_now() + timeout;
        let mut state = self.state();
        while state.session.is_none() && !state.stopping {
            let left = deadline.saturating_duration_since(real_now());
            if left.is_zero() {
                break;
            }
            (state, _) = self
                .shared
                .changed
                .wait_timeout(state, left)
                .unwrap_or_else(PoisonError::into_inner);
        }
        state.session.is_some()
    }

    /// Why the session is not open.
    pub(crate) fn set_trouble(&self, trouble: String) {
        self.state().trouble = Some(trouble);
    }

    /// Why the session is not open, if it was tried and failed.
    pub(crate) fn trouble(&self) -> Option<String> {
        self.state().trouble.clone()
    }
}
