//! Symmetric positive definite systems whose rows begin where they first have something: ordered by time, the normal
//! equations of a window are narrow, and a Cholesky factor stays within the same outline.
//!
//! Rows go in pairs with one outline, so that four sums of products run side by side: one alone waits for its own
//! additions, and took twice as long.

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
    /// One over each diagonal entry.
    inverse: Vec<f64>,
}

impl Skyline {
    /// All zero, with this first column in each row or one before it.
    pub(super) fn reset(&mut self, first: &[usize]) {
        self.first.clear();
        for pair in first.chunks(2) {
            let least = pair.iter().fold(usize::MAX, |least, row| least.min(*row));
            // Even: columns go in pairs, too.
            self.first.extend(pair.iter().map(|_| least - least % 2));
        }
        self.begin.clear();
        self.begin.push(0);
        let mut end = 0;
        for (row, first) in self.first.iter().enumerate() {
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

    /// Adds to entries of one row that follow each other.
    pub(super) fn add_row(&mut self, row: usize, column: usize, values: &[f64]) {
        debug_assert!(
            column + values.len() <= row + 1 && column >= self.first[row],
            "outside the outline"
        );
        let begin = self.begin[row] + column - self.first[row];
        let entries = &mut self.entries[begin..begin + values.len()];
        for (entry, value) in entries.iter_mut().zip(values) {
            *entry += value;
        }
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.entries[self.begin[row]..self.begin[row + 1]]
    }
}

/// The root of a diagonal entry, unless nothing determines it.
fn positive_root(square: f64) -> Result<f64, NotPositive> {
    // Not `square <= 0`: not a number must end here too.
    if square > f64::MIN_POSITIVE && square.is_finite() {
        Ok(square.sqrt())
    } else {
        Err(NotPositive)
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

/// The sums of products of two rows with two others: `a0 b0, a0 b1, a1 b0, a1 b1`.
fn four_dots(a: [&[f64]; 2], b: [&[f64]; 2]) -> [f64; 4] {
    let pairs = |row| <[f64]>::as_chunks::<2>(row).0.iter();
    let rows = pairs(a[0]).zip(pairs(a[1]));
    let others = pairs(b[0]).zip(pairs(b[1]));
    let mut sums = [[0.0; 2]; 4];
    for ((a0, a1), (b0, b1)) in rows.zip(others) {
        for lane in 0..2 {
            sums[0][lane] += a0[lane] * b0[lane];
            sums[1][lane] += a0[lane] * b1[lane];
            sums[2][lane] += a1[lane] * b0[lane];
            sums[3][lane] += a1[lane] * b1[lane];
        }
    }
    sums.map(|lanes| lanes[0] + lanes[1])
}

impl Factor {
    /// Factors a matrix, of which nothing is left.
    pub(super) fn of(&mut self, matrix: &mut Skyline) -> Result<(), NotPositive> {
        std::mem::swap(&mut self.lower, matrix);
        self.inverse.clear();
        let size = self.lower.first.len();
        for row in (0..size).step_by(2) {
            if row + 1 < size {
                self.pair_of_rows(row)?;
            } else {
                self.lone_row(row)?;
            }
        }
        Ok(())
    }

    fn pair_of_rows(&mut self, row: usize) -> Result<(), NotPositive> {
        let Skyline {
            first,
            begin,
            entries,
        } = &mut self.lower;
        let own_first = first[row];
        let (above, own) = entries.split_at_mut(begin[row]);
        let length = row - own_first;
        let (upper, lower) = own.split_at_mut(length + 1);
        let lower = &mut lower[..length + 2];
        for column in (own_first..row).step_by(2) {
            let other_first = first[column];
            let from = own_first.max(other_first);
            let others = [
                &above[begin[column]..begin[column + 1]],
                &above[begin[column + 1]..begin[column + 2]],
            ];
            let at = column - own_first;
            let met = from - own_first..at;
            let with = from - other_first..column - other_first;
            let sums = four_dots(
                [&upper[met.clone()], &lower[met]],
                [&others[0][with.clone()], &others[1][with]],
            );
            let below = others[1][column - other_first];
            let (here, next) = (self.inverse[column], self.inverse[column + 1]);
            upper[at] = (upper[at] - sums[0]) * here;
            upper[at + 1] = (upper[at + 1] - sums[1] - upper[at] * below) * next;
            lower[at] = (lower[at] - sums[2]) * here;
            lower[at + 1] = (lower[at + 1] - sums[3] - lower[at] * below) * next;
        }
        let root = positive_root(upper[length] - dot(&upper[..length], &upper[..length]))?;
        upper[length] = root;
        self.inverse.push(1.0 / root);
        let across = lower[length] - dot(&lower[..length], &upper[..length]);
        lower[length] = across / root;
        let root = positive_root(lower[length + 1] - dot(&lower[..=length], &lower[..=length]))?;
        lower[length + 1] = root;
        self.inverse.push(1.0 / root);
        Ok(())
    }

    fn lone_row(&mut self, row: usize) -> Result<(), NotPositive> {
        let Skyline {
            first,
            begin,
            entries,
        } = &mut self.lower;
        let own_first = first[row];
        let (above, own) = entries.split_at_mut(begin[row]);
        let length = row - own_first;
        for column in own_first..row {
            let other_first = first[column];
            let from = own_first.max(other_first);
            let other = &above[begin[column]..begin[column + 1]];
            let sum = dot(
                &own[from - own_first..column - own_first],
                &other[from - other_first..column - other_first],
            );
            own[column - own_first] = (own[column - own_first] - sum) * self.inverse[column];
        }
        let root = positive_root(own[length] - dot(&own[..length], &own[..length]))?;
        own[length] = root;
        self.inverse.push(1.0 / root);
        Ok(())
    }

    /// `L^-1 b` in place, for a right side that is zero before `from`.
    pub(super) fn forward(&self, right: &mut [f64], from: usize) {
        for row in from..self.lower.len() {
            let first = self.lower.first[row];
            let begin = first.max(from);
            let own = self.lower.row(row);
            let sum = dot(&own[begin - first..row - first], &right[begin..row]);
            right[row] = (right[row] - sum) * self.inverse[row];
        }
    }

    /// The same for several right sides, of which each row holds one number each.
    pub(super) fn forward_all<const N: usize>(&self, right: &mut [[f64; N]], from: usize) {
        for row in from..self.lower.len() {
            let first = self.lower.first[row];
            let begin = first.max(from);
            let own = &self.lower.row(row)[begin - first..row - first];
            let mut sums = [0.0; N];
            for (entry, solved) in own.iter().zip(&right[begin..row]) {
                for column in 0..N {
                    sums[column] += entry * solved[column];
                }
            }
            for column in 0..N {
                right[row][column] = (right[row][column] - sums[column]) * self.inverse[row];
            }
        }
    }

    /// `L^-T b` in place.
    pub(super) fn backward(&self, right: &mut [f64]) {
        for row in (0..self.lower.len()).rev() {
            let first = self.lower.first[row];
            let own = self.lower.row(row);
            right[row] *= self.inverse[row];
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
        let (mut skyline, dense) = pair();
        let size = skyline.len();
        let mut factor = Factor::default();
        factor.of(&mut skyline).unwrap();
        let right = DVector::from_fn(size, |row, _| row as f64 - 3.0);
        let expected = dense.clone().cholesky().unwrap().solve(&right);
        let mut solved = right.as_slice().to_vec();
        factor.solve(&mut solved);
        assert!((DVector::from_vec(solved) - expected).norm() < 1e-12);
    }

    #[test]
    fn a_right_side_that_begins_late_costs_only_what_comes_after() {
        let (mut skyline, dense) = pair();
        let size = skyline.len();
        let mut factor = Factor::default();
        factor.of(&mut skyline).unwrap();
        let mut unit = vec![0.0; size];
        unit[5] = 1.0;
        factor.forward(&mut unit, 5);
        let variance: f64 = unit.iter().map(|y| y * y).sum();
        let inverse = dense.try_inverse().unwrap();
        assert!((variance - inverse[(5, 5)]).abs() < 1e-12);
        let mut units = vec![[0.0; 2]; size];
        (units[5][0], units[7][1]) = (1.0, 1.0);
        factor.forward_all(&mut units, 5);
        let across: f64 = units.iter().map(|[a, b]| a * b).sum();
        assert!((across - inverse[(5, 7)]).abs() < 1e-12);
    }

    #[test]
    fn a_direction_that_nothing_determines_is_told() {
        for corner in [1.0, f64::NAN] {
            let mut skyline = Skyline::default();
            skyline.reset(&[0, 0]);
            for (row, column) in [(0, 0), (1, 0), (1, 1)] {
                skyline.add(row, column, if row == 0 { corner } else { 1.0 });
            }
            assert_eq!(Factor::default().of(&mut skyline), Err(NotPositive));
        }
    }
}
