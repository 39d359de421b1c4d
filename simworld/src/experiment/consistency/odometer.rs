//! Odometry that is not as it should be: biased, lying, or with noise that is not white. What it states stays.

use super::history::History;
use nalgebra::{Vector3, Vector6};
use skein_estimation::{Body, Transform, se3, so3};

/// Everybody's odometer tells so much too little or too much, and everybody's gyroscope turns so much about its
/// vertical axis each round, radians; neighbours with opposite signs.
pub fn bias(history: &mut History, scale: f64, gyro_rad: f64) {
    bend(history, |vehicle, _, step| {
        let sign = if vehicle % 2 == 0 { 1.0 } else { -1.0 };
        let turn = so3::exp(&Vector3::new(0.0, 0.0, gyro_rad * sign));
        Transform::new(
            step.rotation * turn,
            step.translation * (1.0 + scale * sign),
        )
    });
}

/// The odometry of one vehicle tells so many times the motion, turns and all.
pub fn exaggerate(history: &mut History, liar: usize, times: f64) {
    bend(history, |vehicle, _, step| {
        if vehicle == liar {
            se3::exp(&(se3::log(&step) * times))
        } else {
            step
        }
    });
}

/// Everybody's noise of one round is `correlation` of that of the round before and new noise, as large as it was when it
/// was white.
pub fn correlate(history: &mut History, correlation: f64) {
    let truth = history.clone();
    let mut noise = vec![Vector6::zeros(); history.team()];
    let fresh = (1.0 - correlation * correlation).sqrt();
    bend(history, |vehicle, k, step| {
        let true_step: Transform<Body, Body> =
            truth.true_pose(k - 1, vehicle).inverse() * truth.true_pose(k, vehicle);
        let white = se3::log(&(true_step.inverse() * step));
        noise[vehicle] = noise[vehicle] * correlation + white * fresh;
        true_step * se3::exp(&noise[vehicle])
    });
}

/// Everything states so many times the noise that it has: odometry, measurements and fixes.
pub fn misstate(history: &mut History, times: f64) {
    restate(history, times);
    for round in &mut history.rounds {
        let measured = round.sightings.iter_mut();
        let measured = measured.map(|sighting| &mut sighting.observation);
        let fixed = round.fixes.iter_mut().map(|fix| &mut fix.observation);
        for observation in measured.chain(fixed) {
            observation.noise.rotation_rad *= times;
            observation.noise.translation *= times;
        }
    }
}

/// Everybody's odometry states so many times the noise that it did.
pub fn restate(history: &mut History, times: f64) {
    for moment in history
        .rounds
        .iter_mut()
        .flat_map(|round| &mut round.moments)
    {
        moment.point.growth = moment.point.growth.scaled(times * times, times * times);
    }
}

/// Puts together everybody's odometry anew from steps that are changed by `change`, given the vehicle and the round at
/// the step's end.
fn bend(
    history: &mut History,
    mut change: impl FnMut(usize, usize, Transform<Body, Body>) -> Transform<Body, Body>,
) {
    for vehicle in 0..history.team() {
        let mut raw_before = history.rounds[0].moments[vehicle].point;
        let mut before = raw_before;
        for k in 1..history.rounds.len() {
            let point = &mut history.rounds[k].moments[vehicle].point;
            let raw = *point;
            let step = raw_before.odometry_from_body.inverse() * raw.odometry_from_body;
            let noise = raw.growth.since(&raw_before.growth);
            point.odometry_from_body = before.odometry_from_body * change(vehicle, k, step);
            point.growth = before.growth.after(
                &point.odometry_from_body.translation,
                noise.rotation.sqrt(),
                noise.translation.sqrt(),
            );
            (raw_before, before) = (raw, *point);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::consistency::history;
    use crate::scenario::Scenario;
    use crate::world::World;

    fn clean(sample: u64) -> History {
        let scenario = Scenario::built_in("section-v").unwrap();
        history::record(&mut World::new(&scenario, sample)).unwrap()
    }

    #[test]
    fn a_bias_changes_every_step_by_as_much_and_nothing_that_is_stated() {
        let (clean, mut biased) = (clean(0), clean(0));
        bias(&mut biased, 0.02, 0.002);
        for k in 1..=clean.last() {
            for vehicle in 0..5 {
                let sign = if vehicle % 2 == 0 { 1.0 } else { -1.0 };
                let (was, is) = (
                    clean.step(vehicle, k - 1, k),
                    biased.step(vehicle, k - 1, k),
                );
                let turn = so3::log(&(was.rotation.inverse() * is.rotation));
                assert!((turn - Vector3::z() * (0.002 * sign)).norm() < 1e-9);
                let moved = is.translation - was.translation * (1.0 + 0.02 * sign);
                assert!(moved.norm() < 1e-9);
                let growth = |history: &History| {
                    let growth = &history.rounds[k].moments[vehicle].point.growth;
                    (growth.rotation, growth.translation)
                };
                assert!((growth(&clean).0 - growth(&biased).0).abs() < 1e-12);
                assert!((growth(&clean).1 - growth(&biased).1).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn only_the_liar_exaggerates() {
        let (clean, mut bent) = (clean(0), clean(0));
        exaggerate(&mut bent, 1, 1.1);
        let norms = |history: &History, vehicle| se3::log(&history.step(vehicle, 6, 7)).norm();
        assert!((norms(&bent, 1) / norms(&clean, 1) - 1.1).abs() < 1e-9);
        assert!((norms(&bent, 0) / norms(&clean, 0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn correlated_noise_is_as_large_as_white_noise_and_looks_like_that_of_the_round_before() {
        let (mut own, mut with_next, mut white) = (0.0, 0.0, 0.0);
        for sample in 0..4 {
            let mut history = clean(sample);
            let noise = |history: &History, k: usize| {
                let true_step: Transform<Body, Body> =
                    history.true_pose(k - 1, 0).inverse() * history.true_pose(k, 0);
                se3::log(&(true_step.inverse() * history.step(0, k - 1, k)))
            };
            // Noise that begins with none is white noise's size after some rounds.
            let sum_white = |history: &History| -> f64 {
                (20..100).map(|k| noise(history, k).norm_squared()).sum()
            };
            white += sum_white(&history);
            correlate(&mut history, 0.8);
            own += sum_white(&history);
            with_next += (20..100)
                .map(|k| noise(&history, k).dot(&noise(&history, k + 1)))
                .sum::<f64>();
        }
        assert!((own / white - 1.0).abs() < 0.2, "{}", own / white);
        assert!((with_next / own - 0.8).abs() < 0.1, "{}", with_next / own);
    }

    #[test]
    fn twice_the_noise_is_stated_of_everything() {
        let (clean, mut misstated) = (clean(0), clean(0));
        misstate(&mut misstated, 2.0);
        let (was, is) = (&clean.rounds[9], &misstated.rounds[9]);
        let variance = |round: &history::RawRound| round.moments[0].point.growth.rotation;
        assert!((variance(is) / variance(was) - 4.0).abs() < 1e-9);
        let sigma = |round: &history::RawRound| round.sightings[0].observation.noise.translation;
        assert!((sigma(is) / sigma(was) - 2.0).abs() < 1e-9);
    }
}
