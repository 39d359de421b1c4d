//! Why nothing was concluded from a message of the schedule, and how often.

/// Why a message was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// It has the receiver's own name.
    #[error("it carries this vehicle's own name")]
    Own,
    /// It speaks of another phase than the receiver's: delayed, or clocks differ.
    #[error("it speaks of another phase")]
    OtherPhase,
    /// A round has no such phase, or the round is zero.
    #[error("there is no such phase")]
    NoSuchPhase,
    /// There is no such state.
    #[error("there is no such state")]
    UnknownState,
    /// The sender says that it moved after the round of which it speaks.
    #[error("it says that its sender moved in the future")]
    MovedInTheFuture,
    /// The sender's last move is before the one that it had told of.
    #[error("its sender's last move is before the one told of earlier")]
    MovedBackwards,
    /// It differs from what the sender said in the same phase.
    #[error("it contradicts what its sender said in the same phase")]
    Contradicts,
    /// The sender takes back what it said was decided in the same round.
    #[error("its sender takes back what was decided in this round")]
    Undecides,
    /// There is no room for another neighbour.
    #[error("there is no room for another neighbour")]
    Full,
}

/// How often messages were refused. Counters stay at their greatest value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refusals {
    /// With the receiver's own name.
    pub own: u32,
    /// Of another phase.
    pub other_phase: u32,
    /// Of a phase that does not exist.
    pub no_such_phase: u32,
    /// Of a state that does not exist.
    pub unknown_state: u32,
    /// Moved in the future.
    pub moved_in_the_future: u32,
    /// The last move went backwards.
    pub moved_backwards: u32,
    /// Two messages of one phase.
    pub contradicts: u32,
    /// A decision taken back.
    pub undecides: u32,
    /// Of one neighbour too many.
    pub full: u32,
}

impl Refusals {
    pub(super) fn count(&mut self, refusal: Refusal) {
        let counter = match refusal {
            Refusal::Own => &mut self.own,
            Refusal::OtherPhase => &mut self.other_phase,
            Refusal::NoSuchPhase => &mut self.no_such_phase,
            Refusal::UnknownState => &mut self.unknown_state,
            Refusal::MovedInTheFuture => &mut self.moved_in_the_future,
            Refusal::MovedBackwards => &mut self.moved_backwards,
            Refusal::Contradicts => &mut self.contradicts,
            Refusal::Undecides => &mut self.undecides,
            Refusal::Full => &mut self.full,
        };
        *counter = counter.saturating_add(1);
    }
}
