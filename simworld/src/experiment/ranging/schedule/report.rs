//! The results of the schedule study as people, spreadsheets and figures read them.

use super::{LongRun, WaitResult};
use crate::plot::{self, Bar, BarGroup, PlotError};
use std::fmt::Write;

/// The results as people read them.
#[must_use]
pub fn table(waits: &[WaitResult], runs: &[LongRun]) -> String {
    let mut text = String::from(
        "robots  loss  sent  degree   all moved after, rounds (worst)   round robin   moving, % a round   \
         longest wait   waits beyond degree, per mille (first)   bytes a round\n",
    );
    for one in waits {
        let cell = &one.cell;
        let _ = writeln!(
            text,
            "{:>6} {:>4.0}% {:>4}x {:>7.2} {:>12.2} +- {:>4.2} ({:>3}) {:>20} {:>11.2} +- {:>4.2} {:>14} {:>20.2} ({:.2}) {:>19}",
            cell.robots,
            100.0 * cell.loss,
            cell.repeats,
            one.degree_mean,
            one.all_moved_rounds,
            one.all_moved_rounds_stderr,
            one.all_moved_rounds_max,
            one.round_robin_rounds,
            100.0 * one.moving,
            100.0 * one.moving_stderr,
            one.wait_rounds_max,
            one.waits_beyond_degree,
            one.first_waits_beyond_degree,
            one.bytes_per_round,
        );
    }
    text += "\nswarms that drive, crash and come back, rounds of each: conflicts are pairs that moved together though they \
             knew each other\n\
             loss   rounds  crashes   joins  moving %  conflicts  met while moving  not yet known  together again\n";
    for run in runs {
        let _ = writeln!(
            text,
            "{:>3.0}% {:>8} {:>8} {:>7} {:>9.2} {:>10} {:>17} {:>14} {:>15}",
            100.0 * run.loss,
            run.rounds,
            run.crashes,
            run.joins,
            100.0 * run.moving,
            run.conflicts,
            run.met_while_moving,
            run.not_yet_known,
            run.unresolved,
        );
    }
    text
}

/// The waits, one row a cell.
#[must_use]
pub fn csv(waits: &[WaitResult]) -> String {
    let mut text = String::from(
        "robots,degree,loss,repeats,samples,seed,degree_mean,all_moved_rounds,all_moved_rounds_stderr,\
         all_moved_rounds_max,moving,moving_stderr,wait_rounds_max,first_waits_beyond_degree,waits_beyond_degree,\
         round_robin_rounds,bytes_per_round\n",
    );
    for one in waits {
        let cell = &one.cell;
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            cell.robots,
            cell.degree,
            cell.loss,
            cell.repeats,
            one.samples,
            one.seed,
            one.degree_mean,
            one.all_moved_rounds,
            one.all_moved_rounds_stderr,
            one.all_moved_rounds_max,
            one.moving,
            one.moving_stderr,
            one.wait_rounds_max,
            one.first_waits_beyond_degree,
            one.waits_beyond_degree,
            one.round_robin_rounds,
            one.bytes_per_round,
        );
    }
    text
}

/// The long runs, one row a loss.
#[must_use]
pub fn runs_csv(runs: &[LongRun]) -> String {
    let mut text = String::from(
        "loss,robots,rounds,seed,moving,crashes,joins,conflicts,met_while_moving,not_yet_known,unresolved\n",
    );
    for run in runs {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{}",
            run.loss,
            run.robots,
            run.rounds,
            run.seed,
            run.moving,
            run.crashes,
            run.joins,
            run.conflicts,
            run.met_while_moving,
            run.not_yet_known,
            run.unresolved,
        );
    }
    text
}

/// Rounds after which all have moved, beside round robin's, which are cut at the top. Fails when there are no results.
pub fn figure(waits: &[WaitResult]) -> Result<String, PlotError> {
    let group = |one: &WaitResult| BarGroup {
        label: format!(
            "{} robots {:.0}% lost, sent {}x",
            one.cell.robots,
            100.0 * one.cell.loss,
            one.cell.repeats
        ),
        bars: vec![
            Bar {
                label: "maximal independent sets".to_owned(),
                height: one.all_moved_rounds,
                stderr: one.all_moved_rounds_stderr,
            },
            Bar {
                label: "round robin".to_owned(),
                height: one.round_robin_rounds as f64,
                stderr: 0.0,
            },
        ],
    };
    let groups: Vec<BarGroup> = waits.iter().map(group).collect();
    plot::bars("Rounds until everybody has moved", &groups, TOP_ROUNDS)
}

/// The top of the axis of rounds.
const TOP_ROUNDS: f64 = 40.0;
