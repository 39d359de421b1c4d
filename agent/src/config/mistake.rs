//! A mistake in a configuration: what is wrong, where by file, line and key, and what to do about it.

use super::Wrong;
use miette::{NamedSource, SourceSpan};
use serde::Serialize;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// How alike two words must be for one to be meant by the other: the same bar as clap sets for options.
const ALIKE: f64 = 0.7;
/// What helps whoever does not know what a key takes.
const EXAMPLE: &str = "agent/examples/skein.toml shows every key with its unit and default";

/// A configuration that cannot be used: what, where, and what to do.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[error("{message}")]
pub struct ConfigError {
    message: String,
    #[source_code]
    source_code: NamedSource<String>,
    #[label("here")]
    at: Option<SourceSpan>,
    #[help]
    help: Option<String>,
}

/// The same in plain words, for programs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Mistake {
    /// The configuration.
    pub file: String,
    /// Counted from 1; none when the file itself cannot be read.
    pub line: Option<usize>,
    /// In characters, counted from 1.
    pub column: Option<usize>,
    /// The key from the top of the file, e.g. `network.listen[0]`.
    pub key: Option<String>,
    /// What is wrong.
    pub message: String,
    /// What to do.
    pub help: Option<String>,
}

impl ConfigError {
    /// Its place and text, one by one.
    pub fn mistake(&self) -> Mistake {
        let text = self.source_code.inner();
        let start = self.at.map(|at| at.offset().min(text.len()));
        let before = start.and_then(|start| text.get(..start));
        Mistake {
            file: self.source_code.name().to_owned(),
            line: before.map(|before| 1 + before.matches('\n').count()),
            column: before.map(|before| {
                let line = before.rsplit('\n').next().unwrap_or_default();
                1 + line.chars().count()
            }),
            key: self
                .at
                .and_then(|at| key_at(text, &(at.offset()..at.offset() + at.len()))),
            message: self.message.clone(),
            help: self.help.clone(),
        }
    }
}

impl Wrong {
    pub(super) fn in_file(self, name: &str, text: &str) -> ConfigError {
        ConfigError {
            message: self.message,
            source_code: NamedSource::new(name, text.to_owned()).with_language("TOML"),
            at: self.at.map(SourceSpan::from),
            help: self.help,
        }
    }
}

/// What the TOML reader found: a syntax error, a key that does not exist or is missing, or a value of another type.
pub(super) fn of_toml(error: &toml::de::Error, text: &str) -> Wrong {
    let words: Vec<&str> = error.message().split('`').skip(1).step_by(2).collect();
    let (message, help) = match words.as_slice() {
        [unknown, known @ ..] if error.message().starts_with("unknown field") => (
            error
                .span()
                .and_then(|span| key_at(text, &span))
                .map_or_else(
                    || format!("there is no key `{unknown}`"),
                    |key| format!("there is no key `{key}`"),
                ),
            match nearest(unknown, known) {
                Some(meant) => format!("did you mean `{meant}`? {}", listed(known)),
                None => listed(known),
            },
        ),
        [missing] if error.message().starts_with("missing field") => (
            format!("the key `{missing}` is missing"),
            format!("add `{missing}`; {EXAMPLE}"),
        ),
        _ => (error.message().to_owned(), EXAMPLE.to_owned()),
    };
    Wrong {
        message,
        // A key that is missing at the top is missing in the first line.
        at: error.span().or(Some(0..0)),
        help: Some(help),
    }
}

fn listed(known: &[&str]) -> String {
    let quoted: Vec<String> = known.iter().map(|word| format!("`{word}`")).collect();
    format!("the keys here are {}", quoted.join(", "))
}

/// The known word that was probably meant.
fn nearest<'a>(unknown: &str, known: &[&'a str]) -> Option<&'a str> {
    let alike = known
        .iter()
        .map(|word| (strsim::jaro(unknown, word), *word))
        .filter(|(likeness, _)| *likeness > ALIKE);
    alike
        .max_by(|(one, _), (other, _)| one.total_cmp(other))
        .map(|(_, word)| word)
}

/// The key whose name or value stands at a place: of all that enclose it the smallest.
fn key_at(text: &str, at: &Range<usize>) -> Option<String> {
    let (table, _) = DeTable::parse_recoverable(text);
    let mut search = Search {
        at: at.start,
        found: None,
    };
    search.table(table.get_ref(), "");
    search.found.map(|(_, key)| key)
}

struct Search {
    at: usize,
    /// The length of the smallest place so far, and its key.
    found: Option<(usize, String)>,
}

impl Search {
    fn table(&mut self, table: &DeTable<'_>, above: &str) {
        for (name, value) in table {
            let key = if above.is_empty() {
                name.get_ref().to_string()
            } else {
                format!("{above}.{}", name.get_ref())
            };
            self.consider(&name.span(), &key);
            self.value(value, &key);
        }
    }

    fn value(&mut self, value: &Spanned<DeValue<'_>>, key: &str) {
        self.consider(&value.span(), key);
        match value.get_ref() {
            DeValue::Table(table) => self.table(table, key),
            DeValue::Array(entries) => {
                for (index, entry) in entries.iter().enumerate() {
                    self.value(entry, &format!("{key}[{index}]"));
                }
            }
            _ => {}
        }
    }

    fn consider(&mut self, place: &Range<usize>, key: &str) {
        let smaller = self
            .found
            .as_ref()
            .is_none_or(|(length, _)| place.len() <= *length);
        if place.contains(&self.at) && smaller {
            self.found = Some((place.len(), key.to_owned()));
        }
    }
}
