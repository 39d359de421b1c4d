//! What is known of one vehicle that tells what it sees, this one included: its newest set, how it moves between sets, and
//! the tracks that are followed as lanes of the pair models.

use super::pair_model::{LANES_MAX, Sight, crossing};
use crate::mutual::direction::{azimuth_rad, difference, turned, zenith_rad};
use crate::mutual::feature_set::{
    FEATURES_MAX, Feature, FeatureSet, Inertial, Motion, TRACKS_MAX, TrackNumber,
};
use crate::mutual::unused::{Unused, is_flyable, is_understood};
use crate::time::{Span, Stamp};
use crate::vehicle_id::VehicleId;
use nalgebra::{UnitVector3, Vector3};

/// Sets whose features wait to be used; of more the oldest are passed over.
const WAITING_MAX: usize = 4;
/// Longest that a vehicle is taken to go on accelerating and turning as it last told (s).
const EXTRAPOLATED_MAX_S: f64 = 0.3;
/// What a vehicle that is silent for longer may do, as white noise: accelerations of 1.5 m/s^2 and turns of 0.3 rad/s that
/// last for most of a second (m^2/s^3, rad^2/s).
const SILENT_ACCELERATION_M2_S3: f64 = 3.0;
const SILENT_TURN_RAD2_S: f64 = 0.1;
/// A stamp that leaves the sender's own integration by more than this (s): it was restarted, or its clock was set. What was
/// known of it was of another time.
const CLOCK_LEFT_S: f64 = 0.1;
/// How much of what a stamp leaves the integration by is drift of clocks (per second).
const CLOCK_DRIFT: f64 = 0.01;
/// Tracks of a vehicle that has been silent for so long are dead (s).
const TRACKS_LIVE_S: f64 = 0.5;
/// Crossings mixed less than this are passed over.
const CROSSING_MIN: f64 = 0.005;

/// One vehicle.
#[derive(Clone, Debug)]
pub(super) struct Talker {
    pub(super) vehicle: VehicleId,
    pub(super) taken: Stamp,
    inertial: Inertial,
    /// When its integration began, by the stamps.
    began: Stamp,
    /// Mean acceleration without gravity (m/s^2) in the gyro frame, and yaw rate (rad/s), over the last interval.
    rates: (Vector3<f64>, f64),
    /// What the filters have moved it by so far.
    used: Inertial,
    waiting: Vec<Waiting>,
    tracks: Vec<(TrackNumber, UnitVector3<f64>, f64)>,
    /// Variance of one of its features (rad^2).
    feature_variance_rad2: f64,
    /// Something was heard since the last epoch.
    fresh: bool,
    lanes: Vec<TrackNumber>,
    lane_directions: Vec<UnitVector3<f64>>,
    sights: Vec<Sight>,
    before: Vec<Option<usize>>,
    crossings: Vec<(usize, usize, f64)>,
}

/// Features not used yet, in the gyro frame.
#[derive(Clone, Debug)]
pub(super) struct Waiting {
    pub(super) taken: Stamp,
    pub(super) features: Vec<Feature>,
}

/// How a set that is taken fits what was told before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Taken {
    /// It goes on.
    Newer,
    /// Its sender was restarted: its gyro frame and its track numbers are others.
    Restarted,
}

impl Talker {
    /// A vehicle heard for the first time.
    ///
    /// # Errors
    /// [`Unused::Implausible`].
    pub(super) fn new(vehicle: VehicleId, set: &FeatureSet) -> Result<Self, Unused> {
        if !is_understood(set) {
            return Err(Unused::Implausible);
        }
        let mut talker = Self {
            vehicle,
            taken: set.taken,
            inertial: set.inertial,
            began: began(set),
            rates: (Vector3::zeros(), 0.0),
            used: set.inertial,
            waiting: Vec::with_capacity(WAITING_MAX),
            tracks: Vec::with_capacity(TRACKS_MAX),
            feature_variance_rad2: 0.0,
            fresh: false,
            lanes: Vec::with_capacity(LANES_MAX),
            lane_directions: Vec::with_capacity(LANES_MAX),
            sights: Vec::with_capacity(LANES_MAX),
            before: Vec::with_capacity(LANES_MAX),
            crossings: Vec::new(),
        };
        talker.take(set);
        Ok(talker)
    }

    /// Takes a further set; of a sender that was restarted nothing is taken.
    ///
    /// # Errors
    /// [`Unused::TooOld`] and [`Unused::Implausible`]: then nothing has changed.
    pub(super) fn hear(&mut self, set: &FeatureSet) -> Result<Taken, Unused> {
        if set.taken <= self.taken {
            return Err(Unused::TooOld);
        }
        if !is_understood(set) {
            return Err(Unused::Implausible);
        }
        let drift_max_s = CLOCK_DRIFT * (set.taken - self.taken).as_secs_f64();
        let left_s = (began(set) - self.began).as_secs_f64();
        if left_s.abs() > CLOCK_LEFT_S + drift_max_s {
            return Ok(Taken::Restarted);
        }
        if !is_flyable(&set.inertial.since(&self.inertial)) {
            return Err(Unused::Implausible);
        }
        let faster = set.inertial.velocity_m_s - self.inertial.velocity_m_s;
        let turned_rad = set.inertial.yaw_rad - self.inertial.yaw_rad;
        let elapsed_s = set.inertial.elapsed_s - self.inertial.elapsed_s;
        self.began += Span::from_secs_f64(left_s.clamp(-drift_max_s, drift_max_s));
        self.rates = (faster / elapsed_s, turned_rad / elapsed_s);
        self.take(set);
        Ok(Taken::Newer)
    }

    fn take(&mut self, set: &FeatureSet) {
        self.taken = set.taken;
        self.inertial = set.inertial;
        let yaw_rad = set.inertial.yaw_rad;
        if self.waiting.len() == WAITING_MAX {
            self.waiting.remove(0);
        }
        let usable = set.features.iter().take(FEATURES_MAX).filter(|feature| {
            is_direction(&feature.direction) && feature.sigma_rad > 1e-4 && feature.sigma_rad < 1.0
        });
        let features: Vec<Feature> = usable
            .map(|feature| Feature {
                direction: turned(&feature.direction, yaw_rad),
                ..*feature
            })
            .collect();
        if let Some(feature) = features.first() {
            self.feature_variance_rad2 = feature.sigma_rad * feature.sigma_rad;
        }
        self.waiting.push(Waiting {
            taken: set.taken,
            features,
        });
        self.tracks.clear();
        for track in set.tracks.iter().take(TRACKS_MAX) {
            let variance = track.variance_rad2;
            let known = self
                .tracks
                .iter()
                .any(|(number, ..)| *number == track.number);
            if track.confirmed
                && !known
                && is_direction(&track.direction)
                && variance > 0.0
                && variance < 1.0
            {
                self.tracks.push((track.number, track.direction, variance));
            }
        }
        self.fresh = true;
    }

    /// Where its integrals are at an instant: as told, carried on for a short while with the rates it had.
    pub(super) fn inertial_at(&self, at: Stamp) -> Inertial {
        let away_s = (at - self.taken).as_secs_f64();
        let held_s = away_s.clamp(-EXTRAPOLATED_MAX_S, EXTRAPOLATED_MAX_S);
        let (acceleration, yaw_rate) = self.rates;
        let faster = acceleration * held_s;
        Inertial {
            elapsed_s: self.inertial.elapsed_s + away_s,
            yaw_rad: self.inertial.yaw_rad + yaw_rate * held_s,
            velocity_m_s: self.inertial.velocity_m_s + faster,
            position_m: self.inertial.position_m
                + self.inertial.velocity_m_s * away_s
                + faster * (away_s - 0.5 * held_s),
        }
    }

    /// What is not known of its motion in a step of `dt_s` up to an instant, because it is silent: variances of its velocity
    /// (m^2/s^2, per axis) and yaw (rad^2).
    pub(super) fn unheard(&self, at: Stamp, dt_s: f64) -> (f64, f64) {
        if (at - self.taken).as_secs_f64() > EXTRAPOLATED_MAX_S {
            (SILENT_ACCELERATION_M2_S3 * dt_s, SILENT_TURN_RAD2_S * dt_s)
        } else {
            (0.0, 0.0)
        }
    }

    /// How it moved since this was last asked, in its level frame of then. What was guessed then and is known now is
    /// made good: the integrals are cumulative.
    pub(super) fn moved_until(&mut self, at: Stamp) -> Motion {
        let now = self.inertial_at(at);
        let motion = now.since(&self.used);
        self.used = now;
        motion
    }

    /// Its integrated yaw (rad) at the instant [`moved_until`](Self::moved_until) was last asked for.
    pub(super) fn yaw_rad(&self) -> f64 {
        self.used.yaw_rad
    }

    /// The features not used yet, oldest first.
    pub(super) fn waiting(&mut self) -> Vec<Waiting> {
        std::mem::take(&mut self.waiting)
    }

    /// Brings the lanes up to its newest tracks, at an epoch at `now`. Whether there is news of them.
    pub(super) fn refresh_lanes(&mut self, now: Stamp) -> bool {
        if (now - self.taken).as_secs_f64() > TRACKS_LIVE_S {
            self.tracks.clear();
        }
        let held = |number: &TrackNumber| self.lanes.iter().position(|lane| lane == number);
        // Lanes that live come first and in their order, so that a flood of new tracks displaces none.
        let mut next: Vec<(Option<usize>, usize)> = (0..self.tracks.len())
            .map(|track| (held(&self.tracks[track].0), track))
            .collect();
        next.sort_by_key(|(lane, track)| (lane.unwrap_or(usize::MAX), *track));
        next.truncate(LANES_MAX);
        self.lanes.clear();
        self.lane_directions.clear();
        self.sights.clear();
        self.before.clear();
        self.crossings.clear();
        for (lane, track) in next {
            let (number, direction, variance_rad2) = self.tracks[track];
            self.before.push(lane);
            self.lanes.push(number);
            self.lane_directions.push(direction);
            self.sights.push(Sight {
                azimuth_rad: azimuth_rad(&direction),
                zenith_rad: zenith_rad(&direction),
                variance_rad2,
            });
        }
        for second in 1..self.sights.len() {
            for first in 0..second {
                let apart = difference(&self.lane_directions[first], &self.lane_directions[second]);
                let variance_rad2 = self.sights[first].variance_rad2
                    + self.sights[second].variance_rad2
                    + 0.5 * self.feature_variance_rad2;
                let mixed = crossing(apart.norm_squared(), variance_rad2);
                if mixed > CROSSING_MIN {
                    self.crossings.push((first, second, mixed));
                }
            }
        }
        std::mem::take(&mut self.fresh)
    }

    /// What was known of each lane at the epoch before, for the lanes of now; `new` for new ones.
    pub(super) fn carried_over(&self, known: &[f64], new: f64) -> Vec<f64> {
        let carried = |before: &Option<usize>| {
            before
                .and_then(|before| known.get(before))
                .copied()
                .unwrap_or(new)
        };
        self.before.iter().map(carried).collect()
    }

    /// The lane of a track.
    pub(super) fn lane_of(&self, track: Option<TrackNumber>) -> Option<usize> {
        track.and_then(|track| self.lanes.iter().position(|lane| *lane == track))
    }

    /// Directions of the lanes, in its gyro frame, at the last epoch.
    pub(super) fn lane_directions(&self) -> &[UnitVector3<f64>] {
        &self.lane_directions
    }

    /// Newest confirmed tracks: which, where in the gyro frame, variance (rad^2).
    pub(super) fn tracks(&self) -> &[(TrackNumber, UnitVector3<f64>, f64)] {
        &self.tracks
    }

    /// The lanes as the pair models take them.
    pub(super) fn side(&self) -> super::pair_model::Side<'_> {
        super::pair_model::Side {
            sights: &self.sights,
            before: &self.before,
            crossings: &self.crossings,
        }
    }
}

/// When the integration of a set began, by its stamp.
fn began(set: &FeatureSet) -> Stamp {
    set.taken - Span::from_secs_f64(set.inertial.elapsed_s)
}

fn is_direction(direction: &UnitVector3<f64>) -> bool {
    (direction.norm_squared() - 1.0).abs() < 1e-3
}

#[cfg(test)]
mod tests;
