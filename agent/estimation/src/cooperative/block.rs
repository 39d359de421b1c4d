//! Dense 6x6 blocks of the normal equations: a Cholesky factor that refuses to divide by a pivot that is only rounding,
//! and the pseudo-inverse for when it does.

use nalgebra::{Matrix6, SMatrix, Vector6};

/// A pivot smaller than this part of its own diagonal entry is rounding, not information.
const PIVOT_PART_MIN: f64 = 1e-12;

/// Eigenvalues below this, after scaling to unit diagonal, count as unobservable directions.
const EIGENVALUE_MIN: f64 = 1e-11;

/// More sweeps than the eigenvalues of a 6x6 matrix ever need; only what is not a number gets there.
const EIGEN_SWEEPS_MAX: usize = 200;

/// The lower factor `L` of `L L^T = matrix` with the inverse of its diagonal, or nothing when the matrix is not
/// positive definite.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Factor {
    /// By column.
    lower: [[f64; 6]; 6],
    inverse_diagonal: [f64; 6],
}

impl Factor {
    /// Factors `matrix`, of which only the lower triangle is read. Pivots are judged against `diagonal`: the diagonal
    /// of the matrix before anything was eliminated from it.
    #[expect(
        clippy::needless_range_loop,
        reason = "rows and columns, as in the equations"
    )]
    pub(crate) fn new(matrix: &Matrix6<f64>, diagonal: &Vector6<f64>) -> Option<Self> {
        // Columns as plain arrays: the compiler then sees that no index is out of range.
        let mut lower = matrix.data.0;
        let mut inverse_diagonal = [0.0; 6];
        for j in 0..6 {
            for k in 0..j {
                let factor = lower[k][j];
                for i in j..6 {
                    lower[j][i] -= lower[k][i] * factor;
                }
            }
            let pivot = lower[j][j];
            // Written so that what is not a number is refused too.
            if !(pivot > PIVOT_PART_MIN * diagonal[j] && pivot.is_finite()) {
                return None;
            }
            let inverse = 1.0 / pivot.sqrt();
            inverse_diagonal[j] = inverse;
            for i in j..6 {
                lower[j][i] *= inverse;
            }
        }
        Some(Self {
            lower,
            inverse_diagonal,
        })
    }

    /// Replaces each column `b` of `right` by `L^-1 b`.
    #[expect(
        clippy::needless_range_loop,
        reason = "rows and columns, as in the equations"
    )]
    pub(crate) fn solve_lower<const C: usize>(&self, right: &mut SMatrix<f64, 6, C>) {
        for column in &mut right.data.0 {
            for k in 0..6 {
                let x = column[k] * self.inverse_diagonal[k];
                column[k] = x;
                for i in k + 1..6 {
                    column[i] -= self.lower[k][i] * x;
                }
            }
        }
    }

    /// Replaces each column `b` of `right` by `L^-T b`.
    #[expect(
        clippy::needless_range_loop,
        reason = "rows and columns, as in the equations"
    )]
    pub(crate) fn solve_upper<const C: usize>(&self, right: &mut SMatrix<f64, 6, C>) {
        for column in &mut right.data.0 {
            for k in (0..6).rev() {
                let mut sum = column[k];
                for i in k + 1..6 {
                    sum -= self.lower[k][i] * column[i];
                }
                column[k] = sum * self.inverse_diagonal[k];
            }
        }
    }
}

/// The solution of smallest length of `matrix x = right`, and in how many directions `matrix` says nothing. For
/// symmetric positive semidefinite matrices that [`Factor`] refused; finite whatever they hold. As there, `diagonal`
/// is that of the matrix before anything was eliminated: what elimination left of it may be rounding only.
pub(crate) fn solve_semidefinite<const C: usize>(
    matrix: &Matrix6<f64>,
    diagonal: &Vector6<f64>,
    right: &SMatrix<f64, 6, C>,
) -> (SMatrix<f64, 6, C>, u8) {
    let symmetric = 0.5 * (matrix + matrix.transpose());
    // Radians and metres, and their weights, are not comparable: judge each direction at unit diagonal.
    let scale = diagonal.map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scaled = Matrix6::from_fn(|i, j| scale[i] * symmetric[(i, j)] * scale[j]);
    let everything_unknown = (SMatrix::zeros(), 6);
    if !scaled.iter().all(|number| number.is_finite()) {
        return everything_unknown;
    }
    let Some(eigen) = scaled.try_symmetric_eigen(f64::EPSILON, EIGEN_SWEEPS_MAX) else {
        return everything_unknown;
    };
    let mut solution = SMatrix::<f64, 6, C>::zeros();
    let mut unknown = 0;
    for k in 0..6 {
        if eigen.eigenvalues[k] > EIGENVALUE_MIN {
            let direction = eigen.eigenvectors.column(k).component_mul(&scale);
            let along = direction.transpose() * right / eigen.eigenvalues[k];
            solution += direction * along;
        } else {
            unknown += 1;
        }
    }
    (solution, unknown)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn definite() -> Matrix6<f64> {
        let a = Matrix6::from_fn(|i, j| ((i * 7 + j * 3) as f64).sin());
        a * a.transpose() + Matrix6::identity()
    }

    #[test]
    fn both_ways_solve_a_definite_system() {
        let (matrix, right) = (definite(), Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0));
        let factor = Factor::new(&matrix, &matrix.diagonal()).unwrap();
        let mut x = right;
        factor.solve_lower(&mut x);
        factor.solve_upper(&mut x);
        assert!((matrix * x - right).norm() < 1e-12);
        let (y, unknown) = solve_semidefinite(&matrix, &matrix.diagonal(), &right);
        assert_eq!(unknown, 0);
        assert!((x - y).norm() < 1e-11);
    }

    #[test]
    fn directions_without_information_stay_at_zero_and_are_counted() {
        let mut matrix = Matrix6::zeros();
        matrix[(0, 0)] = 4.0;
        matrix[(4, 4)] = 1e-6;
        assert!(Factor::new(&matrix, &matrix.diagonal()).is_none());
        let (x, unknown) = solve_semidefinite(
            &matrix,
            &matrix.diagonal(),
            &Vector6::new(8.0, 0.0, 0.0, 0.0, 2e-6, 0.0),
        );
        assert_eq!(unknown, 4);
        assert!((x - Vector6::new(2.0, 0.0, 0.0, 0.0, 2.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_pivot_that_is_only_rounding_is_refused() {
        let mut matrix = Matrix6::identity();
        matrix[(5, 5)] = 1e-14;
        assert!(Factor::new(&matrix, &matrix.diagonal()).is_some());
        assert!(Factor::new(&matrix, &Vector6::repeat(1.0)).is_none());
        matrix[(5, 5)] = -1e-14;
        assert!(Factor::new(&matrix, &Vector6::repeat(1.0)).is_none());
    }

    #[test]
    fn what_is_not_a_number_is_all_unknown_and_stays_finite() {
        let matrix = Matrix6::from_element(f64::NAN);
        assert!(Factor::new(&matrix, &matrix.diagonal()).is_none());
        assert_eq!(
            solve_semidefinite(&matrix, &matrix.diagonal(), &Vector6::zeros()),
            (Vector6::zeros(), 6)
        );
    }
}
