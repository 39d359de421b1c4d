//! All located neighbours in one Kalman filter: position, velocity and relative yaw of each in the own level frame, and how
//! they hang together.
//!
//! What one neighbour sees of another says something of both, and of the scale; given to separate filters the same
//! information would be counted again and again and the scales would diverge.

use super::relative::{
    ACCELERATION_M_S2, Bend, STATES, Vector7, YAW_STEP_RAD, corrected, line, moved, own_yaw_bend,
    spread,
};
use super::sight::{CHANCE_MIN, FEATURE_WIDENED, GATE, NONE_WEIGHT, SOFTENED_MAX, Sight};
use crate::mutual::assignment::assign;
use crate::mutual::direction::{difference, turned};
use crate::mutual::feature_set::Motion;
use crate::mutual::located::Reduced;
use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, Vector2};

/// What a sight may cost in all.
const COST_MAX: f64 = 19.8;
/// What it costs that a neighbour is not seen.
const MISSED_COST: f64 = 13.8;
/// Standard deviations of a neighbour that comes in: of the distance (relative), across (rad), velocity (m/s), yaw (rad).
const START_RADIAL: f64 = 0.4;
const START_ACROSS_RAD: f64 = 0.07;
const START_VELOCITY_M_S: f64 = 0.8;
const START_YAW_RAD: f64 = 0.07;

/// The filter. Talkers are given by their index, 0 being the own vehicle.
#[derive(Clone, Debug)]
pub(super) struct JointFilter {
    members: Vec<Member>,
    covariance: DMatrix<f64>,
    /// Correction of all states that is not applied yet.
    step: DVector<f64>,
}

#[derive(Clone, Debug)]
struct Member {
    talker: usize,
    state: Reduced,
}

/// One possible explanation of a sight.
struct Innovation {
    /// Members whose states it bends with; at most two.
    bends: [Option<(usize, Bend)>; 2],
    /// From the states as they were predicted.
    residual: Vector2<f64>,
    sight_variance: f64,
    squared_distance: f64,
    cost: f64,
}

impl JointFilter {
    pub(super) fn new() -> Self {
        Self {
            members: Vec::new(),
            covariance: DMatrix::zeros(0, 0),
            step: DVector::zeros(0),
        }
    }

    /// Where a talker is.
    pub(super) fn state(&self, talker: usize) -> Option<Reduced> {
        self.at(talker).map(|at| self.members[at].state)
    }

    /// Covariance of that: position, velocity, yaw.
    pub(super) fn covariance(&self, talker: usize) -> Option<SMatrix<f64, STATES, STATES>> {
        let at = self.at(talker)? * STATES;
        Some(
            self.covariance
                .fixed_view::<STATES, STATES>(at, at)
                .into_owned(),
        )
    }

    /// Takes a talker in that is not yet.
    pub(super) fn insert(&mut self, talker: usize, state: Reduced) {
        let at = self.members.len() * STATES;
        let before = std::mem::replace(
            &mut self.covariance,
            DMatrix::zeros(at + STATES, at + STATES),
        );
        self.covariance
            .view_mut((0, 0), (at, at))
            .copy_from(&before);
        self.covariance
            .fixed_view_mut::<STATES, STATES>(at, at)
            .copy_from(&spread(
                &state.position_m,
                START_RADIAL,
                START_ACROSS_RAD,
                START_VELOCITY_M_S,
                START_YAW_RAD,
            ));
        self.step = DVector::zeros(at + STATES);
        self.members.push(Member { talker, state });
    }

    /// Lets a talker go.
    pub(super) fn remove(&mut self, talker: usize) {
        let Some(at) = self.at(talker) else { return };
        self.members.remove(at);
        let before = std::mem::replace(&mut self.covariance, DMatrix::zeros(0, 0));
        self.covariance = before
            .remove_rows(at * STATES, STATES)
            .remove_columns(at * STATES, STATES);
        self.step = DVector::zeros(self.members.len() * STATES);
    }

    /// A talker is no more, and those after it count one less.
    pub(super) fn forget(&mut self, talker: usize) {
        self.remove(talker);
        for member in self
            .members
            .iter_mut()
            .filter(|member| member.talker > talker)
        {
            member.talker -= 1;
        }
    }

    /// All have moved for `dt_s`. By talker, `motions` is how, and `unheard` what is not known of it beyond the usual noise:
    /// variances of velocity (m^2/s^2) and yaw (rad^2).
    pub(super) fn predict(&mut self, dt_s: f64, motions: &[Motion], unheard: &[(f64, f64)]) {
        let bends: Vec<_> = self
            .members
            .iter_mut()
            .map(|member| {
                let (state, bend) =
                    moved(&member.state, dt_s, &motions[0], &motions[member.talker]);
                member.state = state;
                bend
            })
            .collect();
        self.carry(&bends);
        let velocity = (ACCELERATION_M_S2 * dt_s).powi(2);
        let yaw = YAW_STEP_RAD * YAW_STEP_RAD;
        let turns: Vec<Vector7> = self
            .members
            .iter()
            .map(|member| own_yaw_bend(&member.state))
            .collect();
        for i in 0..self.members.len() {
            for j in 0..self.members.len() {
                let mut block = self
                    .covariance
                    .fixed_view_mut::<STATES, STATES>(i * STATES, j * STATES);
                block += turns[i] * turns[j].transpose() * yaw;
                for axis in 3..6 {
                    block[(axis, axis)] += if i == j { velocity } else { 0.5 * velocity };
                }
                if i == j {
                    let (unheard_velocity, unheard_yaw) = unheard[self.members[i].talker];
                    for axis in 3..6 {
                        block[(axis, axis)] += unheard_velocity;
                    }
                    block[(6, 6)] += yaw + unheard_yaw;
                }
            }
        }
    }

    /// Takes what one talker saw `age_s` ago. Each feature goes to at most one neighbour and each neighbour to at most one
    /// feature. Gives for each sight the neighbour it is held to be and the probability of that.
    pub(super) fn observe(
        &mut self,
        observer: usize,
        age_s: f64,
        sights: &[Sight],
    ) -> Vec<Option<(usize, f64)>> {
        let mut held = vec![None; sights.len()];
        if observer != 0 && self.at(observer).is_none() {
            return held;
        }
        let own = (observer != 0).then_some(0);
        let others = self
            .members
            .iter()
            .map(|member| member.talker)
            .filter(|talker| *talker != observer);
        let targets: Vec<usize> = own.into_iter().chain(others).collect();
        let innovations: Vec<Vec<Option<Innovation>>> = targets
            .iter()
            .map(|target| {
                sights
                    .iter()
                    .map(|sight| self.innovation(observer, *target, age_s, sight))
                    .collect()
            })
            .collect();
        let cost = |target: usize, sight: usize| {
            innovations[target][sight]
                .as_ref()
                .map_or(f64::INFINITY, |innovation| innovation.cost)
        };
        let assigned = assign(targets.len(), sights.len(), MISSED_COST, cost);
        for (target, sight) in assigned.iter().enumerate() {
            let Some(sight) = *sight else { continue };
            let Some(innovation) = &innovations[target][sight] else {
                continue;
            };
            let other_sights = (0..sights.len())
                .filter(|other| *other != sight)
                .map(|other| cost(target, other));
            let other_targets = (0..targets.len())
                .filter(|other| *other != target)
                .map(|other| cost(other, sight));
            let rivals: f64 = other_sights
                .chain(other_targets)
                .map(|other| (-0.5 * (other - innovation.cost)).exp())
                .sum();
            let chances = &sights[sight].chances;
            let chance = chances[targets[target]].max(CHANCE_MIN);
            let none = (1.0 - chances.iter().sum::<f64>()).max(CHANCE_MIN);
            let doubt = NONE_WEIGHT * none / chance;
            // The farther off, the rather it is something else that is anywhere.
            let unlikely = doubt * (0.5 * innovation.squared_distance).exp();
            held[sight] = Some((targets[target], 1.0 / (1.0 + rivals + unlikely)));
            let softened = (1.0 + rivals + doubt).min(SOFTENED_MAX);
            self.take(innovation, softened);
        }
        held
    }

    /// Applies the corrections of all sights of one instant.
    pub(super) fn settle(&mut self) {
        let step = std::mem::replace(&mut self.step, DVector::zeros(self.members.len() * STATES));
        for (at, member) in self.members.iter_mut().enumerate() {
            let step = step.fixed_rows::<STATES>(at * STATES).into_owned();
            member.state = corrected(&member.state, &step);
        }
    }

    fn at(&self, talker: usize) -> Option<usize> {
        self.members
            .iter()
            .position(|member| member.talker == talker)
    }

    /// Covariance through one matrix per member. What rounding makes unsymmetric would grow from step to step.
    fn carry(&mut self, bends: &[SMatrix<f64, STATES, STATES>]) {
        for i in 0..bends.len() {
            for j in 0..=i {
                let (row, column) = (i * STATES, j * STATES);
                let block = self
                    .covariance
                    .fixed_view::<STATES, STATES>(row, column)
                    .into_owned();
                let mut carried = bends[i] * block * bends[j].transpose();
                if i == j {
                    carried = (carried + carried.transpose()) * 0.5;
                }
                self.covariance
                    .fixed_view_mut::<STATES, STATES>(column, row)
                    .copy_from(&carried.transpose());
                self.covariance
                    .fixed_view_mut::<STATES, STATES>(row, column)
                    .copy_from(&carried);
            }
        }
    }

    fn innovation(
        &self,
        observer: usize,
        target: usize,
        age_s: f64,
        sight: &Sight,
    ) -> Option<Innovation> {
        let (from, to) = (self.at(observer), self.at(target));
        let then = |at: Option<usize>| {
            at.map_or_else(nalgebra::Vector3::zeros, |at| {
                let state = &self.members[at].state;
                state.position_m - state.velocity_m_s * age_s
            })
        };
        let line = line(&(then(to) - then(from)));
        let bend = |sign: f64, heading: bool| {
            let mut bend = Bend::zeros();
            bend.fixed_view_mut::<2, 3>(0, 0)
                .copy_from(&(line.per_metre * sign));
            bend.fixed_view_mut::<2, 3>(0, 3)
                .copy_from(&(line.per_metre * (-sign * age_s)));
            if heading {
                bend.set_column(6, &line.per_heading);
            }
            bend
        };
        let bends = [
            from.map(|at| (at, bend(-1.0, true))),
            to.map(|at| (at, bend(1.0, false))),
        ];
        let heading_rad = from.map_or(0.0, |at| self.members[at].state.yaw_rad);
        let residual = difference(&line.direction, &turned(&sight.direction, heading_rad));
        let mut left = residual;
        let sight_variance = FEATURE_WIDENED * sight.variance_rad2;
        let mut variance = Matrix2::identity() * sight_variance;
        for (at, bend) in bends.iter().flatten() {
            left -= bend * self.step.fixed_rows::<STATES>(at * STATES);
            for (other, other_bend) in bends.iter().flatten() {
                let block = self
                    .covariance
                    .fixed_view::<STATES, STATES>(at * STATES, other * STATES);
                variance += bend * block * other_bend.transpose();
            }
        }
        let squared_distance = left.dot(&(variance.try_inverse()? * left));
        let spread = (variance.determinant() / (sight_variance * sight_variance)).max(1.0);
        let cost =
            squared_distance + spread.ln() - 2.0 * sight.chances[target].max(CHANCE_MIN).ln();
        (squared_distance < GATE && cost < COST_MAX).then_some(Innovation {
            bends,
            residual,
            sight_variance,
            squared_distance,
            cost,
        })
    }

    fn take(&mut self, innovation: &Innovation, softened: f64) {
        let states = self.covariance.nrows();
        let mut across = nalgebra::OMatrix::<f64, nalgebra::Dyn, nalgebra::U2>::zeros(states);
        let mut residual = innovation.residual;
        let mut variance = Matrix2::identity() * (innovation.sight_variance * softened);
        for (at, bend) in innovation.bends.iter().flatten() {
            across += self.covariance.columns(at * STATES, STATES) * bend.transpose();
            residual -= bend * self.step.fixed_rows::<STATES>(at * STATES);
        }
        for (at, bend) in innovation.bends.iter().flatten() {
            variance += bend * across.rows(at * STATES, STATES);
        }
        let Some(inverse) = variance.try_inverse() else {
            return;
        };
        let gain = &across * inverse;
        self.step += &gain * residual;
        self.covariance.gemm(-1.0, &gain, &across.transpose(), 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::flight::Flight;
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const TEAM: [[f64; 3]; 3] = [[0.0, 0.0, 2.0], [3.0, -1.0, 3.0], [1.0, 3.0, 1.5]];
    const DT_S: f64 = 0.05;

    /// Both neighbours of robot 0 in the filter, thought half as far again as they are.
    fn started(flight: &Flight) -> JointFilter {
        let mut filter = JointFilter::new();
        for robot in 1..TEAM.len() {
            let truth = flight.relative(0, robot, 0.0);
            filter.insert(
                robot,
                Reduced {
                    position_m: truth.position_m * 1.5,
                    ..truth
                },
            );
        }
        filter
    }

    fn sights(flight: &mut Flight, observer: usize, t_s: f64) -> Vec<Sight> {
        let set = flight.set(observer, t_s);
        let others: Vec<usize> = (0..TEAM.len()).filter(|other| *other != observer).collect();
        let sight = |(feature, other): (&crate::mutual::Feature, &usize)| Sight {
            direction: feature.direction,
            variance_rad2: feature.sigma_rad.powi(2),
            chances: (0..TEAM.len())
                .map(|robot| if robot == *other { 0.95 } else { 0.02 })
                .collect(),
        };
        set.features.iter().zip(&others).map(sight).collect()
    }

    fn fly(
        flight: &mut Flight,
        filter: &mut JointFilter,
        observers: &[usize],
        until_s: f64,
    ) -> f64 {
        let mut t_s = 0.0;
        while t_s < until_s {
            let next_s = t_s + DT_S;
            let motions: Vec<Motion> = (0..TEAM.len())
                .map(|robot| {
                    flight
                        .inertial(robot, next_s)
                        .since(&flight.inertial(robot, t_s))
                })
                .collect();
            filter.predict(DT_S, &motions, &[(0.0, 0.0); TEAM.len()]);
            for observer in observers {
                let held = filter.observe(*observer, 0.0, &sights(flight, *observer, next_s));
                assert_eq!(held.len(), TEAM.len() - 1);
            }
            filter.settle();
            t_s = next_s;
        }
        t_s
    }

    fn distance_variance(filter: &JointFilter, robot: usize) -> f64 {
        let outward = filter
            .state(robot)
            .expect("it is in")
            .position_m
            .normalize();
        let covariance = filter.covariance(robot).expect("it is in");
        (outward.transpose() * covariance.fixed_view::<3, 3>(0, 0) * outward)[0]
    }

    #[test]
    fn distances_come_from_the_motion_of_all() {
        let mut flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(2));
        let mut filter = started(&flight);
        let t_s = fly(&mut flight, &mut filter, &[0, 1, 2], 15.0);
        for robot in 1..TEAM.len() {
            let (held, truth) = (
                filter.state(robot).expect("it is in"),
                flight.relative(0, robot, t_s),
            );
            let off = (held.position_m - truth.position_m).norm() / truth.position_m.norm();
            assert!(off < 0.12, "robot {robot}: {off}");
        }
        assert!(filter.covariance.clone().cholesky().is_some());
    }

    #[test]
    fn what_neighbours_see_of_each_other_helps() {
        let knowing = |observers: &[usize]| {
            let mut flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(2));
            let mut filter = started(&flight);
            let _ = fly(&mut flight, &mut filter, observers, 5.0);
            distance_variance(&filter, 1)
        };
        assert!(knowing(&[0, 1, 2]) < 0.8 * knowing(&[0]));
    }

    #[test]
    fn who_is_let_go_leaves_the_others_as_they_were() {
        let flight = Flight::new(&TEAM, 3, 0.05, ChaCha8Rng::seed_from_u64(3));
        let mut filter = started(&flight);
        let (state, covariance) = (filter.state(2), filter.covariance(2));
        filter.forget(1);
        assert_eq!((filter.state(1), filter.covariance(1)), (state, covariance));
        assert_eq!(filter.state(2), None);
    }
}
