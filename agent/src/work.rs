//! Long computations of the vehicle, run beside it: newest first, so what waits too long is dropped and counted.

use crate::clock::Clock;
use crate::inbox::Inbox;
use crate::queue::Queue;
use skein_estimation::mutual::Work;
use skein_vehicle::Input;

/// Computations that wait at most: a newer one makes an older one worthless.
pub(crate) const WORK_MAX: usize = 1;

/// Runs what is asked for until the queue is closed; results go the way of every other input.
pub(crate) fn run(work: &Queue<Box<Work>>, clock: &Clock, inbox: &Inbox) {
    while let Some(work) = work.pop() {
        let done = Some(Box::new(work.run()));
        let number = work.number();
        inbox.push(clock.now(), Input::Done { number, done });
    }
}
