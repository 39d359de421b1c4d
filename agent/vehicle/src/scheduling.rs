//! This vehicle's part in the motion schedule: phases by its own clock, one message in every round record, and whether it
//! may move.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use skein_estimation::VehicleId;
use skein_estimation::ranging::schedule::{Message, PHASES, Permit, Refusal, Scheduler, Slot};
use skein_estimation::time::{Span, Stamp};
use skein_proto::document;
use skein_proto::document::{MotionDocument, ScheduleHealth};
use skein_proto::name::Name;
use skein_proto::record::Schedule;

use crate::counters::Counters;
use crate::neighbours::Neighbours;

/// Periods of the rounds in a phase: what is said in it is said so often, so that a lost packet loses nothing.
const PERIODS_PER_PHASE: i64 = 2;

/// The schedule of one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Scheduling {
    scheduler: Scheduler,
    phase: Span,
    /// Draws, one for each phase.
    chance: ChaCha8Rng,
    slot: Option<Slot>,
    moves: u64,
    /// The round of the last permit to move that was counted.
    counted: u32,
    refused: Counters,
}

impl Scheduling {
    pub(crate) fn new(me: Name, boot: u64, period: Span) -> Self {
        Self {
            scheduler: Scheduler::new(VehicleId(me.hash())),
            phase: period * PERIODS_PER_PHASE,
            chance: ChaCha8Rng::seed_from_u64(me.hash() ^ boot),
            slot: None,
            moves: 0,
            counted: 0,
            refused: Counters::default(),
        }
    }

    /// What is said at this instant. True when the permit is another than before.
    pub(crate) fn speak(&mut self, at: Stamp) -> Option<(Schedule, bool)> {
        let slot = self.slot_of(at)?;
        let before = self.permit();
        let message = self.scheduler.begin_phase(slot, self.chance.next_u32());
        self.slot = Some(slot);
        let permit = self.permit();
        if permit == Permit::Move && self.counted != slot.round() {
            self.counted = slot.round();
            self.moves += 1;
        }
        let said = Schedule {
            round: message.round,
            phase: u16::from(message.phase),
            state: message.state,
            draw: u64::from(message.value),
            moves: message.moved,
        };
        Some((said, permit != before))
    }

    /// Takes what a neighbour said. What cannot be used is counted.
    pub(crate) fn hear(&mut self, from: VehicleId, said: &Schedule) {
        // A phase or a draw beyond what there is says what no vehicle could.
        let message = Message {
            round: said.round,
            phase: u8::try_from(said.phase).unwrap_or(u8::MAX),
            state: said.state,
            value: u32::try_from(said.draw).unwrap_or(u32::MAX),
            moved: said.moves,
        };
        if let Err(why) = self.scheduler.hear(from, &message) {
            self.refused.count(word(why));
        }
    }

    fn permit(&self) -> Permit {
        self.scheduler.permit()
    }

    /// For the vehicle's controller.
    pub(crate) fn to_document(&self) -> MotionDocument {
        MotionDocument {
            permit: match self.permit() {
                Permit::Move => document::Permit::Move,
                Permit::Stay => document::Permit::Stay,
            },
            round: self.slot.map_or(0, Slot::round),
        }
    }

    /// For the health.
    pub(crate) fn to_health(&self, neighbours: &Neighbours) -> ScheduleHealth {
        let waits_for = |name: &Name| self.scheduler.knows(VehicleId(name.hash()));
        ScheduleHealth {
            round: self.slot.map_or(0, Slot::round),
            moves: self.moves,
            neighbours: neighbours
                .iter()
                .filter(|(name, _)| waits_for(name))
                .map(|(name, _)| name.to_string())
                .collect(),
            refused: self.refused.to_document(),
        }
    }

    /// The phase of an instant of this vehicle's clock. Rounds are numbered from one.
    fn slot_of(&self, at: Stamp) -> Option<Slot> {
        let phase = at.as_nanos().div_euclid(self.phase.as_nanos());
        let phases = i64::from(PHASES);
        let round = u32::try_from(phase.div_euclid(phases) + 1).ok()?;
        let phase = u8::try_from(phase.rem_euclid(phases)).ok()?;
        Slot::new(round, phase)
    }
}

/// One word for the health.
const fn word(why: Refusal) -> &'static str {
    match why {
        Refusal::Own => "own_name",
        Refusal::OtherPhase => "other_phase",
        Refusal::NoSuchPhase => "no_such_phase",
        Refusal::UnknownState => "unknown_state",
        Refusal::MovedInTheFuture => "moved_in_the_future",
        Refusal::MovedBackwards => "moved_backwards",
        Refusal::Contradicts => "contradicts",
        Refusal::Undecides => "takes_back",
        Refusal::Full => "full",
    }
}
