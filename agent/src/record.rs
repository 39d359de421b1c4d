//! The input log: every input with its time and every output that it caused, in an MCAP file that a later run repeats
//! bit by bit (`verify`). Written by its own thread over a bounded queue; a killed process leaves a readable prefix.
//!
//! The file has one metadata record `skein` (who flew, with the vehicle's configuration), and two channels of postcard:
//! `input` (`InputRecord`) and, behind each of those, its `output`s (`OutputRecord`). Message sequence = step.

use crate::queue::{Queue, WhenFull};
use mcap::records::{MessageHeader, Metadata};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use skein_estimation::cooperative::{
    AnchorWeight, Descent, GaussNewton, Kernel, Mode, Optimiser, Robust, Weighting,
};
use skein_estimation::ranging::Dimension;
use skein_estimation::time::{Span, Stamp};
use skein_estimation::transform::Transform;
use skein_proto::document::QueueHealth;
use skein_proto::keys::boot_text;
use skein_proto::name::Name;
use skein_vehicle::{
    Checkpoint, Config, Input, MutualConfig, MutualWay, Output, PacketKey, RangingConfig,
    SensorConfig, Start, ToldPose,
};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Steps that wait for the disk at most: some seconds of a busy vehicle.
const STEPS_MAX: usize = 8_192;
/// The name of this form of log.
pub(crate) const FORMAT: &str = "skein-log 4";
/// The metadata record and the channels.
pub(crate) const METADATA: &str = "skein";
pub(crate) const INPUT: &str = "input";
pub(crate) const OUTPUT: &str = "output";

type Writer = mcap::Writer<BufWriter<File>>;

/// One call of [`skein_vehicle::Vehicle::handle`] and what came of it. The first has no input: the vehicle was made.
pub(crate) struct Step {
    vehicle: Name,
    pub(crate) input: InputRecord,
    pub(crate) outputs: Vec<OutputRecord>,
}

/// Message on the channel `input`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct InputRecord {
    pub(crate) now_ns: i64,
    /// How many outputs follow.
    pub(crate) outputs: u32,
    pub(crate) input: Option<Input>,
}

/// Message on the channel `output`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum OutputRecord {
    Send { key: PacketKey, bytes: Vec<u8> },
    Estimate { packet: Vec<u8> },
    Health { json: String },
    WakeAt { stamp_ns: i64 },
    Checkpoint { bytes: Vec<u8> },
    Ask { to: Name, boot: u64, since_ns: i64 },
    Answer { query: u64, packets: Vec<Vec<u8>> },
    Work { number: u64 },
}

impl OutputRecord {
    pub(crate) fn of(output: &Output, vehicle: Name) -> Self {
        match output {
            Output::Send { key, bytes } => Self::Send {
                key: *key,
                bytes: bytes.clone(),
            },
            Output::Estimate { packet, .. } => Self::Estimate {
                packet: packet.clone(),
            },
            Output::Health(document) => Self::Health {
                json: serde_json::to_string(document)
                    .expect("documents have string keys and always serialise"),
            },
            Output::WakeAt(stamp) => Self::WakeAt {
                stamp_ns: stamp.as_nanos(),
            },
            Output::Checkpoint(checkpoint) => Self::Checkpoint {
                bytes: checkpoint.encode(vehicle).to_vec(),
            },
            Output::Ask { to, boot, since_ns } => Self::Ask {
                to: *to,
                boot: *boot,
                since_ns: *since_ns,
            },
            Output::Work(work) => Self::Work {
                number: work.number(),
            },
            Output::Answer { query, packets } => Self::Answer {
                query: *query,
                packets: packets.clone(),
            },
        }
    }
}

impl Step {
    pub(crate) fn new(vehicle: Name, now: Stamp, input: Option<Input>) -> Self {
        Self {
            vehicle,
            input: InputRecord {
                now_ns: now.as_nanos(),
                outputs: 0,
                input,
            },
            outputs: vec![],
        }
    }

    pub(crate) fn add(&mut self, output: &Output) {
        self.input.outputs += 1;
        self.outputs.push(OutputRecord::of(output, self.vehicle));
    }
}

/// Everything that a vehicle was made from, to the bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) started_ns: i64,
    vehicle: Name,
    boot: u64,
    period_ns: i64,
    round_wait_ns: i64,
    start: StartRecord,
    mode: ModeRecord,
    optimiser: OptimiserRecord,
    mutual: MutualRecord,
    ranging: RangingRecord,
    sensors: Vec<(Name, String, Pose)>,
    body_from_target: Pose,
    presence_timeout_ns: i64,
    repeats: u64,
    relay: bool,
    estimate_spacing_ns: i64,
}

/// Quaternion (x, y, z, w), then translation: as it is held, so that nothing is rounded.
type Pose = ([f64; 4], [f64; 3]);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum StartRecord {
    Pose {
        world_from_body: Pose,
        rotation_sigma_rad: f64,
        translation_sigma_m: f64,
    },
    Checkpoint(Vec<u8>),
    Unknown,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum ModeRecord {
    Paper,
    Star {
        by_noise: bool,
        anchor: [f64; 2],
        oriented_rotation: f64,
        floors: [f64; 2],
        widening: f64,
        narrowing: f64,
    },
    Team,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct MutualRecord {
    published: bool,
    bearings_to_cooperative: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct RangingRecord {
    spatial: bool,
    schedule: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum OptimiserRecord {
    GaussNewton {
        step_norm_max: f64,
        decrease_part_max: f64,
        iterations_max: u64,
    },
    Descent {
        first_step: f64,
        shrink: f64,
        sufficient_decrease: f64,
        gradient_norm_max: f64,
        iterations_max: u64,
    },
}

impl Header {
    pub(crate) fn of(config: &Config, started: Stamp) -> Self {
        Self {
            started_ns: started.as_nanos(),
            vehicle: config.vehicle,
            boot: config.boot,
            period_ns: config.period.as_nanos(),
            round_wait_ns: config.round_wait.as_nanos(),
            start: match &config.start {
                Start::Pose(told) => StartRecord::Pose {
                    world_from_body: record_pose(&told.world_from_body),
                    rotation_sigma_rad: told.rotation_sigma_rad,
                    translation_sigma_m: told.translation_sigma_m,
                },
                Start::Checkpoint(checkpoint) => {
                    StartRecord::Checkpoint(checkpoint.encode(config.vehicle).to_vec())
                }
                Start::Unknown => StartRecord::Unknown,
            },
            mode: record_mode(&config.mode),
            optimiser: record_optimiser(&config.optimiser),
            mutual: MutualRecord {
                published: config.mutual.way == MutualWay::Published,
                bearings_to_cooperative: config.mutual.bearings_to_cooperative,
            },
            ranging: RangingRecord {
                spatial: config.ranging.dimension == Dimension::Spatial,
                schedule: config.ranging.schedule,
            },
            sensors: config
                .sensors
                .iter()
                .map(|s| (s.name, s.driver.clone(), record_pose(&s.body_from_sensor)))
                .collect(),
            body_from_target: record_pose(&config.body_from_target),
            presence_timeout_ns: config.presence_timeout.as_nanos(),
            repeats: config.repeats as u64,
            relay: config.relay,
            estimate_spacing_ns: config.estimate_spacing.as_nanos(),
        }
    }

    pub(crate) fn config(&self) -> Config {
        Config {
            vehicle: self.vehicle,
            boot: self.boot,
            period: Span::from_nanos(self.period_ns),
            round_wait: Span::from_nanos(self.round_wait_ns),
            start: match &self.start {
                StartRecord::Pose {
                    world_from_body,
                    rotation_sigma_rad,
                    translation_sigma_m,
                } => Start::Pose(ToldPose {
                    world_from_body: read_pose(world_from_body),
                    rotation_sigma_rad: *rotation_sigma_rad,
                    translation_sigma_m: *translation_sigma_m,
                }),
                StartRecord::Checkpoint(bytes) => Checkpoint::decode(self.vehicle, bytes)
                    .map_or(Start::Unknown, Start::Checkpoint),
                StartRecord::Unknown => Start::Unknown,
            },
            mode: read_mode(&self.mode),
            optimiser: read_optimiser(&self.optimiser),
            mutual: MutualConfig {
                way: if self.mutual.published {
                    MutualWay::Published
                } else {
                    MutualWay::Persistent
                },
                bearings_to_cooperative: self.mutual.bearings_to_cooperative,
            },
            ranging: RangingConfig {
                dimension: if self.ranging.spatial {
                    Dimension::Spatial
                } else {
                    Dimension::Planar
                },
                schedule: self.ranging.schedule,
            },
            sensors: self
                .sensors
                .iter()
                .map(|(name, driver, pose)| SensorConfig {
                    name: *name,
                    driver: driver.clone(),
                    body_from_sensor: read_pose(pose),
                })
                .collect(),
            body_from_target: read_pose(&self.body_from_target),
            presence_timeout: Span::from_nanos(self.presence_timeout_ns),
            repeats: usize::try_from(self.repeats).unwrap_or(usize::MAX),
            relay: self.relay,
            estimate_spacing: Span::from_nanos(self.estimate_spacing_ns),
        }
    }
}

fn record_pose<To, From>(pose: &Transform<To, From>) -> Pose {
    let q = pose.rotation.coords;
    ([q.x, q.y, q.z, q.w], pose.translation.into())
}

fn read_pose<To, From>(&([x, y, z, w], translation): &Pose) -> Transform<To, From> {
    // Not normalised again: that could change the last bit.
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
    Transform::new(rotation, Vector3::from(translation))
}

const fn record_mode(mode: &Mode) -> ModeRecord {
    match *mode {
        Mode::Paper => ModeRecord::Paper,
        Mode::Star(Robust {
            weighting,
            anchor,
            oriented_rotation,
            kernel,
        }) => ModeRecord::Star {
            by_noise: matches!(weighting, Weighting::Noise),
            anchor: [anchor.rotation, anchor.translation],
            oriented_rotation,
            floors: [kernel.rotation_floor_rad, kernel.translation_floor_m],
            widening: kernel.widening,
            narrowing: kernel.narrowing,
        },
        Mode::Team => ModeRecord::Team,
    }
}

const fn read_mode(record: &ModeRecord) -> Mode {
    match *record {
        ModeRecord::Paper => Mode::Paper,
        ModeRecord::Team => Mode::Team,
        ModeRecord::Star {
            by_noise,
            anchor: [rotation, translation],
            oriented_rotation,
            floors: [rotation_floor_rad, translation_floor_m],
            widening,
            narrowing,
        } => Mode::Star(Robust {
            weighting: if by_noise {
                Weighting::Noise
            } else {
                Weighting::Unit
            },
            anchor: AnchorWeight {
                rotation,
                translation,
            },
            oriented_rotation,
            kernel: Kernel {
                rotation_floor_rad,
                translation_floor_m,
                widening,
                narrowing,
            },
        }),
    }
}

fn record_optimiser(optimiser: &Optimiser) -> OptimiserRecord {
    match *optimiser {
        Optimiser::GaussNewton(GaussNewton {
            step_norm_max,
            decrease_part_max,
            iterations_max,
        }) => OptimiserRecord::GaussNewton {
            step_norm_max,
            decrease_part_max,
            iterations_max: iterations_max as u64,
        },
        Optimiser::Descent(Descent {
            first_step,
            shrink,
            sufficient_decrease,
            gradient_norm_max,
            iterations_max,
        }) => OptimiserRecord::Descent {
            first_step,
            shrink,
            sufficient_decrease,
            gradient_norm_max,
            iterations_max: iterations_max as u64,
        },
    }
}

fn read_optimiser(record: &OptimiserRecord) -> Optimiser {
    let count = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
    match *record {
        OptimiserRecord::GaussNewton {
            step_norm_max,
            decrease_part_max,
            iterations_max,
        } => Optimiser::GaussNewton(GaussNewton {
            step_norm_max,
            decrease_part_max,
            iterations_max: count(iterations_max),
        }),
        OptimiserRecord::Descent {
            first_step,
            shrink,
            sufficient_decrease,
            gradient_norm_max,
            iterations_max,
        } => Optimiser::Descent(Descent {
            first_step,
            shrink,
            sufficient_decrease,
            gradient_norm_max,
            iterations_max: count(iterations_max),
        }),
    }
}

/// Why a log cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("the input log {path} cannot be written: {reason}")]
pub struct RecordError {
    path: String,
    reason: String,
}

/// Hands steps to the writing thread.
pub(crate) struct Recorder {
    steps: Queue<Step>,
    health: LogHealth,
    writing: Option<JoinHandle<()>>,
}

/// Whether the log holds everything so far.
#[derive(Clone)]
pub(crate) struct LogHealth {
    steps: Queue<Step>,
    complete: Arc<AtomicBool>,
}

impl LogHealth {
    pub(crate) fn is_complete(&self) -> bool {
        self.complete.load(Ordering::Relaxed)
    }

    pub(crate) fn queue(&self) -> QueueHealth {
        self.steps.health()
    }
}

impl Recorder {
    /// Creates the file with its header, and its folder where it is missing.
    pub(crate) fn create(
        path: &Path,
        fleet: Name,
        config: &Config,
        started: Stamp,
    ) -> Result<Self, RecordError> {
        let wrong = |reason: String| RecordError {
            path: path.display().to_string(),
            reason,
        };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|error| wrong(error.to_string()))?;
        }
        let log =
            Log::create(path, fleet, config, started).map_err(|error| wrong(error.to_string()))?;
        // What does not fit is dropped at the end: the log stays a prefix without holes.
        let steps = Queue::new(STEPS_MAX, WhenFull::DropNewest);
        let complete = Arc::new(AtomicBool::new(true));
        let health = LogHealth {
            steps: steps.clone(),
            complete: Arc::clone(&complete),
        };
        let writing = std::thread::Builder::new()
            .name("skein-log".to_owned())
            .spawn({
                let steps = steps.clone();
                let path = path.to_owned();
                move || log.write_all(&steps, &path, &complete)
            })
            .map_err(|error| wrong(error.to_string()))?;
        Ok(Self {
            steps,
            health,
            writing: Some(writing),
        })
    }

    pub(crate) fn record(&self, step: Step) {
        // After one lost step the rest could not be repeated: it is not written.
        if self.health.is_complete() && !self.steps.push(step) {
            self.health.complete.store(false, Ordering::Relaxed);
            tracing::error!(
                "the disk is too slow for the input log: it ends here and is marked incomplete"
            );
        }
    }

    pub(crate) fn health(&self) -> LogHealth {
        self.health.clone()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.steps.close();
        if let Some(writing) = self.writing.take() {
            // A panic there has been reported by the thread itself.
            let _ = writing.join();
        }
    }
}

/// The open file.
struct Log {
    writer: Writer,
    input: u16,
    output: u16,
    step: u32,
}

impl Log {
    fn create(
        path: &Path,
        fleet: Name,
        config: &Config,
        started: Stamp,
    ) -> Result<Self, mcap::McapError> {
        let mut writer = mcap::WriteOptions::new()
            .use_chunks(false)
            .compression(None)
            .profile("")
            .library(concat!("skein ", env!("CARGO_PKG_VERSION")))
            .create(BufWriter::new(File::create(path)?))?;
        let header = Header::of(config, started);
        let bytes = postcard::to_allocvec(&header).expect("a vector takes any header");
        writer.write_metadata(&Metadata {
            name: METADATA.to_owned(),
            metadata: BTreeMap::from(
                [
                    ("format", FORMAT.to_owned()),
                    ("program", env!("CARGO_PKG_VERSION").to_owned()),
                    (
                        "wire",
                        format!(
                            "{}.{}",
                            skein_proto::VERSION_MAJOR,
                            skein_proto::VERSION_MINOR
                        ),
                    ),
                    ("fleet", fleet.to_string()),
                    ("vehicle", config.vehicle.to_string()),
                    ("boot", boot_text(config.boot)),
                    ("started_ns", started.as_nanos().to_string()),
                    ("header", to_hex(&bytes)),
                ]
                .map(|(key, value)| (key.to_owned(), value)),
            ),
        })?;
        let none = BTreeMap::new();
        let input = writer.add_channel(0, INPUT, "postcard", &none)?;
        let output = writer.add_channel(0, OUTPUT, "postcard", &none)?;
        writer.flush()?;
        Ok(Self {
            writer,
            input,
            output,
            step: 0,
        })
    }

    fn write_all(mut self, steps: &Queue<Step>, path: &Path, complete: &AtomicBool) {
        let mut waiting = steps.pop();
        while let Some(step) = waiting {
            let next = steps.try_pop();
            let mut written = self.write(&step);
            if written.is_ok() && next.is_none() {
                // Nothing waits: a good moment to bring everything to the file, should the process be killed.
                written = self.writer.flush();
            }
            if let Err(error) = written {
                complete.store(false, Ordering::Relaxed);
                tracing::error!(log = %path.display(), %error, "the input log cannot be written: it ends here");
                return;
            }
            waiting = next.or_else(|| steps.pop());
        }
        if let Err(error) = self.writer.finish() {
            complete.store(false, Ordering::Relaxed);
            tracing::error!(log = %path.display(), %error, "the input log could not be finished");
        }
    }

    fn write(&mut self, step: &Step) -> Result<(), mcap::McapError> {
        let time = u64::try_from(step.input.now_ns).unwrap_or(0);
        let message = |channel_id| MessageHeader {
            channel_id,
            sequence: self.step,
            log_time: time,
            publish_time: time,
        };
        let input = postcard::to_allocvec(&step.input).expect("a vector takes any input");
        self.writer
            .write_to_known_channel(&message(self.input), &input)?;
        for output in &step.outputs {
            let output = postcard::to_allocvec(output).expect("a vector takes any output");
            self.writer
                .write_to_known_channel(&message(self.output), &output)?;
        }
        self.step = self.step.wrapping_add(1);
        Ok(())
    }
}

fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The bytes of hexadecimal digits; none for anything else.
pub(crate) fn from_hex(text: &str) -> Option<Vec<u8>> {
    if !text.is_ascii() || !text.len().is_multiple_of(2) {
        return None;
    }
    (0..text.len())
        .step_by(2)
        .map(|i| u8::from_str_radix(&text[i..i + 2], 16).ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_survives_its_header_to_the_bit() {
        let settings = crate::config::parse(
            include_str!("../examples/skein.toml"),
            "skein.toml",
            Path::new(""),
        )
        .unwrap();
        let header = Header::of(&settings.vehicle, Stamp::from_nanos(5));
        let bytes = postcard::to_allocvec(&header).unwrap();
        let read: Header = postcard::from_bytes(&from_hex(&to_hex(&bytes)).unwrap()).unwrap();
        assert_eq!(read.config(), settings.vehicle);
        assert_eq!(read, header);
    }
}
