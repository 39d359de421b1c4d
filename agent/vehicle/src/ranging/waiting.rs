//! Distances that wait until the odometry of both their ends has come, and what they are then.

use std::collections::VecDeque;

use nalgebra::Vector3;
use skein_estimation::odometry::{Gap, OdometryPoint};
use skein_estimation::ranging::RangeSample;
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Odometry, Transform};
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::name::Name;

use super::Readable;
use super::geometry::{levelled, point};
use crate::refused::Refused;

/// How long a distance waits.
const WAIT_MAX: Span = Span::secs(2);
/// Periods for which every distance is held back, so that what others measured comes in order of its time.
const HELD_PERIODS: i64 = 2;

/// One end of a distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Party {
    Own,
    Neighbour(Name),
}

/// A distance that waits for the odometry of its time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    /// Who measured it.
    by: Party,
    /// To whom.
    of: Party,
    /// On this vehicle's clock.
    taken: Stamp,
    distance_m: f64,
    sigma_m: f64,
    /// Where the sensor was, in the measuring vehicle's odometry frame (m).
    sensor_m: Vector3<f64>,
}

/// Both vehicles at one moment, in the order of their parties.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ends {
    pub(crate) taken: Stamp,
    pub(crate) own: OdometryPoint,
    pub(crate) neighbour: OdometryPoint,
}

/// All that wait, up to a bound.
#[derive(Clone, Debug)]
pub(super) struct Queue {
    waiting: VecDeque<Waiting>,
    most: usize,
}

impl Waiting {
    /// None of any other kind of measurement.
    pub(super) fn new(
        by: Party,
        of: Party,
        taken: Stamp,
        measured: &Measured,
        odometry_from_body: &Transform<Odometry, Body>,
    ) -> Option<Self> {
        let MeasuredValue::Distance {
            distance_m,
            origin_m,
            sigma_m,
        } = measured.value
        else {
            return None;
        };
        Some(Self {
            by,
            of,
            taken,
            distance_m,
            sigma_m: f64::from(sigma_m),
            sensor_m: point(odometry_from_body, &Vector3::from(origin_m)),
        })
    }

    /// Its two ends in the order of their parties.
    pub(super) fn parties(&self) -> (Party, Party) {
        (self.by.min(self.of), self.by.max(self.of))
    }

    /// With the points between which it was measured: the sensor at one end, the target at the other.
    fn resolve(&self, from: &Readable<'_>) -> Result<(RangeSample, Ends), Gap> {
        let (first, second) = self.parties();
        let (own, own_m) = self.end(from, first)?;
        let (neighbour, neighbour_m) = self.end(from, second)?;
        let sample = RangeSample {
            taken: self.taken,
            range_m: self.distance_m,
            sigma_m: self.sigma_m,
            own: levelled(&own, own_m),
            neighbour: levelled(&neighbour, neighbour_m),
        };
        let ends = Ends {
            taken: self.taken,
            own,
            neighbour,
        };
        Ok((sample, ends))
    }

    /// One vehicle then, and its end of the distance in its odometry frame (m).
    fn end(&self, from: &Readable<'_>, party: Party) -> Result<(OdometryPoint, Vector3<f64>), Gap> {
        let (at, body_from_target) = match party {
            Party::Own => (from.reckoning.near(self.taken)?, &from.body_from_target),
            Party::Neighbour(name) => {
                let boot = from.boot(name).ok_or(Gap::Before)?;
                let theirs = boot.clock.to_peer(self.taken).ok_or(Gap::Before)?;
                (boot.odometry_at(theirs)?, &boot.body_from_target)
            }
        };
        let end_m = if party == self.by {
            self.sensor_m
        } else {
            point(&at.odometry_from_body, &body_from_target.translation)
        };
        Ok((at, end_m))
    }
}

/// A distance with both its ends, or why it has none.
pub(super) type Settled = Result<(RangeSample, Ends), Refused>;

impl Queue {
    pub(super) const fn new(most: usize) -> Self {
        Self {
            waiting: VecDeque::new(),
            most,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    pub(super) fn push(&mut self, waiting: Waiting) -> Result<(), Refused> {
        if self.waiting.len() >= self.most {
            return Err(Refused::Full);
        }
        self.waiting.push_back(waiting);
        Ok(())
    }

    pub(super) fn retain(&mut self, keep: impl FnMut(&Waiting) -> bool) {
        self.waiting.retain(keep);
    }

    /// Takes out every distance of which both ends are known, and those that are given up, in order of their times.
    pub(super) fn settled(&mut self, from: &Readable<'_>) -> Vec<(Waiting, Settled)> {
        let held_since = from.now - from.period * HELD_PERIODS;
        let given_up = from.now - WAIT_MAX;
        let (mut ripe, held): (Vec<_>, Vec<_>) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition(|waiting| waiting.taken <= held_since);
        self.waiting = held.into();
        ripe.sort_by_key(|waiting| (waiting.taken, waiting.parties()));
        let mut settled = Vec::new();
        for waiting in ripe {
            match waiting.resolve(from) {
                Ok(resolved) => settled.push((waiting, Ok(resolved))),
                Err(Gap::NotYet) if waiting.taken >= given_up => self.waiting.push_back(waiting),
                Err(_) => settled.push((waiting, Err(Refused::NoOdometry))),
            }
        }
        settled
    }
}
