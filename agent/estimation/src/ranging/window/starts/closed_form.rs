//! The roots of the sextic (in the plane) and of the octic (in space), found on the unit circle where yaws are.
//!
//! The polynomial is never expanded: it is a short product of known vectors, and it is wanted on the circle only. There
//! it is real; where noise has lifted a double root off the circle, the place nearest to it still is a start.

use super::super::geometry::Geometry;
use super::super::{Dimension, RelativePose, WINDOW_MAX};
use crate::ranging::pose::turned;
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// Places on the circle where the polynomial is looked at. Of degree eight it has at most sixteen turns there.
const LOOKS: usize = 64;
/// Steps that each root is refined by.
const REFINEMENTS: usize = 4;
/// Most sets that there are: four of nine.
const COMBINATIONS_MAX: usize = 126;

/// Starts from so many sets of ranges that lie well apart.
pub(super) fn starts(
    geometry: &Geometry,
    dimension: Dimension,
    sets_max: usize,
    start: &mut impl FnMut(&RelativePose),
) {
    let size = match dimension {
        Dimension::Planar => 3,
        Dimension::Spatial => 4,
    };
    let mut sets = [(0, [0; 4]); COMBINATIONS_MAX];
    let count = combinations(geometry.count, size, &mut sets);
    let sets = &mut sets[..count];
    sets.sort_unstable_by(|a, b| b.cmp(a));
    for (_, set) in sets.iter().take(sets_max) {
        Elimination::new(geometry, &set[..size]).starts(start);
    }
}

/// All increasing sets of so many of `0..of`, each with how well its members are spread. Returns how many.
fn combinations(
    of: usize,
    size: usize,
    sets: &mut [(usize, [usize; 4]); COMBINATIONS_MAX],
) -> usize {
    let mut count = 0;
    for bits in 0_usize..1 << of.min(WINDOW_MAX) {
        if bits.count_ones() as usize != size || count == COMBINATIONS_MAX {
            continue;
        }
        let mut set = [0; 4];
        let members = (0..of).filter(|j| bits >> j & 1 == 1);
        for (place, j) in set.iter_mut().zip(members) {
            *place = j;
        }
        let gap = (1..size).map(|i| set[i] - set[i - 1]).min().unwrap_or(0);
        sets[count] = (16 * gap + set[size - 1] - set[0], set);
        count += 1;
    }
    count
}

/// What is left of a set of ranges when the position is eliminated.
struct Elimination {
    /// Against the reference: where the neighbour was and where the vehicle was, `dv` and `du`.
    apart: [(Vector3<f64>, Vector3<f64>); 3],
    /// `(d_j^2 - d^2 - |dv|^2 - |du|^2) / 2`.
    known: [f64; 3],
    spatial: bool,
    range_m: f64,
    /// The reference's places, neighbour's and own.
    reference: (Vector3<f64>, Vector3<f64>),
}

impl Elimination {
    fn new(geometry: &Geometry, set: &[usize]) -> Self {
        let last = set[set.len() - 1];
        let range_m = geometry.range_m[last];
        let reference = (geometry.neighbour[last].place_m, geometry.own[last].place_m);
        let mut elimination = Self {
            apart: [(Vector3::zeros(), Vector3::zeros()); 3],
            known: [0.0; 3],
            spatial: set.len() == 4,
            range_m,
            reference,
        };
        for (i, j) in set[..set.len() - 1].iter().enumerate() {
            let theirs = geometry.neighbour[*j].place_m - reference.0;
            let own = geometry.own[*j].place_m - reference.1;
            elimination.apart[i] = (theirs, own);
            elimination.known[i] = 0.5
                * (geometry.range_m[*j].powi(2)
                    - range_m.powi(2)
                    - theirs.norm_squared()
                    - own.norm_squared());
        }
        elimination
    }

    /// `N` and `D` at a yaw of which sine and cosine are given.
    fn numerator(&self, sin: f64, cos: f64) -> (Vector3<f64>, f64) {
        let mut a = [Vector3::zeros(); 3];
        let mut b = [0.0; 3];
        for i in 0..3 {
            let (theirs, own) = &self.apart[i];
            let there = Vector3::new(
                cos * theirs.x - sin * theirs.y,
                sin * theirs.x + cos * theirs.y,
                theirs.z,
            );
            a[i] = there - own;
            // |R dv - du|^2 = |dv|^2 + |du|^2 - 2 du . R dv
            b[i] = self.known[i] + own.dot(&there);
        }
        if self.spatial {
            let crossed = [a[1].cross(&a[2]), a[2].cross(&a[0]), a[0].cross(&a[1])];
            let numerator = crossed[0] * b[0] + crossed[1] * b[1] + crossed[2] * b[2];
            (numerator, a[0].dot(&crossed[0]))
        } else {
            let numerator = Vector3::new(
                b[0] * a[1].y - b[1] * a[0].y,
                b[1] * a[0].x - b[0] * a[1].x,
                0.0,
            );
            (numerator, a[0].x * a[1].y - a[0].y * a[1].x)
        }
    }

    /// `|N|^2 - d^2 D^2`.
    fn polynomial(&self, yaw_rad: f64) -> f64 {
        let (sin, cos) = yaw_rad.sin_cos();
        let (numerator, denominator) = self.numerator(sin, cos);
        numerator.norm_squared() - (self.range_m * denominator).powi(2)
    }

    fn starts(&self, start: &mut impl FnMut(&RelativePose)) {
        let spacing = TAU / LOOKS as f64;
        let yaw = |i: usize| spacing * i as f64 - PI;
        let mut looks = [0.0; LOOKS];
        for (i, look) in looks.iter_mut().enumerate() {
            *look = self.polynomial(yaw(i));
        }
        for i in 0..LOOKS {
            let (before, here, after) = (
                looks[(i + LOOKS - 1) % LOOKS],
                looks[i],
                looks[(i + 1) % LOOKS],
            );
            if here.is_sign_positive() != after.is_sign_positive() {
                self.start_at(self.root(yaw(i), here, yaw(i) + spacing, after), start);
            } else if before.is_sign_positive() == here.is_sign_positive()
                && here.abs() <= before.abs()
                && here.abs() < after.abs()
            {
                self.start_at(yaw(i), start);
            }
        }
    }

    /// The root between two yaws of different signs, by regula falsi (Illinois).
    fn root(&self, mut low: f64, mut at_low: f64, mut high: f64, mut at_high: f64) -> f64 {
        let mut root = low;
        for _ in 0..REFINEMENTS {
            root = low + (high - low) * at_low / (at_low - at_high);
            let value = self.polynomial(root);
            if value.is_sign_positive() == at_low.is_sign_positive() {
                (low, at_low) = (root, value);
                at_high *= 0.5;
            } else {
                (high, at_high) = (root, value);
                at_low *= 0.5;
            }
        }
        root
    }

    fn start_at(&self, yaw_rad: f64, start: &mut impl FnMut(&RelativePose)) {
        let (sin, cos) = yaw_rad.sin_cos();
        let (numerator, denominator) = self.numerator(sin, cos);
        // |q| = d: only the direction is needed, and it is well defined where D is nearly zero.
        let length = numerator.norm() * denominator.signum();
        if !length.is_finite() || length == 0.0 {
            return;
        }
        let between = numerator * (self.range_m / length);
        let position = between - turned(&self.reference.0, yaw_rad) + self.reference.1;
        start(&RelativePose::new(position, yaw_rad));
    }
}
