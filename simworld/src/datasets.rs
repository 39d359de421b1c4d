//! Where real recordings lie on this computer, and how their files are opened: the one place of the library that
//! reads an environment variable or a file. Recordings are never part of the project.

use crate::inertial_recording::{InertialReading, RecordingError};
use crate::mrclam::{MrclamError, Recording};
use crate::{broad, euroc};
use flate2::read::GzDecoder;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The environment variable with the folder of all recordings.
pub const VARIABLE: &str = "SKEIN_DATA";

/// The folder of the recordings with this name: in `$SKEIN_DATA`, or else beside the project in `shared/data`. None,
/// and a line on stderr that says what is skipped, when it is not there.
#[must_use]
pub fn find(name: &str) -> Option<PathBuf> {
    let beside = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    let folder = std::env::var_os(VARIABLE)
        .map_or_else(beside, PathBuf::from)
        .join(name);
    if folder.is_dir() {
        Some(folder)
    } else {
        eprintln!(
            "SKIPPED: no recordings in {}; set {VARIABLE} to the folder that holds `{name}`",
            folder.display()
        );
        None
    }
}

/// Reads the folder of an MR.CLAM recording. Fails with the file, the line and what is wrong.
pub fn read_mrclam(folder: &Path) -> Result<Recording, MrclamError> {
    Recording::parse(|file_name| std::fs::read_to_string(folder.join(file_name)))
}

/// The most bytes of text that are read from one packed file.
const UNPACKED_MAX: u64 = 1 << 28;

/// Why an inertial recording cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum InertialError {
    /// A file or folder could not be read.
    #[error("cannot read {}: {error}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// There is nothing of the kind in the folder.
    #[error("there is no {what} in {}", folder.display())]
    Nothing {
        /// What is missing.
        what: &'static str,
        /// The folder.
        folder: PathBuf,
    },
    /// A line is wrong.
    #[error(transparent)]
    Wrong(#[from] RecordingError),
}

/// Reads every trial of BROAD (`*.csv.gz`) in a folder, in the order of their names, which come first.
pub fn read_broad(folder: &Path) -> Result<Vec<(String, Vec<InertialReading>)>, InertialError> {
    let unreadable = |path: &Path| {
        let path = path.to_owned();
        move |error| InertialError::Unreadable { path, error }
    };
    let mut names: Vec<String> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable(folder))? {
        let entry = entry.map_err(unreadable(folder))?;
        if let Some(name) = entry
            .file_name()
            .to_str()
            .and_then(|name| name.strip_suffix(".csv.gz"))
        {
            names.push(name.to_owned());
        }
    }
    if names.is_empty() {
        return Err(InertialError::Nothing {
            what: "trial (*.csv.gz)",
            folder: folder.to_owned(),
        });
    }
    names.sort();
    let read = |name: String| {
        let path = folder.join(format!("{name}.csv.gz"));
        let mut text = String::new();
        File::open(&path)
            .and_then(|file| {
                GzDecoder::new(file)
                    .take(UNPACKED_MAX)
                    .read_to_string(&mut text)
            })
            .map_err(unreadable(&path))?;
        let readings = broad::parse(&text, &format!("{name}.csv"))?;
        Ok((name, readings))
    };
    names.into_iter().map(read).collect()
}

/// Reads a EuRoC flight (`imu0_data.csv` and `V1_01_easy.csv`) in a folder.
pub fn read_euroc(folder: &Path) -> Result<euroc::Flight, InertialError> {
    let text = |name: &str| {
        let path = folder.join(name);
        std::fs::read_to_string(&path).map_err(|error| InertialError::Unreadable { path, error })
    };
    const SENSOR: &str = "imu0_data.csv";
    const TRUTH: &str = "V1_01_easy.csv";
    let (sensor, truth) = (text(SENSOR)?, text(TRUTH)?);
    Ok(euroc::parse((&sensor, SENSOR), (&truth, TRUTH))?)
}
