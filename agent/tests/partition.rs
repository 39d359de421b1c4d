//! Live teams that are torn apart and come together again: by a radio that carries nothing, and by a cut cable, in which
//! nothing flows and nobody is told.
#![allow(clippy::unwrap_used)]

mod team;

use skein_agent::{Agent, Clock, NetworkSettings};
use skein_proto::faults::Faults;
use skein_proto::status::Status;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use team::{
    Flight, LEASE, Since, name, neighbour, nth_name, pause, settings, started, status, until,
    within,
};

const TEAM: usize = 3;
const SECOND: Duration = Duration::from_secs(1);

/// What a vehicle has accepted of another, and used of it, by its health.
fn exchanged(agent: &Agent, of: &str) -> (u64, u64) {
    let neighbour = neighbour(agent, of);
    let accepted = neighbour.accepted.get("exchange").copied();
    (accepted.unwrap_or_default(), neighbour.fused)
}

/// All of them know and correct each other.
fn gathered(agents: &[Agent]) {
    until("everybody is tracking everybody", || {
        (0..TEAM).all(|nth| {
            let of = |other: usize| exchanged(&agents[nth], nth_name(other).as_str()).1 > 0;
            status(&agents[nth]) == Some(Status::Tracking)
                && (0..TEAM).filter(|other| *other != nth).all(of)
        })
    });
}

/// Whether a vehicle has a status; if not, its health says why.
fn assert_status(agent: &Agent, wanted: Status) {
    let estimate = agent.latest_estimate().unwrap();
    let health = agent.latest_health().unwrap();
    assert_eq!(
        estimate.document.status, wanted,
        "{estimate:#?} {health:#?}"
    );
}

/// v1 hears of v2 and v3 again: how long until its estimate was corrected by them, and until its health tells so.
fn reunited(first: &Agent, before: [(u64, u64); 2], healed: Since) -> (Duration, Duration) {
    until("v1 is corrected again", || {
        status(first) == Some(Status::Tracking)
    });
    let corrected = healed.elapsed();
    until("the health of v1 counts it", || {
        ["v2", "v3"].iter().zip(before).any(|(of, before)| {
            let now = exchanged(first, of);
            now.0 > before.0 && now.1 > before.1
        })
    });
    (corrected, healed.elapsed())
}

#[test]
fn a_vehicle_cut_off_by_its_radio_says_so_within_the_lease_and_a_second_and_is_back_within_one() {
    let mut agents: Vec<Agent> = Vec::new();
    let mut flights = Vec::new();
    for nth in 0..TEAM {
        let known = agents.iter().flat_map(Agent::locators).collect();
        let settings = settings("parted", nth, NetworkSettings::loopback(known));
        let clock = settings.clock;
        let agent = started(settings);
        flights.push(Flight::in_process(nth, TEAM, clock, &agent));
        agents.push(agent);
    }
    gathered(&agents);

    // When: no packet passes between v1 and the others, while every link stays as it is.
    let isolated = Faults {
        partitions: vec![vec![vec![name("v1")], vec![name("v2"), name("v3")]]],
        ..Faults::default()
    };
    for agent in &agents {
        agent.take_faults(isolated.clone()).unwrap();
    }
    let alone = within(LEASE + SECOND, "v1 says that it is alone", || {
        status(&agents[0]) == Some(Status::Alone)
    });
    // Then: the other two still have each other.
    assert_status(&agents[1], Status::Tracking);
    std::thread::sleep(2 * SECOND);
    assert_status(&agents[0], Status::Alone);
    assert_status(&agents[2], Status::Tracking);

    let before = ["v2", "v3"].map(|of| exchanged(&agents[0], of));
    let healed = Since::now();
    for agent in &agents {
        agent.take_faults(Faults::default()).unwrap();
    }
    let (corrected, told) = reunited(&agents[0], before, healed);
    eprintln!(
        "radio: alone after {alone:.2?}, corrected {corrected:.2?} after healing, told by the health after {told:.2?}"
    );
    assert!(corrected < SECOND, "{corrected:?}");
    // The health is published once a second.
    assert!(told < 2 * SECOND, "{told:?}");
}

/// A cable between whoever dials [`Cable::endpoint`] and one address. When it is cut nothing flows and nothing is
/// closed, and what was begun before or meanwhile never carries anything again.
struct Cable {
    shared: Arc<Ends>,
    endpoint: String,
    accepting: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Ends {
    /// Cuts and mendings so far: whole while it is even. A connection lives as long as it does not change.
    changes: AtomicUsize,
    removed: AtomicBool,
}

impl Ends {
    fn lives(&self, begun: usize) -> bool {
        begun.is_multiple_of(2) && self.changes.load(Ordering::SeqCst) == begun
    }

    fn is_removed(&self) -> bool {
        self.removed.load(Ordering::SeqCst)
    }
}

impl Cable {
    /// To an endpoint `tcp/IP:PORT`.
    fn to(endpoint: &str) -> Self {
        let address = endpoint.strip_prefix("tcp/").unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
        let shared = Arc::new(Ends::default());
        let ends = Arc::clone(&shared);
        let accepting = std::thread::spawn(move || accept(&listener, &address, &ends));
        Self {
            shared,
            endpoint,
            accepting: Some(accepting),
        }
    }

    /// Cuts it, or mends it.
    fn change(&self) {
        self.shared.changes.fetch_add(1, Ordering::SeqCst);
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.shared.removed.store(true, Ordering::SeqCst);
        self.accepting.take().unwrap().join().unwrap();
    }
}

fn accept(listener: &TcpListener, address: &str, ends: &Arc<Ends>) {
    // Kept open to the end: whoever is cut off is not told.
    let mut open = Vec::new();
    let mut pumps = Vec::new();
    while !ends.is_removed() {
        let Ok((near, _)) = listener.accept() else {
            pause();
            continue;
        };
        near.set_nonblocking(false).unwrap();
        let begun = ends.changes.load(Ordering::SeqCst);
        if begun.is_multiple_of(2) {
            let far = TcpStream::connect(address).unwrap();
            let ways = [
                (near.try_clone().unwrap(), far.try_clone().unwrap()),
                (far.try_clone().unwrap(), near.try_clone().unwrap()),
            ];
            for (from, to) in ways {
                let ends = Arc::clone(ends);
                pumps.push(std::thread::spawn(move || pump(from, to, begun, &ends)));
            }
            open.push(far);
        }
        open.push(near);
    }
    for pump in pumps {
        pump.join().unwrap();
    }
}

/// Carries bytes one way, and the end of them, as long as the connection lives.
fn pump(mut from: TcpStream, mut to: TcpStream, begun: usize, ends: &Ends) {
    from.set_read_timeout(Some(Duration::from_millis(10)))
        .unwrap();
    from.set_nodelay(true).unwrap();
    let mut bytes = [0; 65_536];
    while !ends.is_removed() {
        let read = from.read(&mut bytes);
        if !ends.lives(begun) {
            return;
        }
        match read {
            Ok(0) => return drop(to.shutdown(Shutdown::Write)),
            Ok(count) if to.write_all(&bytes[..count]).is_ok() => {}
            Err(error)
                if matches!(
                    error.kind(),
                    std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut
                ) => {}
            _ => return,
        }
    }
}

/// The network of a vehicle that nothing reaches but what it dials itself, otherwise as the production settings are: it
/// listens nowhere and takes no gossip, or it would find a way around the cable.
fn only_by(connect: Vec<String>, folder: &Path) -> NetworkSettings {
    let mut config = NetworkSettings::loopback(connect).zenoh().unwrap();
    config.insert_json5("listen/endpoints", "[]").unwrap();
    config
        .insert_json5("scouting/gossip/enabled", "false")
        .unwrap();
    let file = folder.join("zenoh.json5");
    std::fs::write(&file, config.to_string()).unwrap();
    NetworkSettings {
        zenoh_config: Some(file),
        ..NetworkSettings::default()
    }
}

#[test]
fn a_vehicle_behind_a_cut_cable_says_so_and_three_seconds_after_it_is_mended_it_is_back() {
    // Given: v2 and v3 know each other; v1 reaches each of them through a cable.
    let folder = std::env::temp_dir().join(format!("skein-cable-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let clock = Clock::real();
    let second = started(settings("cable", 1, NetworkSettings::loopback(vec![])));
    let third = started(settings(
        "cable",
        2,
        NetworkSettings::loopback(second.locators()),
    ));
    let cables = [&second, &third].map(|agent| Cable::to(&agent.locators()[0]));
    let ends = cables.iter().map(|cable| cable.endpoint.clone()).collect();
    let first = started(settings("cable", 0, only_by(ends, &folder)));
    let agents = [first, second, third];
    let flights: Vec<Flight> = (0..TEAM)
        .map(|nth| Flight::in_process(nth, TEAM, clock, &agents[nth]))
        .collect();
    gathered(&agents);

    // When: both cables are cut.
    let change = || cables.iter().for_each(Cable::change);
    change();
    let alone = within(LEASE + SECOND, "v1 says that it is alone", || {
        status(&agents[0]) == Some(Status::Alone)
    });
    // Then: the links are given up, and the other two still have each other.
    until("v1 has no peer", || {
        let health = agents[0].latest_health().unwrap();
        health.process.as_ref().is_some_and(|p| p.peers == 0)
    });
    assert_status(&agents[1], Status::Tracking);
    // Long enough for v1 to dial in vain.
    std::thread::sleep(3 * SECOND);
    assert_status(&agents[0], Status::Alone);

    let before = ["v2", "v3"].map(|of| exchanged(&agents[0], of));
    let healed = Since::now();
    change();
    let (corrected, told) = reunited(&agents[0], before, healed);
    eprintln!(
        "cable: alone after {alone:.2?}, corrected {corrected:.2?} after mending, told by the health after {told:.2?}"
    );
    assert!(corrected < 3 * SECOND, "{corrected:?}");
    assert!(told < 4 * SECOND, "{told:?}");
    drop(flights);
    drop(agents);
    std::fs::remove_dir_all(folder).unwrap();
}
