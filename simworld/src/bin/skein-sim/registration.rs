//! `skein-sim experiment registration`: single anonymous scans, the published method beside ours.

use crate::experiment::progress;
use crate::files::write;
use crate::output::{print, print_json};
use clap::Args;
use miette::IntoDiagnostic;
use skein_simworld::experiment::registration::cell::cells;
use skein_simworld::experiment::registration::{REGISTRARS, Registrar, Request, report, run};
use std::path::PathBuf;

/// Options of `experiment registration`.
#[derive(Debug, Args)]
pub(crate) struct RegistrationArguments {
    /// Who registers, any number of times; all when not given.
    #[arg(long = "method", value_name = "NAME", value_parser = registrar)]
    methods: Vec<Registrar>,
    /// Only cells of at most so many robots.
    #[arg(long, default_value_t = 20)]
    robots_max: usize,
    /// Scans a cell.
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    samples: u64,
    /// Seed of all random streams.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; all cores when not given.
    #[arg(long)]
    pub(crate) threads: Option<usize>,
    /// Where the CSV and SVG files go.
    #[arg(long, default_value = "out/registration")]
    output: PathBuf,
    /// Print one JSON array, one object a cell and method, instead of the table.
    #[arg(long)]
    json: bool,
}

/// A registrar by its name, with or without its space.
fn registrar(name: &str) -> Result<Registrar, String> {
    let found = REGISTRARS
        .into_iter()
        .find(|one| one.name().replace(' ', "-") == name);
    found.ok_or_else(|| {
        let names = REGISTRARS.map(|one| one.name().replace(' ', "-"));
        format!("there is no such method, but {}", names.join(", "))
    })
}

pub(crate) fn fly(arguments: &RegistrationArguments) -> miette::Result<()> {
    let registrars = if arguments.methods.is_empty() {
        &REGISTRARS[..]
    } else {
        &arguments.methods[..]
    };
    let mut cells = cells();
    cells.retain(|cell| cell.robots <= arguments.robots_max);
    let progress = progress(arguments.samples * (cells.len() * registrars.len()) as u64)?;
    let request = Request {
        samples: arguments.samples,
        seed: arguments.seed,
        clock_s: &|| progress.elapsed().as_secs_f64(),
    };
    let mut results = Vec::new();
    for cell in &cells {
        for registrar in registrars {
            progress.set_message(format!("{}, {}", registrar.name(), cell.name()));
            results.push(run(cell, *registrar, &request, || progress.inc(1)));
        }
    }
    progress.finish_and_clear();
    write(
        &arguments.output,
        "registration.csv",
        &report::csv(&results),
    )?;
    let figure = report::figure(&results).into_diagnostic()?;
    write(&arguments.output, "registration.svg", &figure)?;
    if arguments.json {
        return print_json(&results);
    }
    print(&format!(
        "{}\nCSV and SVG files: {}\n",
        report::table(&results),
        arguments.output.display()
    ))
}
