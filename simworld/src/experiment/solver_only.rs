//! The bare algorithm of Knuth & Barooah on a sample of a world: no packets, no clocks, no rounds that wait.
//!
//! It is fast, and it is the second opinion on [`crate::fleet`]: over a perfect radio both must tell the same.

use crate::stage::Stage;
use crate::truth::Pose;
use crate::world::{World, from_transform, transform};
use nalgebra::Vector3;
use skein_estimation::cooperative::{
    Contact, Measurement, Noise, Optimiser, Refusal, Star, StarWorkspace,
};
use skein_estimation::{Body, Sensor, Transform, World as WorldFrame, so3};
use skein_proto::frame::{Frame, RelativeValue};

/// Why a scenario cannot be flown without vehicles.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotBare {
    /// Readings between the rounds, late readings, or clocks that differ need the rounds of a vehicle.
    #[error("without vehicles every reading must be taken on its round, at once, on one clock")]
    Times,
    /// The estimator refused something that the world made.
    #[error("the estimator refused a measurement: {0}")]
    Refused(#[from] Refusal),
}

/// The estimates of every vehicle at every k, from 0 on: `[k][vehicle]`.
pub fn fly(world: &mut World, optimiser: &Optimiser) -> Result<Vec<Vec<Pose>>, NotBare> {
    let period_ns = world.period_ns();
    let (start_ns, end_ns) = world.span_ns();
    let team = world.vehicles();
    if (0..team).any(|vehicle| world.first_instant_ns(vehicle, 0) != 0) {
        return Err(NotBare::Times);
    }
    let mut estimates: Vec<Transform<WorldFrame, Body>> = (0..team)
        .map(|vehicle| transform(&world.pose(vehicle, 0)))
        .collect();
    let mounts: Vec<Transform<Body, Sensor>> = (0..team)
        .map(|vehicle| world.config(vehicle, 0).sensors[1].body_from_sensor)
        .collect();
    let mut workspace = StarWorkspace::new();
    let mut star = Star::new(Transform::identity())?;
    let mut flown = Vec::new();
    let mut instant_ns = world.first_instant_ns(0, start_ns + 1);
    while instant_ns <= end_ns {
        let mut measured = vec![vec![None; team]; team];
        for vehicle in 0..team {
            for delivery in world.round(vehicle, instant_ns) {
                match delivery.frame {
                    Frame::Odometry(frame) => {
                        let motion = Transform::<Body, Body>::from_rotation_vector(frame.motion);
                        estimates[vehicle] = estimates[vehicle]
                            * motion.map_err(|_| Refusal::NotFinite { what: "odometry" })?;
                    }
                    Frame::Relative(frame) => {
                        let on_time = world.time_ns(vehicle, frame.taken_ns) == instant_ns;
                        if !on_time || delivery.at_ns != instant_ns {
                            return Err(NotBare::Times);
                        }
                        let target = (0..team).find(|target| world.name(*target) == frame.target);
                        if let Some(target) = target {
                            measured[vehicle][target] = Some(measurement(&frame.value)?);
                        }
                    }
                    _ => {}
                }
            }
        }
        // Simultaneous: everybody solves from the priors of this round (estimation from the paper's section IV).
        let priors = estimates.clone();
        for me in 0..team {
            star.restart(priors[me].reframe())?;
            for other in 0..team {
                let (mine, theirs) = (measured[me][other], measured[other][me]);
                if mine.is_none() && theirs.is_none() {
                    continue;
                }
                let neighbour = star.add_neighbour(priors[other].reframe(), Contact::FRESH)?;
                let end = Transform::identity();
                if let Some((measurement, noise)) = mine {
                    star.measured_by_me(neighbour, measurement, noise, mounts[me], end)?;
                }
                if let Some((measurement, noise)) = theirs {
                    star.measured_by_neighbour(neighbour, measurement, noise, end, mounts[other])?;
                }
            }
            estimates[me] = star
                .solve(&mut workspace, optimiser)
                .world_from_body
                .reframe();
        }
        if instant_ns >= 0 {
            flown.push(estimates.iter().map(from_transform).collect());
        }
        instant_ns += period_ns;
    }
    Ok(flown)
}

pub(super) fn measurement(value: &RelativeValue) -> Result<(Measurement, Noise), Refusal> {
    let rotation = |vector: &[f64; 3]| so3::exp(&Vector3::from(*vector));
    Ok(match value {
        RelativeValue::Pose {
            sensor_from_target: [a, b, c, x, y, z],
            rotation_sigma_rad,
            translation_sigma_m,
        } => (
            Measurement::pose(Transform::new(
                rotation(&[*a, *b, *c]),
                Vector3::new(*x, *y, *z),
            ))?,
            Noise {
                rotation_rad: *rotation_sigma_rad,
                translation: *translation_sigma_m,
            },
        ),
        RelativeValue::Orientation {
            rotation_vector_rad,
            sigma_rad,
        } => (
            Measurement::orientation(rotation(rotation_vector_rad))?,
            Noise {
                rotation_rad: *sigma_rad,
                translation: 0.0,
            },
        ),
        RelativeValue::Position {
            position_m,
            sigma_m,
        } => (
            Measurement::position(Vector3::from(*position_m))?,
            Noise {
                rotation_rad: 0.0,
                translation: *sigma_m,
            },
        ),
        RelativeValue::Bearing {
            direction,
            sigma_rad,
        } => (
            Measurement::bearing(Vector3::from(*direction))?,
            Noise {
                rotation_rad: *sigma_rad,
                translation: 0.0,
            },
        ),
        RelativeValue::Distance {
            distance_m,
            sigma_m,
        } => (
            Measurement::distance(*distance_m)?,
            Noise {
                rotation_rad: 0.0,
                translation: *sigma_m,
            },
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fleet::Fleet;
    use crate::scenario::Scenario;
    use crate::sensor::Kind;
    use skein_estimation::cooperative::Mode;

    fn agree(scenario: &Scenario) {
        let bare = fly(&mut World::new(scenario, 0), &Optimiser::gauss_newton()).unwrap();
        let as_published = |_, config| skein_vehicle::Config {
            mode: Mode::Paper,
            ..config
        };
        let mut fleet = Fleet::with_configs(scenario, 0, as_published);
        let period_ns = fleet.stage().period_ns();
        for (k, estimates) in bare.iter().enumerate() {
            fleet.run_until((k as i64 + 1) * period_ns);
            for (vehicle, bare) in estimates.iter().enumerate() {
                let (_, flown) = fleet.scored(vehicle).unwrap();
                let apart = (flown.translation.vector - bare.translation.vector).norm()
                    + flown.rotation.angle_to(&bare.rotation);
                assert!(apart < 1e-9, "k = {k}, vehicle {vehicle}: {apart:e}");
            }
        }
    }

    #[test]
    fn a_fleet_over_a_perfect_radio_tells_what_the_bare_algorithm_tells() {
        let mut scenario = Scenario::built_in("section-v").unwrap();
        for kind in [
            Kind::Pose,
            Kind::Orientation,
            Kind::Position,
            Kind::Bearing,
            Kind::Distance,
        ] {
            scenario.sensor.kind = kind;
            agree(&scenario);
        }
    }
}
