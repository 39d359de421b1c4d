//! Factor graphs, good ones and wrong ones.

use super::*;
use crate::datasets;

const GOOD: &str = "\
# two robots and a beacon
VERTEX_SE2 100.5 A0 1.0 2.0 0.5
VERTEX_SE2 101.5 A1 2.0 2.0 0.5
VERTEX_SE2 100.5 B0 4.0 6.0 -0.5

EDGE_SE2 101.5 A0 A1 0.9 -0.4 0.01 0.0001 0 0 0.0003 0 2.5e-05
EDGE_RANGE 101.6 A1 B0 4.5 0.01
EDGE_RANGE 101.7 A1 L0 3.0 0.01
VERTEX_XY L0 2.0 5.0
";

#[test]
fn poses_odometry_distances_and_landmarks_are_read() {
    let graph = FactorGraph::parse(GOOD).unwrap();
    assert_eq!(graph.robots(), ['A', 'B']);
    assert!(!graph.is_spatial);
    let later: Key = "A1".parse().unwrap();
    let vertex = graph.vertices[&later];
    assert_eq!(vertex.time_s, 1.0);
    assert!((vertex.pose.rotation.euler_angles().2 - 0.5).abs() < 1e-12);
    let step = &graph.odometry[0];
    assert_eq!((step.to, step.motion.translation.x), (later, 0.9));
    assert!((step.translation_variance_m2 - 2e-4).abs() < 1e-12);
    assert_eq!(step.rotation_variance_rad2, 2.5e-5);
    assert!((graph.ranges[0].time_s - 1.1).abs() < 1e-6);
    assert_eq!((graph.ranges.len(), graph.landmarks.len()), (2, 1));
}

#[test]
fn a_spatial_pose_and_step_are_read() {
    let upper: Vec<String> = (0..21).map(|index| format!("{}", index + 1)).collect();
    let text = format!(
        "VERTEX_SE3:QUAT 1 A0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 2 A1 1 2 3 0 0 1 0\n\
         EDGE_SE3:QUAT 2 A0 A1 1 2 3 0 0 1 0 {}\n",
        upper.join(" ")
    );
    let graph = FactorGraph::parse(&text).unwrap();
    assert!(graph.is_spatial);
    let step = &graph.odometry[0];
    assert_eq!(step.motion.translation.z, 3.0);
    // The diagonal: 1, 7, 12 and, of the rotation about z, 21.
    assert!((step.translation_variance_m2 - 20.0 / 3.0).abs() < 1e-12);
    assert_eq!(step.rotation_variance_rad2, 21.0);
}

#[test]
fn what_is_wrong_is_named_with_its_line() {
    let cases = [
        ("VERTEX_SE2 1 A0 0 0", "5 columns"),
        ("VERTEX_SE2 1 A0 0 0 nan", "`nan`"),
        ("VERTEX_SE2 1 A0 0 1e300 0", "too far"),
        ("VERTEX_SE2 1 A0 0 0 inf", "`inf`"),
        ("VERTEX_SE2 1 40 0 0 0", "`40`"),
        ("VERTEX_SE2 1 A-1 0 0 0", "`A-1`"),
        ("VERTEX_SE2 1 A99999999999 0 0 0", "`A99999999999`"),
        ("VERTEX_SE2 1 \u{e4}1 0 0 0", "letter"),
        ("VERTEX_SE2 1 A7 0 0 0\nVERTEX_SE2 1 A7 0 0 0", "twice"),
        ("VERTEX_SE3:QUAT 1 A0 0 0 0 0 0 0 2", "length 2"),
        ("VERTEX_SE3:QUAT 1 A0 0 0 0 0 0 0 0", "length 0"),
        ("EDGE_RANGE 1 A1 B0 -4.5 0.01", "negative"),
        ("EDGE_RANGE 1 A1 B0 4.5 0", "above zero"),
        ("EDGE_RANGE 1 A1 A1 4.5 0.01", "both ends"),
        ("EDGE_RANGE 1 A1 B9 4.5 0.01", "no vertex B9"),
        ("EDGE_SE2 1 A0 B0 0 0 0 1 0 0 1 0 1", "no step"),
        ("EDGE_SE2 1 A0 A4294967296 0 0 0 1 0 0 1 0 1", "A4294967296"),
        ("WALL 1 2 3", "`WALL`"),
    ];
    let lines = GOOD.lines().count();
    for (added, expected) in cases {
        let text = format!("{GOOD}{added}\n");
        let error = FactorGraph::parse(&text).unwrap_err();
        let PyfgError::Line { line, reason } = &error else {
            panic!("{added}: {error}");
        };
        assert!(reason.contains(expected), "{added}: {error}");
        assert_eq!(*line, lines + added.lines().count(), "{added}: {error}");
    }
    assert_eq!(FactorGraph::parse("# nothing\n"), Err(PyfgError::Empty));
}

#[test]
fn the_real_recording_of_four_robots_is_read() {
    let Some(folder) = datasets::find("cora_pyfg") else {
        return;
    };
    let text = std::fs::read_to_string(folder.join("tiers.pyfg")).unwrap();
    let graph = FactorGraph::parse(&text).unwrap();
    assert_eq!(graph.robots(), ['A', 'B', 'C', 'D']);
    assert_eq!(
        (
            graph.vertices.len(),
            graph.odometry.len(),
            graph.ranges.len()
        ),
        (9768, 9764, 7789)
    );
}
