//! Levenberg-Marquardt on all poses of a team. An error of one robot's odometry is in all its ranges before, whomever
//! they are to: in the end the residuals are weighed by their whole covariance.

use super::search::is_same_place;
use super::{ANSWERS_MAX, Formation, Placed, Team};
use crate::ranging::pose::{Dimension, RelativePose, turned};
use crate::ranging::trail::Past;
use crate::ranging::window::{Loss, WindowSettings};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};

/// By robot, where it is in the level frame of robot 0; none while it is not placed.
pub(super) type Poses = Vec<Option<RelativePose>>;

/// Iterations with ranges apart while formations are put together, and with all together in the end.
const ITERATIONS: (usize, usize) = (6, 12);
/// A step that changes the cost by less than this ends a descent.
const NEGLIGIBLE: f64 = 1e-4;
/// Formations that cost so much more than the best with ranges apart are not among the best with all together.
const WORTH: f64 = 50.0;
/// A pose is a position and a yaw.
const PER_ROBOT: usize = 4;

/// A range, ready to be compared with poses.
struct Tie {
    ends: [usize; 2],
    past: [Past; 2],
    range_m: f64,
    variance_m2: f64,
    apart_m2: f64,
}

/// What is descended on.
pub(super) struct Descent<'a> {
    settings: &'a WindowSettings,
    /// Oldest first.
    ties: Vec<Tie>,
    robots: usize,
}

/// A tie against poses: residual (m) and the direction (unit) from the one end to the other.
struct Seen {
    residual: f64,
    direction: Vector3<f64>,
    /// What turning each end moves its place by.
    turning: [Vector3<f64>; 2],
}

impl<'a> Descent<'a> {
    pub(super) fn new(team: &Team, settings: &'a WindowSettings) -> Self {
        let mut ties = Vec::new();
        for high in 1..team.now.len() {
            for low in 0..high {
                for sample in team.pair(low, high) {
                    let ends = [low, high];
                    let mut past = [
                        Past::of(&sample.own, &team.now[low]),
                        Past::of(&sample.neighbour, &team.now[high]),
                    ];
                    if settings.dimension == Dimension::Planar {
                        past[0].place_m.z = 0.0;
                        past[1].place_m.z = 0.0;
                    }
                    let variance_m2 = sample.variance_m2(settings.sigma_floor_m);
                    ties.push((
                        sample.taken,
                        Tie {
                            ends,
                            range_m: sample.range_m,
                            variance_m2,
                            apart_m2: variance_m2 + past[0].variance() + past[1].variance(),
                            past,
                        },
                    ));
                }
            }
        }
        ties.sort_by_key(|one| one.0);
        Self {
            settings,
            ties: ties.into_iter().map(|one| one.1).collect(),
            robots: team.now.len(),
        }
    }

    /// What all ranges between placed robots cost, each by itself.
    pub(super) fn cost(&self, poses: &Poses) -> f64 {
        let seen = self
            .ties
            .iter()
            .filter_map(|tie| Some((tie, tie.seen(poses)?)));
        seen.map(|(tie, seen)| self.loss(seen.residual.powi(2) / tie.apart_m2).0)
            .sum()
    }

    /// Brings the placed poses to a minimum of that cost, which is returned; infinite when numbers fail.
    pub(super) fn refine(&mut self, poses: &mut Poses) -> f64 {
        self.descend(poses, ITERATIONS.0, |descent, poses| {
            Some(descent.apart(poses))
        })
    }

    fn descend(
        &self,
        poses: &mut Poses,
        iterations: usize,
        linear: impl Fn(&Self, &Poses) -> Option<Linear>,
    ) -> f64 {
        let Some(mut here) = linear(self, poses) else {
            return f64::INFINITY;
        };
        let mut damping = 1e-4;
        for _ in 0..iterations {
            let Some(step) = here.step(damping) else {
                break;
            };
            let change = step.dot(&(&here.hessian * &step));
            let candidate = stepped(poses, &step);
            match linear(self, &candidate) {
                Some(there) if there.cost <= here.cost + NEGLIGIBLE => {
                    (*poses, here) = (candidate, there);
                    damping = (damping * 0.1).max(1e-9);
                    if change < NEGLIGIBLE {
                        break;
                    }
                }
                _ if change < 1e-2 => break,
                _ => damping *= 20.0,
            }
        }
        here.cost
    }

    /// The loss of a squared, normalised residual, and the weight that it leaves.
    fn loss(&self, square: f64) -> (f64, f64) {
        match self.settings.loss {
            Loss::Square => (square, 1.0),
            Loss::Redescending { sigmas } => {
                let scale = sigmas * sigmas;
                let left = scale / (scale + square);
                (left * square, left * left)
            }
        }
    }

    fn apart(&self, poses: &Poses) -> Linear {
        let mut linear = Linear::nothing(self.robots);
        for tie in &self.ties {
            let Some(seen) = tie.seen(poses) else {
                continue;
            };
            let square = seen.residual.powi(2) / tie.apart_m2;
            let (loss, weight) = self.loss(square);
            linear.cost += loss;
            linear.square += square;
            linear.ranges += 1;
            let rows = seen.rows(self.settings.dimension);
            for (a, end) in tie.ends.iter().enumerate() {
                for i in 0..PER_ROBOT {
                    let weighted = rows[a][i] * weight / tie.apart_m2;
                    linear.gradient[PER_ROBOT * end + i] += weighted * seen.residual;
                    for (b, other) in tie.ends.iter().enumerate() {
                        for (k, change) in rows[b].iter().enumerate() {
                            linear.hessian[(PER_ROBOT * end + i, PER_ROBOT * other + k)] +=
                                weighted * change;
                        }
                    }
                }
            }
        }
        linear.hold(poses, self.settings.dimension);
        linear
    }

    /// With the whole covariance; ranges that do not fit have the weights that they have apart.
    fn together(&self, poses: &Poses) -> Option<Linear> {
        let seen: Vec<(&Tie, Seen)> = self
            .ties
            .iter()
            .filter_map(|tie| Some((tie, tie.seen(poses)?)))
            .collect();
        let count = seen.len();
        let mut jacobian = DMatrix::zeros(count, PER_ROBOT * self.robots);
        let mut residual = DVector::zeros(count);
        let mut forgone = 0.0;
        let mut covariance = DMatrix::zeros(count, count);
        for (later, (tie, one)) in seen.iter().enumerate() {
            let square = one.residual.powi(2) / tie.apart_m2;
            let (loss, weight) = self.loss(square);
            forgone += loss - weight * square + weight.ln();
            residual[later] = one.residual;
            for (end, row) in tie.ends.iter().zip(one.rows(self.settings.dimension)) {
                for i in 0..PER_ROBOT {
                    jacobian[(later, PER_ROBOT * end + i)] = row[i];
                }
            }
            for (earlier, (other, its)) in seen[..=later].iter().enumerate() {
                let shared: f64 = (0..4)
                    .map(|which| {
                        let (a, b) = (which / 2, which % 2);
                        if tie.ends[a] != other.ends[b] {
                            return 0.0;
                        }
                        let yaw = poses[tie.ends[a]].map_or(0.0, |pose| pose.yaw_rad);
                        let sign = if a == b { 1.0 } else { -1.0 };
                        sign * other.past[b].covariance_along(
                            &turned(&its.direction, -yaw),
                            &tie.past[a],
                            &turned(&one.direction, -yaw),
                        )
                    })
                    .sum();
                covariance[(later, earlier)] = shared;
            }
            covariance[(later, later)] += tie.variance_m2 / weight;
        }
        let factor = Cholesky::<f64, Dyn>::new(covariance)?;
        let lower = factor.l_dirty();
        if !(lower.solve_lower_triangular_mut(&mut residual)
            && lower.solve_lower_triangular_mut(&mut jacobian))
        {
            return None;
        }
        let mut linear = Linear {
            square: residual.norm_squared(),
            ranges: count,
            cost: residual.norm_squared()
                + 2.0 * (0..count).map(|j| lower[(j, j)].ln()).sum::<f64>()
                + forgone,
            gradient: jacobian.tr_mul(&residual),
            hessian: jacobian.tr_mul(&jacobian),
        };
        linear.hold(poses, self.settings.dimension);
        linear.cost.is_finite().then_some(linear)
    }
}

impl Tie {
    /// None while an end is not placed.
    fn seen(&self, poses: &Poses) -> Option<Seen> {
        let ends = [poses[self.ends[0]]?, poses[self.ends[1]]?];
        let turning = [0, 1].map(|end| turned(&self.past[end].place_m, ends[end].yaw_rad));
        let between = ends[1].position_m + turning[1] - ends[0].position_m - turning[0];
        let distance = between.norm().max(f64::MIN_POSITIVE);
        Some(Seen {
            residual: self.range_m - distance,
            direction: between / distance,
            turning,
        })
    }
}

impl Seen {
    /// How the predicted range changes with position and yaw of either end.
    fn rows(&self, dimension: Dimension) -> [[f64; PER_ROBOT]; 2] {
        let n = &self.direction;
        let height = if dimension == Dimension::Spatial {
            n.z
        } else {
            0.0
        };
        let turn = |end: usize| n.y * self.turning[end].x - n.x * self.turning[end].y;
        [[-n.x, -n.y, -height, -turn(0)], [n.x, n.y, height, turn(1)]]
    }
}

/// The cost around poses, to second order.
struct Linear {
    cost: f64,
    /// Of it, the squared residuals over their covariance.
    square: f64,
    ranges: usize,
    gradient: DVector<f64>,
    hessian: DMatrix<f64>,
}

impl Linear {
    fn nothing(robots: usize) -> Self {
        Self {
            cost: 0.0,
            square: 0.0,
            ranges: 0,
            gradient: DVector::zeros(PER_ROBOT * robots),
            hessian: DMatrix::zeros(PER_ROBOT * robots, PER_ROBOT * robots),
        }
    }

    /// Holds what is no unknown: robot 0, robots not placed, heights in the plane.
    fn hold(&mut self, poses: &Poses, dimension: Dimension) {
        for (robot, pose) in poses.iter().enumerate() {
            for i in 0..PER_ROBOT {
                let height = i == 2 && dimension == Dimension::Planar;
                if robot == 0 || pose.is_none() || height {
                    let at = PER_ROBOT * robot + i;
                    self.hessian.row_mut(at).fill(0.0);
                    self.hessian.column_mut(at).fill(0.0);
                    self.hessian[(at, at)] = 1.0;
                    self.gradient[at] = 0.0;
                }
            }
        }
    }

    fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let mut damped = self.hessian.clone();
        for i in 0..damped.nrows() {
            damped[(i, i)] += damping * self.hessian[(i, i)].max(1e-3) + 1e-9;
        }
        let step = Cholesky::<f64, Dyn>::new(damped)?.solve(&self.gradient);
        let most = step.amax();
        let scale = if most > 5.0 { 5.0 / most } else { 1.0 };
        step.iter().all(|one| one.is_finite()).then(|| step * scale)
    }
}

fn stepped(poses: &Poses, step: &DVector<f64>) -> Poses {
    let moved = |(robot, pose): (usize, &Option<RelativePose>)| {
        let by = step.fixed_rows::<PER_ROBOT>(PER_ROBOT * robot);
        pose.map(|pose| {
            let position = pose.position_m + Vector3::new(by[0], by[1], by[2]);
            RelativePose::new(position, pose.yaw_rad + by[3])
        })
    };
    poses.iter().enumerate().map(moved).collect()
}

/// The best of the formations, brought to their minima with full weights. All that could come near the best are: which is
/// the second best of a robot's places may be known only then.
pub(super) fn answers(
    team: &Team,
    settings: &WindowSettings,
    formations: &[Poses],
) -> Vec<Formation> {
    let descent = Descent::new(team, settings);
    let worth = formations.first().map(|best| descent.cost(best) + WORTH);
    let worth = worth.unwrap_or(f64::INFINITY);
    // What was refined in few steps may still be far from its minimum: the first are descended from whatever they cost.
    let near = formations
        .iter()
        .enumerate()
        .filter(|(place, one)| *place < ANSWERS_MAX || descent.cost(one) <= worth)
        .map(|one| one.1);
    let images = formations
        .first()
        .filter(|_| settings.dimension == Dimension::Spatial)
        .map(images);
    let mut minima: Vec<(f64, Poses)> = Vec::new();
    for formation in near.chain(images.iter().flatten()) {
        if formation.iter().skip(1).all(Option::is_none) {
            continue;
        }
        let mut poses = formation.clone();
        let cost = descent.descend(&mut poses, ITERATIONS.1, Descent::together);
        let known = minima
            .iter()
            .any(|(_, one)| super::search::is_same(one, &poses));
        if cost.is_finite() && !known {
            minima.push((cost, poses));
        }
    }
    minima.sort_by(|a, b| a.0.total_cmp(&b.0));
    let answer = |(cost, poses): &(f64, Poses)| {
        let linear = descent.together(poses)?;
        let (square, ranges) = (linear.square, linear.ranges);
        let inverse = linear.hessian.cholesky()?.inverse();
        let placed = |robot: usize| {
            let pose = poses[robot]?;
            let elsewhere = minima.iter().filter(|(_, other)| {
                other[robot].is_some_and(|other| !is_same_place(&pose, &other))
            });
            let least = elsewhere.map(|one| one.0).fold(f64::INFINITY, f64::min);
            let mut covariance = inverse
                .fixed_view::<PER_ROBOT, PER_ROBOT>(PER_ROBOT * robot, PER_ROBOT * robot)
                .into_owned();
            if settings.dimension == Dimension::Planar {
                covariance[(2, 2)] = 0.0;
            }
            Some(Placed {
                pose,
                covariance,
                cost_gap: least - cost,
            })
        };
        Some(Formation {
            placed: (1..poses.len()).map(placed).collect(),
            cost: *cost,
            square,
            ranges,
        })
    };
    let best = minima.iter().take(ANSWERS_MAX);
    best.filter_map(answer).collect()
}

/// What looks alike while nobody climbs: all upside down, and each robot alone.
fn images(poses: &Poses) -> Vec<Poses> {
    let below = |which: &dyn Fn(usize) -> bool| -> Poses {
        let turned_over = |(robot, pose): (usize, &Option<RelativePose>)| {
            pose.map(|mut pose| {
                if which(robot) {
                    pose.position_m.z = -pose.position_m.z;
                }
                pose
            })
        };
        poses.iter().enumerate().map(turned_over).collect()
    };
    let each = (1..poses.len()).map(|alone| below(&|robot| robot == alone));
    std::iter::once(below(&|_| true)).chain(each).collect()
}
