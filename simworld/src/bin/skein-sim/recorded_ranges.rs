//! `skein-sim replay pyfg` and `skein-sim replay tiers`: real distances between robots.

use crate::experiment::write_to;
use crate::output::{print, print_json};
use clap::Args;
use miette::{IntoDiagnostic, WrapErr, miette};
use skein_simworld::experiment::ranging::recorded::{self, Request};
use skein_simworld::pyfg::FactorGraph;
use skein_simworld::tiers;
use std::path::{Path, PathBuf};

/// Options of `replay pyfg`.
#[derive(Debug, Args)]
pub(crate) struct PyfgArguments {
    /// A factor graph with odometry, distances between robots and truth, all in the plane.
    file: PathBuf,
    /// Noise to add to each step of odometry, in standard deviations that the file states for it; any number of times. As
    /// recorded, and with 0.3 and 1 of them, when not given.
    #[arg(long = "added", value_name = "SIGMAS", value_parser = sigmas)]
    added: Vec<f64>,
    /// Seed of the noise that is added.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write one line a pair there.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Print one JSON array, one object a pair, instead of the table.
    #[arg(long)]
    json: bool,
}

/// Options of `replay tiers`.
#[derive(Debug, Args)]
pub(crate) struct TiersArguments {
    /// A CSV file of the TIERS group: distances by radio and by motion capture. It has no odometry: nobody is localised.
    file: PathBuf,
    /// Print one JSON array, one object a pair, instead of the table.
    #[arg(long)]
    json: bool,
}

fn sigmas(text: &str) -> Result<f64, String> {
    let sigmas = text.parse().ok();
    sigmas
        .filter(|value| (0.0..=100.0).contains(value))
        .ok_or_else(|| "it must lie between 0 and 100".to_owned())
}

pub(crate) fn pyfg(arguments: &PyfgArguments) -> miette::Result<()> {
    let text = read(&arguments.file)?;
    let graph = FactorGraph::parse(&text)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} is no factor graph", arguments.file.display()))?;
    let added = if arguments.added.is_empty() {
        &[0.0, 0.3, 1.0][..]
    } else {
        &arguments.added[..]
    };
    let mut results = Vec::new();
    for added_sigmas in added {
        let request = Request {
            added_sigmas: *added_sigmas,
            seed: arguments.seed,
        };
        let pairs = recorded::replay(&graph, request)
            .ok_or_else(|| miette!("its robots fly: only recordings in the plane are replayed"))?;
        results.extend(pairs);
    }
    if results.is_empty() {
        return Err(miette!("no two robots of it measured each other"));
    }
    if let Some(file) = &arguments.csv {
        write_to(file, &recorded::csv(&results))?;
    }
    if arguments.json {
        return print_json(&results);
    }
    print(&recorded::table(&results))
}

pub(crate) fn tiers(arguments: &TiersArguments) -> miette::Result<()> {
    let text = read(&arguments.file)?;
    let results = tiers::errors(&text)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} is no table of distances", arguments.file.display()))?;
    if arguments.json {
        return print_json(&results);
    }
    print(&format!(
        "{}\nThere is no odometry in such a file: `replay pyfg` localises the same robots.\n",
        tiers::table(&results)
    ))
}

fn read(file: &Path) -> miette::Result<String> {
    std::fs::read_to_string(file)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", file.display()))
}
