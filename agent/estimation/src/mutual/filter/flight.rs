//! What one vehicle learns of another that weaves, for tests of all filters: motions that are a little wrong, and answers
//! that are right but for noise.

use super::mixture::{Answer, Mixture, Tempering};
use super::{Estimate, FilterSettings, NeighbourFilter};
use crate::mutual::direction;
use crate::mutual::located::Reduced;
use crate::mutual::propagation::weaving::Weaving;
use nalgebra::{Matrix3, UnitVector3, Vector2};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

/// Messages per second.
pub(super) const RATE_HZ: f64 = 20.0;

pub(super) struct Flight {
    pub(super) rng: ChaCha8Rng,
    pub(super) filter: Option<NeighbourFilter>,
    settings: FilterSettings,
    own: Weaving,
    neighbour: Weaving,
    step: u32,
}

impl Flight {
    pub(super) fn new(settings: FilterSettings, seed: u64) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            filter: None,
            settings,
            own: Weaving::one(),
            neighbour: Weaving::other(),
            step: 0,
        }
    }

    fn now_s(&self) -> f64 {
        f64::from(self.step) / RATE_HZ
    }

    pub(super) fn truth(&self) -> Reduced {
        self.neighbour.seen_from(&self.own, self.now_s())
    }

    /// The right answer but for noise, and where the neighbour would be if it were mistaken for another.
    pub(super) fn right(&mut self, sigma_rad: f64) -> Answer {
        let truth = self.truth();
        let mut normal = || -> f64 { StandardNormal.sample(&mut self.rng) };
        let off = Vector2::new(normal(), normal()) * sigma_rad;
        let toward = UnitVector3::new_normalize(truth.position_m);
        Answer {
            direction: direction::moved(&toward, &off),
            yaw_rad: truth.yaw_rad + normal() * sigma_rad,
            covariance_rad2: Matrix3::identity() * sigma_rad.powi(2),
            log_likelihood: 0.0,
            own_feature: Some(0),
        }
    }

    /// Moves on by one message.
    pub(super) fn step(&mut self) {
        let from_s = self.now_s();
        self.step += 1;
        let to_s = self.now_s();
        let (own, neighbour) = (
            self.own.motion(from_s, to_s),
            self.neighbour.motion(from_s, to_s),
        );
        if let Some(filter) = &mut self.filter {
            filter.predict(&own, &neighbour, &mut self.rng);
        }
    }

    pub(super) fn measure(&mut self, answers: &[Answer]) {
        let mixture = Mixture::new(answers, &[], &Tempering::CAUTIOUS).unwrap();
        match &mut self.filter {
            Some(filter) => drop(filter.update(&mixture, &mut self.rng)),
            None => {
                self.filter = Some(NeighbourFilter::born(
                    &self.settings,
                    &mixture,
                    &mut self.rng,
                ));
            }
        }
    }

    /// Flies on, with the right answer (3 degrees) every other message.
    pub(super) fn fly(&mut self, seconds: f64) {
        for _ in 0..(seconds * RATE_HZ) as u32 {
            self.step();
            if self.step.is_multiple_of(2) {
                let right = self.right(0.05);
                self.measure(&[right]);
            }
        }
    }

    pub(super) fn estimate(&mut self) -> Estimate {
        self.filter.as_mut().unwrap().estimate()
    }

    /// How far off a place is: over the distance, and in yaw (rad).
    pub(super) fn error(&self, place: &Reduced) -> (f64, f64) {
        let truth = self.truth();
        (
            (place.position_m - truth.position_m).norm() / truth.position_m.norm(),
            direction::wrapped(place.yaw_rad - truth.yaw_rad).abs(),
        )
    }
}
