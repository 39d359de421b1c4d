//! What registration found: every surviving solution, how likely each is, and what was left out to bound the work.

use super::belief::{Compared, Pose, agreement};
use super::formation::Formation;
use super::published::raw_covariance;
use super::refinement::refine;
use super::scene::Scene;
use super::{Job, Method};
use crate::mutual::direction::tangents;
use crate::vehicle_id::VehicleId;
use nalgebra::{Matrix3, Matrix4, SMatrix, UnitVector3};

/// What was left out to bound the work; all zero when everything was looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// Neighbours beyond the bound.
    pub neighbours: usize,
    /// Sightings beyond the bound.
    pub sightings: usize,
    /// Mutual pairs of sightings.
    pub matches: usize,
    /// Triples of vehicles whose triangles were not looked for, though no solution explained everything yet.
    pub triples: usize,
    /// Triangles.
    pub triangles: usize,
    /// Seeds and branches of them.
    pub branches: usize,
    /// Solutions.
    pub solutions: usize,
}

/// What registration found.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// All solutions that survive, the likeliest (sightings and beliefs together) first.
    pub solutions: Vec<Solution>,
    /// What was left out.
    pub cut: Cut,
}

/// One way in which all sightings fit together.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Likelihood of the sightings over that of nobody being placed and all sightings being clutter (nats).
    pub log_likelihood: f64,
    /// How well it agrees with the beliefs (logarithm of the paper's metric, eq. 17, nats); zero without beliefs.
    pub log_belief: f64,
    /// What makes it agree best (m): the neighbours' mean distance. None without beliefs.
    pub scale_m: Option<f64>,
    /// The neighbours that have a place in it, in the order of the job.
    pub placed: Vec<Placed>,
    /// Who is seen where: by vehicle (0 is this one, `1 + k` is the job's neighbour `k`) and by sighting the number of
    /// the vehicle that it is.
    pub seen: Vec<Vec<Option<usize>>>,
}

/// Where a neighbour is, up to distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Who.
    pub vehicle: VehicleId,
    /// Its direction in this vehicle's level frame.
    pub direction: UnitVector3<f64>,
    /// Its heading relative to this vehicle's (rad), counter-clockwise.
    pub yaw_rad: f64,
    /// Covariance of the direction, along its two tangents, and of the yaw (rad^2).
    pub covariance: Matrix3<f64>,
    /// Its distance over the mean distance of all placed neighbours.
    pub relative_distance: f64,
    /// Which of my sightings it is.
    pub mine: Option<usize>,
    /// Which of its sightings I am.
    pub theirs: Option<usize>,
    /// How well the *other* neighbours agree with their beliefs (nats): the part of `log_belief` that is news to this
    /// neighbour's own filter.
    pub log_cavity: f64,
}

impl Outcome {
    /// Weights of the solutions, summing to one, from likelihoods and beliefs raised to `temper` (one: as they are;
    /// less: alternatives are kept alive).
    #[must_use]
    pub fn weights(&self, temper: f64) -> Vec<f64> {
        let posterior = |one: &Solution| (one.log_likelihood + one.log_belief) * temper;
        let best = self
            .solutions
            .iter()
            .map(posterior)
            .fold(f64::NEG_INFINITY, f64::max);
        let shares: Vec<f64> = self
            .solutions
            .iter()
            .map(|one| (posterior(one) - best).exp())
            .collect();
        let total: f64 = shares.iter().sum();
        shares.into_iter().map(|share| share / total).collect()
    }
}

/// Compares the formations with the beliefs and keeps those that survive.
pub(super) fn outcome(
    job: &Job,
    scene: &Scene,
    formations: Vec<Formation>,
    mut cut: Cut,
) -> Outcome {
    let mut solutions: Vec<Solution> = formations
        .into_iter()
        .filter_map(|formation| solution(job, scene, formation))
        .collect();
    let posterior = |one: &Solution| one.log_likelihood + one.log_belief;
    solutions.sort_by(|a, b| posterior(b).total_cmp(&posterior(a)));
    if let Some(best) = solutions.first().map(posterior) {
        solutions.retain(|one| posterior(one) >= best - job.settings.survival_nats);
    }
    cut.solutions += solutions.len().saturating_sub(job.settings.solutions_max);
    solutions.truncate(job.settings.solutions_max);
    Outcome { solutions, cut }
}

fn solution(job: &Job, scene: &Scene, mut formation: Formation) -> Option<Solution> {
    formation.normalise();
    let refined = refine(&mut formation, scene, 0)?;
    if !formation.is_finite() || formation.stances[0].is_none() {
        return None;
    }
    let log_likelihood = formation.log_likelihood(scene);
    let neighbours: Vec<(usize, Pose, Matrix4<f64>)> = formation
        .placed()
        .filter(|(vehicle, _)| *vehicle > 0)
        .filter_map(|(vehicle, stance)| {
            let place = Pose {
                position_m: stance.position,
                yaw_rad: stance.yaw_rad,
            };
            let covariance = match job.method {
                Method::SingleScan => refined.covariance(vehicle)?,
                Method::Published => raw_covariance(&formation, scene, vehicle),
            };
            Some((vehicle, place, covariance))
        })
        .collect();
    let compared: Vec<Compared<'_>> = neighbours
        .iter()
        .map(|(vehicle, place, covariance)| Compared {
            belief: job.neighbours[vehicle - 1].belief.as_ref(),
            place: *place,
            covariance: *covariance,
        })
        .collect();
    let agreement = agreement(
        &compared,
        job.settings.belief_wrong_probability.clamp(1e-6, 1.0),
    );
    let seen = seen(job, scene, &formation);
    let placed = neighbours
        .iter()
        .zip(&agreement.log_cavities)
        .filter_map(|((vehicle, place, covariance), log_cavity)| {
            let (direction, distance) = UnitVector3::try_new_and_get(place.position_m, 1e-9)?;
            let own = seen[0].iter().position(|one| *one == Some(*vehicle));
            let theirs = seen[*vehicle].iter().position(|one| *one == Some(0));
            Some(Placed {
                vehicle: job.neighbours[vehicle - 1].vehicle,
                direction,
                yaw_rad: place.yaw_rad,
                covariance: across(&direction, distance, covariance),
                relative_distance: distance,
                mine: own,
                theirs,
                log_cavity: *log_cavity,
            })
        })
        .collect();
    Some(Solution {
        log_likelihood,
        log_belief: agreement.log_metric,
        scale_m: agreement.scale_m,
        placed,
        seen,
    })
}

/// Covariance of direction and yaw from that of position and yaw.
fn across(direction: &UnitVector3<f64>, distance: f64, covariance: &Matrix4<f64>) -> Matrix3<f64> {
    let mut jacobian = SMatrix::<f64, 3, 4>::zeros();
    for (axis, tangent) in tangents(direction).iter().enumerate() {
        jacobian
            .fixed_view_mut::<1, 3>(axis, 0)
            .copy_from(&(tangent / distance).transpose());
    }
    jacobian[(2, 3)] = 1.0;
    jacobian * covariance * jacobian.transpose()
}

fn seen(job: &Job, scene: &Scene, formation: &Formation) -> Vec<Vec<Option<usize>>> {
    let all = std::iter::once(&job.own).chain(job.neighbours.iter().map(|one| &one.sightings));
    let mut seen: Vec<Vec<Option<usize>>> =
        all.map(|sightings| vec![None; sightings.len()]).collect();
    for (vehicle, rays) in scene.rays.iter().enumerate() {
        for (ray, target) in rays.iter().zip(&formation.seen[vehicle]) {
            let target = *target as usize;
            let is_placed = formation.stances.get(target).is_some_and(Option::is_some);
            seen[vehicle][ray.index] = is_placed.then_some(target);
        }
    }
    seen
}
