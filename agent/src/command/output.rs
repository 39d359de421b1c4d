//! What commands write to their standard output: a reader that has had enough ends a command cleanly, and what others
//! wrote cannot steer the terminal.

use super::Ending;
use miette::{IntoDiagnostic, WrapErr};
use serde::Serialize;
use std::io::{ErrorKind, Write};

/// Writes a text. A closed pipe is no failure: `skein get | head -1` is done.
pub(super) fn print(text: &str) -> miette::Result<Ending> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error)
            .into_diagnostic()
            .wrap_err("the output cannot be written"),
        _ => Ok(Ending::Done),
    }
}

/// Writes a document as one line of JSON.
pub(super) fn print_json<T: Serialize>(document: &T) -> miette::Result<Ending> {
    let json = crate::queries::json(document);
    print(&format!("{}\n", String::from_utf8_lossy(&json)))
}

/// A text from another process without control characters, which a terminal would obey.
pub(super) fn plain(text: &str) -> String {
    text.replace(|c: char| c.is_control(), " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_of_others_cannot_steer_the_terminal() {
        assert_eq!(plain("why\u{1b}[2J\nnot"), "why [2J not");
    }
}
