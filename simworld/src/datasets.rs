//! Where real recordings lie on this computer, and how their files are opened: the one place of the library that
//! reads an environment variable or a file. Recordings are never part of the project.

use crate::mrclam::{MrclamError, Recording};
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
