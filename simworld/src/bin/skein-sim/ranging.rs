//! `skein-sim experiment ranging`: who moves when, stop and move, flocking, and what it costs.

use crate::experiment::progress;
use crate::files::write;
use crate::output::{print, print_json};
use clap::{Args, ValueEnum};
use miette::IntoDiagnostic;
use skein_simworld::experiment::ranging::{
    complexity, errors, flocking, joining, optimum, schedule, spatial, trilateration,
};
use skein_simworld::planar_swarm::SwarmNoise;
use std::path::PathBuf;

/// What is studied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Study {
    /// Maximal independent sets beside round robin: 10 to 1000 robots, loss, crashes, and long runs.
    Schedule,
    /// Algorithm 2 on pairs: plain, with what neighbours tell, and with a bank.
    Trilateration,
    /// Both algorithms on pairs, beside their bounds: mean square errors against each of three noises.
    Errors,
    /// Whether windows find their global optimum, and how often what they accept is wrong.
    Optimum,
    /// A robot that joins a located team by distances alone, beside one that is told its start.
    Joining,
    /// Heading averaging on orientations with noise.
    Flocking,
    /// Messages, bytes and time against neighbours.
    Complexity,
    /// Algorithm 1 in space: pairs of drones that both move, levelled by gravity.
    Spatial,
}

/// Options of `experiment ranging`.
#[derive(Debug, Args)]
pub(crate) struct RangingArguments {
    /// Which study.
    #[arg(long, value_enum, default_value_t = Study::Schedule)]
    study: Study,
    /// Swarms, pairs, flocks or windows a cell.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    samples: u64,
    /// Rounds of each long run of the schedule, and of each timing.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    rounds: u32,
    /// Seed of all random streams.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; all cores when not given.
    #[arg(long)]
    pub(crate) threads: Option<usize>,
    /// Where the CSV and SVG files go.
    #[arg(long, default_value = "out/ranging")]
    output: PathBuf,
    /// Print JSON instead of the table.
    #[arg(long)]
    json: bool,
}

pub(crate) fn fly(arguments: &RangingArguments) -> miette::Result<()> {
    match arguments.study {
        Study::Schedule => schedule_study(arguments),
        Study::Trilateration => trilateration_study(arguments),
        Study::Errors => errors_study(arguments),
        Study::Optimum => optimum_study(arguments),
        Study::Joining => joining_study(arguments),
        Study::Flocking => flocking_study(arguments),
        Study::Complexity => complexity_study(arguments),
        Study::Spatial => spatial_study(arguments),
    }
}

fn schedule_study(arguments: &RangingArguments) -> miette::Result<()> {
    let request = schedule::Request {
        samples: arguments.samples,
        seed: arguments.seed,
        rounds: arguments.rounds,
    };
    let cells = schedule::cells();
    let rounds = u64::from(arguments.rounds) * schedule::LOSSES.len() as u64;
    let progress = progress(arguments.samples * cells.len() as u64 + rounds)?;
    let mut waits = Vec::new();
    for cell in &cells {
        progress.set_message(format!("{} robots", cell.robots));
        waits.push(schedule::run(cell, &request, || progress.inc(1)));
    }
    let mut runs = Vec::new();
    for loss in schedule::LOSSES {
        progress.set_message(format!("long run, {:.0}% lost", 100.0 * loss));
        runs.push(schedule::long_run(
            loss,
            request.rounds,
            request.seed,
            || {
                progress.inc(1);
            },
        ));
    }
    progress.finish_and_clear();
    let folder = &arguments.output;
    write(folder, "schedule.csv", &schedule::report::csv(&waits))?;
    write(
        folder,
        "schedule-runs.csv",
        &schedule::report::runs_csv(&runs),
    )?;
    let figure = schedule::report::figure(&waits).into_diagnostic()?;
    write(folder, "schedule.svg", &figure)?;
    if arguments.json {
        return print_json(&serde_json::json!({ "waits": waits, "runs": runs }));
    }
    conclude(arguments, &schedule::report::table(&waits, &runs))
}

fn trilateration_study(arguments: &RangingArguments) -> miette::Result<()> {
    let request = trilateration::Request {
        samples: arguments.samples,
        seed: arguments.seed,
    };
    let progress = progress(arguments.samples * trilateration::METHODS.len() as u64)?;
    let results: Vec<_> = trilateration::METHODS
        .into_iter()
        .map(|method| {
            progress.set_message(method.name());
            trilateration::run(method, SwarmNoise::USUAL, request, || progress.inc(1))
        })
        .collect();
    progress.finish_and_clear();
    write(
        &arguments.output,
        "trilateration.csv",
        &trilateration::csv(&results),
    )?;
    if arguments.json {
        return print_json(&results);
    }
    conclude(arguments, &trilateration::table(&results))
}

fn errors_study(arguments: &RangingArguments) -> miette::Result<()> {
    let request = errors::Request {
        samples: arguments.samples,
        seed: arguments.seed,
    };
    let noises = errors::noises();
    let progress = progress(arguments.samples * noises.len() as u64)?;
    let mut results = Vec::new();
    for noise in noises {
        let (range_m, translation_m) = (noise.range_sigma_m, noise.translation_sigma_m);
        progress.set_message(format!(
            "{range_m} m, {translation_m} m, {} rad",
            noise.rotation_sigma_rad
        ));
        let methods = errors::methods(&noise);
        results.extend(errors::run(&methods, noise, request, || progress.inc(1)));
    }
    progress.finish_and_clear();
    let folder = &arguments.output;
    write(folder, "errors.csv", &errors::report::csv(&results))?;
    let figure = errors::report::figure(&results).into_diagnostic()?;
    write(folder, "errors.svg", &figure)?;
    if arguments.json {
        return print_json(&results);
    }
    conclude(arguments, &errors::report::table(&results))
}

fn optimum_study(arguments: &RangingArguments) -> miette::Result<()> {
    let progress = progress(arguments.samples * optimum::LENGTHS.len() as u64)?;
    let results = optimum::LENGTHS.map(|ranges| {
        progress.set_message(format!("windows of {ranges}"));
        optimum::run(ranges, arguments.samples, arguments.seed, || {
            progress.inc(1);
        })
    });
    progress.finish_and_clear();
    write(&arguments.output, "optimum.csv", &optimum::csv(&results))?;
    if arguments.json {
        return print_json(&results);
    }
    conclude(arguments, &optimum::table(&results))
}

fn joining_study(arguments: &RangingArguments) -> miette::Result<()> {
    let progress = progress(arguments.samples * joining::KNOWN.len() as u64)?;
    let (samples, seed) = (arguments.samples, arguments.seed);
    let results = joining::KNOWN.map(|known| {
        progress.set_message(known.name());
        joining::run(known, samples, seed, || progress.inc(1))
    });
    progress.finish_and_clear();
    write(&arguments.output, "joining.csv", &joining::csv(&results))?;
    let figure = joining::figure(&results).into_diagnostic()?;
    write(&arguments.output, "joining.svg", &figure)?;
    if arguments.json {
        return print_json(&results);
    }
    conclude(arguments, &joining::table(&results))
}

fn flocking_study(arguments: &RangingArguments) -> miette::Result<()> {
    let progress = progress(arguments.samples * flocking::CELLS.len() as u64)?;
    let results: Vec<_> = flocking::CELLS
        .iter()
        .map(|cell| {
            progress.set_message(cell.name);
            flocking::run(cell, arguments.samples, arguments.seed, || progress.inc(1))
        })
        .collect();
    progress.finish_and_clear();
    write(&arguments.output, "flocking.csv", &flocking::csv(&results))?;
    let figure = flocking::figure(&results).into_diagnostic()?;
    write(&arguments.output, "flocking.svg", &figure)?;
    if arguments.json {
        return print_json(&results);
    }
    conclude(arguments, &flocking::table(&results))
}

fn complexity_study(arguments: &RangingArguments) -> miette::Result<()> {
    let cells = complexity::ALGORITHMS.len() * complexity::NEIGHBOURS.len();
    let progress = progress(cells as u64)?;
    let clock_s = || progress.elapsed().as_secs_f64();
    let mut rows = Vec::new();
    for algorithm in complexity::ALGORITHMS {
        progress.set_message(algorithm.name());
        for neighbours in complexity::NEIGHBOURS {
            let rounds = arguments.rounds;
            rows.push(complexity::run(
                algorithm,
                neighbours,
                rounds,
                arguments.seed,
                &clock_s,
            ));
            progress.inc(1);
        }
    }
    progress.finish_and_clear();
    write(&arguments.output, "complexity.csv", &complexity::csv(&rows))?;
    if arguments.json {
        return print_json(&rows);
    }
    conclude(arguments, &complexity::table(&rows))
}

fn spatial_study(arguments: &RangingArguments) -> miette::Result<()> {
    let progress = progress(arguments.samples * spatial::CELLS.len() as u64)?;
    let results: Vec<_> = spatial::CELLS
        .iter()
        .map(|cell| {
            progress.set_message(cell.name);
            spatial::run(cell, arguments.samples, arguments.seed, || progress.inc(1))
        })
        .collect();
    progress.finish_and_clear();
    write(
        &arguments.output,
        "spatial.csv",
        &spatial::report::csv(&results),
    )?;
    let figure = spatial::report::figure(&results).into_diagnostic()?;
    write(&arguments.output, "spatial.svg", &figure)?;
    if arguments.json {
        return print_json(&results);
    }
    conclude(arguments, &spatial::report::table(&results))
}

fn conclude(arguments: &RangingArguments, table: &str) -> miette::Result<()> {
    print(&format!("{table}\nfiles: {}\n", arguments.output.display()))
}
