//! Who is in the team: coming, going, coming back, and making room.

use super::super::settings::MEMBERS_MAX;
use super::*;

#[test]
fn a_vehicle_that_begins_anew_is_forgotten_and_located_again() {
    let mut flight = Flight::fly(SEED, &Conditions::good(4, 40));
    let begins_anew = 20;
    for round in begins_anew..40 {
        let point = &mut flight.moments[round][2].point;
        point.segment = 1;
    }
    let mut team = flight.team(Settings::DEFAULT);
    for round in 1..begins_anew {
        flight.hear(&mut team, round);
        team.solve();
    }
    let again = &flight.moments[begins_anew][2];
    assert_eq!(team.heard(again), Err(Unused::Interrupted));
    team.forget(id(2));
    assert!(!team.is_located(id(2)));
    assert_eq!(team.member(id(2)), None);
    assert_eq!(team.relative(id(2)), None);
    assert_eq!(team.heard(again), Err(Unused::Unlocated));
    for sighting in &flight.sightings[begins_anew] {
        flight.tell(&mut team, sighting, begins_anew).unwrap();
    }
    assert!(team.is_located(id(2)), "by what was measured");
    assert!(!team.solve().undetermined);
    flight.follow(&mut team, begins_anew + 1);
    let (_, found) = team.world_from(id(2)).unwrap();
    assert!(apart(&found, &flight.truth[39][2]) < 0.2);
}

#[test]
fn what_a_forgotten_vehicle_told_of_the_others_stays() {
    let flight = Flight::fly(SEED, &Conditions::linear(4, 10));
    let settings = least_squares(3);
    let (mut stays, mut goes) = (flight.team(settings), flight.team(settings));
    for round in 1..10 {
        flight.hear(&mut stays, round);
        flight.hear(&mut goes, round);
        stays.solve_with_stated_noise();
        goes.solve_with_stated_noise();
    }
    goes.forget(id(3));
    stays.solve();
    goes.solve();
    let (a, b) = (stays.own().unwrap(), goes.own().unwrap());
    assert!(apart(&a.world_from_body, &b.world_from_body) < 1e-8);
    assert!((a.covariance - b.covariance).norm() < 1e-3 * a.covariance.norm());
}

#[test]
fn a_vehicle_can_forget_itself() {
    let flight = Flight::fly(SEED, &Conditions::good(3, 30));
    let mut team = flight.team(Settings::DEFAULT);
    for round in 1..10 {
        flight.hear(&mut team, round);
        team.solve();
    }
    team.forget(id(0));
    assert_eq!(team.own(), None);
    assert!(!team.solve().undetermined);
    assert_eq!(team.own(), None);
    flight.hear_all_but(&mut team, 10, 0);
    assert!(!team.solve().undetermined);
    for sighting in &flight.sightings[11] {
        flight.tell(&mut team, sighting, 11).unwrap();
    }
    assert!(!team.solve().undetermined);
    flight.follow(&mut team, 12);
    assert!(flight.own_error_m(&team, 29) < 0.2);
}

#[test]
fn the_one_that_was_heard_longest_ago_makes_room() {
    let flight = Flight::fly(SEED, &Conditions::good(MEMBERS_MAX + 2, 12));
    let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
    let start = |team: &mut Team, vehicle: usize, round: usize| {
        let moment = &flight.moments[round][vehicle];
        team.start(moment, moment, &flight.truth[round][vehicle], 0.1, 0.1)
    };
    for vehicle in 0..MEMBERS_MAX {
        start(&mut team, vehicle, 0).unwrap();
    }
    assert_eq!(start(&mut team, MEMBERS_MAX, 0), Err(Unused::Full));
    for round in 1..12 {
        for vehicle in (0..MEMBERS_MAX).filter(|vehicle| *vehicle != 4 || round < 2) {
            team.heard(&flight.moments[round][vehicle]).unwrap();
        }
        assert!(!team.solve().undetermined);
    }
    assert!(!team.is_located(id(4)), "it was absent longest");
    assert_eq!(team.statistics().evicted, 1, "and nobody else had to go");
    start(&mut team, MEMBERS_MAX, 11).unwrap();
    assert!(!team.solve().undetermined);
}

#[test]
fn the_window_does_not_grow_while_this_vehicle_is_not_located() {
    let flight = Flight::fly(SEED, &Conditions::good(4, 80));
    let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
    for vehicle in 1..4 {
        let (moment, truth) = (&flight.moments[0][vehicle], &flight.truth[0][vehicle]);
        team.start(moment, moment, truth, 1e-4, 1e-4).unwrap();
    }
    for round in 1..80 {
        flight.hear_all_but(&mut team, round, 0);
        assert!(!team.solve().undetermined);
        let poses = team.statistics().poses;
        assert!(poses <= 3 * 22, "round {round}: {poses}");
    }
    assert_eq!(team.own(), None);
    assert!(team.world_from(id(1)).is_some());
}

#[test]
fn only_the_nearest_are_measured_and_a_newcomer_is_located_all_the_same() {
    let flight = Flight::fly(SEED, &Conditions::good(10, 8));
    let few = Settings {
        nearest: 6,
        ..Settings::DEFAULT
    };
    let mut team = Team::new(id(0), PERIOD, few);
    for vehicle in 0..9 {
        let (moment, truth) = (&flight.moments[0][vehicle], &flight.truth[0][vehicle]);
        team.start(moment, moment, truth, 1e-4, 1e-4).unwrap();
    }
    for round in 1..8 {
        for moment in &flight.moments[round][..9] {
            team.heard(moment).unwrap();
        }
        for sighting in &flight.sightings[round] {
            let newcomer = sighting.from.max(sighting.to) == 9;
            if round == 7 || !newcomer {
                let told = flight.tell(&mut team, sighting, round);
                assert!(matches!(told, Ok(()) | Err(Unused::LeftOut)), "{told:?}");
            }
        }
        assert!(!team.solve().undetermined);
    }
    let statistics = team.statistics();
    assert!(statistics.left_out > 0, "{statistics:?}");
    assert!(team.is_located(id(9)), "whoever is unknown may be near");
}

#[test]
fn two_fixes_that_place_a_vehicle_before_its_first_round_count_once_each() {
    const NOW: usize = 10;
    let flight = Flight::fly(SEED, &Conditions::good(7, NOW + 1));
    let noise = Noise {
        rotation_rad: 0.01,
        translation: 0.02,
    };
    let fixed = |team: &mut Team, round: usize| {
        let fix = Observation {
            measurement: Measurement::pose(flight.truth[round][0].reframe()).unwrap(),
            noise,
            from_end: Transform::identity(),
            to_end: Transform::identity(),
        };
        team.fixed(&flight.moments[round][0], 0, &fix)
    };
    // The window of seven is three rounds long: by itself it would not reach back to either fix.
    let placed_at = |round: usize| {
        let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
        for vehicle in 1..7 {
            let (moment, truth) = (&flight.moments[0][vehicle], &flight.truth[0][vehicle]);
            team.start(moment, moment, truth, 0.1, 0.1).unwrap();
        }
        team.place(&flight.moments[round][0], &flight.truth[round][0])
            .unwrap();
        for moment in flight.moments[round..].iter().flatten() {
            team.heard(moment).unwrap();
        }
        team
    };
    let sigma_rad = |team: &Team| team.own().unwrap().covariance[(0, 0)].sqrt();
    let mut team = placed_at(3);
    fixed(&mut team, 3).unwrap();
    fixed(&mut team, 6).unwrap();
    assert_eq!(fixed(&mut team, 3), Err(Unused::Counted));
    assert!(!team.solve().undetermined);
    let expected = noise.rotation_rad / 2.0_f64.sqrt();
    let sigma = sigma_rad(&team);
    assert!((expected..1.5 * expected).contains(&sigma), "{sigma} rad");
    assert!(flight.own_error_m(&team, NOW) < 0.1);
    assert!(!team.solve().undetermined, "and the window is short again");
    assert!(team.statistics().poses <= 7 * 5, "{:?}", team.statistics());
}
