//! The results of the errors study as people, spreadsheets and figures read them.

use super::localiser::Method;
use super::{AXES, Axis, Estimate, MethodResult};
use crate::planar_swarm::SwarmNoise;
use crate::plot::{self, Line, PlotError, Sweep};
use std::fmt::Write;

/// Who is drawn: the others would hide each other.
const DRAWN: [Method; 6] = [
    Method::Window(4),
    Method::Window(6),
    Method::Window(9),
    Method::Bank(6),
    Method::Trilateration,
    Method::TrilaterationBank,
];

/// The results as people read them: all of them at the usual noise, then what each noise does to the mean square errors.
#[must_use]
pub fn table(results: &[MethodResult]) -> String {
    let mut text = String::from(
        "usual noise (0.1 m, 0.05 m, 0.01 rad)\n\
         method                 rounds    position MSE m2   bound   ratio          median m   orientation MSE rad2   \
         bound   ratio          NEES a dimension  median  astray %  no answer %\n",
    );
    for one in results.iter().filter(|one| one.noise == SwarmNoise::USUAL) {
        let _ = writeln!(text, "{}", row(one));
    }
    text += "bounds: Cramer-Rao of the same answers, the bearing going around; NEES: 1 and 2.37 are honest, astray is more \
             than 25 in all\n";
    if let Some(bank) = results
        .iter()
        .find(|one| one.noise == SwarmNoise::USUAL && one.method == Method::Bank(6))
    {
        let (tangent, ratio) = (
            &bank.position_tangent_bound_m2,
            &bank.position_tangent_ratio,
        );
        let _ = writeln!(
            text,
            "bank from 6 over its recursive bound: {}; along the tangent, bound {}, {}",
            number(&bank.position_ratio),
            number(tangent),
            number(ratio),
        );
    }
    for axis in AXES {
        for (name, of, bound) in VALUES {
            let _ = write!(text, "\n{name:<20} (bound) at {:<20}", axis.name());
            for value in axis.values() {
                let _ = write!(text, " {value:>19}");
            }
            text.push('\n');
            for method in methods_of(results) {
                let cells: Vec<&MethodResult> = along(results, axis, method).collect();
                if cells.len() < axis.values().len() {
                    continue;
                }
                let _ = write!(text, "{:<51}", method.name());
                for one in cells {
                    let cell = format!("{} ({})", brief(of(one).mean), brief(bound(one).mean));
                    let _ = write!(text, " {cell:>19}");
                }
                text.push('\n');
            }
        }
    }
    text
}

/// A mean square error and its bound.
type Value = fn(&MethodResult) -> &Estimate;

const VALUES: [(&str, Value, Value); 2] = [
    (
        "position MSE m2",
        |one| &one.position_m2,
        |one| &one.position_bound_m2,
    ),
    (
        "orientation MSE rad2",
        |one| &one.orientation_rad2,
        |one| &one.orientation_bound_rad2,
    ),
];

fn row(one: &MethodResult) -> String {
    let honest = one.nees.map_or_else(String::new, |nees| {
        format!(
            "{:>6} +- {:<6} {:>7.2} {:>8.1}",
            brief(nees.mean),
            brief(nees.stderr),
            nees.median,
            100.0 * nees.astray
        )
    });
    format!(
        "{:<20} {:>2} to {:>2} {:>16} {:>7} {:>16} {:>9} {:>20} {:>8} {:>16} {:>38} {:>9.1}",
        one.method.name(),
        one.scored_from,
        one.method.last_round(),
        number(&one.position_m2),
        brief(one.position_bound_m2.mean),
        number(&one.position_ratio),
        brief(one.position_median_m),
        number(&one.orientation_rad2),
        brief(one.orientation_bound_rad2.mean),
        number(&one.orientation_ratio),
        honest,
        100.0 * one.unanswered,
    )
}

fn number(estimate: &Estimate) -> String {
    format!("{} +- {}", brief(estimate.mean), brief(estimate.stderr))
}

/// Three digits that count.
fn brief(number: f64) -> String {
    let places = (2.0 - number.abs().max(1e-9).log10().floor()).clamp(0.0, 6.0);
    format!("{number:.*}", places as usize)
}

/// One row a noise and method.
#[must_use]
pub fn csv(results: &[MethodResult]) -> String {
    let mut text = String::from(
        "method,range_sigma_m,translation_sigma_m,rotation_sigma_rad,samples,seed,scored_from,unanswered,\
         position_m2,position_stderr_m2,position_bound_m2,position_bound_stderr_m2,position_ratio,\
         position_ratio_stderr,position_tangent_bound_m2,position_tangent_bound_stderr_m2,position_tangent_ratio,\
         position_tangent_ratio_stderr,orientation_rad2,orientation_stderr_rad2,orientation_bound_rad2,\
         orientation_bound_stderr_rad2,orientation_ratio,orientation_ratio_stderr,position_median_m,\
         orientation_median_rad,nees,nees_stderr,nees_median,astray\n",
    );
    for one in results {
        let noise = &one.noise;
        let _ = write!(
            text,
            "{},{},{},{},{},{},{},{}",
            one.method.name(),
            noise.range_sigma_m,
            noise.translation_sigma_m,
            noise.rotation_sigma_rad,
            one.samples,
            one.seed,
            one.scored_from,
            one.unanswered,
        );
        for estimate in [
            &one.position_m2,
            &one.position_bound_m2,
            &one.position_ratio,
            &one.position_tangent_bound_m2,
            &one.position_tangent_ratio,
            &one.orientation_rad2,
            &one.orientation_bound_rad2,
            &one.orientation_ratio,
        ] {
            let _ = write!(text, ",{},{}", estimate.mean, estimate.stderr);
        }
        let _ = write!(
            text,
            ",{},{}",
            one.position_median_m, one.orientation_median_rad
        );
        let honest = one.nees.map_or_else(
            || ",,,,".to_owned(),
            |nees| {
                format!(
                    ",{},{},{},{}",
                    nees.mean, nees.stderr, nees.median, nees.astray
                )
            },
        );
        let _ = writeln!(text, "{honest}");
    }
    text
}

/// Mean square errors against each noise, their bounds beside them. Fails when there are no results.
pub fn figure(results: &[MethodResult]) -> Result<String, PlotError> {
    let sweep = |(name, of, bound): (&str, Value, Value), axis: Axis| {
        let lines = DRAWN.iter().enumerate().flat_map(|(colour, method)| {
            let line = |value: Value, is_bound: bool, label: String| Line {
                label,
                colour,
                is_bound,
                points: axis
                    .values()
                    .into_iter()
                    .zip(along(results, axis, *method))
                    .map(|(noise, one)| (noise, value(one).mean))
                    .collect(),
            };
            [
                Some(line(of, false, method.name())),
                // Both ways of Algorithm 2 have one bound.
                (*method != Method::TrilaterationBank)
                    .then(|| line(bound, true, format!("bound of {}", method.name()))),
            ]
        });
        Sweep {
            quantity: axis.name().to_owned(),
            name: name.to_owned(),
            lines: lines.flatten().collect(),
        }
    };
    let rows = VALUES.into_iter();
    let charts: Vec<Sweep> = rows
        .flat_map(|row| AXES.map(|axis| sweep(row, axis)))
        .collect();
    plot::sweeps(
        "Mean square errors of pairs that hear their distance, and their Cramer-Rao bounds",
        AXES.len(),
        &charts,
    )
}

/// Those of a method along an axis, in the order of its values.
fn along(
    results: &[MethodResult],
    axis: Axis,
    method: Method,
) -> impl Iterator<Item = &MethodResult> {
    axis.values().into_iter().filter_map(move |value| {
        let noise = axis.at(value);
        let mut all = results.iter();
        all.find(|one| one.method == method && one.noise == noise)
    })
}

/// Those that there are, once each, in the order of the results.
fn methods_of(results: &[MethodResult]) -> Vec<Method> {
    let mut methods = Vec::new();
    for one in results {
        if !methods.contains(&one.method) {
            methods.push(one.method);
        }
    }
    methods
}
