//! The prediction of a mode against what small disturbances do.

use super::*;
use crate::ranging::trilateration::Turtle;

fn moved(motion: &PairMotion, at: &Relative) -> Vector3<f64> {
    let after = motion.carried(at);
    Vector3::new(
        after.position_m.x,
        after.position_m.y,
        after.orientation_rad,
    )
}

#[test]
fn a_prediction_spreads_as_disturbed_states_and_odometries_do() {
    const STEP: f64 = 1e-6;
    let at = Relative {
        position_m: Vector2::new(3.0, -2.0),
        orientation_rad: 0.7,
    };
    let motion = PairMotion {
        own: Turtle {
            translation_m: Vector2::new(1.0, 0.4),
            rotation_rad: 0.3,
        },
        theirs: Turtle {
            translation_m: Vector2::new(0.5, -0.8),
            rotation_rad: -0.2,
        },
    };
    let noise = Noise {
        range_sigma_m: 0.1,
        translation_sigma_m: 0.05,
        rotation_sigma_rad: 0.4,
    };
    let start = Matrix3::new(0.5, 0.1, 0.05, 0.1, 0.3, -0.02, 0.05, -0.02, 0.2);
    let mut mode = Mode {
        at,
        covariance: start,
        log_weight: 0.0,
    };
    mode.predict(&motion, &noise);

    let centre = moved(&motion, &at);
    let by = |motion: &PairMotion, at: &Relative| (moved(motion, at) - centre) / STEP;
    let mut f = Matrix3::zeros();
    for axis in 0..3 {
        let mut other = at;
        match axis {
            2 => other.orientation_rad += STEP,
            _ => other.position_m[axis] += STEP,
        }
        f.set_column(axis, &by(&motion, &other));
    }
    let mut expected = f * start * f.transpose();
    for who in 0..2 {
        for part in 0..3 {
            let mut other = motion;
            let turtle = if who == 0 {
                &mut other.own
            } else {
                &mut other.theirs
            };
            let sigma = match part {
                2 => {
                    turtle.rotation_rad += STEP;
                    noise.rotation_sigma_rad
                }
                _ => {
                    turtle.translation_m[part] += STEP;
                    noise.translation_sigma_m
                }
            };
            let g = by(&other, &at);
            expected += sigma.powi(2) * g * g.transpose();
        }
    }
    let off = (mode.covariance - expected).amax();
    assert!(off < 1e-5, "{off}: {} {expected}", mode.covariance);
}
