//! Range-only localisation: distances between this vehicle and neighbours of which at least one of the two has no pose in
//! the common frame, with the odometry of both, become where each such neighbour is; and through one that is located,
//! where this vehicle is.

mod forming;
mod found;
mod geometry;
mod joining;
mod telling;
mod waiting;

use std::collections::{BTreeMap, BTreeSet};

use skein_estimation::odometry::OdometryPoint;
use skein_estimation::ranging::bank::Place;
use skein_estimation::ranging::neighbour::{Estimate, NeighbourSettings};
use skein_estimation::ranging::team::Formation;
use skein_estimation::ranging::window::Observability;
use skein_estimation::ranging::{Dimension, Neighbour, RangeRefusal, RangeSample};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, VehicleId};
use skein_proto::measured::Measured;
use skein_proto::name::Name;

use crate::clock::PeerStamp;
use crate::counters::Counters;
use crate::dead_reckoning::DeadReckoning;
use crate::neighbours::{Boot, Neighbours};
use crate::refused::Refused;
use crate::rounds::Round;
use crate::work::Job;
use forming::Forming;
use found::Found;
use geometry::{body_from_body, level};
use waiting::{Ends, Party, Queue, Waiting};

/// Own distances that wait for the odometry of their time.
const WAITING_MAX: usize = 256;

/// The pipeline of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Ranging {
    settings: NeighbourSettings,
    pairs: BTreeMap<Name, Pair>,
    waiting: Queue,
    forming: Forming,
    used: u64,
    refused: Counters,
    pub(crate) placed: u64,
}

/// This vehicle and one neighbour.
#[derive(Clone, Debug)]
struct Pair {
    life: Life,
    follower: Neighbour,
    /// The newest distance, and both vehicles then.
    newest: Option<(RangeSample, Ends)>,
    /// The rounds of the neighbour up to this one were looked through.
    read_until: Option<PeerStamp>,
}

/// One clock of one process of a neighbour: of its odometry nothing holds across two.
type Life = (u64, Option<PeerStamp>);

/// What distances are read with.
pub(crate) struct Readable<'a> {
    pub(crate) now: Stamp,
    pub(crate) me: VehicleId,
    pub(crate) round: &'a Round,
    pub(crate) period: Span,
    pub(crate) neighbours: &'a Neighbours,
    pub(crate) reckoning: &'a DeadReckoning,
    /// Where others' sensors see this vehicle.
    pub(crate) body_from_target: Transform<Body, Sensor>,
    /// Those whose distances are measurements of the cooperative pipeline.
    pub(crate) tied: &'a BTreeSet<Name>,
}

impl Readable<'_> {
    /// The neighbour's process, if anything of it may be used.
    fn boot(&self, name: Name) -> Option<&Boot> {
        self.neighbours.get(name)?.usable()
    }
}

impl Ranging {
    pub(crate) fn new(dimension: Dimension) -> Self {
        let settings = match dimension {
            Dimension::Planar => NeighbourSettings::PLANAR,
            Dimension::Spatial => NeighbourSettings::SPATIAL,
        };
        Self {
            settings,
            pairs: BTreeMap::new(),
            waiting: Queue::new(WAITING_MAX),
            forming: Forming::new(settings),
            used: 0,
            refused: Counters::default(),
            placed: 0,
        }
    }

    /// Takes the distances of a round, and what neighbours told of theirs since. Returns what was not used, and of whom.
    pub(crate) fn read(&mut self, from: &Readable<'_>) -> Vec<(Name, Refused)> {
        self.meet(from);
        let mut refused = Vec::new();
        self.collect(from, &mut refused);
        self.feed(from, &mut refused);
        for (_, why) in &refused {
            self.refused.refuse(why);
        }
        refused
    }

    /// Whoever began a new life is a stranger, and whoever is tied to the common frame needs this no more.
    fn meet(&mut self, from: &Readable<'_>) {
        self.pairs.retain(|name, pair| {
            let boot = from.boot(*name);
            !from.tied.contains(name) && boot.is_some_and(|boot| life(boot) == pair.life)
        });
        let pairs = &self.pairs;
        self.waiting.retain(|waiting| match waiting.parties() {
            (Party::Own, Party::Neighbour(name)) => pairs.contains_key(&name),
            _ => false,
        });
        self.forming.meet(pairs);
    }

    fn collect(&mut self, from: &Readable<'_>, refused: &mut Vec<(Name, Refused)>) {
        for (name, neighbour) in from.neighbours.iter() {
            let Some(boot) = neighbour.usable().filter(|_| !from.tied.contains(&name)) else {
                continue;
            };
            let mut heard = own_distances(from, name);
            let read_until = self.pairs.get(&name).and_then(|pair| pair.read_until);
            let told = boot.rounds.iter().rev();
            let mut newest = read_until;
            for round in told.take_while(|round| read_until.is_none_or(|at| round.instant > at)) {
                newest = newest.max(Some(round.instant));
                for addressed in &round.measured {
                    let of = if addressed.to == from.me.0 {
                        Party::Own
                    } else if let Some(other) = self.forming.told(name, addressed.to) {
                        Party::Neighbour(other)
                    } else {
                        continue;
                    };
                    let taken = round.instant.plus(offset(&addressed.measured));
                    let Some(taken) = boot.clock.to_mine(taken) else {
                        continue;
                    };
                    let waiting = Waiting::new(
                        Party::Neighbour(name),
                        of,
                        taken,
                        &addressed.measured,
                        &round.point.odometry_from_body,
                    );
                    match (waiting, of) {
                        (Some(waiting), Party::Own) => heard.push(waiting),
                        (Some(waiting), Party::Neighbour(_)) => self.forming.push(waiting),
                        (None, _) => {}
                    }
                }
            }
            if heard.is_empty() && !self.pairs.contains_key(&name) {
                continue;
            }
            let pair = self.pairs.entry(name).or_insert_with(|| Pair {
                life: life(boot),
                follower: Neighbour::new(self.settings),
                newest: None,
                read_until: None,
            });
            pair.read_until = newest;
            for waiting in heard {
                if let Err(why) = self.waiting.push(waiting) {
                    refused.push((name, why));
                }
            }
        }
    }

    /// Gives the followers every distance of which both ends are known, in order of their times.
    fn feed(&mut self, from: &Readable<'_>, refused: &mut Vec<(Name, Refused)>) {
        for (waiting, settled) in self.waiting.settled(from) {
            let (_, Party::Neighbour(name)) = waiting.parties() else {
                continue;
            };
            let Some(pair) = self.pairs.get_mut(&name) else {
                continue;
            };
            match settled.and_then(|(sample, ends)| pair.take(sample, ends)) {
                Ok(()) => {
                    self.used += 1;
                    self.forming.join(name);
                }
                Err(why) => refused.push((name, why)),
            }
        }
        self.forming.feed(from);
    }

    /// The search for a formation that is due, if one is.
    pub(crate) fn begin_work(&mut self, number: u64, from: &Readable<'_>) -> Option<Job> {
        self.forming.begin(number, from, &self.pairs)
    }

    /// Takes what came of it.
    pub(crate) fn finish_work(&mut self, number: u64, best: Option<&Formation>) {
        self.forming.finish(number, best);
    }

    /// A neighbour as it was seen when both were at these points of their odometries; none while it may be at more than one
    /// place.
    pub(crate) fn found(
        &self,
        name: Name,
        own: &OdometryPoint,
        neighbour: &OdometryPoint,
    ) -> Option<Found> {
        let pair = self.pairs.get(&name)?;
        let (sample, _) = pair.newest.as_ref()?;
        let estimate = pair.follower.estimate();
        if estimate.observability != Observability::Observable {
            let place = self.placed_by_all(name, pair, &estimate, own, neighbour)?;
            let at = [&level(own), &level(neighbour)];
            return Some(Found {
                body_from_neighbour: body_from_body(at, &place.pose, own, neighbour),
                covariance: place.covariance,
            });
        }
        let continued =
            sample.own.segment == own.segment && sample.neighbour.segment == neighbour.segment;
        let place = estimate.best.filter(|_| continued)?;
        let at = [&sample.own, &sample.neighbour];
        Some(Found {
            body_from_neighbour: body_from_body(at, &place.pose, own, neighbour),
            covariance: place.covariance,
        })
    }

    /// The only place of a neighbour in the formation of all, at these points, where its own distances leave it open.
    fn placed_by_all(
        &self,
        name: Name,
        pair: &Pair,
        estimate: &Estimate,
        own: &OdometryPoint,
        neighbour: &OdometryPoint,
    ) -> Option<Place> {
        let open = estimate.observability != Observability::Observable && !estimate.is_disagreeing;
        let place = || self.forming.place(name, pair.life, own, neighbour);
        open.then(place).flatten()
    }
}

impl Pair {
    fn take(&mut self, sample: RangeSample, ends: Ends) -> Result<(), Refused> {
        self.follower.handle(&sample).map_err(refused)?;
        self.newest = Some((sample, ends));
        Ok(())
    }
}

/// What this vehicle measured to a neighbour in a round.
fn own_distances(from: &Readable<'_>, name: Name) -> Vec<Waiting> {
    let Some(at_round) = &from.round.odometry else {
        return Vec::new();
    };
    let measured = from.round.measured.get(&name).into_iter().flatten();
    let waiting = |measured: &Measured| {
        let taken = from.round.instant + offset(measured);
        let of = Party::Neighbour(name);
        let odometry_from_body = &at_round.odometry_from_body;
        Waiting::new(Party::Own, of, taken, measured, odometry_from_body)
    };
    measured.filter_map(waiting).collect()
}

fn life(boot: &Boot) -> Life {
    (boot.id, boot.stepped_at)
}

fn offset(measured: &Measured) -> Span {
    Span::micros(i64::from(measured.taken_offset_us))
}

fn refused(why: RangeRefusal) -> Refused {
    match why {
        RangeRefusal::NotLater => Refused::TooLate,
        RangeRefusal::BadOwnOdometry | RangeRefusal::BadNeighbourOdometry => Refused::NoOdometry,
        RangeRefusal::NotFinite
        | RangeRefusal::NotPositive
        | RangeRefusal::TooFar
        | RangeRefusal::BadSigma => Refused::Implausible,
    }
}
