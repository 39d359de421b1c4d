//! A recording of the UTIAS MR.CLAM collection (Leung et al. 2011): five real robots in the plane with commanded
//! velocities, range and bearing by camera, and true poses by motion capture. Parsed as it is; what it means for an
//! estimator is the calibration's matter.

mod lines;
mod planar_truth;

pub use planar_truth::{PlanarTruth, TruthRow};

use lines::Lines;
use std::collections::BTreeMap;
use std::io;

/// How many robots a recording has; they are the subjects 1 to 5.
pub const ROBOTS: usize = 5;

/// The most rows of one file.
pub const ROWS_MAX: usize = 1_000_000;

/// A commanded velocity, which holds until the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// When it was given, nanoseconds since 1970.
    pub time_ns: i64,
    /// Forward velocity, metres per second.
    pub forward_mps: f64,
    /// Angular velocity, radians per second, counter-clockwise.
    pub turn_radps: f64,
}

/// Whom a barcode stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// A robot, by its index from 0 (subject 1 is index 0).
    Robot(usize),
    /// A landmark, by its subject number.
    Landmark(u32),
}

/// One reading of the camera: a subject's range and bearing. Several readings of one image share a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeBearing {
    /// The image's time stamp, nanoseconds since 1970.
    pub time_ns: i64,
    /// Whom it shows.
    pub subject: Subject,
    /// The range, metres.
    pub range_m: f64,
    /// The bearing in the body frame, radians counter-clockwise from the heading.
    pub bearing_rad: f64,
}

/// What one robot recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotRecord {
    /// Its commands, in the order of time; at least one.
    pub commands: Vec<Command>,
    /// Its camera's readings, in the order of time.
    pub readings: Vec<RangeBearing>,
    /// Readings of a barcode that belongs to nobody, or to itself: the camera misread it.
    pub n_misreads: usize,
    /// Where it really was.
    pub truth: PlanarTruth,
}

/// A landmark's true place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landmark {
    /// Its subject number.
    pub subject: u32,
    /// East, metres.
    pub x_m: f64,
    /// North, metres.
    pub y_m: f64,
}

/// A whole recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The robots, index 0 being subject 1.
    pub robots: Vec<RobotRecord>,
    /// The landmarks.
    pub landmarks: Vec<Landmark>,
}

/// Why a folder is no recording: the file, and what is wrong with it.
#[derive(Debug, thiserror::Error)]
pub enum MrclamError {
    /// A file could not be read.
    #[error("{file}: {error}")]
    Unreadable {
        /// The file's name.
        file: String,
        /// Why.
        error: io::Error,
    },
    /// A line is wrong.
    #[error("{file}:{line}: {reason}")]
    Line {
        /// The file's name.
        file: String,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// A file that needs rows has none.
    #[error("{file}: there is no row in it")]
    Empty {
        /// The file's name.
        file: String,
    },
}

impl Recording {
    /// Parses a recording; `read` gives the text of the file with a name. Fails with the file and the line.
    pub fn parse(mut read: impl FnMut(&str) -> io::Result<String>) -> Result<Self, MrclamError> {
        let mut text = |file: &str| {
            read(file).map_err(|error| MrclamError::Unreadable {
                file: file.to_owned(),
                error,
            })
        };
        let barcodes = parse_barcodes(&text("Barcodes.dat")?)?;
        let landmarks = parse_landmarks(&text("Landmark_Groundtruth.dat")?)?;
        let robots = (0..ROBOTS)
            .map(|index| {
                let mut of = |what: &str| {
                    let file = format!("Robot{}_{what}.dat", index + 1);
                    text(&file).map(|text| (text, file))
                };
                let (text, file) = of("Odometry")?;
                let commands = parse_commands(&text, &file)?;
                let (text, file) = of("Measurement")?;
                let (readings, n_misreads) = parse_readings(&text, &file, &barcodes, index)?;
                let (text, file) = of("Groundtruth")?;
                let truth = parse_truth(&text, &file)?;
                Ok(RobotRecord {
                    commands,
                    readings,
                    n_misreads,
                    truth,
                })
            })
            .collect::<Result<_, MrclamError>>()?;
        Ok(Self { robots, landmarks })
    }

    /// The earliest time of any robot's truth, nanoseconds since 1970: the recording's zero.
    #[must_use]
    pub fn start_ns(&self) -> i64 {
        self.robots
            .iter()
            .map(|robot| robot.truth.start_ns())
            .min()
            .expect("a recording has robots")
    }

    /// The latest time of any robot's truth, nanoseconds since 1970.
    #[must_use]
    pub fn end_ns(&self) -> i64 {
        self.robots
            .iter()
            .map(|robot| robot.truth.end_ns())
            .max()
            .expect("a recording has robots")
    }
}

/// Barcode to subject.
fn parse_barcodes(text: &str) -> Result<BTreeMap<u32, Subject>, MrclamError> {
    let mut barcodes = BTreeMap::new();
    for row in Lines::new(text, "Barcodes.dat") {
        let row = row?;
        let [subject, barcode] = row.columns()?;
        let subject = row.count(subject)?;
        let known = match subject {
            0 => return Err(row.wrong("subjects count from 1")),
            1..=5 => Subject::Robot(subject as usize - 1),
            _ => Subject::Landmark(subject),
        };
        if barcodes.insert(row.count(barcode)?, known).is_some() {
            return Err(row.wrong(&format!("the barcode {barcode} belongs to two subjects")));
        }
    }
    Ok(barcodes)
}

fn parse_landmarks(text: &str) -> Result<Vec<Landmark>, MrclamError> {
    Lines::new(text, "Landmark_Groundtruth.dat")
        .map(|row| {
            let row = row?;
            let [subject, x, y, _x_std, _y_std] = row.columns()?;
            Ok(Landmark {
                subject: row.count(subject)?,
                x_m: row.number(x)?,
                y_m: row.number(y)?,
            })
        })
        .collect()
}

fn parse_commands(text: &str, file: &str) -> Result<Vec<Command>, MrclamError> {
    let mut commands: Vec<Command> = Vec::new();
    for row in Lines::new(text, file) {
        let row = row?;
        let [time, forward, turn] = row.columns()?;
        let time_ns = row.nanoseconds(time)?;
        // Two rows of one time do occur; the later one holds.
        if commands
            .last()
            .is_some_and(|previous| time_ns < previous.time_ns)
        {
            return Err(row.wrong("the time is earlier than the one before"));
        }
        commands.push(Command {
            time_ns,
            forward_mps: row.number(forward)?,
            turn_radps: row.number(turn)?,
        });
    }
    if commands.is_empty() {
        Err(MrclamError::Empty {
            file: file.to_owned(),
        })
    } else {
        Ok(commands)
    }
}

fn parse_readings(
    text: &str,
    file: &str,
    barcodes: &BTreeMap<u32, Subject>,
    observer: usize,
) -> Result<(Vec<RangeBearing>, usize), MrclamError> {
    let mut readings: Vec<RangeBearing> = Vec::new();
    let mut n_misreads = 0;
    let mut previous_ns = i64::MIN;
    for row in Lines::new(text, file) {
        let row = row?;
        let [time, barcode, range, bearing] = row.columns()?;
        let time_ns = row.nanoseconds(time)?;
        if time_ns < previous_ns {
            return Err(row.wrong("the time is earlier than the one before"));
        }
        previous_ns = time_ns;
        let (range_m, bearing_rad) = (row.number(range)?, row.number(bearing)?);
        if range_m < 0.0 {
            return Err(row.wrong("the range is negative"));
        }
        match barcodes.get(&row.count(barcode)?) {
            Some(subject) if *subject != Subject::Robot(observer) => {
                readings.push(RangeBearing {
                    time_ns,
                    subject: *subject,
                    range_m,
                    bearing_rad,
                });
            }
            _ => n_misreads += 1,
        }
    }
    Ok((readings, n_misreads))
}

fn parse_truth(text: &str, file: &str) -> Result<PlanarTruth, MrclamError> {
    let mut rows: Vec<TruthRow> = Vec::new();
    for row in Lines::new(text, file) {
        let row = row?;
        let [time, x, y, heading] = row.columns()?;
        let time_ns = row.nanoseconds(time)?;
        if rows
            .last()
            .is_some_and(|previous| time_ns <= previous.time_ns)
        {
            return Err(row.wrong("the time is not later than the one before"));
        }
        rows.push(TruthRow {
            time_ns,
            x_m: row.number(x)?,
            y_m: row.number(y)?,
            heading_rad: row.number(heading)?,
        });
    }
    PlanarTruth::new(rows).ok_or_else(|| MrclamError::Empty {
        file: file.to_owned(),
    })
}

#[cfg(test)]
mod tests;
