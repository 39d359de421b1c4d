//! What the joint filter learns of distances, from whom, and what stays when somebody goes.

use super::*;
use crate::mutual::identity::flight::Flight;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const TEAM: [[f64; 3]; 3] = [[0.0, 0.0, 2.0], [3.0, -1.0, 3.0], [1.0, 3.0, 1.5]];
const DT_S: f64 = 0.05;

/// Both neighbours of robot 0 in the filter, thought half as far again as they are.
fn started(flight: &Flight) -> JointFilter {
    let mut filter = JointFilter::new();
    for robot in 1..TEAM.len() {
        let truth = flight.relative(0, robot, 0.0);
        filter.insert(
            robot,
            Reduced {
                position_m: truth.position_m * 1.5,
                ..truth
            },
        );
    }
    filter
}

fn sights(flight: &mut Flight, observer: usize, t_s: f64) -> Vec<Sight> {
    let set = flight.set(observer, t_s);
    let others: Vec<usize> = (0..TEAM.len()).filter(|other| *other != observer).collect();
    let sight = |(feature, other): (&crate::mutual::Feature, &usize)| Sight {
        direction: feature.direction,
        variance_rad2: feature.sigma_rad.powi(2),
        strays: Vec::new(),
        chances: (0..TEAM.len())
            .map(|robot| if robot == *other { 0.95 } else { 0.02 })
            .collect(),
    };
    set.features.iter().zip(&others).map(sight).collect()
}

fn fly(flight: &mut Flight, filter: &mut JointFilter, observers: &[usize], until_s: f64) -> f64 {
    let mut t_s = 0.0;
    while t_s < until_s {
        let next_s = t_s + DT_S;
        let motions: Vec<Motion> = (0..TEAM.len())
            .map(|robot| {
                flight
                    .inertial(robot, next_s)
                    .since(&flight.inertial(robot, t_s))
            })
            .collect();
        filter.predict(DT_S, &motions, &[(0.0, 0.0); TEAM.len()]);
        for observer in observers {
            let held = filter.observe(*observer, 0.0, &sights(flight, *observer, next_s));
            assert_eq!(held.len(), TEAM.len() - 1);
        }
        filter.settle();
        t_s = next_s;
    }
    t_s
}

fn distance_variance(filter: &JointFilter, robot: usize) -> f64 {
    let outward = filter
        .state(robot)
        .expect("it is in")
        .position_m
        .normalize();
    let covariance = filter.covariance(robot).expect("it is in");
    (outward.transpose() * covariance.fixed_view::<3, 3>(0, 0) * outward)[0]
}

#[test]
fn distances_come_from_the_motion_of_all() {
    let mut flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(2));
    let mut filter = started(&flight);
    let t_s = fly(&mut flight, &mut filter, &[0, 1, 2], 15.0);
    for robot in 1..TEAM.len() {
        let (held, truth) = (
            filter.state(robot).expect("it is in"),
            flight.relative(0, robot, t_s),
        );
        let off = (held.position_m - truth.position_m).norm() / truth.position_m.norm();
        assert!(off < 0.12, "robot {robot}: {off}");
    }
    assert!(filter.covariance.clone().cholesky().is_some());
}

#[test]
fn what_neighbours_see_of_each_other_helps() {
    let knowing = |observers: &[usize]| {
        let mut flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(2));
        let mut filter = started(&flight);
        let _ = fly(&mut flight, &mut filter, observers, 5.0);
        distance_variance(&filter, 1)
    };
    assert!(knowing(&[0, 1, 2]) < 0.8 * knowing(&[0]));
}

#[test]
fn who_is_let_go_leaves_the_others_as_they_were() {
    let flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(3));
    let mut filter = started(&flight);
    let (state, covariance) = (filter.state(2), filter.covariance(2));
    filter.forget(1);
    assert_eq!((filter.state(1), filter.covariance(1)), (state, covariance));
    assert_eq!(filter.state(2), None);
}

fn still() -> Motion {
    Motion {
        elapsed_s: DT_S,
        yaw_rad: 0.0,
        velocity_m_s: nalgebra::Vector3::zeros(),
        position_m: nalgebra::Vector3::zeros(),
    }
}

/// Robots 1 and 2 in the filter, where they truly are.
fn known(flight: &Flight) -> JointFilter {
    let mut filter = JointFilter::new();
    for robot in 1..TEAM.len() {
        filter.insert(robot, flight.relative(0, robot, 0.0));
    }
    filter
}

/// Where one robot is for another as the filter holds it, off to the left by so much.
fn sight(filter: &JointFilter, target: usize, off_rad: f64, chances: [f64; 3]) -> Sight {
    let place = filter.state(target).expect("it is in").position_m;
    Sight {
        direction: turned(&nalgebra::UnitVector3::new_normalize(place), off_rad),
        variance_rad2: 0.05 * 0.05,
        strays: Vec::new(),
        chances: chances.to_vec(),
    }
}

#[test]
fn what_is_not_known_of_motions_widens_what_is_known_of_places() {
    let flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(4));
    let filter = known(&flight);
    let widened = |unheard: (f64, f64)| {
        let mut filter = filter.clone();
        filter.predict(DT_S, &[still(); 3], &[(0.0, 0.0), unheard, (0.0, 0.0)]);
        filter.covariance - &known(&flight).covariance
    };
    let (plain, silent) = (widened((0.0, 0.0)), widened((0.5, 0.25)));
    // The yaw errs by the own vehicle's and by the neighbour's steps, and the own one's is common to all.
    let yaw = YAW_STEP_RAD * YAW_STEP_RAD;
    assert!((plain[(6, 6)] - 2.0 * yaw).abs() < 1e-12);
    assert!((plain[(6, STATES + 6)] - yaw).abs() < 1e-12);
    // So is half of the acceleration's.
    let velocity = (ACCELERATION_M_S2 * DT_S).powi(2);
    assert!((plain[(5, 5)] - velocity).abs() < 1e-12);
    assert!((plain[(5, STATES + 5)] - 0.5 * velocity).abs() < 1e-12);
    let more = silent - plain;
    assert!((more[(4, 4)] - 0.5).abs() < 1e-9 && (more[(6, 6)] - 0.25).abs() < 1e-9);
    assert!(more[(STATES + 4, STATES + 4)].abs() < 1e-12);
}

#[test]
fn what_was_seen_a_while_ago_is_where_it_was() {
    let flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(5));
    let mut filter = known(&flight);
    let state = filter.state(1).expect("it is in");
    let (age_s, then) = (0.3, state.position_m - state.velocity_m_s * 0.3);
    assert!(then.angle(&state.position_m) > 0.03, "it moves across");
    let sight = Sight {
        direction: nalgebra::UnitVector3::new_normalize(then),
        variance_rad2: 1e-4,
        strays: Vec::new(),
        chances: vec![0.0, 0.95, 0.02],
    };
    let held = filter.observe(0, age_s, &[sight]);
    assert_eq!(held[0].map(|(who, _)| who), Some(1));
    filter.settle();
    let moved = filter.state(1).expect("it is in").position_m - state.position_m;
    assert!(moved.norm() < 1e-9, "{moved}");
}

#[test]
fn two_sights_at_once_are_as_good_as_one_after_the_other() {
    let flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(6));
    let seen = |together: bool| {
        let mut filter = known(&flight);
        let sight = sight(&filter, 1, 0.03, [0.0, 0.98, 0.0]);
        let before = filter.state(1).expect("it is in").position_m;
        for _ in 0..2 {
            let _ = filter.observe(0, 0.0, std::slice::from_ref(&sight));
            if !together {
                filter.settle();
            }
        }
        filter.settle();
        (filter.state(1).expect("it is in").position_m - before).norm()
    };
    let (together, apart) = (seen(true), seen(false));
    assert!((together / apart - 1.0).abs() < 0.1, "{together} {apart}");
}

#[test]
fn a_neighbour_that_sees_others_turned_heads_elsewhere_than_thought() {
    let flight = Flight::new(&TEAM, 3, 0.0, ChaCha8Rng::seed_from_u64(7));
    let mut filter = JointFilter::new();
    for robot in 1..TEAM.len() {
        let truth = flight.relative(0, robot, 0.0);
        let off_rad = if robot == 1 { 0.1 } else { 0.0 };
        filter.insert(
            robot,
            Reduced {
                yaw_rad: truth.yaw_rad + off_rad,
                ..truth
            },
        );
    }
    let mut flight = flight;
    let sights = sights(&mut flight, 1, 0.0);
    for _ in 0..20 {
        let _ = filter.observe(1, 0.0, &sights);
        filter.settle();
    }
    let held = filter.state(1).expect("it is in").yaw_rad;
    let off_rad = held - flight.relative(0, 1, 0.0).yaw_rad;
    assert!(off_rad.abs() < 0.07, "{off_rad}");
}

#[test]
fn who_a_sight_is_said_to_be_is_as_sure_as_there_are_no_rivals() {
    let flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(8));
    let filter = known(&flight);
    let probability = |sights: &[Sight]| {
        let held = filter.clone().observe(0, 0.0, sights);
        held.iter().flatten().map(|held| held.1).fold(0.0, f64::max)
    };
    let right = |off_rad, chance| sight(&filter, 1, off_rad, [0.0, chance, 0.0]);
    let alone = probability(&[right(0.0, 0.95)]);
    assert!(alone > 0.95, "{alone}");
    // The models hold it to be nobody.
    let strange = probability(&[right(0.0, 0.05)]);
    assert!(strange < 0.3, "{strange}");
    // It is as far off as such a sight can just be.
    let far = probability(&[right(0.28, 0.95)]);
    assert!(far < 0.9, "{far}");
    // A track of somebody else is as near and went without.
    let beside = Sight {
        strays: vec![(0.5, vec![0.0, 0.02, 0.0])],
        ..right(0.0, 0.95)
    };
    let stray = probability(&[beside]);
    assert!(stray < 0.7, "{stray}");
    // Two that fit equally well.
    let either = probability(&[right(0.01, 0.5), right(-0.01, 0.5)]);
    assert!(either < 0.6, "{either}");
}
