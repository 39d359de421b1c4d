//! Distances between robots as the TIERS group published them: one a line, beside the one that motion capture saw. There is
//! no odometry in these files, so they say how wrong the distances are, not where anybody is; the same robots with odometry
//! and truth are in a factor graph ([`crate::pyfg`]).
//!
//! ```text
//! timestamp,node1,node2,uwb_range,mocap_range,...
//! ```

use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Rows that are read at most.
pub const ROWS_MAX: usize = 2_000_000;

/// Farther than this (m) nothing is.
const FAR_M: f64 = 1e6;

/// Why a file cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TiersError {
    /// A line is wrong.
    #[error("line {line}: {reason}")]
    Line {
        /// Which, from one.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// There is nothing in it.
    #[error("there is no distance in it")]
    Empty,
}

/// The errors of one pair's distances: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairErrors {
    /// The two robots.
    pub nodes: (u32, u32),
    /// Distances.
    pub n: usize,
    /// Mean error, measured less true (m).
    pub mean_m: f64,
    /// Median error (m).
    pub median_m: f64,
    /// Standard deviation about the mean (m).
    pub std_m: f64,
}

/// The errors of all distances of a file, by pair.
///
/// # Errors
/// With the first line that is wrong, or when there is none.
pub fn errors(text: &str) -> Result<Vec<PairErrors>, TiersError> {
    let mut by_pair: BTreeMap<(u32, u32), Vec<f64>> = BTreeMap::new();
    for (index, line) in text.lines().enumerate() {
        let is_header = index == 0 && line.starts_with("timestamp,");
        if is_header || line.trim().is_empty() {
            continue;
        }
        let wrong = |reason: String| TiersError::Line {
            line: index + 1,
            reason,
        };
        if index > ROWS_MAX {
            return Err(wrong(format!("more than {ROWS_MAX} rows")));
        }
        let (nodes, error_m) = row(line).map_err(wrong)?;
        by_pair.entry(nodes).or_default().push(error_m);
    }
    if by_pair.is_empty() {
        return Err(TiersError::Empty);
    }
    let pairs = by_pair.into_iter();
    Ok(pairs
        .map(|(nodes, all)| PairErrors::of(nodes, all))
        .collect())
}

fn row(line: &str) -> Result<((u32, u32), f64), String> {
    let mut words = line.split(',').map(str::trim);
    let mut next = |name: &str| -> Result<f64, String> {
        let word = words.next().ok_or_else(|| format!("there is no {name}"))?;
        let number = word.parse().ok().filter(|value: &f64| value.is_finite());
        number.ok_or_else(|| format!("`{word}` is no {name}"))
    };
    next("time")?;
    let mut node = || -> Result<u32, String> {
        let number = next("node")?;
        let is_node = (0.0..=1e6).contains(&number) && number.fract().abs() < 1e-9;
        let wrong = || format!("{number} is no node");
        is_node.then_some(number as u32).ok_or_else(wrong)
    };
    let nodes = (node()?, node()?);
    if nodes.0 == nodes.1 {
        return Err(format!("both ends are node {}", nodes.0));
    }
    let mut length = |name: &str| -> Result<f64, String> {
        let metres = next(name)?;
        let wrong = || format!("a {name} of {metres} m is absurd");
        (0.0..=FAR_M)
            .contains(&metres)
            .then_some(metres)
            .ok_or_else(wrong)
    };
    let (measured_m, true_m) = (length("measured distance")?, length("true distance")?);
    Ok((nodes, measured_m - true_m))
}

impl PairErrors {
    /// Of at least one error.
    fn of(nodes: (u32, u32), mut errors_m: Vec<f64>) -> Self {
        errors_m.sort_by(f64::total_cmp);
        let n = errors_m.len() as f64;
        let mean_m = errors_m.iter().sum::<f64>() / n;
        let squares = errors_m
            .iter()
            .map(|one| (one - mean_m).powi(2))
            .sum::<f64>();
        Self {
            nodes,
            n: errors_m.len(),
            mean_m,
            median_m: errors_m[errors_m.len() / 2],
            std_m: (squares / n).sqrt(),
        }
    }
}

/// The errors as people read them.
#[must_use]
pub fn table(results: &[PairErrors]) -> String {
    let mut text =
        String::from("nodes     distances   mean m  median m    std m   (measured less true)\n");
    for one in results {
        let (a, b) = one.nodes;
        let _ = writeln!(
            text,
            "{a:>2} - {b:<2} {:>12} {:>8.3} {:>9.3} {:>8.3}",
            one.n, one.mean_m, one.median_m, one.std_m
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::datasets;

    const HEADER: &str =
        "timestamp,node1,node2,uwb_range,mocap_range,tb_node1_yaw,tb_node2_yaw,error\n";

    #[test]
    fn errors_are_counted_by_pair() {
        let text = format!("{HEADER}1.5,1.0,3.0,4.5,4.0,0,0,0.5\n2.5,1.0,3.0,4.2,4.1\n3,3,4,1,1\n");
        let results = errors(&text).unwrap();
        assert_eq!((results[0].nodes, results[0].n), ((1, 3), 2));
        assert!((results[0].mean_m - 0.3).abs() < 1e-12);
        assert!((results[0].std_m - 0.2).abs() < 1e-12);
        assert_eq!((results[1].nodes, results[1].n), ((3, 4), 1));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let cases = [
            ("1,1,3,4", "no true distance"),
            ("x,1,3,4,4", "no time"),
            ("1,1.5,3,4,4", "no node"),
            ("1,-1,3,4,4", "no node"),
            ("1,3,3,4,4", "both ends"),
            ("1,1,3,NaN,4", "measured distance"),
            ("1,1,3,-4,4", "absurd"),
            ("1,1,3,4,1e300", "absurd"),
        ];
        for (row, expected) in cases {
            let error = errors(&format!("{HEADER}1,1,3,4,4\n{row}\n")).unwrap_err();
            let told = error.to_string();
            assert!(
                told.contains(expected) && told.starts_with("line 3"),
                "{row}: {told}"
            );
        }
        assert_eq!(errors(HEADER), Err(TiersError::Empty));
    }

    #[test]
    fn the_real_distances_are_a_third_of_a_metre_too_long() {
        let Some(folder) = datasets::find("tiers_uwb") else {
            return;
        };
        let text = std::fs::read_to_string(folder.join("20221011_processed.csv")).unwrap();
        let results = errors(&text).unwrap();
        let n: usize = results.iter().map(|one| one.n).sum();
        let mean_m = results
            .iter()
            .map(|one| one.n as f64 * one.mean_m)
            .sum::<f64>()
            / n as f64;
        assert_eq!(n, 8712);
        assert!((mean_m - 0.35).abs() < 0.05, "{mean_m}");
    }
}
