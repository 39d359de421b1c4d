//! The results of mutual localisation as people and programs read them.

use super::CellResult;
use super::score::Estimate;
use std::fmt::Write;

/// A table, one line a case and method.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut text = format!(
        "{:<26} {:<12} {:>13} {:>11} {:>13}  {:>13} {:>7} {:>7} {:>6}  {:>12} {:>12} {:>12} {:>12} {:>9} {:>10}  {:>7} {:>7}\n",
        "case",
        "method",
        "lock s",
        "p90 s",
        "within 10% s",
        "wrong mode %",
        "wrong",
        "silent",
        "publ %",
        "azimuth deg",
        "zenith deg",
        "yaw deg",
        "distance %",
        "bias %",
        "NEES/7",
        "ident %",
        "wrong %",
    );
    for result in results {
        let scores = &result.scores;
        let _ = writeln!(
            text,
            "{:<26} {:<12} {:>13} {:>11} {:>13}  {:>13} {:>7} {:>7} {:>6}  {:>12} {:>12} {:>12} {:>12} {:>9} {:>10}  {:>7} {:>7}",
            result.case,
            result.method.name(),
            spread(scores.lock_median_s, 1.0, 1),
            spread(scores.lock_p90_s, 1.0, 1),
            spread(scores.found_median_s, 1.0, 1),
            spread(scores.wrong_mode, 100.0, 2),
            format!("{}/{}", scores.wrong_at_end, scores.neighbours),
            format!("{}/{}", scores.silent_at_end, scores.neighbours),
            number(scores.published, 100.0, 1),
            spread(scores.azimuth_deg, 1.0, 2),
            spread(scores.zenith_deg, 1.0, 2),
            spread(scores.yaw_deg, 1.0, 2),
            spread(scores.distance, 100.0, 1),
            spread(scores.distance_bias, 100.0, 1),
            spread(scores.nees, 1.0, 2),
            number(scores.identified, 100.0, 1),
            number(scores.misidentified, 100.0, 2),
        );
    }
    text += "\nMeans of |e| +- standard error over flights, while a right place is published, from 20 s on; wrong: more than 20 deg\noff in direction or yaw; NEES per dimension: of whatever is published with a covariance. Times of those that never come to it count as the longest.\n\n";
    text + &held(results)
}

/// The same for whatever place is held, one line a case and method, and how level everyone was.
fn held(results: &[CellResult]) -> String {
    let mut text = format!(
        "{:<26} {:<12} {:>14} {:>14} {:>14} {:>14} {:>14} {:>12} {:>12}\n",
        "whatever place is held",
        "method",
        "wrong mode %",
        "azimuth deg",
        "zenith deg",
        "yaw deg",
        "distance %",
        "roll deg",
        "pitch deg",
    );
    for result in results {
        let scores = &result.scores;
        let _ = writeln!(
            text,
            "{:<26} {:<12} {:>14} {:>14} {:>14} {:>14} {:>14} {:>12} {:>12}",
            result.case,
            result.method.name(),
            spread(scores.held_wrong_mode, 100.0, 2),
            spread(scores.held_azimuth_deg, 1.0, 2),
            spread(scores.held_zenith_deg, 1.0, 2),
            spread(scores.held_yaw_deg, 1.0, 2),
            spread(scores.held_distance, 100.0, 1),
            spread(scores.roll_deg, 1.0, 2),
            spread(scores.pitch_deg, 1.0, 2),
        );
    }
    text
}

/// One line a case and method, every score with its standard error.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    let mut text = String::new();
    for (index, result) in results.iter().enumerate() {
        let columns = columns(result);
        if index == 0 {
            let names: Vec<String> = columns
                .iter()
                .map(|(name, _)| format!("{name},{name}_stderr"))
                .collect();
            let _ = writeln!(
                text,
                "case,method,samples,seed,neighbours,never_found,wrong_at_end,silent_at_end,{}",
                names.join(",")
            );
        }
        let cell = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let values: Vec<String> = columns
            .iter()
            .map(|(_, estimate)| format!("{},{}", cell(estimate.value), cell(estimate.stderr)))
            .collect();
        let scores = &result.scores;
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{}",
            result.case,
            result.method.name(),
            result.samples,
            result.seed,
            scores.neighbours,
            scores.never_found,
            scores.wrong_at_end,
            scores.silent_at_end,
            values.join(",")
        );
    }
    text
}

/// The errors of every neighbour after every own set of every flight.
#[must_use]
pub fn moments_csv(result: &CellResult) -> String {
    let mut text = String::from(
        "flight,robot,time_s,published,azimuth_deg,zenith_deg,distance_percent,yaw_deg\n",
    );
    for (flight, neighbours) in result.flights.iter().enumerate() {
        for (neighbour, moments) in neighbours.iter().enumerate() {
            for moment in moments {
                let Some(error) = moment.error else { continue };
                let _ = writeln!(
                    text,
                    "{flight},{},{:.3},{},{:.4},{:.4},{:.3},{:.4}",
                    neighbour + 2,
                    moment.taken_s,
                    u8::from(moment.published),
                    error.azimuth_rad.to_degrees(),
                    error.zenith_rad.to_degrees(),
                    100.0 * error.distance,
                    error.yaw_rad.to_degrees(),
                );
            }
        }
    }
    text
}

fn columns(result: &CellResult) -> [(&'static str, Estimate); 23] {
    let scores = &result.scores;
    [
        ("lock_median_s", scores.lock_median_s),
        ("lock_p90_s", scores.lock_p90_s),
        ("found_median_s", scores.found_median_s),
        ("wrong_mode", scores.wrong_mode),
        ("published", scores.published),
        ("azimuth_deg", scores.azimuth_deg),
        ("zenith_deg", scores.zenith_deg),
        ("yaw_deg", scores.yaw_deg),
        ("distance", scores.distance),
        ("distance_bias", scores.distance_bias),
        ("azimuth_rmse_deg", scores.azimuth_rmse_deg),
        ("yaw_rmse_deg", scores.yaw_rmse_deg),
        ("distance_rmse", scores.distance_rmse),
        ("held_azimuth_deg", scores.held_azimuth_deg),
        ("held_zenith_deg", scores.held_zenith_deg),
        ("held_yaw_deg", scores.held_yaw_deg),
        ("held_distance", scores.held_distance),
        ("held_wrong_mode", scores.held_wrong_mode),
        ("nees", scores.nees),
        ("identified", scores.identified),
        ("misidentified", scores.misidentified),
        ("roll_deg", scores.roll_deg),
        ("pitch_deg", scores.pitch_deg),
    ]
}

fn number(estimate: Estimate, unit: f64, digits: usize) -> String {
    let number = |value: f64| format!("{:.digits$}", value * unit);
    estimate.value.map_or_else(|| "-".to_owned(), number)
}

fn spread(estimate: Estimate, unit: f64, digits: usize) -> String {
    let value = number(estimate, unit, digits);
    match estimate.stderr {
        Some(stderr) => format!("{value}+-{:.digits$}", stderr * unit),
        None => value,
    }
}
