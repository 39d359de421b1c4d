//! `skein-sim replay attitude` and `skein-sim experiment attitude`: how far a levelled vertical is off.

use crate::experiment::{progress, write_to};
use crate::output::{print, print_json};
use clap::Args;
use miette::{IntoDiagnostic, WrapErr, miette};
use skein_estimation::mutual::attitude::Settings;
use skein_simworld::datasets;
use skein_simworld::experiment::attitude::simulated::{CASES, run};
use skein_simworld::experiment::attitude::{
    EUROC, EUROC_CALIBRATED, RecordingResult, level, report,
};
use std::path::PathBuf;

/// Options of `replay attitude`.
#[derive(Debug, Args)]
pub(crate) struct RecordedArguments {
    /// Folder of trials of BROAD (*.csv.gz).
    #[arg(long, value_name = "FOLDER", required_unless_present = "euroc")]
    broad: Option<PathBuf>,
    /// Folder of the EuRoC flight V1_01 (imu0_data.csv, V1_01_easy.csv): levelled without and with a calibrated
    /// accelerometer, scored after 20 s.
    #[arg(long, value_name = "FOLDER")]
    euroc: Option<PathBuf>,
    /// Draw the errors over time there.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Print one JSON array, one object a recording, instead of the table.
    #[arg(long)]
    json: bool,
}

/// Options of `experiment attitude`.
#[derive(Debug, Args)]
pub(crate) struct SimulatedArguments {
    /// Flights of four a case.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(2..=100_000))]
    samples: u64,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; all cores when not given.
    #[arg(long)]
    pub(crate) threads: Option<usize>,
    /// Print one JSON array, one object a case, instead of the table.
    #[arg(long)]
    json: bool,
}

pub(crate) fn replay(arguments: &RecordedArguments) -> miette::Result<()> {
    let settings = Settings::standard();
    let mut recordings = Vec::new();
    if let Some(folder) = &arguments.broad {
        for (name, readings) in datasets::read_broad(folder).into_diagnostic()? {
            recordings.push((name, readings, settings.clone()));
        }
    }
    if let Some(folder) = &arguments.euroc {
        let flight = datasets::read_euroc(folder).into_diagnostic()?;
        let mut calibrated = settings.clone();
        calibrated.force.bias_m_s2 = flight.force_bias_m_s2;
        recordings.push((EUROC.to_owned(), flight.readings.clone(), settings));
        recordings.push((EUROC_CALIBRATED.to_owned(), flight.readings, calibrated));
    }
    let results = recordings
        .iter()
        .map(|(name, readings, settings)| {
            level(name, readings, settings)
                .ok_or_else(|| miette!("there is nothing to score in {name}"))
        })
        .collect::<miette::Result<Vec<RecordingResult>>>()?;
    if let Some(file) = &arguments.svg {
        let figure = report::figure(&results).into_diagnostic()?;
        write_to(file, &figure).wrap_err("the figure cannot be written")?;
    }
    if arguments.json {
        return print_json(&results);
    }
    print(&report::recordings(&results))
}

pub(crate) fn fly(arguments: &SimulatedArguments) -> miette::Result<()> {
    let progress = progress(arguments.samples * CASES.len() as u64)?;
    let mut results = Vec::new();
    for case in &CASES {
        progress.set_message(case.name);
        results.push(run(case, arguments.samples, arguments.seed, || {
            progress.inc(1);
        }));
    }
    progress.finish_and_clear();
    if arguments.json {
        return print_json(&results);
    }
    print(&report::cases(&results))
}
