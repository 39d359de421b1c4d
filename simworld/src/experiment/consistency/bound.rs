//! What nobody can do better than: the batch over everything that a vehicle heard in the whole flight, told the true
//! noise, the true biases and which measurements are wrong.
//!
//! It is started from the poses of a flight of the team estimator that was told the same, never from truth: its cost has
//! other minima, and near truth it would find the one that no estimator can know.

use super::flight::{Flight, Heard};
use super::history::History;
use nalgebra::{DMatrix, DMatrixView, Matrix3, Matrix6};
use skein_estimation::cooperative::{
    Edge, Graph, Kind, Measurement, NodeIndex, Optimiser, Refusal, Weight, solve,
};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform, World, se3};
use std::collections::BTreeMap;

/// The batch's answer.
#[derive(Clone, Debug)]
pub struct Bound {
    /// Everybody's last pose that was heard.
    pub team: Vec<Transform<World, Body>>,
    /// The covariance of the own last pose, of a twist on its right, rotation first (rad, m). None when rounds came late
    /// or never: the equations are then not those of a chain of rounds.
    pub covariance: Option<Matrix6<f64>>,
}

/// The bound of what was heard.
///
/// # Errors
/// [`Refusal`] when the history holds what is no measurement.
pub fn of(history: &History, heard: &Heard, flown: &Flight) -> Result<Bound, Refusal> {
    let mut graph = Graph::new();
    let mut nodes: BTreeMap<(usize, usize), NodeIndex> = BTreeMap::new();
    let starts = started_from(history, heard, flown);
    for (&(k, vehicle), start) in &starts {
        let node = graph.add_node(*start)?;
        if k == 0 {
            graph.hold(node)?;
        }
        nodes.insert((k, vehicle), node);
    }
    let mut last: Vec<usize> = vec![0; history.team()];
    for (&(k, vehicle), &node) in &nodes {
        if k > 0 {
            let before = nodes[&(last[vehicle], vehicle)];
            graph.add_edge(before, node, odometry(history, vehicle, last[vehicle], k)?)?;
        }
        last[vehicle] = k;
    }
    for round in &heard.rounds {
        for &(k, nth) in &round.sightings {
            let sighting = &history.rounds[k].sightings[nth];
            if sighting.is_wrong {
                continue;
            }
            let observation = &sighting.observation;
            let edge = Edge::with_offsets(
                observation.measurement,
                weight(&observation.measurement, observation.noise),
                observation.from_end,
                observation.to_end,
            )?;
            graph.add_edge(nodes[&(k, sighting.from)], nodes[&(k, sighting.to)], edge)?;
        }
        for &(k, nth) in &round.fixes {
            let fix = &history.rounds[k].fixes[nth];
            let observation = &fix.observation;
            graph.add_fix(
                nodes[&(k, fix.of)],
                observation.measurement,
                weight(&observation.measurement, observation.noise),
                observation.to_end,
            )?;
        }
    }
    solve(&mut graph, &Optimiser::gauss_newton(), |_| ());
    let pose = |vehicle: usize| {
        let node = nodes[&(last[vehicle], vehicle)];
        *graph.pose(node).expect("added above")
    };
    let everything = history.team() * history.rounds.len();
    let covariance = (nodes.len() == everything).then(|| covariance(&graph, history, heard.own));
    Ok(Bound {
        team: (0..history.team()).map(pose).collect(),
        covariance: covariance.flatten(),
    })
}

/// Where each pose that was heard was flown when it was: by the estimate of its vehicle then, and the odometry between.
fn started_from(
    history: &History,
    heard: &Heard,
    flown: &Flight,
) -> BTreeMap<(usize, usize), Transform<World, Body>> {
    let k_of: BTreeMap<Stamp, usize> = (0..)
        .zip(&history.rounds)
        .map(|(k, round)| (round.moments[0].instant, k))
        .collect();
    let mut starts = BTreeMap::new();
    for (round, estimates) in heard.rounds.iter().zip(&flown.rounds) {
        for &(k, vehicle) in &round.moments {
            let (instant, pose) = &estimates.team[vehicle];
            let on_the_way = history.step(vehicle, k_of[instant], k);
            let start = if k == 0 {
                history.starts[vehicle]
            } else {
                *pose * on_the_way
            };
            starts.insert((k, vehicle), start);
        }
    }
    starts
}

fn odometry(
    history: &History,
    vehicle: usize,
    earlier: usize,
    later: usize,
) -> Result<Edge, Refusal> {
    let point = |k: usize| &history.rounds[k].moments[vehicle].point;
    let growth = point(later).growth.since(&point(earlier).growth);
    // On the body's side of the later end, as the twist residual has it.
    let to_body = se3::adjoint(&point(later).odometry_from_body.inverse());
    let covariance = to_body * growth.covariance() * to_body.transpose();
    let information = covariance.try_inverse().ok_or(Refusal::BadWeight)?;
    let information = (information + information.transpose()) * 0.5;
    let step = history.step(vehicle, earlier, later);
    Edge::new(
        Measurement::pose(step.reframe())?,
        Weight::Information(information),
    )
}

/// A pose by its information, whose residual is that of its noise; anything else by its noise.
fn weight(measurement: &Measurement, noise: skein_estimation::cooperative::Noise) -> Weight {
    if measurement.kind() != Kind::Pose {
        return Weight::Noise(noise);
    }
    let (rotation, translation) = (noise.rotation_rad.powi(-2), noise.translation.powi(-2));
    let mut information = Matrix6::identity() * rotation;
    information
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(Matrix3::identity() * translation));
    Weight::Information(information)
}

/// The covariance of a vehicle's last pose when every round is there, in order: round after round is eliminated.
fn covariance(graph: &Graph, history: &History, own: usize) -> Option<Matrix6<f64>> {
    let (team, last) = (history.team(), history.last());
    let width = 6 * team;
    // The reference is node 0, then round by round.
    let place = |node: NodeIndex| {
        let node = node.get().checked_sub(1)?;
        (node >= team).then_some((node / team, 6 * (node % team)))
    };
    let mut diagonal = vec![DMatrix::<f64>::zeros(width, width); last + 1];
    // Of a round's rows and the columns of the one before.
    let mut across = vec![DMatrix::<f64>::zeros(width, width); last + 1];
    let add = |matrix: &mut DMatrix<f64>, row, column, block: &Matrix6<f64>| {
        let mut view = matrix.fixed_view_mut::<6, 6>(row, column);
        view += block;
    };
    for edge in graph.edges() {
        let ends = (graph.pose(edge.from)?, graph.pose(edge.to)?);
        let (normal, _) = edge.edge.linearise(ends.0, ends.1);
        let (from, to) = (place(edge.from), place(edge.to));
        if let Some((k, at)) = from {
            add(&mut diagonal[k], at, at, &normal.from_from);
        }
        if let Some((k, at)) = to {
            add(&mut diagonal[k], at, at, &normal.to_to);
        }
        if let (Some((from_k, from_at)), Some((to_k, to_at))) = (from, to) {
            let block = &normal.from_to;
            if from_k == to_k {
                add(&mut diagonal[from_k], from_at, to_at, block);
                add(&mut diagonal[from_k], to_at, from_at, &block.transpose());
            } else {
                add(&mut across[to_k], to_at, from_at, &block.transpose());
            }
        }
    }
    let mut kept = diagonal[1].clone();
    for k in 2..=last {
        let eliminated = kept.cholesky()?.solve(&across[k].transpose());
        kept = &diagonal[k] - &across[k] * eliminated;
    }
    let all = kept.cholesky()?.inverse();
    let block: DMatrixView<'_, f64> = all.view((6 * own, 6 * own), (6, 6));
    let block = Matrix6::from_iterator(block.iter().copied());
    // From (w, world displacement) to a twist on the body's side.
    let pose = graph.nodes()[1 + last * team + own];
    let mut to_twist = Matrix6::identity();
    to_twist
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(pose.rotation.inverse().to_rotation_matrix().matrix());
    Some(to_twist * block * to_twist.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::consistency::hearing::{Air, Hearing};
    use crate::experiment::consistency::{flight, history, mistakes};
    use crate::scenario::Scenario;
    use crate::streams::{Purpose, Streams};
    use crate::world::World as Flown;
    use skein_estimation::cooperative::team::Settings;
    use skein_estimation::time::Span;

    fn bound(history: &History, air: &Air) -> Bound {
        let hearing = Hearing::new(air, history.team(), history.last(), &Streams::new(1, 0));
        let heard = Heard::new(history, &hearing, 0);
        let flown = flight::fly(
            history,
            &heard,
            Settings::DEFAULT,
            Span::millis(200),
            |sighting| !sighting.is_wrong,
        );
        of(history, &heard, &flown).unwrap()
    }

    fn short() -> History {
        let mut scenario = Scenario::built_in("section-v").unwrap();
        scenario.duration_s = 4.0;
        scenario.team.truncate(3);
        history::record(&mut Flown::new(&scenario, 0)).unwrap()
    }

    #[test]
    fn what_is_wrong_is_not_in_the_bound() {
        let (clean, mut wrong) = (short(), short());
        mistakes::gross(
            &mut wrong,
            0.3,
            &mut Streams::new(1, 0).vehicle(0, Purpose::Outlier),
        );
        let mut without = clean;
        for (round, wrong) in without.rounds.iter_mut().zip(&wrong.rounds) {
            let mut sightings = wrong.sightings.iter();
            round
                .sightings
                .retain(|_| sightings.next().is_some_and(|sighting| !sighting.is_wrong));
        }
        let (with, without) = (bound(&wrong, &Air::PERFECT), bound(&without, &Air::PERFECT));
        for (with, without) in with.team.iter().zip(&without.team) {
            assert!((with.translation - without.translation).norm() < 1e-9);
        }
    }

    #[test]
    fn odometry_alone_ends_where_dead_reckoning_does_with_the_covariance_that_it_gathered() {
        let mut history = short();
        for round in &mut history.rounds {
            round.sightings.clear();
        }
        let bound = bound(&history, &Air::PERFECT);
        let last = history.last();
        let reckoned = history.starts[0] * history.step(0, 0, last);
        assert!((bound.team[0].translation - reckoned.translation).norm() < 1e-6);
        let point = &history.rounds[last].moments[0].point;
        let to_body = se3::adjoint(&point.odometry_from_body.inverse());
        let gathered = to_body * point.growth.covariance() * to_body.transpose();
        let off = (bound.covariance.unwrap() - gathered).norm() / gathered.norm();
        assert!(off < 1e-6, "{off}");
    }

    #[test]
    fn who_hears_less_has_another_bound_and_no_covariance() {
        let history = short();
        let lossy = Air {
            loss: 0.5,
            ..Air::PERFECT
        };
        let (all, some) = (bound(&history, &Air::PERFECT), bound(&history, &lossy));
        assert!(all.covariance.is_some() && some.covariance.is_none());
        assert!((all.team[0].translation - some.team[0].translation).norm() > 1e-6);
    }
}
