//! The settings of a relative sensor: what it tells, how far it sees, how well, from where on the vehicle and when.

use super::{FalsePositives, FieldOfView, Kind};
use crate::bounded::{finite, not_negative, positive, probability};
use crate::truth::{Pose, pose_from_euler};
use crate::von_mises_fisher::VonMisesFisher;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The noise of relative measurements; the default is section V's (for bearing and distance the paper gives no
/// numbers: 10,000 and 1 mm are ours).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    /// Concentration of the rotation noise, of pose and orientation.
    pub rotation_concentration: VonMisesFisher,
    /// Standard deviation of a position per axis, of pose and position, metres.
    #[serde(deserialize_with = "not_negative")]
    pub translation_std_m: f64,
    /// Concentration of the rotation that is applied to a true bearing.
    pub bearing_concentration: VonMisesFisher,
    /// Standard deviation of a distance, metres.
    #[serde(deserialize_with = "not_negative")]
    pub distance_std_m: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            rotation_concentration: section_v_concentration(),
            translation_std_m: 0.001,
            bearing_concentration: section_v_concentration(),
            distance_std_m: 0.001,
        }
    }
}

/// The concentration of section V: 0.020 rad per axis.
pub(super) fn section_v_concentration() -> VonMisesFisher {
    VonMisesFisher::new(10_000.0).expect("10,000 is positive")
}

/// Where a sensor sits on its vehicle. In a scenario: `{ translation_m = [0.3, 0, 0], yaw_deg = 20 }`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Mount {
    /// The sensor's place in the body frame, metres.
    pub translation_m: [f64; 3],
    /// Yaw of the sensor against the body, degrees.
    pub yaw_deg: f64,
    /// Pitch, degrees.
    pub pitch_deg: f64,
    /// Roll, degrees.
    pub roll_deg: f64,
}

impl Mount {
    /// `body_from_sensor`, metres.
    #[must_use]
    pub fn body_from_sensor(&self) -> Pose {
        pose_from_euler(
            Vector3::from(self.translation_m),
            self.yaw_deg.to_radians(),
            self.pitch_deg.to_radians(),
            self.roll_deg.to_radians(),
        )
    }
}

/// When within its round a sensor measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Taken {
    /// At the round's instant.
    #[default]
    OnRound,
    /// At a random time of the period that ends with the round's instant.
    AnywhereInRound,
}

/// From a time on, the sensor tells something else.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KindChange {
    /// From when on, seconds since the start of the motion.
    #[serde(deserialize_with = "finite")]
    pub from_s: f64,
    /// What it tells from then on.
    pub kind: Kind,
}

/// The settings of the relative sensor that every vehicle of a scenario carries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorSettings {
    /// What it tells at first.
    pub kind: Kind,
    /// What it tells later, in the order of the times.
    pub changes: Vec<KindChange>,
    /// How far it sees, metres. Section V: 7 m.
    #[serde(deserialize_with = "positive")]
    pub range_m: f64,
    /// What it sees around its x axis; without it, everything around.
    pub field_of_view: Option<FieldOfView>,
    /// The probability that a measurement of a vehicle in sight is missed, independently for each ordered pair.
    #[serde(deserialize_with = "probability")]
    pub miss_probability: f64,
    /// The noise.
    pub noise: Noise,
    /// Where it sits: vehicle i has the mount i modulo their number. Without any it is the body itself.
    pub mounts: Vec<Mount>,
    /// How long a measurement takes to reach the vehicle's software, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub delivery_delay_s: f64,
    /// When within a round it measures.
    pub taken: Taken,
    /// What it reports that is not so.
    pub false_positives: FalsePositives,
}

impl Default for SensorSettings {
    /// The relative pose sensor of section V.
    fn default() -> Self {
        Self {
            kind: Kind::Pose,
            changes: Vec::new(),
            range_m: 7.0,
            field_of_view: None,
            miss_probability: 0.25,
            noise: Noise::default(),
            mounts: Vec::new(),
            delivery_delay_s: 0.0,
            taken: Taken::OnRound,
            false_positives: FalsePositives::default(),
        }
    }
}

impl SensorSettings {
    /// What the sensor tells at `t_s` seconds since the start of the motion.
    #[must_use]
    pub fn kind_at(&self, t_s: f64) -> Kind {
        let latest = self
            .changes
            .iter()
            .rev()
            .find(|change| change.from_s <= t_s);
        latest.map_or(self.kind, |change| change.kind)
    }

    /// `body_from_sensor` of the vehicle with this index.
    #[must_use]
    pub fn body_from_sensor(&self, vehicle: usize) -> Pose {
        match self.mounts.as_slice() {
            [] => Pose::identity(),
            mounts => mounts[vehicle % mounts.len()].body_from_sensor(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kind_follows_the_list_of_changes() {
        let settings: SensorSettings = toml::from_str(
            r#"
        kind = "pose"
        changes = [{ from_s = 5, kind = "bearing" }, { from_s = 8.5, kind = "distance" }]
        "#,
        )
        .unwrap();
        let kinds = [-1.0, 4.9, 5.0, 8.4, 9.0].map(|t_s| settings.kind_at(t_s));
        assert_eq!(
            kinds,
            [
                Kind::Pose,
                Kind::Pose,
                Kind::Bearing,
                Kind::Bearing,
                Kind::Distance
            ]
        );
    }

    #[test]
    fn vehicles_take_the_mounts_in_turn() {
        let settings: SensorSettings =
            toml::from_str("mounts = [{ yaw_deg = 20 }, { roll_deg = 20 }]").unwrap();
        assert_eq!(settings.body_from_sensor(0), settings.body_from_sensor(2));
        assert_ne!(settings.body_from_sensor(0), settings.body_from_sensor(1));
        assert_eq!(
            SensorSettings::default().body_from_sensor(3),
            Pose::identity()
        );
    }
}
