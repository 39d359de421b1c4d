//! Follows what one vehicle sees from image to image, in the frame that does not turn with it, and says what is the same
//! thing as before; not which robot it is.
//!
//! A track is a direction that moves at a nearly constant angular velocity, with one variance for both axes: a sphere has
//! no preferred axis, and nothing here fails straight up.

use crate::mutual::assignment::assign;
use crate::mutual::direction::{difference, tangents, turned};
use crate::mutual::feature_set::{FEATURES_MAX, Feature, TRACKS_MAX, Track, TrackNumber};
use crate::time::Stamp;
use nalgebra::{UnitVector3, Vector3};

/// Angular acceleration as white noise (rad^2/s^3): robots that pass within metres.
const MANOEUVRE_RAD2_S3: f64 = 0.05;
/// Variance of the angular velocity of a new track, and its greatest (rad^2/s^2).
const RATE_VARIANCE_MAX: f64 = 0.25;
/// Squared normalised distance beyond which a feature is another thing: 0.1 % of its own exceed it in two dimensions.
const GATE: f64 = 13.8;
/// What leaving a track without a feature costs: a little more than the dearest feature within the gate.
const MISSED_COST: f64 = GATE + 1.4;
/// What a track costs more that was not seen often.
const UNCONFIRMED_COST: f64 = 2.0;
/// How often a track is seen before it is believed.
const CONFIRMING_HITS: u8 = 3;
/// How long a track lives unseen (s) before and after it is confirmed. Longer coasting steals the features of others that
/// pass by; gaps are bridged where identities are kept.
const COAST_S: [f64; 2] = [0.12, 0.5];
/// Variance (rad^2) beyond which a track says nothing.
const VARIANCE_MAX_RAD2: f64 = 0.35 * 0.35;
/// Unseen for longer than this (s), a track slows down with the time constant after it (s).
const SLOWS_AFTER_S: f64 = 0.3;
const SLOWING_S: f64 = 1.5;
/// Least standard deviation that is believed of a feature (rad).
const SIGMA_MIN_RAD: f64 = 1e-4;
/// Longest step that is predicted at once (s): after a longer pause nothing is the same thing as before.
const STEP_MAX_S: f64 = 1.0;

/// The tracks of one vehicle; at most [`TRACKS_MAX`].
#[derive(Clone, Debug)]
pub struct Tracker {
    followed: Vec<Followed>,
    at: Option<Stamp>,
    next_number: u16,
}

#[derive(Clone, Debug)]
struct Followed {
    number: TrackNumber,
    direction: UnitVector3<f64>,
    /// Across `direction` (rad/s).
    rate: Vector3<f64>,
    /// Variance of the direction, covariance with the rate, variance of the rate, per axis.
    variance: [f64; 3],
    hits: u8,
    unseen_s: f64,
}

impl Default for Tracker {
    fn default() -> Self {
        Self::new()
    }
}

impl Tracker {
    /// Nothing was seen yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            followed: Vec::with_capacity(TRACKS_MAX),
            at: None,
            next_number: 0,
        }
    }

    /// Takes one image: its features in the level frame, when it was taken and the integrated yaw then (rad, as in
    /// [`Inertial::yaw_rad`](crate::mutual::Inertial::yaw_rad)). Writes into each feature which track it went into, and
    /// gives all tracks. Features beyond [`FEATURES_MAX`] and those that are no directions go into none.
    ///
    /// An image that is not newer than the one before changes nothing.
    pub fn scan(&mut self, taken: Stamp, yaw_rad: f64, features: &mut [Feature]) -> Vec<Track> {
        for feature in features.iter_mut() {
            feature.track = None;
        }
        let elapsed_s = self.at.map_or(0.0, |at| (taken - at).as_secs_f64());
        if !yaw_rad.is_finite() || self.at.is_some_and(|at| taken <= at) {
            return self.tracks();
        }
        self.at = Some(taken);
        if elapsed_s > STEP_MAX_S {
            self.followed.clear();
        }
        for track in &mut self.followed {
            track.predict(elapsed_s);
        }
        let usable = |feature: &Feature| {
            (feature.direction.norm_squared() - 1.0).abs() < 1e-3 && feature.sigma_rad.is_finite()
        };
        let seen: Vec<Seen> = features
            .iter()
            .enumerate()
            .take(FEATURES_MAX)
            .filter(|(_, feature)| usable(feature))
            .map(|(index, feature)| Seen {
                index,
                direction: turned(&feature.direction, yaw_rad),
                variance_rad2: feature.sigma_rad.max(SIGMA_MIN_RAD).powi(2),
            })
            .collect();
        let assigned = assign(
            self.followed.len(),
            seen.len(),
            MISSED_COST,
            |track, feature| self.followed[track].cost(&seen[feature]),
        );
        let mut used = vec![false; seen.len()];
        for (track, feature) in self.followed.iter_mut().zip(assigned) {
            if let Some(feature) = feature {
                used[feature] = true;
                track.update(&seen[feature]);
                features[seen[feature].index].track = Some(track.number);
            } else {
                track.unseen_s += elapsed_s;
            }
        }
        self.followed.retain(Followed::lives);
        for (seen, _) in seen.iter().zip(used).filter(|(_, used)| !used) {
            if self.followed.len() < TRACKS_MAX {
                let number = self.unused_number();
                self.followed.push(Followed::born(number, seen));
                features[seen.index].track = Some(number);
            }
        }
        self.tracks()
    }

    /// All that is followed, in the gyro frame.
    #[must_use]
    pub fn tracks(&self) -> Vec<Track> {
        let told = |track: &Followed| Track {
            number: track.number,
            direction: track.direction,
            variance_rad2: track.variance[0],
            confirmed: track.hits >= CONFIRMING_HITS,
        };
        self.followed.iter().map(told).collect()
    }

    /// A number no living track has; there is one, as there are more numbers than tracks.
    fn unused_number(&mut self) -> TrackNumber {
        loop {
            let number = TrackNumber(self.next_number);
            self.next_number = self.next_number.wrapping_add(1);
            if self.followed.iter().all(|track| track.number != number) {
                return number;
            }
        }
    }
}

/// A feature in the gyro frame.
struct Seen {
    index: usize,
    direction: UnitVector3<f64>,
    variance_rad2: f64,
}

impl Followed {
    fn born(number: TrackNumber, seen: &Seen) -> Self {
        Self {
            number,
            direction: seen.direction,
            rate: Vector3::zeros(),
            variance: [seen.variance_rad2, 0.0, RATE_VARIANCE_MAX],
            hits: 1,
            unseen_s: 0.0,
        }
    }

    fn predict(&mut self, dt: f64) {
        self.turn(&(self.rate * dt));
        let [p11, p12, p22] = self.variance;
        let q = MANOEUVRE_RAD2_S3;
        self.variance = [
            p11 + 2.0 * dt * p12 + dt * dt * p22 + q * dt.powi(3) / 3.0,
            p12 + dt * p22 + q * dt * dt / 2.0,
            (p22 + q * dt).min(RATE_VARIANCE_MAX),
        ];
        if self.unseen_s > SLOWS_AFTER_S {
            self.rate *= (-dt / SLOWING_S).exp();
        }
    }

    /// Squared normalised distance, with what makes wide tracks dearer; beyond the gate it is forbidden.
    fn cost(&self, seen: &Seen) -> f64 {
        let innovation_variance = self.variance[0] + seen.variance_rad2;
        let distance =
            difference(&self.direction, &seen.direction).norm_squared() / innovation_variance;
        if distance > GATE {
            return f64::INFINITY;
        }
        let unconfirmed = if self.hits < CONFIRMING_HITS {
            UNCONFIRMED_COST
        } else {
            0.0
        };
        distance + 2.0 * (innovation_variance / seen.variance_rad2).ln() + unconfirmed
    }

    fn update(&mut self, seen: &Seen) {
        let [p11, p12, p22] = self.variance;
        let innovation_variance = p11 + seen.variance_rad2;
        let (k1, k2) = (p11 / innovation_variance, p12 / innovation_variance);
        let away = difference(&self.direction, &seen.direction);
        let [azimuthal, zenithal] = tangents(&self.direction);
        let innovation = azimuthal * away.x + zenithal * away.y;
        self.rate += innovation * k2;
        self.turn(&(innovation * k1));
        self.variance = [p11 * (1.0 - k1), p12 * (1.0 - k1), p22 - k2 * p12];
        self.hits = self.hits.saturating_add(1);
        self.unseen_s = 0.0;
    }

    /// Moves along the sphere by `step` (rad, across the direction) and takes the rate along without turning it.
    fn turn(&mut self, step: &Vector3<f64>) {
        let arc = step.norm();
        if arc < 1e-12 {
            return;
        }
        let (from, along) = (self.direction.into_inner(), step / arc);
        let (sin, cos) = arc.sin_cos();
        let to = from * cos + along * sin;
        // The part of the rate along the path turns with it; the part across stays.
        let forward = self.rate.dot(&along);
        self.rate += (along * cos - from * sin - along) * forward;
        self.direction = UnitVector3::new_normalize(to);
        self.rate -= to * to.dot(&self.rate);
    }

    fn lives(&self) -> bool {
        let confirmed = usize::from(self.hits >= CONFIRMING_HITS);
        self.unseen_s <= COAST_S[confirmed] && self.variance[0] < VARIANCE_MAX_RAD2
    }
}

#[cfg(test)]
mod tests {
    use super::super::flight::stamp;
    use super::*;
    use crate::mutual::direction::{from_angles, moved};
    use nalgebra::Vector2;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SIGMA_RAD: f64 = 0.087;

    fn feature(direction: UnitVector3<f64>) -> Feature {
        Feature {
            direction,
            sigma_rad: SIGMA_RAD,
            track: None,
        }
    }

    #[test]
    fn something_that_moves_steadily_is_one_track_and_better_known_than_one_sight_of_it() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut tracker = Tracker::new();
        let (mut numbers, mut error2, mut count) = (Vec::new(), 0.0, 0.0);
        for step in 0..200 {
            let t_s = 0.05 * f64::from(step);
            let truth = from_angles(0.3 * t_s, 1.2 + 0.2 * (0.5 * t_s).sin());
            let mut noise = || -> f64 {
                let normal: f64 = StandardNormal.sample(&mut rng);
                SIGMA_RAD * normal
            };
            let mut seen = [feature(moved(&truth, &Vector2::new(noise(), noise())))];
            let tracks = tracker.scan(stamp(t_s), 0.0, &mut seen);
            numbers.push(seen[0].track);
            if step > 20 {
                let told = tracks
                    .iter()
                    .find(|track| Some(track.number) == seen[0].track);
                error2 += difference(&truth, &told.expect("it is followed").direction)
                    .norm_squared()
                    / 2.0;
                count += 1.0;
            }
        }
        numbers.dedup();
        assert_eq!(numbers.len(), 1);
        let rms_rad = f64::sqrt(error2 / count);
        assert!(rms_rad < 0.6 * SIGMA_RAD, "{rms_rad}");
    }

    #[test]
    fn what_stands_still_stands_still_for_a_vehicle_that_turns() {
        let mut tracker = Tracker::new();
        let still = from_angles(0.4, 1.3);
        for step in 0..40 {
            let yaw_rad = 0.1 * f64::from(step);
            let mut seen = [feature(turned(&still, -yaw_rad))];
            let tracks = tracker.scan(stamp(0.05 * f64::from(step)), yaw_rad, &mut seen);
            assert_eq!(tracks.len(), 1);
            assert!(difference(&still, &tracks[0].direction).norm() < 1e-9);
        }
    }

    #[test]
    fn what_passes_overhead_stays_the_same_thing() {
        let mut tracker = Tracker::new();
        let mut numbers = Vec::new();
        for step in -40..40 {
            let arc_rad = 0.02 * f64::from(step);
            let azimuth_rad = if arc_rad < 0.0 {
                0.0
            } else {
                std::f64::consts::PI
            };
            let mut seen = [feature(from_angles(azimuth_rad, arc_rad.abs()))];
            let _ = tracker.scan(stamp(0.05 * f64::from(step)), 0.0, &mut seen);
            numbers.push(seen[0].track);
        }
        numbers.dedup();
        assert_eq!(numbers.len(), 1);
    }

    #[test]
    fn a_track_is_believed_at_the_third_sight_and_given_up_after_half_a_second_without() {
        let mut tracker = Tracker::new();
        let there = from_angles(1.0, 1.5);
        for step in 0..3 {
            let tracks = tracker.scan(stamp(0.05 * f64::from(step)), 0.0, &mut [feature(there)]);
            assert_eq!(tracks[0].confirmed, step == 2);
        }
        assert_eq!(tracker.scan(stamp(0.55), 0.0, &mut []).len(), 1);
        assert_eq!(tracker.scan(stamp(0.65), 0.0, &mut []).len(), 0);
    }

    #[test]
    fn tracks_are_bounded_and_what_is_no_direction_is_in_none() {
        let mut tracker = Tracker::new();
        let mut seen: Vec<Feature> = (0..FEATURES_MAX + 1)
            .map(|index| feature(from_angles(0.19 * index as f64, 0.7 + 0.05 * index as f64)))
            .collect();
        assert_eq!(
            tracker.scan(stamp(0.0), 0.0, &mut seen).len(),
            TRACKS_MAX.min(FEATURES_MAX)
        );
        assert_eq!(seen[FEATURES_MAX].track, None);
        let mut hostile = [feature(UnitVector3::new_unchecked(Vector3::repeat(
            f64::NAN,
        )))];
        let mut tracker = Tracker::new();
        assert_eq!(tracker.scan(stamp(1.0), 0.0, &mut hostile), []);
    }

    #[test]
    fn an_older_image_changes_nothing() {
        let mut tracker = Tracker::new();
        let there = from_angles(1.0, 1.5);
        let before = tracker.scan(stamp(1.0), 0.0, &mut [feature(there)]);
        assert_eq!(
            tracker.scan(stamp(0.5), 0.0, &mut [feature(from_angles(2.0, 1.0))]),
            before
        );
    }
}
