//! What stories of fleets in virtual time share: what a user would ask of them, and a world whose drivers bring something
//! else than they should.

use nalgebra::{Matrix6, Vector6};
use skein_estimation::{Body, Transform, World as WorldFrame, se3};
use skein_proto::document::{CovarianceDocument, NeighbourHealth};
use skein_proto::name::Name;
use skein_proto::status::Status;
use skein_simworld::evaluation::covariance_of;
use skein_simworld::fleet::Fleet;
use skein_simworld::radio::Radio;
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::truth::Pose;
use skein_simworld::world::{Delivery, World, transform};
use skein_vehicle::Config;

/// A scenario that ships with the simulator, its seed said in case the story fails.
pub fn built_in(name: &str) -> Scenario {
    let scenario = Scenario::built_in(name).expect("it ships with the simulator");
    eprintln!("scenario {name}, seed {}", scenario.seed);
    scenario
}

/// A name that is one.
pub fn name(text: &str) -> Name {
    Name::parse(text).expect("lower-case letters and digits")
}

/// What a vehicle says of its newest estimate.
pub fn status<S: Stage>(fleet: &Fleet<S>, vehicle: usize) -> Status {
    fleet.estimate(vehicle).expect("it has published").status
}

/// Why its estimate is none or a poor one; empty when it gives no reason.
pub fn why<S: Stage>(fleet: &Fleet<S>, vehicle: usize) -> String {
    let estimate = fleet.estimate(vehicle).expect("it has published");
    estimate.why.clone().unwrap_or_default()
}

/// What a vehicle knows of another.
pub fn neighbour<'a, S: Stage>(
    fleet: &'a Fleet<S>,
    vehicle: usize,
    of: &str,
) -> &'a NeighbourHealth {
    &fleet.health(vehicle).expect("it has published").neighbours[of]
}

/// The covariance that a vehicle published of its own pose.
fn covariance<S: Stage>(fleet: &Fleet<S>, vehicle: usize) -> Matrix6<f64> {
    let estimate = fleet.estimate(vehicle).expect("it has published");
    let covariance = estimate.covariance.as_ref();
    let covariance = covariance.and_then(covariance_of);
    covariance.expect("it is in mode `team`")
}

/// Normalised squared error of what a vehicle published of itself, per degree of freedom: one when it means it.
pub fn nees<S: Stage>(fleet: &Fleet<S>, vehicle: usize) -> f64 {
    let (truth, estimate) = fleet.scored(vehicle).expect("it has a pose");
    let estimate: Transform<WorldFrame, Body> = transform(&estimate);
    let truth: Transform<WorldFrame, Body> = transform(&truth);
    let error: Vector6<f64> = se3::log(&(estimate.inverse() * truth));
    let information = covariance(fleet, vehicle).try_inverse();
    error.dot(&(information.expect("it is certain of nothing") * error)) / 6.0
}

/// How far off a vehicle expects its position to be, in metres.
pub fn position_sigma_m<S: Stage>(fleet: &Fleet<S>, vehicle: usize) -> f64 {
    let estimate = fleet.estimate(vehicle).expect("it has published");
    let covariance = estimate.covariance.as_ref();
    let sigma_m = covariance.and_then(CovarianceDocument::position_sigma_m);
    sigma_m.expect("it is in mode `team`")
}

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
