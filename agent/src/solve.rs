//! `skein solve FILE`: the centralised algorithm on a pose-graph file.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic as _, WrapErr as _};
use serde::Serialize;
use skein_estimation::cooperative::{Degeneracy, Optimiser, SolveStatus, solve};

use crate::pose_graph::{self, FILE_BYTES_MAX, PoseGraph};

/// Arguments of `skein solve`.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example:
  skein solve agent/examples/square.graph")]
pub struct SolveArgs {
    /// Pose-graph file: g2o (SE3:QUAT), or its text form with the other kinds of measurement.
    pub file: PathBuf,
    /// Write the file again with the solved poses.
    #[arg(long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print the summary as JSON.
    #[arg(long)]
    pub json: bool,
    /// How to minimise the cost.
    #[arg(long, value_enum, default_value_t = OptimiserName::GaussNewton)]
    pub optimiser: OptimiserName,
    /// Stop after this many iterations.
    #[arg(long, value_name = "N")]
    pub max_iterations: Option<usize>,
}

/// The optimisers by the names of the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum OptimiserName {
    /// Gauss-Newton with a step test and damping: a handful of iterations.
    GaussNewton,
    /// The paper's Riemannian descent with Armijo's step: provably convergent and slow.
    Descent,
}

impl OptimiserName {
    fn optimiser(self, iterations_max: Option<usize>) -> Optimiser {
        let optimiser = match self {
            Self::GaussNewton => Optimiser::gauss_newton(),
            Self::Descent => Optimiser::descent(),
        };
        iterations_max.map_or(optimiser, |limit| optimiser.with_iterations_max(limit))
    }
}

/// What a solve gave; the JSON of `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Vertices in the file.
    pub vertices: usize,
    /// Measurements and fixes in the file.
    pub measurements: usize,
    /// Which optimiser ran.
    pub optimiser: OptimiserName,
    /// Why it stopped: `converged`, `nothing measured`, `iteration limit`, `stalled`, `unobservable`,
    /// `coincident ends`, `opposite orientation` or `not finite`.
    pub status: &'static str,
    /// The cost before: half the weighted sum of squares.
    pub cost_before: f64,
    /// The cost after.
    pub cost_after: f64,
    /// Accepted iterations.
    pub iterations: usize,
    /// Time of the solver alone, seconds.
    pub seconds: f64,
    /// The cost at the start and after each iteration.
    pub costs: Vec<f64>,
}

impl fmt::Display for Summary {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            formatter,
            "{} vertices, {} measurements",
            self.vertices, self.measurements
        )?;
        // A descent of hundreds of iterations is shown by its ends.
        const SHOWN_MAX: usize = 20;
        writeln!(formatter, "{:>9}  {:>20}", "iteration", "cost")?;
        for (iteration, cost) in self.costs.iter().enumerate() {
            let last = self.costs.len() - 1;
            if iteration <= SHOWN_MAX || iteration == last {
                writeln!(formatter, "{iteration:>9}  {cost:>20.9}")?;
            } else if iteration == SHOWN_MAX + 1 {
                writeln!(formatter, "{:>9}", "...")?;
            }
        }
        writeln!(
            formatter,
            "{} after {} iterations in {:.3} s",
            self.status, self.iterations, self.seconds
        )?;
        write!(
            formatter,
            "cost {:.9} -> {:.9}",
            self.cost_before, self.cost_after
        )
    }
}

/// Solves a file that was read, with `clock` for the time it takes; the answer is left in it.
pub fn solve_pose_graph(
    file: &mut PoseGraph,
    name: OptimiserName,
    iterations_max: Option<usize>,
    clock: impl Fn() -> Duration,
) -> Summary {
    let mut costs = Vec::new();
    let begin = clock();
    let solution = solve(
        &mut file.graph,
        &name.optimiser(iterations_max),
        |progress| costs.push(progress.cost),
    );
    Summary {
        vertices: file.vertices(),
        measurements: file.graph.edges().len(),
        optimiser: name,
        status: status_text(solution.status),
        cost_before: solution.cost_before,
        cost_after: solution.cost_after,
        iterations: solution.iterations,
        seconds: clock().saturating_sub(begin).as_secs_f64(),
        costs,
    }
}

/// Runs the command.
///
/// # Errors
/// When the file cannot be read, understood or written; each says where and what to do.
#[expect(
    clippy::disallowed_methods,
    reason = "a stopwatch for one command, not a time of the daemon"
)]
pub fn run(args: &SolveArgs) -> miette::Result<()> {
    let text = read(&args.file)?;
    let mut file = pose_graph::parse(&text)
        .wrap_err_with(|| format!("cannot read {}", args.file.display()))?;
    drop(text);
    let begin = Instant::now();
    let summary = solve_pose_graph(&mut file, args.optimiser, args.max_iterations, || {
        begin.elapsed()
    });
    if let Some(output) = &args.output {
        std::fs::write(output, file.to_text())
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write {}", output.display()))?;
    }
    if args.json {
        println!(
            "{}",
            serde_json::to_string_pretty(&summary).into_diagnostic()?
        );
    } else {
        println!("{summary}");
    }
    Ok(())
}

fn read(path: &Path) -> miette::Result<String> {
    let about = || format!("cannot read {}", path.display());
    let bytes = std::fs::metadata(path)
        .into_diagnostic()
        .wrap_err_with(about)?
        .len();
    if bytes > FILE_BYTES_MAX {
        return Err(miette::miette!(
            help = "split the history into several files",
            "{} has {bytes} bytes; the limit is {FILE_BYTES_MAX}",
            path.display()
        ));
    }
    std::fs::read_to_string(path)
        .into_diagnostic()
        .wrap_err_with(about)
}

const fn status_text(status: SolveStatus) -> &'static str {
    match status {
        SolveStatus::Converged => "converged",
        SolveStatus::NothingMeasured => "nothing measured",
        SolveStatus::IterationLimit => "iteration limit",
        SolveStatus::Stalled => "stalled",
        SolveStatus::Degenerate(Degeneracy::Unobservable) => "unobservable",
        SolveStatus::Degenerate(Degeneracy::CoincidentEnds) => "coincident ends",
        SolveStatus::Degenerate(Degeneracy::OppositeOrientation) => "opposite orientation",
        SolveStatus::NotFinite => "not finite",
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    const LINE: &str = "\
VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 2 0 0 0 0 0 1
EDGE_POSITION 0 1 1 0 0 1
EDGE_ORIENTATION 0 1 0 0 0 1 1
";

    #[test]
    fn a_summary_holds_costs_iterations_and_the_time_of_the_clock_given() {
        let mut file = pose_graph::parse(LINE).unwrap();
        let ticks = Cell::new(0);
        let clock = || {
            ticks.set(ticks.get() + 1);
            Duration::from_secs(ticks.get())
        };
        let summary = solve_pose_graph(&mut file, OptimiserName::GaussNewton, None, clock);
        assert_eq!(
            (summary.vertices, summary.measurements, summary.status),
            (2, 2, "converged")
        );
        assert_eq!(summary.seconds.to_bits(), 1.0_f64.to_bits());
        assert!((summary.cost_before - 0.5).abs() < 1e-12);
        assert!(summary.cost_after < 1e-12);
        assert_eq!(summary.costs.len(), summary.iterations + 1);
        assert!(
            file.to_text()
                .contains("\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n"),
            "{}",
            file.to_text()
        );
    }

    #[test]
    fn both_optimisers_reach_the_same_cost_and_a_limit_is_said() {
        let solved = |name, limit| {
            let mut file = pose_graph::parse(LINE).unwrap();
            solve_pose_graph(&mut file, name, limit, || Duration::ZERO)
        };
        assert!(solved(OptimiserName::Descent, None).cost_after < 1e-10);
        assert_eq!(
            solved(OptimiserName::Descent, Some(0)).status,
            "iteration limit"
        );
    }

    #[test]
    fn the_summary_is_json_and_a_table() {
        let mut file = pose_graph::parse(LINE).unwrap();
        let summary = solve_pose_graph(&mut file, OptimiserName::GaussNewton, None, || {
            Duration::ZERO
        });
        let json: serde_json::Value = serde_json::to_value(&summary).unwrap();
        assert_eq!(json["optimiser"], "gauss-newton");
        assert_eq!(json["status"], "converged");
        assert!(
            summary
                .to_string()
                .contains("cost 0.500000000 -> 0.000000000")
        );
    }
}
