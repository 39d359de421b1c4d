//! Two robots of section V that take turns to move.

use super::super::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::FRAC_PI_4;

pub(super) const STILL: PairMotion = PairMotion {
    own: Turtle::STILL,
    theirs: Turtle::STILL,
};

pub(super) struct Pair {
    /// East, north (m), heading (rad).
    poses: [(Vector2<f64>, f64); 2],
    noise: Noise,
    rng: ChaCha8Rng,
    rounds: usize,
}

impl Pair {
    pub(super) fn new(seed: u64, noise: Noise) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut pose = || {
            let position_m = Vector2::from_fn(|_, _| 10.0 * rng.random::<f64>());
            (position_m, rng.random_range(-PI..PI))
        };
        Self {
            poses: [pose(), pose()],
            noise,
            rng,
            rounds: 0,
        }
    }

    fn gauss(&mut self, sigma: f64) -> f64 {
        let one: f64 = StandardNormal.sample(&mut self.rng);
        sigma * one
    }

    /// One moves, the other stands still: what odometry says of it, and the distance afterwards.
    pub(super) fn round(&mut self) -> (PairMotion, f64) {
        let mover = self.rounds % 2;
        self.rounds += 1;
        let turn_rad = self.rng.random_range(-FRAC_PI_4..FRAC_PI_4);
        let length_m = 3.0 + self.gauss(0.5_f64.sqrt());
        let heading_rad = self.poses[mover].1 + turn_rad;
        self.poses[mover] = (
            self.poses[mover].0 + length_m * ahead(heading_rad),
            heading_rad,
        );
        let (along, turn) = (
            self.noise.translation_sigma_m,
            self.noise.rotation_sigma_rad,
        );
        let off_m = Vector2::new(self.gauss(along), self.gauss(along));
        let moved = Turtle {
            translation_m: length_m * ahead(turn_rad) + off_m,
            rotation_rad: turn_rad + self.gauss(turn),
        };
        let motion = if mover == 0 {
            PairMotion {
                own: moved,
                ..STILL
            }
        } else {
            PairMotion {
                theirs: moved,
                ..STILL
            }
        };
        (motion, self.range_m())
    }

    pub(super) fn range_m(&mut self) -> f64 {
        let truth_m = (self.poses[1].0 - self.poses[0].0).norm();
        (truth_m + self.gauss(self.noise.range_sigma_m)).max(0.0)
    }

    /// How far an estimate is from the truth (m, rad).
    pub(super) fn error(&self, at: &Relative) -> (f64, f64) {
        let [own, theirs] = self.poses;
        let truth_m = Rotation2::new(-own.1) * (theirs.0 - own.0);
        let off_rad = wrapped(at.orientation_rad - (theirs.1 - own.1)).abs();
        ((at.position_m - truth_m).norm(), off_rad)
    }

    /// Where the neighbour has this robot, in its own frame.
    pub(super) fn seen_by_neighbour(&self) -> Vector2<f64> {
        let [own, theirs] = self.poses;
        Rotation2::new(-theirs.1) * (own.0 - theirs.0)
    }
}
