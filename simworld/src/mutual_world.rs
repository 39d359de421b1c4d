//! One flight of a team that is to find itself by anonymous bearings: truth, and what inertial sensors, cameras and the
//! radio make of it. Everything can be asked for in any order and is the same each time.

use crate::anonymous::{Camera, Phantom, Scan};
use crate::mutual_scenario::MutualScenario;
use crate::quadrotor::{Course, Imu, ImuSample, Motion, attitude};
use crate::streams::{Purpose, Streams};
use crate::truth::Pose;
use nalgebra::Vector3;
use rand::RngExt;

/// Truth and sensors of one sample of a scenario.
#[derive(Debug)]
pub struct MutualWorld {
    scenario: MutualScenario,
    courses: Vec<Course>,
    imus: Vec<Imu>,
    cameras: Vec<Camera>,
    phantoms: Vec<Vec<Phantom>>,
    /// `[from][to][n]`: when the nth message arrives, if it does, in seconds after it was sent.
    late_s: Vec<Vec<Vec<Option<f64>>>>,
}

/// Where one robot is for another, in the level frame of that other: its origin, z up, x along its heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relative {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// As an observer that does not turn sees it, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// Its heading less the other's, counter-clockwise, not wrapped, radians.
    pub yaw_rad: f64,
}

impl MutualWorld {
    /// The world of one sample.
    #[must_use]
    pub fn new(scenario: &MutualScenario, sample: u64) -> Self {
        let streams = Streams::new(scenario.seed, sample);
        let courses = scenario.courses(sample);
        let arena = scenario.arena(&courses);
        let team = courses.len();
        let until_s = scenario.duration_s;
        let camera = |vehicle| Camera::new(scenario.camera, vehicle, team, 0.0..until_s, streams);
        let phantoms =
            |vehicle| Phantom::drawn(scenario.camera.phantoms, vehicle, &arena, until_s, &streams);
        let messages = (until_s * scenario.camera.rate_hz).ceil() as usize + 1;
        let talking = scenario.formation.talking();
        let late_s = |from: usize| {
            let to = |to: usize| {
                let mut rng = streams.pair(from, to, Purpose::Radio);
                let message = |_| {
                    let (lost, late): (f64, f64) = (rng.random(), rng.random());
                    (lost >= scenario.loss).then_some(late * scenario.late_s_max)
                };
                (0..messages).map(message).collect()
            };
            (0..talking).map(to).collect()
        };
        Self {
            imus: (0..team)
                .map(|vehicle| Imu::new(scenario.imu, vehicle, 0.0, streams))
                .collect(),
            cameras: (0..team).map(camera).collect(),
            phantoms: (0..team).map(phantoms).collect(),
            late_s: (0..talking).map(late_s).collect(),
            scenario: scenario.clone(),
            courses,
        }
    }

    /// What is flown.
    #[must_use]
    pub const fn scenario(&self) -> &MutualScenario {
        &self.scenario
    }

    /// How many robots there are.
    #[must_use]
    pub fn robots(&self) -> usize {
        self.courses.len()
    }

    /// How many of them talk: vehicles 0 to this. The others are only seen.
    #[must_use]
    pub fn talking(&self) -> usize {
        self.scenario.formation.talking()
    }

    /// What is true of a vehicle at a time (s).
    #[must_use]
    pub fn motion(&self, vehicle: usize, t_s: f64) -> Motion {
        Motion::at(&self.courses[vehicle], t_s)
    }

    /// Where a vehicle is at a time (s): `world_from_body`.
    #[must_use]
    pub fn pose(&self, vehicle: usize, t_s: f64) -> Pose {
        attitude(&self.courses[vehicle].place_at(t_s))
    }

    /// Where one robot is for another at a time (s).
    #[must_use]
    pub fn relative(&self, observer: usize, target: usize, t_s: f64) -> Relative {
        let (own, other) = (
            self.courses[observer].place_at(t_s),
            self.courses[target].place_at(t_s),
        );
        let (sin, cos) = own.heading_rad.sin_cos();
        let level =
            |v: Vector3<f64>| Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
        Relative {
            position_m: level(other.position_m - own.position_m),
            velocity_m_s: level(other.velocity_m_s - own.velocity_m_s),
            yaw_rad: other.heading_rad - own.heading_rad,
        }
    }

    /// The `index`th sample of a vehicle's inertial sensor; the first is taken at 0 s.
    #[must_use]
    pub fn imu(&self, vehicle: usize, index: usize) -> ImuSample {
        self.imus[vehicle].sample(&self.courses[vehicle], index)
    }

    /// The constant errors of a vehicle's inertial sensor: gyroscope, rad/s, and accelerometer, m/s^2.
    #[must_use]
    pub fn biases(&self, vehicle: usize) -> (Vector3<f64>, Vector3<f64>) {
        self.imus[vehicle].biases()
    }

    /// When a vehicle's camera takes its `index`th image (s).
    #[must_use]
    pub fn taken_s(&self, vehicle: usize, index: usize) -> f64 {
        self.cameras[vehicle].taken_s(index)
    }

    /// What is in that image.
    #[must_use]
    pub fn scan(&self, vehicle: usize, index: usize) -> Scan {
        let taken_s = self.taken_s(vehicle, index);
        let team: Vec<Pose> = (0..self.robots())
            .map(|robot| self.pose(robot, taken_s))
            .collect();
        let phantoms: Vec<_> = self.phantoms[vehicle]
            .iter()
            .map(|phantom| phantom.position_m(taken_s))
            .collect();
        self.cameras[vehicle].scan(index, &team, &phantoms)
    }

    /// How long the message of one talking vehicle with its `index`th image takes to another (s), if it arrives.
    #[must_use]
    pub fn arrives_after_s(&self, from: usize, to: usize, index: usize) -> Option<f64> {
        self.late_s[from][to].get(index).copied().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mutual_scenario::{Formation, Roles};

    #[test]
    fn a_sample_is_the_same_again_and_another_is_another() {
        let scenario = MutualScenario::eight();
        let (once, again) = (
            MutualWorld::new(&scenario, 3),
            MutualWorld::new(&scenario, 3),
        );
        // In another order, as nothing depends on what was asked before.
        let late = once.scan(1, 200);
        assert_eq!(once.imu(1, 7), again.imu(1, 7));
        assert_eq!(again.scan(1, 200), late);
        let other = MutualWorld::new(&scenario, 4);
        assert_ne!(other.scan(1, 200), late);
        assert_ne!(other.imu(1, 7), once.imu(1, 7));
    }

    #[test]
    fn roles_are_drawn_for_every_sample_and_all_are_taken() {
        let scenario = MutualScenario {
            roles: Roles::Drawn,
            ..MutualScenario::eight()
        };
        let in_order = MutualScenario::eight().courses(0);
        let places = |sample| {
            let courses = scenario.courses(sample);
            assert!(courses.iter().all(|course| in_order.contains(course)));
            courses
                .iter()
                .map(|course| in_order.iter().position(|other| other == course))
                .collect::<Vec<_>>()
        };
        assert_eq!(places(1), places(1));
        assert_ne!(places(1), places(2));
    }

    #[test]
    fn a_message_is_lost_as_often_as_the_radio_loses_them() {
        let world = MutualWorld::new(
            &MutualScenario {
                loss: 0.3,
                ..MutualScenario::eight()
            },
            0,
        );
        let lost = (0..1200)
            .filter(|index| world.arrives_after_s(1, 0, *index).is_none())
            .count();
        assert!((lost as f64 / 1200.0 - 0.3).abs() < 0.04, "{lost}");
        assert!(
            (0..1200)
                .any(|index| world.arrives_after_s(1, 0, index)
                    != world.arrives_after_s(1, 2, index))
        );
    }

    #[test]
    fn what_is_relative_is_seen_from_the_heading_of_the_observer() {
        let world = MutualWorld::new(&MutualScenario::square(), 0);
        let t_s = 13.0;
        let relative = world.relative(0, 2, t_s);
        let (own, other) = (world.pose(0, t_s), world.pose(2, t_s));
        let back =
            nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, world.motion(0, t_s).heading_rad);
        assert!(
            (own.translation.vector + back * relative.position_m - other.translation.vector).norm()
                < 1e-12
        );
        // A mutual pair gives the relative yaw: psi = azimuth there - azimuth back + pi.
        let there = relative.position_m;
        let here = world.relative(2, 0, t_s).position_m;
        let psi = there.y.atan2(there.x) - here.y.atan2(here.x) + std::f64::consts::PI;
        assert!(((psi - relative.yaw_rad) / 2.0).sin().abs() < 1e-12);
    }

    #[test]
    fn a_scattered_team_is_as_large_as_asked_and_its_last_are_silent() {
        let formation = Formation::Scattered {
            robots: 20,
            silent: 2,
        };
        let world = MutualWorld::new(
            &MutualScenario {
                formation,
                ..MutualScenario::square()
            },
            0,
        );
        assert_eq!((world.robots(), world.talking()), (20, 18));
        assert_eq!(
            world
                .scan(0, 0)
                .sightings
                .iter()
                .filter(|s| s.who > Some(17))
                .count(),
            2
        );
    }
}
