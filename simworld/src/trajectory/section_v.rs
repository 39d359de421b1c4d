//! The zig-zag paths of section V of Knuth & Barooah, for any number of robots. The paper shows them only as a
//! picture; these formulas are ours, fixed so that everyone flies the same ones.

use crate::truth::{Pose, pose_from_euler};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::num::NonZeroU32;

/// The interval of one step k of the paper, seconds.
const STEP_S: f64 = 0.2;

/// The path of one robot, numbered from 1; there is a path for every number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SectionV {
    /// Which robot, from 1.
    pub robot: NonZeroU32,
}

/// Origin, period of the sideways and of the vertical zig-zag in steps, and their phases in turns.
struct Row {
    origin_m: [f64; 3],
    sideways_period: f64,
    sideways_phase: f64,
    vertical_period: f64,
    vertical_phase: f64,
}

const fn row(origin_m: [f64; 3], sideways: [f64; 2], vertical: [f64; 2]) -> Row {
    Row {
        origin_m,
        sideways_period: sideways[0],
        sideways_phase: sideways[1],
        vertical_period: vertical[0],
        vertical_phase: vertical[1],
    }
}

const ROWS: [Row; 5] = [
    row([0.0, 0.0, 0.0], [25.0, 0.0], [20.0, 0.0]),
    row([1.0, 4.5, 1.0], [30.0, 0.30], [22.0, 0.40]),
    row([-1.0, -4.5, -1.0], [28.0, 0.60], [18.0, 0.70]),
    row([5.0, 1.0, 3.0], [34.0, 0.15], [24.0, 0.25]),
    row([-5.0, -2.0, 3.0], [40.0, 0.80], [21.0, 0.55]),
];

impl SectionV {
    /// The truth pose at `t_s` seconds, not negative.
    pub(super) fn pose_at(&self, t_s: f64) -> Pose {
        let k = t_s / STEP_S;
        let index = self.robot.get() as usize - 1;
        let row = &ROWS[index % ROWS.len()];
        // Robots beyond the fifth fly the five paths again, beside them and out of step.
        let again = (index / ROWS.len()) as f64;
        let sideways = k / row.sideways_period + row.sideways_phase + 0.17 * again;
        let vertical = k / row.vertical_period + row.vertical_phase + 0.17 * again;
        let [ox, oy, oz] = row.origin_m;
        let position_m = Vector3::new(
            ox + 0.2 * k,
            oy + 9.0 * again + 3.0 * triangle(sideways),
            oz + triangle(vertical),
        );
        let yaw_rad = 0.8 * (TAU * sideways).sin();
        let pitch_rad = 0.4 * (TAU * vertical).sin();
        let roll_rad = 0.3 * (TAU * (k / 33.0 + 0.1 * f64::from(self.robot.get()))).sin();
        pose_from_euler(position_m, yaw_rad, pitch_rad, roll_rad)
    }
}

/// The triangle wave of period 1 between -1 (at 0) and 1 (at 1/2).
fn triangle(turns: f64) -> f64 {
    4.0 * (turns - (turns + 0.5).floor()).abs() - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::yaw_rad;

    fn robot(number: u32) -> SectionV {
        SectionV {
            robot: NonZeroU32::new(number).unwrap(),
        }
    }

    #[test]
    fn the_triangle_wave_has_its_corners_at_half_turns() {
        for (turns, value) in [
            (0.0, -1.0),
            (0.25, 0.0),
            (0.5, 1.0),
            (0.75, 0.0),
            (1.0, -1.0),
            (-0.5, 1.0),
            (3.25, 0.0),
        ] {
            assert!((triangle(turns) - value).abs() < 1e-12, "{turns}");
        }
    }

    #[test]
    fn robot_1_is_where_a_calculation_by_hand_puts_it() {
        // k = 0: both waves at their lower corner, all sines 0 but the roll's phase of a tenth of a turn.
        let start = robot(1).pose_at(0.0);
        assert!((start.translation.vector - Vector3::new(0.0, -3.0, -1.0)).norm() < 1e-12);
        let (roll, pitch, yaw) = start.rotation.euler_angles();
        assert!(
            (roll - 0.3 * (TAU * 0.1).sin()).abs() < 1e-12
                && pitch.abs() < 1e-12
                && yaw.abs() < 1e-12
        );
        // k = 100 = 4 P = 5 Q: the same corner, 20 m on.
        let end = robot(1).pose_at(20.0);
        assert!((end.translation.vector - Vector3::new(20.0, -3.0, -1.0)).norm() < 1e-9);
        // k = 6.25: a quarter of P, so y crosses its origin and the yaw is at its largest.
        let quarter = robot(1).pose_at(1.25);
        assert!(quarter.translation.y.abs() < 1e-9 && (yaw_rad(&quarter) - 0.8).abs() < 1e-9);
    }

    #[test]
    fn robot_4_is_where_a_calculation_by_hand_puts_it() {
        // k = 17 is half of P = 34: sideways 0.5 + 0.15 turns, tri = 4 * 0.35 - 1; vertical 17/24 + 0.25 = 0.958333.
        let pose = robot(4).pose_at(3.4);
        let expected = Vector3::new(
            5.0 + 3.4,
            1.0 + 3.0 * 0.4,
            3.0 + (4.0 * (1.0 - 0.958_333_333_333) - 1.0),
        );
        assert!(
            (pose.translation.vector - expected).norm() < 1e-9,
            "{}",
            pose.translation
        );
    }

    #[test]
    fn robots_beyond_the_fifth_fly_beside_the_first_five() {
        let (first, sixth) = (robot(1).pose_at(0.0), robot(6).pose_at(0.0));
        assert!((sixth.translation.x - first.translation.x).abs() < 1e-12);
        // oy + 9, and the zig-zag 0.17 turns on: tri(0.17) = -0.32.
        assert!((sixth.translation.y - (9.0 + 3.0 * -0.32)).abs() < 1e-9);
        assert!((yaw_rad(&sixth) - 0.8 * (TAU * 0.17).sin()).abs() < 1e-9);
        // The roll's phase goes by the robot's own number: six tenths of a turn.
        assert!((sixth.rotation.euler_angles().0 - 0.3 * (TAU * 0.6).sin()).abs() < 1e-9);
    }
}
