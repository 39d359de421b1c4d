//! What is known of the vehicles that are watched, and how it is shown: as a table, or as a line when something changed.

use crate::command::get::age;
use crate::command::output::plain;
use crate::command::sigma;
use skein_estimation::time::Stamp;
use skein_proto::document::EstimateDocument;
use skein_proto::limits::NEIGHBOURS_MAX;
use skein_proto::name::Name;
use skein_proto::status::Status;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Vehicles shown at most; further ones are counted.
const VEHICLES_MAX: usize = 256;
/// Characters of a reason that are kept.
const WHY_CHARS_MAX: usize = 300;

/// The vehicles by name. Holds at most [`VEHICLES_MAX`] of them, each of a bounded size.
pub(super) struct Board {
    rows: BTreeMap<Name, Row>,
    cut: u64,
    every: Duration,
}

#[derive(Default)]
struct Row {
    boot: Option<u64>,
    vanished: bool,
    shown: Option<Shown>,
    told_at: Option<Instant>,
}

/// The part of an estimate that is shown.
struct Shown {
    taken_ns: i64,
    status: Status,
    /// East, north, up in metres, and yaw in degrees.
    pose: Option<([f64; 3], f64)>,
    /// How far off the position may be, in metres.
    sigma: String,
    neighbours: Vec<Name>,
    why: Option<String>,
}

impl Shown {
    fn of(estimate: &EstimateDocument) -> Self {
        let why = |why: &String| plain(&why.chars().take(WHY_CHARS_MAX).collect::<String>());
        let neighbours = estimate.neighbours.iter().take(NEIGHBOURS_MAX);
        Self {
            taken_ns: estimate.taken_ns,
            status: estimate.status,
            pose: estimate
                .pose
                .as_ref()
                .map(|pose| (pose.position_m, pose.yaw_pitch_roll_deg[0])),
            sigma: sigma::position_m(estimate.covariance.as_ref(), 2),
            neighbours: neighbours.map(|neighbour| neighbour.vehicle).collect(),
            why: estimate.why.as_ref().map(why),
        }
    }

    /// Whether people would call it news.
    fn differs(&self, before: &Self) -> bool {
        self.status != before.status
            || self.neighbours != before.neighbours
            || self.why.is_some() != before.why.is_some()
    }
}

impl Board {
    /// A board that repeats what has not changed after `every`.
    pub(super) fn new(every: Duration) -> Self {
        Self {
            rows: BTreeMap::new(),
            cut: 0,
            every,
        }
    }

    /// Takes an estimate; the line that it is worth.
    pub(super) fn estimate(
        &mut self,
        estimate: &EstimateDocument,
        now: Stamp,
        at: Instant,
    ) -> Option<String> {
        let every = self.every;
        let row = self.row(estimate.vehicle)?;
        let shown = Shown::of(estimate);
        let due = row
            .told_at
            .is_none_or(|told| at.saturating_duration_since(told) >= every);
        let news = row
            .shown
            .as_ref()
            .is_none_or(|before| shown.differs(before));
        row.shown = Some(shown);
        if !due && !news {
            return None;
        }
        row.told_at = Some(at);
        Some(row.line(estimate.vehicle, now))
    }

    /// Takes a token that came; the line that it is worth.
    pub(super) fn appeared(&mut self, vehicle: Name, boot: u64) -> Option<String> {
        let row = self.row(vehicle)?;
        row.boot = Some(boot);
        row.vanished = false;
        Some(format!("{:<13} appeared", vehicle.as_str()))
    }

    /// Takes a token that went; the line that it is worth. An old boot's is worth none.
    pub(super) fn vanished(&mut self, vehicle: Name, boot: u64) -> Option<String> {
        let row = self.row(vehicle)?;
        if row.boot.is_some_and(|newest| newest != boot) {
            return None;
        }
        row.vanished = true;
        Some(format!("{:<13} vanished", vehicle.as_str()))
    }

    /// The row of a vehicle. When there is room for no more, one that vanished makes place; else there is none.
    fn row(&mut self, vehicle: Name) -> Option<&mut Row> {
        if !self.rows.contains_key(&vehicle) && self.rows.len() >= VEHICLES_MAX {
            let gone = self.rows.iter().find(|(_, row)| row.vanished);
            let Some(gone) = gone.map(|(name, _)| *name) else {
                self.cut += 1;
                return None;
            };
            self.rows.remove(&gone);
        }
        Some(self.rows.entry(vehicle).or_default())
    }

    /// The lines of a table that fits into so many columns and rows; none while there is nothing to show.
    pub(super) fn table(&self, now: Stamp, width: usize, height: usize) -> Vec<String> {
        if self.rows.is_empty() {
            return vec![];
        }
        let room = height.saturating_sub(2).max(2);
        let mut lines = vec![header()];
        let mut hidden = self.cut > 0;
        for (vehicle, row) in &self.rows {
            if lines.len() == room {
                hidden = true;
                break;
            }
            lines.push(row.line(*vehicle, now));
        }
        if hidden {
            lines.push("... and more vehicles: `skein watch VEHICLE` shows one".to_owned());
        }
        for line in &mut lines {
            *line = line.chars().take(width).collect();
        }
        lines
    }
}

/// Titles of the columns, which fill a terminal of 80 characters up to yaw.
fn header() -> String {
    format!(
        "{:<13} {:<14} {:>6} {:>9} {:>9} {:>9} {:>6} {:>7}  {}",
        "vehicle",
        "status",
        "age s",
        "x m",
        "y m",
        "z m",
        "+- m",
        "yaw deg",
        "neighbours present; why"
    )
}

impl Row {
    fn line(&self, vehicle: Name, now: Stamp) -> String {
        // As a text: a name by itself does not fill its column.
        let vehicle = vehicle.as_str();
        let Some(shown) = &self.shown else {
            let word = if self.vanished {
                "vanished"
            } else {
                "no estimate yet"
            };
            return format!("{vehicle:<13} {word}");
        };
        let status = if self.vanished {
            "vanished"
        } else {
            shown.status.words()
        };
        let pose = match shown.pose {
            Some(([x, y, z], yaw)) => {
                let sigma = &shown.sigma;
                format!("{x:>9.3} {y:>9.3} {z:>9.3} {sigma:>6} {yaw:>7.2}")
            }
            None => format!("{:>9} {:>9} {:>9} {:>6} {:>7}", "-", "-", "-", "-", "-"),
        };
        let neighbours: Vec<&str> = shown.neighbours.iter().map(Name::as_str).collect();
        let neighbours = if neighbours.is_empty() {
            "-".to_owned()
        } else {
            neighbours.join(",")
        };
        let why = shown
            .why
            .as_deref()
            .map_or_else(String::new, |why| format!("; {why}"));
        format!(
            "{vehicle:<13} {status:<14} {:>6} {pose}  {neighbours}{why}",
            age(now, shown.taken_ns)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::real_now;
    use crate::command::sigma::tests::covariance;
    use skein_proto::document::{NeighbourDocument, PoseDocument};

    const EVERY: Duration = Duration::from_secs(1);
    const NOW: Stamp = Stamp::from_nanos(1_500_000_000);

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn estimate(vehicle: &str, status: Status, neighbours: &[&str]) -> EstimateDocument {
        EstimateDocument {
            vehicle: name(vehicle),
            boot: "00000000000000ab".to_owned(),
            taken_ns: 1_000_000_000,
            status,
            pose: Some(PoseDocument {
                position_m: [1.0, -2.0, 3.0],
                quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
                yaw_pitch_roll_deg: [90.0, 0.0, 0.0],
                rotation_vector_rad: [0.0; 3],
            }),
            velocity: None,
            covariance: None,
            neighbours: neighbours
                .iter()
                .map(|of| NeighbourDocument {
                    vehicle: name(of),
                    status: None,
                    taken_ns: None,
                    pose: None,
                    covariance: None,
                    mutual: None,
                    ranging: None,
                })
                .collect(),
            features: vec![],
            motion: None,
            why: (status != Status::Tracking).then(|| "nobody\u{1b}[2J measures".to_owned()),
        }
    }

    #[test]
    fn a_line_tells_where_how_why_and_with_whom() {
        let mut board = Board::new(EVERY);
        let told = board.estimate(
            &estimate("v1", Status::Alone, &["v2", "v3"]),
            NOW,
            real_now(),
        );
        let line = told.unwrap();
        assert_eq!(
            line.find("alone"),
            header().find("status"),
            "under its title"
        );
        for expected in [
            "v1",
            "alone",
            "0.50",
            "-2.000",
            "90.00",
            "v2,v3; nobody [2J measures",
        ] {
            assert!(line.contains(expected), "{expected}: {line}");
        }
    }

    #[test]
    fn a_line_tells_how_far_off_the_position_may_be_when_the_estimator_says() {
        let mut board = Board::new(Duration::ZERO);
        let mut told = |covariance| {
            let published = EstimateDocument {
                covariance,
                ..estimate("v1", Status::Tracking, &["v2"])
            };
            board.estimate(&published, NOW, real_now()).unwrap()
        };
        let (known, unknown) = (told(Some(covariance(0.1, 0.2))), told(None));
        let ends = |text: &str, word: &str| text.find(word).map(|at| at + word.len());
        assert_eq!(ends(&known, "+-0.35"), ends(&header(), "+- m"), "{known}");
        assert_eq!(
            ends(&known, "90.00"),
            Some(80),
            "a terminal has its yaw too"
        );
        assert!(unknown.contains("3.000      -   90.00"), "{unknown}");
    }

    #[test]
    fn what_has_not_changed_is_told_again_only_after_the_interval() {
        let mut board = Board::new(EVERY);
        let start = real_now();
        let mut told = |status, neighbours: &[&str], after_ms| {
            let at = start + Duration::from_millis(after_ms);
            board
                .estimate(&estimate("v1", status, neighbours), NOW, at)
                .is_some()
        };
        assert!(told(Status::Tracking, &["v2"], 0));
        assert!(!told(Status::Tracking, &["v2"], 999));
        assert!(told(Status::Tracking, &["v2"], 1_000));
        assert!(told(Status::Tracking, &[], 1_001), "a neighbour went");
        assert!(told(Status::Alone, &[], 1_002), "another status");
        assert!(!told(Status::Alone, &[], 1_003));
    }

    #[test]
    fn vehicles_come_and_go_and_an_old_boot_does_not_take_the_new_one_along() {
        let mut board = Board::new(EVERY);
        assert!(board.appeared(name("v1"), 1).is_some());
        assert!(board.table(NOW, 80, 24)[1].contains("no estimate yet"));
        assert!(board.appeared(name("v1"), 2).is_some());
        assert_eq!(board.vanished(name("v1"), 1), None);
        assert!(board.vanished(name("v1"), 2).unwrap().contains("vanished"));
        assert!(board.table(NOW, 80, 24)[1].contains("vanished"));
    }

    #[test]
    fn the_table_fits_the_terminal() {
        let mut board = Board::new(EVERY);
        for n in 0..30 {
            board.estimate(
                &estimate(&format!("v{n}"), Status::Lost, &[]),
                NOW,
                real_now(),
            );
        }
        let lines = board.table(NOW, 60, 10);
        assert!(lines.len() < 10, "{lines:#?}");
        assert!(lines.iter().all(|line| line.chars().count() <= 60));
        assert!(lines.last().unwrap().contains("more vehicles"));
        assert_eq!(board.table(NOW, 200, 40).len(), 31);
    }

    #[test]
    fn at_its_limit_it_holds_every_vehicle_and_one_past_it_one_that_vanished_makes_place() {
        let mut board = Board::new(EVERY);
        for n in 0..VEHICLES_MAX {
            board.appeared(name(&format!("v{n}")), 1);
        }
        assert_eq!((board.rows.len(), board.cut), (VEHICLES_MAX, 0));
        assert_eq!(board.appeared(name("more"), 1), None);
        assert_eq!((board.rows.len(), board.cut), (VEHICLES_MAX, 1));
        board.vanished(name("v7"), 1);
        assert!(board.appeared(name("more"), 1).is_some());
        assert_eq!(board.rows.len(), VEHICLES_MAX);
    }
}
