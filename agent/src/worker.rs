//! The one thread that owns the vehicle: takes inputs in the order of their arrival, hands out what comes of them, and
//! keeps the vehicle's only timer.

use crate::changes::Changes;
use crate::checkpoint::CheckpointWriter;
use crate::clock::Clock;
use crate::inbox::{Inbox, Popped};
use crate::outbox::Outgoing;
use crate::process::Process;
use crate::published::{Published, PublishedEstimate};
use crate::queue::Queue;
use crate::record::{Recorder, Step};
use skein_estimation::time::{Span, Stamp};
use skein_proto::backlog::Question;
use skein_vehicle::{Input, Output, Vehicle, Work};
use std::sync::Arc;

pub(crate) struct Worker {
    pub(crate) vehicle: Vehicle,
    pub(crate) clock: Clock,
    pub(crate) inbox: Inbox,
    pub(crate) outbox: Queue<Outgoing>,
    pub(crate) work: Queue<Box<Work>>,
    pub(crate) published: Published,
    pub(crate) process: Process,
    pub(crate) recorder: Option<Recorder>,
    pub(crate) checkpoints: Option<CheckpointWriter>,
}

/// What the vehicle waits for, when it was last told the time, and what the log was last told.
struct Pace {
    now: Stamp,
    wake_at: Stamp,
    changes: Changes,
}

/// How far behind its wakes the vehicle may be and still be given each of them at its own time.
const BEHIND_MAX: Span = Span::secs(1);

impl Worker {
    /// Runs until the inbox is closed. `started` is what [`Vehicle::new`] was given.
    pub(crate) fn run(mut self, started: Stamp) {
        let mut pace = Pace {
            now: started,
            wake_at: started,
            changes: Changes::default(),
        };
        self.drain(&mut pace, None);
        loop {
            match self.inbox.pop_until(self.clock.instant_of(pace.wake_at)) {
                Popped::Closed => break,
                Popped::TimedOut => {
                    let now = self.clock.now().max(pace.wake_at);
                    self.step(&mut pace, now, Input::Wake);
                }
                Popped::Input { arrival, input } => {
                    // After a stop of the whole process the past is not lived through again.
                    if arrival - pace.wake_at > BEHIND_MAX {
                        self.step(&mut pace, arrival, Input::Wake);
                    }
                    // What was due before it arrived comes before it, so that a busy moment does not change the order.
                    while pace.wake_at <= arrival {
                        let due = pace.wake_at;
                        self.step(&mut pace, due, Input::Wake);
                        if pace.wake_at <= due {
                            break;
                        }
                    }
                    self.step(&mut pace, arrival, input);
                }
            }
        }
    }

    /// Time never goes back for the vehicle, whichever thread read the clock first.
    fn step(&mut self, pace: &mut Pace, at: Stamp, input: Input) {
        pace.now = pace.now.max(at);
        let recorded = self.recorder.is_some().then(|| input.clone());
        self.vehicle.handle(pace.now, input);
        self.drain(pace, recorded);
    }

    fn drain(&mut self, pace: &mut Pace, input: Option<Input>) {
        let mut step = self
            .recorder
            .as_ref()
            .map(|_| Step::new(self.published.info().vehicle, pace.now, input));
        loop {
            let output = self.vehicle.poll();
            if let Some(step) = &mut step {
                step.add(&output);
            }
            match output {
                Output::Send { key, bytes } => {
                    self.outbox.push(Outgoing::Packet { key, bytes });
                }
                Output::Ask { to, boot, since_ns } => {
                    let question = Question { since_ns, boot };
                    self.outbox.push(Outgoing::Question { to, question });
                }
                Output::Work(work) => {
                    self.work.push(work);
                }
                Output::Answer { query, packets } => {
                    self.outbox.push(Outgoing::Answer { query, packets });
                }
                Output::Estimate { packet, document } => {
                    if let Some(change) = pace.changes.in_estimate(&document) {
                        change.log(document.vehicle.as_str());
                    }
                    let estimate = Arc::new(PublishedEstimate {
                        packet,
                        document: *document,
                    });
                    self.published.set_estimate(Arc::clone(&estimate));
                    self.outbox.push(Outgoing::Estimate(estimate));
                }
                Output::Health(document) => {
                    let mut health = *document;
                    self.process.add_to(&mut health);
                    for change in pace.changes.in_health(&health) {
                        change.log(health.vehicle.as_str());
                    }
                    let health = Arc::new(health);
                    self.published.set_health(Arc::clone(&health));
                    self.outbox.push(Outgoing::Health(health));
                }
                Output::Checkpoint(checkpoint) => {
                    if let Some(writer) = &self.checkpoints {
                        writer.write(checkpoint);
                    }
                }
                Output::WakeAt(instant) => {
                    pace.wake_at = instant;
                    break;
                }
            }
        }
        if let (Some(recorder), Some(step)) = (&self.recorder, step) {
            recorder.record(step);
        }
    }
}
