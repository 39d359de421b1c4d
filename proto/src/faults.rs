//! Radio faults as simworld dictates them: what every link does to packets, and who cannot hear whom for now.
//!
//! [`impairments`] are the numbers and their ranges, [`link`] the one rule that obeys them, live and virtual. This file
//! is the JSON of `@sim/faults` that brings them to live agents.

pub mod impairments;
pub mod link;

pub use impairments::{
    Burst, DELAY_MAX_S, Duplicate, Impairments, LinkOverride, RateLimit, Reorder,
};
pub use link::{Barrier, Draws, Link, LinkCount, LinkRule, Reason, Verdict};

use crate::name::Name;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Longest list of pairs: every pair of 64 vehicles fits.
pub const PAIRS_MAX: usize = 2_048;
/// Most links with settings of their own.
pub const LINKS_MAX: usize = 512;
/// Most partitions at one time.
pub const PARTITIONS_MAX: usize = 16;
/// Most vehicles that one partition names, in all its groups together.
pub const PARTITION_VEHICLES_MAX: usize = 1_000;

/// JSON of `@sim/faults`: what the simulated radio does from now on to every packet between vehicles. Whatever is left
/// out is not the case.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Faults {
    /// Probability that a packet is lost, drawn for each receiver.
    pub loss: f64,
    /// Seconds by which every packet is late.
    pub delay_s: f64,
    /// Seconds by which it is up to so much earlier or later than that, uniformly.
    #[serde(skip_serializing_if = "is_nothing")]
    pub jitter_s: f64,
    /// Losses that come together.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub burst: Option<Burst>,
    /// Packets held back, so that later ones overtake them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reorder: Option<Reorder>,
    /// Packets that come twice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duplicate: Option<Duplicate>,
    /// How many bytes fit through each directed link.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_limit: Option<RateLimit>,
    /// Directed links with settings of their own; at most [`LINKS_MAX`].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub links: Vec<LinkOverride<Name>>,
    /// Pairs that are silenced, both ways; at most [`PAIRS_MAX`].
    pub silent: Vec<(Name, Name)>,
    /// Pairs out of each other's range; at most [`PAIRS_MAX`].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub out_of_range: Vec<(Name, Name)>,
    /// Partitions, each of groups that do not hear one another; whoever is in no group hears everybody.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub partitions: Vec<Vec<Vec<Name>>>,
}

/// Why faults were refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FaultsError {
    /// A number outside its range, or none at all.
    #[error("{field} must lie between {least} and {most}, not {value}")]
    OutOfRange {
        /// The member.
        field: &'static str,
        /// What it was.
        value: f64,
        /// The least that is allowed.
        least: f64,
        /// The most that is allowed.
        most: f64,
    },
    /// A list beyond its bound.
    #[error("{field} has {count} entries, and {max} at most are allowed")]
    TooMany {
        /// The list.
        field: &'static str,
        /// Its length.
        count: usize,
        /// The bound.
        max: usize,
    },
    /// Members that contradict each other.
    #[error("{field}: {why}")]
    Contradiction {
        /// The member.
        field: &'static str,
        /// What is wrong with it.
        why: &'static str,
    },
    /// Not JSON of this form.
    #[error("not a faults document: {why}")]
    Malformed {
        /// What the reader found.
        why: String,
    },
}

impl Faults {
    /// Parses and checks the JSON form.
    pub fn parse(bytes: &[u8]) -> Result<Self, FaultsError> {
        let faults: Self =
            serde_json::from_slice(bytes).map_err(|error| FaultsError::Malformed {
                why: error.to_string(),
            })?;
        faults.check()?;
        Ok(faults)
    }

    /// Checks the ranges and bounds.
    pub fn check(&self) -> Result<(), FaultsError> {
        at_most("links", self.links.len(), LINKS_MAX)?;
        at_most("silent", self.silent.len(), PAIRS_MAX)?;
        at_most("out_of_range", self.out_of_range.len(), PAIRS_MAX)?;
        at_most("partitions", self.partitions.len(), PARTITIONS_MAX)?;
        self.impairments().check()?;
        check_links(&self.links)?;
        self.partitions
            .iter()
            .try_for_each(|groups| check_groups(groups))
    }

    /// What every link does that has no settings of its own.
    #[must_use]
    pub fn impairments(&self) -> Impairments {
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

    /// What holds for packets from one vehicle to another.
    #[must_use]
    pub fn rule(&self, from: Name, to: Name) -> LinkRule {
        let own = self
            .links
            .iter()
            .find(|link| (link.from, link.to) == (from, to));
        let among = |pairs: &[(Name, Name)]| {
            pairs
                .iter()
                .any(|&pair| pair == (from, to) || pair == (to, from))
        };
        let barrier = if among(&self.out_of_range) {
            Some(Barrier::OutOfRange)
        } else if among(&self.silent) || own.is_some_and(|link| link.silent) {
            Some(Barrier::Silenced)
        } else if self
            .partitions
            .iter()
            .any(|groups| separates(groups, &from, &to))
        {
            Some(Barrier::Partitioned)
        } else {
            None
        };
        let everyones = self.impairments();
        LinkRule {
            impairments: own.map_or(everyones, |link| everyones.with(link)),
            barrier,
        }
    }
}

/// Whether two vehicles are in different groups.
pub fn separates<V: PartialEq>(groups: &[Vec<V>], a: &V, b: &V) -> bool {
    let group_of = |vehicle| groups.iter().position(|group| group.contains(vehicle));
    matches!((group_of(a), group_of(b)), (Some(a), Some(b)) if a != b)
}

/// Checks settings of links: every number, and that no link has two.
pub fn check_links<V: Ord>(links: &[LinkOverride<V>]) -> Result<(), FaultsError> {
    at_most("links", links.len(), LINKS_MAX)?;
    let mut seen = BTreeSet::new();
    for link in links {
        link.check()?;
        if !seen.insert((&link.from, &link.to)) {
            return Err(FaultsError::Contradiction {
                field: "links",
                why: "a link is listed twice",
            });
        }
    }
    Ok(())
}

/// Checks one partition: not too many vehicles, and none in two groups.
pub fn check_groups<V: Ord>(groups: &[Vec<V>]) -> Result<(), FaultsError> {
    let count = groups.iter().map(Vec::len).sum();
    at_most("partitions", count, PARTITION_VEHICLES_MAX)?;
    // A group of nobody costs nothing to name, so their number has a bound of its own.
    at_most("partitions", groups.len(), PARTITION_VEHICLES_MAX)?;
    let vehicles: BTreeSet<&V> = groups.iter().flatten().collect();
    if vehicles.len() < count {
        return Err(FaultsError::Contradiction {
            field: "partitions",
            why: "a vehicle is in two groups, or twice in one",
        });
    }
    Ok(())
}

/// What is not the case is not written, so that an agent which does not know it yet still understands the rest.
fn is_nothing(seconds: &f64) -> bool {
    seconds.to_bits() == 0
}

fn at_most(field: &'static str, count: usize, max: usize) -> Result<(), FaultsError> {
    if count > max {
        return Err(FaultsError::TooMany { field, count, max });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn refusal(text: &str) -> String {
        Faults::parse(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn a_document_of_the_first_form_still_says_what_it_said() {
        let text = br#"{"loss": 0.3, "delay_s": 0.1, "silent": [["a", "b"]]}"#;
        let faults = Faults::parse(text).unwrap();
        let (a, b, c) = (name("a"), name("b"), name("c"));
        for (from, to) in [(a, b), (b, a)] {
            assert_eq!(faults.rule(from, to).barrier, Some(Barrier::Silenced));
        }
        let rule = faults.rule(a, c);
        assert_eq!(rule.barrier, None);
        assert_eq!(
            (rule.impairments.loss, rule.impairments.delay_s),
            (0.3, 0.1)
        );
        assert_eq!(Faults::parse(b"{}").unwrap(), Faults::default());
        // And whoever only knows that form understands what asks for no more.
        let written = serde_json::to_string(&faults).unwrap();
        assert_eq!(
            written,
            r#"{"loss":0.3,"delay_s":0.1,"silent":[["a","b"]]}"#
        );
    }

    #[test]
    fn a_document_with_everything_survives_being_written_and_read() {
        let text = r#"{
            "loss": 0.1, "delay_s": 0.1, "jitter_s": 0.05,
            "burst": {"share": 0.1, "mean_s": 0.5, "loss": 0.8},
            "reorder": {"probability": 0.05, "delay_s": 0.2},
            "duplicate": {"probability": 0.05, "delay_s": 0.03},
            "rate_limit": {"bytes_per_s": 20000, "bucket_bytes": 4000, "queue_bytes": 8000},
            "links": [{"from": "v1", "to": "v2", "loss": 0.9}, {"from": "v3", "to": "v1", "silent": true}],
            "silent": [["v1", "v4"]],
            "out_of_range": [["v1", "v5"]],
            "partitions": [[["v1", "v2"], ["v3", "v6"]]]
        }"#;
        let faults = Faults::parse(text.as_bytes()).unwrap();
        let again = serde_json::to_vec(&faults).unwrap();
        assert_eq!(Faults::parse(&again).unwrap(), faults);
        let barrier = |from, to| faults.rule(name(from), name(to)).barrier;
        assert_eq!(faults.rule(name("v1"), name("v2")).impairments.loss, 0.9);
        assert_eq!(faults.rule(name("v2"), name("v1")).impairments.loss, 0.1);
        assert_eq!(barrier("v3", "v1"), Some(Barrier::Silenced), "one way only");
        assert_eq!(barrier("v1", "v3"), Some(Barrier::Partitioned));
        assert_eq!(barrier("v5", "v1"), Some(Barrier::OutOfRange));
        assert_eq!(barrier("v1", "v2"), None, "one group");
        assert_eq!(barrier("v7", "v3"), None, "v7 is in no group");
    }

    #[test]
    fn hostile_documents_are_refused_and_told_why() {
        let cases = [
            (r#"{"loss": 1.5}"#, "loss must lie between 0 and 1, not 1.5"),
            (r#"{"delay_s": -1}"#, "delay_s must lie between 0 and 10"),
            (r#"{"jitter_s": 1e300}"#, "jitter_s must lie between"),
            (r#"{"loss": NaN}"#, "not a faults document"),
            (r#"{"loss": 1e999}"#, "number out of range"),
            (r#"{"loss": null}"#, "not a faults document"),
            (r#"{"los": 0.5}"#, "unknown field `los`"),
            (
                r#"{"burst": {"share": 1, "mean_s": 1}}"#,
                "burst.share must lie",
            ),
            (
                r#"{"burst": {"share": 0.1, "mean_s": 0}}"#,
                "burst.mean_s must lie",
            ),
            (
                r#"{"reorder": {"probability": 0.1, "delay_s": 11}}"#,
                "reorder.delay_s must lie",
            ),
            (
                r#"{"duplicate": {"probability": -0.1, "delay_s": 1}}"#,
                "duplicate.probability must lie",
            ),
            (
                r#"{"rate_limit": {"bytes_per_s": 1000, "bucket_bytes": 10}}"#,
                "rate_limit.bucket_bytes must lie",
            ),
            (
                r#"{"rate_limit": {"bytes_per_s": 1, "bucket_bytes": 2000, "queue_bytes": 11}}"#,
                "rate_limit.queue_bytes must lie between 0 and 10",
            ),
            (
                r#"{"links": [{"from": "a", "to": "b", "loss": 2}]}"#,
                "links.loss must lie",
            ),
            (
                r#"{"links": [{"from": "a", "to": "a"}]}"#,
                "not one with itself",
            ),
            (
                r#"{"links": [{"from": "a", "to": "b"}, {"from": "a", "to": "b"}]}"#,
                "listed twice",
            ),
            (r#"{"partitions": [[["a"], ["b", "a"]]]}"#, "in two groups"),
            (r#"{"silent": [["a", "B"]]}"#, "a name is made of"),
            (r#"{"silent": [["a"]]}"#, "not a faults document"),
        ];
        for (text, why) in cases {
            assert!(refusal(text).contains(why), "{text}: {}", refusal(text));
        }
    }

    #[test]
    fn lists_may_be_as_long_as_their_bound_and_not_one_longer() {
        let vehicle = |n: usize| name(&format!("v{n}"));
        let pairs = |n: usize| (0..n).map(|k| (vehicle(k), vehicle(k + 1))).collect();
        let links = |n: usize| {
            let link = |k| LinkOverride {
                from: vehicle(k),
                to: vehicle(k + 1),
                loss: None,
                delay_s: None,
                jitter_s: None,
                silent: true,
            };
            (0..n).map(link).collect()
        };
        let group = |n: usize| vec![(0..n).map(vehicle).collect::<Vec<Name>>()];
        type Make<'a> = Box<dyn Fn(usize) -> Faults + 'a>;
        let cases: [(&str, usize, Make<'_>); 6] = [
            (
                "silent",
                PAIRS_MAX,
                Box::new(|n| Faults {
                    silent: pairs(n),
                    ..Faults::default()
                }),
            ),
            (
                "out_of_range",
                PAIRS_MAX,
                Box::new(|n| Faults {
                    out_of_range: pairs(n),
                    ..Faults::default()
                }),
            ),
            (
                "links",
                LINKS_MAX,
                Box::new(|n| Faults {
                    links: links(n),
                    ..Faults::default()
                }),
            ),
            (
                "partitions",
                PARTITIONS_MAX,
                Box::new(|n| Faults {
                    partitions: vec![group(2); n],
                    ..Faults::default()
                }),
            ),
            (
                "partitions",
                PARTITION_VEHICLES_MAX,
                Box::new(|n| Faults {
                    partitions: vec![group(n)],
                    ..Faults::default()
                }),
            ),
            (
                "partitions",
                PARTITION_VEHICLES_MAX,
                Box::new(|n| Faults {
                    partitions: vec![vec![vec![]; n]],
                    ..Faults::default()
                }),
            ),
        ];
        for (field, max, make) in cases {
            assert_eq!(make(max).check(), Ok(()), "{field}");
            let count = max + 1;
            let refused = Err(FaultsError::TooMany { field, count, max });
            assert_eq!(make(count).check(), refused);
        }
    }
}
