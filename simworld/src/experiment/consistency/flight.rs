//! A history flown again by the team estimator of one vehicle, with what it hears of the others.

use super::hearing::Hearing;
use super::history::{History, RawSighting, id};
use skein_estimation::cooperative::Team;
use skein_estimation::cooperative::team::{PoseEstimate, Settings, Statistics};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Transform, World};
use std::collections::BTreeSet;

/// Standard deviation of a known start, rad and m: as good as exact.
const START_SIGMA: f64 = 1e-4;

/// What one vehicle hears in each round, oldest first.
#[derive(Clone, Debug)]
pub struct Heard {
    /// The vehicle.
    pub own: usize,
    /// By the round in which it is heard.
    pub rounds: Vec<HeardRound>,
}

/// What is heard in one round.
#[derive(Clone, Debug, Default)]
pub struct HeardRound {
    /// Odometry: the round and the vehicle.
    pub moments: Vec<(usize, usize)>,
    /// Measurements whose ends are both heard by now: the round and the place in its list.
    pub sightings: Vec<(usize, usize)>,
    /// Absolute fixes, so.
    pub fixes: Vec<(usize, usize)>,
}

impl Heard {
    /// What `own` hears of a flight.
    #[must_use]
    pub fn new(history: &History, hearing: &Hearing, own: usize) -> Self {
        let mut rounds = vec![HeardRound::default(); history.rounds.len()];
        for (k, round) in history.rounds.iter().enumerate() {
            let arrival = |vehicle: usize| hearing.arrival(own, vehicle, k);
            for vehicle in 0..history.team() {
                if let Some(at) = arrival(vehicle) {
                    rounds[at].moments.push((k, vehicle));
                }
            }
            for (nth, sighting) in round.sightings.iter().enumerate() {
                if let (Some(from), Some(to)) = (arrival(sighting.from), arrival(sighting.to)) {
                    rounds[from.max(to)].sightings.push((k, nth));
                }
            }
            for (nth, fix) in round.fixes.iter().enumerate() {
                if let Some(at) = arrival(fix.of) {
                    rounds[at].fixes.push((k, nth));
                }
            }
        }
        Self { own, rounds }
    }
}

/// How a flight went.
#[derive(Clone, Debug)]
pub struct Flight {
    /// After each round.
    pub rounds: Vec<Estimates>,
    /// Rounds that could not be solved, and quarantines.
    pub statistics: Statistics,
    /// Who was ever put into quarantine, or whose odometry was taken for a lie.
    pub accused: BTreeSet<usize>,
}

/// What is thought after a round.
#[derive(Clone, Debug)]
pub struct Estimates {
    /// Of the vehicle itself, if the round could be solved.
    pub own: Option<PoseEstimate>,
    /// Of everybody: at the last instant heard.
    pub team: Vec<(Stamp, Transform<World, Body>)>,
}

/// Flies. Of the measurements only those that `is_told`.
#[must_use]
pub fn fly(
    history: &History,
    heard: &Heard,
    settings: Settings,
    period: Span,
    is_told: impl Fn(&RawSighting) -> bool,
) -> Flight {
    let mut team = Team::new(id(heard.own), period, settings);
    let mut flight = Flight {
        rounds: Vec::new(),
        statistics: Statistics::default(),
        accused: BTreeSet::new(),
    };
    for (now, round) in heard.rounds.iter().enumerate() {
        for &(k, vehicle) in &round.moments {
            let moment = &history.rounds[k].moments[vehicle];
            if k == 0 {
                team.start(
                    moment,
                    moment,
                    &history.starts[vehicle],
                    START_SIGMA,
                    START_SIGMA,
                )
                .expect("a start at the start");
            } else {
                // Too late for the window, at worst: that is what is studied.
                let _ = team.heard(moment);
            }
        }
        for &(k, nth) in &round.sightings {
            let raw = &history.rounds[k];
            let sighting = &raw.sightings[nth];
            if is_told(sighting) {
                let (from, to) = (&raw.moments[sighting.from], &raw.moments[sighting.to]);
                let _ = team.measured(from, to, &sighting.observation);
            }
        }
        for &(k, nth) in &round.fixes {
            let raw = &history.rounds[k];
            let fix = &raw.fixes[nth];
            let _ = team.fixed(&raw.moments[fix.of], 0, &fix.observation);
        }
        team.solve();
        let instant = history.rounds[now].moments[heard.own].instant;
        let poses = (0..history.team()).map(|vehicle| {
            team.world_from(id(vehicle))
                .expect("everybody's start is known")
        });
        flight.rounds.push(Estimates {
            own: team.own().filter(|own| own.instant == instant).copied(),
            team: poses.collect(),
        });
        for vehicle in 0..history.team() {
            let is_accused = team
                .member(id(vehicle))
                .is_some_and(|member| member.quarantined || member.odometry_lies);
            if is_accused {
                flight.accused.insert(vehicle);
            }
        }
    }
    flight.statistics = team.statistics();
    flight
}
