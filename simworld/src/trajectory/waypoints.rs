//! Straight legs between points that are reached at given times; after the last one the vehicle stands there.

use crate::truth::{Pose, pose_from_euler, wrapped_rad};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A point, when to be there, and where to look.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Waypoint {
    /// When to be there, seconds since the start of the motion.
    pub t_s: f64,
    /// Where, world frame, metres.
    pub position_m: [f64; 3],
    /// The heading there, degrees counter-clockwise from east; in between it turns the shorter way.
    #[serde(default)]
    pub yaw_deg: f64,
}

/// At least one point, in the order of their times.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Waypoint>", into = "Vec<Waypoint>")]
pub struct Waypoints(Vec<Waypoint>);

/// Why a list of waypoints is no trajectory.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BadWaypoints {
    /// No waypoint at all.
    #[error("waypoints need at least one point")]
    Empty,
    /// A time that is not finite or not later than the one before.
    #[error("waypoint {index} (from 0) has t_s = {t_s}, which is not later than the one before it")]
    NotLater {
        /// Which one, from 0.
        index: usize,
        /// Its time, seconds.
        t_s: f64,
    },
}

impl TryFrom<Vec<Waypoint>> for Waypoints {
    type Error = BadWaypoints;

    fn try_from(points: Vec<Waypoint>) -> Result<Self, BadWaypoints> {
        let mut previous_s = f64::NEG_INFINITY;
        for (index, point) in points.iter().enumerate() {
            if !point.t_s.is_finite() || point.t_s <= previous_s {
                return Err(BadWaypoints::NotLater {
                    index,
                    t_s: point.t_s,
                });
            }
            previous_s = point.t_s;
        }
        if points.is_empty() {
            Err(BadWaypoints::Empty)
        } else {
            Ok(Self(points))
        }
    }
}

impl From<Waypoints> for Vec<Waypoint> {
    fn from(waypoints: Waypoints) -> Self {
        waypoints.0
    }
}

impl Waypoints {
    /// The points, in the order of their times.
    #[must_use]
    pub fn points(&self) -> &[Waypoint] {
        &self.0
    }

    /// The truth pose at `t_s` seconds, not negative.
    pub(super) fn pose_at(&self, t_s: f64) -> Pose {
        let next = self.0.partition_point(|point| point.t_s <= t_s);
        let (from, to) = match (next.checked_sub(1), self.0.get(next)) {
            (Some(last), Some(to)) => (&self.0[last], to),
            (Some(last), None) => (&self.0[last], &self.0[last]),
            (None, _) => (&self.0[0], &self.0[0]),
        };
        let leg_s = to.t_s - from.t_s;
        let share = if leg_s > 0.0 {
            (t_s - from.t_s) / leg_s
        } else {
            0.0
        };
        let position_m = Vector3::from(from.position_m).lerp(&Vector3::from(to.position_m), share);
        let turn_rad = wrapped_rad((to.yaw_deg - from.yaw_deg).to_radians());
        pose_from_euler(
            position_m,
            from.yaw_deg.to_radians() + share * turn_rad,
            0.0,
            0.0,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::yaw_rad;

    fn point(t_s: f64, x: f64, yaw_deg: f64) -> Waypoint {
        Waypoint {
            t_s,
            position_m: [x, 0.0, 0.0],
            yaw_deg,
        }
    }

    #[test]
    fn halfway_in_time_is_halfway_along_the_leg_and_the_turn_goes_the_shorter_way() {
        let path =
            Waypoints::try_from(vec![point(1.0, 0.0, 170.0), point(3.0, 4.0, -170.0)]).unwrap();
        let middle = path.pose_at(2.0);
        assert!((middle.translation.x - 2.0).abs() < 1e-12);
        assert!((yaw_rad(&middle).abs() - 180_f64.to_radians()).abs() < 1e-9);
    }

    #[test]
    fn before_the_first_and_after_the_last_point_the_vehicle_stands() {
        let path = Waypoints::try_from(vec![point(1.0, 0.5, 0.0), point(3.0, 4.0, 0.0)]).unwrap();
        assert!((path.pose_at(0.0).translation.x - 0.5).abs() < 1e-12);
        assert!((path.pose_at(9.0).translation.x - 4.0).abs() < 1e-12);
    }

    #[test]
    fn points_out_of_order_or_missing_are_refused() {
        assert_eq!(Waypoints::try_from(vec![]), Err(BadWaypoints::Empty));
        let twice = Waypoints::try_from(vec![point(1.0, 0.0, 0.0), point(1.0, 1.0, 0.0)]);
        assert_eq!(twice, Err(BadWaypoints::NotLater { index: 1, t_s: 1.0 }));
    }
}
