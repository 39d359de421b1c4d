//! Something that flies like a robot, looks like one to a single camera, and is none.

use crate::quadrotor::{Arena, Course, Legs};
use crate::streams::{Purpose, Streams};
use nalgebra::Vector3;

/// One of them: it flies from point to point in the box of the team, as a robot might.
#[derive(Clone, Debug, PartialEq)]
pub struct Phantom(Course);

impl Phantom {
    /// Those of one camera.
    pub(crate) fn drawn(
        count: usize,
        vehicle: usize,
        arena: &Arena,
        until_s: f64,
        streams: &Streams,
    ) -> Vec<Self> {
        let mut rng = streams.vehicle(vehicle, Purpose::Phantom);
        let starts: Vec<_> = (0..count).map(|_| (arena.any(&mut rng), 0.0)).collect();
        let courses = Legs::drawn(&starts, arena, until_s, &mut rng);
        courses
            .into_iter()
            .map(|legs| Self(Course::Legs(legs)))
            .collect()
    }

    /// Where it is, world frame, metres.
    #[must_use]
    pub fn position_m(&self, t_s: f64) -> Vector3<f64> {
        self.0.place_at(t_s).position_m
    }
}
