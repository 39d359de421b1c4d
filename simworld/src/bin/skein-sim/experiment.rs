//! `skein-sim experiment ...`: many virtual flights, tables and figures.

use crate::attitude;
use crate::files::write;
use crate::output::{print, print_json};
use crate::{ranging, registration};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use miette::IntoDiagnostic;
use skein_estimation::cooperative::Optimiser;
use skein_simworld::experiment::consistency::cell::{CELLS, Cell};
use skein_simworld::experiment::cooperative::{self, CellResult, Engine, Request};
use skein_simworld::experiment::mutual::case::{CASES, Case};
use skein_simworld::experiment::mutual::method::{METHODS, Method};
use skein_simworld::experiment::{consistency, modes, mutual};
use std::path::{Path, PathBuf};

/// Which experiment.
#[derive(Debug, Subcommand)]
pub(crate) enum Experiment {
    /// Section V of Knuth & Barooah: teams of 1-5, five kinds of measurement, kinds changing in time, and figure 6.
    Cooperative(CooperativeArguments),
    /// The modes of the cooperative pipeline on section V with outliers, bursts, blackouts, loss, delay and disorder.
    Modes(ModesArguments),
    /// Error over the bound of a batch, and NEES: teams, kinds, loss, outliers, wrong noise, biases and liars, by mode.
    Consistency(ConsistencyArguments),
    /// Anonymous bearings: figures 5 to 9 of Cognetti et al., the published way and ours, over other roles, other
    /// trajectories, phantoms, loss and biases.
    Mutual(MutualArguments),
    /// Registration of single anonymous scans: robots, noise, phantoms, misses, silent robots, by method.
    Registration(registration::RegistrationArguments),
    /// Range-only localisation: section V of Cornejo & Nagpal.
    Ranging(ranging::RangingArguments),
    /// Levelling: roll and pitch of virtual quadrotors, with and without biases.
    Attitude(attitude::SimulatedArguments),
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

/// Options of `experiment modes`.
#[derive(Debug, Args)]
pub(crate) struct ModesArguments {
    /// Samples a cell.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    samples: u64,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; all cores when not given.
    #[arg(long)]
    threads: Option<usize>,
    /// Where the CSV and SVG files go.
    #[arg(long, default_value = "out/modes")]
    output: PathBuf,
    /// Print one JSON array, one object a cell, instead of the table.
    #[arg(long)]
    json: bool,
}

/// Options of `experiment consistency`.
#[derive(Debug, Args)]
pub(crate) struct ConsistencyArguments {
    /// A cell to fly, any number of times; all when not given.
    #[arg(long = "cell", value_name = "NAME", value_parser = cell)]
    cells: Vec<Cell>,
    /// Samples a cell.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    samples: u64,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Rounds of every cell; each cell's own when not given.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    rounds: Option<u32>,
    /// Threads; all cores when not given.
    #[arg(long)]
    threads: Option<usize>,
    /// Write one line a cell and method there.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draw the ratios, and the NEES over time, there.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Print one JSON array, one object a cell, instead of the table.
    #[arg(long)]
    json: bool,
}

/// Options of `experiment mutual`.
#[derive(Debug, Args)]
pub(crate) struct MutualArguments {
    /// A case to fly, any number of times; all when not given.
    #[arg(long = "case", value_name = "NAME", value_parser = mutual_case)]
    cases: Vec<Case>,
    /// Who estimates, any number of times; all when not given.
    #[arg(long = "method", value_name = "NAME", value_parser = mutual_method)]
    methods: Vec<Method>,
    /// Samples a case.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    samples: u64,
    /// Seed of all random streams.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; all cores when not given.
    #[arg(long)]
    threads: Option<usize>,
    /// Where the CSV and SVG files go.
    #[arg(long, default_value = "out/mutual")]
    output: PathBuf,
    /// Write the error of every neighbour at every image of every flight too.
    #[arg(long)]
    moments: bool,
    /// Print one JSON array, one object a case and method, instead of the table.
    #[arg(long)]
    json: bool,
}

/// A case of mutual localisation by its name.
fn mutual_case(name: &str) -> Result<Case, String> {
    Case::named(name).ok_or_else(|| {
        let names: Vec<&str> = CASES.iter().map(|case| case.name).collect();
        format!("there is no such case, but {}", names.join(", "))
    })
}

/// A method of mutual localisation by its name.
fn mutual_method(name: &str) -> Result<Method, String> {
    Method::named(name).ok_or_else(|| {
        let names: Vec<&str> = METHODS.iter().map(|method| method.name()).collect();
        format!("there is no such method, but {}", names.join(", "))
    })
}

/// A cell by its name.
fn cell(name: &str) -> Result<Cell, String> {
    Cell::named(name).ok_or_else(|| {
        let names: Vec<&str> = CELLS.iter().map(|cell| cell.name).collect();
        format!("there is no such cell, but {}", names.join(", "))
    })
}

pub(crate) fn run(experiment: &Experiment) -> miette::Result<()> {
    match experiment {
        Experiment::Cooperative(arguments) => {
            rayon_pool(arguments.threads)?.install(|| cooperative(arguments))
        }
        Experiment::Modes(arguments) => rayon_pool(arguments.threads)?.install(|| modes(arguments)),
        Experiment::Consistency(arguments) => {
            rayon_pool(arguments.threads)?.install(|| consistency(arguments))
        }
        Experiment::Mutual(arguments) => {
            rayon_pool(arguments.threads)?.install(|| mutual(arguments))
        }
        Experiment::Registration(arguments) => {
            rayon_pool(arguments.threads)?.install(|| registration::fly(arguments))
        }
        Experiment::Ranging(arguments) => {
            rayon_pool(arguments.threads)?.install(|| ranging::fly(arguments))
        }
        Experiment::Attitude(arguments) => {
            rayon_pool(arguments.threads)?.install(|| attitude::fly(arguments))
        }
    }
}

fn consistency(arguments: &ConsistencyArguments) -> miette::Result<()> {
    let cells = if arguments.cells.is_empty() {
        &CELLS[..]
    } else {
        &arguments.cells[..]
    };
    let progress = progress(arguments.samples * cells.len() as u64)?;
    let request = consistency::Request {
        samples: arguments.samples,
        seed: arguments.seed,
        rounds: arguments.rounds.map(|rounds| rounds as usize),
        clock_s: &|| progress.elapsed().as_secs_f64(),
    };
    let mut results = Vec::new();
    for cell in cells {
        progress.set_message(cell.name);
        let result = consistency::run(cell, &request, || progress.inc(1)).into_diagnostic()?;
        results.push(result);
    }
    progress.finish_and_clear();
    if let Some(file) = &arguments.csv {
        write_to(file, &consistency::report::csv(&results))?;
    }
    if let Some(file) = &arguments.svg {
        let figure = consistency::report::figure(&results).into_diagnostic()?;
        write_to(file, &figure)?;
    }
    if arguments.json {
        let json = serde_json::to_string_pretty(&results).into_diagnostic()?;
        return print(&format!("{json}\n"));
    }
    print(&consistency::report::table(&results))
}

fn mutual(arguments: &MutualArguments) -> miette::Result<()> {
    let cases = if arguments.cases.is_empty() {
        CASES.to_vec()
    } else {
        arguments.cases.clone()
    };
    let methods = if arguments.methods.is_empty() {
        METHODS.to_vec()
    } else {
        arguments.methods.clone()
    };
    let progress = progress(arguments.samples * (cases.len() * methods.len()) as u64)?;
    let request = mutual::Request {
        samples: arguments.samples,
        seed: arguments.seed,
        methods,
    };
    let mut results = Vec::new();
    for case in &cases {
        progress.set_message(case.name);
        for mut result in mutual::run(case, &request, || progress.inc(1)) {
            for (name, svg) in mutual::figures::of(&result).into_diagnostic()? {
                write(&arguments.output, &name, &svg)?;
            }
            if arguments.moments {
                let name = format!("{}-{}-moments.csv", result.case, result.method.name());
                write(
                    &arguments.output,
                    &name,
                    &mutual::report::moments_csv(&result),
                )?;
            }
            // They are drawn; those of all cases together would be a lot to keep.
            result.flights.clear();
            results.push(result);
        }
    }
    progress.finish_and_clear();
    write(
        &arguments.output,
        "mutual.csv",
        &mutual::report::csv(&results),
    )?;
    if arguments.json {
        return print_json(&results);
    }
    print(&format!(
        "{}\nCSV and SVG files: {}\n",
        mutual::report::table(&results),
        arguments.output.display()
    ))
}

/// Writes a file of the caller's naming.
pub(crate) fn write_to(file: &Path, text: &str) -> miette::Result<()> {
    let name = file.file_name().and_then(|name| name.to_str());
    let name = name.ok_or_else(|| miette::miette!("{} is no file", file.display()))?;
    write(file.parent().unwrap_or(Path::new(".")), name, text)
}

fn modes(arguments: &ModesArguments) -> miette::Result<()> {
    let request = modes::Request {
        samples: arguments.samples,
        seed: arguments.seed,
    };
    let progress =
        progress(arguments.samples * (modes::METHODS.len() * modes::FAULTS.len()) as u64)?;
    let mut results = Vec::new();
    for fault in modes::FAULTS {
        for method in modes::METHODS {
            progress.set_message(format!("{}, {}", method.name(), fault.name()));
            results.push(modes::run(method, fault, request, || progress.inc(1)));
        }
    }
    progress.finish_and_clear();
    write(&arguments.output, "modes.csv", &modes::csv(&results))?;
    write(
        &arguments.output,
        "modes.svg",
        &modes::figure(&results).into_diagnostic()?,
    )?;
    if arguments.json {
        return print_json(&results);
    }
    print(&format!(
        "{}\nCSV and SVG files: {}\n",
        modes::table(&results),
        arguments.output.display()
    ))
}

/// A bar that counts flights.
pub(crate) fn progress(flights: u64) -> miette::Result<ProgressBar> {
    Ok(ProgressBar::new(flights).with_style(
        ProgressStyle::with_template("{wide_bar} {pos}/{len} flights, {eta} left, {msg}")
            .into_diagnostic()?,
    ))
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
    let progress = progress(arguments.samples * cells.len() as u64)?;
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
        return print_json(&results);
    }
    let final_errors = figure_6.final_error_m.iter();
    let final_errors = final_errors.map(|(kind, error_m)| format!("  {kind:<15} {error_m:.3} m\n"));
    print(&format!(
        "{}\nfigure 6, one realisation, final error of robot 1:\n{}\nCSV and SVG files: {}\n",
        cooperative::table(&results),
        final_errors.collect::<String>(),
        arguments.output.display()
    ))
}

/// A pool of the threads asked for.
pub(crate) fn rayon_pool(threads: Option<usize>) -> miette::Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .into_diagnostic()
}
