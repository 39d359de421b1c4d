//! Answers that can be worked out by hand.

use super::*;

fn at(x: f64) -> Pose {
    Transform::new(UnitQuaternion::identity(), Vector3::new(x, 0.0, 0.0))
}

/// A vehicle that has not moved and whose odometry never errs.
fn standing(vehicle: usize, round: i64) -> Moment {
    let instant = Stamp::from_nanos(PERIOD.as_nanos() * round);
    Moment {
        vehicle: id(vehicle),
        instant,
        point: OdometryPoint {
            taken: instant,
            segment: 0,
            odometry_from_body: Transform::identity(),
            growth: Growth::zero(),
        },
    }
}

fn sees(measurement: Measurement, sigma: f64) -> Observation {
    Observation {
        measurement,
        noise: Noise {
            rotation_rad: sigma,
            translation: sigma,
        },
        from_end: Transform::identity(),
        to_end: Transform::identity(),
    }
}

#[test]
fn two_starts_and_a_position_between_them_meet_where_their_variances_say() {
    let mut team = Team::new(id(0), PERIOD, least_squares(3));
    let (mine, theirs) = (standing(0, 0), standing(1, 0));
    team.start(&mine, &mine, &at(0.0), 1e-4, 0.1).unwrap();
    team.start(&theirs, &theirs, &at(10.0), 1e-4, 0.2).unwrap();
    // Starts say 10 m with variance .01 + .04, the measurement 10.6 m with variance .01: of the 0.6 m the starts give
    // five sixths, by one to four.
    let seen = Measurement::position(Vector3::new(10.6, 0.0, 0.0)).unwrap();
    team.measured(&mine, &theirs, &sees(seen, 0.1)).unwrap();
    assert!(!team.solve().undetermined);
    let x = |vehicle| team.world_from(id(vehicle)).unwrap().1.translation.x;
    assert!((x(0) + 0.1).abs() < 1e-5, "{}", x(0));
    assert!((x(1) - 10.4).abs() < 1e-5, "{}", x(1));
    // 1/variance = 1/.01 + 1/(.04 + .01) = 120, and of the distance 1/.01 + 1/.05 = 120.
    let own = team.own().unwrap().covariance[(3, 3)];
    let between = team.relative(id(1)).unwrap().covariance[(3, 3)];
    assert!((own * 120.0 - 1.0).abs() < 1e-3, "{own}");
    assert!((between * 120.0 - 1.0).abs() < 1e-3, "{between}");
}

#[test]
fn a_start_alone_is_what_is_known() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut team = Team::new(id(0), PERIOD, least_squares(3));
    let (mine, pose) = (standing(0, 0), transform(&mut rng, 1.5, 20.0));
    team.start(&mine, &mine, &pose, 0.02, 0.3).unwrap();
    assert_eq!(
        team.start(&mine, &mine, &pose, 0.02, 0.3),
        Err(Unused::Counted)
    );
    assert!(!team.solve().undetermined);
    let own = team.own().unwrap();
    assert!(apart(&own.world_from_body, &pose) < 1e-12);
    for axis in 0..6 {
        let sigma: f64 = if axis < 3 { 0.02 } else { 0.3 };
        let variance = own.covariance[(axis, axis)];
        assert!(
            (variance / (sigma * sigma) - 1.0).abs() < 1e-9,
            "{variance}"
        );
    }
}

#[test]
fn a_fix_of_an_antenna_pulls_the_vehicle_under_it() {
    let mut team = Team::new(id(0), PERIOD, least_squares(3));
    let mine = standing(0, 0);
    team.start(&mine, &mine, &at(0.0), 1e-5, 0.1).unwrap();
    let antenna = Transform::new(UnitQuaternion::identity(), Vector3::new(0.0, 2.0, 0.0));
    let fix = Observation {
        to_end: antenna,
        ..sees(
            Measurement::position(Vector3::new(0.2, 2.0, 0.0)).unwrap(),
            0.1,
        )
    };
    team.fixed(&mine, 0, &fix).unwrap();
    team.solve_with_stated_noise();
    let own = team.own().unwrap().world_from_body.translation;
    assert!((own - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-6, "{own}");
    assert_eq!(team.fixed(&mine, 0, &fix), Err(Unused::Counted));
    team.fixed(&mine, 1, &fix).unwrap();
    team.solve();
    let own = team.own().unwrap().world_from_body.translation;
    assert!(
        (own.x - 0.4 / 3.0).abs() < 1e-6,
        "another fix of that moment: {own}"
    );
}

#[test]
fn nobody_knows_an_unlocated_vehicle_until_a_pose_is_measured() {
    let flight = Flight::fly(SEED, &Conditions::good(2, 1));
    let (mine, theirs) = (&flight.moments[0][0], &flight.moments[0][1]);
    for measured_by_me in [true, false] {
        let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
        team.start(mine, mine, &flight.truth[0][0], 1e-4, 1e-4)
            .unwrap();
        assert_eq!(team.heard(theirs), Err(Unused::Unlocated));
        let metres = sees(Measurement::distance(3.0).unwrap(), 0.1);
        assert_eq!(team.measured(mine, theirs, &metres), Err(Unused::Unlocated));
        assert!(!team.is_located(id(1)));
        let sighting = flight.sightings[0]
            .iter()
            .find(|sighting| (sighting.from == 0) == measured_by_me)
            .unwrap();
        flight.tell(&mut team, sighting, 0).unwrap();
        assert!(!team.solve().undetermined);
        let (_, pose) = team.world_from(id(1)).unwrap();
        assert!(apart(&pose, &flight.truth[0][1]) < 0.2);
        let spread = team.relative(id(1)).unwrap().covariance;
        let stated = flight.sightings[0][0].observation.noise;
        let sigma = spread[(3, 3)].sqrt();
        assert!(
            sigma < 2.0 * (stated.translation + 4.0 * stated.rotation_rad),
            "{sigma}"
        );
    }
}

#[test]
fn a_fixed_pose_locates_too() {
    let flight = Flight::fly(SEED, &Conditions::good(1, 1));
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let noise = Conditions::good(1, 1).measurement;
    let ends = (transform(&mut rng, 1.0, 5.0), transform(&mut rng, 1.0, 0.5));
    let (mine, truth) = (&flight.moments[0][0], &flight.truth[0][0]);
    let fix = observe(
        &mut rng,
        Kind::Pose,
        &noise,
        (&Pose::identity(), truth),
        ends,
    );
    let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
    team.fixed(mine, 0, &fix).unwrap();
    assert!(!team.solve().undetermined);
    assert!(apart(&team.own().unwrap().world_from_body, truth) < 0.2);
}

#[test]
fn an_odometer_that_says_too_little_is_found_out() {
    let conditions = Conditions {
        short_odometer: Some((1, 0.02)),
        odometry: (0.002, 0.001),
        ..Conditions::good(4, 120)
    };
    let flight = Flight::fly(SEED, &conditions);
    let mut team = flight.team(Settings::DEFAULT);
    flight.follow(&mut team, 1);
    let scale = |vehicle| team.member(id(vehicle)).unwrap().odometer_scale;
    assert!((scale(1) - 0.02).abs() < 2e-3, "{}", scale(1));
    for honest in [0, 2, 3] {
        assert!(scale(honest).abs() < 2e-3, "{honest}: {}", scale(honest));
    }
}

#[test]
fn a_start_that_odometry_has_worn_out_is_refused() {
    let flight = Flight::fly(SEED, &Conditions::good(1, 2));
    let (at, truth) = (&flight.moments[0][0], &flight.truth[0][0]);
    let later = |rotation_rad: f64, segment: u8, seconds: i64| {
        let mut moment = flight.moments[1][0];
        moment.point.taken = at.point.taken + Span::secs(seconds);
        moment.point.segment = segment;
        moment.point.growth = at.point.growth.after(&Vector3::zeros(), rotation_rad, 0.1);
        moment
    };
    let start = |now: &Moment| {
        Team::new(id(0), PERIOD, Settings::DEFAULT).start(at, now, truth, 1e-4, 1e-4)
    };
    assert_eq!(start(&later(0.4, 0, 1)), Ok(()));
    assert_eq!(start(&later(0.6, 0, 1)), Err(Unused::TooLate));
    assert_eq!(
        start(&later(0.0, 0, 3600)),
        Err(Unused::TooLate),
        "by its bias"
    );
    assert_eq!(start(&later(0.0, 1, 1)), Err(Unused::Interrupted));
    assert_eq!(start(&later(0.0, 0, -1)), Err(Unused::Interrupted));
}

#[test]
fn the_noise_scales_find_what_was_understated_and_believe_the_rest() {
    let mut flight = Flight::fly(SEED, &Conditions::good(4, 150));
    let found = |flight: &Flight| {
        let mut team = flight.team(Settings::DEFAULT);
        flight.follow(&mut team, 1);
        *team.scales()
    };
    let stated_well = found(&flight);
    for sighting in flight.sightings.iter_mut().flatten() {
        sighting.observation.noise.translation *= 0.5;
    }
    let stated_half = found(&flight);
    // The kernel weighs everything a little less, and the scales make up for it: two becomes 1.7.
    let scales = &stated_half.measurement;
    assert!((1.6..2.0).contains(&scales.translation()), "{scales:?}");
    assert!((scales.rotation() - 1.0).abs() < 0.05, "{scales:?}");
    assert!(stated_well.measurement.translation() < 1.1);
    for sighting in flight.sightings.iter_mut().flatten() {
        sighting.observation.noise.translation *= 8.0;
    }
    let overstated = found(&flight).measurement;
    assert!(
        (overstated.translation() - 1.0).abs() < 1e-9,
        "{overstated:?}: nobody is more precise than it says"
    );
}

#[test]
fn a_vehicle_is_found_with_every_kind_of_measurement_and_with_lever_arms() {
    for kinds in [
        vec![Kind::Orientation, Kind::Position],
        vec![Kind::Orientation, Kind::Bearing, Kind::Distance],
        vec![Kind::Bearing, Kind::Distance],
        vec![Kind::Pose, Kind::Distance],
    ] {
        let conditions = Conditions {
            kinds: kinds.clone(),
            levers: true,
            ..Conditions::good(4, 60)
        };
        let flight = Flight::fly(SEED, &conditions);
        let mut team = flight.team(Settings::DEFAULT);
        flight.follow(&mut team, 1);
        let error = flight.own_error_m(&team, 59);
        assert!(error < 0.2, "{kinds:?}: {error} m");
        let own = team.own().unwrap();
        let twist = se3::log(&(own.world_from_body.inverse() * flight.truth[59][0]));
        let nees = twist.dot(&(own.covariance.try_inverse().unwrap() * twist));
        assert!(nees < 30.0, "{kinds:?}: NEES {nees}");
    }
}
