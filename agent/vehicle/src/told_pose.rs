//! A pose that a vehicle is told, by its configuration or by an operator, and how well whoever tells it knows it.

use skein_estimation::{Body, Transform, World};
use skein_proto::limits::SIGMA_MAX;

/// Where a vehicle is, as it was told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToldPose {
    /// The pose.
    pub world_from_body: Transform<World, Body>,
    /// Standard deviation of its rotation per axis (rad).
    pub rotation_sigma_rad: f64,
    /// Standard deviation of its translation per axis (m).
    pub translation_sigma_m: f64,
}

impl ToldPose {
    /// Half a degree: how well a vehicle is pointed along a line on the floor. Meant where nobody says better.
    pub const ROTATION_SIGMA_RAD: f64 = 0.01;
    /// A centimetre: how well a vehicle is put on a mark. Meant where nobody says better.
    pub const TRANSLATION_SIGMA_M: f64 = 0.01;
    /// What stands for "exactly", in radians and metres: certainty itself would be no number.
    const EXACT_SIGMA: f64 = 1e-4;

    /// A pose of which nobody says how well it is known.
    pub const fn by_hand(world_from_body: Transform<World, Body>) -> Self {
        Self {
            world_from_body,
            rotation_sigma_rad: Self::ROTATION_SIGMA_RAD,
            translation_sigma_m: Self::TRANSLATION_SIGMA_M,
        }
    }

    /// A pose that is known exactly, as in a simulation.
    pub const fn exact(world_from_body: Transform<World, Body>) -> Self {
        Self {
            world_from_body,
            rotation_sigma_rad: Self::EXACT_SIGMA,
            translation_sigma_m: Self::EXACT_SIGMA,
        }
    }

    /// Whether its standard deviations may be told to others.
    pub(crate) fn is_sayable(&self) -> bool {
        [self.rotation_sigma_rad, self.translation_sigma_m]
            .iter()
            .all(|sigma| *sigma > 0.0 && *sigma <= SIGMA_MAX)
    }
}
