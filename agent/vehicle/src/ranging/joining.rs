//! What the vehicle makes of distances: they are read while one end of them is not in the common frame, and through a
//! neighbour that is in it, this vehicle joins. From then on they are measurements of the cooperative pipeline.

use std::collections::BTreeSet;

use skein_estimation::cooperative::team::Moment;
use skein_estimation::odometry::OdometryPoint;
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform, VehicleId, World};
use skein_proto::name::Name;

use super::Readable;
use crate::neighbours::Neighbour;
use crate::rounds::Round;
use crate::told_pose::ToldPose;
use crate::vehicle::Vehicle;

/// Nobody joins by a pose of which it is not at least so certain: a restart of the estimators costs more than waiting.
const JOIN_ROTATION_SIGMA_MAX_RAD: f64 = 0.3;
/// See [`JOIN_ROTATION_SIGMA_MAX_RAD`].
const JOIN_TRANSLATION_SIGMA_MAX_M: f64 = 1.0;

impl Vehicle {
    /// Reads the distances of a round that was solved.
    pub(crate) fn read_distances(&mut self, now: Stamp, round: &Round) {
        let tied = self.tied();
        let readable = Readable {
            now,
            me: VehicleId(self.config.vehicle.hash()),
            round,
            period: self.config.period,
            neighbours: &self.neighbours,
            reckoning: &self.reckoning,
            body_from_target: self.config.body_from_target,
            tied: &tied,
        };
        let refused = self.ranging.read(&readable);
        let job = self.ranging.begin_work(self.works + 1, &readable);
        job.into_iter().for_each(|job| self.hand_out(job));
        for (name, why) in refused {
            self.count_refusal(name, &why);
        }
    }

    /// The neighbours that are in the common frame, as this vehicle is; nobody while it has lost its pose.
    fn tied(&self) -> BTreeSet<Name> {
        let newest = self.reckoning.newest();
        if newest.and_then(|at| self.reckoning.placed_at(at)).is_none() {
            return BTreeSet::new();
        }
        let is_tied = |(name, neighbour): &(Name, &Neighbour)| match &self.smoothing {
            Some(smoothing) => smoothing.team().is_located(VehicleId(name.hash())),
            None => neighbour.is_located(),
        };
        let tied = self.neighbours.iter().filter(is_tied);
        tied.map(|(name, _)| name).collect()
    }

    /// This vehicle has joined where distances say that it was.
    pub(crate) fn join(&mut self, odometry: &OdometryPoint, pose: ToldPose) {
        self.ranging.placed += 1;
        if let Some(smoothing) = &mut self.smoothing {
            let vehicle = VehicleId(self.config.vehicle.hash());
            let moment = Moment {
                vehicle,
                instant: odometry.taken,
                point: *odometry,
            };
            smoothing.find(moment, pose);
        }
    }

    /// Where neighbours are that nobody told anything but distances of: the team estimator begins with them there.
    pub(crate) fn find_neighbours(
        &mut self,
        round: &Round,
        odometry: &OdometryPoint,
        world_from_body: &Transform<World, Body>,
    ) {
        let Some(smoothing) = &mut self.smoothing else {
            return;
        };
        for (name, neighbour) in self.neighbours.iter() {
            let vehicle = VehicleId(name.hash());
            let Some(boot) = neighbour
                .usable()
                .filter(|_| !smoothing.team().is_located(vehicle))
            else {
                continue;
            };
            let told = boot.rounds.iter().rev().find_map(|told| {
                let instant = boot.clock.to_mine(told.instant)?;
                (instant <= round.instant).then_some((instant, told.point))
            });
            let Some((instant, point)) = told else {
                continue;
            };
            if let Some(found) = self.ranging.found(name, odometry, &point) {
                let moment = Moment {
                    vehicle,
                    instant,
                    point,
                };
                smoothing.find(moment, found.neighbour_pose(world_from_body));
            }
        }
    }

    /// Where this vehicle was in a round, by the located neighbour that distances tell most of. None while they leave more
    /// than one place.
    pub(crate) fn found_by_distances(
        &self,
        round: &Round,
        odometry: &OdometryPoint,
    ) -> Option<ToldPose> {
        let candidates = self.neighbours.iter().filter_map(|(name, neighbour)| {
            let boot = neighbour.usable()?;
            let exchange = boot.exchanges.get(&round.index)?;
            let world_from_neighbour = exchange.prior?;
            let theirs = boot.odometry_at(exchange.instant).ok()?;
            let found = self.ranging.found(name, odometry, &theirs)?;
            Some(found.own_pose(&world_from_neighbour))
        });
        let sharp = candidates.filter(|told| {
            told.rotation_sigma_rad <= JOIN_ROTATION_SIGMA_MAX_RAD
                && told.translation_sigma_m <= JOIN_TRANSLATION_SIGMA_MAX_M
        });
        sharp.min_by(|a, b| a.translation_sigma_m.total_cmp(&b.translation_sigma_m))
    }
}
