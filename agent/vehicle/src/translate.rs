//! Wire numbers to estimation types and back. Both sides look alike; neither knows the other.

use nalgebra::{Matrix6, Vector3};
use skein_estimation::cooperative::team::Observation;
use skein_estimation::cooperative::{Measurement, Noise, Refusal};
use skein_estimation::odometry::{Growth, OdometryPoint};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Sensor, Transform, TransformError, World, so3};
use skein_proto::document::PoseDocument;
use skein_proto::fixed;
use skein_proto::frame::{FixValue, RelativeValue};
use skein_proto::growth;
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

/// Folds a mount, and the motion since the reading, into a fix: out comes what was fixed of the body itself at its round.
pub(crate) fn fold_fix(
    value: &FixValue,
    body_from_sensor: &Transform<Body, Sensor>,
) -> Result<fixed::Fixed, Refused> {
    let fixed = match value {
        FixValue::Pose {
            world_from_sensor,
            rotation_sigma_rad,
            translation_sigma_m,
        } => {
            let world_from_sensor = transform::<World, Sensor>(world_from_sensor)?;
            fixed::Fixed::Pose {
                world_from_body: (world_from_sensor * body_from_sensor.inverse()).to_numbers(),
                rotation_sigma_rad: sigma(*rotation_sigma_rad),
                translation_sigma_m: sigma(*translation_sigma_m),
            }
        }
        FixValue::Position {
            position_m,
            sigma_m,
        } => fixed::Fixed::Position {
            position_m: *position_m,
            point_m: body_from_sensor.translation.into(),
            sigma_m: sigma(*sigma_m),
        },
        FixValue::Orientation {
            rotation_vector_rad,
            sigma_rad,
        } => fixed::Fixed::Orientation {
            rotation_vector_rad: so3::log(
                &(rotation(rotation_vector_rad) * body_from_sensor.rotation.inverse()),
            )
            .into(),
            sigma_rad: sigma(*sigma_rad),
        },
        FixValue::Landmark {
            landmark_m,
            position_m,
            sigma_m,
        } => fixed::Fixed::Position {
            position_m: *landmark_m,
            point_m: body_from_sensor
                .transform_point(&Vector3::from(*position_m))
                .into(),
            sigma_m: sigma(*sigma_m),
        },
    };
    fixed.check()?;
    Ok(fixed)
}

/// A fix as it crossed the wire, ready for the team estimator: what the world measures of a point of the body.
pub(crate) fn fixed(fixed: &fixed::Fixed) -> Result<Observation, Refused> {
    use fixed::Fixed;
    let mut to_end = Transform::identity();
    let (measurement, noise) = match fixed {
        Fixed::Pose {
            world_from_body,
            rotation_sigma_rad,
            translation_sigma_m,
        } => (
            Measurement::pose(transform(world_from_body)?)?,
            noise(
                f64::from(*rotation_sigma_rad),
                f64::from(*translation_sigma_m),
            ),
        ),
        Fixed::Position {
            position_m,
            point_m,
            sigma_m,
        } => {
            to_end.translation = Vector3::from(*point_m);
            (
                Measurement::position(Vector3::from(*position_m))?,
                noise(0.0, f64::from(*sigma_m)),
            )
        }
        Fixed::Orientation {
            rotation_vector_rad,
            sigma_rad,
        } => (
            Measurement::orientation(rotation(rotation_vector_rad))?,
            noise(f64::from(*sigma_rad), 0.0),
        ),
    };
    Ok(Observation {
        measurement,
        noise,
        from_end: Transform::identity(),
        to_end,
    })
}

/// A standard deviation in single precision, which must not vanish: zero noise would be refused by everybody.
pub(crate) fn sigma(sigma: f64) -> f32 {
    (sigma as f32).max(f32::MIN_POSITIVE)
}

/// Whether a pose lies within what messages may say: a sum of numbers in range need not be.
pub(crate) fn is_sayable<To, From>(pose: &Transform<To, From>) -> bool {
    pose.is_valid() && pose.translation.amax() <= COORDINATE_MAX_M
}

/// Covariance growth as it crosses the wire.
pub(crate) fn growth_to_wire(growth: &Growth) -> growth::Growth {
    growth::Growth::Isotropic(growth.to_numbers())
}

/// Covariance growth as it crossed the wire; none when its sender gave none, or not in the form that we add up.
pub(crate) const fn growth(growth: &growth::Growth) -> Option<Growth> {
    match growth {
        growth::Growth::Isotropic(numbers) => Some(Growth::from_numbers(numbers)),
        growth::Growth::Unknown | growth::Growth::Full(_) => None,
    }
}

/// A neighbour's odometry of one round, on its own clock. A growth that is not known is zero.
pub(crate) fn odometry_point(
    round: &record::Round,
    taken: Stamp,
) -> Result<OdometryPoint, Refused> {
    Ok(OdometryPoint {
        taken,
        segment: round.segment,
        odometry_from_body: transform(&round.odometry_from_body)?,
        growth: growth(&round.growth).unwrap_or_else(Growth::zero),
    })
}

/// A covariance of a twist on the body's side, rotation first: the upper triangle, row by row. None when it is none.
pub(crate) fn covariance(covariance: &Matrix6<f64>) -> Option<[f64; 21]> {
    let mut numbers = [0.0; 21];
    let upper = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    for (number, at) in numbers.iter_mut().zip(upper) {
        *number = covariance[at];
    }
    let good = covariance.iter().all(|number| number.is_finite());
    (good
        && covariance
            .diagonal()
            .iter()
            .all(|variance| *variance >= 0.0))
    .then_some(numbers)
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

#[cfg(test)]
mod tests {
    use super::*;
    use skein_estimation::World;
    use std::f64::consts::FRAC_PI_2;

    /// A body at (5, 0, 0), turned a quarter to the left, whose sensor sits one metre ahead, turned as much again.
    fn stage() -> (Transform<World, Body>, Transform<Body, Sensor>) {
        let quarter = [0.0, 0.0, FRAC_PI_2];
        (
            Transform::new(rotation(&quarter), Vector3::new(5.0, 0.0, 0.0)),
            Transform::new(rotation(&quarter), Vector3::new(1.0, 0.0, 0.0)),
        )
    }

    fn near(left: &[f64], right: &[f64]) {
        let apart = left.iter().zip(right).map(|(l, r)| (l - r).abs());
        assert!(
            apart.fold(0.0, f64::max) < 1e-12,
            "{left:?} is not {right:?}"
        );
    }

    #[test]
    fn a_fix_of_the_sensor_s_pose_is_told_as_the_body_s() {
        let (world_from_body, body_from_sensor) = stage();
        let value = FixValue::Pose {
            world_from_sensor: (world_from_body * body_from_sensor).to_numbers(),
            rotation_sigma_rad: 0.1,
            translation_sigma_m: 0.5,
        };
        match fold_fix(&value, &body_from_sensor).unwrap() {
            fixed::Fixed::Pose {
                world_from_body: told,
                rotation_sigma_rad,
                translation_sigma_m,
            } => {
                near(&told, &world_from_body.to_numbers());
                assert_eq!((rotation_sigma_rad, translation_sigma_m), (0.1, 0.5));
            }
            other => panic!("{other:?}"),
        }
        let value = FixValue::Orientation {
            rotation_vector_rad: [0.0, 0.0, 2.0 * FRAC_PI_2],
            sigma_rad: 0.1,
        };
        match fold_fix(&value, &body_from_sensor).unwrap() {
            fixed::Fixed::Orientation {
                rotation_vector_rad,
                ..
            } => near(&rotation_vector_rad, &[0.0, 0.0, FRAC_PI_2]),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_fix_of_a_position_names_the_point_of_the_body_that_is_there() {
        let (world_from_body, body_from_sensor) = stage();
        let point_in_sensor = Vector3::new(2.0, 0.0, 0.0);
        for (seen_m, value) in [
            (
                Vector3::zeros(),
                FixValue::Position {
                    position_m: (world_from_body * body_from_sensor).translation.into(),
                    sigma_m: 0.5,
                },
            ),
            (
                point_in_sensor,
                FixValue::Landmark {
                    landmark_m: (world_from_body * body_from_sensor)
                        .transform_point(&point_in_sensor)
                        .into(),
                    position_m: point_in_sensor.into(),
                    sigma_m: 0.5,
                },
            ),
        ] {
            match fold_fix(&value, &body_from_sensor).unwrap() {
                fixed::Fixed::Position {
                    position_m,
                    point_m,
                    ..
                } => {
                    near(
                        &point_m,
                        body_from_sensor.transform_point(&seen_m).as_slice(),
                    );
                    let there = world_from_body.transform_point(&Vector3::from(point_m));
                    near(&position_m, there.as_slice());
                }
                other => panic!("{other:?}"),
            }
        }
    }
}
