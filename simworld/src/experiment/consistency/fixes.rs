//! Absolute fixes of one vehicle: a position of the world, at an antenna off its centre.

use super::history::{History, RawFix};
use nalgebra::Vector3;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use skein_estimation::Transform;
use skein_estimation::cooperative::team::Observation;
use skein_estimation::cooperative::{Measurement, Noise};

/// The antenna on the vehicle, metres.
const ANTENNA_M: Vector3<f64> = Vector3::new(0.2, 0.0, 0.1);
/// Standard deviation of a fix per axis, metres.
const SIGMA_M: f64 = 0.02;
/// Rounds from one fix to the next.
const EVERY: usize = 5;

/// Gives a vehicle a fix every second, none before round `from`.
pub fn add(history: &mut History, vehicle: usize, from: usize, rng: &mut impl Rng) {
    let every_second = (EVERY..=history.last()).step_by(EVERY);
    for k in every_second.filter(|k| *k >= from) {
        let antenna = history.true_pose(k, vehicle).transform_point(&ANTENNA_M);
        let mut noise = || -> f64 { StandardNormal.sample(rng) };
        let noise = Vector3::new(noise(), noise(), noise()) * SIGMA_M;
        history.rounds[k].fixes.push(RawFix {
            of: vehicle,
            observation: Observation {
                measurement: Measurement::position(antenna + noise).expect("finite and in range"),
                noise: Noise {
                    rotation_rad: 0.0,
                    translation: SIGMA_M,
                },
                from_end: Transform::identity(),
                to_end: Transform::new(nalgebra::UnitQuaternion::identity(), ANTENNA_M),
            },
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::consistency::history;
    use crate::scenario::Scenario;
    use crate::streams::{Purpose, Streams};
    use crate::world::World;

    #[test]
    fn from_a_round_on_one_vehicle_is_told_every_second_where_its_antenna_is() {
        let scenario = Scenario::built_in("section-v").unwrap();
        let mut history = history::record(&mut World::new(&scenario, 0)).unwrap();
        add(
            &mut history,
            2,
            20,
            &mut Streams::new(1, 0).vehicle(2, Purpose::Fix),
        );
        let mut squares = 0.0;
        for (k, round) in history.rounds.iter().enumerate() {
            assert_eq!(round.fixes.len(), usize::from(k >= 20 && k % 5 == 0));
            for fix in &round.fixes {
                let Measurement::Position(place) = fix.observation.measurement else {
                    panic!("a position");
                };
                let antenna = history.true_pose(k, 2).transform_point(&ANTENNA_M);
                squares += (place.vector() - antenna).norm_squared();
                assert_eq!(fix.of, 2);
            }
        }
        let sigma_m = (squares / 51.0).sqrt();
        assert!((sigma_m / SIGMA_M - 1.0).abs() < 0.3, "{sigma_m}");
    }
}
