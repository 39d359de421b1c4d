//! Numbers and orders that no honest vehicle sends: never a panic, every pose finite, every bound kept, and the honest
//! ones are found all the same.

use std::f64::consts::PI;

use super::super::settings::{EDGES_MAX, MEMBERS_MAX, POSES_MAX};
use super::*;

const LIAR: usize = 3;
const ROUNDS: usize = 25;

fn assert_sound(team: &Team) {
    let statistics = team.statistics();
    assert!(statistics.members <= MEMBERS_MAX as u64, "{statistics:?}");
    assert!(statistics.poses <= POSES_MAX as u64, "{statistics:?}");
    assert!(statistics.edges <= EDGES_MAX as u64, "{statistics:?}");
    assert!(
        team.window
            .poses
            .iter()
            .all(|pose| pose.world_from_body.is_valid())
    );
    if let Some(estimate) = team.own() {
        assert!(estimate.world_from_body.is_valid());
        assert!(estimate.covariance.iter().all(|number| number.is_finite()));
    }
}

/// Three honest vehicles find themselves, whatever a fourth does in every round.
fn honest_ones_survive(mut mischief: impl FnMut(&Flight, &mut Team, usize)) {
    let flight = Flight::fly(SEED, &Conditions::good(4, ROUNDS));
    let mut team = flight.team(Settings::DEFAULT);
    for round in 1..ROUNDS {
        mischief(&flight, &mut team, round);
        flight.hear_all_but(&mut team, round, LIAR);
        let report = team.solve();
        assert!(!report.undetermined, "round {round}");
        assert_sound(&team);
        let error = flight.own_error_m(&team, round);
        assert!(error < 0.3, "round {round}: {error} m");
        assert_eq!(
            team.own().unwrap().instant,
            flight.moments[round][0].instant
        );
    }
}

fn nowhere<To, From>() -> [Transform<To, From>; 4] {
    let turned = |number: f64| {
        UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(number, 0.0, 0.0, 0.0))
    };
    let upright = UnitQuaternion::identity();
    [
        Transform::new(upright, Vector3::new(f64::NAN, 0.0, 0.0)),
        Transform::new(upright, Vector3::new(0.0, f64::INFINITY, 0.0)),
        Transform::new(turned(f64::NAN), Vector3::zeros()),
        Transform::new(turned(2.0), Vector3::zeros()),
    ]
}

#[test]
fn poses_that_are_none_are_refused_and_leave_no_trace() {
    let flight = Flight::fly(SEED, &Conditions::good(4, 2));
    let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
    let moment = flight.moments[0][0];
    let truth = &flight.truth[0][0];
    for bad in nowhere() {
        let started = team.start(&moment, &moment, &bad, 0.1, 0.1);
        assert_eq!(started, Err(Unused::Unusable));
        assert_eq!(team.place(&moment, &bad), Err(Unused::Unusable));
    }
    for bad in nowhere() {
        let mut moment = moment;
        moment.point.odometry_from_body = bad;
        assert_eq!(team.place(&moment, truth), Err(Unused::Unusable));
    }
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
        let started = team.start(&moment, &moment, truth, bad, 0.1);
        assert_eq!(started, Err(Unused::Unusable), "{bad}");
        let started = team.start(&moment, &moment, truth, 0.1, bad);
        assert_eq!(started, Err(Unused::Unusable), "{bad}");
    }
    assert_eq!(
        team.statistics(),
        Team::new(id(0), PERIOD, Settings::DEFAULT).statistics()
    );
    let mut team = flight.team(Settings::DEFAULT);
    for bad in nowhere() {
        let mut moment = flight.moments[1][1];
        moment.point.odometry_from_body = bad;
        assert_eq!(team.heard(&moment), Err(Unused::Unusable));
    }
    let (from, to) = (&flight.moments[0][0], &flight.moments[0][1]);
    for bad in nowhere() {
        let mut observation = flight.sightings[0][0].observation;
        observation.from_end = bad;
        assert_eq!(team.measured(from, to, &observation), Err(Unused::Unusable));
        assert_eq!(team.fixed(to, 0, &observation), Err(Unused::Unusable));
        observation.from_end = Transform::identity();
        observation.to_end = bad;
        assert_eq!(team.measured(from, to, &observation), Err(Unused::Unusable));
        assert_eq!(team.fixed(to, 0, &observation), Err(Unused::Unusable));
    }
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
        let mut observation = flight.sightings[0][0].observation;
        observation.noise.translation = bad;
        assert_eq!(team.measured(from, to, &observation), Err(Unused::Unusable));
    }
    assert_eq!(team.statistics().edges, 0);
    assert_eq!(team.statistics().poses, 4);
}

#[test]
fn noise_of_next_to_nothing_and_of_next_to_everything_stops_nobody() {
    for (rotation_rad, translation) in [
        (1e-200, 1e-200),
        (1e-12, 1e-12),
        (1e-9, 1e200),
        (1e200, 1e200),
        (1e-300, 1.0),
    ] {
        honest_ones_survive(|flight, team, round| {
            for sighting in &flight.sightings[round] {
                if sighting.from == LIAR {
                    let mut sure = *sighting;
                    sure.observation.noise = Noise {
                        rotation_rad,
                        translation,
                    };
                    let _ = flight.tell(team, &sure, round);
                }
            }
        });
    }
}

#[test]
fn a_start_known_too_well_or_not_at_all_stops_nobody() {
    for (rotation_rad, translation_m) in
        [(1e-200, 1e-200), (1e-12, 1e-9), (1e200, 1e200), (1e-9, 1e9)]
    {
        honest_ones_survive(|flight, team, round| {
            let (moment, truth) = (&flight.moments[round][LIAR], &flight.truth[round][LIAR]);
            team.forget(id(LIAR));
            let _ = team.start(moment, moment, truth, rotation_rad, translation_m);
            for sighting in &flight.sightings[round] {
                if sighting.from == LIAR || sighting.to == LIAR {
                    let _ = flight.tell(team, sighting, round);
                }
            }
        });
    }
}

#[test]
fn odometry_that_leaps_stops_nobody() {
    for metres in [1e3, 1e5, 1e8, 1e15, 1e160, 1e300] {
        honest_ones_survive(|flight, team, round| {
            let mut moment = flight.moments[round][LIAR];
            let way = &mut moment.point.odometry_from_body.translation;
            way.x += if round % 2 == 0 { metres } else { -metres };
            let _ = team.heard(&moment);
            for sighting in &flight.sightings[round] {
                let end = |vehicle: usize| {
                    if vehicle == LIAR {
                        moment
                    } else {
                        flight.moments[round][vehicle]
                    }
                };
                if sighting.from == LIAR || sighting.to == LIAR {
                    let (from, to) = (end(sighting.from), end(sighting.to));
                    let _ = team.measured(&from, &to, &sighting.observation);
                }
            }
        });
    }
}

#[test]
fn growth_of_any_size_stops_nobody() {
    for variance in [
        1e-300,
        1.0,
        1e6,
        1e12,
        1e30,
        1e200,
        f64::MAX,
        f64::INFINITY,
        f64::NAN,
        -1.0,
    ] {
        for part in 0..4 {
            honest_ones_survive(|flight, team, round| {
                let mut moment = flight.moments[round][LIAR];
                let growth = &mut moment.point.growth;
                let size = variance * round as f64;
                match part {
                    0 => growth.rotation += size,
                    1 => growth.translation += size,
                    2 => growth.lever.x += size,
                    _ => growth.lever_square[(1, 1)] += size,
                }
                let _ = team.heard(&moment);
            });
        }
    }
}

#[test]
fn growth_that_shrinks_is_refused_whether_it_comes_in_time_or_late() {
    let flight = Flight::fly(SEED, &Conditions::good(4, 6));
    let mut team = flight.team(Settings::DEFAULT);
    flight.hear(&mut team, 1);
    let shrunk = |round: usize, times: f64| {
        let mut moment = flight.moments[round][1];
        moment.point.growth = moment.point.growth.scaled(times, times);
        moment
    };
    assert_eq!(team.heard(&shrunk(2, 0.1)), Err(Unused::Unusable));
    team.heard(&flight.moments[3][1]).unwrap();
    assert_eq!(
        team.heard(&shrunk(2, 5.0)),
        Err(Unused::Unusable),
        "between two that are known"
    );
    team.heard(&flight.moments[2][1]).unwrap();
    assert!(!team.solve().undetermined);
    flight.follow(&mut team, 3);
}

#[test]
fn noise_scales_do_not_undo_odometry_that_was_taken() {
    // Levers that no path explains, hidden under translation noise: a covariance, until that noise is scaled down.
    honest_ones_survive(|flight, team, round| {
        let mut moment = flight.moments[round][LIAR];
        let growth = &mut moment.point.growth;
        growth.translation += 4.0 * round as f64;
        growth.lever_square[(0, 0)] -= 3.0 * round as f64;
        growth.lever_square[(1, 1)] -= 3.0 * round as f64;
        let _ = team.heard(&moment);
        team.scales = NoiseScales::default();
        for _ in 0..200 {
            team.scales.odometry.translation.note(0.0, 100.0);
            team.scales.end_round();
        }
        let _ = team.heard(&flight.moments[round][LIAR]);
    });
}

#[test]
fn a_flood_of_moments_leaves_room_for_the_honest_ones() {
    honest_ones_survive(|flight, team, round| {
        for part in 0..1000 {
            let mut moment = flight.moments[round][LIAR];
            moment.point.taken += Span::micros(part);
            // Of any time, also of one that is not yet.
            moment.instant += Span::secs(part);
            let _ = team.heard(&moment);
        }
    });
}

#[test]
fn a_flood_of_measurements_leaves_room_for_the_honest_ones() {
    let flight = Flight::fly(SEED, &Conditions::good(4, ROUNDS));
    let kinds = Flight::fly(
        SEED,
        &Conditions {
            kinds: EVERY_KIND.to_vec(),
            ..Conditions::good(4, ROUNDS)
        },
    );
    let mut team = flight.team(Settings::DEFAULT);
    for part in 0..3000 {
        let mut moment = flight.moments[1][LIAR];
        moment.point.taken += Span::micros(part);
        for sighting in kinds.sightings[1]
            .iter()
            .filter(|sighting| sighting.from == LIAR)
        {
            let to = &flight.moments[1][sighting.to];
            let _ = team.measured(&moment, to, &sighting.observation);
        }
        for nth in 0..=255 {
            let _ = team.fixed(&moment, nth, &kinds.sightings[1][0].observation);
        }
    }
    for sighting in flight.sightings[1]
        .iter()
        .filter(|sighting| sighting.from != LIAR)
    {
        flight.tell(&mut team, sighting, 1).unwrap();
    }
    assert_sound(&team);
}

#[test]
fn ten_thousand_vehicles_are_not_taken_in() {
    honest_ones_survive(|flight, team, round| {
        for stranger in 0..400 {
            let mut moment = flight.moments[round][LIAR];
            moment.vehicle = VehicleId(1000 + 400 * round as u64 + stranger);
            let _ = team.place(&moment, &flight.truth[round][LIAR]);
            let sighting = flight.sightings[round][0];
            let _ = team.measured(&moment, &flight.moments[round][LIAR], &sighting.observation);
            let _ = team.measured(&flight.moments[round][LIAR], &moment, &sighting.observation);
        }
    });
}

#[test]
fn nobody_measures_itself() {
    let flight = Flight::fly(SEED, &Conditions::good(2, 2));
    let mut team = flight.team(Settings::DEFAULT);
    let moments = [&flight.moments[0][1], &flight.moments[1][1]];
    let seen = &flight.sightings[0][0].observation;
    assert_eq!(
        team.measured(moments[0], moments[1], seen),
        Err(Unused::SameVehicle)
    );
    assert_eq!(
        team.measured(moments[0], moments[0], seen),
        Err(Unused::SameVehicle)
    );
}

#[test]
fn time_that_runs_backwards_is_too_late_and_nothing_worse() {
    honest_ones_survive(|flight, team, round| {
        let mut moment = flight.moments[round][LIAR];
        moment.instant = flight.moments[ROUNDS - round][LIAR].instant;
        let _ = team.heard(&moment);
        moment.point.taken = flight.moments[ROUNDS - round][LIAR].point.taken;
        let _ = team.heard(&moment);
        for extreme in [i64::MIN, -1, i64::MAX] {
            moment.point.taken = Stamp::from_nanos(extreme);
            moment.instant = Stamp::from_nanos(extreme);
            let _ = team.heard(&moment);
            let _ = team.start(
                &moment,
                &flight.moments[round][LIAR],
                &flight.truth[0][LIAR],
                0.1,
                0.1,
            );
        }
    });
    // This vehicle's own clock too.
    let flight = Flight::fly(SEED, &Conditions::good(4, ROUNDS));
    let mut team = flight.team(Settings::DEFAULT);
    for round in (1..ROUNDS).chain([3, 2, 24]) {
        for vehicle in 0..4 {
            let mut moment = flight.moments[round][vehicle];
            moment.instant = Stamp::from_nanos(if round % 2 == 0 { i64::MAX } else { i64::MIN });
            let _ = team.heard(&moment);
        }
        team.solve();
        assert_sound(&team);
    }
}

#[test]
fn a_segment_that_changes_at_one_instant_is_an_interruption_all_the_same() {
    let flight = Flight::fly(SEED, &Conditions::good(2, 2));
    let mut team = flight.team(Settings::DEFAULT);
    let mut moment = flight.moments[0][1];
    moment.point.segment = 7;
    assert_eq!(team.heard(&moment), Err(Unused::Interrupted));
}

#[test]
fn ends_that_coincide_and_half_turns_stay_finite() {
    let mut flight = Flight::fly(SEED, &Conditions::linear(3, 10));
    for truth in &mut flight.truth[0] {
        *truth = Pose::identity();
    }
    let noise = Noise {
        rotation_rad: 0.01,
        translation: 0.01,
    };
    let half_turn = so3::exp(&Vector3::new(0.0, 0.0, PI));
    let mut team = flight.team(Settings::DEFAULT);
    for round in 0..10 {
        let moments = &flight.moments[round];
        for measurement in [
            Measurement::bearing(Vector3::x()).unwrap(),
            Measurement::distance(0.0).unwrap(),
            Measurement::orientation(half_turn).unwrap(),
            Measurement::position(Vector3::zeros()).unwrap(),
            Measurement::pose(Transform::new(half_turn, Vector3::zeros())).unwrap(),
        ] {
            let seen = Observation {
                measurement,
                noise,
                from_end: Transform::identity(),
                to_end: Transform::identity(),
            };
            team.measured(&moments[0], &moments[1], &seen).unwrap();
            team.measured(&moments[2], &moments[0], &seen).unwrap();
        }
        assert!(!team.solve().undetermined, "round {round}");
        assert_sound(&team);
    }
}

/// Numbers among which hostile ones are frequent.
fn number(rng: &mut ChaCha8Rng) -> f64 {
    const EVIL: [f64; 16] = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN_POSITIVE,
        -1.0,
        0.0,
        1e-200,
        1e-12,
        1e5,
        1e7,
        1e12,
        1e30,
        1e160,
        1e200,
        PI,
    ];
    match rng.random_range(0..8) {
        0 => EVIL[rng.random_range(0..EVIL.len())],
        1 => 10f64.powf(rng.random_range(-9.0..9.0)),
        _ => rng.random_range(-3.0..3.0),
    }
}

fn wild_transform<To, From>(rng: &mut ChaCha8Rng) -> Transform<To, From> {
    let translation = Vector3::from_fn(|_, _| number(rng));
    let rotation = if rng.random_range(0..20) == 0 {
        UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(number(rng), 0.0, 0.0, 0.0))
    } else {
        so3::exp(&Vector3::from_fn(|_, _| rng.random_range(-PI..PI)))
    };
    Transform::new(rotation, translation)
}

fn wild_moment(rng: &mut ChaCha8Rng, flight: &Flight) -> Moment {
    let round = rng.random_range(0..flight.moments.len());
    let mut moment = flight.moments[round][rng.random_range(0..flight.moments[0].len())];
    match rng.random_range(0..12) {
        0 => moment.vehicle = VehicleId(rng.random_range(0..60)),
        1 => moment.instant = Stamp::from_nanos(rng.random()),
        2 => moment.point.taken = Stamp::from_nanos(rng.random()),
        3 => moment.point.segment = rng.random_range(0..3),
        4 => moment.point.odometry_from_body = wild_transform(rng),
        5 => moment.point.growth.rotation += number(rng),
        6 => moment.point.growth.translation += number(rng),
        7 => moment.point.growth.lever.y += number(rng),
        8 => moment.point.growth.lever_square[(2, 2)] += number(rng),
        _ => {}
    }
    moment
}

fn wild_observation(rng: &mut ChaCha8Rng) -> Observation {
    let unit = so3::exp(&vector(rng, PI)) * Vector3::x();
    let relative = wild_transform(rng);
    let metres = number(rng);
    let measured = match rng.random_range(0..5) {
        0 => Measurement::pose(relative),
        1 => Measurement::orientation(relative.rotation),
        2 => Measurement::position(relative.translation),
        3 => Measurement::bearing(unit),
        _ => Measurement::distance(metres),
    };
    let tame = rng.random_range(0..2) == 0;
    let mut end = || {
        if tame {
            Transform::identity()
        } else {
            wild_transform(rng)
        }
    };
    let (from_end, to_end) = (end(), end());
    Observation {
        measurement: measured.unwrap_or_else(|_| Measurement::distance(1.0).unwrap()),
        noise: Noise {
            rotation_rad: number(rng),
            translation: number(rng),
        },
        from_end,
        to_end,
    }
}

#[test]
fn whatever_is_said_in_whatever_order_nothing_breaks() {
    for seed in 0..60 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let flight = Flight::fly(seed, &Conditions::good(5, 12));
        let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
        for _ in 0..400 {
            match rng.random_range(0..12) {
                0 => {
                    let (at, now) = (
                        wild_moment(&mut rng, &flight),
                        wild_moment(&mut rng, &flight),
                    );
                    let pose = wild_transform(&mut rng);
                    let _ = team.start(&at, &now, &pose, number(&mut rng), number(&mut rng));
                }
                1 => {
                    let pose = wild_transform(&mut rng);
                    let _ = team.place(&wild_moment(&mut rng, &flight), &pose);
                }
                2..=4 => drop(team.heard(&wild_moment(&mut rng, &flight))),
                5..=8 => {
                    let (from, to) = (
                        wild_moment(&mut rng, &flight),
                        wild_moment(&mut rng, &flight),
                    );
                    let _ = team.measured(&from, &to, &wild_observation(&mut rng));
                }
                9 => {
                    let at = wild_moment(&mut rng, &flight);
                    let _ = team.fixed(&at, rng.random(), &wild_observation(&mut rng));
                }
                10 if rng.random_range(0..4) == 0 => team.forget(id(rng.random_range(0..6))),
                _ => {
                    team.solve();
                    assert_sound(&team);
                }
            }
        }
    }
}

#[test]
fn after_the_wildest_beginning_honest_vehicles_find_each_other() {
    let (mut lost, runs) = (0, 40);
    for seed in 0..runs {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let flight = Flight::fly(seed, &Conditions::good(5, 60));
        let mut team = flight.team(Settings::DEFAULT);
        for round in 1..60 {
            if (35..50).contains(&round) {
                for _ in 0..20 {
                    let mut from = wild_moment(&mut rng, &flight);
                    from.vehicle = id(4);
                    let _ = team.heard(&from);
                    let to = &flight.moments[rng.random_range(0..=round)][rng.random_range(0..4)];
                    let _ = team.measured(&from, to, &wild_observation(&mut rng));
                }
            }
            flight.hear_all_but(&mut team, round, 4);
            lost += u32::from(team.solve().undetermined);
            assert_sound(&team);
        }
        let error = flight.own_error_m(&team, 59);
        assert!(error < 0.3, "seed {seed}: {error} m");
    }
    assert_eq!(lost, 0, "rounds that could not be solved");
}
