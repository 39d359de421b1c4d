//! The results of registration as people, spreadsheets and figures read them.

use super::cell::Cell;
use super::{CellResult, REGISTRARS, Registrar};
use crate::plot::{self, Bar, BarGroup, PlotError};
use std::fmt::Write;

/// The results as people read them.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut text = format!("{:<34}", "every neighbour in place / strict");
    for registrar in REGISTRARS {
        let _ = write!(text, "  {:<29}", registrar.name());
    }
    text += "  any   solutions  NEES  cut %  ms (single scan, published)\n";
    for cell in cells(results) {
        let _ = write!(text, "{:<34}", cell.name());
        let of = |registrar| find(results, &cell, registrar);
        for registrar in REGISTRARS {
            let shown = of(registrar).map_or_else(String::new, |one| {
                format!(
                    "{:.3} +- {:.3} / {:.3} +- {:.3}",
                    one.pose, one.pose_stderr, one.strict, one.strict_stderr
                )
            });
            let _ = write!(text, "  {shown:<29}");
        }
        if let Some(ours) = of(Registrar::SingleScan) {
            let _ = write!(
                text,
                "  {:.3}  {:>7.1}  {:>5.2}  {:>5.1}  {:>8.2}",
                ours.pose_in_any,
                ours.solutions,
                ours.nees_per_dof,
                100.0 * ours.cut,
                ours.time_ms
            );
        }
        if let Some(published) = of(Registrar::Published) {
            let _ = write!(text, "  {:>9.2}", published.time_ms);
        }
        text += "\n";
    }
    text
}

/// Every cell and registrar, one row each.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    let mut text = String::from(
        "robots,noise_deg,phantoms,misses,silent,registrar,samples,seed,pose,pose_stderr,pose_in_any,strict,\
         strict_stderr,own_strict,solutions,nees_per_dof,cut,time_ms\n",
    );
    for one in results {
        let Cell {
            robots,
            noise_deg,
            phantoms,
            misses,
            silent,
        } = one.cell;
        let _ = writeln!(
            text,
            "{robots},{noise_deg},{phantoms},{misses},{silent},\"{}\",{},{},{},{},{},{},{},{},{},{},{},{}",
            one.registrar.name(),
            one.samples,
            one.seed,
            one.pose,
            one.pose_stderr,
            one.pose_in_any,
            one.strict,
            one.strict_stderr,
            one.own_strict,
            one.solutions,
            one.nees_per_dof,
            one.cut,
            one.time_ms
        );
    }
    text
}

/// The shares of scans with every neighbour in place, bars of each cell beside each other. Fails when there are no results.
pub fn figure(results: &[CellResult]) -> Result<String, PlotError> {
    let group = |cell: &Cell| BarGroup {
        label: cell.name(),
        bars: REGISTRARS
            .iter()
            .filter_map(|registrar| find(results, cell, *registrar))
            .map(|one| Bar {
                label: one.registrar.name().to_owned(),
                height: one.pose,
                stderr: one.pose_stderr,
            })
            .collect(),
    };
    let cells = cells(results);
    let drawings = cells
        .chunks(CELLS_IN_A_ROW)
        .map(|cells| {
            let groups: Vec<BarGroup> = cells.iter().map(group).collect();
            plot::bars("Share of scans with every neighbour in place", &groups, 1.0)
        })
        .collect::<Result<Vec<String>, PlotError>>()?;
    Ok(plot::stacked(&drawings))
}

/// Groups of bars that have room beside each other.
const CELLS_IN_A_ROW: usize = 8;

fn find<'a>(
    results: &'a [CellResult],
    cell: &Cell,
    registrar: Registrar,
) -> Option<&'a CellResult> {
    results
        .iter()
        .find(|one| one.cell == *cell && one.registrar == registrar)
}

/// The cells there are results of, in their order.
fn cells(results: &[CellResult]) -> Vec<Cell> {
    let mut cells: Vec<Cell> = Vec::new();
    for one in results {
        if !cells.contains(&one.cell) {
            cells.push(one.cell);
        }
    }
    cells
}
