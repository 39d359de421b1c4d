//! The cheapest one-to-one assignment of rows to columns (Hungarian method, by shortest augmenting paths).

/// Most rows or columns that are assigned.
pub const SIDE_MAX: usize = 64;

/// Assigns every row to a column of its own so that the sum of `cost(row, column)` is least, or leaves it out at the price
/// `unassigned`. Gives each row's column. Costs that are not finite forbid the pair.
///
/// Rows and columns beyond [`SIDE_MAX`] are left out. The time is O(rows^2 (rows + columns)).
///
/// Ties are broken by the order of rows and columns, so the answer is always the same one.
#[must_use]
pub fn assign(
    rows: usize,
    columns: usize,
    unassigned: f64,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<Option<usize>> {
    let mut assigned = vec![None; rows];
    let (rows, columns) = (rows.min(SIDE_MAX), columns.min(SIDE_MAX));
    // Column `columns + row` stands for leaving the row out, so an assignment of all rows always exists.
    let wide = columns + rows;
    let priced = |row: usize, column: usize| {
        let cost = if column < columns {
            cost(row, column)
        } else if column == columns + row {
            unassigned
        } else {
            f64::INFINITY
        };
        if cost.is_finite() { cost } else { FORBIDDEN }
    };
    let mut row_price = vec![0.0; rows + 1];
    let mut column_price = vec![0.0; wide + 1];
    let mut row_of = vec![rows; wide + 1];
    for row in 0..rows {
        // Column `wide` is the root of the tree of alternating paths.
        row_of[wide] = row;
        let mut column = wide;
        let mut slack = vec![f64::INFINITY; wide];
        let mut came_from = vec![wide; wide];
        let mut reached = vec![false; wide + 1];
        while row_of[column] != rows {
            reached[column] = true;
            let at = row_of[column];
            let mut nearest = (f64::INFINITY, wide);
            for next in 0..wide {
                if reached[next] {
                    continue;
                }
                let reduced = priced(at, next) - row_price[at] - column_price[next];
                if reduced < slack[next] {
                    slack[next] = reduced;
                    came_from[next] = column;
                }
                if slack[next] < nearest.0 {
                    nearest = (slack[next], next);
                }
            }
            for known in 0..=wide {
                if reached[known] {
                    row_price[row_of[known]] += nearest.0;
                    column_price[known] -= nearest.0;
                } else if known < wide {
                    slack[known] -= nearest.0;
                }
            }
            column = nearest.1;
        }
        while column != wide {
            let before = came_from[column];
            row_of[column] = row_of[before];
            column = before;
        }
    }
    for (column, &row) in row_of.iter().enumerate().take(columns) {
        if row < rows && priced(row, column) < FORBIDDEN {
            assigned[row] = Some(column);
        }
    }
    assigned
}

/// Dearer than any sum of honest costs, and finite: infinities have no differences.
const FORBIDDEN: f64 = 1e12;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn total(costs: &[Vec<f64>], unassigned: f64, assigned: &[Option<usize>]) -> f64 {
        let price = |(row, column): (usize, &Option<usize>)| {
            column.map_or(unassigned, |column| costs[row][column])
        };
        assigned.iter().enumerate().map(price).sum()
    }

    fn cheapest(costs: &[Vec<f64>], unassigned: f64, row: usize, taken: &mut Vec<usize>) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        let mut best = unassigned + cheapest(costs, unassigned, row + 1, taken);
        for column in 0..costs[row].len() {
            if !taken.contains(&column) {
                taken.push(column);
                best = best.min(costs[row][column] + cheapest(costs, unassigned, row + 1, taken));
                taken.pop();
            }
        }
        best
    }

    proptest! {
        #[test]
        fn it_is_as_cheap_as_the_best_of_all(
            costs in (1usize..5, 0usize..5).prop_flat_map(|(rows, columns)|
                prop::collection::vec(prop::collection::vec(0.0..10.0f64, columns), rows)),
            unassigned in 0.0..10.0f64,
        ) {
            let assigned = assign(costs.len(), costs[0].len(), unassigned, |row, column| costs[row][column]);
            let best = cheapest(&costs, unassigned, 0, &mut Vec::new());
            prop_assert!((total(&costs, unassigned, &assigned) - best).abs() < 1e-9);
            let mut columns: Vec<_> = assigned.iter().flatten().collect();
            columns.sort_unstable();
            columns.dedup();
            prop_assert_eq!(columns.len(), assigned.iter().flatten().count());
        }
    }

    #[test]
    fn a_forbidden_pair_is_left_out() {
        let assigned = assign(2, 1, 5.0, |row, _| if row == 0 { f64::NAN } else { 1.0 });
        assert_eq!(assigned, [None, Some(0)]);
    }

    #[test]
    fn what_is_beyond_the_bound_is_left_out() {
        let assigned = assign(SIDE_MAX + 1, 1, 5.0, |row, _| -(row as f64));
        assert_eq!(assigned.len(), SIDE_MAX + 1);
        assert_eq!(assigned[SIDE_MAX - 1], Some(0));
        assert_eq!(assigned[SIDE_MAX], None);
    }
}
