//! Feature sets as what a registration takes, and a registration's outcome as what the filter of one neighbour takes.

use super::Seen;
use crate::mutual::direction::turned;
use crate::mutual::feature_set::FeatureSet;
use crate::mutual::filter::mixture::Answer;
use crate::mutual::registration::{Outcome, Sighting};
use crate::vehicle_id::VehicleId;

/// What a registration says of one neighbour: answers, and log-likelihoods of the solutions that leave it out.
///
/// A solution is believed by its sightings and by how it agrees with what is believed of the *others*; what is believed of
/// this neighbour itself comes in when its filter weighs the answers.
pub(super) fn answers(outcome: &Outcome, vehicle: VehicleId) -> (Vec<Answer>, Vec<f64>) {
    let (mut answers, mut elsewhere) = (Vec::new(), Vec::new());
    for solution in &outcome.solutions {
        let placed = solution
            .placed
            .iter()
            .find(|placed| placed.vehicle == vehicle);
        match placed {
            Some(placed) => answers.push(Answer {
                direction: placed.direction,
                yaw_rad: placed.yaw_rad,
                covariance_rad2: placed.covariance,
                log_likelihood: solution.log_likelihood + placed.log_cavity,
                own_feature: placed.mine,
            }),
            None => elsewhere.push(solution.log_likelihood + solution.log_belief),
        }
    }
    (answers, elsewhere)
}

/// What a set's vehicle sees, in a level frame that is turned by so much from the gyro frame.
pub(super) fn sightings(set: &FeatureSet, seen: Seen, level_from_gyro_rad: f64) -> Vec<Sighting> {
    match seen {
        Seen::Features => {
            let turn_rad = level_from_gyro_rad + set.inertial.yaw_rad;
            let sighting = |feature| {
                let seen = Sighting::from(feature);
                Sighting {
                    direction: turned(&seen.direction, turn_rad),
                    ..seen
                }
            };
            set.features.iter().map(sighting).collect()
        }
        Seen::Tracks => {
            let confirmed = set.tracks.iter().filter(|track| track.confirmed);
            confirmed
                .map(|track| Sighting {
                    direction: turned(&track.direction, level_from_gyro_rad),
                    sigma_rad: track.variance_rad2.max(0.0).sqrt(),
                })
                .collect()
        }
    }
}
