//! The relative position, in the sensor's frame, with independent normal noise on each axis.

use super::Noise;
use crate::truth::Pose;
use nalgebra::Vector3;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

/// The target's place in the sensor's frame with its noise, metres.
pub(super) fn measure(
    sensor_from_target: &Pose,
    noise: &Noise,
    rng: &mut (impl Rng + ?Sized),
) -> Vector3<f64> {
    sensor_from_target.translation.vector + normal(noise.translation_std_m, rng)
}

/// A normal vector with this standard deviation on each axis.
pub(super) fn normal(std_m: f64, rng: &mut (impl Rng + ?Sized)) -> Vector3<f64> {
    Vector3::from_fn(|_, _| {
        let standard: f64 = StandardNormal.sample(rng);
        std_m * standard
    })
}
