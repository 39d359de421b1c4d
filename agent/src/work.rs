//! Long computations of the vehicle, run beside it: newest first, so what waits too long is dropped and counted.

use crate::clock::Clock;
use crate::inbox::Inbox;
use crate::queue::Queue;
use skein_vehicle::{Input, Work};

/// Computations that wait at most: one of either pipeline. A newer one makes an older one worthless.
pub(crate) const WORK_MAX: usize = 2;

/// Runs what is asked for until the queue is closed; results go the way of every other input.
pub(crate) fn run(work: &Queue<Box<Work>>, clock: &Clock, inbox: &Inbox) {
    while let Some(work) = work.pop() {
        let done = Some(Box::new(work.run()));
        let number = work.number();
        inbox.push(clock.now(), Input::Done { number, done });
    }
}
