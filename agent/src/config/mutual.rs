//! `[mutual]`: how neighbours are located by anonymous bearings.

use super::{Checked, Wrong};
use serde::Deserialize;
use skein_vehicle::{MutualConfig, MutualWay};
use toml::Spanned;

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMutual {
    way: Option<Spanned<String>>,
    bearings_to_cooperative: Option<bool>,
}

impl RawMutual {
    pub(super) fn check(&self) -> Checked<MutualConfig> {
        let way = match &self.way {
            None => MutualConfig::DEFAULT.way,
            Some(word) => match word.get_ref().as_str() {
                "persistent" => MutualWay::Persistent,
                "published" => MutualWay::Published,
                other => {
                    return Err(Wrong::at(
                        word,
                        format!("there is no way {other:?}"),
                        "use \"persistent\" (who is who is held over time) or \"published\" (registration and particle \
                         filters, as in the paper)",
                    ));
                }
            },
        };
        let bearings_to_cooperative = self
            .bearings_to_cooperative
            .unwrap_or(MutualConfig::DEFAULT.bearings_to_cooperative);
        Ok(MutualConfig {
            way,
            bearings_to_cooperative,
        })
    }
}
