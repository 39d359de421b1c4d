//! Directions in a level frame: azimuth and zenith distance (Cognetti et al., eq. 16), and small differences between two.
//!
//! Azimuth counts counter-clockwise from the x axis, zenith distance from straight up, both in radians.

use nalgebra::{UnitVector3, Vector2, Vector3};

/// The direction of an azimuth and a zenith distance.
#[must_use]
pub fn from_angles(azimuth_rad: f64, zenith_rad: f64) -> UnitVector3<f64> {
    let (sin_zenith, cos_zenith) = zenith_rad.sin_cos();
    let (sin_azimuth, cos_azimuth) = azimuth_rad.sin_cos();
    UnitVector3::new_normalize(Vector3::new(
        sin_zenith * cos_azimuth,
        sin_zenith * sin_azimuth,
        cos_zenith,
    ))
}

/// Azimuth in (-pi, pi]; zero straight up and straight down, where there is none.
#[must_use]
pub fn azimuth_rad(direction: &UnitVector3<f64>) -> f64 {
    direction.y.atan2(direction.x)
}

/// Zenith distance in [0, pi].
#[must_use]
pub fn zenith_rad(direction: &UnitVector3<f64>) -> f64 {
    direction.x.hypot(direction.y).atan2(direction.z)
}

/// The direction turned counter-clockwise about the vertical.
#[must_use]
pub fn turned(direction: &UnitVector3<f64>, yaw_rad: f64) -> UnitVector3<f64> {
    let (sin, cos) = yaw_rad.sin_cos();
    UnitVector3::new_unchecked(Vector3::new(
        cos * direction.x - sin * direction.y,
        sin * direction.x + cos * direction.y,
        direction.z,
    ))
}

/// The unit vectors along which azimuth and zenith distance grow.
#[must_use]
pub fn tangents(direction: &UnitVector3<f64>) -> [Vector3<f64>; 2] {
    let (sin, cos) = azimuth_rad(direction).sin_cos();
    let level = direction.x.hypot(direction.y);
    [
        Vector3::new(-sin, cos, 0.0),
        Vector3::new(direction.z * cos, direction.z * sin, -level),
    ]
}

/// Where `to` lies seen from `from`: its arc length (rad) along the two [`tangents`] of `from`, close to
/// (d azimuth * sin zenith, d zenith). Defined straight up and down too; for opposite directions any of the ways there.
#[must_use]
pub fn difference(from: &UnitVector3<f64>, to: &UnitVector3<f64>) -> Vector2<f64> {
    let [azimuthal, zenithal] = tangents(from);
    let across = Vector2::new(to.dot(&azimuthal), to.dot(&zenithal));
    let sin = across.norm();
    let arc = sin.atan2(from.dot(to));
    if sin > 1e-12 {
        across * (arc / sin)
    } else {
        Vector2::new(arc, 0.0)
    }
}

/// The direction that is `step` (arc length along the two [`tangents`], rad) away; inverse of [`difference`].
#[must_use]
pub fn moved(from: &UnitVector3<f64>, step: &Vector2<f64>) -> UnitVector3<f64> {
    let arc = step.norm();
    if arc < 1e-15 {
        return *from;
    }
    let [azimuthal, zenithal] = tangents(from);
    let across = (azimuthal * step.x + zenithal * step.y) / arc;
    UnitVector3::new_normalize(from.into_inner() * arc.cos() + across * arc.sin())
}

/// The angle in (-pi, pi].
#[must_use]
pub fn wrapped(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let wrapped = angle_rad - turn * (angle_rad / turn).round();
    if wrapped <= -std::f64::consts::PI {
        wrapped + turn
    } else {
        wrapped
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn straight_up_has_zenith_distance_zero_and_no_azimuth() {
        let up = from_angles(0.0, 0.0);
        assert_eq!(zenith_rad(&up), 0.0);
        assert_eq!(azimuth_rad(&up), 0.0);
        assert!((difference(&up, &from_angles(1.0, 0.1)).norm() - 0.1).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn a_direction_is_its_angles(azimuth in -3.1..3.1f64, zenith in 0.01..3.1f64) {
            let direction = from_angles(azimuth, zenith);
            prop_assert!((azimuth_rad(&direction) - azimuth).abs() < 1e-12);
            prop_assert!((zenith_rad(&direction) - zenith).abs() < 1e-12);
        }

        #[test]
        fn a_difference_leads_there(a in -3.1..3.1f64, b in 0.0..PI, c in -3.1..3.1f64, d in 0.0..PI) {
            let (from, to) = (from_angles(a, b), from_angles(c, d));
            prop_assume!(from.dot(&to) > -0.999);
            prop_assert!((moved(&from, &difference(&from, &to)).into_inner() - to.into_inner()).norm() < 1e-9);
        }

        #[test]
        fn a_small_difference_is_azimuth_by_sine_and_zenith(a in -3.0..3.0f64, z in 0.3..2.8f64, da in -1e-4..1e-4f64, dz in -1e-4..1e-4f64) {
            let difference = difference(&from_angles(a, z), &from_angles(a + da, z + dz));
            prop_assert!((difference.x - da * z.sin()).abs() < 1e-7);
            prop_assert!((difference.y - dz).abs() < 1e-7);
        }

        #[test]
        fn turning_adds_to_the_azimuth(a in -3.0..3.0f64, z in 0.3..2.8f64, yaw in -9.0..9.0f64) {
            let direction = turned(&from_angles(a, z), yaw);
            prop_assert!(wrapped(azimuth_rad(&direction) - a - yaw).abs() < 1e-9);
            prop_assert!((zenith_rad(&direction) - z).abs() < 1e-9);
        }

        #[test]
        fn a_wrapped_angle_is_the_same_angle(angle in -1e3..1e3f64) {
            let w = wrapped(angle);
            prop_assert!(w > -PI && w <= PI + 1e-12);
            prop_assert!(((angle - w) / TAU - ((angle - w) / TAU).round()).abs() < 1e-9);
        }
    }
}
