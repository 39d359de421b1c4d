//! A Zenoh session that only looks: finds the vehicles of a fleet by their tokens and asks them for documents.

use crate::clock::real_now;
use crate::network::NetworkSettings;
use crate::queries::About;
use miette::{IntoDiagnostic, WrapErr, miette};
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
/// How long one query waits for its replies.
const REPLY_WITHIN: Duration = Duration::from_secs(1);

#[derive(clap::Args)]
pub(super) struct ObserverArgs {
    /// The fleet to look at.
    #[arg(long, default_value = "skein")]
    fleet: Name,
    /// An endpoint of any vehicle, e.g. tcp/127.0.0.1:7447; the others are found through it. May be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    connect: Vec<String>,
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
    /// Seconds to wait for vehicles and answers.
    #[arg(long, default_value_t = 5.0, value_name = "SECONDS")]
    wait: f64,
}

/// An open session and what it looks for.
pub(super) struct Observer {
    session: Session,
    fleet: Name,
    deadline: Instant,
    wait_s: f64,
}

/// What vehicles answered.
pub(super) struct Answers<D> {
    /// By vehicle.
    pub(super) documents: BTreeMap<Name, D>,
    /// Vehicles that are present but did not answer in time, or answered with an error.
    pub(super) silent: BTreeMap<Name, String>,
}

impl Observer {
    pub(super) fn open(args: &ObserverArgs) -> miette::Result<Self> {
        let wait = Duration::try_from_secs_f64(args.wait)
            .into_diagnostic()
            .wrap_err("--wait is a number of seconds")?;
        let settings = NetworkSettings {
            listen: args.listen.clone(),
            connect: args.connect.clone(),
            multicast: !args.no_multicast,
            interface: args.interface.clone(),
            zenoh_config: args.zenoh_config.clone(),
        };
        let mut config = settings.zenoh()?;
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
            fleet: args.fleet,
            deadline: real_now() + wait,
            wait_s: args.wait,
        })
    }

    /// Asks one vehicle, or all that are present, and says on stderr which selector that is.
    pub(super) fn ask<D: DeserializeOwned>(
        &self,
        about: About,
        vehicle: Option<Name>,
    ) -> miette::Result<Answers<D>> {
        let selector = match vehicle {
            Some(of) => about.key(of).in_fleet(self.fleet),
            None => match about {
                About::Health => select::healths(self.fleet),
                _ => select::estimates(self.fleet),
            },
        };
        eprintln!("selector: {selector}");
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

    /// What to do when nobody is there.
    pub(super) fn advice(&self, vehicle: Option<Name>) -> String {
        let who = vehicle.map_or_else(
            || "no vehicle".to_owned(),
            |name| format!("no vehicle {name}"),
        );
        let peers = self.session.info().peers_zid().wait().count();
        let network = if peers == 0 {
            "No Zenoh process was found at all: give --connect ENDPOINT of a vehicle (its `listen`), or --interface NAME \
             of the network that carries multicast (lo for vehicles on this machine)."
        } else {
            "Zenoh processes were found, but none with such a vehicle: is --fleet the one in its configuration?"
        };
        format!(
            "{who} of fleet {} answered within {} s.\n{network}\nIs `skein run` running there?",
            self.fleet, self.wait_s
        )
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
