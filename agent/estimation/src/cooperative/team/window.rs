//! What the team estimator holds at a time: the poses of the last rounds, what was measured between them, the biases of
//! everybody's odometry, and the prior of all that has gone.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Vector3, Vector4};

use super::biases::{Biases, Fate};
use super::doubt::{Doubt, LYING_NOISE, MISPLACED_BY, Misplaced, OdometryDoubt};
use super::measured_edge::{Linear, MeasuredEdge, PoseId};
use super::noise_scales::{NoiseScales, ScalePair};
use super::prior::Prior;
use super::settings::{
    BiasRange, EDGES_BY_ONE_MAX, EDGES_MAX, LEVER_MAX_M, MEMBERS_MAX, NOISE_MIN, POSES_MAX,
    POSES_OF_ONE_MAX, REACH_M, Settings, UNKNOWN_START, WORN_START_RAD,
};
use super::stretch::{self, Stretch};
use super::{Moment, Observation, PoseEstimate, RelativeEstimate, Unused};
use crate::cooperative::measurement::{Kind, Measurement, Noise};
use crate::odometry::OdometryPoint;
use crate::time::{Span, Stamp};
use crate::{Body, Sensor, Transform, VehicleId, World};

/// A vehicle that was heard so many rounds ago is present.
pub(super) const PRESENT_ROUNDS: i64 = 5;
/// Rounds after the last distance in which the window stays as long as distances want it.
const DISTANCE_ROUNDS: u32 = 25;
/// How much more room than usual the biases of odometry get that fits nothing.
const SUSPICIOUS_ROOM: f64 = 10.0;

/// A vehicle at one round.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    pub(super) id: PoseId,
    pub(super) vehicle: VehicleId,
    pub(super) instant: Stamp,
    pub(super) point: OdometryPoint,
    /// In the window's frame: world axes about [`Window::centre`].
    pub(super) world_from_body: Transform<World, Body>,
    pub(super) is_new: bool,
    /// What it measured and was counted.
    counted: Vec<Counted>,
}

/// What tells two measurements of one pose apart; of the world: no target, and its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Counted {
    of: Option<VehicleId>,
    kind: Kind,
    nth: u8,
}

/// A vehicle that is located.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub(super) biases: Biases,
    pub(super) doubt: Doubt,
    pub(super) odometry: OdometryDoubt,
    /// How many times as noisy its odometry is as everybody's.
    pub(super) scale: ScalePair,
    pub(super) misplaced: Misplaced,
    pub(super) relative: Option<RelativeEstimate>,
}

/// The window.
#[derive(Clone, Debug)]
pub(super) struct Window {
    pub(super) own: VehicleId,
    pub(super) period: Span,
    pub(super) settings: Settings,
    /// Where the frame's origin is in the world: at this vehicle, where digits are needed.
    centre: Vector3<f64>,
    pub(super) members: BTreeMap<VehicleId, Member>,
    /// In order of time, then of vehicle.
    pub(super) poses: Vec<Pose>,
    index_of: BTreeMap<PoseId, usize>,
    pub(super) edges: Vec<MeasuredEdge>,
    /// Measured by vehicles in quarantine: judged and not used.
    pub(super) tested: Vec<MeasuredEdge>,
    pub(super) prior: Prior,
    next_id: u64,
    /// Between whom measurements are used, the smaller id first; everybody while they are few.
    kept: Option<BTreeSet<(VehicleId, VehicleId)>>,
    pub(super) own_estimate: Option<PoseEstimate>,
    pub(super) evicted: u64,
    /// Rounds for which distances lengthen the window.
    pub(super) distance_rounds: u32,
    /// Poses before it go.
    pub(super) cutoff: Option<Stamp>,
    /// Until when the cutoff stays where it is.
    pub(super) held_until: Option<Stamp>,
    /// Where in time this vehicle joined, until the round after that.
    pub(super) joined: Option<Stamp>,
}

impl Window {
    pub(super) fn new(own: VehicleId, period: Span, settings: Settings) -> Self {
        Self {
            own,
            period,
            settings,
            centre: Vector3::zeros(),
            members: BTreeMap::new(),
            poses: Vec::new(),
            index_of: BTreeMap::new(),
            edges: Vec::new(),
            tested: Vec::new(),
            prior: Prior::nothing(),
            next_id: 0,
            kept: None,
            own_estimate: None,
            evicted: 0,
            distance_rounds: 0,
            cutoff: None,
            held_until: None,
            joined: None,
        }
    }

    pub(super) fn period_s(&self) -> f64 {
        self.period.as_secs_f64()
    }

    /// Rounds that the window holds now.
    pub(super) fn lag(&self) -> u32 {
        self.settings
            .lag
            .rounds(self.members.len(), self.distance_rounds > 0)
    }

    pub(super) fn in_the_world(&self, pose: &Transform<World, Body>) -> Transform<World, Body> {
        Transform::new(pose.rotation, pose.translation + self.centre)
    }

    fn in_the_window(&self, pose: &Transform<World, Body>) -> Transform<World, Body> {
        Transform::new(pose.rotation, pose.translation - self.centre)
    }

    pub(super) fn index(&self, id: PoseId) -> usize {
        self.index_of[&id]
    }

    pub(super) fn newest_index_of(&self, vehicle: VehicleId) -> Option<usize> {
        let of = |(_, pose): &(usize, &Pose)| pose.vehicle == vehicle;
        self.poses
            .iter()
            .enumerate()
            .filter(of)
            .max_by_key(|(_, pose)| pose.point.taken)
            .map(|(at, _)| at)
    }

    pub(super) fn newest_of(&self, vehicle: VehicleId) -> Option<&Pose> {
        self.newest_index_of(vehicle).map(|at| &self.poses[at])
    }

    /// Every vehicle's poses that follow each other, as indices.
    pub(super) fn stretches(&self) -> Vec<(usize, usize)> {
        let mut last: BTreeMap<VehicleId, usize> = BTreeMap::new();
        let mut order: Vec<usize> = (0..self.poses.len()).collect();
        order.sort_by_key(|at| self.poses[*at].point.taken);
        let mut pairs = Vec::new();
        for at in order {
            if let Some(before) = last.insert(self.poses[at].vehicle, at) {
                pairs.push((before, at));
            }
        }
        pairs
    }

    fn insert(&mut self, moment: &Moment, world_from_body: Transform<World, Body>) -> PoseId {
        let id = PoseId(self.next_id);
        self.next_id += 1;
        let key = (moment.instant, moment.vehicle);
        let at = self
            .poses
            .partition_point(|pose| (pose.instant, pose.vehicle) <= key);
        self.poses.insert(
            at,
            Pose {
                id,
                vehicle: moment.vehicle,
                instant: moment.instant,
                point: moment.point,
                world_from_body,
                is_new: true,
                counted: Vec::new(),
            },
        );
        self.reindex();
        id
    }

    pub(super) fn reindex(&mut self) {
        self.index_of = self
            .poses
            .iter()
            .enumerate()
            .map(|(at, pose)| (pose.id, at))
            .collect();
    }

    /// The pose of a moment, made from the one before it if it is new.
    pub(super) fn pose_of(&mut self, moment: &Moment) -> Result<PoseId, Unused> {
        let Some(member) = self.members.get(&moment.vehicle) else {
            return Err(Unused::Unlocated);
        };
        let taken = |pose: &&Pose| pose.point.taken;
        let all = self.poses_of(moment.vehicle);
        let before = all
            .filter(|pose| pose.point.taken <= moment.point.taken)
            .max_by_key(taken)
            .ok_or(Unused::TooLate)?;
        if before.point.segment != moment.point.segment {
            return Err(Unused::Interrupted);
        }
        if before.point.taken == moment.point.taken {
            return Ok(before.id);
        }
        if !self.has_room_for(moment.vehicle) {
            return Err(Unused::Full);
        }
        if !moment.point.odometry_from_body.is_valid() {
            return Err(Unused::Unusable);
        }
        let stretch = Stretch {
            earlier: &before.point,
            later: &moment.point,
        };
        let predicted = stretch.predict(&before.world_from_body, &member.biases.value);
        // A late moment splits a stretch, of which the second part must be one too.
        let all = self.poses_of(moment.vehicle);
        let after = all
            .filter(|pose| pose.point.taken > moment.point.taken)
            .min_by_key(taken);
        let rest = after.map(|after| Stretch {
            earlier: &moment.point,
            later: &after.point,
        });
        let is_sound = |stretch: &Stretch<'_>| stretch.is_sound(&self.settings, self.period_s());
        if !is_sound(&stretch) || !rest.as_ref().is_none_or(is_sound) || !is_in_reach(&predicted) {
            return Err(Unused::Unusable);
        }
        Ok(self.insert(moment, predicted))
    }

    fn poses_of(&self, vehicle: VehicleId) -> impl Iterator<Item = &Pose> {
        let of = move |pose: &&Pose| pose.vehicle == vehicle;
        self.poses.iter().filter(of)
    }

    /// Whether a vehicle may have one more pose: nobody's flood keeps this vehicle from its own.
    fn has_room_for(&self, vehicle: VehicleId) -> bool {
        let others_max = POSES_MAX - POSES_OF_ONE_MAX;
        let own = self.poses_of(self.own).count();
        self.poses_of(vehicle).count() < POSES_OF_ONE_MAX
            && (vehicle == self.own || self.poses.len() - own < others_max)
    }

    /// Whether a vehicle may have measured one more thing.
    fn has_room_for_edge_by(&self, vehicle: VehicleId) -> bool {
        let all = || self.edges.iter().chain(&self.tested);
        let by_others = all().filter(|edge| edge.by != self.own).count();
        let others_max = EDGES_MAX - EDGES_BY_ONE_MAX;
        all().filter(|edge| edge.by == vehicle).count() < EDGES_BY_ONE_MAX
            && (vehicle == self.own || by_others < others_max)
    }

    pub(super) fn start(
        &mut self,
        at: &Moment,
        now: &Moment,
        world_from_body: &Transform<World, Body>,
        sigmas: (f64, f64),
    ) -> Result<(), Unused> {
        let stretch = Stretch {
            earlier: &at.point,
            later: &now.point,
        };
        if at.point.segment != now.point.segment || at.point.taken > now.point.taken {
            return Err(Unused::Interrupted);
        }
        if stretch.rotation_sigma_rad(&self.settings) > WORN_START_RAD {
            return Err(Unused::TooLate);
        }
        self.locate(at, world_from_body, sigmas).map(|_| ())
    }

    pub(super) fn place(
        &mut self,
        at: &Moment,
        world_from_body: &Transform<World, Body>,
    ) -> Result<(), Unused> {
        self.locate(at, world_from_body, UNKNOWN_START).map(|_| ())
    }

    /// A vehicle joins.
    fn locate(
        &mut self,
        at: &Moment,
        world_from_body: &Transform<World, Body>,
        sigmas: (f64, f64),
    ) -> Result<PoseId, Unused> {
        if self.members.contains_key(&at.vehicle) {
            return Err(Unused::Counted);
        }
        let good = |sigma: f64| sigma.is_finite() && sigma > 0.0;
        let numbers = at.point.growth.to_numbers();
        if !world_from_body.is_valid()
            || !at.point.odometry_from_body.is_valid()
            || !numbers.iter().all(|number| number.is_finite())
            || !good(sigmas.0)
            || !good(sigmas.1)
        {
            return Err(Unused::Unusable);
        }
        if self.members.len() >= MEMBERS_MAX || !self.has_room_for(at.vehicle) {
            return Err(Unused::Full);
        }
        if self.members.is_empty() {
            self.centre = world_from_body.translation;
        }
        let pose = self.in_the_window(world_from_body);
        if !is_in_reach(&pose) {
            return Err(Unused::Unusable);
        }
        let id = self.insert(at, pose);
        self.prior.add_pose(
            id,
            &pose,
            sigmas.0.clamp(NOISE_MIN.0, UNKNOWN_START.0),
            sigmas.1.clamp(NOISE_MIN.1, UNKNOWN_START.1),
        );
        let bias = self.settings.bias;
        self.prior
            .add_biases(at.vehicle, bias.gyro.start, bias.scale.start);
        let member = Member {
            biases: Biases::new(&bias),
            doubt: Doubt::default(),
            odometry: OdometryDoubt::default(),
            scale: ScalePair::of_one(),
            misplaced: Misplaced::default(),
            relative: None,
        };
        self.members.insert(at.vehicle, member);
        Ok(id)
    }

    pub(super) fn measured(
        &mut self,
        from: &Moment,
        to: &Moment,
        observation: &Observation,
    ) -> Result<(), Unused> {
        if from.vehicle == to.vehicle {
            return Err(Unused::SameVehicle);
        }
        if !self.has_room_for_edge_by(from.vehicle) {
            return Err(Unused::Full);
        }
        let measurement = &observation.measurement;
        if !is_usable(observation) || !is_lever(&observation.from_end) {
            return Err(Unused::Unusable);
        }
        if !self.is_kept(from.vehicle, to.vehicle) {
            return Err(Unused::LeftOut);
        }
        self.locate_by(from, to, observation)?;
        let (from_id, to_id) = (self.pose_of(from)?, self.pose_of(to)?);
        let counted = Counted {
            of: Some(to.vehicle),
            kind: measurement.kind(),
            nth: 0,
        };
        self.count(from_id, counted)?;
        let edge = self.edge(Some(from_id), to_id, from.vehicle, to.vehicle, observation);
        if self.members[&from.vehicle].doubt.is_quarantined {
            self.tested.push(edge);
            return Err(Unused::Quarantined);
        }
        if measurement.kind() == Kind::Distance {
            self.distance_rounds = DISTANCE_ROUNDS;
        }
        if has_a_length(measurement.kind()) {
            self.give_scales_room(&[from.vehicle, to.vehicle]);
        }
        self.edges.push(edge);
        Ok(())
    }

    /// The scales of vehicles between which a length was measured get room, each once.
    fn give_scales_room(&mut self, vehicles: &[VehicleId]) {
        let room = self.settings.bias.scale.room;
        for vehicle in vehicles {
            let member = self.members.get_mut(vehicle);
            if member.is_some_and(|member| member.biases.meet_a_length()) {
                self.prior
                    .wander(0.0, room * room, |other| other == *vehicle);
            }
        }
    }

    pub(super) fn fixed(
        &mut self,
        at: &Moment,
        nth: u8,
        observation: &Observation,
    ) -> Result<(), Unused> {
        if !self.has_room_for_edge_by(at.vehicle) {
            return Err(Unused::Full);
        }
        let kind = observation.measurement.kind();
        if !is_usable(observation) {
            return Err(Unused::Unusable);
        }
        if let (false, Measurement::Pose(pose)) = (
            self.members.contains_key(&at.vehicle),
            &observation.measurement,
        ) {
            let world_from_end = observation.from_end * pose.relative();
            let world_from_body = world_from_end * observation.to_end.inverse();
            self.place(at, &world_from_body.reframe())?;
        }
        let to = self.pose_of(at)?;
        let counted = Counted {
            of: None,
            kind,
            nth,
        };
        self.count(to, counted)?;
        let edge = self.edge(None, to, at.vehicle, at.vehicle, observation);
        self.edges.push(edge);
        Ok(())
    }

    fn edge(
        &self,
        from: Option<PoseId>,
        to: PoseId,
        by: VehicleId,
        of: VehicleId,
        observation: &Observation,
    ) -> MeasuredEdge {
        // What a kind has not got is not looked at, and may be anything.
        let noise = Noise {
            rotation_rad: observation.noise.rotation_rad.max(NOISE_MIN.0),
            translation: observation.noise.translation.max(NOISE_MIN.1),
        };
        MeasuredEdge {
            from,
            to,
            from_end: observation.from_end,
            to_end: observation.to_end,
            measurement: observation.measurement,
            noise,
            by,
            of,
            is_new: true,
            failed_gate: false,
            is_apart: false,
            linear: Linear::default(),
            weight: 0.0,
        }
    }

    /// A measured pose locates whichever of its ends is not located yet.
    fn locate_by(
        &mut self,
        from: &Moment,
        to: &Moment,
        observation: &Observation,
    ) -> Result<(), Unused> {
        let located = |window: &Self, moment: &Moment| window.members.contains_key(&moment.vehicle);
        let Measurement::Pose(pose) = &observation.measurement else {
            return Ok(());
        };
        let from_from_to = pose.relative();
        let (known, unknown, known_from_unknown) = match (located(self, from), located(self, to)) {
            (true, false) => {
                let forth = observation.from_end * from_from_to * observation.to_end.inverse();
                (from, to, forth)
            }
            (false, true) => {
                let back =
                    observation.to_end * from_from_to.inverse() * observation.from_end.inverse();
                (to, from, back)
            }
            _ => return Ok(()),
        };
        if self
            .members
            .get(&from.vehicle)
            .is_some_and(|member| member.doubt.is_quarantined)
        {
            return Err(Unused::Quarantined);
        }
        let known = self.pose_of(known)?;
        let world_from_known = self.in_the_world(&self.poses[self.index(known)].world_from_body);
        self.place(unknown, &(world_from_known * known_from_unknown))
    }

    fn count(&mut self, id: PoseId, counted: Counted) -> Result<(), Unused> {
        let at = self.index(id);
        let list = &mut self.poses[at].counted;
        if list.contains(&counted) {
            return Err(Unused::Counted);
        }
        list.push(counted);
        Ok(())
    }

    /// The frame's origin moves to this vehicle; while nobody knows where it is, to somebody.
    pub(super) fn recentre(&mut self) {
        let somebody = || self.newest_of(*self.members.keys().next()?);
        let Some(middle) = self.newest_of(self.own).or_else(somebody) else {
            return;
        };
        let shift = middle.world_from_body.translation;
        self.centre += shift;
        for pose in &mut self.poses {
            pose.world_from_body.translation -= shift;
        }
        self.prior.recentre(&shift);
    }

    /// The instant of the last round: of this vehicle's last pose or, while nobody knows where it is, one that half of
    /// the others have reached.
    pub(super) fn newest_round(&self) -> Option<Stamp> {
        if let Some(own) = self.newest_of(self.own) {
            return Some(own.instant);
        }
        let others = self.members.keys().filter_map(|id| self.newest_of(*id));
        let mut instants: Vec<Stamp> = others.map(|pose| pose.instant).collect();
        instants.sort();
        instants.get(instants.len() / 2).copied()
    }

    /// Everybody's biases wander for a round.
    pub(super) fn wander(&mut self) {
        let (bias, seconds) = (self.settings.bias, self.period_s());
        let gyro = bias.gyro.walk * bias.gyro.walk * seconds;
        let scale = bias.scale.walk * bias.scale.walk * seconds;
        self.prior.wander(gyro, scale, |_| true);
    }

    /// Biases that are none are held there, and those that left the range in which they were expected get room.
    pub(super) fn judge_biases(&mut self, variances: &BTreeMap<VehicleId, Vector4<f64>>) {
        let (noise, seconds) = (self.settings.bias, self.period_s());
        for (vehicle, variances) in variances {
            let Some(member) = self.members.get_mut(vehicle) else {
                continue;
            };
            let fates = member.biases.judge(variances, &noise, seconds);
            let room = |fate: Fate, range: &BiasRange| match fate {
                Fate::Room => range.room * range.room,
                Fate::Held | Fate::Unchanged => 0.0,
            };
            let (gyro, scale) = (
                room(fates.gyro, &noise.gyro),
                room(fates.scale, &noise.scale),
            );
            if gyro > 0.0 || scale > 0.0 {
                self.prior.wander(gyro, scale, |other| other == *vehicle);
            }
            if fates.gyro == Fate::Held {
                self.prior.hold_biases(*vehicle, 0..3, noise.gyro.held);
            }
            if fates.scale == Fate::Held {
                self.prior.hold_biases(*vehicle, 3..4, noise.scale.held);
            }
        }
    }

    /// A vehicle's biases may be anything.
    pub(super) fn free_biases(&mut self, vehicle: VehicleId) {
        let gyro = SUSPICIOUS_ROOM * self.settings.bias.gyro.room;
        let scale = SUSPICIOUS_ROOM * self.settings.bias.scale.room;
        self.prior
            .wander(gyro * gyro, scale * scale, |other| other == vehicle);
    }

    /// A vehicle may be elsewhere: what was measured since brings it there.
    pub(super) fn displace(&mut self, vehicle: VehicleId) {
        let all: BTreeSet<PoseId> = self.poses_of(vehicle).map(|pose| pose.id).collect();
        self.prior.displace(MISPLACED_BY, |id| all.contains(&id));
    }

    pub(super) fn biases(&self) -> Vec<(VehicleId, Vector4<f64>)> {
        let members = self.members.iter();
        members
            .map(|(id, member)| (*id, member.biases.value))
            .collect()
    }

    pub(super) fn restore(
        &mut self,
        poses: &[Transform<World, Body>],
        biases: &[(VehicleId, Vector4<f64>)],
    ) {
        for (pose, before) in self.poses.iter_mut().zip(poses) {
            pose.world_from_body = *before;
        }
        for (vehicle, before) in biases {
            if let Some(member) = self.members.get_mut(vehicle) {
                member.biases.value = *before;
            }
        }
    }

    pub(super) fn is_finite(&self) -> bool {
        let biases = self
            .members
            .values()
            .all(|member| member.biases.value.iter().all(|bias| bias.is_finite()));
        biases
            && self
                .poses
                .iter()
                .all(|pose| pose.world_from_body.is_valid())
    }

    pub(super) fn linearise(&self, edge: &MeasuredEdge, scales: &NoiseScales) -> Linear {
        let world = Transform::new(nalgebra::UnitQuaternion::identity(), -self.centre);
        let from = edge
            .from
            .map_or(world, |from| self.poses[self.index(from)].world_from_body);
        let to = self.poses[self.index(edge.to)].world_from_body;
        edge.linearise(&from, &to, &scales.measurement)
    }

    /// The linearised stretch between two poses, by index.
    pub(super) fn linearise_stretch(
        &self,
        (earlier, later): (usize, usize),
        scales: &NoiseScales,
    ) -> Option<stretch::Linear> {
        let (earlier, later) = (&self.poses[earlier], &self.poses[later]);
        let member = &self.members[&earlier.vehicle];
        let inflated = if member.odometry.lies {
            LYING_NOISE
        } else {
            1.0
        };
        let factors = (
            scales.odometry.rotation() * member.scale.rotation() * inflated,
            scales.odometry.translation() * member.scale.translation() * inflated,
        );
        Stretch {
            earlier: &earlier.point,
            later: &later.point,
        }
        .linearise(
            &earlier.world_from_body,
            &later.world_from_body,
            &member.biases.value,
            factors,
            &self.settings,
            self.period_s(),
        )
    }

    /// Linearises every measurement at the present poses.
    pub(super) fn linearise_edges(&mut self, scales: &NoiseScales) {
        let mut edges = std::mem::take(&mut self.edges);
        for edge in &mut edges {
            edge.linear = self.linearise(edge, scales);
        }
        self.edges = edges;
    }

    /// Weighs every measurement by its residual: Cauchy, for those that failed the gate its square, and nothing at all in
    /// a round's first iteration, when the estimate may still be where they want it.
    pub(super) fn weigh_edges(&mut self, settled: bool, is_first: bool) {
        let cauchy = self.settings.cauchy;
        for edge in &mut self.edges {
            let weight = cauchy / (cauchy + edge.linear.square());
            edge.weight = match (edge.failed_gate, is_first && edge.is_new, settled) {
                _ if !weight.is_finite() => 0.0,
                (true, true, _) => 0.0,
                (true, false, true) => weight * weight,
                _ => weight,
            };
        }
    }

    /// The round is over: nothing is new any more, and the nearest are chosen for the next.
    pub(super) fn end_round(&mut self) {
        for pose in &mut self.poses {
            pose.is_new = false;
        }
        for edge in &mut self.edges {
            edge.is_new = false;
        }
        self.tested.clear();
        self.kept = self.nearest();
    }

    /// Whether what two vehicles measure of each other is used. Whoever is not located yet may be near.
    fn is_kept(&self, a: VehicleId, b: VehicleId) -> bool {
        let located = |vehicle| self.members.contains_key(&vehicle);
        let kept = self.kept.as_ref();
        kept.is_none_or(|kept| kept.contains(&pair(a, b)) || !located(a) || !located(b))
    }

    /// Between whom measurements are used, when there are many: each vehicle and those that are nearest to it. So every
    /// vehicle keeps its best, the team stays connected, and measurements grow with their number, not its square.
    fn nearest(&self) -> Option<BTreeSet<(VehicleId, VehicleId)>> {
        if self.members.len() <= self.settings.nearest + 1 {
            return None;
        }
        let now = self.newest_round()?;
        let members = self.members.keys();
        let places: Vec<(VehicleId, Vector3<f64>)> = members
            .filter_map(|vehicle| self.newest_of(*vehicle))
            .filter(|pose| now - pose.instant <= self.period * PRESENT_ROUNDS)
            .map(|pose| (pose.vehicle, pose.world_from_body.translation))
            .collect();
        let mut kept = BTreeSet::new();
        for (vehicle, place) in &places {
            let others = places.iter().filter(|(other, _)| other != vehicle);
            let mut others: Vec<(f64, VehicleId)> = others
                .map(|(other, elsewhere)| ((elsewhere - place).norm(), *other))
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let nearest = others.into_iter().take(self.settings.nearest);
            kept.extend(nearest.map(|(_, other)| pair(*vehicle, other)));
        }
        Some(kept)
    }
}

/// Two vehicles in one order.
fn pair(a: VehicleId, b: VehicleId) -> (VehicleId, VehicleId) {
    (a.min(b), a.max(b))
}

/// Whether a pose of the window can be followed.
fn is_in_reach(pose: &Transform<World, Body>) -> bool {
    pose.is_valid() && pose.translation.norm() <= REACH_M
}

/// Whether an end is at a body.
fn is_lever(end: &Transform<Body, Sensor>) -> bool {
    end.is_valid() && end.translation.norm() <= LEVER_MAX_M
}

/// Whether an observation is one; its measurement was checked when it was made.
fn is_usable(observation: &Observation) -> bool {
    let kind = observation.measurement.kind();
    observation.noise.check(kind).is_ok()
        && observation.from_end.is_valid()
        && is_lever(&observation.to_end)
}

/// Whether a kind tells lengths, without which an odometer's scale cannot be told from none.
const fn has_a_length(kind: Kind) -> bool {
    matches!(kind, Kind::Pose | Kind::Position | Kind::Distance)
}
