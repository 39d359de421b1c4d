//! What a fleet flies on: simulated truth or a recording of real robots. Either brings the drivers' frames.

use crate::truth::Pose;
use crate::world::Delivery;
use skein_proto::document::EstimateDocument;
use skein_vehicle::Config;

/// Times are nanoseconds since the stage's own zero; stamps are on the vehicles' clocks.
pub trait Stage {
    /// How many vehicles there are.
    fn vehicles(&self) -> usize;
    /// When it begins.
    fn begins_ns(&self) -> i64;
    /// Length of a round.
    fn period_ns(&self) -> i64;
    /// What a vehicle's clock shows at a time.
    fn stamp_ns(&self, vehicle: usize, at_ns: i64) -> i64;
    /// The time at which a vehicle's clock shows a stamp.
    fn time_ns(&self, vehicle: usize, stamp_ns: i64) -> i64;
    /// How the daemon of a vehicle is configured.
    fn config(&self, vehicle: usize, boot: u64) -> Config;
    /// The boot id of the nth start of a vehicle.
    fn boot(&self, vehicle: usize, start: usize) -> u64;
    /// Where a vehicle truly is, where that is known.
    fn truth(&self, vehicle: usize, at_ns: i64) -> Option<Pose>;
    /// Everything that a vehicle's drivers bring for the round that ends at `instant_ns`. Asked for every round once,
    /// in order, one period ahead.
    fn round(&mut self, vehicle: usize, instant_ns: i64) -> Vec<Delivery>;

    /// A vehicle has published an estimate. For stages whose drivers use what the vehicle knows.
    fn told(&mut self, vehicle: usize, estimate: &EstimateDocument) {
        let _ = (vehicle, estimate);
    }

    /// The first round instant of a vehicle's clock at or after a time.
    fn first_instant_ns(&self, vehicle: usize, from_ns: i64) -> i64 {
        let period_ns = self.period_ns();
        let stamp = self.stamp_ns(vehicle, from_ns);
        let rounds = stamp.div_euclid(period_ns) + i64::from(stamp.rem_euclid(period_ns) > 0);
        self.time_ns(vehicle, rounds * period_ns)
    }
}
