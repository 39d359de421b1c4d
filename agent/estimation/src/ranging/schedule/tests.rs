//! The stories of the motion schedule.

mod hostile;
mod swarm;

use super::*;
use swarm::Swarm;

#[test]
fn neighbours_that_know_each_other_never_move_together_whatever_is_lost() {
    for loss in [0.0, 0.2, 0.4] {
        let mut swarm = Swarm::grid(4, loss, 7);
        for round in 0..1500 {
            if round % 40 == 0 {
                swarm.crash(round / 40 % 16);
            }
            if round % 40 == 20 {
                swarm.start(round / 40 % 16);
            }
            swarm.run(1);
        }
        assert_eq!(swarm.conflicts, 0, "with a loss of {loss}");
        assert!(swarm.moves > 1500, "{} moves", swarm.moves);
    }
}

#[test]
fn without_loss_nobody_waits_longer_than_it_has_neighbours() {
    let mut swarm = Swarm::grid(10, 0.0, 3);
    swarm.run(300);
    assert!(
        swarm.first_wait_rounds_max <= 8,
        "{}",
        swarm.first_wait_rounds_max
    );
    assert!(
        swarm.eligible_wait_rounds_max <= 8,
        "{}",
        swarm.eligible_wait_rounds_max
    );
}

#[test]
fn a_hundred_with_eight_neighbours_each_have_all_moved_after_twelve_rounds_of_a_lossy_radio() {
    for seed in 0..10 {
        let mut swarm = Swarm::grid(10, 0.2, seed);
        swarm.repeats = 2;
        // The first rounds only listen: they are not counted as waiting.
        swarm.run(1 + LISTENING_ROUNDS + 12);
        let still: Vec<usize> = (0..100).filter(|one| swarm.moved(*one) == 0).collect();
        assert!(still.is_empty(), "seed {seed}: {still:?} have not moved");
    }
}

#[test]
fn a_crashed_neighbour_holds_up_the_others_for_some_rounds_and_is_forgotten() {
    let mut pair = Swarm::line(2, 0.0, 1);
    pair.run(10);
    pair.crash(1);
    pair.run(SILENT_ROUNDS_MAX + 1);
    assert!(!pair.knows(0, 1));
    let before = pair.moved(0);
    pair.run(6);
    // Alone, it listens in every round in which it moves.
    assert_eq!(pair.moved(0) - before, 3);
}

#[test]
fn a_newcomer_listens_for_a_round_and_then_takes_its_turn() {
    let mut pair = Swarm::line(2, 0.0, 1);
    pair.crash(1);
    pair.run(7);
    pair.start(1);
    pair.run(1 + LISTENING_ROUNDS);
    assert_eq!(pair.moved(1), 0);
    assert!(pair.knows(0, 1) && pair.knows(1, 0));
    pair.run(2);
    assert_eq!(pair.moved(1), 1);
    assert_eq!(pair.conflicts, 0);
}

#[test]
fn a_vehicle_that_has_moved_waits_until_its_neighbour_has() {
    let mut pair = Swarm::line(2, 0.0, 5);
    pair.run(2 + LISTENING_ROUNDS);
    for _ in 0..50 {
        pair.run(1);
        assert!(pair.moved(0).abs_diff(pair.moved(1)) <= 1);
    }
    assert!(pair.moved(0) + pair.moved(1) >= 49);
}

#[test]
fn two_that_meet_while_both_move_are_apart_again_in_the_next_round() {
    let mut pair = Swarm::line(2, 0.0, 1);
    pair.disconnect(0, 1);
    // Alone, both move at once.
    while pair.permit(0) != Permit::Move {
        pair.run(1);
    }
    assert_eq!(pair.permit(1), Permit::Move);
    pair.connect(0, 1);
    pair.run(1);
    assert_ne!(
        (pair.permit(0), pair.permit(1)),
        (Permit::Move, Permit::Move)
    );
    // Having moved together, neither waits for the other: one of them moves next.
    pair.run(1);
    assert_ne!(pair.permit(0), pair.permit(1));
    assert_eq!(pair.conflicts, 0);
}

#[test]
fn a_neighbour_that_never_takes_part_holds_up_nobody_for_ever() {
    let mut own = Scheduler::new(VehicleId(1));
    let mut moves = Vec::new();
    for round in 1..300 {
        for phase in 0..PHASES {
            own.begin_phase(Slot::new(round, phase).unwrap(), 5);
            let parked = Message {
                round,
                phase,
                state: State::Resting.code(),
                value: 0,
                moved: 0,
            };
            own.hear(VehicleId(2), &parked).unwrap();
        }
        if own.permit() == Permit::Move {
            moves.push(round);
        }
    }
    let between = moves.windows(2).map(|pair| pair[1] - pair[0]);
    assert!(moves.len() > 3, "{moves:?}");
    assert!(
        between.clone().all(|rounds| rounds == PATIENCE_ROUNDS + 2),
        "{moves:?}"
    );
}

#[test]
fn in_round_robin_each_robot_has_its_own_round() {
    let movers = |round| -> Vec<usize> {
        (0..5)
            .filter(|index| round_robin(*index, 5, round) == Permit::Move)
            .collect()
    };
    assert_eq!(
        (3..8).map(movers).collect::<Vec<_>>(),
        [[3], [4], [0], [1], [2]]
    );
    assert_eq!(round_robin(0, 0, 3), Permit::Stay);
    assert_eq!(round_robin(5, 5, 5), Permit::Stay);
}
