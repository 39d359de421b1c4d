//! `[network]`: where the vehicle listens, and whom it connects to.

use super::{Checked, Wrong};
use crate::network::NetworkSettings;
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawNetwork {
    listen: Option<Vec<Spanned<String>>>,
    connect: Option<Vec<Spanned<String>>>,
    multicast: Option<bool>,
    interface: Option<String>,
    zenoh_config: Option<Spanned<PathBuf>>,
}

impl RawNetwork {
    pub(super) fn check(self, folder: &Path, at: &Range<usize>) -> Checked<NetworkSettings> {
        let others = self.listen.is_some()
            || self.connect.is_some()
            || self.multicast.is_some()
            || self.interface.is_some();
        if let Some(file) = self.zenoh_config.as_ref().filter(|_| others) {
            return Err(Wrong::at(
                file,
                "[network] has zenoh_config and other keys",
                "a Zenoh configuration file is passed through as it is: put the endpoints there, or leave it out",
            ));
        }
        for endpoint in self.listen.iter().chain(&self.connect).flatten() {
            let alone = NetworkSettings::loopback(vec![endpoint.get_ref().clone()]);
            let refused = match alone.zenoh() {
                Err(error) => error.to_string(),
                Ok(_) if !has_port(endpoint.get_ref()) => {
                    format!("{:?} has no port", endpoint.get_ref())
                }
                Ok(_) => continue,
            };
            return Err(Wrong::at(
                endpoint,
                refused,
                "endpoints look like tcp/192.168.1.7:7447, or 192.168.1.7:7447 for TCP and UDP",
            ));
        }
        let texts = |endpoints: Option<Vec<Spanned<String>>>| {
            let endpoints = endpoints.unwrap_or_default().into_iter();
            endpoints.map(Spanned::into_inner).collect()
        };
        let file_at = self.zenoh_config.as_ref().map(Spanned::span);
        let defaults = NetworkSettings::default();
        let settings = NetworkSettings {
            listen: texts(self.listen),
            connect: texts(self.connect),
            multicast: self.multicast.unwrap_or(defaults.multicast),
            interface: self.interface.unwrap_or(defaults.interface),
            zenoh_config: self.zenoh_config.map(|path| folder.join(path.into_inner())),
        };
        settings.zenoh().map_err(|error| Wrong {
            message: error.to_string(),
            help: Some(match &file_at {
                Some(_) => "zenoh_config names a file of Zenoh's own (JSON5), meant from the folder of this configuration".into(),
                None => "listen and connect hold endpoints like tcp/192.168.1.7:7447; interface is a name like \"wlan0\"".into(),
            }),
            at: Some(file_at.unwrap_or_else(|| at.clone())),
        })?;
        Ok(settings)
    }
}

/// Whether an endpoint ends with a port. Zenoh takes one without, and then never connects.
fn has_port(endpoint: &str) -> bool {
    let address = endpoint.split(['?', '#']).next().unwrap_or_default();
    let port = address.rsplit_once(':').map(|(_, port)| port);
    port.is_some_and(|port| port.parse::<u16>().is_ok())
}
