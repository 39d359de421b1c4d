//! Mutual pairs: two sightings of two vehicles that may be each other. One pair has the relative yaw in closed form,
//! `yaw_j - yaw_i = azimuth_i - azimuth_j + pi`, and one test, `zenith_i + zenith_j = pi` (after Cognetti et al., III-A).

use super::Cut;
use super::scene::Scene;
use crate::mutual::direction::wrapped;
use std::f64::consts::PI;

/// Most matches that are kept of one pair of vehicles: those whose zenith distances agree best.
const MATCHES_MAX: usize = 256;
/// Zenith distances may disagree by 3.3 standard deviations: one true pair in a thousand is lost.
const ZENITH_CHI2_MAX: f64 = 10.8;
/// Matches nearer to the vertical than this tell no yaw (variance of the yaw, rad^2).
const YAW_VARIANCE_MAX: f64 = 0.6;

/// Sighting `mine` of the first vehicle and `theirs` of the second may be each other.
#[derive(Clone, Copy)]
pub(super) struct Match {
    pub(super) mine: u8,
    pub(super) theirs: u8,
    /// Yaw of the second vehicle relative to the first (rad).
    pub(super) yaw_rad: f64,
    /// Its variance (rad^2).
    pub(super) yaw_variance: f64,
    /// Square of the disagreement of the zenith distances over its variance.
    pub(super) zenith_chi2: f64,
}

/// The matches of every ordered pair of vehicles, sorted by yaw.
pub(super) struct Pairs {
    vehicles: usize,
    matches: Vec<Vec<Match>>,
}

impl Pairs {
    pub(super) fn new(scene: &Scene, cut: &mut Cut) -> Self {
        let vehicles = scene.vehicles();
        let mut matches = vec![Vec::new(); vehicles * vehicles];
        for first in 0..vehicles {
            for second in first + 1..vehicles {
                let found = between(scene, first, second, cut);
                let mut mirrored: Vec<Match> = found.iter().map(mirrored).collect();
                mirrored.sort_by(|a, b| a.yaw_rad.total_cmp(&b.yaw_rad));
                matches[first * vehicles + second] = found;
                matches[second * vehicles + first] = mirrored;
            }
        }
        Self { vehicles, matches }
    }

    /// No pairs, for where nobody is left to be placed.
    pub(super) fn none() -> Self {
        Self {
            vehicles: 0,
            matches: Vec::new(),
        }
    }

    pub(super) fn of(&self, first: usize, second: usize) -> &[Match] {
        self.matches
            .get(first * self.vehicles + second)
            .map_or(&[], Vec::as_slice)
    }

    /// The matches of a pair whose yaw is within `width` (rad, below pi) of `yaw_rad` (wrapped).
    pub(super) fn near(
        &self,
        first: usize,
        second: usize,
        yaw_rad: f64,
        width: f64,
    ) -> impl Iterator<Item = &Match> {
        let all = self.of(first, second);
        let range = |from: f64, to: f64| {
            let start = all.partition_point(|one| one.yaw_rad < from);
            let end = all.partition_point(|one| one.yaw_rad <= to);
            all[start..end.max(start)].iter()
        };
        let (low, high) = (yaw_rad - width, yaw_rad + width);
        let around = if low < -PI {
            range(low + 2.0 * PI, f64::MAX)
        } else if high > PI {
            range(f64::MIN, high - 2.0 * PI)
        } else {
            [].iter()
        };
        range(low, high).chain(around)
    }
}

fn mirrored(one: &Match) -> Match {
    Match {
        mine: one.theirs,
        theirs: one.mine,
        yaw_rad: wrapped(-one.yaw_rad),
        ..*one
    }
}

fn between(scene: &Scene, first: usize, second: usize, cut: &mut Cut) -> Vec<Match> {
    let mut found = Vec::new();
    for (mine, a) in scene.rays[first].iter().enumerate() {
        for (theirs, b) in scene.rays[second].iter().enumerate() {
            let zenith_chi2 =
                (a.zenith_rad + b.zenith_rad - PI).powi(2) / (a.variance + b.variance);
            let yaw_variance = a.azimuth_variance + b.azimuth_variance;
            if zenith_chi2 < ZENITH_CHI2_MAX && yaw_variance < YAW_VARIANCE_MAX {
                found.push(Match {
                    mine: mine as u8,
                    theirs: theirs as u8,
                    yaw_rad: wrapped(a.azimuth_rad - b.azimuth_rad + PI),
                    yaw_variance,
                    zenith_chi2,
                });
            }
        }
    }
    if found.len() > MATCHES_MAX {
        cut.matches += found.len() - MATCHES_MAX;
        found.sort_by(|a, b| a.zenith_chi2.total_cmp(&b.zenith_chi2));
        found.truncate(MATCHES_MAX);
    }
    found.sort_by(|a, b| a.yaw_rad.total_cmp(&b.yaw_rad));
    found
}
