//! The schedule study, a little of it.

use super::*;

#[test]
fn in_a_swarm_that_drives_crashes_and_loses_messages_no_two_that_know_each_other_move_together() {
    for loss in LOSSES {
        let run = long_run(loss, 1000, 1, || {});
        assert_eq!((run.conflicts, run.unresolved), (0, 0), "{run:?}");
        assert!(run.crashes > 50 && run.joins > 50, "{run:?}");
        assert!(run.met_while_moving > 0, "{run:?}");
        assert!(run.moving > 0.05, "{run:?}");
    }
}

#[test]
fn a_hundred_robots_with_eight_neighbours_have_moved_within_twelve_rounds_in_spite_of_loss() {
    let cell = Cell {
        robots: 100,
        degree: 8.0,
        loss: 0.2,
        repeats: 2,
    };
    let request = Request {
        samples: 10,
        seed: 1,
        rounds: 0,
    };
    let result = run(&cell, &request, || {});
    assert!(result.all_moved_rounds_max <= 12, "{result:?}");
}

#[test]
fn without_loss_no_wait_is_longer_than_there_are_neighbours() {
    let cell = cells()[2];
    let request = Request {
        samples: 10,
        seed: 1,
        rounds: 0,
    };
    let result = run(&cell, &request, || {});
    assert_eq!((cell.robots, cell.loss), (100, 0.0));
    assert_eq!(result.first_waits_beyond_degree, 0.0);
    assert_eq!(result.waits_beyond_degree, 0.0);
    assert!(result.all_moved_rounds < 25.0, "round robin takes 100");
}
