//! What scans of an experiment are like.

use serde::Serialize;

/// One kind of scan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// Robots that talk, this one among them.
    pub robots: usize,
    /// Standard deviation of azimuth and of zenith distance (deg).
    pub noise_deg: f64,
    /// Sightings of nothing in every robot's scan.
    pub phantoms: usize,
    /// Probability that a robot does not see another one.
    pub misses: f64,
    /// Robots that are seen and do not talk.
    pub silent: usize,
}

/// Nothing goes wrong.
const fn clean(robots: usize, noise_deg: f64) -> Cell {
    Cell {
        robots,
        noise_deg,
        phantoms: 0,
        misses: 0.0,
        silent: 0,
    }
}

/// All cells, in the order of the table: numbers of robots, noise, phantoms, misses, silent robots.
#[must_use]
pub fn cells() -> Vec<Cell> {
    let mut cells: Vec<Cell> = (3..=8).map(|robots| clean(robots, 5.0)).collect();
    cells.extend([8, 12, 16, 20].map(|robots| clean(robots, 1.0)));
    cells.extend([0.5, 1.0, 2.0, 3.0].map(|noise_deg| clean(6, noise_deg)));
    for robots in [4, 6, 8] {
        let base = clean(robots, 5.0);
        cells.extend([1, 2, 5].map(|phantoms| Cell { phantoms, ..base }));
        cells.extend([0.1, 0.2, 0.3].map(|misses| Cell { misses, ..base }));
        cells.extend([1, 2].map(|silent| Cell { silent, ..base }));
    }
    cells
}

impl Cell {
    /// What it is, in words that stand below each other in a figure.
    #[must_use]
    pub fn name(&self) -> String {
        let mut name = format!("{} robots {} deg", self.robots, self.noise_deg);
        if self.phantoms > 0 {
            name += &format!(" {} phantoms", self.phantoms);
        }
        if self.misses > 0.0 {
            name += &format!(" {:.0} % missed", 100.0 * self.misses);
        }
        if self.silent > 0 {
            name += &format!(" {} silent", self.silent);
        }
        name
    }
}
