//! Range-only localisation: distances between this vehicle and neighbours of which at least one of the two has no pose in
//! the common frame, with the odometry of both, become where each such neighbour is; and through one that is located,
//! where this vehicle is.

mod found;
mod geometry;
mod joining;
mod telling;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use nalgebra::Vector3;
use skein_estimation::odometry::{Gap, OdometryPoint};
use skein_estimation::ranging::neighbour::NeighbourSettings;
use skein_estimation::ranging::window::Observability;
use skein_estimation::ranging::{Dimension, Neighbour, RangeRefusal, RangeSample};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Odometry, Sensor, Transform, VehicleId};
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::name::Name;

use crate::clock::PeerStamp;
use crate::counters::Counters;
use crate::dead_reckoning::DeadReckoning;
use crate::gathering::Direction;
use crate::neighbours::{Boot, Neighbours};
use crate::refused::Refused;
use crate::rounds::Round;
use found::Found;
use geometry::{body_from_body, levelled, point};

/// Distances that wait for the odometry of their time.
const WAITING_MAX: usize = 256;
/// How long they wait.
const WAIT_MAX: Span = Span::secs(2);
/// Periods for which every distance is held back, so that what the neighbour measured comes in order of its time.
const HELD_PERIODS: i64 = 2;

/// The pipeline of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Ranging {
    dimension: Dimension,
    pairs: BTreeMap<Name, Pair>,
    waiting: VecDeque<Waiting>,
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

/// Both vehicles at one moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ends {
    pub(crate) taken: Stamp,
    pub(crate) own: OdometryPoint,
    pub(crate) neighbour: OdometryPoint,
}

/// A distance that waits for the odometry of its time.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    neighbour: Name,
    direction: Direction,
    /// On this vehicle's clock.
    taken: Stamp,
    distance_m: f64,
    sigma_m: f64,
    /// Where the sensor was, in the measuring vehicle's odometry frame (m).
    sensor_m: Vector3<f64>,
}

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

impl Ranging {
    pub(crate) fn new(dimension: Dimension) -> Self {
        Self {
            dimension,
            pairs: BTreeMap::new(),
            waiting: VecDeque::new(),
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
            let boot = from.neighbours.get(*name).and_then(|known| known.usable());
            !from.tied.contains(name) && boot.is_some_and(|boot| life(boot) == pair.life)
        });
        let pairs = &self.pairs;
        self.waiting
            .retain(|waiting| pairs.contains_key(&waiting.neighbour));
    }

    fn collect(&mut self, from: &Readable<'_>, refused: &mut Vec<(Name, Refused)>) {
        for (name, neighbour) in from.neighbours.iter() {
            let Some(boot) = neighbour.usable().filter(|_| !from.tied.contains(&name)) else {
                continue;
            };
            let mine = from.round.measured.get(&name);
            let mut heard = Vec::new();
            let at_round = from.round.odometry.as_ref();
            for measured in mine.into_iter().flatten() {
                let taken = from.round.instant + offset(measured);
                let at_round = at_round.map(|point| &point.odometry_from_body);
                heard.extend(at_round.and_then(|odometry_from_body| {
                    Waiting::new(name, Direction::Mine, taken, measured, odometry_from_body)
                }));
            }
            let read_until = self.pairs.get(&name).and_then(|pair| pair.read_until);
            let told = boot.rounds.iter().rev();
            let mut newest = read_until;
            for round in told.take_while(|round| read_until.is_none_or(|at| round.instant > at)) {
                newest = newest.max(Some(round.instant));
                let of_me = |addressed: &&skein_proto::record::Addressed| addressed.to == from.me.0;
                for addressed in round.measured.iter().filter(of_me) {
                    let taken = round.instant.plus(offset(&addressed.measured));
                    let Some(taken) = boot.clock.to_mine(taken) else {
                        continue;
                    };
                    let odometry_from_body = &round.point.odometry_from_body;
                    heard.extend(Waiting::new(
                        name,
                        Direction::Theirs,
                        taken,
                        &addressed.measured,
                        odometry_from_body,
                    ));
                }
            }
            if heard.is_empty() && !self.pairs.contains_key(&name) {
                continue;
            }
            let pair = self.pairs.entry(name).or_insert_with(|| Pair {
                life: life(boot),
                follower: Neighbour::new(match self.dimension {
                    Dimension::Planar => NeighbourSettings::PLANAR,
                    Dimension::Spatial => NeighbourSettings::SPATIAL,
                }),
                newest: None,
                read_until: None,
            });
            pair.read_until = newest;
            for waiting in heard {
                if self.waiting.len() < WAITING_MAX {
                    self.waiting.push_back(waiting);
                } else {
                    refused.push((name, Refused::Full));
                }
            }
        }
    }

    /// Gives the followers every distance of which both ends are known, in order of their times.
    fn feed(&mut self, from: &Readable<'_>, refused: &mut Vec<(Name, Refused)>) {
        let held_since = from.now - from.period * HELD_PERIODS;
        let given_up = from.now - WAIT_MAX;
        let waiting = std::mem::take(&mut self.waiting);
        let (mut ripe, held): (Vec<_>, Vec<_>) = waiting
            .into_iter()
            .partition(|waiting| waiting.taken <= held_since);
        self.waiting = held.into();
        ripe.sort_by_key(|waiting| (waiting.taken, waiting.neighbour));
        for waiting in ripe {
            let (Some(pair), Some(boot)) = (
                self.pairs.get_mut(&waiting.neighbour),
                from.neighbours
                    .get(waiting.neighbour)
                    .and_then(|neighbour| neighbour.usable()),
            ) else {
                continue;
            };
            let outcome = match ends(from, boot, waiting.taken) {
                Ok(ends) => pair.take(waiting.sample(from, boot, &ends), ends),
                Err(Gap::NotYet) if waiting.taken >= given_up => {
                    self.waiting.push_back(waiting);
                    continue;
                }
                Err(_) => Err(Refused::NoOdometry),
            };
            match outcome {
                Ok(()) => self.used += 1,
                Err(why) => refused.push((waiting.neighbour, why)),
            }
        }
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
        let continued =
            sample.own.segment == own.segment && sample.neighbour.segment == neighbour.segment;
        let estimate = pair.follower.estimate();
        let known = continued && estimate.observability == Observability::Observable;
        let place = estimate.best.filter(|_| known)?;
        Some(Found {
            body_from_neighbour: body_from_body(sample, &place.pose, own, neighbour),
            covariance: place.covariance,
        })
    }
}

impl Pair {
    fn take(&mut self, sample: RangeSample, ends: Ends) -> Result<(), Refused> {
        self.follower.handle(&sample).map_err(refused)?;
        self.newest = Some((sample, ends));
        Ok(())
    }
}

impl Waiting {
    /// None of any other kind of measurement.
    fn new(
        neighbour: Name,
        direction: Direction,
        taken: Stamp,
        measured: &Measured,
        odometry_from_body: &Transform<Odometry, Body>,
    ) -> Option<Self> {
        let MeasuredValue::Distance {
            distance_m,
            origin_m,
            sigma_m,
        } = measured.value
        else {
            return None;
        };
        Some(Self {
            neighbour,
            direction,
            taken,
            distance_m,
            sigma_m: f64::from(sigma_m),
            sensor_m: point(odometry_from_body, &Vector3::from(origin_m)),
        })
    }

    /// With the points between which it was measured: the sensor at one end, the target at the other.
    fn sample(&self, from: &Readable<'_>, boot: &Boot, ends: &Ends) -> RangeSample {
        let target = |at: &OdometryPoint, mount: &Transform<Body, Sensor>| {
            point(&at.odometry_from_body, &mount.translation)
        };
        let (own_m, neighbour_m) = match self.direction {
            Direction::Mine => (
                self.sensor_m,
                target(&ends.neighbour, &boot.body_from_target),
            ),
            Direction::Theirs => (target(&ends.own, &from.body_from_target), self.sensor_m),
        };
        RangeSample {
            taken: self.taken,
            range_m: self.distance_m,
            sigma_m: self.sigma_m,
            own: levelled(&ends.own, own_m),
            neighbour: levelled(&ends.neighbour, neighbour_m),
        }
    }
}

fn life(boot: &Boot) -> Life {
    (boot.id, boot.stepped_at)
}

fn offset(measured: &Measured) -> Span {
    Span::micros(i64::from(measured.taken_offset_us))
}

/// Both vehicles' odometry at one instant of our clock.
fn ends(from: &Readable<'_>, boot: &Boot, taken: Stamp) -> Result<Ends, Gap> {
    let theirs = boot.clock.to_peer(taken).ok_or(Gap::Before)?;
    Ok(Ends {
        taken,
        own: from.reckoning.near(taken)?,
        neighbour: boot.odometry_at(theirs)?,
    })
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
