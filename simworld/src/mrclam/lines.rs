//! The rows of one of the recording's text files, with the line that an error names.

use super::{MrclamError, ROWS_MAX};
use std::str::Lines as TextLines;

/// All rows of a text: comments and empty lines are passed over, and there are at most `ROWS_MAX`.
pub(super) struct Lines<'a> {
    lines: std::iter::Enumerate<TextLines<'a>>,
    file: &'a str,
    n_rows: usize,
}

impl<'a> Lines<'a> {
    pub(super) fn new(text: &'a str, file: &'a str) -> Self {
        Self {
            lines: text.lines().enumerate(),
            file,
            n_rows: 0,
        }
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Result<Row<'a>, MrclamError>;

    fn next(&mut self) -> Option<Self::Item> {
        let has_content = |line: &str| !line.is_empty() && !line.starts_with('#');
        let (index, text) = self
            .lines
            .by_ref()
            .map(|(index, line)| (index, line.trim()))
            .find(|(_, line)| has_content(line))?;
        let row = Row {
            text,
            file: self.file,
            line: index + 1,
        };
        self.n_rows += 1;
        if self.n_rows > ROWS_MAX {
            // The first row too many is an error, and the end.
            self.lines = "".lines().enumerate();
            return Some(Err(row.wrong(&format!("more than {ROWS_MAX} rows"))));
        }
        Some(Ok(row))
    }
}

/// One row.
pub(super) struct Row<'a> {
    text: &'a str,
    file: &'a str,
    line: usize,
}

impl<'a> Row<'a> {
    pub(super) fn wrong(&self, reason: &str) -> MrclamError {
        MrclamError::Line {
            file: self.file.to_owned(),
            line: self.line,
            reason: reason.to_owned(),
        }
    }

    /// Exactly N words.
    pub(super) fn columns<const N: usize>(&self) -> Result<[&'a str; N], MrclamError> {
        let n_columns = self.text.split_whitespace().count();
        let mut words = self.text.split_whitespace();
        if n_columns != N {
            return Err(self.wrong(&format!("{N} columns are needed, not {n_columns}")));
        }
        Ok(std::array::from_fn(|_| {
            words.next().expect("the words were counted")
        }))
    }

    pub(super) fn number(&self, word: &str) -> Result<f64, MrclamError> {
        let number = word.parse().ok().filter(|value: &f64| value.is_finite());
        number.ok_or_else(|| self.wrong(&format!("`{word}` is not a finite number")))
    }

    pub(super) fn count(&self, word: &str) -> Result<u32, MrclamError> {
        word.parse()
            .map_err(|_| self.wrong(&format!("`{word}` is not a whole number")))
    }

    /// A time in seconds, read digit by digit: a double would lose a quarter of a microsecond.
    pub(super) fn nanoseconds(&self, word: &str) -> Result<i64, MrclamError> {
        let wrong = || self.wrong(&format!("`{word}` is not a time in seconds"));
        let (whole, fraction) = word.split_once('.').unwrap_or((word, "0"));
        let digits =
            |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        if !digits(whole) || !digits(fraction) || fraction.len() > 9 {
            return Err(wrong());
        }
        let seconds: i64 = whole.parse().map_err(|_| wrong())?;
        let nanoseconds: i64 = format!("{fraction:0<9}").parse().map_err(|_| wrong())?;
        seconds
            .checked_mul(1_000_000_000)
            .and_then(|ns| ns.checked_add(nanoseconds))
            .ok_or_else(wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(text: &str) -> Row<'_> {
        Row {
            text,
            file: "f",
            line: 3,
        }
    }

    #[test]
    fn a_time_keeps_every_digit() {
        let time = |word| row("").nanoseconds(word).ok();
        assert_eq!(time("1248444175.103"), Some(1_248_444_175_103_000_000));
        assert_eq!(time("0.000000001"), Some(1));
        assert_eq!(time("7"), Some(7_000_000_000));
        for bad in [
            "",
            ".",
            "1.",
            ".5",
            "-1.0",
            "1e3",
            "1.0000000001",
            "99999999999.0",
            "nan",
        ] {
            assert_eq!(time(bad), None, "{bad}");
        }
    }

    #[test]
    fn comments_and_empty_lines_are_passed_over_but_counted() {
        let rows: Vec<_> = Lines::new("# one\n\n  # three\n 4 5 \n", "f")
            .map(Result::unwrap)
            .collect();
        assert_eq!(rows.len(), 1);
        let error = rows[0].columns::<3>().unwrap_err();
        assert_eq!(error.to_string(), "f:4: 3 columns are needed, not 2");
    }

    #[test]
    fn a_file_may_have_the_largest_number_of_rows_and_not_one_more() {
        let text = "1\n".repeat(ROWS_MAX);
        assert!(Lines::new(&text, "f").all(|row| row.is_ok()));
        let text = text + "1\n1\n";
        assert_eq!(Lines::new(&text, "f").filter(Result::is_err).count(), 1);
        assert_eq!(Lines::new(&text, "f").count(), ROWS_MAX + 1);
    }
}
