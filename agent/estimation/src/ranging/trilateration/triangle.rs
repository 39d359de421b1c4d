//! The triangle of two distances and the move between them (Cornejo & Nagpal, equations 3 to 6).

use super::pair_motion::Turtle;
use std::f64::consts::PI;

/// Robot a moves, robot b stands still: the corners are a before, a after, and b. A flip of +1 has b on the left of the
/// motion, of -1 on its right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// At a before the motion: from the motion to b (rad).
    pub before_rad: f64,
    /// At a after it: from the way back to b (rad).
    pub after_rad: f64,
    /// At b, between a before and a after (rad).
    pub apex_rad: f64,
    motion_rad: f64,
    rotation_rad: f64,
}

impl Triangle {
    /// Of the motion of a and its distances to b before and after it (m). Distances that contradict the move make a flat
    /// triangle; angles beside a side of length zero are right ones.
    #[must_use]
    pub fn new(motion: &Turtle, before_m: f64, after_m: f64) -> Self {
        let length_m = motion.translation_m.norm();
        // The cosine law, for the angle between two sides and opposite the third.
        let angle = |a: f64, b: f64, opposite: f64| {
            let cosine = (a * a + b * b - opposite * opposite) / (2.0 * a * b);
            if cosine.is_nan() {
                PI / 2.0
            } else {
                cosine.clamp(-1.0, 1.0).acos()
            }
        };
        Self {
            before_rad: angle(length_m, before_m, after_m),
            after_rad: angle(length_m, after_m, before_m),
            apex_rad: angle(before_m, after_m, length_m),
            motion_rad: motion.translation_m.y.atan2(motion.translation_m.x),
            rotation_rad: motion.rotation_rad,
        }
    }

    /// The bearing of b before the motion in a's frame before it (rad, not wrapped).
    #[must_use]
    pub fn bearing_before(&self, flip: f64) -> f64 {
        self.motion_rad + flip * self.before_rad
    }

    /// The bearing of b after the motion in a's frame after it (rad, not wrapped).
    #[must_use]
    pub fn bearing_after(&self, flip: f64) -> f64 {
        self.motion_rad + PI - flip * self.after_rad - self.rotation_rad
    }
}
