//! What stories of fleets in virtual time share: a world whose drivers bring something else than they should.

use skein_simworld::fleet::Fleet;
use skein_simworld::radio::Radio;
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::truth::Pose;
use skein_simworld::world::{Delivery, World};
use skein_vehicle::Config;

/// A world whose frames pass through a change on their way to the drivers.
pub struct Altered<F> {
    /// The world behind it.
    pub world: World,
    change: F,
}

impl<F> std::fmt::Debug for Altered<F> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Altered")
            .field("world", &self.world)
            .finish_non_exhaustive()
    }
}

impl<F: FnMut(&World, usize, i64, &mut Vec<Delivery>)> Stage for Altered<F> {
    fn vehicles(&self) -> usize {
        self.world.vehicles()
    }
    fn begins_ns(&self) -> i64 {
        self.world.begins_ns()
    }
    fn period_ns(&self) -> i64 {
        self.world.period_ns()
    }
    fn stamp_ns(&self, vehicle: usize, at_ns: i64) -> i64 {
        self.world.stamp_ns(vehicle, at_ns)
    }
    fn time_ns(&self, vehicle: usize, stamp_ns: i64) -> i64 {
        self.world.time_ns(vehicle, stamp_ns)
    }
    fn config(&self, vehicle: usize, boot: u64) -> Config {
        self.world.config(vehicle, boot)
    }
    fn boot(&self, vehicle: usize, start: usize) -> u64 {
        self.world.boot(vehicle, start)
    }
    fn truth(&self, vehicle: usize, at_ns: i64) -> Option<Pose> {
        self.world.truth(vehicle, at_ns)
    }
    fn round(&mut self, vehicle: usize, instant_ns: i64) -> Vec<Delivery> {
        let mut deliveries = self.world.round(vehicle, instant_ns);
        (self.change)(&self.world, vehicle, instant_ns, &mut deliveries);
        deliveries
    }
}

/// A fleet whose drivers bring what `change` makes of the world's frames of (vehicle, round instant).
pub fn altered<F: FnMut(&World, usize, i64, &mut Vec<Delivery>)>(
    scenario: &Scenario,
    sample: u64,
    config: impl Fn(usize, Config) -> Config,
    change: F,
) -> Fleet<Altered<F>> {
    let world = World::new(scenario, sample);
    let radio = Radio::new(&scenario.radio, world.streams());
    Fleet::on(Altered { world, change }, radio, config)
}
