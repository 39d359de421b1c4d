//! What a quadrotor carries beside its odometer: an inertial sensor, and a camera that sees robots and not which robots.

use super::{CAMERA, Delivery, IMU, World, fixed, nanos, seconds};
use crate::anonymous::{Camera, Phantom};
use crate::quadrotor::{Arena, Imu};
use crate::scenario::Scenario;
use crate::stage::Stage;
use crate::streams::Streams;
use crate::trajectory::Trajectory;
use crate::truth::Pose;
use nalgebra::Vector3;
use skein_proto::frame::{BearingsFrame, Frame, ImuFrame};
use skein_proto::limits::FEATURES_PER_FRAME_MAX;

/// How far phantoms leave the box around the team's first places (m).
const MARGIN_M: Vector3<f64> = Vector3::new(1.2, 1.2, 0.8);

/// The two sensors of one vehicle, each if it has one, and which reading comes next.
#[derive(Debug)]
pub(super) struct Aboard {
    imu: Option<Imu>,
    next_sample: usize,
    camera: Option<Camera>,
    next_image: usize,
    phantoms: Vec<Phantom>,
}

impl Aboard {
    /// The sensors of a vehicle. They read from the beginning of the standstill on.
    pub(super) fn new(scenario: &Scenario, vehicle: usize, streams: Streams) -> Self {
        let time_s = -scenario.standstill_s..scenario.duration_s;
        let places: Vec<Vector3<f64>> = everyone(scenario)
            .map(|trajectory| trajectory.pose_at(0.0).translation.vector)
            .collect();
        let camera =
            |settings| Camera::new(settings, vehicle, places.len(), time_s.clone(), streams);
        let arena = Arena::around(&places, MARGIN_M);
        let phantoms = scenario.camera.map_or(0, |camera| camera.phantoms);
        Self {
            imu: scenario
                .imu
                .map(|settings| Imu::new(settings, vehicle, time_s.start, streams)),
            next_sample: 0,
            camera: scenario.camera.map(camera),
            next_image: 0,
            phantoms: Phantom::drawn(phantoms, vehicle, &arena, time_s.end, &streams),
        }
    }
}

/// Vehicles, then those that fly along.
fn everyone(scenario: &Scenario) -> impl Iterator<Item = &Trajectory> {
    let vehicles = scenario.team.vehicles().iter();
    vehicles
        .map(|vehicle| &vehicle.trajectory)
        .chain(&scenario.bystanders)
}

impl World {
    /// Everything that a vehicle's inertial sensor and camera read in the period that ends at `instant_ns`. What they
    /// read before the first round that is asked for is nobody's.
    pub(super) fn felt_and_seen(&mut self, vehicle: usize, instant_ns: i64) -> Vec<Delivery> {
        let since_ns = instant_ns - self.period_ns;
        let mut deliveries = self.felt(vehicle, since_ns, instant_ns);
        deliveries.extend(self.seen(vehicle, since_ns, instant_ns));
        deliveries
    }

    fn felt(&mut self, vehicle: usize, since_ns: i64, until_ns: i64) -> Vec<Delivery> {
        let mut deliveries = Vec::new();
        let aboard = &self.vehicles[vehicle].aboard;
        let Some((imu, settings)) = aboard.imu.as_ref().zip(self.scenario.imu) else {
            return deliveries;
        };
        let Trajectory::Quadrotor(course) = &self.scenario.team.vehicles()[vehicle].trajectory
        else {
            return deliveries;
        };
        let mut index = aboard.next_sample;
        while nanos(imu.taken_s(index)) <= until_ns {
            let taken_ns = nanos(imu.taken_s(index));
            if taken_ns > since_ns {
                let sample = imu.sample(course, index);
                let frame = ImuFrame {
                    taken_ns: self.stamp_ns(vehicle, taken_ns),
                    angular_rate_rad_s: sample.rate_rad_s.into(),
                    specific_force_m_s2: sample.force_m_s2.into(),
                    rate_sigma_rad_s: settings.stated_rate_sigma_rad_s(),
                    force_sigma_m_s2: settings.stated_force_sigma_m_s2(),
                };
                deliveries.push(Delivery {
                    at_ns: taken_ns,
                    sensor: fixed(IMU),
                    frame: Frame::Imu(frame),
                });
            }
            index += 1;
        }
        self.vehicles[vehicle].aboard.next_sample = index;
        deliveries
    }

    fn seen(&mut self, vehicle: usize, since_ns: i64, until_ns: i64) -> Vec<Delivery> {
        let mut deliveries = Vec::new();
        let aboard = &self.vehicles[vehicle].aboard;
        let Some(camera) = &aboard.camera else {
            return deliveries;
        };
        let mut index = aboard.next_image;
        while nanos(camera.taken_s(index)) <= until_ns {
            let taken_ns = nanos(camera.taken_s(index));
            if taken_ns > since_ns {
                let taken_s = seconds(taken_ns);
                let team: Vec<Pose> = everyone(&self.scenario)
                    .map(|trajectory| trajectory.pose_at(taken_s))
                    .collect();
                let phantoms = aboard.phantoms.iter();
                let phantoms: Vec<_> = phantoms
                    .map(|phantom| phantom.position_m(taken_s))
                    .collect();
                let scan = camera.scan(index, &team, &phantoms);
                let directions = scan.sightings.iter().take(FEATURES_PER_FRAME_MAX);
                let frame = BearingsFrame {
                    taken_ns: self.stamp_ns(vehicle, taken_ns),
                    sigma_rad: scan.sigma_rad,
                    directions: directions
                        .map(|seen| seen.direction.into_inner().into())
                        .collect(),
                };
                deliveries.push(Delivery {
                    at_ns: taken_ns,
                    sensor: fixed(CAMERA),
                    frame: Frame::Bearings(frame),
                });
            }
            index += 1;
        }
        self.vehicles[vehicle].aboard.next_image = index;
        deliveries
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quadrotor::GRAVITY_M_S2;

    /// All deliveries of one sensor of a vehicle in the standstill and ten seconds after.
    fn deliveries(world: &mut World, vehicle: usize, sensor: &str) -> Vec<Delivery> {
        let period_ns = world.period_ns();
        let mut instant_ns = world.first_instant_ns(vehicle, world.begins_ns() + 1);
        let mut all = Vec::new();
        while instant_ns <= 10_000_000_000 {
            let round = world.round(vehicle, instant_ns);
            all.extend(
                round
                    .into_iter()
                    .filter(|delivery| delivery.sensor == fixed(sensor)),
            );
            instant_ns += period_ns;
        }
        all
    }

    #[test]
    fn a_quadrotor_s_drivers_bring_every_sample_and_every_image_once_and_in_order() {
        let scenario = Scenario::built_in("eight").unwrap();
        let mut world = World::new(&scenario, 0);
        let felt = deliveries(&mut world, 2, IMU);
        let steps: Vec<i64> = felt
            .windows(2)
            .map(|pair| pair[1].at_ns - pair[0].at_ns)
            .collect();
        assert!(steps.iter().all(|step| (step - 2_500_000).abs() <= 1));
        let spanned_s = 10.0 + scenario.standstill_s;
        assert!(
            (felt.len() as f64 - 400.0 * spanned_s).abs() <= 1.0,
            "{}",
            felt.len()
        );
        let mut world = World::new(&scenario, 0);
        let seen = deliveries(&mut world, 2, CAMERA);
        assert!(seen.windows(2).all(|pair| pair[0].at_ns < pair[1].at_ns));
        assert!(
            (seen.len() as f64 - 20.0 * spanned_s).abs() <= 1.0,
            "{}",
            seen.len()
        );
    }

    #[test]
    fn cameras_see_those_that_fly_along_without_a_word() {
        let scenario = Scenario::built_in("eight").unwrap();
        assert_eq!((scenario.team.len(), scenario.bystanders.len()), (6, 2));
        let mut world = World::new(&scenario, 0);
        let most = deliveries(&mut world, 0, CAMERA)
            .into_iter()
            .map(|delivery| match delivery.frame {
                Frame::Bearings(frame) => frame.directions.len(),
                other => panic!("{other:?}"),
            })
            .max();
        assert_eq!(most, Some(7));
    }

    #[test]
    fn a_vehicle_that_stands_feels_gravity() {
        let mut world = World::new(&Scenario::built_in("square").unwrap(), 0);
        let standing = &deliveries(&mut world, 1, IMU)[..1600];
        let mut force = Vector3::zeros();
        for delivery in standing {
            assert!(delivery.frame.check().is_ok());
            let Frame::Imu(frame) = &delivery.frame else {
                panic!("{delivery:?}")
            };
            force += Vector3::from(frame.specific_force_m_s2) / 1600.0;
        }
        // Four standard errors of the mean of the noisiest axis.
        let off = (force - Vector3::z() * GRAVITY_M_S2).norm();
        assert!(off < 4.0 * 0.775 / 40.0, "{off}");
    }
}
