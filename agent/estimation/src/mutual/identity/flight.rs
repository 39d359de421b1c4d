//! A team in flight for the tests of identity: places and headings in closed form, inertial integrals without an error,
//! directions with as much noise as is asked for.

use super::Tracker;
use crate::mutual::direction::{difference, moved};
use crate::mutual::feature_set::{Feature, FeatureSet, Inertial};
use crate::mutual::located::Reduced;
use crate::time::Stamp;
use crate::vehicle_id::VehicleId;
use nalgebra::{Rotation3, UnitVector3, Vector2, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub(super) const PERIOD_S: f64 = 0.05;

/// Robots that sway about places of their own and turn.
pub(super) struct Flight {
    centres_m: Vec<Vector3<f64>>,
    trackers: Vec<Tracker>,
    rng: ChaCha8Rng,
    /// Of each direction, per axis (rad).
    pub(super) sigma_rad: f64,
    /// Robots that are seen but do not talk come last.
    pub(super) talking: usize,
    /// `(observer, target)` that do not see each other.
    pub(super) hidden: Vec<(usize, usize)>,
}

impl Flight {
    pub(super) fn new(
        centres_m: &[[f64; 3]],
        talking: usize,
        sigma_rad: f64,
        rng: ChaCha8Rng,
    ) -> Self {
        Self {
            centres_m: centres_m
                .iter()
                .map(|centre| Vector3::from(*centre))
                .collect(),
            trackers: vec![Tracker::new(); centres_m.len()],
            rng,
            sigma_rad,
            talking,
            hidden: Vec::new(),
        }
    }

    pub(super) fn vehicle(robot: usize) -> VehicleId {
        VehicleId(100 + robot as u64)
    }

    fn phase(robot: usize, axis: usize) -> (f64, f64) {
        (
            0.7 + 0.17 * ((3 * robot + 2 * axis) % 5) as f64,
            1.3 * robot as f64 + 2.1 * axis as f64,
        )
    }

    pub(super) fn position_m(&self, robot: usize, t_s: f64) -> Vector3<f64> {
        let sway = |axis: usize| {
            let (rate, phase) = Self::phase(robot, axis);
            [1.1, 0.9, 0.6][axis] * (rate * t_s + phase).sin()
        };
        self.centres_m[robot] + Vector3::new(sway(0), sway(1), sway(2))
    }

    pub(super) fn velocity_m_s(robot: usize, t_s: f64) -> Vector3<f64> {
        let sway = |axis: usize| {
            let (rate, phase) = Self::phase(robot, axis);
            [1.1, 0.9, 0.6][axis] * rate * (rate * t_s + phase).cos()
        };
        Vector3::new(sway(0), sway(1), sway(2))
    }

    pub(super) fn yaw_rad(robot: usize, t_s: f64) -> f64 {
        0.9 * (robot * robot) as f64 + 0.6 * (0.4 * t_s + robot as f64).sin()
    }

    /// Where one robot is for another.
    pub(super) fn relative(&self, observer: usize, target: usize, t_s: f64) -> Reduced {
        let level = about_vertical(-Self::yaw_rad(observer, t_s));
        Reduced {
            position_m: level * (self.position_m(target, t_s) - self.position_m(observer, t_s)),
            velocity_m_s: level
                * (Self::velocity_m_s(target, t_s) - Self::velocity_m_s(observer, t_s)),
            yaw_rad: Self::yaw_rad(target, t_s) - Self::yaw_rad(observer, t_s),
        }
    }

    /// The integrals of a robot that was booted at 0 s.
    pub(super) fn inertial(&self, robot: usize, t_s: f64) -> Inertial {
        let gyro_from_world = about_vertical(-Self::yaw_rad(robot, 0.0));
        let start = Self::velocity_m_s(robot, 0.0);
        Inertial {
            elapsed_s: t_s,
            yaw_rad: Self::yaw_rad(robot, t_s) - Self::yaw_rad(robot, 0.0),
            velocity_m_s: gyro_from_world * (Self::velocity_m_s(robot, t_s) - start),
            position_m: gyro_from_world
                * (self.position_m(robot, t_s) - self.position_m(robot, 0.0) - start * t_s),
        }
    }

    /// What a robot tells at an instant; features are in the order of the robots.
    pub(super) fn set(&mut self, robot: usize, t_s: f64) -> FeatureSet {
        let inertial = self.inertial(robot, t_s);
        let mut features = Vec::new();
        for target in 0..self.centres_m.len() {
            if target == robot || self.hidden.contains(&(robot, target)) {
                continue;
            }
            let there = UnitVector3::new_normalize(self.relative(robot, target, t_s).position_m);
            let mut noise = || -> f64 {
                let normal: f64 = StandardNormal.sample(&mut self.rng);
                self.sigma_rad * normal
            };
            let noise = Vector2::new(noise(), noise());
            features.push(Feature {
                direction: moved(&there, &noise),
                sigma_rad: self.sigma_rad.max(0.01),
                track: None,
            });
        }
        let taken = stamp(t_s);
        let tracks = self.trackers[robot].scan(taken, inertial.yaw_rad, &mut features);
        FeatureSet {
            taken,
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rate_rad_s: 0.0,
            acceleration_m_s2: Vector3::zeros(),
            inertial,
            features,
            tracks,
        }
    }
}

pub(super) fn stamp(t_s: f64) -> Stamp {
    Stamp::from_nanos((t_s * 1e9).round() as i64)
}

pub(super) fn about_vertical(yaw_rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad)
}

/// Angle between where a neighbour is held to be and where it is (rad).
pub(super) fn bearing_error_rad(held: &Reduced, truth: &Reduced) -> f64 {
    difference(
        &UnitVector3::new_normalize(held.position_m),
        &UnitVector3::new_normalize(truth.position_m),
    )
    .norm()
}
