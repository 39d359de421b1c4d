//! `skein status`: the health of one vehicle or of all: neighbours, rates, counters, and why there is no estimate.

use super::Ending;
use super::observer::{Observer, ObserverArgs, WaitArgs};
use super::output::{plain, print, print_json};
use crate::queries::About;
use skein_proto::document::{HealthDocument, NeighbourHealth};
use skein_proto::name::Name;
use skein_proto::status::Status;
use std::collections::BTreeMap;
use std::fmt::Write;

#[derive(clap::Args)]
#[command(after_help = "Examples:
  skein status                       all vehicles
  skein status v1 --json             one, as JSON
It ends with 3 when nobody answers.")]
pub(super) struct StatusArgs {
    /// The vehicle; all of the fleet without it.
    vehicle: Option<Name>,
    /// Print a JSON array of healths, one for each vehicle, as documented in ZENOH_API.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    wait: WaitArgs,
    #[command(flatten)]
    observer: ObserverArgs,
}

pub(super) fn run(args: &StatusArgs) -> miette::Result<Ending> {
    let (network, fleet) = (args.observer.network(), args.observer.fleet());
    let observer = Observer::open(&network, fleet, args.wait.wait)?;
    let selector = observer.selector(About::Health, args.vehicle);
    eprintln!("selector: {selector}");
    let answers = observer.ask::<HealthDocument>(About::Health, args.vehicle)?;
    for (vehicle, reason) in &answers.silent {
        eprintln!("{vehicle}: {reason}");
    }
    if answers.documents.is_empty() {
        eprintln!("{}", observer.advice(args.vehicle));
        return Ok(Ending::NobodyAnswered);
    }
    let healths: Vec<HealthDocument> = answers.documents.into_values().collect();
    if args.json {
        print_json(&healths)
    } else {
        let pages: Vec<String> = healths.iter().map(page).collect();
        print(&pages.concat())
    }
}

/// One vehicle's health for people. Writing to a string cannot fail, so its results are dropped.
fn page(health: &HealthDocument) -> String {
    let mut page = String::new();
    let _ = writeln!(
        page,
        "{} (boot {}): {}, up {:.0} s",
        health.vehicle,
        health.boot,
        health.status.words(),
        health.uptime_s
    );
    if let Some(why) = &health.why {
        let _ = writeln!(page, "  why: {}", plain(why));
    }
    let rounds = &health.rounds;
    let _ = writeln!(
        page,
        "  rounds: {} every {} s, {} solved, {} coasted, last with {} edges{}",
        rounds.mode,
        rounds.period_s,
        rounds.solved,
        rounds.coasted,
        rounds.last_edges,
        rounds
            .last_latency_s
            .map(|s| format!(" after {s:.3} s"))
            .unwrap_or_default()
    );
    counters(&mut page, "  rounds skipped", &rounds.skipped);
    counters(&mut page, "  rounds troubled", &rounds.troubled);
    counters(&mut page, "  cut", &rounds.cut);
    for (name, sensor) in &health.sensors {
        let age = sensor
            .age_s
            .map_or_else(|| "never".to_owned(), |s| format!("{s:.2} s ago"));
        let _ = writeln!(
            page,
            "  sensor {name}: {} frames, {:.1}/s, last {age}{}",
            sensor.accepted,
            sensor.rate_hz,
            refused(&sensor.refused)
        );
    }
    for (name, neighbour) in &health.neighbours {
        page.push_str(&neighbour_line(name, neighbour));
    }
    counters(&mut page, "  refused", &health.refused);
    if let Some(boot) = &health.namesake_boot {
        let _ = writeln!(page, "  ANOTHER PROCESS FLIES UNDER THIS NAME: boot {boot}");
    }
    if let Some(process) = &health.process {
        let session = if process.session_open {
            "open"
        } else {
            "NOT OPEN"
        };
        let _ = writeln!(page, "  Zenoh session {session}, {} peers", process.peers);
        for (name, queue) in process.queues.iter().filter(|(_, queue)| queue.dropped > 0) {
            let _ = writeln!(
                page,
                "  queue {name}: {} dropped (held {} of {})",
                queue.dropped, queue.most, queue.capacity
            );
        }
        if process.faults_dropped > 0 {
            let _ = writeln!(
                page,
                "  simulated faults took {} packets",
                process.faults_dropped
            );
        }
        if let Some(faults) = &process.faults {
            let happened = faults.by_reason().into_iter().filter(|(_, n)| *n > 0);
            let counts = happened.map(|(reason, n)| (reason.to_owned(), n)).collect();
            counters(&mut page, "  simulated faults", &counts);
        }
        if process.log_complete == Some(false) {
            let _ = writeln!(page, "  the input log is INCOMPLETE");
        }
    }
    page
}

fn neighbour_line(name: &str, neighbour: &NeighbourHealth) -> String {
    let mut line = format!(
        "  neighbour {name}: {}",
        if neighbour.present {
            "present"
        } else {
            "absent"
        }
    );
    if let Some(status) = neighbour.status {
        let _ = write!(line, ", says {}", Status::words(status));
    }
    let _ = write!(line, ", {:.1} packets/s", neighbour.rate_hz);
    if let Some(age_s) = neighbour.age_s {
        let _ = write!(line, ", last {age_s:.2} s ago");
    }
    match neighbour.clock_offset_s {
        Some(offset_s) => {
            let _ = write!(line, ", clock {:+.6} s", offset_s);
        }
        None => {
            let _ = write!(line, ", clock unknown ({} of 4 echoes)", neighbour.echoes);
        }
    }
    if let Some(round_trip_s) = neighbour.round_trip_s {
        let _ = write!(line, " (round trip {:.1} ms)", 1e3 * round_trip_s);
    }
    if neighbour.clock_stepped > 0 {
        let _ = write!(line, ", clock stepped {} times", neighbour.clock_stepped);
    }
    if !neighbour.duplicate_boots.is_empty() {
        let boots = neighbour.duplicate_boots.join(" and ");
        let _ = write!(
            line,
            ", DUPLICATE NAME: refused while boots {boots} are alive"
        );
    }
    if let Some(period_s) = neighbour.other_period_s {
        let _ = write!(line, ", ANOTHER PERIOD: {period_s} s");
    }
    let _ = writeln!(
        line,
        ", {} fused{}",
        neighbour.fused,
        refused(&neighbour.refused)
    );
    line
}

fn refused(reasons: &BTreeMap<String, u64>) -> String {
    if reasons.is_empty() {
        String::new()
    } else {
        format!(", refused: {}", listed(reasons))
    }
}

fn counters(page: &mut String, title: &str, counts: &BTreeMap<String, u64>) {
    if !counts.is_empty() {
        let _ = writeln!(page, "{title}: {}", listed(counts));
    }
}

fn listed(counts: &BTreeMap<String, u64>) -> String {
    let items: Vec<String> = counts
        .iter()
        .map(|(reason, count)| format!("{reason} {count}"))
        .collect();
    items.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use skein_proto::document::{ProcessHealth, RoundsHealth};

    #[test]
    fn the_page_says_why_and_what_was_refused() {
        let neighbour = NeighbourHealth {
            present: true,
            echoes: 2,
            refused: BTreeMap::from([("clock_unknown".to_owned(), 7)]),
            duplicate_boots: vec!["000000000000000a".to_owned(), "000000000000000b".to_owned()],
            ..NeighbourHealth::default()
        };
        let health = HealthDocument {
            vehicle: Name::parse("v1").unwrap(),
            boot: "00000000000000ab".to_owned(),
            taken_ns: 0,
            uptime_s: 12.0,
            status: Status::Unplaced,
            why: Some("nobody is located: give one vehicle a pose".to_owned()),
            rounds: RoundsHealth::default(),
            sensors: BTreeMap::new(),
            neighbours: BTreeMap::from([("v2".to_owned(), neighbour)]),
            refused: BTreeMap::new(),
            namesake_boot: Some("00000000000000cd".to_owned()),
            process: Some(ProcessHealth::default()),
        };
        let page = page(&health);
        for expected in [
            "unplaced",
            "give one vehicle a pose",
            "clock unknown (2 of 4 echoes)",
            "clock_unknown 7",
            "DUPLICATE NAME: refused while boots 000000000000000a and 000000000000000b are alive",
            "ANOTHER PROCESS FLIES UNDER THIS NAME: boot 00000000000000cd",
            "NOT OPEN",
        ] {
            assert!(page.contains(expected), "{expected}: {page}");
        }
    }
}
