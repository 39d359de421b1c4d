//! Questions for the last rounds of a vehicle over Zenoh, both ways: others ask this one, and it asks others. Nobody waits
//! here: questions and answers go through the vehicle's inbox and the outbox like everything else.

use crate::clock::{Clock, real_now};
use crate::inbox::Inbox;
use crate::pending::Pending;
use crate::refusals::Refusals;
use skein_proto::backlog::Question;
use skein_proto::document::ErrorDocument;
use skein_proto::envelope::ENVELOPE_BYTES;
use skein_proto::keys::Key;
use skein_proto::limits::BACKLOG_BYTES_MAX;
use skein_proto::name::Name;
use skein_vehicle::{Input, PacketKey};
use std::time::Duration;
use zenoh::bytes::Encoding;
use zenoh::qos::CongestionControl;
use zenoh::query::{ConsolidationMode, Query, QueryTarget, Reply};
use zenoh::sample::Locality;
use zenoh::{Session, Wait};

/// How long a neighbour may take to answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// Between Zenoh and the vehicle.
#[derive(Clone)]
pub(crate) struct Backlogs {
    pub(crate) fleet: Name,
    pub(crate) clock: Clock,
    pub(crate) inbox: Inbox,
    pub(crate) refusals: Refusals,
    pub(crate) pending: Pending<Query>,
}

impl Backlogs {
    /// Passes somebody's question on to the vehicle, or says what is wrong with it.
    pub(crate) fn pass_on(&self, query: &Query) -> Result<(), ErrorDocument> {
        let Some(question) = Question::parse(query.parameters().as_str()) else {
            return Err(malformed());
        };
        let Ok(query) = self.pending.keep(real_now(), query.clone()) else {
            self.refusals.count("backlog_full");
            return Err(busy());
        };
        let input = Input::Asked {
            query,
            since_ns: question.since_ns,
            boot: question.boot,
        };
        self.inbox.push(self.clock.now(), input);
        Ok(())
    }

    /// Replies to a question that the vehicle has answered.
    pub(crate) fn reply(&self, of: Name, number: u64, packets: Vec<Vec<u8>>) -> zenoh::Result<()> {
        let Some(query) = self.pending.take(number) else {
            return Ok(());
        };
        let key = Key::Backlog { of }.in_fleet(self.fleet);
        for bytes in packets {
            query
                .reply(key.as_str(), bytes)
                .encoding(Encoding::APPLICATION_OCTET_STREAM)
                .wait()?;
        }
        Ok(())
    }

    /// Drops questions that the vehicle has not answered in time: they end without a reply.
    pub(crate) fn give_up(&self) {
        for _query in self.pending.give_up(real_now()) {
            self.refusals.count("backlog_unanswered");
        }
    }

    /// Asks a neighbour. Its replies reach the vehicle as packets, when they come.
    pub(crate) fn ask(&self, session: &Session, to: Name, question: Question) -> zenoh::Result<()> {
        let backlogs = self.clone();
        session
            .get(question.selector(self.fleet, to))
            .target(QueryTarget::All)
            // Several replies under one key are not versions of each other.
            .consolidation(ConsolidationMode::None)
            .congestion_control(CongestionControl::Drop)
            .allowed_destination(Locality::Remote)
            .timeout(ANSWER_WITHIN)
            .callback(move |reply| backlogs.replied(to, &reply))
            .wait()
    }

    fn replied(&self, to: Name, reply: &Reply) {
        let arrival = self.clock.now();
        // An error, and nothing when the time is up, is no answer: it is asked again, or given up.
        let Ok(sample) = reply.result() else { return };
        let key = Key::parse(sample.key_expr().as_str());
        if key != Ok((self.fleet, Key::Backlog { of: to })) {
            self.refusals.count("wrong_key");
            return;
        }
        if sample.payload().len() > ENVELOPE_BYTES + BACKLOG_BYTES_MAX {
            self.refusals.count("packet_too_long");
            return;
        }
        let key = PacketKey::Backlog { from: to };
        let bytes = sample.payload().to_bytes().into_owned();
        self.inbox.push(arrival, Input::Packet { key, bytes });
    }
}

fn malformed() -> ErrorDocument {
    ErrorDocument {
        code: "malformed".to_owned(),
        message: "ask with since_ns=<nanoseconds>;boot=<16 hexadecimal digits>".to_owned(),
    }
}

fn busy() -> ErrorDocument {
    ErrorDocument {
        code: "busy".to_owned(),
        message: "too many questions wait for an answer: ask again".to_owned(),
    }
}
