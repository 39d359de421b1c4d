//! Reader of PyFG factor graphs: odometry, distances and truth of real robots as text, one record a line. A line that
//! cannot be right is an error that names it.
//!
//! ```text
//! VERTEX_SE2       time key x y theta                         the truth
//! VERTEX_SE3:QUAT  time key x y z qx qy qz qw
//! VERTEX_XY        key x y                                    a landmark; VERTEX_XYZ key x y z
//! EDGE_SE2         time from to dx dy dtheta  covariance (6, upper triangle)
//! EDGE_SE3:QUAT    time from to dx dy dz qx qy qz qw  covariance (21)
//! EDGE_RANGE       time from to range variance
//! ```

use crate::truth::Pose;
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

/// Lines that are read at most.
pub const LINES_MAX: usize = 2_000_000;

/// Farther than this (m) nothing is.
const FAR_M: f64 = 1e6;

/// A robot (or L, a landmark) and which of its poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    /// The letter of the robot.
    pub robot: char,
    /// Which of its poses.
    pub index: u32,
}

/// Where a robot truly was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// Seconds since the graph's first vertex.
    pub time_s: f64,
    /// `world_from_body`.
    pub pose: Pose,
}

/// What odometry says of a robot between two of its poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryEdge {
    /// The earlier pose.
    pub from: Key,
    /// The later pose.
    pub to: Key,
    /// `earlier_from_later`.
    pub motion: Pose,
    /// Mean of the variances of the translation's axes (m^2).
    pub translation_variance_m2: f64,
    /// Variance of the rotation about z (rad^2).
    pub rotation_variance_rad2: f64,
}

/// A measured distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeEdge {
    /// Seconds since the graph's first vertex.
    pub time_s: f64,
    /// One end.
    pub from: Key,
    /// The other: another robot, or a landmark.
    pub to: Key,
    /// Metres.
    pub range_m: f64,
    /// Its variance (m^2).
    pub variance_m2: f64,
}

/// Everything in a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FactorGraph {
    /// True poses.
    pub vertices: BTreeMap<Key, Vertex>,
    /// Landmarks, in the world (m).
    pub landmarks: BTreeMap<Key, Vector3<f64>>,
    /// Odometry, in the order of the file.
    pub odometry: Vec<OdometryEdge>,
    /// Distances, in the order of the file.
    pub ranges: Vec<RangeEdge>,
    /// Some pose is spatial.
    pub is_spatial: bool,
}

/// Why a file is no factor graph.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PyfgError {
    /// A line is wrong.
    #[error("line {line}: {reason}")]
    Line {
        /// Which, from one.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// There is nothing in it.
    #[error("there is no vertex in it")]
    Empty,
}

impl FactorGraph {
    /// Reads a whole file.
    ///
    /// # Errors
    /// With the first line that is wrong, or when there is nothing.
    pub fn parse(text: &str) -> Result<Self, PyfgError> {
        let mut graph = Self::default();
        let mut start_s = None;
        for (index, line) in text.lines().enumerate() {
            let line_number = index + 1;
            let wrong = |reason: String| PyfgError::Line {
                line: line_number,
                reason,
            };
            if index >= LINES_MAX {
                return Err(wrong(format!("more than {LINES_MAX} lines")));
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            if words.is_empty() || words[0].starts_with('#') {
                continue;
            }
            graph.take(&words, &mut start_s).map_err(wrong)?;
        }
        if graph.vertices.is_empty() {
            return Err(PyfgError::Empty);
        }
        graph.check(text)?;
        Ok(graph)
    }

    /// The letters of all robots.
    #[must_use]
    pub fn robots(&self) -> Vec<char> {
        let mut robots: Vec<char> = self.vertices.keys().map(|key| key.robot).collect();
        robots.dedup();
        robots
    }

    fn take(&mut self, words: &[&str], start_s: &mut Option<f64>) -> Result<(), String> {
        match words[0] {
            "VERTEX_SE2" => {
                let [time, key, x, y, theta] = columns(words)?;
                let pose = planar(number(x)?, number(y)?, number(theta)?)?;
                self.add_vertex(number(time)?, key, pose, start_s)
            }
            "VERTEX_SE3:QUAT" => {
                let [time, key, rest @ ..] = columns::<9>(words)?;
                self.is_spatial = true;
                self.add_vertex(number(time)?, key, spatial(&rest)?, start_s)
            }
            "VERTEX_XY" => {
                let [key, x, y] = columns(words)?;
                self.add_landmark(key, Vector3::new(number(x)?, number(y)?, 0.0))
            }
            "VERTEX_XYZ" => {
                let [key, x, y, z] = columns(words)?;
                self.add_landmark(key, Vector3::new(number(x)?, number(y)?, number(z)?))
            }
            "EDGE_SE2" => {
                let [time, from, to, dx, dy, dtheta, xx, _, _, yy, _, tt] = columns(words)?;
                number(time)?;
                let motion = planar(number(dx)?, number(dy)?, number(dtheta)?)?;
                let variances = [variance(xx)?, variance(yy)?];
                self.add_odometry(from, to, motion, &variances, variance(tt)?)
            }
            "EDGE_SE3:QUAT" => {
                let all: [&str; 31] = columns(words)?;
                number(all[0])?;
                let motion = spatial(&std::array::from_fn(|index| all[3 + index]))?;
                // The upper triangle of six: its diagonal is at 0, 6, 11, 15, 18 and 20.
                let variances = [variance(all[10])?, variance(all[16])?, variance(all[21])?];
                self.add_odometry(all[1], all[2], motion, &variances, variance(all[30])?)
            }
            "EDGE_RANGE" => {
                let [time, from, to, range, spread] = columns(words)?;
                let (time_s, range_m) = (number(time)?, number(range)?);
                if range_m < 0.0 {
                    return Err(format!("the range {range} is negative"));
                }
                let (from, to) = (from.parse::<Key>()?, to.parse::<Key>()?);
                if from == to {
                    return Err(format!("both ends of the range are {from}"));
                }
                self.ranges.push(RangeEdge {
                    time_s: time_s - start_s.ok_or("a range before the first vertex")?,
                    from,
                    to,
                    range_m: near(range_m)?,
                    variance_m2: variance(spread)?,
                });
                Ok(())
            }
            other => Err(format!("there is no record called `{other}`")),
        }
    }

    fn add_vertex(
        &mut self,
        time_s: f64,
        key: &str,
        pose: Pose,
        start_s: &mut Option<f64>,
    ) -> Result<(), String> {
        let key: Key = key.parse()?;
        let time_s = time_s - *start_s.get_or_insert(time_s);
        let before = self.vertices.insert(key, Vertex { time_s, pose });
        before.map_or(Ok(()), |_| Err(format!("{key} is there twice")))
    }

    fn add_landmark(&mut self, key: &str, at_m: Vector3<f64>) -> Result<(), String> {
        let key: Key = key.parse()?;
        near(at_m.amax())?;
        let before = self.landmarks.insert(key, at_m);
        before.map_or(Ok(()), |_| Err(format!("{key} is there twice")))
    }

    fn add_odometry(
        &mut self,
        from: &str,
        to: &str,
        motion: Pose,
        translation: &[f64],
        rotation_variance_rad2: f64,
    ) -> Result<(), String> {
        let (from, to): (Key, Key) = (from.parse()?, to.parse()?);
        if from.robot != to.robot || from.index.checked_add(1) != Some(to.index) {
            return Err(format!(
                "odometry from {from} to {to} is no step of one robot"
            ));
        }
        self.odometry.push(OdometryEdge {
            from,
            to,
            motion,
            translation_variance_m2: translation.iter().sum::<f64>() / translation.len() as f64,
            rotation_variance_rad2,
        });
        Ok(())
    }

    /// Edges end at what there is. Landmarks may stand after the ranges to them, so this is looked at last.
    fn check(&self, text: &str) -> Result<(), PyfgError> {
        let is_known =
            |key: &Key| self.vertices.contains_key(key) || self.landmarks.contains_key(key);
        let odometry = self.odometry.iter().flat_map(|edge| [edge.from, edge.to]);
        let ranges = self.ranges.iter().flat_map(|edge| [edge.from, edge.to]);
        let Some(missing) = odometry.chain(ranges).find(|key| !is_known(key)) else {
            return Ok(());
        };
        let name = missing.to_string();
        let mentions = |line: &str| line.split_whitespace().any(|word| word == name);
        Err(PyfgError::Line {
            line: text.lines().position(mentions).map_or(0, |index| index + 1),
            reason: format!("there is no vertex {name}"),
        })
    }
}

impl FromStr for Key {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not a letter and a number");
        let mut letters = text.chars();
        let robot = letters.next().filter(char::is_ascii_alphabetic);
        let robot = robot.ok_or_else(wrong)?;
        let digits = letters.as_str();
        if !digits.bytes().all(|byte| byte.is_ascii_digit()) {
            return Err(wrong());
        }
        let index = digits.parse().map_err(|_| wrong())?;
        Ok(Self { robot, index })
    }
}

impl fmt::Display for Key {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}{}", self.robot, self.index)
    }
}

/// The words after the record's name, which must be so many.
fn columns<'a, const N: usize>(words: &[&'a str]) -> Result<[&'a str; N], String> {
    let n_columns = words.len() - 1;
    <[&str; N]>::try_from(&words[1..])
        .map_err(|_| format!("{} needs {N} columns, not {n_columns}", words[0]))
}

fn number(word: &str) -> Result<f64, String> {
    let number = word.parse().ok().filter(|value: &f64| value.is_finite());
    number.ok_or_else(|| format!("`{word}` is not a finite number"))
}

fn variance(word: &str) -> Result<f64, String> {
    let variance = number(word)?;
    if variance > 0.0 {
        Ok(variance)
    } else {
        Err(format!("the variance {word} is not above zero"))
    }
}

fn near(metres: f64) -> Result<f64, String> {
    if metres.abs() <= FAR_M {
        Ok(metres)
    } else {
        Err(format!("{metres} m is too far"))
    }
}

fn planar(x_m: f64, y_m: f64, theta_rad: f64) -> Result<Pose, String> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), theta_rad);
    let translation = Translation3::new(near(x_m)?, near(y_m)?, 0.0);
    Ok(Pose::from_parts(translation, rotation))
}

fn spatial(words: &[&str; 7]) -> Result<Pose, String> {
    let mut numbers = [0.0; 7];
    for (value, word) in numbers.iter_mut().zip(words) {
        *value = number(word)?;
    }
    let [x, y, z, qx, qy, qz, qw] = numbers;
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() > 1e-3 {
        return Err(format!("the quaternion has length {norm}, not one"));
    }
    let translation = Translation3::new(near(x)?, near(y)?, near(z)?);
    Ok(Pose::from_parts(
        translation,
        UnitQuaternion::from_quaternion(quaternion),
    ))
}

#[cfg(test)]
mod tests;
