//! Anonymous mutual localisation, the published way and ours: who is where after how long, how often it is the wrong
//! one, and how far it is off (Cognetti et al., figures 5 to 9), over many flights.
//!
//! A [`case`] says what is flown. Each talking vehicle makes its feature sets of what its sensors say ([`telling`]); every
//! [`method`] hears the same sets ([`flight`]) and is scored by the truth ([`score`]).

pub mod case;
pub mod figures;
pub mod flight;
pub mod method;
pub mod report;
pub mod score;
pub mod telling;

use self::case::Case;
use self::flight::{Flown, Moment, Snapshot};
use self::method::Method;
use self::score::{FlightScore, Scores};
use self::telling::Telling;
use crate::mutual_world::MutualWorld;
use rayon::prelude::*;
use serde::Serialize;

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Request {
    /// Samples of every case.
    pub samples: u64,
    /// Seed of all random streams. Every method flies the same samples.
    pub seed: u64,
    /// Who estimates.
    pub methods: Vec<Method>,
}

/// One case flown by one method: one object of the JSON output.
#[derive(Clone, Debug, Serialize)]
pub struct CellResult {
    /// What was flown.
    pub case: &'static str,
    /// Who estimated.
    pub method: Method,
    /// How many samples.
    pub samples: u64,
    /// The seed.
    pub seed: u64,
    /// How it went.
    #[serde(flatten)]
    pub scores: Scores,
    /// `[flight][neighbour][image]`, for the curves.
    #[serde(skip)]
    pub flights: Vec<Vec<Vec<Moment>>>,
    /// Two instants of the first flight.
    #[serde(skip)]
    pub snapshots: Vec<Snapshot>,
    /// `[vehicle][image]`: seconds, roll error and pitch error (rad) in the first flight.
    #[serde(skip)]
    pub tilt: Vec<Vec<[f64; 3]>>,
}

/// Flies every sample of a case with every method. `flown` is called after each flight of a method, from any thread.
#[must_use]
pub fn run(case: &Case, request: &Request, flown: impl Fn() + Sync) -> Vec<CellResult> {
    let scenario = case.scenario(request.seed);
    let per_sample: Vec<(Telling, Vec<Flown>)> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let world = MutualWorld::new(&scenario, sample);
            let telling = Telling::of(&world);
            let fly = |method: &Method| {
                let result = flight::fly(&world, &telling, *method, sample);
                flown();
                result
            };
            let flights = request.methods.iter().map(fly).collect();
            // Only the first one is drawn; the sets of all would be a lot to keep.
            let kept = if sample == 0 {
                telling
            } else {
                telling.without_sets()
            };
            (kept, flights)
        })
        .collect();
    let cell = |(index, method): (usize, &Method)| {
        let flights = || per_sample.iter().map(|(_, flights)| &flights[index]);
        let scores: Vec<FlightScore> = per_sample
            .iter()
            .map(|(telling, flights)| FlightScore::of(&flights[index], telling))
            .collect();
        CellResult {
            case: case.name,
            method: *method,
            samples: request.samples,
            seed: request.seed,
            scores: Scores::of(&scores, request.seed),
            flights: flights().map(|flown| flown.moments.clone()).collect(),
            snapshots: flights()
                .next()
                .map(|flown| flown.snapshots.clone())
                .unwrap_or_default(),
            tilt: per_sample
                .first()
                .map(|(telling, _)| telling.tilt.clone())
                .unwrap_or_default(),
        }
    };
    request.methods.iter().enumerate().map(cell).collect()
}

#[cfg(test)]
mod tests;
