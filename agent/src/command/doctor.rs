//! `skein doctor`: looks at this machine, at a configuration and at the running fleet, and says for each what it found,
//! what that means and what to do.

mod finding;
mod fleet;
mod machine;
mod ports;

use super::Ending;
use super::check_config::{self, Problem};
use super::observer::{Observer, ObserverArgs, WaitArgs};
use super::output::{print, print_json};
use crate::clock::Clock;
use crate::network::NetworkSettings;
use crate::queries::About;
use crate::settings::Settings;
use finding::{Finding, Report};
use skein_proto::document::{HealthDocument, InfoDocument};
use skein_proto::name::Name;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
#[command(after_help = "Examples:
  skein doctor --config skein.toml   before or while `skein run --config skein.toml` runs
  skein doctor --connect tcp/10.0.0.1:7447 --json
It ends with 0 when all is well or there are only warnings, with 5 when something needs to be mended.
It sends one small packet to the multicast group, opens a Zenoh session that only looks, and changes nothing.")]
pub(super) struct DoctorArgs {
    /// A vehicle's configuration (TOML): its fleet, network and folders are looked at.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print JSON: {problems, warnings, checks: [{check, level, found, means, advice}]}.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    wait: WaitArgs,
    #[command(flatten)]
    observer: ObserverArgs,
}

pub(super) fn run(args: &DoctorArgs) -> miette::Result<Ending> {
    let mut findings = Vec::new();
    let settings = args
        .config
        .as_deref()
        .and_then(|file| configuration(file, &mut findings));
    if let Some(settings) = &settings {
        findings.extend(machine::folders(settings));
    }
    let network = network(args, settings.as_ref());
    findings.push(machine::wall_clock(Clock::real().now()));
    findings.push(machine::synchronised());
    findings.extend(machine::interfaces(&network));
    findings.extend(machine::multicast(&network));
    let seen = look(args, &network, settings.as_ref(), &mut findings);
    if let Some(settings) = &settings {
        let runs = seen.healths.contains_key(&settings.vehicle.vehicle);
        findings.extend(ports::listening(settings, runs));
    }
    findings.extend(fleet::examine(
        &seen,
        settings.as_ref().map(|settings| settings.vehicle.vehicle),
        Clock::real().now(),
    ));
    let report = Report::of(findings);
    if args.json {
        print_json(&report)?;
    } else {
        print(&report.page())?;
    }
    Ok(if report.problems > 0 {
        Ending::Problems
    } else {
        Ending::Done
    })
}

/// Reads the configuration as `skein run` would.
fn configuration(file: &Path, findings: &mut Vec<Finding>) -> Option<Settings> {
    let (message, help) = match check_config::check(file) {
        Ok(settings) => {
            let vehicle = settings.vehicle.vehicle;
            findings.push(Finding::ok(
                "configuration",
                format!(
                    "{}: vehicle {vehicle} of fleet {}",
                    file.display(),
                    settings.fleet
                ),
            ));
            return Some(settings);
        }
        Err(Problem::Config(error)) => {
            let mistake = error.mistake();
            let line = mistake
                .line
                .map_or_else(String::new, |line| format!(":{line}"));
            (
                format!("{}{line}: {}", mistake.file, mistake.message),
                mistake.help,
            )
        }
        Err(Problem::Start(error)) => (
            format!("{}: {error}", file.display()),
            miette::Diagnostic::help(&error).map(|help| help.to_string()),
        ),
    };
    findings.push(Finding::problem(
        "configuration",
        message,
        "`skein run` does not start with it; what follows is looked at without it",
        &help
            .unwrap_or_else(|| "mend the line and look again with `skein check-config`".to_owned()),
    ));
    None
}

/// The vehicle's network as an onlooker uses it: the same interface, and the vehicle's own endpoints dialled.
fn network(args: &DoctorArgs, settings: Option<&Settings>) -> NetworkSettings {
    let mut network = args.observer.network();
    let Some(vehicle) = settings.map(|settings| &settings.network) else {
        return network;
    };
    if network.interface == NetworkSettings::default().interface {
        network.interface.clone_from(&vehicle.interface);
    }
    network.multicast &= vehicle.multicast;
    if network.zenoh_config.is_none() {
        network.zenoh_config.clone_from(&vehicle.zenoh_config);
    }
    // With a Zenoh configuration the endpoints stand there; Zenoh dials those of its `connect` by itself.
    let dialled = if vehicle.zenoh_config.is_some() {
        vehicle.listening().unwrap_or_default()
    } else {
        [vehicle.listen.as_slice(), &vehicle.connect].concat()
    };
    network
        .connect
        .extend(dialled.into_iter().filter(|endpoint| {
            !endpoint
                .split('?')
                .next()
                .unwrap_or_default()
                .ends_with(":0")
        }));
    network
}

/// What was heard of a fleet.
struct Seen {
    healths: BTreeMap<Name, HealthDocument>,
    infos: BTreeMap<Name, InfoDocument>,
}

/// Opens a session that only looks, and asks everybody.
fn look(
    args: &DoctorArgs,
    network: &NetworkSettings,
    settings: Option<&Settings>,
    findings: &mut Vec<Finding>,
) -> Seen {
    let mut seen = Seen {
        healths: BTreeMap::new(),
        infos: BTreeMap::new(),
    };
    let configured = settings.map(|settings| settings.fleet);
    let fleet = args.observer.fleet.or(configured);
    let fleet = fleet.unwrap_or_else(|| args.observer.fleet());
    let observer = match Observer::open(network, fleet, args.wait.wait) {
        Ok(observer) => observer,
        Err(error) => {
            findings.push(Finding::problem(
                "Zenoh session",
                error.to_string(),
                "`skein run` will try again and again, and nobody hears the vehicle meanwhile",
                "look at listen, connect and interface in [network]",
            ));
            return seen;
        }
    };
    match observer.ask::<HealthDocument>(About::Health, None) {
        Ok(answers) if answers.documents.is_empty() && answers.silent.is_empty() => {
            findings.push(Finding::warning(
                "fleet",
                format!(
                    "no vehicle of fleet {fleet} was seen within {} s",
                    args.wait.wait.as_secs_f64()
                ),
                "either nobody runs, or this machine cannot reach them",
                &observer.network_advice(),
            ));
        }
        Ok(answers) => {
            let names: Vec<&str> = answers.documents.keys().map(Name::as_str).collect();
            findings.push(Finding::ok(
                "fleet",
                format!(
                    "{} of fleet {fleet} answer: {}",
                    names.len(),
                    names.join(", ")
                ),
            ));
            for (vehicle, reason) in answers.silent {
                findings.push(Finding::problem(
                    &format!("{vehicle} answers"),
                    reason,
                    "its token is seen, but it does not answer for its health",
                    "is its process stopped or overloaded, or is the link to it bad? look at its log",
                ));
            }
            seen.healths = answers.documents;
        }
        Err(error) => findings.push(Finding::problem(
            "fleet",
            error.to_string(),
            "the fleet cannot be asked",
            "look at the Zenoh configuration",
        )),
    }
    if !seen.healths.is_empty()
        && let Ok(answers) = observer.ask::<InfoDocument>(About::Info, None)
    {
        seen.infos = answers.documents;
    }
    seen
}

#[cfg(test)]
mod tests {
    use super::finding::Level;
    use super::*;
    use crate::config;

    #[test]
    fn an_onlooker_dials_the_vehicle_and_those_that_it_dials() {
        let text = "[vehicle]\nname = \"v1\"\n[network]\nlisten = [\"127.0.0.1:7447\", \"tcp/127.0.0.1:0\"]\n\
                    connect = [\"10.0.0.2:7447\"]\nmulticast = false\ninterface = \"lo\"\n";
        let settings = config::parse(text, "test.toml", Path::new("")).unwrap();
        let line = clap::Parser::try_parse_from(["doctor"]);
        let Line { args } = line.unwrap();
        let network = network(&args, Some(&settings));
        assert_eq!(network.connect, ["127.0.0.1:7447", "10.0.0.2:7447"]);
        assert!(network.listen.is_empty() && !network.multicast);
        assert_eq!(network.interface, "lo");
    }

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: DoctorArgs,
    }

    #[test]
    fn a_configuration_that_does_not_parse_is_a_problem_with_its_line() {
        let mut findings = Vec::new();
        assert!(configuration(Path::new("Cargo.toml"), &mut findings).is_none());
        assert!(findings[0].level == Level::Problem && findings[0].found.contains("Cargo.toml:"));
    }
}
