//! Feeds an input log through a fresh vehicle and compares every output with the recorded one, bit by bit.

use crate::record::{FORMAT, Header, INPUT, InputRecord, METADATA, OUTPUT, OutputRecord, from_hex};
use mcap::records::{Metadata, Record};
use skein_estimation::time::Stamp;
use skein_proto::name::Name;
use skein_vehicle::{Done, Input, Output, Vehicle, Work};
use std::collections::VecDeque;
use std::path::Path;

/// A log that was repeated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verified {
    /// Who flew.
    pub vehicle: Name,
    /// Inputs that were fed.
    pub inputs: u64,
    /// Outputs that were equal.
    pub outputs: u64,
    /// Nanoseconds from the first to the last input.
    pub duration_ns: i64,
    /// Whether the log was ended in order. One of a killed process is not: its prefix was repeated.
    pub ended: bool,
}

/// Why a log was not repeated.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum VerifyError {
    /// The file cannot be read.
    #[error("{path} cannot be read: {error}")]
    File {
        /// The log.
        path: String,
        /// What the system says.
        error: std::io::Error,
    },
    /// Not a log of this program.
    #[error("{path} is no input log of this version: {reason}")]
    #[diagnostic(help(
        "logs are written by `skein run` with [log] in its configuration, and verified by the same version"
    ))]
    Foreign {
        /// The file.
        path: String,
        /// What is missing.
        reason: String,
    },
    /// The vehicle of today does something else.
    #[error("step {step}, output {output} (at {at:?}): recorded {recorded}, now {computed}")]
    #[diagnostic(help(
        "this program does not compute what the one that flew computed; step 0 is the vehicle's making"
    ))]
    Difference {
        /// Which input, from 1; 0 is the making of the vehicle.
        step: u64,
        /// Which of its outputs, from 0.
        output: usize,
        /// When.
        at: Stamp,
        /// What the log says.
        recorded: String,
        /// What came now.
        computed: String,
    },
}

/// Repeats a log. Fails at the first difference and names it.
pub fn verify(path: &Path) -> Result<Verified, VerifyError> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| VerifyError::File {
        path: name.clone(),
        error,
    })?;
    let foreign = |reason: String| VerifyError::Foreign {
        path: name.clone(),
        reason,
    };
    let mut log = LogReader::open(&bytes).map_err(foreign)?;
    let header = log.header.clone();
    let config = header.config();
    let started = Stamp::from_nanos(header.started_ns);
    let mut repeated = Repeated {
        vehicle: Vehicle::new(config.clone(), started),
        verified: Verified {
            vehicle: config.vehicle,
            inputs: 0,
            outputs: 0,
            duration_ns: 0,
            ended: false,
        },
        step: 0,
        work: VecDeque::new(),
    };
    while let Some((input, outputs)) = log.next_step().map_err(foreign)? {
        repeated.verified.duration_ns = input.now_ns.saturating_sub(header.started_ns);
        repeated.step(&input, &outputs)?;
    }
    repeated.verified.ended = log.ended;
    Ok(repeated.verified)
}

struct Repeated {
    vehicle: Vehicle,
    verified: Verified,
    step: u64,
    /// The last computations that the vehicle asked for.
    work: VecDeque<Box<Work>>,
}

/// A log may bring a computation's result so many later ones after it was asked for.
const WORK_MAX: usize = 16;

impl Repeated {
    fn step(&mut self, record: &InputRecord, recorded: &[OutputRecord]) -> Result<(), VerifyError> {
        let now = Stamp::from_nanos(record.now_ns);
        if let Some(input) = &record.input {
            let mut input = input.clone();
            if let Input::Done { number, done } = &mut input {
                *done = self.run_work(*number);
            }
            self.vehicle.handle(now, input);
            self.verified.inputs += 1;
        }
        let mut computed = Vec::new();
        loop {
            let output = self.vehicle.poll();
            computed.push(OutputRecord::of(&output, self.verified.vehicle));
            if let Output::Work(work) = &output {
                self.work.push_front(work.clone());
                self.work.truncate(WORK_MAX);
            }
            if matches!(output, Output::WakeAt(_)) {
                break;
            }
        }
        // The last step of a killed process may lack some outputs; what is there must be equal.
        let whole = recorded.len() == record.outputs as usize;
        let compared = if whole {
            computed.len().max(recorded.len())
        } else {
            recorded.len()
        };
        for output in 0..compared {
            if computed.get(output) != recorded.get(output) {
                return Err(VerifyError::Difference {
                    step: self.step,
                    output,
                    at: now,
                    recorded: describe(recorded.get(output)),
                    computed: describe(computed.get(output)),
                });
            }
        }
        self.verified.outputs += compared as u64;
        self.step += 1;
        Ok(())
    }
}

impl Repeated {
    /// Runs a computation again whose result the vehicle was given.
    fn run_work(&self, number: u64) -> Option<Box<Done>> {
        let work = self.work.iter().find(|work| work.number() == number)?;
        Some(Box::new(work.run()))
    }
}

fn describe(output: Option<&OutputRecord>) -> String {
    match output {
        None => "nothing".to_owned(),
        Some(OutputRecord::Send { key, bytes }) => {
            format!("a packet of {} bytes under {}", bytes.len(), key.key())
        }
        Some(OutputRecord::Estimate { packet }) => format!("an estimate of {} bytes", packet.len()),
        Some(OutputRecord::Health { json }) => format!("the health {json}"),
        Some(OutputRecord::WakeAt { stamp_ns }) => format!("a wake at {stamp_ns} ns"),
        Some(OutputRecord::Ask { to, boot, since_ns }) => {
            format!("a question to {to}, boot {boot:016x}, for what came after {since_ns} ns")
        }
        Some(OutputRecord::Work { number }) => format!("the computation {number}"),
        Some(OutputRecord::Answer { query, packets }) => {
            format!("an answer of {} packets to question {query}", packets.len())
        }
        Some(OutputRecord::Checkpoint { bytes }) => format!("the checkpoint {bytes:02x?}"),
    }
}

/// The steps of a log, in order.
struct LogReader<'a> {
    records: mcap::read::LinearReader<'a>,
    header: Header,
    input: u16,
    output: u16,
    pending: Option<InputRecord>,
    ended: bool,
}

impl<'a> LogReader<'a> {
    fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let options = mcap::read::Options::IgnoreEndMagic;
        let mut records = mcap::read::LinearReader::new_with_options(bytes, options.into())
            .map_err(|error| error.to_string())?;
        let (mut header, mut input, mut output) = (None, None, None);
        loop {
            match records.next() {
                Some(Ok(Record::Metadata(metadata))) if metadata.name == METADATA => {
                    header = Some(read_header(&metadata)?);
                }
                Some(Ok(Record::Channel(channel))) if channel.topic == INPUT => {
                    input = Some(channel.id)
                }
                Some(Ok(Record::Channel(channel))) if channel.topic == OUTPUT => {
                    output = Some(channel.id)
                }
                Some(Ok(_)) => {}
                Some(Err(error)) => return Err(error.to_string()),
                None => return Err("it has no header".to_owned()),
            }
            if let (Some(header), Some(input), Some(output)) = (&header, input, output) {
                return Ok(Self {
                    records,
                    header: header.clone(),
                    input,
                    output,
                    pending: None,
                    ended: false,
                });
            }
        }
    }

    /// The next input with its outputs. What a killed process left half written ends the log.
    fn next_step(&mut self) -> Result<Option<(InputRecord, Vec<OutputRecord>)>, String> {
        let mut outputs = Vec::new();
        loop {
            let (channel, data) = match self.records.next() {
                Some(Ok(Record::Message { header, data })) => (header.channel_id, data),
                Some(Ok(Record::DataEnd(_))) => {
                    self.ended = true;
                    continue;
                }
                Some(Ok(_)) => continue,
                Some(Err(_)) | None => {
                    return Ok(self.pending.take().map(|input| (input, outputs)));
                }
            };
            if channel == self.output {
                outputs.push(
                    postcard::from_bytes(&data).map_err(|_| "a malformed output".to_owned())?,
                );
            } else if channel == self.input {
                let next =
                    postcard::from_bytes(&data).map_err(|_| "a malformed input".to_owned())?;
                if let Some(input) = self.pending.replace(next) {
                    return Ok(Some((input, outputs)));
                }
            }
        }
    }
}

fn read_header(metadata: &Metadata) -> Result<Header, String> {
    let get = |key: &str| {
        metadata
            .metadata
            .get(key)
            .ok_or_else(|| format!("its header has no {key}"))
    };
    let format = get("format")?;
    if format != FORMAT {
        return Err(format!("its format is {format:?}, not {FORMAT:?}"));
    }
    let bytes = from_hex(get("header")?).ok_or("its header is malformed")?;
    postcard::from_bytes(&bytes).map_err(|_| "its header is malformed".to_owned())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::record::{Recorder, Step};
    use skein_vehicle::Input;
    use std::path::PathBuf;

    /// A flight of twenty wakes in virtual time; `spoil` may change what is recorded of a step.
    fn log(name: &str, mut spoil: impl FnMut(usize, &mut Step)) -> PathBuf {
        let path =
            std::env::temp_dir().join(format!("skein-verify-{}-{name}.mcap", std::process::id()));
        let text = include_str!("../examples/skein.toml");
        let config = crate::config::parse(text, "skein.toml", Path::new(""))
            .unwrap()
            .vehicle;
        let started = Stamp::from_nanos(1_800_000_000_000_000_000);
        let recorder =
            Recorder::create(&path, Name::parse("skein").unwrap(), &config, started).unwrap();
        let mut vehicle = Vehicle::new(config, started);
        let (mut now, mut input) = (started, None);
        for index in 0..20 {
            if let Some(input) = &input {
                vehicle.handle(now, Input::clone(input));
            }
            let mut step = Step::new(vehicle.info().vehicle, now, input.take());
            let wake_at = loop {
                let output = vehicle.poll();
                step.add(&output);
                if let Output::WakeAt(instant) = output {
                    break instant;
                }
            };
            spoil(index, &mut step);
            recorder.record(step);
            (now, input) = (wake_at, Some(Input::Wake));
        }
        path
    }

    /// A log with one wrong bit in its step 12.
    pub(crate) fn spoilt(name: &str) -> PathBuf {
        log(name, |index, step| {
            if index == 12 {
                let last = step.outputs.last_mut().unwrap();
                let OutputRecord::WakeAt { stamp_ns } = last else {
                    panic!("{last:?}")
                };
                *stamp_ns ^= 1;
            }
        })
    }

    #[test]
    fn a_flight_is_repeated_bit_by_bit() {
        let path = log("whole", |_, _| {});
        let verified = verify(&path).unwrap();
        assert_eq!((verified.inputs, verified.ended), (19, true));
        assert!(verified.outputs > 20);
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn one_wrong_bit_is_found_and_named() {
        let path = spoilt("spoilt");
        let error = verify(&path).unwrap_err();
        assert!(
            matches!(error, VerifyError::Difference { step: 12, .. }),
            "{error}"
        );
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn the_prefix_that_a_killed_process_leaves_is_repeated() {
        let path = log("killed", |_, _| {});
        let bytes = std::fs::read(&path).unwrap();
        let mut inputs = 0;
        for length in [bytes.len() / 2, bytes.len() * 2 / 3] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            let verified = verify(&path).unwrap();
            assert!(!verified.ended && verified.inputs > inputs, "{verified:?}");
            inputs = verified.inputs;
        }
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn a_file_that_is_no_log_is_refused() {
        let path =
            std::env::temp_dir().join(format!("skein-verify-{}-foreign", std::process::id()));
        std::fs::write(&path, b"not a log").unwrap();
        assert!(matches!(verify(&path), Err(VerifyError::Foreign { .. })));
        std::fs::remove_file(path).unwrap();
    }
}
