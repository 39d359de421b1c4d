//! The distance to the target with normal noise.

use super::Noise;
use crate::truth::Pose;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// The distance from the sensor to the target with its noise, metres, never negative.
pub(super) fn measure(
    sensor_from_target: &Pose,
    noise: &Noise,
    rng: &mut (impl Rng + ?Sized),
) -> f64 {
    let standard: f64 = StandardNormal.sample(rng);
    (sensor_from_target.translation.vector.norm() + noise.distance_std_m * standard).max(0.0)
}
