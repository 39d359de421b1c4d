//! An edge of the measurement graph: one measurement between two nodes, with a constant offset at each end.
//!
//! The offset carries the lever arm of the sensor and the motion between the round and the measurement, so the ends
//! are `T_a O_a`. A perturbation `(w, delta)` of `T` is the perturbation `(Ro^T w, delta - R [t_o]x w)` of `T O`,
//! i.e. `[[Ro^T, 0], [-R [t_o]x, I]]`; everything here goes through that matrix.

use nalgebra::{Matrix3, Matrix6, SMatrix, UnitQuaternion, Vector3, Vector6};

use super::kernel::{Disagreement, Judged, Scale};
use super::measurement::{
    COINCIDENT_BELOW_M, End, Gradient, Jacobian, Kind, Measurement, Noise, Orientation, Position,
};
use super::refusal::Refusal;
use crate::so3;
use crate::transform::{Body, Sensor, Transform, World};

/// A node's pose.
pub type Node = Transform<World, Body>;

/// How much an edge counts in the cost.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "edges of one graph are mostly of one weight, and boxing would allocate per measurement"
)]
pub enum Weight {
    /// One per squared radian and squared metre, as in the paper.
    Unit,
    /// By stated standard deviations: `1/sigma^2`. A bearing then uses its residual on the sphere.
    Noise(Noise),
    /// A pose's full information matrix, rotation first, on its twist residual (see `measurement/pose.rs`).
    Information(Matrix6<f64>),
}

impl Weight {
    /// Checks that the weight can be one of a measurement of `kind`.
    ///
    /// # Errors
    /// [`Refusal::BadNoise`], [`Refusal::BadWeight`] or [`Refusal::WeightOfAnotherKind`].
    pub fn check(&self, kind: Kind) -> Result<(), Refusal> {
        match self {
            Self::Unit => Ok(()),
            Self::Noise(noise) => noise.check(kind),
            Self::Information(_) if kind != Kind::Pose => {
                Err(Refusal::WeightOfAnotherKind { kind })
            }
            Self::Information(matrix) => check_information(matrix),
        }
    }
}

/// Symmetric, finite and without a negative eigenvalue, within rounding.
fn check_information(matrix: &Matrix6<f64>) -> Result<(), Refusal> {
    let size = matrix.amax();
    if !size.is_finite() || !matrix.iter().all(|number| number.is_finite()) {
        return Err(Refusal::BadWeight);
    }
    if (matrix - matrix.transpose()).amax() > 1e-9 * size {
        return Err(Refusal::BadWeight);
    }
    let smallest = matrix.symmetric_eigenvalues().min();
    if smallest < -1e-9 * size {
        Err(Refusal::BadWeight)
    } else {
        Ok(())
    }
}

/// One measurement between two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    measurement: Measurement,
    weight: Weight,
    from_offset: Offset,
    to_offset: Offset,
}

/// The part of the normal equations that one edge contributes: `H = J^T W J` and `g = J^T W r`, in the perturbations
/// of its two nodes.
#[derive(Debug, Clone, Copy)]
pub struct Normal {
    /// `H` of the measuring node with itself.
    pub from_from: Matrix6<f64>,
    /// `H` of the measuring node (rows) with the measured one (columns).
    pub from_to: Matrix6<f64>,
    /// `H` of the measured node with itself.
    pub to_to: Matrix6<f64>,
    /// `g` of the measuring node.
    pub from: Vector6<f64>,
    /// `g` of the measured node.
    pub to: Vector6<f64>,
}

impl Edge {
    /// An edge without offsets: the nodes themselves measure and are measured.
    ///
    /// # Errors
    /// [`Refusal`] when the weight cannot be one of this measurement.
    pub fn new(measurement: Measurement, weight: Weight) -> Result<Self, Refusal> {
        Self::with_offsets(
            measurement,
            weight,
            Transform::identity(),
            Transform::identity(),
        )
    }

    /// An edge whose ends are `T O`, `O` being `body_from_sensor` of each end (motion since the round included).
    ///
    /// # Errors
    /// [`Refusal`] when the weight cannot be one of this measurement or an offset is not finite.
    pub fn with_offsets(
        measurement: Measurement,
        weight: Weight,
        from_offset: Transform<Body, Sensor>,
        to_offset: Transform<Body, Sensor>,
    ) -> Result<Self, Refusal> {
        weight.check(measurement.kind())?;
        Ok(Self {
            measurement,
            weight,
            from_offset: Offset::new(from_offset)?,
            to_offset: Offset::new(to_offset)?,
        })
    }

    /// What was measured.
    #[must_use]
    pub const fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    /// How much it counts.
    #[must_use]
    pub const fn weight(&self) -> &Weight {
        &self.weight
    }

    /// `body_from_sensor` of the measuring end.
    #[must_use]
    pub const fn from_offset(&self) -> &Transform<Body, Sensor> {
        &self.from_offset.transform
    }

    /// `body_from_sensor` of the measured end.
    #[must_use]
    pub const fn to_offset(&self) -> &Transform<Body, Sensor> {
        &self.to_offset.transform
    }

    /// The weighted `g_e`: twice what the edge adds to the cost of the graph (paper eq. 3 has the factor 1/2).
    #[must_use]
    pub fn cost(&self, from: &Node, to: &Node) -> f64 {
        let (from, to) = (self.from_offset.end(from), self.to_offset.end(to));
        match (&self.weight, &self.measurement) {
            (Weight::Unit, measurement) => measurement.cost(&from, &to),
            (Weight::Information(information), Measurement::Pose(pose)) => {
                let residual = pose.twist_residual(&from, &to);
                residual.dot(&(information * residual))
            }
            (weight, Measurement::Bearing(bearing)) => {
                weight.of_rotation() * bearing.residual_on_sphere(&from, &to).norm_squared()
            }
            (weight, Measurement::Pose(pose)) => {
                weight.of_rotation() * pose.orientation().cost(&from, &to)
                    + weight.of_translation() * pose.position().cost(&from, &to)
            }
            (weight, Measurement::Orientation(orientation)) => {
                weight.of_rotation() * orientation.cost(&from, &to)
            }
            (weight, Measurement::Position(position)) => {
                weight.of_translation() * position.cost(&from, &to)
            }
            (weight, Measurement::Distance(distance)) => {
                weight.of_translation() * distance.cost(&from, &to)
            }
        }
    }

    /// The lengths of the residual's parts, before any weight. A bearing's is an angle when it is weighted by its noise
    /// and a length (times the present distance) when it counts one.
    #[must_use]
    pub fn disagreement(&self, from: &Node, to: &Node) -> Disagreement {
        let (from, to) = (self.from_offset.end(from), self.to_offset.end(to));
        let (rotation_rad, translation_m) = match &self.measurement {
            Measurement::Pose(pose) => (
                Some(pose.orientation().residual(&from, &to).norm()),
                Some(pose.position().residual(&from, &to).norm()),
            ),
            Measurement::Orientation(orientation) => {
                (Some(orientation.residual(&from, &to).norm()), None)
            }
            Measurement::Position(position) => (None, Some(position.residual(&from, &to).norm())),
            Measurement::Bearing(bearing) if matches!(self.weight, Weight::Unit) => {
                (None, Some(bearing.residual(&from, &to).norm()))
            }
            Measurement::Bearing(bearing) => {
                (Some(bearing.residual_on_sphere(&from, &to).norm()), None)
            }
            Measurement::Distance(distance) => (None, Some(distance.residual(&from, &to).abs())),
        };
        Disagreement {
            rotation_rad,
            translation_m,
        }
    }

    /// What the kernel of `scale` makes of the edge.
    pub(super) fn judged(&self, scale: &Scale, from: &Node, to: &Node) -> Judged {
        let apart = self.disagreement(from, to);
        // The noise of a part that a measurement has not may be zero, its weight infinite: it is not looked at.
        let cost = |apart: &Disagreement| {
            let turned = apart
                .rotation_rad
                .map(|angle| self.weight.of_rotation() * angle * angle);
            let moved = apart
                .translation_m
                .map(|length| self.weight.of_translation() * length * length);
            turned.unwrap_or(0.0) + moved.unwrap_or(0.0)
        };
        Judged::new(cost(&apart), cost(&scale.of_the_parts(&apart)))
    }

    /// The standard deviations, in rad and m, of the residual at the given nodes by the measurement's own noise.
    pub(super) fn residual_noise(&self, noise: &Noise, from: &Node, to: &Node) -> (f64, f64) {
        match self.measurement.kind() {
            Kind::Pose => (noise.rotation_rad, noise.translation),
            Kind::Orientation => (noise.rotation_rad, 0.0),
            Kind::Position | Kind::Distance => (0.0, noise.translation),
            Kind::Bearing if matches!(self.weight, Weight::Unit) => {
                let (from, to) = (self.from_offset.end(from), self.to_offset.end(to));
                let range_m = (to.translation - from.translation).norm();
                (0.0, range_m * noise.rotation_rad)
            }
            Kind::Bearing => (noise.rotation_rad, 0.0),
        }
    }

    /// The gradient of [`Edge::cost`] in the perturbations of the two nodes.
    #[must_use]
    pub fn gradient(&self, from: &Node, to: &Node) -> Gradient {
        let ends = (self.from_offset.end(from), self.to_offset.end(to));
        let at_ends = match (&self.weight, &self.measurement) {
            (Weight::Unit, measurement) => measurement.gradient(&ends.0, &ends.1),
            (Weight::Information(information), Measurement::Pose(pose)) => {
                let Jacobian { from, to } = pose.twist_jacobian(&ends.0, &ends.1);
                let weighted = 2.0 * (information * pose.twist_residual(&ends.0, &ends.1));
                Gradient {
                    from: from.tr_mul(&weighted),
                    to: to.tr_mul(&weighted),
                }
            }
            (weight, Measurement::Bearing(bearing)) => {
                let Jacobian { from, to } = bearing.jacobian_on_sphere(&ends.0, &ends.1);
                let weighted =
                    2.0 * weight.of_rotation() * bearing.residual_on_sphere(&ends.0, &ends.1);
                Gradient {
                    from: from.tr_mul(&weighted),
                    to: to.tr_mul(&weighted),
                }
            }
            (weight, Measurement::Pose(pose)) => {
                let turn = pose.orientation().gradient(&ends.0, &ends.1);
                let shift = pose.position().gradient(&ends.0, &ends.1);
                let (turns, shifts) = (weight.of_rotation(), weight.of_translation());
                Gradient {
                    from: turns * turn.from + shifts * shift.from,
                    to: turns * turn.to + shifts * shift.to,
                }
            }
            (weight, Measurement::Orientation(orientation)) => orientation
                .gradient(&ends.0, &ends.1)
                .times(weight.of_rotation()),
            (weight, measurement) => measurement
                .gradient(&ends.0, &ends.1)
                .times(weight.of_translation()),
        };
        Gradient {
            from: self.from_offset.pull_back(from, &at_ends.from),
            to: self.to_offset.pull_back(to, &at_ends.to),
        }
    }

    /// The edge's part of the normal equations and its weighted `g_e`, at the given nodes.
    #[must_use]
    pub fn linearise(&self, from_node: &Node, to_node: &Node) -> (Normal, f64) {
        let mut normal = Normal::zero();
        let cost = self.add_linearised(from_node, to_node, &mut normal.sums());
        (normal, cost)
    }

    /// Adds what [`Edge::linearise`] gives to running sums; gives the weighted `g_e`.
    pub(crate) fn add_linearised(
        &self,
        from_node: &Node,
        to_node: &Node,
        normal: &mut Sums<'_>,
    ) -> f64 {
        self.add_share_linearised(from_node, to_node, 1.0, normal)
    }

    /// As [`Edge::add_linearised`], with that share of the weight (iteratively reweighted least squares).
    pub(super) fn add_share_linearised(
        &self,
        from_node: &Node,
        to_node: &Node,
        share: f64,
        normal: &mut Sums<'_>,
    ) -> f64 {
        let (rotation, translation) = (
            share * self.weight.of_rotation(),
            share * self.weight.of_translation(),
        );
        let relative = from_node.rotation.inverse() * to_node.rotation;
        let from_from_to = relative.to_rotation_matrix().into_inner();
        match (&self.weight, &self.measurement) {
            (Weight::Information(information), Measurement::Pose(pose)) => {
                let (from, to) = (self.from_offset.end(from_node), self.to_offset.end(to_node));
                let by = pose.twist_jacobian(&from, &to);
                let by_from = through(&by.from, &self.from_offset, from_node);
                let by_to = through(&by.to, &self.to_offset, to_node);
                let residual = pose.twist_residual(&from, &to);
                let information = share * information;
                normal.add_information(&information, &residual, &by_from, &by_to);
                residual.dot(&(information * residual))
            }
            (_, Measurement::Pose(pose)) => {
                self.add_turn(
                    rotation,
                    pose.orientation(),
                    &relative,
                    &from_from_to,
                    normal,
                ) + self.add_shift(
                    translation,
                    pose.position(),
                    from_node,
                    to_node,
                    &from_from_to,
                    normal,
                )
            }
            (_, Measurement::Orientation(orientation)) => {
                self.add_turn(rotation, orientation, &relative, &from_from_to, normal)
            }
            (_, Measurement::Position(position)) => self.add_shift(
                translation,
                position,
                from_node,
                to_node,
                &from_from_to,
                normal,
            ),
            (weight, Measurement::Bearing(bearing)) => {
                let (from, to) = (self.from_offset.end(from_node), self.to_offset.end(to_node));
                // In metres with weight one, on the sphere otherwise: the paper's weight of one is no angle's.
                let ((residual, by_turn, by_delta), weight) = match weight {
                    Weight::Unit => (bearing.linearised(&from, &to), translation),
                    Weight::Noise(_) | Weight::Information(_) => {
                        (bearing.linearised_on_sphere(&from, &to), rotation)
                    }
                };
                normal.add_difference(
                    weight,
                    &residual,
                    &self.shifted(from_node, to_node, by_turn, by_delta),
                )
            }
            (_, Measurement::Distance(distance)) => {
                let (from, to) = (self.from_offset.end(from_node), self.to_offset.end(to_node));
                let (residual, u) = distance.linearised(&from, &to);
                let shift = self.shifted(
                    from_node,
                    to_node,
                    SMatrix::<f64, 1, 3>::zeros(),
                    u.transpose(),
                );
                normal.add_difference(translation, &SMatrix::<f64, 1, 1>::new(residual), &shift)
            }
        }
    }

    /// Adds an orientation residual. Its Jacobians are rotations of `Jr^-1(phi)`, and `Jr^-T phi = phi`, so with the
    /// disagreement `psi` seen in the node that is measured and `M = R_i^T R_j` of the nodes the parts are closed
    /// forms: `H_jj = G(psi)`, `H_ij = -M G(psi)`, `H_ii = M G(psi) M^T`, `g_j = psi`, `g_i = -M psi`, `G = Jr^-T Jr^-1`.
    fn add_turn(
        &self,
        weight: f64,
        orientation: &Orientation,
        relative: &UnitQuaternion<f64>,
        from_from_to: &Matrix3<f64>,
        normal: &mut Sums<'_>,
    ) -> f64 {
        let (from_offset, to_offset) = (&self.from_offset, &self.to_offset);
        let psi = if from_offset.is_identity && to_offset.is_identity {
            so3::log(&(orientation.rotation().inverse() * relative))
        } else {
            let ends =
                from_offset.transform.rotation.inverse() * relative * to_offset.transform.rotation;
            to_offset
                .sensor_from_body
                .tr_mul(&so3::log(&(orientation.rotation().inverse() * ends)))
        };
        let in_from = from_from_to * psi;
        let to_to = so3::right_jacobian_inverse_gram(&psi) * weight;
        let turned = from_from_to * to_to;
        add_block(normal.from_from, 0, 0, &(turned * from_from_to.transpose()));
        normal.add_pair(0, 0, &-turned);
        add_block(normal.to_to, 0, 0, &to_to);
        add_rows(normal.from, 0, &(-weight * in_from));
        add_rows(normal.to, 0, &(weight * psi));
        weight * psi.norm_squared()
    }

    /// Adds a position residual. Turned into the measuring body's frame it is `s - c`, with `s` where the measured
    /// point was seen and `c = R_i^T (t_j + R_j a - t_i)` where it is, `a` its lever arm: then `J_wi = -[c]x`,
    /// `J_di = R_i^T`, `J_wj = M [a]x`, `J_dj = -R_i^T`, `M = R_i^T R_j`. A constant turn of a residual changes
    /// nothing in the normal equations.
    fn add_shift(
        &self,
        weight: f64,
        position: &Position,
        from: &Node,
        to: &Node,
        from_from_to: &Matrix3<f64>,
        normal: &mut Sums<'_>,
    ) -> f64 {
        let a = &self.to_offset.transform.translation;
        let seen = if self.from_offset.is_identity {
            position.vector()
        } else {
            self.from_offset
                .transform
                .transform_point(&position.vector())
        };
        let world_from_from = from.rotation.to_rotation_matrix().into_inner();
        let c = world_from_from.tr_mul(&(to.translation - from.translation)) + from_from_to * a;
        let residual = seen - c;
        let in_world = weight * (world_from_from * residual);
        // [c]x R_i^T: the transpose of -R_i [c]x.
        let turn_delta = (world_from_from * so3::hat(&c) * -weight).transpose();
        add_block(normal.from_from, 0, 0, &(gram_of_hat(&c) * weight));
        add_block(normal.from_from, 0, 3, &turn_delta);
        add_block(normal.from_from, 3, 0, &turn_delta.transpose());
        add_diagonal(normal.from_from, weight);
        add_diagonal(normal.to_to, weight);
        add_diagonal(normal.pair, -weight);
        normal.add_pair(0, 3, &-turn_delta);
        add_rows(normal.from, 0, &(weight * c.cross(&residual)));
        add_rows(normal.from, 3, &in_world);
        add_rows(normal.to, 3, &-in_world);
        if !self.to_offset.is_identity {
            let by_to_turn = from_from_to * so3::hat(a);
            let delta_turn = weight * (world_from_from * by_to_turn);
            normal.add_pair(0, 0, &(so3::hat(&c) * by_to_turn * weight));
            normal.add_pair(3, 0, &delta_turn);
            add_block(normal.to_to, 0, 0, &(gram_of_hat(a) * weight));
            add_block(normal.to_to, 3, 0, &-delta_turn);
            add_block(normal.to_to, 0, 3, &-delta_turn.transpose());
            add_rows(normal.to, 0, &(weight * by_to_turn.tr_mul(&residual)));
        }
        weight * residual.norm_squared()
    }

    /// Carries derivatives at the ends to the nodes, for a residual of the difference of the two end positions.
    fn shifted<const D: usize>(
        &self,
        from: &Node,
        to: &Node,
        by_turn: SMatrix<f64, D, 3>,
        by_delta: SMatrix<f64, D, 3>,
    ) -> Shift<D> {
        let (from_offset, to_offset) = (&self.from_offset, &self.to_offset);
        Shift {
            by_from_turn: if from_offset.is_identity {
                by_turn
            } else {
                by_turn * from_offset.sensor_from_body + by_delta * from_offset.lever(from)
            },
            by_to_turn: (!to_offset.is_identity).then(|| -by_delta * to_offset.lever(to)),
            by_from_delta: by_delta,
        }
    }

    /// How many standard deviations lie between this and another measurement of the same kind between the same two
    /// nodes, taken by the same sensors at the same time (equal offsets); zero where nothing can be said.
    #[must_use]
    pub fn sigmas_apart(&self, noise: &Noise, other: &Self, other_noise: &Noise) -> f64 {
        if self.from_offset == other.from_offset && self.to_offset == other.to_offset {
            self.measurement
                .sigmas_apart(noise, &other.measurement, other_noise)
        } else {
            0.0
        }
    }

    /// True when this is a bearing or distance whose ends coincide, so that it has no direction and pulls nowhere.
    #[must_use]
    pub fn is_coincident(&self, from: &Node, to: &Node) -> bool {
        let undirected = matches!(self.measurement.kind(), Kind::Bearing | Kind::Distance);
        undirected
            && (self.to_offset.end(to).translation - self.from_offset.end(from).translation).norm()
                < COINCIDENT_BELOW_M
    }

    /// True when the measured and the predicted orientation are half a turn apart, within 1e-6 rad.
    #[must_use]
    pub fn is_opposite(&self, from: &Node, to: &Node) -> bool {
        let orientation = match &self.measurement {
            Measurement::Pose(pose) => pose.orientation(),
            Measurement::Orientation(orientation) => orientation,
            _ => return false,
        };
        let (from, to) = (
            from.rotation * self.from_offset.transform.rotation,
            to.rotation * self.to_offset.transform.rotation,
        );
        let disagreement = orientation.rotation().inverse() * (from.inverse() * to);
        // The scalar part is cos(angle/2), about half of what is missing to pi.
        disagreement.w.abs() < 0.5e-6
    }
}

impl Weight {
    pub(super) fn of_rotation(&self) -> f64 {
        match self {
            Self::Noise(noise) => noise.rotation_rad.powi(-2),
            Self::Unit | Self::Information(_) => 1.0,
        }
    }

    pub(super) fn of_translation(&self) -> f64 {
        match self {
            Self::Noise(noise) => noise.translation.powi(-2),
            Self::Unit | Self::Information(_) => 1.0,
        }
    }
}

impl Gradient {
    fn times(self, factor: f64) -> Self {
        Self {
            from: factor * self.from,
            to: factor * self.to,
        }
    }
}

/// A checked end offset, with its rotation as a matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Offset {
    transform: Transform<Body, Sensor>,
    sensor_from_body: Matrix3<f64>,
    is_identity: bool,
}

impl Offset {
    fn new(transform: Transform<Body, Sensor>) -> Result<Self, Refusal> {
        if !transform.is_valid() {
            return Err(Refusal::NotFinite {
                what: "the end offset",
            });
        }
        Ok(Self {
            sensor_from_body: transform
                .rotation
                .inverse()
                .to_rotation_matrix()
                .into_inner(),
            is_identity: transform == Transform::identity(),
            transform,
        })
    }

    fn end(&self, node: &Node) -> End {
        if self.is_identity {
            node.reframe()
        } else {
            *node * self.transform
        }
    }

    /// `-R [t_o]x`: how a turn of the node moves the end.
    fn lever(&self, node: &Node) -> Matrix3<f64> {
        if self.is_identity {
            Matrix3::zeros()
        } else {
            -node.rotation.to_rotation_matrix().into_inner() * so3::hat(&self.transform.translation)
        }
    }

    /// A gradient at the end, as one at the node: the transposed offset matrix.
    fn pull_back(&self, node: &Node, at_end: &Vector6<f64>) -> Vector6<f64> {
        if self.is_identity {
            return *at_end;
        }
        let turn: Vector3<f64> = at_end.fixed_rows::<3>(0).into_owned();
        let shift: Vector3<f64> = at_end.fixed_rows::<3>(3).into_owned();
        let turn = self.sensor_from_body.tr_mul(&turn) + self.lever(node).tr_mul(&shift);
        Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
    }
}

/// Derivatives of a residual of `D` numbers that depends on the difference of the two end positions: in the turns of
/// both nodes and in `delta_i`, which is minus that in `delta_j`.
struct Shift<const D: usize> {
    by_from_turn: SMatrix<f64, D, 3>,
    by_to_turn: Option<SMatrix<f64, D, 3>>,
    by_from_delta: SMatrix<f64, D, 3>,
}

/// A derivative at an end as one at its node: times the offset matrix.
fn through(by_end: &Matrix6<f64>, offset: &Offset, node: &Node) -> Matrix6<f64> {
    if offset.is_identity {
        return *by_end;
    }
    let turn = by_end.fixed_columns::<3>(0) * offset.sensor_from_body
        + by_end.fixed_columns::<3>(3) * offset.lever(node);
    let mut by_node = *by_end;
    by_node.fixed_columns_mut::<3>(0).copy_from(&turn);
    by_node
}

/// Running sums of normal equations, wherever they are kept.
pub(crate) struct Sums<'a> {
    pub(crate) from_from: &'a mut Matrix6<f64>,
    pub(crate) to_to: &'a mut Matrix6<f64>,
    /// Of the pair: rows are the measuring node's, or the measured node's when `pair_is_to_from`.
    pub(crate) pair: &'a mut Matrix6<f64>,
    pub(crate) pair_is_to_from: bool,
    pub(crate) from: &'a mut Vector6<f64>,
    pub(crate) to: &'a mut Vector6<f64>,
}

impl Normal {
    pub(crate) fn zero() -> Self {
        Self {
            from_from: Matrix6::zeros(),
            from_to: Matrix6::zeros(),
            to_to: Matrix6::zeros(),
            from: Vector6::zeros(),
            to: Vector6::zeros(),
        }
    }

    pub(crate) fn sums(&mut self) -> Sums<'_> {
        Sums {
            from_from: &mut self.from_from,
            to_to: &mut self.to_to,
            pair: &mut self.from_to,
            pair_is_to_from: false,
            from: &mut self.from,
            to: &mut self.to,
        }
    }
}

impl Sums<'_> {
    /// Adds a block of the pair, given with the measuring node's rows.
    fn add_pair(&mut self, row: usize, column: usize, block: &Matrix3<f64>) {
        if self.pair_is_to_from {
            add_block(self.pair, column, row, &block.transpose());
        } else {
            add_block(self.pair, row, column, block);
        }
    }

    /// Adds a residual that depends on the difference of the end positions; gives its weighted square.
    fn add_difference<const D: usize>(
        &mut self,
        weight: f64,
        residual: &SMatrix<f64, D, 1>,
        by: &Shift<D>,
    ) -> f64 {
        let turn = by.by_from_turn.transpose() * weight;
        let delta = by.by_from_delta.transpose() * weight;
        let turn_turn = turn * by.by_from_turn;
        let turn_delta = turn * by.by_from_delta;
        let delta_delta = delta * by.by_from_delta;
        add_block(self.from_from, 0, 0, &turn_turn);
        add_block(self.from_from, 0, 3, &turn_delta);
        add_block(self.from_from, 3, 0, &turn_delta.transpose());
        add_block(self.from_from, 3, 3, &delta_delta);
        self.add_pair(0, 3, &-turn_delta);
        self.add_pair(3, 3, &-delta_delta);
        add_block(self.to_to, 3, 3, &delta_delta);
        let along = delta * residual;
        add_rows(self.from, 0, &(turn * residual));
        add_rows(self.from, 3, &along);
        add_rows(self.to, 3, &-along);
        if let Some(by_to_turn) = &by.by_to_turn {
            let to_turn = by_to_turn.transpose() * weight;
            let to_turn_delta = -(to_turn * by.by_from_delta);
            self.add_pair(0, 0, &(turn * by_to_turn));
            self.add_pair(3, 0, &(delta * by_to_turn));
            add_block(self.to_to, 0, 0, &(to_turn * by_to_turn));
            add_block(self.to_to, 0, 3, &to_turn_delta);
            add_block(self.to_to, 3, 0, &to_turn_delta.transpose());
            add_rows(self.to, 0, &(to_turn * residual));
        }
        weight * residual.norm_squared()
    }

    fn add_information(
        &mut self,
        information: &Matrix6<f64>,
        residual: &Vector6<f64>,
        by_from: &Matrix6<f64>,
        by_to: &Matrix6<f64>,
    ) {
        let from = by_from.transpose() * information;
        let to = by_to.transpose() * information;
        *self.from_from += from * by_from;
        *self.pair += if self.pair_is_to_from {
            to * by_from
        } else {
            from * by_to
        };
        *self.to_to += to * by_to;
        *self.from += from * residual;
        *self.to += to * residual;
    }
}

fn add_block(matrix: &mut Matrix6<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    let mut view = matrix.fixed_view_mut::<3, 3>(row, column);
    view += block;
}

/// Adds to the diagonal of the translation block.
fn add_diagonal(matrix: &mut Matrix6<f64>, value: f64) {
    for k in 3..6 {
        matrix[(k, k)] += value;
    }
}

/// `[a]x^T [a]x`.
fn gram_of_hat(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(a.norm_squared()) - a * a.transpose()
}

fn add_rows(vector: &mut Vector6<f64>, row: usize, part: &Vector3<f64>) {
    let mut view = vector.fixed_rows_mut::<3>(row);
    view += part;
}

#[cfg(test)]
mod tests;
