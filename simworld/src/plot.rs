//! Plots as SVG text: error curves against time in the form of the paper's figures 3 and 4, paths in the plane, and bars.
//! Writing the text to a file is the caller's.

mod bars;
mod panels;
mod scene;
mod sweep;

pub use bars::{Bar, BarGroup, bars};
pub use panels::{Panel, Trace, panels};
pub use scene::{Scene, Spot, scenes};
pub use sweep::{Line, Sweep, sweeps};

use plotters::prelude::*;
use std::ops::Range;

/// A plot that could not be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot draw the plot: {0}")]
pub struct PlotError(String);

/// The mean of |e| and the standard deviation of one method over time.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorCurve {
    /// What the legend calls it.
    pub label: String,
    /// Time in seconds, mean of |e| in metres, standard deviation in metres.
    pub points: Vec<ErrorPoint>,
}

/// The errors of one method at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorPoint {
    /// Seconds since the start of the motion.
    pub time_s: f64,
    /// The mean of |e|, metres: what the paper calls bias.
    pub mean_norm_m: f64,
    /// The standard deviation, metres.
    pub std_m: f64,
}

/// What a path is, which decides how it is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathKind {
    /// Where the vehicle really was: black.
    Truth,
    /// What an estimator said: in colour.
    Estimate,
    /// Odometry alone: grey.
    DeadReckoning,
}

/// One path in the plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// What the legend calls it.
    pub label: String,
    /// What it is.
    pub kind: PathKind,
    /// East and north, metres.
    pub points_m: Vec<(f64, f64)>,
}

const BACKGROUND: RGBColor = WHITE;
const FONT: &str = "sans-serif";

/// The backend rounds to whole units, which makes smooth curves jagged: so a pixel is this many units.
const PIXEL: u32 = 8;

/// Colours that people with any kind of colour vision can tell apart (Okabe and Ito), the darker ones first.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(110, 80, 40),
];

/// Height of the title.
const HEADING: u32 = 40 * PIXEL;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

/// A drawing of so many units with its title; `draw` fills what is below that.
fn titled(
    title: &str,
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&BACKGROUND).map_err(drawing)?;
        let (heading, below) = root.split_vertically(HEADING);
        heading
            .margin(8 * PIXEL, 0, 0, 0)
            .titled(title, (FONT, 22 * PIXEL))
            .map_err(drawing)?;
        draw(&below)?;
        root.present().map_err(drawing)?;
    }
    Ok(in_pixels(&svg))
}

fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

/// What a panel draws of a point.
type Value = fn(&ErrorPoint) -> f64;

/// Error against time as the paper's figures 3 and 4 have it: the mean of |e| above, the standard deviation below,
/// one line for every method in both. Fails when a number is not finite or there is nothing to draw.
pub fn error_curves(title: &str, curves: &[ErrorCurve]) -> Result<String, PlotError> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let until_s = largest(points().map(|point| point.time_s))?;
    let panels: [(&str, Value); 2] = [
        ("mean of |e| (\"bias\"), m", |point| point.mean_norm_m),
        ("standard deviation, m", |point| point.std_m),
    ];
    titled(title, (860 * PIXEL, 760 * PIXEL), |below| {
        for (area, (name, value)) in below.split_evenly((2, 1)).iter().zip(panels) {
            let highest = largest(points().map(value))?;
            let mut chart = ChartBuilder::on(area)
                .margin(12 * PIXEL)
                .margin_right(24 * PIXEL)
                .set_label_area_size(LabelAreaPosition::Left, 58 * PIXEL)
                .set_label_area_size(LabelAreaPosition::Bottom, 44 * PIXEL)
                .build_cartesian_2d(0.0..positive(until_s), 0.0..positive(highest * 1.08))
                .map_err(drawing)?;
            chart
                .configure_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(RGBColor(210, 210, 210).stroke_width(PIXEL))
                .axis_style(RGBColor(60, 60, 60).stroke_width(PIXEL))
                .set_all_tick_mark_size(5 * PIXEL)
                .x_desc("time, s")
                .y_desc(name)
                .label_style((FONT, 15 * PIXEL))
                .axis_desc_style((FONT, 16 * PIXEL))
                .draw()
                .map_err(drawing)?;
            for (index, curve) in curves.iter().enumerate() {
                let style = colour(index).stroke_width(2 * PIXEL);
                let line = curve
                    .points
                    .iter()
                    .map(|point| (point.time_s, value(point)));
                chart
                    .draw_series(LineSeries::new(line, style))
                    .map_err(drawing)?
                    .label(&curve.label)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + LEGEND_LINE, y)], style));
            }
            legend(&mut chart, SeriesLabelPosition::UpperLeft)?;
        }
        Ok(())
    })
}

/// Paths in the plane, to one scale in both directions. Fails when a number is not finite or there is nothing to draw.
pub fn paths(title: &str, paths: &[Path]) -> Result<String, PlotError> {
    let points = || paths.iter().flat_map(|path| &path.points_m);
    let (width, height) = (860 * PIXEL, 700 * PIXEL);
    let (left, bottom) = (58 * PIXEL, 44 * PIXEL);
    let margin = 12 * PIXEL;
    let drawn_width = width - left - 2 * margin;
    let drawn_height = height - bottom - HEADING - 2 * margin;
    let (x, y) = equal_scale(
        range(points().map(|point| point.0))?,
        range(points().map(|point| point.1))?,
        f64::from(drawn_width) / f64::from(drawn_height),
    );
    titled(title, (width, height), |below| {
        let mut chart = ChartBuilder::on(below)
            .margin(margin)
            .set_label_area_size(LabelAreaPosition::Left, left)
            .set_label_area_size(LabelAreaPosition::Bottom, bottom)
            .build_cartesian_2d(x, y)
            .map_err(drawing)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(210, 210, 210).stroke_width(PIXEL))
            .axis_style(RGBColor(60, 60, 60).stroke_width(PIXEL))
            .set_all_tick_mark_size(5 * PIXEL)
            .x_desc("east, m")
            .y_desc("north, m")
            .label_style((FONT, 15 * PIXEL))
            .axis_desc_style((FONT, 16 * PIXEL))
            .draw()
            .map_err(drawing)?;
        let mut estimates = 0;
        for path in paths {
            let style = match path.kind {
                PathKind::Truth => BLACK.stroke_width(2 * PIXEL),
                PathKind::DeadReckoning => RGBColor(150, 150, 150).stroke_width(2 * PIXEL),
                PathKind::Estimate => {
                    estimates += 1;
                    colour(estimates - 1).stroke_width(2 * PIXEL)
                }
            };
            chart
                .draw_series(LineSeries::new(path.points_m.iter().copied(), style))
                .map_err(drawing)?
                .label(&path.label)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + LEGEND_LINE, y)], style));
            // A dot where it starts.
            chart
                .draw_series(
                    path.points_m
                        .first()
                        .map(|start| Circle::new(*start, 4 * PIXEL, style.filled())),
                )
                .map_err(drawing)?;
        }
        legend(&mut chart, SeriesLabelPosition::UpperRight)?;
        Ok(())
    })
}

/// A value over rounds, of several cells, with the band in which it should be. The axis of values is logarithmic. Fails
/// when a number is not above zero or there is nothing to draw.
pub fn banded(
    title: &str,
    curves: &[(String, Vec<f64>)],
    band: (f64, f64),
) -> Result<String, PlotError> {
    let all = || curves.iter().flat_map(|(_, values)| values.iter().copied());
    let values = range(all().chain([band.0, band.1]))?;
    if values.start <= 0.0 {
        return Err(PlotError(format!("{} has no logarithm", values.start)));
    }
    let rounds = curves.iter().map(|(_, values)| values.len()).max();
    let rounds = positive(rounds.unwrap_or_default() as f64);
    titled(title, (1100 * PIXEL, 460 * PIXEL), |below| {
        // The axis is one of logarithms, to base ten; its labels are powers.
        let axis = values.start.log10() - 0.1..values.end.log10() + 0.3;
        let mut chart = ChartBuilder::on(below)
            .margin(12 * PIXEL)
            .margin_right(24 * PIXEL)
            .set_label_area_size(LabelAreaPosition::Left, 58 * PIXEL)
            .set_label_area_size(LabelAreaPosition::Bottom, 44 * PIXEL)
            .build_cartesian_2d(0.0..rounds, axis)
            .map_err(drawing)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(210, 210, 210).stroke_width(PIXEL))
            .axis_style(RGBColor(60, 60, 60).stroke_width(PIXEL))
            .set_all_tick_mark_size(5 * PIXEL)
            .x_desc("round")
            .y_label_formatter(&|power| format!("{:.2}", 10_f64.powf(*power)))
            .label_style((FONT, 15 * PIXEL))
            .axis_desc_style((FONT, 16 * PIXEL))
            .draw()
            .map_err(drawing)?;
        let corners = [(0.0, band.0.log10()), (rounds, band.1.log10())];
        let grey = RGBColor(225, 225, 225).filled();
        chart
            .draw_series([Rectangle::new(corners, grey)])
            .map_err(drawing)?;
        for (index, (label, values)) in curves.iter().enumerate() {
            let style = colour(index).stroke_width(2 * PIXEL);
            let line = (1..).zip(values);
            let line = line.map(|(k, value)| (f64::from(k), value.log10()));
            chart
                .draw_series(LineSeries::new(line, style))
                .map_err(drawing)?
                .label(label)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + LEGEND_LINE, y)], style));
        }
        legend(&mut chart, SeriesLabelPosition::UpperRight)?;
        Ok(())
    })
}

/// Drawings of this module below each other, as one.
#[must_use]
pub fn stacked(drawings: &[String]) -> String {
    let side = |drawing: &str, name: &str| -> u32 {
        let number = drawing.split_once(&format!(" {name}=\""));
        let number = number.and_then(|(_, rest)| rest.split('"').next());
        number.and_then(|number| number.parse().ok()).unwrap_or(0)
    };
    let (mut width, mut height, mut inner) = (0, 0, String::new());
    for drawing in drawings {
        inner += &drawing.replacen("<svg ", &format!("<svg y=\"{height}\" "), 1);
        width = width.max(side(drawing, "width"));
        height += side(drawing, "height");
    }
    format!(
        "<svg width=\"{width}\" height=\"{height}\" xmlns=\"http://www.w3.org/2000/svg\">\n{inner}</svg>\n"
    )
}

/// The same drawing, its size given in pixels; its coordinates keep their finer unit.
fn in_pixels(svg: &str) -> String {
    let (head, drawing) = svg.split_once('>').expect("a drawing has an opening tag");
    let side = |name: &str| -> u32 {
        let (_, rest) = head
            .split_once(&format!(" {name}=\""))
            .expect("the size is given");
        let digits = rest
            .split('"')
            .next()
            .expect("splitting gives at least one part");
        digits.parse().expect("the size is a number")
    };
    let (width, height) = (side("width"), side("height"));
    format!(
        "<svg width=\"{}\" height=\"{}\" viewBox=\"0 0 {width} {height}\" xmlns=\"http://www.w3.org/2000/svg\">{drawing}",
        width / PIXEL,
        height / PIXEL,
    )
}

/// The length of a line in the legend.
const LEGEND_LINE: i32 = 24 * PIXEL as i32;

type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn legend<'b: 'a, 'a>(
    chart: &mut Chart<'a, 'b>,
    position: SeriesLabelPosition,
) -> Result<(), PlotError> {
    chart
        .configure_series_labels()
        .position(position)
        .margin(10 * PIXEL)
        .legend_area_size(32 * PIXEL)
        .border_style(RGBColor(200, 200, 200).stroke_width(PIXEL))
        .background_style(BACKGROUND.mix(0.85))
        .label_font((FONT, 15 * PIXEL))
        .draw()
        .map_err(drawing)
}

fn drawing(error: impl std::fmt::Display) -> PlotError {
    PlotError(error.to_string())
}

fn range(values: impl Iterator<Item = f64>) -> Result<Range<f64>, PlotError> {
    let mut range = f64::INFINITY..f64::NEG_INFINITY;
    for value in values {
        if !value.is_finite() {
            return Err(PlotError(format!("{value} cannot be drawn")));
        }
        range = range.start.min(value)..range.end.max(value);
    }
    if range.start.is_finite() {
        Ok(range)
    } else {
        Err(PlotError("there is nothing to draw".to_owned()))
    }
}

fn largest(values: impl Iterator<Item = f64>) -> Result<f64, PlotError> {
    range(values).map(|range| range.end)
}

/// An axis needs some length, even when everything is zero.
fn positive(length: f64) -> f64 {
    if length > 0.0 { length } else { 1.0 }
}

/// Both ranges with a margin, the shorter one widened until a metre is as long on both axes.
fn equal_scale(x: Range<f64>, y: Range<f64>, width_per_height: f64) -> (Range<f64>, Range<f64>) {
    let length = |range: &Range<f64>| 1.1 * (range.end - range.start);
    let height = positive(length(&y).max(length(&x) / width_per_height));
    let widened = |range: Range<f64>, length: f64| {
        let middle = f64::midpoint(range.start, range.end);
        middle - length / 2.0..middle + length / 2.0
    };
    (widened(x, height * width_per_height), widened(y, height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use crate::sensor::Odometry;
    use crate::truth::Pose;

    fn curve(label: &str, growth: f64) -> ErrorCurve {
        let point = |k: i32| {
            let time_s = 0.2 * f64::from(k);
            ErrorPoint {
                time_s,
                mean_norm_m: growth * time_s.powf(1.5),
                std_m: 1.2 * growth * time_s.powf(1.5),
            }
        };
        ErrorCurve {
            label: label.to_owned(),
            points: (0..=100).map(point).collect(),
        }
    }

    /// Keeps the drawing for a look at it when the variable names a folder.
    fn keep(name: &str, svg: &str) {
        if let Some(folder) = std::env::var_os("SKEIN_PLOTS") {
            std::fs::write(std::path::Path::new(&folder).join(name), svg).unwrap();
        }
    }

    #[test]
    fn a_banded_curve_has_its_band_and_what_has_no_logarithm_is_refused() {
        let curve = |values: &[f64]| [("NEES".to_owned(), values.to_vec())];
        let svg = banded("t", &curve(&[0.5, 1.0, 2.0]), (0.8, 1.2)).unwrap();
        assert!(svg.contains("#E1E1E1"), "the band is grey");
        assert!(banded("t", &curve(&[0.5, 0.0]), (0.8, 1.2)).is_err());
        assert!(banded("t", &curve(&[f64::NAN]), (0.8, 1.2)).is_err());
    }

    #[test]
    fn stacked_drawings_are_as_high_as_all_of_them() {
        let one = |width, height| format!("<svg width=\"{width}\" height=\"{height}\"></svg>");
        let svg = stacked(&[one(40, 10), one(30, 20)]);
        assert!(svg.starts_with("<svg width=\"40\" height=\"30\""), "{svg}");
        assert!(svg.contains("<svg y=\"10\" width=\"30\""), "{svg}");
    }

    #[test]
    fn error_curves_have_two_panels_and_a_line_for_every_method_in_each() {
        let curves = [
            curve("dead reckoning", 0.035),
            curve("2 robots", 0.016),
            curve("5 robots", 0.003),
        ];
        let svg = error_curves("Section V, robot 1: error against time", &curves).unwrap();
        keep("error-curves.svg", &svg);
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert!(svg.contains("standard deviation, m") && svg.contains("mean of |e|"));
        for (index, curve) in curves.iter().enumerate() {
            let RGBColor(red, green, blue) = colour(index);
            let stroke = format!("stroke=\"#{red:02X}{green:02X}{blue:02X}\"");
            // A line and its legend in each of two panels.
            assert_eq!(svg.matches(&stroke).count(), 4, "{}", curve.label);
            assert_eq!(svg.matches(curve.label.as_str()).count(), 2);
        }
    }

    #[test]
    fn paths_show_truth_estimate_and_dead_reckoning() {
        let scenario = Scenario::built_in("section-v").unwrap();
        let path = &scenario.team.vehicles()[0].trajectory;
        let mut odometry = Odometry::new(scenario.odometry, 0.2, 0, &scenario.streams(0));
        let truth: Vec<Pose> = (0..=100)
            .map(|k| path.pose_at(0.2 * f64::from(k)))
            .collect();
        let mut reckoned = vec![truth[0]];
        for k in 0..100 {
            let from_s = 0.2 * f64::from(k);
            reckoned.push(reckoned[k as usize] * odometry.between(path, from_s, from_s + 0.2));
        }
        let plane = |poses: &[Pose]| {
            poses
                .iter()
                .map(|pose| (pose.translation.x, pose.translation.y))
                .collect()
        };
        let drawn = [
            Path {
                label: "truth".into(),
                kind: PathKind::Truth,
                points_m: plane(&truth),
            },
            Path {
                label: "dead reckoning".into(),
                kind: PathKind::DeadReckoning,
                points_m: plane(&reckoned),
            },
            Path {
                label: "a first estimate".into(),
                kind: PathKind::Estimate,
                points_m: vec![(0.0, -3.0), (20.0, -3.0)],
            },
        ];
        let svg = paths("Section V, robot 1: paths", &drawn).unwrap();
        keep("paths.svg", &svg);
        for path in &drawn {
            assert_eq!(
                svg.matches(path.label.as_str()).count(),
                1,
                "{}",
                path.label
            );
        }
        assert!(svg.starts_with("<svg width=\"860\" height=\"700\" viewBox=\"0 0 6880 5600\""));
        assert!(svg.contains("east, m") && svg.contains("north, m"));
    }

    #[test]
    fn a_metre_is_as_long_to_the_north_as_to_the_east() {
        for (x, y) in [
            (0.0..10.0, 0.0..1.0),
            (0.0..1.0, 0.0..10.0),
            (2.0..2.0, 3.0..3.0),
        ] {
            let (wide_x, wide_y) = equal_scale(x.clone(), y.clone(), 1.5);
            assert!(
                ((wide_x.end - wide_x.start) / (wide_y.end - wide_y.start) - 1.5).abs() < 1e-12
            );
            assert!(
                wide_x.start <= x.start
                    && wide_x.end >= x.end
                    && wide_y.start <= y.start
                    && wide_y.end >= y.end
            );
        }
    }

    #[test]
    fn what_cannot_be_drawn_is_refused() {
        assert!(error_curves("nothing", &[]).is_err());
        let nowhere = Path {
            label: "x".into(),
            kind: PathKind::Truth,
            points_m: vec![(f64::NAN, 0.0)],
        };
        assert!(paths("nowhere", &[nowhere]).is_err());
    }

    #[test]
    fn errors_that_are_all_zero_can_be_drawn() {
        assert!(error_curves("zero", &[curve("exact", 0.0)]).is_ok());
    }
}
