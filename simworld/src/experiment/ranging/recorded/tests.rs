//! A real recording, replayed.

use super::*;
use crate::datasets;
use crate::experiment::ranging::following::Off;

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
        assert!(one.position_m.rms < 0.5, "{one:?}");
        assert!(one.heading_rad.rms < 0.12, "{one:?}");
    }
}

fn off(position_m: f64, yaw_rad: f64) -> Told {
    Told::Place(Off {
        position_m,
        yaw_rad,
        nees: 1.0,
    })
}

#[test]
fn who_is_near_only_now_and_then_has_not_converged() {
    let good = |index: u32| (0.5 * f64::from(index), off(0.1, 0.1));
    let mut moments: Vec<Moment> = (0..100).map(good).collect();
    assert_eq!(converged(&moments), Some(0.0));
    moments[5].1 = off(3.0, 0.1);
    assert_eq!(converged(&moments), Some(3.0));
    for index in (0..100).step_by(8) {
        moments[index].1 = off(0.1, 1.0);
    }
    assert_eq!(converged(&moments), None);
}

#[test]
fn to_be_told_nothing_is_neither_near_nor_far() {
    let mut moments: Vec<Moment> = (0..100)
        .map(|index| (0.5 * f64::from(index), Told::Nothing))
        .collect();
    assert_eq!(converged(&moments), None);
    moments[10].1 = off(0.1, 0.1);
    moments[40].1 = off(0.1, 0.1);
    assert_eq!(converged(&moments), Some(5.0));
}
