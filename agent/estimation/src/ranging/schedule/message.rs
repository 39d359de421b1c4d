//! What vehicles tell each other to agree on who moves, and the numbering of the phases in which they do.

use super::refusal::Refusal;

/// Phases of a round: so many that a round of a hundred vehicles with eight neighbours each, losing 4 % of the messages,
/// seldom ends before the set is maximal.
pub const PHASES: u8 = 10;

/// Who does not contend in one of so many first phases of a round takes no part in it: so a message lost at its beginning
/// costs nothing, and what a resting vehicle says later holds for the round.
pub const ENTRY_PHASES: u8 = 2;

/// One phase of one round. Later ones are greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot {
    round: u32,
    phase: u8,
}

impl Slot {
    /// Fails when a round has no such phase, or the round is zero: rounds are numbered from one.
    #[must_use]
    pub fn new(round: u32, phase: u8) -> Option<Self> {
        (phase < PHASES && round > 0).then_some(Self { round, phase })
    }

    /// Of which round.
    #[must_use]
    pub const fn round(self) -> u32 {
        self.round
    }

    /// Which of the round, from zero.
    #[must_use]
    pub const fn phase(self) -> u8 {
        self.phase
    }
}

/// What a vehicle is in the election of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It takes no part: it listens, moves, or waits for its neighbours to have moved.
    Resting,
    /// It takes part, and has not been decided upon.
    Contending,
    /// It moves in the next round.
    Joined,
    /// A neighbour does.
    Out,
}

impl State {
    /// As a message has it.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Resting => 0,
            Self::Contending => 1,
            Self::Joined => 2,
            Self::Out => 3,
        }
    }

    /// The state of a code, if there is one.
    #[must_use]
    pub const fn of_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Resting),
            1 => Some(Self::Contending),
            2 => Some(Self::Joined),
            3 => Some(Self::Out),
            _ => None,
        }
    }
}

/// What one vehicle says in one phase: 14 bytes. As it comes off the network: nothing in it has been checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message {
    /// Of which round it speaks, numbered from one.
    pub round: u32,
    /// Of which of its phases.
    pub phase: u8,
    /// The code of the sender's [`State`] when the phase began.
    pub state: u8,
    /// The sender's draw of this phase; the greater wins, of equal ones the greater vehicle.
    pub value: u32,
    /// The last round in which the sender was permitted to move; zero when there was none.
    pub moved: u32,
}

impl Message {
    /// What it says, unless it says what no vehicle could.
    pub(super) fn checked(&self) -> Result<(Slot, State), Refusal> {
        let slot = Slot::new(self.round, self.phase).ok_or(Refusal::NoSuchPhase)?;
        let state = State::of_code(self.state).ok_or(Refusal::UnknownState)?;
        if self.moved > self.round {
            return Err(Refusal::MovedInTheFuture);
        }
        Ok((slot, state))
    }
}
