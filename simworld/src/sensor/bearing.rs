//! The direction to the target: the true bearing rotated by a von Mises-Fisher quaternion (section V-B), which moves
//! it by 2/sqrt(kappa) on each of the two axes across it.

use super::Noise;
use crate::truth::Pose;
use nalgebra::{Unit, UnitVector3, Vector3};
use rand::Rng;
use rand_distr::Distribution;

/// The unit vector towards the target in the sensor's frame, with its noise. A target at the sensor's very place has
/// no bearing: it is then reported ahead.
pub(super) fn measure(
    sensor_from_target: &Pose,
    noise: &Noise,
    rng: &mut (impl Rng + ?Sized),
) -> UnitVector3<f64> {
    let place = sensor_from_target.translation.vector;
    let bearing = Unit::try_new(place, 1e-12).unwrap_or_else(Vector3::x_axis);
    noise.bearing_concentration.sample(rng) * bearing
}
