//! Messages that no honest vehicle sends, and clocks that jump.

use super::super::*;

const NEIGHBOUR: VehicleId = VehicleId(2);

fn slot(round: u32, phase: u8) -> Slot {
    Slot::new(round, phase).unwrap()
}

/// A vehicle in the second phase of round 10, the first of those in which it takes part.
fn listener() -> Scheduler {
    let mut own = Scheduler::new(VehicleId(1));
    for round in 8..10 {
        for phase in 0..PHASES {
            own.begin_phase(slot(round, phase), 7);
        }
    }
    own.begin_phase(slot(10, 1), 7);
    own
}

fn said(state: State) -> Message {
    Message {
        round: 10,
        phase: 1,
        state: state.code(),
        value: 3,
        moved: 4,
    }
}

#[test]
fn what_no_vehicle_could_say_is_refused_and_counted() {
    let mut own = listener();
    let good = said(State::Contending);
    let cases = [
        (Message { round: 0, ..good }, Refusal::NoSuchPhase),
        (
            Message {
                phase: PHASES,
                ..good
            },
            Refusal::NoSuchPhase,
        ),
        (Message { state: 4, ..good }, Refusal::UnknownState),
        (Message { state: 255, ..good }, Refusal::UnknownState),
        (Message { moved: 11, ..good }, Refusal::MovedInTheFuture),
        (
            Message {
                moved: u32::MAX,
                ..good
            },
            Refusal::MovedInTheFuture,
        ),
    ];
    for (message, refusal) in cases {
        assert_eq!(own.hear(NEIGHBOUR, &message), Err(refusal));
    }
    assert_eq!(own.hear(VehicleId(1), &good), Err(Refusal::Own));
    assert!(!own.knows(NEIGHBOUR) && !own.knows(VehicleId(1)));
    let counted = Refusals {
        own: 1,
        no_such_phase: 2,
        unknown_state: 2,
        moved_in_the_future: 2,
        ..Refusals::default()
    };
    assert_eq!(*own.refusals(), counted);
}

#[test]
fn a_neighbour_of_another_time_is_waited_for_but_not_believed() {
    let mut own = listener();
    for (round, phase) in [(9, 1), (11, 1), (u32::MAX, 9), (10, 0), (10, 2)] {
        let message = Message {
            round,
            phase,
            ..said(State::Joined)
        };
        assert_eq!(own.hear(NEIGHBOUR, &message), Err(Refusal::OtherPhase));
    }
    assert_eq!(own.refusals().other_phase, 5);
    assert!(own.knows(NEIGHBOUR));
    // It is there, and has said nothing of this phase: nobody may move.
    own.begin_phase(slot(10, 2), 7);
    assert_eq!(own.state(), State::Contending);
}

#[test]
fn a_neighbour_that_says_two_things_in_one_phase_is_held_to_the_first() {
    let mut own = listener();
    own.hear(NEIGHBOUR, &said(State::Contending)).unwrap();
    own.hear(NEIGHBOUR, &said(State::Contending)).unwrap();
    let others = [
        said(State::Joined),
        Message {
            value: 4,
            ..said(State::Contending)
        },
        Message {
            moved: 5,
            ..said(State::Contending)
        },
    ];
    for other in others {
        assert_eq!(own.hear(NEIGHBOUR, &other), Err(Refusal::Contradicts));
    }
    assert_eq!(own.refusals().contradicts, 3);
    own.begin_phase(slot(10, 2), 7);
    assert_eq!(own.state(), State::Joined);
}

#[test]
fn what_was_decided_is_not_taken_back_in_its_round_and_a_last_move_does_not_go_backwards() {
    let mut own = listener();
    own.hear(NEIGHBOUR, &said(State::Out)).unwrap();
    own.begin_phase(slot(10, 2), 7);
    for withdrawn in [State::Contending, State::Joined] {
        let message = Message {
            phase: 2,
            ..said(withdrawn)
        };
        assert_eq!(own.hear(NEIGHBOUR, &message), Err(Refusal::Undecides));
    }
    let earlier = Message {
        phase: 2,
        moved: 3,
        ..said(State::Out)
    };
    assert_eq!(own.hear(NEIGHBOUR, &earlier), Err(Refusal::MovedBackwards));
    assert_eq!(
        (own.refusals().undecides, own.refusals().moved_backwards),
        (2, 1)
    );
    // Whoever starts anew rests and has moved in no round.
    let anew = Message {
        phase: 2,
        moved: 0,
        ..said(State::Resting)
    };
    own.hear(NEIGHBOUR, &anew).unwrap();
}

#[test]
fn there_is_room_for_so_many_neighbours_and_not_for_one_more() {
    let mut own = listener();
    for index in 0..NEIGHBOURS_MAX as u64 {
        own.hear(VehicleId(100 + index), &said(State::Resting))
            .unwrap();
    }
    assert_eq!(
        own.hear(NEIGHBOUR, &said(State::Joined)),
        Err(Refusal::Full)
    );
    assert_eq!(
        (own.refusals().full, own.neighbours().count()),
        (1, NEIGHBOURS_MAX)
    );
}

#[test]
fn a_vehicle_whose_clock_jumps_stands_still_and_listens_first() {
    for (round, phase) in [(10, 0), (9, 9), (3, 0), (12, 0), (u32::MAX, 9)] {
        let mut own = listener();
        own.hear(NEIGHBOUR, &said(State::Resting)).unwrap();
        own.begin_phase(slot(10, 2), 7);
        assert_eq!(own.state(), State::Joined);
        own.begin_phase(slot(round, phase), 7);
        assert_eq!((own.state(), own.permit()), (State::Resting, Permit::Stay));
        assert!(own.moved().is_none_or(|moved| moved <= round));
    }
}

#[test]
fn nothing_is_heard_before_the_first_phase_has_begun() {
    let mut own = Scheduler::new(VehicleId(1));
    assert_eq!(
        own.hear(NEIGHBOUR, &said(State::Resting)),
        Err(Refusal::OtherPhase)
    );
    assert!(!own.knows(NEIGHBOUR));
}

#[test]
fn a_vehicle_whose_clock_differs_from_all_others_never_takes_itself_for_alone() {
    let mut own = listener();
    for round in 11..40 {
        for phase in 0..PHASES {
            own.begin_phase(slot(round, phase), 7);
            assert!(round == 11 || own.permit() == Permit::Stay);
        }
        let of_five_rounds_ago = Message {
            round: round - 5,
            phase: 0,
            ..said(State::Resting)
        };
        let heard = own.hear(NEIGHBOUR, &of_five_rounds_ago);
        assert_eq!(heard, Err(Refusal::OtherPhase));
    }
}
