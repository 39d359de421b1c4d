//! The figures of Cognetti et al.: 5 (one attitude), 6 and 8 (errors over time) and 7 and 9 (what is believed at two
//! instants), for any case and method; and errors over time as means over all flights.

use super::CellResult;
use super::flight::{Error, Moment};
use crate::plot::{self, Panel, PlotError, Scene, Spot, Trace};

/// An error in a figure.
struct Drawn {
    /// What stands beside the axis.
    name: &'static str,
    /// The largest that is shown.
    most: f64,
    /// How it is read from an estimate.
    of: fn(&Error) -> f64,
}

const DRAWN: [Drawn; 4] = [
    Drawn {
        name: "azimuth, deg",
        most: 30.0,
        of: |error| error.azimuth_rad.to_degrees(),
    },
    Drawn {
        name: "zenith distance, deg",
        most: 15.0,
        of: |error| error.zenith_rad.to_degrees(),
    },
    Drawn {
        name: "distance, %",
        most: 60.0,
        of: |error| 100.0 * error.distance,
    },
    Drawn {
        name: "yaw, deg",
        most: 30.0,
        of: |error| error.yaw_rad.to_degrees(),
    },
];
/// Largest error of roll and pitch that is shown, degrees.
const TILT_DEG: f64 = 2.0;

/// File names (without folder) and SVG texts of a cell.
///
/// # Errors
/// [`PlotError`] when there is nothing to draw.
pub fn of(result: &CellResult) -> Result<Vec<(String, String)>, PlotError> {
    let name = |figure: &str| format!("{}-{}-{figure}.svg", result.case, result.method.name());
    Ok(vec![
        (name("errors"), errors(result)?),
        (name("mean-errors"), mean_errors(result)?),
        (name("snapshots"), snapshots(result)?),
    ])
}

/// Figures 6 and 8: one flight.
fn errors(result: &CellResult) -> Result<String, PlotError> {
    let mut drawn: Vec<Panel> = [(1, "roll, deg"), (2, "pitch, deg")]
        .into_iter()
        .map(|(axis, name)| Panel {
            name: name.to_owned(),
            shown: (-TILT_DEG, TILT_DEG),
            traces: numbered(&result.tilt, 1, |tilt| (tilt[0], tilt[axis].to_degrees())),
        })
        .collect();
    let flight = result.flights.first().map_or(&[][..], Vec::as_slice);
    for Drawn { name, most, of } in DRAWN {
        let point = |moment: &Moment| {
            (
                moment.taken_s,
                moment.error.map_or(f64::NAN, |error| of(&error)),
            )
        };
        drawn.push(Panel {
            name: name.to_owned(),
            shown: (-most, most),
            traces: numbered(flight, 2, point),
        });
    }
    let title = format!(
        "{}, {}: errors of robot 1, one flight",
        result.case,
        result.method.name()
    );
    plot::panels(&title, 2, &drawn)
}

/// The same as means of |e| over all flights, of those that have an estimate then.
fn mean_errors(result: &CellResult) -> Result<String, PlotError> {
    let neighbours = result.flights.first().map_or(0, Vec::len);
    let images = result
        .flights
        .iter()
        .flatten()
        .map(Vec::len)
        .min()
        .unwrap_or(0);
    let mut drawn = Vec::new();
    for Drawn { name, most, of } in DRAWN {
        let trace = |neighbour: usize| {
            let point = |image: usize| {
                let moments = result.flights.iter().map(|flight| flight[neighbour][image]);
                let taken_s = moments.clone().next().map_or(0.0, |moment| moment.taken_s);
                let sizes = moments
                    .filter_map(|moment| moment.error)
                    .map(|error| of(&error).abs());
                let (count, sum) =
                    sizes.fold((0.0, 0.0), |(count, sum), size| (count + 1.0, sum + size));
                // Nothing known is not a number: a gap.
                (taken_s, sum / count)
            };
            (0..images).map(point).collect::<Vec<_>>()
        };
        let traces: Vec<_> = (0..neighbours).map(trace).collect();
        drawn.push(Panel {
            name: format!("mean of |e|: {name}"),
            shown: (0.0, most),
            traces: numbered(&traces, 2, |point| *point),
        });
    }
    let title = format!(
        "{}, {}: mean errors of robot 1, {} flights",
        result.case,
        result.method.name(),
        result.samples
    );
    plot::panels(&title, 2, &drawn)
}

/// Figures 7 and 9: the likeliest places, the one that is held and the true one, from above.
fn snapshots(result: &CellResult) -> Result<String, PlotError> {
    let scenes: Vec<Scene> = result
        .snapshots
        .iter()
        .map(|snapshot| Scene {
            name: format!("t = {:.1} s", snapshot.taken_s),
            spots: (2..)
                .zip(&snapshot.neighbours)
                .map(|(number, neighbour)| Spot {
                    label: number.to_string(),
                    truth: (neighbour.truth.x, neighbour.truth.y),
                    estimate: neighbour.estimate.map(|place| (place.x, place.y)),
                    likely: neighbour
                        .likeliest
                        .iter()
                        .map(|place| (place.x, place.y))
                        .collect(),
                })
                .collect(),
        })
        .collect();
    let title = format!(
        "{}, {}: what robot 1 believes",
        result.case,
        result.method.name()
    );
    plot::scenes(&title, &scenes)
}

/// Figure 5: roll and pitch errors are the first row of the figures of errors. Robots are counted from 1.
fn numbered<T>(rows: &[Vec<T>], first: usize, point: impl Fn(&T) -> (f64, f64)) -> Vec<Trace> {
    (first..)
        .zip(rows)
        .map(|(number, row)| Trace {
            label: number.to_string(),
            points: row.iter().map(&point).collect(),
        })
        .collect()
}
