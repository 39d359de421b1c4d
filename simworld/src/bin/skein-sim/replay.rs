//! `skein-sim replay`: recordings of real robots, each robot fed to a vehicle of its own.

use crate::attitude;
use crate::files;
use crate::mode_name::ModeName;
use crate::output::{print, print_json};
use crate::recorded_ranges;
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, WrapErr, miette};
use skein_simworld::calibration::{Calibration, Readings};
use skein_simworld::datasets;
use skein_simworld::fleet::Fleet;
use skein_simworld::plot::{self, Path, PathKind};
use skein_simworld::recorded::{
    Assigned, Flown, Identities, Recorded, ReplayScore, Reported, Score,
};
use skein_simworld::stage::Stage;
use skein_simworld::tum::{self, StampedPose};
use std::fmt::Write;
use std::path::PathBuf;

/// Which kind of recording.
#[derive(Debug, Subcommand)]
pub(crate) enum Replay {
    /// UTIAS MR.CLAM: five robots in the plane, odometry, range and bearing to each other, motion capture as truth.
    Mrclam(MrclamArguments),
    /// Inertial sensors with a true vertical beside them: how far the levelled one is off.
    Attitude(attitude::RecordedArguments),
    /// Factor graphs (PyFG): robots in the plane that find each other by their distances and odometry.
    Pyfg(recorded_ranges::PyfgArguments),
    /// TIERS: distances by radio beside those by motion capture.
    Tiers(recorded_ranges::TiersArguments),
}

/// Options of `replay mrclam`.
#[derive(Debug, Args)]
pub(crate) struct MrclamArguments {
    /// Folder of one recording (Robot1_Odometry.dat and so on).
    folder: PathBuf,
    /// Calibration of the robots (TOML): scales, biases, lags and noise. As recorded when not given.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Use the landmarks too, as points whose places are known.
    #[arg(long)]
    landmarks: bool,
    /// In virtual time, without Zenoh.
    #[arg(long = "virtual")]
    in_virtual_time: bool,
    /// How many times as fast as it was recorded, live.
    #[arg(long, default_value_t = 10.0)]
    speed: f64,
    /// Stop after so many recorded seconds.
    #[arg(long)]
    duration: Option<f64>,
    /// How rounds are weighed: `team` (everybody together, the default), `star` (robust) or `paper`.
    #[arg(long, value_enum, default_value_t = ModeName::Team)]
    mode: ModeName,
    /// Drop which robot each reading is of, and lay it to the nearest by the published estimates; with --virtual.
    #[arg(long, requires = "in_virtual_time")]
    drop_identities: bool,
    /// Where the TUM and SVG files go.
    #[arg(long, default_value = "out/mrclam")]
    output: PathBuf,
    /// Print JSON instead of the table.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(replay: &Replay) -> miette::Result<()> {
    match replay {
        Replay::Mrclam(arguments) => mrclam(arguments),
        Replay::Attitude(arguments) => attitude::replay(arguments),
        Replay::Pyfg(arguments) => recorded_ranges::pyfg(arguments),
        Replay::Tiers(arguments) => recorded_ranges::tiers(arguments),
    }
}

fn mrclam(arguments: &MrclamArguments) -> miette::Result<()> {
    let calibration = match &arguments.calibration {
        None => Calibration::default(),
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .into_diagnostic()
                .wrap_err_with(|| format!("cannot read the calibration {}", path.display()))?;
            Calibration::parse(&text)
                .into_diagnostic()
                .wrap_err_with(|| path.display().to_string())?
        }
    };
    let recording = datasets::read_mrclam(&arguments.folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} is no MR.CLAM recording", arguments.folder.display()))?;
    let readings = if arguments.landmarks {
        Readings::OfRobotsAndLandmarks
    } else {
        Readings::OfRobots
    };
    let identities = if arguments.drop_identities {
        Identities::Nearest
    } else {
        Identities::Recorded
    };
    let recorded = Recorded::new(recording, calibration, readings)
        .into_diagnostic()?
        .in_mode(arguments.mode.mode())
        .with_identities(identities);
    let end_ns = match arguments.duration {
        Some(duration_s) => recorded.duration_ns().min((duration_s * 1e9) as i64),
        None => recorded.duration_ns(),
    };
    let progress = ProgressBar::new((end_ns / 1_000_000_000).unsigned_abs()).with_style(
        ProgressStyle::with_template("{wide_bar} {pos}/{len} s recorded, {eta} left")
            .into_diagnostic()?,
    );
    let (flown, recorded) = if arguments.in_virtual_time {
        fly_virtually(recorded, end_ns, &progress)
    } else {
        fly_live(recorded, end_ns, arguments.speed, &progress)?
    };
    progress.finish_and_clear();
    let score = flown
        .score(&recorded)
        .ok_or_else(|| miette!("there is nothing to score: no vehicle had an estimate"))?;
    write_files(arguments, &flown, &recorded)?;
    if arguments.json {
        print_json(&score)?;
    } else {
        print(&table(&score))?;
        if let Some(Assigned {
            readings,
            right,
            dropped,
        }) = score.identities
        {
            print(&format!(
                "\nidentities dropped: {right} of {readings} readings ({:.2} %) laid to the right robot, {dropped} to nobody\n",
                100.0 * right as f64 / readings.max(1) as f64
            ))?;
        }
        print(&format!(
            "\nTUM and SVG files: {}\n",
            arguments.output.display()
        ))?;
    }
    Ok(())
}

fn fly_virtually(recorded: Recorded, end_ns: i64, progress: &ProgressBar) -> (Flown, Recorded) {
    let mut fleet = Fleet::on(recorded, Recorded::radio(), |_, config| config);
    let mut flown = Flown::default();
    let mut at_ns = 0;
    while at_ns <= end_ns {
        fleet.run_until(at_ns + 1);
        let newest = |robot| Reported::of(fleet.estimate(robot)?, fleet.stage(), robot);
        flown.push((0..fleet.len()).map(newest).collect());
        progress.set_position((at_ns / 1_000_000_000).unsigned_abs());
        at_ns += fleet.stage().period_ns();
    }
    (flown, fleet.into_stage())
}

#[cfg(not(feature = "live"))]
fn fly_live(_: Recorded, _: i64, _: f64, _: &ProgressBar) -> miette::Result<(Flown, Recorded)> {
    Err(miette!(
        "this program was built without the feature `live`: use --virtual"
    ))
}

#[cfg(feature = "live")]
fn fly_live(
    recorded: Recorded,
    end_ns: i64,
    speed: f64,
    progress: &ProgressBar,
) -> miette::Result<(Flown, Recorded)> {
    use skein_agent::{
        Agent, Clock, DriverSettings, NetworkSettings, Settings, TimedFrame, new_boot,
    };
    use skein_estimation::time::{Span, Stamp};
    use std::time::Duration;

    /// Real seconds for the agents to open their sessions and find each other.
    const GATHERING_S: f64 = 4.0;
    if !(0.01..=100.0).contains(&speed) {
        return Err(miette!("--speed must lie between 0.01 and 100"));
    }
    let zero = Stamp::from_nanos(recorded.start_unix_ns());
    let begin =
        zero + Span::from_nanos(recorded.begins_ns()) - Span::from_secs_f64(GATHERING_S * speed);
    let clock = Clock::scaled(begin, speed);
    let mut agents: Vec<Agent> = Vec::new();
    for robot in 0..recorded.vehicles() {
        let config = recorded.config(robot, new_boot());
        let played = |sensor| {
            let frames = recorded
                .frames(robot)
                .iter()
                .filter(|delivery| delivery.sensor == sensor);
            let timed = |at_ns| zero + Span::from_nanos(at_ns);
            let frames = frames.map(|delivery| TimedFrame {
                arrival: timed(delivery.at_ns),
                frame: delivery.frame.clone(),
            });
            DriverSettings::Frames(frames.collect())
        };
        let agent = Agent::start(Settings {
            fleet: skein_proto::name::Name::parse("mrclam").into_diagnostic()?,
            drivers: config
                .sensors
                .iter()
                .map(|sensor| (sensor.name, played(sensor.name)))
                .collect(),
            vehicle: config,
            network: NetworkSettings::loopback(agents.iter().flat_map(Agent::locators).collect()),
            clock,
            log: None,
            checkpoint: None,
            rpc: false,
            faults: None,
        })?;
        if !agent.wait_open(Duration::from_secs(20)) {
            return Err(miette!(
                "the Zenoh session of robot {} did not open",
                robot + 1
            ));
        }
        agents.push(agent);
    }
    let mut flown = Flown::default();
    let mut at_ns = 0;
    while at_ns <= end_ns {
        let wait = clock.real_time(zero + Span::from_nanos(at_ns) - clock.now());
        std::thread::sleep(wait);
        let newest = |(robot, agent): (usize, &Agent)| {
            Reported::of(&agent.latest_estimate()?.document, &recorded, robot)
        };
        flown.push(agents.iter().enumerate().map(newest).collect());
        progress.set_position((at_ns / 1_000_000_000).unsigned_abs());
        at_ns += recorded.period_ns();
    }
    for agent in agents {
        agent.stop();
    }
    Ok((flown, recorded))
}

fn write_files(
    arguments: &MrclamArguments,
    flown: &Flown,
    recorded: &Recorded,
) -> miette::Result<()> {
    for robot in 0..recorded.vehicles() {
        let name = recorded.name(robot);
        let [truth, estimate, odometry] = flown.trajectories(recorded, robot);
        files::write(
            &arguments.output,
            &format!("{name}-truth.tum"),
            &tum::write(&truth),
        )?;
        files::write(
            &arguments.output,
            &format!("{name}-estimate.tum"),
            &tum::write(&estimate),
        )?;
        let path = |label: &str, kind, poses: &[StampedPose]| Path {
            label: label.to_owned(),
            kind,
            points_m: poses
                .iter()
                .map(|at| (at.pose.translation.x, at.pose.translation.y))
                .collect(),
        };
        let paths = [
            path("truth", PathKind::Truth, &truth),
            path("odometry alone", PathKind::DeadReckoning, &odometry),
            path("estimate", PathKind::Estimate, &estimate),
        ];
        let svg = plot::paths(&format!("{name}, MR.CLAM"), &paths).into_diagnostic()?;
        files::write(&arguments.output, &format!("{name}-paths.svg"), &svg)?;
    }
    Ok(())
}

fn table(score: &ReplayScore) -> String {
    let mut text = String::from(
        "          position RMSE m  mean m  heading RMSE rad  odometry alone RMSE m\n",
    );
    for robot in &score.robots {
        let _ = writeln!(
            text,
            "{:<9} {:>15.3} {:>7.3} {:>17.3} {:>22.3}",
            robot.robot,
            robot.position_rmse_m,
            robot.position_mean_m,
            robot.heading_rmse_rad,
            robot.dead_reckoning_rmse_m
        );
    }
    text.push_str(
        "\n                position RMSE m  mean m  heading RMSE rad  instant m  relative m\n",
    );
    for (label, row) in [
        ("team", &score.team),
        ("odometry alone", &score.dead_reckoning),
    ] {
        let Score {
            position_rmse_m,
            position_mean_m,
            heading_rmse_rad,
            instant_rmse_m,
            relative_rmse_m,
            ..
        } = row;
        let _ = writeln!(
            text,
            "{label:<15} {position_rmse_m:>15.3} {position_mean_m:>7.3} {heading_rmse_rad:>17.3} {instant_rmse_m:>10.3} {relative_rmse_m:>11.3}"
        );
    }
    if let (Some(own), Some(relative)) = (score.nees, score.relative_nees) {
        let _ = writeln!(
            text,
            "\nNEES a degree of freedom (one when the covariance means it): own pose {own:.2}, where the others are {relative:.2}"
        );
    }
    text
}
