//! What is left of everything that has gone from the window: `1/2 e^T Lambda e + beta^T e`, linear in
//! `e = Log(T T*^-1)` with Jacobian one on purpose. Exact Jacobians would leak what is known of relative poses into the
//! common motion of the team, which nothing but absolute fixes observes.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix6, Vector3, Vector4};

use super::measured_edge::PoseId;
use super::stretch::{BIASES, adjoint_of_shift};
use crate::{Body, Transform, VehicleId, World, se3};

/// The least variance by which a bias wanders: it then stays what it is.
const VARIANCE_MIN: f64 = 1e-18;

/// An unknown of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Unknown {
    Pose(PoseId),
    Biases(VehicleId),
}

impl Unknown {
    pub(super) const fn dimension(self) -> usize {
        match self {
            Self::Pose(_) => 6,
            Self::Biases(_) => BIASES,
        }
    }
}

/// An unknown and the value about which the prior is quadratic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Anchor {
    Pose(PoseId, Transform<World, Body>),
    Biases(VehicleId, Vector4<f64>),
}

impl Anchor {
    pub(super) const fn unknown(&self) -> Unknown {
        match self {
            Self::Pose(id, _) => Unknown::Pose(*id),
            Self::Biases(id, _) => Unknown::Biases(*id),
        }
    }
}

/// The prior.
#[derive(Clone, Debug)]
pub(super) struct Prior {
    pub(super) anchors: Vec<Anchor>,
    pub(super) lambda: DMatrix<f64>,
    pub(super) beta: DVector<f64>,
}

impl Prior {
    pub(super) fn nothing() -> Self {
        Self {
            anchors: Vec::new(),
            lambda: DMatrix::zeros(0, 0),
            beta: DVector::zeros(0),
        }
    }

    pub(super) fn dimension(&self) -> usize {
        self.beta.len()
    }

    /// One more unknown that nothing else is known of.
    pub(super) fn add(&mut self, anchor: Anchor, information: &DMatrix<f64>) {
        let (old, new) = (self.dimension(), anchor.unknown().dimension());
        self.anchors.push(anchor);
        let lambda = std::mem::replace(&mut self.lambda, DMatrix::zeros(0, 0));
        self.lambda = lambda.resize(old + new, old + new, 0.0);
        self.lambda
            .view_mut((old, old), (new, new))
            .copy_from(information);
        let beta = std::mem::replace(&mut self.beta, DVector::zeros(0));
        self.beta = beta.resize_vertically(old + new, 0.0);
    }

    /// A pose known with these standard deviations (radians, metres), in its own axes.
    pub(super) fn add_pose(
        &mut self,
        id: PoseId,
        world_from_body: &Transform<World, Body>,
        rotation_rad: f64,
        translation_m: f64,
    ) {
        let information = information(world_from_body, (rotation_rad, translation_m));
        let information = DMatrix::from_column_slice(6, 6, information.as_slice());
        self.add(Anchor::Pose(id, *world_from_body), &information);
    }

    /// Biases of zero, give or take these standard deviations.
    pub(super) fn add_biases(&mut self, vehicle: VehicleId, gyro_rad_s: f64, scale: f64) {
        let (gyro, scale) = (gyro_rad_s.powi(-2), scale.powi(-2));
        let diagonal = DVector::from_column_slice(&[gyro, gyro, gyro, scale]);
        let information = DMatrix::from_diagonal(&diagonal);
        self.add(Anchor::Biases(vehicle, Vector4::zeros()), &information);
    }

    /// The world's origin moves by `shift`: `T' = C^-1 T`, `Lambda' = A^T Lambda A`, `beta' = A^T beta` with
    /// `A = blkdiag Ad(C)`. Exact; without it the information form loses its digits far from the origin.
    pub(super) fn recentre(&mut self, shift: &Vector3<f64>) {
        let adjoint = adjoint_of_shift(shift);
        let mut offset = 0;
        for anchor in &mut self.anchors {
            let size = anchor.unknown().dimension();
            if let Anchor::Pose(_, pose) = anchor {
                pose.translation -= shift;
                let columns = self.lambda.columns(offset, size) * adjoint;
                self.lambda.columns_mut(offset, size).copy_from(&columns);
                let rows = adjoint.transpose() * self.lambda.rows(offset, size);
                self.lambda.rows_mut(offset, size).copy_from(&rows);
                let beta = adjoint.transpose() * self.beta.rows(offset, size);
                self.beta.rows_mut(offset, size).copy_from(&beta);
            }
            offset += size;
        }
    }

    /// The biases wander: their old values, of which the prior speaks, are eliminated in favour of new ones that differ by
    /// noise of these variances (of the gyroscope per axis, of the scale).
    pub(super) fn wander(&mut self, gyro: f64, scale: f64, whose: impl Fn(VehicleId) -> bool) {
        let mut rows = Vec::new();
        let mut offset = 0;
        for anchor in &self.anchors {
            let size = anchor.unknown().dimension();
            if let Anchor::Biases(vehicle, _) = anchor
                && whose(*vehicle)
            {
                rows.extend(offset..offset + size);
            }
            offset += size;
        }
        if rows.is_empty() {
            return;
        }
        let mut information = DMatrix::zeros(rows.len(), rows.len());
        for at in 0..rows.len() {
            let variance = if at % BIASES == BIASES - 1 {
                scale
            } else {
                gyro
            };
            information[(at, at)] = 1.0 / variance.max(VARIANCE_MIN);
        }
        self.loosen(&rows, information);
    }

    /// Some poses may be elsewhere, each by so much in its own axes (standard deviations in radians and metres).
    pub(super) fn displace(&mut self, sigmas: (f64, f64), is_displaced: impl Fn(PoseId) -> bool) {
        let mut offset = 0;
        for at in 0..self.anchors.len() {
            let anchor = self.anchors[at];
            if let Anchor::Pose(id, pose) = anchor
                && is_displaced(id)
            {
                let information = information(&pose, sigmas);
                let rows: Vec<usize> = (offset..offset + 6).collect();
                self.loosen(
                    &rows,
                    DMatrix::from_column_slice(6, 6, information.as_slice()),
                );
            }
            offset += anchor.unknown().dimension();
        }
    }

    /// Noise of this information is added to some unknowns:
    /// `Lambda' = Lambda - Lambda B (B^T Lambda B + Q^-1)^-1 B^T Lambda`, and `beta'` alike.
    fn loosen(&mut self, rows: &[usize], information: DMatrix<f64>) {
        let picked = self.lambda.select_columns(rows);
        let inner = picked.select_rows(rows) + information;
        let Some(inner) = inner.cholesky() else {
            return;
        };
        let beta = DVector::from_iterator(rows.len(), rows.iter().map(|row| self.beta[*row]));
        self.beta -= &picked * inner.solve(&beta);
        subtract_marginal(&mut self.lambda, &inner, &picked);
        self.symmetrise();
    }

    /// Some of a vehicle's biases are none, give or take `sigma`.
    pub(super) fn hold_biases(
        &mut self,
        vehicle: VehicleId,
        rows: std::ops::Range<usize>,
        sigma: f64,
    ) {
        let mut offset = 0;
        for anchor in &self.anchors {
            if let Anchor::Biases(whose, about) = anchor
                && *whose == vehicle
            {
                let information = sigma.powi(-2);
                for row in rows {
                    self.lambda[(offset + row, offset + row)] += information;
                    self.beta[offset + row] += information * about[row];
                }
                return;
            }
            offset += anchor.unknown().dimension();
        }
    }

    pub(super) fn symmetrise(&mut self) {
        for row in 0..self.lambda.nrows() {
            for column in 0..row {
                let mean = 0.5 * (self.lambda[(row, column)] + self.lambda[(column, row)]);
                self.lambda[(row, column)] = mean;
                self.lambda[(column, row)] = mean;
            }
        }
    }
}

/// `Lambda - A H^-1 A^T`, by half of the solve: `A L^-T L^-1 A^T`.
pub(super) fn subtract_marginal(
    lambda: &mut DMatrix<f64>,
    inner: &Cholesky<f64, Dyn>,
    across: &DMatrix<f64>,
) {
    let mut half = across.transpose();
    inner.l_dirty().solve_lower_triangular_mut(&mut half);
    lambda.gemm_tr(-1.0, &half, &half, 1.0);
}

/// That of a world twist of a pose which is known so well in its own axes: `Ad(T)^-T diag Ad(T)^-1`.
fn information(
    world_from_body: &Transform<World, Body>,
    (rotation_rad, translation_m): (f64, f64),
) -> Matrix6<f64> {
    let back = se3::adjoint(&world_from_body.inverse());
    let (rotation, translation) = (rotation_rad.powi(-2), translation_m.powi(-2));
    let diagonal = nalgebra::Vector6::new(
        rotation,
        rotation,
        rotation,
        translation,
        translation,
        translation,
    );
    back.transpose() * Matrix6::from_diagonal(&diagonal) * back
}
