//! The simulation of Cornejo & Nagpal, section V, for tests: robots that turn and go on at random, with noise.

use super::pose::{RelativePose, turned};
use super::sample::{LevelOdometry, RangeSample};
use crate::odometry::Growth;
use crate::time::{Span, Stamp};
use nalgebra::Vector3;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use std::f64::consts::{FRAC_PI_4, PI};

/// Standard deviations of a round.
#[derive(Clone, Copy)]
pub(crate) struct Noise {
    /// Of a range (m).
    pub(crate) range_m: f64,
    /// Of odometry's translation, per axis (m).
    pub(crate) translation_m: f64,
    /// Of odometry's turn (rad).
    pub(crate) turn_rad: f64,
}

impl Noise {
    /// What the paper's figures are compared at.
    pub(crate) const USUAL: Self = Self {
        range_m: 0.1,
        translation_m: 0.05,
        turn_rad: 0.01,
    };
    /// None, or so little that it makes no difference.
    pub(crate) const NONE: Self = Self {
        range_m: 1e-9,
        translation_m: 1e-9,
        turn_rad: 1e-9,
    };
    /// The least that a robot tells.
    const TOLD_MIN: Self = Self {
        range_m: 1e-3,
        translation_m: 1e-4,
        turn_rad: 1e-5,
    };
}

/// What one robot does in a round: it turns by an angle (rad), then moves in its new level frame (m).
#[derive(Clone, Copy)]
pub(crate) struct Motion {
    pub(crate) turn_rad: f64,
    pub(crate) forward_m: Vector3<f64>,
}

/// One robot: where it is, and where it thinks that it is.
#[derive(Clone)]
pub(crate) struct Robot {
    pub(crate) position_m: Vector3<f64>,
    pub(crate) yaw_rad: f64,
    pub(crate) odometry: LevelOdometry,
}

/// Robots that know how far they are from each other.
#[derive(Clone)]
pub(crate) struct World {
    pub(crate) rng: ChaCha8Rng,
    pub(crate) noise: Noise,
    pub(crate) spatial: bool,
    pub(crate) round: i64,
    pub(crate) robots: Vec<Robot>,
}

impl World {
    /// So many robots, anywhere in a box of 10 m.
    pub(crate) fn new(mut rng: ChaCha8Rng, noise: Noise, robots: usize, spatial: bool) -> Self {
        let robots = (0..robots)
            .map(|_| {
                let mut anywhere = || rng.random_range(0.0..10.0);
                let position_m = Vector3::new(anywhere(), anywhere(), anywhere());
                Robot {
                    position_m: if spatial {
                        position_m
                    } else {
                        Vector3::new(position_m.x, position_m.y, 0.0)
                    },
                    yaw_rad: rng.random_range(-PI..PI),
                    odometry: LevelOdometry {
                        segment: 0,
                        position_m: Vector3::zeros(),
                        yaw_rad: 0.0,
                        growth: Growth::zero(),
                    },
                }
            })
            .collect();
        Self {
            rng,
            noise,
            spatial,
            round: 0,
            robots,
        }
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.rng)
    }

    /// What a robot of the paper does.
    pub(crate) fn random_motion(&mut self) -> Motion {
        let turn_rad = self.rng.random_range(-FRAC_PI_4..FRAC_PI_4);
        let length = 3.0 + 0.5_f64.sqrt() * self.normal();
        let climb = if self.spatial { self.normal() } else { 0.0 };
        Motion {
            turn_rad,
            forward_m: Vector3::new(length, 0.0, climb),
        }
    }

    /// All robots move once at random.
    pub(crate) fn step(&mut self) {
        for robot in 0..self.robots.len() {
            let motion = self.random_motion();
            self.drive(robot, &motion);
        }
        self.round += 1;
    }

    /// One robot moves.
    pub(crate) fn drive(&mut self, robot: usize, motion: &Motion) {
        let mut error = || {
            let unit: f64 = StandardNormal.sample(&mut self.rng);
            unit * self.noise.translation_m
        };
        let slip = Vector3::new(error(), error(), if self.spatial { error() } else { 0.0 });
        let slip_rad = self.noise.turn_rad * self.normal();
        let noise = self.noise;
        let robot = &mut self.robots[robot];
        robot.yaw_rad += motion.turn_rad;
        robot.position_m += turned(&motion.forward_m, robot.yaw_rad);
        // Odometry tells the whole increment in the frame before it.
        let told = turned(&motion.forward_m, motion.turn_rad) + slip;
        let odometry = &mut robot.odometry;
        odometry.position_m += turned(&told, odometry.yaw_rad);
        odometry.yaw_rad += motion.turn_rad + slip_rad;
        odometry.growth = odometry.growth.after(
            &odometry.position_m,
            noise.turn_rad.max(Noise::TOLD_MIN.turn_rad),
            noise.translation_m.max(Noise::TOLD_MIN.translation_m),
        );
    }

    /// How far it truly is from one robot to another (m).
    pub(crate) fn distance_m(&self, from: usize, to: usize) -> f64 {
        (self.robots[to].position_m - self.robots[from].position_m).norm()
    }

    /// A range between two robots.
    pub(crate) fn range(&mut self, from: usize, to: usize) -> RangeSample {
        let range_m = self.distance_m(from, to) + self.noise.range_m * self.normal();
        RangeSample {
            taken: Stamp::from_nanos(0) + Span::secs(self.round),
            range_m: range_m.max(1e-3),
            sigma_m: self.noise.range_m.max(Noise::TOLD_MIN.range_m),
            own: self.robots[from].odometry,
            neighbour: self.robots[to].odometry,
        }
    }

    /// Where one robot truly is for another.
    pub(crate) fn truth(&self, from: usize, to: usize) -> RelativePose {
        let (from, to) = (&self.robots[from], &self.robots[to]);
        RelativePose::new(
            turned(&(to.position_m - from.position_m), -from.yaw_rad),
            to.yaw_rad - from.yaw_rad,
        )
    }
}
