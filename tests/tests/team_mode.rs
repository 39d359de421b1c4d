//! Mode `team` in fleets of production vehicles over the simulated radio: as accurate as it can be, as certain as it is,
//! and moved by nothing that is not information.
#![allow(clippy::unwrap_used)]

use skein_estimation::cooperative::{Mode, Robust};
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, LoggedValue};
use skein_simworld::scenario::Scenario;
use skein_simworld::world::nanos;
use skein_tests::stories::{built_in, nees, status};
use skein_vehicle::{Config, Input, Output, PacketKey, Start};

const SAMPLES: u64 = 8;
const END_S: f64 = 20.0;

fn in_team(_: usize, config: Config) -> Config {
    Config {
        mode: Mode::Team,
        ..config
    }
}

/// Flies samples of a scenario to the end of section V and gives each fleet.
fn flown(scenario: &Scenario, change: impl Fn(usize, Config) -> Config) -> Vec<Fleet> {
    let fly = |sample| {
        let mut fleet = Fleet::with_configs(scenario, sample, &change);
        fleet.run_until(nanos(END_S) + 300_000_000);
        fleet
    };
    (0..SAMPLES).map(fly).collect()
}

/// Root of the mean square position error over some vehicles of all flights.
fn rmse_m(flights: &[Fleet], vehicles: &[usize]) -> f64 {
    let errors = flights.iter().flat_map(|fleet| {
        vehicles
            .iter()
            .map(|vehicle| fleet.position_error_m(*vehicle))
    });
    let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| {
        (sum + error * error, count + 1.0)
    });
    f64::sqrt(sum / count)
}

/// The mean NEES of what some vehicles publish of themselves.
fn mean_nees(flights: &[Fleet], vehicles: &[usize]) -> f64 {
    let own = flights
        .iter()
        .flat_map(|fleet| vehicles.iter().map(|vehicle| nees(fleet, *vehicle)));
    let (sum, count) = own.fold((0.0, 0.0), |(sum, count), nees| (sum + nees, count + 1.0));
    sum / count
}

const ALL: [usize; 5] = [0, 1, 2, 3, 4];

#[test]
fn section_v_is_flown_at_a_third_of_the_star_s_error_and_the_published_covariance_means_it() {
    let flights = flown(&built_in("section-v"), in_team);
    let error = rmse_m(&flights, &ALL);
    let star = flown(&built_in("section-v"), |_, config| Config {
        mode: Mode::Star(Robust::DEFAULT),
        ..config
    });
    println!("team {error:.3} m, star {:.3} m", rmse_m(&star, &ALL));
    assert!(error < 0.10 && 2.0 * error < rmse_m(&star, &ALL));
    // Vehicles of one flight are not independent: eight flights of six numbers leave a standard deviation of 0.2.
    let nees = mean_nees(&flights, &ALL);
    println!("NEES {nees:.2}");
    assert!((0.5..1.6).contains(&nees));
    for fleet in &flights {
        assert_eq!(status(fleet, 0), Status::Tracking);
        let seen = &fleet.estimate(0).unwrap().neighbours;
        assert!(seen.iter().all(|other| other.covariance.is_some()));
    }
    let health = flights[0].health(0).unwrap().rounds.team.clone().unwrap();
    assert_eq!((health.members, health.restarts, health.evicted), (5, 0, 0));
    assert!(health.position_sigma_m.unwrap() < 0.5);
}

#[test]
fn three_packets_in_ten_lost_and_one_measurement_in_five_wrong_cost_little() {
    let mut scenario = built_in("section-v");
    scenario.radio.loss = 0.3;
    let error = rmse_m(&flown(&scenario, in_team), &ALL);
    println!("30 % loss: {error:.3} m");
    assert!(error < 0.11);
    let mut scenario = built_in("section-v");
    scenario.sensor.false_positives.wrong_probability = 0.2;
    scenario.sensor.false_positives.wrong = skein_simworld::sensor::Wrong::Gross;
    let flights = flown(&scenario, in_team);
    let error = rmse_m(&flights, &ALL);
    println!("20 % gross: {error:.3} m");
    assert!(error < 0.12);
    let quarantines = flights.iter().flat_map(|fleet| {
        let neighbours = &fleet.health(0).unwrap().neighbours;
        neighbours.values().map(|neighbour| neighbour.quarantined)
    });
    assert!(
        quarantines.into_iter().all(|accused| !accused),
        "honest vehicles are not accused"
    );
}

#[test]
fn vehicles_in_other_modes_take_part_with_what_they_measure() {
    let mixed = |vehicle: usize, config: Config| Config {
        mode: match vehicle {
            0 => Mode::Paper,
            1 => Mode::Star(Robust::DEFAULT),
            _ => Mode::Team,
        },
        ..config
    };
    let paper = |_: usize, config: Config| Config {
        mode: Mode::Paper,
        ..config
    };
    let flights = flown(&built_in("section-v"), mixed);
    let pure = flown(&built_in("section-v"), paper);
    for vehicle in ALL {
        let (mixed, pure) = (rmse_m(&flights, &[vehicle]), rmse_m(&pure, &[vehicle]));
        println!("vehicle {vehicle}: {mixed:.3} m, all in mode paper {pure:.3} m");
        assert!(mixed <= pure, "vehicle {vehicle}");
    }
    let nees = mean_nees(&flights, &[2, 3, 4]);
    println!("NEES of those in mode team {nees:.2}");
    assert!((0.5..1.6).contains(&nees));
}

#[test]
fn a_vehicle_that_does_not_know_where_it_starts_is_placed_and_then_as_good_as_the_others() {
    let unknown = |vehicle: usize, config: Config| Config {
        start: if vehicle == 4 {
            Start::Unknown
        } else {
            config.start
        },
        ..in_team(vehicle, config)
    };
    let flights = flown(&built_in("section-v"), unknown);
    let (placed, others) = (rmse_m(&flights, &[4]), rmse_m(&flights, &ALL[..4]));
    println!("placed {placed:.3} m, others {others:.3} m");
    assert!(placed < 0.2 && others < 0.12);
}

/// Every estimate that a vehicle published.
fn estimates(fleet: &mut Fleet, vehicle: usize) -> Vec<Output> {
    let log = fleet.take_log().into_iter();
    log.filter(|entry| entry.vehicle == vehicle)
        .filter_map(|entry| match entry.what {
            LoggedValue::Output(output @ Output::Estimate { .. }) => Some(output),
            _ => None,
        })
        .collect()
}

#[test]
fn forged_and_replayed_records_change_not_a_bit() {
    let fly = |forge: bool| {
        let mut fleet = Fleet::with_configs(&built_in("section-v"), 0, in_team);
        fleet.log();
        let mut published = Vec::new();
        for round in 0..60 {
            fleet.run_until(round * 200_000_000);
            let log = fleet.take_log();
            fleet.log();
            let heard = log.iter().find_map(|entry| match &entry.what {
                LoggedValue::Input(Input::Packet { key, bytes })
                    if entry.vehicle == 0 && matches!(key, PacketKey::Odometry { .. }) =>
                {
                    Some((*key, bytes.clone()))
                }
                _ => None,
            });
            published.extend(log.into_iter().filter_map(|entry| match entry.what {
                LoggedValue::Output(output @ Output::Estimate { .. }) if entry.vehicle == 0 => {
                    Some(output)
                }
                _ => None,
            }));
            if let (true, Some((key, bytes))) = (forge, heard) {
                // Again; of another boot (bytes 8 to 15 of the envelope); of another name (bytes 16 to 23).
                fleet.inject(0, key, bytes.clone());
                for at in [8, 16] {
                    let mut forged = bytes.clone();
                    forged[at] ^= 0x5a;
                    fleet.inject(0, key, forged);
                }
            }
        }
        fleet.run_until(nanos(13.0));
        published.extend(estimates(&mut fleet, 0));
        let health = fleet.health(0).unwrap();
        let neighbours = health.neighbours.values();
        let refused: u64 = neighbours.flat_map(|other| other.refused.values()).sum();
        (published, refused)
    };
    let ((alone, _), (beset, refused)) = (fly(false), fly(true));
    assert!(refused > 100, "{refused} refused");
    assert_eq!(alone.len(), beset.len());
    let document = |output: &Output| match output {
        Output::Estimate { document, .. } => (
            document.pose,
            document.covariance.clone(),
            document.neighbours.clone(),
        ),
        _ => unreachable!("only estimates were kept"),
    };
    assert!(alone.iter().map(document).eq(beset.iter().map(document)));
}
