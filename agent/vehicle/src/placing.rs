//! Placing a vehicle that has no pose of its own: what neighbours and fixes say of it in single rounds becomes its pose
//! when two rounds agree, so that one wrong measurement never does.

use std::collections::VecDeque;

use skein_estimation::cooperative::{Optimiser, SolveStatus, Star, StarWorkspace};
use skein_estimation::odometry::OdometryPoint;
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Odometry, Transform, World};

use crate::gathering::Gathered;
use crate::local_star::{Built, Centre};
use crate::translate;

/// Rounds that are remembered.
const PROPOSALS_MAX: usize = 8;
/// For how long.
const PROPOSED_FOR: Span = Span::secs(2);
/// Two rounds agree when they are no further apart than good priors and measurements are.
const AGREE_WITHIN_M: f64 = 1.0;
const AGREE_WITHIN_RAD: f64 = 0.5;
/// An answer that explains the measurements within this cost (rad^2 and m^2), or nearly as well as the best, is a rival.
const RIVAL_COST_MIN: f64 = 0.1;

/// What single rounds said lately.
#[derive(Clone, Debug, Default)]
pub(crate) struct Placing {
    proposals: VecDeque<Proposal>,
}

#[derive(Clone, Copy, Debug)]
struct Proposal {
    instant: Stamp,
    segment: u8,
    world_from_odometry: Transform<World, Odometry>,
}

impl Placing {
    /// One round says that the vehicle was at `world_from_body` at this point of odometry. True when a round before it
    /// said the same.
    pub(crate) fn propose(
        &mut self,
        instant: Stamp,
        point: &OdometryPoint,
        world_from_body: &Transform<World, Body>,
    ) -> bool {
        self.proposals.retain(|before| {
            instant - before.instant <= PROPOSED_FOR && before.segment == point.segment
        });
        let agrees = self.proposals.iter().any(|before| {
            agree(
                &(before.world_from_odometry * point.odometry_from_body),
                world_from_body,
            )
        });
        if self.proposals.len() >= PROPOSALS_MAX {
            self.proposals.pop_front();
        }
        self.proposals.push_back(Proposal {
            instant,
            segment: point.segment,
            world_from_odometry: *world_from_body * point.odometry_from_body.inverse(),
        });
        if agrees {
            self.proposals.clear();
        }
        agrees
    }
}

/// What one round says of a vehicle without a pose.
pub(crate) struct Found {
    /// Where it was at the round's instant; none when the round does not determine it.
    pub(crate) pose: Option<Transform<World, Body>>,
    /// The star that was built last.
    pub(crate) built: Built,
}

/// Looks for this vehicle's pose by what was measured alone, from each start. Nothing is found unless all six degrees of
/// freedom are determined, and the best answer is clearly better than any other.
pub(crate) fn search(
    star: &mut Star,
    workspace: &mut StarWorkspace,
    optimiser: &Optimiser,
    gathered: &Gathered<'_>,
    starts: &[Centre],
) -> Found {
    let mut built = Built {
        refused: gathered.refused.clone(),
        ..Built::nothing()
    };
    let mut answers: Vec<(f64, Transform<World, Body>)> = Vec::new();
    for start in starts {
        built = gathered.build(star, *start);
        let solution = star.solve(workspace, optimiser);
        let settled = solution.status == SolveStatus::Converged && solution.unobservable == 0;
        let world_from_body =
            solution.world_from_body.reframe() * built.instant_from_solved.inverse();
        if settled && translate::is_sayable(&world_from_body) {
            answers.push((solution.cost_after, world_from_body));
        }
    }
    answers.sort_by(|a, b| a.0.total_cmp(&b.0));
    let pose = answers.first().and_then(|(cost, best)| {
        let rival = answers.iter().find(|(_, other)| !agree(best, other));
        let clear = rival.is_none_or(|(other, _)| *other > RIVAL_COST_MIN.max(4.0 * cost));
        clear.then_some(*best)
    });
    Found { pose, built }
}

/// Whether two poses may be one.
pub(crate) fn agree(a: &Transform<World, Body>, b: &Transform<World, Body>) -> bool {
    let apart = a.inverse() * *b;
    apart.translation.norm() <= AGREE_WITHIN_M && apart.rotation.angle() <= AGREE_WITHIN_RAD
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};
    use skein_estimation::odometry::Growth;

    fn driven(metres: f64, segment: u8) -> OdometryPoint {
        OdometryPoint {
            taken: Stamp::default(),
            segment,
            odometry_from_body: Transform::new(
                UnitQuaternion::identity(),
                Vector3::new(metres, 0.0, 0.0),
            ),
            growth: Growth::zero(),
        }
    }

    fn at(x: f64) -> Transform<World, Body> {
        Transform::new(UnitQuaternion::identity(), Vector3::new(x, 0.0, 0.0))
    }

    fn millis(ms: i64) -> Stamp {
        Stamp::default() + Span::millis(ms)
    }

    #[test]
    fn two_rounds_that_agree_place_a_vehicle_and_a_wrong_one_between_them_does_not() {
        let mut placing = Placing::default();
        assert!(!placing.propose(millis(0), &driven(0.0, 0), &at(10.0)));
        assert!(!placing.propose(millis(200), &driven(0.5, 0), &at(-40.0)));
        assert!(placing.propose(millis(400), &driven(1.0, 0), &at(11.1)));
    }

    #[test]
    fn what_was_said_long_ago_or_before_an_interruption_does_not_count() {
        let mut placing = Placing::default();
        assert!(!placing.propose(millis(0), &driven(0.0, 0), &at(10.0)));
        assert!(!placing.propose(millis(2001), &driven(0.0, 0), &at(10.0)));
        assert!(!placing.propose(millis(2200), &driven(0.0, 1), &at(10.0)));
    }

    #[test]
    fn proposals_are_bounded() {
        let mut placing = Placing::default();
        for k in 0..=PROPOSALS_MAX as i64 {
            assert!(!placing.propose(millis(k), &driven(0.0, 0), &at(10.0 * k as f64)));
        }
        assert_eq!(placing.proposals.len(), PROPOSALS_MAX);
    }
}
