//! A real recording, replayed.

use super::*;
use crate::datasets;

#[test]
fn four_real_robots_find_each_other_by_distances() {
    let Some(folder) = datasets::find("cora_pyfg") else {
        return;
    };
    let text = std::fs::read_to_string(folder.join("tiers.pyfg")).unwrap();
    let graph = FactorGraph::parse(&text).unwrap();
    let request = Request {
        added_sigmas: 0.0,
        seed: 1,
    };
    let results = replay(&graph, request).unwrap();
    assert_eq!(results.len(), 12);
    for one in &results {
        let seconds = one.converged_s.unwrap_or(f64::INFINITY);
        assert!(seconds < 40.0 && one.refused == 0, "{one:?}");
        assert!(one.position_rmse_m < 0.5, "{one:?}");
        assert!(one.heading_rmse_rad < 0.12, "{one:?}");
    }
}

#[test]
fn who_is_near_only_now_and_then_has_not_converged() {
    let good = |time_s: f64| (time_s, 0.1, 0.1);
    let mut moments: Vec<Moment> = (0..100).map(|index| good(0.5 * f64::from(index))).collect();
    assert_eq!(converged(&moments), Some(0));
    moments[5].1 = 3.0;
    assert_eq!(converged(&moments), Some(6));
    for index in (0..100).step_by(8) {
        moments[index].2 = 1.0;
    }
    assert_eq!(converged(&moments), None);
}
