//! Rigid transforms that carry the names of their two frames as types, so that only matching ones compose.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::so3;

/// The team's common frame: east, north, up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum World {}
/// A vehicle's own frame: forward, left, up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {}
/// The frame of a sensor, or of the point that a sensor sees, at the instant of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {}
/// The frame in which a vehicle's odometry counts: where the body was when the odometry began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Odometry {}

/// How far from one the norm of a quaternion may be before it is refused as no rotation.
const UNIT_TOLERANCE: f64 = 1e-6;

/// A rigid transform that takes coordinates in `From` to coordinates in `To`: `p_to = rotation p_from + translation`.
///
/// Equally the pose of frame `From` in frame `To`, so a vehicle's pose is `Transform<World, Body>` and is called
/// `world_from_body`. Translation in metres.
///
/// Composition wants the inner frames equal:
///
/// ```
/// use skein_estimation::{Body, Sensor, Transform, World};
/// let world_from_body = Transform::<World, Body>::identity();
/// let body_from_sensor = Transform::<Body, Sensor>::identity();
/// let world_from_sensor: Transform<World, Sensor> = world_from_body * body_from_sensor;
/// ```
///
/// and anything else does not compile:
///
/// ```compile_fail,E0308
/// use skein_estimation::{Body, Sensor, Transform, World};
/// let world_from_body = Transform::<World, Body>::identity();
/// let sensor_from_body = Transform::<Sensor, Body>::identity();
/// let nonsense = world_from_body * sensor_from_body;
/// ```
pub struct Transform<To, From> {
    /// Rotation from `From` to `To`.
    pub rotation: UnitQuaternion<f64>,
    /// Origin of `From` in `To`, metres.
    pub translation: Vector3<f64>,
    frames: PhantomData<fn(From) -> To>,
}

/// Numbers that are no transform.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TransformError {
    /// One of the six numbers is infinite or not a number.
    #[error("number {index} of the transform is not finite")]
    NotFinite {
        /// Which of the six: 0 to 2 rotation vector, 3 to 5 translation.
        index: usize,
    },
    /// The quaternion given is not of unit length.
    #[error("the quaternion has length {norm}, not one")]
    NotUnit {
        /// Its length.
        norm: f64,
    },
}

impl<To, From> Transform<To, From> {
    /// From a rotation and a translation in metres. Not checked for finiteness; see [`Transform::is_valid`].
    #[must_use]
    pub const fn new(rotation: UnitQuaternion<f64>, translation: Vector3<f64>) -> Self {
        Self {
            rotation,
            translation,
            frames: PhantomData,
        }
    }

    /// The two frames coincide.
    #[must_use]
    pub fn identity() -> Self {
        Self::new(UnitQuaternion::identity(), Vector3::zeros())
    }

    /// From six numbers as they cross the network: rotation vector (rad), then translation (m).
    ///
    /// # Errors
    /// [`TransformError::NotFinite`] names the first number that is not finite.
    pub fn from_rotation_vector(numbers: [f64; 6]) -> Result<Self, TransformError> {
        if let Some(index) = numbers.iter().position(|number| !number.is_finite()) {
            return Err(TransformError::NotFinite { index });
        }
        let [wx, wy, wz, x, y, z] = numbers;
        Ok(Self::new(
            so3::exp(&Vector3::new(wx, wy, wz)),
            Vector3::new(x, y, z),
        ))
    }

    /// From a quaternion as scalar and vector part and a translation (m); the quaternion is normalised.
    ///
    /// # Errors
    /// [`TransformError`] when a number is not finite (counted quaternion x, y, z, then translation; the scalar part
    /// counts as 0) or the quaternion's length is not one within 1 %, which no rounding explains.
    pub fn from_quaternion(
        scalar: f64,
        vector: [f64; 3],
        translation: [f64; 3],
    ) -> Result<Self, TransformError> {
        let quaternion = Quaternion::new(scalar, vector[0], vector[1], vector[2]);
        if !scalar.is_finite() {
            return Err(TransformError::NotFinite { index: 0 });
        }
        if let Some(index) = vector
            .iter()
            .chain(&translation)
            .position(|number| !number.is_finite())
        {
            return Err(TransformError::NotFinite { index });
        }
        let norm = quaternion.norm();
        if (norm - 1.0).abs() > 0.01 {
            return Err(TransformError::NotUnit { norm });
        }
        Ok(Self::new(
            UnitQuaternion::new_normalize(quaternion),
            Vector3::from(translation),
        ))
    }

    /// Rotation vector (rad, length at most pi), then translation (m).
    #[must_use]
    pub fn to_numbers(&self) -> [f64; 6] {
        let w = so3::log(&self.rotation);
        [
            w.x,
            w.y,
            w.z,
            self.translation.x,
            self.translation.y,
            self.translation.z,
        ]
    }

    /// The transform the other way.
    #[must_use]
    pub fn inverse(&self) -> Transform<From, To> {
        let rotation = self.rotation.inverse();
        Transform::new(rotation, -(rotation * self.translation))
    }

    /// A point (m) in `From`, expressed in `To`.
    #[must_use]
    pub fn transform_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// The nearby transform `(R exp(w), t + delta)`: the manifold SO(3) x R^3 of the paper, rotation updated on the
    /// body side (rad), translation in `To` (m). Paper eq. 8.
    #[must_use]
    pub fn retract(&self, rotation: &Vector3<f64>, translation: &Vector3<f64>) -> Self {
        let mut turned = self.rotation * so3::exp(rotation);
        // Both factors are unit to rounding, so one Newton step removes what rounding adds.
        turned.renormalize_fast();
        Self::new(turned, self.translation + translation)
    }

    /// The same numbers under other frame names. For solver internals, where a reference node or a sensor plays the
    /// part of a body; never to silence a type error.
    #[must_use]
    pub const fn reframe<A, B>(&self) -> Transform<A, B> {
        Transform::new(self.rotation, self.translation)
    }

    /// True when every number is finite and the quaternion is of unit length.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.translation.iter().all(|number| number.is_finite())
            && (self.rotation.norm() - 1.0).abs() <= UNIT_TOLERANCE
    }
}

impl<To, Middle, From> Mul<Transform<Middle, From>> for Transform<To, Middle> {
    type Output = Transform<To, From>;

    fn mul(self, right: Transform<Middle, From>) -> Self::Output {
        Transform::new(
            self.rotation * right.rotation,
            self.transform_point(&right.translation),
        )
    }
}

// By hand: the derived ones would ask the frame markers for the same traits.
impl<To, From> Clone for Transform<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<To, From> Copy for Transform<To, From> {}

impl<To, From> PartialEq for Transform<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.rotation == other.rotation && self.translation == other.translation
    }
}

impl<To, From> fmt::Debug for Transform<To, From> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frame = |name: &'static str| name.rsplit("::").next().unwrap_or(name);
        let (to, from) = (
            frame(std::any::type_name::<To>()),
            frame(std::any::type_name::<From>()),
        );
        write!(formatter, "{to}_from_{from}{:?}", self.to_numbers())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_goes_through_a_composition_as_through_its_parts() {
        let world_from_body =
            Transform::<World, Body>::from_rotation_vector([0.3, -0.2, 1.0, 4.0, 5.0, 6.0])
                .unwrap();
        let body_from_sensor =
            Transform::<Body, Sensor>::from_rotation_vector([-1.3, 0.2, 0.1, 0.1, 0.2, 0.3])
                .unwrap();
        let point = Vector3::new(1.0, 2.0, 3.0);
        let at_once = (world_from_body * body_from_sensor).transform_point(&point);
        let in_parts = world_from_body.transform_point(&body_from_sensor.transform_point(&point));
        assert!((at_once - in_parts).norm() < 1e-14);
        let back = world_from_body.inverse().transform_point(&at_once);
        assert!((back - body_from_sensor.transform_point(&point)).norm() < 1e-14);
    }

    #[test]
    fn six_numbers_come_back_as_they_went_in() {
        let numbers = [0.3, -0.2, 1.0, 4.0, 5.0, 6.0];
        let back = Transform::<World, Body>::from_rotation_vector(numbers)
            .unwrap()
            .to_numbers();
        assert!(numbers.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-15));
    }

    #[test]
    fn numbers_that_are_not_finite_are_refused_by_place() {
        for index in 0..6 {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut numbers = [0.1; 6];
                numbers[index] = bad;
                let refused = Transform::<World, Body>::from_rotation_vector(numbers);
                assert_eq!(refused, Err(TransformError::NotFinite { index }));
            }
        }
    }

    #[test]
    fn a_quaternion_that_is_no_rotation_is_refused() {
        let refused = Transform::<World, Body>::from_quaternion(1.0, [0.5, 0.0, 0.0], [0.0; 3]);
        assert!(matches!(refused, Err(TransformError::NotUnit { .. })));
        assert!(Transform::<World, Body>::from_quaternion(0.9999, [0.0; 3], [0.0; 3]).is_ok());
    }

    #[test]
    fn retract_turns_on_the_body_side_and_shifts_in_the_world() {
        let pose =
            Transform::<World, Body>::from_rotation_vector([0.0, 0.0, 1.5, 1.0, 0.0, 0.0]).unwrap();
        let moved = pose.retract(&Vector3::new(0.2, 0.0, 0.0), &Vector3::new(0.0, 3.0, 0.0));
        let expected = pose.rotation * so3::exp(&Vector3::new(0.2, 0.0, 0.0));
        assert!(moved.rotation.angle_to(&expected) < 1e-7);
        assert_eq!(moved.translation, Vector3::new(1.0, 3.0, 0.0));
    }
}
