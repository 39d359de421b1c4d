//! `skein watch`: follows the estimates of one vehicle or of all as they are published, until it is told to stop.
//!
//! Three threads share the work: Zenoh's put what they hear into a bounded channel, one writes, and the first waits for
//! signals, so that a reader who no longer reads cannot keep the command from ending.

mod board;

use super::Ending;
use super::observer::{Observer, ObserverArgs, seconds};
use super::output::plain;
use crate::clock::{Clock, real_now};
use board::Board;
use miette::{IntoDiagnostic, WrapErr, miette};
use skein_proto::document::EstimateDocument;
use skein_proto::keys::{Key, select};
use skein_proto::limits::DOCUMENT_BYTES_MAX;
use skein_proto::name::Name;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};
use zenoh::Wait;
use zenoh::sample::{Sample, SampleKind};

/// What was heard and is not yet written, at most: a second of a large fleet. More is dropped and counted.
const HEARD_MAX: usize = 1_024;
/// How often a table on a terminal is drawn.
const DRAW_EVERY: Duration = Duration::from_millis(200);
/// After so long without a vehicle it is said what may be wrong.
const HINT_AFTER: Duration = Duration::from_secs(5);
/// How long the writer may take to finish its last line.
const FINISH_WITHIN: Duration = Duration::from_millis(300);

#[derive(clap::Args)]
#[command(after_help = "Examples:
  skein watch                        the whole fleet, a table that is refreshed in place
  skein watch v1 --every 5 >> v1.txt   a line at each change of status or neighbours, and every 5 s
  skein watch --json --for 60        a minute of estimates, one JSON object a line
It ends with 0 at Ctrl-C, at SIGTERM and when its reader goes; with 3 when --for passes and nothing was heard.")]
pub(super) struct WatchArgs {
    /// The vehicle; all of the fleet without it.
    vehicle: Option<Name>,
    /// Print each estimate as it was published, one JSON object a line (NDJSON), as documented in ZENOH_API.md.
    #[arg(long)]
    json: bool,
    /// End after so many seconds.
    #[arg(long = "for", value_name = "SECONDS", value_parser = seconds)]
    duration: Option<Duration>,
    /// When the output is no terminal: seconds between two lines of a vehicle for which nothing changed.
    #[arg(long, default_value = "1", value_name = "SECONDS", value_parser = seconds)]
    every: Duration,
    #[command(flatten)]
    observer: ObserverArgs,
}

/// What Zenoh's threads tell the writer.
enum Heard {
    Estimate { key: Name, bytes: Vec<u8> },
    Appeared { vehicle: Name, boot: u64 },
    Vanished { vehicle: Name, boot: u64 },
}

/// What the threads count for each other.
#[derive(Default)]
struct Counts {
    estimates: AtomicU64,
    missed: AtomicU64,
    strange: AtomicU64,
    stop: AtomicBool,
}

pub(super) fn run(args: &WatchArgs) -> miette::Result<Ending> {
    let (network, fleet) = (args.observer.network(), args.observer.fleet());
    let observer = Observer::open(&network, fleet, HINT_AFTER)?;
    let counts = Arc::new(Counts::default());
    let (sender, heard) = sync_channel(HEARD_MAX);
    listen(&observer, fleet, args.vehicle, &sender, &counts)
        .map_err(|error| miette!("Zenoh refuses the subscription: {error}"))?;
    let writer = Writer {
        style: if args.json {
            Style::Json
        } else if std::io::stdout().is_terminal() {
            Style::Table
        } else {
            Style::Lines
        },
        every: args.every,
        clock: Clock::real(),
        counts: Arc::clone(&counts),
    };
    let (finished, finish) = tokio::sync::oneshot::channel();
    std::thread::Builder::new()
        .name("skein-watch".to_owned())
        .spawn(move || {
            // Nobody waits for it any more when the process is already ending.
            let _ = finished.send(writer.run(&heard));
        })
        .into_diagnostic()?;
    // For the signals, as in `skein run`; of more than one thread, because Zenoh is asked for its peers inside.
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .into_diagnostic()?;
    let ending = runtime.block_on(until_told(args, &observer, &counts, finish));
    let missed = counts.missed.load(Ordering::Relaxed);
    if missed > 0 {
        eprintln!("{missed} publications are not shown: the output was not read fast enough");
    }
    let strange = counts.strange.load(Ordering::Relaxed);
    if strange > 0 {
        eprintln!("{strange} publications were no estimates of the vehicle in their key");
    }
    ending
}

/// Subscribes to estimates and tokens.
fn listen(
    observer: &Observer,
    fleet: Name,
    vehicle: Option<Name>,
    sender: &SyncSender<Heard>,
    counts: &Arc<Counts>,
) -> zenoh::Result<()> {
    let selector = match vehicle {
        Some(of) => Key::Estimate { of }.in_fleet(fleet),
        None => select::estimates(fleet),
    };
    eprintln!("selector: {selector}");
    let tell = |sender: SyncSender<Heard>, counts: Arc<Counts>| {
        move |sample: Sample| {
            let Some(heard) = understand(&sample, vehicle) else {
                counts.strange.fetch_add(1, Ordering::Relaxed);
                return;
            };
            if let Err(TrySendError::Full(_)) = sender.try_send(heard) {
                counts.missed.fetch_add(1, Ordering::Relaxed);
            }
        }
    };
    observer
        .session()
        .declare_subscriber(selector)
        .callback(tell(sender.clone(), Arc::clone(counts)))
        .background()
        .wait()?;
    let tokens = match vehicle {
        Some(of) => select::boots(fleet, of),
        None => select::alive(fleet),
    };
    observer
        .session()
        .liveliness()
        .declare_subscriber(tokens)
        .history(true)
        .callback(tell(sender.clone(), Arc::clone(counts)))
        .background()
        .wait()
}

/// What a sample says; none when it is nothing of the contract.
fn understand(sample: &Sample, wanted: Option<Name>) -> Option<Heard> {
    let (_, key) = Key::parse(sample.key_expr().as_str()).ok()?;
    let heard = match (key, sample.kind()) {
        (Key::Estimate { of }, SampleKind::Put) if sample.payload().len() <= DOCUMENT_BYTES_MAX => {
            Heard::Estimate {
                key: of,
                bytes: sample.payload().to_bytes().into_owned(),
            }
        }
        (Key::Alive { of: vehicle, boot }, SampleKind::Put) => Heard::Appeared { vehicle, boot },
        (Key::Alive { of: vehicle, boot }, SampleKind::Delete) => Heard::Vanished { vehicle, boot },
        _ => return None,
    };
    let of = match heard {
        Heard::Estimate { key: of, .. }
        | Heard::Appeared { vehicle: of, .. }
        | Heard::Vanished { vehicle: of, .. } => of,
    };
    wanted.is_none_or(|wanted| wanted == of).then_some(heard)
}

/// Waits for a signal, for the time to pass, or for the writer, whose reader may go.
async fn until_told(
    args: &WatchArgs,
    observer: &Observer,
    counts: &Counts,
    mut finish: tokio::sync::oneshot::Receiver<std::io::Result<()>>,
) -> miette::Result<Ending> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).into_diagnostic()?;
    let mut interrupt = signal(SignalKind::interrupt()).into_diagnostic()?;
    let time = tokio::time::sleep(args.duration.unwrap_or(Duration::MAX));
    let hint = tokio::time::sleep(HINT_AFTER);
    tokio::pin!(time, hint);
    let mut hinted = false;
    let silent = || counts.estimates.load(Ordering::Relaxed) == 0;
    let ending = loop {
        tokio::select! {
            _ = terminate.recv() => break Ending::Done,
            _ = interrupt.recv() => break Ending::Done,
            () = &mut time => break if silent() { Ending::NobodyAnswered } else { Ending::Done },
            () = &mut hint, if !hinted => {
                hinted = true;
                if silent() {
                    eprintln!("{}", observer.advice(args.vehicle));
                }
            }
            finished = &mut finish => return written(finished.unwrap_or(Ok(()))),
        }
    };
    counts.stop.store(true, Ordering::Relaxed);
    if ending == Ending::NobodyAnswered && !hinted {
        eprintln!("no estimate was heard.\n{}", observer.network_advice());
    }
    match tokio::time::timeout(FINISH_WITHIN, &mut finish).await {
        Ok(finished) => written(finished.unwrap_or(Ok(()))).map(|_| ending),
        // It is stuck in a pipe that nobody reads; the process ends without it.
        Err(_) => Ok(ending),
    }
}

fn written(result: std::io::Result<()>) -> miette::Result<Ending> {
    match result {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error)
            .into_diagnostic()
            .wrap_err("the output cannot be written"),
        _ => Ok(Ending::Done),
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Style {
    Json,
    Table,
    Lines,
}

/// The one who writes to standard output.
struct Writer {
    style: Style,
    every: Duration,
    clock: Clock,
    counts: Arc<Counts>,
}

impl Writer {
    /// Runs until it is told to stop, or its reader goes.
    fn run(&self, heard: &Receiver<Heard>) -> std::io::Result<()> {
        let mut out = std::io::stdout().lock();
        let mut board = Board::new(self.every);
        let mut drawn = 0;
        let mut draw_at = real_now();
        while !self.counts.stop.load(Ordering::Relaxed) {
            match heard.recv_timeout(draw_at.saturating_duration_since(real_now())) {
                Ok(heard) => self.take(heard, &mut board, &mut out)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
            if real_now() >= draw_at {
                draw_at = real_now() + DRAW_EVERY;
                if self.style == Style::Table {
                    drawn = draw(&board, self.clock, drawn, &mut out)?;
                }
            }
        }
        Ok(())
    }

    fn take(&self, heard: Heard, board: &mut Board, out: &mut impl Write) -> std::io::Result<()> {
        let now: Instant = real_now();
        let line = match heard {
            Heard::Estimate { key, bytes } => {
                let document = serde_json::from_slice::<EstimateDocument>(&bytes).ok();
                let Some(document) = document.filter(|document| document.vehicle == key) else {
                    self.counts.strange.fetch_add(1, Ordering::Relaxed);
                    return Ok(());
                };
                self.counts.estimates.fetch_add(1, Ordering::Relaxed);
                if self.style == Style::Json {
                    return write_line(out, &one_line(bytes));
                }
                board.estimate(&document, self.clock.now(), now)
            }
            Heard::Appeared { vehicle, boot } => board.appeared(vehicle, boot),
            Heard::Vanished { vehicle, boot } => board.vanished(vehicle, boot),
        };
        match (line, self.style) {
            (Some(line), Style::Lines) => write_line(out, line.as_bytes()),
            // The table shows it, and objects of another kind have no place between estimates.
            (Some(line), Style::Json) => {
                eprintln!("{line}");
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

/// A document as published, on one line: line breaks are white space in JSON.
fn one_line(mut bytes: Vec<u8>) -> Vec<u8> {
    for byte in &mut bytes {
        if matches!(byte, b'\n' | b'\r') {
            *byte = b' ';
        }
    }
    bytes
}

fn write_line(out: &mut impl Write, line: &[u8]) -> std::io::Result<()> {
    out.write_all(line)?;
    out.write_all(b"\n")?;
    out.flush()
}

/// Draws the table over the one before it, which had `drawn` lines; how many it has now.
fn draw(board: &Board, clock: Clock, drawn: usize, out: &mut impl Write) -> std::io::Result<usize> {
    let (width, height) = terminal_size::terminal_size().map_or((80, 24), |(width, height)| {
        (width.0.into(), height.0.into())
    });
    let lines = board.table(clock.now(), width, height);
    let mut page = String::new();
    if drawn > 0 {
        // Up to where the last table began, and everything below is cleared.
        page.push_str(&format!("\u{1b}[{drawn}A\r\u{1b}[J"));
    }
    for line in &lines {
        page.push_str(&plain(line));
        page.push('\n');
    }
    out.write_all(page.as_bytes())?;
    out.flush()?;
    Ok(lines.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_document_of_many_lines_becomes_one() {
        let pretty = b"{\n  \"a\": \"b\\n\"\r\n}".to_vec();
        assert_eq!(one_line(pretty), b"{   \"a\": \"b\\n\"  }");
    }
}
