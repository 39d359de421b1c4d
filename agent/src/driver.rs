//! Drivers: where frames come from. One trait, frames out; each runs on its own thread until the agent stops.

pub mod replay;
pub mod zenoh;

use crate::clock::Clock;
use crate::inbox::Inbox;
use crate::life::Life;
use crate::refusals::Refusals;
use skein_proto::frame::Frame;
use skein_proto::limits::FRAME_BYTES_MAX;
use skein_proto::name::Name;
use skein_vehicle::Input;

/// A source of frames of one sensor.
pub trait Driver: Send {
    /// Sends frames until there are no more or [`Surroundings::is_stopping`].
    fn run(
        self: Box<Self>,
        frames: &FrameSender,
        surroundings: &Surroundings,
    ) -> Result<(), DriverError>;
}

/// What a driver may use of the agent that it runs in.
pub struct Surroundings {
    /// The process's clock.
    pub clock: Clock,
    pub(crate) life: Life,
}

/// Why a driver ended early.
#[derive(Debug, thiserror::Error)]
pub enum DriverError {
    /// A recording that cannot be played, with its line.
    #[error(transparent)]
    Recording(#[from] replay::RecordingError),
    /// Zenoh did not accept the subscription.
    #[error("cannot subscribe to {key}: {reason}")]
    Subscription {
        /// The sensor's key.
        key: String,
        /// What Zenoh says.
        reason: String,
    },
}

impl Surroundings {
    /// Whether the driver should end.
    pub fn is_stopping(&self) -> bool {
        self.life.is_stopping()
    }

    /// Waits until the clock reads `stamp`; false when the driver should end.
    pub fn wait_until(&self, stamp: skein_estimation::time::Stamp) -> bool {
        while self.clock.now() < stamp {
            if !self.life.wait_until(self.clock.instant_of(stamp)) {
                return false;
            }
        }
        !self.life.is_stopping()
    }
}

/// The way of one sensor's frames into the vehicle. Sending never blocks; what does not fit is counted in the health.
#[derive(Clone)]
pub struct FrameSender {
    pub(crate) sensor: Name,
    pub(crate) clock: Clock,
    pub(crate) inbox: Inbox,
    pub(crate) refusals: Refusals,
}

impl FrameSender {
    /// Sends a frame; it arrives now.
    pub fn send(&self, frame: &Frame) {
        self.send_bytes(frame.encode());
    }

    /// Sends an encoded frame in either form, not yet checked; it arrives now.
    pub fn send_bytes(&self, bytes: Vec<u8>) {
        // Checked before it takes room in the queue; the rest is checked behind it.
        if bytes.len() > FRAME_BYTES_MAX {
            self.refusals.count("frame_too_long");
            return;
        }
        let sensor = self.sensor;
        self.inbox
            .push(self.clock.now(), Input::Frame { sensor, bytes });
    }

    /// Whose frames these are.
    pub fn sensor(&self) -> Name {
        self.sensor
    }
}
