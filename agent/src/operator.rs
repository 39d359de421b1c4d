//! What an operator may tell a running vehicle under `@rpc`: off unless configured, checked before it is passed on.

use crate::clock::Clock;
use crate::inbox::Inbox;
use nalgebra::{Quaternion, UnitQuaternion};
use serde::{Deserialize, Serialize};
use skein_proto::document::ErrorDocument;
use skein_proto::limits::{COORDINATE_MAX_M, SIGMA_MAX};
use skein_proto::name::Name;
use skein_vehicle::{Input, ToldPose};

/// How far from one a quaternion's length may be: people write these.
const QUATERNION_TOLERANCE: f64 = 1e-3;
/// Longest payload that is looked at.
const PAYLOAD_BYTES_MAX: usize = 4_096;

/// Passes an operator's wishes to the vehicle.
pub(crate) struct Operator {
    pub(crate) clock: Clock,
    pub(crate) inbox: Inbox,
}

/// The payload of `@rpc/set_pose`: `world_from_body`, with one of the two rotations or none.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct SetPose {
    position_m: [f64; 3],
    yaw_pitch_roll_deg: Option<[f64; 3]>,
    quaternion_wxyz: Option<[f64; 4]>,
    rotation_sigma_rad: Option<f64>,
    translation_sigma_m: Option<f64>,
}

/// The answer to a wish that was passed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Accepted {
    accepted: bool,
}

fn error(code: &str, message: impl Into<String>) -> ErrorDocument {
    ErrorDocument {
        code: code.to_owned(),
        message: message.into(),
    }
}

impl Operator {
    /// Does what a verb says, or says why not.
    pub(crate) fn obey(&self, verb: Name, payload: &[u8]) -> Result<Accepted, ErrorDocument> {
        if verb.as_str() != "set_pose" {
            let message = format!("there is no @rpc/{verb}; the only one is set_pose");
            return Err(error("unknown_verb", message));
        }
        let told = set_pose(payload)?;
        tracing::info!(?told, "an operator sets the pose");
        let Told {
            world_from_body,
            rotation_sigma_rad,
            translation_sigma_m,
        } = told;
        let input = Input::SetPose {
            world_from_body,
            rotation_sigma_rad,
            translation_sigma_m,
        };
        self.inbox.push(self.clock.now(), input);
        Ok(Accepted { accepted: true })
    }
}

/// A checked wish.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Told {
    /// Rotation vector (rad), then translation (m).
    world_from_body: [f64; 6],
    rotation_sigma_rad: f64,
    translation_sigma_m: f64,
}

fn set_pose(payload: &[u8]) -> Result<Told, ErrorDocument> {
    const FORM: &str = "send JSON: {\"position_m\": [x, y, z]} in the common frame, and if it is turned \
                        \"yaw_pitch_roll_deg\": [..] or \"quaternion_wxyz\": [..]; and how well it is known: \
                        \"rotation_sigma_rad\", \"translation_sigma_m\"";
    if payload.len() > PAYLOAD_BYTES_MAX {
        return Err(error(
            "too_long",
            format!("the payload is too long: {FORM}"),
        ));
    }
    let wish: SetPose = serde_json::from_slice(payload)
        .map_err(|wrong| error("malformed", format!("{wrong}; {FORM}")))?;
    let out_of_range = |what: &str| error("out_of_range", format!("{what} is out of range"));
    let in_range = |numbers: &[f64], max: f64| numbers.iter().all(|n| n.abs() <= max);
    if !in_range(&wish.position_m, COORDINATE_MAX_M) {
        return Err(out_of_range("position_m"));
    }
    let rotation = match (wish.yaw_pitch_roll_deg, wish.quaternion_wxyz) {
        (None, None) => UnitQuaternion::identity(),
        (Some(angles), None) => {
            if !in_range(&angles, 360.0) {
                return Err(out_of_range("yaw_pitch_roll_deg"));
            }
            let [yaw, pitch, roll] = angles.map(f64::to_radians);
            UnitQuaternion::from_euler_angles(roll, pitch, yaw)
        }
        (None, Some([w, x, y, z])) => {
            let quaternion = Quaternion::new(w, x, y, z);
            if (quaternion.norm() - 1.0).abs() > QUATERNION_TOLERANCE
                || !quaternion.norm().is_finite()
            {
                return Err(error("not_unit", "quaternion_wxyz must have length one"));
            }
            UnitQuaternion::new_normalize(quaternion)
        }
        (Some(_), Some(_)) => {
            let message = "give yaw_pitch_roll_deg or quaternion_wxyz, not both";
            return Err(error("two_rotations", message));
        }
    };
    let [wx, wy, wz]: [f64; 3] = rotation.scaled_axis().into();
    let [x, y, z] = wish.position_m;
    let sigma = |what: &str, given: Option<f64>, otherwise: f64| match given {
        None => Ok(otherwise),
        Some(sigma) if sigma > 0.0 && sigma <= SIGMA_MAX => Ok(sigma),
        Some(_) => Err(out_of_range(what)),
    };
    Ok(Told {
        world_from_body: [wx, wy, wz, x, y, z],
        rotation_sigma_rad: sigma(
            "rotation_sigma_rad",
            wish.rotation_sigma_rad,
            ToldPose::ROTATION_SIGMA_RAD,
        )?,
        translation_sigma_m: sigma(
            "translation_sigma_m",
            wish.translation_sigma_m,
            ToldPose::TRANSLATION_SIGMA_M,
        )?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(payload: &str) -> String {
        set_pose(payload.as_bytes()).unwrap_err().code
    }

    #[test]
    fn a_pose_is_read_in_either_form() {
        let turned = set_pose(br#"{"position_m": [1, 2, 3], "yaw_pitch_roll_deg": [90, 0, 0]}"#);
        let [wx, wy, wz, x, y, z] = turned.unwrap().world_from_body;
        assert!((wz - std::f64::consts::FRAC_PI_2).abs() < 1e-12 && wx.hypot(wy) < 1e-12);
        assert_eq!([x, y, z], [1.0, 2.0, 3.0]);
        let plain = set_pose(br#"{"position_m": [1, 2, 3], "quaternion_wxyz": [1, 0, 0, 0]}"#);
        let plain = plain.unwrap();
        assert_eq!(plain.world_from_body, [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
        let sigmas = |told: &Told| (told.rotation_sigma_rad, told.translation_sigma_m);
        assert_eq!(sigmas(&plain), (0.01, 0.01), "by hand");
        let surveyed = set_pose(
            br#"{"position_m": [1, 2, 3], "rotation_sigma_rad": 0.1, "translation_sigma_m": 0.002}"#,
        );
        assert_eq!(sigmas(&surveyed.unwrap()), (0.1, 0.002));
    }

    #[test]
    fn what_is_no_pose_is_refused_by_a_word() {
        assert_eq!(code("up"), "malformed");
        assert_eq!(code(r#"{"position": [1, 2, 3]}"#), "malformed");
        assert_eq!(code(r#"{"position_m": [1e9, 2, 3]}"#), "out_of_range");
        assert_eq!(
            code(r#"{"position_m": [1, 2, 3], "translation_sigma_m": 0}"#),
            "out_of_range"
        );
        assert_eq!(
            code(r#"{"position_m": [1, 2, 3], "quaternion_wxyz": [2, 0, 0, 0]}"#),
            "not_unit"
        );
        assert_eq!(
            code(
                r#"{"position_m": [1, 2, 3], "quaternion_wxyz": [1, 0, 0, 0], "yaw_pitch_roll_deg": [0, 0, 0]}"#
            ),
            "two_rotations"
        );
        assert_eq!(code(&" ".repeat(5_000)), "too_long");
    }
}
