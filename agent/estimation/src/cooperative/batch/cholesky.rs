//! Sparse Cholesky over 6x6 blocks: `L L^T = H + added I`, left-looking, columns in the order of elimination. The
//! pattern is analysed once and reused for every factor.

use nalgebra::{Matrix6, Vector6};

use super::Block;
use crate::cooperative::block::Factor;

const NONE: usize = usize::MAX;

/// A symmetric matrix of blocks: the diagonal, and the blocks below it by column.
#[derive(Debug, Clone)]
pub(crate) struct Sparse {
    diagonal: Vec<Block>,
    /// Where each column begins in `rows` and `blocks`.
    starts: Vec<usize>,
    rows: Vec<usize>,
    blocks: Vec<Block>,
}

impl Sparse {
    /// A zero matrix of `size` block rows, with room for the pairs given in either order.
    pub(crate) fn new(size: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Self {
        let mut columns = vec![Vec::new(); size];
        for (a, b) in pairs {
            columns[a.min(b)].push(a.max(b));
        }
        let mut starts = vec![0];
        let mut rows = Vec::new();
        for mut column in columns {
            column.sort_unstable();
            column.dedup();
            rows.extend_from_slice(&column);
            starts.push(rows.len());
        }
        Self {
            diagonal: vec![Block::zeros(); size],
            blocks: vec![Block::zeros(); rows.len()],
            starts,
            rows,
        }
    }

    pub(crate) fn size(&self) -> usize {
        self.diagonal.len()
    }

    /// The place of a block below the diagonal.
    pub(crate) fn find(&self, row: usize, column: usize) -> Option<usize> {
        let (start, end) = (self.starts[column], self.starts[column + 1]);
        self.rows[start..end]
            .binary_search(&row)
            .ok()
            .map(|offset| start + offset)
    }

    pub(crate) fn clear(&mut self) {
        self.diagonal.fill(Block::zeros());
        self.blocks.fill(Block::zeros());
    }

    pub(crate) fn diagonal(&self, index: usize) -> &Block {
        &self.diagonal[index]
    }

    pub(crate) fn diagonal_mut(&mut self, index: usize) -> &mut Block {
        &mut self.diagonal[index]
    }

    pub(crate) fn block_mut(&mut self, place: usize) -> &mut Block {
        &mut self.blocks[place]
    }
}

/// The factor, with its pattern.
#[derive(Debug, Clone)]
pub(crate) struct Cholesky {
    starts: Vec<usize>,
    rows: Vec<usize>,
    blocks: Vec<Block>,
    diagonal: Vec<Option<Factor>>,
    /// Of each row, the column that is waiting to update it and the one after that: linked lists.
    waiting: Vec<usize>,
    after: Vec<usize>,
    /// Of each column, the first of its blocks not used yet.
    cursor: Vec<usize>,
    /// The place in the present column of each row.
    place_of: Vec<usize>,
}

impl Cholesky {
    /// The pattern of the factor: each column has the rows of the matrix and those of the columns whose first row it is.
    pub(crate) fn analyse(matrix: &Sparse) -> Self {
        let size = matrix.size();
        let mut children = vec![Vec::new(); size];
        let mut starts = vec![0];
        let mut rows: Vec<usize> = Vec::new();
        let mut marked = vec![NONE; size];
        for column in 0..size {
            let start = rows.len();
            marked[column] = column;
            for &row in &matrix.rows[matrix.starts[column]..matrix.starts[column + 1]] {
                marked[row] = column;
                rows.push(row);
            }
            for &child in &children[column] {
                let (from, to): (usize, usize) = (starts[child], starts[child + 1]);
                for k in from..to {
                    let row = rows[k];
                    if marked[row] != column {
                        marked[row] = column;
                        rows.push(row);
                    }
                }
            }
            rows[start..].sort_unstable();
            starts.push(rows.len());
            if let Some(&parent) = rows.get(start) {
                children[parent].push(column);
            }
        }
        Self {
            blocks: vec![Block::zeros(); rows.len()],
            diagonal: vec![None; size],
            waiting: vec![NONE; size],
            after: vec![NONE; size],
            cursor: vec![0; size],
            place_of: vec![NONE; size],
            starts,
            rows,
        }
    }

    /// Factors `matrix + added I`, which has the pattern that was analysed. False when it is not positive definite.
    pub(crate) fn factor(&mut self, matrix: &Sparse, added: f64) -> bool {
        self.waiting.fill(NONE);
        for column in 0..matrix.size() {
            let (start, end) = (self.starts[column], self.starts[column + 1]);
            for place in start..end {
                self.blocks[place] = Block::zeros();
                self.place_of[self.rows[place]] = place;
            }
            for k in matrix.starts[column]..matrix.starts[column + 1] {
                self.blocks[self.place_of[matrix.rows[k]]] = matrix.blocks[k];
            }
            let mut own = matrix.diagonal[column];
            for i in 0..6 {
                own[(i, i)] += added;
            }
            let diagonal = own.diagonal();

            // Every earlier column with a block in this row takes its part away.
            let mut earlier = self.waiting[column];
            while earlier != NONE {
                let next = self.after[earlier];
                let first = self.cursor[earlier];
                let last = self.starts[earlier + 1];
                let (done, here) = self.blocks.split_at_mut(start);
                let pivot = done[first].transpose();
                subtract_product(&mut own, &done[first], &pivot);
                for k in first + 1..last {
                    subtract_product(
                        &mut here[self.place_of[self.rows[k]] - start],
                        &done[k],
                        &pivot,
                    );
                }
                self.wait(earlier, first + 1);
                earlier = next;
            }

            let Some(factor) = Factor::new(&own, &diagonal) else {
                return false;
            };
            for block in &mut self.blocks[start..end] {
                // L_ij = C_ij L_jj^-T, so L_ij^T = L_jj^-1 C_ij^T.
                let mut turned = block.transpose();
                factor.solve_lower(&mut turned);
                *block = turned.transpose();
            }
            self.diagonal[column] = Some(factor);
            self.wait(column, start);
        }
        true
    }

    /// Queues a column for the row of its block at `place`, if there is one.
    fn wait(&mut self, column: usize, place: usize) {
        self.cursor[column] = place;
        if place < self.starts[column + 1] {
            let row = self.rows[place];
            self.after[column] = self.waiting[row];
            self.waiting[row] = column;
        }
    }

    /// Replaces `right` by the solution of the factored system.
    pub(crate) fn solve(&self, right: &mut [Vector6<f64>]) {
        for column in 0..right.len() {
            let mut x = right[column];
            if let Some(factor) = &self.diagonal[column] {
                factor.solve_lower(&mut x);
            }
            right[column] = x;
            for place in self.starts[column]..self.starts[column + 1] {
                right[self.rows[place]] -= self.blocks[place] * x;
            }
        }
        for column in (0..right.len()).rev() {
            let mut x = right[column];
            for place in self.starts[column]..self.starts[column + 1] {
                x -= self.blocks[place].tr_mul(&right[self.rows[place]]);
            }
            if let Some(factor) = &self.diagonal[column] {
                factor.solve_upper(&mut x);
            }
            right[column] = x;
        }
    }
}

/// `target -= a b`, unrolled: nearly all of the time of a factor goes here.
#[inline]
fn subtract_product(target: &mut Matrix6<f64>, a: &Matrix6<f64>, b: &Matrix6<f64>) {
    for column in 0..6 {
        let mut sum = [0.0; 6];
        for k in 0..6 {
            let factor = b[(k, column)];
            for (row, sum) in sum.iter_mut().enumerate() {
                *sum += a[(row, k)] * factor;
            }
        }
        for (row, sum) in sum.iter().enumerate() {
            target[(row, column)] -= sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sparse_system_is_solved_as_the_dense_one() {
        let size = 12;
        let pairs = [
            (0, 3),
            (1, 3),
            (2, 7),
            (3, 9),
            (4, 5),
            (5, 11),
            (6, 8),
            (0, 10),
            (7, 9),
            (2, 11),
        ];
        let mut matrix = Sparse::new(size, pairs.into_iter());
        for (k, (a, b)) in pairs.into_iter().enumerate() {
            let place = matrix.find(a.max(b), a.min(b)).unwrap();
            *matrix.block_mut(place) = Block::from_fn(|i, j| ((7 * k + 3 * i + j) as f64).sin());
        }
        for k in 0..size {
            *matrix.diagonal_mut(k) = Block::identity() * (20.0 + k as f64);
        }
        let mut dense = nalgebra::DMatrix::<f64>::zeros(6 * size, 6 * size);
        for k in 0..size {
            dense
                .view_mut((6 * k, 6 * k), (6, 6))
                .copy_from(matrix.diagonal(k));
        }
        for (a, b) in pairs {
            let block = matrix.blocks[matrix.find(a.max(b), a.min(b)).unwrap()];
            dense
                .view_mut((6 * a.max(b), 6 * a.min(b)), (6, 6))
                .copy_from(&block);
            dense
                .view_mut((6 * a.min(b), 6 * a.max(b)), (6, 6))
                .copy_from(&block.transpose());
        }
        let right = nalgebra::DVector::from_fn(6 * size, |i, _| (i as f64).cos());
        let expected = (dense + nalgebra::DMatrix::identity(6 * size, 6 * size) * 0.5)
            .cholesky()
            .unwrap()
            .solve(&right);
        let mut cholesky = Cholesky::analyse(&matrix);
        for _ in 0..2 {
            assert!(cholesky.factor(&matrix, 0.5));
            let mut x: Vec<Vector6<f64>> = (0..size)
                .map(|k| right.fixed_rows::<6>(6 * k).into_owned())
                .collect();
            cholesky.solve(&mut x);
            for (k, x) in x.iter().enumerate() {
                assert!((x - expected.fixed_rows::<6>(6 * k)).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn an_indefinite_system_is_refused() {
        let mut matrix = Sparse::new(2, [(0, 1)].into_iter());
        *matrix.diagonal_mut(0) = Block::identity();
        *matrix.diagonal_mut(1) = Block::identity();
        *matrix.block_mut(0) = Block::identity();
        let mut cholesky = Cholesky::analyse(&matrix);
        assert!(!cholesky.factor(&matrix, 0.0));
        assert!(cholesky.factor(&matrix, 0.1));
    }
}
