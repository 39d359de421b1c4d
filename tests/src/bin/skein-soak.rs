//! `skein-soak virtual [MINUTES]` and `skein-soak live [MINUTES]`: long flights with every fault on, one line a sample.
//! Ends with 1 when something grew from the second quarter of the flight to its end.
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "tables are what this program is for"
)]

use skein_estimation::cooperative::Mode;
use skein_tests::soak::{Footprint, Live, Virtual};
use std::process::ExitCode;

const USAGE: &str =
    "usage: skein-soak virtual [MINUTES, default 60] | skein-soak live [MINUTES, default 10]";
/// Samples of one flight.
const SAMPLES: u64 = 40;
/// How much more memory than in the second quarter of the flight is no growth.
const GROWTH_MAX: f64 = 0.05;

/// The C library gives threads memory pools of their own, by default up to eight for each processor. Agents that come and
/// go in one process spread what is freed over all of them, which looks like growth for an hour; a vehicle starts its
/// threads once. With one pool only what is really kept grows.
const ONE_POOL: (&str, &str) = ("MALLOC_ARENA_MAX", "1");

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let minutes = |given: &[&str], usual: u64| match given {
        [] => Some(usual),
        [minutes] => minutes.parse().ok().filter(|minutes| *minutes > 0),
        _ => None,
    };
    let flown = match words.as_slice() {
        ["virtual", given @ ..] => minutes(given, 60).map(|minutes| Ok(fly_virtually(minutes))),
        ["live", given @ ..] => minutes(given, 10).map(|minutes| {
            if std::env::var_os(ONE_POOL.0).is_none() {
                return again_with_one_pool(&words);
            }
            fly_live(minutes)
        }),
        _ => None,
    };
    match flown {
        None => {
            eprintln!("{USAGE}");
            ExitCode::from(2)
        }
        Some(Ok(true)) => ExitCode::SUCCESS,
        Some(Ok(false)) => ExitCode::FAILURE,
        Some(Err(error)) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Flies in a process of its own, as the pools are counted before the program begins. Whether that ended with 0.
fn again_with_one_pool(words: &[&str]) -> Result<bool, Box<dyn std::error::Error + Send + Sync>> {
    let flight = std::process::Command::new(std::env::current_exe()?)
        .args(words)
        .env(ONE_POOL.0, ONE_POOL.1)
        .status()?;
    Ok(flight.success())
}

/// A number of every sample, and how much of it there may be at the end.
struct Watched {
    what: &'static str,
    samples: Vec<f64>,
    growth_max: f64,
}

impl Watched {
    fn new(what: &'static str, growth_max: f64) -> Self {
        Self {
            what,
            samples: Vec::new(),
            growth_max,
        }
    }

    /// Whether the most in the last quarter is no more than that in the second, with what is allowed. The first quarter
    /// warms up: pools, caches and allocators find their size.
    fn is_flat(&self) -> bool {
        let quarter = self.samples.len() / 4;
        let most = |samples: &[f64]| samples.iter().copied().fold(0.0, f64::max);
        let early = most(&self.samples[quarter..2 * quarter]);
        let late = most(&self.samples[3 * quarter..]);
        let is_flat = late <= early * (1.0 + self.growth_max);
        let verdict = if is_flat { "flat" } else { "GROWS" };
        println!(
            "{}: at most {early:.2} in the second quarter, {late:.2} in the last: {verdict}",
            self.what
        );
        is_flat
    }
}

fn mib(footprint: Option<Footprint>) -> f64 {
    footprint.map_or(0.0, |footprint| {
        footprint.resident_bytes as f64 / f64::from(1 << 20)
    })
}

fn fly_virtually(minutes: u64) -> bool {
    let mut flight = Virtual::new(1, Mode::default());
    let mut memory = Watched::new("resident MiB", GROWTH_MAX);
    let mut written = Watched::new("bytes of everything remembered, as text", GROWTH_MAX);
    println!(
        "flown_s resident_mib remembered_bytes health_bytes neighbours placed error_m accepted refused"
    );
    for _ in 0..SAMPLES {
        flight.fly_s((minutes * 60) as f64 / SAMPLES as f64);
        let sample = flight.sample();
        memory.samples.push(mib(sample.footprint));
        written.samples.push(sample.written_bytes as f64);
        println!(
            "{:.0} {:.2} {} {} {} {} {:.2} {} {}",
            sample.flown_s,
            mib(sample.footprint),
            sample.written_bytes,
            sample.health_bytes,
            sample.neighbours,
            sample.placed,
            sample.error_m,
            sample.accepted,
            sample.refused
        );
    }
    [memory, written].iter().all(Watched::is_flat)
}

fn fly_live(minutes: u64) -> Result<bool, Box<dyn std::error::Error + Send + Sync>> {
    let mut flight = Live::start(1)?;
    let mut memory = Watched::new("resident MiB", GROWTH_MAX);
    let mut files = Watched::new("open files", 0.1);
    let mut threads = Watched::new("threads", 0.1);
    let mut dropped = Watched::new("drops of full queues", 0.0);
    println!("flown_s resident_mib files threads dropped tracking restarts");
    let seconds = (minutes * 60 / SAMPLES).max(1);
    for _ in 0..SAMPLES {
        flight.fly_s(seconds)?;
        let sample = flight.sample();
        let (open, running) = sample
            .footprint
            .map_or((0, 0), |footprint| (footprint.files, footprint.threads));
        memory.samples.push(mib(sample.footprint));
        files.samples.push(open as f64);
        threads.samples.push(running as f64);
        dropped.samples.push(sample.dropped as f64);
        println!(
            "{} {:.2} {open} {running} {} {} {}",
            sample.flown_s,
            mib(sample.footprint),
            sample.dropped,
            sample.tracking,
            sample.restarts
        );
    }
    flight.stop()?;
    let flat: Vec<bool> = [memory, files, threads, dropped]
        .iter()
        .map(Watched::is_flat)
        .collect();
    Ok(flat.iter().all(|flat| *flat))
}
