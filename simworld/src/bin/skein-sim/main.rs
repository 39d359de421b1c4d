//! `skein-sim`: flies scenarios, runs the papers' experiments and replays recordings.

#[cfg(feature = "live")]
mod air;
mod attitude;
mod experiment;
mod files;
#[cfg(feature = "live")]
mod fly;
mod mode_name;
mod output;
mod ranging;
mod recorded_ranges;
mod registration;
mod replay;

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
    /// Fly a scenario live: real agents over real Zenoh, a simulated world around them.
    #[cfg(feature = "live")]
    Fly(fly::FlyArguments),
    /// Reproduce a paper's experiment in virtual time.
    #[command(subcommand)]
    Experiment(experiment::Experiment),
    /// Replay a recording of real robots.
    #[command(subcommand)]
    Replay(replay::Replay),
}

fn main() -> miette::Result<()> {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        // Zenoh calls it an error when a packet overtakes the declaration of its key, which happens at every start.
        .unwrap_or_else(|_| {
            tracing_subscriber::EnvFilter::new("warn,zenoh=error,zenoh::api::session=off")
        });
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .init();
    match Arguments::parse().command {
        #[cfg(feature = "live")]
        Command::Fly(arguments) => fly::run(&arguments),
        Command::Experiment(experiment) => experiment::run(&experiment),
        Command::Replay(replay) => replay::run(&replay),
    }
}
