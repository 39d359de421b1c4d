//! A history flown again by the production vehicle and codec: the drivers bring what it holds.

use super::history::History;
use crate::stage::Stage;
use crate::truth::Pose;
use crate::world::{Delivery, ODOMETRY, RELATIVE, World};
use skein_estimation::cooperative::team::Observation;
use skein_estimation::cooperative::{Measurement, Noise};
use skein_estimation::so3;
use skein_proto::frame::{Frame, OdometryFrame, RelativeFrame, RelativeValue};
use skein_proto::name::Name;
use skein_vehicle::Config;

/// A stage whose readings come from a history; absolute fixes are not brought.
#[derive(Debug)]
pub struct Playback {
    /// The world that was recorded, for all but the readings.
    world: World,
    history: History,
}

impl Playback {
    /// The same world again, before its standstill, and what was measured in it.
    #[must_use]
    pub const fn new(world: World, history: History) -> Self {
        Self { world, history }
    }

    fn odometry(&self, vehicle: usize, k: usize) -> Frame {
        let moment = |k: usize| &self.history.rounds[k].moments[vehicle];
        let growth = moment(k).point.growth.since(&moment(k - 1).point.growth);
        Frame::Odometry(OdometryFrame {
            since_ns: self.stamp_ns(vehicle, moment(k - 1).instant.as_nanos()),
            taken_ns: self.stamp_ns(vehicle, moment(k).instant.as_nanos()),
            motion: self.history.step(vehicle, k - 1, k).to_numbers(),
            rotation_sigma_rad: growth.rotation.sqrt(),
            translation_sigma_m: growth.translation.sqrt(),
        })
    }
}

impl Stage for Playback {
    fn vehicles(&self) -> usize {
        self.world.vehicles()
    }

    fn begins_ns(&self) -> i64 {
        self.world.begins_ns()
    }

    fn period_ns(&self) -> i64 {
        self.world.period_ns()
    }

    fn stamp_ns(&self, vehicle: usize, at_ns: i64) -> i64 {
        self.world.stamp_ns(vehicle, at_ns)
    }

    fn time_ns(&self, vehicle: usize, stamp_ns: i64) -> i64 {
        self.world.time_ns(vehicle, stamp_ns)
    }

    fn config(&self, vehicle: usize, boot: u64) -> Config {
        self.world.config(vehicle, boot)
    }

    fn boot(&self, vehicle: usize, start: usize) -> u64 {
        self.world.boot(vehicle, start)
    }

    fn truth(&self, vehicle: usize, at_ns: i64) -> Option<Pose> {
        self.world.truth(vehicle, at_ns)
    }

    fn round(&mut self, vehicle: usize, instant_ns: i64) -> Vec<Delivery> {
        if instant_ns <= 0 {
            return self.world.round(vehicle, instant_ns);
        }
        let k = usize::try_from(instant_ns / self.period_ns()).unwrap_or(usize::MAX);
        if k > self.history.last() {
            return Vec::new();
        }
        let taken_ns = self.stamp_ns(vehicle, instant_ns);
        let own = |sighting: &&super::history::RawSighting| sighting.from == vehicle;
        let seen = self.history.rounds[k].sightings.iter().filter(own);
        let delivery = |sensor: &str, frame: Frame| Delivery {
            at_ns: instant_ns,
            sensor: Name::parse(sensor).expect("lower-case letters only"),
            frame,
        };
        let mut deliveries: Vec<Delivery> = seen
            .map(|sighting| {
                let frame = RelativeFrame {
                    taken_ns,
                    target: self.world.name(sighting.to),
                    value: value(&sighting.observation),
                };
                delivery(RELATIVE, Frame::Relative(frame))
            })
            .collect();
        deliveries.push(delivery(ODOMETRY, self.odometry(vehicle, k)));
        deliveries
    }
}

fn value(observation: &Observation) -> RelativeValue {
    let Noise {
        rotation_rad,
        translation,
    } = observation.noise;
    match &observation.measurement {
        Measurement::Pose(pose) => RelativeValue::Pose {
            sensor_from_target: pose.relative().to_numbers(),
            rotation_sigma_rad: rotation_rad,
            translation_sigma_m: translation,
        },
        Measurement::Orientation(orientation) => RelativeValue::Orientation {
            rotation_vector_rad: so3::log(&orientation.rotation()).into(),
            sigma_rad: rotation_rad,
        },
        Measurement::Position(position) => RelativeValue::Position {
            position_m: position.vector().into(),
            sigma_m: translation,
        },
        Measurement::Bearing(bearing) => RelativeValue::Bearing {
            direction: bearing.direction().into(),
            sigma_rad: rotation_rad,
        },
        Measurement::Distance(distance) => RelativeValue::Distance {
            distance_m: distance.metres(),
            sigma_m: translation,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::consistency::history;
    use crate::fleet::Fleet;
    use crate::radio::Radio;
    use crate::scenario::Scenario;

    #[test]
    fn a_fleet_on_a_history_flies_as_on_the_world_it_was_recorded_in() {
        let mut scenario = Scenario::built_in("section-v").unwrap();
        scenario.duration_s = 4.0;
        scenario.sensor.mounts = Scenario::built_in("section-v-mounted")
            .unwrap()
            .sensor
            .mounts;
        let history = history::record(&mut World::new(&scenario, 0)).unwrap();
        let world = World::new(&scenario, 0);
        let radio = Radio::new(&scenario.radio, world.streams());
        let mut again = Fleet::on(Playback::new(world, history), radio, |_, config| config);
        let mut fleet = Fleet::new(&scenario, 0);
        let period_ns = fleet.stage().period_ns();
        for k in 1..=20 {
            fleet.run_until((k + 1) * period_ns);
            again.run_until((k + 1) * period_ns);
            for vehicle in 0..5 {
                let (_, first) = fleet.scored(vehicle).unwrap();
                let (_, second) = again.scored(vehicle).unwrap();
                let apart = (first.translation.vector - second.translation.vector).norm();
                assert!(apart < 1e-9, "k = {k}, vehicle {vehicle}: {apart:e}");
            }
        }
    }
}
