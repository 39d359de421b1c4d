//! Vehicles that stand in a line or on a torus and hear their neighbours through a radio that loses messages.

use super::super::*;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub(super) struct Swarm {
    schedulers: Vec<Option<Scheduler>>,
    links: Vec<Vec<usize>>,
    moves_of: Vec<u32>,
    /// The round in which each began to take part without having moved since.
    waits_since: Vec<Option<u32>>,
    first_round: Vec<u32>,
    loss: f64,
    rng: ChaCha8Rng,
    round: u32,
    /// How often a message is sent in its phase.
    pub(super) repeats: u32,
    /// Pairs that moved together though they knew each other when the round in which they were elected began.
    pub(super) conflicts: u32,
    pub(super) moves: u32,
    /// Rounds before the first in which a vehicle was elected.
    pub(super) first_wait_rounds_max: u32,
    /// Rounds of taking part before one was elected.
    pub(super) eligible_wait_rounds_max: u32,
}

fn id(index: usize) -> VehicleId {
    VehicleId(index as u64 + 1)
}

impl Swarm {
    fn new(links: Vec<Vec<usize>>, loss: f64, seed: u64) -> Self {
        let n = links.len();
        Self {
            schedulers: (0..n)
                .map(|index| Some(Scheduler::new(id(index))))
                .collect(),
            links,
            moves_of: vec![0; n],
            waits_since: vec![None; n],
            first_round: vec![2 + LISTENING_ROUNDS; n],
            loss,
            rng: ChaCha8Rng::seed_from_u64(seed),
            round: 0,
            repeats: 1,
            conflicts: 0,
            moves: 0,
            first_wait_rounds_max: 0,
            eligible_wait_rounds_max: 0,
        }
    }

    pub(super) fn line(n: usize, loss: f64, seed: u64) -> Self {
        let beside = |index: usize| {
            let before = index.checked_sub(1);
            let after = (index + 1 < n).then_some(index + 1);
            before.into_iter().chain(after).collect()
        };
        Self::new((0..n).map(beside).collect(), loss, seed)
    }

    /// Side times side vehicles on a torus, each with the eight around it as neighbours.
    pub(super) fn grid(side: usize, loss: f64, seed: u64) -> Self {
        let around = |index: usize| {
            let (row, column) = (index / side, index % side);
            let steps = [side - 1, 0, 1];
            let cells = steps
                .iter()
                .flat_map(|down| steps.iter().map(move |right| (*down, *right)));
            cells
                .filter(|step| *step != (0, 0))
                .map(|(down, right)| (row + down) % side * side + (column + right) % side)
                .collect()
        };
        Self::new((0..side * side).map(around).collect(), loss, seed)
    }

    pub(super) fn crash(&mut self, index: usize) {
        self.schedulers[index] = None;
    }

    pub(super) fn start(&mut self, index: usize) {
        self.schedulers[index] = Some(Scheduler::new(id(index)));
        self.waits_since[index] = None;
    }

    pub(super) fn connect(&mut self, a: usize, b: usize) {
        self.links[a].push(b);
        self.links[b].push(a);
    }

    pub(super) fn disconnect(&mut self, a: usize, b: usize) {
        self.links[a].retain(|other| *other != b);
        self.links[b].retain(|other| *other != a);
    }

    pub(super) fn moved(&self, index: usize) -> u32 {
        self.moves_of[index]
    }

    pub(super) fn knows(&self, index: usize, other: usize) -> bool {
        let scheduler = self.schedulers[index].as_ref();
        scheduler.is_some_and(|one| one.knows(id(other)))
    }

    pub(super) fn permit(&self, index: usize) -> Permit {
        let scheduler = self.schedulers[index].as_ref();
        scheduler.map_or(Permit::Stay, Scheduler::permit)
    }

    /// Lets rounds go by; permits are then those of the round that begins.
    pub(super) fn run(&mut self, rounds: u32) {
        for _ in 0..rounds {
            self.round += 1;
            let n = self.links.len();
            let links = self.links.clone();
            let knew: Vec<Vec<bool>> = (0..n)
                .map(|a| {
                    links[a]
                        .iter()
                        .map(|b| self.knows(a, *b) && self.knows(*b, a))
                        .collect()
                })
                .collect();
            for phase in 0..PHASES {
                self.exchange(Slot::new(self.round, phase).unwrap());
            }
            // The next round begins: nothing is said in it yet.
            let next = Slot::new(self.round + 1, 0).unwrap();
            for scheduler in self.schedulers.iter_mut().flatten() {
                scheduler.begin_phase(next, self.rng.next_u32());
            }
            self.count(&knew);
        }
    }

    fn exchange(&mut self, slot: Slot) {
        let said: Vec<Option<Message>> = self
            .schedulers
            .iter_mut()
            .map(|one| Some(one.as_mut()?.begin_phase(slot, self.rng.next_u32())))
            .collect();
        for (from, message) in said.iter().enumerate() {
            let Some(message) = message else { continue };
            for to in &self.links[from] {
                for _ in 0..self.repeats {
                    if self.rng.random_bool(1.0 - self.loss)
                        && let Some(scheduler) = &mut self.schedulers[*to]
                    {
                        scheduler.hear(id(from), message).unwrap();
                    }
                }
            }
        }
        for (index, scheduler) in self.schedulers.iter().enumerate() {
            let takes_part = scheduler
                .as_ref()
                .is_some_and(|one| one.state() != State::Resting);
            if takes_part && self.waits_since[index].is_none() {
                self.waits_since[index] = Some(slot.round());
            }
        }
    }

    fn count(&mut self, knew: &[Vec<bool>]) {
        for index in 0..self.links.len() {
            if self.permit(index) != Permit::Move {
                continue;
            }
            self.moves += 1;
            self.moves_of[index] += 1;
            let together = self.links[index].iter().zip(&knew[index]);
            let together =
                together.filter(|(other, knew)| **knew && self.permit(**other) == Permit::Move);
            self.conflicts += together.count() as u32;
            if let Some(since) = self.waits_since[index].take() {
                self.eligible_wait_rounds_max =
                    self.eligible_wait_rounds_max.max(self.round - since);
            }
            if self.moves_of[index] == 1 {
                let wait = self.round - self.first_round[index];
                self.first_wait_rounds_max = self.first_wait_rounds_max.max(wait);
            }
        }
    }
}
