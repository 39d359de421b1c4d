//! What every talking vehicle tells: its feature sets, from its own inertial sensor and camera by its own attitude and
//! its own tracks.

use crate::anonymous::Scan;
use crate::mutual_world::MutualWorld;
use crate::world::nanos;
use skein_estimation::Stamp;
use skein_estimation::mutual::attitude::Settings;
use skein_estimation::mutual::identity::Tracker;
use skein_estimation::mutual::own_motion::OwnMotion;
use skein_estimation::mutual::{Feature, FeatureSet};

/// A feature set, and what nobody is told.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// What goes out.
    pub set: FeatureSet,
    /// Of each of its features, which robot it truly is.
    pub who: Vec<Option<usize>>,
}

/// What all talking vehicles tell in one flight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Telling {
    /// `[vehicle][image]`.
    pub told: Vec<Vec<Told>>,
    /// `[vehicle][image]`: seconds, error of roll and error of pitch (rad).
    pub tilt: Vec<Vec<[f64; 3]>>,
}

impl Telling {
    /// Flies all of them.
    #[must_use]
    pub fn of(world: &MutualWorld) -> Self {
        let mut telling = Self::default();
        for vehicle in 0..world.talking() {
            let (told, tilt) = tell(world, vehicle);
            telling.told.push(told);
            telling.tilt.push(tilt);
        }
        telling
    }

    /// The same, with only what is left to score.
    #[must_use]
    pub(super) fn without_sets(mut self) -> Self {
        self.told.clear();
        self
    }
}

fn tell(world: &MutualWorld, vehicle: usize) -> (Vec<Told>, Vec<[f64; 3]>) {
    let scenario = world.scenario();
    let mut own = OwnMotion::new(Settings::standard());
    let mut tracker = Tracker::new();
    let (mut told, mut tilt) = (Vec::new(), Vec::new());
    let mut samples = 0;
    let images = (scenario.duration_s * scenario.camera.rate_hz) as usize;
    for image in 0..images {
        let scan = world.scan(vehicle, image);
        while samples as f64 <= scan.taken_s * scenario.imu.rate_hz {
            let sample = world.imu(vehicle, samples);
            let elapsed_s = if samples == 0 {
                0.0
            } else {
                1.0 / scenario.imu.rate_hz
            };
            own.update(elapsed_s, &sample.rate_rad_s, &sample.force_m_s2);
            samples += 1;
        }
        let told_now = set(&mut own, &mut tracker, &scan);
        let truth = world.motion(vehicle, scan.taken_s);
        tilt.push([
            scan.taken_s,
            told_now.set.roll_rad - truth.roll_rad,
            told_now.set.pitch_rad - truth.pitch_rad,
        ]);
        told.push(told_now);
    }
    (told, tilt)
}

fn set(own: &mut OwnMotion, tracker: &mut Tracker, scan: &Scan) -> Told {
    let motion = own.tell();
    let feature = |sighting: &crate::anonymous::Sighting| Feature {
        direction: own.levelled(&sighting.direction),
        sigma_rad: scan.sigma_rad,
        track: None,
    };
    let mut features: Vec<Feature> = scan.sightings.iter().map(feature).collect();
    let taken = Stamp::from_nanos(nanos(scan.taken_s));
    let tracks = tracker.scan(taken, motion.inertial.yaw_rad, &mut features);
    Told {
        set: FeatureSet {
            taken,
            roll_rad: motion.roll_rad,
            pitch_rad: motion.pitch_rad,
            yaw_rate_rad_s: motion.yaw_rate_rad_s,
            acceleration_m_s2: motion.acceleration_m_s2,
            inertial: motion.inertial,
            features,
            tracks,
        },
        who: scan.sightings.iter().map(|sighting| sighting.who).collect(),
    }
}
