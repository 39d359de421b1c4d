//! The radio of a flight: which packet arrives, when, and whether twice. Only rules; whoever asks holds the packets.
//!
//! What a link does to a packet is decided in [`skein_proto::faults`], the same for this radio in virtual time and for
//! live agents, which get [`RadioSettings::faults`] over the network. What is here is the schedule, the range and the
//! random streams.

mod settings;
#[cfg(test)]
mod tests;

pub use settings::{
    LINKS_MAX, PARTITIONS_MAX, Partition, RadioSettings, SILENCES_MAX, Silence, VEHICLES_LISTED_MAX,
};
pub use skein_proto::faults::{
    Barrier, Burst, Duplicate, LinkCount, LinkOverride, RateLimit, Reason, Reorder, Verdict,
};

use crate::streams::{Purpose, Streams};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use skein_proto::faults::{self, Draws, Impairments, LinkRule};
use std::collections::BTreeMap;

/// All links of a fleet, each with its own random streams.
#[derive(Clone, Debug)]
pub struct Radio {
    settings: RadioSettings,
    streams: Streams,
    links: BTreeMap<(usize, usize), Link>,
}

#[derive(Clone, Debug)]
struct Link {
    impairments: Impairments,
    silent: bool,
    chance: ChaCha8Rng,
    others: ChaCha8Rng,
    state: faults::Link,
}

impl Radio {
    /// A radio with these rules that has carried nothing yet.
    #[must_use]
    pub fn new(settings: &RadioSettings, streams: Streams) -> Self {
        Self {
            settings: settings.clone(),
            streams,
            links: BTreeMap::new(),
        }
    }

    /// Changes the rules during a flight; packets under way keep the delay they were sent with.
    pub fn change(&mut self, settings: &RadioSettings) {
        self.settings = settings.clone();
        for ((from, to), link) in &mut self.links {
            (link.impairments, link.silent) = settings.link(*from, *to);
        }
    }

    /// Sends one packet at `now_ns` (nanoseconds since the start of the motion, negative before it) over the link
    /// between two vehicles, by their indices, that are `distance_m` apart.
    pub fn transmit(
        &mut self,
        now_ns: i64,
        from: usize,
        to: usize,
        distance_m: f64,
        bytes: usize,
    ) -> Verdict {
        let (settings, streams) = (&self.settings, &self.streams);
        let link = self.links.entry((from, to)).or_insert_with(|| {
            let (impairments, silent) = settings.link(from, to);
            Link {
                impairments,
                silent,
                chance: streams.pair(from, to, Purpose::Radio),
                others: streams.pair(from, to, Purpose::RadioImpairments),
                state: faults::Link::default(),
            }
        });
        let now_s = now_ns as f64 * 1e-9;
        let rule = LinkRule {
            impairments: link.impairments,
            barrier: settings.barrier(now_s, from, to, distance_m, link.silent),
        };
        let (chance, others) = (&mut link.chance, &mut link.others);
        let draws = Draws::take(&mut || chance.random(), &mut || others.random());
        link.state.judge(&rule, now_ns, bytes, &draws)
    }

    /// What the link between two vehicles has carried, by their indices.
    #[must_use]
    pub fn count(&self, from: usize, to: usize) -> LinkCount {
        self.links
            .get(&(from, to))
            .map_or_else(LinkCount::default, |link| link.state.count())
    }

    /// Every link that was used, in the order (from, to), with what it carried.
    pub fn counts(&self) -> impl Iterator<Item = ((usize, usize), LinkCount)> + '_ {
        self.links
            .iter()
            .map(|(ends, link)| (*ends, link.state.count()))
    }

    /// What all links together have carried.
    #[must_use]
    pub fn total(&self) -> LinkCount {
        let mut total = LinkCount::default();
        for (_, count) in self.counts() {
            total += count;
        }
        total
    }
}
