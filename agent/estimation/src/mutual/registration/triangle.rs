//! Triangles: three vehicles that see each other (Cognetti et al., III-A). Six sightings leave five tests: three sums of
//! zenith distances, the sum of the azimuth angles (signed, of one chirality), and the closure of the heights.

use super::Cut;
use super::formation::{Formation, Stance};
use super::pairs::{Match, Pairs};
use super::scene::{CLUTTER_PER_SR, Scene, angle2};
use crate::mutual::direction::wrapped;
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::PI;

/// A true triangle in a thousand is lost: chi-square of five degrees of freedom.
pub(super) const CHI2_MAX: f64 = 20.5;
/// Most triangles of one triple of vehicles: those that close best.
const TRIANGLES_MAX: usize = 4096;
/// Two sightings count as vertical up to this sum of the squares of their tilts over their variance.
const UPRIGHT_CHI2_MAX: f64 = 9.0;
/// Sines of inner angles below this count as this: flatter triangles tell no ratio of sides.
const SINE_MIN: f64 = 0.03;
/// The azimuths' closure may miss by this many standard deviations.
const CLOSURE_SIGMAS: f64 = 3.3;

/// Three vehicles and which sighting of each is which other.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    /// Who.
    pub(super) vehicles: [usize; 3],
    /// By corner: the sightings of the next and of the next but one corner.
    pub(super) sightings: [[u8; 2]; 3],
    /// Of the five tests.
    pub(super) chi2: f64,
    /// Where the corners are, in the level frame of the first; the side from the first to the second has length one.
    pub(super) stances: [Stance; 3],
}

/// All triangles of three vehicles, those that close best first.
pub(super) fn of_triple(
    scene: &Scene,
    pairs: &Pairs,
    vehicles: [usize; 3],
    cut: &mut Cut,
) -> Vec<Triangle> {
    let [r, s, t] = vehicles;
    let mut found = Vec::new();
    for rs in pairs.of(r, s) {
        for rt in pairs.of(r, t) {
            let so_far = rs.zenith_chi2 + rt.zenith_chi2;
            if rs.mine == rt.mine || so_far > CHI2_MAX {
                continue;
            }
            let yaw_rad = wrapped(rt.yaw_rad - rs.yaw_rad);
            // The yaw variances of the sides differ; the widest that a match may have bounds the window.
            let known = rs.yaw_variance + rt.yaw_variance;
            let width = (CLOSURE_SIGMAS * (known * 1.5 + scene.variance).sqrt()).min(1.5);
            for st in pairs.near(s, t, yaw_rad, width) {
                if st.mine == rs.theirs || st.theirs == rt.theirs {
                    continue;
                }
                if let Some(triangle) = closed(scene, vehicles, [rs, rt, st]) {
                    found.push(triangle);
                }
            }
        }
    }
    for turned in [[r, s, t], [s, t, r], [t, r, s]] {
        upright(scene, pairs, turned, &mut found);
    }
    found.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    cut.triangles += found.len().saturating_sub(TRIANGLES_MAX);
    found.truncate(TRIANGLES_MAX);
    found
}

/// The triangle of three matches, if it closes.
fn closed(scene: &Scene, vehicles: [usize; 3], [rs, rt, st]: [&Match; 3]) -> Option<Triangle> {
    let [r, s, t] = vehicles;
    let variance = rs.yaw_variance + rt.yaw_variance + st.yaw_variance;
    // The sum of the signed inner angles less pi; the same number as the disagreement of the three relative yaws.
    let open = wrapped(rt.yaw_rad - rs.yaw_rad - st.yaw_rad);
    let chi2 = rs.zenith_chi2 + rt.zenith_chi2 + st.zenith_chi2 + open * open / variance;
    if chi2 > CHI2_MAX {
        return None;
    }
    let (r_s, r_t) = (
        &scene.rays[r][rs.mine as usize],
        &scene.rays[r][rt.mine as usize],
    );
    let (s_t, s_r) = (
        &scene.rays[s][st.mine as usize],
        &scene.rays[s][rs.theirs as usize],
    );
    let (t_r, t_s) = (
        &scene.rays[t][rt.theirs as usize],
        &scene.rays[t][st.theirs as usize],
    );
    let corner = |from: &super::scene::Ray, to: &super::scene::Ray| {
        let share = (from.azimuth_variance + to.azimuth_variance) / variance;
        let angle = wrapped(to.azimuth_rad - from.azimuth_rad);
        (
            angle - open * share,
            from.azimuth_variance + to.azimuth_variance,
        )
    };
    let angles = [corner(r_s, r_t), corner(s_t, s_r), corner(t_r, t_s)];
    // One chirality: all inner angles turn the same way, but for noise.
    let turn = (angles.iter().map(|(angle, _)| angle.sin()).sum::<f64>()).signum();
    let mut sines = [0.0; 3];
    let mut cosines = [0.0; 3];
    for (corner, (angle, variance)) in angles.iter().enumerate() {
        let sine = angle.sin() * turn;
        if sine < -2.0 * variance.sqrt().min(0.5) {
            return None;
        }
        sines[corner] = sine.max(SINE_MIN);
        cosines[corner] = angle.cos();
    }
    // Planar sides by the sine rule (r to s lies opposite of t, and so on), each with the slope of its two sightings.
    let slope = |away: &super::scene::Ray, back: &super::scene::Ray| {
        let variance = (away.azimuth_variance / (away.sin_zenith * away.sin_zenith)
            + back.azimuth_variance / (back.sin_zenith * back.sin_zenith))
            / 4.0;
        ((away.cot_zenith - back.cot_zenith) / 2.0, variance)
    };
    let slopes = [slope(r_s, s_r), slope(s_t, t_s), slope(t_r, r_t)];
    let opposite = [2, 0, 1];
    let (mut climb, mut climb_variance) = (0.0, 1e-12);
    for (side, (slope, slope_variance)) in slopes.iter().enumerate() {
        let corner = opposite[side];
        climb += sines[corner] * slope;
        climb_variance += sines[corner].powi(2) * slope_variance
            + (cosines[corner] * slope).powi(2) * angles[corner].1;
    }
    let chi2 = chi2 + climb * climb / climb_variance;
    if chi2 > CHI2_MAX {
        return None;
    }
    let along = |away: &super::scene::Ray, slope: f64| {
        let level = away.unit.xy().normalize();
        Vector3::new(level.x, level.y, slope)
    };
    let second = along(r_s, slopes[0].0);
    let third = along(r_t, -slopes[2].0) * (sines[1] / sines[2]);
    let unit = 1.0 / second.norm();
    let shared = open / variance;
    Some(Triangle {
        vehicles,
        sightings: [
            [rs.mine, rt.mine],
            [st.mine, rs.theirs],
            [rt.theirs, st.theirs],
        ],
        chi2,
        stances: [
            Stance::origin(),
            Stance {
                position: second * unit,
                yaw_rad: wrapped(rs.yaw_rad + shared * rs.yaw_variance),
            },
            Stance {
                position: third * unit,
                yaw_rad: wrapped(rt.yaw_rad - shared * rt.yaw_variance),
            },
        ],
    })
}

/// The triangles whose first two corners are one above the other: the sighting of one by the other has no azimuth, so the
/// difference angles are those of the zenith distances (Cognetti et al., end of III-A). The third corner sees both in one
/// vertical plane, which is the test that remains beside the three sums of zenith distances.
fn upright(scene: &Scene, pairs: &Pairs, vehicles: [usize; 3], found: &mut Vec<Triangle>) {
    let [low, high, side] = vehicles;
    for (a, up) in scene.rays[low].iter().enumerate() {
        for (b, down) in scene.rays[high].iter().enumerate() {
            let variance = up.variance + down.variance;
            let tilt2 = up.sin_zenith.powi(2) + down.sin_zenith.powi(2);
            let opposite = up.unit.z * down.unit.z < 0.0;
            if !opposite || tilt2 > UPRIGHT_CHI2_MAX * variance {
                continue;
            }
            // Which of the two is above the other.
            let above = up.unit.z.signum();
            for near in pairs.of(low, side) {
                for far in pairs.of(high, side) {
                    if near.mine as usize == a
                        || far.mine as usize == b
                        || near.theirs == far.theirs
                    {
                        continue;
                    }
                    let (to_low, to_high) = (
                        &scene.rays[side][near.theirs as usize],
                        &scene.rays[side][far.theirs as usize],
                    );
                    let apart = wrapped(to_low.azimuth_rad - to_high.azimuth_rad);
                    let apart_variance = to_low.azimuth_variance + to_high.azimuth_variance;
                    let chi2 = near.zenith_chi2
                        + far.zenith_chi2
                        + tilt2 / variance
                        + apart * apart / apart_variance;
                    // Inner angles in the vertical plane: at the side corner, and at the high one.
                    let at_side = (to_low.zenith_rad - to_high.zenith_rad) * above;
                    let at_high = scene.rays[high][far.mine as usize].zenith_rad;
                    if chi2 > CHI2_MAX || at_side <= 0.0 {
                        continue;
                    }
                    let away = scene.rays[low][near.mine as usize].unit;
                    let distance = at_high.sin() / at_side.sin().max(SINE_MIN);
                    found.push(Triangle {
                        vehicles,
                        sightings: [
                            [a as u8, near.mine],
                            [far.mine, b as u8],
                            [near.theirs, far.theirs],
                        ],
                        chi2,
                        stances: [
                            Stance::origin(),
                            Stance {
                                position: Vector3::new(0.0, 0.0, above),
                                yaw_rad: wrapped(near.yaw_rad - far.yaw_rad),
                            },
                            Stance {
                                position: away * distance,
                                yaw_rad: near.yaw_rad,
                            },
                        ],
                    });
                }
            }
        }
    }
}

/// How often rays of two and of all three corners meet.
#[derive(Clone, Copy, Default)]
pub(super) struct Intersections {
    pub(super) two: usize,
    pub(super) three: usize,
    /// How much likelier all that is than by chance (nats).
    pub(super) nats: f64,
}

/// Rays count as meeting within three standard deviations, widened as corners are not exactly where they are thought.
const MEETING_CHI2_MAX: f64 = 9.0;
const WIDENED: f64 = 2.0;

/// Two rays that meet.
pub(super) struct Meeting {
    /// The length along the first ray.
    pub(super) first: f64,
    /// The length along the second.
    pub(super) second: f64,
    /// Square of how far they miss over its variance.
    pub(super) chi2: f64,
}

/// Where a ray from each of two points comes nearest to the other, if they meet ahead.
pub(super) fn meeting(
    offset: &Vector3<f64>,
    first: &Vector3<f64>,
    second: &Vector3<f64>,
    first_variance: f64,
    second_variance: f64,
) -> Option<Meeting> {
    let together = first.dot(second);
    let spread = 1.0 - together * together;
    let (along_first, along_second) = (first.dot(offset), second.dot(offset));
    let t = along_first - together * along_second;
    let u = together * along_first - along_second;
    if spread < 2e-3 || t <= 0.0 || u <= 0.0 {
        return None;
    }
    let (t, u) = (t / spread, u / spread);
    let gap = first * t - second * u - offset;
    let variance = WIDENED * (first_variance * t * t + second_variance * u * u);
    let chi2 = gap.norm_squared() / variance;
    (chi2 < MEETING_CHI2_MAX).then_some(Meeting {
        first: t,
        second: u,
        chi2,
    })
}

impl Triangle {
    /// The sightings of a corner, turned into the triangle's frame.
    fn turned(&self, scene: &Scene, corner: usize) -> Vec<Vector3<f64>> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), self.stances[corner].yaw_rad);
        let rays = scene.rays[self.vehicles[corner]].iter();
        rays.map(|ray| turn * ray.unit).collect()
    }

    fn used(&self, corner: usize, ray: usize) -> bool {
        self.sightings[corner].contains(&(ray as u8))
    }

    /// Counts the 2- and 3-intersections of the sightings that are no side.
    ///
    /// A 3-intersection counts for one of the rays of the first corner at most, and rays that meet twice count once.
    pub(super) fn intersections(&self, scene: &Scene) -> Intersections {
        let turned = [0, 1, 2].map(|corner| self.turned(scene, corner));
        let rays = self.vehicles.map(|vehicle| &scene.rays[vehicle]);
        let mut count = Intersections::default();
        let offset = self.stances[1].position;
        // What chance would do: two rays lie in one plane to within about a radian, a third points anywhere.
        let two_nats = -0.5 * (2.0 * PI * 2.0 * WIDENED * scene.variance).ln();
        for (a, first) in turned[0].iter().enumerate() {
            if self.used(0, a) {
                continue;
            }
            let (mut meets_second, mut meets_both, mut best) = (false, false, 0.0_f64);
            for (b, second) in turned[1].iter().enumerate() {
                let variances = (rays[0][a].variance, rays[1][b].variance);
                let met = if self.used(1, b) {
                    None
                } else {
                    meeting(&offset, first, second, variances.0, variances.1)
                };
                let Some(met) = met else { continue };
                meets_second = true;
                let nats = two_nats - 0.5 * met.chi2;
                best = best.max(nats);
                let point = (first * met.first + offset + second * met.second) / 2.0;
                let from_third = point - self.stances[2].position;
                let distance = from_third.norm();
                let uncertain = met.first * met.first + met.second * met.second;
                let spread = (WIDENED * scene.variance * (1.0 + uncertain / (distance * distance)))
                    .min(0.06);
                let peak = -(2.0 * PI * spread * CLUTTER_PER_SR).ln();
                for (c, third) in turned[2].iter().enumerate() {
                    let chi2 = angle2(third.dot(&from_third) / distance) / spread;
                    if chi2 < MEETING_CHI2_MAX && !self.used(2, c) {
                        meets_both = true;
                        best = best.max(nats + peak - 0.5 * chi2);
                    }
                }
            }
            count.two += usize::from(meets_second);
            count.three += usize::from(meets_both);
            count.nats += best;
        }
        count
    }

    /// The formation of the three corners alone.
    pub(super) fn formation(&self, scene: &Scene) -> Formation {
        let mut formation = Formation::empty(scene);
        for (corner, vehicle) in self.vehicles.iter().enumerate() {
            formation.stances[*vehicle] = Some(self.stances[corner]);
        }
        self.mark(&mut formation);
        formation
    }

    pub(super) fn mark(&self, formation: &mut Formation) {
        for (viewer, ray, target) in self.sides() {
            formation.seen[viewer][ray] = target as u8;
        }
    }

    pub(super) fn is_within(&self, formation: &Formation) -> bool {
        let mut sides = self.sides();
        sides.all(|(viewer, ray, target)| formation.seen[viewer][ray] as usize == target)
    }

    /// Which ray of which corner is which corner.
    pub(super) fn sides(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        (0..3).flat_map(|corner| {
            [1, 2].map(|further| {
                let ray = self.sightings[corner][further - 1] as usize;
                (
                    self.vehicles[corner],
                    ray,
                    self.vehicles[(corner + further) % 3],
                )
            })
        })
    }
}
