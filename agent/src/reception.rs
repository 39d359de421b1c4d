//! What comes in from Zenoh: callbacks that parse the key, look at the length and enqueue. No other work is done on
//! Zenoh's threads.

use crate::backlog::Backlogs;
use crate::clock::Clock;
use crate::faults::FaultFilter;
use crate::inbox::Inbox;
use crate::queries::{About, Question, Wish};
use crate::queue::Queue;
use crate::refusals::Refusals;
use skein_proto::envelope::ENVELOPE_BYTES;
use skein_proto::faults::{Faults, FaultsError};
use skein_proto::keys::{Key, SimChannel, select};
use skein_proto::limits::{DOCUMENT_BYTES_MAX, PACKET_BYTES_MAX};
use skein_proto::name::Name;
use skein_vehicle::{Input, PacketKey};
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Query;
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Session, Wait};

/// Where what comes in goes to.
#[derive(Clone)]
pub(crate) struct Reception {
    pub(crate) fleet: Name,
    pub(crate) vehicle: Name,
    pub(crate) boot: u64,
    pub(crate) clock: Clock,
    pub(crate) inbox: Inbox,
    pub(crate) questions: Queue<Question>,
    pub(crate) backlogs: Backlogs,
    pub(crate) faults: Option<FaultFilter>,
    pub(crate) refusals: Refusals,
    /// Whether queries under `@rpc` are taken.
    pub(crate) rpc: bool,
}

impl Reception {
    /// Declares all subscriptions and queryables, then the liveliness token: who sees it can be sure to be heard.
    ///
    /// The declarations live as long as the session; the token as long as what is returned.
    pub(crate) fn declare(&self, session: &Session) -> zenoh::Result<LivelinessToken> {
        for selector in [
            select::exchanges_to(self.fleet, self.vehicle),
            select::odometry(self.fleet),
            select::features(self.fleet),
            select::relays(self.fleet),
        ] {
            let reception = self.clone();
            session
                .declare_subscriber(selector)
                .allowed_origin(Locality::Remote)
                .callback(move |sample| reception.packet(&sample))
                .background()
                .wait()?;
        }
        if self.faults.is_some() {
            let reception = self.clone();
            let channel = SimChannel::Faults;
            session
                .declare_subscriber(Key::Sim { channel }.in_fleet(self.fleet))
                .callback(move |sample| reception.faults(&sample))
                .background()
                .wait()?;
        }
        for about in About::ALL {
            let questions = self.questions.clone();
            session
                .declare_queryable(about.key(self.vehicle).in_fleet(self.fleet))
                .callback(move |query| {
                    let wish = Wish::Tell(about);
                    questions.push(Question { wish, query });
                })
                .background()
                .wait()?;
        }
        let questions = self.questions.clone();
        session
            .declare_queryable(Key::Backlog { of: self.vehicle }.in_fleet(self.fleet))
            .callback(move |query| {
                let wish = Wish::Backlog;
                questions.push(Question { wish, query });
            })
            .background()
            .wait()?;
        if self.rpc {
            let reception = self.clone();
            session
                .declare_queryable(select::rpc_on(self.fleet, self.vehicle))
                .callback(move |query| reception.rpc(query))
                .background()
                .wait()?;
        }
        let reception = self.clone();
        session
            .liveliness()
            .declare_subscriber(select::alive(self.fleet))
            .history(true)
            .callback(move |sample| reception.presence(&sample))
            .background()
            .wait()?;
        let token = Key::Alive {
            of: self.vehicle,
            boot: self.boot,
        };
        session
            .liveliness()
            .declare_token(token.in_fleet(self.fleet))
            .wait()
    }

    fn packet(&self, sample: &Sample) {
        let arrival = self.clock.now();
        let Some(key) = self.key(sample).as_ref().and_then(PacketKey::of) else {
            self.refusals.count("wrong_key");
            return;
        };
        if sample.kind() != SampleKind::Put {
            self.refusals.count("packet_deleted");
            return;
        }
        if sample.payload().len() > ENVELOPE_BYTES + PACKET_BYTES_MAX {
            self.refusals.count("packet_too_long");
            return;
        }
        let bytes = sample.payload().to_bytes().into_owned();
        let packet = Input::Packet { key, bytes };
        match &self.faults {
            Some(filter) => filter.pass(arrival, key.from(), packet, &self.inbox),
            None => self.inbox.push(arrival, packet),
        }
    }

    fn rpc(&self, query: Query) {
        let Ok((_, Key::Rpc { verb, .. })) = Key::parse(query.key_expr().as_str()) else {
            self.refusals.count("wrong_key");
            return;
        };
        let wish = Wish::Do(verb);
        self.questions.push(Question { wish, query });
    }

    fn presence(&self, sample: &Sample) {
        let arrival = self.clock.now();
        let Some(Key::Alive { of: vehicle, boot }) = self.key(sample) else {
            self.refusals.count("wrong_key");
            return;
        };
        if (vehicle, boot) == (self.vehicle, self.boot) {
            return;
        }
        let input = match sample.kind() {
            SampleKind::Put => Input::Appeared { vehicle, boot },
            SampleKind::Delete => Input::Vanished { vehicle, boot },
        };
        self.inbox.push(arrival, input);
    }

    fn faults(&self, sample: &Sample) {
        let Some(filter) = &self.faults else { return };
        if sample.payload().len() > DOCUMENT_BYTES_MAX {
            self.refusals.count("faults_too_long");
            return;
        }
        let set = Faults::parse(&sample.payload().to_bytes()).and_then(|faults| filter.set(faults));
        if let Err(error) = set {
            self.refusals.count(match error {
                FaultsError::Malformed { .. } => "faults_malformed",
                _ => "faults_out_of_bounds",
            });
            tracing::debug!(%error, "simulated faults are refused");
        }
    }

    fn key(&self, sample: &Sample) -> Option<Key> {
        let (fleet, key) = Key::parse(sample.key_expr().as_str()).ok()?;
        (fleet == self.fleet).then_some(key)
    }
}
