//! What the shell refuses before it reaches the vehicle, counted by reason and shown in the health.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Counters shared by callbacks; copies count together. Reasons are words of this program, so their number is bounded.
#[derive(Clone, Default)]
pub(crate) struct Refusals {
    counts: Arc<Mutex<BTreeMap<&'static str, u64>>>,
}

impl Refusals {
    fn counts(&self) -> MutexGuard<'_, BTreeMap<&'static str, u64>> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn count(&self, reason: &'static str) {
        *self.counts().entry(reason).or_insert(0) += 1;
    }

    /// Adds them to a health's counters.
    pub(crate) fn add_to(&self, refused: &mut BTreeMap<String, u64>) {
        for (reason, count) in self.counts().iter() {
            *refused.entry((*reason).to_owned()).or_insert(0) += count;
        }
    }
}
