//! The schedule that needs no messages (Cornejo & Nagpal, section IV-A): in round i robot i moves, all others stand still.

use super::Permit;

/// What the `index`th of so many robots may do in a round. Nobody moves when there is no such robot.
#[must_use]
pub fn round_robin(index: usize, robots: usize, round: u32) -> Permit {
    let is_its_turn = index < robots && round as usize % robots == index;
    if is_its_turn {
        Permit::Move
    } else {
        Permit::Stay
    }
}
