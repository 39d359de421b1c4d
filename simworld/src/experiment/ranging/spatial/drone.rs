//! A drone on a smooth course, and what its levelled odometry says: the height of its course is as good as the rest, its
//! heading drifts, gravity keeps it level.

use crate::experiment::ranging::following::Truth;
use crate::experiment::ranging::reckoning;
use crate::planar_swarm::SwarmNoise;
use crate::streams::{Purpose, Streams};
use nalgebra::{Rotation3, Vector3};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use skein_estimation::ranging::LevelOdometry;
use std::f64::consts::PI;

/// Side of the box around whose points drones fly (m).
const SIDE_M: f64 = 10.0;
/// How far they fly to either side, along and across (m).
const REACH_M: (f64, f64) = (6.0, 10.0);
/// How far they climb and sink (m).
const CLIMB_M: (f64, f64) = (2.0, 4.0);
/// How far they turn to either side (rad).
const TURN_RAD: (f64, f64) = (1.0, PI);
/// How fast all of it goes to and fro (rad a round): 3 m a round in the mean.
const PACE_RAD: (f64, f64) = (0.3, 0.6);

/// A number that goes to and fro.
#[derive(Clone, Copy, Debug)]
struct Swing {
    middle: f64,
    reach: f64,
    pace_rad: f64,
    phase_rad: f64,
}

/// One drone.
#[derive(Clone, Debug)]
pub(super) struct Drone {
    axes: [Swing; 3],
    yaw: Swing,
    round: u32,
    noise: SwarmNoise,
    rng: ChaCha8Rng,
    odometry: LevelOdometry,
}

impl Swing {
    fn random(rng: &mut impl Rng, middle: f64, reach: (f64, f64)) -> Self {
        Self {
            middle,
            reach: rng.random_range(reach.0..reach.1),
            pace_rad: rng.random_range(PACE_RAD.0..PACE_RAD.1),
            phase_rad: rng.random_range(-PI..PI),
        }
    }

    fn at(&self, round: u32) -> f64 {
        self.middle + self.reach * (self.pace_rad * f64::from(round) + self.phase_rad).sin()
    }
}

impl Drone {
    pub(super) fn new(index: usize, climbs: bool, noise: SwarmNoise, streams: &Streams) -> Self {
        let rng = &mut streams.vehicle(index, Purpose::Trajectory);
        let mut middle = || SIDE_M * rng.random::<f64>();
        let middles = [middle(), middle(), middle()];
        let reaches = [REACH_M, REACH_M, CLIMB_M];
        let mut axes = [0, 1, 2].map(|axis| Swing::random(rng, middles[axis], reaches[axis]));
        if !climbs {
            axes[2].reach = 0.0;
        }
        let heading_rad = rng.random_range(-PI..PI);
        Self {
            axes,
            yaw: Swing::random(rng, heading_rad, TURN_RAD),
            round: 0,
            noise,
            rng: streams.vehicle(index, Purpose::Odometry),
            odometry: reckoning::begun(),
        }
    }

    pub(super) fn position_m(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.axes[axis].at(self.round))
    }

    pub(super) fn yaw_rad(&self) -> f64 {
        self.yaw.at(self.round)
    }

    pub(super) const fn odometry(&self) -> LevelOdometry {
        self.odometry
    }

    /// Lets one round go by.
    pub(super) fn step(&mut self) {
        let (from_m, from_rad) = (self.position_m(), self.yaw_rad());
        self.round += 1;
        let rng = &mut self.rng;
        let mut gauss = |sigma: f64| sigma * Distribution::<f64>::sample(&StandardNormal, rng);
        let noise = &self.noise;
        let slip_m = Vector3::from_fn(|_, _| gauss(noise.translation_sigma_m));
        let slip_rad = gauss(noise.rotation_sigma_rad);
        let moved_m = about_z(-from_rad) * (self.position_m() - from_m) + slip_m;
        let turned_rad = self.yaw_rad() - from_rad + slip_rad;
        let sigmas = (noise.rotation_sigma_rad, noise.translation_sigma_m);
        self.odometry = reckoning::after(&self.odometry, &moved_m, turned_rad, sigmas);
    }

    /// Where another drone is for this one.
    pub(super) fn sees(&self, other: &Self) -> Truth {
        Truth {
            position_m: about_z(-self.yaw_rad()) * (other.position_m() - self.position_m()),
            yaw_rad: other.yaw_rad() - self.yaw_rad(),
        }
    }
}

fn about_z(angle_rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odometry_without_noise_is_the_course_seen_from_its_start() {
        let streams = Streams::new(3, 0);
        let mut drone = Drone::new(0, true, SwarmNoise::NONE, &streams);
        let start = (drone.position_m(), drone.yaw_rad());
        let mut way_m = 0.0;
        for _ in 0..100 {
            let before_m = drone.position_m();
            drone.step();
            way_m += (drone.position_m() - before_m).norm();
        }
        let seen_m = about_z(-start.1) * (drone.position_m() - start.0);
        assert!((drone.odometry().position_m - seen_m).norm() < 1e-9);
        assert!((drone.odometry().yaw_rad - (drone.yaw_rad() - start.1)).abs() < 1e-9);
        // As fast as the robots in the plane.
        assert!((2.0..4.5).contains(&(way_m / 100.0)), "{way_m}");
    }

    #[test]
    fn who_does_not_climb_stays_as_high_as_it_is() {
        let mut drone = Drone::new(0, false, SwarmNoise::NONE, &Streams::new(3, 0));
        let height_m = drone.position_m().z;
        drone.step();
        assert!((drone.position_m().z - height_m).abs() < 1e-12);
        assert!(drone.odometry().position_m.norm() > 0.1);
    }
}
