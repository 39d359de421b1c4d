//! Two fleets on one network, over real Zenoh on the loopback address: the same names, and no word between them.
#![allow(clippy::unwrap_used)]

mod team;

use skein_agent::{Agent, NetworkSettings};
use team::{settings_of, until};

/// A vehicle without sensors.
fn started(fleet: &str, vehicle: &str, connect: Vec<String>) -> Agent {
    let mut settings = settings_of(fleet, vehicle, NetworkSettings::loopback(connect));
    settings.vehicle.sensors.clear();
    team::started(settings)
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
