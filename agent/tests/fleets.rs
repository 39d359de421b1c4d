//! Two fleets on one network, over real Zenoh on the loopback address: the same names, and no word between them.
#![allow(clippy::unwrap_used)]

use skein_agent::{Agent, Clock, NetworkSettings, Settings, new_boot};
use skein_estimation::cooperative::{Mode, Optimiser};
use skein_estimation::time::Span;
use skein_estimation::transform::Transform;
use skein_proto::name::Name;
use skein_vehicle::{Config, Start, ToldPose};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(20);

fn name(text: &str) -> Name {
    Name::parse(text).unwrap()
}

fn started(fleet: &str, vehicle: &str, connect: Vec<String>) -> Agent {
    let settings = Settings {
        fleet: name(fleet),
        vehicle: Config {
            vehicle: name(vehicle),
            boot: new_boot(),
            period: Span::millis(200),
            round_wait: Span::millis(300),
            start: Start::Pose(ToldPose::by_hand(Transform::identity())),
            mode: Mode::default(),
            optimiser: Optimiser::default(),
            sensors: Vec::new(),
            body_from_target: Transform::identity(),
            presence_timeout: Span::secs(2),
            repeats: 3,
            tell_absolute: false,
            ask_backlog: false,
            estimate_spacing: Span::millis(50),
        },
        drivers: BTreeMap::new(),
        network: NetworkSettings::loopback(connect),
        clock: Clock::real(),
        log: None,
        checkpoint: None,
        rpc: false,
        faults: None,
    };
    let agent = Agent::start(settings).unwrap();
    assert!(agent.wait_open(PATIENCE), "no session");
    agent
}

/// Waits until something holds; fails with `what` when it does not in time.
#[expect(
    clippy::disallowed_methods,
    reason = "a test that watches real processes measures real time"
)]
fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let since = Instant::now();
    while !holds() {
        assert!(
            since.elapsed() < PATIENCE,
            "{what}: not within {PATIENCE:?}"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn two_fleets_on_one_network_do_not_see_each_other() {
    let goose = started("geese", "v1", vec![]);
    let swan = started("swans", "v1", goose.locators());
    let mut everybody = goose.locators();
    everybody.extend(swan.locators());
    let goslings = ["v2", "v3"].map(|vehicle| started("geese", vehicle, everybody.clone()));
    let cygnet = started("swans", "v2", everybody);

    // All are linked to all: who keeps the fleets apart is the keys.
    let agents = [&goose, &swan, &goslings[0], &goslings[1], &cygnet];
    for agent in agents {
        until("everybody is linked to everybody", || {
            let health = agent.latest_health().and_then(|h| h.process.clone());
            health.is_some_and(|process| process.peers == 4)
        });
    }
    let clocks_known = |agent: &Agent, of: usize| {
        let neighbours = agent.latest_health().unwrap().neighbours.clone();
        let known = neighbours.values().filter(|n| n.clock_offset_s.is_some());
        known.count() == of
    };
    for (agent, of) in agents.into_iter().zip([2, 1, 2, 2, 1]) {
        until("each knows the others of its fleet", || {
            clocks_known(agent, of)
        });
    }
    for (agent, others) in agents.into_iter().zip([
        vec!["v2", "v3"],
        vec!["v2"],
        vec!["v1", "v3"],
        vec!["v1", "v2"],
        vec!["v1"],
    ]) {
        let health = agent.latest_health().unwrap();
        let known: Vec<&String> = health.neighbours.keys().collect();
        assert_eq!(known, others);
        // A name that is borne in either fleet is nobody's double.
        assert_eq!(health.namesake_boot, None);
        assert!(health.refused.is_empty(), "{:?}", health.refused);
        for neighbour in health.neighbours.values() {
            assert!(neighbour.duplicate_boots.is_empty());
            assert_eq!(neighbour.refused.get("wrong_hash"), None);
        }
    }
}
