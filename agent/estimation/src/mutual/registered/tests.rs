//! Stories of the paper's way: a team that weaves, of which one vehicle finds the others.

use super::*;
use crate::mutual::direction;
use crate::mutual::feature_set::{Feature, Inertial};
use crate::mutual::filter::bank::BankSettings;
use crate::mutual::filter::particles::ParticleSettings;
use crate::mutual::located::Status;
use crate::mutual::propagation::advanced;
use crate::mutual::propagation::weaving::Weaving;
use nalgebra::{Vector2, Vector3};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

const RATE_HZ: f64 = 20.0;
const SIGMA_RAD: f64 = 0.02;

/// Vehicle 0 runs the pipeline. All see all.
struct Team {
    vehicles: Vec<Weaving>,
    inertials: Vec<Inertial>,
    step: u32,
    rng: ChaCha8Rng,
    registered: Registered,
}

fn bank() -> Settings {
    Settings {
        filter: FilterSettings::Bank(BankSettings::QUADROTOR),
        ..Settings::paper()
    }
}

fn id(vehicle: usize) -> VehicleId {
    VehicleId(10 * vehicle as u64)
}

fn at(step: u32) -> f64 {
    f64::from(step) / RATE_HZ
}

impl Team {
    fn of(count: usize, settings: Settings) -> Self {
        Self {
            vehicles: (0..count).map(Weaving::nth).collect(),
            inertials: vec![Inertial::zero(); count],
            step: 0,
            rng: ChaCha8Rng::seed_from_u64(1),
            registered: Registered::new(settings, 7),
        }
    }

    fn set(&mut self, vehicle: usize) -> FeatureSet {
        let own = &self.vehicles[vehicle];
        let mut features = Vec::new();
        for (other, target) in self.vehicles.iter().enumerate() {
            if other != vehicle {
                let place = target.seen_from(own, at(self.step)).position_m;
                let mut normal = || -> f64 { StandardNormal.sample(&mut self.rng) };
                let off = Vector2::new(normal(), normal()) * SIGMA_RAD;
                features.push(Feature {
                    direction: direction::moved(&UnitVector3::new_normalize(place), &off),
                    sigma_rad: SIGMA_RAD,
                    track: None,
                });
            }
        }
        FeatureSet {
            taken: Stamp::from_nanos((1e9 * (1.0 + at(self.step))).round() as i64),
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rate_rad_s: 0.0,
            acceleration_m_s2: Vector3::z() * 9.81,
            inertial: self.inertials[vehicle],
            features,
            tracks: Vec::new(),
        }
    }

    /// Everyone moves on and the own set is taken, without registering.
    fn step(&mut self, heard: impl Fn(usize, u32) -> bool) {
        self.step += 1;
        for (vehicle, inertial) in self.vehicles.iter().zip(&mut self.inertials) {
            let motion = vehicle.motion(at(self.step - 1), at(self.step));
            *inertial = advanced(inertial, &motion);
        }
        let own = self.set(0);
        self.registered.own(&own);
        for vehicle in 1..self.vehicles.len() {
            let set = self.set(vehicle);
            if heard(vehicle, self.step) {
                let _ = self.registered.heard(id(vehicle), &set);
            }
        }
    }

    fn fly(&mut self, seconds: f64, heard: impl Fn(usize, u32) -> bool) {
        for _ in 0..(seconds * RATE_HZ) as u32 {
            self.step(&heard);
            if let Some(work) = self.registered.poll_job() {
                self.registered.done(&work.run());
            }
        }
    }

    fn located(&self, vehicle: usize) -> Option<Located> {
        let located = self.registered.located();
        located
            .into_iter()
            .find(|located| located.vehicle == id(vehicle))
    }

    fn status(&self, vehicle: usize) -> Option<Status> {
        self.located(vehicle).map(|located| located.status)
    }

    /// How far off a place is: over the distance, and in yaw.
    fn error(&self, vehicle: usize) -> (f64, f64) {
        let truth = self.vehicles[vehicle].seen_from(&self.vehicles[0], at(self.step));
        let held = self.located(vehicle).and_then(|located| located.relative);
        held.map_or((f64::INFINITY, f64::INFINITY), |held| {
            (
                (held.position_m - truth.position_m).norm() / truth.position_m.norm(),
                direction::wrapped(held.yaw_rad - truth.yaw_rad).abs(),
            )
        })
    }

    fn is_found(&self, vehicle: usize) -> bool {
        let (off, yaw_off) = self.error(vehicle);
        self.status(vehicle) == Some(Status::Converged) && off < 0.15 && yaw_off < 0.1
    }
}

fn all(_: usize, _: u32) -> bool {
    true
}

#[test]
fn a_team_is_found_by_either_filter() {
    let particles = Settings {
        filter: FilterSettings::Particles(ParticleSettings {
            particles: 1000,
            ..ParticleSettings::PAPER
        }),
        ..Settings::paper()
    };
    for settings in [bank(), particles] {
        let mut team = Team::of(4, settings);
        team.fly(15.0, all);
        for vehicle in 1..4 {
            assert!(
                team.is_found(vehicle),
                "{vehicle}: {:?}",
                team.error(vehicle)
            );
        }
    }
}

#[test]
fn nothing_is_known_before_anyone_is_heard() {
    let mut team = Team::of(4, bank());
    team.fly(1.0, |_, _| false);
    assert!(team.registered.located().is_empty());
    team.step(all);
    assert_eq!(team.status(1), Some(Status::Unknown));
}

#[test]
fn lost_sets_lose_no_motion() {
    let mut team = Team::of(4, bank());
    team.fly(15.0, |vehicle, step| {
        !(step as usize + vehicle).is_multiple_of(3)
    });
    for vehicle in 1..4 {
        assert!(
            team.is_found(vehicle),
            "{vehicle}: {:?}",
            team.error(vehicle)
        );
    }
}

#[test]
fn a_neighbour_that_falls_silent_is_unknown_and_comes_back_where_it_is() {
    let mut team = Team::of(4, bank());
    team.fly(15.0, all);
    team.fly(5.0, |vehicle, _| vehicle != 2);
    assert_eq!(team.status(2), Some(Status::Unknown));
    assert!(team.is_found(1) && team.is_found(3));
    // No registration: what was believed has moved with both.
    team.step(all);
    team.step(all);
    let (off, yaw_off) = team.error(2);
    assert!(off < 0.25 && yaw_off < 0.1, "{off} {yaw_off}");
    team.fly(3.0, all);
    assert!(team.is_found(2));
}

#[test]
fn a_neighbour_silent_for_long_is_forgotten() {
    let settings = Settings {
        forgotten_after: Span::secs(2),
        ..bank()
    };
    let mut team = Team::of(4, settings);
    team.fly(1.0, all);
    team.fly(2.5, |vehicle, _| vehicle != 2);
    assert_eq!(team.status(2), None);
    assert!(team.status(1).is_some());
}

#[test]
fn a_neighbour_that_starts_again_is_found_again() {
    let mut team = Team::of(4, bank());
    team.fly(10.0, all);
    team.inertials[2] = Inertial::zero();
    team.step(all);
    assert_eq!(team.status(2), Some(Status::Unknown));
    team.fly(15.0, all);
    assert!(team.is_found(2), "{:?}", team.error(2));
}

#[test]
fn filters_wait_for_a_registration_and_catch_up() {
    let mut team = Team::of(4, bank());
    team.fly(15.0, all);
    team.step(all);
    let work = std::iter::repeat_with(|| {
        team.step(all);
        team.registered.poll_job()
    })
    .flatten()
    .next()
    .unwrap();
    for _ in 0..6 {
        team.step(all);
        assert!(team.registered.poll_job().is_none());
    }
    assert!(team.is_found(1), "{:?}", team.error(1));
    team.registered.done(&work.run());
    assert!(team.is_found(1), "{:?}", team.error(1));
    assert_eq!(team.registered.passed_over(), PassedOver::default());
}

#[test]
fn a_registration_that_does_not_come_back_is_given_up() {
    let mut team = Team::of(4, bank());
    team.step(all);
    let work = team.registered.poll_job().unwrap();
    for _ in 0..25 {
        team.step(all);
    }
    assert_eq!(team.registered.passed_over().registrations, 1);
    let before = team.registered.located();
    team.registered.done(&work.run());
    assert_eq!(team.registered.located(), before);
    assert!(team.registered.poll_job().is_some());
}

#[test]
fn neighbours_beyond_the_bound_are_passed_over() {
    let mut team = Team::of(2, bank());
    team.step(all);
    let set = team.set(1);
    for vehicle in 100..100 + NEIGHBOURS_MAX {
        let _ = team.registered.heard(id(vehicle), &set);
    }
    assert_eq!(team.registered.located().len(), NEIGHBOURS_MAX);
    assert_eq!(team.registered.passed_over().sets, 1);
}

#[test]
fn features_are_named_and_what_never_talks_has_no_name() {
    let mut team = Team::of(5, bank());
    team.fly(15.0, |vehicle, _| vehicle != 4);
    let (_, identifications) = team.registered.identifications().unwrap();
    assert_eq!(identifications.len(), 4);
    for (feature, identification) in identifications.iter().enumerate() {
        let of = |vehicle| {
            let found = identification
                .probabilities
                .iter()
                .find(|of| of.0 == id(vehicle));
            found.map_or(0.0, |of| of.1)
        };
        for vehicle in 1..4 {
            let right = feature + 1 == vehicle;
            assert!(
                (of(vehicle) > 0.8) == right,
                "{feature}: {identification:?}"
            );
        }
    }
}

#[test]
fn sets_out_of_time_change_nothing() {
    let mut team = Team::of(3, bank());
    team.fly(5.0, all);
    let before = team.registered.located();
    let mut old = team.set(0);
    old.taken = old.taken - Span::secs(1);
    team.registered.own(&old);
    let mut late = team.set(1);
    late.taken = late.taken - Span::secs(10);
    let _ = team.registered.heard(id(1), &late);
    let mut early = team.set(1);
    early.taken += Span::secs(10);
    let _ = team.registered.heard(id(1), &early);
    assert_eq!(team.registered.located(), before);
}

#[test]
fn the_same_seed_finds_the_same() {
    let flown = || {
        let mut team = Team::of(3, Settings::paper());
        team.fly(1.0, all);
        team.registered.located()
    };
    assert_eq!(flown(), flown());
}
