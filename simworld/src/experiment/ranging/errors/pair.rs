//! A pair of robots on its way: what was true and what both measured, so that all who localise are given the same.

use crate::experiment::ranging::reckoning;
use crate::planar_swarm::{
    Drive, PlanarMotion, PlanarPose, PlanarSwarm, SwarmNoise, SwarmSettings,
};
use crate::streams::Streams;
use skein_estimation::ranging::RangeSample;
use skein_estimation::time::{Span, Stamp};

/// Where both are in the world: the one that localises, then the other.
pub type Places = [PlanarPose; 2];

/// Who moves in a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turns {
    /// Both (Algorithm 1).
    Together,
    /// One after the other (Algorithm 2).
    Alternating,
}

/// What there is of one round. In the first nobody has moved yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// Where both are at its end.
    pub places: Places,
    /// What their odometries said of it.
    pub motions: [PlanarMotion; 2],
    /// The distance that both heard at its end (m).
    pub range_m: f64,
}

/// A pair that has gone its way.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// What the sensors added.
    pub noise: SwarmNoise,
    /// Oldest first.
    pub rounds: Vec<Round>,
}

impl Pair {
    /// The pair of section V after so many distances.
    #[must_use]
    pub fn gone(turns: Turns, count: usize, noise: SwarmNoise, streams: &Streams) -> Self {
        let mut swarm = PlanarSwarm::new(SwarmSettings::section_v(2, noise), streams);
        let mut rounds = Vec::with_capacity(count);
        for index in 0..count {
            if index > 0 {
                swarm.step(|robot| match turns {
                    Turns::Alternating if robot != index % 2 => Drive::Stay,
                    Turns::Alternating | Turns::Together => Drive::Random,
                });
            }
            let motions = [0, 1].map(|robot| swarm.odometry(robot));
            let Some(range_m) = swarm.range_m(0, 1) else {
                unreachable!("in section V everybody hears everybody");
            };
            rounds.push(Round {
                places: [swarm.pose(0), swarm.pose(1)],
                motions,
                range_m,
            });
        }
        Self { noise, rounds }
    }

    /// The same for the other of the two.
    #[must_use]
    pub fn seen_by_the_other(&self) -> Self {
        let mut other = self.clone();
        for round in &mut other.rounds {
            round.places.reverse();
            round.motions.reverse();
        }
        other
    }

    /// Where both were at every distance.
    #[must_use]
    pub fn places(&self) -> Vec<Places> {
        self.rounds.iter().map(|round| round.places).collect()
    }

    /// The distances as Algorithm 1 takes them: with cumulative odometry.
    #[must_use]
    pub fn samples(&self) -> Vec<RangeSample> {
        let mut odometries = [reckoning::begun(); 2];
        let sigmas = (
            self.noise.rotation_sigma_rad,
            self.noise.translation_sigma_m,
        );
        let sample = |(second, round): (i64, &Round)| {
            if second > 0 {
                for (odometry, motion) in odometries.iter_mut().zip(&round.motions) {
                    let moved_m = motion.translation_m.push(0.0);
                    *odometry = reckoning::after(odometry, &moved_m, motion.rotation_rad, sigmas);
                }
            }
            RangeSample {
                taken: Stamp::from_nanos(0) + Span::secs(second),
                // A distance of nothing or less is none.
                range_m: round.range_m.max(1e-3),
                sigma_m: self.noise.range_sigma_m,
                own: odometries[0],
                neighbour: odometries[1],
            }
        };
        (0..).zip(&self.rounds).map(sample).collect()
    }
}
