//! Groups of bars with their standard errors.

use super::{
    FONT, HEADING, LEGEND_LINE, PIXEL, PlotError, colour, drawing, largest, legend, positive,
    titled,
};
use plotters::prelude::*;

/// Bars that stand together.
#[derive(Clone, Debug, PartialEq)]
pub struct BarGroup {
    /// What stands below it; its words may stand below each other.
    pub label: String,
    /// The bars, from left to right; bars of one label have one colour in all groups.
    pub bars: Vec<Bar>,
}

/// One bar.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// What the legend calls it.
    pub label: String,
    /// Its height.
    pub height: f64,
    /// The standard error of its height, drawn as a whisker.
    pub stderr: f64,
}

/// Groups of bars with their standard errors and their heights as numbers. What is higher than `top` is cut there. Fails
/// when a number is not finite or there is nothing to draw.
pub fn bars(title: &str, groups: &[BarGroup], top: f64) -> Result<String, PlotError> {
    let all = || groups.iter().flat_map(|group| &group.bars);
    largest(all().flat_map(|bar| [bar.height, bar.stderr]))?;
    let top = positive(top);
    let mut labels: Vec<&str> = Vec::new();
    for bar in all() {
        if !labels.contains(&bar.label.as_str()) {
            labels.push(&bar.label);
        }
    }
    let small = || (FONT, 12 * PIXEL).into_font();
    titled(title, (1100 * PIXEL, 460 * PIXEL), |below| {
        let mut chart = ChartBuilder::on(below)
            .margin(12 * PIXEL)
            .margin_bottom(52 * PIXEL)
            .set_label_area_size(LabelAreaPosition::Left, 44 * PIXEL)
            .build_cartesian_2d(0.0..groups.len() as f64, 0.0..top * 1.15)
            .map_err(drawing)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .disable_x_axis()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(210, 210, 210).stroke_width(PIXEL))
            .axis_style(RGBColor(60, 60, 60).stroke_width(PIXEL))
            .label_style((FONT, 15 * PIXEL))
            .draw()
            .map_err(drawing)?;
        let width = 0.84 / labels.len().max(1) as f64;
        for (index, label) in labels.iter().enumerate() {
            let style = colour(index);
            let places = groups.iter().enumerate().filter_map(|(nth, group)| {
                let bar = group.bars.iter().find(|bar| bar.label == **label)?;
                Some((nth as f64 + 0.08 + width * index as f64, bar))
            });
            let places: Vec<(f64, &Bar)> = places.collect();
            let drawn = places.iter().map(|(left, bar)| {
                let corner = (left + 0.9 * width, bar.height.min(top));
                Rectangle::new([(*left, 0.0), corner], style.filled())
            });
            chart
                .draw_series(drawn)
                .map_err(drawing)?
                .label(*label)
                .legend(move |(x, y)| {
                    PathElement::new(
                        [(x, y), (x + LEGEND_LINE, y)],
                        style.stroke_width(8 * PIXEL),
                    )
                });
            let whisker = |(left, bar): &(f64, &Bar)| {
                let middle = left + 0.45 * width;
                let (low, high) = (bar.height - bar.stderr, bar.height + bar.stderr);
                let ends = [low, high].map(|end| (middle, end.min(top)));
                PathElement::new(ends, BLACK.stroke_width(PIXEL))
            };
            let whiskers = places
                .iter()
                .filter(|(_, bar)| bar.height < top)
                .map(whisker);
            chart.draw_series(whiskers).map_err(drawing)?;
            let upright = small().transform(FontTransform::Rotate270).color(&BLACK);
            let numbers = places.iter().map(|(left, bar)| {
                let above = (bar.height + bar.stderr).min(top) + 0.012 * top;
                // Turned text hangs at its left from the point given.
                Text::new(
                    format!("{:.2}", bar.height),
                    (left + 0.1 * width, above),
                    upright.clone(),
                )
            });
            chart.draw_series(numbers).map_err(drawing)?;
        }
        for (nth, group) in groups.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(nth as f64 + 0.5, 0.0));
            for (line, words) in lines(&group.label).into_iter().enumerate() {
                let centred = small()
                    .color(&BLACK)
                    .pos(plotters::style::text_anchor::Pos::new(
                        plotters::style::text_anchor::HPos::Center,
                        plotters::style::text_anchor::VPos::Top,
                    ));
                let at = (
                    x,
                    y - HEADING as i32 + (6 + 13 * line as i32) * PIXEL as i32,
                );
                below
                    .draw(&Text::new(words, at, centred))
                    .map_err(drawing)?;
            }
        }
        legend(&mut chart, SeriesLabelPosition::UpperRight)?;
        Ok(())
    })
}

/// A label in lines that fit below a group of bars.
fn lines(label: &str) -> Vec<String> {
    const LETTERS_MAX: usize = 12;
    let mut lines: Vec<String> = Vec::new();
    for word in label.split(' ') {
        match lines.last_mut() {
            Some(line) if line.len() + 1 + word.len() <= LETTERS_MAX => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_carry_their_heights_as_numbers_also_where_they_are_cut() {
        let bar = |label: &str, height: f64| Bar {
            label: label.to_owned(),
            height,
            stderr: 0.02,
        };
        let groups = [
            BarGroup {
                label: "clean".into(),
                bars: vec![bar("paper", 0.28), bar("star", 0.22)],
            },
            BarGroup {
                label: "gross outliers, blackout".into(),
                bars: vec![bar("paper", 8.89), bar("star", 1.43)],
            },
        ];
        let svg = bars("Which mode?", &groups, 2.0).unwrap();
        for text in ["0.28", "0.22", "8.89", "1.43", "outliers,", "blackout"] {
            assert_eq!(svg.matches(&format!("\n{text}\n")).count(), 1, "{text}");
        }
        let RGBColor(red, green, blue) = colour(1);
        let fill = format!("fill=\"#{red:02X}{green:02X}{blue:02X}\"");
        assert_eq!(svg.matches(&fill).count(), 2, "a bar in each group");
        assert_eq!(lines("20 % of 3-10 sigma"), ["20 % of 3-10", "sigma"]);
        assert!(bars("nothing", &[], 1.0).is_err());
        let broken = [BarGroup {
            label: "clean".into(),
            bars: vec![bar("paper", f64::NAN)],
        }];
        assert!(bars("broken", &broken, 1.0).is_err());
    }
}
