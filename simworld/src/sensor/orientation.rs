//! The relative orientation `R_i^T R_j`, turned by a von Mises-Fisher rotation on its right (the target's) side.

use super::Noise;
use crate::truth::Pose;
use nalgebra::UnitQuaternion;
use rand::Rng;
use rand_distr::Distribution;

/// The rotation of `sensor_from_target` with its noise.
pub(super) fn measure(
    sensor_from_target: &Pose,
    noise: &Noise,
    rng: &mut (impl Rng + ?Sized),
) -> UnitQuaternion<f64> {
    sensor_from_target.rotation * noise.rotation_concentration.sample(rng)
}
