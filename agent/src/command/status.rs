//! `skein status`: the health of one vehicle or of all: neighbours, rates, counters, and why there is no estimate.

use super::Ending;
use super::observer::{Observer, ObserverArgs, WaitArgs};
use super::output::{plain, print, print_json};
use super::sigma::plus_minus;
use crate::queries::About;
use skein_proto::document::{
    HealthDocument, MutualHealth, NeighbourHealth, RangingHealth, TeamHealth, TeamMemberHealth,
};
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
    if let Some(team) = &rounds.team {
        page.push_str(&team_lines(team));
    }
    if let Some(mutual) = &health.mutual {
        page.push_str(&mutual_lines(mutual));
    }
    if let Some(ranging) = &health.ranging {
        page.push_str(&ranging_lines(ranging));
    }
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

/// The estimator of the whole team: what it holds, what it gated, and how far it believes the sensors.
fn team_lines(team: &TeamHealth) -> String {
    let mut lines = format!(
        "  team: {} vehicles, {} poses over {} rounds, {} edges; last round {} new, {} gated; gated {}",
        team.members,
        team.poses,
        team.lag_rounds,
        team.edges,
        team.new_edges,
        team.gated,
        share(team.gated_total, team.edges_total)
    );
    for (count, what) in [
        (team.left_out, "edges left out for room"),
        (team.evicted, "members given up for room"),
        (team.restarts, "times BEGUN AGAIN"),
    ] {
        if count > 0 {
            let _ = write!(lines, ", {count} {what}");
        }
    }
    let position = plus_minus(team.position_sigma_m, 3);
    let rotation = plus_minus(team.rotation_sigma_rad.map(f64::to_degrees), 2);
    let scales = team.noise_scales.by_name();
    let scales = scales.map(|(name, scale)| format!("{name} {scale:.2}"));
    let _ = writeln!(
        lines,
        "\n  own pose: {position} m, {rotation} deg\n  noise scales: {}",
        scales.join(", ")
    );
    lines
}

/// Localisation by anonymous bearings: the own attitude, and what was told and heard.
fn mutual_lines(mutual: &MutualHealth) -> String {
    let attitude = match (mutual.roll_deg, mutual.pitch_deg) {
        (Some(roll), Some(pitch)) => format!(
            "roll {roll:+.1}, pitch {pitch:+.1} deg{}",
            if mutual.attitude_settled {
                ""
            } else {
                " (settling)"
            }
        ),
        _ => "no attitude".to_owned(),
    };
    let mut lines = format!(
        "  bearings: {}, {attitude}, {} tracks, {} sets told, {} heard, {} bearings identified\n",
        plain(&mutual.way),
        mutual.tracks,
        mutual.sets_told,
        mutual.sets_heard,
        mutual.bearings_identified
    );
    if let Some(why) = &mutual.why {
        let _ = writeln!(lines, "    nobody located: {}", plain(why));
    }
    counters(&mut lines, "    cut", &mutual.cut);
    lines
}

/// Localisation by distances alone, and turns to move.
fn ranging_lines(ranging: &RangingHealth) -> String {
    let mut lines = format!(
        "  distances while somebody has no pose: {} used, {} waiting, placed by them {} times\n",
        ranging.used, ranging.waiting, ranging.placed
    );
    counters(&mut lines, "    refused", &ranging.refused);
    if let Some(formation) = &ranging.formation {
        let _ = writeln!(
            lines,
            "  distances between {} neighbours: {} used, {} waiting; {} searches of all, {} dropped, {} that nothing fits",
            formation.neighbours,
            formation.used,
            formation.waiting,
            formation.work_done,
            formation.work_dropped,
            formation.unfit
        );
        counters(&mut lines, "    refused", &formation.refused);
    }
    if let Some(schedule) = &ranging.schedule {
        let _ = writeln!(
            lines,
            "  turns: round {}, moved in {}, with {}",
            schedule.round,
            schedule.moves,
            if schedule.neighbours.is_empty() {
                "nobody".to_owned()
            } else {
                schedule.neighbours.join(", ")
            }
        );
        counters(&mut lines, "    refused", &schedule.refused);
    }
    lines
}

/// A part of a whole, in percent.
fn share(part: u64, whole: u64) -> String {
    if whole == 0 {
        return "none of 0".to_owned();
    }
    format!("{:.1} % of {whole}", 100.0 * part as f64 / whole as f64)
}

/// What the estimator of the whole team thinks of a neighbour, behind what is known of it.
fn member_line(team: &TeamMemberHealth) -> String {
    let bias = team.gyro_bias_rad_s.map(|rate| format!("{rate:+.4}"));
    format!(
        "    team: doubts {:.0} % of its measurements, odometry {:.2} times as far off as stated{}, gyroscope bias ({}) \
         rad/s, odometer {:+.1} %\n",
        100.0 * team.doubted_share,
        team.odometry_ratio,
        if team.odometry_liar {
            " and NOT BELIEVED"
        } else {
            ""
        },
        bias.join(", "),
        100.0 * team.odometer_scale
    )
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
    if neighbour.quarantined {
        line.push_str(", IN QUARANTINE");
    }
    if neighbour.quarantines > 0 {
        let _ = write!(line, ", quarantined {} times", neighbour.quarantines);
    }
    let _ = writeln!(
        line,
        ", {} fused{}",
        neighbour.fused,
        refused(&neighbour.refused)
    );
    if let Some(team) = &neighbour.team {
        line.push_str(&member_line(team));
    }
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
    use skein_proto::document::{NoiseScales, ProcessHealth, RoundsHealth};

    fn health(rounds: RoundsHealth, neighbour: NeighbourHealth) -> HealthDocument {
        HealthDocument {
            vehicle: Name::parse("v1").unwrap(),
            boot: "00000000000000ab".to_owned(),
            taken_ns: 0,
            uptime_s: 12.0,
            status: Status::Unplaced,
            why: Some("nobody is located: give one vehicle a pose".to_owned()),
            rounds,
            mutual: None,
            ranging: None,
            sensors: BTreeMap::new(),
            neighbours: BTreeMap::from([("v2".to_owned(), neighbour)]),
            refused: BTreeMap::new(),
            namesake_boot: Some("00000000000000cd".to_owned()),
            process: Some(ProcessHealth::default()),
        }
    }

    /// A health of mode `team` with a neighbour whose odometry lies.
    fn of_a_team() -> HealthDocument {
        let team = TeamHealth {
            noise_scales: NoiseScales {
                odometry_translation: 2.5,
                ..NoiseScales::default()
            },
            lag_rounds: 5,
            poses: 25,
            members: 5,
            edges: 120,
            new_edges: 20,
            gated: 3,
            gated_total: 30,
            edges_total: 1000,
            restarts: 1,
            position_sigma_m: Some(0.034),
            rotation_sigma_rad: Some(0.01),
            ..TeamHealth::default()
        };
        let member = TeamMemberHealth {
            doubted_share: 0.25,
            odometry_ratio: 7.5,
            gyro_bias_rad_s: [0.0, 0.0, -0.002],
            odometer_scale: 0.02,
            odometry_liar: true,
        };
        health(
            RoundsHealth {
                mode: "team".to_owned(),
                team: Some(team),
                ..RoundsHealth::default()
            },
            NeighbourHealth {
                present: true,
                quarantined: true,
                quarantines: 2,
                team: Some(member),
                ..NeighbourHealth::default()
            },
        )
    }

    #[test]
    fn the_team_is_summed_up_and_whose_odometry_is_not_believed() {
        let page = page(&of_a_team());
        for expected in [
            "  team: 5 vehicles, 25 poses over 5 rounds, 120 edges; last round 20 new, 3 gated; gated 3.0 % of 1000, \
             1 times BEGUN AGAIN\n",
            "  own pose: +-0.034 m, +-0.57 deg\n",
            "  noise scales: odometry rotation 1.00, odometry translation 2.50, measured rotation 1.00, ",
            ", IN QUARANTINE, quarantined 2 times, 0 fused\n",
            "    team: doubts 25 % of its measurements, odometry 7.50 times as far off as stated and NOT BELIEVED, \
             gyroscope bias (+0.0000, +0.0000, -0.0020) rad/s, odometer +2.0 %\n",
        ] {
            assert!(page.contains(expected), "{expected}: {page}");
        }
        assert!(!page.contains("for room"), "nothing was: {page}");
    }

    #[test]
    fn a_team_without_an_edge_has_no_share() {
        let mut health = of_a_team();
        health.rounds.team = Some(TeamHealth::default());
        let page = page(&health);
        assert!(page.contains("gated none of 0\n"), "{page}");
        assert!(page.contains("  own pose: - m, - deg\n"), "{page}");
    }

    #[test]
    fn another_mode_says_nothing_of_a_team() {
        let page =
            page(&health(RoundsHealth::default(), NeighbourHealth::default())).to_lowercase();
        assert!(
            !page.contains("team") && !page.contains("quarantine"),
            "{page}"
        );
    }

    #[test]
    fn json_has_all_of_a_health() {
        let published = of_a_team();
        let json = crate::queries::json(&[&published]);
        let read: Vec<HealthDocument> = serde_json::from_slice(&json).unwrap();
        assert_eq!(read, [published]);
    }

    #[test]
    fn the_page_says_why_and_what_was_refused() {
        let neighbour = NeighbourHealth {
            present: true,
            echoes: 2,
            refused: BTreeMap::from([("clock_unknown".to_owned(), 7)]),
            duplicate_boots: vec!["000000000000000a".to_owned(), "000000000000000b".to_owned()],
            ..NeighbourHealth::default()
        };
        let page = page(&health(RoundsHealth::default(), neighbour));
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
