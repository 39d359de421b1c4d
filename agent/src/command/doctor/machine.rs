//! What can be told of this machine alone: clock, folders, interfaces, and whether multicast works on them.

use super::finding::Finding;
use crate::clock::real_now;
use crate::network::NetworkSettings;
use crate::settings::Settings;
use pnet_datalink::NetworkInterface;
use skein_estimation::time::Stamp;
use socket2::{Domain, Protocol, Socket, Type};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Nanoseconds of UNIX time between which a clock is believed: 2025 to 2100.
const BELIEVED_NS: std::ops::Range<i64> = 1_735_689_600_000_000_000..4_102_444_800_000_000_000;
/// What systemd-timesyncd leaves when it has set the clock.
const SYNCHRONISED: &str = "/run/systemd/timesync/synchronized";
/// How long a packet to the own multicast group may take.
const HEARD_WITHIN: Duration = Duration::from_millis(300);
/// Zenoh's group, when its configuration names none.
const GROUP: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(224, 0, 0, 224), 7446);

/// Whether the system's clock can be right at all.
pub(super) fn wall_clock(now: Stamp) -> Finding {
    let seconds = now.as_nanos() / 1_000_000_000;
    let year = 1970 + seconds / 31_556_952;
    if BELIEVED_NS.contains(&now.as_nanos()) {
        Finding::ok("clock", format!("UNIX time {seconds} s, in {year}"))
    } else {
        Finding::problem(
            "clock",
            format!("UNIX time {seconds} s, in {year}"),
            "vehicles learn each other's clocks, but logs, certificates and a resumed pose need the right date",
            "set the clock (NTP, GPS or `date -s`), or give the computer a battery for it",
        )
    }
}

/// Whether something keeps the clock right, where that can be told from a file.
pub(super) fn synchronised() -> Finding {
    if Path::new(SYNCHRONISED).exists() {
        Finding::ok("time service", "systemd-timesyncd has set the clock")
    } else {
        Finding::skipped(
            "time service",
            "systemd-timesyncd has not set the clock; whether another service has cannot be told here",
        )
    }
}

/// Whether the folders that the daemon writes to take a file.
pub(super) fn folders(settings: &Settings) -> Vec<Finding> {
    let written = [
        ("log folder", settings.log.as_deref()),
        ("checkpoint folder", settings.checkpoint.as_deref()),
    ];
    written
        .into_iter()
        .filter_map(|(check, path)| Some((check, path?)))
        .map(|(check, path)| folder_of(check, path))
        .collect()
}

fn folder_of(check: &str, file: &Path) -> Finding {
    let folder = match file.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => file,
    };
    match try_folder(folder) {
        Ok(existing) if existing == folder => {
            Finding::ok(check, format!("{} can be written", folder.display()))
        }
        Ok(existing) => Finding::ok(
            check,
            format!(
                "{} is not there yet; `skein run` makes it in {}",
                folder.display(),
                existing.display()
            ),
        ),
        Err(error) => Finding::problem(
            check,
            format!("{}: {error}", folder.display()),
            "`skein run` does not start when it cannot write there",
            "create it for the user that runs skein (mkdir, chown), or name another in the configuration",
        ),
    }
}

/// Makes a file in a folder, or in the nearest one above that exists, and removes it again.
fn try_folder(folder: &Path) -> std::io::Result<PathBuf> {
    let existing = folder
        .ancestors()
        .map(|above| {
            if above.as_os_str().is_empty() {
                Path::new(".")
            } else {
                above
            }
        })
        .find(|above| above.exists())
        .unwrap_or(Path::new("."));
    let file = existing.join(format!(".skein-doctor-{}", std::process::id()));
    std::fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(&file)?;
    std::fs::remove_file(&file)?;
    Ok(existing.to_owned())
}

/// The interfaces with their addresses, and whether the configured one can be used.
pub(super) fn interfaces(network: &NetworkSettings) -> Vec<Finding> {
    let all = pnet_datalink::interfaces();
    let described: Vec<String> = all
        .iter()
        .filter(|interface| !interface.ips.is_empty())
        .map(describe)
        .collect();
    let mut findings = vec![if described.is_empty() {
        Finding::problem(
            "interfaces",
            "none has an address",
            "no other machine can be reached",
            "bring the network up",
        )
    } else {
        Finding::ok("interfaces", described.join("; "))
    }];
    for wanted in configured(network) {
        findings.push(chosen(wanted, &all));
    }
    findings
}

/// The configured names or addresses of interfaces; none for `auto`.
fn configured(network: &NetworkSettings) -> Vec<&str> {
    let names = network.interface.split(',').map(str::trim);
    names
        .filter(|name| network.multicast && network.zenoh_config.is_none() && *name != "auto")
        .collect()
}

fn describe(interface: &NetworkInterface) -> String {
    let addresses: Vec<String> = interface.ips.iter().map(|ip| ip.ip().to_string()).collect();
    let down = if interface.is_up() { "" } else { " (down)" };
    format!("{}{down} {}", interface.name, addresses.join(" "))
}

fn is(interface: &NetworkInterface, wanted: &str) -> bool {
    let address = wanted.parse::<IpAddr>();
    interface.name == wanted
        || address.is_ok_and(|address| interface.ips.iter().any(|ip| ip.ip() == address))
}

fn chosen(wanted: &str, all: &[NetworkInterface]) -> Finding {
    let check = format!("interface {wanted}");
    let names: Vec<&str> = all
        .iter()
        .map(|interface| interface.name.as_str())
        .collect();
    match all.iter().find(|interface| is(interface, wanted)) {
        None => Finding::problem(
            &check,
            "this machine has no such interface",
            "vehicles that are not listed in `connect` are not found by multicast",
            &format!("set [network] interface to one of {}", names.join(", ")),
        ),
        Some(interface) if !interface.is_up() => Finding::problem(
            &check,
            "it is down",
            "nothing is sent or heard on it",
            &format!("bring it up: ip link set {} up", interface.name),
        ),
        Some(interface) if interface.ips.is_empty() => Finding::problem(
            &check,
            "it has no address",
            "nothing is sent or heard on it",
            "give it one, or wait until the network has",
        ),
        Some(interface) => Finding::ok(&check, describe(interface)),
    }
}

/// Whether a packet to the scouting group comes back on each interface that would be used.
pub(super) fn multicast(network: &NetworkSettings) -> Vec<Finding> {
    if !network.multicast {
        return vec![Finding::skipped(
            "multicast",
            "switched off: vehicles are found by `connect` and gossip",
        )];
    }
    let wanted = configured(network);
    let all = pnet_datalink::interfaces();
    let used = all.iter().filter(|interface| {
        if wanted.is_empty() {
            // What Zenoh takes for `auto`.
            interface.is_up() && interface.is_multicast() && !interface.is_loopback()
        } else {
            wanted.iter().any(|wanted| is(interface, wanted))
        }
    });
    let addresses: Vec<(&str, Ipv4Addr)> = used
        .filter_map(|interface| {
            let mut addresses = interface.ips.iter().filter_map(|ip| match ip.ip() {
                IpAddr::V4(address) => Some(address),
                IpAddr::V6(_) => None,
            });
            Some((interface.name.as_str(), addresses.next()?))
        })
        .collect();
    if addresses.is_empty() {
        return vec![Finding::warning(
            "multicast",
            "no interface with an IPv4 address can do it",
            "vehicles that are not listed in `connect` are not found",
            "name an interface in [network] (lo for vehicles on one machine), or list all vehicles in `connect`",
        )];
    }
    let group = group(network);
    addresses
        .into_iter()
        .map(|(name, address)| echo_of(name, address, group))
        .collect()
}

/// The scouting group of a network.
fn group(network: &NetworkSettings) -> Ipv4Addr {
    let text = network
        .zenoh()
        .ok()
        .and_then(|config| config.get_json("scouting/multicast/address").ok());
    let address: Option<SocketAddr> = text.and_then(|text| text.trim_matches('"').parse().ok());
    match address {
        Some(SocketAddr::V4(address)) => *address.ip(),
        _ => *GROUP.ip(),
    }
}

fn echo_of(name: &str, address: Ipv4Addr, group: Ipv4Addr) -> Finding {
    let check = format!("multicast on {name}");
    match is_heard(address, group) {
        Ok(true) => Finding::ok(
            &check,
            format!(
                "a packet to {group} is heard on this machine; whether the network carries it, other vehicles show"
            ),
        ),
        Ok(false) => Finding::warning(
            &check,
            format!("a packet to {group} was sent but not heard"),
            "a firewall or the interface swallows it: vehicles that are not listed in `connect` are not found",
            "allow UDP port 7446 to the group, name another interface, or list all vehicles in `connect`",
        ),
        Err(error) => Finding::warning(
            &check,
            error.to_string(),
            "vehicles that are not listed in `connect` are not found there",
            "add a route for multicast (ip route add 224.0.0.0/4 dev INTERFACE), or list all vehicles in `connect`",
        ),
    }
}

/// Sends from one socket to the group and listens on another. The port is a free one, so that no vehicle hears it.
fn is_heard(address: Ipv4Addr, group: Ipv4Addr) -> std::io::Result<bool> {
    let ear = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    ear.join_multicast_v4(&group, &address)?;
    let port = ear.local_addr()?.port();
    let mouth = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    mouth.set_multicast_if_v4(&address)?;
    mouth.set_multicast_loop_v4(true)?;
    let said = format!("skein doctor {} {port}", std::process::id());
    mouth.send_to(said.as_bytes(), &SocketAddrV4::new(group, port).into())?;
    let deadline = real_now() + HEARD_WITHIN;
    let mut heard = [0; 64];
    loop {
        let left = deadline.saturating_duration_since(real_now());
        if left.is_zero() {
            return Ok(false);
        }
        ear.set_read_timeout(Some(left))?;
        match ear.recv(&mut heard) {
            Ok(length) if heard.get(..length) == Some(said.as_bytes()) => return Ok(true),
            Ok(_) => {}
            Err(error)
                if matches!(
                    error.kind(),
                    std::io::ErrorKind::WouldBlock
                        | std::io::ErrorKind::TimedOut
                        | std::io::ErrorKind::Interrupted
                ) => {}
            Err(error) => return Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    #[test]
    fn a_clock_that_starts_in_1970_is_a_problem() {
        let battery_flat = Stamp::from_nanos(86_400_000_000_000);
        assert_eq!(wall_clock(battery_flat).level, Level::Problem);
        let plausible = Stamp::from_nanos(1_800_000_000_000_000_000);
        let finding = wall_clock(plausible);
        assert!(
            finding.level == Level::Ok && finding.found.contains("in 2027"),
            "{finding:?}"
        );
    }

    #[test]
    fn a_folder_below_a_file_is_a_problem_and_nothing_is_left_in_a_good_one() {
        let root = std::env::temp_dir().join(format!("skein-doctor-test-{}", std::process::id()));
        std::fs::create_dir_all(&root).unwrap();
        std::fs::write(root.join("file"), "").unwrap();
        let level = |path: &str| folder_of("log folder", &root.join(path)).level;
        assert_eq!(level("v1.mcap"), Level::Ok);
        assert_eq!(level("new/deep/v1.mcap"), Level::Ok);
        assert_eq!(level("file/v1.mcap"), Level::Problem);
        assert_eq!(std::fs::read_dir(&root).unwrap().count(), 1);
        std::fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn an_interface_that_is_not_there_is_a_problem_that_names_those_that_are() {
        let network = NetworkSettings {
            interface: "nowhere0".to_owned(),
            ..NetworkSettings::default()
        };
        let findings = interfaces(&network);
        let problem = findings.last().unwrap();
        assert_eq!(problem.level, Level::Problem);
        assert!(
            problem.advice.as_ref().unwrap().contains("lo"),
            "{problem:?}"
        );
    }
}
