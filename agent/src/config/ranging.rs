//! `[ranging]`: how neighbours are located by distances alone, and whether the vehicle takes turns to move.

use super::{Checked, Wrong};
use serde::Deserialize;
use skein_estimation::ranging::Dimension;
use skein_vehicle::RangingConfig;
use toml::Spanned;

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRanging {
    motion: Option<Spanned<String>>,
    schedule: Option<bool>,
}

impl RawRanging {
    pub(super) fn check(&self) -> Checked<RangingConfig> {
        let dimension = match &self.motion {
            None => RangingConfig::DEFAULT.dimension,
            Some(word) => match word.get_ref().as_str() {
                "planar" => Dimension::Planar,
                "spatial" => Dimension::Spatial,
                other => {
                    return Err(Wrong::at(
                        word,
                        format!("there is no motion {other:?}"),
                        "use \"planar\" (all vehicles on one level) or \"spatial\" (they fly, and odometry's z axis \
                         points up)",
                    ));
                }
            },
        };
        Ok(RangingConfig {
            dimension,
            schedule: self.schedule.unwrap_or(RangingConfig::DEFAULT.schedule),
        })
    }
}
