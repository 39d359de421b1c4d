//! Wire numbers to estimation types and back. Both sides look alike; neither knows the other.

use nalgebra::Vector3;
use skein_estimation::cooperative::{Measurement, Noise, Refusal};
use skein_estimation::odometry::{Growth, OdometryPoint};
use skein_estimation::{Body, Sensor, Transform, TransformError, so3};
use skein_proto::document::PoseDocument;
use skein_proto::frame::{FixValue, RelativeValue};
use skein_proto::limits::COORDINATE_MAX_M;
use skein_proto::measured::MeasuredValue;
use skein_proto::record;

use crate::refused::Refused;

/// What one end of an edge saw, ready for the estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sighting {
    pub(crate) measurement: Measurement,
    pub(crate) noise: Noise,
    /// The measuring end, in the measuring vehicle's body at its round.
    pub(crate) from_end: Transform<Body, Sensor>,
}

/// A transform of checked numbers.
pub(crate) fn transform<To, From>(numbers: &[f64; 6]) -> Result<Transform<To, From>, Refused> {
    Transform::from_rotation_vector(*numbers)
        .map_err(|_: TransformError| Refusal::NotFinite { what: "a pose" }.into())
}

fn rotation(vector_rad: &[f64; 3]) -> nalgebra::UnitQuaternion<f64> {
    so3::exp(&Vector3::from(*vector_rad))
}

const fn noise(rotation_rad: f64, translation: f64) -> Noise {
    Noise {
        rotation_rad,
        translation,
    }
}

/// A measurement as it crossed the wire, in the measuring vehicle's body frame.
pub(crate) fn sighting(value: &MeasuredValue) -> Result<Sighting, Refused> {
    let at = |origin_m: &[f64; 3]| {
        Transform::new(
            nalgebra::UnitQuaternion::identity(),
            Vector3::from(*origin_m),
        )
    };
    let body = Transform::identity();
    let (measurement, noise, from_end) = match value {
        MeasuredValue::Pose {
            body_from_neighbour,
            rotation_sigma_rad,
            translation_sigma_m,
        } => (
            Measurement::pose(transform(body_from_neighbour)?)?,
            noise(
                f64::from(*rotation_sigma_rad),
                f64::from(*translation_sigma_m),
            ),
            body,
        ),
        MeasuredValue::Orientation {
            rotation_vector_rad,
            sigma_rad,
        } => (
            Measurement::orientation(rotation(rotation_vector_rad))?,
            noise(f64::from(*sigma_rad), 0.0),
            body,
        ),
        MeasuredValue::Position {
            position_m,
            sigma_m,
        } => (
            Measurement::position(Vector3::from(*position_m))?,
            noise(0.0, f64::from(*sigma_m)),
            body,
        ),
        MeasuredValue::Bearing {
            direction,
            origin_m,
            sigma_rad,
        } => (
            Measurement::bearing(Vector3::from(*direction))?,
            noise(f64::from(*sigma_rad), 0.0),
            at(origin_m),
        ),
        MeasuredValue::Distance {
            distance_m,
            origin_m,
            sigma_m,
        } => (
            Measurement::distance(*distance_m)?,
            noise(0.0, f64::from(*sigma_m)),
            at(origin_m),
        ),
    };
    Ok(Sighting {
        measurement,
        noise,
        from_end,
    })
}

/// An absolute fix, ready for the estimator: what the world's origin measures of a point at the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fixed {
    pub(crate) measurement: Measurement,
    pub(crate) noise: Noise,
    pub(crate) sensor_from_point: Transform<Sensor, Sensor>,
}

/// A fix as its driver says it.
pub(crate) fn fix(value: &FixValue) -> Result<Fixed, Refused> {
    let mut sensor_from_point = Transform::identity();
    let (measurement, noise) = match value {
        FixValue::Pose {
            world_from_sensor,
            rotation_sigma_rad,
            translation_sigma_m,
        } => (
            Measurement::pose(transform(world_from_sensor)?)?,
            noise(*rotation_sigma_rad, *translation_sigma_m),
        ),
        FixValue::Position {
            position_m,
            sigma_m,
        } => (
            Measurement::position(Vector3::from(*position_m))?,
            noise(0.0, *sigma_m),
        ),
        FixValue::Orientation {
            rotation_vector_rad,
            sigma_rad,
        } => (
            Measurement::orientation(rotation(rotation_vector_rad))?,
            noise(*sigma_rad, 0.0),
        ),
        FixValue::Landmark {
            landmark_m,
            position_m,
            sigma_m,
        } => {
            // To see a known point is to have a sensor there: as the noise is the same in all directions, the distance
            // between where the point is and where the sensor sees it is all that counts.
            sensor_from_point.translation = Vector3::from(*position_m);
            (
                Measurement::position(Vector3::from(*landmark_m))?,
                noise(0.0, *sigma_m),
            )
        }
    };
    Ok(Fixed {
        measurement,
        noise,
        sensor_from_point,
    })
}

/// Folds a mount, and the motion since the reading, into a measurement: out comes what the body itself would have
/// measured at its round. Isotropic noise is unchanged by it.
pub(crate) fn fold(
    value: &RelativeValue,
    body_from_sensor: &Transform<Body, Sensor>,
) -> MeasuredValue {
    let turned = |vector: &[f64; 3]| -> [f64; 3] {
        (body_from_sensor.rotation * Vector3::from(*vector)).into()
    };
    let origin_m: [f64; 3] = body_from_sensor.translation.into();
    match value {
        RelativeValue::Pose {
            sensor_from_target,
            rotation_sigma_rad,
            translation_sigma_m,
        } => {
            let [wx, wy, wz, x, y, z] = *sensor_from_target;
            let sensor_from_target =
                Transform::<Sensor, Body>::new(rotation(&[wx, wy, wz]), Vector3::new(x, y, z));
            MeasuredValue::Pose {
                body_from_neighbour: (*body_from_sensor * sensor_from_target).to_numbers(),
                rotation_sigma_rad: sigma(*rotation_sigma_rad),
                translation_sigma_m: sigma(*translation_sigma_m),
            }
        }
        RelativeValue::Orientation {
            rotation_vector_rad,
            sigma_rad,
        } => MeasuredValue::Orientation {
            rotation_vector_rad: so3::log(
                &(body_from_sensor.rotation * rotation(rotation_vector_rad)),
            )
            .into(),
            sigma_rad: sigma(*sigma_rad),
        },
        RelativeValue::Position {
            position_m,
            sigma_m,
        } => MeasuredValue::Position {
            position_m: body_from_sensor
                .transform_point(&Vector3::from(*position_m))
                .into(),
            sigma_m: sigma(*sigma_m),
        },
        RelativeValue::Bearing {
            direction,
            sigma_rad,
        } => MeasuredValue::Bearing {
            direction: turned(direction),
            origin_m,
            sigma_rad: sigma(*sigma_rad),
        },
        RelativeValue::Distance {
            distance_m,
            sigma_m,
        } => MeasuredValue::Distance {
            distance_m: *distance_m,
            origin_m,
            sigma_m: sigma(*sigma_m),
        },
    }
}

/// A standard deviation in single precision, which must not vanish: zero noise would be refused by everybody.
fn sigma(sigma: f64) -> f32 {
    (sigma as f32).max(f32::MIN_POSITIVE)
}

/// Whether a pose lies within what messages may say: a sum of numbers in range need not be.
pub(crate) fn is_sayable<To, From>(pose: &Transform<To, From>) -> bool {
    pose.is_valid() && pose.translation.amax() <= COORDINATE_MAX_M
}

/// Covariance growth as it crosses the wire.
pub(crate) fn growth_to_wire(growth: &Growth) -> record::Growth {
    record::Growth::Isotropic(growth.to_numbers())
}

/// A neighbour's odometry of one round, on its own clock. Its growth is not used by the star and stays zero.
pub(crate) fn odometry_point(
    round: &record::Round,
    taken: skein_estimation::time::Stamp,
) -> Result<OdometryPoint, Refused> {
    Ok(OdometryPoint {
        taken,
        segment: round.segment,
        odometry_from_body: transform(&round.odometry_from_body)?,
        growth: Growth::zero(),
    })
}

/// A pose in the forms that people and programs use.
pub(crate) fn pose_document<To, From>(pose: &Transform<To, From>) -> PoseDocument {
    let (roll, pitch, yaw) = pose.rotation.euler_angles();
    let [wx, wy, wz, x, y, z] = pose.to_numbers();
    let q = pose.rotation.quaternion();
    PoseDocument {
        position_m: [x, y, z],
        quaternion_wxyz: [q.w, q.i, q.j, q.k],
        yaw_pitch_roll_deg: [yaw.to_degrees(), pitch.to_degrees(), roll.to_degrees()],
        rotation_vector_rad: [wx, wy, wz],
    }
}
