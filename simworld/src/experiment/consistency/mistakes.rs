//! Measurements that are not so: what a history looks like when sensors err. Every one is marked, so that a bound can do
//! without.

use super::history::{History, RawSighting};
use nalgebra::Vector3;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, UnitBall, UnitSphere};
use skein_estimation::cooperative::{Measurement, Noise};
use skein_estimation::{Transform, so3};
use std::collections::BTreeMap;
use std::ops::Range;

/// The sensing range, metres, within which a gross mistake puts its target.
const RANGE_M: f64 = 7.0;
/// Standard deviations of a moderate mistake.
const DEVIATIONS: Range<f64> = 3.0..10.0;
/// Rounds that one edge is wrong in a row.
const BURST_ROUNDS: usize = 10;
/// By how much it is displaced, metres.
const BURST_M: f64 = 0.5;
/// By how much it is turned, if it is a bearing or an orientation, radians.
const BURST_RAD: f64 = 0.5;

/// Anything in range, in the place of so large a share of all measurements.
pub fn gross(history: &mut History, share: f64, rng: &mut impl Rng) {
    each(history, share, rng, |sighting, rng| {
        let direction: [f64; 3] = UnitSphere.sample(rng);
        let angle_rad = rng.random_range(0.0..std::f64::consts::PI);
        let rotation = so3::exp(&(Vector3::from(direction) * angle_rad));
        let place: [f64; 3] = UnitBall.sample(rng);
        let place = Vector3::from(place) * RANGE_M;
        let towards = place
            .try_normalize(f64::MIN_POSITIVE)
            .unwrap_or_else(Vector3::x);
        match sighting.observation.measurement {
            Measurement::Pose(_) => Measurement::pose(Transform::new(rotation, place)),
            Measurement::Orientation(_) => Measurement::orientation(rotation),
            Measurement::Position(_) => Measurement::position(place),
            Measurement::Bearing(_) => Measurement::bearing(towards),
            Measurement::Distance(_) => Measurement::distance(place.norm()),
        }
        .expect("finite and in range")
    });
}

/// Off by some standard deviations of the stated noise: so large a share of all measurements.
pub fn moderate(history: &mut History, share: f64, rng: &mut impl Rng) {
    each(history, share, rng, |sighting, rng| {
        let mut deviations = || {
            let direction: [f64; 3] = UnitSphere.sample(rng);
            Vector3::from(direction) * rng.random_range(DEVIATIONS)
        };
        let (turn, shift) = (deviations(), deviations());
        let Noise {
            rotation_rad,
            translation,
        } = sighting.observation.noise;
        displaced(
            &sighting.observation.measurement,
            &(turn * rotation_rad),
            &(shift * translation),
        )
    });
}

/// One vehicle's measurements of one other are off by one and the same error, for ten rounds of the second half.
pub fn burst(history: &mut History, rng: &mut impl Rng) {
    let first = history.last() / 2;
    let begins =
        rng.random_range(first..history.last().saturating_sub(BURST_ROUNDS).max(first + 1));
    let window = begins..(begins + BURST_ROUNDS).min(history.rounds.len());
    let mut edges: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for sighting in history.rounds[window]
        .iter()
        .flat_map(|round| &round.sightings)
    {
        *edges.entry((sighting.from, sighting.to)).or_default() += 1;
    }
    // Who is hardly seen makes no burst.
    edges.retain(|_, times| 2 * *times >= BURST_ROUNDS);
    let edges: Vec<(usize, usize)> = edges.into_keys().collect();
    if edges.is_empty() {
        return;
    }
    let (from, to) = edges[rng.random_range(0..edges.len())];
    let mut towards = |length: f64| {
        let direction: [f64; 3] = UnitSphere.sample(rng);
        Vector3::from(direction) * length
    };
    let (turn, shift) = (towards(BURST_RAD), towards(BURST_M));
    let rounds = history.rounds.iter_mut().skip(begins).take(BURST_ROUNDS);
    for sighting in rounds.flat_map(|round| &mut round.sightings) {
        if (sighting.from, sighting.to) == (from, to) {
            // A pose keeps its rotation: a wrong place alone is harder to find.
            let turn = match sighting.observation.measurement {
                Measurement::Pose(_) => Vector3::zeros(),
                _ => turn,
            };
            mistake(sighting, &turn, &shift);
        }
    }
}

/// Everything that one vehicle measures in these rounds is displaced by this, in its sensor's frame, metres.
pub fn displaced_sensor(
    history: &mut History,
    vehicle: usize,
    rounds: Range<usize>,
    shift: &Vector3<f64>,
) {
    for (_, round) in (0..)
        .zip(&mut history.rounds)
        .filter(|(k, _)| rounds.contains(k))
    {
        for sighting in &mut round.sightings {
            if sighting.from == vehicle {
                mistake(sighting, &Vector3::zeros(), shift);
            }
        }
    }
}

fn mistake(sighting: &mut RawSighting, turn: &Vector3<f64>, shift: &Vector3<f64>) {
    sighting.observation.measurement = displaced(&sighting.observation.measurement, turn, shift);
    sighting.is_wrong = true;
}

/// Makes a share of all measurements wrong. As many numbers are drawn for a right one as for the choice alone.
fn each<R: Rng>(
    history: &mut History,
    share: f64,
    rng: &mut R,
    wrong: impl Fn(&RawSighting, &mut R) -> Measurement,
) {
    let sightings = history.rounds.iter_mut();
    for sighting in sightings.flat_map(|round| &mut round.sightings) {
        if rng.random::<f64>() < share {
            sighting.observation.measurement = wrong(sighting, rng);
            sighting.is_wrong = true;
        }
    }
}

/// A measurement turned and shifted, each part as far as its kind tells it.
fn displaced(measurement: &Measurement, turn: &Vector3<f64>, shift: &Vector3<f64>) -> Measurement {
    let turned = so3::exp(turn);
    match measurement {
        Measurement::Pose(pose) => {
            let pose = pose.relative();
            let rotation = pose.rotation * turned;
            Measurement::pose(Transform::new(rotation, pose.translation + shift))
        }
        Measurement::Orientation(orientation) => {
            Measurement::orientation(orientation.rotation() * turned)
        }
        Measurement::Position(position) => Measurement::position(position.vector() + shift),
        Measurement::Bearing(bearing) => Measurement::bearing(turned * bearing.direction()),
        // The sign of a component of a random direction is a fair coin.
        Measurement::Distance(distance) => {
            let wrong_m = distance.metres() + shift.norm() * shift.x.signum();
            Measurement::distance(wrong_m.abs())
        }
    }
    .expect("finite and in range")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::consistency::history;
    use crate::scenario::Scenario;
    use crate::streams::{Purpose, Streams};
    use crate::world::World;

    fn clean() -> History {
        let scenario = Scenario::built_in("section-v").unwrap();
        history::record(&mut World::new(&scenario, 0)).unwrap()
    }

    fn changed(history: &History) -> Vec<(usize, f64, f64, bool)> {
        let clean = clean();
        let rounds = history.rounds.iter().zip(&clean.rounds).enumerate();
        let pairs = rounds.flat_map(|(k, (round, clean))| {
            let pairs = round.sightings.iter().zip(&clean.sightings);
            pairs.map(move |pair| (k, pair))
        });
        pairs
            .map(|(k, (sighting, clean))| {
                let (Measurement::Pose(pose), Measurement::Pose(clean)) = (
                    &sighting.observation.measurement,
                    &clean.observation.measurement,
                ) else {
                    panic!("section V measures poses");
                };
                let apart = clean.relative().inverse() * pose.relative();
                let shift = pose.relative().translation - clean.relative().translation;
                (k, apart.rotation.angle(), shift.norm(), sighting.is_wrong)
            })
            .collect()
    }

    fn rng() -> rand_chacha::ChaCha8Rng {
        Streams::new(1, 0).vehicle(0, Purpose::Outlier)
    }

    #[test]
    fn one_measurement_in_five_is_wrong_and_marked_and_the_others_are_untouched() {
        type Wrong = fn(&mut History, f64, &mut rand_chacha::ChaCha8Rng);
        for wrong in [gross as Wrong, moderate] {
            let mut history = clean();
            wrong(&mut history, 0.2, &mut rng());
            let changed = changed(&history);
            let marked = changed.iter().filter(|(.., is_wrong)| *is_wrong).count() as f64;
            assert!((marked / changed.len() as f64 - 0.2).abs() < 0.04);
            for (_, angle_rad, shift_m, is_wrong) in changed {
                assert_eq!(is_wrong, angle_rad > 1e-6 || shift_m > 1e-9);
            }
        }
    }

    #[test]
    fn a_moderate_mistake_is_three_to_ten_standard_deviations() {
        let mut history = clean();
        moderate(&mut history, 1.0, &mut rng());
        for (_, angle_rad, shift_m, _) in changed(&history) {
            assert!((0.0599..0.2001).contains(&angle_rad), "{angle_rad}");
            assert!((0.00299..0.01001).contains(&shift_m), "{shift_m}");
        }
    }

    #[test]
    fn a_burst_is_one_edge_half_a_metre_off_for_ten_rounds() {
        let mut history = clean();
        burst(&mut history, &mut rng());
        let sightings = || history.rounds.iter().flat_map(|round| &round.sightings);
        let wrong: Vec<_> = sightings().filter(|sighting| sighting.is_wrong).collect();
        assert!((5..=10).contains(&wrong.len()), "{}", wrong.len());
        let edge = |sighting: &RawSighting| (sighting.from, sighting.to);
        assert!(
            wrong
                .iter()
                .all(|sighting| edge(sighting) == edge(wrong[0]))
        );
        let wrong: Vec<_> = changed(&history)
            .into_iter()
            .filter(|(.., is_wrong)| *is_wrong)
            .collect();
        assert!(wrong[0].0 >= 50 && wrong[wrong.len() - 1].0 - wrong[0].0 < 10);
        for (_, angle_rad, shift_m, _) in wrong {
            assert!(angle_rad < 1e-6 && (shift_m - 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn a_displaced_sensor_is_wrong_in_its_rounds_and_of_everybody() {
        let mut history = clean();
        displaced_sensor(&mut history, 1, 30..60, &Vector3::x());
        for (k, round) in history.rounds.iter().enumerate() {
            for sighting in &round.sightings {
                let expected = sighting.from == 1 && (30..60).contains(&k);
                assert_eq!(sighting.is_wrong, expected);
            }
        }
    }
}
