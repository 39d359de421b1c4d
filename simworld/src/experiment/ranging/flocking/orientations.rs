//! Which way its neighbours look, as each robot of a swarm finds out by distances and the odometry of both (Cornejo &
//! Nagpal, Algorithm 1).

use crate::experiment::ranging::reckoning;
use crate::planar_swarm::PlanarSwarm;
use serde::Serialize;
use skein_estimation::ranging::neighbour::NeighbourSettings;
use skein_estimation::ranging::window::{Starts, WindowSettings};
use skein_estimation::ranging::{LevelOdometry, Neighbour, RangeSample, Window};
use skein_estimation::time::{Span, Stamp};

/// What makes orientations of distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Algorithm 1: what fits the newest so many distances best. It takes four to be unique, three to be solved at all;
    /// of fewer nothing follows.
    Windows(usize),
    /// What the daemon follows a neighbour with, whether or not it calls the place known.
    Follower,
}

/// What one robot knows of another.
#[derive(Clone, Debug)]
enum Known {
    Window(Box<Window>, usize),
    Follower(Box<Neighbour>),
}

/// What all robots know of all others.
#[derive(Clone, Debug)]
pub struct Orientations {
    source: Source,
    round: i64,
    odometry: Vec<LevelOdometry>,
    /// By observer, then by robot.
    known: Vec<Vec<Known>>,
}

/// The least standard deviations that are told: of a distance (m), of a move (m), of a turn (rad).
const TOLD_MIN: (f64, f64, f64) = (1e-3, 1e-4, 1e-5);

impl Orientations {
    /// Of robots that know nothing yet.
    #[must_use]
    pub fn new(source: Source, robots: usize) -> Self {
        Self {
            source,
            round: 0,
            odometry: vec![reckoning::begun(); robots],
            known: vec![vec![Known::nothing(source); robots]; robots],
        }
    }

    /// Takes in a round: what each robot's odometry says, and how far it is from whomever it hears. Before the first
    /// move there is a round as well.
    pub fn observe(&mut self, swarm: &mut PlanarSwarm) {
        let noise = swarm.settings().noise;
        for (robot, odometry) in self.odometry.iter_mut().enumerate() {
            let moved = swarm.odometry(robot);
            let sigmas = (
                noise.rotation_sigma_rad.max(TOLD_MIN.2),
                noise.translation_sigma_m.max(TOLD_MIN.1),
            );
            let moved_m = moved.translation_m.push(0.0);
            *odometry = reckoning::after(odometry, &moved_m, moved.rotation_rad, sigmas);
        }
        let taken = Stamp::default() + Span::secs(self.round);
        for (observer, known) in self.known.iter_mut().enumerate() {
            for (robot, known) in known.iter_mut().enumerate() {
                let Some(range_m) = swarm.range_m(observer, robot) else {
                    *known = Known::nothing(self.source);
                    continue;
                };
                known.take(&RangeSample {
                    taken,
                    range_m,
                    sigma_m: noise.range_sigma_m.max(TOLD_MIN.0),
                    own: self.odometry[observer],
                    neighbour: self.odometry[robot],
                });
            }
        }
        self.round += 1;
    }

    /// The heading of `robot` less that of `observer`, as the observer estimates it (rad).
    #[must_use]
    pub fn relative_rad(&self, observer: usize, robot: usize) -> Option<f64> {
        match &self.known[observer][robot] {
            Known::Window(window, ranges) => {
                let is_full = window.len() >= *ranges;
                let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
                let best = modes.best().filter(|_| is_full);
                best.map(|best| best.pose.yaw_rad)
            }
            Known::Follower(follower) => {
                let best = follower.estimate().best;
                best.map(|best| best.pose.yaw_rad)
            }
        }
    }
}

impl Known {
    fn nothing(source: Source) -> Self {
        match source {
            Source::Windows(ranges) => Self::Window(Box::default(), ranges),
            Source::Follower => Self::Follower(Box::new(Neighbour::new(NeighbourSettings::PLANAR))),
        }
    }

    fn take(&mut self, sample: &RangeSample) {
        // A distance that is refused, of two that are within its noise of each other, changes nothing.
        match self {
            Self::Window(window, ranges) => {
                let _ = window.push(sample);
                window.keep_newest(*ranges);
            }
            Self::Follower(follower) => {
                let _ = follower.handle(sample);
            }
        }
    }
}
