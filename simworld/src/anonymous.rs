//! A camera that sees robots and not which robots: noisy directions in no order, with gaps, with things that look like
//! robots, and with false alarms.

mod phantom;
mod settings;

pub use phantom::Phantom;
pub use settings::CameraSettings;

use crate::streams::{Purpose, Streams};
use crate::truth::{Pose, relative_position_m};
use nalgebra::{UnitVector3, Vector3};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Exp, Poisson, StandardNormal, UnitSphere};

/// One thing in one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Where the camera says that it is, body frame.
    pub direction: UnitVector3<f64>,
    /// What it truly is, for scoring: a vehicle by its index, or nothing that is a robot.
    pub who: Option<usize>,
}

/// One image.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// When it was taken, in seconds since the start.
    pub taken_s: f64,
    /// Standard deviation of azimuth and of zenith distance of every sighting (rad).
    pub sigma_rad: f64,
    /// What is in it, in random order.
    pub sightings: Vec<Sighting>,
}

/// The camera of one vehicle. Every image can be asked for in any order.
#[derive(Clone, Debug)]
pub struct Camera {
    settings: CameraSettings,
    vehicle: usize,
    begins_s: f64,
    streams: Streams,
    /// When each vehicle is not seen by this one: from and to, in seconds.
    gaps_s: Vec<Vec<(f64, f64)>>,
}

impl Camera {
    /// The camera of a vehicle in a team of so many, with the gaps of its sight drawn for this time (s); its first
    /// image is due at the beginning.
    #[must_use]
    pub fn new(
        settings: CameraSettings,
        vehicle: usize,
        team: usize,
        time_s: std::ops::Range<f64>,
        streams: Streams,
    ) -> Self {
        let gaps_s = (0..team)
            .map(|target| {
                let mut rng = streams.pair(vehicle, target, Purpose::Miss);
                gaps_s(&settings, &time_s, &mut rng)
            })
            .collect();
        Self {
            settings,
            vehicle,
            begins_s: time_s.start,
            streams,
            gaps_s,
        }
    }

    /// When the `index`th image is taken (s): at its turn, give or take the jitter.
    #[must_use]
    pub fn taken_s(&self, index: usize) -> f64 {
        let mut rng = self
            .streams
            .nth(self.vehicle, index, Purpose::MeasuringTime);
        let normal: f64 = StandardNormal.sample(&mut rng);
        let period_s = 1.0 / self.settings.rate_hz;
        // Never as far as the turn of the next, so that images stay in order.
        let jitter_s = (normal * self.settings.jitter_s).clamp(-0.4 * period_s, 0.4 * period_s);
        self.begins_s + (index as f64 * period_s + jitter_s).max(0.0)
    }

    /// What is in the `index`th image. `team` tells where each vehicle truly is when it is taken; `others` are places
    /// (world frame, metres) of things that look like a robot to this camera.
    #[must_use]
    pub fn scan(&self, index: usize, team: &[Pose], others: &[Vector3<f64>]) -> Scan {
        let taken_s = self.taken_s(index);
        let own = &team[self.vehicle];
        let mut rng = self.streams.nth(self.vehicle, index, Purpose::Camera);
        let mut sightings = Vec::new();
        for (target, pose) in team.iter().enumerate() {
            // Drawn before anything is decided, so that one miss shifts nothing else.
            let missed = rng.random::<f64>() < self.settings.miss_probability;
            let noise = self.noise(&mut rng);
            let place = relative_position_m(own, pose);
            if target != self.vehicle && !missed && !self.gap(target, taken_s) {
                sightings.extend(self.sighting(&place, noise, Some(target)));
            }
        }
        for place in others {
            let noise = self.noise(&mut rng);
            let place = own.inverse() * nalgebra::Point3::from(*place);
            sightings.extend(self.sighting(&place.coords, noise, None));
        }
        sightings.extend(self.false_alarms(&mut rng));
        sightings.shuffle(&mut rng);
        Scan {
            taken_s,
            sigma_rad: self.settings.noise_deg.to_radians(),
            sightings,
        }
    }

    fn noise(&self, rng: &mut impl Rng) -> [f64; 2] {
        [(); 2].map(|()| {
            let normal: f64 = StandardNormal.sample(rng);
            normal * self.settings.noise_deg.to_radians()
        })
    }

    fn gap(&self, target: usize, at_s: f64) -> bool {
        let gaps = self.gaps_s.get(target).map_or(&[][..], Vec::as_slice);
        gaps.iter().any(|(from, to)| (*from..*to).contains(&at_s))
    }

    /// A place (body frame) as it is seen, if it is: noise on azimuth and on zenith distance.
    fn sighting(
        &self,
        place: &Vector3<f64>,
        noise: [f64; 2],
        who: Option<usize>,
    ) -> Option<Sighting> {
        let range_m = place.norm();
        let seen = range_m > 0.0 && range_m <= self.settings.range_m;
        if !seen || self.settings.view.is_some_and(|view| !view.contains(place)) {
            return None;
        }
        let azimuth = place.y.atan2(place.x) + noise[0];
        let zenith = place.x.hypot(place.y).atan2(place.z) + noise[1];
        let direction = Vector3::new(
            zenith.sin() * azimuth.cos(),
            zenith.sin() * azimuth.sin(),
            zenith.cos(),
        );
        Some(Sighting {
            direction: UnitVector3::new_normalize(direction),
            who,
        })
    }

    /// Directions in which there is nothing, uniform over what is in view.
    fn false_alarms(&self, rng: &mut impl Rng) -> Vec<Sighting> {
        let mean = self.settings.false_alarms;
        let Ok(count) = Poisson::new(mean) else {
            return Vec::new();
        };
        let count: f64 = count.sample(rng);
        let anywhere = (0..count as usize).map(|_| Vector3::from(UnitSphere.sample(rng)));
        anywhere
            .filter(|direction| {
                self.settings
                    .view
                    .is_none_or(|view| view.contains(direction))
            })
            .map(|direction| Sighting {
                direction: UnitVector3::new_normalize(direction),
                who: None,
            })
            .collect()
    }
}

/// When one vehicle is not seen: gaps begin as a Poisson process and last uniformly long.
fn gaps_s(
    settings: &CameraSettings,
    time_s: &std::ops::Range<f64>,
    rng: &mut impl Rng,
) -> Vec<(f64, f64)> {
    let mut gaps = Vec::new();
    let Ok(wait) = Exp::new(settings.gaps_per_s) else {
        return gaps;
    };
    let mut t_s = time_s.start + wait.sample(rng);
    while t_s < time_s.end {
        gaps.push((t_s, t_s + rng.random::<f64>() * settings.gap_s_max));
        t_s += wait.sample(rng);
    }
    gaps
}

#[cfg(test)]
mod tests;
