//! Who may move, and who stands still to be measured from: a motion schedule by maximal independent sets (Cornejo &
//! Nagpal, algorithm 3), elected among neighbours by messages that may be lost.
//!
//! Time comes in *rounds* of [`PHASES`] phases. In each phase a vehicle tells its state ([`Scheduler::begin_phase`]) and
//! hears that of others ([`Scheduler::hear`]); the set that is elected in round k moves in round k + 1, while the next is
//! elected. A vehicle that has moved takes no part until each neighbour has moved since, or together with it.
//!
//! The election is Luby's, made safe against loss. The textbook's vehicle joins when it *hears* of no greater value, so a
//! lost message lets two neighbours move together. Here it joins only when *every* neighbour it knows has said in this
//! round that it takes no part, or in this very phase that it has the smaller value. Of two neighbours that know each other
//! at most one can join: in one phase each would need the other's value to be smaller, and in different phases the later
//! one needs a message of the earlier, which says that it has joined. Loss costs time, never independence. A neighbour that falls
//! silent holds up those around it for [`SILENT_ROUNDS_MAX`] rounds and is then forgotten; one that appears is heard for a
//! round before anything is decided with it unknown, because a newcomer, and a vehicle that moves, only listens. A liar can
//! hold up its neighbours by pretending to move always; it cannot make two others move together.
//!
//! # What it demands of a clock
//!
//! Rounds and phases are numbers that all vehicles of a fleet derive from one common time, and they are written into every
//! message: the argument above is about these numbers, not about instants, so clocks that differ make vehicles refuse each
//! other's messages and stand still, but never join together. What clocks do decide is when a *move* begins and ends: where
//! two clocks differ by d, the end of one round's moves overlaps the beginning of the next one's by d, so a vehicle must
//! stand still for the greatest difference to be expected at one end of its round. A vehicle whose time runs backwards
//! begins anew as a newcomer. The phase should last at least one message period and the usual delay; when it lasts several
//! message periods, the same message is repeated in it, and loss falls to its power.

mod message;
mod neighbour;
mod refusal;
mod round_robin;

pub use message::{ENTRY_PHASES, Message, PHASES, Slot, State};
pub use refusal::{Refusal, Refusals};
pub use round_robin::round_robin;

use crate::vehicle_id::VehicleId;
use neighbour::Neighbour;

/// Neighbours that are kept. More are refused, and counted.
pub const NEIGHBOURS_MAX: usize = 64;

/// A neighbour that has not been heard for so many whole rounds is taken for gone.
pub const SILENT_ROUNDS_MAX: u32 = 2;

/// Whole rounds for which a vehicle only listens after it has started.
pub const LISTENING_ROUNDS: u32 = 1;

/// After so many rounds a vehicle waits no longer for neighbours that have not moved: who takes part would have, for its
/// own wait is bounded by its neighbours, and who never does must not hold up others for ever.
pub const PATIENCE_ROUNDS: u32 = NEIGHBOURS_MAX as u32;

/// What a vehicle may do in a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permit {
    /// It is in the set that moves; its neighbours stand still.
    Move,
    /// It must stand still.
    Stay,
}

/// One vehicle's part in the schedule.
#[derive(Clone, Debug)]
pub struct Scheduler {
    own: VehicleId,
    /// The phase that has begun last.
    now: Option<Slot>,
    /// The first round in which it may take part.
    listens_until: u32,
    state: State,
    /// What it said of itself in this phase.
    value: u32,
    permit: Permit,
    /// The last round in which it was permitted to move; zero when there was none.
    moved: u32,
    /// Sorted by vehicle.
    neighbours: Vec<Neighbour>,
    refusals: Refusals,
}

impl Scheduler {
    /// A vehicle that has heard of nobody yet.
    #[must_use]
    pub fn new(own: VehicleId) -> Self {
        Self {
            own,
            now: None,
            listens_until: 0,
            state: State::Resting,
            value: 0,
            permit: Permit::Stay,
            moved: 0,
            neighbours: Vec::new(),
            refusals: Refusals::default(),
        }
    }

    /// Concludes the phase before and begins this one: gives the message to send in it, as often as one likes. `draw` must
    /// be random and new in every phase. The phase that is already running changes nothing and has the same message; phases
    /// that were missed cost their votes; a phase of the past, or a round that was missed altogether, makes a newcomer of
    /// the vehicle.
    pub fn begin_phase(&mut self, slot: Slot, draw: u32) -> Message {
        match self.now {
            Some(now) if slot == now => return self.message(slot),
            Some(now) if now < slot && slot.round() - now.round() <= 1 => {
                self.conclude_phase(now);
                if now.round() < slot.round() {
                    self.begin_round(slot.round());
                }
            }
            _ => self.begin_anew(slot.round()),
        }
        self.now = Some(slot);
        let may_enter = slot.phase() < ENTRY_PHASES && self.is_eligible(slot.round());
        if self.state == State::Resting && may_enter {
            self.state = State::Contending;
        }
        self.value = draw;
        self.message(slot)
    }

    /// Takes in what a neighbour said. A message of another phase still shows that somebody is there.
    ///
    /// # Errors
    /// With the reason, which is counted, when nothing can be concluded from it.
    pub fn hear(&mut self, from: VehicleId, message: &Message) -> Result<(), Refusal> {
        let heard = self.take(from, message);
        if let Err(refusal) = heard {
            self.refusals.count(refusal);
        }
        heard
    }

    /// What may be done in the round that has begun.
    #[must_use]
    pub const fn permit(&self) -> Permit {
        self.permit
    }

    /// What the vehicle says of itself in this phase.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// The last round in which it was permitted to move.
    #[must_use]
    pub fn moved(&self) -> Option<u32> {
        (self.moved > 0).then_some(self.moved)
    }

    /// The neighbours that it waits for.
    pub fn neighbours(&self) -> impl Iterator<Item = VehicleId> + '_ {
        self.neighbours.iter().map(|one| one.vehicle)
    }

    /// Whether it knows of a vehicle.
    #[must_use]
    pub fn knows(&self, vehicle: VehicleId) -> bool {
        self.place(vehicle).is_ok()
    }

    /// How often messages were refused, by reason.
    #[must_use]
    pub const fn refusals(&self) -> &Refusals {
        &self.refusals
    }

    fn message(&self, slot: Slot) -> Message {
        Message {
            round: slot.round(),
            phase: slot.phase(),
            state: self.state.code(),
            value: self.value,
            moved: self.moved,
        }
    }

    /// Forgets everybody and listens first: whoever knows nobody would else move at once.
    fn begin_anew(&mut self, round: u32) {
        self.listens_until = round.saturating_add(1 + LISTENING_ROUNDS);
        self.state = State::Resting;
        self.permit = Permit::Stay;
        // A move in what is now the future would be refused by everybody.
        if self.moved > round {
            self.moved = 0;
        }
        self.neighbours.clear();
    }

    /// Luby's step on what was heard in a phase.
    fn conclude_phase(&mut self, slot: Slot) {
        if self.state != State::Contending {
            return;
        }
        let own = (self.value, self.own);
        if self
            .neighbours
            .iter()
            .any(|one| one.joined_in(slot.round()))
        {
            self.state = State::Out;
        } else if self.neighbours.iter().all(|one| one.yields_to(own, slot)) {
            self.state = State::Joined;
        }
    }

    fn begin_round(&mut self, round: u32) {
        self.permit = if self.state == State::Joined {
            self.moved = round;
            Permit::Move
        } else {
            Permit::Stay
        };
        self.state = State::Resting;
        self.neighbours.retain(|one| !one.is_silent_in(round));
    }

    /// Whether it may take part: not while it moves, for it only then finds out whom it meets; and not before each
    /// neighbour has moved since it did, or together with it. Waiting goes from the later mover to the earlier and never
    /// in a circle.
    fn is_eligible(&self, round: u32) -> bool {
        let is_patient = round.saturating_sub(self.moved) <= PATIENCE_ROUNDS;
        let all_have_moved = || {
            let mut neighbours = self.neighbours.iter();
            neighbours.all(|one| one.has_moved_since(self.moved))
        };
        round >= self.listens_until
            && self.permit == Permit::Stay
            && (!is_patient || all_have_moved())
    }

    fn take(&mut self, from: VehicleId, message: &Message) -> Result<(), Refusal> {
        if from == self.own {
            return Err(Refusal::Own);
        }
        let now = self.now.ok_or(Refusal::OtherPhase)?;
        let (slot, state) = message.checked()?;
        let place = match self.place(from) {
            Ok(place) => place,
            Err(_) if self.neighbours.len() >= NEIGHBOURS_MAX => return Err(Refusal::Full),
            Err(place) => {
                self.neighbours.insert(place, Neighbour::new(from));
                place
            }
        };
        self.neighbours[place].hear(now, slot, state, message)
    }

    fn place(&self, vehicle: VehicleId) -> Result<usize, usize> {
        self.neighbours
            .binary_search_by_key(&vehicle, |one| one.vehicle)
    }
}

#[cfg(test)]
mod tests;
