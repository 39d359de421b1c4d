//! `skein-sim`: flies scenarios, runs the papers' experiments and replays recordings.
#![allow(clippy::print_stdout, reason = "tables are what this program is for")]

mod experiment;

use clap::{Parser, Subcommand};

/// Simulated worlds for Skein: fly scenarios, reproduce the papers' figures, replay real robots.
#[derive(Debug, Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Reproduce a paper's experiment in virtual time.
    #[command(subcommand)]
    Experiment(experiment::Experiment),
}

fn main() -> miette::Result<()> {
    match Arguments::parse().command {
        Command::Experiment(experiment) => experiment::run(&experiment),
    }
}
