//! Each piece of information counts once, in whatever order and however often it comes.

use super::*;

const ROUNDS: usize = 16;

fn flight() -> Flight {
    Flight::fly(SEED, &Conditions::good(4, ROUNDS))
}

fn assert_same(a: &Team, b: &Team) {
    assert_eq!(a.own(), b.own());
    for vehicle in 0..4 {
        assert_eq!(a.relative(id(vehicle)), b.relative(id(vehicle)));
        assert_eq!(a.world_from(id(vehicle)), b.world_from(id(vehicle)));
        assert_eq!(a.member(id(vehicle)), b.member(id(vehicle)));
    }
    assert_eq!(a.scales(), b.scales());
    assert_eq!(a.statistics(), b.statistics());
}

#[test]
fn the_same_flight_gives_the_same_bits() {
    let flight = flight();
    let follow = || {
        let mut team = flight.team(Settings::DEFAULT);
        flight.follow(&mut team, 1);
        team
    };
    assert_same(&follow(), &follow());
}

#[test]
fn a_packet_that_repeats_the_last_rounds_changes_no_bit() {
    let flight = flight();
    let (mut once, mut often) = (
        flight.team(Settings::DEFAULT),
        flight.team(Settings::DEFAULT),
    );
    for round in 1..ROUNDS {
        flight.hear(&mut once, round);
        flight.hear(&mut often, round);
        for past in round.saturating_sub(2).max(1)..=round {
            for moment in &flight.moments[past] {
                often.heard(moment).unwrap();
            }
            for sighting in &flight.sightings[past] {
                // Another packet, other bits: a measurement of the same moment and kind is the same one.
                let mut again = *sighting;
                again.observation.noise.translation *= 0.1;
                assert_eq!(flight.tell(&mut often, &again, past), Err(Unused::Counted));
            }
        }
        once.solve();
        often.solve();
        assert_same(&once, &often);
    }
}

#[test]
fn what_comes_after_its_round_has_left_counts_no_more() {
    let flight = flight();
    let (mut once, mut late) = (
        flight.team(Settings::DEFAULT),
        flight.team(Settings::DEFAULT),
    );
    let gone = Settings::DEFAULT.lag.several as usize + 3;
    assert!(ROUNDS > gone + 1, "something must come too late");
    for round in 1..ROUNDS {
        flight.hear(&mut once, round);
        flight.hear(&mut late, round);
        if round > gone {
            for sighting in &flight.sightings[round - gone] {
                assert_eq!(
                    flight.tell(&mut late, sighting, round - gone),
                    Err(Unused::TooLate)
                );
            }
        }
        once.solve();
        late.solve();
        assert_same(&once, &late);
    }
}

/// Estimates that differ by rounding and by what a few iterations leave.
fn assert_close(a: &Team, b: &Team, tolerance: f64) {
    let (a_own, b_own) = (a.own().unwrap(), b.own().unwrap());
    assert!(apart(&a_own.world_from_body, &b_own.world_from_body) < tolerance);
    assert!((a_own.covariance - b_own.covariance).norm() < tolerance * a_own.covariance.norm());
    for vehicle in 1..4 {
        let of = |team: &Team| team.relative(id(vehicle)).unwrap().body_from_neighbour;
        assert!(apart(&of(a), &of(b)) < tolerance, "vehicle {vehicle}");
    }
}

#[test]
fn the_order_within_a_round_does_not_matter() {
    let flight = flight();
    let (mut forwards, mut backwards) = (
        flight.team(Settings::DEFAULT),
        flight.team(Settings::DEFAULT),
    );
    for round in 1..ROUNDS {
        flight.hear(&mut forwards, round);
        for sighting in flight.sightings[round].iter().rev() {
            flight.tell(&mut backwards, sighting, round).unwrap();
        }
        forwards.solve();
        backwards.solve();
        assert_close(&forwards, &backwards, 1e-9);
    }
}

#[test]
fn a_measurement_that_comes_a_round_late_counts_as_much_as_one_in_time() {
    let flight = flight();
    let settings = least_squares(3);
    let (mut in_time, mut late) = (flight.team(settings), flight.team(settings));
    let held_back = |sighting: &Sighting| sighting.from == 2;
    for round in 1..ROUNDS {
        flight.hear(&mut in_time, round);
        for moment in &flight.moments[round] {
            // The third vehicle's packets take a round.
            if moment.vehicle != id(2) || round + 1 == ROUNDS {
                late.heard(moment).unwrap();
            }
        }
        late.heard(&flight.moments[round - 1][2]).unwrap();
        let now = flight.sightings[round].iter();
        for sighting in now.filter(|sighting| !held_back(sighting) || round + 1 == ROUNDS) {
            flight.tell(&mut late, sighting, round).unwrap();
        }
        let before = flight.sightings[round - 1].iter();
        for sighting in before.filter(|sighting| round > 1 && held_back(sighting)) {
            flight.tell(&mut late, sighting, round - 1).unwrap();
        }
        in_time.solve_with_stated_noise();
        late.solve_with_stated_noise();
    }
    // To second order in the noise: what was marginalised was linearised elsewhere.
    assert_close(&in_time, &late, 2e-3);
}
