//! The experiment of mutual localisation: its scores and tables on known answers.

use super::*;
use crate::mutual_scenario::MutualScenario;

#[test]
fn every_case_has_a_name_of_its_own_and_some_vehicle_to_talk_to() {
    for case in case::CASES {
        assert_eq!(Case::named(case.name), Some(case));
        assert!(case.scenario(1).formation.talking() > 2);
    }
}

#[test]
fn what_a_vehicle_tells_is_what_it_sees_by_its_own_attitude() {
    let scenario = MutualScenario {
        duration_s: 12.0,
        ..MutualScenario::square()
    };
    let world = MutualWorld::new(&scenario, 0);
    let telling = Telling::of(&world);
    assert_eq!(telling.told.len(), 4);
    // Five degrees of noise, sharpened by nothing: the mean angle is sqrt(pi/2) of one axis, and a robot level with
    // the observer has both.
    let mut angles = Vec::new();
    for (vehicle, told) in telling.told.iter().enumerate() {
        for told in told
            .iter()
            .filter(|told| told.set.taken.as_nanos() > 8_000_000_000)
        {
            for (feature, who) in told.set.features.iter().zip(&told.who) {
                let taken_s = told.set.taken.as_nanos() as f64 / 1e9;
                let truth = world.relative(vehicle, who.unwrap(), taken_s).position_m;
                angles.push(feature.direction.angle(&truth).to_degrees());
            }
        }
    }
    let mean = angles.iter().sum::<f64>() / angles.len() as f64;
    assert!((mean / 6.27 - 1.0).abs() < 0.08, "{mean}");
    assert!(
        telling.told[0]
            .last()
            .unwrap()
            .set
            .tracks
            .iter()
            .any(|track| track.confirmed)
    );
}

#[test]
fn four_in_a_square_are_told_apart_and_the_report_says_so() {
    let request = Request {
        samples: 2,
        seed: 1,
        methods: vec![Method::Identity],
    };
    let case = Case::named("square").unwrap();
    let results = run(&case, &request, || {});
    let scores = &results[0].scores;
    assert_eq!(
        (scores.neighbours, scores.wrong_at_end, scores.silent_at_end),
        (6, 0, 0)
    );
    assert!(scores.azimuth_deg.value.unwrap() < 2.5, "{scores:?}");
    assert_eq!(results[0].snapshots.len(), 2);
    assert_eq!(report::csv(&results).lines().count(), 2);
    assert!(report::table(&results).contains("identity"));
    for (name, svg) in figures::of(&results[0]).unwrap() {
        assert!(
            name.starts_with("square-identity-") && svg.starts_with("<svg"),
            "{name}"
        );
    }
}
