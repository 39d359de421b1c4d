//! Symmetric positive definite systems whose rows begin where they first have something: ordered by time, the normal
//! equations of a window are narrow, and a Cholesky factor stays within the same outline.

/// A symmetric matrix by its lower rows, each from its first entry to the diagonal.
#[derive(Clone, Debug, Default)]
pub(super) struct Skyline {
    /// The first column of each row.
    first: Vec<usize>,
    /// Where each row's entries begin; one more than there are rows.
    begin: Vec<usize>,
    entries: Vec<f64>,
}

/// The matrix has a direction that nothing determines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NotPositive;

/// A lower factor: `L L^T` is the matrix.
#[derive(Clone, Debug, Default)]
pub(super) struct Factor {
    lower: Skyline,
}

impl Skyline {
    /// All zero, with this first column in each row.
    pub(super) fn reset(&mut self, first: &[usize]) {
        self.first.clear();
        self.first.extend_from_slice(first);
        self.begin.clear();
        self.begin.push(0);
        let mut end = 0;
        for (row, first) in first.iter().enumerate() {
            end += row + 1 - first;
            self.begin.push(end);
        }
        self.entries.clear();
        self.entries.resize(end, 0.0);
    }

    pub(super) fn len(&self) -> usize {
        self.first.len()
    }

    /// Adds to an entry of the lower half.
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        debug_assert!(
            column <= row && column >= self.first[row],
            "outside the outline"
        );
        self.entries[self.begin[row] + column - self.first[row]] += value;
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.entries[self.begin[row]..self.begin[row + 1]]
    }
}

/// The sum of products in four lanes, always in the same order.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (mut a, mut b) = (a.chunks_exact(4), b.chunks_exact(4));
    for (a, b) in a.by_ref().zip(b.by_ref()) {
        for lane in 0..4 {
            lanes[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a
        .remainder()
        .iter()
        .zip(b.remainder())
        .map(|(a, b)| a * b)
        .sum();
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
}

impl Factor {
    /// Factors a matrix.
    pub(super) fn of(&mut self, matrix: &Skyline) -> Result<(), NotPositive> {
        self.lower.clone_from(matrix);
        let Skyline {
            first,
            begin,
            entries,
        } = &mut self.lower;
        for row in 0..first.len() {
            let row_first = first[row];
            let (above, own) = entries.split_at_mut(begin[row]);
            let own = &mut own[..row + 1 - row_first];
            for column in row_first..row {
                let from = row_first.max(first[column]);
                let other = &above[begin[column]..begin[column + 1]];
                let sum = dot(
                    &own[from - row_first..column - row_first],
                    &other[from - first[column]..column - first[column]],
                );
                own[column - row_first] =
                    (own[column - row_first] - sum) / other[column - first[column]];
            }
            let (left, diagonal) = own.split_at_mut(row - row_first);
            let square = diagonal[0] - dot(left, left);
            // Not `square <= 0`: not a number must end here too.
            if !(square > f64::MIN_POSITIVE && square.is_finite()) {
                return Err(NotPositive);
            }
            diagonal[0] = square.sqrt();
        }
        Ok(())
    }

    /// `L^-1 b` in place, for a right side that is zero before `from`.
    pub(super) fn forward(&self, right: &mut [f64], from: usize) {
        for row in from..self.lower.len() {
            let first = self.lower.first[row];
            let begin = first.max(from);
            let own = self.lower.row(row);
            let sum = dot(&own[begin - first..row - first], &right[begin..row]);
            right[row] = (right[row] - sum) / own[row - first];
        }
    }

    /// `L^-T b` in place.
    pub(super) fn backward(&self, right: &mut [f64]) {
        for row in (0..self.lower.len()).rev() {
            let first = self.lower.first[row];
            let own = self.lower.row(row);
            right[row] /= own[row - first];
            let value = right[row];
            for (right, own) in right[first..row].iter_mut().zip(own) {
                *right -= own * value;
            }
        }
    }

    /// Solves the system in place.
    pub(super) fn solve(&self, right: &mut [f64]) {
        self.forward(right, 0);
        self.backward(right);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// A positive definite matrix with an outline, and the same one dense.
    fn pair() -> (Skyline, DMatrix<f64>) {
        let first = [0, 0, 1, 0, 3, 3, 1, 0, 4];
        let mut skyline = Skyline::default();
        skyline.reset(&first);
        let mut dense = DMatrix::zeros(first.len(), first.len());
        for (row, first) in first.iter().enumerate() {
            for column in *first..=row {
                let value = if row == column {
                    9.0
                } else {
                    ((row * 7 + column * 3) % 5) as f64 - 2.0
                };
                skyline.add(row, column, value);
                dense[(row, column)] = value;
                dense[(column, row)] = value;
            }
        }
        (skyline, dense)
    }

    #[test]
    fn it_solves_what_a_dense_factor_solves() {
        let (skyline, dense) = pair();
        let mut factor = Factor::default();
        factor.of(&skyline).unwrap();
        let right = DVector::from_fn(skyline.len(), |row, _| row as f64 - 3.0);
        let expected = dense.clone().cholesky().unwrap().solve(&right);
        let mut solved = right.as_slice().to_vec();
        factor.solve(&mut solved);
        assert!((DVector::from_vec(solved) - expected).norm() < 1e-12);
    }

    #[test]
    fn a_right_side_that_begins_late_costs_only_what_comes_after() {
        let (skyline, dense) = pair();
        let mut factor = Factor::default();
        factor.of(&skyline).unwrap();
        let mut unit = vec![0.0; skyline.len()];
        unit[5] = 1.0;
        factor.forward(&mut unit, 5);
        let variance: f64 = unit.iter().map(|y| y * y).sum();
        assert!((variance - dense.try_inverse().unwrap()[(5, 5)]).abs() < 1e-12);
    }

    #[test]
    fn a_direction_that_nothing_determines_is_told() {
        let mut skyline = Skyline::default();
        skyline.reset(&[0, 0]);
        for (row, column) in [(0, 0), (1, 0), (1, 1)] {
            skyline.add(row, column, 1.0);
        }
        assert_eq!(Factor::default().of(&skyline), Err(NotPositive));
        skyline.add(0, 0, f64::NAN);
        assert_eq!(Factor::default().of(&skyline), Err(NotPositive));
    }
}
