//! The rigid motion that brings one set of points nearest to another: Umeyama (1991) without scale, in space by a
//! singular value decomposition, in the plane in closed form.

use crate::truth::{Pose, pose_from_euler};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// What may move in an alignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// Any rotation and translation.
    Spatial,
    /// Rotation about the vertical, and any translation.
    Planar,
}

/// `to_from`: the rigid motion with the least sum of squares `|to_from * from_k - to_k|^2`, metres. The identity for
/// no points. Both slices must be of one length.
#[must_use]
pub fn align(from: &[Vector3<f64>], to: &[Vector3<f64>], space: Space) -> Pose {
    assert_eq!(from.len(), to.len(), "points are aligned in pairs");
    if from.is_empty() {
        return Pose::identity();
    }
    let n = from.len() as f64;
    let from_mean = from.iter().sum::<Vector3<f64>>() / n;
    let to_mean = to.iter().sum::<Vector3<f64>>() / n;
    let pairs = from
        .iter()
        .zip(to)
        .map(|(from, to)| (from - from_mean, to - to_mean));
    let rotation = match space {
        Space::Spatial => spatial_rotation(pairs.map(|(from, to)| to * from.transpose()).sum()),
        Space::Planar => {
            let (cosine, sine) = pairs.fold((0.0, 0.0), |(cosine, sine), (from, to)| {
                (
                    cosine + from.x * to.x + from.y * to.y,
                    sine + from.x * to.y - from.y * to.x,
                )
            });
            pose_from_euler(Vector3::zeros(), f64::atan2(sine, cosine), 0.0, 0.0).rotation
        }
    };
    Pose::from_parts(Translation3::from(to_mean - rotation * from_mean), rotation)
}

/// The rotation R with the largest `tr(R^T C)` of `C = sum to from^T`.
fn spatial_rotation(covariance: Matrix3<f64>) -> UnitQuaternion<f64> {
    let svd = covariance.svd(true, true);
    let u = svd.u.expect("U was asked for");
    let v_t = svd.v_t.expect("V^T was asked for");
    // A mirror image fits best when the product's determinant is -1: turn the weakest direction round.
    let mut signs = Vector3::repeat(1.0);
    signs[svd.singular_values.imin()] = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::{Purpose, Streams};
    use rand_distr::{Distribution, UnitBall};

    fn points(n: usize) -> Vec<Vector3<f64>> {
        let mut rng = Streams::new(31, 0).vehicle(0, Purpose::Trajectory);
        (0..n)
            .map(|_| Vector3::from(UnitBall.sample(&mut rng)) * 5.0)
            .collect()
    }

    fn moved(pose: &Pose, points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        points
            .iter()
            .map(|point| pose.rotation * point + pose.translation.vector)
            .collect()
    }

    #[test]
    fn a_rigid_motion_is_found_again() {
        let motion = pose_from_euler(Vector3::new(3.0, -20.0, 7.0), 2.5, -1.1, 0.4);
        for n in [3, 4, 30] {
            let from = points(n);
            let found = align(&from, &moved(&motion, &from), Space::Spatial);
            let error = found.inv_mul(&motion);
            assert!(
                error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9,
                "{n}: {error}"
            );
        }
    }

    #[test]
    fn a_planar_motion_is_found_again_and_stays_planar() {
        let motion = pose_from_euler(Vector3::new(3.0, -20.0, 7.0), 2.5, 0.0, 0.0);
        let from = points(5);
        let error = align(&from, &moved(&motion, &from), Space::Planar).inv_mul(&motion);
        assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9);
        let tilted = pose_from_euler(Vector3::zeros(), 0.2, 0.3, 0.1);
        let (roll, pitch, _) = align(&from, &moved(&tilted, &from), Space::Planar)
            .rotation
            .euler_angles();
        assert!(roll.abs() < 1e-12 && pitch.abs() < 1e-12);
    }

    #[test]
    fn a_mirror_image_is_met_by_a_rotation() {
        let from = points(10);
        let mirrored: Vec<_> = from
            .iter()
            .map(|point| Vector3::new(point.x, point.y, -point.z))
            .collect();
        let found = align(&from, &mirrored, Space::Spatial);
        assert!((found.rotation.to_rotation_matrix().matrix().determinant() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn points_in_a_plane_on_a_line_and_in_one_place_are_aligned_too() {
        let motion = pose_from_euler(Vector3::new(1.0, 2.0, 3.0), 0.3, 0.2, 0.1);
        let flat: Vec<_> = points(6)
            .into_iter()
            .map(|point| Vector3::new(point.x, point.y, 0.0))
            .collect();
        let line: Vec<_> = (0..2)
            .map(|k| Vector3::new(f64::from(k), 0.0, 0.0))
            .collect();
        let place = vec![Vector3::new(1.0, 1.0, 1.0); 3];
        for from in [flat, line, place] {
            let to = moved(&motion, &from);
            let found = align(&from, &to, Space::Spatial);
            for (found, to) in moved(&found, &from).iter().zip(&to) {
                assert!((found - to).norm() < 1e-9);
            }
        }
    }
}
