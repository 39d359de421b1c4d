//! How well a solution agrees with what was believed (Cognetti et al., eq. 17), at the scale that suits it best.

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

use crate::mutual::direction::wrapped;
use std::f64::consts::PI;

/// Most samples of a belief that are looked at.
const SAMPLES_MAX: usize = 256;
/// Most scales that are tried.
const SCALES_MAX: usize = 24;
/// Halvings of the step by which the best scale is refined.
const SCALE_STEPS: usize = 7;
/// Samples stand for what is around them: so far, as a share of the distance, and in yaw (rad).
const SAMPLE_SPREAD: f64 = 0.1;
const SAMPLE_YAW_SPREAD_RAD: f64 = 0.08;
/// Beliefs that are surer than this across the direction and in yaw (rad) are worth predicting from.
const SURE_RAD: f64 = 0.35;
/// Distances are taken to span so many natural logarithms when a belief is wrong.
const DISTANCE_SPAN: f64 = 3.0;

/// A place and a heading, in this vehicle's level frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Where (m).
    pub position_m: Vector3<f64>,
    /// Heading relative to this vehicle's (rad), counter-clockwise.
    pub yaw_rad: f64,
}

/// Where a neighbour is believed to be.
#[derive(Clone, Debug, PartialEq)]
pub enum Belief {
    /// About there.
    Gaussian {
        /// The middle.
        mean: Pose,
        /// Covariance of position and yaw (m, rad).
        covariance: Matrix4<f64>,
    },
    /// At one of these, each as likely; the first 256 count.
    Samples(Vec<Pose>),
}

impl Belief {
    /// The middle and the covariance.
    pub(super) fn moments(&self) -> Option<(Pose, Matrix4<f64>)> {
        match self {
            Self::Gaussian { mean, covariance } => Some((*mean, *covariance)),
            Self::Samples(samples) => {
                let samples = &samples[..samples.len().min(SAMPLES_MAX)];
                let first = samples.first()?;
                let count = samples.len() as f64;
                let away = |one: &Pose| {
                    let apart = one.position_m - first.position_m;
                    Vector4::new(
                        apart.x,
                        apart.y,
                        apart.z,
                        wrapped(one.yaw_rad - first.yaw_rad),
                    )
                };
                let mean = samples.iter().map(away).sum::<Vector4<f64>>() / count;
                let spread = samples.iter().map(|one| {
                    let from_mean = away(one) - mean;
                    from_mean * from_mean.transpose()
                });
                let covariance = spread.sum::<Matrix4<f64>>() / count;
                let middle = Pose {
                    position_m: first.position_m + mean.xyz(),
                    yaw_rad: first.yaw_rad + mean.w,
                };
                Some((middle, covariance))
            }
        }
    }

    /// The middle with the variance of the position per axis (m^2) and of the yaw (rad^2), when direction and yaw are
    /// known well enough to say what is seen where.
    pub(super) fn sure(&self) -> Option<(Pose, f64, f64)> {
        let (mean, covariance) = self.moments()?;
        let distance2 = mean.position_m.norm_squared();
        let finite = distance2.is_finite() && mean.yaw_rad.is_finite();
        if !finite || !covariance.iter().all(|one| one.is_finite()) || distance2 < 1e-12 {
            return None;
        }
        let along = mean.position_m / distance2.sqrt();
        let position = covariance.fixed_view::<3, 3>(0, 0);
        let radial = (position * along).dot(&along);
        let across = (position.trace() - radial).max(0.0) / 2.0 / distance2;
        let yaw = covariance[(3, 3)].max(0.0);
        let limit = SURE_RAD * SURE_RAD;
        (across < limit && yaw < limit).then_some((mean, position.trace().max(0.0) / 3.0, yaw))
    }

    /// Density of a place (per steradian, radian and natural logarithm of distance) that is itself only known to
    /// `covariance`.
    fn density(&self, place: &Pose, covariance: &Matrix4<f64>) -> f64 {
        let volume = place.position_m.norm().powi(3);
        let density = match self {
            Self::Gaussian {
                mean,
                covariance: believed,
            } => Gaussian::new(&(believed + covariance)).map(|around| around.density(place, mean)),
            Self::Samples(samples) => {
                let samples = &samples[..samples.len().min(SAMPLES_MAX)];
                let spread = (SAMPLE_SPREAD * place.position_m.norm()).powi(2);
                let mut wide = *covariance;
                for axis in 0..3 {
                    wide[(axis, axis)] += spread;
                }
                wide[(3, 3)] += SAMPLE_YAW_SPREAD_RAD * SAMPLE_YAW_SPREAD_RAD;
                Gaussian::new(&wide).map(|around| {
                    let total: f64 = samples.iter().map(|one| around.density(place, one)).sum();
                    total / samples.len().max(1) as f64
                })
            }
        };
        let density = density.unwrap_or(0.0) * volume;
        if density.is_finite() { density } else { 0.0 }
    }
}

/// A Gaussian over position and yaw.
struct Gaussian {
    information: Matrix4<f64>,
    peak: f64,
}

impl Gaussian {
    fn new(covariance: &Matrix4<f64>) -> Option<Self> {
        let cholesky = covariance.cholesky()?;
        let root: f64 = cholesky.l_dirty().diagonal().iter().product();
        Some(Self {
            information: cholesky.inverse(),
            peak: 1.0 / (root * (2.0 * PI).powi(2)),
        })
    }

    fn density(&self, place: &Pose, mean: &Pose) -> f64 {
        let apart = place.position_m - mean.position_m;
        let turned = wrapped(place.yaw_rad - mean.yaw_rad);
        let apart = Vector4::new(apart.x, apart.y, apart.z, turned);
        self.peak * (-0.5 * apart.dot(&(self.information * apart))).exp()
    }
}

/// A neighbour of a solution, up to scale, beside what was believed of it.
pub(super) struct Compared<'a> {
    pub(super) belief: Option<&'a Belief>,
    pub(super) place: Pose,
    pub(super) covariance: Matrix4<f64>,
}

/// What the beliefs say of a solution.
pub(super) struct Agreement {
    /// Metres that one of the solution's units is; none without beliefs.
    pub(super) scale_m: Option<f64>,
    /// Logarithm of the metric (nats); zero where nothing is believed.
    pub(super) log_metric: f64,
    /// By neighbour: the same from the *other* neighbours' beliefs only.
    pub(super) log_cavities: Vec<f64>,
}

/// The metric at the scale that makes it greatest. With `wrong_probability` a belief says nothing.
pub(super) fn agreement(compared: &[Compared<'_>], wrong_probability: f64) -> Agreement {
    let values = |scale: f64| -> Vec<f64> {
        compared
            .iter()
            .map(|one| {
                one.belief
                    .map_or(0.0, |belief| one.value(belief, scale, wrong_probability))
            })
            .collect()
    };
    let mut scales: Vec<f64> = Vec::new();
    let believed = compared.iter().filter(|one| one.belief.is_some()).count();
    for one in compared {
        scales.extend(one.scales(SCALES_MAX / believed.max(1)));
    }
    scales.truncate(SCALES_MAX);
    let mut tried: Vec<(f64, Vec<f64>)> = scales
        .into_iter()
        .map(|scale| (scale, values(scale)))
        .collect();
    let total = |(_, values): &(f64, Vec<f64>)| values.iter().sum::<f64>();
    let best = tried
        .iter()
        .max_by(|a, b| total(a).total_cmp(&total(b)))
        .cloned();
    let Some(mut best) = best else {
        return Agreement {
            scale_m: None,
            log_metric: 0.0,
            log_cavities: vec![0.0; compared.len()],
        };
    };
    let mut step = 1.2;
    for _ in 0..SCALE_STEPS {
        for scale in [best.0 * step, best.0 / step] {
            let one = (scale, values(scale));
            if total(&one) > total(&best) {
                best = one.clone();
            }
            tried.push(one);
        }
        step = step.sqrt();
    }
    let cavity = |neighbour: usize| {
        let without = tried.iter().map(|one| total(one) - one.1[neighbour]);
        without.fold(f64::NEG_INFINITY, f64::max)
    };
    Agreement {
        scale_m: Some(best.0),
        log_metric: total(&best),
        log_cavities: (0..compared.len()).map(cavity).collect(),
    }
}

impl Compared<'_> {
    fn value(&self, belief: &Belief, scale: f64, wrong_probability: f64) -> f64 {
        let place = Pose {
            position_m: self.place.position_m * scale,
            yaw_rad: self.place.yaw_rad,
        };
        let mut covariance = self.covariance * scale;
        let position: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(0, 0) * (scale * scale);
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&position);
        covariance[(3, 3)] = self.covariance[(3, 3)];
        let nothing = 1.0 / (4.0 * PI * 2.0 * PI * DISTANCE_SPAN);
        let density = belief.density(&place, &covariance);
        ((1.0 - wrong_probability) * density + wrong_probability * nothing)
            .max(1e-300)
            .ln()
    }

    /// Scales at which the place is nearest to what is believed.
    fn scales(&self, count_max: usize) -> Vec<f64> {
        let at = &self.place.position_m;
        let scale = |pose: &Pose| pose.position_m.dot(at) / at.norm_squared();
        let scales: Vec<f64> = match self.belief {
            None => Vec::new(),
            Some(Belief::Gaussian { mean, .. }) => vec![scale(mean)],
            Some(Belief::Samples(samples)) => {
                let samples = &samples[..samples.len().min(SAMPLES_MAX)];
                let step = samples.len().div_ceil(count_max.max(1)).max(1);
                samples.iter().step_by(step).map(scale).collect()
            }
        };
        scales
            .into_iter()
            .filter(|scale| scale.is_finite() && *scale > 0.0)
            .collect()
    }
}
