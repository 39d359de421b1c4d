//! How the reduced relative pose of a neighbour moves, how sights bend with it, and how it is corrected.
//!
//! Equations of motion: Cognetti et al., eq. 18 to 22, corrected. With `Z` the turn by minus the own yaw step,
//! `p <- Z (p + v dt + R(psi) dP_j - dP_i)`, `v <- Z (v + R(psi) dV_j - dV_i)`, `psi <- psi + dpsi_j - dpsi_i`, where dV and
//! dP are what the inertial sensors integrated: exact for any motion within the step.

use crate::mutual::direction::tangents;
use crate::mutual::feature_set::Motion;
use crate::mutual::located::Reduced;
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, UnitVector3, Vector3};

/// States of one neighbour: position (m), velocity (m/s), relative yaw (rad).
pub(super) const STATES: usize = 7;
pub(super) type Matrix7 = SMatrix<f64, STATES, STATES>;
pub(super) type Vector7 = SVector<f64, STATES>;
/// How a sight's two residuals bend with one neighbour's states.
pub(super) type Bend = SMatrix<f64, 2, STATES>;

/// Noise of the relative acceleration (m/s^2), as a step of the velocity at each image. Half of its square is the own
/// vehicle's, and so common to all neighbours.
pub(super) const ACCELERATION_M_S2: f64 = 0.4;
/// Noise of each yaw step of one vehicle (rad).
pub(super) const YAW_STEP_RAD: f64 = 0.15 * std::f64::consts::PI / 180.0;
/// Least distance at which a direction is defined (m).
const DISTANCE_MIN_M: f64 = 0.05;

fn turn(yaw_rad: f64) -> Matrix3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad).into_inner()
}

/// The state after both have moved for `dt_s`, and how it bends with the state before.
pub(super) fn moved(
    state: &Reduced,
    dt_s: f64,
    own: &Motion,
    neighbour: &Motion,
) -> (Reduced, Matrix7) {
    let back = turn(-own.yaw_rad);
    let facing = turn(state.yaw_rad);
    let (step, faster) = (
        facing * neighbour.position_m,
        facing * neighbour.velocity_m_s,
    );
    let after = Reduced {
        position_m: back * (state.position_m + state.velocity_m_s * dt_s + step - own.position_m),
        velocity_m_s: back * (state.velocity_m_s + faster - own.velocity_m_s),
        yaw_rad: state.yaw_rad + neighbour.yaw_rad - own.yaw_rad,
    };
    let mut bend = Matrix7::identity();
    bend.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
    bend.fixed_view_mut::<3, 3>(0, 3).copy_from(&(back * dt_s));
    bend.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
    bend.fixed_view_mut::<3, 1>(0, 6)
        .copy_from(&(back * Vector3::z().cross(&step)));
    bend.fixed_view_mut::<3, 1>(3, 6)
        .copy_from(&(back * Vector3::z().cross(&faster)));
    (after, bend)
}

/// What an error of the own yaw step (rad) does to a neighbour's state.
pub(super) fn own_yaw_bend(state: &Reduced) -> Vector7 {
    let (p, v) = (&state.position_m, &state.velocity_m_s);
    Vector7::from_column_slice(&[p.y, -p.x, 0.0, v.y, -v.x, 0.0, -1.0])
}

/// A direction from one place to another and how it bends with where the two are.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) direction: UnitVector3<f64>,
    /// Along the two [`tangents`] of the direction, per metre that the target moves.
    pub(super) per_metre: SMatrix<f64, 2, 3>,
    /// Along the two tangents, per radian that the observer's heading is greater than thought.
    pub(super) per_heading: nalgebra::Vector2<f64>,
}

/// The line along `offset` (m), from the observer to what it sees.
pub(super) fn line(offset: &Vector3<f64>) -> Line {
    let distance_m = offset.norm().max(DISTANCE_MIN_M);
    let direction = UnitVector3::try_new(*offset, 1e-9).unwrap_or_else(Vector3::x_axis);
    let across = tangents(&direction);
    let per_metre = SMatrix::<f64, 2, 3>::from_rows(&[
        (across[0] / distance_m).transpose(),
        (across[1] / distance_m).transpose(),
    ]);
    Line {
        direction,
        per_metre,
        per_heading: nalgebra::Vector2::new(-direction.x.hypot(direction.y), 0.0),
    }
}

/// The state corrected by `step`. Plain sums: in coordinates of direction and logarithm of distance (modified polar), the
/// distances of teams in flight came out twice as far off.
pub(super) fn corrected(state: &Reduced, step: &Vector7) -> Reduced {
    Reduced {
        position_m: state.position_m + step.fixed_rows::<3>(0),
        velocity_m_s: state.velocity_m_s + step.fixed_rows::<3>(3),
        yaw_rad: state.yaw_rad + step[6],
    }
}

/// Covariance of a neighbour in a known direction at an unsure distance: relative standard deviation of the distance,
/// angle across (rad), velocity (m/s) and yaw (rad).
pub(super) fn spread(
    position_m: &Vector3<f64>,
    radial: f64,
    across_rad: f64,
    velocity_m_s: f64,
    yaw_rad: f64,
) -> Matrix7 {
    let along = position_m * position_m.transpose();
    let square = position_m.norm_squared();
    let mut spread = Matrix7::zeros();
    spread.fixed_view_mut::<3, 3>(0, 0).copy_from(
        &(along * (radial * radial)
            + (Matrix3::identity() * square - along) * (across_rad * across_rad)),
    );
    spread
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(Matrix3::identity() * velocity_m_s * velocity_m_s));
    spread[(6, 6)] = yaw_rad * yaw_rad;
    spread
}

#[cfg(test)]
mod tests {
    use super::super::flight::Flight;
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn flat(state: &Reduced) -> Vector7 {
        let (p, v) = (&state.position_m, &state.velocity_m_s);
        Vector7::from_column_slice(&[p.x, p.y, p.z, v.x, v.y, v.z, state.yaw_rad])
    }

    fn state(flat: &Vector7) -> Reduced {
        Reduced {
            position_m: flat.fixed_rows::<3>(0).into_owned(),
            velocity_m_s: flat.fixed_rows::<3>(3).into_owned(),
            yaw_rad: flat[6],
        }
    }

    /// Columns of central differences.
    fn numeric(at: &Vector7, of: impl Fn(&Vector7) -> Vector7) -> Matrix7 {
        const STEP: f64 = 1e-6;
        let mut bend = Matrix7::zeros();
        for column in 0..STATES {
            let mut step = Vector7::zeros();
            step[column] = STEP;
            bend.set_column(
                column,
                &((of(&(at + step)) - of(&(at - step))) / (2.0 * STEP)),
            );
        }
        bend
    }

    fn motion(numbers: &[f64]) -> Motion {
        Motion {
            elapsed_s: 0.05,
            yaw_rad: numbers[0],
            velocity_m_s: Vector3::from_column_slice(&numbers[1..4]),
            position_m: Vector3::from_column_slice(&numbers[4..7]),
        }
    }

    #[test]
    fn without_noise_a_neighbour_is_followed_exactly_whatever_the_step() {
        let flight = Flight::new(
            &[[0.0, 0.0, 2.0], [3.0, -1.0, 3.0]],
            2,
            0.0,
            ChaCha8Rng::seed_from_u64(0),
        );
        let mut held = flight.relative(0, 1, 0.0);
        let steps = [0.05, 0.4, 0.05, 0.7];
        let mut t_s = 0.0;
        for step_s in steps.iter().cycle().take(60) {
            let next_s = t_s + step_s;
            let moves = |robot| {
                flight
                    .inertial(robot, next_s)
                    .since(&flight.inertial(robot, t_s))
            };
            held = moved(&held, *step_s, &moves(0), &moves(1)).0;
            t_s = next_s;
        }
        let truth = flight.relative(0, 1, t_s);
        assert!(
            (flat(&held) - flat(&truth)).norm() < 1e-9,
            "{held:?} {truth:?}"
        );
    }

    proptest! {
        #[test]
        fn motion_bends_as_differences_say(
            at in prop::array::uniform7(-3.0..3.0f64),
            own in prop::array::uniform7(-0.5..0.5f64),
            other in prop::array::uniform7(-0.5..0.5f64),
        ) {
            let at = Vector7::from_column_slice(&at);
            let (own, other) = (motion(&own), motion(&other));
            let bend = moved(&state(&at), 0.05, &own, &other).1;
            let differences = numeric(&at, |flat_state| flat(&moved(&state(flat_state), 0.05, &own, &other).0));
            prop_assert!((bend - differences).norm() < 1e-6, "{}", bend - differences);
        }

        #[test]
        fn sights_bend_as_differences_say(offset in prop::array::uniform3(-3.0..3.0f64), step in prop::array::uniform3(-1.0..1.0f64), turn in -1.0..1.0f64) {
            use crate::mutual::direction::{difference, turned};
            let (offset, step) = (Vector3::from(offset), Vector3::from(step) * 1e-5);
            prop_assume!(offset.norm() > 0.3 && offset.xy().norm() > 0.05);
            let here = line(&offset);
            let seen = UnitVector3::new_normalize(offset + step);
            prop_assert!((difference(&here.direction, &seen) - here.per_metre * step).norm() < 1e-8);
            // The sight is told in the observer's frame: thought to head further round, the same place lies further back.
            let told = turned(&here.direction, -turn * 1e-5);
            prop_assert!((difference(&here.direction, &told) - here.per_heading * (turn * 1e-5)).norm() < 1e-8);
        }
    }
}
