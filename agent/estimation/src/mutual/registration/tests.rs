//! Stories of registration: formations of known shape, what each vehicle sees of them, and what is found.

use super::*;
use crate::mutual::direction::{azimuth_rad, difference, from_angles, wrapped, zenith_rad};
use nalgebra::{Matrix4, Rotation3, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Where vehicles really are. Vehicle 0 is the one that registers.
struct Truth {
    positions: Vec<Vector3<f64>>,
    yaws: Vec<f64>,
}

impl Truth {
    /// Vehicles at these places, all heading elsewhere.
    fn at(positions: Vec<Vector3<f64>>) -> Self {
        let yaws = (0..positions.len()).map(|k| 0.9 * (k * k) as f64).collect();
        Self { positions, yaws }
    }

    /// A regular polygon with its corners at these heights.
    fn polygon(heights: &[f64]) -> Self {
        let corner = |(k, height): (usize, &f64)| {
            let angle = std::f64::consts::TAU * k as f64 / heights.len() as f64;
            Vector3::new(3.0 * angle.cos(), 3.0 * angle.sin(), *height)
        };
        Self::at(heights.iter().enumerate().map(corner).collect())
    }

    /// Vehicles anywhere in a box, at least a metre apart.
    fn random(count: usize, rng: &mut ChaCha8Rng) -> Self {
        let mut positions: Vec<Vector3<f64>> = Vec::new();
        while positions.len() < count {
            let drawn = Vector3::from([2.6, 5.0, 1.6].map(|half| rng.random_range(-half..half)));
            if positions.iter().all(|one| (one - drawn).norm() > 1.0) {
                positions.push(drawn);
            }
        }
        Self::at(positions)
    }

    fn seen(&self, viewer: usize, target: usize) -> UnitVector3<f64> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -self.yaws[viewer]);
        UnitVector3::new_normalize(turn * (self.positions[target] - self.positions[viewer]))
    }

    fn pose(&self, target: usize) -> Pose {
        let distance = (self.positions[target] - self.positions[0]).norm();
        Pose {
            position_m: self.seen(0, target).into_inner() * distance,
            yaw_rad: wrapped(self.yaws[target] - self.yaws[0]),
        }
    }

    /// What everybody sees, with noise in azimuth and zenith distance, in the order of the vehicles.
    fn job(&self, noise_deg: f64, rng: &mut ChaCha8Rng) -> Job {
        let sigma_rad = noise_deg.to_radians();
        let count = self.positions.len();
        let mut sightings: Vec<Vec<Sighting>> = Vec::new();
        for viewer in 0..count {
            let mut seen = Vec::new();
            for target in (0..count).filter(|target| *target != viewer) {
                let truth = self.seen(viewer, target);
                let mut noise = || -> f64 {
                    let one: f64 = StandardNormal.sample(rng);
                    sigma_rad * one
                };
                let azimuth = azimuth_rad(&truth) + noise();
                let direction = from_angles(azimuth, zenith_rad(&truth) + noise());
                // What is exact is still taken for measured.
                let sigma_rad = sigma_rad.max(0.03);
                seen.push(Sighting {
                    direction,
                    sigma_rad,
                });
            }
            sightings.push(seen);
        }
        let own = sightings.remove(0);
        let neighbours = sightings
            .into_iter()
            .zip(1..)
            .map(|(sightings, k)| Neighbour {
                vehicle: VehicleId(k),
                sightings,
                belief: None,
            });
        Job {
            own,
            neighbours: neighbours.collect(),
            method: Method::SingleScan,
            settings: Settings::default(),
        }
    }

    /// What is believed of a vehicle, rightly.
    fn belief(&self, target: usize) -> Option<Belief> {
        Some(Belief::Gaussian {
            mean: self.pose(target),
            covariance: Matrix4::identity() * 0.01,
        })
    }

    /// Whether a solution has everybody where it is.
    fn is_found(&self, solution: &Solution, within_rad: f64) -> bool {
        solution.placed.len() == self.positions.len() - 1
            && solution.placed.iter().all(|placed| {
                let target = placed.vehicle.0 as usize;
                self.seen(0, target).angle(&placed.direction) < within_rad
                    && wrapped(placed.yaw_rad - self.pose(target).yaw_rad).abs() < within_rad
            })
    }
}

fn rng() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(7)
}

fn published(job: Job) -> Job {
    Job {
        method: Method::Published,
        ..job
    }
}

#[test]
fn a_flat_square_looks_like_six() {
    let square = Truth::polygon(&[0.0; 4]);
    let job = square.job(0.0, &mut rng());
    for job in [job.clone(), published(job)] {
        let outcome = job.run();
        assert_eq!(outcome.solutions.len(), 6, "{:?}", job.method);
        assert!(
            outcome
                .solutions
                .iter()
                .any(|one| square.is_found(one, 1e-3))
        );
        assert!(
            outcome
                .weights(1.0)
                .iter()
                .all(|weight| (weight - 1.0 / 6.0).abs() < 1e-3)
        );
    }
}

#[test]
fn a_square_of_alternating_heights_looks_like_two() {
    let square = Truth::polygon(&[0.0, 1.0, 0.0, 1.0]);
    let job = square.job(0.0, &mut rng());
    for job in [job.clone(), published(job)] {
        let outcome = job.run();
        assert_eq!(outcome.solutions.len(), 2, "{:?}", job.method);
        assert!(
            outcome
                .solutions
                .iter()
                .any(|one| square.is_found(one, 1e-3))
        );
    }
}

#[test]
fn a_flat_hexagon_looks_like_a_hundred_and_twenty() {
    let hexagon = Truth::polygon(&[0.0; 6]);
    let outcome = hexagon.job(0.0, &mut rng()).run();
    assert_eq!(outcome.solutions.len(), 120);
    assert_eq!(outcome.cut, Cut::default());
    assert!(
        outcome
            .solutions
            .iter()
            .any(|one| hexagon.is_found(one, 1e-3))
    );
}

#[test]
fn more_solutions_than_may_be_told_are_cut_and_counted() {
    let mut job = Truth::polygon(&[0.0; 4]).job(0.0, &mut rng());
    job.settings.solutions_max = 4;
    let outcome = job.run();
    assert_eq!((outcome.solutions.len(), outcome.cut.solutions), (4, 2));
}

#[test]
fn two_vehicles_know_direction_and_yaw_of_each_other() {
    let truth = Truth::at(vec![Vector3::zeros(), Vector3::new(3.0, 1.0, 0.5)]);
    let outcome = truth.job(0.0, &mut rng()).run();
    assert!(truth.is_found(&outcome.solutions[0], 1e-3));
    assert_eq!(outcome.solutions[0].placed[0].mine, Some(0));
    assert_eq!(outcome.solutions[0].placed[0].theirs, Some(0));
}

#[test]
fn a_vehicle_straight_above_is_found_as_any_other() {
    let truth = Truth::at(vec![
        Vector3::zeros(),
        Vector3::new(0.0, 0.0, 2.0),
        Vector3::new(3.0, 0.5, 0.7),
        Vector3::new(-1.0, 2.5, 1.3),
    ]);
    let job = truth.job(0.0, &mut rng());
    assert!(truth.is_found(&job.run().solutions[0], 1e-3));
    assert!(
        published(job)
            .run()
            .solutions
            .iter()
            .any(|one| truth.is_found(one, 0.02))
    );
}

#[test]
fn robots_in_a_box_are_found_through_noise() {
    let mut rng = rng();
    for count in 4..=8 {
        let truth = Truth::random(count, &mut rng);
        let outcome = truth.job(3.0, &mut rng).run();
        assert!(truth.is_found(&outcome.solutions[0], 0.2), "{count}");
    }
}

#[test]
fn what_a_silent_robot_and_phantoms_look_like_is_nobody() {
    let mut rng = rng();
    let truth = Truth::random(5, &mut rng);
    let mut job = truth.job(2.0, &mut rng);
    let phantom = |azimuth| Sighting {
        direction: from_angles(azimuth, 1.4),
        sigma_rad: 2.0_f64.to_radians(),
    };
    job.own.insert(0, phantom(2.9));
    job.neighbours[1].sightings.insert(2, phantom(-0.4));
    // The last vehicle falls silent.
    job.neighbours.pop();
    let solution = &job.run().solutions[0];
    assert_eq!(solution.placed.len(), 3);
    assert_eq!(solution.seen[0], [None, Some(1), Some(2), Some(3), None]);
    assert_eq!(solution.seen[2], [Some(0), Some(1), None, Some(3), None]);
}

#[test]
fn errors_are_as_large_as_their_covariance_says() {
    let mut rng = rng();
    let (mut total, mut numbers) = (0.0, 0.0);
    for _ in 0..60 {
        let truth = Truth::random(5, &mut rng);
        let outcome = truth.job(2.0, &mut rng).run();
        let found = outcome
            .solutions
            .iter()
            .find(|one| truth.is_found(one, 0.14));
        for placed in found.iter().flat_map(|one| &one.placed) {
            let target = placed.vehicle.0 as usize;
            let across = difference(&placed.direction, &truth.seen(0, target));
            let yaw = wrapped(truth.pose(target).yaw_rad - placed.yaw_rad);
            let error = Vector3::new(across.x, across.y, yaw);
            total += error.dot(&placed.covariance.cholesky().unwrap().solve(&error));
            numbers += 3.0;
        }
    }
    assert!(numbers > 600.0);
    let nees = total / numbers;
    assert!((0.85..1.15).contains(&nees), "{nees}");
}

#[test]
fn beliefs_that_explain_the_scan_are_all_that_is_looked_at() {
    let square = Truth::polygon(&[0.0; 4]);
    let mut job = square.job(0.0, &mut rng());
    for target in 1..4 {
        job.neighbours[target - 1].belief = square.belief(target);
    }
    let outcome = job.run();
    assert_eq!(outcome.solutions.len(), 1);
    assert!(square.is_found(&outcome.solutions[0], 1e-3));
    let scale_m = outcome.solutions[0].scale_m.unwrap();
    let mean_m = (1..4)
        .map(|one| square.pose(one).position_m.norm())
        .sum::<f64>()
        / 3.0;
    assert!((scale_m / mean_m - 1.0).abs() < 0.02, "{scale_m} {mean_m}");

    job.settings.search = Search::Always;
    job.settings.survival_nats = 1e3;
    let outcome = job.run();
    assert!(outcome.solutions.len() >= 6);
    assert!(square.is_found(&outcome.solutions[0], 1e-3));
}

#[test]
fn a_neighbour_that_is_not_where_it_is_believed_is_searched_for() {
    let mut rng = rng();
    let truth = Truth::random(6, &mut rng);
    let mut job = truth.job(1.0, &mut rng);
    for target in 1..6 {
        job.neighbours[target - 1].belief = truth.belief(target);
    }
    let moved = truth.pose(2);
    job.neighbours[1].belief = Some(Belief::Samples(vec![
        Pose {
            position_m: -moved.position_m,
            yaw_rad: moved.yaw_rad + 2.0,
        };
        9
    ]));
    assert!(truth.is_found(&job.run().solutions[0], 0.07));
}

#[test]
fn beliefs_that_are_all_wrong_do_not_hide_the_truth() {
    let mut rng = rng();
    let truth = Truth::random(6, &mut rng);
    let elsewhere = Truth::random(6, &mut rng);
    let mut job = truth.job(1.0, &mut rng);
    for target in 1..6 {
        job.neighbours[target - 1].belief = elsewhere.belief(target);
    }
    assert!(truth.is_found(&job.run().solutions[0], 0.07));
}

#[test]
fn a_cavity_leaves_the_own_belief_out() {
    let square = Truth::polygon(&[0.0; 4]);
    let mut job = square.job(0.0, &mut rng());
    job.settings.survival_nats = 1e3;
    job.neighbours[0].belief = square.belief(1);
    for solution in job.run().solutions {
        assert_eq!(solution.placed[0].log_cavity, 0.0);
        assert!((solution.placed[1].log_cavity - solution.log_belief).abs() < 0.1);
    }
}

#[test]
fn vehicles_and_sightings_beyond_the_bounds_are_cut_and_counted() {
    let mut job = Truth::polygon(&[0.0; 4]).job(0.0, &mut rng());
    let sighting = job.own[0];
    job.own.resize(SIGHTINGS_MAX + 2, sighting);
    job.settings.branches_max = 10;
    let silent = Neighbour {
        vehicle: VehicleId(9),
        sightings: Vec::new(),
        belief: None,
    };
    job.neighbours.resize(NEIGHBOURS_MAX + 3, silent);
    let cut = job.run().cut;
    assert_eq!((cut.neighbours, cut.sightings), (3, 2));
    assert!(cut.branches > 0);
}

#[test]
fn weights_keep_alternatives_alive_when_tempered() {
    let mut rng = rng();
    let mut job = Truth::polygon(&[0.0; 4]).job(3.0, &mut rng);
    job.settings.survival_nats = 20.0;
    let outcome = job.run();
    let (sharp, tempered) = (outcome.weights(1.0), outcome.weights(0.35));
    assert!((tempered.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(sharp[0] > tempered[0] && tempered[0] > 1.0 / tempered.len() as f64);
}

fn any_sighting() -> impl Strategy<Value = Sighting> {
    let angles = prop_oneof![Just(0.0), Just(std::f64::consts::PI), -4.0..4.0f64];
    let sigma = prop_oneof![Just(0.0), Just(f64::NAN), Just(1e9), 0.01..0.2f64];
    (angles.clone(), angles, sigma).prop_map(|(azimuth, zenith, sigma_rad)| Sighting {
        direction: from_angles(azimuth, zenith),
        sigma_rad,
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn nonsense_has_an_outcome_and_always_the_same(
        sets in prop::collection::vec(prop::collection::vec(any_sighting(), 0..6), 1..5),
        method in prop_oneof![Just(Method::SingleScan), Just(Method::Published)],
        position_m in prop_oneof![Just(0.0), Just(f64::NAN), 1.0..2.0f64],
    ) {
        let pose = Pose { position_m: Vector3::repeat(position_m), yaw_rad: 0.1 };
        let belief = Some(Belief::Samples(vec![pose; 2]));
        let neighbours = sets[1..].iter().map(|sightings| Neighbour {
            vehicle: VehicleId(1),
            sightings: sightings.clone(),
            belief: belief.clone(),
        });
        let job = Job {
            own: sets[0].clone(),
            neighbours: neighbours.collect(),
            method,
            settings: Settings { branches_max: 200, ..Settings::default() },
        };
        let outcome = job.run();
        prop_assert!(outcome.solutions.iter().all(|one| one.log_likelihood.is_finite()));
        prop_assert_eq!(outcome, job.run());
    }
}
