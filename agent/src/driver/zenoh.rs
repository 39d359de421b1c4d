//! Frames from any program in any language, sent over Zenoh to the sensor's `@driver` key.

use super::{Driver, DriverError, FrameSender, Surroundings};
use skein_proto::keys::Key;
use skein_proto::name::Name;
use zenoh::Wait;

/// Subscribes to one sensor's key.
pub struct ZenohDriver {
    /// The fleet of the vehicle.
    pub fleet: Name,
    /// The vehicle.
    pub vehicle: Name,
}

impl Driver for ZenohDriver {
    fn run(
        self: Box<Self>,
        frames: &FrameSender,
        surroundings: &Surroundings,
    ) -> Result<(), DriverError> {
        let Some(session) = surroundings.life.wait_for_session() else {
            return Ok(());
        };
        let key = Key::Driver {
            of: self.vehicle,
            sensor: frames.sensor(),
        }
        .in_fleet(self.fleet);
        let sender = frames.clone();
        // In the background: undeclaring could block on a broken link, and closing the session ends it anyway.
        session
            .declare_subscriber(&key)
            .callback(move |sample| sender.send_bytes(sample.payload().to_bytes().into_owned()))
            .background()
            .wait()
            .map_err(|error| DriverError::Subscription {
                key,
                reason: error.to_string(),
            })
    }
}
