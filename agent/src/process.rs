//! What the process around the vehicle knows of itself, added to the vehicle's health: session, peers, queues, log.

use crate::faults::FaultFilter;
use crate::inbox::Inbox;
use crate::life::Life;
use crate::outbox::Outgoing;
use crate::queries::Question;
use crate::queue::Queue;
use crate::record::LogHealth;
use crate::refusals::Refusals;
use skein_proto::document::{HealthDocument, ProcessHealth};
use skein_vehicle::Work;
use zenoh::Wait;

pub(crate) struct Process {
    pub(crate) life: Life,
    pub(crate) inbox: Inbox,
    pub(crate) outbox: Queue<Outgoing>,
    pub(crate) questions: Queue<Question>,
    pub(crate) work: Queue<Box<Work>>,
    pub(crate) faults: Option<FaultFilter>,
    pub(crate) refusals: Refusals,
    pub(crate) log: Option<LogHealth>,
}

impl Process {
    /// Fills `process`, adds what the shell refused, and says why nobody can be heard when that is so.
    pub(crate) fn add_to(&self, health: &mut HealthDocument) {
        let session = self.life.session();
        let peers = session.as_ref().map_or(0, |session| {
            session.info().peers_zid().wait().count() as u64
        });
        let mut process = ProcessHealth {
            peers,
            session_open: session.is_some(),
            faults_dropped: self.faults.as_ref().map_or(0, FaultFilter::dropped),
            faults: self.faults.as_ref().map(FaultFilter::count),
            log_complete: self.log.as_ref().map(LogHealth::is_complete),
            ..ProcessHealth::default()
        };
        for (lane, queue) in self.inbox.health() {
            process.queues.insert(lane.to_owned(), queue);
        }
        process
            .queues
            .insert("outbox".to_owned(), self.outbox.health());
        process
            .queues
            .insert("queries".to_owned(), self.questions.health());
        process.queues.insert("work".to_owned(), self.work.health());
        if let Some(faults) = &self.faults {
            process.queues.insert("delayed".to_owned(), faults.queue());
        }
        if let Some(log) = &self.log {
            process.queues.insert("log".to_owned(), log.queue());
        }
        health.process = Some(process);
        self.refusals.add_to(&mut health.refused);
        let network = match (&session, peers) {
            (None, _) => Some(format!(
                "the Zenoh session is not open yet{}: see [network] in the configuration",
                self.life
                    .trouble()
                    .map(|reason| format!(" ({reason})"))
                    .unwrap_or_default()
            )),
            (Some(_), 0) => Some(
                "no other Zenoh process is connected: check that the others run, and [network] connect and multicast"
                    .to_owned(),
            ),
            _ => None,
        };
        if let Some(network) = network {
            health.why = Some(match health.why.take() {
                Some(why) => format!("{why}; {network}"),
                None => network,
            });
        }
    }
}
