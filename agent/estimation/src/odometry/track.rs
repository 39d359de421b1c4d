//! A bounded stretch of cumulative odometry, of this vehicle or of a neighbour, that answers for any instant within.
//!
//! Only odometry is interpolated, never an estimate; nothing is extrapolated but a moment's clock error.

use std::collections::VecDeque;

use crate::odometry::Growth;
use crate::time::{Span, Stamp};
use crate::{Body, Odometry, Transform, se3};

/// Points kept at most; at 400 Hz about ten seconds.
pub const TRACK_POINTS_MAX: usize = 4096;
/// How far behind the newest point the track reaches.
pub const TRACK_SPAN: Span = Span::secs(8);
/// How far past the newest point it still answers. It covers the jitter of a clock offset and nothing else: at 10 m/s^2
/// the constant speed assumed here is wrong by 20 micrometres.
pub const EXTRAPOLATION_MAX: Span = Span::millis(2);

/// Where odometry says a vehicle was at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryPoint {
    /// When, on the clock of whoever owns the odometry.
    pub taken: Stamp,
    /// Rises when odometry was interrupted; across two segments nothing is known.
    pub segment: u8,
    /// Cumulative odometry.
    pub odometry_from_body: Transform<Odometry, Body>,
    /// Covariance gathered so far.
    pub growth: Growth,
}

/// Why a track has no answer for an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gap {
    /// The instant is later than what is known yet.
    NotYet,
    /// The instant is earlier than what is still kept, or nothing was ever known.
    Before,
    /// Odometry was interrupted around the instant.
    Interrupted,
}

/// Points in order of time, without two of the same instant.
#[derive(Clone, Debug, Default)]
pub struct Track {
    points: VecDeque<OdometryPoint>,
}

impl Track {
    /// An empty track.
    pub const fn new() -> Self {
        Self {
            points: VecDeque::new(),
        }
    }

    /// The newest point.
    pub fn newest(&self) -> Option<&OdometryPoint> {
        self.points.back()
    }

    /// Adds a point wherever it belongs in time. A point of an instant that is known already changes nothing: what was
    /// said once stays said. Returns whether it was new.
    pub fn insert(&mut self, point: OdometryPoint) -> bool {
        let at = self
            .points
            .partition_point(|known| known.taken < point.taken);
        if self
            .points
            .get(at)
            .is_some_and(|known| known.taken == point.taken)
        {
            return false;
        }
        self.points.insert(at, point);
        let newest = self.points[self.points.len() - 1].taken;
        while self.points.len() > TRACK_POINTS_MAX
            || self
                .points
                .front()
                .is_some_and(|oldest| newest - oldest.taken > TRACK_SPAN)
        {
            self.points.pop_front();
        }
        true
    }

    /// The odometry of an instant: a point itself, between two of one segment (constant twist), or at most
    /// [`EXTRAPOLATION_MAX`] past the newest.
    ///
    /// # Errors
    /// The [`Gap`] says why there is none.
    pub fn at(&self, instant: Stamp) -> Result<OdometryPoint, Gap> {
        let next = self.points.partition_point(|known| known.taken < instant);
        if let Some(exact) = self.points.get(next).filter(|known| known.taken == instant) {
            return Ok(*exact);
        }
        if next == 0 {
            return Err(if self.points.is_empty() {
                Gap::NotYet
            } else {
                Gap::Before
            });
        }
        let Some(after) = self.points.get(next) else {
            return self.past_the_newest(instant);
        };
        let before = &self.points[next - 1];
        if before.segment != after.segment {
            return Err(Gap::Interrupted);
        }
        Ok(between(before, after, instant))
    }

    /// As [`Track::at`], but it answers further past the newest point: a quarter of the step between the last two. With a
    /// step P and an acceleration a the speed assumed there is wrong by no more than 5/32 |a| P^2, about what it is
    /// wrong between two points (|a| P^2 / 8). For who must not wait for the next point.
    ///
    /// # Errors
    /// The [`Gap`] says why there is none.
    pub fn near(&self, instant: Stamp) -> Result<OdometryPoint, Gap> {
        match (self.at(instant), self.last_step()) {
            (Err(Gap::NotYet), Some((before, newest)))
                if instant - newest.taken
                    <= Span::from_nanos((newest.taken - before.taken).as_nanos() / 4) =>
            {
                Ok(between(before, newest, instant))
            }
            (answer, _) => answer,
        }
    }

    fn past_the_newest(&self, instant: Stamp) -> Result<OdometryPoint, Gap> {
        match self.last_step() {
            Some((before, newest)) if instant - newest.taken <= EXTRAPOLATION_MAX => {
                Ok(between(before, newest, instant))
            }
            _ => Err(Gap::NotYet),
        }
    }

    /// The last two points, when nothing was interrupted between them.
    fn last_step(&self) -> Option<(&OdometryPoint, &OdometryPoint)> {
        let mut newest_first = self.points.iter().rev();
        let (newest, before) = (newest_first.next()?, newest_first.next()?);
        (before.segment == newest.segment).then_some((before, newest))
    }
}

fn between(before: &OdometryPoint, after: &OdometryPoint, instant: Stamp) -> OdometryPoint {
    let fraction =
        (instant - before.taken).as_nanos() as f64 / (after.taken - before.taken).as_nanos() as f64;
    OdometryPoint {
        taken: instant,
        segment: before.segment,
        odometry_from_body: se3::interpolate(
            &before.odometry_from_body,
            &after.odometry_from_body,
            fraction,
        ),
        growth: before.growth.between(&after.growth, fraction),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    fn point(millis: i64, segment: u8, x: f64, yaw: f64) -> OdometryPoint {
        OdometryPoint {
            taken: Stamp::default() + Span::millis(millis),
            segment,
            odometry_from_body: Transform::new(
                UnitQuaternion::from_euler_angles(0.0, 0.0, yaw),
                Vector3::new(x, 0.0, 0.0),
            ),
            growth: Growth::zero().after(&Vector3::zeros(), x.sqrt(), 0.0),
        }
    }

    fn at(millis: i64) -> Stamp {
        Stamp::default() + Span::millis(millis)
    }

    #[test]
    fn between_two_points_the_motion_is_of_constant_twist() {
        let mut track = Track::new();
        track.insert(point(0, 0, 0.0, 0.0));
        track.insert(point(200, 0, 2.0, 0.0));
        let middle = track.at(at(50)).unwrap();
        assert!((middle.odometry_from_body.translation.x - 0.5).abs() < 1e-12);
        assert!((middle.growth.rotation - 0.5).abs() < 1e-12);
    }

    #[test]
    fn points_may_come_in_any_order_and_the_first_word_on_an_instant_stands() {
        let mut track = Track::new();
        assert!(track.insert(point(400, 0, 4.0, 0.0)));
        assert!(track.insert(point(0, 0, 0.0, 0.0)));
        assert!(track.insert(point(200, 0, 2.0, 0.0)));
        assert!(!track.insert(point(200, 0, 99.0, 0.0)));
        assert!((track.at(at(300)).unwrap().odometry_from_body.translation.x - 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_gap_says_what_kind_it_is() {
        let mut track = Track::new();
        assert_eq!(track.at(at(0)), Err(Gap::NotYet));
        track.insert(point(100, 0, 1.0, 0.0));
        track.insert(point(200, 1, 2.0, 0.0));
        assert_eq!(track.at(at(50)), Err(Gap::Before));
        assert_eq!(track.at(at(150)), Err(Gap::Interrupted));
        assert_eq!(track.at(at(203)), Err(Gap::NotYet));
    }

    #[test]
    fn past_the_newest_point_it_answers_for_a_moment_only() {
        let mut track = Track::new();
        track.insert(point(0, 0, 0.0, 0.0));
        track.insert(point(200, 0, 2.0, 0.0));
        assert!((track.at(at(202)).unwrap().odometry_from_body.translation.x - 2.02).abs() < 1e-12);
        assert_eq!(track.at(at(202) + Span::from_nanos(1)), Err(Gap::NotYet));
    }

    #[test]
    fn who_must_not_wait_is_answered_up_to_a_quarter_of_a_step_past_the_newest_point() {
        let mut track = Track::new();
        track.insert(point(0, 0, 0.0, 0.0));
        assert_eq!(track.near(at(1)), Err(Gap::NotYet), "of what speed?");
        track.insert(point(200, 0, 2.0, 0.0));
        let ahead = track.near(at(250)).unwrap().odometry_from_body;
        assert!((ahead.translation.x - 2.5).abs() < 1e-12);
        assert_eq!(track.near(at(250) + Span::from_nanos(1)), Err(Gap::NotYet));
        assert_eq!(track.near(at(150)), track.at(at(150)));
        track.insert(point(400, 1, 0.0, 0.0));
        assert_eq!(track.near(at(410)), Err(Gap::NotYet), "interrupted");
    }

    #[test]
    fn what_is_kept_is_bounded_in_number_and_in_time() {
        let mut track = Track::new();
        for millis in 0..=TRACK_POINTS_MAX as i64 {
            track.insert(point(millis, 0, 0.0, 0.0));
        }
        assert_eq!(track.points.len(), TRACK_POINTS_MAX);
        track.insert(point(60_000, 0, 0.0, 0.0));
        assert_eq!(track.points.len(), 1);
    }
}
