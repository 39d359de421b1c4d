//! `skein-sim experiment ...`: many virtual flights, tables and figures.

use crate::files::write;
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use miette::IntoDiagnostic;
use skein_estimation::cooperative::Optimiser;
use skein_simworld::experiment::cooperative::{self, CellResult, Engine, Request};
use std::path::PathBuf;

/// Which experiment.
#[derive(Debug, Subcommand)]
pub(crate) enum Experiment {
    /// Section V of Knuth & Barooah: teams of 1-5, five kinds of measurement, kinds changing in time, and figure 6.
    Cooperative(CooperativeArguments),
}

/// Options of `experiment cooperative`.
#[derive(Debug, Args)]
pub(crate) struct CooperativeArguments {
    /// Samples a cell.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    samples: u64,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; all cores when not given.
    #[arg(long)]
    threads: Option<usize>,
    /// Fly the bare algorithm instead of the production vehicle and codec: faster, and the same over a perfect radio.
    #[arg(long)]
    solver_only: bool,
    /// Solve by the paper's gradient descent instead of Gauss-Newton.
    #[arg(long)]
    descent: bool,
    /// Where the CSV and SVG files go.
    #[arg(long, default_value = "out/cooperative")]
    output: PathBuf,
    /// Print one JSON array, one object a cell, instead of the table.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(experiment: &Experiment) -> miette::Result<()> {
    let Experiment::Cooperative(arguments) = experiment;
    let pool = rayon_pool(arguments.threads)?;
    pool.install(|| cooperative(arguments))
}

fn cooperative(arguments: &CooperativeArguments) -> miette::Result<()> {
    let request = Request {
        samples: arguments.samples,
        seed: arguments.seed,
        engine: if arguments.solver_only {
            Engine::SolverOnly
        } else {
            Engine::Vehicle
        },
        optimiser: if arguments.descent {
            Optimiser::descent()
        } else {
            Optimiser::gauss_newton()
        },
    };
    let cells = cooperative::cells();
    let progress = ProgressBar::new(arguments.samples * cells.len() as u64).with_style(
        ProgressStyle::with_template("{wide_bar} {pos}/{len} flights, {eta} left, {msg}")
            .into_diagnostic()?,
    );
    let mut results: Vec<CellResult> = Vec::new();
    for cell in cells {
        progress.set_message(format!("{} robots, {}", cell.robots, cell.kind_name()));
        results.push(cooperative::run(cell, &request, || progress.inc(1)).into_diagnostic()?);
    }
    progress.finish_and_clear();
    let figure_6 = cooperative::figure_6(arguments.seed).into_diagnostic()?;

    write(&arguments.output, "cells.csv", &cooperative::csv(&results))?;
    for (name, svg) in cooperative::figures(&results).into_diagnostic()? {
        write(&arguments.output, name, &svg)?;
    }
    write(
        &arguments.output,
        "figure-6-parallel-lines.svg",
        &figure_6.svg,
    )?;
    if arguments.json {
        println!(
            "{}",
            serde_json::to_string_pretty(&results).into_diagnostic()?
        );
        return Ok(());
    }
    print!("{}", cooperative::table(&results));
    println!("\nfigure 6, one realisation, final error of robot 1:");
    for (kind, error_m) in &figure_6.final_error_m {
        println!("  {kind:<15} {error_m:.3} m");
    }
    println!("\nCSV and SVG files: {}", arguments.output.display());
    Ok(())
}

/// A pool of the threads asked for.
fn rayon_pool(threads: Option<usize>) -> miette::Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .into_diagnostic()
}
