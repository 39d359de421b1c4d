//! Why a text is no scenario: what is wrong, and its line, column and key.

use std::fmt;
use std::ops::Range;

/// What is wrong with the text of a scenario, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScenarioError {
    origin: String,
    text: String,
    span: Range<usize>,
    key: Option<String>,
    message: String,
}

impl ScenarioError {
    /// What the TOML reader says of this text.
    pub(super) fn of_toml(text: &str, origin: &str, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or(0..0);
        Self::at(
            text,
            origin,
            span.clone(),
            key_at(text, span.start),
            error.message().to_owned(),
        )
    }

    /// A broken law of a key, wherever the text first sets it.
    pub(super) fn of_key(text: &str, origin: &str, key: &str, message: String) -> Self {
        // Either `key = ...`, or a table of its own: `[table.key]`, `[[table.key]]`.
        let set = |line: &str| {
            let header = line.trim().strip_prefix('[').and_then(|rest| {
                let name = rest.trim_end_matches(']');
                name.rsplit(['.', '[']).next()
            });
            let assigned = line.trim_start().strip_prefix(key);
            header == Some(key)
                || assigned.is_some_and(|rest| rest.trim_start().starts_with(['=', '.']))
        };
        let start = text.split_inclusive('\n').scan(0, |offset, line| {
            let start = *offset;
            *offset += line.len();
            Some((start, line))
        });
        let start = start
            .filter(|(_, line)| set(line))
            .map(|(start, _)| start)
            .next()
            .unwrap_or(0);
        Self::at(text, origin, start..start, Some(key.to_owned()), message)
    }

    fn at(
        text: &str,
        origin: &str,
        span: Range<usize>,
        key: Option<String>,
        message: String,
    ) -> Self {
        Self {
            origin: origin.to_owned(),
            text: text.to_owned(),
            span,
            key,
            message,
        }
    }

    fn before(&self) -> &[u8] {
        &self.text.as_bytes()[..self.span.start.min(self.text.len())]
    }

    /// The line, from 1.
    #[must_use]
    pub fn line(&self) -> usize {
        self.before().iter().filter(|byte| **byte == b'\n').count() + 1
    }

    /// The column in bytes, from 1.
    #[must_use]
    pub fn column(&self) -> usize {
        let since_newline = self.before().iter().rev();
        since_newline.take_while(|byte| **byte != b'\n').count() + 1
    }

    /// The key on that line with its table, if there is one: `radio.loss`.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        self.key.as_deref()
    }

    /// What is wrong, without its place.
    #[must_use]
    pub fn message(&self) -> &str {
        &self.message
    }
}

/// The key that the line at this offset sets, with the header of the table it stands in; for a table's own line, the
/// table. Only for messages: keys inside an inline table are reported as the line's key.
fn key_at(text: &str, offset: usize) -> Option<String> {
    let offset = offset.min(text.len());
    let line_start = text[..offset].rfind('\n').map_or(0, |newline| newline + 1);
    let line = text[line_start..].lines().next().unwrap_or("").trim();
    let header = |line: &str| {
        let name = line
            .trim()
            .strip_prefix('[')?
            .trim_matches(['[', ']'])
            .trim()
            .to_owned();
        (!line.contains('=')).then_some(name)
    };
    if let Some(table) = header(line) {
        return Some(table);
    }
    let (key, _) = line.split_once('=')?;
    let key = key.trim();
    let table = text[..line_start].lines().rev().find_map(header);
    Some(table.map_or_else(|| key.to_owned(), |table| format!("{table}.{key}")))
}

impl fmt::Display for ScenarioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}: ", self.origin, self.line(), self.column())?;
        if let Some(key) = &self.key {
            write!(f, "{key}: ")?;
        }
        f.write_str(&self.message)
    }
}

impl std::error::Error for ScenarioError {}

impl miette::Diagnostic for ScenarioError {
    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        Some(&self.text)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = miette::LabeledSpan> + '_>> {
        let label =
            miette::LabeledSpan::new(Some("here".to_owned()), self.span.start, self.span.len());
        Some(Box::new(std::iter::once(label)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "a = 1\n[table]\nb = 2\nc = { d = 3 }\n[[list]]\ne = 4\n";

    #[test]
    fn a_key_is_reported_with_its_table() {
        let key = |needle: &str| key_at(TEXT, TEXT.find(needle).unwrap());
        assert_eq!(key("1").as_deref(), Some("a"));
        assert_eq!(key("2").as_deref(), Some("table.b"));
        assert_eq!(key("3").as_deref(), Some("table.c"));
        assert_eq!(key("[table]").as_deref(), Some("table"));
        assert_eq!(key("4").as_deref(), Some("list.e"));
        assert_eq!(key_at(TEXT, TEXT.len()), None);
    }

    #[test]
    fn lines_and_columns_count_from_one() {
        let place = TEXT.find("= 2").unwrap();
        let error = ScenarioError::at(TEXT, "t", place..place, None, String::new());
        assert_eq!((error.line(), error.column()), (3, 3));
    }
}
