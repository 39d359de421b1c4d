//! A sample of a world as raw information: everybody's odometry and measurements of every round, without packets. It is
//! what a vehicle that hears everything has heard, and what a batch over the whole flight is given.

use crate::experiment::solver_only::{self, NotBare};
use crate::stage::Stage;
use crate::truth::Pose;
use crate::world::{World, transform};
use skein_estimation::cooperative::Refusal;
use skein_estimation::cooperative::team::{Moment, Observation};
use skein_estimation::odometry::{Growth, OdometryPoint};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Odometry, Transform, VehicleId, World as WorldFrame};
use skein_proto::frame::Frame;

/// Everything that was measured in one flight, from k = 0 on.
#[derive(Clone, Debug)]
pub struct History {
    /// Where everybody starts, exactly.
    pub starts: Vec<Transform<WorldFrame, Body>>,
    /// Round by round.
    pub rounds: Vec<RawRound>,
    /// Where everybody was: `[k][vehicle]`.
    pub truth: Vec<Vec<Pose>>,
}

/// One round.
#[derive(Clone, Debug)]
pub struct RawRound {
    /// Everybody's odometry.
    pub moments: Vec<Moment>,
    /// What was measured.
    pub sightings: Vec<RawSighting>,
    /// Who was told where it is in the world, and what.
    pub fixes: Vec<RawFix>,
}

impl History {
    /// How many vehicles.
    #[must_use]
    pub const fn team(&self) -> usize {
        self.starts.len()
    }

    /// The last round.
    #[must_use]
    pub const fn last(&self) -> usize {
        self.rounds.len() - 1
    }

    /// Where a vehicle was.
    #[must_use]
    pub fn true_pose(&self, k: usize, vehicle: usize) -> Transform<WorldFrame, Body> {
        transform(&self.truth[k][vehicle])
    }

    /// What a vehicle's odometry says of the way to a round from an earlier one.
    #[must_use]
    pub fn step(&self, vehicle: usize, earlier: usize, k: usize) -> Transform<Body, Body> {
        let pose = |k: usize| self.rounds[k].moments[vehicle].point.odometry_from_body;
        pose(earlier).inverse() * pose(k)
    }
}

/// What one vehicle measured of another.
#[derive(Clone, Copy, Debug)]
pub struct RawSighting {
    /// Who.
    pub from: usize,
    /// Whom.
    pub to: usize,
    /// What.
    pub observation: Observation,
    /// Whether it is not so. No estimator is told; the bound is.
    pub is_wrong: bool,
}

/// What was measured of the world.
#[derive(Clone, Copy, Debug)]
pub struct RawFix {
    /// Whose place.
    pub of: usize,
    /// What.
    pub observation: Observation,
}

/// The id of the vehicle of that number.
#[must_use]
pub const fn id(vehicle: usize) -> VehicleId {
    VehicleId(vehicle as u64 + 1)
}

/// Flies a sample and keeps what was measured.
///
/// # Errors
/// [`NotBare`] when readings are not taken on their rounds, at once, on one clock.
pub fn record(world: &mut World) -> Result<History, NotBare> {
    let period_ns = world.period_ns();
    let (start_ns, end_ns) = world.span_ns();
    let team = world.vehicles();
    let mounts: Vec<_> = (0..team)
        .map(|vehicle| world.config(vehicle, 0).sensors[1].body_from_sensor)
        .collect();
    let mut odometry: Vec<Transform<Odometry, Body>> = vec![Transform::identity(); team];
    let mut growth = vec![Growth::zero(); team];
    let mut history = History {
        starts: (0..team)
            .map(|vehicle| transform(&world.pose(vehicle, 0)))
            .collect(),
        rounds: Vec::new(),
        truth: Vec::new(),
    };
    let mut instant_ns = world.first_instant_ns(0, start_ns + 1);
    while instant_ns <= end_ns {
        let mut sightings = Vec::new();
        for vehicle in 0..team {
            for delivery in world.round(vehicle, instant_ns) {
                match delivery.frame {
                    Frame::Odometry(frame) if instant_ns > 0 => {
                        let motion = Transform::<Body, Body>::from_rotation_vector(frame.motion)
                            .map_err(|_| Refusal::NotFinite { what: "odometry" })?;
                        odometry[vehicle] = odometry[vehicle] * motion;
                        growth[vehicle] = growth[vehicle].after(
                            &odometry[vehicle].translation,
                            frame.rotation_sigma_rad,
                            frame.translation_sigma_m,
                        );
                    }
                    Frame::Relative(frame) => {
                        let on_time = world.time_ns(vehicle, frame.taken_ns) == instant_ns;
                        if !on_time || delivery.at_ns != instant_ns {
                            return Err(NotBare::Times);
                        }
                        let target = (0..team).find(|target| world.name(*target) == frame.target);
                        if let Some(to) = target {
                            let (measurement, noise) = solver_only::measurement(&frame.value)?;
                            sightings.push(RawSighting {
                                from: vehicle,
                                to,
                                observation: Observation {
                                    measurement,
                                    noise,
                                    from_end: mounts[vehicle],
                                    to_end: Transform::identity(),
                                },
                                is_wrong: false,
                            });
                        }
                    }
                    _ => {}
                }
            }
        }
        if instant_ns >= 0 {
            let instant = Stamp::from_nanos(instant_ns);
            let moment = |vehicle: usize| Moment {
                vehicle: id(vehicle),
                instant,
                point: OdometryPoint {
                    taken: instant,
                    segment: 0,
                    odometry_from_body: odometry[vehicle],
                    growth: growth[vehicle],
                },
            };
            history.rounds.push(RawRound {
                moments: (0..team).map(moment).collect(),
                sightings,
                fixes: Vec::new(),
            });
            let truth = (0..team).map(|vehicle| world.pose(vehicle, instant_ns));
            history.truth.push(truth.collect());
        }
        instant_ns += period_ns;
    }
    Ok(history)
}
