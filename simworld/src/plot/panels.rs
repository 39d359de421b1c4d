//! A grid of small charts over time, each with a few traces: how the figures of errors of Cognetti et al. look.

use super::{FONT, LEGEND_LINE, PIXEL, PlotError, colour, drawing, largest, legend, titled};
use plotters::prelude::*;

/// A value over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// What the legend calls it; traces of one place in their panel have one colour.
    pub label: String,
    /// Seconds and value. A value that is not finite leaves a gap.
    pub points: Vec<(f64, f64)>,
}

/// One small chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// What it shows, with its unit.
    pub name: String,
    /// Lowest and highest value shown; what is beyond is drawn there.
    pub shown: (f64, f64),
    /// What is drawn.
    pub traces: Vec<Trace>,
}

/// The axis of time is this much longer than the traces, so that the legend covers none.
const LEGEND_ROOM: f64 = 1.14;

/// Panels in so many columns, row by row. Fails when there is nothing to draw.
pub fn panels(title: &str, columns: usize, panels: &[Panel]) -> Result<String, PlotError> {
    let columns = columns.max(1);
    let rows = panels.len().div_ceil(columns).max(1);
    let points = || {
        panels
            .iter()
            .flat_map(|panel| &panel.traces)
            .flat_map(|trace| &trace.points)
    };
    let until_s = largest(points().map(|point| point.0))?;
    let (width, height) = (1200 * PIXEL, (250 * rows as u32 + 40) * PIXEL);
    titled(title, (width, height), |below| {
        for (area, panel) in below.split_evenly((rows, columns)).iter().zip(panels) {
            let (low, high) = panel.shown;
            let mut chart = ChartBuilder::on(area)
                .margin(10 * PIXEL)
                .set_label_area_size(LabelAreaPosition::Left, 52 * PIXEL)
                .set_label_area_size(LabelAreaPosition::Bottom, 36 * PIXEL)
                .build_cartesian_2d(0.0..LEGEND_ROOM * until_s.max(1.0), low..high)
                .map_err(drawing)?;
            chart
                .configure_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(RGBColor(225, 225, 225).stroke_width(PIXEL))
                .axis_style(RGBColor(60, 60, 60).stroke_width(PIXEL))
                .set_all_tick_mark_size(4 * PIXEL)
                .x_desc("time, s")
                .y_desc(&panel.name)
                .x_labels(7)
                .y_labels(6)
                .label_style((FONT, 12 * PIXEL))
                .axis_desc_style((FONT, 13 * PIXEL))
                .draw()
                .map_err(drawing)?;
            for (index, trace) in panel.traces.iter().enumerate() {
                let style = colour(index).stroke_width(PIXEL * 5 / 4);
                let unbroken = trace.points.split(|point| !point.1.is_finite());
                for line in unbroken.filter(|line| !line.is_empty()) {
                    let line = line
                        .iter()
                        .map(|(t_s, value)| (*t_s, value.clamp(low, high)));
                    chart
                        .draw_series(LineSeries::new(line, style))
                        .map_err(drawing)?;
                }
                let named = std::iter::empty::<(f64, f64)>();
                chart
                    .draw_series(LineSeries::new(named, style))
                    .map_err(drawing)?
                    .label(&trace.label)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + LEGEND_LINE, y)], style));
            }
            legend(&mut chart, SeriesLabelPosition::UpperRight)?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(points: &[(f64, f64)]) -> Panel {
        Panel {
            name: "yaw, deg".to_owned(),
            shown: (-10.0, 10.0),
            traces: vec![Trace {
                label: "2".to_owned(),
                points: points.to_vec(),
            }],
        }
    }

    #[test]
    fn what_is_unknown_leaves_a_gap() {
        let lines = |points: &[(f64, f64)]| {
            let svg = panels("errors", 1, &[panel(points)]).unwrap();
            svg.matches("stroke=\"#0072B2\"").count()
        };
        let whole = [(0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 50.0)];
        let broken = [(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0), (3.0, 50.0)];
        assert_eq!(lines(&broken), lines(&whole) + 1);
        assert!(panels("errors", 1, &[]).is_err());
    }
}
