//! The command line `skein`, one file a command, and what its exit codes mean.

mod check_config;
mod doctor;
mod get;
mod observer;
mod output;
mod run;
mod sigma;
mod status;
mod verify;
mod watch;

use clap::{Parser, Subcommand, ValueEnum};
use std::io::IsTerminal;
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

const ABOUT: &str = "Tells vehicles where they and their team-mates are, without GPS.

One daemon on each vehicle (`skein run`) locates it by its own odometry and by what vehicles measure of each other, and \
talks to the others over Zenoh. All other commands look at vehicles from any machine of the network, or work on files.";

const EXAMPLES_AND_EXIT_CODES: &str = "\
A first flight:
  skein check-config skein.toml      is the configuration right?
  skein run --config skein.toml      start the vehicle; stop it with Ctrl-C or SIGTERM
  skein watch                        see all vehicles live
  skein status v1                    why is there no estimate?
  skein doctor --config skein.toml   what is wrong with this machine or the network?

Exit codes:
  0  done; for doctor: nothing worse than warnings
  1  failed, with the reason on stderr
  2  wrong usage
  3  nobody answered, or nothing was heard
  4  a log was not repeated
  5  the doctor found problems

Logs go to stderr, as text or with --log-format json as one JSON object a line. They tell what changed: start, session,
drivers, neighbours, status and why, first refusals, stop. RUST_LOG=debug shows more, RUST_LOG=warn less.
`skein COMMAND --help` has examples of each command.";

/// Tells vehicles where they and their team-mates are, without GPS.
#[derive(Parser)]
#[command(
    name = "skein",
    version,
    about,
    long_about = ABOUT,
    after_help = EXAMPLES_AND_EXIT_CODES,
    arg_required_else_help = true
)]
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
    ///
    /// Reads the configuration, starts the drivers and the estimator, and joins the fleet. The vehicle runs also while
    /// the network does not: the session is opened again and again. SIGINT and SIGTERM stop it within a second.
    Run(run::RunArgs),
    /// Shows the newest estimate of one vehicle or of all.
    ///
    /// Asks once and prints a table: each vehicle in the common frame (x east, y north, z up), and below it where it
    /// sees its neighbours (x forward, y left, z up). The Zenoh selector that was asked is printed on stderr.
    Get(get::GetArgs),
    /// Follows estimates live, until it is stopped.
    ///
    /// On a terminal a table that is refreshed in place, a line a vehicle; elsewhere a line when a vehicle appears,
    /// vanishes, or its status, its neighbours or its reason change, and one in each interval.
    Watch(watch::WatchArgs),
    /// Shows neighbours, rates, counters, and why there is no estimate.
    ///
    /// Asks one vehicle or all for their health: rounds, sensors, neighbours with clock offsets, every reason for which
    /// something was refused, queues. When there is no estimate or a poor one it says why and what to do.
    Status(status::StatusArgs),
    /// Checks a configuration without starting anything.
    ///
    /// Reads the file exactly as `skein run` does, files that it names included, and prints what would run, or the
    /// mistake with its file, line, key and what to do.
    CheckConfig(check_config::CheckConfigArgs),
    /// Looks for what is wrong: machine, configuration, network, fleet.
    ///
    /// Checks clock, folders, interfaces, multicast, ports, and asks the vehicles that it sees. For each check it says
    /// ok, warning or problem, what that means and what to do.
    Doctor(doctor::DoctorArgs),
    /// Solves a pose-graph file with the centralised algorithm.
    Solve(crate::solve::SolveArgs),
    /// Repeats an input log and compares every output bit by bit.
    ///
    /// An input log (`[log]` in the configuration) holds everything that went into the estimator. Fed back, the same
    /// must come out; what does not shows where this program differs from the one that flew.
    Verify(verify::VerifyArgs),
}

#[derive(Clone, Copy, ValueEnum)]
enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

/// How a command ended, when it is not for the caller to tell why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    Done,
    /// The file has a mistake, which has been told.
    Mistaken,
    NobodyAnswered,
    Differs,
    Problems,
}

impl Ending {
    fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Mistaken => 1,
            Self::NobodyAnswered => 3,
            Self::Differs => 4,
            Self::Problems => 5,
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
        Command::Watch(args) => watch::run(args),
        Command::CheckConfig(args) => check_config::run(args),
        Command::Doctor(args) => doctor::run(args),
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
