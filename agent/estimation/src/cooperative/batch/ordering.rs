//! The order of elimination: approximate minimum degree on the quotient graph (Amestoy, Davis and Duff 1996), without
//! supervariables. Ties go to the lower number, so the order is the same on every machine.

use std::collections::BTreeSet;

/// Which unknown to eliminate first, second and so on. `neighbours` is symmetric, without repeats or loops.
pub(crate) fn minimum_degree(neighbours: &[Vec<usize>]) -> Vec<usize> {
    let count = neighbours.len();
    // An eliminated unknown becomes an element: the clique of its remaining neighbours, kept as one list.
    let mut unknowns: Vec<Vec<usize>> = neighbours.to_vec();
    let mut elements: Vec<Vec<usize>> = vec![Vec::new(); count];
    let mut clique: Vec<Vec<usize>> = vec![Vec::new(); count];
    let mut state = vec![State::Unknown; count];
    let mut degree: Vec<usize> = unknowns.iter().map(Vec::len).collect();
    let mut queue: BTreeSet<(usize, usize)> = degree.iter().copied().zip(0..count).collect();
    let mut marked = vec![usize::MAX; count];
    // Of each element, how many members lie outside the clique now formed; valid when stamped with this step.
    let mut outside: Vec<(usize, usize)> = vec![(usize::MAX, 0); count];
    let mut order = Vec::with_capacity(count);

    while let Some((_, pivot)) = queue.pop_first() {
        let step = order.len();
        order.push(pivot);
        state[pivot] = State::Element;

        // The new clique: neighbours through edges and through the elements that the pivot belongs to.
        marked[pivot] = step;
        let mut members = Vec::new();
        let absorbed = std::mem::take(&mut elements[pivot]);
        for &unknown in unknowns[pivot]
            .iter()
            .chain(absorbed.iter().flat_map(|&element| &clique[element]))
        {
            if marked[unknown] != step && state[unknown] == State::Unknown {
                marked[unknown] = step;
                members.push(unknown);
            }
        }
        unknowns[pivot] = Vec::new();
        for &element in &absorbed {
            state[element] = State::Absorbed;
            clique[element] = Vec::new();
        }

        for &member in &members {
            elements[member].retain(|&element| state[element] == State::Element);
            for &element in &elements[member] {
                let (stamp, left) = &mut outside[element];
                if *stamp != step {
                    (*stamp, *left) = (
                        step,
                        clique[element]
                            .iter()
                            .filter(|&&m| state[m] == State::Unknown)
                            .count(),
                    );
                }
                *left -= 1;
            }
        }
        let remaining = count - order.len();
        for &member in &members {
            // Edges inside the clique are now said by the element.
            unknowns[member]
                .retain(|&other| marked[other] != step && state[other] == State::Unknown);
            // An element inside the new clique says nothing new.
            elements[member].retain(|&element| outside[element].1 > 0);
            let through_elements: usize = elements[member]
                .iter()
                .map(|&element| outside[element].1)
                .sum();
            elements[member].push(pivot);
            let others = members.len() - 1;
            let bound = (unknowns[member].len() + others + through_elements)
                .min(degree[member] + others)
                .min(remaining - 1);
            queue.remove(&(degree[member], member));
            degree[member] = bound;
            queue.insert((bound, member));
        }
        clique[pivot] = members;
    }
    order
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Unknown,
    Element,
    Absorbed,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_names_every_unknown_once() {
        let ring: Vec<Vec<usize>> = (0..50).map(|k| vec![(k + 49) % 50, (k + 1) % 50]).collect();
        let mut order = minimum_degree(&ring);
        order.sort_unstable();
        assert_eq!(order, (0..50).collect::<Vec<_>>());
        assert!(minimum_degree(&[]).is_empty());
    }

    #[test]
    fn the_hub_of_a_star_goes_last() {
        let mut star: Vec<Vec<usize>> = vec![vec![0]; 20];
        star[0] = (1..20).collect();
        let order = minimum_degree(&star);
        assert!(order[18..].contains(&0), "{order:?}");
    }

    #[test]
    fn a_grid_fills_far_less_than_in_its_natural_order() {
        let side = 30;
        let at = |x: usize, y: usize| x * side + y;
        let mut grid = vec![Vec::new(); side * side];
        for x in 0..side {
            for y in 0..side {
                if x + 1 < side {
                    grid[at(x, y)].push(at(x + 1, y));
                    grid[at(x + 1, y)].push(at(x, y));
                }
                if y + 1 < side {
                    grid[at(x, y)].push(at(x, y + 1));
                    grid[at(x, y + 1)].push(at(x, y));
                }
            }
        }
        let natural: Vec<usize> = (0..side * side).collect();
        let (before, after) = (fill(&grid, &natural), fill(&grid, &minimum_degree(&grid)));
        assert!(after * 2 < before, "{after} against {before}");
    }

    /// The number of blocks below the diagonal of the factor, by plain elimination.
    fn fill(neighbours: &[Vec<usize>], order: &[usize]) -> usize {
        let mut sets: Vec<BTreeSet<usize>> = neighbours
            .iter()
            .map(|list| list.iter().copied().collect())
            .collect();
        let mut total = 0;
        for &pivot in order {
            let members: Vec<usize> = std::mem::take(&mut sets[pivot]).into_iter().collect();
            total += members.len();
            for &a in &members {
                sets[a].remove(&pivot);
                sets[a].extend(members.iter().copied().filter(|&b| b != a));
            }
        }
        total
    }
}
