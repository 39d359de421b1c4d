//! Who flies where, who talks and what they sense, when a team is to find itself by anonymous bearings.

use crate::anonymous::CameraSettings;
use crate::quadrotor::{Arena, Course, ImuSettings, Legs, Round, Weave, WeaveOf};
use crate::streams::{Purpose, Streams};
use nalgebra::Vector3;
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Where a team starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Formation {
    /// One of the two teams of the published experiments; of eight, two do not talk.
    Of(WeaveOf),
    /// Anywhere in the arena of the experiments, drawn anew for every sample.
    Scattered {
        /// How many.
        robots: usize,
        /// How many of them do not talk.
        silent: usize,
    },
}

/// How a team moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flight {
    /// As in the experiments; a scattered team has no such motion of its own and flies from point to point.
    Weave,
    /// Each on a circle of its own.
    Round,
    /// From point to point.
    Legs,
}

/// Which robot of a formation is which vehicle: vehicle 0 is the one whose estimates are looked at, the last ones are silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Roles {
    /// In the order of the formation.
    InOrder,
    /// Drawn anew for every sample.
    Drawn,
}

/// A flight. Its times are seconds since its start; for the first two, everyone hovers.
#[derive(Clone, Debug, PartialEq)]
pub struct MutualScenario {
    /// Seed of every random stream.
    pub seed: u64,
    /// Where the team starts.
    pub formation: Formation,
    /// How it moves.
    pub flight: Flight,
    /// Who is who.
    pub roles: Roles,
    /// How long it lasts (s).
    pub duration_s: f64,
    /// Everyone's inertial sensor.
    pub imu: ImuSettings,
    /// Everyone's camera. A message goes out with every image.
    pub camera: CameraSettings,
    /// Probability that a message does not arrive, for each receiver on its own.
    pub loss: f64,
    /// A message arrives this late at most, each by a random part of it (s).
    pub late_s_max: f64,
}

/// The arena of the experiments (Cognetti et al., section IV) without a margin of 1 m: metres.
const ARENA: Arena = Arena {
    low_m: Vector3::new(-4.0, -5.0, 1.0),
    high_m: Vector3::new(4.0, 5.0, 5.0),
};
/// How near two scattered robots may start (m).
const APART_M: f64 = 1.8;
/// How often a place is looked for that is so far from all others.
const TRIES_MAX: usize = 1000;

impl Formation {
    /// How many robots there are, silent ones included.
    #[must_use]
    pub const fn robots(self) -> usize {
        match self {
            Self::Of(team) => team.robots(),
            Self::Scattered { robots, .. } => robots,
        }
    }

    /// How many talk: the first so many vehicles.
    #[must_use]
    pub const fn talking(self) -> usize {
        match self {
            Self::Of(WeaveOf::Square) => 4,
            Self::Of(WeaveOf::Eight) => 6,
            Self::Scattered { robots, silent } => robots.saturating_sub(silent),
        }
    }
}

impl MutualScenario {
    /// Four in a square that is ambiguous at first.
    #[must_use]
    pub fn square() -> Self {
        Self {
            seed: 1,
            formation: Formation::Of(WeaveOf::Square),
            flight: Flight::Weave,
            roles: Roles::InOrder,
            duration_s: 60.0,
            imu: ImuSettings::default(),
            camera: CameraSettings::default(),
            loss: 0.0,
            late_s_max: 0.0,
        }
    }

    /// Eight, of which two never say a word.
    #[must_use]
    pub fn eight() -> Self {
        Self {
            formation: Formation::Of(WeaveOf::Eight),
            ..Self::square()
        }
    }

    /// The box that the team stays in, about.
    pub(crate) fn arena(&self, courses: &[Course]) -> Arena {
        let starts: Vec<_> = courses
            .iter()
            .map(|course| course.place_at(0.0).position_m)
            .collect();
        Arena::around(&starts, MARGIN_M)
    }

    /// The course of every vehicle in one sample.
    #[must_use]
    pub fn courses(&self, sample: u64) -> Vec<Course> {
        let streams = Streams::new(self.seed, sample);
        let mut rng = streams.vehicle(0, Purpose::Trajectory);
        let mut courses = match self.formation {
            Formation::Of(team) => self.of_team(team, &mut rng),
            Formation::Scattered { robots, .. } => {
                let starts = scattered(robots, &mut rng);
                match self.flight {
                    Flight::Round => rounds(&starts),
                    Flight::Weave | Flight::Legs => self.legs(&starts, &ARENA, &mut rng),
                }
            }
        };
        if self.roles == Roles::Drawn {
            courses.shuffle(&mut streams.vehicle(0, Purpose::Role));
        }
        courses
    }

    fn of_team(&self, team: WeaveOf, rng: &mut impl Rng) -> Vec<Course> {
        let weave = |robot| Course::Weave(Weave { team, robot });
        let weaves: Vec<Course> = (1..=team.robots()).map(weave).collect();
        let starts: Vec<_> = weaves
            .iter()
            .map(|weave| weave.place_at(0.0))
            .map(|place| (place.position_m, place.heading_rad))
            .collect();
        match self.flight {
            Flight::Weave => weaves,
            Flight::Round => rounds(&starts),
            Flight::Legs => self.legs(&starts, &self.arena(&weaves), rng),
        }
    }

    fn legs(
        &self,
        starts: &[(Vector3<f64>, f64)],
        arena: &Arena,
        rng: &mut impl Rng,
    ) -> Vec<Course> {
        Legs::drawn(starts, arena, self.duration_s, rng)
            .into_iter()
            .map(Course::Legs)
            .collect()
    }
}

/// How far a team leaves the box around its starts (m).
const MARGIN_M: Vector3<f64> = Vector3::new(1.2, 1.2, 0.8);

/// A circle for each, around where it would have started: no two alike, and every other one the other way round.
fn rounds(starts: &[(Vector3<f64>, f64)]) -> Vec<Course> {
    let round = |(index, (start, heading_rad)): (usize, &(Vector3<f64>, f64))| {
        let sense = if index % 2 == 0 { 1.0 } else { -1.0 };
        Course::Round(Round {
            centre_m: (*start).into(),
            radius_m: 0.7 + 0.15 * (index % 3) as f64,
            rate_rad_s: sense * (0.75 + 0.08 * (index % 5) as f64),
            phase_rad: heading_rad.rem_euclid(TAU),
            wave_m: 0.2 + 0.1 * (index % 4) as f64,
        })
    };
    starts.iter().enumerate().map(round).collect()
}

/// Places and headings at random, not too near to each other.
fn scattered(robots: usize, rng: &mut impl Rng) -> Vec<(Vector3<f64>, f64)> {
    let mut starts: Vec<(Vector3<f64>, f64)> = Vec::new();
    for _ in 0..robots {
        let free = (0..TRIES_MAX).map(|_| ARENA.any(rng)).find(|place| {
            starts
                .iter()
                .all(|(other, _)| (place - other).norm() > APART_M)
        });
        let place = free.unwrap_or_else(|| ARENA.any(rng));
        starts.push((place, rng.random_range(0.0..TAU)));
    }
    starts
}
