//! The way out: one thread opens the session, publishes what the vehicle says, and closes the session at the end.

use crate::life::Life;
use crate::network::NetworkSettings;
use crate::published::PublishedEstimate;
use crate::queries::json;
use crate::queue::Queue;
use crate::reception::Reception;
use crate::session;
use skein_proto::backlog::Question;
use skein_proto::document::HealthDocument;
use skein_proto::keys::Key;
use skein_proto::name::Name;
use skein_vehicle::PacketKey;
use std::sync::Arc;
use zenoh::bytes::Encoding;
use zenoh::qos::{CongestionControl, Reliability};
use zenoh::sample::Locality;
use zenoh::{Session, Wait};

/// Publications that wait at most: a second of 16 neighbours several times over. The oldest goes first, for the newest
/// pose is the best.
pub(crate) const OUTBOX_MAX: usize = 1_024;

/// One publication.
pub(crate) enum Outgoing {
    Packet {
        key: PacketKey,
        bytes: Vec<u8>,
    },
    /// For a neighbour, about its last rounds.
    Question {
        to: Name,
        question: Question,
    },
    /// To the question of that number.
    Answer {
        query: u64,
        packets: Vec<Vec<u8>>,
    },
    Estimate(Arc<PublishedEstimate>),
    Health(Arc<HealthDocument>),
}

/// Runs until the outbox is closed.
pub(crate) fn run(
    network: &NetworkSettings,
    reception: &Reception,
    outbox: &Queue<Outgoing>,
    life: &Life,
) {
    let (session, token) = loop {
        let Some(session) = session::open_with_retry(network, life) else {
            return;
        };
        match reception.declare(&session) {
            Ok(token) => break (session, token),
            Err(error) => {
                tracing::error!(%error, "Zenoh refused a declaration; the session is opened again");
                life.set_trouble(error.to_string());
                session::close(session, ());
            }
        }
    };
    // What was said while nobody could hear it is stale.
    while outbox.try_pop().is_some() {}
    tracing::info!(
        listening = ?locators(&session),
        fleet = %reception.fleet,
        vehicle = %reception.vehicle,
        "the Zenoh session is open"
    );
    life.set_session(session.clone());
    while let Some(outgoing) = outbox.pop() {
        reception.backlogs.give_up();
        if let Err(error) = publish(&session, reception, outgoing) {
            tracing::debug!(%error, "a publication failed");
        }
    }
    life.clear_session();
    session::close(session, token);
}

fn publish(session: &Session, reception: &Reception, outgoing: Outgoing) -> zenoh::Result<()> {
    let (of, fleet) = (reception.vehicle, reception.fleet);
    match outgoing {
        // Best effort: a late pose is worth less than the next one. Express: not held back to fill a batch.
        Outgoing::Packet { key, bytes } => session
            .put(key.key().in_fleet(fleet), bytes)
            .encoding(Encoding::APPLICATION_OCTET_STREAM)
            .reliability(Reliability::BestEffort)
            .congestion_control(CongestionControl::Drop)
            .express(true)
            .allowed_destination(Locality::Remote)
            .wait(),
        Outgoing::Question { to, question } => reception.backlogs.ask(session, to, question),
        Outgoing::Answer { query, packets } => reception.backlogs.reply(of, query, packets),
        Outgoing::Estimate(estimate) => session
            .put(
                Key::Estimate { of }.in_fleet(fleet),
                json(&estimate.document),
            )
            .encoding(Encoding::APPLICATION_JSON)
            .congestion_control(CongestionControl::Drop)
            .wait(),
        Outgoing::Health(health) => session
            .put(Key::Health { of }.in_fleet(fleet), json(health.as_ref()))
            .encoding(Encoding::APPLICATION_JSON)
            .congestion_control(CongestionControl::Drop)
            .wait(),
    }
}

/// The endpoints on which a session listens, ports resolved.
pub(crate) fn locators(session: &Session) -> Vec<String> {
    session
        .info()
        .locators()
        .wait()
        .iter()
        .map(ToString::to_string)
        .collect()
}
