//! Files of results.

use miette::{Context, IntoDiagnostic};
use std::path::Path;

/// Writes a file, its folder made where it is missing.
pub(crate) fn write(folder: &Path, name: &str, text: &str) -> miette::Result<()> {
    let path = folder.join(name);
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(&path, text))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}
