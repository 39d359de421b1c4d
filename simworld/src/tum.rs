//! Trajectories as text in the format of TUM's benchmark: `timestamp tx ty tz qx qy qz qw` a line, `#` for comments.

use crate::truth::{self, Pose};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::fmt::Write;

/// The most poses that are read from one text.
pub const POSES_MAX: usize = 5_000_000;

/// A pose and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// Seconds, of whatever clock the file has.
    pub time_s: f64,
    /// `world_from_body`, metres.
    pub pose: Pose,
}

/// Why a text is no trajectory, and in which line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{origin}:{line}: {reason}")]
pub struct TumError {
    /// What the text is called, usually a file's name.
    pub origin: String,
    /// The line, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub reason: TumReason,
}

/// What is wrong with a line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TumReason {
    /// Not eight numbers.
    #[error("eight numbers are needed (timestamp tx ty tz qx qy qz qw), not {0}")]
    Columns(usize),
    /// Something that is no finite number.
    #[error("`{0}` is not a finite number")]
    NotANumber(String),
    /// A quaternion of length near 0.
    #[error("the quaternion is zero")]
    ZeroQuaternion,
    /// A time that is earlier than the one before; equal ones do occur in published files.
    #[error("the time is earlier than the one before")]
    Earlier,
    /// More than `POSES_MAX` poses.
    #[error("more than {POSES_MAX} poses")]
    TooMany,
}

/// Reads a trajectory; `origin` is what an error calls the text.
pub fn parse(text: &str, origin: &str) -> Result<Vec<StampedPose>, TumError> {
    let mut poses: Vec<StampedPose> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let fail = |reason| TumError {
            origin: origin.to_owned(),
            line: index + 1,
            reason,
        };
        let stamped = parse_line(line).map_err(fail)?;
        if poses
            .last()
            .is_some_and(|previous| stamped.time_s < previous.time_s)
        {
            return Err(fail(TumReason::Earlier));
        }
        if poses.len() == POSES_MAX {
            return Err(fail(TumReason::TooMany));
        }
        poses.push(stamped);
    }
    Ok(poses)
}

fn parse_line(line: &str) -> Result<StampedPose, TumReason> {
    let mut numbers = [0.0; 8];
    let n_columns = line.split_whitespace().count();
    if n_columns != numbers.len() {
        return Err(TumReason::Columns(n_columns));
    }
    for (number, word) in numbers.iter_mut().zip(line.split_whitespace()) {
        *number = word
            .parse()
            .ok()
            .filter(|value: &f64| value.is_finite())
            .ok_or_else(|| TumReason::NotANumber(word.to_owned()))?;
    }
    let [time_s, x, y, z, qx, qy, qz, qw] = numbers;
    let rotation = UnitQuaternion::try_new(Quaternion::new(qw, qx, qy, qz), 1e-6)
        .ok_or(TumReason::ZeroQuaternion)?;
    Ok(StampedPose {
        time_s,
        pose: truth::pose(rotation, Vector3::new(x, y, z)),
    })
}

/// Writes a trajectory, one line a pose, with enough digits to read the same numbers back to a nanometre.
#[must_use]
pub fn write(poses: &[StampedPose]) -> String {
    let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
    for StampedPose { time_s, pose } in poses {
        let t = pose.translation.vector;
        let q = pose.rotation.quaternion();
        writeln!(
            text,
            "{time_s:.9} {:.9} {:.9} {:.9} {:.12} {:.12} {:.12} {:.12}",
            t.x, t.y, t.z, q.i, q.j, q.k, q.w
        )
        .expect("writing to a string does not fail");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trajectory_survives_being_written_and_read() {
        let poses: Vec<_> = (0..20)
            .map(|k| StampedPose {
                time_s: 1_305_031_098.665_9 + f64::from(k) * 0.01,
                pose: truth::pose_from_euler(
                    Vector3::new(f64::from(k), 0.1, -2.0),
                    0.3,
                    f64::from(k) * 0.05,
                    -0.2,
                ),
            })
            .collect();
        let again = parse(&write(&poses), "again").unwrap();
        assert_eq!(again.len(), poses.len());
        for (read, written) in again.iter().zip(&poses) {
            assert!((read.time_s - written.time_s).abs() < 1e-6);
            let error = read.pose.inv_mul(&written.pose);
            assert!(error.translation.vector.norm() < 1e-8 && error.rotation.angle() < 1e-8);
        }
    }

    #[test]
    fn the_quaternion_s_scalar_part_comes_last() {
        let poses = parse("0 1 2 3 0 0 0.7071067811865476 0.7071067811865476\n", "t").unwrap();
        assert!((truth::yaw_rad(&poses[0].pose) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(
            poses[0].pose.translation.vector,
            Vector3::new(1.0, 2.0, 3.0)
        );
    }

    #[test]
    fn every_fault_is_told_with_its_line() {
        let good = "# a comment\n\n1 0 0 0 0 0 0 1\n";
        let cases = [
            ("2 0 0 0 0 0 0", TumReason::Columns(7)),
            ("2 0 0 x 0 0 0 1", TumReason::NotANumber("x".into())),
            ("2 0 0 nan 0 0 0 1", TumReason::NotANumber("nan".into())),
            ("2 0 0 0 0 0 0 0", TumReason::ZeroQuaternion),
            ("0.9 0 0 0 0 0 0 1", TumReason::Earlier),
        ];
        for (line, reason) in cases {
            let error = parse(&format!("{good}{line}\n"), "t").unwrap_err();
            assert_eq!(
                error,
                TumError {
                    origin: "t".into(),
                    line: 4,
                    reason
                }
            );
        }
    }
}
