//! The relative pose: orientation and position together, with independent noises.

use super::{Noise, orientation, position};
use crate::truth::{self, Pose};
use rand::Rng;

/// `sensor_from_target` with its noise, metres.
pub(super) fn measure(
    sensor_from_target: &Pose,
    noise: &Noise,
    rng: &mut (impl Rng + ?Sized),
) -> Pose {
    let rotation = orientation::measure(sensor_from_target, noise, rng);
    let translation_m = position::measure(sensor_from_target, noise, rng);
    truth::pose(rotation, translation_m)
}
