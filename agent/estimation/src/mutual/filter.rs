//! What is believed about one neighbour's place, from registrations that may give several answers and from both
//! vehicles' motion (Cognetti et al., section III-B): the paper's particle filter, and a bank of Kalman filters behind the
//! same interface.
//!
//! Registration says in which direction a neighbour is and how it is turned, never how far it is: distance follows from
//! how the direction changes while both accelerate as they say.

pub mod mixture;

pub mod particles;

pub mod bank;

mod clusters;

mod noise;

use super::feature_set::Motion;
use super::located::Reduced;
use bank::{Bank, BankSettings};
use mixture::{Mixture, Responsibilities};
use nalgebra::SMatrix;
use particles::{ParticleSettings, Particles};
use rand::Rng;

/// What part of the weight is put where an answer is that nothing believed explains: how likely the belief is wrong
/// altogether.
///
/// Of features of 3 degrees, an answer makes those near it some 300 to 500 times as likely as those that are explained by
/// no answer at all ([`mixture::Tempering`]), and registrations that follow each other make the same mistake. At a
/// thousandth, three wrong answers in a row, 0.3 s, carried any belief away; at a millionth it takes a fourth, and a wrong
/// belief is left after as many right ones.
pub const INJECTED_WEIGHT: f64 = 1e-6;

/// Which filter, with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FilterSettings {
    /// The paper's.
    Particles(ParticleSettings),
    /// Kalman filters, one for each of several distances.
    Bank(BankSettings),
}

/// What is known of a neighbour before anything of its motion is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Nearest a neighbour can be (m).
    pub distance_min_m: f64,
    /// Farthest (m); between the two, its logarithm is uniform.
    pub distance_max_m: f64,
    /// Standard deviation of the relative velocity, per axis (m/s).
    pub speed_sigma_m_s: f64,
}

impl Prior {
    /// Robots that fly within some ten metres of each other, as slowly as in the paper's arena.
    pub const ARENA: Self = Self {
        distance_min_m: 0.8,
        distance_max_m: 12.0,
        speed_sigma_m_s: 0.8,
    };
}

/// How far the two vehicles' motions, as they are told, may be wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionNoise {
    /// Random walk of the relative velocity, per axis (m/s per root second).
    pub velocity_m_s_rs: f64,
    /// Random walk of the relative yaw (rad per root second).
    pub yaw_rad_rs: f64,
}

impl MotionNoise {
    /// Quadrotors whose inertial sensors shake as the paper's do, levelled to a few tenths of a degree: at 20 Hz,
    /// 0.2 m/s^2 and 0.15 degrees per step.
    pub const QUADROTOR: Self = Self {
        velocity_m_s_rs: 0.2 * 0.223_606_797_749_979,
        yaw_rad_rs: 0.011_7,
    };
}

/// What a filter makes of a neighbour's place. The three places are the paper's choice, its alternative, and the
/// clustering it suggests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The likeliest particle.
    pub best: Reduced,
    /// The mean of everything believed; between the places when there are several.
    pub mean: Reduced,
    /// The mean of the heaviest cluster of directions and yaws.
    pub dominant: Reduced,
    /// Covariance of that cluster: position, velocity, yaw (m, m/s, rad).
    pub covariance: SMatrix<f64, 7, 7>,
    /// Which part of the belief is in that cluster, 0 to 1.
    pub dominant_mass: f64,
    /// In how many clusters the belief lies, those of little mass left out.
    pub modes: usize,
}

impl Estimate {
    /// Standard deviation of the distance over the distance, within the dominant cluster.
    #[must_use]
    pub fn relative_distance_sigma(&self) -> f64 {
        let toward = self.dominant.position_m.normalize();
        let block = self.covariance.fixed_view::<3, 3>(0, 0);
        (toward.dot(&(block * toward)).max(0.0)).sqrt() / self.dominant.position_m.norm()
    }
}

/// The belief about one neighbour.
#[derive(Clone, Debug)]
pub enum NeighbourFilter {
    /// As [`FilterSettings::Particles`].
    Particles(Box<Particles>),
    /// As [`FilterSettings::Bank`].
    Bank(Box<Bank>),
}

impl NeighbourFilter {
    /// A belief begun by a first measurement: distances and velocities are random within the prior.
    #[must_use]
    pub fn born(settings: &FilterSettings, first: &Mixture, rng: &mut impl Rng) -> Self {
        match settings {
            FilterSettings::Particles(settings) => {
                Self::Particles(Box::new(Particles::born(*settings, first, rng)))
            }
            FilterSettings::Bank(settings) => Self::Bank(Box::new(Bank::born(*settings, first))),
        }
    }

    /// Both vehicles have moved, for equally long.
    pub fn predict(&mut self, own: &Motion, neighbour: &Motion, rng: &mut impl Rng) {
        match self {
            Self::Particles(particles) => particles.predict(own, neighbour, rng),
            Self::Bank(bank) => bank.predict(own, neighbour),
        }
    }

    /// Weighs the belief by what a registration said, and says which of its answers the belief holds to be true.
    pub fn update(&mut self, measured: &Mixture, rng: &mut impl Rng) -> Responsibilities {
        match self {
            Self::Particles(particles) => particles.update(measured, rng),
            Self::Bank(bank) => bank.update(measured),
        }
    }

    /// Where the neighbour is held to be.
    #[must_use]
    pub fn estimate(&mut self) -> Estimate {
        match self {
            Self::Particles(particles) => particles.estimate(),
            Self::Bank(bank) => bank.estimate(),
        }
    }

    /// So many places that are equally likely, as a sample of the belief.
    #[must_use]
    pub fn sampled(&self, count: usize) -> Vec<Reduced> {
        match self {
            Self::Particles(particles) => particles.sampled(count),
            Self::Bank(bank) => bank.sampled(count),
        }
    }

    /// The likeliest places, likeliest first, at most `count`.
    #[must_use]
    pub fn likeliest(&self, count: usize) -> Vec<Reduced> {
        match self {
            Self::Particles(particles) => particles.likeliest(count),
            Self::Bank(bank) => bank.likeliest(count),
        }
    }
}

#[cfg(test)]
mod flight;

#[cfg(test)]
mod tests;
