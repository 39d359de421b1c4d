//! The newest of what the agent publishes, kept for queries and for the program that runs the agent.

use skein_proto::document::{EstimateDocument, HealthDocument, InfoDocument};
use std::sync::{Arc, Mutex, PoisonError};

/// An estimate in both its forms.
#[derive(Clone, Debug, PartialEq)]
pub struct PublishedEstimate {
    /// The binary form: an envelope and a [`skein_proto::estimate::Estimate`].
    pub packet: Vec<u8>,
    /// The JSON form.
    pub document: EstimateDocument,
}

/// Shared by the worker, which writes, and whoever answers.
#[derive(Clone)]
pub(crate) struct Published {
    info: Arc<InfoDocument>,
    newest: Arc<Mutex<Newest>>,
}

#[derive(Default)]
struct Newest {
    estimate: Option<Arc<PublishedEstimate>>,
    health: Option<Arc<HealthDocument>>,
}

impl Published {
    pub(crate) fn new(info: InfoDocument) -> Self {
        Self {
            info: Arc::new(info),
            newest: Arc::default(),
        }
    }

    fn with<T>(&self, use_it: impl FnOnce(&mut Newest) -> T) -> T {
        use_it(&mut self.newest.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn set_estimate(&self, estimate: Arc<PublishedEstimate>) {
        self.with(|newest| newest.estimate = Some(estimate));
    }

    pub(crate) fn set_health(&self, health: Arc<HealthDocument>) {
        self.with(|newest| newest.health = Some(health));
    }

    pub(crate) fn estimate(&self) -> Option<Arc<PublishedEstimate>> {
        self.with(|newest| newest.estimate.clone())
    }

    pub(crate) fn health(&self) -> Option<Arc<HealthDocument>> {
        self.with(|newest| newest.health.clone())
    }

    pub(crate) fn info(&self) -> &InfoDocument {
        &self.info
    }
}
