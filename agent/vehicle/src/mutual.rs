//! Mutual localisation: camera frames and inertial readings become feature sets, which are told to everybody; own sets and
//! heard ones become where each neighbour is, and who is who.

mod inertial_history;
mod localiser;
mod telling;
mod wire;

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{UnitQuaternion, UnitVector3, Vector3};
use skein_estimation::mutual::feature_set::FEATURES_MAX;
use skein_estimation::mutual::{Done, Feature, FeatureSet, Status, Tracker, Work, attitude};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, VehicleId};
use skein_proto::frame::{BearingsFrame, ImuFrame, RelativeValue};
use skein_proto::name::Name;

use crate::config::MutualConfig;
use crate::counters::Counters;
use crate::refused::Refused;
use inertial_history::{At, InertialHistory, Moment};
use localiser::Localiser;

pub(crate) use wire::{from_wire, to_wire};

/// Camera frames that wait for the inertial readings of their time; as many that were levelled are kept.
const WAITING_MAX: usize = 8;
/// How long they wait.
const WAIT_MAX: Span = Span::millis(200);
/// Neighbours whose names are kept.
const NAMES_MAX: usize = 64;
/// A neighbour's place has been known for so long without a break before a feature is a bearing of it.
const STEADY_MIN: Span = Span::secs(5);
/// It must be seen where its place says it is, to so many standard deviations of the camera.
const FITS_SIGMAS: f64 = 3.0;
/// A feature that is this neighbour with at least this probability is a bearing of it.
const IDENTIFIED_MIN: f64 = 0.95;

/// The pipeline of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Mutual {
    config: MutualConfig,
    inertial_sensor: Option<Name>,
    camera: Option<Name>,
    history: InertialHistory,
    tracker: Tracker,
    waiting: VecDeque<Scan>,
    /// The last frames that were levelled.
    seen: VecDeque<Scan>,
    /// How the vehicle was when it last told a set.
    told: Option<Moment>,
    localiser: Localiser,
    names: BTreeMap<VehicleId, Heard>,
    /// The newest own set.
    newest: Option<FeatureSet>,
    /// Since when each neighbour's place is known without a break.
    converged_since: BTreeMap<VehicleId, Stamp>,
    /// When each neighbour's bearing was last given to the cooperative pipeline.
    offered: BTreeMap<VehicleId, Stamp>,
    counts: Counts,
}

/// A camera frame, not yet levelled.
#[derive(Clone, Debug)]
struct Scan {
    camera: Name,
    taken: Stamp,
    body_from_sensor: Transform<Body, Sensor>,
    sigma_rad: f64,
    /// Unit vectors in the sensor's frame.
    directions: Vec<[f64; 3]>,
    /// The same in the level frame, once it is levelled.
    levelled: Vec<UnitVector3<f64>>,
}

/// What a neighbour last told of its own attitude.
#[derive(Clone, Copy, Debug)]
struct Heard {
    name: Name,
    level_from_body: UnitQuaternion<f64>,
}

#[derive(Clone, Debug, Default)]
struct Counts {
    told: u64,
    heard: u64,
    identified: u64,
    work_begun: u64,
    work_done: u64,
    cut: Counters,
}

/// A camera's bearing of a neighbour that is identified: what the cooperative pipeline takes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct IdentifiedBearing {
    pub(crate) camera: Name,
    pub(crate) taken: Stamp,
    pub(crate) body_from_sensor: Transform<Body, Sensor>,
    pub(crate) target: Name,
    pub(crate) value: RelativeValue,
}

/// What came of a camera frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Scanned {
    /// A set to be told.
    Told {
        set: Box<FeatureSet>,
        bearings: Vec<IdentifiedBearing>,
    },
    /// The frame was given up.
    Lost { camera: Name, why: Refused },
}

impl Mutual {
    pub(crate) fn new(me: Name, boot: u64, config: MutualConfig) -> Self {
        let me = VehicleId(me.hash());
        Self {
            inertial_sensor: None,
            camera: None,
            history: InertialHistory::new(attitude::Settings::standard()),
            tracker: Tracker::new(),
            waiting: VecDeque::new(),
            seen: VecDeque::new(),
            told: None,
            localiser: Localiser::new(me, boot, config.way),
            names: BTreeMap::new(),
            newest: None,
            converged_since: BTreeMap::new(),
            offered: BTreeMap::new(),
            counts: Counts::default(),
            config,
        }
    }

    /// Takes an inertial reading. The first sensor that brings any is the source from then on.
    pub(crate) fn read(
        &mut self,
        sensor: Name,
        body_from_sensor: &Transform<Body, Sensor>,
        frame: &ImuFrame,
    ) -> Result<(), Refused> {
        if *self.inertial_sensor.get_or_insert(sensor) != sensor {
            return Err(Refused::SecondInertial);
        }
        self.history.read(body_from_sensor, frame)
    }

    /// Takes a camera frame. The first camera that brings any is the source from then on: what it does not see in a
    /// frame is not there, which two cameras could not both say.
    pub(crate) fn look(
        &mut self,
        camera: Name,
        body_from_sensor: Transform<Body, Sensor>,
        frame: BearingsFrame,
    ) -> Result<(), Refused> {
        if *self.camera.get_or_insert(camera) != camera {
            return Err(Refused::SecondCamera);
        }
        let taken = Stamp::from_nanos(frame.taken_ns);
        let newest = self.waiting.back().map(|scan| scan.taken);
        let newest = newest.or_else(|| self.newest.as_ref().map(|set| set.taken));
        if newest.is_some_and(|newest| taken <= newest) {
            return Err(Refused::TooLate);
        }
        if self.waiting.len() >= WAITING_MAX {
            return Err(Refused::Full);
        }
        self.waiting.push_back(Scan {
            camera,
            taken,
            body_from_sensor,
            sigma_rad: frame.sigma_rad,
            directions: frame.directions,
            levelled: Vec::new(),
        });
        Ok(())
    }

    /// The next camera frame whose time the inertial readings have reached, as a set; or one that is given up.
    pub(crate) fn next_scan(&mut self, now: Stamp, period: Span) -> Option<Scanned> {
        let scan = self.waiting.front()?;
        let moment = match self.history.at(scan.taken) {
            At::Known(moment) => Ok(moment),
            At::NotYet if now - scan.taken < WAIT_MAX => return None,
            At::NotYet => Err(Refused::NoInertial),
            At::Gone => Err(Refused::TooLate),
        };
        let scan = self.waiting.pop_front().expect("it was just looked at");
        Some(match moment {
            Ok(moment) => self.level(scan, &moment, period),
            Err(why) => Scanned::Lost {
                camera: scan.camera,
                why,
            },
        })
    }

    /// Whether a camera frame waits for inertial readings, and until when at most.
    pub(crate) fn wake_at(&self) -> Option<Stamp> {
        self.waiting.front().map(|scan| scan.taken + WAIT_MAX)
    }

    /// Levels a frame by the attitude of its time, follows its features, and locates.
    fn level(&mut self, mut scan: Scan, moment: &Moment, period: Span) -> Scanned {
        let level_from_sensor = moment.level_from_body * scan.body_from_sensor.rotation;
        let mut features: Vec<Feature> = scan
            .directions
            .iter()
            .take(FEATURES_MAX)
            .map(|direction| Feature {
                direction: level_from_sensor
                    * UnitVector3::new_normalize(Vector3::from(*direction)),
                sigma_rad: scan.sigma_rad,
                track: None,
            })
            .collect();
        scan.levelled = features.iter().map(|feature| feature.direction).collect();
        let too_many = scan.directions.len().saturating_sub(FEATURES_MAX);
        self.counts.cut.add("features", too_many as u64);
        let tracks = self
            .tracker
            .scan(scan.taken, moment.inertial.yaw_rad, &mut features);
        let (roll_rad, pitch_rad) = moment.roll_pitch_rad();
        let set = FeatureSet {
            taken: scan.taken,
            roll_rad,
            pitch_rad,
            yaw_rate_rad_s: moment.yaw_rate_rad_s,
            acceleration_m_s2: self.history.mean_acceleration(self.told.as_ref(), moment),
            inertial: moment.inertial,
            features,
            tracks,
        };
        self.told = Some(*moment);
        self.localiser.own(&set);
        self.counts.told += 1;
        self.newest = Some(set.clone());
        self.seen.push_back(scan);
        if self.seen.len() > WAITING_MAX {
            self.seen.pop_front();
        }
        self.note_converged(set.taken);
        let bearings = self.identified(period);
        Scanned::Told {
            set: Box::new(set),
            bearings,
        }
    }

    /// Notes whose places are known now. A symmetric team can look like another one for a moment; while it moves, not for
    /// long.
    fn note_converged(&mut self, now: Stamp) {
        let before = std::mem::take(&mut self.converged_since);
        let located = self.localiser.located();
        let converged = located
            .iter()
            .filter(|located| located.status == Status::Converged)
            .map(|located| located.vehicle);
        self.converged_since = converged
            .map(|id| (id, before.get(&id).copied().unwrap_or(now)))
            .collect();
    }

    /// The long computation that is due, if one is.
    pub(crate) fn begin_work(&mut self) -> Option<Work> {
        let work = self.localiser.begin_work();
        self.counts.work_begun += u64::from(work.is_some());
        work
    }

    /// Takes what came of a long computation.
    pub(crate) fn finish_work(&mut self, done: &Done, period: Span) -> Vec<IdentifiedBearing> {
        self.counts.work_done += 1;
        self.localiser.finish_work(done);
        self.identified(period)
    }

    /// Takes what a neighbour told.
    ///
    /// # Errors
    /// Why it was not used.
    pub(crate) fn hear(&mut self, from: Name, set: &FeatureSet) -> Result<(), Refused> {
        let id = VehicleId(from.hash());
        self.counts.heard += 1;
        self.localiser.heard(id, set).map_err(Refused::from)?;
        let level_from_body = UnitQuaternion::from_euler_angles(set.roll_rad, set.pitch_rad, 0.0);
        self.names.insert(
            id,
            Heard {
                name: from,
                level_from_body,
            },
        );
        // Names of vehicles that the localiser has forgotten are forgotten too.
        if self.names.len() > NAMES_MAX {
            let located = self.localiser.located();
            let known = |id: &VehicleId| located.iter().any(|located| located.vehicle == *id);
            self.names.retain(|id, _| known(id));
        }
        Ok(())
    }

    /// Bearings of neighbours that are known to be those, as the camera saw them: the bearing, never what was estimated
    /// from it. One a neighbour and round is as much as a round takes.
    fn identified(&mut self, period: Span) -> Vec<IdentifiedBearing> {
        let Some(identified) = self.localiser.identified() else {
            return Vec::new();
        };
        let scan = self.seen.iter().find(|scan| scan.taken == identified.taken);
        let (Some(scan), true) = (scan, self.config.bearings_to_cooperative) else {
            return Vec::new();
        };
        let located = self.localiser.located();
        let mut bearings = Vec::new();
        for (feature, probabilities) in &identified.features {
            let likeliest = probabilities.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            let Some(&(target, probability)) = likeliest else {
                continue;
            };
            let offered = self.offered.get(&target);
            let spaced = offered.is_none_or(|at| (scan.taken - *at) * 4 >= period * 3);
            let (Some(direction), Some(heard)) =
                (scan.directions.get(*feature), self.names.get(&target))
            else {
                continue;
            };
            let steady = self
                .converged_since
                .get(&target)
                .is_some_and(|since| scan.taken - *since >= STEADY_MIN);
            let place = located
                .iter()
                .find(|located| located.vehicle == target)
                .and_then(|located| located.relative);
            // Another robot that takes the neighbour's place in the image for a moment is not where the neighbour is.
            let fits = place
                .zip(scan.levelled.get(*feature))
                .is_some_and(|(place, seen)| {
                    place.position_m.angle(seen) <= FITS_SIGMAS * scan.sigma_rad
                });
            if probability < IDENTIFIED_MIN || !spaced || !steady || !fits {
                continue;
            }
            self.offered.insert(target, scan.taken);
            bearings.push(IdentifiedBearing {
                camera: scan.camera,
                taken: scan.taken,
                body_from_sensor: scan.body_from_sensor,
                target: heard.name,
                value: RelativeValue::Bearing {
                    direction: *direction,
                    sigma_rad: scan.sigma_rad,
                },
            });
        }
        let names = &self.names;
        self.offered.retain(|id, _| names.contains_key(id));
        self.counts.identified += bearings.len() as u64;
        bearings
    }
}

#[cfg(test)]
mod tests;
