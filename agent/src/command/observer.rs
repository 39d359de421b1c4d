//! A Zenoh session that only looks: finds the vehicles of a fleet by their tokens and asks them for documents.

use crate::clock::real_now;
use crate::network::NetworkSettings;
use crate::queries::About;
use miette::miette;
use serde::de::DeserializeOwned;
use skein_proto::document::ErrorDocument;
use skein_proto::keys::{Key, select};
use skein_proto::limits::DOCUMENT_BYTES_MAX;
use skein_proto::name::Name;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::{Duration, Instant};
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::{Session, Wait};

/// How long the set of vehicles must stay the same before it counts as all of them.
const SETTLED: Duration = Duration::from_millis(400);
/// Pause between two looks.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Longest time that can be asked for: further, the clocks of some systems cannot count.
const SECONDS_MAX: Duration = Duration::from_secs(366 * 86_400);
/// How long one query waits for its replies.
const REPLY_WITHIN: Duration = Duration::from_secs(1);

#[derive(clap::Args)]
pub(super) struct ObserverArgs {
    /// The fleet to look at [default: skein].
    #[arg(long)]
    pub(super) fleet: Option<Name>,
    /// An endpoint of any vehicle, e.g. tcp/127.0.0.1:7447; the others are found through it. May be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub(super) connect: Vec<String>,
    /// An endpoint to listen on, for vehicles that dial this tool. May be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    listen: Vec<String>,
    /// The interface on which vehicles are looked for by multicast.
    #[arg(long, default_value = "auto")]
    interface: String,
    /// Do not look for vehicles by multicast.
    #[arg(long)]
    no_multicast: bool,
    /// A Zenoh configuration file (JSON5), e.g. with certificates, instead of the options above.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["connect", "listen", "no_multicast"])]
    zenoh_config: Option<PathBuf>,
}

/// How patient a command is that asks.
#[derive(clap::Args)]
pub(super) struct WaitArgs {
    /// Seconds to wait for vehicles and answers.
    #[arg(long, default_value = "5", value_name = "SECONDS", value_parser = seconds)]
    pub(super) wait: Duration,
}

/// Parses a number of seconds.
pub(super) fn seconds(text: &str) -> Result<Duration, String> {
    text.parse()
        .ok()
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .filter(|span| *span <= SECONDS_MAX)
        .ok_or_else(|| "give a number of seconds, at most a year".to_owned())
}

impl ObserverArgs {
    /// The fleet to look at.
    pub(super) fn fleet(&self) -> Name {
        self.fleet
            .unwrap_or_else(|| Name::parse("skein").expect("the default fleet is a name"))
    }

    /// How this tool reaches the vehicles.
    pub(super) fn network(&self) -> NetworkSettings {
        NetworkSettings {
            listen: self.listen.clone(),
            connect: self.connect.clone(),
            multicast: !self.no_multicast,
            interface: self.interface.clone(),
            zenoh_config: self.zenoh_config.clone(),
        }
    }
}

/// An open session and what it looks for.
pub(super) struct Observer {
    session: Session,
    fleet: Name,
    deadline: Instant,
    wait: Duration,
}

/// What vehicles answered.
pub(super) struct Answers<D> {
    /// By vehicle.
    pub(super) documents: BTreeMap<Name, D>,
    /// Vehicles that are present but did not answer in time, or answered with an error.
    pub(super) silent: BTreeMap<Name, String>,
}

impl Observer {
    /// Opens a session that looks at a fleet for at most `wait`.
    pub(super) fn open(
        settings: &NetworkSettings,
        fleet: Name,
        wait: Duration,
    ) -> miette::Result<Self> {
        let mut config = settings.zenoh()?;
        if settings.zenoh_config.is_some() && !settings.connect.is_empty() {
            // The file of a vehicle that may be running: its ports are its own, and it is dialled there.
            let mut dialled: Vec<String> = config
                .get_json("connect/endpoints")
                .ok()
                .and_then(|text| serde_json::from_str(&text).ok())
                .unwrap_or_default();
            dialled.extend(settings.connect.iter().cloned());
            for (key, endpoints) in [("listen/endpoints", vec![]), ("connect/endpoints", dialled)] {
                config
                    .insert_json5(key, &serde_json::json!(endpoints).to_string())
                    .map_err(|error| miette!("{error}"))?;
            }
        }
        if settings.zenoh_config.is_none() {
            // A tool dials everybody itself: nobody should have to reach a laptop behind a firewall.
            for scouting in ["multicast", "gossip"] {
                config
                    .insert_json5(
                        &format!("scouting/{scouting}/autoconnect_strategy"),
                        "\"always\"",
                    )
                    .map_err(|error| miette!("{error}"))?;
            }
        }
        let session = zenoh::open(config)
            .wait()
            .map_err(|error| miette!("no Zenoh session can be opened: {error}"))?;
        Ok(Self {
            session,
            fleet,
            deadline: real_now() + wait,
            wait,
        })
    }

    /// What [`Observer::ask`] asks for, so that people can ask it themselves.
    pub(super) fn selector(&self, about: About, vehicle: Option<Name>) -> String {
        match (vehicle, about) {
            (Some(of), _) => about.key(of).in_fleet(self.fleet),
            (None, About::Health) => select::healths(self.fleet),
            (None, About::Estimate) => select::estimates(self.fleet),
            (None, About::Info) => select::infos(self.fleet),
        }
    }

    /// Asks one vehicle, or all that are present.
    pub(super) fn ask<D: DeserializeOwned>(
        &self,
        about: About,
        vehicle: Option<Name>,
    ) -> miette::Result<Answers<D>> {
        let selector = self.selector(about, vehicle);
        let present = self.wait_for_vehicles(vehicle)?;
        let mut answers = Answers {
            documents: BTreeMap::new(),
            silent: present
                .into_iter()
                .map(|name| (name, "no answer in time".to_owned()))
                .collect(),
        };
        while !answers.silent.is_empty() {
            self.get(&selector, &mut answers)?;
            if real_now() >= self.deadline {
                break;
            }
            if !answers.silent.is_empty() {
                std::thread::sleep(LOOK_EVERY);
            }
        }
        Ok(answers)
    }

    /// The session, for what is more than a question.
    pub(super) fn session(&self) -> &Session {
        &self.session
    }

    /// What to do when nobody is there.
    pub(super) fn advice(&self, vehicle: Option<Name>) -> String {
        let who = vehicle.map_or_else(
            || "no vehicle".to_owned(),
            |name| format!("no vehicle {name}"),
        );
        let fleet = self.fleet;
        format!(
            "{who} of fleet {fleet} answered within {} s.\n{}",
            self.wait.as_secs_f64(),
            self.network_advice()
        )
    }

    /// Why vehicles may be out of sight.
    pub(super) fn network_advice(&self) -> String {
        let peers = self.session.info().peers_zid().wait().count();
        let network = if peers == 0 {
            "No Zenoh process was found at all: give --connect ENDPOINT of a vehicle (its `listen`), or --interface NAME \
             of the network that carries multicast (lo for vehicles on this machine)."
        } else {
            "Zenoh processes were found, but none with such a vehicle: is --fleet the one in its configuration?"
        };
        format!("{network}\nIs `skein run` running there?")
    }

    /// The vehicles whose tokens are seen: waits for the one asked for, or until their number has settled.
    fn wait_for_vehicles(&self, vehicle: Option<Name>) -> miette::Result<BTreeSet<Name>> {
        let mut seen = BTreeSet::new();
        let mut since = real_now();
        loop {
            let now_seen = self.tokens()?;
            let now = real_now();
            if let Some(wanted) = vehicle
                && now_seen.contains(&wanted)
            {
                return Ok(BTreeSet::from([wanted]));
            }
            if now_seen != seen {
                seen = now_seen;
                since = now;
            }
            let settled = vehicle.is_none() && !seen.is_empty() && now - since >= SETTLED;
            if settled || now >= self.deadline {
                return Ok(if vehicle.is_none() {
                    seen
                } else {
                    BTreeSet::new()
                });
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    fn tokens(&self) -> miette::Result<BTreeSet<Name>> {
        let replies = self
            .session
            .liveliness()
            .get(select::alive(self.fleet))
            .timeout(REPLY_WITHIN)
            .wait()
            .map_err(|error| miette!("Zenoh refuses the query for tokens: {error}"))?;
        let mut names = BTreeSet::new();
        while let Ok(reply) = replies.recv() {
            if let Ok(sample) = reply.result()
                && let Ok((_, Key::Alive { of, .. })) = Key::parse(sample.key_expr().as_str())
            {
                names.insert(of);
            }
        }
        Ok(names)
    }

    fn get<D: DeserializeOwned>(
        &self,
        selector: &str,
        answers: &mut Answers<D>,
    ) -> miette::Result<()> {
        let replies = self
            .session
            .get(selector)
            .target(QueryTarget::All)
            .consolidation(ConsolidationMode::None)
            .timeout(REPLY_WITHIN)
            .wait()
            .map_err(|error| miette!("Zenoh refuses the query: {error}"))?;
        while let Ok(reply) = replies.recv() {
            match reply.result() {
                Ok(sample) => {
                    let Ok((_, key)) = Key::parse(sample.key_expr().as_str()) else {
                        continue;
                    };
                    let (Key::Estimate { of } | Key::Health { of } | Key::Info { of }) = key else {
                        continue;
                    };
                    let bytes = sample.payload().to_bytes();
                    if bytes.len() > DOCUMENT_BYTES_MAX {
                        answers
                            .silent
                            .insert(of, format!("an answer of {} bytes", bytes.len()));
                        continue;
                    }
                    match serde_json::from_slice(&bytes) {
                        Ok(document) => {
                            answers.silent.remove(&of);
                            answers.documents.insert(of, document);
                        }
                        Err(error) => {
                            answers
                                .silent
                                .insert(of, format!("not understood: {error}"));
                        }
                    }
                }
                Err(error) => {
                    let bytes = error.payload().to_bytes();
                    let message = serde_json::from_slice::<ErrorDocument>(&bytes)
                        .map_or_else(|_| "an error".to_owned(), |error| error.message);
                    tracing::warn!(%message, "a vehicle answered with an error");
                }
            }
        }
        Ok(())
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        // The tool is done; what is not closed when it exits, the lease ends.
        crate::session::close(self.session.clone(), ());
    }
}
