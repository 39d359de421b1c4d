//! A live fleet in the default mode, `team`, over Zenoh: what its vehicles tell of each other and how certain they are,
//! together, after one has left, and alone.
#![allow(clippy::unwrap_used)]

mod team;

use skein_agent::{Agent, NetworkSettings};
use skein_proto::document::EstimateDocument;
use skein_proto::status::Status;
use std::process::Command;
use team::{Flight, LEASE, PATIENCE, settings, started, status, until, within};

const FLEET: &str = "team_live";

/// What `skein get VEHICLE --json` prints.
fn got(vehicle: &str, through: &Agent) -> Option<EstimateDocument> {
    let output = Command::new(env!("CARGO_BIN_EXE_skein"))
        .args(["get", vehicle, "--json", "--fleet", FLEET])
        .args(["--connect", &through.locators()[0], "--no-multicast"])
        .output()
        .unwrap();
    let estimates: Vec<EstimateDocument> = serde_json::from_slice(&output.stdout).ok()?;
    estimates.into_iter().next()
}

#[test]
fn a_live_team_tells_how_certain_it_is_and_what_became_of_it() {
    let first = settings(FLEET, 0, NetworkSettings::loopback(vec![]));
    let clock = first.clock;
    let first = started(first);
    let mut others: Vec<(Agent, Flight)> = Vec::new();
    for nth in 1..3 {
        let mut everybody = first.locators();
        everybody.extend(others.iter().flat_map(|(agent, _)| agent.locators()));
        let agent = started(settings(FLEET, nth, NetworkSettings::loopback(everybody)));
        let flight = Flight::in_process(nth, 3, clock, &agent);
        others.push((agent, flight));
    }
    let flight = Flight::in_process(0, 3, clock, &first);

    // Together: everybody tracks, and tells of both others with covariances.
    until("everybody tracks", || {
        let mut agents = others.iter().map(|(agent, _)| agent);
        status(&first) == Some(Status::Tracking)
            && agents.all(|agent| status(agent) == Some(Status::Tracking))
    });
    let mut together = None;
    within(PATIENCE, "both others are told of with covariances", || {
        together = got("v1", &first).filter(|estimate| {
            let certain = |other: &&_| certain(other);
            estimate.neighbours.iter().filter(certain).count() == 2
        });
        together.is_some()
    });
    let together = together.unwrap();
    let sigma_m = together.covariance.as_ref().unwrap().position_sigma_m();
    assert!(sigma_m.unwrap() < 0.1, "{sigma_m:?}");
    let mut health = None;
    // The health comes once a second.
    within(PATIENCE, "all three are members", || {
        health = first.latest_health();
        let team = health
            .as_ref()
            .and_then(|health| health.rounds.team.clone());
        team.is_some_and(|team| (team.members, team.restarts) == (3, 0))
    });
    let health = health.unwrap();
    assert_eq!(health.rounds.mode, "team");
    assert!(health.neighbours.values().all(|other| !other.quarantined));

    // One leaves: the other two go on.
    let (leaving, its_flight) = others.pop().unwrap();
    drop(its_flight);
    leaving.stop();
    within(LEASE * 2, "v3 is missed", || {
        first.latest_estimate().unwrap().document.neighbours.len() == 1
    });
    assert_eq!(status(&first), Some(Status::Tracking));

    // Alone: by its own odometry, less certain from second to second, and it says so.
    let (leaving, its_flight) = others.pop().unwrap();
    drop(its_flight);
    leaving.stop();
    within(LEASE * 3, "v1 is alone", || {
        status(&first) == Some(Status::Alone)
    });
    let sigma_m = || {
        let estimate = first.latest_estimate().unwrap();
        let covariance = estimate.document.covariance.clone();
        covariance.unwrap().position_sigma_m().unwrap()
    };
    let before_m = sigma_m();
    within(PATIENCE, "its covariance grows", || sigma_m() > before_m);
    drop(flight);
    first.stop();
}

/// Whether a neighbour is told of with its pose and its covariance.
fn certain(neighbour: &skein_proto::document::NeighbourDocument) -> bool {
    neighbour.pose.is_some()
        && neighbour
            .covariance
            .as_ref()
            .is_some_and(|covariance| covariance.position_sigma_m().is_some())
}
