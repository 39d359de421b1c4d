//! The results of the study as people read them: a table, CSV, and one figure.

use super::cell::Cell;
use super::{ApartResult, CellResult, Method, MethodResult};
use crate::plot::{self, Bar, BarGroup, PlotError};
use std::fmt::Write;

/// Ratios above it are cut in the figure and keep their number.
const RATIO_SHOWN_MAX: f64 = 2.0;
/// Cells that stand beside each other in the figure.
const CELLS_BESIDE: usize = 9;
/// Cells whose NEES is drawn over time, if they were flown.
const DRAWN: [&str; 7] = [
    "pose-2",
    "pose-5",
    "bearing",
    "loss-30-repeats",
    "gross-20",
    "noise-half",
    "biased",
];

impl Method {
    /// What tables call it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Star => "star",
            Self::Team => "team",
            Self::Batch => "batch",
        }
    }
}

/// What is asked of a cell and not kept, in words.
#[must_use]
pub fn missed(result: &CellResult) -> Vec<String> {
    let asked = Cell::named(result.cell)
        .map(|cell| cell.asked)
        .unwrap_or_default();
    let mut missed = Vec::new();
    let Some(team) = result.method(Method::Team) else {
        return missed;
    };
    if let Some(most) = asked.ratio.filter(|most| team.ratio > *most) {
        missed.push(format!(
            "{:.3} +- {:.3} of the bound, asked {most:.2}",
            team.ratio, team.ratio_stderr
        ));
    }
    if let Some(most) = asked.rmse_m.filter(|most| team.rmse_m > *most) {
        missed.push(format!("{:.3} m, asked {most:.2}", team.rmse_m));
    }
    let moved = result.apart.as_ref().and_then(|apart| apart.moved_sigmas);
    if let (Some(most), Some((_, moved))) = (asked.moved_sigmas, moved)
        && moved > most
    {
        missed.push(format!("moved by {moved:.1} sigmas, asked {most:.0}"));
    }
    if let (Some((low, high)), Some(nees)) = (asked.nees, &team.nees)
        && !(low..=high).contains(&nees.mean)
    {
        missed.push(format!("NEES {:.2}, asked {low:.2}-{high:.2}", nees.mean));
    }
    missed
}

/// One row a cell.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut text = String::from(
        "RMSE at the last round, m, and over the bound; NEES per degree of freedom at the last round, its 95 % bounds, and\n\
         the share of rounds inside them\n\
         cell                bound   paper    star    team       team / bound    |e|    NEES median  95 %       \
         inside batch  undetermined quarantines accused    ms  scored apart\n",
    );
    for result in results {
        text += &row(result);
    }
    text += "\nasked of the team estimator and not kept:\n";
    for result in results {
        for miss in missed(result) {
            let _ = writeln!(text, "  {:<18} {miss}", result.cell);
        }
    }
    text
}

fn row(result: &CellResult) -> String {
    let mut text = String::new();
    let _ = write!(text, "{:<18}", result.cell);
    for method in [Method::Batch, Method::Paper, Method::Star, Method::Team] {
        let found = result.method(method);
        let shown = found.map_or_else(|| "-".to_owned(), |of| format!("{:.4}", of.rmse_m));
        let _ = write!(text, " {shown:>7}");
    }
    if let Some(team) = result.method(Method::Team) {
        let _ = write!(
            text,
            "  {:>7.3} +- {:<6.3} {:>7.4}",
            team.ratio, team.ratio_stderr, team.mean_norm_m
        );
        if let Some(nees) = &team.nees {
            let _ = write!(
                text,
                "  {:>5.2} {:>6.2}  {:.2}-{:.2}  {:>5.0}%",
                nees.mean,
                nees.median,
                nees.low,
                nees.high,
                100.0 * nees.inside
            );
        }
    }
    let batch = result.method(Method::Batch);
    let batch = batch.and_then(|batch| batch.nees.as_ref());
    let batch = batch.map_or_else(|| "-".to_owned(), |nees| format!("{:.2}", nees.mean));
    let _ = write!(
        text,
        " {batch:>5}  {:>12.2} {:>11.2} {:>7} {:>6.2}",
        result.undetermined, result.quarantines, result.honest_accused, result.milliseconds
    );
    if let Some(apart) = &result.apart {
        let _ = write!(text, "  {:.3} +- {:.3}", apart.ratio, apart.ratio_stderr);
        if let Some((mean, largest)) = apart.moved_sigmas {
            let _ = write!(text, ", moved by {mean:.1} sigmas, at most {largest:.1}");
        }
    }
    text.push('\n');
    text
}

/// One row a cell and method.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    let mut text = String::from(
        "cell,robots,rounds,samples,seed,method,rmse_m,rmse_stderr_m,mean_norm_m,ratio,ratio_stderr,nees_mean,\
         nees_median,nees_low,nees_high,nees_inside,undetermined,quarantines,honest_accused,milliseconds,apart_ratio,\
         apart_ratio_stderr,moved_sigmas_mean,moved_sigmas_largest\n",
    );
    for result in results {
        for of in &result.methods {
            let _ = write!(
                text,
                "\"{}\",{},{},{},{},{},{},{},{},{},{}",
                result.cell,
                result.robots,
                result.rounds,
                result.samples,
                result.seed,
                of.method.name(),
                of.rmse_m,
                of.rmse_stderr_m,
                of.mean_norm_m,
                of.ratio,
                of.ratio_stderr,
            );
            match &of.nees {
                Some(nees) => {
                    let _ = write!(
                        text,
                        ",{},{},{},{},{}",
                        nees.mean, nees.median, nees.low, nees.high, nees.inside
                    );
                }
                None => text += ",,,,,",
            }
            let _ = match of.method {
                Method::Team => writeln!(
                    text,
                    ",{},{},{},{},{}",
                    result.undetermined,
                    result.quarantines,
                    result.honest_accused,
                    result.milliseconds,
                    apart_numbers(result.apart.as_ref())
                ),
                _ => writeln!(text, ",,,,,,,,"),
            };
        }
    }
    text
}

/// Four columns; empty where there is nothing.
fn apart_numbers(apart: Option<&ApartResult>) -> String {
    apart.map_or_else(
        || ",,,".to_owned(),
        |apart| {
            let moved = apart.moved_sigmas;
            let moved =
                moved.map_or_else(|| ",".to_owned(), |(mean, most)| format!("{mean},{most}"));
            format!("{},{},{moved}", apart.ratio, apart.ratio_stderr)
        },
    )
}

/// Bars of the error over the bound, and below them the NEES over time of a few cells.
///
/// # Errors
/// [`PlotError`] when there is nothing to draw.
pub fn figure(results: &[CellResult]) -> Result<String, PlotError> {
    let bar = |of: &MethodResult| Bar {
        label: of.method.name().to_owned(),
        height: of.ratio,
        stderr: of.ratio_stderr,
    };
    let group = |result: &CellResult| BarGroup {
        label: result.cell.replace('-', " "),
        bars: result
            .methods
            .iter()
            .filter(|of| of.method != Method::Batch && of.ratio.is_finite())
            .map(bar)
            .collect(),
    };
    let mut drawings = Vec::new();
    for row in results.chunks(CELLS_BESIDE) {
        let groups: Vec<BarGroup> = row.iter().map(group).collect();
        drawings.push(plot::bars(
            "RMSE at the last round over the bound of a batch",
            &groups,
            RATIO_SHOWN_MAX,
        )?);
    }
    let drawn = results
        .iter()
        .filter(|result| DRAWN.contains(&result.cell))
        .filter_map(|result| Some((result.cell, result.method(Method::Team)?.nees.as_ref()?)));
    let drawn: Vec<_> = drawn.collect();
    if let Some((_, nees)) = drawn.first() {
        let curves: Vec<(String, Vec<f64>)> = drawn
            .iter()
            .map(|(cell, nees)| ((*cell).to_owned(), nees.over_time.clone()))
            .collect();
        drawings.push(plot::banded(
            "NEES per degree of freedom of the own pose, with the 95 % bounds of its mean",
            &curves,
            (nees.low, nees.high),
        )?);
    }
    Ok(plot::stacked(&drawings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::consistency::Nees;

    fn result(cell: &'static str, ratio: f64, mean: f64) -> CellResult {
        let of = |method, ratio, nees| MethodResult {
            method,
            rmse_m: 0.07 * ratio,
            rmse_stderr_m: 0.001,
            mean_norm_m: 0.06,
            ratio,
            ratio_stderr: 0.005,
            nees,
        };
        let nees = Nees {
            mean,
            median: 0.9,
            low: 0.8,
            high: 1.2,
            inside: 0.95,
            over_time: vec![1.1, mean],
        };
        CellResult {
            cell,
            robots: 5,
            rounds: 2,
            samples: 40,
            seed: 1,
            methods: vec![
                of(Method::Paper, 3.4, None),
                of(Method::Team, ratio, Some(nees)),
                of(Method::Batch, 1.0, None),
            ],
            apart: None,
            undetermined: 0.0,
            quarantines: 0.0,
            honest_accused: 0,
            milliseconds: 0.7,
        }
    }

    #[test]
    fn what_is_asked_and_not_kept_is_said() {
        assert_eq!(missed(&result("pose-5", 1.01, 1.0)), Vec::<String>::new());
        let mut jumped = result("meeting", 1.01, 1.0);
        jumped.apart = Some(ApartResult {
            rmse_m: 0.1,
            ratio: 1.0,
            ratio_stderr: 0.01,
            moved_sigmas: Some((0.5, 3.1)),
        });
        assert_eq!(missed(&jumped), ["moved by 3.1 sigmas, asked 3"]);
        let missed = missed(&result("pose-5", 1.03, 1.3));
        assert_eq!(
            missed,
            [
                "1.030 +- 0.005 of the bound, asked 1.02",
                "NEES 1.30, asked 0.85-1.15"
            ]
        );
    }

    #[test]
    fn every_cell_has_its_row_every_method_its_line_and_there_is_a_figure() {
        let mut results = [result("pose-5", 1.01, 1.0), result("mixed", 1.2, 1.0)];
        results[1].apart = Some(ApartResult {
            rmse_m: 0.1,
            ratio: 1.4,
            ratio_stderr: 0.04,
            moved_sigmas: Some((0.5, 2.5)),
        });
        let table = table(&results);
        let rows = table.lines().filter(|line| line.starts_with("pose-5  "));
        assert_eq!(rows.count(), 1, "{table}");
        assert!(table.contains("1.400 +- 0.040, moved by 0.5 sigmas, at most 2.5"));
        let columns = |line: &str| line.split(',').count();
        let csv = csv(&results);
        assert_eq!(csv.lines().count(), 7);
        assert!(csv.lines().all(|line| columns(line) == 24), "{csv}");
        let figure = figure(&results).unwrap();
        assert_eq!(figure.matches("<svg ").count(), 3);
    }
}
