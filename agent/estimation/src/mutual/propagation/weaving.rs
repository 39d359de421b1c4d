//! Two vehicles of which everything is known, for tests: they weave, climb and turn.

use super::{Drive, about_vertical, advanced, motion_between};
use crate::mutual::feature_set::{Inertial, Motion};
use crate::mutual::located::Reduced;
use nalgebra::Vector3;
use std::f64::consts::TAU;

pub(in crate::mutual) const GRAVITY_M_S2: f64 = 9.81;

/// Truth in the world: a vehicle that weaves, climbs and turns.
pub(in crate::mutual) struct Weaving {
    amplitude_m: Vector3<f64>,
    rate_rad_s: Vector3<f64>,
    start_m: Vector3<f64>,
    turning_rad_s: f64,
}

impl Weaving {
    pub(in crate::mutual) fn one() -> Self {
        Self::nth(0)
    }

    pub(in crate::mutual) fn other() -> Self {
        Self::nth(1)
    }

    /// One of a team of any size, no two alike.
    pub(in crate::mutual) fn nth(index: usize) -> Self {
        let k = index as f64;
        let around = 2.4 * k + 2.7;
        let sense = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
        Self {
            amplitude_m: Vector3::new(1.2 - 0.1 * (k % 3.0), 1.4 - 0.2 * (k % 4.0), 0.7),
            rate_rad_s: Vector3::new(0.7 + 0.1 * k, 0.9 - 0.1 * (k % 5.0), 1.1 - 0.15 * (k % 3.0)),
            start_m: Vector3::new(
                2.2 * around.cos(),
                2.2 * around.sin(),
                2.5 + 0.8 * (1.7 * k).sin(),
            ),
            turning_rad_s: sense * (0.4 - 0.05 * k),
        }
    }

    fn along(&self, derivative: i32, t: f64) -> Vector3<f64> {
        let quarter = TAU / 4.0 * f64::from(derivative);
        self.amplitude_m
            .zip_map(&self.rate_rad_s, |amplitude, rate| {
                amplitude * rate.powi(derivative) * (rate * t + quarter).sin()
            })
    }

    fn yaw_rad(&self, t: f64) -> f64 {
        self.turning_rad_s * t + 0.5 * (0.5 * t).sin()
    }

    pub(in crate::mutual) fn drive(&self, t: f64) -> Drive {
        let proper = self.along(2, t) + Vector3::z() * GRAVITY_M_S2;
        Drive {
            acceleration_m_s2: about_vertical(-self.yaw_rad(t)) * proper,
            yaw_rate_rad_s: self.turning_rad_s + 0.25 * (0.5 * t).cos(),
        }
    }

    /// What it does between two instants.
    pub(in crate::mutual) fn motion(&self, from_s: f64, to_s: f64) -> Motion {
        let steps = 20;
        let step_s = (to_s - from_s) / f64::from(steps);
        let mut moved = Inertial::zero();
        for step in 0..steps {
            let at = from_s + f64::from(step) * step_s;
            let motion = motion_between(&self.drive(at), &self.drive(at + step_s), step_s);
            moved = advanced(&moved, &motion);
        }
        moved.since(&Inertial::zero())
    }

    /// Where it is for another.
    pub(in crate::mutual) fn seen_from(&self, own: &Self, t: f64) -> Reduced {
        let level_from_world = about_vertical(-own.yaw_rad(t));
        let between = self.start_m + self.along(0, t) - own.start_m - own.along(0, t);
        Reduced {
            position_m: level_from_world * between,
            velocity_m_s: level_from_world * (self.along(1, t) - own.along(1, t)),
            yaw_rad: self.yaw_rad(t) - own.yaw_rad(t),
        }
    }
}
