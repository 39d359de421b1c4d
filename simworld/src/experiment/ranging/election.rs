//! Robots of a planar swarm that elect who moves, over a radio that loses messages, while some crash and come back.

use crate::planar_swarm::{Drive, PlanarSwarm};
use crate::streams::{Purpose, Streams};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use skein_estimation::VehicleId;
use skein_estimation::ranging::schedule::{
    LISTENING_ROUNDS, Message, PHASES, Permit, Scheduler, Slot, State,
};
use std::cmp::Ordering;

/// Bytes of one message of the schedule.
pub const MESSAGE_BYTES: usize = 14;

/// What the radio and fate do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fate {
    /// Probability that one message does not reach one listener.
    pub loss: f64,
    /// How often a message is sent in its phase.
    pub repeats: u32,
    /// Probability that a robot crashes in a round.
    pub crash: f64,
    /// Rounds for which one that has crashed is away.
    pub away_rounds: u32,
}

impl Fate {
    /// Nothing is lost and nobody crashes.
    pub const KIND: Self = Self {
        loss: 0.0,
        repeats: 1,
        crash: 0.0,
        away_rounds: 0,
    };
}

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Rounds.
    pub rounds: u64,
    /// Permits to move.
    pub moves: u64,
    /// Robots present, summed over rounds.
    pub present: u64,
    /// Crashes.
    pub crashes: u64,
    /// Starts after a crash.
    pub joins: u64,
    /// Messages sent.
    pub messages: u64,
    /// Pairs that moved together within reach though each knew the other when the phase began in which the later of them
    /// was elected.
    pub conflicts: u64,
    /// Pairs that moved together and only met while they did.
    pub met_while_moving: u64,
    /// Pairs that moved together, were within reach of each other during the election, and did not both know it.
    pub not_yet_known: u64,
    /// Pairs of the two kinds before that moved together in the next round too.
    pub unresolved: u64,
    /// Robots that took part and were left undecided though none within reach moves: the set was not maximal.
    pub undecided: u64,
}

/// When robots waited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wait {
    /// Rounds in which it was not elected before the one in which it was.
    pub rounds: u32,
    /// Its neighbours when it began to wait.
    pub degree: u32,
}

/// A swarm and its schedulers.
#[derive(Debug)]
pub struct Election {
    swarm: PlanarSwarm,
    robots: Vec<Robot>,
    fate: Fate,
    radio: ChaCha8Rng,
    draws: ChaCha8Rng,
    crashes: ChaCha8Rng,
    round: u32,
    /// Whom each reaches at the beginning of the round: those near enough to be met before its end.
    near: Vec<Vec<usize>>,
    /// Pairs that moved together in the last round without having known each other.
    together: Vec<(usize, usize)>,
    counts: Counts,
    /// By robot: the wait before its first move, counted from the first round that it could be elected in.
    first_waits: Vec<Option<Wait>>,
    /// Waits since eligible.
    waits: Vec<Wait>,
}

#[derive(Debug)]
struct Robot {
    scheduler: Option<Scheduler>,
    away_until: u32,
    /// Whom it knew when the phase in which it was elected began.
    knew: Vec<VehicleId>,
    /// That phase.
    elected: Option<u8>,
    /// Since which round it has taken part without having been elected, and with how many neighbours.
    since: Option<(u32, u32)>,
}

fn id(robot: usize) -> VehicleId {
    VehicleId(robot as u64 + 1)
}

impl Election {
    /// All robots start at once.
    #[must_use]
    pub fn new(swarm: PlanarSwarm, fate: Fate, streams: &Streams) -> Self {
        let robot = |robot: usize| Robot {
            scheduler: Some(Scheduler::new(id(robot))),
            away_until: 0,
            knew: Vec::new(),
            elected: None,
            since: None,
        };
        let robots: Vec<Robot> = (0..swarm.robots()).map(robot).collect();
        Self {
            fate,
            radio: streams.vehicle(0, Purpose::Radio),
            draws: streams.vehicle(0, Purpose::Election),
            crashes: streams.vehicle(0, Purpose::Crash),
            round: 0,
            near: vec![Vec::new(); robots.len()],
            together: Vec::new(),
            counts: Counts::default(),
            first_waits: vec![None; robots.len()],
            waits: Vec::new(),
            robots,
            swarm,
        }
    }

    /// Lets one round go by: those permitted drive if `drives`, and meanwhile the next are elected.
    pub fn round(&mut self, drives: bool) {
        self.round += 1;
        self.fate();
        let robots = 0..self.robots.len();
        let moving: Vec<bool> = robots.map(|robot| self.moves(robot)).collect();
        self.swarm.step(|robot| {
            if drives && moving[robot] {
                Drive::Random
            } else {
                Drive::Stay
            }
        });
        let near_before = if drives || self.round == 1 {
            self.find_near()
        } else {
            self.near.clone()
        };
        self.count_together(&moving, &near_before);
        for robot in &mut self.robots {
            robot.elected = None;
        }
        for phase in 0..PHASES {
            self.phase(Slot::new(self.round, phase).expect("rounds are counted from one"));
        }
        self.conclude();
    }

    /// What was counted so far.
    #[must_use]
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// By robot, the wait before its first move; none of whoever has not moved.
    #[must_use]
    pub fn first_waits(&self) -> &[Option<Wait>] {
        &self.first_waits
    }

    /// All waits since eligible.
    #[must_use]
    pub fn waits(&self) -> &[Wait] {
        &self.waits
    }

    /// What a robot may do in the round that is to come.
    #[must_use]
    pub fn moves(&self, robot: usize) -> bool {
        let scheduler = self.robots[robot].scheduler.as_ref();
        scheduler.is_some_and(|one| one.permit() == Permit::Move)
    }

    /// The swarm.
    #[must_use]
    pub const fn swarm(&self) -> &PlanarSwarm {
        &self.swarm
    }

    fn fate(&mut self) {
        for (index, robot) in self.robots.iter_mut().enumerate() {
            let crashes = self.crashes.random_bool(self.fate.crash);
            if robot.scheduler.is_none() {
                if self.round >= robot.away_until {
                    robot.scheduler = Some(Scheduler::new(id(index)));
                    self.counts.joins += 1;
                }
            } else if crashes {
                robot.scheduler = None;
                robot.since = None;
                robot.away_until = self.round + self.fate.away_rounds;
                self.counts.crashes += 1;
            }
        }
    }

    /// Whom each meets in this round; gives what it was before.
    fn find_near(&mut self) -> Vec<Vec<usize>> {
        let n = self.robots.len();
        let near = (0..n).map(|a| {
            let meet = |b: &usize| {
                let mut shares = (0..=PHASES).map(|phase| f64::from(phase) / f64::from(PHASES));
                *b != a && shares.any(|share| self.swarm.are_linked_at(a, *b, share))
            };
            (0..n).filter(meet).collect()
        });
        let near = near.collect();
        std::mem::replace(&mut self.near, near)
    }

    /// Counts pairs that move together within reach. `near_before`: who met whom in the round of their election.
    fn count_together(&mut self, moving: &[bool], near_before: &[Vec<usize>]) {
        let mut together = Vec::new();
        for a in (0..moving.len()).filter(|a| moving[*a]) {
            for b in self.near[a].iter().copied() {
                if b < a || !moving[b] {
                    continue;
                }
                self.counts.unresolved += u64::from(self.together.contains(&(a, b)));
                if self.knew(a, b) {
                    self.counts.conflicts += 1;
                } else {
                    together.push((a, b));
                    if near_before[a].contains(&b) {
                        self.counts.not_yet_known += 1;
                    } else {
                        self.counts.met_while_moving += 1;
                    }
                }
            }
        }
        self.together = together;
    }

    /// Whether two knew of each other when the phase began in which the later of them was elected: that the later one knew
    /// is enough, as the earlier had been elected without it.
    fn knew(&self, a: usize, b: usize) -> bool {
        let knew = |a: usize, b: usize| self.robots[a].knew.contains(&id(b));
        match self.robots[a].elected.cmp(&self.robots[b].elected) {
            Ordering::Less => knew(b, a),
            Ordering::Equal => knew(a, b) && knew(b, a),
            Ordering::Greater => knew(a, b),
        }
    }

    fn phase(&mut self, slot: Slot) {
        let share = f64::from(slot.phase()) / f64::from(PHASES);
        let said: Vec<Option<Message>> = (0..self.robots.len())
            .map(|robot| self.begin_phase(robot, slot))
            .collect();
        for (from, message) in said.iter().enumerate() {
            let Some(message) = message else { continue };
            self.counts.messages += u64::from(self.fate.repeats);
            for to in &self.near[from] {
                let heard = (0..self.fate.repeats)
                    .filter(|_| !self.radio.random_bool(self.fate.loss))
                    .count();
                if heard == 0 || !self.swarm.are_linked_at(from, *to, share) {
                    continue;
                }
                if let Some(scheduler) = &mut self.robots[*to].scheduler {
                    // What is refused is counted by the scheduler; honest robots of one clock are not.
                    let _ = scheduler.hear(id(from), message);
                }
            }
        }
    }

    fn begin_phase(&mut self, index: usize, slot: Slot) -> Option<Message> {
        let degree = self.near[index].len() as u32;
        let robot = &mut self.robots[index];
        let scheduler = robot.scheduler.as_mut()?;
        let before = scheduler.state();
        let message = scheduler.begin_phase(slot, self.draws.next_u32());
        if before == State::Contending
            && scheduler.state() == State::Joined
            && let Some(elected) = slot.phase().checked_sub(1)
        {
            robot.elected = Some(elected);
        }
        if scheduler.state() == State::Contending {
            robot.knew.clear();
            robot.knew.extend(scheduler.neighbours());
            robot.since.get_or_insert((slot.round(), degree));
        }
        Some(message)
    }

    /// Begins the next round, in which nothing has been said yet, and counts who moves in it.
    fn conclude(&mut self) {
        let next = Slot::new(self.round + 1, 0).expect("rounds are counted from one");
        let mut undecided = Vec::new();
        for index in 0..self.robots.len() {
            let degree = self.near[index].len() as u32;
            let robot = &mut self.robots[index];
            let Some(scheduler) = &mut robot.scheduler else {
                continue;
            };
            self.counts.present += 1;
            if scheduler.state() == State::Contending {
                // Whom it knew was noted when the phase that ends here began.
                robot.elected = Some(PHASES - 1);
                undecided.push(index);
            }
            scheduler.begin_phase(next, self.draws.next_u32());
            if scheduler.permit() != Permit::Move {
                continue;
            }
            self.counts.moves += 1;
            if let Some((since, degree)) = robot.since.take() {
                let rounds = self.round - since;
                self.waits.push(Wait { rounds, degree });
            }
            // They started in the first round and could be elected after they had listened.
            let rounds = self.round.saturating_sub(2 + LISTENING_ROUNDS);
            self.first_waits[index].get_or_insert(Wait { rounds, degree });
        }
        undecided.retain(|index| {
            let mut reached = self.near[*index].iter();
            !self.moves(*index) && !reached.any(|other| self.moves(*other))
        });
        self.counts.undecided += undecided.len() as u64;
        self.counts.rounds += 1;
    }
}
