//! `[[sensor]]`: what a sensor is called, where it is mounted, and where its frames come from.

use super::pose::{RawPose, optional_pose};
use super::{Checked, Wrong, name};
use crate::driver::replay;
use crate::settings::DriverSettings;
use serde::Deserialize;
use skein_proto::name::Name;
use skein_vehicle::SensorConfig;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Sensors that one vehicle has at most.
const SENSORS_MAX: usize = 32;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSensor {
    name: Spanned<String>,
    driver: Spanned<String>,
    file: Option<Spanned<PathBuf>>,
    body_from_sensor: Option<Spanned<RawPose>>,
}

/// What the vehicle knows of its sensors, and their drivers.
pub(super) type Sensors = (Vec<SensorConfig>, BTreeMap<Name, DriverSettings>);

pub(super) fn check_sensors(raw: &[RawSensor], folder: &Path) -> Checked<Sensors> {
    let mut sensors = Vec::new();
    let mut drivers = BTreeMap::new();
    for sensor in raw {
        let name = name(&sensor.name)?;
        if sensors.len() == SENSORS_MAX {
            return Err(Wrong::at(
                &sensor.name,
                format!("more than {SENSORS_MAX} sensors"),
                "put sensors of one kind and mount together",
            ));
        }
        let driver = check_driver(sensor, folder)?;
        sensors.push(SensorConfig {
            name,
            driver: driver.word().to_owned(),
            body_from_sensor: optional_pose(sensor.body_from_sensor.as_ref())?,
        });
        if drivers.insert(name, driver).is_some() {
            return Err(Wrong::at(
                &sensor.name,
                format!("there are two sensors {name}"),
                "each [[sensor]] needs its own name",
            ));
        }
    }
    Ok((sensors, drivers))
}

fn check_driver(sensor: &RawSensor, folder: &Path) -> Checked<DriverSettings> {
    match (sensor.driver.get_ref().as_str(), &sensor.file) {
        ("zenoh", None) => Ok(DriverSettings::Zenoh),
        ("process", None) => Ok(DriverSettings::Process),
        ("replay", Some(file)) => {
            let path = folder.join(file.get_ref());
            if !path.is_file() {
                return Err(Wrong::at(
                    file,
                    format!("there is no file {}", path.display()),
                    "a path is meant from the folder of this configuration",
                ));
            }
            replay::check(&path, name(&sensor.name)?).map_err(|error| {
                Wrong::at(
                    file,
                    format!("the recording cannot be played: {error}"),
                    "each line is {\"arrival_ns\": .., \"sensor\": \"..\", \"frame\": {..}}, arrivals in order",
                )
            })?;
            Ok(DriverSettings::Recording(path))
        }
        ("replay", None) => Err(Wrong::at(
            &sensor.driver,
            "the replay driver needs a recording",
            "add file = \"recording.jsonl\"",
        )),
        ("zenoh" | "process", Some(file)) => Err(Wrong::at(
            file,
            "only the replay driver reads a file",
            "use driver = \"replay\" or remove file",
        )),
        (other, _) => Err(Wrong::at(
            &sensor.driver,
            format!("there is no driver {other:?}"),
            "use \"zenoh\" (any program sends the frames) or \"replay\" (a recording)",
        )),
    }
}
