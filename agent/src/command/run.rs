//! `skein run`: the agent of one vehicle, until SIGINT or SIGTERM.

use super::Ending;
use crate::agent::Agent;
use crate::config;
use miette::{IntoDiagnostic, WrapErr, miette};
use std::path::PathBuf;
use std::time::Duration;

/// How often it is looked whether the vehicle still runs.
const WATCH_EVERY: Duration = Duration::from_secs(1);

#[derive(clap::Args)]
#[command(after_help = "Example:
  skein run --config skein.toml --log-format json")]
pub(super) struct RunArgs {
    /// The vehicle's configuration (TOML).
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
}

pub(super) fn run(args: &RunArgs) -> miette::Result<Ending> {
    let settings = config::load(&args.config).map_err(|error| miette::Report::new(*error))?;
    tracing::info!(
        fleet = %settings.fleet,
        vehicle = %settings.vehicle.vehicle,
        boot = skein_proto::keys::boot_text(settings.vehicle.boot),
        log = settings.log.as_ref().map(|path| path.display().to_string()),
        "starting"
    );
    let agent = Agent::start(settings)?;
    // A runtime for the signals alone: the agent has its own threads.
    let signals = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .into_diagnostic()
        .wrap_err("signals cannot be waited for")?;
    let ended = signals.block_on(until_told(&agent));
    tracing::info!("stopping");
    agent.stop();
    ended
}

async fn until_told(agent: &Agent) -> miette::Result<Ending> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).into_diagnostic()?;
    let mut interrupt = signal(SignalKind::interrupt()).into_diagnostic()?;
    let mut watch = tokio::time::interval(WATCH_EVERY);
    loop {
        tokio::select! {
            _ = terminate.recv() => return Ok(Ending::Done),
            _ = interrupt.recv() => return Ok(Ending::Done),
            _ = watch.tick() => {
                if agent.has_ended() {
                    return Err(miette!("the vehicle's thread has ended by itself: please report this with the log above"));
                }
            }
        }
    }
}
