//! The configured sensors: decodes their frames, knows their mounts, counts what came and what was refused.

use std::collections::BTreeMap;

use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform};
use skein_proto::document::SensorHealth;
use skein_proto::frame::Frame;
use skein_proto::name::Name;

use crate::config::SensorConfig;
use crate::counters::{Counters, Rate};
use crate::refused::Refused;

/// How far ahead of our clock a reading may claim to be taken.
const AHEAD_MAX: Span = Span::secs(1);

/// All sensors of the vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Sensors {
    sensors: BTreeMap<Name, SensorState>,
}

#[derive(Clone, Debug)]
struct SensorState {
    driver: String,
    body_from_sensor: Transform<Body, Sensor>,
    accepted: u64,
    refused: Counters,
    rate: Rate,
    taken: Option<Stamp>,
}

/// A decoded frame and where its sensor sits.
#[derive(Clone, Debug)]
pub(crate) struct Reading {
    pub(crate) sensor: Name,
    pub(crate) body_from_sensor: Transform<Body, Sensor>,
    pub(crate) frame: Frame,
}

impl Sensors {
    pub(crate) fn new(configs: &[SensorConfig]) -> Self {
        let state = |config: &SensorConfig| SensorState {
            driver: config.driver.clone(),
            body_from_sensor: config.body_from_sensor,
            accepted: 0,
            refused: Counters::default(),
            rate: Rate::default(),
            taken: None,
        };
        Self {
            sensors: configs
                .iter()
                .map(|config| (config.name, state(config)))
                .collect(),
        }
    }

    /// Decodes a frame of a configured sensor.
    pub(crate) fn decode(
        &self,
        now: Stamp,
        sensor: Name,
        bytes: &[u8],
    ) -> Result<Reading, Refused> {
        let state = self.sensors.get(&sensor).ok_or(Refused::UnknownSensor)?;
        let frame = Frame::decode(bytes)?;
        if Stamp::from_nanos(frame.taken_ns()) - now > AHEAD_MAX {
            return Err(Refused::FromTheFuture);
        }
        Ok(Reading {
            sensor,
            body_from_sensor: state.body_from_sensor,
            frame,
        })
    }

    /// Counts what became of a frame. False when no sensor of that name is configured.
    pub(crate) fn count(
        &mut self,
        now: Stamp,
        sensor: Name,
        taken_ns: i64,
        outcome: &Result<(), Refused>,
    ) -> bool {
        let Some(state) = self.sensors.get_mut(&sensor) else {
            return false;
        };
        match outcome {
            Ok(()) => {
                state.accepted += 1;
                state.rate.count(now);
                state.taken = state.taken.max(Some(Stamp::from_nanos(taken_ns)));
            }
            Err(why) => state.refused.refuse(why),
        }
        true
    }

    /// Names and drivers, for `info`.
    pub(crate) fn drivers(&self) -> BTreeMap<String, String> {
        self.sensors
            .iter()
            .map(|(name, state)| (name.to_string(), state.driver.clone()))
            .collect()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.sensors.is_empty()
    }

    pub(crate) fn to_document(&self, now: Stamp) -> BTreeMap<String, SensorHealth> {
        let health = |state: &SensorState| SensorHealth {
            accepted: state.accepted,
            refused: state.refused.to_document(),
            age_s: state.taken.map(|taken| (now - taken).as_secs_f64()),
            rate_hz: state.rate.per_second(now),
        };
        self.sensors
            .iter()
            .map(|(name, state)| (name.to_string(), health(state)))
            .collect()
    }
}
