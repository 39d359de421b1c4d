//! `skein check-config`: reads a configuration exactly as `skein run` does, starts nothing, and tells what would run.

use super::Ending;
use super::output::{print, print_json};
use crate::agent::Agent;
use crate::config::{self, Mistake};
use crate::settings::{DriverSettings, Settings};
use serde::Serialize;
use skein_estimation::transform::Transform;
use skein_proto::keys::Key;
use skein_proto::name::Name;
use skein_vehicle::Start;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
#[command(after_help = "Examples:
  skein check-config skein.toml
  skein check-config skein.toml --json
A mistake ends it with 1; with --json it is {file, line, column, key, message, help} on the standard output.")]
pub(super) struct CheckConfigArgs {
    /// The vehicle's configuration (TOML).
    file: PathBuf,
    /// Print JSON: the summary, or the mistake.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &CheckConfigArgs) -> miette::Result<Ending> {
    let checked = match check(&args.file) {
        Ok(settings) => Ok(settings),
        Err(Problem::Config(error)) if args.json => Err(error.mistake()),
        Err(Problem::Config(error)) => return Err(miette::Report::new(*error)),
        Err(Problem::Start(error)) if args.json => Err(Mistake {
            file: args.file.display().to_string(),
            line: None,
            column: None,
            key: None,
            message: error.to_string(),
            help: miette::Diagnostic::help(&error).map(|help| help.to_string()),
        }),
        Err(Problem::Start(error)) => return Err(error.into()),
    };
    match checked {
        Ok(settings) => {
            let summary = Summary::of(&args.file, &settings);
            if args.json {
                print_json(&summary)
            } else {
                print(&summary.page())
            }
        }
        Err(mistake) => {
            print_json(&mistake)?;
            Ok(Ending::Mistaken)
        }
    }
}

/// Why `skein run` would not start.
pub(super) enum Problem {
    /// The file.
    Config(Box<config::ConfigError>),
    /// What it asks for.
    Start(crate::agent::StartError),
}

/// What `skein run` checks before it starts anything.
pub(super) fn check(file: &Path) -> Result<Settings, Problem> {
    let settings = config::load(file).map_err(Problem::Config)?;
    Agent::check(&settings).map_err(Problem::Start)?;
    Ok(settings)
}

/// What would run.
#[derive(Debug, Serialize)]
struct Summary {
    file: String,
    fleet: Name,
    vehicle: Name,
    start: String,
    sensors: BTreeMap<Name, SensorSummary>,
    mode: String,
    period_s: f64,
    round_wait_s: f64,
    listen: Vec<String>,
    connect: Vec<String>,
    multicast: bool,
    interface: String,
    zenoh_config: Option<PathBuf>,
    secured: bool,
    log: Option<PathBuf>,
    simulation: bool,
}

#[derive(Debug, Serialize)]
struct SensorSummary {
    driver: String,
    /// Where its frames come from.
    source: String,
    /// Its mount.
    body_from_sensor: String,
}

impl Summary {
    fn of(file: &Path, settings: &Settings) -> Self {
        let vehicle = &settings.vehicle;
        let sensors = vehicle.sensors.iter().map(|sensor| {
            let source = match settings.drivers.get(&sensor.name) {
                Some(DriverSettings::Zenoh) => Key::Driver {
                    of: vehicle.vehicle,
                    sensor: sensor.name,
                }
                .in_fleet(settings.fleet),
                Some(DriverSettings::Recording(path)) => path.display().to_string(),
                _ => "the program that runs the agent".to_owned(),
            };
            let summary = SensorSummary {
                driver: sensor.driver.clone(),
                source,
                body_from_sensor: pose(&sensor.body_from_sensor),
            };
            (sensor.name, summary)
        });
        let network = &settings.network;
        Self {
            file: file.display().to_string(),
            fleet: settings.fleet,
            vehicle: vehicle.vehicle,
            start: start(&vehicle.start),
            sensors: sensors.collect(),
            mode: vehicle.mode.name().to_owned(),
            period_s: vehicle.period.as_secs_f64(),
            round_wait_s: vehicle.round_wait.as_secs_f64(),
            listen: network.listen.clone(),
            connect: network.connect.clone(),
            multicast: network.multicast,
            interface: network.interface.clone(),
            zenoh_config: network.zenoh_config.clone(),
            secured: network.is_secured().unwrap_or(false),
            log: settings.log.clone(),
            simulation: settings.faults.is_some(),
        }
    }

    /// For people. Writing to a string cannot fail, so its results are dropped.
    fn page(&self) -> String {
        use std::fmt::Write;
        let mut page = String::new();
        let mut line = |title: &str, text: String| {
            let _ = writeln!(page, "  {title:<10} {text}");
        };
        line(
            "vehicle",
            format!("{} of fleet {}", self.vehicle, self.fleet),
        );
        line("start", self.start.clone());
        if self.sensors.is_empty() {
            line(
                "sensors",
                "none: without odometry there is no estimate".to_owned(),
            );
        }
        for (name, sensor) in &self.sensors {
            line(
                "sensor",
                format!(
                    "{name}: driver {}, from {}; mount {}",
                    sensor.driver, sensor.source, sensor.body_from_sensor
                ),
            );
        }
        line(
            "rounds",
            format!(
                "mode {}, every {} s, solved {:.3} s after their instant at the latest",
                self.mode, self.period_s, self.round_wait_s
            ),
        );
        if let Some(file) = &self.zenoh_config {
            line("network", format!("as in {}", file.display()));
        } else {
            line("listens on", listed(&self.listen, "any free port"));
            line("dials", listed(&self.connect, "nobody by configuration"));
            let multicast = if self.multicast {
                format!("on interface {}", self.interface)
            } else {
                "off".to_owned()
            };
            line("multicast", multicast);
        }
        let secured = if self.secured {
            "yes"
        } else {
            "no: anybody on the network can speak and listen"
        };
        line("secured", secured.to_owned());
        let log = self.log.as_ref();
        line(
            "input log",
            log.map_or_else(|| "none".to_owned(), |path| path.display().to_string()),
        );
        if self.simulation {
            line("simulation", "obeys simulated radio faults".to_owned());
        }
        format!("{}: no mistakes. `skein run` would run\n{page}", self.file)
    }
}

fn listed(texts: &[String], none: &str) -> String {
    if texts.is_empty() {
        none.to_owned()
    } else {
        texts.join(", ")
    }
}

fn start(start: &Start) -> String {
    match start {
        Start::Pose(told) => format!(
            "{}, give or take {:?} rad and {:?} m",
            pose(&told.world_from_body),
            told.rotation_sigma_rad,
            told.translation_sigma_m
        ),
        Start::Checkpoint(checkpoint) => {
            format!("checkpoint, {}", pose(&checkpoint.world_from_body))
        }
        Start::Unknown => {
            "unknown: placed by located neighbours, a pose fix or @rpc/set_pose".to_owned()
        }
    }
}

/// A pose as it stands in a configuration.
fn pose<To, From>(pose: &Transform<To, From>) -> String {
    let [x, y, z]: [f64; 3] = pose.translation.into();
    let (roll, pitch, yaw) = pose.rotation.euler_angles();
    // Adding zero turns a negative zero into a plain one.
    let shown = |number: f64| (number * 1e4).round() / 1e4 + 0.0;
    let degrees = [yaw, pitch, roll].map(|angle| shown(angle.to_degrees()));
    format!(
        "at {:?} m, yaw pitch roll {degrees:?} deg",
        [shown(x), shown(y), shown(z)]
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_says_what_would_run() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/skein.toml");
        let Ok(settings) = check(Path::new(file)) else {
            panic!("the example is a valid configuration");
        };
        let page = Summary::of(Path::new(file), &settings).page();
        for expected in [
            "v1 of fleet skein",
            "at [0.0, 0.0, 0.0] m",
            "tags: driver zenoh, from skein/@v1/v1/@driver/tags; mount at [0.3, 0.0, 0.1] m, yaw pitch roll [20.0, 0.0, 0.0] deg",
            "mode team, every 0.2 s",
            "127.0.0.1:7447",
            "on interface auto",
        ] {
            assert!(page.contains(expected), "{expected}: {page}");
        }
    }
}
