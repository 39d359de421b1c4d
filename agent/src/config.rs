//! The configuration file (TOML): read raw, checked, and turned into [`Settings`]. Whatever is wrong is shown with its
//! file, line and key, and with what to do. Each large table has a file of its own: what may stand in it, and its check.

mod cooperative;
mod mistake;
mod mutual;
mod network;
mod pose;
mod ranging;
mod sensor;

pub use mistake::{ConfigError, Mistake};

use crate::clock::Clock;
use crate::driver::replay;
use crate::network::NetworkSettings;
use crate::settings::{DriverSettings, FaultSettings, Settings, new_boot};
use cooperative::RawCooperative;
use mutual::RawMutual;
use network::RawNetwork;
use pose::{RawPose, check_pose, optional_pose};
use ranging::RawRanging;
use sensor::{RawSensor, check_sensors};
use serde::Deserialize;
use skein_estimation::time::{Span, Stamp};
use skein_proto::name::Name;
use skein_vehicle::{Start, ToldPose};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Reads a file. Fails with where and what to do.
pub fn load(path: &Path) -> Result<Settings, Box<ConfigError>> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|error| {
        let wrong = Wrong {
            message: format!("{name} cannot be read: {error}"),
            at: None,
            help: Some("give the path of a configuration; agent/examples/skein.toml is one".into()),
        };
        Box::new(wrong.in_file(&name, ""))
    })?;
    parse(&text, &name, path.parent().unwrap_or(Path::new("")))
}

/// Parses a text. `name` is shown in errors; files named in it are looked for in `folder`.
pub fn parse(text: &str, name: &str, folder: &Path) -> Result<Settings, Box<ConfigError>> {
    let wrong = |wrong: Wrong| Box::new(wrong.in_file(name, text));
    let raw: RawConfig =
        toml::from_str(text).map_err(|error| wrong(mistake::of_toml(&error, text)))?;
    raw.check(folder).map_err(wrong)
}

/// Something wrong at a place in the text.
struct Wrong {
    message: String,
    at: Option<Range<usize>>,
    help: Option<String>,
}

impl Wrong {
    fn at<T>(value: &Spanned<T>, message: impl Into<String>, help: &str) -> Self {
        Self {
            message: message.into(),
            at: Some(value.span()),
            help: Some(help.to_owned()),
        }
    }
}

type Checked<T> = Result<T, Wrong>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawConfig {
    vehicle: RawVehicle,
    #[serde(default)]
    start: RawStart,
    #[serde(default)]
    sensor: Vec<RawSensor>,
    #[serde(default)]
    cooperative: RawCooperative,
    #[serde(default)]
    mutual: RawMutual,
    #[serde(default)]
    ranging: RawRanging,
    #[serde(default)]
    estimate: RawEstimate,
    network: Option<Spanned<RawNetwork>>,
    #[serde(default)]
    clock: RawClock,
    log: Option<Spanned<RawLog>>,
    #[serde(default)]
    rpc: RawRpc,
    simulation: Option<RawSimulation>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawVehicle {
    #[serde(default = "default_fleet")]
    fleet: Spanned<String>,
    name: Spanned<String>,
    body_from_target: Option<Spanned<RawPose>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawStart {
    pose: Option<Spanned<RawPose>>,
    rotation_sigma_rad: Option<Spanned<f64>>,
    translation_sigma_m: Option<Spanned<f64>>,
    unknown: Option<Spanned<bool>>,
    checkpoint: Option<Spanned<PathBuf>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawRpc {
    enabled: bool,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawEstimate {
    rate_hz_max: Option<Spanned<f64>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawClock {
    rate: Option<Spanned<f64>>,
    start_ns: Option<i64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawLog {
    directory: Option<Spanned<PathBuf>>,
    file: Option<Spanned<PathBuf>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawSimulation {
    enabled: Spanned<bool>,
    #[serde(default)]
    seed: u64,
}

fn default_fleet() -> Spanned<String> {
    Spanned::new(0..0, "skein".to_owned())
}

impl RawConfig {
    fn check(self, folder: &Path) -> Checked<Settings> {
        let fleet = name(&self.vehicle.fleet)?;
        let vehicle = name(&self.vehicle.name)?;
        let body_from_target = optional_pose(self.vehicle.body_from_target.as_ref())?;
        let (sensors, drivers) = check_sensors(&self.sensor, folder)?;
        let clock = self.clock.check(&drivers)?;
        let (network, network_at) = match self.network {
            None => (NetworkSettings::default(), None),
            Some(network) => {
                let at = network.span();
                (network.into_inner().check(folder, &at)?, Some(at))
            }
        };
        let faults = check_simulation(self.simulation.as_ref(), &network, network_at)?;
        let boot = new_boot();
        let log = self
            .log
            .map(|log| {
                let at = log.span();
                log.into_inner().check(folder, vehicle, boot, at)
            })
            .transpose()?;
        let checkpoint = self.start.checkpoint.as_ref();
        let checkpoint = checkpoint.map(|path| folder.join(path.get_ref()));
        let cooperative = self.cooperative.check()?;
        let estimate_rate_hz = positive(self.estimate.rate_hz_max.as_ref(), 20.0, "rate_hz_max")?;
        Ok(Settings {
            fleet,
            vehicle: skein_vehicle::Config {
                vehicle,
                boot,
                period: cooperative.period,
                round_wait: cooperative.round_wait,
                start: self.start.check()?,
                mode: cooperative.mode,
                optimiser: cooperative.optimiser,
                mutual: self.mutual.check()?,
                ranging: self.ranging.check()?,
                sensors,
                body_from_target,
                presence_timeout: cooperative.presence_timeout,
                repeats: cooperative.repeats,
                relay: cooperative.relay,
                estimate_spacing: Span::from_secs_f64(1.0 / estimate_rate_hz),
            },
            drivers,
            network,
            clock,
            log,
            checkpoint,
            rpc: self.rpc.enabled,
            faults,
        })
    }
}

impl RawStart {
    fn check(self) -> Checked<Start> {
        let told = |pose| -> Checked<Start> {
            Ok(Start::Pose(ToldPose {
                world_from_body: check_pose(pose)?,
                rotation_sigma_rad: positive(
                    self.rotation_sigma_rad.as_ref(),
                    ToldPose::ROTATION_SIGMA_RAD,
                    "rotation_sigma_rad",
                )?,
                translation_sigma_m: positive(
                    self.translation_sigma_m.as_ref(),
                    ToldPose::TRANSLATION_SIGMA_M,
                    "translation_sigma_m",
                )?,
            }))
        };
        let sigmas = [&self.rotation_sigma_rad, &self.translation_sigma_m];
        if let (None, Some(sigma)) = (&self.pose, sigmas.into_iter().flatten().next()) {
            return Err(Wrong::at(
                sigma,
                "[start] says how well a pose is known, but not which",
                "give pose = { position_m = [..], yaw_pitch_roll_deg = [..] }, or leave the sigmas out",
            ));
        }
        match (&self.pose, &self.unknown) {
            (Some(pose), None) => told(pose),
            (None, None) => Ok(Start::Unknown),
            (None, Some(unknown)) if *unknown.get_ref() => Ok(Start::Unknown),
            (Some(pose), Some(unknown)) if !*unknown.get_ref() => told(pose),
            (_, Some(unknown)) => Err(Wrong::at(
                unknown,
                "[start] must say one thing",
                "give pose = { position_m = [..], yaw_pitch_roll_deg = [..] }, or unknown = true, not both",
            )),
        }
    }
}

impl RawClock {
    /// A recording runs on its own time: without other orders the clock starts where the earliest one does.
    fn check(self, drivers: &BTreeMap<Name, DriverSettings>) -> Checked<Clock> {
        let rate = positive(self.rate.as_ref(), 1.0, "rate")?;
        let recorded = drivers
            .values()
            .filter_map(|driver| match driver {
                DriverSettings::Recording(path) => replay::first_arrival(path).ok().flatten(),
                _ => None,
            })
            .min();
        let start = self.start_ns.map(Stamp::from_nanos).or(recorded);
        match start {
            Some(start) => Ok(Clock::scaled(start, rate)),
            None if self.rate.as_ref().is_some_and(|r| *r.get_ref() != 1.0) => {
                let at = self.rate.as_ref().map(Spanned::span);
                Err(Wrong {
                    message: "a clock that follows the world cannot run at another rate".into(),
                    at,
                    help: Some("rate is for recordings: give a replay driver, or start_ns".into()),
                })
            }
            None => Ok(Clock::real()),
        }
    }
}

impl RawLog {
    fn check(self, folder: &Path, vehicle: Name, boot: u64, at: Range<usize>) -> Checked<PathBuf> {
        match (self.directory, self.file) {
            (Some(directory), None) => {
                let file = format!("{vehicle}-{}.mcap", skein_proto::keys::boot_text(boot));
                Ok(folder.join(directory.into_inner()).join(file))
            }
            (None, Some(file)) => Ok(folder.join(file.into_inner())),
            (Some(directory), Some(_)) => Err(Wrong::at(
                &directory,
                "[log] has a directory and a file",
                "a directory gets one new file a boot, a file is overwritten: give one of them",
            )),
            (None, None) => Err(Wrong {
                message: "[log] has neither directory nor file".into(),
                at: Some(at),
                help: Some("give directory = \"..\" or leave the section out".into()),
            }),
        }
    }
}

fn check_simulation(
    raw: Option<&RawSimulation>,
    network: &NetworkSettings,
    network_at: Option<Range<usize>>,
) -> Checked<Option<FaultSettings>> {
    let Some(raw) = raw.filter(|raw| *raw.enabled.get_ref()) else {
        return Ok(None);
    };
    let secured = network.is_secured().map_err(|error| Wrong {
        message: error.to_string(),
        at: network_at,
        help: None,
    })?;
    if secured {
        return Err(Wrong::at(
            &raw.enabled,
            "simulation is refused beside TLS",
            "a secured fleet is a real one, and simulation lets anybody drop its packets: remove one of the two",
        ));
    }
    Ok(Some(FaultSettings { seed: raw.seed }))
}

fn name(text: &Spanned<String>) -> Checked<Name> {
    Name::parse(text.get_ref()).map_err(|error| {
        Wrong::at(
            text,
            format!("{:?} is no name: {error}", text.get_ref()),
            "names stand in keys: use 1 to 32 of a-z, 0-9 and _",
        )
    })
}

fn positive(value: Option<&Spanned<f64>>, default: f64, key: &str) -> Checked<f64> {
    let Some(given) = value else {
        return Ok(default);
    };
    let number = *given.get_ref();
    if number.is_finite() && number > 0.0 && number <= 1e6 {
        Ok(number)
    } else {
        Err(Wrong::at(
            given,
            format!("{key} = {number} is no positive number"),
            &format!("the default is {default}"),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const EXAMPLE: &str = include_str!("../examples/skein.toml");

    fn parsed(text: &str) -> Result<Settings, Box<ConfigError>> {
        parse(text, "test.toml", Path::new(""))
    }

    /// The error as a user sees it, without colours.
    fn shown(text: &str) -> String {
        let error = parsed(text).unwrap_err();
        let mut page = String::new();
        miette::GraphicalReportHandler::new_themed(miette::GraphicalTheme::unicode_nocolor())
            .render_report(&mut page, error.as_ref())
            .unwrap();
        page
    }

    const MINIMAL: &str = "[vehicle]\nname = \"v1\"\n";

    #[test]
    fn the_example_is_a_valid_configuration() {
        let settings = parsed(EXAMPLE).unwrap();
        assert_eq!(settings.vehicle.vehicle.as_str(), "v1");
        assert_eq!(settings.vehicle.sensors.len(), 2);
        assert!(matches!(settings.vehicle.start, Start::Pose(_)));
    }

    #[test]
    fn a_name_is_all_that_must_be_given() {
        let settings = parsed(MINIMAL).unwrap();
        assert_eq!(settings.fleet.as_str(), "skein");
        assert_eq!(settings.vehicle.period, Span::millis(200));
        assert_eq!(settings.vehicle.round_wait, Span::millis(300));
        assert_eq!(settings.vehicle.start, Start::Unknown);
        assert!(settings.network.multicast);
    }

    #[test]
    fn two_readings_of_one_file_are_two_boots() {
        assert_ne!(
            parsed(MINIMAL).unwrap().vehicle.boot,
            parsed(MINIMAL).unwrap().vehicle.boot
        );
    }

    #[test]
    fn a_misspelt_key_is_shown_with_its_line() {
        let page = shown("[vehicle]\nname = \"v1\"\n\n[cooperative]\nperiod = 0.2\n");
        assert!(page.contains("test.toml:5"), "{page}");
        assert!(page.contains("period_s"), "{page}");
    }

    #[test]
    fn a_bad_name_is_shown_with_what_to_do() {
        let page = shown("[vehicle]\nname = \"V 1\"\n");
        assert!(page.contains("test.toml:2"), "{page}");
        assert!(page.contains("a-z, 0-9 and _"), "{page}");
    }

    #[test]
    fn a_mount_turns_by_yaw_then_pitch_then_roll() {
        let text = format!(
            "{MINIMAL}[[sensor]]\nname = \"tags\"\ndriver = \"zenoh\"\n\
             body_from_sensor = {{ position_m = [0.1, 0, 0.2], yaw_pitch_roll_deg = [90, 0, 90] }}\n"
        );
        let settings = parsed(&text).unwrap();
        let body_from_sensor = settings.vehicle.sensors[0].body_from_sensor;
        let ahead_of_sensor = Vector3::new(1.0, 0.0, 0.0);
        let in_body = body_from_sensor.transform_point(&ahead_of_sensor);
        assert!((in_body - Vector3::new(0.1, 1.0, 0.2)).norm() < 1e-12);
        let left_of_sensor = Vector3::new(0.0, 1.0, 0.0);
        let in_body = body_from_sensor.transform_point(&left_of_sensor);
        assert!((in_body - Vector3::new(0.1, 0.0, 1.2)).norm() < 1e-12);
    }

    #[test]
    fn contradictions_are_refused() {
        for (text, expected) in [
            ("[start]\npose = {}\nunknown = true\n", "not both"),
            (
                "[start]\npose = { quaternion_wxyz = [1, 1, 0, 0] }\n",
                "length one",
            ),
            (
                "[network]\nzenoh_config = \"z.json5\"\nlisten = []\n",
                "passed through",
            ),
            (
                "[simulation]\nenabled = true\n[network]\nconnect = [\"tls/127.0.0.1:7447\"]\n",
                "refused beside TLS",
            ),
            ("[cooperative]\nmode = \"crew\"\n", "no mode"),
            ("[cooperative]\nrepeats = 8\n", "too many"),
            ("[cooperative]\nperiod_s = -1\n", "no positive number"),
            (
                "[[sensor]]\nname = \"a\"\ndriver = \"replay\"\n",
                "needs a recording",
            ),
            (
                "[[sensor]]\nname = \"a\"\ndriver = \"zenoh\"\n[[sensor]]\nname = \"a\"\ndriver = \"zenoh\"\n",
                "two sensors a",
            ),
            ("[clock]\nrate = 20.0\n", "another rate"),
            ("[network]\nlisten = [\"tcp/\"]\n", "endpoints look like"),
        ] {
            let page = shown(&format!("{MINIMAL}{text}"));
            assert!(page.contains(expected), "{expected}: {page}");
        }
    }

    #[test]
    fn every_mistake_names_its_line_its_key_and_what_to_do() {
        for (text, line, key) in [
            ("[cooperative]\nperiod = 0.2\n", 4, "cooperative.period"),
            (
                "[cooperative]\nperiod_s = \"fast\"\n",
                4,
                "cooperative.period_s",
            ),
            ("[cooperative]\nperiod_s = 0\n", 4, "cooperative.period_s"),
            (
                "[cooperative]\nround_wait_s = -1\n",
                4,
                "cooperative.round_wait_s",
            ),
            ("[cooperative]\nmode = \"crew\"\n", 4, "cooperative.mode"),
            (
                "[cooperative]\noptimiser = \"x\"\n",
                4,
                "cooperative.optimiser",
            ),
            ("[cooperative]\nrepeats = 8\n", 4, "cooperative.repeats"),
            (
                "[cooperative]\npresence_timeout_s = nan\n",
                4,
                "cooperative.presence_timeout_s",
            ),
            ("[estimate]\nrate_hz_max = 0\n", 4, "estimate.rate_hz_max"),
            (
                "[start]\npose = { position_m = [0, 0] }\n",
                4,
                "start.pose.position_m",
            ),
            (
                "[start.pose]\nposition_m = [0, 0, 0]\nquaternion_wxyz = [1, 1, 0, 0]\n",
                5,
                "start.pose.quaternion_wxyz",
            ),
            (
                "[start.pose]\nyaw_pitch_roll_deg = [0, 0, 0]\nquaternion_wxyz = [1, 0, 0, 0]\n",
                5,
                "start.pose.quaternion_wxyz",
            ),
            (
                "[start.pose]\nyaw_pitch_roll_deg = [0, 0, inf]\n",
                4,
                "start.pose.yaw_pitch_roll_deg",
            ),
            ("[start]\npose = {}\nunknown = true\n", 5, "start.unknown"),
            (
                "[start]\npose = {}\nrotation_sigma_rad = 0\n",
                5,
                "start.rotation_sigma_rad",
            ),
            (
                "[start]\ntranslation_sigma_m = 0.1\n",
                4,
                "start.translation_sigma_m",
            ),
            (
                "[[sensor]]\nname = \"A\"\ndriver = \"zenoh\"\n",
                4,
                "sensor[0].name",
            ),
            (
                "[[sensor]]\nname = \"a\"\ndriver = \"x\"\n",
                5,
                "sensor[0].driver",
            ),
            (
                "[[sensor]]\nname = \"a\"\ndriver = \"replay\"\nfile = \"gone\"\n",
                6,
                "sensor[0].file",
            ),
            (
                "[[sensor]]\nname = \"a\"\ndriver = \"replay\"\nfile = \"Cargo.toml\"\n",
                6,
                "sensor[0].file",
            ),
            ("[[sensor]]\nname = \"a\"\n", 3, "sensor[0]"),
            (
                "[network]\nlisten = [\n  \"tcp/127.0.0.1:1\",\n  \"tcp/\",\n]\n",
                6,
                "network.listen[1]",
            ),
            (
                "[network]\nconnect = [\"nowhere\"]\n",
                4,
                "network.connect[0]",
            ),
            ("[network]\nmulticast = 1\n", 4, "network.multicast"),
            (
                "[network]\nzenoh_config = \"gone.json5\"\n",
                4,
                "network.zenoh_config",
            ),
            (
                "[network]\nmulticast = true\nzenoh_config = \"z.json5\"\n",
                5,
                "network.zenoh_config",
            ),
            ("[clock]\nrate = 20.0\n", 4, "clock.rate"),
            ("[clock]\nstart_ns = 1.5\n", 4, "clock.start_ns"),
            ("[log]\n", 3, "log"),
            (
                "[log]\ndirectory = \"a\"\nfile = \"b\"\n",
                4,
                "log.directory",
            ),
            (
                "[simulation]\nenabled = true\nseed = -1\n",
                5,
                "simulation.seed",
            ),
            ("[sensors]\n", 3, "sensors"),
        ] {
            let text = format!("{MINIMAL}{text}");
            let mistake = parsed(&text).unwrap_err().mistake();
            let found = (mistake.line, mistake.key.as_deref());
            assert_eq!(found, (Some(line), Some(key)), "{text}: {mistake:?}");
            assert!(mistake.help.is_some(), "{text}: {mistake:?}");
        }
    }

    #[test]
    fn what_is_missing_is_missing_somewhere() {
        let mistake = parsed("[vehicle]\nfleet = \"geese\"\n")
            .unwrap_err()
            .mistake();
        assert_eq!(
            (mistake.line, mistake.key.as_deref()),
            (Some(1), Some("vehicle"))
        );
        assert!(mistake.message.contains("`name` is missing"), "{mistake:?}");
        let mistake = parsed("# nothing\n").unwrap_err().mistake();
        assert_eq!((mistake.line, mistake.column), (Some(1), Some(1)));
        assert!(
            mistake.message.contains("`vehicle` is missing"),
            "{mistake:?}"
        );
    }

    #[test]
    fn the_key_that_was_meant_is_suggested() {
        for (text, meant) in [
            ("[cooperative]\nperiod = 0.2\n", "did you mean `period_s`?"),
            ("[network]\nlisen = []\n", "did you mean `listen`?"),
            ("[sensors]\n", "did you mean `sensor`?"),
            ("[netwrok]\n", "did you mean `network`?"),
        ] {
            let help = parsed(&format!("{MINIMAL}{text}"))
                .unwrap_err()
                .mistake()
                .help;
            assert!(
                help.as_deref().is_some_and(|help| help.contains(meant)),
                "{help:?}"
            );
        }
        let strange = parsed(&format!("{MINIMAL}[estimate]\nxyz = 1\n")).unwrap_err();
        let help = strange.mistake().help.unwrap();
        assert!(
            !help.contains("mean") && help.contains("`rate_hz_max`"),
            "{help}"
        );
    }
}
