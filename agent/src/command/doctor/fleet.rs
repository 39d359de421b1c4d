//! What the vehicles' own documents tell: estimates, sensors, neighbours that are not used and why, clocks, versions.

use super::Seen;
use super::finding::Finding;
use skein_estimation::time::Stamp;
use skein_proto::document::{HealthDocument, InfoDocument, NeighbourHealth, SensorHealth};
use skein_proto::name::Name;
use skein_proto::status::Status;
use std::collections::{BTreeMap, BTreeSet};

/// Clocks further apart than this are worth a word: logs of different vehicles no longer fit together.
const CLOCKS_APART_S: f64 = 1.0;
/// Clocks further apart than this are of another kind: a simulation or a recording.
const OTHER_TIME_S: f64 = 86_400.0;
/// Echoes before a neighbour's clock is known.
const ECHOES_NEEDED: u64 = 4;

/// Looks at everything that was heard; with `own`, the neighbours of that vehicle only.
pub(super) fn examine(seen: &Seen, own: Option<Name>, now: Stamp) -> Vec<Finding> {
    let mut findings = Vec::new();
    if let Some(own) = own.filter(|own| !seen.healths.contains_key(own))
        && !seen.healths.is_empty()
    {
        findings.push(Finding::warning(
            &format!("{own} runs"),
            "not seen in its fleet",
            "others are, so either it does not run or it cannot reach them",
            "start it with `skein run`, and read its log",
        ));
    }
    for (vehicle, health) in &seen.healths {
        findings.push(estimate(vehicle, health));
        findings.extend(own_clock(vehicle, health, now));
        findings.extend(process(vehicle, health));
        if own.is_none_or(|own| own == *vehicle) {
            for (sensor, of) in &health.sensors {
                findings.extend(self::sensor(vehicle, sensor, of));
            }
            for (name, of) in &health.neighbours {
                findings.push(neighbour(vehicle, name, of, health.rounds.period_s));
            }
        }
    }
    findings.extend(versions(&seen.infos));
    findings
}

/// Whether a vehicle knows where it is.
fn estimate(vehicle: &Name, health: &HealthDocument) -> Finding {
    let check = format!("{vehicle} estimate");
    let found = health.status.words();
    let why = health
        .why
        .as_deref()
        .unwrap_or("see `skein status` of the vehicle");
    match health.status {
        Status::Tracking => Finding::ok(&check, found),
        Status::Unplaced | Status::Lost => {
            Finding::problem(&check, found, "the vehicle does not know where it is", why)
        }
        Status::Degraded => Finding::warning(
            &check,
            found,
            "it is corrected, but may be further off than its covariance says",
            why,
        ),
        Status::DeadReckoning | Status::Alone | Status::Resuming => Finding::warning(
            &check,
            found,
            "the estimate drifts as the odometry does, or is not confirmed",
            why,
        ),
    }
}

/// A vehicle's clock beside this machine's.
fn own_clock(vehicle: &Name, health: &HealthDocument, now: Stamp) -> Option<Finding> {
    let apart_s = (Stamp::from_nanos(health.taken_ns) - now).as_secs_f64();
    // A health is up to a second old: that much is no clock error.
    let is_apart = !(-(CLOCKS_APART_S + 1.0)..=CLOCKS_APART_S).contains(&apart_s);
    clocks_apart(
        &format!("{vehicle} clock"),
        "this machine's",
        apart_s,
        is_apart,
    )
}

fn clocks_apart(check: &str, whose: &str, apart_s: f64, is_apart: bool) -> Option<Finding> {
    if apart_s.abs() > OTHER_TIME_S {
        return Some(Finding::skipped(
            check,
            "runs on another time (a recording, or a clock that was never set)",
        ));
    }
    is_apart.then(|| {
        Finding::warning(
            check,
            format!("{apart_s:+.1} s from {whose}"),
            "vehicles correct for it among each other, but logs and certificates do not",
            "synchronise the clocks (NTP) before the flight",
        )
    })
}

/// Whether a process keeps up.
fn process(vehicle: &Name, health: &HealthDocument) -> Vec<Finding> {
    let mut findings = Vec::new();
    let Some(process) = &health.process else {
        return findings;
    };
    let dropped: Vec<String> = process
        .queues
        .iter()
        .filter(|(_, queue)| queue.dropped > 0)
        .map(|(name, queue)| format!("{name} {}", queue.dropped))
        .collect();
    if !dropped.is_empty() {
        findings.push(Finding::warning(
            &format!("{vehicle} queues"),
            format!("dropped: {}", dropped.join(", ")),
            "more came in than the vehicle could take, or a link was down",
            "look for a sensor that sends too fast, and at the computer's load",
        ));
    }
    if process.log_complete == Some(false) {
        findings.push(Finding::warning(
            &format!("{vehicle} input log"),
            "incomplete",
            "`skein verify` repeats it only up to where something is missing",
            "is the disk full or too slow?",
        ));
    }
    if process.faults_dropped > 0 {
        findings.push(Finding::warning(
            &format!("{vehicle} radio"),
            format!("simulated faults took {} packets", process.faults_dropped),
            "[simulation] is enabled",
            "remove [simulation] on a real vehicle",
        ));
    }
    findings
}

/// A sensor that brings nothing, or nothing that can be used.
fn sensor(vehicle: &Name, name: &str, sensor: &SensorHealth) -> Option<Finding> {
    let check = format!("{vehicle} sensor {name}");
    let refused = listed(&sensor.refused);
    if sensor.accepted > 0 {
        let mut found = format!("{} frames, {:.1}/s", sensor.accepted, sensor.rate_hz);
        if !refused.is_empty() {
            found.push_str(&format!("; refused: {refused}"));
        }
        return Some(Finding::ok(&check, found));
    }
    Some(if refused.is_empty() {
        Finding::warning(
            &check,
            "no frame yet",
            "the vehicle has nothing of this sensor",
            "does its driver run, and send to this vehicle's @driver key?",
        )
    } else {
        Finding::problem(
            &check,
            format!("every frame was refused: {refused}"),
            &meanings(&sensor.refused),
            "mend what the driver sends; ZENOH_API.md has the frames and their limits",
        )
    })
}

/// A neighbour as one vehicle sees it, and if it is not used, why.
fn neighbour(vehicle: &Name, name: &str, of: &NeighbourHealth, period_s: f64) -> Finding {
    let check = format!("{vehicle} sees {name}");
    let refused = listed(&of.refused);
    if !of.present {
        return Finding::warning(
            &check,
            "absent",
            "its token is gone, or nothing was heard of it lately",
            "does it run, is it in range, and do both list each other in `connect`?",
        );
    }
    if of.refused.contains_key("version") {
        return Finding::problem(
            &check,
            format!("refused: {refused}"),
            "it speaks another major version of the contract",
            "install the same version of skein on both",
        );
    }
    if let Some(other_s) = of.other_period_s {
        return Finding::warning(
            &check,
            format!("its rounds last {other_s} s, those of {vehicle} {period_s} s"),
            "rounds of different periods meet rarely, so that few measurements are used",
            "give the whole fleet one [cooperative] period_s",
        );
    }
    let Some(offset_s) = of.clock_offset_s else {
        return Finding::warning(
            &check,
            format!(
                "its clock is unknown: {} of {ECHOES_NEEDED} echoes",
                of.echoes
            ),
            "nothing of it is used until its clock is known, which takes about a second",
            "when this stays, packets are lost one way: look at the radio and at `skein status` of both",
        );
    };
    let apart = clocks_apart(
        &check,
        &format!("the clock of {vehicle}"),
        offset_s,
        offset_s.abs() > CLOCKS_APART_S,
    );
    if let Some(apart) = apart {
        return apart;
    }
    if of.fused == 0 {
        let meanings = meanings(&of.refused);
        return Finding::warning(
            &check,
            if refused.is_empty() {
                "present, but neither has measured the other yet".to_owned()
            } else {
                format!("present, but nothing of it was used; refused: {refused}")
            },
            if meanings.is_empty() {
                "neither corrects the other"
            } else {
                &meanings
            },
            "does a relative sensor of one see the other, under the name that it has in its configuration?",
        );
    }
    let status = of.status.map_or("unknown", Status::words);
    let mut found = format!(
        "{status}, {} measurements used, clock {offset_s:+.6} s",
        of.fused
    );
    if !refused.is_empty() {
        found.push_str(&format!("; refused: {refused}"));
    }
    Finding::ok(&check, found)
}

/// Whether all speak the same.
fn versions(infos: &BTreeMap<Name, InfoDocument>) -> Option<Finding> {
    let said = |what: &dyn Fn(&InfoDocument) -> String| -> Vec<String> {
        let versions: BTreeSet<String> = infos.values().map(what).collect();
        versions.into_iter().collect()
    };
    let programs = said(&|info| info.program.clone());
    let wires = said(&|info| info.wire.clone());
    if infos.is_empty() {
        return None;
    }
    Some(if programs.len() == 1 && wires.len() == 1 {
        Finding::ok(
            "versions",
            format!("skein {}, wire {}", programs[0], wires[0]),
        )
    } else {
        Finding::warning(
            "versions",
            format!("skein {}; wire {}", programs.join(", "), wires.join(", ")),
            "vehicles of one major wire version understand each other, but may estimate differently",
            "install the same version everywhere",
        )
    })
}

fn listed(reasons: &BTreeMap<String, u64>) -> String {
    let items: Vec<String> = reasons
        .iter()
        .map(|(reason, count)| format!("{reason} {count}"))
        .collect();
    items.join(", ")
}

/// What the reasons of the contract mean, most counted first.
fn meanings(reasons: &BTreeMap<String, u64>) -> String {
    let mut counted: Vec<(&String, &u64)> = reasons.iter().collect();
    counted.sort_by(|one, other| other.1.cmp(one.1));
    let told: Vec<String> = counted
        .into_iter()
        .filter_map(|(reason, _)| Some(format!("{reason}: {}", meaning(reason)?)))
        .collect();
    told.join("; ")
}

/// A reason in the words of ZENOH_API.md.
fn meaning(reason: &str) -> Option<&'static str> {
    Some(match reason {
        "too_long" | "truncated" | "trailing" | "malformed" | "too_many" => {
            "the bytes are not this message"
        }
        "not_finite" | "out_of_range" => "a number is none, or outside the limits",
        "version" => "another major version",
        "wrong_hash" => "the sender's hash does not fit its name",
        "old_boot" => "from a boot that no longer counts",
        "unproven_boot" => "from a process that has not answered us: a new one, or a recording",
        "new_boot" => "from a restarted process whose predecessor has not left yet",
        "duplicate_id" => "two processes run under this name: stop one or rename it",
        "out_of_sequence" => "it came far out of order, or is a replay",
        "gated" => "it disagreed with everything else by more than can be explained",
        "quarantined" => {
            "it goes on disagreeing while others agree: are its mounts and its start pose right?"
        }
        "clock_unknown" => "its clock was not known yet",
        "too_late" => "its round was solved already: the network or a clock is slow",
        "from_the_future" => "it lies too far ahead: is taken_ns on the vehicle's clock?",
        "no_odometry" => "odometry around its time is missing here or there",
        "no_prior" => "the neighbour was not heard in the round, or has no estimate",
        "unplaced" => "the vehicle has no pose yet",
        "unknown_sensor" => "no sensor of that name is configured",
        "second_odometry" => "another sensor is the source of odometry",
        "overlap" => "of time already counted",
        "no_pipeline" => {
            "nothing here uses this kind of packet: a relay, in another mode than team"
        }
        "no_inertial" => "no inertial reading reaches the time of these camera frames",
        "second_inertial" => "another inertial sensor is the source already",
        "second_camera" => "another camera is the source already",
        "full" => "a bound was reached",
        "contradicts" | "unusable" => "the estimator refused it: is the mount right?",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;
    use skein_proto::document::RoundsHealth;

    const NOW: Stamp = Stamp::from_nanos(1_800_000_000_000_000_000);

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn good() -> NeighbourHealth {
        NeighbourHealth {
            present: true,
            status: Some(Status::Tracking),
            echoes: 9,
            clock_offset_s: Some(0.001),
            fused: 7,
            refused: BTreeMap::from([("clock_unknown".to_owned(), 2)]),
            ..NeighbourHealth::default()
        }
    }

    fn health(neighbour: NeighbourHealth) -> HealthDocument {
        HealthDocument {
            vehicle: name("v1"),
            boot: "00000000000000ab".to_owned(),
            taken_ns: NOW.as_nanos(),
            uptime_s: 60.0,
            status: Status::Tracking,
            why: None,
            rounds: RoundsHealth {
                period_s: 0.2,
                ..RoundsHealth::default()
            },
            mutual: None,
            ranging: None,
            sensors: BTreeMap::new(),
            neighbours: BTreeMap::from([("v2".to_owned(), neighbour)]),
            refused: BTreeMap::new(),
            namesake_boot: None,
            process: None,
        }
    }

    /// What is found of `v2` by `v1`.
    fn found(change: impl Fn(&mut NeighbourHealth)) -> Finding {
        let mut neighbour = good();
        change(&mut neighbour);
        let seen = Seen {
            healths: BTreeMap::from([(name("v1"), health(neighbour))]),
            infos: BTreeMap::new(),
        };
        let findings = examine(&seen, Some(name("v1")), NOW);
        let of_v2 = findings.into_iter().find(|f| f.check == "v1 sees v2");
        of_v2.unwrap()
    }

    #[test]
    fn a_neighbour_whose_measurements_are_used_is_fine() {
        assert_eq!(found(|_| {}).level, Level::Ok);
    }

    #[test]
    fn why_a_neighbour_is_not_used_is_said() {
        let says = |finding: &Finding, words: &str| {
            let text = format!("{} {:?}", finding.found, finding.means);
            assert!(text.contains(words), "{words}: {finding:?}");
            assert!(
                finding.level != Level::Ok && finding.advice.is_some(),
                "{finding:?}"
            );
        };
        says(&found(|n| n.present = false), "absent");
        says(
            &found(|n| (n.clock_offset_s, n.echoes) = (None, 2)),
            "2 of 4 echoes",
        );
        says(
            &found(|n| n.other_period_s = Some(0.5)),
            "0.5 s, those of v1 0.2 s",
        );
        says(
            &found(|n| n.clock_offset_s = Some(-3.0)),
            "-3.0 s from the clock of v1",
        );
        says(&found(|n| n.fused = 0), "clock was not known yet");
        let version = found(|n| n.refused = BTreeMap::from([("version".to_owned(), 9)]));
        says(&version, "another major version");
        assert_eq!(version.level, Level::Problem);
    }

    #[test]
    fn a_vehicle_without_a_pose_is_a_problem_and_its_reason_the_advice() {
        let mut lost = health(good());
        lost.status = Status::Lost;
        lost.why = Some("no odometry for 3 s".to_owned());
        let finding = estimate(&name("v1"), &lost);
        assert_eq!(finding.level, Level::Problem);
        assert_eq!(finding.advice.as_deref(), Some("no odometry for 3 s"));
    }

    #[test]
    fn a_degraded_estimate_is_a_warning_not_to_rely_on_its_covariance() {
        let mut degraded = health(good());
        degraded.status = Status::Degraded;
        let finding = estimate(&name("v1"), &degraded);
        assert_eq!(finding.level, Level::Warning);
        assert!(
            finding
                .means
                .is_some_and(|means| means.contains("covariance"))
        );
    }

    #[test]
    fn a_clock_that_is_off_is_told_and_a_simulated_one_is_not_judged() {
        let level = |seconds: i64| {
            let mut health = health(good());
            health.taken_ns += seconds * 1_000_000_000;
            own_clock(&name("v1"), &health, NOW).map(|finding| finding.level)
        };
        assert_eq!(level(0), None);
        assert_eq!(level(-1), None, "a health may be a second old");
        assert_eq!(level(5), Some(Level::Warning));
        assert_eq!(level(-5), Some(Level::Warning));
        assert_eq!(level(-90_000), Some(Level::Skipped));
    }

    #[test]
    fn vehicles_of_different_versions_are_told() {
        let info = |vehicle: &str, program: &str| InfoDocument {
            vehicle: name(vehicle),
            boot: String::new(),
            program: program.to_owned(),
            wire: "1.0".to_owned(),
            period_s: 0.2,
            capabilities: vec![],
            sensors: BTreeMap::new(),
            limits: BTreeMap::new(),
        };
        let of = |other: &str| {
            let infos = [info("v1", "0.1.0"), info("v2", other)];
            versions(&infos.into_iter().map(|info| (info.vehicle, info)).collect())
        };
        assert_eq!(of("0.1.0").unwrap().level, Level::Ok);
        assert_eq!(of("0.2.0").unwrap().level, Level::Warning);
        assert_eq!(versions(&BTreeMap::new()), None);
    }
}
