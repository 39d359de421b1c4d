//! A pose as configurations write it: a position, and one of two forms of rotation.

use super::{Checked, Wrong};
use nalgebra::{UnitQuaternion, Vector3};
use serde::Deserialize;
use skein_estimation::transform::Transform;
use toml::Spanned;

/// How far from one a quaternion's length may be in a file that people write.
const QUATERNION_TOLERANCE: f64 = 1e-3;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPose {
    position_m: Option<Spanned<[f64; 3]>>,
    yaw_pitch_roll_deg: Option<Spanned<[f64; 3]>>,
    quaternion_wxyz: Option<Spanned<[f64; 4]>>,
}

pub(super) fn optional_pose<To, From>(
    raw: Option<&Spanned<RawPose>>,
) -> Checked<Transform<To, From>> {
    raw.map_or_else(|| Ok(Transform::identity()), check_pose)
}

pub(super) fn check_pose<To, From>(raw: &Spanned<RawPose>) -> Checked<Transform<To, From>> {
    let pose = raw.get_ref();
    let position = check_finite(pose.position_m.as_ref())?.unwrap_or_default();
    let angles = check_finite(pose.yaw_pitch_roll_deg.as_ref())?;
    let quaternion = check_finite(pose.quaternion_wxyz.as_ref())?;
    let rotation = match (angles, quaternion) {
        (None, None) => UnitQuaternion::identity(),
        (Some([yaw, pitch, roll]), None) => UnitQuaternion::from_euler_angles(
            roll.to_radians(),
            pitch.to_radians(),
            yaw.to_radians(),
        ),
        (None, Some([w, x, y, z])) => {
            let quaternion = nalgebra::Quaternion::new(w, x, y, z);
            if (quaternion.norm() - 1.0).abs() > QUATERNION_TOLERANCE {
                return Err(Wrong {
                    message: format!("the quaternion has length {}", quaternion.norm()),
                    at: pose.quaternion_wxyz.as_ref().map(Spanned::span),
                    help: Some("a rotation is a quaternion of length one, scalar first".into()),
                });
            }
            UnitQuaternion::from_quaternion(quaternion)
        }
        (Some(_), Some(_)) => {
            return Err(Wrong {
                message: "a pose has one rotation".into(),
                at: pose.quaternion_wxyz.as_ref().map(Spanned::span),
                help: Some("give yaw_pitch_roll_deg or quaternion_wxyz, not both".into()),
            });
        }
    };
    Ok(Transform::new(rotation, Vector3::from(position)))
}

fn check_finite<const N: usize>(given: Option<&Spanned<[f64; N]>>) -> Checked<Option<[f64; N]>> {
    match given {
        Some(numbers) if numbers.get_ref().iter().any(|n| !n.is_finite()) => Err(Wrong::at(
            numbers,
            "a pose is made of finite numbers",
            "write position_m in metres and angles in degrees",
        )),
        _ => Ok(given.map(|numbers| *numbers.get_ref())),
    }
}
