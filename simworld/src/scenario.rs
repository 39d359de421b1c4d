//! A scenario: which vehicles fly where, what they measure and what the radio does to them. Read from TOML text in
//! which every misspelt key and every impossible number is an error that names its place.

mod aboard;
mod error;
mod team;

pub use aboard::{BYSTANDERS_MAX, CAMERA_TIME_MAX_S, READINGS_PER_S_MAX, SIGHTINGS_MAX};
pub use error::ScenarioError;
pub use team::{Formation, Start, Team, Vehicle};

use crate::anonymous::CameraSettings;
use crate::bounded::{not_negative, positive};
use crate::quadrotor::ImuSettings;
use crate::radio::RadioSettings;
use crate::sensor::{OdometryNoise, SensorSettings};
use crate::streams::{Purpose, Streams};
use crate::trajectory::Trajectory;
use crate::truth::Pose;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// The largest fleet of a scenario.
pub const VEHICLES_MAX: usize = 1000;

/// The most rounds of a scenario, before and after the start of the motion together.
pub const ROUNDS_MAX: usize = 1_000_000;

/// How the vehicles' clocks differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Clocks {
    /// Each clock is ahead of the simulation's by a random constant from 0 to this, seconds.
    #[serde(deserialize_with = "not_negative")]
    pub ahead_s_max: f64,
}

/// Everything a virtual flight needs to know. Its times are seconds since the start of the motion (k = 0); it runs
/// from `-standstill_s` to `duration_s`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// One line about it.
    #[serde(default)]
    pub description: String,
    /// When it ends, seconds.
    #[serde(deserialize_with = "positive")]
    pub duration_s: f64,
    /// The round's period P, seconds.
    #[serde(default = "section_v_period_s", deserialize_with = "positive")]
    pub period_s: f64,
    /// How long everyone stands before the start of the motion, seconds; clocks are compared meanwhile.
    #[serde(default = "two_seconds", deserialize_with = "not_negative")]
    pub standstill_s: f64,
    /// The seed of every random stream.
    #[serde(default = "one")]
    pub seed: u64,
    /// Who flies.
    pub team: Team,
    /// Who flies along and says nothing: cameras see them too.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bystanders: Vec<Trajectory>,
    /// How their clocks differ.
    #[serde(default)]
    pub clocks: Clocks,
    /// Whether all stay on one level, and are told so. Only those located by distances alone care.
    #[serde(default)]
    pub planar: bool,
    /// Whether they take turns to move.
    #[serde(default)]
    pub schedule: bool,
    /// The noise of everyone's odometry in one round.
    #[serde(default)]
    pub odometry: OdometryNoise,
    /// Everyone's relative sensor.
    #[serde(default)]
    pub sensor: SensorSettings,
    /// Everyone's inertial sensor, if they have one. Only quadrotors do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imu: Option<ImuSettings>,
    /// Everyone's camera that sees robots and not which robots, if they have one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraSettings>,
    /// The radio.
    #[serde(default)]
    pub radio: RadioSettings,
}

fn section_v_period_s() -> f64 {
    0.2
}

fn two_seconds() -> f64 {
    2.0
}

fn one() -> u64 {
    1
}

const BUILT_IN: [(&str, &str); 10] = [
    ("section-v", include_str!("../scenarios/section-v.toml")),
    (
        "section-v-lossy",
        include_str!("../scenarios/section-v-lossy.toml"),
    ),
    (
        "section-v-harsh",
        include_str!("../scenarios/section-v-harsh.toml"),
    ),
    (
        "section-v-partition",
        include_str!("../scenarios/section-v-partition.toml"),
    ),
    (
        "section-v-mounted",
        include_str!("../scenarios/section-v-mounted.toml"),
    ),
    (
        "parallel-lines",
        include_str!("../scenarios/parallel-lines.toml"),
    ),
    ("hover", include_str!("../scenarios/hover.toml")),
    ("square", include_str!("../scenarios/square.toml")),
    ("eight", include_str!("../scenarios/eight.toml")),
    ("ranges", include_str!("../scenarios/ranges.toml")),
];

impl Scenario {
    /// Reads a scenario from TOML text; `origin` is what an error calls the text, usually a file's name. Fails when
    /// the text is no scenario, with the line and the key.
    pub fn parse(text: &str, origin: &str) -> Result<Self, ScenarioError> {
        let scenario: Self =
            toml::from_str(text).map_err(|error| ScenarioError::of_toml(text, origin, &error))?;
        scenario
            .check()
            .map_err(|(key, message)| ScenarioError::of_key(text, origin, key, message))?;
        Ok(scenario)
    }

    /// The scenario of this name that comes with the program, if there is one.
    #[must_use]
    pub fn built_in(name: &str) -> Option<Self> {
        Self::built_in_text(name).map(|text| {
            Self::parse(text, name).expect("a built-in scenario is valid, a test reads every one")
        })
    }

    /// The TOML text of a built-in scenario, to copy and change.
    #[must_use]
    pub fn built_in_text(name: &str) -> Option<&'static str> {
        BUILT_IN
            .iter()
            .find(|(known, _)| *known == name)
            .map(|(_, text)| *text)
    }

    /// The names of the built-in scenarios.
    pub fn built_in_names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// The random streams of one repetition.
    #[must_use]
    pub const fn streams(&self, sample: u64) -> Streams {
        Streams::new(self.seed, sample)
    }

    /// How far the clock of a vehicle is ahead of the simulation's in one repetition, nanoseconds.
    #[must_use]
    pub fn clock_ahead_ns(&self, sample: u64, vehicle: usize) -> i64 {
        let share: f64 = self
            .streams(sample)
            .vehicle(vehicle, Purpose::Clock)
            .random();
        (share * self.clocks.ahead_s_max * 1e9).round() as i64
    }

    /// The last round, counted from k = 0 at the start of the motion.
    #[must_use]
    pub fn rounds(&self) -> usize {
        // A hundred rounds of 0.2 s are 20 s, whatever the last bit of the quotient says.
        (self.duration_s / self.period_s + 1e-9).floor() as usize
    }

    /// The laws that join several keys; the key to blame comes first.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let rounds = (self.duration_s + self.standstill_s) / self.period_s;
        if rounds > ROUNDS_MAX as f64 {
            return Err((
                "duration_s",
                format!("{rounds:.0} rounds are more than {ROUNDS_MAX}"),
            ));
        }
        aboard::check(self)?;
        for vehicle in self.team.vehicles() {
            let ends_s = [0.0, self.duration_s];
            if !ends_s
                .iter()
                .all(|t_s| is_finite(&vehicle.trajectory.pose_at(*t_s)))
            {
                let message = format!(
                    "the path of `{}` does not have finite numbers",
                    vehicle.name
                );
                return Err(("trajectory", message));
            }
        }
        if !self
            .sensor
            .mounts
            .iter()
            .all(|mount| is_finite(&mount.body_from_sensor()))
        {
            return Err(("mounts", "a mount has a number that is not finite".into()));
        }
        self.radio.check(self.team.len())?;
        if self
            .sensor
            .changes
            .windows(2)
            .any(|pair| pair[1].from_s <= pair[0].from_s)
        {
            return Err((
                "changes",
                "the changes of the sensor's kind are not in the order of their times".into(),
            ));
        }
        Ok(())
    }
}

fn is_finite(pose: &Pose) -> bool {
    let rotation = pose.rotation.coords.iter();
    rotation
        .chain(pose.translation.vector.iter())
        .all(|number| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::{LINKS_MAX, PARTITIONS_MAX, SILENCES_MAX};
    use crate::sensor::{Kind, Taken};
    use crate::trajectory::Trajectory;

    const SMALLEST: &str =
        "name = \"x\"\nduration_s = 5\n\n[team]\ncount = 2\nformation = \"hover\"\n";

    #[test]
    fn every_built_in_scenario_is_valid_and_known_by_its_own_name() {
        for name in Scenario::built_in_names() {
            let text = Scenario::built_in_text(name).unwrap();
            let scenario = Scenario::parse(text, name).unwrap();
            assert_eq!(scenario.name, name);
            // It takes a while to find out who is who, or where.
            let finds_out = matches!(name, "square" | "eight" | "ranges");
            let rounds = if finds_out { 300 } else { 100 };
            assert_eq!(scenario.rounds(), rounds);
        }
        assert_eq!(Scenario::built_in("nowhere"), None);
    }

    #[test]
    fn section_v_is_what_the_defaults_are_made_of() {
        let scenario = Scenario::built_in("section-v").unwrap();
        assert_eq!(scenario.sensor, SensorSettings::default());
        assert_eq!(scenario.odometry, OdometryNoise::default());
        assert_eq!(scenario.radio, RadioSettings::default());
        assert_eq!(scenario.team.len(), 5);
        for (index, vehicle) in scenario.team.vehicles().iter().enumerate() {
            let Trajectory::SectionV(path) = vehicle.trajectory else {
                panic!("{vehicle:?}")
            };
            assert_eq!(
                (path.robot.get() as usize, vehicle.start),
                (index + 1, Start::Pose)
            );
        }
    }

    #[test]
    fn the_lossy_and_the_mounted_variant_differ_in_what_their_names_say() {
        let lossy = Scenario::built_in("section-v-lossy").unwrap();
        assert_eq!((lossy.radio.loss, lossy.radio.delay_s), (0.3, 0.1));
        let mounted = Scenario::built_in("section-v-mounted").unwrap();
        assert_eq!(mounted.sensor.taken, Taken::AnywhereInRound);
        for vehicle in 0..5 {
            let body_from_sensor = mounted.sensor.body_from_sensor(vehicle);
            assert!((body_from_sensor.translation.vector.norm() - 0.3).abs() < 1e-12);
            assert!((body_from_sensor.rotation.angle().to_degrees() - 20.0).abs() < 1e-9);
        }
        let ahead: Vec<i64> = (0..5)
            .map(|vehicle| mounted.clock_ahead_ns(0, vehicle))
            .collect();
        assert!(
            ahead.iter().all(|ns| (0..=200_000_000).contains(ns)) && ahead[0] != ahead[1],
            "{ahead:?}"
        );
    }

    #[test]
    fn vehicles_can_be_listed_one_by_one() {
        let text = r#"
            name = "two"
            duration_s = 10
            [[team.vehicles]]
            trajectory.circle = { centre_m = [0, 0, 1], radius_m = 2, period_s = 10 }
            [[team.vehicles]]
            name = "lost"
            start = "unknown"
            trajectory.hover = { position_m = [0, 0, 2] }
            [sensor]
            kind = "bearing"
        "#;
        let scenario = Scenario::parse(text, "two.toml").unwrap();
        let vehicles = scenario.team.vehicles();
        assert_eq!(
            (vehicles[0].name.as_str(), vehicles[0].start),
            ("v1", Start::Pose)
        );
        assert_eq!(
            (vehicles[1].name.as_str(), vehicles[1].start),
            ("lost", Start::Unknown)
        );
        assert_eq!(scenario.sensor.kind, Kind::Bearing);
    }

    #[test]
    fn a_misspelt_key_is_an_error_with_its_line_and_its_name() {
        let error =
            Scenario::parse(&format!("{SMALLEST}[sensor]\nrang_m = 3\n"), "mine.toml").unwrap_err();
        assert_eq!((error.line(), error.key()), (8, Some("sensor.rang_m")));
        assert!(
            error
                .to_string()
                .starts_with("mine.toml:8:1: sensor.rang_m: unknown field `rang_m`"),
            "{error}"
        );
    }

    #[test]
    fn an_impossible_number_is_an_error_with_its_line_and_its_key() {
        let error = Scenario::parse(
            &format!("{SMALLEST}[radio]\ndelay_s = 0.1\nloss = 1.5\n"),
            "mine.toml",
        )
        .unwrap_err();
        assert_eq!((error.line(), error.key()), (9, Some("radio.loss")));
        assert!(
            error.to_string().contains("1.5 is not a probability"),
            "{error}"
        );
    }

    #[test]
    fn a_bad_concentration_inside_an_inline_table_names_the_table_s_key() {
        let text = format!("{SMALLEST}[sensor]\nnoise = {{ rotation_concentration = -4 }}\n");
        let error = Scenario::parse(&text, "mine.toml").unwrap_err();
        assert_eq!((error.line(), error.key()), (8, Some("sensor.noise")));
    }

    #[test]
    fn a_missing_key_is_named() {
        let error = Scenario::parse(
            "name = \"x\"\n[team]\ncount = 2\nformation = \"hover\"\n",
            "mine.toml",
        )
        .unwrap_err();
        assert!(
            error.to_string().contains("missing field `duration_s`"),
            "{error}"
        );
    }

    #[test]
    fn laws_that_join_keys_blame_a_line_too() {
        let text =
            format!("{SMALLEST}[radio]\nsilences = [{{ from_s = 1, to_s = 2, vehicles = [2] }}]\n");
        let error = Scenario::parse(&text, "mine.toml").unwrap_err();
        assert_eq!((error.line(), error.key()), (8, Some("silences")));
        assert!(error.to_string().contains("no vehicle 2"), "{error}");
    }

    #[test]
    fn every_setting_of_the_radio_that_cannot_be_is_an_error_with_its_line_and_its_key() {
        let cases = [
            (
                "jitter_s = -0.1",
                "radio.jitter_s",
                "not a delay from 0 to 10 s",
            ),
            (
                "delay_s = nan",
                "radio.delay_s",
                "not a delay from 0 to 10 s",
            ),
            (
                "burst = { share = 0.1, mean_s = 0 }",
                "radio.burst",
                "burst.mean_s must lie",
            ),
            (
                "[radio.burst]\nshare = 2\nmean_s = 1",
                "radio.burst",
                "burst.share must lie",
            ),
            (
                "reorder = { probability = 0.1 }",
                "radio.reorder",
                "missing field `delay_s`",
            ),
            (
                "duplicate = { probability = 7, delay_s = 0.1 }",
                "radio.duplicate",
                "duplicate.probability must lie",
            ),
            (
                "rate_limit = { bytes_per_s = 1000, bucket_bytes = 10 }",
                "radio.rate_limit",
                "rate_limit.bucket_bytes must lie",
            ),
            (
                "links = [{ from = 0, to = 1, loss = 2 }]",
                "radio.links",
                "links.loss must lie",
            ),
            (
                "links = [{ from = 1, to = 1 }]",
                "radio.links",
                "not one with itself",
            ),
            (
                "links = [{ from = 0, to = 2 }]",
                "links",
                "there is no vehicle 2",
            ),
            (
                "[[radio.links]]\nfrom = 0\nto = 2",
                "links",
                "there is no vehicle 2",
            ),
            (
                "partitions = [{ from_s = 2, to_s = 2, groups = [[0], [1]] }]",
                "radio.partitions",
                "heals at 2 s, before it begins",
            ),
            (
                "partitions = [{ from_s = 1, to_s = 2, groups = [[0, 1]] }]",
                "radio.partitions",
                "two groups or more",
            ),
            (
                "partitions = [{ from_s = 1, to_s = 2, groups = [[0, 1], [1]] }]",
                "radio.partitions",
                "in two groups",
            ),
            (
                "partitions = [{ from_s = 1, to_s = 2, groups = [[0], [5]] }]",
                "partitions",
                "there is no vehicle 5",
            ),
            (
                "[[radio.silences]]\nfrom_s = 3\nto_s = 2",
                "silences",
                "before it begins",
            ),
        ];
        for (setting, key, why) in cases {
            let text = format!("{SMALLEST}[radio]\n{setting}\n");
            let error = Scenario::parse(&text, "mine.toml").unwrap_err();
            assert_eq!((error.line(), error.key()), (8, Some(key)), "{error}");
            assert!(error.message().contains(why), "{setting}: {error}");
        }
    }

    #[test]
    fn the_radio_that_the_readme_shows_can_be_flown_and_uses_every_key() {
        let readme = include_str!("../../README.md");
        let radio = readme.split("```toml\n[radio]\n").nth(1).unwrap();
        let radio = radio.split("```").next().unwrap();
        let team = SMALLEST.replace("count = 2", "count = 5");
        let scenario = Scenario::parse(&format!("{team}[radio]\n{radio}"), "README.md").unwrap();
        let written = toml::to_string(&scenario.radio).unwrap();
        let keys: toml::Table = toml::from_str(&written).unwrap();
        assert_eq!(keys.len(), 11, "{written}");
        for key in keys.keys() {
            assert!(radio.contains(&format!("{key} = ")), "{key}");
        }
    }

    #[test]
    fn silences_and_partitions_are_bounded() {
        let entries = |entry: &str, n: usize| format!("[{}]", [entry].repeat(n).join(", "));
        let silences = |n| format!("silences = {}", entries("{ from_s = 1, to_s = 2 }", n));
        let partition = "{ from_s = 1, to_s = 2, groups = [[0], [1]] }";
        let partitions = |n| format!("partitions = {}", entries(partition, n));
        let link = |k: usize| format!("{{ from = 0, to = {} }}", k + 1);
        let links = |n: usize| {
            let list: Vec<String> = (0..n).map(link).collect();
            format!("links = [{}]", list.join(", "))
        };
        let team = SMALLEST.replace("count = 2", &format!("count = {VEHICLES_MAX}"));
        let is_allowed =
            |setting: String| Scenario::parse(&format!("{team}[radio]\n{setting}\n"), "x").is_ok();
        assert!(is_allowed(silences(SILENCES_MAX)) && !is_allowed(silences(SILENCES_MAX + 1)));
        assert!(is_allowed(partitions(PARTITIONS_MAX)));
        assert!(!is_allowed(partitions(PARTITIONS_MAX + 1)));
        assert!(is_allowed(links(LINKS_MAX)) && !is_allowed(links(LINKS_MAX + 1)));
    }

    #[test]
    fn a_path_or_a_mount_that_leads_nowhere_is_refused() {
        let path = "name = \"x\"\nduration_s = 5\n[[team.vehicles]]\ntrajectory.hover = { position_m = [0, nan, 0] }\n";
        let error = Scenario::parse(path, "mine.toml").unwrap_err();
        assert_eq!(error.key(), Some("trajectory"), "{error}");
        let mount = format!("{SMALLEST}[sensor]\nmounts = [{{ yaw_deg = inf }}]\n");
        let error = Scenario::parse(&mount, "mine.toml").unwrap_err();
        assert_eq!((error.line(), error.key()), (8, Some("mounts")), "{error}");
    }

    #[test]
    fn a_team_is_bounded() {
        for (count, allowed) in [
            (0, false),
            (1, true),
            (VEHICLES_MAX, true),
            (VEHICLES_MAX + 1, false),
        ] {
            let text = SMALLEST.replace("count = 2", &format!("count = {count}"));
            assert_eq!(
                Scenario::parse(&text, "mine.toml").is_ok(),
                allowed,
                "{count}"
            );
        }
    }

    #[test]
    fn a_scenario_survives_being_written_and_read() {
        for name in Scenario::built_in_names() {
            let scenario = Scenario::built_in(name).unwrap();
            let text = toml::to_string(&scenario).unwrap();
            assert_eq!(Scenario::parse(&text, "again").unwrap(), scenario);
        }
    }
}
