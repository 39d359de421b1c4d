//! What range-only localisation says of its neighbours and of itself.

use std::collections::BTreeMap;

use nalgebra::Matrix4;
use skein_estimation::ranging::neighbour::Estimate;
use skein_estimation::ranging::window::{Ambiguity, Observability};
use skein_estimation::time::Stamp;
use skein_proto::document::{RangedDocument, RangingDocument, RangingHealth, RangingStatus};
use skein_proto::estimate::{RangingCovariance, RangingEstimate};
use skein_proto::name::Name;

use super::geometry::body_from_body;
use super::{Pair, Ranging};
use crate::translate;

impl Ranging {
    /// Every neighbour whose distances are read, by its name, in both forms; `taken` is the time of the estimate they go
    /// with.
    pub(crate) fn neighbours(
        &self,
        taken: Stamp,
    ) -> BTreeMap<Name, (RangingDocument, RangingEstimate)> {
        let described = self
            .pairs
            .iter()
            .filter_map(|(name, pair)| Some((*name, pair.describe(*name, taken)?)));
        described.collect()
    }

    /// Whether there is anything to say.
    pub(crate) fn is_in_use(&self) -> bool {
        !self.pairs.is_empty() || self.used > 0
    }

    pub(crate) fn to_document(&self) -> RangingHealth {
        RangingHealth {
            used: self.used,
            waiting: self.waiting.len() as u64,
            refused: self.refused.to_document(),
            placed: self.placed,
            schedule: None,
        }
    }
}

impl Pair {
    fn describe(&self, name: Name, taken: Stamp) -> Option<(RangingDocument, RangingEstimate)> {
        let (sample, ends) = self.newest.as_ref()?;
        let estimate = self.follower.estimate();
        let (status, modes) = match estimate.observability {
            Observability::Unknown => (RangingStatus::Unknown, 0),
            Observability::Ambiguous { modes, .. } => (RangingStatus::Ambiguous, modes.max(2)),
            Observability::Imprecise => (RangingStatus::Imprecise, 0),
            Observability::Observable => (RangingStatus::Converged, 1),
        };
        let pose = estimate.best.as_ref().map(|best| {
            let pose = body_from_body(sample, &best.pose, &ends.own, &ends.neighbour);
            (pose, best)
        });
        let pose = pose.filter(|(pose, _)| translate::is_sayable(pose));
        let covariance = pose
            .as_ref()
            .filter(|_| status == RangingStatus::Converged)
            .map(|(_, best)| triangle(&best.covariance));
        let document = RangingDocument {
            status,
            modes: modes as u64,
            why: why(&estimate),
            taken_ns: ends.taken.as_nanos(),
            pose: pose
                .as_ref()
                .map(|(pose, _)| translate::pose_document(pose)),
            reduced: pose.as_ref().map(|(_, best)| RangedDocument {
                position_level_m: best.pose.position_m.into(),
                yaw_rad: best.pose.yaw_rad,
                covariance_position_yaw: covariance,
            }),
        };
        let offset_us = (ends.taken - taken).as_micros_rounded();
        let estimate = RangingEstimate {
            vehicle: name.hash(),
            modes: u8::try_from(modes).unwrap_or(u8::MAX),
            taken_offset_us: i32::try_from(offset_us).unwrap_or(i32::MIN),
            reduced: pose.as_ref().map(|(_, best)| {
                let [x, y, z]: [f64; 3] = best.pose.position_m.into();
                [x, y, z, best.pose.yaw_rad]
            }),
            covariance: covariance.map(RangingCovariance::PositionYaw),
        };
        Some((document, estimate))
    }
}

/// What stands between a neighbour and its place, and what movement would tell.
fn why(estimate: &Estimate) -> Option<String> {
    let why = match estimate.observability {
        _ if estimate.is_disagreeing => {
            "distances go on contradicting what the two odometries say: one of them is wrong"
        }
        Observability::Observable => return None,
        Observability::Unknown => {
            "too few distances from different places yet: both vehicles should move about"
        }
        Observability::Imprecise => {
            "its place is not yet known to a metre: both vehicles should go on moving about"
        }
        Observability::Ambiguous { which, .. } => match which {
            Ambiguity::Flip => {
                "it may be on either side of a straight path: one of the two should turn"
            }
            Ambiguity::Rotation => {
                "its heading is open, as it has stood still, or moved in step: it should move"
            }
            Ambiguity::Exchange => {
                "both moved alike, so that their places could be exchanged: one should move otherwise"
            }
            Ambiguity::Several => {
                "several places fit the distances: both vehicles should go on moving about"
            }
        },
    };
    Some(why.to_owned())
}

/// The upper triangle, row by row.
fn triangle(covariance: &Matrix4<f64>) -> [f64; 10] {
    let places = (0..4).flat_map(|row| (row..4).map(move |column| (row, column)));
    let mut numbers = [0.0; 10];
    for (number, place) in numbers.iter_mut().zip(places) {
        *number = covariance[place];
    }
    numbers
}
