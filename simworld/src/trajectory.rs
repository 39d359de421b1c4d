//! Where a vehicle flies: the truth pose at every instant, as a formula of time and nothing else. Time is in seconds
//! since the start of the motion; before it, every vehicle stands at its first pose.

mod circle;
mod hover;
mod line;
mod parallel;
mod section_v;
mod waypoints;

pub use circle::Circle;
pub use hover::Hover;
pub use line::Line;
pub use parallel::Parallel;
pub use section_v::SectionV;
pub use waypoints::{BadWaypoints, Waypoint, Waypoints};

use crate::quadrotor::{self, Course};
use crate::truth::Pose;
use serde::{Deserialize, Serialize};

/// A path through the world. In a scenario: `trajectory.circle = { radius_m = 3.0, ... }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Trajectory {
    /// The zig-zag paths of section V of Knuth & Barooah.
    SectionV(SectionV),
    /// Standing in the air, with a sway if asked.
    Hover(Hover),
    /// A straight line at constant speed.
    Line(Line),
    /// A level circle, nose along the path.
    Circle(Circle),
    /// Straight legs between points that are reached at given times.
    Waypoints(Waypoints),
    /// One of two planar robots on straight parallel lines.
    Parallel(Parallel),
    /// A quadrotor, which leans to where it accelerates.
    Quadrotor(Course),
}

impl Trajectory {
    /// The truth pose `world_from_body` at `t_s` seconds after the start of the motion.
    #[must_use]
    pub fn pose_at(&self, t_s: f64) -> Pose {
        let t_s = t_s.max(0.0);
        match self {
            Self::SectionV(path) => path.pose_at(t_s),
            Self::Hover(path) => path.pose_at(t_s),
            Self::Line(path) => path.pose_at(t_s),
            Self::Circle(path) => path.pose_at(t_s),
            Self::Waypoints(path) => path.pose_at(t_s),
            Self::Parallel(path) => path.pose_at(t_s),
            Self::Quadrotor(course) => quadrotor::attitude(&course.place_at(t_s)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_kind() -> Vec<Trajectory> {
        #[derive(Deserialize)]
        struct Document {
            trajectory: Vec<Trajectory>,
        }
        let document: Document = toml::from_str(
            r#"trajectory = [
                { section-v = { robot = 2 } },
                { hover = { position_m = [1, 2, 3], yaw_deg = 30, sway_m = [0.5, 0.2, 0.1], sway_period_s = 7 } },
                { line = { start_m = [0, 0, 1], velocity_mps = [1, 1, 0] } },
                { circle = { centre_m = [0, 0, 2], radius_m = 3, period_s = 20 } },
                { waypoints = [
                    { t_s = 0, position_m = [0, 0, 0] },
                    { t_s = 10, position_m = [5, 0, 1], yaw_deg = 90 },
                ] },
                { parallel = { robot = 2 } },
                { quadrotor.weave = { team = "eight", robot = 3 } },
                { quadrotor.round = { centre_m = [0, 0, 2], radius_m = 1, rate_rad_s = -0.9, phase_rad = 1, wave_m = 0.3 } },
                { quadrotor.legs = [
                    { t_s = 2, position_m = [0, 0, 1] },
                    { t_s = 6, position_m = [3, 0, 2], yaw_deg = 90 },
                ] },
            ]"#,
        )
        .unwrap();
        document.trajectory
    }

    #[test]
    fn before_the_start_every_vehicle_stands_at_its_first_pose() {
        for trajectory in every_kind() {
            assert_eq!(
                trajectory.pose_at(-1.7),
                trajectory.pose_at(0.0),
                "{trajectory:?}"
            );
        }
    }

    #[test]
    fn no_trajectory_jumps() {
        // A wrong wrap or a wrong branch shows as a step; 10 m/s is faster than any path here.
        for trajectory in every_kind() {
            for step in 0..12_000 {
                let t_s = f64::from(step) * 0.005;
                let increment = trajectory
                    .pose_at(t_s)
                    .inv_mul(&trajectory.pose_at(t_s + 0.005));
                assert!(
                    increment.translation.vector.norm() < 0.05,
                    "{trajectory:?} at {t_s}"
                );
                assert!(increment.rotation.angle() < 0.05, "{trajectory:?} at {t_s}");
            }
        }
    }

    #[test]
    fn a_misspelt_setting_is_refused() {
        let error = toml::from_str::<Trajectory>(
            "circle = { centre_m = [0, 0, 2], radius_m = 3, perod_s = 20 }",
        )
        .unwrap_err();
        assert!(error.to_string().contains("perod_s"), "{error}");
    }
}
