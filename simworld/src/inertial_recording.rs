//! A recording of one inertial sensor with a true vertical beside it, in readings of one kind, whoever recorded it.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// The most rows of one file.
pub const ROWS_MAX: usize = 5_000_000;

/// One reading, and what is true then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialReading {
    /// Seconds since the first.
    pub time_s: f64,
    /// Turn rate in the sensor's frame, radians per second.
    pub rate_rad_s: Vector3<f64>,
    /// Proper acceleration in the sensor's frame, m/s^2.
    pub force_m_s2: Vector3<f64>,
    /// Straight up in the sensor's frame, where the truth is known.
    pub up: Option<Vector3<f64>>,
    /// Whether the recording's rules score it.
    pub is_scored: bool,
}

/// Why a text is no recording: the file, the line and what is wrong with it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}:{line}: {reason}")]
pub struct RecordingError {
    /// What the file is called.
    pub file: String,
    /// The line, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub reason: String,
}

/// One row of comma-separated words, and where it stands.
pub(crate) struct Row<'a> {
    words: Vec<&'a str>,
    file: &'a str,
    line: usize,
}

/// All rows below the heading. Fails when there are more than [`ROWS_MAX`], or one has not so many columns.
pub(crate) fn rows<'a>(
    text: &'a str,
    file: &'a str,
    columns: usize,
) -> impl Iterator<Item = Result<Row<'a>, RecordingError>> {
    let lines = text.lines().enumerate().skip(1).take(ROWS_MAX + 1);
    lines.enumerate().map(move |(index, (line, text))| {
        let row = Row {
            words: text.split(',').map(str::trim).collect(),
            file,
            line: line + 1,
        };
        if index == ROWS_MAX {
            Err(row.wrong(format!("more than {ROWS_MAX} rows")))
        } else if row.words.len() == columns {
            Ok(row)
        } else {
            let n_words = row.words.len();
            Err(row.wrong(format!("{columns} columns are needed, not {n_words}")))
        }
    })
}

impl Row<'_> {
    pub(crate) fn wrong(&self, reason: String) -> RecordingError {
        RecordingError {
            file: self.file.to_owned(),
            line: self.line,
            reason,
        }
    }

    /// A number, which may be none (`nan`).
    pub(crate) fn number_or_nan(&self, column: usize) -> Result<f64, RecordingError> {
        let word = self.words[column];
        let number = word
            .parse()
            .ok()
            .filter(|number: &f64| !number.is_infinite());
        number.ok_or_else(|| self.wrong(format!("`{word}` is not a number")))
    }

    pub(crate) fn number(&self, column: usize) -> Result<f64, RecordingError> {
        let number = self.number_or_nan(column)?;
        if number.is_finite() {
            Ok(number)
        } else {
            Err(self.wrong(format!("column {} is not a number", column + 1)))
        }
    }

    /// Three numbers beginning with this column.
    pub(crate) fn vector(&self, column: usize) -> Result<Vector3<f64>, RecordingError> {
        Ok(Vector3::new(
            self.number(column)?,
            self.number(column + 1)?,
            self.number(column + 2)?,
        ))
    }

    /// Straight up in the body, of four numbers beginning with this column: w, x, y, z of the turn from the body to a
    /// frame with its z up. None where they are not all numbers.
    pub(crate) fn up_in_body(&self, column: usize) -> Result<Option<Vector3<f64>>, RecordingError> {
        let mut parts = [0.0; 4];
        for (offset, part) in parts.iter_mut().enumerate() {
            *part = self.number_or_nan(column + offset)?;
        }
        let [w, x, y, z] = parts;
        if !parts.iter().all(|part| part.is_finite()) {
            return Ok(None);
        }
        UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-3)
            .map(|world_from_body| Some(world_from_body.inverse() * Vector3::z()))
            .ok_or_else(|| self.wrong("the quaternion is zero".to_owned()))
    }

    /// Nanoseconds.
    pub(crate) fn nanoseconds(&self, column: usize) -> Result<i64, RecordingError> {
        let word = self.words[column];
        let parsed = word.parse();
        parsed.map_err(|_| self.wrong(format!("`{word}` is not a time in nanoseconds")))
    }
}
