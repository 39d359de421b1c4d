//! What a vehicle measures of its own motion and of the others, made from truth poses. A relative measurement is made
//! in the *sensor's* frame and from the sensor's place, of the other vehicle's body.

mod bearing;
mod distance;
mod false_positive;
mod odometry;
mod orientation;
mod pose;
mod position;
mod settings;
mod view;

pub use false_positive::{FalsePositives, Phantom, Wrong, WrongBurst};
pub use odometry::{Odometry, OdometryNoise};
pub use settings::{KindChange, Mount, Noise, SensorSettings, Taken};
pub use view::FieldOfView;

use crate::streams::{Purpose, Streams};
use crate::truth::Pose;
use false_positive::Bursts;
use nalgebra::{UnitQuaternion, UnitVector3, Vector3};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a relative sensor can tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Orientation and position.
    Pose,
    /// Orientation only.
    Orientation,
    /// Position only.
    Position,
    /// The direction to the other vehicle.
    Bearing,
    /// The distance to the other vehicle.
    Distance,
}

/// One relative measurement, with its noise, in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading {
    /// `sensor_from_target`, metres.
    Pose(Pose),
    /// The rotation of `sensor_from_target`.
    Orientation(UnitQuaternion<f64>),
    /// The target's position, metres.
    Position(Vector3<f64>),
    /// The unit vector towards the target.
    Bearing(UnitVector3<f64>),
    /// The distance to the target, metres, never negative.
    Distance(f64),
}

/// What came of looking at one vehicle once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sight {
    /// A measurement; `wrong` when it is a false positive, which the vehicle is never told.
    Seen {
        /// The measurement.
        reading: Reading,
        /// Whether it is a false positive.
        wrong: bool,
    },
    /// In sight, but missed.
    Missed,
    /// Farther than the sensor sees.
    OutOfRange,
    /// Outside the field of view.
    OutOfView,
}

impl Sight {
    /// The measurement, if there is one.
    #[must_use]
    pub const fn reading(&self) -> Option<Reading> {
        match self {
            Self::Seen { reading, .. } => Some(*reading),
            Self::Missed | Self::OutOfRange | Self::OutOfView => None,
        }
    }
}

/// The relative sensor of one vehicle, with its random streams: one set per vehicle it looks at, so that a larger
/// fleet does not change what two of its members see of each other.
#[derive(Clone, Debug)]
pub struct RelativeSensor {
    settings: SensorSettings,
    body_from_sensor: Pose,
    observer: usize,
    streams: Streams,
    pairs: BTreeMap<usize, Pair>,
    phantoms: Vec<Phantom>,
    bursts: Bursts,
    measuring_time: ChaCha8Rng,
}

#[derive(Clone, Debug)]
struct Pair {
    miss: ChaCha8Rng,
    outlier: ChaCha8Rng,
    noise: ChaCha8Rng,
}

impl Pair {
    fn new(streams: &Streams, observer: usize, target: usize) -> Self {
        Self {
            miss: streams.pair(observer, target, Purpose::Miss),
            outlier: streams.pair(observer, target, Purpose::Outlier),
            noise: streams.pair(observer, target, Purpose::Measurement),
        }
    }
}

impl RelativeSensor {
    /// The sensor of the vehicle with index `observer` in a fleet of `n_vehicles`.
    #[must_use]
    pub fn new(
        settings: &SensorSettings,
        observer: usize,
        n_vehicles: usize,
        streams: Streams,
    ) -> Self {
        Self {
            body_from_sensor: settings.body_from_sensor(observer),
            phantoms: Phantom::of_observer(
                &settings.false_positives,
                observer,
                n_vehicles,
                &streams,
            ),
            bursts: Bursts::of_observer(
                &settings.false_positives,
                settings.range_m,
                observer,
                &streams,
            ),
            measuring_time: streams.vehicle(observer, Purpose::MeasuringTime),
            settings: settings.clone(),
            observer,
            streams,
            pairs: BTreeMap::new(),
        }
    }

    /// The settings it was made with.
    #[must_use]
    pub const fn settings(&self) -> &SensorSettings {
        &self.settings
    }

    /// `body_from_sensor`, metres.
    #[must_use]
    pub const fn body_from_sensor(&self) -> &Pose {
        &self.body_from_sensor
    }

    /// Begins a round, and says when the sensor measures for it: for the round at `round_s`, within the period that ends
    /// there. Call it once per round, in order.
    pub fn begin_round(&mut self, round_s: f64, period_s: f64) -> f64 {
        self.bursts.begin_round();
        match self.settings.taken {
            Taken::OnRound => round_s,
            // The share is below 1, so the time never falls onto the round before.
            Taken::AnywhereInRound => round_s - period_s * self.measuring_time.random::<f64>(),
        }
    }

    /// Looks at the vehicle with index `target` at `t_s` seconds since the start of the motion.
    pub fn observe(
        &mut self,
        t_s: f64,
        world_from_observer: &Pose,
        target: usize,
        world_from_target: &Pose,
    ) -> Sight {
        let streams = &self.streams;
        let observer = self.observer;
        let pair = self
            .pairs
            .entry(target)
            .or_insert_with(|| Pair::new(streams, observer, target));
        // Drawn whether or not the target is in sight, so that moving a sensor does not change the luck of the others.
        let missed = pair.miss.random::<f64>() < self.settings.miss_probability;
        let wrong = pair.outlier.random::<f64>() < self.settings.false_positives.wrong_probability;

        let sensor_from_target =
            (world_from_observer * self.body_from_sensor).inv_mul(world_from_target);
        let place = &sensor_from_target.translation.vector;
        if place.norm() >= self.settings.range_m {
            return Sight::OutOfRange;
        }
        if self
            .settings
            .field_of_view
            .is_some_and(|view| !view.contains(place))
        {
            return Sight::OutOfView;
        }
        if missed {
            return Sight::Missed;
        }
        let kind = self.settings.kind_at(t_s);
        let noise = &self.settings.noise;
        let mistake = if wrong {
            let false_positives = &self.settings.false_positives;
            let range_m = self.settings.range_m;
            Some(false_positives.wrong.once(range_m, &mut pair.outlier))
        } else {
            self.bursts.mistake().copied()
        };
        let measured = mistake.map_or(sensor_from_target, |mistake| {
            mistake.of(&sensor_from_target, kind, noise)
        });
        Sight::Seen {
            reading: measure(kind, &measured, noise, &mut pair.noise),
            wrong: mistake.is_some(),
        }
    }

    /// What it sees at `t_s` of robots that do not exist, each with the index of the vehicle it is taken for.
    pub fn phantoms(&mut self, t_s: f64, world_from_observer: &Pose) -> Vec<(usize, Reading)> {
        let kind = self.settings.kind_at(t_s);
        let world_from_sensor = world_from_observer * self.body_from_sensor;
        let mut seen = Vec::new();
        for phantom in &mut self.phantoms {
            let sensor_from_phantom =
                world_from_sensor.inv_mul(&phantom.pose_at(t_s, world_from_observer));
            let place = &sensor_from_phantom.translation.vector;
            let missed = phantom.rng.random::<f64>() < self.settings.miss_probability;
            let in_view = self
                .settings
                .field_of_view
                .is_none_or(|view| view.contains(place));
            if !missed && in_view && place.norm() < self.settings.range_m {
                let reading = measure(
                    kind,
                    &sensor_from_phantom,
                    &self.settings.noise,
                    &mut phantom.rng,
                );
                seen.push((phantom.taken_for(), reading));
            }
        }
        seen
    }
}

/// One measurement of this kind of `sensor_from_target`, with its noise.
pub fn measure(
    kind: Kind,
    sensor_from_target: &Pose,
    noise: &Noise,
    rng: &mut (impl Rng + ?Sized),
) -> Reading {
    match kind {
        Kind::Pose => Reading::Pose(pose::measure(sensor_from_target, noise, rng)),
        Kind::Orientation => {
            Reading::Orientation(orientation::measure(sensor_from_target, noise, rng))
        }
        Kind::Position => Reading::Position(position::measure(sensor_from_target, noise, rng)),
        Kind::Bearing => Reading::Bearing(bearing::measure(sensor_from_target, noise, rng)),
        Kind::Distance => Reading::Distance(distance::measure(sensor_from_target, noise, rng)),
    }
}

#[cfg(test)]
mod tests;
