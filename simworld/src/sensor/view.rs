//! What a sensor sees around its x axis.

use crate::bounded::positive;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Full opening angles about the sensor's x axis, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldOfView {
    /// From left to right, degrees; 360 is all around.
    #[serde(deserialize_with = "positive")]
    pub horizontal_deg: f64,
    /// From top to bottom, degrees; 180 is all of it.
    #[serde(deserialize_with = "positive")]
    pub vertical_deg: f64,
}

impl FieldOfView {
    /// Whether this place in the sensor's frame (x ahead, y left, z up) is in view.
    #[must_use]
    pub fn contains(&self, place: &Vector3<f64>) -> bool {
        let azimuth_deg = place.y.atan2(place.x).to_degrees();
        let elevation_deg = place.z.atan2(place.x.hypot(place.y)).to_degrees();
        azimuth_deg.abs() <= self.horizontal_deg / 2.0
            && elevation_deg.abs() <= self.vertical_deg / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_of_ninety_by_sixty_degrees_sees_to_its_edges() {
        let camera = FieldOfView {
            horizontal_deg: 90.0,
            vertical_deg: 60.0,
        };
        let at = |azimuth_deg: f64, elevation_deg: f64| {
            let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
            let level = elevation.cos();
            camera.contains(&Vector3::new(
                level * azimuth.cos(),
                level * azimuth.sin(),
                elevation.sin(),
            ))
        };
        assert!(at(0.0, 0.0) && at(44.9, 0.0) && at(-44.9, 0.0) && at(0.0, 29.9) && at(0.0, -29.9));
        assert!(
            !at(45.1, 0.0)
                && !at(-45.1, 0.0)
                && !at(0.0, 30.1)
                && !at(0.0, -30.1)
                && !at(180.0, 0.0)
        );
    }
}
