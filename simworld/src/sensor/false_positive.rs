//! What a sensor reports that is not so: grossly wrong measurements of real robots, and robots that do not exist.

use super::position;
use crate::bounded::probability;
use crate::streams::{Purpose, Streams};
use crate::truth::{self, Pose};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, UnitBall, UnitSphere};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// How a wrong measurement is wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Wrong {
    /// Anything in range: any rotation, anywhere in the ball of the sensing range.
    #[default]
    Gross,
    /// The truth, displaced by about 0.5 m and turned by about 0.2 rad per axis: harder to tell from a good one.
    Moderate,
}

impl Wrong {
    /// The wrong `sensor_from_target` that is measured in the place of the true one.
    pub(super) fn instead_of(
        self,
        sensor_from_target: &Pose,
        range_m: f64,
        rng: &mut impl Rng,
    ) -> Pose {
        match self {
            Self::Gross => {
                let place: [f64; 3] = UnitBall.sample(rng);
                truth::pose(any_rotation(rng), Vector3::from(place) * range_m)
            }
            Self::Moderate => {
                let turn = UnitQuaternion::from_scaled_axis(position::normal(0.2, rng));
                truth::pose(
                    sensor_from_target.rotation * turn,
                    sensor_from_target.translation.vector + position::normal(0.5, rng),
                )
            }
        }
    }
}

/// A rotation that is uniform over all rotations: three uniform numbers, after Shoemake (1992).
fn any_rotation(rng: &mut impl Rng) -> UnitQuaternion<f64> {
    let (u, v, w): (f64, f64, f64) = (rng.random(), rng.random(), rng.random());
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
        b * (TAU * w).cos(),
        a * (TAU * v).sin(),
        a * (TAU * v).cos(),
        b * (TAU * w).sin(),
    ))
}

/// The settings of what is not so; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FalsePositives {
    /// The probability that a measurement is wrong.
    #[serde(deserialize_with = "probability")]
    pub wrong_probability: f64,
    /// How it is then wrong.
    pub wrong: Wrong,
    /// How many robots each vehicle sees that do not exist.
    pub phantoms: usize,
}

/// A robot that does not exist: it flies about its observer and is taken for one of the others.
#[derive(Clone, Debug)]
pub struct Phantom {
    taken_for: usize,
    places: Vector3<f64>,
    turns_per_s: Vector3<f64>,
    phases: Vector3<f64>,
    pub(super) rng: ChaCha8Rng,
}

impl Phantom {
    /// The phantoms of one observer; none in a fleet of one, where there is nobody to be taken for.
    pub(super) fn of_observer(
        settings: &FalsePositives,
        observer: usize,
        n_vehicles: usize,
        streams: &Streams,
    ) -> Vec<Self> {
        let others: Vec<usize> = (0..n_vehicles)
            .filter(|vehicle| *vehicle != observer)
            .collect();
        if others.is_empty() {
            return Vec::new();
        }
        (0..settings.phantoms)
            .map(|number| {
                let mut rng = streams.pair(observer, number, Purpose::Phantom);
                let direction: [f64; 3] = UnitSphere.sample(&mut rng);
                Self {
                    taken_for: others[rng.random_range(0..others.len())],
                    places: Vector3::from(direction) * rng.random_range(2.0..5.0),
                    turns_per_s: Vector3::from_fn(|_, _| rng.random_range(0.02..0.08)),
                    phases: Vector3::from_fn(|_, _| rng.random()),
                    rng,
                }
            })
            .collect()
    }

    /// The index of the vehicle that the observer takes it for.
    #[must_use]
    pub const fn taken_for(&self) -> usize {
        self.taken_for
    }

    /// Where it seems to be at `t_s`: it keeps its place about the observer in world axes and wanders by up to 2 m.
    #[must_use]
    pub fn pose_at(&self, t_s: f64, world_from_observer: &Pose) -> Pose {
        let wave = Vector3::from_fn(|axis, _| {
            (TAU * (self.turns_per_s[axis] * t_s + self.phases[axis])).sin()
        });
        let place = world_from_observer.translation.vector + self.places + 1.15 * wave;
        truth::pose_from_euler(place, wave.x * 3.0, 0.0, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gross_error_is_anywhere_in_range_and_turned_anyhow() {
        let mut rng = Streams::new(1, 0).vehicle(0, Purpose::Outlier);
        let truth = truth::pose_from_euler(Vector3::new(3.0, 0.0, 0.0), 0.0, 0.0, 0.0);
        let wrong: Vec<Pose> = (0..20_000)
            .map(|_| Wrong::Gross.instead_of(&truth, 7.0, &mut rng))
            .collect();
        let n = wrong.len() as f64;
        assert!(
            wrong
                .iter()
                .all(|pose| pose.translation.vector.norm() <= 7.0)
        );
        // Uniform in a ball: the mean distance is 3/4 of the radius. Uniform over rotations: mean angle pi/2 + 2/pi.
        let mean_distance = wrong
            .iter()
            .map(|pose| pose.translation.vector.norm())
            .sum::<f64>()
            / n;
        let mean_angle = wrong.iter().map(|pose| pose.rotation.angle()).sum::<f64>() / n;
        assert!((mean_distance - 5.25).abs() < 0.04, "{mean_distance}");
        assert!(
            (mean_angle - (TAU / 4.0 + 4.0 / TAU)).abs() < 0.02,
            "{mean_angle}"
        );
    }

    #[test]
    fn a_phantom_keeps_near_its_observer_and_is_taken_for_another_vehicle() {
        let settings = FalsePositives {
            phantoms: 3,
            ..FalsePositives::default()
        };
        let phantoms = Phantom::of_observer(&settings, 1, 4, &Streams::new(2, 0));
        assert_eq!(phantoms.len(), 3);
        let observer = truth::pose_from_euler(Vector3::new(50.0, 0.0, 0.0), 1.0, 0.0, 0.0);
        for phantom in &phantoms {
            assert!(phantom.taken_for() < 4 && phantom.taken_for() != 1);
            for second in 0..60 {
                let pose = phantom.pose_at(f64::from(second), &observer);
                assert!((pose.translation.vector - observer.translation.vector).norm() < 7.0);
            }
        }
        assert!(Phantom::of_observer(&settings, 0, 1, &Streams::new(2, 0)).is_empty());
    }
}
