//! What range-only localisation says of its neighbours and of itself.

use std::collections::BTreeMap;

use nalgebra::Matrix4;
use skein_estimation::ranging::bank::Place;
use skein_estimation::ranging::neighbour::Estimate;
use skein_estimation::ranging::window::{Ambiguity, Observability};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform};
use skein_proto::document::{
    RangedBy, RangedDocument, RangingDocument, RangingHealth, RangingStatus,
};
use skein_proto::estimate::{RangingCovariance, RangingEstimate};
use skein_proto::name::Name;

use super::geometry::{body_from_body, level};
use super::waiting::Ends;
use super::{Pair, Ranging};
use crate::translate;

impl Ranging {
    /// Every neighbour whose distances are read, by its name, in both forms; `taken` is the time of the estimate they go
    /// with.
    pub(crate) fn neighbours(
        &self,
        taken: Stamp,
    ) -> BTreeMap<Name, (RangingDocument, RangingEstimate)> {
        let described = self.pairs.iter().filter_map(|(name, pair)| {
            let (_, ends) = pair.newest.as_ref()?;
            let estimate = pair.follower.estimate();
            let by_all = self.placed_by_all(*name, pair, &estimate, &ends.own, &ends.neighbour);
            let told = match by_all {
                Some(place) => Told::by_all(&place, ends),
                None => pair.tell(&estimate)?,
            };
            Some((*name, told.describe(*name, taken)))
        });
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
            formation: self.forming.to_document(),
            schedule: None,
        }
    }
}

/// What is said of a neighbour.
struct Told {
    status: RangingStatus,
    modes: usize,
    why: Option<String>,
    by: RangedBy,
    /// When it was there.
    at: Stamp,
    place: Option<(Transform<Body, Body>, Place)>,
}

impl Pair {
    /// What its own distances say; none before the first.
    fn tell(&self, estimate: &Estimate) -> Option<Told> {
        let (sample, ends) = self.newest.as_ref()?;
        let (status, modes) = match estimate.observability {
            Observability::Unknown => (RangingStatus::Unknown, 0),
            Observability::Ambiguous { modes, .. } => (RangingStatus::Ambiguous, modes.max(2)),
            Observability::Imprecise => (RangingStatus::Imprecise, 0),
            Observability::Observable => (RangingStatus::Converged, 1),
        };
        let at = [&sample.own, &sample.neighbour];
        let place = estimate.best.map(|best| {
            let pose = body_from_body(at, &best.pose, &ends.own, &ends.neighbour);
            (pose, best)
        });
        Some(Told {
            status,
            modes,
            why: why(estimate),
            by: RangedBy::Pair,
            at: ends.taken,
            place,
        })
    }
}

impl Told {
    /// What the distances of all say together.
    fn by_all(place: &Place, ends: &Ends) -> Self {
        let at = [&level(&ends.own), &level(&ends.neighbour)];
        let pose = body_from_body(at, &place.pose, &ends.own, &ends.neighbour);
        Self {
            status: RangingStatus::Converged,
            modes: 1,
            why: None,
            by: RangedBy::All,
            at: ends.taken,
            place: Some((pose, *place)),
        }
    }

    fn describe(self, name: Name, taken: Stamp) -> (RangingDocument, RangingEstimate) {
        let place = self.place.filter(|(pose, _)| translate::is_sayable(pose));
        let covariance = place
            .as_ref()
            .filter(|_| self.status == RangingStatus::Converged)
            .map(|(_, place)| triangle(&place.covariance));
        let document = RangingDocument {
            status: self.status,
            modes: self.modes as u64,
            why: self.why,
            by: place.as_ref().map(|_| self.by),
            taken_ns: self.at.as_nanos(),
            pose: place
                .as_ref()
                .map(|(pose, _)| translate::pose_document(pose)),
            reduced: place.as_ref().map(|(_, place)| RangedDocument {
                position_level_m: place.pose.position_m.into(),
                yaw_rad: place.pose.yaw_rad,
                covariance_position_yaw: covariance,
            }),
        };
        let offset_us = (self.at - taken).as_micros_rounded();
        let estimate = RangingEstimate {
            vehicle: name.hash(),
            modes: u8::try_from(self.modes).unwrap_or(u8::MAX),
            taken_offset_us: i32::try_from(offset_us).unwrap_or(i32::MIN),
            reduced: place.as_ref().map(|(_, place)| {
                let [x, y, z]: [f64; 3] = place.pose.position_m.into();
                [x, y, z, place.pose.yaw_rad]
            }),
            covariance: covariance.map(RangingCovariance::PositionYaw),
        };
        (document, estimate)
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
