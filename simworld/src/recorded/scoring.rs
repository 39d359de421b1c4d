//! How far off the robots of a recording were that flew again, by motion capture, and whether they knew it.

use super::{Assigned, Recorded};
use crate::evaluation::{Scored, Space, TeamScore, covariance_of, planar_nees, score_team};
use crate::fleet::pose_of;
use crate::stage::Stage;
use crate::truth::{Pose, yaw_rad};
use crate::tum::StampedPose;
use nalgebra::Matrix6;
use serde::Serialize;
use skein_proto::document::{CovarianceDocument, EstimateDocument, PoseDocument};

/// A pose that a robot told, and how sure it was.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sure {
    /// When, in nanoseconds since the zero.
    at_ns: i64,
    pose: Pose,
    /// Of a twist on the body's side of the pose, rotation (rad) first, then translation (m).
    covariance: Option<Matrix6<f64>>,
}

/// What one robot told at one instant: where it is, and where it has the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Reported {
    own: Sure,
    /// By the others' indices: `body_from_neighbour`.
    neighbours: Vec<(usize, Sure)>,
}

/// What every robot told over time, to be scored: `[instant][robot]`.
#[derive(Clone, Debug, Default)]
pub struct Flown {
    instants: Vec<Vec<Option<Reported>>>,
}

/// The scores of one flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplayScore {
    /// Of the estimates.
    pub team: Score,
    /// Of odometry alone at the same times.
    pub dead_reckoning: Score,
    /// One row a robot.
    pub robots: Vec<RobotScore>,
    /// NEES of the own poses that were told with a covariance, in the plane (heading and two lengths), a degree of
    /// freedom: one when it means what it says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nees: Option<f64>,
    /// The same of where each robot has each other.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative_nees: Option<f64>,
    /// How often the right robot was found, when identities were dropped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identities: Option<Assigned>,
}

/// The team's score.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Poses scored.
    pub poses: usize,
    /// RMSE of the position.
    pub position_rmse_m: f64,
    /// Mean of the position error.
    pub position_mean_m: f64,
    /// RMSE of the heading.
    pub heading_rmse_rad: f64,
    /// RMSE of the positions after the whole team is laid onto the truth at each instant.
    pub instant_rmse_m: f64,
    /// RMSE of each robot's position in each other's frame.
    pub relative_rmse_m: f64,
}

/// One robot's score.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RobotScore {
    /// Its name.
    pub robot: String,
    /// RMSE of the position.
    pub position_rmse_m: f64,
    /// Mean of the position error.
    pub position_mean_m: f64,
    /// RMSE of the heading.
    pub heading_rmse_rad: f64,
    /// The same of odometry alone.
    pub dead_reckoning_rmse_m: f64,
}

impl From<TeamScore> for Score {
    fn from(score: TeamScore) -> Self {
        Self {
            poses: score.n_poses,
            position_rmse_m: score.position_rmse_m,
            position_mean_m: score.position_mean_m,
            heading_rmse_rad: score.heading_rmse_rad,
            instant_rmse_m: score.instant_rmse_m,
            relative_rmse_m: score.relative_rmse_m,
        }
    }
}

impl Sure {
    /// None without a covariance.
    fn nees(&self, truth: &Pose) -> Option<f64> {
        planar_nees(&self.pose, &self.covariance?, truth)
    }
}

impl Reported {
    /// What a robot's estimate says; none while it has no pose.
    #[must_use]
    pub fn of(estimate: &EstimateDocument, recorded: &Recorded, robot: usize) -> Option<Self> {
        let sure = |taken_ns, pose: &PoseDocument, covariance: Option<&CovarianceDocument>| Sure {
            at_ns: recorded.time_ns(robot, taken_ns),
            pose: pose_of(pose),
            covariance: covariance.and_then(covariance_of),
        };
        let own_pose = estimate.pose.as_ref()?;
        let neighbours = estimate.neighbours.iter().filter_map(|neighbour| {
            let index =
                (0..recorded.vehicles()).find(|of| recorded.name(*of) == neighbour.vehicle)?;
            let (taken_ns, pose) = (neighbour.taken_ns?, neighbour.pose.as_ref()?);
            Some((index, sure(taken_ns, pose, neighbour.covariance.as_ref())))
        });
        Some(Self {
            own: sure(estimate.taken_ns, own_pose, estimate.covariance.as_ref()),
            neighbours: neighbours.collect(),
        })
    }

    /// NEES of the own pose; none without truth or covariance.
    fn nees(&self, recorded: &Recorded, robot: usize) -> Option<f64> {
        self.own.nees(&recorded.truth(robot, self.own.at_ns)?)
    }

    /// NEES of where each other is.
    fn relative_nees(&self, recorded: &Recorded, robot: usize) -> impl Iterator<Item = f64> {
        let own = recorded.truth(robot, self.own.at_ns);
        self.neighbours.iter().filter_map(move |(index, sure)| {
            let neighbour = recorded.truth(*index, sure.at_ns)?;
            sure.nees(&(own?.inverse() * neighbour))
        })
    }
}

impl Flown {
    /// Adds the newest estimates of all robots at one instant.
    pub fn push(&mut self, estimates: Vec<Option<Reported>>) {
        self.instants.push(estimates);
    }

    /// Everything told, with who told it.
    fn reported(&self) -> impl Iterator<Item = (usize, &Reported)> {
        let robots = self
            .instants
            .iter()
            .flat_map(|instant| instant.iter().enumerate());
        robots.filter_map(|(robot, told)| Some((robot, told.as_ref()?)))
    }

    /// Scores everything against the truth of the recording; none when there is nothing to score.
    #[must_use]
    pub fn score(&self, recorded: &Recorded) -> Option<ReplayScore> {
        let estimates = self.scored(recorded, |_, _, estimate| estimate);
        let reckoned: Vec<Vec<Pose>> = (0..recorded.vehicles())
            .map(|robot| self.reckon(recorded, robot))
            .collect();
        let odometry = self.scored(recorded, |instant, robot, _| reckoned[robot][instant]);
        let robots = (0..recorded.vehicles()).map(|robot| {
            let of = |all: &[Vec<Option<Scored>>]| robot_errors(all, robot);
            let (position, heading) = of(&estimates);
            let (by_odometry, _) = of(&odometry);
            RobotScore {
                robot: recorded.name(robot).to_string(),
                position_rmse_m: root_mean_square(&position),
                position_mean_m: position.iter().sum::<f64>() / position.len() as f64,
                heading_rmse_rad: root_mean_square(&heading),
                dead_reckoning_rmse_m: root_mean_square(&by_odometry),
            }
        });
        Some(ReplayScore {
            team: score_team(&estimates, Space::Planar)?.into(),
            dead_reckoning: score_team(&odometry, Space::Planar)?.into(),
            robots: robots.collect(),
            nees: mean(
                self.reported()
                    .filter_map(|(robot, told)| told.nees(recorded, robot)),
            ),
            relative_nees: mean(
                self.reported()
                    .flat_map(|(robot, told)| told.relative_nees(recorded, robot)),
            ),
            identities: recorded.assigned(),
        })
    }

    /// Odometry alone at the times of a robot's estimates; where it has none, at the time before.
    fn reckon(&self, recorded: &Recorded, robot: usize) -> Vec<Pose> {
        let mut last = 0;
        let times: Vec<i64> = self
            .instants
            .iter()
            .map(|estimates| {
                last = estimates[robot]
                    .as_ref()
                    .map_or(last, |told| told.own.at_ns.max(last));
                last
            })
            .collect();
        recorded.dead_reckoning(robot, &times)
    }

    fn scored(
        &self,
        recorded: &Recorded,
        of: impl Fn(usize, usize, Pose) -> Pose,
    ) -> Vec<Vec<Option<Scored>>> {
        let score = |instant: usize, robot: usize, told: &Option<Reported>| {
            let Sure { at_ns, pose, .. } = told.as_ref()?.own;
            let truth = recorded.truth(robot, at_ns)?;
            Some(Scored {
                truth,
                estimate: of(instant, robot, pose),
            })
        };
        let instants = self.instants.iter().enumerate();
        instants
            .map(|(instant, all)| {
                all.iter()
                    .enumerate()
                    .map(|(robot, one)| score(instant, robot, one))
                    .collect()
            })
            .collect()
    }

    /// Truth, estimate and odometry of one robot, in that order.
    #[must_use]
    pub fn trajectories(&self, recorded: &Recorded, robot: usize) -> [Vec<StampedPose>; 3] {
        let mut tracks: [Vec<StampedPose>; 3] = Default::default();
        let reckoned = self.reckon(recorded, robot);
        for (estimates, reckoned) in self.instants.iter().zip(reckoned) {
            let Some(Reported { own, .. }) = &estimates[robot] else {
                continue;
            };
            let (at_ns, estimate) = (own.at_ns, own.pose);
            let time_s = (recorded.start_ns + at_ns) as f64 * 1e-9;
            tracks[0].extend(
                recorded
                    .truth(robot, at_ns)
                    .map(|pose| StampedPose { time_s, pose }),
            );
            tracks[1].push(StampedPose {
                time_s,
                pose: estimate,
            });
            tracks[2].push(StampedPose {
                time_s,
                pose: reckoned,
            });
        }
        tracks
    }
}

/// Position errors (m) and heading errors (rad) of one robot.
fn robot_errors(all: &[Vec<Option<Scored>>], robot: usize) -> (Vec<f64>, Vec<f64>) {
    let scored = all.iter().filter_map(|instant| instant[robot].as_ref());
    scored
        .map(|Scored { truth, estimate }| {
            let apart = (truth.translation.vector - estimate.translation.vector)
                .xy()
                .norm();
            (
                apart,
                crate::truth::wrapped_rad(yaw_rad(estimate) - yaw_rad(truth)),
            )
        })
        .unzip()
}

fn root_mean_square(errors: &[f64]) -> f64 {
    (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
}

/// None of nothing.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u64), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}
