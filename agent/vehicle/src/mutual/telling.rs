//! What mutual localisation says of its neighbours, of the features in sight and of itself.

use std::collections::BTreeMap;

use nalgebra::SMatrix;
use skein_estimation::mutual::{Located, Reduced, Status, direction};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform, VehicleId};
use skein_proto::document::{
    FeatureDocument, MutualDocument, MutualHealth, MutualStatus, ReducedDocument,
};
use skein_proto::estimate::{MutualCovariance, MutualEstimate};
use skein_proto::limits::{NEIGHBOURS_MAX, SPEED_MAX_M_S};
use skein_proto::name::Name;

use super::Mutual;
use crate::translate;

/// Numbers in the upper triangle of a 7 x 7 matrix.
const TRIANGLE: usize = 28;

impl Mutual {
    /// Every neighbour that is heard, by its name, in both forms; `taken` is the time of the estimate they go with.
    pub(crate) fn neighbours(
        &self,
        taken: Stamp,
    ) -> BTreeMap<Name, (MutualDocument, MutualEstimate)> {
        let Some(own) = &self.newest else {
            return BTreeMap::new();
        };
        let described = self.localiser.located().into_iter().filter_map(|located| {
            let name = self.names.get(&located.vehicle)?.name;
            Some((name, self.describe(own.taken, taken, &located)))
        });
        described.take(NEIGHBOURS_MAX).collect()
    }

    fn describe(
        &self,
        at: Stamp,
        taken: Stamp,
        located: &Located,
    ) -> (MutualDocument, MutualEstimate) {
        let (status, modes) = match located.status {
            Status::Unknown => (MutualStatus::Unknown, 0),
            Status::Ambiguous { modes } => (MutualStatus::Ambiguous, modes.max(2)),
            Status::Converged => (MutualStatus::Converged, 1),
        };
        let reduced = located.relative.filter(is_sayable).map(|reduced| Reduced {
            yaw_rad: direction::wrapped(reduced.yaw_rad),
            ..reduced
        });
        let covariance = reduced
            .and(located.covariance)
            .and_then(|covariance| triangle(&covariance));
        let pose = reduced.and_then(|reduced| self.pose(located.vehicle, &reduced));
        let identity_probability = located.identity_probability.clamp(0.0, 1.0);
        let document = MutualDocument {
            status,
            modes: modes as u64,
            taken_ns: at.as_nanos(),
            pose: pose.as_ref().map(translate::pose_document),
            reduced: reduced.map(|reduced| ReducedDocument {
                position_level_m: reduced.position_m.into(),
                velocity_level_m_s: reduced.velocity_m_s.into(),
                yaw_rad: reduced.yaw_rad,
                covariance_position_velocity_yaw: covariance.map(|numbers| numbers.to_vec()),
            }),
            identity_probability,
        };
        let offset_us = (at - taken).as_micros_rounded();
        let estimate = MutualEstimate {
            vehicle: located.vehicle.0,
            modes: u8::try_from(modes).unwrap_or(u8::MAX),
            taken_offset_us: i32::try_from(offset_us).unwrap_or(i32::MIN),
            identity_probability: identity_probability as f32,
            reduced: reduced.map(|reduced| {
                let ([x, y, z], [vx, vy, vz]): ([f64; 3], [f64; 3]) =
                    (reduced.position_m.into(), reduced.velocity_m_s.into());
                [x, y, z, vx, vy, vz, reduced.yaw_rad]
            }),
            covariance: covariance.map(|numbers| {
                let half = |from: usize| std::array::from_fn(|n| numbers[from + n]);
                MutualCovariance::PositionVelocityYaw(half(0), half(TRIANGLE / 2))
            }),
        };
        (document, estimate)
    }

    /// `body_from_neighbour`, by both vehicles' attitudes.
    fn pose(&self, vehicle: VehicleId, reduced: &Reduced) -> Option<Transform<Body, Body>> {
        let own = self.told.as_ref()?;
        let neighbour = self.names.get(&vehicle)?;
        let (rotation, translation) =
            reduced.in_body(&own.level_from_body, &neighbour.level_from_body);
        Some(Transform::new(rotation, translation)).filter(translate::is_sayable)
    }

    /// The features of the newest set, and who each may be.
    pub(crate) fn features(&self) -> Vec<FeatureDocument> {
        let Some(own) = &self.newest else {
            return Vec::new();
        };
        let identified = self.localiser.identified();
        let identified = identified.filter(|identified| identified.taken == own.taken);
        let identified = identified.map_or_else(Vec::new, |identified| identified.features);
        let document = |(index, feature): (usize, &skein_estimation::mutual::Feature)| {
            let of_this = identified.iter().filter(|(feature, _)| *feature == index);
            let candidates = of_this.flat_map(|(_, probabilities)| probabilities);
            let named = candidates.filter_map(|(vehicle, probability)| {
                let name = self.names.get(vehicle)?.name;
                Some((name.to_string(), probability.clamp(0.0, 1.0)))
            });
            FeatureDocument {
                direction_level: feature.direction.into_inner().into(),
                identities: named.collect(),
            }
        };
        own.features.iter().enumerate().map(document).collect()
    }

    /// Whether this vehicle has an inertial sensor or a camera for it.
    pub(crate) const fn is_in_use(&self) -> bool {
        self.inertial_sensor.is_some() || self.camera.is_some()
    }

    pub(crate) fn to_document(&self) -> MutualHealth {
        let attitude = self.history.motion().attitude();
        let known = self.history.newest().is_some();
        let moment = self.history.newest();
        MutualHealth {
            way: self.localiser.way().name().to_owned(),
            why: self.why_nobody_is_located(),
            attitude_settled: known && attitude.is_settled(),
            roll_deg: moment.map(|moment| moment.roll_pitch_rad().0.to_degrees()),
            pitch_deg: moment.map(|moment| moment.roll_pitch_rad().1.to_degrees()),
            gyroscope_bias_rad_s: known.then(|| attitude.rate_bias_rad_s().into()),
            sets_told: self.counts.told,
            sets_heard: self.counts.heard,
            tracks: self
                .newest
                .as_ref()
                .map_or(0, |set| set.tracks.len() as u64),
            bearings_identified: self.counts.identified,
            work_begun: self.counts.work_begun,
            work_done: self.counts.work_done,
            cut: self.counts.cut.to_document(),
        }
    }

    /// What stands between this vehicle and its neighbours' places, and what to do.
    fn why_nobody_is_located(&self) -> Option<String> {
        let located = self.localiser.located();
        if located
            .iter()
            .any(|located| located.status == Status::Converged)
        {
            return None;
        }
        let why = if self.history.newest().is_none() {
            "no inertial reading yet: camera frames cannot be levelled; check the inertial sensor and its driver in this \
             document's sensors"
        } else if self.camera.is_none() {
            "no camera frame yet: check the camera and its driver in this document's sensors"
        } else if self.names.is_empty() {
            "no neighbour tells what it sees: neighbours need a camera and an inertial sensor of their own, and a known \
             clock (four echoes)"
        } else if self
            .newest
            .as_ref()
            .is_none_or(|set| set.features.is_empty())
        {
            "this vehicle's camera sees nobody"
        } else if located
            .iter()
            .any(|located| matches!(located.status, Status::Ambiguous { .. }))
        {
            "who is who, or how far, is still ambiguous: the vehicles have to move, not all in the same way"
        } else {
            "no feature fits a neighbour yet: two vehicles have to see each other for some seconds"
        };
        Some(why.to_owned())
    }
}

fn is_sayable(reduced: &Reduced) -> bool {
    let speed_is_sane = reduced
        .velocity_m_s
        .iter()
        .all(|number| number.abs() <= SPEED_MAX_M_S);
    let identity = nalgebra::UnitQuaternion::identity();
    let place = Transform::<Body, Body>::new(identity, reduced.position_m);
    speed_is_sane && reduced.yaw_rad.is_finite() && translate::is_sayable(&place)
}

/// The upper triangle, row by row; none unless all of it is finite.
fn triangle(covariance: &SMatrix<f64, 7, 7>) -> Option<[f64; TRIANGLE]> {
    let mut numbers = [0.0; TRIANGLE];
    let upper = (0..7).flat_map(|row| (row..7).map(move |column| (row, column)));
    for (number, place) in numbers.iter_mut().zip(upper) {
        *number = covariance[place];
    }
    numbers
        .iter()
        .all(|number| number.is_finite())
        .then_some(numbers)
}
