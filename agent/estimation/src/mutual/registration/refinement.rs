//! Refinement: all stances of a formation at once by Gauss-Newton on the sightings that are assigned, each with the
//! residual in the tangent plane of its ray, so that the vertical is like every other direction.

use super::formation::{Formation, Stance};
use super::scene::{Scene, angle2};
use crate::mutual::direction::{difference, wrapped};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix4, SMatrix, UnitVector3, Vector3};

/// Numbers of a stance: position and yaw.
const DOF: usize = 4;
/// A step is halved at most so often until it does not make things worse.
const HALVINGS_MAX: usize = 4;
/// The distance of a vehicle that nothing tells is known to a factor e: information along all axes (1/distance^2), so
/// weak that sightings outweigh it.
const DAMPING: f64 = 1e-1;

/// The normal equations of a formation.
struct Normal {
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Half the sum of squares of the residuals over their variances.
    cost: f64,
}

/// What is estimated: who, in what order. The first of them is held where it is.
pub(super) struct Refined {
    /// Row of each vehicle's position, by vehicle.
    pub(super) rows: Vec<Option<usize>>,
    cholesky: Cholesky<f64, Dyn>,
}

impl Refined {
    /// Covariance of position and yaw of a vehicle, in the formation's frame, with its scale held.
    pub(super) fn covariance(&self, vehicle: usize) -> Option<Matrix4<f64>> {
        let row = self.rows.get(vehicle).copied().flatten()?;
        let mut columns = DMatrix::zeros(self.cholesky.l_dirty().nrows(), DOF);
        for axis in 0..DOF {
            columns[(row + axis, axis)] = 1.0;
        }
        self.cholesky.solve_mut(&mut columns);
        Some(columns.fixed_view::<DOF, DOF>(row, 0).into_owned())
    }
}

/// Improves the stances in at most `steps_max` steps. None when nothing can be solved for.
pub(super) fn refine(
    formation: &mut Formation,
    scene: &Scene,
    steps_max: usize,
) -> Option<Refined> {
    let mut rows = vec![None; scene.vehicles()];
    let others: Vec<usize> = formation
        .placed()
        .map(|(vehicle, _)| vehicle)
        .skip(1)
        .collect();
    for (order, vehicle) in others.iter().enumerate() {
        rows[*vehicle] = Some(order * DOF);
    }
    if others.is_empty() {
        return None;
    }
    let mut normal = normal(formation, scene, &rows, others.len());
    let mut refined = None;
    for step in 0..=steps_max {
        let cholesky =
            std::mem::replace(&mut normal.information, DMatrix::zeros(0, 0)).cholesky()?;
        let change = -cholesky.solve(&normal.gradient);
        refined = Some(Refined {
            rows: rows.clone(),
            cholesky,
        });
        if step == steps_max || !change.iter().all(|one| one.is_finite()) {
            break;
        }
        let Some(better) = accepted(formation, scene, &rows, &change, normal.cost) else {
            break;
        };
        let settled = normal.cost - better < 1e-3;
        if settled {
            break;
        }
        normal = self::normal(formation, scene, &rows, others.len());
    }
    refined
}

/// Takes the longest of the step, its half, its quarter and so on that does not make the cost worse; the cost after it.
fn accepted(
    formation: &mut Formation,
    scene: &Scene,
    rows: &[Option<usize>],
    change: &DVector<f64>,
    cost: f64,
) -> Option<f64> {
    let before = formation.stances.clone();
    let mut share = 1.0;
    for _ in 0..=HALVINGS_MAX {
        for (vehicle, row) in rows.iter().enumerate() {
            if let (Some(row), Some(from), Some(to)) =
                (row, &before[vehicle], &mut formation.stances[vehicle])
            {
                let step = change.fixed_rows::<3>(*row) * share;
                to.position = from.position + step;
                to.yaw_rad = wrapped(from.yaw_rad + change[row + 3] * share);
            }
        }
        let after = self::cost(formation, scene);
        if after <= cost {
            return Some(after);
        }
        share *= 0.5;
    }
    formation.stances = before;
    None
}

/// Half the sum of squares of all assigned sightings' angles over their variances.
pub(super) fn cost(formation: &Formation, scene: &Scene) -> f64 {
    let mut total = 0.0;
    for (viewer, stance) in formation.placed() {
        let level_from_frame = stance.frame_from_level().inverse();
        for (index, ray) in scene.rays[viewer].iter().enumerate() {
            let target = formation.seen[viewer][index] as usize;
            if let Some(Some(other)) = formation.stances.get(target) {
                let offset = level_from_frame * (other.position - stance.position);
                let cosine = ray.unit.dot(&offset) / offset.norm().max(1e-12);
                total += 0.5 * angle2(cosine) / ray.variance;
            }
        }
    }
    total
}

fn normal(formation: &Formation, scene: &Scene, rows: &[Option<usize>], others: usize) -> Normal {
    let size = others * DOF;
    let mut information = DMatrix::zeros(size, size);
    let mut gradient = DVector::zeros(size);
    let mut cost = 0.0;
    for (viewer, stance) in formation.placed() {
        for (index, ray) in scene.rays[viewer].iter().enumerate() {
            let target = formation.seen[viewer][index] as usize;
            let Some(Some(other)) = formation.stances.get(target) else {
                continue;
            };
            let Some((residual, by_viewer, by_target)) = linear(stance, other, ray) else {
                continue;
            };
            let weight = 1.0 / ray.variance;
            cost += 0.5 * weight * residual.norm_squared();
            let ends = [(rows[viewer], &by_viewer), (rows[target], &by_target)];
            for (row, jacobian) in ends {
                let Some(row) = row else { continue };
                let mut part = gradient.fixed_rows_mut::<DOF>(row);
                part += jacobian.transpose() * residual * weight;
                for (column, second) in ends {
                    let Some(column) = column else { continue };
                    let mut part = information.fixed_view_mut::<DOF, DOF>(row, column);
                    part += jacobian.transpose() * second * weight;
                }
            }
        }
    }
    hold_scale(formation, rows, &mut information);
    Normal {
        information,
        gradient,
        cost,
    }
}

/// Sightings do not tell the scale: it is held, and what else they may not tell is damped.
fn hold_scale(formation: &Formation, rows: &[Option<usize>], information: &mut DMatrix<f64>) {
    let origin = formation
        .placed()
        .next()
        .map_or(Vector3::zeros(), |(_, first)| first.position);
    let mut along = DVector::<f64>::zeros(information.nrows());
    for (vehicle, stance) in formation.placed() {
        let Some(row) = rows[vehicle] else { continue };
        let offset = stance.position - origin;
        along.fixed_rows_mut::<3>(row).copy_from(&offset);
        let damping = DAMPING / offset.norm_squared().max(1e-12);
        for axis in 0..3 {
            information[(row + axis, row + axis)] += damping;
        }
        information[(row + 3, row + 3)] += DAMPING;
    }
    let squared = along.norm_squared().max(1e-24);
    // As certain as one part in a hundred.
    information.ger(1e4 / (squared * squared), &along, &along, 1.0);
}

/// The residual of a sighting (rad, along the ray's tangents) and its derivatives by the stances of viewer and target.
fn linear(
    viewer: &Stance,
    target: &Stance,
    ray: &super::scene::Ray,
) -> Option<(
    nalgebra::Vector2<f64>,
    SMatrix<f64, 2, 4>,
    SMatrix<f64, 2, 4>,
)> {
    let level_from_frame = viewer.frame_from_level().inverse();
    let offset = level_from_frame * (target.position - viewer.position);
    let distance = offset.norm();
    if !(distance > 1e-9 && distance.is_finite()) {
        return None;
    }
    let unit = offset / distance;
    let seen = UnitVector3::new_unchecked(ray.unit);
    let residual = difference(&seen, &UnitVector3::new_unchecked(unit));
    let mut by_viewer = SMatrix::<f64, 2, 4>::zeros();
    let mut by_target = SMatrix::<f64, 2, 4>::zeros();
    for (axis, tangent) in ray.tangents.iter().enumerate() {
        let across = (tangent - unit * unit.dot(tangent)) / distance;
        let in_frame = level_from_frame.inverse() * across;
        by_target
            .fixed_view_mut::<1, 3>(axis, 0)
            .copy_from(&in_frame.transpose());
        by_viewer
            .fixed_view_mut::<1, 3>(axis, 0)
            .copy_from(&-in_frame.transpose());
        // Turning the viewer turns what it sees the other way: -e3 x offset.
        by_viewer[(axis, 3)] = -across.dot(&Vector3::new(-offset.y, offset.x, 0.0));
    }
    Some((residual, by_viewer, by_target))
}
