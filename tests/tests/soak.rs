//! The short form of the soak: nothing that a fleet remembers grows, with every fault on. The long form is `skein-soak`.
#![allow(clippy::unwrap_used)]

use skein_estimation::cooperative::{Mode, Robust};
use skein_tests::soak::{Live, Virtual, VirtualSample};

/// The vehicle's own bound of neighbours, strangers' names among them.
const NEIGHBOURS_MAX: usize = 64;

#[test]
fn an_hour_of_every_fault_leaves_a_fleet_that_remembers_no_more_than_after_ten_minutes() {
    // The star is quick: `skein-soak` flies the default mode for as long.
    let mut flight = Virtual::new(1, Mode::Star(Robust::DEFAULT));
    // Everybody dies in turn, which takes 80 s: the most of several turns is compared, sampled at other moments of each.
    let mut ten_minutes = || -> Vec<VirtualSample> {
        let sample = |_| {
            flight.fly_s(7.0);
            flight.sample()
        };
        (0..86).map(sample).collect()
    };
    let phases: Vec<Vec<VirtualSample>> = (0..6).map(|_| ten_minutes()).collect();
    let most = |phase: &[VirtualSample]| phase.iter().map(|s| s.written_bytes).max();
    let written: Vec<f64> = phases.iter().map(|p| most(p).unwrap() as f64).collect();
    let last = phases.last().unwrap().last().unwrap();
    eprintln!("seed 1: at most {written:?} bytes in each ten minutes; in the end {last:?}");
    assert!(written[5] < 1.03 * written[0], "{written:?}");
    for sample in phases.iter().flatten() {
        assert!(sample.neighbours <= NEIGHBOURS_MAX, "{sample:?}");
        // A health in JSON of 64 neighbours with every word of refusal.
        assert!(sample.health_bytes < 65_536, "{sample:?}");
    }
    // One of four may just be dead and another just be back: the rest know where they are nearly always.
    let placed = |sample: &&VirtualSample| sample.placed >= 3;
    let samples = phases.iter().flatten();
    let share = samples.clone().filter(placed).count() as f64 / samples.count() as f64;
    assert!(share > 0.95, "{share}");
    // Forged packets are refused by the hundred, honest ones accepted, since the boot of each.
    assert!(last.refused > 500 && last.accepted > 500, "{last:?}");
}

#[test]
fn twenty_seconds_live_leave_no_file_open_no_thread_running_and_no_queue_full() {
    let mut flight = Live::start(1).unwrap();
    let mut samples = Vec::new();
    // Two restarts a phase: the first phase warms everything up.
    for _ in 0..2 {
        flight.fly_s(10).unwrap();
        samples.push(flight.sample());
        eprintln!("{:?}", samples.last().unwrap());
    }
    assert_eq!(samples[1].dropped, 0, "{samples:?}");
    assert_eq!(samples[1].restarts, 4, "{samples:?}");
    if let (Some(early), Some(late)) = (samples[0].footprint, samples[1].footprint) {
        // A link or a close more or less may be under way.
        assert!(late.files <= early.files + 10, "{samples:?}");
        assert!(late.threads <= early.threads + 5, "{samples:?}");
    }
    flight.stop().unwrap();
}
