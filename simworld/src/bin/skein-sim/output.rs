//! What commands write to their standard output: a reader that has had enough ends a command cleanly.

use miette::{IntoDiagnostic, WrapErr};
use serde::Serialize;
use std::io::{ErrorKind, Write};

/// Writes a text. A closed pipe is no failure: `skein-sim experiment modes | head -1` is done.
pub(crate) fn print(text: &str) -> miette::Result<()> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error)
            .into_diagnostic()
            .wrap_err("the output cannot be written"),
        _ => Ok(()),
    }
}

/// Writes results as JSON that people can read too.
pub(crate) fn print_json<T: Serialize>(results: &T) -> miette::Result<()> {
    let json = serde_json::to_string_pretty(results).into_diagnostic()?;
    print(&format!("{json}\n"))
}
