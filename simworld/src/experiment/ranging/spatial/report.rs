//! The results of the study in space as people, spreadsheets and figures read them.

use super::{CellResult, ROUNDS, WRONG_M};
use crate::plot::{self, Panel, PlotError, Trace};
use std::fmt::Write;

/// Median errors are drawn up to this (m).
const SHOWN_M: f64 = 2.0;

/// The results as people read them.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut text = format!(
        "{ROUNDS} rounds; errors and NEES per dimension are of the places told; wrong: more than {WRONG_M} m off\n\
         {:<26} pairs   told, % of rounds    ever %   first   position MSE m2     median m   yaw MSE rad2          \
         median rad   wrong % (pairs)   NEES mean        median   imprecise %  several %  none %\n",
        "pairs of drones"
    );
    for one in results {
        let _ = writeln!(
            text,
            "{:<26} {:>5} {:>8.1} +- {:<6.1} {:>8.1} {:>7} {:>8.3} +- {:<6.3} {:>8.3} {:>10.5} +- {:<8.5} {:>9.4} \
             {:>9.2} ({:>3}) {:>9.2} +- {:<5.2} {:>6.2} {:>11.1} {:>10.1} {:>8.1}",
            one.cell.name,
            one.samples,
            100.0 * one.told.place,
            100.0 * one.place_stderr,
            100.0 * one.ever,
            one.first_round,
            one.position_mse_m2,
            one.position_mse_stderr_m2,
            one.position_median_m,
            one.yaw_mse_rad2,
            one.yaw_mse_stderr_rad2,
            one.yaw_median_rad,
            100.0 * one.wrong,
            one.wrong_pairs,
            one.nees.mean,
            one.nees_stderr,
            one.nees.median,
            100.0 * one.told.imprecise,
            100.0 * one.told.ambiguous,
            100.0 * one.told.nothing,
        );
    }
    text
}

/// Every cell and round, one row each.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    let mut text = String::from(
        "cell,range_sigma_m,translation_sigma_m,rotation_sigma_rad,samples,seed,round,place,median_m\n",
    );
    for one in results {
        let noise = &one.cell.noise;
        let rounds = one.place_by_round.iter().zip(&one.median_by_round_m);
        for (round, (place, median_m)) in rounds.enumerate() {
            let _ = writeln!(
                text,
                "\"{}\",{},{},{},{},{},{round},{place},{}",
                one.cell.name,
                noise.range_sigma_m,
                noise.translation_sigma_m,
                noise.rotation_sigma_rad,
                one.samples,
                one.seed,
                median_m.map_or_else(String::new, |median_m| median_m.to_string()),
            );
        }
    }
    text
}

/// By round, to how many a place was told, and how far off it was. Fails when there are no results.
pub fn figure(results: &[CellResult]) -> Result<String, PlotError> {
    let trace = |one: &CellResult, values: &mut dyn Iterator<Item = f64>| Trace {
        label: one.cell.name.to_owned(),
        points: (0..).map(f64::from).zip(values).collect(),
    };
    let told = |one: &CellResult| trace(one, &mut one.place_by_round.iter().copied());
    let off = |one: &CellResult| {
        let medians = one.median_by_round_m.iter();
        trace(
            one,
            &mut medians.map(|median_m| median_m.unwrap_or(f64::NAN)),
        )
    };
    let panels = [
        Panel {
            name: "told a place, share of pairs (time: rounds)".to_owned(),
            shown: (0.0, 1.02),
            traces: results.iter().map(told).collect(),
        },
        Panel {
            name: "median error of those, m (time: rounds)".to_owned(),
            shown: (0.0, SHOWN_M),
            traces: results.iter().map(off).collect(),
        },
    ];
    plot::panels("Drones that find each other by distances", 1, &panels)
}
