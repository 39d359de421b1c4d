//! Whether the endpoints on which a vehicle listens are free, taken by itself, or taken by somebody else.

use super::finding::Finding;
use crate::settings::Settings;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs, UdpSocket};

/// Looks at each endpoint; `runs` when the vehicle of this configuration is seen in the fleet.
pub(super) fn listening(settings: &Settings, runs: bool) -> Vec<Finding> {
    let vehicle = settings.vehicle.vehicle;
    match settings.network.listening() {
        Ok(endpoints) if endpoints.is_empty() => {
            vec![Finding::ok("listens on", "any free port")]
        }
        Ok(endpoints) => endpoints
            .iter()
            .map(|endpoint| judge(endpoint, try_to_listen(endpoint), vehicle.as_str(), runs))
            .collect(),
        Err(error) => vec![Finding::problem(
            "listens on",
            error.to_string(),
            "the vehicle cannot be reached",
            "mend [network] listen",
        )],
    }
}

fn judge(endpoint: &str, tried: Option<std::io::Result<()>>, vehicle: &str, runs: bool) -> Finding {
    let check = format!("listens on {endpoint}");
    match tried {
        None => Finding::skipped(
            &check,
            "only Zenoh can tell whether this can be listened on",
        ),
        Some(Ok(())) => Finding::ok(&check, "free"),
        Some(Err(error)) if error.kind() == ErrorKind::AddrInUse && runs => {
            Finding::ok(&check, format!("taken, and {vehicle} runs"))
        }
        Some(Err(error)) if error.kind() == ErrorKind::AddrInUse => Finding::problem(
            &check,
            "taken, and this vehicle is not seen",
            "another program has the port, or the vehicle runs and cannot be reached",
            "see who has it with `ss -lntup`, stop it or configure another port",
        ),
        Some(Err(error)) if error.kind() == ErrorKind::AddrNotAvailable => Finding::problem(
            &check,
            "this machine does not have that address",
            "the vehicle cannot listen there, and its session does not open",
            "give an address of this machine (see interfaces above), or 0.0.0.0 for all of them",
        ),
        Some(Err(error)) => Finding::problem(
            &check,
            error.to_string(),
            "the vehicle cannot listen there, and its session does not open",
            "mend [network] listen; ports below 1024 need a privilege",
        ),
    }
}

/// Listens for a moment; none for a protocol that is not tried.
fn try_to_listen(endpoint: &str) -> Option<std::io::Result<()>> {
    let (protocol, rest) = endpoint.split_once('/')?;
    let address = rest.split(['?', '#']).next().unwrap_or_default();
    if !["tcp", "tls", "udp", "quic"].contains(&protocol) {
        return None;
    }
    let listened = address.to_socket_addrs().and_then(|addresses| {
        let addresses: Vec<SocketAddr> = addresses.collect();
        if matches!(protocol, "tcp" | "tls") {
            TcpListener::bind(addresses.as_slice()).map(drop)
        } else {
            UdpSocket::bind(addresses.as_slice()).map(drop)
        }
    });
    Some(listened)
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    fn level(endpoint: &str, runs: bool) -> Level {
        judge(endpoint, try_to_listen(endpoint), "v1", runs).level
    }

    #[test]
    fn a_port_is_free_or_taken_by_the_vehicle_or_by_a_stranger() {
        assert_eq!(level("tcp/127.0.0.1:0", false), Level::Ok);
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("tcp/{}?rel=1", taken.local_addr().unwrap());
        assert_eq!(level(&endpoint, true), Level::Ok);
        assert_eq!(level(&endpoint, false), Level::Problem);
        let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("udp/{}?rel=0", taken.local_addr().unwrap());
        assert_eq!(level(&endpoint, false), Level::Problem);
    }

    #[test]
    fn an_address_of_another_machine_is_a_problem() {
        assert_eq!(level("tcp/198.51.100.77:7447", true), Level::Problem);
        assert_eq!(level("unixsock-stream/x", true), Level::Skipped);
    }
}
