//! How a session reaches the others: the settings, and the Zenoh configuration that they mean.
//!
//! The choices behind it were measured: listing all known vehicles with a short retry heals a broken link in about a
//! second, multicast is the second source, one side of each pair dials (`greater-zid`), and the session id is never set
//! because a restarted process with the same id is locked out until the old lease ends.

use std::path::PathBuf;
use zenoh::Config;

/// Milliseconds without a sign of life after which a neighbour's link counts as broken (Zenoh's own default is 10 s).
const LEASE_MS: u64 = 2_000;
/// First and longest pause between two attempts to connect, in milliseconds.
const RETRY_MS: (u64, u64) = (250, 1_000);
/// How long one attempt to connect may take, milliseconds, from the first packet to the end of Zenoh's handshake. An
/// attempt that falls into a partition never ends by itself, and none is made beside it: with Zenoh's own 10 s a link was
/// found 7.5 s after it was mended. So it is back after this, the longest pause and a round: within three seconds.
const OPEN_WITHIN_MS: u64 = 1_250;
/// Largest message that is put together from fragments, in bytes.
const MESSAGE_BYTES_MAX: usize = 1_048_576;

/// Where to listen and whom to dial.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkSettings {
    /// Endpoints to listen on: Zenoh's (`tcp/10.0.0.1:7447`), or `10.0.0.1:7447` for TCP and, beside it, UDP for what
    /// may be lost. Empty: any free port on all interfaces.
    pub listen: Vec<String>,
    /// Endpoints of the other vehicles, in the same two forms; the vehicle's own may be among them.
    pub connect: Vec<String>,
    /// Whether vehicles are looked for by multicast.
    pub multicast: bool,
    /// The interface for multicast; `auto` takes all that can.
    pub interface: String,
    /// A Zenoh configuration file (JSON5) that is passed through as it is; everything above is then unused.
    pub zenoh_config: Option<PathBuf>,
}

impl Default for NetworkSettings {
    fn default() -> Self {
        Self {
            listen: vec![],
            connect: vec![],
            multicast: true,
            interface: "auto".to_owned(),
            zenoh_config: None,
        }
    }
}

/// A network that Zenoh does not accept.
#[derive(Clone, Debug, thiserror::Error, miette::Diagnostic)]
#[error("Zenoh refuses {what}: {reason}")]
#[diagnostic(help(
    "endpoints look like tcp/192.168.1.7:7447, quic/192.168.1.7:7447?mixed_rel=1 or 192.168.1.7:7447 (TCP and UDP)"
))]
pub struct NetworkError {
    what: String,
    reason: String,
}

impl NetworkSettings {
    /// For several agents on one machine: a free TCP port on the loopback address, no multicast.
    pub fn loopback(connect: Vec<String>) -> Self {
        Self {
            listen: vec!["tcp/127.0.0.1:0".to_owned()],
            connect,
            multicast: false,
            ..Self::default()
        }
    }

    /// The Zenoh configuration. Fails when an endpoint or the file is malformed, and names it.
    pub fn zenoh(&self) -> Result<Config, NetworkError> {
        if let Some(path) = &self.zenoh_config {
            return Config::from_file(path).map_err(|error| NetworkError {
                what: path.display().to_string(),
                reason: error.to_string(),
            });
        }
        let mut config = Config::default();
        let mut set = |key: &str, value: serde_json::Value| {
            config
                .insert_json5(key, &value.to_string())
                .map_err(|error| NetworkError {
                    what: format!("{value} as {key}"),
                    reason: error.to_string(),
                })
        };
        let listen = endpoints(&self.listen);
        // One list may serve the whole fleet: dialling oneself would fail, loudly and for ever.
        let mut connect = endpoints(&self.connect);
        connect.retain(|endpoint| !listen.contains(endpoint));
        // One link of each kind between two vehicles; secured links are single ones.
        let links = if is_secured(listen.iter().chain(&connect)) {
            1
        } else {
            2
        };
        let strategy =
            serde_json::json!({"peer": {"to_router": "always", "to_peer": "greater-zid"}});
        set("mode", "peer".into())?;
        if !listen.is_empty() {
            set("listen/endpoints", listen.into())?;
        }
        set("connect/endpoints", connect.into())?;
        set(
            "connect/retry",
            serde_json::json!({
                "period_init_ms": RETRY_MS.0,
                "period_max_ms": RETRY_MS.1,
                "period_increase_factor": 2,
            }),
        )?;
        set("scouting/multicast/enabled", self.multicast.into())?;
        set(
            "scouting/multicast/interface",
            self.interface.as_str().into(),
        )?;
        set("scouting/multicast/autoconnect_strategy", strategy.clone())?;
        set("scouting/gossip/enabled", true.into())?;
        set("scouting/gossip/autoconnect_strategy", strategy)?;
        set("transport/unicast/max_links", links.into())?;
        set("transport/unicast/open_timeout", OPEN_WITHIN_MS.into())?;
        set("transport/link/tx/lease", LEASE_MS.into())?;
        set(
            "transport/link/rx/max_message_size",
            MESSAGE_BYTES_MAX.into(),
        )?;
        Ok(config)
    }

    /// Whether any link of it is under TLS. Simulated faults are refused there: nobody may switch a real fleet's radio
    /// off by a message.
    pub fn is_secured(&self) -> Result<bool, NetworkError> {
        let config = self.zenoh()?;
        let texts: Vec<String> = [
            "listen/endpoints",
            "connect/endpoints",
            "transport/link/protocols",
            "transport/link/tls/root_ca_certificate",
            "transport/link/tls/listen_certificate",
        ]
        .iter()
        .filter_map(|key| config.get_json(key).ok())
        .collect();
        let [listen, connect, protocols, certificates @ ..] = texts.as_slice() else {
            return Ok(false);
        };
        Ok([listen, connect]
            .iter()
            .any(|text| text.contains("\"tls/") || text.contains("\"quic"))
            || protocols.contains("tls")
            || protocols.contains("quic")
            || certificates.iter().any(|text| text != "null"))
    }
}

impl NetworkSettings {
    /// The endpoints that it listens on, as Zenoh knows them; none: any free port. Fails as [`NetworkSettings::zenoh`].
    pub(crate) fn listening(&self) -> Result<Vec<String>, NetworkError> {
        let text = self.zenoh()?.get_json("listen/endpoints");
        // A list, or with a Zenoh configuration perhaps one list for each mode.
        let lists = text
            .ok()
            .and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok());
        let list = match &lists {
            Some(serde_json::Value::Object(modes)) => modes.get("peer"),
            lists => lists.as_ref(),
        };
        let endpoints = list.and_then(serde_json::Value::as_array);
        Ok(endpoints
            .into_iter()
            .flatten()
            .filter_map(|endpoint| endpoint.as_str().map(str::to_owned))
            .collect())
    }
}

/// Zenoh's endpoints: an address without a protocol stands for TCP and UDP, each for the traffic that it is good at.
fn endpoints(texts: &[String]) -> Vec<String> {
    texts
        .iter()
        .flat_map(|text| {
            if text.contains('/') {
                vec![text.clone()]
            } else {
                vec![format!("tcp/{text}?rel=1"), format!("udp/{text}?rel=0")]
            }
        })
        .collect()
}

fn is_secured<'a>(mut endpoints: impl Iterator<Item = &'a String>) -> bool {
    endpoints.any(|endpoint| endpoint.starts_with("tls/") || endpoint.starts_with("quic"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json(config: &Config, key: &str) -> String {
        config.get_json(key).unwrap()
    }

    #[test]
    fn an_address_without_a_protocol_is_tcp_and_udp() {
        let settings = NetworkSettings {
            listen: vec!["10.0.0.1:7447".to_owned()],
            ..NetworkSettings::default()
        };
        let config = settings.zenoh().unwrap();
        let listen = json(&config, "listen/endpoints");
        assert!(listen.contains("tcp/10.0.0.1:7447?rel=1"), "{listen}");
        assert!(listen.contains("udp/10.0.0.1:7447?rel=0"), "{listen}");
        assert_eq!(json(&config, "transport/unicast/max_links"), "2");
    }

    #[test]
    fn a_vehicle_does_not_dial_itself() {
        let fleet = vec!["10.0.0.1:7447".to_owned(), "10.0.0.2:7447".to_owned()];
        let settings = NetworkSettings {
            listen: vec![fleet[0].clone()],
            connect: fleet,
            ..NetworkSettings::default()
        };
        let connect = json(&settings.zenoh().unwrap(), "connect/endpoints");
        assert!(!connect.contains("10.0.0.1"), "{connect}");
        assert!(connect.contains("10.0.0.2"), "{connect}");
    }

    #[test]
    fn the_measured_defaults_reach_zenoh() {
        let config = NetworkSettings::loopback(vec!["tcp/127.0.0.1:7447".to_owned()])
            .zenoh()
            .unwrap();
        assert_eq!(json(&config, "transport/link/tx/lease"), "2000");
        assert!(json(&config, "connect/retry").contains("250"));
        assert_eq!(json(&config, "transport/unicast/open_timeout"), "1250");
        assert!(json(&config, "scouting/gossip/autoconnect_strategy").contains("greater-zid"));
        assert_eq!(json(&config, "scouting/multicast/enabled"), "false");
    }

    #[test]
    fn a_malformed_endpoint_is_refused_by_name() {
        let error = NetworkSettings::loopback(vec!["tcp/".to_owned()])
            .zenoh()
            .unwrap_err();
        assert!(error.to_string().contains("tcp/"), "{error}");
    }

    #[test]
    fn tls_and_quic_count_as_secured() {
        let with = |endpoint: &str| {
            NetworkSettings::loopback(vec![endpoint.to_owned()])
                .is_secured()
                .unwrap()
        };
        assert!(!with("tcp/127.0.0.1:7447"));
        assert!(with("tls/127.0.0.1:7447"));
        assert!(with("quic/127.0.0.1:7447?mixed_rel=1"));
    }
}
