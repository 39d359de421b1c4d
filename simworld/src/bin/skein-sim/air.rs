//! The world's own Zenoh session: it dictates the radio's faults, drives the sensors of agents in other processes, and
//! hears what everybody estimates.

use miette::{Context, IntoDiagnostic, miette};
use skein_agent::NetworkSettings;
use skein_proto::document::{EstimateDocument, HealthDocument};
use skein_proto::faults::Faults;
use skein_proto::keys::{Key, SimChannel, select};
use skein_proto::limits::DOCUMENT_BYTES_MAX;
use skein_proto::name::Name;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use zenoh::Wait;
use zenoh::bytes::Encoding;

type Newest<T> = Arc<Mutex<BTreeMap<Name, T>>>;

/// One open session of the world.
pub(crate) struct Air {
    session: zenoh::Session,
    fleet: Name,
    estimates: Newest<EstimateDocument>,
    healths: Newest<HealthDocument>,
}

impl Air {
    /// Joins a fleet's network and listens to its estimates and healths.
    pub(crate) fn join(fleet: Name, network: &NetworkSettings) -> miette::Result<Self> {
        let session = zenoh::open(network.zenoh()?)
            .wait()
            .map_err(|error| miette!("the world's Zenoh session does not open: {error}"))?;
        let air = Self {
            session,
            fleet,
            estimates: Newest::default(),
            healths: Newest::default(),
        };
        air.listen(
            &select::estimates(fleet),
            &air.estimates,
            |document: &EstimateDocument| document.vehicle,
        )?;
        air.listen(
            &select::healths(fleet),
            &air.healths,
            |document: &HealthDocument| document.vehicle,
        )?;
        Ok(air)
    }

    fn listen<T: serde::de::DeserializeOwned + Send + 'static>(
        &self,
        selector: &str,
        newest: &Newest<T>,
        of: impl Fn(&T) -> Name + Send + Sync + 'static,
    ) -> miette::Result<()> {
        let newest = Arc::clone(newest);
        self.session
            .declare_subscriber(selector)
            .callback(move |sample| {
                let bytes = sample.payload().to_bytes();
                if bytes.len() > DOCUMENT_BYTES_MAX {
                    return;
                }
                if let Ok(document) = serde_json::from_slice::<T>(&bytes) {
                    newest
                        .lock()
                        .unwrap_or_else(PoisonError::into_inner)
                        .insert(of(&document), document);
                }
            })
            .background()
            .wait()
            .map_err(|error| miette!("cannot subscribe to {selector}: {error}"))
    }

    /// The newest estimate of a vehicle.
    pub(crate) fn estimate(&self, vehicle: Name) -> Option<EstimateDocument> {
        self.estimates
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get(&vehicle)
            .cloned()
    }

    /// The newest health of a vehicle.
    pub(crate) fn health(&self, vehicle: Name) -> Option<HealthDocument> {
        self.healths
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get(&vehicle)
            .cloned()
    }

    /// Tells all agents what the radio does from now on. Fails when they would refuse it.
    pub(crate) fn dictate(&self, faults: &Faults) -> miette::Result<()> {
        faults.check().into_diagnostic().wrap_err("faults")?;
        let text = serde_json::to_string(faults)
            .into_diagnostic()
            .wrap_err("faults")?;
        self.put(
            Key::Sim {
                channel: SimChannel::Faults,
            },
            text.into_bytes(),
            Encoding::APPLICATION_JSON,
        )
    }

    /// Brings a frame to the driver of an agent in another process.
    pub(crate) fn drive(&self, vehicle: Name, sensor: Name, frame: Vec<u8>) -> miette::Result<()> {
        self.put(
            Key::Driver {
                of: vehicle,
                sensor,
            },
            frame,
            Encoding::APPLICATION_OCTET_STREAM,
        )
    }

    fn put(&self, key: Key, bytes: Vec<u8>, encoding: Encoding) -> miette::Result<()> {
        self.session
            .put(key.in_fleet(self.fleet), bytes)
            .encoding(encoding)
            .wait()
            .map_err(|error| miette!("cannot publish {key}: {error}"))
    }
}
