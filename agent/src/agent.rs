//! One agent: a vehicle with its threads, from start to a clean stop. A process may run several.

use crate::backlog::Backlogs;
use crate::checkpoint::{self, CheckpointWriter};
use crate::driver::replay::{FramesDriver, RecordingDriver, RecordingError};
use crate::driver::zenoh::ZenohDriver;
use crate::driver::{Driver, FrameSender, Surroundings};
use crate::faults::FaultFilter;
use crate::inbox::{Inbox, Limits};
use crate::life::Life;
use crate::network::NetworkError;
use crate::operator::Operator;
use crate::outbox::{self, OUTBOX_MAX};
use crate::pending::Pending;
use crate::process::Process;
use crate::published::{Published, PublishedEstimate};
use crate::queries::{self, QUERIES_MAX, Question};
use crate::queue::{Queue, WhenFull};
use crate::reception::Reception;
use crate::record::{RecordError, Recorder};
use crate::refusals::Refusals;
use crate::settings::{DriverSettings, Settings};
use crate::work::{self, WORK_MAX};
use crate::worker::Worker;
use skein_proto::document::{HealthDocument, InfoDocument};
use skein_proto::faults::{Faults, FaultsError};
use skein_proto::name::Name;
use skein_vehicle::{Start, Vehicle, Work};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// A running agent. Dropping it stops it.
pub struct Agent {
    life: Life,
    inbox: Inbox,
    outbox: Queue<outbox::Outgoing>,
    questions: Queue<Question>,
    work: Queue<Box<Work>>,
    faults: Option<FaultFilter>,
    published: Published,
    senders: BTreeMap<Name, FrameSender>,
    worker: Option<JoinHandle<()>>,
    threads: Vec<JoinHandle<()>>,
}

/// Each sensor's driver.
type Drivers = Vec<(Name, Box<dyn Driver>)>;

/// Why an agent did not start.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum StartError {
    /// The log cannot be created.
    #[error(transparent)]
    #[diagnostic(help("[log] names a folder or file that this user may write"))]
    Record(#[from] RecordError),
    /// Checkpoints cannot be written.
    #[error("checkpoints cannot be written to {0}: {1}")]
    #[diagnostic(help("[start] checkpoint names a file in a folder that this user may write"))]
    Checkpoint(PathBuf, std::io::Error),
    /// A recording that cannot be played.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Endpoints that Zenoh does not accept.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Network(#[from] NetworkError),
    /// Simulated faults were asked for beside TLS.
    #[error("simulated faults are refused beside TLS")]
    #[diagnostic(help(
        "a secured fleet is a real one: remove [simulation], or the secured endpoints"
    ))]
    SimulationBesideTls,
    /// The system gives no more threads.
    #[error("a thread cannot be started: {0}")]
    Thread(#[from] std::io::Error),
}

impl Agent {
    /// Whether [`Agent::start`] would accept these settings; starts and creates nothing.
    pub fn check(settings: &Settings) -> Result<(), StartError> {
        checked(settings).map(drop)
    }

    /// Starts a vehicle with its drivers. Returns at once: Zenoh opens in the background, and is tried again until it
    /// opens; the vehicle runs meanwhile.
    pub fn start(mut settings: Settings) -> Result<Self, StartError> {
        let drivers = checked(&settings)?;
        let checkpoints = match &settings.checkpoint {
            None => None,
            Some(path) => {
                let vehicle = settings.vehicle.vehicle;
                if let Some(checkpoint) = checkpoint::load(path, vehicle) {
                    settings.vehicle.start = Start::Checkpoint(checkpoint);
                }
                let writer = CheckpointWriter::start(path, vehicle);
                Some(writer.map_err(|error| StartError::Checkpoint(path.clone(), error))?)
            }
        };
        let started = settings.clock.now();
        let recorder = settings
            .log
            .as_deref()
            .map(|path| Recorder::create(path, settings.fleet, &settings.vehicle, started))
            .transpose()?;
        let vehicle = Vehicle::new(settings.vehicle.clone(), started);
        let faults = settings
            .faults
            .map(|faults| FaultFilter::new(settings.vehicle.vehicle, faults));
        let refusals = Refusals::default();
        let inbox = Inbox::new(Limits::LIVE);
        let senders = settings
            .vehicle
            .sensors
            .iter()
            .map(|sensor| {
                let sender = FrameSender {
                    sensor: sensor.name,
                    clock: settings.clock,
                    inbox: inbox.clone(),
                    refusals: refusals.clone(),
                };
                (sensor.name, sender)
            })
            .collect();
        let mut agent = Self {
            life: Life::default(),
            inbox,
            outbox: Queue::new(OUTBOX_MAX, WhenFull::DropOldest),
            questions: Queue::new(QUERIES_MAX, WhenFull::DropNewest),
            work: Queue::new(WORK_MAX, WhenFull::DropOldest),
            faults,
            published: Published::new(vehicle.info()),
            senders,
            worker: None,
            threads: vec![],
        };
        // From here on dropping `agent` stops what has been started.
        agent.start_network(&settings, &refusals)?;
        agent.start_drivers(&settings, drivers)?;
        let worker = Worker {
            vehicle,
            clock: settings.clock,
            inbox: agent.inbox.clone(),
            outbox: agent.outbox.clone(),
            work: agent.work.clone(),
            published: agent.published.clone(),
            process: Process {
                life: agent.life.clone(),
                inbox: agent.inbox.clone(),
                outbox: agent.outbox.clone(),
                questions: agent.questions.clone(),
                work: agent.work.clone(),
                faults: agent.faults.clone(),
                refusals,
                log: recorder.as_ref().map(Recorder::health),
            },
            recorder,
            checkpoints,
        };
        let (work, clock, inbox) = (agent.work.clone(), settings.clock, agent.inbox.clone());
        let body = move || work::run(&work, &clock, &inbox);
        agent.threads.push(thread("work", body)?);
        agent.worker = Some(thread("worker", move || worker.run(started))?);
        Ok(agent)
    }

    fn start_network(
        &mut self,
        settings: &Settings,
        refusals: &Refusals,
    ) -> Result<(), StartError> {
        let backlogs = Backlogs {
            fleet: settings.fleet,
            clock: settings.clock,
            inbox: self.inbox.clone(),
            refusals: refusals.clone(),
            pending: Pending::default(),
        };
        let reception = Reception {
            fleet: settings.fleet,
            vehicle: settings.vehicle.vehicle,
            boot: settings.vehicle.boot,
            clock: settings.clock,
            inbox: self.inbox.clone(),
            questions: self.questions.clone(),
            backlogs: backlogs.clone(),
            faults: self.faults.clone(),
            refusals: refusals.clone(),
            rpc: settings.rpc,
        };
        let (network, outbox, life) = (
            settings.network.clone(),
            self.outbox.clone(),
            self.life.clone(),
        );
        self.threads.push(thread("network", move || {
            outbox::run(&network, &reception, &outbox, &life);
        })?);
        let (questions, fleet, published) = (
            self.questions.clone(),
            settings.fleet,
            self.published.clone(),
        );
        let operator = Operator {
            clock: settings.clock,
            inbox: self.inbox.clone(),
        };
        self.threads.push(thread("queries", move || {
            queries::answer_all(&questions, fleet, &published, &operator, &backlogs);
        })?);
        if let Some(filter) = self.faults.clone() {
            let (clock, inbox) = (settings.clock, self.inbox.clone());
            self.threads.push(thread("faults", move || {
                filter.deliver_delayed(&clock, &inbox);
            })?);
        }
        Ok(())
    }

    fn start_drivers(&mut self, settings: &Settings, drivers: Drivers) -> Result<(), StartError> {
        for (sensor, driver) in drivers {
            let Some(frames) = self.senders.get(&sensor).cloned() else {
                continue;
            };
            let surroundings = Surroundings {
                clock: settings.clock,
                life: self.life.clone(),
            };
            let word = settings.drivers.get(&sensor).map(DriverSettings::word);
            let vehicle = settings.vehicle.vehicle;
            self.threads.push(thread("driver", move || {
                tracing::info!(%vehicle, %sensor, driver = word, "the driver has started");
                if let Err(error) = driver.run(&frames, &surroundings) {
                    tracing::error!(%vehicle, %sensor, %error, "the driver has failed: no more frames of this sensor");
                }
            })?);
        }
        Ok(())
    }

    /// Waits at most so long until the Zenoh session is open and everything is declared; whether it is.
    pub fn wait_open(&self, timeout: Duration) -> bool {
        self.life.wait_open(timeout)
    }

    /// The endpoints on which it listens, ports resolved; none before the session is open.
    pub fn locators(&self) -> Vec<String> {
        self.life
            .session()
            .map(|session| outbox::locators(&session))
            .unwrap_or_default()
    }

    /// The way of a configured sensor's frames into the vehicle, whatever else drives it.
    pub fn driver(&self, sensor: Name) -> Option<FrameSender> {
        self.senders.get(&sensor).cloned()
    }

    /// The newest estimate, as published.
    pub fn latest_estimate(&self) -> Option<Arc<PublishedEstimate>> {
        self.published.estimate()
    }

    /// The newest health, as published.
    pub fn latest_health(&self) -> Option<Arc<HealthDocument>> {
        self.published.health()
    }

    /// What the vehicle is.
    pub fn info(&self) -> &InfoDocument {
        self.published.info()
    }

    /// Obeys other simulated faults from now on, as if they had come over `@sim/faults`. Fails when they are absurd;
    /// nothing happens in an agent whose settings have no faults.
    pub fn take_faults(&self, faults: Faults) -> Result<(), FaultsError> {
        match &self.faults {
            Some(filter) => filter.set(faults),
            None => faults.check(),
        }
    }

    /// Whether the vehicle's thread has ended by itself, which only a bug can do.
    pub fn has_ended(&self) -> bool {
        self.worker.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Stops: the token is withdrawn, the log finished, the session closed; within a second, also during a partition.
    pub fn stop(self) {
        drop(self);
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        self.life.stop();
        // The worker first: what it says last still goes out, and its log is finished.
        self.inbox.close();
        if let Some(worker) = self.worker.take() {
            join(worker);
        }
        if let Some(filter) = &self.faults {
            filter.close();
        }
        self.outbox.close();
        self.questions.close();
        self.work.close();
        for thread in self.threads.drain(..) {
            join(thread);
        }
    }
}

/// The drivers of settings that an agent can start with.
fn checked(settings: &Settings) -> Result<Drivers, StartError> {
    settings.network.zenoh()?;
    if settings.faults.is_some() && settings.network.is_secured()? {
        return Err(StartError::SimulationBesideTls);
    }
    drivers(settings)
}

fn drivers(settings: &Settings) -> Result<Drivers, StartError> {
    let mut drivers = Drivers::new();
    for (sensor, driver) in &settings.drivers {
        drivers.push((
            *sensor,
            match driver {
                DriverSettings::Process => continue,
                DriverSettings::Zenoh => Box::new(ZenohDriver {
                    fleet: settings.fleet,
                    vehicle: settings.vehicle.vehicle,
                }),
                DriverSettings::Recording(path) => {
                    let frames = crate::driver::replay::check(path, *sensor)?;
                    if frames == 0 {
                        tracing::warn!(%sensor, recording = %path.display(), "the recording has no frame of this sensor");
                    }
                    Box::new(RecordingDriver { path: path.clone() })
                }
                DriverSettings::Frames(frames) => Box::new(FramesDriver {
                    frames: Arc::clone(frames),
                }),
            },
        ));
    }
    Ok(drivers)
}

fn thread(name: &str, body: impl FnOnce() + Send + 'static) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new()
        .name(format!("skein-{name}"))
        .spawn(body)
}

fn join(thread: JoinHandle<()>) {
    if thread.join().is_err() {
        tracing::error!("a thread of the agent panicked: please report this with the log above");
    }
}
