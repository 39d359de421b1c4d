//! Whether windows of distances find their global optimum (Cornejo & Nagpal, Algorithm 1), beside the rule that accepts
//! or refuses it: the best fit may be found and still be another place than the true one.
//!
//! The optimum is the least cost that any of all starts leads to, those of the solver and a dense grid of [`GRID_SIDE`]
//! bearings times as many relative yaws, all at the distance that was measured last.

use super::errors::Estimate;
use super::errors::localiser::ROUNDS;
use super::errors::pair::{Pair, Turns};
use crate::planar_swarm::SwarmNoise;
use crate::statistics::{mean_and_stderr, ratio_and_stderr};
use crate::streams::Streams;
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::ranging::Window;
use skein_estimation::ranging::window::{Criterion, Modes, Observability, Starts, WindowSettings};
use std::fmt::Write;

/// Lengths of the windows.
pub const LENGTHS: [usize; 4] = [3, 4, 5, 6];
/// Bearings of the grid, and relative yaws: 324 starts.
pub const GRID_SIDE: usize = 18;
/// Costs that differ by less are taken for the same: one place is then at most 5 % likelier than the other, and two are told
/// apart by nine.
pub const SAME_COST: f64 = 0.1;
/// The same, strictly: about what the last steps of a descent are worth.
pub const SAME_COST_STRICTLY: f64 = 0.01;
/// A place that is farther off (m) is another place.
pub const WRONG_M: f64 = 3.0;

/// The windows of one length: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LengthResult {
    /// Distances in each window.
    pub ranges: usize,
    /// Windows, each of a pair of its own.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// What the sensors added.
    pub noise: SwarmNoise,
    /// Share of windows of which the solver's starts lead to the optimum.
    pub found: Estimate,
    /// The same, strictly: where no angle is well known, descents come to rest at different points of one wide minimum.
    pub found_strictly: Estimate,
    /// By how much the worst of the others misses its cost.
    pub worst_miss: f64,
    /// Share of windows of which the optimum is more than 3 m from the truth: no solver does better.
    pub optimum_wrong: Estimate,
    /// Share of windows that are accepted: one place, known to a metre, without any prior.
    pub accepted: Estimate,
    /// Share of those accepted that are more than 3 m off; nothing when none is accepted.
    pub accepted_wrong: Option<Estimate>,
}

/// What came of one window.
struct Solved {
    /// By how much the solver's best fit costs more than the optimum.
    miss: f64,
    /// How far the optimum is from the truth (m).
    optimum_off_m: f64,
    accepted: bool,
    /// How far the solver's best fit is from the truth (m).
    off_m: f64,
}

/// Solves the windows of a length at the usual noise. `solved` is called after each, from any thread.
#[must_use]
pub fn run(ranges: usize, samples: u64, seed: u64, solved: impl Fn() + Sync) -> LengthResult {
    let windows: Vec<Solved> = (0..samples)
        .into_par_iter()
        .map(|sample| {
            let window = Solved::of(ranges, sample, seed);
            solved();
            window
        })
        .collect();
    LengthResult::of(ranges, &windows, seed)
}

impl Solved {
    fn of(ranges: usize, sample: u64, seed: u64) -> Self {
        let noise = SwarmNoise::USUAL;
        // Windows end at all rounds alike: the later ones are of pairs that have drifted apart.
        let rounds = (ROUNDS + 1 - ranges) as u64;
        let before = (sample % rounds) as usize;
        let streams = Streams::new(seed, sample);
        let pair = Pair::gone(Turns::Together, before + ranges, noise, &streams);
        let mut window = Window::new();
        for sample in &pair.samples()[before..] {
            // A distance that is refused leaves the window shorter, and a shorter one is solved no worse.
            let _ = window.push(sample);
        }
        let solve = |starts| window.solve(&WindowSettings::PLANAR, starts, None);
        let (ours, grid) = (solve(Starts::Exhaustive), solve(Starts::Grid(GRID_SIDE)));
        let cost = |modes: &Modes| modes.best().map_or(f64::INFINITY, |best| best.cost);
        let optimum = cost(&ours).min(cost(&grid));
        let [own, other] = pair.rounds[before + ranges - 1].places;
        let truth_m = other.seen_from(&own).position_m;
        let off_m = |modes: &Modes| {
            let best = modes.best();
            best.map_or(f64::INFINITY, |best| {
                (best.pose.position_m.xy() - truth_m).norm()
            })
        };
        let is_ours = cost(&ours) <= optimum;
        Self {
            miss: cost(&ours) - optimum,
            optimum_off_m: off_m(if is_ours { &ours } else { &grid }),
            accepted: ours.observability(&Criterion::DEFAULT) == Observability::Observable,
            off_m: off_m(&ours),
        }
    }
}

impl LengthResult {
    fn of(ranges: usize, windows: &[Solved], seed: u64) -> Self {
        let share = |of: &dyn Fn(&Solved) -> bool| {
            let (mean, stderr) = mean_and_stderr(windows.iter().map(|one| f64::from(of(one))));
            Estimate { mean, stderr }
        };
        let count = |of: &dyn Fn(&Solved) -> bool| -> Vec<f64> {
            windows.iter().map(|one| f64::from(of(one))).collect()
        };
        let accepted = share(&|one| one.accepted);
        let accepted_wrong = (accepted.mean > 0.0).then(|| {
            let wrong = count(&|one| one.accepted && one.off_m > WRONG_M);
            let (mean, stderr) = ratio_and_stderr(&wrong, &count(&|one| one.accepted));
            Estimate { mean, stderr }
        });
        Self {
            ranges,
            samples: windows.len() as u64,
            seed,
            noise: SwarmNoise::USUAL,
            found: share(&|one| one.miss < SAME_COST),
            found_strictly: share(&|one| one.miss < SAME_COST_STRICTLY),
            worst_miss: windows.iter().map(|one| one.miss).fold(0.0, f64::max),
            optimum_wrong: share(&|one| one.optimum_off_m > WRONG_M),
            accepted,
            accepted_wrong,
        }
    }
}

/// The results as people read them.
#[must_use]
pub fn table(results: &[LengthResult]) -> String {
    let starts = GRID_SIDE * GRID_SIDE;
    let mut text = format!(
        "usual noise (0.1 m, 0.05 m, 0.01 rad); optimum: least cost of all starts, the solver's and a grid of {starts}; \
         found: within {SAME_COST} of it, strictly within {SAME_COST_STRICTLY}; wrong: more than {WRONG_M} m off\n\
         distances  windows   optimum found, %   strictly, %         worst miss   optimum wrong, %   accepted, %        \
         of these wrong, %\n"
    );
    let percent = |share: &Estimate| {
        format!(
            "{:>7.3} +- {:<5.3}",
            100.0 * share.mean,
            100.0 * share.stderr
        )
    };
    for one in results {
        let wrong = one.accepted_wrong.as_ref();
        let _ = writeln!(
            text,
            "{:<10} {:>7}   {}   {}   {:>10.3}   {}   {}   {}",
            one.ranges,
            one.samples,
            percent(&one.found),
            percent(&one.found_strictly),
            one.worst_miss,
            percent(&one.optimum_wrong),
            percent(&one.accepted),
            wrong.map_or_else(|| "      -".to_owned(), percent),
        );
    }
    text
}

/// Every length, one row each.
#[must_use]
pub fn csv(results: &[LengthResult]) -> String {
    let mut text = String::from(
        "ranges,samples,seed,found,found_stderr,found_strictly,found_strictly_stderr,worst_miss,optimum_wrong,\
         optimum_wrong_stderr,accepted,accepted_stderr,accepted_wrong,accepted_wrong_stderr\n",
    );
    let cells = |share: &Estimate| format!("{},{}", share.mean, share.stderr);
    for one in results {
        let wrong = one.accepted_wrong.as_ref();
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{}",
            one.ranges,
            one.samples,
            one.seed,
            cells(&one.found),
            cells(&one.found_strictly),
            one.worst_miss,
            cells(&one.optimum_wrong),
            cells(&one.accepted),
            wrong.map_or_else(|| ",".to_owned(), cells),
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_windows_miss_their_optimum_and_three_distances_are_never_accepted() {
        let results = LENGTHS.map(|ranges| run(ranges, 40, 1, || {}));
        for one in &results {
            assert!(one.found.mean >= 0.97, "{one:?}");
        }
        let [three, .., six] = &results;
        assert_eq!((three.accepted.mean, three.accepted_wrong), (0.0, None));
        assert!(six.accepted.mean > 0.1, "{six:?}");
        assert_eq!(csv(&results).lines().count(), 1 + LENGTHS.len());
        assert_eq!(table(&results).lines().count(), 2 + LENGTHS.len());
    }

    #[test]
    fn shares_of_the_accepted_are_of_these_alone() {
        let solved = |miss, accepted, off_m| Solved {
            miss,
            optimum_off_m: 0.0,
            accepted,
            off_m,
        };
        let windows = [
            solved(0.0, true, 1.0),
            solved(0.04, true, 4.0),
            solved(0.0, false, 9.0),
            solved(2.0, false, 1.0),
        ];
        let result = LengthResult::of(4, &windows, 1);
        assert_eq!((result.found.mean, result.worst_miss), (0.75, 2.0));
        assert_eq!(result.accepted.mean, 0.5);
        assert_eq!(result.accepted_wrong.map(|wrong| wrong.mean), Some(0.5));
    }
}
