//! What changed for a vehicle, told once: compares each estimate and health with the one before and says what the log
//! should have. A steady flight has nothing to say.

use skein_proto::document::{
    EstimateDocument, HealthDocument, NeighbourHealth, ProcessHealth, TeamHealth,
};
use skein_proto::status::Status;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::RangeInclusive;

/// Reasons remembered for one neighbour or sensor; the contract has fewer.
const REASONS_MAX: usize = 64;
/// Beyond these a noise scale is worth a word: what the sensors state is off by a factor of two.
const NOISE_SCALE_FAIR: RangeInclusive<f64> = 0.5..=2.0;
/// Back within these it may become worth another one; what hovers about a bound is told once.
const NOISE_SCALE_FAIR_AGAIN: RangeInclusive<f64> = 0.6..=1.67;

/// Remembers what was told. Bounded as its documents are: it keeps nothing of a neighbour that they no longer list.
#[derive(Default)]
pub(crate) struct Changes {
    status: Option<(Status, Option<String>)>,
    neighbours: BTreeMap<String, Neighbour>,
    sensors: BTreeMap<String, Sensor>,
    refused: BTreeSet<String>,
    team: Team,
    process: Process,
}

#[derive(Default)]
struct Neighbour {
    present: bool,
    clock_known: bool,
    other_period: bool,
    odometry_doubted: bool,
    refused: BTreeSet<String>,
}

#[derive(Default)]
struct Sensor {
    brings: bool,
    refused: BTreeSet<String>,
}

#[derive(Default)]
struct Team {
    restarts: u64,
    unfair_scales: BTreeSet<&'static str>,
}

#[derive(Default)]
struct Process {
    connected: bool,
    overflowing: BTreeSet<String>,
    log_cut: bool,
}

/// One change, in the order of the fields that a log line has.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Change {
    /// The estimate is of another kind, or poor for another reason.
    Status { status: Status, why: Option<String> },
    /// A neighbour is announced and heard.
    Appeared { neighbour: String },
    /// A neighbour is silent, or its token is gone.
    Vanished { neighbour: String },
    /// From now on its packets are used.
    ClockKnown { neighbour: String, offset_s: f64 },
    /// A neighbour restarted, so that its clock must be learnt again.
    ClockLost { neighbour: String },
    /// A neighbour runs on another round period.
    OtherPeriod { neighbour: String, period_s: f64 },
    /// What others measure goes on contradicting a neighbour's odometry.
    OdometryDoubted { neighbour: String },
    /// It no longer does.
    OdometryBelieved { neighbour: String },
    /// The estimator of the whole team had to begin again; how often so far.
    TeamRestarted { restarts: u64 },
    /// What sensors state of their noise is off by more than a factor of two.
    UnfairNoise { of: &'static str, scale: f64 },
    /// The first frame of a sensor.
    FirstFrame { sensor: String },
    /// The first refusal for a reason; later ones are only counted.
    Refused { of: String, reason: String },
    /// The first Zenoh process is connected.
    Connected,
    /// No Zenoh process is connected any more.
    Disconnected,
    /// The first entry that a full queue dropped.
    Overflow { queue: String },
    /// The input log lacks something.
    LogIncomplete,
}

impl Changes {
    /// What an estimate has that the one before had not.
    pub(crate) fn in_estimate(&mut self, estimate: &EstimateDocument) -> Option<Change> {
        // Seconds that pass are no other reason.
        let kind = (estimate.status, estimate.why.as_deref().map(wordy));
        if self.status.as_ref() == Some(&kind) {
            return None;
        }
        self.status = Some(kind);
        Some(Change::Status {
            status: estimate.status,
            why: estimate.why.clone(),
        })
    }

    /// What a health has that the one before had not.
    pub(crate) fn in_health(&mut self, health: &HealthDocument) -> Vec<Change> {
        let mut changes = Vec::new();
        self.neighbours
            .retain(|name, _| health.neighbours.contains_key(name));
        for (name, now) in &health.neighbours {
            let before = self.neighbours.entry(name.clone()).or_default();
            before.compare(name, now, &mut changes);
        }
        for (name, now) in &health.sensors {
            let before = self.sensors.entry(name.clone()).or_default();
            if now.accepted > 0 && !before.brings {
                before.brings = true;
                changes.push(Change::FirstFrame {
                    sensor: name.clone(),
                });
            }
            let of = format!("sensor {name}");
            new_reasons(&mut before.refused, &now.refused, &of, &mut changes);
        }
        new_reasons(&mut self.refused, &health.refused, "nobody", &mut changes);
        if let Some(team) = &health.rounds.team {
            self.team.compare(team, &mut changes);
        }
        if let Some(process) = &health.process {
            self.process.compare(process, &mut changes);
        }
        changes
    }
}

impl Neighbour {
    fn compare(&mut self, name: &str, now: &NeighbourHealth, changes: &mut Vec<Change>) {
        let neighbour = || name.to_owned();
        if now.present != self.present {
            self.present = now.present;
            changes.push(if now.present {
                Change::Appeared {
                    neighbour: neighbour(),
                }
            } else {
                Change::Vanished {
                    neighbour: neighbour(),
                }
            });
        }
        match now.clock_offset_s {
            Some(offset_s) if !self.clock_known => changes.push(Change::ClockKnown {
                neighbour: neighbour(),
                offset_s,
            }),
            None if self.clock_known => changes.push(Change::ClockLost {
                neighbour: neighbour(),
            }),
            _ => {}
        }
        self.clock_known = now.clock_offset_s.is_some();
        if let (Some(period_s), false) = (now.other_period_s, self.other_period) {
            changes.push(Change::OtherPeriod {
                neighbour: neighbour(),
                period_s,
            });
        }
        self.other_period = now.other_period_s.is_some();
        let odometry_doubted = now.team.is_some_and(|team| team.odometry_liar);
        if odometry_doubted != self.odometry_doubted {
            self.odometry_doubted = odometry_doubted;
            changes.push(if odometry_doubted {
                Change::OdometryDoubted {
                    neighbour: neighbour(),
                }
            } else {
                Change::OdometryBelieved {
                    neighbour: neighbour(),
                }
            });
        }
        let of = format!("neighbour {name}");
        new_reasons(&mut self.refused, &now.refused, &of, changes);
    }
}

impl Team {
    fn compare(&mut self, now: &TeamHealth, changes: &mut Vec<Change>) {
        if now.restarts > self.restarts {
            changes.push(Change::TeamRestarted {
                restarts: now.restarts,
            });
        }
        self.restarts = now.restarts;
        for (of, scale) in now.noise_scales.by_name() {
            if NOISE_SCALE_FAIR_AGAIN.contains(&scale) {
                self.unfair_scales.remove(of);
            } else if !NOISE_SCALE_FAIR.contains(&scale) && self.unfair_scales.insert(of) {
                changes.push(Change::UnfairNoise { of, scale });
            }
        }
    }
}

impl Process {
    fn compare(&mut self, now: &ProcessHealth, changes: &mut Vec<Change>) {
        let connected = now.peers > 0;
        if connected != self.connected {
            self.connected = connected;
            changes.push(if connected {
                Change::Connected
            } else {
                Change::Disconnected
            });
        }
        for (queue, _) in now.queues.iter().filter(|(_, queue)| queue.dropped > 0) {
            if self.overflowing.insert(queue.clone()) {
                changes.push(Change::Overflow {
                    queue: queue.clone(),
                });
            }
        }
        if now.log_complete == Some(false) && !self.log_cut {
            self.log_cut = true;
            changes.push(Change::LogIncomplete);
        }
    }
}

fn new_reasons(
    told: &mut BTreeSet<String>,
    counted: &BTreeMap<String, u64>,
    of: &str,
    changes: &mut Vec<Change>,
) {
    for reason in counted.keys() {
        if told.len() < REASONS_MAX && told.insert(reason.clone()) {
            changes.push(Change::Refused {
                of: of.to_owned(),
                reason: reason.clone(),
            });
        }
    }
}

/// A sentence without its numbers.
fn wordy(text: &str) -> String {
    text.chars()
        .filter(|c| !c.is_ascii_digit() && *c != '.')
        .collect()
}

impl Change {
    /// Writes its line into the log of a vehicle.
    pub(crate) fn log(&self, vehicle: &str) {
        match self {
            Self::Status { status, why } => tracing::info!(
                %vehicle,
                status = status.words(),
                why = why.as_deref(),
                "{self}"
            ),
            Self::Appeared { neighbour }
            | Self::Vanished { neighbour }
            | Self::ClockLost { neighbour } => tracing::info!(%vehicle, %neighbour, "{self}"),
            Self::ClockKnown {
                neighbour,
                offset_s,
            } => {
                tracing::info!(%vehicle, %neighbour, clock_offset_s = offset_s, "{self}");
            }
            Self::OtherPeriod {
                neighbour,
                period_s,
            } => tracing::warn!(%vehicle, %neighbour, period_s, "{self}"),
            Self::OdometryDoubted { neighbour } => {
                tracing::warn!(%vehicle, %neighbour, "{self}");
            }
            Self::OdometryBelieved { neighbour } => {
                tracing::info!(%vehicle, %neighbour, "{self}");
            }
            Self::TeamRestarted { restarts } => tracing::warn!(%vehicle, restarts, "{self}"),
            Self::UnfairNoise { of, scale } => tracing::warn!(%vehicle, %of, scale, "{self}"),
            Self::FirstFrame { sensor } => tracing::info!(%vehicle, %sensor, "{self}"),
            Self::Refused { of, reason } => tracing::info!(%vehicle, %of, %reason, "{self}"),
            Self::Connected | Self::Disconnected => tracing::info!(%vehicle, "{self}"),
            Self::Overflow { queue } => tracing::warn!(%vehicle, %queue, "{self}"),
            Self::LogIncomplete => tracing::warn!(%vehicle, "{self}"),
        }
    }
}

impl fmt::Display for Change {
    /// The message; what it is about stands in the fields of the line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Status { .. } => "the estimate's status",
            Self::Appeared { .. } => "a neighbour has appeared",
            Self::Vanished { .. } => "a neighbour has vanished",
            Self::ClockKnown { .. } => "the neighbour's clock is known: its measurements are used",
            Self::ClockLost { .. } => "the neighbour's clock is unknown again",
            Self::OtherPeriod { .. } => {
                "the neighbour has another round period: give the whole fleet the same"
            }
            Self::OdometryDoubted { .. } => {
                "what others measure contradicts the neighbour's odometry: it is not believed"
            }
            Self::OdometryBelieved { .. } => "the neighbour's odometry is believed again",
            Self::TeamRestarted { .. } => {
                "the estimator of the team had to begin again: its covariance is young"
            }
            Self::UnfairNoise { .. } => {
                "noise is another than the sensors state, by this factor: give their drivers honest sigmas"
            }
            Self::FirstFrame { .. } => "the first frame of a sensor",
            Self::Refused { .. } => {
                "refused for the first time for this reason; `skein status` counts them"
            }
            Self::Connected => "a Zenoh process is connected",
            Self::Disconnected => "no Zenoh process is connected any more",
            Self::Overflow { .. } => "a queue was full and has dropped: `skein status` counts them",
            Self::LogIncomplete => "the input log is incomplete from here on",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skein_proto::document::{QueueHealth, RoundsHealth, SensorHealth, TeamMemberHealth};
    use skein_proto::name::Name;

    fn estimate(status: Status, why: Option<&str>) -> EstimateDocument {
        EstimateDocument {
            vehicle: Name::parse("v1").unwrap(),
            boot: "00000000000000ab".to_owned(),
            taken_ns: 0,
            status,
            pose: None,
            velocity: None,
            covariance: None,
            neighbours: vec![],
            features: vec![],
            motion: None,
            why: why.map(str::to_owned),
        }
    }

    /// A vehicle that tracks beside `v2`, after so many seconds.
    fn steady(second: u64) -> HealthDocument {
        let neighbour = NeighbourHealth {
            present: true,
            age_s: Some(0.01 * second as f64),
            echoes: 4 + second,
            clock_offset_s: Some(1e-6 * second as f64),
            fused: 5 * second,
            refused: BTreeMap::from([("too_late".to_owned(), 1 + second)]),
            ..NeighbourHealth::default()
        };
        let sensor = SensorHealth {
            accepted: 1 + 20 * second,
            ..SensorHealth::default()
        };
        HealthDocument {
            vehicle: Name::parse("v1").unwrap(),
            boot: "00000000000000ab".to_owned(),
            taken_ns: second as i64 * 1_000_000_000,
            uptime_s: second as f64,
            status: Status::Tracking,
            why: None,
            rounds: RoundsHealth::default(),
            mutual: None,
            ranging: None,
            sensors: BTreeMap::from([("odometry".to_owned(), sensor)]),
            neighbours: BTreeMap::from([("v2".to_owned(), neighbour)]),
            refused: BTreeMap::new(),
            namesake_boot: None,
            process: Some(ProcessHealth {
                peers: 1 + second % 2,
                session_open: true,
                log_complete: Some(true),
                ..ProcessHealth::default()
            }),
        }
    }

    /// Changes that have seen the first health.
    fn started() -> Changes {
        let mut changes = Changes::default();
        changes.in_health(&steady(0));
        changes
    }

    fn of_v2(change: impl Fn(&mut NeighbourHealth)) -> HealthDocument {
        let mut health = steady(1);
        change(health.neighbours.get_mut("v2").unwrap());
        health
    }

    #[test]
    fn a_steady_flight_of_a_minute_says_nothing_after_its_start() {
        let mut changes = Changes::default();
        assert!(
            changes
                .in_estimate(&estimate(Status::Tracking, None))
                .is_some()
        );
        assert_eq!(changes.in_health(&steady(0)).len(), 5);
        for second in 1..=60 {
            for _ in 0..20 {
                assert_eq!(changes.in_estimate(&estimate(Status::Tracking, None)), None);
            }
            assert_eq!(changes.in_health(&steady(second)), []);
        }
    }

    #[test]
    fn another_status_is_one_line_with_its_reason() {
        let mut changes = Changes::default();
        changes.in_estimate(&estimate(Status::Tracking, None));
        let lost = estimate(Status::Lost, Some("no odometry for 1.2 s"));
        let told = changes.in_estimate(&lost);
        assert_eq!(
            told,
            Some(Change::Status {
                status: Status::Lost,
                why: Some("no odometry for 1.2 s".to_owned())
            })
        );
        let later = estimate(Status::Lost, Some("no odometry for 13.7 s"));
        assert_eq!(changes.in_estimate(&later), None, "time alone is no change");
        let other = estimate(Status::Lost, Some("odometry was interrupted for 14 s"));
        assert!(changes.in_estimate(&other).is_some(), "another reason is");
    }

    #[test]
    fn a_neighbour_that_goes_and_restarts_is_told_of_once_each() {
        let mut changes = started();
        let gone = of_v2(|v2| v2.present = false);
        let neighbour = || "v2".to_owned();
        assert_eq!(
            changes.in_health(&gone),
            [Change::Vanished {
                neighbour: neighbour()
            }]
        );
        assert_eq!(changes.in_health(&gone), []);
        let restarted = of_v2(|v2| v2.clock_offset_s = None);
        assert_eq!(
            changes.in_health(&restarted),
            [
                Change::Appeared {
                    neighbour: neighbour()
                },
                Change::ClockLost {
                    neighbour: neighbour()
                }
            ]
        );
        let known = of_v2(|v2| v2.clock_offset_s = Some(0.5));
        assert_eq!(
            changes.in_health(&known),
            [Change::ClockKnown {
                neighbour: neighbour(),
                offset_s: 0.5
            }]
        );
    }

    #[test]
    fn a_reason_is_told_when_it_is_first_counted_for_a_neighbour() {
        let mut changes = started();
        let refused = of_v2(|v2| {
            v2.refused.insert("version".to_owned(), 1);
            v2.other_period_s = Some(0.5);
        });
        let told = changes.in_health(&refused);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told.contains(&Change::Refused {
            of: "neighbour v2".to_owned(),
            reason: "version".to_owned()
        }));
        assert_eq!(changes.in_health(&refused), []);
    }

    #[test]
    fn a_neighbour_whose_odometry_lies_is_told_of_when_it_begins_and_when_it_ends() {
        let mut changes = started();
        let lying = |odometry_liar| {
            of_v2(|v2| {
                v2.team = Some(TeamMemberHealth {
                    odometry_liar,
                    ..TeamMemberHealth::default()
                });
            })
        };
        let neighbour = || "v2".to_owned();
        assert_eq!(changes.in_health(&lying(false)), []);
        assert_eq!(
            changes.in_health(&lying(true)),
            [Change::OdometryDoubted {
                neighbour: neighbour()
            }]
        );
        assert_eq!(changes.in_health(&lying(true)), []);
        assert_eq!(
            changes.in_health(&lying(false)),
            [Change::OdometryBelieved {
                neighbour: neighbour()
            }]
        );
    }

    fn of_the_team(change: impl Fn(&mut TeamHealth)) -> HealthDocument {
        let mut health = steady(1);
        change(health.rounds.team.insert(TeamHealth::default()));
        health
    }

    #[test]
    fn each_time_the_estimator_of_the_team_begins_again_is_told_once() {
        let mut changes = started();
        assert_eq!(changes.in_health(&of_the_team(|_| ())), []);
        for restarts in [1, 2] {
            let again = of_the_team(|team| team.restarts = restarts);
            assert_eq!(
                changes.in_health(&again),
                [Change::TeamRestarted { restarts }]
            );
            assert_eq!(changes.in_health(&again), []);
        }
    }

    #[test]
    fn noise_beyond_a_factor_of_two_is_told_once_until_it_was_fair_again() {
        let mut changes = started();
        let mut told = |scale| {
            let noisy = of_the_team(|team| team.noise_scales.odometry_rotation = scale);
            changes.in_health(&noisy)
        };
        let unfair = |scale| {
            [Change::UnfairNoise {
                of: "odometry rotation",
                scale,
            }]
        };
        assert_eq!(told(2.0), []);
        assert_eq!(told(2.01), unfair(2.01));
        for hovering in [2.5, 1.9, 2.01] {
            assert_eq!(told(hovering), [], "{hovering}");
        }
        assert_eq!(told(1.0), []);
        assert_eq!(told(0.49), unfair(0.49));
    }

    #[test]
    fn what_the_process_loses_is_told_once() {
        let mut changes = started();
        let mut alone = steady(1);
        let process = alone.process.as_mut().unwrap();
        process.peers = 0;
        process.log_complete = Some(false);
        let full = QueueHealth {
            dropped: 3,
            ..QueueHealth::default()
        };
        process.queues.insert("outbox".to_owned(), full);
        let told = changes.in_health(&alone);
        let queue = "outbox".to_owned();
        assert_eq!(
            told,
            [
                Change::Disconnected,
                Change::Overflow { queue },
                Change::LogIncomplete
            ]
        );
        assert_eq!(changes.in_health(&alone), []);
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let mut changes = started();
        for round in 0..10 {
            let flood = of_v2(|v2| {
                v2.refused = (0..50).map(|n| (format!("r{round}_{n}"), 1)).collect();
            });
            changes.in_health(&flood);
        }
        assert_eq!(changes.neighbours["v2"].refused.len(), REASONS_MAX);
        let mut empty = steady(2);
        empty.neighbours.clear();
        changes.in_health(&empty);
        assert!(changes.neighbours.is_empty());
    }
}
