//! Robots in the plane that drive at random, in the open or between walls, and measure how far they are from each other
//! and how they have moved themselves: the worlds of Cornejo & Nagpal, section V. What the paper does not say is chosen
//! here: headings are uniform at the start, a robot turns first and then drives along its new heading, and without walls
//! it leaves the box.

use crate::streams::{Purpose, Streams};
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal, StandardNormal};
use std::f64::consts::{FRAC_PI_4, PI, TAU};

/// How robots start, drive and measure.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SwarmSettings {
    /// How many.
    pub robots: usize,
    /// Side of the square in which they start, metres.
    pub side_m: f64,
    /// They are turned back at its walls.
    pub has_walls: bool,
    /// Two robots hear and measure each other up to this distance, metres; infinite for all.
    pub radio_m: f64,
    /// Mean length of a move, metres.
    pub move_mean_m: f64,
    /// Its variance, square metres.
    pub move_variance_m2: f64,
    /// Greatest turn to either side, radians.
    pub turn_max_rad: f64,
    /// What the sensors add.
    pub noise: SwarmNoise,
}

/// Noise of distances and of the odometry of a round.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SwarmNoise {
    /// Standard deviation of a distance, metres.
    pub range_sigma_m: f64,
    /// Standard deviation of the translation of a round, per axis, metres.
    pub translation_sigma_m: f64,
    /// Standard deviation of the turn of a round, radians.
    pub rotation_sigma_rad: f64,
    /// Share of distances that went a longer way: by 1 m to 5 m.
    pub outliers: f64,
}

/// Where a robot is and where it looks to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarPose {
    /// In the world, metres.
    pub position_m: Vector2<f64>,
    /// Counter-clockwise from the world's x axis, not wrapped, radians.
    pub heading_rad: f64,
}

/// How a robot has moved in a round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarMotion {
    /// In its own frame before the round (x ahead, y to the left), metres.
    pub translation_m: Vector2<f64>,
    /// Counter-clockwise, radians.
    pub rotation_rad: f64,
}

/// What one robot does in a round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// It stands still.
    Stay,
    /// It turns and drives at random.
    Random,
    /// It turns by so much (radians, counter-clockwise) and drives as far as it would at random.
    Turn(f64),
}

/// The swarm, round by round.
#[derive(Debug)]
pub struct PlanarSwarm {
    settings: SwarmSettings,
    poses: Vec<PlanarPose>,
    /// Where each was before the last round.
    before: Vec<PlanarPose>,
    drives: Vec<ChaCha8Rng>,
    odometers: Vec<ChaCha8Rng>,
    rangers: Vec<ChaCha8Rng>,
}

impl SwarmSettings {
    /// Section V: a box of 10 m, no walls, everybody hears everybody, moves of 3 m (variance 0.5), turns up to 45 deg.
    #[must_use]
    pub const fn section_v(robots: usize, noise: SwarmNoise) -> Self {
        Self {
            robots,
            side_m: 10.0,
            has_walls: false,
            radio_m: f64::INFINITY,
            move_mean_m: 3.0,
            move_variance_m2: 0.5,
            turn_max_rad: FRAC_PI_4,
            noise,
        }
    }

    /// The same with a radio of which a robot in the middle reaches so many others on average.
    #[must_use]
    pub fn with_mean_degree(self, degree: f64) -> Self {
        let others_per_m2 = (self.robots as f64 - 1.0) / self.side_m.powi(2);
        let radio_m = (degree / (PI * others_per_m2)).sqrt();
        Self { radio_m, ..self }
    }
}

impl SwarmNoise {
    /// None at all.
    pub const NONE: Self = Self {
        range_sigma_m: 0.0,
        translation_sigma_m: 0.0,
        rotation_sigma_rad: 0.0,
        outliers: 0.0,
    };

    /// 10 cm, 5 cm and 10 mrad.
    pub const USUAL: Self = Self {
        range_sigma_m: 0.1,
        translation_sigma_m: 0.05,
        rotation_sigma_rad: 0.01,
        outliers: 0.0,
    };
}

impl PlanarSwarm {
    /// Robots strewn over the box.
    #[must_use]
    pub fn new(settings: SwarmSettings, streams: &Streams) -> Self {
        let start = |robot: usize| {
            let mut rng = streams.vehicle(robot, Purpose::Start);
            PlanarPose {
                position_m: Vector2::from_fn(|_, _| settings.side_m * rng.random::<f64>()),
                heading_rad: rng.random_range(-PI..PI),
            }
        };
        let poses: Vec<PlanarPose> = (0..settings.robots).map(start).collect();
        let each = |purpose| -> Vec<ChaCha8Rng> {
            let robots = 0..settings.robots;
            robots
                .map(|robot| streams.vehicle(robot, purpose))
                .collect()
        };
        Self {
            settings,
            before: poses.clone(),
            poses,
            drives: each(Purpose::Trajectory),
            odometers: each(Purpose::Odometry),
            rangers: each(Purpose::Measurement),
        }
    }

    /// How many robots.
    #[must_use]
    pub fn robots(&self) -> usize {
        self.poses.len()
    }

    /// What it was made of.
    #[must_use]
    pub const fn settings(&self) -> &SwarmSettings {
        &self.settings
    }

    /// Where a robot is.
    #[must_use]
    pub fn pose(&self, robot: usize) -> PlanarPose {
        self.poses[robot]
    }

    /// Where a robot is for another, in that other's frame.
    #[must_use]
    pub fn relative(&self, observer: usize, robot: usize) -> PlanarPose {
        self.poses[robot].seen_from(&self.poses[observer])
    }

    /// Whether two hear each other now.
    #[must_use]
    pub fn are_linked(&self, a: usize, b: usize) -> bool {
        self.are_linked_at(a, b, 1.0)
    }

    /// Whether two heard each other when this share of the last round was over: robots drive straight and evenly.
    #[must_use]
    pub fn are_linked_at(&self, a: usize, b: usize, share: f64) -> bool {
        let at = |robot: usize| {
            let (from, to) = (self.before[robot].position_m, self.poses[robot].position_m);
            from.lerp(&to, share)
        };
        a != b && (at(a) - at(b)).norm() <= self.settings.radio_m
    }

    /// Lets one round go by.
    pub fn step(&mut self, drive: impl Fn(usize) -> Drive) {
        self.before.clone_from(&self.poses);
        let sigma_m = self.settings.move_variance_m2.max(0.0).sqrt();
        let turn_max_rad = self.settings.turn_max_rad;
        for (robot, pose) in self.poses.iter_mut().enumerate() {
            // Drawn by whoever stands still too, so that one robot's permit does not shift another's draws.
            let rng = &mut self.drives[robot];
            let gauss: f64 = StandardNormal.sample(rng);
            let length_m = self.settings.move_mean_m + sigma_m * gauss;
            let turn_rad = turn_max_rad * (2.0 * rng.random::<f64>() - 1.0);
            let turn_rad = match drive(robot) {
                Drive::Stay => continue,
                Drive::Random => turn_rad,
                Drive::Turn(turn_rad) => turn_rad,
            };
            pose.heading_rad += turn_rad;
            let step_m = length_m * ahead(pose.heading_rad);
            pose.position_m += step_m;
            if self.settings.has_walls {
                turn_back(pose, step_m, self.settings.side_m);
            }
        }
    }

    /// What a robot's odometry says of the last round. Each call draws anew; whoever stood still measures nothing wrong.
    pub fn odometry(&mut self, robot: usize) -> PlanarMotion {
        let (pose, before) = (self.poses[robot], self.before[robot]);
        let truth = pose.seen_from(&before);
        if pose == before {
            return PlanarMotion {
                translation_m: Vector2::zeros(),
                rotation_rad: 0.0,
            };
        }
        let rng = &mut self.odometers[robot];
        let mut gauss = |sigma: f64| sigma * Distribution::<f64>::sample(&StandardNormal, rng);
        let noise = &self.settings.noise;
        PlanarMotion {
            translation_m: Vector2::new(
                truth.position_m.x + gauss(noise.translation_sigma_m),
                truth.position_m.y + gauss(noise.translation_sigma_m),
            ),
            rotation_rad: truth.heading_rad + gauss(noise.rotation_sigma_rad),
        }
    }

    /// The distance to another as a robot measures it now, metres; each call draws anew. None out of reach.
    pub fn range_m(&mut self, robot: usize, to: usize) -> Option<f64> {
        if !self.are_linked(robot, to) {
            return None;
        }
        let noise = self.settings.noise;
        let rng = &mut self.rangers[robot];
        let normal = Normal::new(0.0, noise.range_sigma_m.max(0.0)).ok()?;
        let detour_m = if rng.random_bool(noise.outliers.clamp(0.0, 1.0)) {
            rng.random_range(1.0..5.0)
        } else {
            0.0
        };
        let truth_m = (self.poses[to].position_m - self.poses[robot].position_m).norm();
        Some((truth_m + normal.sample(rng)).max(0.0) + detour_m)
    }
}

impl PlanarPose {
    /// This pose in the frame of another.
    #[must_use]
    pub fn seen_from(&self, other: &Self) -> Self {
        let apart_m = self.position_m - other.position_m;
        let (sin, cos) = other.heading_rad.sin_cos();
        Self {
            position_m: Vector2::new(
                cos * apart_m.x + sin * apart_m.y,
                -sin * apart_m.x + cos * apart_m.y,
            ),
            heading_rad: self.heading_rad - other.heading_rad,
        }
    }
}

/// The angle in (-pi, pi].
#[must_use]
pub fn wrapped_rad(angle_rad: f64) -> f64 {
    let wrapped = angle_rad.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

fn ahead(heading_rad: f64) -> Vector2<f64> {
    Vector2::new(heading_rad.cos(), heading_rad.sin())
}

/// Whoever would have gone through a wall has turned to the other side before it set off: its move stays
/// straight.
fn turn_back(pose: &mut PlanarPose, step_m: Vector2<f64>, side_m: f64) {
    let from = pose.position_m - step_m;
    let mut turned = step_m;
    let inside = 0.0..=side_m;
    for axis in 0..2 {
        if !inside.contains(&(from[axis] + turned[axis])) {
            turned[axis] = -turned[axis];
        }
    }
    // A move too long for either side.
    for _ in 0..8 {
        let reached = from + turned;
        if !(inside.contains(&reached.x) && inside.contains(&reached.y)) {
            turned *= 0.5;
        }
    }
    pose.position_m = from + turned;
    if turned != step_m {
        pose.heading_rad = turned.y.atan2(turned.x);
    }
}

#[cfg(test)]
mod tests;
