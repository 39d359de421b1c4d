//! How far answers are off: one trial's sums, and what all trials together say. Rounds of one trial and both of its robots
//! go together; trials do not: standard errors are those of trials.

use super::bound::{self, LeastSquares};
use super::localiser::{Answer, Method};
use super::pair::{Pair, Round};
use crate::experiment::ranging::trilateration::error;
use crate::planar_swarm::wrapped_rad;
use crate::statistics::ratio_and_stderr;
use nalgebra::{Matrix3, RowVector3, Vector2, Vector3};

/// One answer that is scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scored {
    /// How far the position is off (m).
    pub off_m: f64,
    /// How far the orientation is off (rad), from 0 to pi.
    pub off_rad: f64,
    /// What it could have been.
    pub least: LeastSquares,
    /// The error squared over its covariance, for those who tell one: of distance, bearing and orientation.
    pub square: Option<f64>,
}

/// What one method did in one trial, both robots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trial {
    /// Rounds in which it might have answered.
    pub asked: usize,
    /// Its answers.
    pub answers: Vec<Scored>,
}

impl Trial {
    /// Both robots of a pair.
    #[must_use]
    pub fn of(method: Method, pair: &Pair) -> Self {
        let mut trial = Self::default();
        for pair in [pair, &pair.seen_by_the_other()] {
            let bounds = method.bound(pair);
            let rounds = pair.rounds.iter().zip(method.answers(pair)).zip(bounds);
            for ((round, answer), information) in rounds.skip(method.scored_from()) {
                trial.asked += 1;
                if let (Some(answer), Some(information)) = (answer, information) {
                    trial.answers.push(scored(round, &answer, &information));
                }
            }
        }
        trial
    }

    /// The sum of something over its answers.
    #[must_use]
    pub fn sum(&self, of: impl Fn(&Scored) -> f64) -> f64 {
        self.answers.iter().map(of).sum()
    }
}

fn scored(round: &Round, answer: &Answer, information: &Matrix3<f64>) -> Scored {
    let truth = round.places[1].seen_from(&round.places[0]);
    let (off_m, off_rad) = error(&answer.at, &truth);
    // What distances leave open is a piece of a circle, along which a covariance of x and y is only the tangent.
    let square = answer.covariance.and_then(|covariance| {
        let estimate_m = answer.at.position_m;
        let distance_m = estimate_m.norm();
        let along = estimate_m / distance_m;
        let bearing_rad = |vector: &Vector2<f64>| vector.y.atan2(vector.x);
        let off = Vector3::new(
            truth.position_m.norm() - distance_m,
            wrapped_rad(bearing_rad(&truth.position_m) - bearing_rad(&estimate_m)),
            wrapped_rad(truth.heading_rad - answer.at.orientation_rad),
        );
        let polar_by_position = Matrix3::from_rows(&[
            RowVector3::new(along.x, along.y, 0.0),
            RowVector3::new(-along.y, along.x, 0.0) / distance_m,
            RowVector3::new(0.0, 0.0, 1.0),
        ]);
        let polar = polar_by_position * covariance * polar_by_position.transpose();
        Some(off.dot(&polar.cholesky()?.solve(&off)))
    });
    Scored {
        off_m,
        off_rad,
        least: bound::least_squares(information, &round.places),
        square,
    }
}

/// The mean of something over all answers of all trials, and its standard error.
#[must_use]
pub fn mean(trials: &[Trial], of: impl Fn(&Scored) -> f64) -> (f64, f64) {
    let sums = trials
        .iter()
        .map(|trial| trial.sum(&of))
        .collect::<Vec<_>>();
    let counts = trials.iter().map(|trial| trial.answers.len() as f64);
    ratio_and_stderr(&sums, &counts.collect::<Vec<_>>())
}

/// The mean of something over that of another thing of the same answers, and its standard error.
#[must_use]
pub fn ratio(
    trials: &[Trial],
    of: impl Fn(&Scored) -> f64,
    to: impl Fn(&Scored) -> f64,
) -> (f64, f64) {
    let sums = trials
        .iter()
        .map(|trial| trial.sum(&of))
        .collect::<Vec<_>>();
    let others = trials
        .iter()
        .map(|trial| trial.sum(&to))
        .collect::<Vec<_>>();
    ratio_and_stderr(&sums, &others)
}

/// The median over all answers that have such a number; NaN of none.
#[must_use]
pub fn median(trials: &[Trial], of: impl Fn(&Scored) -> Option<f64>) -> f64 {
    let mut all: Vec<f64> = trials
        .iter()
        .flat_map(|trial| trial.answers.iter().filter_map(&of))
        .collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::ranging::errors::pair::Turns;
    use crate::planar_swarm::{PlanarMotion, PlanarPose, SwarmNoise};
    use crate::streams::Streams;
    use nalgebra::Rotation2;
    use skein_estimation::ranging::trilateration::Relative;

    #[test]
    fn an_error_along_the_circle_is_measured_along_it() {
        let place = |x: f64, y: f64, heading_rad: f64| PlanarPose {
            position_m: Vector2::new(x, y),
            heading_rad,
        };
        let still = PlanarMotion {
            translation_m: Vector2::zeros(),
            rotation_rad: 0.0,
        };
        let round = Round {
            places: [place(1.0, 2.0, 0.3), place(13.0, 18.0, 1.0)],
            motions: [still; 2],
            range_m: 20.0,
        };
        let truth = round.places[1].seen_from(&round.places[0]);
        // Half a radian around, and a fifth turned, both one standard deviation; the distance is right.
        let position_m = Rotation2::new(0.5) * truth.position_m;
        let along = position_m / 20.0;
        let across = Vector2::new(-along.y, along.x);
        let planar = along * along.transpose() * 0.01 + across * across.transpose() * 100.0;
        let mut covariance = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 0.04));
        covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&planar);
        let answer = Answer {
            at: Relative {
                position_m,
                orientation_rad: truth.heading_rad + 0.2,
            },
            covariance: Some(covariance),
        };
        let scored = scored(&round, &answer, &Matrix3::identity());
        assert!((scored.square.unwrap() - 2.0).abs() < 1e-9, "{scored:?}");
        assert!((scored.off_m - 40.0 * 0.25_f64.sin()).abs() < 1e-9);
        assert!((scored.off_rad - 0.2).abs() < 1e-9);
    }

    #[test]
    fn who_does_not_answer_is_counted_and_otherwise_left_out() {
        let mut pair = Pair::gone(Turns::Together, 20, SwarmNoise::USUAL, &Streams::new(1, 0));
        let both = Trial::of(Method::Bank(6), &pair);
        assert_eq!((both.asked, both.answers.len()), (28, 28));
        // Who never moves is nowhere in particular.
        let start = pair.rounds[0];
        pair.rounds.fill(start);
        let neither = Trial::of(Method::Bank(6), &pair);
        assert_eq!((neither.asked, neither.answers.len()), (28, 0));
        let (mean_m, _) = mean(&[both.clone(), neither], |one| one.off_m);
        assert!((mean_m - both.sum(|one| one.off_m) / 28.0).abs() < 1e-9);
    }
}
