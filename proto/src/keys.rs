//! Every key of the contract: built and parsed here and nowhere else.
//!
//! All keys are `{fleet}/@v1/...`. `@v1` is a verbatim chunk: no wildcard matches it, so versions never mix. The other
//! chunks that open with `@` are verbatim too and must be named in every selector and access rule.

use crate::name::{Name, NameError};
use std::fmt;

/// The version chunk.
pub const VERSION_CHUNK: &str = "@v1";

/// A key inside one fleet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Key {
    /// `{vehicle}/x/exchange/{to}`: the 12-number exchange, addressed to one neighbour.
    Exchange {
        /// Sender.
        from: Name,
        /// Addressee.
        to: Name,
    },
    /// `{vehicle}/x/odometry`: the round record.
    Odometry {
        /// Sender.
        from: Name,
    },
    /// `{vehicle}/x/backlog`: its last rounds, queryable.
    Backlog {
        /// Whose.
        of: Name,
    },
    /// `{vehicle}/x/relay`: rounds of others, repeated.
    Relay {
        /// Who repeats them.
        from: Name,
    },
    /// `{vehicle}/x/features`: the anonymous feature set.
    Features {
        /// Sender.
        from: Name,
    },
    /// `{vehicle}/state/estimate`: the newest estimate, published and queryable.
    Estimate {
        /// Whose.
        of: Name,
    },
    /// `{vehicle}/state/health`: counters and reasons, published and queryable.
    Health {
        /// Whose.
        of: Name,
    },
    /// `{vehicle}/info`: versions, capabilities, limits, queryable.
    Info {
        /// Whose.
        of: Name,
    },
    /// `{vehicle}/@rpc/{verb}`: a query with an effect.
    Rpc {
        /// On whom.
        on: Name,
        /// What to do.
        verb: Name,
    },
    /// `{vehicle}/@driver/{sensor}`: frames from an external driver.
    Driver {
        /// To whom.
        of: Name,
        /// From which of its sensors.
        sensor: Name,
    },
    /// `{vehicle}/@alive/{boot}`: liveliness token; the boot id is 16 hexadecimal digits.
    Alive {
        /// Who is present.
        of: Name,
        /// Which boot of it.
        boot: u64,
    },
    /// `@sim/{channel}`: simworld's truth, clock and faults.
    Sim {
        /// Which.
        channel: SimChannel,
    },
}

/// What simworld publishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SimChannel {
    /// True poses.
    Truth,
    /// Simulated time.
    Clock,
    /// Radio faults: [`crate::faults::Faults`].
    Faults,
}

/// Why a text is no key of the contract.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum KeyError {
    /// The second chunk is not `@v1`.
    #[error("not a key of version 1: the second chunk must be {VERSION_CHUNK}")]
    Version,
    /// A fleet, vehicle, sensor or verb that is no name.
    #[error("in a key: {0}")]
    Name(#[from] NameError),
    /// A boot id that is not 16 lower-case hexadecimal digits.
    #[error("a boot id has 16 lower-case hexadecimal digits")]
    Boot,
    /// Chunks that the contract does not have.
    #[error("no such key in the contract")]
    Unknown,
}

impl Key {
    /// The whole key expression inside a fleet.
    pub fn in_fleet(&self, fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/{self}")
    }

    /// Parses a whole key expression into its fleet and key.
    pub fn parse(text: &str) -> Result<(Name, Self), KeyError> {
        let chunks: Vec<&str> = text.splitn(8, '/').collect();
        let [fleet, version, rest @ ..] = chunks.as_slice() else {
            return Err(KeyError::Unknown);
        };
        if *version != VERSION_CHUNK {
            return Err(KeyError::Version);
        }
        let key = match rest {
            ["@sim", channel] => Self::Sim {
                channel: SimChannel::parse(channel)?,
            },
            [from, "x", "exchange", to] => Self::Exchange {
                from: Name::parse(from)?,
                to: Name::parse(to)?,
            },
            [from, "x", "odometry"] => Self::Odometry {
                from: Name::parse(from)?,
            },
            [of, "x", "backlog"] => Self::Backlog {
                of: Name::parse(of)?,
            },
            [from, "x", "relay"] => Self::Relay {
                from: Name::parse(from)?,
            },
            [from, "x", "features"] => Self::Features {
                from: Name::parse(from)?,
            },
            [of, "state", "estimate"] => Self::Estimate {
                of: Name::parse(of)?,
            },
            [of, "state", "health"] => Self::Health {
                of: Name::parse(of)?,
            },
            [of, "info"] => Self::Info {
                of: Name::parse(of)?,
            },
            [on, "@rpc", verb] => Self::Rpc {
                on: Name::parse(on)?,
                verb: Name::parse(verb)?,
            },
            [of, "@driver", sensor] => Self::Driver {
                of: Name::parse(of)?,
                sensor: Name::parse(sensor)?,
            },
            [of, "@alive", boot] => Self::Alive {
                of: Name::parse(of)?,
                boot: parse_boot(boot)?,
            },
            _ => return Err(KeyError::Unknown),
        };
        Ok((Name::parse(fleet)?, key))
    }
}

/// A boot id as it stands in keys and documents.
pub fn boot_text(boot: u64) -> String {
    format!("{boot:016x}")
}

pub(crate) fn parse_boot(text: &str) -> Result<u64, KeyError> {
    let digits = text.len() == 16 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    if digits {
        u64::from_str_radix(text, 16).map_err(|_| KeyError::Boot)
    } else {
        Err(KeyError::Boot)
    }
}

impl SimChannel {
    fn chunk(self) -> &'static str {
        match self {
            Self::Truth => "truth",
            Self::Clock => "clock",
            Self::Faults => "faults",
        }
    }

    fn parse(chunk: &str) -> Result<Self, KeyError> {
        [Self::Truth, Self::Clock, Self::Faults]
            .into_iter()
            .find(|c| c.chunk() == chunk)
            .ok_or(KeyError::Unknown)
    }
}

impl fmt::Display for Key {
    /// The key without its fleet and version.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exchange { from, to } => write!(f, "{from}/x/exchange/{to}"),
            Self::Odometry { from } => write!(f, "{from}/x/odometry"),
            Self::Backlog { of } => write!(f, "{of}/x/backlog"),
            Self::Relay { from } => write!(f, "{from}/x/relay"),
            Self::Features { from } => write!(f, "{from}/x/features"),
            Self::Estimate { of } => write!(f, "{of}/state/estimate"),
            Self::Health { of } => write!(f, "{of}/state/health"),
            Self::Info { of } => write!(f, "{of}/info"),
            Self::Rpc { on, verb } => write!(f, "{on}/@rpc/{verb}"),
            Self::Driver { of, sensor } => write!(f, "{of}/@driver/{sensor}"),
            Self::Alive { of, boot } => write!(f, "{of}/@alive/{}", boot_text(*boot)),
            Self::Sim { channel } => write!(f, "@sim/{}", channel.chunk()),
        }
    }
}

/// Selectors: key expressions that match many keys.
pub mod select {
    use super::VERSION_CHUNK;
    use crate::name::Name;

    /// Exchanges addressed to one vehicle, from anybody.
    pub fn exchanges_to(fleet: Name, to: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/x/exchange/{to}")
    }
    /// Round records of everybody.
    pub fn odometry(fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/x/odometry")
    }
    /// Anonymous feature sets of everybody.
    pub fn features(fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/x/features")
    }
    /// What anybody relays.
    pub fn relays(fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/x/relay")
    }
    /// Estimates of everybody.
    pub fn estimates(fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/state/estimate")
    }
    /// Healths of everybody.
    pub fn healths(fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/state/health")
    }
    /// Queries with an effect on one vehicle.
    pub fn rpc_on(fleet: Name, on: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/{on}/@rpc/*")
    }
    /// Infos of everybody.
    pub fn infos(fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/info")
    }
    /// Liveliness tokens of everybody.
    pub fn alive(fleet: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/*/@alive/*")
    }
    /// Liveliness tokens of one vehicle.
    pub fn boots(fleet: Name, of: Name) -> String {
        format!("{fleet}/{VERSION_CHUNK}/{of}/@alive/*")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    /// One of each, so that a new key cannot be forgotten in the snapshot.
    fn one_of_each() -> Vec<Key> {
        let (v1, v2) = (name("v1"), name("v2"));
        vec![
            Key::Exchange { from: v1, to: v2 },
            Key::Odometry { from: v1 },
            Key::Backlog { of: v1 },
            Key::Relay { from: v1 },
            Key::Features { from: v1 },
            Key::Estimate { of: v1 },
            Key::Health { of: v1 },
            Key::Info { of: v1 },
            Key::Rpc {
                on: v1,
                verb: name("set_pose"),
            },
            Key::Driver {
                of: v1,
                sensor: name("tags"),
            },
            Key::Alive { of: v1, boot: 0xab },
            Key::Sim {
                channel: SimChannel::Truth,
            },
            Key::Sim {
                channel: SimChannel::Clock,
            },
            Key::Sim {
                channel: SimChannel::Faults,
            },
        ]
    }

    #[test]
    fn the_keys_are_those_of_the_contract() {
        let keys: Vec<String> = one_of_each()
            .iter()
            .map(|key| key.in_fleet(name("geese")))
            .collect();
        assert_eq!(
            keys,
            [
                "geese/@v1/v1/x/exchange/v2",
                "geese/@v1/v1/x/odometry",
                "geese/@v1/v1/x/backlog",
                "geese/@v1/v1/x/relay",
                "geese/@v1/v1/x/features",
                "geese/@v1/v1/state/estimate",
                "geese/@v1/v1/state/health",
                "geese/@v1/v1/info",
                "geese/@v1/v1/@rpc/set_pose",
                "geese/@v1/v1/@driver/tags",
                "geese/@v1/v1/@alive/00000000000000ab",
                "geese/@v1/@sim/truth",
                "geese/@v1/@sim/clock",
                "geese/@v1/@sim/faults",
            ]
        );
    }

    #[test]
    fn what_is_built_is_parsed() {
        for key in one_of_each() {
            assert_eq!(
                Key::parse(&key.in_fleet(name("geese"))),
                Ok((name("geese"), key))
            );
        }
    }

    #[test]
    fn strangers_keys_are_refused_with_a_reason() {
        assert_eq!(Key::parse("geese/@v2/v1/info"), Err(KeyError::Version));
        assert_eq!(Key::parse("geese/@v1/v1/x/other"), Err(KeyError::Unknown));
        assert_eq!(Key::parse("geese/@v1/v1/@alive/AB"), Err(KeyError::Boot));
        assert_eq!(Key::parse("geese"), Err(KeyError::Unknown));
        assert!(matches!(
            Key::parse("geese/@v1/V1/info"),
            Err(KeyError::Name(_))
        ));
    }

    proptest! {
        #[test]
        fn parsing_never_panics_and_what_it_accepts_is_canonical(text in "[a-z@/_0-9*]{0,60}") {
            if let Ok((fleet, key)) = Key::parse(&text) {
                prop_assert_eq!(key.in_fleet(fleet), text);
            }
        }
    }
}
