//! What one vehicle believes about the places of others, seen from above: clouds of likely places, what is held, and what
//! is true.

use super::{Area, FONT, PIXEL, PlotError, colour, drawing, equal_scale, range, titled};
use plotters::prelude::*;

/// One vehicle in a scene; x ahead and y left of the observer, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Spot {
    /// What stands beside it.
    pub label: String,
    /// Where it truly is: a circle with a cross, pale.
    pub truth: (f64, f64),
    /// Where it is held to be: a circle with a cross.
    pub estimate: Option<(f64, f64)>,
    /// Where it may be: dots.
    pub likely: Vec<(f64, f64)>,
}

/// One instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// What stands above it.
    pub name: String,
    /// Everyone but the observer, which is the triangle at the origin.
    pub spots: Vec<Spot>,
}

/// Farthest from the observer that is shown (m).
const SHOWN_M: f64 = 12.0;

/// Scenes beside each other. Fails when a number is not finite or there is nothing to draw.
pub fn scenes(title: &str, scenes: &[Scene]) -> Result<String, PlotError> {
    let side = 560 * PIXEL;
    let count = scenes.len().max(1);
    let size = (side * count as u32, side + 40 * PIXEL);
    titled(title, size, |below| {
        for (area, scene) in below.split_evenly((1, count)).iter().zip(scenes) {
            draw(area, scene)?;
        }
        Ok(())
    })
}

fn draw(area: &Area<'_>, scene: &Scene) -> Result<(), PlotError> {
    // What is farther is drawn where it would cross the edge.
    let near = |(x, y): (f64, f64)| {
        let share = (SHOWN_M / x.hypot(y)).min(1.0);
        (x * share, y * share)
    };
    let places = || {
        let spots = scene.spots.iter();
        let places = spots.flat_map(|spot| {
            spot.likely
                .iter()
                .copied()
                .chain(spot.estimate)
                .chain([spot.truth])
        });
        places.map(near).chain([(0.0, 0.0)])
    };
    let (x, y) = equal_scale(
        range(places().map(|place| place.0))?,
        range(places().map(|place| place.1))?,
        1.0,
    );
    let mut chart = ChartBuilder::on(area)
        .margin(12 * PIXEL)
        .caption(&scene.name, (FONT, 16 * PIXEL))
        .set_label_area_size(LabelAreaPosition::Left, 48 * PIXEL)
        .set_label_area_size(LabelAreaPosition::Bottom, 40 * PIXEL)
        .build_cartesian_2d(x, y)
        .map_err(drawing)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225).stroke_width(PIXEL))
        .axis_style(RGBColor(60, 60, 60).stroke_width(PIXEL))
        .x_desc("ahead, m")
        .y_desc("left, m")
        .label_style((FONT, 13 * PIXEL))
        .axis_desc_style((FONT, 14 * PIXEL))
        .draw()
        .map_err(drawing)?;
    chart
        .draw_series([TriangleMarker::new((0.0, 0.0), 8 * PIXEL, BLACK.filled())])
        .map_err(drawing)?;
    for (index, spot) in scene.spots.iter().enumerate() {
        let bright = colour(index);
        let pale = bright.mix(0.45);
        let dots = spot
            .likely
            .iter()
            .map(|place| Circle::new(near(*place), PIXEL * 3 / 2, pale.filled()));
        chart.draw_series(dots).map_err(drawing)?;
        let truth = near(spot.truth);
        chart
            .draw_series([Circle::new(truth, 10 * PIXEL, pale.stroke_width(2 * PIXEL))])
            .map_err(drawing)?;
        chart
            .draw_series([Cross::new(truth, 10 * PIXEL, pale.stroke_width(2 * PIXEL))])
            .map_err(drawing)?;
        let held = spot.estimate.map(near);
        chart
            .draw_series(
                held.map(|place| Circle::new(place, 7 * PIXEL, bright.stroke_width(2 * PIXEL))),
            )
            .map_err(drawing)?;
        chart
            .draw_series(
                held.map(|place| Cross::new(place, 7 * PIXEL, bright.stroke_width(2 * PIXEL))),
            )
            .map_err(drawing)?;
        let label = EmptyElement::at(truth)
            + Text::new(
                spot.label.clone(),
                (12 * PIXEL as i32, -(12 * PIXEL as i32)),
                (FONT, 14 * PIXEL).into_font().color(&bright),
            );
        chart.draw_series([label]).map_err(drawing)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_shows_every_likely_place() {
        let spot = |likely: usize| Spot {
            label: "2".to_owned(),
            truth: (2.0, 1.0),
            estimate: Some((2.1, 1.0)),
            likely: vec![(1.0, 0.5); likely],
        };
        let circles = |likely: usize| {
            let scene = Scene {
                name: "t = 1 s".to_owned(),
                spots: vec![spot(likely)],
            };
            scenes("who is where", &[scene])
                .unwrap()
                .matches("<circle")
                .count()
        };
        assert_eq!(circles(100), circles(0) + 100);
    }
}
