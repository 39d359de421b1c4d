//! `[radio]` of a scenario: what every link does to packets, what single links do, and who is cut off when.

use crate::bounded::{finite, positive, probability};
use serde::de::{Deserializer, Error};
use serde::{Deserialize, Serialize};
use skein_proto::faults::{
    Barrier, Burst, DELAY_MAX_S, Duplicate, Faults, Impairments, LinkOverride, RateLimit, Reorder,
    check_groups, check_links, separates,
};
use skein_proto::name::Name;

pub use skein_proto::faults::LINKS_MAX;

/// Most silences of a scenario.
pub const SILENCES_MAX: usize = 1_000;
/// Most partitions of a scenario.
pub const PARTITIONS_MAX: usize = 1_000;
/// Most vehicles that one silence lists.
pub const VEHICLES_LISTED_MAX: usize = 1_000;

/// A time during which packets do not get through.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Silence {
    /// When it begins, seconds since the start of the motion.
    #[serde(deserialize_with = "finite")]
    pub from_s: f64,
    /// When it is over, seconds.
    #[serde(deserialize_with = "finite")]
    pub to_s: f64,
    /// Which vehicles are cut off, by their index; everyone when empty.
    #[serde(default)]
    pub vehicles: Vec<usize>,
}

impl Silence {
    fn silences(&self, now_s: f64, from: usize, to: usize) -> bool {
        let everyone = self.vehicles.is_empty();
        let concerned = everyone || self.vehicles.contains(&from) || self.vehicles.contains(&to);
        concerned && (self.from_s..self.to_s).contains(&now_s)
    }
}

/// A time during which a fleet is split into groups that do not hear one another. Afterwards it is whole again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Partition {
    /// When it begins, seconds since the start of the motion.
    #[serde(deserialize_with = "finite")]
    pub from_s: f64,
    /// When it heals, seconds.
    #[serde(deserialize_with = "finite")]
    pub to_s: f64,
    /// The groups, of vehicles by their index. Whoever is in no group hears everybody and is heard by everybody.
    pub groups: Vec<Vec<usize>>,
}

impl Partition {
    fn holds(&self, now_s: f64) -> bool {
        (self.from_s..self.to_s).contains(&now_s)
    }
}

/// The radio's rules; by default perfect.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RadioSettings {
    /// How far it reaches, metres; everywhere when not given.
    #[serde(deserialize_with = "reach", skip_serializing_if = "Option::is_none")]
    pub range_m: Option<f64>,
    /// The probability that a packet in range is lost, independently of every other.
    #[serde(deserialize_with = "probability")]
    pub loss: f64,
    /// How long a packet takes, seconds.
    #[serde(deserialize_with = "delay")]
    pub delay_s: f64,
    /// It takes up to this much less or more, uniformly, seconds.
    #[serde(deserialize_with = "delay")]
    pub jitter_s: f64,
    /// Losses that come together.
    #[serde(deserialize_with = "burst", skip_serializing_if = "Option::is_none")]
    pub burst: Option<Burst>,
    /// Packets held back, so that later ones overtake them.
    #[serde(deserialize_with = "reorder", skip_serializing_if = "Option::is_none")]
    pub reorder: Option<Reorder>,
    /// Packets that come twice.
    #[serde(
        deserialize_with = "duplicate",
        skip_serializing_if = "Option::is_none"
    )]
    pub duplicate: Option<Duplicate>,
    /// How many bytes fit through each directed link.
    #[serde(
        deserialize_with = "rate_limit",
        skip_serializing_if = "Option::is_none"
    )]
    pub rate_limit: Option<RateLimit>,
    /// Directed links with settings of their own, vehicles by their index.
    #[serde(deserialize_with = "links", skip_serializing_if = "Vec::is_empty")]
    pub links: Vec<LinkOverride<usize>>,
    /// When nothing gets through.
    pub silences: Vec<Silence>,
    /// When the fleet is split.
    #[serde(deserialize_with = "partitions", skip_serializing_if = "Vec::is_empty")]
    pub partitions: Vec<Partition>,
}

impl RadioSettings {
    /// What every link does that has no settings of its own.
    #[must_use]
    pub const fn impairments(&self) -> Impairments {
        Impairments {
            loss: self.loss,
            delay_s: self.delay_s,
            jitter_s: self.jitter_s,
            burst: self.burst,
            reorder: self.reorder,
            duplicate: self.duplicate,
            rate_limit: self.rate_limit,
        }
    }

    /// What the link between two vehicles does, and whether it is silent for good.
    pub(super) fn link(&self, from: usize, to: usize) -> (Impairments, bool) {
        let own = self
            .links
            .iter()
            .find(|link| (link.from, link.to) == (from, to));
        let everyones = self.impairments();
        own.map_or((everyones, false), |link| {
            (everyones.with(link), link.silent)
        })
    }

    /// What keeps all packets between two vehicles `distance_m` apart at a time, in seconds since the start of the
    /// motion; `silent` when the link is silent for good.
    pub(super) fn barrier(
        &self,
        now_s: f64,
        from: usize,
        to: usize,
        distance_m: f64,
        silent: bool,
    ) -> Option<Barrier> {
        if self.range_m.is_some_and(|range_m| distance_m >= range_m) {
            Some(Barrier::OutOfRange)
        } else if silent || self.is_silenced(now_s, from, to) {
            Some(Barrier::Silenced)
        } else if self.is_partitioned(now_s, from, to) {
            Some(Barrier::Partitioned)
        } else {
            None
        }
    }

    /// Whether one of two vehicles is silenced at a time, in seconds since the start of the motion.
    #[must_use]
    pub fn is_silenced(&self, now_s: f64, from: usize, to: usize) -> bool {
        self.silences
            .iter()
            .any(|silence| silence.silences(now_s, from, to))
    }

    fn is_partitioned(&self, now_s: f64, from: usize, to: usize) -> bool {
        self.partitions
            .iter()
            .any(|partition| partition.holds(now_s) && separates(&partition.groups, &from, &to))
    }

    /// What live agents are told of the radio at a time, in seconds since the start of the motion: `names` are the
    /// vehicles, `distance_m` tells how far two of them are apart.
    #[must_use]
    pub fn faults(
        &self,
        now_s: f64,
        names: &[Name],
        distance_m: impl Fn(usize, usize) -> f64,
    ) -> Faults {
        let pairs = || (0..names.len()).flat_map(|a| (a + 1..names.len()).map(move |b| (a, b)));
        let named = |(a, b): (usize, usize)| (names[a], names[b]);
        let is_far = |&(a, b): &(usize, usize)| {
            self.range_m
                .is_some_and(|range_m| distance_m(a, b) >= range_m)
        };
        let links = self.links.iter().filter_map(|link| {
            Some(LinkOverride {
                from: *names.get(link.from)?,
                to: *names.get(link.to)?,
                loss: link.loss,
                delay_s: link.delay_s,
                jitter_s: link.jitter_s,
                silent: link.silent,
            })
        });
        let groups = |partition: &Partition| -> Vec<Vec<Name>> {
            let group = |group: &Vec<usize>| {
                let known = group.iter().filter_map(|vehicle| names.get(*vehicle));
                known.copied().collect()
            };
            partition.groups.iter().map(group).collect()
        };
        let Impairments {
            loss,
            delay_s,
            jitter_s,
            burst,
            reorder,
            duplicate,
            rate_limit,
        } = self.impairments();
        Faults {
            loss,
            delay_s,
            jitter_s,
            burst,
            reorder,
            duplicate,
            rate_limit,
            links: links.collect(),
            // A pair out of range says no more by being silenced too, and the lists stay short.
            silent: pairs()
                .filter(|pair| !is_far(pair) && self.is_silenced(now_s, pair.0, pair.1))
                .map(named)
                .collect(),
            out_of_range: pairs().filter(is_far).map(named).collect(),
            partitions: self
                .partitions
                .iter()
                .filter(|partition| partition.holds(now_s))
                .map(groups)
                .collect(),
        }
    }

    /// When a silence or a partition begins or ends, seconds since the start of the motion.
    pub fn turns_s(&self) -> impl Iterator<Item = f64> + '_ {
        let silences = self
            .silences
            .iter()
            .map(|silence| (silence.from_s, silence.to_s));
        let partitions = self
            .partitions
            .iter()
            .map(|partition| (partition.from_s, partition.to_s));
        silences
            .chain(partitions)
            .flat_map(|(from_s, to_s)| [from_s, to_s])
    }

    /// The laws that join the radio with a fleet of `n_vehicles`; the key to blame comes first. The numbers themselves
    /// were checked when they were read.
    pub(crate) fn check(&self, n_vehicles: usize) -> Result<(), (&'static str, String)> {
        let known = |key, vehicle: usize| {
            if vehicle < n_vehicles {
                Ok(())
            } else {
                Err((
                    key,
                    format!("there is no vehicle {vehicle} (they count from 0)"),
                ))
            }
        };
        for link in &self.links {
            known("links", link.from)?;
            known("links", link.to)?;
        }
        at_most("silences", self.silences.len(), SILENCES_MAX)?;
        for silence in &self.silences {
            if silence.to_s <= silence.from_s {
                return Err((
                    "silences",
                    format!("a silence ends at {} s, before it begins", silence.to_s),
                ));
            }
            at_most("silences", silence.vehicles.len(), VEHICLES_LISTED_MAX)?;
            silence
                .vehicles
                .iter()
                .try_for_each(|vehicle| known("silences", *vehicle))?;
        }
        self.partitions
            .iter()
            .flat_map(|partition| partition.groups.iter().flatten())
            .try_for_each(|vehicle| known("partitions", *vehicle))
    }
}

fn at_most(key: &'static str, count: usize, max: usize) -> Result<(), (&'static str, String)> {
    if count > max {
        return Err((key, format!("{count} entries are more than {max}")));
    }
    Ok(())
}

fn check_partitions(partitions: &[Partition]) -> Result<(), String> {
    at_most("partitions", partitions.len(), PARTITIONS_MAX).map_err(|(_, message)| message)?;
    for partition in partitions {
        if partition.to_s <= partition.from_s {
            return Err(format!(
                "a partition heals at {} s, before it begins",
                partition.to_s
            ));
        }
        if partition.groups.len() < 2 {
            return Err("a partition has two groups or more".into());
        }
        check_groups(&partition.groups).map_err(|error| error.to_string())?;
    }
    Ok(())
}

fn reach<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    positive(deserializer).map(Some)
}

fn delay<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    lawful(deserializer, |delay_s| {
        if (0.0..=DELAY_MAX_S).contains(delay_s) {
            Ok(())
        } else {
            Err(format!(
                "{delay_s} is not a delay from 0 to {DELAY_MAX_S} s"
            ))
        }
    })
}

fn burst<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Burst>, D::Error> {
    lawful(deserializer, Burst::check).map(Some)
}

fn reorder<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Reorder>, D::Error> {
    lawful(deserializer, Reorder::check).map(Some)
}

fn duplicate<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Duplicate>, D::Error> {
    lawful(deserializer, Duplicate::check).map(Some)
}

fn rate_limit<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<RateLimit>, D::Error> {
    lawful(deserializer, RateLimit::check).map(Some)
}

fn links<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<LinkOverride<usize>>, D::Error> {
    lawful(deserializer, |links: &Vec<_>| check_links(links))
}

fn partitions<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Partition>, D::Error> {
    lawful(deserializer, |partitions: &Vec<_>| {
        check_partitions(partitions)
    })
}

/// A value that is checked while it is read, so that the error still knows its place in the file.
fn lawful<'de, D: Deserializer<'de>, T: Deserialize<'de>, E: std::fmt::Display>(
    deserializer: D,
    check: impl Fn(&T) -> Result<(), E>,
) -> Result<T, D::Error> {
    let value = T::deserialize(deserializer)?;
    check(&value).map_err(D::Error::custom)?;
    Ok(value)
}
