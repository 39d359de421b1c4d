//! How a method did, in numbers with their standard errors. Flights are independent of each other; neighbours of one
//! flight are not, so every spread is one over flights.

use super::flight::{Error, Flown, Identities, Moment};
use super::telling::Telling;
use crate::streams::{Purpose, Streams};
use rand::RngExt;
use serde::Serialize;

/// An estimate is of the wrong mode when its direction or its yaw is off by more than this (rad): 20 degrees.
const WRONG_RAD: f64 = 0.35;
/// A distance is found when it is off by less than this part...
const FOUND: f64 = 0.1;
/// ...for so many images in a row (1 s).
const FOUND_FOR: usize = 20;
/// From when on errors are averaged and identities counted (s).
pub const STEADY_FROM_S: f64 = 20.0;
/// Draws of the bootstrap by which quantiles get their standard error.
const DRAWS: usize = 400;

/// Whether an estimate is of the right mode.
fn is_right(error: &Error) -> bool {
    error.bearing_rad <= WRONG_RAD && error.yaw_rad.abs() <= WRONG_RAD
}

/// One neighbour of one flight.
#[derive(Clone, Debug, Default, PartialEq)]
struct NeighbourScore {
    lock_s: Option<f64>,
    found_s: Option<f64>,
    published: usize,
    wrong: usize,
    /// Published, from [`STEADY_FROM_S`] on.
    steady_published: usize,
    steady: usize,
    right_at_end: bool,
    wrong_at_end: bool,
    /// Published, right and steady: azimuth, zenith distance and yaw (rad), distance.
    errors: Vec<[f64; 4]>,
    /// The same of whatever place is held, steady, published and right or not.
    held: Vec<[f64; 4]>,
    /// How many of those are of the wrong mode.
    held_wrong: usize,
    /// Published, right or not, and steady: normalised squared errors, where a covariance is told.
    nees: Vec<f64>,
}

/// One flight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlightScore {
    neighbours: Vec<NeighbourScore>,
    identities: Identities,
    /// Mean of the absolute errors of roll and of pitch over all vehicles (rad).
    tilt_rad: [f64; 2],
}

impl FlightScore {
    /// The score of a flight.
    #[must_use]
    pub fn of(flown: &Flown, telling: &Telling) -> Self {
        let tilts = telling.tilt.iter().flatten();
        let count = tilts.clone().count().max(1) as f64;
        let mean = |axis: usize| tilts.clone().map(|tilt| tilt[axis].abs()).sum::<f64>() / count;
        Self {
            neighbours: flown
                .moments
                .iter()
                .map(|moments| neighbour(moments))
                .collect(),
            identities: flown.identities,
            tilt_rad: [mean(1), mean(2)],
        }
    }
}

fn neighbour(moments: &[Moment]) -> NeighbourScore {
    let mut score = NeighbourScore::default();
    let mut found_for = 0;
    for moment in moments {
        let published = moment.error.filter(|_| moment.published);
        let right = published.filter(is_right);
        let steady = moment.taken_s >= STEADY_FROM_S;
        score.published += usize::from(published.is_some());
        score.wrong += usize::from(published.is_some() && right.is_none());
        score.steady += usize::from(steady);
        score.steady_published += usize::from(steady && published.is_some());
        score.right_at_end = right.is_some();
        score.wrong_at_end = published.is_some() && right.is_none();
        let near = right.is_some_and(|error| error.distance.abs() < FOUND);
        found_for = if near { found_for + 1 } else { 0 };
        if found_for == FOUND_FOR && score.found_s.is_none() {
            let since = moments
                .iter()
                .filter(|other| other.taken_s <= moment.taken_s);
            score.found_s = since.rev().nth(FOUND_FOR - 1).map(|first| first.taken_s);
        }
        if steady && published.is_some() {
            score.nees.extend(moment.nees);
        }
        if let Some(error) = moment.error.filter(|_| steady) {
            score.held.push(numbers(&error));
            score.held_wrong += usize::from(!is_right(&error));
        }
        let Some(error) = right else { continue };
        score.lock_s.get_or_insert(moment.taken_s);
        if steady {
            score.errors.push(numbers(&error));
        }
    }
    score
}

/// Azimuth, zenith distance and yaw (rad), distance.
const fn numbers(error: &Error) -> [f64; 4] {
    [
        error.azimuth_rad,
        error.zenith_rad,
        error.yaw_rad,
        error.distance,
    ]
}

/// A number and its standard error over flights; no error of a single flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The number; none where there is nothing to count.
    pub value: Option<f64>,
    /// Its standard error.
    pub stderr: Option<f64>,
}

/// How all flights went.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// Neighbours of all flights together.
    pub neighbours: usize,
    /// Median of the time at which a neighbour is first said to be where it is, within 20 degrees (s); none when half of
    /// them never were.
    pub lock_median_s: Estimate,
    /// The time by which nine of ten are.
    pub lock_p90_s: Estimate,
    /// Median of the time from which on the distance is within 10 % for a second (s).
    pub found_median_s: Estimate,
    /// Neighbours of which it never was.
    pub never_found: usize,
    /// Part of the published time in which the place is a wrong one.
    pub wrong_mode: Estimate,
    /// Neighbours that are said to be at a wrong place when the flight ends.
    pub wrong_at_end: usize,
    /// Neighbours of which nothing is said then.
    pub silent_at_end: usize,
    /// Part of the time from 20 s on in which a place is published.
    pub published: Estimate,
    /// Mean of |e| of the azimuth while a right place is published, from 20 s on, degrees.
    pub azimuth_deg: Estimate,
    /// The same of the zenith distance.
    pub zenith_deg: Estimate,
    /// The same of the relative yaw.
    pub yaw_deg: Estimate,
    /// The same of the distance, as a part of the true one.
    pub distance: Estimate,
    /// The mean of e of the distance.
    pub distance_bias: Estimate,
    /// RMSE of the azimuth, degrees.
    pub azimuth_rmse_deg: Estimate,
    /// RMSE of the relative yaw, degrees.
    pub yaw_rmse_deg: Estimate,
    /// RMSE of the distance.
    pub distance_rmse: Estimate,
    /// Mean of |e| of the azimuth of whatever place is held, published or not, right or not, from 20 s on, degrees.
    pub held_azimuth_deg: Estimate,
    /// The same of the zenith distance.
    pub held_zenith_deg: Estimate,
    /// The same of the relative yaw.
    pub held_yaw_deg: Estimate,
    /// The same of the distance, as a part of the true one.
    pub held_distance: Estimate,
    /// Part of that time in which the place is a wrong one.
    pub held_wrong_mode: Estimate,
    /// Mean of the normalised squared error of position, velocity and yaw per number of them while a place is published,
    /// right or not, from 20 s on: one when the covariance that is told is right; none where none is told.
    pub nees: Estimate,
    /// Part of the features of robots that talk of which the method is sure, and rightly.
    pub identified: Estimate,
    /// Part of the features that it is sure of that are another, or nobody.
    pub misidentified: Estimate,
    /// Mean of |e| of roll, all vehicles, degrees.
    pub roll_deg: Estimate,
    /// Mean of |e| of pitch, all vehicles, degrees.
    pub pitch_deg: Estimate,
}

impl Scores {
    /// Of all flights of a cell; the seed is the bootstrap's.
    #[must_use]
    pub fn of(flights: &[FlightScore], seed: u64) -> Self {
        let all = || flights.iter().flat_map(|flight| &flight.neighbours);
        let mean_abs = |index: usize, unit: f64| {
            over_flights(flights, |flight| {
                mean(errors(flight).map(|error| error[index].abs() * unit))
            })
        };
        let mean_held = |index: usize, unit: f64| {
            over_flights(flights, |flight| {
                let held = flight
                    .neighbours
                    .iter()
                    .flat_map(|neighbour| &neighbour.held);
                mean(held.map(|error| error[index].abs() * unit))
            })
        };
        let rmse = |index: usize, unit: f64| {
            let square = over_flights(flights, |flight| {
                mean(errors(flight).map(|error| (error[index] * unit).powi(2)))
            });
            let root = square.value.map(f64::sqrt);
            // sqrt(v) has the standard error of v over 2 sqrt(v).
            let stderr = square
                .stderr
                .zip(root)
                .map(|(stderr, root)| stderr / (2.0 * root));
            Estimate {
                value: root,
                stderr,
            }
        };
        let degree = 1_f64.to_degrees();
        let ratio = |part: fn(&FlightScore) -> usize, of: fn(&FlightScore) -> usize| {
            over_flights(flights, |flight| {
                let of = of(flight);
                (of > 0).then(|| part(flight) as f64 / of as f64)
            })
        };
        Self {
            neighbours: all().count(),
            lock_median_s: quantile(flights, 0.5, seed, |neighbour| neighbour.lock_s),
            lock_p90_s: quantile(flights, 0.9, seed, |neighbour| neighbour.lock_s),
            found_median_s: quantile(flights, 0.5, seed, |neighbour| neighbour.found_s),
            never_found: all()
                .filter(|neighbour| neighbour.found_s.is_none())
                .count(),
            wrong_mode: ratio(|f| sum(f, |n| n.wrong), |f| sum(f, |n| n.published)),
            wrong_at_end: all().filter(|neighbour| neighbour.wrong_at_end).count(),
            silent_at_end: all().filter(|n| !n.wrong_at_end && !n.right_at_end).count(),
            published: ratio(|f| sum(f, |n| n.steady_published), |f| sum(f, |n| n.steady)),
            azimuth_deg: mean_abs(0, degree),
            zenith_deg: mean_abs(1, degree),
            yaw_deg: mean_abs(2, degree),
            distance: mean_abs(3, 1.0),
            distance_bias: over_flights(flights, |flight| {
                mean(errors(flight).map(|error| error[3]))
            }),
            azimuth_rmse_deg: rmse(0, degree),
            yaw_rmse_deg: rmse(2, degree),
            distance_rmse: rmse(3, 1.0),
            held_azimuth_deg: mean_held(0, degree),
            held_zenith_deg: mean_held(1, degree),
            held_yaw_deg: mean_held(2, degree),
            held_distance: mean_held(3, 1.0),
            held_wrong_mode: ratio(|f| sum(f, |n| n.held_wrong), |f| sum(f, |n| n.held.len())),
            nees: over_flights(flights, |flight| {
                let of = flight
                    .neighbours
                    .iter()
                    .flat_map(|neighbour| &neighbour.nees);
                mean(of.copied())
            }),
            identified: ratio(
                |f| f.identities.sure - f.identities.wrong,
                |f| f.identities.possible,
            ),
            misidentified: ratio(|f| f.identities.wrong, |f| f.identities.sure),
            roll_deg: over_flights(flights, |flight| Some(flight.tilt_rad[0].to_degrees())),
            pitch_deg: over_flights(flights, |flight| Some(flight.tilt_rad[1].to_degrees())),
        }
    }
}

fn errors(flight: &FlightScore) -> impl Iterator<Item = &[f64; 4]> {
    flight
        .neighbours
        .iter()
        .flat_map(|neighbour| &neighbour.errors)
}

fn sum(flight: &FlightScore, of: fn(&NeighbourScore) -> usize) -> usize {
    flight.neighbours.iter().map(of).sum()
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0_usize, 0.0), |(count, sum), value| {
        (count + 1, sum + value)
    });
    (count > 0).then(|| sum / count as f64)
}

/// The mean of a flight's number over the flights that have one.
fn over_flights(flights: &[FlightScore], of: impl Fn(&FlightScore) -> Option<f64>) -> Estimate {
    let values: Vec<f64> = flights.iter().filter_map(of).collect();
    let n = values.len() as f64;
    let value = mean(values.iter().copied());
    let stderr = value.filter(|_| values.len() > 1).map(|mean| {
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        (squares / (n - 1.0) / n).sqrt()
    });
    Estimate { value, stderr }
}

/// The quantile of a time over all neighbours, those that never came to it counted as later than all others. Its
/// standard error is the spread of the same over flights drawn with replacement.
fn quantile(
    flights: &[FlightScore],
    part: f64,
    seed: u64,
    of: fn(&NeighbourScore) -> Option<f64>,
) -> Estimate {
    let of_all = |flights: &mut dyn Iterator<Item = &FlightScore>| {
        let mut times: Vec<f64> = flights
            .flat_map(|flight| &flight.neighbours)
            .map(|neighbour| of(neighbour).unwrap_or(f64::INFINITY))
            .collect();
        times.sort_by(f64::total_cmp);
        let index = (times.len().saturating_sub(1) as f64 * part).round() as usize;
        times.get(index).copied().filter(|time| time.is_finite())
    };
    let value = of_all(&mut flights.iter());
    let mut rng = Streams::new(seed, 0).vehicle(0, Purpose::Bootstrap);
    let draws: Option<Vec<f64>> = (0..DRAWS)
        .map(|_| {
            let drawn: Vec<&FlightScore> = flights
                .iter()
                .map(|_| &flights[rng.random_range(0..flights.len())])
                .collect();
            of_all(&mut drawn.into_iter())
        })
        .collect();
    let spread = |draws: Vec<f64>| {
        let n = draws.len() as f64;
        let mean = draws.iter().sum::<f64>() / n;
        (draws.iter().map(|draw| (draw - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()
    };
    // A quantile that is sometimes never reached has no spread.
    let stderr = draws.filter(|_| flights.len() > 1).map(spread);
    Estimate { value, stderr }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A neighbour that is published from `from` on, off by so much azimuth and distance.
    fn moments(from: usize, azimuth_rad: f64, distance: f64) -> Vec<Moment> {
        let moment = |image: usize| Moment {
            taken_s: 0.05 * image as f64,
            published: image >= from,
            error: (image >= from).then_some(Error {
                azimuth_rad,
                zenith_rad: 0.0,
                bearing_rad: azimuth_rad.abs(),
                distance,
                yaw_rad: 0.0,
            }),
            nees: (image >= from).then_some(distance.abs() * 10.0),
        };
        (0..1200).map(moment).collect()
    }

    fn flight(neighbours: &[Vec<Moment>]) -> FlightScore {
        let flown = Flown {
            moments: neighbours.to_vec(),
            ..Flown::default()
        };
        FlightScore::of(&flown, &Telling::default())
    }

    #[test]
    fn who_is_found_late_and_right_and_who_is_at_a_wrong_place_are_told_apart() {
        let flights = [
            flight(&[moments(100, 0.02, 0.05), moments(200, 1.0, 0.0)]),
            flight(&[moments(100, -0.04, -0.3), moments(300, 0.02, 0.05)]),
        ];
        let scores = Scores::of(&flights, 1);
        assert_eq!(scores.neighbours, 4);
        assert_eq!(scores.wrong_at_end, 1);
        assert_eq!(scores.silent_at_end, 0);
        // 5, 5 and 15 s, and never.
        assert_eq!(scores.lock_median_s.value, Some(15.0));
        assert_eq!(scores.lock_p90_s.value, None);
        assert_eq!(scores.never_found, 2);
        // Of the first flight 1000 of 2100 published moments are wrong, of the second none.
        let wrong = scores.wrong_mode.value.unwrap();
        assert!((wrong - 0.5 * 1000.0 / 2100.0).abs() < 1e-12);
        // A covariance is told of a wrong place too, and counts.
        let nees = scores.nees.value.unwrap();
        assert!((nees - 0.5 * (0.25 + 1.75)).abs() < 1e-9, "{nees}");
        // The wrong place counts for no error.
        let azimuth = scores.azimuth_deg.value.unwrap();
        assert!(
            (azimuth - 0.5 * (0.02_f64 + 0.03).to_degrees()).abs() < 1e-9,
            "{azimuth}"
        );
        let bias = scores.distance_bias.value.unwrap();
        assert!((bias - 0.5 * (0.05 - 0.125)).abs() < 1e-12);
        // But for what is held: half of the first flight is at the wrong place.
        assert_eq!(scores.held_wrong_mode.value, Some(0.25));
        let held = scores.held_azimuth_deg.value.unwrap();
        assert!((held - 0.5 * (0.51_f64 + 0.03).to_degrees()).abs() < 1e-9);
    }

    #[test]
    fn a_distance_is_found_when_it_begins_to_stay_right_for_a_second() {
        let mut flickering = moments(0, 0.0, 0.05);
        for image in (0..400).step_by(15) {
            flickering[image].error = flickering[image].error.map(|error| Error {
                distance: 0.2,
                ..error
            });
        }
        let score = neighbour(&flickering);
        assert_eq!(score.found_s, Some(flickering[391].taken_s));
    }

    #[test]
    fn a_mean_over_flights_has_the_spread_of_flights() {
        let flights: Vec<FlightScore> = [0.01, 0.02, 0.03]
            .iter()
            .map(|azimuth| flight(&[moments(0, *azimuth, 0.0)]))
            .collect();
        let azimuth = Scores::of(&flights, 1).azimuth_deg;
        let degree = 1_f64.to_degrees();
        assert!((azimuth.value.unwrap() - 0.02 * degree).abs() < 1e-12);
        assert!((azimuth.stderr.unwrap() - 0.01 / 3_f64.sqrt() * degree).abs() < 1e-12);
    }
}
