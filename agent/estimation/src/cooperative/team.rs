//! The team estimator: everybody's raw odometry and raw measurements, smoothed jointly over a short window, each piece
//! of information counted once.
//!
//! Exchanging estimates counts information twice; exchanging what was measured does not. So each vehicle smooths, by
//! itself, the joint graph of what it heard: a pose of each vehicle at each round of the window and the last pose of
//! everybody ever heard, with four odometry biases a vehicle. What leaves the window is kept as a `prior`, linear in a
//! world twist.
//!
//! In reading order: [`settings`], the two factors (`stretch` of odometry, `measured_edge`), the `prior`, the
//! `window` that holds them, what leaves it (`marginalising`), its normal equations (`normal`, `skyline`), and the round ([`Team::solve`]): what has
//! left is marginalised, what is new is gated, Gauss-Newton over everything, then the noise scales and the doubts.
//!
//! The tangent here is a world twist `T <- exp(xi) T`, `xi = (w, v)`, rotation first, not the SO(3) x R^3 of the star.

pub mod settings;

mod biases;
mod doubt;
mod marginalising;
mod measured_edge;
mod noise_scales;
mod normal;
mod prior;
mod report;
mod skyline;
mod stretch;
mod window;

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Vector3, Vector6};

use self::doubt::{Place, Remedy};
use self::measured_edge::{MeasuredEdge, degrees_of_freedom};
use self::normal::{Normal, NotDetermined, OdometryLeft};
use self::window::Window;
use super::measurement::{Measurement, Noise};
use crate::odometry::OdometryPoint;
use crate::time::{Span, Stamp};
use crate::{Body, Sensor, Transform, VehicleId, World, se3};

pub use self::noise_scales::{NoiseScales, ScalePair};
pub use self::report::{MemberReport, Report, Statistics, Verdict};
pub use self::settings::Settings;

/// A vehicle at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Which.
    pub vehicle: VehicleId,
    /// When, on the clock of whoever estimates: it says what is in the window.
    pub instant: Stamp,
    /// What its odometry says, on its own clock.
    pub point: OdometryPoint,
}

/// What was measured between two moments, each end in the body frame of its moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// What was measured.
    pub measurement: Measurement,
    /// With which noise.
    pub noise: Noise,
    /// The measuring end; of an absolute fix, that of the world.
    pub from_end: Transform<Body, Sensor>,
    /// The measured end.
    pub to_end: Transform<Body, Sensor>,
}

/// Why a piece of information was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unused {
    /// It is older than what the window still holds of the vehicle.
    #[error("older than the window")]
    TooLate,
    /// Nobody knows yet where the vehicle is.
    #[error("the vehicle is not located yet")]
    Unlocated,
    /// It was counted before.
    #[error("counted before")]
    Counted,
    /// Its ends are not among the nearest vehicles.
    #[error("beyond the nearest vehicles")]
    LeftOut,
    /// Its sender is in quarantine; it was tested.
    #[error("measured by a vehicle in quarantine")]
    Quarantined,
    /// A bound is reached.
    #[error("no room")]
    Full,
    /// Both ends are of one vehicle.
    #[error("both ends are of one vehicle")]
    SameVehicle,
    /// Odometry was interrupted since the vehicle was last heard.
    #[error("odometry was interrupted")]
    Interrupted,
    /// Its numbers are no measurement.
    #[error("not a measurement")]
    Unusable,
}

/// A pose with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEstimate {
    /// When, on the clock of whoever estimates.
    pub instant: Stamp,
    /// The odometry of that moment.
    pub point: OdometryPoint,
    /// Where.
    pub world_from_body: Transform<World, Body>,
    /// Of a twist on the body's side, `pose * exp(twist)`, rotation first (rad, m).
    pub covariance: Matrix6<f64>,
}

impl PoseEstimate {
    /// The covariance at a later point of the same odometry, which adds its own. None when odometry was interrupted, or the
    /// point is an earlier one.
    #[must_use]
    pub fn carried_to(&self, point: &OdometryPoint, scales: &NoiseScales) -> Option<Matrix6<f64>> {
        if point.segment != self.point.segment || point.taken < self.point.taken {
            return None;
        }
        let (from, to) = (&self.point.odometry_from_body, &point.odometry_from_body);
        let carried = se3::adjoint(&(to.inverse() * *from));
        let rotation = scales.odometry.rotation();
        let translation = scales.odometry.translation();
        let growth = point
            .growth
            .since(&self.point.growth)
            .about(&to.translation)
            .scaled(
                rotation * rotation * scales.told_share(),
                translation * translation * scales.told_share(),
            )
            .covariance();
        let axes: Transform<Body, crate::Odometry> =
            Transform::new(to.rotation.inverse(), Vector3::zeros());
        let turned = se3::adjoint(&axes);
        Some(carried * self.covariance * carried.transpose() + turned * growth * turned.transpose())
    }
}

/// Where a vehicle is as seen from this one, with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeEstimate {
    /// When the other one was there, on the clock of whoever estimates.
    pub instant: Stamp,
    /// `body_from_neighbour`, of the last pose of each.
    pub body_from_neighbour: Transform<Body, Body>,
    /// Of a twist on the neighbour's side, `pose * exp(twist)`, rotation first (rad, m).
    pub covariance: Matrix6<f64>,
}

/// The estimator of one vehicle.
#[derive(Clone, Debug)]
pub struct Team {
    window: Window,
    scales: NoiseScales,
    normal: Normal,
    rounds: u32,
    statistics: Statistics,
}

impl Team {
    /// The estimator of a vehicle whose rounds follow each other so.
    #[must_use]
    pub fn new(own: VehicleId, period: Span, settings: Settings) -> Self {
        Self {
            window: Window::new(own, period, settings),
            scales: NoiseScales::default(),
            normal: Normal::default(),
            rounds: 0,
            statistics: Statistics::default(),
        }
    }

    /// Where a vehicle is known to have started, with standard deviations in its own axes (rad, m).
    ///
    /// # Errors
    /// [`Unused`] when it is located already, or when odometry has made the start worthless since (`now`).
    pub fn start(
        &mut self,
        at: &Moment,
        now: &Moment,
        world_from_body: &Transform<World, Body>,
        rotation_rad: f64,
        translation_m: f64,
    ) -> Result<(), Unused> {
        self.window
            .start(at, now, world_from_body, (rotation_rad, translation_m))
    }

    /// Where to look for a vehicle of which nothing is known: where the search begins, and no information. In the round in
    /// which this vehicle joins the window reaches back to there, however short it is otherwise, within bounds.
    ///
    /// # Errors
    /// [`Unused`] when it is located already.
    pub fn place(
        &mut self,
        at: &Moment,
        world_from_body: &Transform<World, Body>,
    ) -> Result<(), Unused> {
        self.window.place(at, world_from_body)?;
        if at.vehicle == self.window.own {
            self.window.joined = Some(at.instant);
        }
        Ok(())
    }

    /// Since when the window holds poses: what was measured before that is too late. None before the first round.
    #[must_use]
    pub fn since(&self) -> Option<Stamp> {
        self.window.cutoff
    }

    /// A vehicle was there, by its odometry.
    ///
    /// # Errors
    /// [`Unused`] says why it is of no use.
    pub fn heard(&mut self, moment: &Moment) -> Result<(), Unused> {
        self.window.pose_of(moment).map(|_| ())
    }

    /// One vehicle measured another. A pose locates whichever is not located yet.
    ///
    /// # Errors
    /// [`Unused`] says why it is not used.
    pub fn measured(
        &mut self,
        from: &Moment,
        to: &Moment,
        observation: &Observation,
    ) -> Result<(), Unused> {
        let outcome = self.window.measured(from, to, observation);
        self.statistics.left_out += u64::from(outcome == Err(Unused::LeftOut));
        outcome
    }

    /// A vehicle was somewhere in the world, by a fix that is the `nth` of its kind at that moment.
    ///
    /// # Errors
    /// [`Unused`] says why it is not used.
    pub fn fixed(&mut self, at: &Moment, nth: u8, observation: &Observation) -> Result<(), Unused> {
        self.window.fixed(at, nth, observation)
    }

    /// A vehicle began anew: what is known of where it was holds no more for where it is.
    pub fn forget(&mut self, vehicle: VehicleId) {
        self.window.forget(vehicle, &self.scales);
    }

    /// Whether a vehicle is somewhere in the window.
    #[must_use]
    pub fn is_located(&self, vehicle: VehicleId) -> bool {
        self.window.members.contains_key(&vehicle)
    }

    /// The last pose of this vehicle and its covariance, by the last round.
    #[must_use]
    pub fn own(&self) -> Option<&PoseEstimate> {
        self.window.own_estimate.as_ref()
    }

    /// The last pose of another vehicle as seen from this one, by the last round.
    #[must_use]
    pub fn relative(&self, vehicle: VehicleId) -> Option<&RelativeEstimate> {
        self.window.members.get(&vehicle)?.relative.as_ref()
    }

    /// Where another vehicle's last pose is in the world, without covariance.
    #[must_use]
    pub fn world_from(&self, vehicle: VehicleId) -> Option<(Stamp, Transform<World, Body>)> {
        let pose = self.window.newest_of(vehicle)?;
        Some((
            pose.instant,
            self.window.in_the_world(&pose.world_from_body),
        ))
    }

    /// The noise scales.
    #[must_use]
    pub const fn scales(&self) -> &NoiseScales {
        &self.scales
    }

    /// What was counted, and how large the window is.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        Statistics {
            lag_rounds: u64::from(self.window.lag()),
            poses: self.window.poses.len() as u64,
            members: self.window.members.len() as u64,
            edges: self.window.edges.len() as u64,
            evicted: self.window.evicted,
            ..self.statistics
        }
    }

    /// What is thought of a vehicle.
    #[must_use]
    pub fn member(&self, vehicle: VehicleId) -> Option<MemberReport> {
        let member = self.window.members.get(&vehicle)?;
        Some(MemberReport {
            quarantined: member.doubt.is_quarantined,
            doubted_share: member.doubt.share(),
            odometry_ratio: member.odometry.ratio(),
            odometry_lies: member.odometry.lies,
            gyro_bias_rad_s: member.biases.value.fixed_rows::<3>(0).into(),
            odometer_scale: member.biases.value[3],
        })
    }

    /// Solves a round with everything that was heard since the last one.
    pub fn solve(&mut self) -> Report {
        self.rounds = self.rounds.saturating_add(1);
        self.window.recentre();
        self.window.marginalise(&self.scales);
        self.window.wander();
        let mut report = Report::default();
        let solved = self.gauss_newton(&mut report);
        self.window.end_round();
        if solved.is_err() {
            report.undetermined = true;
            self.statistics.undetermined += 1;
        }
        report
    }

    fn gauss_newton(&mut self, report: &mut Report) -> Result<(), NotDetermined> {
        let window = &mut self.window;
        if window.poses.is_empty() {
            return Ok(());
        }
        let before: Vec<Transform<World, Body>> = window
            .poses
            .iter()
            .map(|pose| pose.world_from_body)
            .collect();
        let biases_before = window.biases();
        let settled = self.rounds > window.settings.settling_rounds;
        window.linearise_edges(&self.scales);
        window.weigh_edges(settled, true);
        self.normal.lay_out(window);
        self.normal
            .assemble(window, &self.scales, |edge| !edge.is_new);
        self.normal.factor()?;
        self.gate();
        let mut iteration = 0;
        let outcome = loop {
            let window = &mut self.window;
            if iteration > 0 {
                window.linearise_edges(&self.scales);
            }
            window.weigh_edges(settled, iteration == 0);
            self.normal.assemble(window, &self.scales, |_| true);
            if let Err(why) = self.normal.factor() {
                break Err(why);
            }
            let largest = self.normal.step(window);
            iteration += 1;
            if !largest.is_finite() {
                break Err(NotDetermined);
            }
            // Whoever is heard for the first time in a while is found farther from where odometry left it than the usual
            // iterations reach: what is left then looks like measurements that fit nobody.
            let most = if largest > STEP_LARGE {
                ITERATIONS_MAX
            } else {
                window.settings.iterations
            };
            if iteration >= most || (iteration > 1 && largest < normal::STEP_NEGLIGIBLE) {
                break Ok(());
            }
        };
        if outcome.is_err() || !self.window.is_finite() {
            self.window.restore(&before, &biases_before);
            return Err(NotDetermined);
        }
        self.take_stock(report);
        self.estimate();
        Ok(())
    }

    /// Gates what is new by its innovation: `S = J P J^T + I`, `d^2 = r^T S^-1 r`.
    fn gate(&mut self) {
        let window = &mut self.window;
        let mut tested = std::mem::take(&mut window.tested);
        for edge in &mut tested {
            edge.linear = window.linearise(edge, &self.scales);
        }
        let mut edges = std::mem::take(&mut window.edges);
        for edge in edges
            .iter_mut()
            .filter(|edge| edge.is_new)
            .chain(&mut tested)
        {
            let linear = &edge.linear;
            let apart = self
                .normal
                .covariance_of(window, edge, &Matrix6::identity());
            let turned = apart.fixed_view::<3, 3>(0, 0).trace();
            // What is not a number is apart.
            edge.is_apart = turned.is_nan() || turned > APART_RAD * APART_RAD;
            let spread = linear.twist * apart * linear.twist.transpose();
            let innovation = (spread + Matrix6::identity()).cholesky();
            let square = innovation.map_or(f64::INFINITY, |innovation| {
                linear.residual.dot(&innovation.solve(&linear.residual))
            });
            let limit = window.settings.gate * edge.degrees_of_freedom() / 6.0;
            // What is not a number fails.
            edge.failed_gate = square.is_nan() || square > limit;
            if !edge.failed_gate {
                for (row, dof) in (0..).zip(edge.degrees_of_freedom_by_row()) {
                    let residual = linear.residual[row];
                    if dof > AXIS_MIN && residual.abs() > NO_NOISE {
                        let square = residual * residual / (spread[(row, row)] + dof);
                        self.scales.innovations.note(row, square, dof);
                    }
                }
            }
        }
        window.edges = edges;
        window.tested = tested;
    }

    /// What is left over: verdicts, noise scales, doubts.
    fn take_stock(&mut self, report: &mut Report) {
        let settled = self.rounds > self.window.settings.settling_rounds;
        self.window.linearise_edges(&self.scales);
        self.window.weigh_edges(settled, false);
        let mut scales = self.scales;
        let window = &self.window;
        for edge in window.edges.iter().filter(|edge| edge.is_new) {
            let linear = &edge.linear;
            report.verdicts.push(Verdict {
                by: edge.by,
                of: edge.of,
                kind: edge.measurement.kind(),
                is_fix: edge.from.is_none(),
                accepted: edge.weight >= 0.5,
                failed_gate: edge.failed_gate,
            });
            self.statistics.edges_total += 1;
            self.statistics.gated_total += u64::from(edge.failed_gate);
            if edge.failed_gate {
                continue;
            }
            let spread = self.normal.covariance_of(window, edge, &linear.twist);
            let (rotation, translation) = degrees_of_freedom(edge.measurement.kind());
            let angles = left_over(&linear.residual, &spread, 0, rotation, edge.weight);
            let lengths = left_over(&linear.residual, &spread, 3, translation, edge.weight);
            scales.measurement.rotation.note(angles.0, angles.1);
            scales.measurement.translation.note(lengths.0, lengths.1);
        }
        let left = self.normal.judge_odometry(window, &self.scales);
        let variances = self.normal.bias_variances();
        self.window.judge_biases(&variances);
        self.doubt(&left);
        self.note_odometry(&left, &mut scales);
        scales.end_round();
        self.scales = scales;
    }

    /// Notes what is left over of odometry: for everybody together, and for each vehicle by itself, as one that is worse
    /// than it says would otherwise be believed by the others, or speak for them.
    fn note_odometry(&mut self, left: &[OdometryLeft], scales: &mut NoiseScales) {
        for stretch in left {
            let Some(member) = self.window.members.get_mut(&stretch.vehicle) else {
                continue;
            };
            if member.odometry.lies {
                continue;
            }
            for pair in [&mut scales.odometry, &mut member.scale] {
                let (rotation, translation) = (stretch.rotation, stretch.translation);
                pair.rotation.note(rotation.0, rotation.1);
                pair.translation.note(translation.0, translation.1);
            }
            member.scale.end_round();
        }
    }

    /// Updates doubts: odometry first, as a vehicle whose odometry lies looks like one whose measurements do.
    fn doubt(&mut self, odometry: &[OdometryLeft]) {
        let suspicious = self.doubt_odometry(odometry);
        self.find_misplaced();
        self.doubt_measurements(suspicious);
    }

    /// Takes what was left over of everybody's odometry, squares and what was expected of them. True when somebody's may be
    /// why its measurements fit nobody.
    fn doubt_odometry(&mut self, odometry: &[OdometryLeft]) -> bool {
        let window = &mut self.window;
        for left in odometry {
            let ((angles, angles_of), (lengths, lengths_of)) = (left.rotation, left.translation);
            if let Some(member) = window.members.get_mut(&left.vehicle) {
                // A scale of its own is no excuse.
                let (rotation, translation) = (member.scale.rotation(), member.scale.translation());
                let squares = angles * rotation * rotation + lengths * translation * translation;
                member.odometry.note(squares, angles_of + lengths_of);
            }
        }
        let largest = window
            .members
            .values()
            .map(|member| member.odometry.ratio())
            .fold(0.0, f64::max);
        let it_shows = window.members.len() >= WITNESSED_FROM;
        let mut biased = Vec::new();
        let mut suspicious = false;
        for (vehicle, member) in &mut window.members {
            let is_largest = member.odometry.ratio() >= largest;
            if member.odometry.judge(is_largest, it_shows) == Remedy::NewBiases {
                biased.push(*vehicle);
            }
            suspicious |= member.odometry.is_under_suspicion();
        }
        for vehicle in biased {
            window.free_biases(vehicle);
        }
        suspicious
    }

    /// Counts bad measurements by who made them, and begins quarantines while more are trusted than doubted: not while
    /// odometry is under suspicion.
    fn doubt_measurements(&mut self, suspicious: bool) {
        let window = &mut self.window;
        let mut measured: BTreeMap<VehicleId, Vec<(VehicleId, bool)>> = BTreeMap::new();
        let new = window.edges.iter().filter(|edge| edge.is_new);
        for edge in new.filter(|edge| edge.from.is_some() && !edge.is_apart) {
            let by = measured.entry(edge.by).or_default();
            by.push((edge.of, edge.weight < 0.5));
        }
        for edge in &window.tested {
            let by = measured.entry(edge.by).or_default();
            by.push((edge.of, edge.failed_gate));
        }
        for (vehicle, measured) in measured {
            if let Some(member) = window.members.get_mut(&vehicle) {
                member.doubt.note(&measured);
            }
        }
        if suspicious || self.rounds <= window.settings.settling_rounds {
            return;
        }
        let members = || window.members.values();
        let doubted = members().filter(|member| member.doubt.is_doubted()).count();
        let witnesses = members().filter(|member| member.doubt.is_trusted()).count();
        if witnesses > doubted {
            for member in window.members.values_mut() {
                if member.doubt.is_doubted() {
                    member.doubt.quarantine();
                    self.statistics.quarantines += 1;
                }
            }
        }
    }

    /// Gives room to vehicles that are not where they are taken to be.
    fn find_misplaced(&mut self) {
        let window = &mut self.window;
        let it_shows = window.members.len() >= WITNESSED_FROM;
        let mut misplaced = Vec::new();
        for (vehicle, member) in &mut window.members {
            let (mut by, mut of) = ((0, 0), (0, 0));
            let count = |counts: &mut (u32, u32), edge: &MeasuredEdge| {
                counts.0 += u32::from(edge.failed_gate);
                counts.1 += 1;
            };
            for edge in window
                .edges
                .iter()
                .filter(|edge| edge.is_new && !edge.is_apart)
            {
                if edge.of == *vehicle {
                    count(&mut of, edge);
                } else if edge.by == *vehicle {
                    count(&mut by, edge);
                }
            }
            let tested = window.tested.iter().filter(|edge| !edge.is_apart);
            for edge in tested.filter(|edge| edge.by == *vehicle) {
                count(&mut by, edge);
            }
            member.misplaced.note(by, of);
            if self.rounds <= window.settings.settling_rounds {
                continue;
            }
            let place = member.misplaced.judge();
            if place == Place::OftenWrong && it_shows {
                member.odometry.disbelieve();
            }
            if place != Place::Believed {
                // Its measurements fitted nobody's because it was elsewhere.
                member.doubt.forgive();
                misplaced.push(*vehicle);
            }
        }
        for vehicle in misplaced {
            window.displace(vehicle);
            self.statistics.misplaced += 1;
        }
    }

    /// The estimates that are told, with their covariances.
    fn estimate(&mut self) {
        let window = &self.window;
        let Some(own_at) = window.newest_index_of(window.own) else {
            self.window.own_estimate = None;
            return;
        };
        let own = &window.poses[own_at];
        let to_body = se3::adjoint(&own.world_from_body.inverse());
        let told_share = self.scales.told_share();
        let covariance = self.normal.covariance_between(None, own_at, &to_body) * told_share;
        let estimate = PoseEstimate {
            instant: own.instant,
            point: own.point,
            world_from_body: window.in_the_world(&own.world_from_body),
            covariance,
        };
        let mut relatives = Vec::new();
        for vehicle in window.members.keys().copied() {
            let Some(at) = window.newest_index_of(vehicle).filter(|at| *at != own_at) else {
                continue;
            };
            let pose = &window.poses[at];
            let present = own.instant - pose.instant <= window.period * window::PRESENT_ROUNDS;
            let relative = present.then(|| {
                let to_body = se3::adjoint(&pose.world_from_body.inverse());
                RelativeEstimate {
                    instant: pose.instant,
                    body_from_neighbour: own.world_from_body.inverse() * pose.world_from_body,
                    covariance: self.normal.covariance_between(Some(own_at), at, &to_body)
                        * told_share,
                }
            });
            relatives.push((vehicle, relative));
        }
        for (vehicle, relative) in relatives {
            if let Some(member) = self.window.members.get_mut(&vehicle) {
                member.relative = relative;
            }
        }
        self.window.own_estimate = Some(estimate);
    }
}

/// Vehicles from which on it shows whose odometry errs when measurements do not fit it.
const WITNESSED_FROM: usize = 3;
/// Two vehicles are apart while it is not known better than this how they are turned against each other (the root of the
/// sum of three variances, radians): a measurement between them then says where they are, and nothing against anybody.
const APART_RAD: f64 = 0.5;
/// A largest step above which a round goes on, radians or metres...
const STEP_LARGE: f64 = 0.05;
/// ...for so many iterations at most.
const ITERATIONS_MAX: usize = 12;
/// An axis of which a measurement tells less than this share of a degree of freedom is not judged by it.
const AXIS_MIN: f64 = 0.05;
/// A whitened residual below this is no noise: of robots on a plane, what stands upright says nothing of their sensors.
const NO_NOISE: f64 = 1e-6;

/// The squares of the three rows from `first` on, and what was expected of them, by the weight of their edge. Rows without
/// any noise do not count.
fn left_over(
    residual: &Vector6<f64>,
    spread: &Matrix6<f64>,
    first: usize,
    degrees_of_freedom: f64,
    weight: f64,
) -> (f64, f64) {
    // A distance has one row, a bearing three for its two degrees of freedom.
    let rows = if degrees_of_freedom > 1.0 {
        3
    } else {
        degrees_of_freedom as usize
    };
    let (mut squares, mut expected) = (0.0, degrees_of_freedom);
    for row in first..first + rows {
        if residual[row].abs() > NO_NOISE {
            squares += weight * residual[row] * residual[row];
            expected -= weight * spread[(row, row)];
        } else {
            expected -= 1.0;
        }
    }
    (squares, expected.max(0.0))
}

#[cfg(test)]
mod tests;
