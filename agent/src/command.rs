//! The command line `skein`, one file a command, and what its exit codes mean.

mod get;
mod observer;
mod run;
mod status;
mod verify;

use clap::{Parser, Subcommand, ValueEnum};
use std::io::IsTerminal;
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

const EXIT_CODES: &str = "Exit codes: 0 done; 1 failed, with the reason on stderr; 2 wrong usage; 3 nobody answered; \
                          4 a log was not repeated.\nLogs go to stderr; RUST_LOG=debug shows more of them.";

/// Tells vehicles where they and their team-mates are, without GPS.
#[derive(Parser)]
#[command(name = "skein", version, about, after_help = EXIT_CODES)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
    /// How logs are written.
    #[arg(long, global = true, value_enum, default_value_t = LogFormat::Text)]
    log_format: LogFormat,
}

#[derive(Subcommand)]
enum Command {
    /// Runs the agent of one vehicle until it is told to stop.
    Run(run::RunArgs),
    /// Shows the newest estimate of one vehicle or of all.
    Get(get::GetArgs),
    /// Shows neighbours, rates, counters, and why there is no estimate.
    Status(status::StatusArgs),
    /// Solves a pose-graph file with the centralised algorithm.
    Solve(crate::solve::SolveArgs),
    /// Repeats an input log and compares every output bit by bit.
    Verify(verify::VerifyArgs),
}

#[derive(Clone, Copy, ValueEnum)]
enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

/// How a command ended when nothing failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    Done,
    NobodyAnswered,
    Differs,
}

impl Ending {
    fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::NobodyAnswered => 3,
            Self::Differs => 4,
        }
    }
}

/// Parses the arguments of this process and runs the command.
pub fn main() -> ExitCode {
    let line = CommandLine::parse();
    let default_level = match &line.command {
        Command::Run(_) => "info,zenoh=warn",
        _ => "warn,zenoh=error",
    };
    start_logging(line.log_format, default_level);
    let ended = match &line.command {
        Command::Run(args) => run::run(args),
        Command::Get(args) => get::run(args),
        Command::Status(args) => status::run(args),
        Command::Solve(args) => crate::solve::run(args).map(|()| Ending::Done),
        Command::Verify(args) => verify::run(args),
    };
    match ended {
        Ok(ending) => ExitCode::from(ending.code()),
        Err(report) => {
            eprintln!("{report:?}");
            ExitCode::FAILURE
        }
    }
}

fn start_logging(format: LogFormat, default_level: &str) {
    let filter =
        EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default_level));
    let logs = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false);
    match format {
        LogFormat::Text => logs.compact().init(),
        LogFormat::Json => logs.json().init(),
    }
}
