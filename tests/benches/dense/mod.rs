//! The yardstick of the solvers: Gauss-Newton on a whole graph with one dense normal matrix, written plainly.

use nalgebra::{DMatrix, DVector, Vector3};
use skein_estimation::cooperative::Graph;
use skein_estimation::{Body, Transform, World};

/// Minimises the cost of a graph whose reference alone is held. Gives the poses, the reference first, and the number
/// of steps.
pub(crate) fn gauss_newton(
    graph: &Graph,
    step_norm_max: f64,
    iterations_max: usize,
) -> (Vec<Transform<World, Body>>, usize) {
    let mut nodes = graph.nodes().to_vec();
    for iteration in 1..=iterations_max {
        let (hessian, gradient) = normal_equations(graph, &nodes);
        let step = hessian
            .cholesky()
            .expect("every graph here is determined")
            .solve(&-gradient);
        for (index, node) in nodes.iter_mut().skip(1).enumerate() {
            let part = step.fixed_rows::<6>(6 * index);
            let (turn, shift): (Vector3<f64>, Vector3<f64>) = (
                part.fixed_rows::<3>(0).into(),
                part.fixed_rows::<3>(3).into(),
            );
            *node = node.retract(&turn, &shift);
        }
        if step.norm() <= step_norm_max {
            return (nodes, iteration);
        }
    }
    (nodes, iterations_max)
}

/// The normal equations of a graph at these poses, the reference left out.
pub(crate) fn normal_equations(
    graph: &Graph,
    nodes: &[Transform<World, Body>],
) -> (DMatrix<f64>, DVector<f64>) {
    let unknowns = 6 * (nodes.len() - 1);
    let mut hessian = DMatrix::zeros(unknowns, unknowns);
    let mut gradient = DVector::zeros(unknowns);
    for e in graph.edges() {
        let (from, to) = (e.from.get(), e.to.get());
        let (part, _) = e.edge.linearise(&nodes[from], &nodes[to]);
        let (a, b) = (
            from.checked_sub(1).map(|a| 6 * a),
            to.checked_sub(1).map(|b| 6 * b),
        );
        if let Some(a) = a {
            let mut block = hessian.fixed_view_mut::<6, 6>(a, a);
            block += part.from_from;
            let mut rows = gradient.fixed_rows_mut::<6>(a);
            rows += part.from;
        }
        if let Some(b) = b {
            let mut block = hessian.fixed_view_mut::<6, 6>(b, b);
            block += part.to_to;
            let mut rows = gradient.fixed_rows_mut::<6>(b);
            rows += part.to;
        }
        if let (Some(a), Some(b)) = (a, b) {
            let mut block = hessian.fixed_view_mut::<6, 6>(a, b);
            block += part.from_to;
            let mut block = hessian.fixed_view_mut::<6, 6>(b, a);
            block += part.from_to.transpose();
        }
    }
    (hessian, gradient)
}
