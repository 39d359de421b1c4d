//! What a vehicle remembers of one neighbour in the schedule.

use super::SILENT_ROUNDS_MAX;
use super::message::{ENTRY_PHASES, Message, Slot, State};
use super::refusal::Refusal;
use crate::vehicle_id::VehicleId;

#[derive(Clone, Debug)]
pub(super) struct Neighbour {
    pub(super) vehicle: VehicleId,
    /// The last round in which it moved; zero when there was none.
    moved: u32,
    /// The own round in which anything was heard of it last.
    heard_in: u32,
    /// What was taken in last.
    last: Option<Said>,
    /// The last round in which it said that it had joined.
    joined: u32,
    /// The last round in which it said that it will not join.
    abstained: u32,
}

#[derive(Clone, Copy, Debug)]
struct Said {
    slot: Slot,
    state: State,
    value: u32,
}

impl Neighbour {
    pub(super) const fn new(vehicle: VehicleId) -> Self {
        Self {
            vehicle,
            moved: 0,
            heard_in: 0,
            last: None,
            joined: 0,
            abstained: 0,
        }
    }

    /// Takes in a message that is well formed, of `slot` and `state`.
    pub(super) fn hear(
        &mut self,
        now: Slot,
        slot: Slot,
        state: State,
        message: &Message,
    ) -> Result<(), Refusal> {
        // Whoever speaks is there, whatever its clock says.
        self.heard_in = now.round();
        if slot != now {
            return Err(Refusal::OtherPhase);
        }
        if message.moved < self.moved && message.moved != 0 {
            return Err(Refusal::MovedBackwards);
        }
        if let Some(last) = self.last {
            let is_repeated = (state, message.value) == (last.state, last.value);
            if last.slot == slot && !(is_repeated && message.moved == self.moved) {
                return Err(Refusal::Contradicts);
            }
            // What is decided stays so for its round; only who has started anew rests again.
            let was_decided = [self.joined, self.abstained].contains(&slot.round());
            if was_decided && state != last.state && state != State::Resting {
                return Err(Refusal::Undecides);
            }
        }
        self.moved = message.moved;
        match state {
            State::Joined => self.joined = slot.round(),
            State::Out => self.abstained = slot.round(),
            State::Resting if slot.phase() >= ENTRY_PHASES => self.abstained = slot.round(),
            State::Resting | State::Contending => {}
        }
        self.last = Some(Said {
            slot,
            state,
            value: message.value,
        });
        Ok(())
    }

    /// It said that it moves in the round after this.
    pub(super) const fn joined_in(&self, round: u32) -> bool {
        self.joined == round
    }

    /// It moved in no earlier round than `round`, or is about to.
    pub(super) const fn has_moved_since(&self, round: u32) -> bool {
        // Who joined in one round moves in the next.
        self.moved >= round || self.joined >= round
    }

    /// In this very phase it said that it does not stand in the way of a contender with this value and name, or in this
    /// round that it will not.
    pub(super) fn yields_to(&self, contender: (u32, VehicleId), slot: Slot) -> bool {
        let abstains = self.abstained == slot.round();
        abstains
            || self.last.is_some_and(|said| {
                said.slot == slot
                    && match said.state {
                        State::Resting | State::Out => true,
                        State::Contending => (said.value, self.vehicle) < contender,
                        State::Joined => false,
                    }
            })
    }

    /// Nothing was heard of it for so long, when this round begins, that it must be gone.
    pub(super) const fn is_silent_in(&self, round: u32) -> bool {
        round.saturating_sub(self.heard_in) > SILENT_ROUNDS_MAX
    }
}
