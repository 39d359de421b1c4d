//! Trilateration while one moves and the other stands still (Cornejo & Nagpal, algorithm 2): two distances and one move
//! make a triangle, which gives the neighbour's bearing up to a flip.
//!
//! Two robots a and b are described from a: `b` is at a position in a's frame (x ahead, y to the left, metres), and turned
//! against a by an orientation (radians, counter-clockwise). In a round at most one of the two should move; where both did,
//! what is known is carried along by both odometries and nothing is concluded from the distances.
//!
//! [`Trilaterator`] is the paper's way: it takes of the two flips the one that its prediction agrees with, and distances
//! correct nothing else. [`Bank`] fuses every distance in a mixture of Gaussians that begins with every bearing and every
//! orientation, and is what to use.

mod bank;
mod pair_motion;
mod triangle;

pub use bank::{Bank, MODES_MAX, Mode, START_MODES};
pub use pair_motion::{Noise, PairMotion, Refusal, Turtle};
pub use triangle::Triangle;

use nalgebra::{Rotation2, Vector2};
use std::f64::consts::PI;

/// Hypotheses that a bootstrap leaves: two flips of each robot's move.
pub const HYPOTHESES_MAX: usize = 4;

/// A move shorter than this is none: its triangle has no shape (metres).
pub const MOVE_MIN_M: f64 = 0.05;

/// Distances after which the hypothesis that explains them best is taken for the truth.
const RESOLVING_ROUNDS: u32 = 6;

/// Where a neighbour is, in the own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relative {
    /// Metres.
    pub position_m: Vector2<f64>,
    /// Its heading less the own, counter-clockwise, in (-pi, pi].
    pub orientation_rad: f64,
}

/// The paper's localisation of one neighbour.
#[derive(Clone, Debug, Default)]
pub struct Trilaterator {
    /// The last distance (m).
    range_m: Option<f64>,
    /// The bearing (rad) of the neighbour for each flip of the own first move, until the neighbour has moved too.
    own_flips: Option<[f64; 2]>,
    /// The same, of this robot for the neighbour.
    their_flips: Option<[f64; 2]>,
    hypotheses: Vec<Hypothesis>,
    rounds: u32,
}

#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    at: Relative,
    /// Sum of the squared differences of predicted and measured distances (m^2).
    misfit_m2: f64,
}

impl Trilaterator {
    /// Nothing is known yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes in a round: how both have moved in it, the distance at its end (m), and, if the neighbour has told it, where
    /// it had this robot in its own frame at the end of the round before (m).
    ///
    /// # Errors
    /// With the reason when a number is not finite or absurd; then nothing has changed, and the next round's triangle
    /// would span two: tell it that nothing is known of the round by starting anew.
    pub fn update(
        &mut self,
        motion: &PairMotion,
        range_m: f64,
        told_m: Option<Vector2<f64>>,
    ) -> Result<(), Refusal> {
        motion.check()?;
        pair_motion::check_range(range_m)?;
        if let Some(told_m) = told_m {
            pair_motion::check_length("the position told", told_m.norm())?;
        }
        let before_m = self.range_m.replace(range_m);
        let Some(before_m) = before_m else {
            return Ok(());
        };
        let has_moved = |one: &Turtle| one.translation_m.norm() >= MOVE_MIN_M;
        match (has_moved(&motion.own), has_moved(&motion.theirs)) {
            (true, false) => self.own_move(motion, before_m, range_m, told_m),
            (false, true) => self.their_move(motion, before_m, range_m),
            (false, false) | (true, true) => self.carry(motion),
        }
        self.resolve(range_m);
        Ok(())
    }

    /// Where the neighbour is by what is most likely.
    #[must_use]
    pub fn estimate(&self) -> Option<Relative> {
        let best = self.hypotheses.iter();
        let best = best.min_by(|a, b| a.misfit_m2.total_cmp(&b.misfit_m2));
        best.map(|one| one.at)
    }

    /// How many hypotheses are left; one when the flips are resolved.
    #[must_use]
    pub fn n_hypotheses(&self) -> usize {
        self.hypotheses.len()
    }

    fn own_move(
        &mut self,
        motion: &PairMotion,
        before_m: f64,
        range_m: f64,
        told_m: Option<Vector2<f64>>,
    ) {
        let triangle = Triangle::new(&motion.own, before_m, range_m);
        // Equation 5, both flips, and what the neighbour sees turn (equation 6).
        let flips =
            [1.0, -1.0].map(|flip| (triangle.bearing_after(flip), flip * triangle.apex_rad));
        if self.hypotheses.is_empty() {
            self.own_flips = Some(flips.map(|(bearing_rad, _)| bearing_rad));
            self.their_flips = None;
            return;
        }
        for one in &mut self.hypotheses {
            let predicted = motion.carried(&one.at);
            one.misfit_m2 += (predicted.position_m.norm() - range_m).powi(2);
            let placed = flips.map(|(bearing_rad, apex_rad)| {
                let position_m = range_m * ahead(bearing_rad);
                // Equation 7 where the neighbour has told where it saw this robot.
                let orientation_rad = told_m.map_or(predicted.orientation_rad, |told_m| {
                    let back_rad = told_m.y.atan2(told_m.x) + apex_rad;
                    wrapped(bearing_rad - back_rad - PI)
                });
                Relative {
                    position_m,
                    orientation_rad,
                }
            });
            let off = |at: &Relative| (at.position_m - predicted.position_m).norm_squared();
            let [left, right] = placed;
            one.at = if off(&left) <= off(&right) {
                left
            } else {
                right
            };
        }
    }

    fn their_move(&mut self, motion: &PairMotion, before_m: f64, range_m: f64) {
        if !self.hypotheses.is_empty() {
            for one in &mut self.hypotheses {
                one.at = motion.carried(&one.at);
                one.misfit_m2 += (one.at.position_m.norm() - range_m).powi(2);
            }
            return;
        }
        let Some(own_flips) = self.own_flips else {
            return;
        };
        // This robot stands still and turns on the spot at most: the neighbour's triangle has its corner here.
        let triangle = Triangle::new(&motion.theirs, before_m, range_m);
        for own_rad in own_flips {
            for flip in [1.0, -1.0] {
                let bearing_rad = own_rad + flip * triangle.apex_rad - motion.own.rotation_rad;
                let back_rad = triangle.bearing_after(flip);
                self.hypotheses.push(Hypothesis {
                    at: Relative {
                        position_m: range_m * ahead(bearing_rad),
                        orientation_rad: wrapped(bearing_rad - back_rad - PI),
                    },
                    misfit_m2: 0.0,
                });
            }
        }
        self.rounds = 0;
        self.own_flips = None;
    }

    /// What is known, after motions that make no triangle.
    fn carry(&mut self, motion: &PairMotion) {
        for one in &mut self.hypotheses {
            one.at = motion.carried(&one.at);
        }
        // A flip is of a robot that has stood still since.
        self.own_flips = match self.own_flips {
            Some(flips) if motion.translation_m() < MOVE_MIN_M => {
                Some(flips.map(|bearing_rad| bearing_rad - motion.own.rotation_rad))
            }
            _ => None,
        };
    }

    fn resolve(&mut self, range_m: f64) {
        if self.hypotheses.len() < 2 {
            return;
        }
        self.rounds += 1;
        if self.rounds > RESOLVING_ROUNDS
            && let Some(at) = self.estimate()
        {
            self.hypotheses.clear();
            self.hypotheses.push(Hypothesis {
                at,
                misfit_m2: (at.position_m.norm() - range_m).powi(2),
            });
        }
    }
}

/// The angle in (-pi, pi].
fn wrapped(angle_rad: f64) -> f64 {
    Rotation2::new(angle_rad).angle()
}

fn ahead(bearing_rad: f64) -> Vector2<f64> {
    Vector2::new(bearing_rad.cos(), bearing_rad.sin())
}

#[cfg(test)]
mod tests;
