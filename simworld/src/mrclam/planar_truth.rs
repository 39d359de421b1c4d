//! A robot's true path in the plane, between the recorded rows as well, but never across a gap.

use crate::truth::{Pose, pose_from_euler, wrapped_rad};
use nalgebra::Vector3;

/// One recorded true pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthRow {
    /// Nanoseconds since 1970.
    pub time_ns: i64,
    /// East, metres.
    pub x_m: f64,
    /// North, metres.
    pub y_m: f64,
    /// Heading, radians counter-clockwise from east.
    pub heading_rad: f64,
}

/// At least one row, in the order of time.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarTruth {
    rows: Vec<TruthRow>,
}

impl PlanarTruth {
    /// The path through these rows, which must be in the order of time; none without rows.
    #[must_use]
    pub fn new(rows: Vec<TruthRow>) -> Option<Self> {
        assert!(
            rows.is_sorted_by(|a, b| a.time_ns < b.time_ns),
            "true poses are in the order of time"
        );
        (!rows.is_empty()).then_some(Self { rows })
    }

    /// The recorded rows.
    #[must_use]
    pub fn rows(&self) -> &[TruthRow] {
        &self.rows
    }

    /// The first row's time, nanoseconds since 1970.
    #[must_use]
    pub fn start_ns(&self) -> i64 {
        self.rows[0].time_ns
    }

    /// The last row's time, nanoseconds since 1970.
    #[must_use]
    pub fn end_ns(&self) -> i64 {
        self.rows[self.rows.len() - 1].time_ns
    }

    /// The true `world_from_body` at this time, interpolated; none before the first row, after the last, or between
    /// two rows that are more than `gap_ns_max` apart.
    #[must_use]
    pub fn pose_at(&self, time_ns: i64, gap_ns_max: i64) -> Option<Pose> {
        let next = self.rows.partition_point(|row| row.time_ns < time_ns);
        let to = self.rows.get(next)?;
        if to.time_ns == time_ns {
            return Some(planar(to.x_m, to.y_m, to.heading_rad));
        }
        let from = &self.rows[next.checked_sub(1)?];
        let leg_ns = to.time_ns - from.time_ns;
        if leg_ns > gap_ns_max {
            return None;
        }
        let share = (time_ns - from.time_ns) as f64 / leg_ns as f64;
        let between = |from: f64, to: f64| from + share * (to - from);
        let turn_rad = wrapped_rad(to.heading_rad - from.heading_rad);
        Some(planar(
            between(from.x_m, to.x_m),
            between(from.y_m, to.y_m),
            from.heading_rad + share * turn_rad,
        ))
    }
}

fn planar(x_m: f64, y_m: f64, heading_rad: f64) -> Pose {
    pose_from_euler(Vector3::new(x_m, y_m, 0.0), heading_rad, 0.0, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::yaw_rad;

    fn truth() -> PlanarTruth {
        let row = |time_ns, x_m, heading_rad| TruthRow {
            time_ns,
            x_m,
            y_m: 1.0,
            heading_rad,
        };
        PlanarTruth::new(vec![
            row(100, 0.0, 3.1),
            row(200, 2.0, -3.1),
            row(1200, 4.0, 0.0),
        ])
        .unwrap()
    }

    #[test]
    fn between_two_rows_the_pose_is_interpolated_and_the_heading_turns_the_shorter_way() {
        let pose = truth().pose_at(150, 100).unwrap();
        assert!((pose.translation.x - 1.0).abs() < 1e-12);
        assert!((yaw_rad(&pose).abs() - std::f64::consts::PI).abs() < 1e-9);
    }

    #[test]
    fn there_is_no_truth_outside_the_rows_or_in_a_gap() {
        let truth = truth();
        for (time_ns, known) in [
            (99, false),
            (100, true),
            (200, true),
            (201, false),
            (1200, true),
            (1201, false),
        ] {
            assert_eq!(truth.pose_at(time_ns, 100).is_some(), known, "{time_ns}");
        }
        assert!(truth.pose_at(700, 1000).is_some() && truth.pose_at(700, 999).is_none());
    }
}
