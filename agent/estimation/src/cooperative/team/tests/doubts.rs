//! Measurements that are wrong, vehicles that lie, and odometry that does.

use super::*;

/// Shifts what a sighting says by so many metres.
fn falsify(sighting: &mut Sighting, shift: &Vector3<f64>) {
    let Measurement::Pose(pose) = &sighting.observation.measurement else {
        panic!("only poses are falsified here");
    };
    let mut relative = pose.relative();
    relative.translation += shift;
    sighting.observation.measurement = Measurement::pose(relative).unwrap();
}

fn between(flight: &mut Flight, round: usize, from: usize, to: usize) -> &mut Sighting {
    flight.sightings[round]
        .iter_mut()
        .find(|sighting| (sighting.from, sighting.to) == (from, to))
        .unwrap()
}

fn own_after(flight: &Flight) -> Pose {
    let mut team = flight.team(Settings::DEFAULT);
    flight.follow(&mut team, 1);
    team.own().unwrap().world_from_body
}

#[test]
fn a_gross_outlier_moves_nobody_by_a_millimetre() {
    for (from, to) in [(0, 1), (1, 0), (2, 3)] {
        for metres in [5.0, 100.0, 1e5] {
            let mut flight = Flight::fly(SEED, &Conditions::good(4, 45));
            let clean = own_after(&flight);
            falsify(
                between(&mut flight, 40, from, to),
                &Vector3::new(metres, 0.0, 0.0),
            );
            let off = apart(&own_after(&flight), &clean);
            assert!(off < 1e-3, "{from} of {to} wrong by {metres} m: {off}");
        }
    }
}

#[test]
fn ten_equal_lies_in_a_row_do_not_become_the_truth() {
    let mut flight = Flight::fly(SEED, &Conditions::good(4, 52));
    let clean = own_after(&flight);
    for round in 40..50 {
        falsify(
            between(&mut flight, round, 0, 1),
            &Vector3::new(2.0, 1.0, 0.0),
        );
    }
    let off = apart(&own_after(&flight), &clean);
    assert!(off < 5e-3, "{off}");
}

#[test]
fn a_liar_is_put_into_quarantine_and_comes_back_when_it_is_honest_again() {
    let mut flight = Flight::fly(SEED, &Conditions::good(5, 120));
    let (begins, ends) = (45, 80);
    for round in begins..ends {
        for to in [0, 1, 2, 4] {
            falsify(
                between(&mut flight, round, 3, to),
                &Vector3::new(0.6, 0.6, 0.5),
            );
        }
    }
    let mut team = flight.team(Settings::DEFAULT);
    let quarantined = |team: &Team| {
        let all = (0..5).filter(|vehicle| team.member(id(*vehicle)).unwrap().quarantined);
        all.collect::<Vec<_>>()
    };
    let (mut caught, mut back) = (None, None);
    for round in 1..120 {
        flight.hear(&mut team, round);
        assert!(!team.solve().undetermined);
        let now = quarantined(&team);
        assert!(now.is_empty() || now == [3], "round {round}: {now:?}");
        if now == [3] {
            caught = caught.or(Some(round));
        } else if caught.is_some() {
            back = back.or(Some(round));
        }
        if (begins..ends).contains(&round) {
            let error = flight.own_error_m(&team, round);
            assert!(error < 0.3, "round {round}: {error} m");
        }
    }
    let (caught, back) = (caught.unwrap(), back.unwrap());
    assert!((begins + 1..begins + 12).contains(&caught), "{caught}");
    assert!((ends..ends + 15).contains(&back), "{back}");
    assert_eq!(team.statistics().quarantines, 1);
}

#[test]
fn honest_vehicles_are_never_doubted() {
    for seed in 0..6 {
        let flight = Flight::fly(seed, &Conditions::good(4, 100));
        let mut team = flight.team(Settings::DEFAULT);
        flight.follow(&mut team, 1);
        let statistics = team.statistics();
        assert_eq!(statistics.quarantines, 0, "seed {seed}");
        assert!(statistics.gated_total < 3, "seed {seed}: {statistics:?}");
        for vehicle in 0..4 {
            assert!(
                !team.member(id(vehicle)).unwrap().odometry_lies,
                "seed {seed}"
            );
        }
    }
}

#[test]
fn odometry_that_lies_is_believed_no_more_and_its_vehicle_is_still_found() {
    let mut flight = Flight::fly(SEED, &Conditions::good(5, 140));
    let begins = 45;
    // From then on it slips: every round its odometry jumps sideways, now by more, now by less.
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut slip = Transform::<Body, Body>::identity();
    for round in begins..140 {
        slip = slip * Transform::new(UnitQuaternion::identity(), vector(&mut rng, 0.4));
        let point = &mut flight.moments[round][2].point;
        point.odometry_from_body = point.odometry_from_body * slip;
    }
    let mut team = flight.team(Settings::DEFAULT);
    flight.follow(&mut team, 1);
    for vehicle in 0..5 {
        let member = team.member(id(vehicle)).unwrap();
        assert_eq!(member.odometry_lies, vehicle == 2, "vehicle {vehicle}");
        assert!(!member.quarantined, "vehicle {vehicle}");
    }
    let error = flight.own_error_m(&team, 139);
    assert!(error < 0.3, "{error} m");
    let (_, found) = team.world_from(id(2)).unwrap();
    let error = apart(&found, &flight.truth[139][2]);
    // Nobody may have measured it since its last slip, which is 0.4 m along each axis.
    assert!(error < 0.4 * 3.0_f64.sqrt(), "{error} m");
}

#[test]
fn a_vehicle_whose_odometry_slips_once_is_found_where_it_is() {
    for (vehicles, who) in [(2, 0), (2, 1), (3, 1), (5, 0), (5, 2)] {
        for metres in [0.5, 3.0, 20.0] {
            let mut flight = Flight::fly(SEED, &Conditions::good(vehicles, 80));
            let slip = Transform::<Body, Body>::new(
                so3::exp(&Vector3::new(0.0, 0.0, 0.3)),
                Vector3::new(0.0, metres, 0.0),
            );
            let before = flight.moments[39][who].point.odometry_from_body;
            for round in 40..80 {
                let odometry = &mut flight.moments[round][who].point.odometry_from_body;
                *odometry = before * slip * (before.inverse() * *odometry);
            }
            let mut team = flight.team(Settings::DEFAULT);
            flight.follow(&mut team, 1);
            let other = usize::from(who == 0);
            let (mine, theirs) = (team.world_from(id(who)), team.world_from(id(other)));
            let between = mine.unwrap().1.inverse() * theirs.unwrap().1;
            let truth = flight.truth[79][who].inverse() * flight.truth[79][other];
            let off = apart(&between, &truth);
            assert!(
                off < 0.15,
                "{vehicles} vehicles, {who} by {metres} m: {off}"
            );
            if vehicles > 2 {
                let error = flight.own_error_m(&team, 79);
                assert!(
                    error < 0.3,
                    "{vehicles} vehicles, {who} by {metres} m: {error} m"
                );
            }
            for vehicle in 0..vehicles {
                assert!(!team.member(id(vehicle)).unwrap().quarantined, "{vehicle}");
            }
        }
    }
}
