//! Plays frames at their times on the process's clock: from a recording in JSON lines, or from memory.
//!
//! One line is `{"arrival_ns": .., "sensor": "..", "frame": {..}}`, the frame as in the JSON form of
//! [`skein_proto::frame`]; arrivals do not go back. Only one line is read ahead.

use super::{Driver, DriverError, FrameSender, Surroundings};
use crate::settings::TimedFrame;
use serde::{Deserialize, Serialize};
use skein_estimation::time::Stamp;
use skein_proto::frame::Frame;
use skein_proto::limits::FRAME_BYTES_MAX;
use skein_proto::name::Name;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest line of a recording.
const LINE_BYTES_MAX: usize = 2 * FRAME_BYTES_MAX;

/// One line of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// When the frame reached the vehicle, in nanoseconds of its clock.
    pub arrival_ns: i64,
    /// From which sensor.
    pub sensor: Name,
    /// The frame.
    pub frame: Frame,
}

/// Why a recording cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("{path}: {error}")]
    File {
        /// The recording.
        path: String,
        /// What the system says.
        error: std::io::Error,
    },
    /// A line that is no line of a recording.
    #[error("{path}, line {line}: {reason}")]
    Line {
        /// The recording.
        path: String,
        /// Counted from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
}

/// The lines of a recording, checked one by one.
struct Lines {
    path: PathBuf,
    reader: BufReader<File>,
    number: usize,
    previous: i64,
}

impl Lines {
    fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = File::open(path).map_err(|error| RecordingError::File {
            path: path.display().to_string(),
            error,
        })?;
        Ok(Self {
            path: path.to_owned(),
            reader: BufReader::new(file),
            number: 0,
            previous: i64::MIN,
        })
    }

    fn wrong(&self, reason: impl Into<String>) -> RecordingError {
        RecordingError::Line {
            path: self.path.display().to_string(),
            line: self.number,
            reason: reason.into(),
        }
    }

    fn next_line(&mut self) -> Result<Option<Line>, RecordingError> {
        loop {
            let mut text = Vec::new();
            let read = self
                .reader
                .by_ref()
                .take(LINE_BYTES_MAX as u64 + 1)
                .read_until(b'\n', &mut text)
                .map_err(|error| RecordingError::File {
                    path: self.path.display().to_string(),
                    error,
                })?;
            if read == 0 {
                return Ok(None);
            }
            self.number += 1;
            if text.len() > LINE_BYTES_MAX {
                return Err(self.wrong(format!("longer than {LINE_BYTES_MAX} bytes")));
            }
            if text.trim_ascii().is_empty() {
                continue;
            }
            let line: Line =
                serde_json::from_slice(&text).map_err(|error| self.wrong(error.to_string()))?;
            line.frame
                .check()
                .map_err(|error| self.wrong(error.to_string()))?;
            if line.arrival_ns < self.previous {
                return Err(self.wrong("arrival_ns is before the line above"));
            }
            self.previous = line.arrival_ns;
            return Ok(Some(line));
        }
    }
}

/// When the first frame of a recording arrives; none in an empty one. Fails when the first line is malformed.
pub fn first_arrival(path: &Path) -> Result<Option<Stamp>, RecordingError> {
    let line = Lines::open(path)?.next_line()?;
    Ok(line.map(|line| Stamp::from_nanos(line.arrival_ns)))
}

/// Reads a whole recording and counts the frames of one sensor. Fails at the first line that is wrong, with its number.
pub fn check(path: &Path, sensor: Name) -> Result<usize, RecordingError> {
    let mut lines = Lines::open(path)?;
    let mut frames = 0;
    while let Some(line) = lines.next_line()? {
        frames += usize::from(line.sensor == sensor);
    }
    Ok(frames)
}

/// Plays one sensor's lines of a recording.
pub struct RecordingDriver {
    /// The recording.
    pub path: PathBuf,
}

impl Driver for RecordingDriver {
    fn run(
        self: Box<Self>,
        frames: &FrameSender,
        surroundings: &Surroundings,
    ) -> Result<(), DriverError> {
        let mut lines = Lines::open(&self.path)?;
        while let Some(line) = lines.next_line()? {
            if line.sensor != frames.sensor() {
                continue;
            }
            if !surroundings.wait_until(Stamp::from_nanos(line.arrival_ns)) {
                return Ok(());
            }
            frames.send(&line.frame);
        }
        tracing::info!(sensor = %frames.sensor(), recording = %self.path.display(), "the recording has ended");
        Ok(())
    }
}

/// Plays frames from memory.
pub struct FramesDriver {
    /// In the order of their arrivals.
    pub frames: Arc<[TimedFrame]>,
}

impl Driver for FramesDriver {
    fn run(
        self: Box<Self>,
        frames: &FrameSender,
        surroundings: &Surroundings,
    ) -> Result<(), DriverError> {
        for timed in self.frames.iter() {
            if !surroundings.wait_until(timed.arrival) {
                return Ok(());
            }
            frames.send(&timed.frame);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"arrival_ns":5,"sensor":"tags","frame":{"relative":{"taken_ns":1,"target":"v2","value":{"distance":{"distance_m":2.0,"sigma_m":0.1}}}}}"#;

    fn recording(name: &str, text: &str) -> PathBuf {
        let path =
            std::env::temp_dir().join(format!("skein-replay-{}-{name}.jsonl", std::process::id()));
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn frames_of_other_sensors_are_not_counted() {
        let path = recording(
            "count",
            &format!("{GOOD}\n\n{}\n", GOOD.replace("tags", "uwb")),
        );
        assert_eq!(check(&path, Name::parse("tags").unwrap()).unwrap(), 1);
        assert_eq!(first_arrival(&path).unwrap(), Some(Stamp::from_nanos(5)));
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn a_wrong_line_is_refused_with_its_number() {
        let earlier = GOOD.replace("\"arrival_ns\":5", "\"arrival_ns\":4");
        let negative = GOOD.replace("2.0", "-2.0");
        let long = format!("{GOOD}{}", " ".repeat(LINE_BYTES_MAX));
        for (case, second, expected) in [
            ("json", "{\"arrival_ns\":6}", "missing field"),
            ("time", &earlier, "before the line above"),
            ("range", &negative, "distance_m is out of range"),
            ("long", &long, "longer than"),
        ] {
            let path = recording(case, &format!("{GOOD}\n{second}\n"));
            let error = check(&path, Name::parse("tags").unwrap())
                .unwrap_err()
                .to_string();
            assert!(
                error.contains("line 2") && error.contains(expected),
                "{error}"
            );
            std::fs::remove_file(path).unwrap();
        }
    }
}
