//! What is told of the estimate: its status and why there is none, the estimate itself, and the health.

use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Transform, World};
use skein_proto::document::{
    CovarianceDocument, EstimateDocument, HealthDocument, InfoDocument, NeighbourDocument,
    RangingHealth, RoundsHealth, VelocityDocument,
};
use skein_proto::estimate::{Covariance, Estimate, NeighbourEstimate};
use skein_proto::keys::boot_text;
use skein_proto::limits::NEIGHBOURS_MAX;
use skein_proto::name::Name;
use skein_proto::status::Status;
use skein_proto::{VERSION_MAJOR, VERSION_MINOR, limits};

use crate::checkpoint::Checkpoint;
use crate::config::Start;
use crate::counters::Counters;
use crate::dead_reckoning::BRIDGE_MAX;
use crate::output::Output;
use crate::scheduling::Scheduling;
use crate::smoothing::Smoothing;
use crate::translate;
use crate::vehicle::Vehicle;

/// How long a correction by neighbours or fixes makes the estimate a tracked one.
const TRACKING_FOR: Span = Span::secs(2);

/// How long an estimator that began again is given to settle.
const DEGRADED_FOR: Span = Span::secs(10);
/// Orientation that is less certain than this, all three axes together, is beyond what a linearised covariance can say.
const CONSISTENT_BELOW_RAD: f64 = 0.2;

/// A covariance for people and programs.
fn covariance_document(upper_triangle: [f64; 21]) -> CovarianceDocument {
    CovarianceDocument {
        body_twist_rotation_first: upper_triangle.to_vec(),
    }
}

/// How the rounds went.
#[derive(Clone, Debug, Default)]
pub(crate) struct RoundCounts {
    pub(crate) solved: u64,
    pub(crate) coasted: u64,
    pub(crate) skipped: Counters,
    pub(crate) troubled: Counters,
    pub(crate) last_latency: Option<Span>,
    pub(crate) last_edges: u64,
    /// When the last measurement or fix corrected the estimate.
    pub(crate) corrected_at: Option<Stamp>,
}

/// A checkpoint's position for people.
fn place(checkpoint: &Checkpoint) -> String {
    let [x, y, z]: [f64; 3] = checkpoint.world_from_body.translation.into();
    format!("({x:.1}, {y:.1}, {z:.1}) m")
}

impl Vehicle {
    /// The state of the estimate, and what is wrong and what to do.
    pub(crate) fn status(&self, now: Stamp) -> (Status, Option<String>) {
        let (status, why) = self.own_status(now);
        let Some(boot) = self.neighbours.namesakes.alive(now) else {
            return (status, why);
        };
        let namesake = format!(
            "another process (boot {}) runs under this vehicle's name, so that others refuse both: stop one of them, or \
             give it a name of its own",
            boot_text(boot)
        );
        let whole = why.map_or_else(|| namesake.clone(), |why| format!("{why}; {namesake}"));
        (status, Some(whole))
    }

    /// The state of the estimate, and when it is not a tracked one, why and what to do.
    fn own_status(&self, now: Stamp) -> (Status, Option<String>) {
        let Some(newest) = self.reckoning.newest() else {
            let status = if self.reckoning.is_resuming() {
                Status::Resuming
            } else {
                Status::Unplaced
            };
            return (status, Some(self.why_no_odometry()));
        };
        if self.reckoning.pose_at(newest).is_none() {
            return self.why_no_pose(now);
        }
        let age = now - newest.taken;
        if age > BRIDGE_MAX {
            let why = format!(
                "no odometry for {:.1} s: check the odometry sensor and its driver in this document's sensors",
                age.as_secs_f64()
            );
            return (Status::Lost, Some(why));
        }
        if self.reckoning.is_resuming() {
            return (Status::Resuming, Some(self.why_resuming(now)));
        }
        let corrected = self
            .counts
            .corrected_at
            .is_some_and(|at| now - at <= TRACKING_FOR);
        let present = self
            .neighbours
            .present(now, self.config.presence_timeout)
            .count();
        match (corrected, present) {
            (true, _) => self.how_well(now),
            (false, 0) => (
                Status::Alone,
                Some("no neighbour is present: the estimate is odometry alone".to_owned()),
            ),
            (false, _) => {
                let why = "neighbours are present, but no measurement between us was used in the last 2 s: \
                           see the refusals of each neighbour in this document";
                (Status::DeadReckoning, Some(why.to_owned()))
            }
        }
    }

    /// A corrected estimate is a good one unless the team estimator says otherwise.
    fn how_well(&self, now: Stamp) -> (Status, Option<String>) {
        let Some(smoothing) = &self.smoothing else {
            return (Status::Tracking, None);
        };
        if smoothing
            .restarted_at
            .is_some_and(|at| now - at <= DEGRADED_FOR)
        {
            let why = "the team estimator had to begin again: it is settling (its health counts restarts)";
            return (Status::Degraded, Some(why.to_owned()));
        }
        match smoothing.rotation_sigma_rad() {
            Some(sigma_rad) if sigma_rad > CONSISTENT_BELOW_RAD => {
                let why = format!(
                    "the orientation is known to {:.0} degrees only, beyond which the stated covariance may be too small: a \
                     fix or a located neighbour in sight helps",
                    sigma_rad.to_degrees()
                );
                (Status::Degraded, Some(why))
            }
            _ => (Status::Tracking, None),
        }
    }

    fn why_no_odometry(&self) -> String {
        if self.sensors.is_empty() {
            "no sensor is configured: add a [[sensor]] with a driver that brings odometry"
                .to_owned()
        } else {
            "no odometry yet: check that the driver of the odometry sensor runs, and its refusals in this document"
                .to_owned()
        }
    }

    fn why_no_pose(&self, now: Stamp) -> (Status, Option<String>) {
        if let (true, Some(gap)) = (self.reckoning.was_placed(), self.reckoning.interrupted()) {
            let why = format!(
                "odometry was interrupted for {:.1} s, longer than can be bridged: {}",
                gap.as_secs_f64(),
                self.why_nobody_places(now)
            );
            return (Status::Lost, Some(why));
        }
        let unused = match self.config.start {
            Start::Checkpoint(checkpoint) => format!(
                " (there is a checkpoint at {}, but it is ahead of this computer's clock: of unknown age, it is not used)",
                place(&checkpoint)
            ),
            Start::Pose(_) | Start::Unknown => String::new(),
        };
        let why = format!(
            "this vehicle has no pose yet{unused}: {}",
            self.why_nobody_places(now)
        );
        (Status::Unplaced, Some(why))
    }

    fn why_resuming(&self, now: Stamp) -> String {
        let Start::Checkpoint(checkpoint) = self.config.start else {
            return self.why_nobody_places(now);
        };
        format!(
            "resumed from a checkpoint at {}, {:.1} s old and not confirmed since, so others are not told of it: {}",
            place(&checkpoint),
            (now - checkpoint.taken).as_secs_f64(),
            self.why_nobody_places(now)
        )
    }

    /// What stands between this vehicle and a pose, and what to do.
    fn why_nobody_places(&self, now: Stamp) -> String {
        let mut present = 0;
        let mut located = Vec::new();
        for (name, neighbour) in self.neighbours.present(now, self.config.presence_timeout) {
            present += 1;
            if neighbour.is_located() {
                located.push(name.to_string());
            }
        }
        if present == 0 {
            "no neighbour is present: give this vehicle a pose ([start], @rpc/set_pose) or a pose fix".to_owned()
        } else if located.is_empty() {
            "nobody present is located either: give one vehicle a pose ([start], @rpc/set_pose) or a pose fix; it \
             places the others"
                .to_owned()
        } else {
            format!(
                "{} can place it as soon as what is measured between them tells all of its pose: one relative pose \
                 does, distances do once both have moved about, a bearing alone does not",
                located.join(", ")
            )
        }
    }

    /// Publishes the estimate if there is anything new to say of it.
    pub(crate) fn report_estimate(&mut self, now: Stamp) {
        let (status, why) = self.status(now);
        let newest = self.reckoning.newest().copied();
        let pose = newest
            .and_then(|point| self.reckoning.pose_at(&point))
            .filter(|pose| status != Status::Lost && translate::is_sayable(pose));
        let (pose, taken) = match (pose, self.config.start) {
            // Before odometry has come there is nothing to compose the checkpoint with: it is shown as it is.
            (None, Start::Checkpoint(checkpoint))
                if newest.is_none() && status == Status::Resuming =>
            {
                (Some(checkpoint.world_from_body), checkpoint.taken)
            }
            (pose, _) => (pose, newest.map_or(now, |point| point.taken)),
        };
        let velocity = pose.as_ref().and_then(|pose| self.reckoning.velocity(pose));
        let covariance = pose
            .and(newest)
            .and_then(|newest| self.smoothing.as_ref()?.covariance_at(&newest))
            .and_then(|covariance| translate::covariance(&covariance));
        let mut by_bearings = self.mutual.neighbours(taken);
        let mut by_distances = self.ranging.neighbours(taken);
        let motion = self.scheduling.as_ref().map(Scheduling::to_document);
        let mut neighbours = self.neighbour_estimates(now, taken, pose.as_ref());
        for (document, _) in &mut neighbours {
            let located = by_bearings.get(&document.vehicle);
            document.mutual = located.map(|(document, _)| document.clone());
            let located = by_distances.get(&document.vehicle);
            document.ranging = located.map(|(document, _)| document.clone());
        }
        let present = |name: &Name| {
            neighbours
                .iter()
                .any(|(document, _)| document.vehicle == *name)
        };
        by_bearings.retain(|name, _| present(name));
        by_distances.retain(|name, _| present(name));
        let document = EstimateDocument {
            vehicle: self.config.vehicle,
            boot: boot_text(self.config.boot),
            taken_ns: taken.as_nanos(),
            status,
            pose: pose.as_ref().map(translate::pose_document),
            velocity: velocity.map(|velocity| VelocityDocument {
                linear_world_m_s: velocity.linear_world_m_s,
                angular_body_rad_s: velocity.angular_body_rad_s,
            }),
            covariance: covariance.map(covariance_document),
            neighbours: neighbours
                .iter()
                .map(|(document, _)| document.clone())
                .collect(),
            features: self.mutual.features(),
            motion,
            why,
        };
        let estimate = Estimate {
            status: status.code(),
            world_from_body: pose.as_ref().map(Transform::to_numbers),
            velocity,
            covariance: covariance.map(Covariance::BodyTwistRotationFirst),
            neighbours: neighbours
                .into_iter()
                .map(|(_, estimate)| estimate)
                .collect(),
            mutual: by_bearings
                .into_values()
                .map(|(_, estimate)| estimate)
                .collect(),
            ranging: by_distances
                .into_values()
                .map(|(_, estimate)| estimate)
                .collect(),
            permit: motion.map_or(0, |motion| motion.permit.code()),
        };
        if let Some(packet) = self.speech.estimate(taken, &estimate) {
            self.outputs.push_back(Output::Estimate {
                packet,
                document: Box::new(document),
            });
        }
        self.reported_at = Some(now);
    }

    /// Every neighbour that is present or that relays tell of, with where it was at the last solved round, as seen from where this vehicle was then.
    fn neighbour_estimates(
        &self,
        now: Stamp,
        taken: Stamp,
        pose: Option<&Transform<World, Body>>,
    ) -> Vec<(NeighbourDocument, NeighbourEstimate)> {
        let timeout = self.config.presence_timeout;
        let relayed = self.neighbours.iter();
        let relayed = relayed.filter(|(_, neighbour)| neighbour.is_relayed(now, timeout));
        let known = self
            .neighbours
            .present(now, timeout)
            .chain(relayed)
            .take(NEIGHBOURS_MAX);
        let described = known.map(|(name, neighbour)| {
            let relative = neighbour.relative.filter(|relative| {
                pose.is_some()
                    && now - relative.taken <= self.config.presence_timeout
                    && translate::is_sayable(&relative.body_from_neighbour)
            });
            let status = neighbour.current().and_then(|boot| boot.status);
            let covariance = relative
                .and_then(|relative| relative.covariance)
                .and_then(|covariance| translate::covariance(&covariance));
            let document = NeighbourDocument {
                vehicle: name,
                status,
                taken_ns: relative.map(|relative| relative.taken.as_nanos()),
                pose: relative
                    .map(|relative| translate::pose_document(&relative.body_from_neighbour)),
                covariance: covariance.map(covariance_document),
                mutual: None,
                ranging: None,
            };
            let offset_us =
                relative.map_or(0, |relative| (relative.taken - taken).as_micros_rounded());
            let estimate = NeighbourEstimate {
                vehicle: name.hash(),
                status: status.unwrap_or(Status::Unplaced).code(),
                taken_offset_us: i32::try_from(offset_us).unwrap_or(i32::MIN),
                body_from_neighbour: relative
                    .map(|relative| relative.body_from_neighbour.to_numbers()),
                covariance: covariance.map(Covariance::BodyTwistRotationFirst),
            };
            (document, estimate)
        });
        described.collect()
    }

    /// Publishes the health.
    pub(crate) fn report_health(&mut self, now: Stamp) {
        let (status, why) = self.status(now);
        let period = self.config.period;
        let timeout = self.config.presence_timeout;
        let document = HealthDocument {
            vehicle: self.config.vehicle,
            boot: boot_text(self.config.boot),
            taken_ns: now.as_nanos(),
            uptime_s: (now - self.started).as_secs_f64(),
            status,
            why,
            rounds: RoundsHealth {
                mode: self.config.mode.name().to_owned(),
                period_s: period.as_secs_f64(),
                solved: self.counts.solved,
                coasted: self.counts.coasted,
                skipped: self.counts.skipped.to_document(),
                troubled: self.counts.troubled.to_document(),
                last_latency_s: self.counts.last_latency.map(Span::as_secs_f64),
                last_edges: self.counts.last_edges,
                cut: self.speech.cut.to_document(),
                team: self.smoothing.as_ref().map(Smoothing::to_document),
            },
            mutual: self.mutual.is_in_use().then(|| self.mutual.to_document()),
            ranging: self.ranging_health(),
            sensors: self.sensors.to_document(now),
            neighbours: self
                .neighbours
                .iter()
                .map(|(name, neighbour)| {
                    let mut document = neighbour.to_document(now, period, timeout);
                    if let Some(smoothing) = &self.smoothing {
                        let known = smoothing.member(name);
                        document.team = known.map(|(team, _)| team);
                        document.quarantined = known.is_some_and(|(_, quarantined)| quarantined);
                        return (name.to_string(), document);
                    }
                    let judged = self.config.mode.kernel().zip(self.reckoning.newest());
                    document.kernel_widening = judged.map(|(kernel, point)| {
                        let since = &self.placed_since;
                        neighbour
                            .trust
                            .contact(point, period, since, &kernel)
                            .translation()
                    });
                    (name.to_string(), document)
                })
                .collect(),
            refused: self.refused.to_document(),
            namesake_boot: self.neighbours.namesakes.alive(now).map(boot_text),
            process: None,
        };
        self.outputs.push_back(Output::Health(Box::new(document)));
    }

    fn ranging_health(&self) -> Option<RangingHealth> {
        let schedule = self.scheduling.as_ref();
        let schedule = schedule.map(|scheduling| scheduling.to_health(&self.neighbours));
        (self.ranging.is_in_use() || schedule.is_some()).then(|| RangingHealth {
            schedule,
            ..self.ranging.to_document()
        })
    }

    /// Who this vehicle is and what it can do.
    pub fn info(&self) -> InfoDocument {
        let limit = |name: &str, value: usize| (name.to_owned(), value as u64);
        InfoDocument {
            vehicle: self.config.vehicle,
            boot: boot_text(self.config.boot),
            program: env!("CARGO_PKG_VERSION").to_owned(),
            wire: format!("{VERSION_MAJOR}.{VERSION_MINOR}"),
            period_s: self.config.period.as_secs_f64(),
            capabilities: vec![
                "cooperative:paper".to_owned(),
                "cooperative:star".to_owned(),
                "cooperative:team".to_owned(),
                format!("flies:{}", self.config.mode.name()),
                format!("mutual:{}", self.config.mutual.way.name()),
            ]
            .into_iter()
            .chain(self.config.relay.then(|| "relays".to_owned()))
            .collect(),
            sensors: self.sensors.drivers(),
            limits: [
                limit("packet_bytes", limits::PACKET_BYTES_MAX),
                limit("frame_bytes", limits::FRAME_BYTES_MAX),
                limit("partners", crate::speaking::PARTNERS_MAX),
                limit("neighbours", crate::neighbours::NEIGHBOURS_MAX),
            ]
            .into(),
        }
    }
}
