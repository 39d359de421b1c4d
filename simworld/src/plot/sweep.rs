//! A grid of small charts of what comes of a quantity that is varied, both axes logarithmic: what was reached in full lines,
//! what bounds it dashed.

use super::{FONT, LEGEND_LINE, PIXEL, PlotError, colour, drawing, range, titled};
use plotters::prelude::*;
use std::ops::Range;

/// A value against the quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What the legend calls it.
    pub label: String,
    /// Which colour: lines of one number have one colour in all charts.
    pub colour: usize,
    /// It is a bound: dashed.
    pub is_bound: bool,
    /// Quantity and value, both above zero.
    pub points: Vec<(f64, f64)>,
}

/// One small chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// What is varied, with its unit.
    pub quantity: String,
    /// What comes of it, with its unit.
    pub name: String,
    /// What is drawn.
    pub lines: Vec<Line>,
}

/// Height of the legend's rows (pixels), and how many labels stand in one.
const LEGEND_ROW: u32 = 22;
const LEGEND_COLUMNS: usize = 4;

/// Charts in so many columns, row by row, those of a row with one axis of values, and one legend for all below: that of
/// the first. Fails when a number is not above zero or there is nothing to draw.
pub fn sweeps(title: &str, columns: usize, sweeps: &[Sweep]) -> Result<String, PlotError> {
    let Some(named) = sweeps.first().map(|sweep| &sweep.lines) else {
        return Err(PlotError("there is nothing to draw".to_owned()));
    };
    let columns = columns.max(1);
    let rows = sweeps.len().div_ceil(columns);
    let legend_height = LEGEND_ROW * (named.len().div_ceil(LEGEND_COLUMNS) as u32 + 1);
    let drawn_height = 290 * rows as u32;
    let (width, height) = (1200, 40 + drawn_height + legend_height);
    titled(title, (width * PIXEL, height * PIXEL), |below| {
        let (charts, names) = below.split_vertically(drawn_height * PIXEL);
        let areas = charts.split_evenly((rows, columns));
        for (areas, row) in areas.chunks(columns).zip(sweeps.chunks(columns)) {
            let values = powers(row.iter().flat_map(|sweep| &sweep.lines), |point| point.1)?;
            for (area, sweep) in areas.iter().zip(row) {
                let quantities = powers(sweep.lines.iter(), |point| point.0)?;
                chart(area, sweep, quantities, values.clone())?;
            }
        }
        for (index, line) in named.iter().enumerate() {
            let column = (index % LEGEND_COLUMNS) as i32;
            let row = (index / LEGEND_COLUMNS) as i32;
            let left = (20 + column * (width as i32 - 20) / LEGEND_COLUMNS as i32) * PIXEL as i32;
            let middle = (LEGEND_ROW as i32 / 2 + row * LEGEND_ROW as i32) * PIXEL as i32;
            for dash in dashes(left, line.is_bound) {
                let ends = [(dash.start, middle), (dash.end, middle)];
                let style = colour(line.colour).stroke_width(2 * PIXEL);
                names
                    .draw(&PathElement::new(ends, style))
                    .map_err(drawing)?;
            }
            let at = (
                left + LEGEND_LINE + 8 * PIXEL as i32,
                middle - 7 * PIXEL as i32,
            );
            let font = (FONT, 15 * PIXEL).into_font();
            names
                .draw(&Text::new(line.label.as_str(), at, font))
                .map_err(drawing)?;
        }
        Ok(())
    })
}

fn chart(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    sweep: &Sweep,
    quantities: Range<f64>,
    values: Range<f64>,
) -> Result<(), PlotError> {
    let mut chart = ChartBuilder::on(area)
        .margin(10 * PIXEL)
        .set_label_area_size(LabelAreaPosition::Left, 64 * PIXEL)
        .set_label_area_size(LabelAreaPosition::Bottom, 40 * PIXEL)
        .build_cartesian_2d(
            (quantities.start..quantities.end)
                .log_scale()
                .with_key_points(ticks(&sweep.lines)),
            (values.start..values.end).log_scale(),
        )
        .map_err(drawing)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225).stroke_width(PIXEL))
        .axis_style(RGBColor(60, 60, 60).stroke_width(PIXEL))
        .set_all_tick_mark_size(4 * PIXEL)
        .x_desc(&sweep.quantity)
        .y_desc(&sweep.name)
        .x_labels(5)
        .y_labels(6)
        .x_label_formatter(&plain)
        .y_label_formatter(&plain)
        .label_style((FONT, 13 * PIXEL))
        .axis_desc_style((FONT, 14 * PIXEL))
        .draw()
        .map_err(drawing)?;
    for line in &sweep.lines {
        let style = colour(line.colour).stroke_width(PIXEL * 7 / 4);
        let points = line.points.iter().copied();
        if line.is_bound {
            let (dash, gap) = (5 * PIXEL as i32, 4 * PIXEL as i32);
            chart
                .draw_series(DashedLineSeries::new(
                    points,
                    dash as u32,
                    gap as u32,
                    style,
                ))
                .map_err(drawing)?;
        } else {
            chart
                .draw_series(LineSeries::new(points, style))
                .map_err(drawing)?;
            let dots = line.points.iter();
            let dots =
                dots.map(|point| Circle::new(*point, 3 * PIXEL, colour(line.colour).filled()));
            chart.draw_series(dots).map_err(drawing)?;
        }
    }
    Ok(())
}

/// From the least to the greatest, with a margin.
fn powers<'a>(
    lines: impl Iterator<Item = &'a Line>,
    of: fn(&(f64, f64)) -> f64,
) -> Result<Range<f64>, PlotError> {
    let all = range(lines.flat_map(|line| line.points.iter().map(of)))?;
    if all.start <= 0.0 {
        return Err(PlotError(format!("{} has no logarithm", all.start)));
    }
    Ok(all.start / 1.3..all.end * 1.3)
}

/// The quantities at which there is something, once each.
fn ticks(lines: &[Line]) -> Vec<f64> {
    let all = lines.iter().flat_map(|line| &line.points);
    let mut ticks: Vec<f64> = all.map(|point| point.0).collect();
    ticks.sort_by(f64::total_cmp);
    ticks.dedup();
    ticks
}

/// A number without a power of ten, and without digits that say nothing.
fn plain(number: &f64) -> String {
    let places = (1.0 - number.abs().log10().floor()).clamp(0.0, 5.0) as usize;
    let text = format!("{number:.places$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// What a line of the legend is drawn of.
fn dashes(left: i32, is_bound: bool) -> Vec<Range<i32>> {
    let (dash, gap) = (LEGEND_LINE * 5 / 14, LEGEND_LINE * 9 / 14);
    if is_bound {
        let second = left + gap;
        vec![left..left + dash, second..second + dash]
    } else {
        std::iter::once(left..left + LEGEND_LINE).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(values: &[f64], is_bound: bool) -> Sweep {
        Sweep {
            quantity: "noise, m".to_owned(),
            name: "error, m2".to_owned(),
            lines: vec![Line {
                label: "bank".to_owned(),
                colour: 0,
                is_bound,
                points: (1..).map(f64::from).zip(values.iter().copied()).collect(),
            }],
        }
    }

    #[test]
    fn a_bound_is_dashed_and_what_was_reached_is_one_line() {
        let strokes = |is_bound| {
            let svg = sweeps("errors", 1, &[sweep(&[0.1, 1.0, 100.0], is_bound)]).unwrap();
            svg.matches("stroke=\"#0072B2\"").count()
        };
        assert_eq!(strokes(false), 2, "in the chart and in the legend");
        assert!(strokes(true) > 10);
    }

    #[test]
    fn what_has_no_logarithm_is_not_drawn() {
        assert!(sweeps("errors", 1, &[sweep(&[0.1, 0.0], false)]).is_err());
        assert!(sweeps("errors", 1, &[sweep(&[0.1, f64::NAN], false)]).is_err());
        assert!(sweeps("errors", 1, &[sweep(&[], true)]).is_err());
        assert!(sweeps("errors", 1, &[]).is_err());
    }

    #[test]
    fn labels_have_no_digits_that_say_nothing() {
        assert_eq!(
            [0.002, 0.05, 1.0, 200.0].map(|one| plain(&one)),
            ["0.002", "0.05", "1", "200"]
        );
    }
}
