//! The sightings of all vehicles with what is computed of them once: angles, tangents, weights. Vehicle 0 is this one,
//! vehicle `1 + k` is the job's neighbour `k`.

use super::{Cut, Job, NEIGHBOURS_MAX, SIGHTINGS_MAX, Sighting};
use crate::mutual::direction;
use nalgebra::Vector3;
use std::f64::consts::PI;

/// Sightings are no better than this (rad): two that agree beyond it tell nothing more.
const SIGMA_MIN_RAD: f64 = 1e-3;
/// Sightings are no worse than this (rad).
const SIGMA_MAX_RAD: f64 = 0.5;
/// How clutter lies around: all azimuths alike, elevations within about half a radian (1/sr).
pub(super) const CLUTTER_PER_SR: f64 = 1.0 / (2.0 * PI * 1.1);

/// A sighting.
pub(super) struct Ray {
    /// Its index in the job.
    pub(super) index: usize,
    pub(super) unit: Vector3<f64>,
    pub(super) tangents: [Vector3<f64>; 2],
    pub(super) azimuth_rad: f64,
    pub(super) zenith_rad: f64,
    pub(super) sin_zenith: f64,
    pub(super) cot_zenith: f64,
    /// Across the ray, per axis (rad^2).
    pub(super) variance: f64,
    /// Of the azimuth (rad^2): grows without bound towards the vertical.
    pub(super) azimuth_variance: f64,
    /// How much likelier (nats) it is that a vehicle is seen exactly there than that it is missed and the sighting clutter.
    pub(super) gain: f64,
}

/// All sightings of all vehicles.
pub(super) struct Scene {
    /// By vehicle.
    pub(super) rays: Vec<Vec<Ray>>,
    /// What placing a vehicle at all must gain (nats): the room it has, over the room that two sightings leave it.
    pub(super) placing_nats: f64,
    /// Mean variance of all sightings (rad^2).
    pub(super) variance: f64,
}

impl Scene {
    pub(super) fn new(job: &Job, cut: &mut Cut) -> Self {
        cut.neighbours = job.neighbours.len().saturating_sub(NEIGHBOURS_MAX);
        let neighbours = job.neighbours.iter().take(NEIGHBOURS_MAX);
        let all = std::iter::once(&job.own).chain(neighbours.map(|one| &one.sightings));
        let detected = job.settings.detection_probability.clamp(0.01, 0.99);
        let clutter = job.settings.clutter.max(0.01) * CLUTTER_PER_SR;
        let mut rays = Vec::new();
        for sightings in all {
            cut.sightings += sightings.len().saturating_sub(SIGHTINGS_MAX);
            let seen = sightings.iter().take(SIGHTINGS_MAX).enumerate();
            let ray = |(index, sighting)| ray(index, sighting, detected, clutter);
            rays.push(seen.filter_map(ray).collect::<Vec<_>>());
        }
        let count: usize = rays.iter().map(Vec::len).sum();
        let total: f64 = rays.iter().flatten().map(|ray| ray.variance).sum();
        let variance = if count == 0 {
            0.01
        } else {
            total / count as f64
        };
        // The prior of direction and yaw over the Gaussians that one mutual pair leaves; a factor e for the distance.
        let direction_nats = -(2.0 * PI * variance * CLUTTER_PER_SR).ln();
        let yaw_nats = ((2.0 * PI).sqrt() / (2.0 * variance).sqrt()).ln();
        Self {
            rays,
            placing_nats: direction_nats.max(0.0) + yaw_nats.max(0.0) + 1.0,
            variance,
        }
    }

    pub(super) fn vehicles(&self) -> usize {
        self.rays.len()
    }
}

fn ray(index: usize, sighting: &Sighting, detected: f64, clutter: f64) -> Option<Ray> {
    let unit = sighting.direction.into_inner();
    let norm = unit.norm();
    if !norm.is_finite() || (norm - 1.0).abs() > 1e-3 || !sighting.sigma_rad.is_finite() {
        return None;
    }
    let variance = sighting
        .sigma_rad
        .clamp(SIGMA_MIN_RAD, SIGMA_MAX_RAD)
        .powi(2);
    let zenith_rad = direction::zenith_rad(&sighting.direction);
    let sin_zenith = zenith_rad.sin().max(1e-6);
    Some(Ray {
        index,
        unit,
        tangents: direction::tangents(&sighting.direction),
        azimuth_rad: direction::azimuth_rad(&sighting.direction),
        zenith_rad,
        sin_zenith,
        cot_zenith: zenith_rad.cos() / sin_zenith,
        variance,
        azimuth_variance: variance / (sin_zenith * sin_zenith),
        gain: (detected / (1.0 - detected)).ln() - (2.0 * PI * variance * clutter).ln(),
    })
}

/// The square of the angle between two unit vectors of this cosine (rad^2); exact to 1e-3 below a radian.
pub(super) fn angle2(cosine: f64) -> f64 {
    let short = (1.0 - cosine).max(0.0);
    short * (2.0 + short * (1.0 / 3.0 + short * 0.089))
}
