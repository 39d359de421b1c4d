//! One instant: robots drawn at random in a box, and what each sees of the others.
//!
//! The box is that of the scenario `eight` with its courses, 5.2 m x 10 m x 3.2 m, robots at least a metre apart; for more
//! robots than eight it grows with their number.

use super::cell::Cell;
use crate::streams::{Purpose, Streams};
use nalgebra::{UnitVector3, Vector3};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::{FRAC_PI_2, PI};

/// Half the sides of the box of eight robots (m).
const HALF_BOX_M: [f64; 3] = [2.6, 5.0, 1.6];
/// Robots are farther apart than this (m).
const APART_M: f64 = 1.0;
/// How phantoms are spread about the horizon (rad).
const PHANTOM_ELEVATION_RAD: f64 = 0.45;

/// One sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Where, in the level frame of the one that sees.
    pub direction: UnitVector3<f64>,
    /// The talking robot that it is, if it is one.
    pub who: Option<usize>,
}

/// Where all robots are and what the talking ones see. Robot 0 is the one that registers; the silent ones are the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// Where (m), z up.
    pub positions_m: Vec<Vector3<f64>>,
    /// Heading, counter-clockwise (rad).
    pub yaws_rad: Vec<f64>,
    /// By talking robot, in random order.
    pub seen: Vec<Vec<Seen>>,
}

impl Scan {
    /// The scan of one sample.
    #[must_use]
    pub fn new(cell: &Cell, streams: &Streams) -> Self {
        let all = cell.robots + cell.silent;
        let growth = (all as f64 / 8.0).cbrt().max(1.0);
        let mut placing = streams.vehicle(0, Purpose::Trajectory);
        let mut positions_m: Vec<Vector3<f64>> = Vec::new();
        while positions_m.len() < all {
            let along = HALF_BOX_M.map(|half| placing.random_range(-half * growth..half * growth));
            let drawn = Vector3::from(along);
            if positions_m.iter().all(|one| (one - drawn).norm() > APART_M) {
                positions_m.push(drawn);
            }
        }
        let yaws_rad = (0..all).map(|_| placing.random_range(-PI..PI)).collect();
        let mut scan = Self {
            positions_m,
            yaws_rad,
            seen: Vec::new(),
        };
        let seen = (0..cell.robots)
            .map(|robot| scan.look(robot, cell, streams))
            .collect();
        scan.seen = seen;
        scan
    }

    /// Azimuth and zenith distance at which a robot would see another one without noise (rad).
    #[must_use]
    pub fn angles_rad(&self, viewer: usize, target: usize) -> (f64, f64) {
        let offset = self.positions_m[target] - self.positions_m[viewer];
        let azimuth = offset.y.atan2(offset.x) - self.yaws_rad[viewer];
        (azimuth, offset.x.hypot(offset.y).atan2(offset.z))
    }

    fn look(&self, viewer: usize, cell: &Cell, streams: &Streams) -> Vec<Seen> {
        let noise_rad = cell.noise_deg.to_radians();
        let mut camera = streams.vehicle(viewer, Purpose::Camera);
        let mut misses = streams.vehicle(viewer, Purpose::Miss);
        let mut phantoms = streams.vehicle(viewer, Purpose::Phantom);
        let mut seen = Vec::new();
        for target in (0..self.positions_m.len()).filter(|target| *target != viewer) {
            let (azimuth, zenith) = self.angles_rad(viewer, target);
            let [a, b]: [f64; 2] =
                [StandardNormal, StandardNormal].map(|one| one.sample(&mut camera));
            if !misses.random_bool(cell.misses) {
                seen.push(Seen {
                    direction: direction(azimuth + noise_rad * a, zenith + noise_rad * b),
                    who: Some(target).filter(|target| *target < cell.robots),
                });
            }
        }
        for _ in 0..cell.phantoms {
            let azimuth = phantoms.random_range(-PI..PI);
            let elevation: f64 = StandardNormal.sample(&mut phantoms);
            let zenith = FRAC_PI_2 - PHANTOM_ELEVATION_RAD * elevation;
            seen.push(Seen {
                direction: direction(azimuth, zenith.clamp(0.0, PI)),
                who: None,
            });
        }
        seen.shuffle(&mut camera);
        seen
    }
}

/// The unit vector of azimuth and zenith distance (rad).
#[must_use]
pub fn direction(azimuth_rad: f64, zenith_rad: f64) -> UnitVector3<f64> {
    UnitVector3::new_normalize(Vector3::new(
        zenith_rad.sin() * azimuth_rad.cos(),
        zenith_rad.sin() * azimuth_rad.sin(),
        zenith_rad.cos(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::registration::cell::cells;

    #[test]
    fn everybody_sees_everybody_else_once_and_phantoms_besides() {
        let cell = Cell {
            phantoms: 3,
            silent: 2,
            ..cells()[2]
        };
        let scan = Scan::new(&cell, &Streams::new(1, 0));
        for (viewer, seen) in scan.seen.iter().enumerate() {
            let mut who: Vec<usize> = seen.iter().filter_map(|one| one.who).collect();
            who.sort_unstable();
            let others: Vec<usize> = (0..cell.robots).filter(|one| *one != viewer).collect();
            assert_eq!(who, others);
            assert_eq!(seen.len(), cell.robots - 1 + cell.silent + cell.phantoms);
        }
    }

    #[test]
    fn what_is_seen_is_off_by_the_noise_of_the_cell() {
        let cell = cells()[5];
        let mut squares = Vec::new();
        for sample in 0..50 {
            let scan = Scan::new(&cell, &Streams::new(1, sample));
            for (viewer, seen) in scan.seen.iter().enumerate() {
                for one in seen {
                    let (_, zenith) = scan.angles_rad(viewer, one.who.unwrap());
                    squares.push((one.direction.z.acos() - zenith).powi(2));
                }
            }
        }
        let deviation = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        // 2800 sightings: a standard error of 0.07 deg.
        assert!(
            (deviation.to_degrees() - 5.0).abs() < 0.2,
            "{}",
            deviation.to_degrees()
        );
    }
}
