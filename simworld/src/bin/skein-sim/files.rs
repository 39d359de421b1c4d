//! Files of results, and scenarios from files.

use miette::{Context, IntoDiagnostic, miette};
use skein_simworld::scenario::Scenario;
use std::path::Path;

/// Writes a file, its folder made where it is missing.
pub(crate) fn write(folder: &Path, name: &str, text: &str) -> miette::Result<()> {
    let path = folder.join(name);
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(&path, text))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}

/// A built-in scenario by its name, or one from a TOML file.
pub(crate) fn scenario(name_or_file: &str) -> miette::Result<Scenario> {
    if let Some(scenario) = Scenario::built_in(name_or_file) {
        return Ok(scenario);
    }
    let text = std::fs::read_to_string(name_or_file).map_err(|error| {
        let known: Vec<&str> = Scenario::built_in_names().collect();
        miette!(
            help = format!("built in are: {}", known.join(", ")),
            "{name_or_file} is neither a built-in scenario nor a file that can be read: {error}"
        )
    })?;
    Ok(Scenario::parse(&text, name_or_file)?)
}
