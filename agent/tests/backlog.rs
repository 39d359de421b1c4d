//! A live vehicle that was deaf for some seconds asks its neighbour over Zenoh for what it missed, and its log tells so.
#![allow(clippy::unwrap_used)]

mod team;

use skein_agent::NetworkSettings;
use skein_estimation::cooperative::Mode;
use skein_proto::faults::Faults;
use std::time::Duration;
use team::{Flight, LEASE, name, neighbour, settings, started, until, within};

const DEAF_FOR: Duration = Duration::from_secs(4);

#[test]
fn what_was_missed_over_the_air_is_had_from_the_neighbour_s_backlog() {
    let folder = std::env::temp_dir().join(format!("skein-backlog-{}", std::process::id()));
    let log = folder.join("v1.mcap");
    let mut first = settings("backlog", 0, NetworkSettings::loopback(vec![]));
    first.vehicle.mode = Mode::Team;
    first.log = Some(log.clone());
    let clock = first.clock;
    let first = started(first);
    let second = started(settings(
        "backlog",
        1,
        NetworkSettings::loopback(first.locators()),
    ));
    let flights = [
        Flight::in_process(0, 2, clock, &first),
        Flight::in_process(1, 2, clock, &second),
    ];
    let counted = |word: &str| {
        let accepted = neighbour(&first, "v2").accepted;
        accepted.get(word).copied().unwrap_or_default()
    };
    until("v1 hears v2", || counted("odometry") > 10);
    let before = counted("backlog_rounds");

    // When: nothing of v2 reaches v1, though it is heard itself.
    let silence = Faults {
        partitions: vec![vec![vec![name("v1")], vec![name("v2")]]],
        ..Faults::default()
    };
    first.take_faults(silence).unwrap();
    std::thread::sleep(DEAF_FOR);
    first.take_faults(Faults::default()).unwrap();

    // Then: all but the repeated rounds come by the backlog. The health is published once a second.
    let missed = DEAF_FOR.as_millis() as u64 / 200 - 5;
    let took = within(LEASE, "v1 has what it missed", || {
        counted("backlog_rounds") >= before + missed
    });
    eprintln!("told by the health {took:.2?} after the return");
    assert_eq!(neighbour(&first, "v2").refused.get("unasked"), None);

    drop(flights);
    second.stop();
    first.stop();
    let verified = skein_agent::verify::verify(&log).unwrap();
    assert!(verified.ended && verified.inputs > 100, "{verified:?}");
    std::fs::remove_dir_all(folder).unwrap();
}
