//! All pairs at once: what neighbours told of the distances between them, with this vehicle's own, leaves fewer formations
//! than each pair leaves places. Those are searched beside the vehicle, and the answer holds where no pair has one.

use std::collections::BTreeMap;

use skein_estimation::odometry::OdometryPoint;
use skein_estimation::ranging::bank::Place;
use skein_estimation::ranging::neighbour::NeighbourSettings;
use skein_estimation::ranging::team::{Formation, Placed, ROBOTS_MAX};
use skein_estimation::ranging::window::Observability;
use skein_estimation::ranging::{RangeSample, Team, Window};
use skein_estimation::time::{Span, Stamp};
use skein_proto::document::FormationHealth;
use skein_proto::name::Name;

use super::geometry::level;
use super::waiting::{Party, Queue, Waiting};
use super::{Life, Pair, Readable, refused};
use crate::counters::Counters;
use crate::refused::Refused;
use crate::work::Job;

/// Formations are searched at most this often.
const EVERY: Span = Span::secs(1);
/// A search that is not back by then was dropped.
const OUT_MAX: Span = Span::secs(10);
/// Distances between neighbours that wait for the odometry of their time.
const WAITING_MAX: usize = 512;
/// A formation of fewer neighbours says nothing that a pair does not.
const NEIGHBOURS_MIN: usize = 2;
/// Two searches in a row find a neighbour in one place when it is no further apart than so many of both standard deviations:
/// one search may miss the place that fits best, and is then sure of another.
const AGREEING_SIGMAS: f64 = 3.0;
/// All that are searched for.
const NEIGHBOURS_MAX: usize = ROBOTS_MAX - 1;

/// The formation of one vehicle and those that it hears.
#[derive(Clone, Debug)]
pub(super) struct Forming {
    settings: NeighbourSettings,
    /// In the order in which distances to them were first used.
    members: Vec<Name>,
    /// The last ranges between two of them, the first being of the lower name.
    between: BTreeMap<(Name, Name), Window>,
    waiting: Queue,
    begun_at: Option<Stamp>,
    /// The newest range that went into a search.
    searched_until: Option<Stamp>,
    out: Option<Out>,
    /// What the last search found, and the one before it.
    answers: [Option<Answer>; 2],
    counts: Counts,
}

/// The search that is out.
#[derive(Clone, Debug)]
struct Out {
    number: u64,
    begun_at: Stamp,
    own: OdometryPoint,
    neighbours: Vec<Member>,
}

/// A neighbour in a search, and where its odometry had it.
#[derive(Clone, Copy, Debug)]
struct Member {
    name: Name,
    life: Life,
    point: OdometryPoint,
}

/// What a search found, where odometry had this vehicle then.
#[derive(Clone, Debug)]
struct Answer {
    own: OdometryPoint,
    placed: Vec<(Member, Placed)>,
}

#[derive(Clone, Debug, Default)]
struct Counts {
    used: u64,
    refused: Counters,
    work_begun: u64,
    work_done: u64,
    work_dropped: u64,
    unfit: u64,
}

impl Forming {
    pub(super) fn new(settings: NeighbourSettings) -> Self {
        Self {
            settings,
            members: Vec::new(),
            between: BTreeMap::new(),
            waiting: Queue::new(WAITING_MAX),
            begun_at: None,
            searched_until: None,
            out: None,
            answers: [None, None],
            counts: Counts::default(),
        }
    }

    /// Forgets whoever is followed no more.
    pub(super) fn meet(&mut self, pairs: &BTreeMap<Name, Pair>) {
        self.members.retain(|name| pairs.contains_key(name));
        let members = &self.members;
        let is_member = |party| match party {
            Party::Own => false,
            Party::Neighbour(name) => members.contains(&name),
        };
        self.between
            .retain(|(first, second), _| members.contains(first) && members.contains(second));
        self.waiting.retain(|waiting| {
            let (first, second) = waiting.parties();
            is_member(first) && is_member(second)
        });
    }

    /// A distance to this neighbour was used: it takes part, while there is room.
    pub(super) fn join(&mut self, name: Name) {
        if self.members.len() < NEIGHBOURS_MAX && !self.members.contains(&name) {
            self.members.push(name);
        }
    }

    /// To which neighbour the distance is that another one told. None unless both take part.
    pub(super) fn told(&self, by: Name, to: u64) -> Option<Name> {
        let mut others = self.members.iter().filter(|name| **name != by);
        let other = others.find(|name| name.hash() == to).copied();
        other.filter(|_| self.members.contains(&by))
    }

    pub(super) fn push(&mut self, waiting: Waiting) {
        if let Err(why) = self.waiting.push(waiting) {
            self.counts.refused.refuse(&why);
        }
    }

    /// Keeps every distance between neighbours of which both ends are known by now.
    pub(super) fn feed(&mut self, from: &Readable<'_>) {
        for (waiting, settled) in self.waiting.settled(from) {
            let taken = settled.and_then(|(sample, _)| self.keep(&waiting, &sample));
            match taken {
                Ok(()) => self.counts.used += 1,
                Err(why) => self.counts.refused.refuse(&why),
            }
        }
    }

    fn keep(&mut self, waiting: &Waiting, sample: &RangeSample) -> Result<(), Refused> {
        let (Party::Neighbour(first), Party::Neighbour(second)) = waiting.parties() else {
            return Err(Refused::NotForMe);
        };
        let window = self.between.entry((first, second)).or_default();
        window
            .push_apart(sample, self.settings.apart_m)
            .map_err(refused)?;
        Ok(())
    }

    /// The search that is due, if one is: when some pair leaves its place open, and distances that no search has seen
    /// have come.
    pub(super) fn begin(
        &mut self,
        number: u64,
        from: &Readable<'_>,
        pairs: &BTreeMap<Name, Pair>,
    ) -> Option<Job> {
        let is_late = |out: &mut Out| from.now - out.begun_at >= OUT_MAX;
        self.counts.work_dropped += u64::from(self.out.take_if(is_late).is_some());
        let is_early = self.begun_at.is_some_and(|at| from.now - at < EVERY);
        if self.out.is_some() || is_early || self.between.is_empty() {
            return None;
        }
        let own = *from.reckoning.newest()?;
        let neighbours: Vec<Member> = self
            .members
            .iter()
            .filter_map(|name| {
                let (pair, boot) = (pairs.get(name)?, from.boot(*name)?);
                Some(Member {
                    name: *name,
                    life: pair.life,
                    point: *boot.track.newest()?,
                })
            })
            .collect();
        let (team, newest) = self.team(&own, &neighbours, pairs)?;
        let is_open =
            |pair: &Pair| pair.follower.estimate().observability != Observability::Observable;
        let is_new = self.searched_until.is_none_or(|until| newest > until);
        if !is_new || !pairs.values().any(is_open) {
            return None;
        }
        self.begun_at = Some(from.now);
        self.searched_until = Some(newest);
        self.counts.work_begun += 1;
        self.out = Some(Out {
            number,
            begun_at: from.now,
            own,
            neighbours,
        });
        Some(Job::Formation {
            team,
            settings: self.settings.window,
        })
    }

    /// All ranges of all pairs, and the time of the newest. None when they make no team.
    fn team(
        &self,
        own: &OdometryPoint,
        neighbours: &[Member],
        pairs: &BTreeMap<Name, Pair>,
    ) -> Option<(Team, Stamp)> {
        let points = std::iter::once(own).chain(neighbours.iter().map(|member| &member.point));
        let mut team = Team::new(&points.map(level).collect::<Vec<_>>());
        let mut newest = None;
        // What is refused is of odometry that was interrupted since, or is ahead of what was told: it says nothing, or
        // comes with the next search.
        let mut add = |from: usize, to: usize, window: &Window| {
            let samples = window.samples();
            let taken = samples.filter(|sample| team.push(from, to, sample).is_ok());
            let last = taken.map(|sample| sample.taken).max();
            newest = newest.max(last);
            last.is_some()
        };
        let numbered = || (1..).zip(neighbours);
        let own_pairs = numbered()
            .filter(|(number, member)| {
                let pair = pairs.get(&member.name);
                pair.is_some_and(|pair| add(0, *number, pair.follower.window()))
            })
            .count();
        let mut between = 0;
        for (from, first) in numbered() {
            for (to, second) in numbered() {
                if let Some(window) = self.between.get(&(first.name, second.name)) {
                    between += usize::from(add(from, to, window));
                }
            }
        }
        if own_pairs < NEIGHBOURS_MIN || between == 0 {
            return None;
        }
        Some((team, newest?))
    }

    /// Takes back what a search found. One that was given up changes nothing.
    pub(super) fn finish(&mut self, number: u64, best: Option<&Formation>) {
        let Some(out) = self.out.take_if(|out| out.number == number) else {
            return;
        };
        self.counts.work_done += 1;
        self.answers = [None, self.answers[0].take()];
        let Some(best) = best else {
            return;
        };
        if !best.fits() {
            self.counts.unfit += 1;
            return;
        }
        let placed = out.neighbours.into_iter().zip(&best.placed);
        self.answers[0] = Some(Answer {
            own: out.own,
            placed: placed
                .filter_map(|(member, placed)| Some((member, (*placed)?)))
                .collect(),
        });
    }

    /// Where a neighbour is when both have got so far by their odometries, if the last two formations leave one place for it,
    /// and the same.
    pub(super) fn place(
        &self,
        name: Name,
        life: Life,
        own: &OdometryPoint,
        neighbour: &OdometryPoint,
    ) -> Option<Place> {
        let place = |answer: &Option<Answer>| {
            let answer = answer.as_ref()?;
            let (member, placed) = answer
                .placed
                .iter()
                .find(|(member, _)| member.name == name && member.life == life)?;
            placed.carried(
                [&level(&answer.own), &level(&member.point)],
                [&level(own), &level(neighbour)],
                self.settings.window.dimension,
                &self.settings.criterion,
            )
        };
        let [last, before] = &self.answers;
        let (last, before) = (place(last)?, place(before)?);
        let apart_m = (last.pose.position_m - before.pose.position_m).norm();
        let sigma_m = last.position_sigma_m().hypot(before.position_sigma_m());
        (apart_m <= AGREEING_SIGMAS * sigma_m).then_some(last)
    }

    /// None while nobody has told of a distance to another neighbour.
    pub(super) fn to_document(&self) -> Option<FormationHealth> {
        let counts = &self.counts;
        let is_in_use = counts.used > 0 || self.waiting.len() > 0;
        is_in_use.then(|| FormationHealth {
            neighbours: self.members.len() as u64,
            used: counts.used,
            waiting: self.waiting.len() as u64,
            refused: counts.refused.to_document(),
            work_begun: counts.work_begun,
            work_done: counts.work_done,
            work_dropped: counts.work_dropped,
            unfit: counts.unfit,
        })
    }
}
