//! In how many places a belief lies: clusters of directions and yaws. Distances and velocities do not tell places apart,
//! since they are uncertain within each.

/// Most clusters that are told apart.
pub(super) const MODES_MAX: usize = 8;

/// A cluster holds what is within this angle (rad) of its middle, in direction and in yaw: several times the spread of
/// one place, less than half the way between two.
const RADIUS_RAD: f64 = 0.45;

/// A cluster of less mass is not counted, and the search ends when less is left.
const MASS_MIN: f64 = 0.04;

/// Points that are tried as middles and that are counted around each.
const CANDIDATES: usize = 48;

/// How often a middle is moved to the mean of what is around it.
const SHIFTS: usize = 2;

/// No cluster's label.
pub(super) const NOWHERE: u8 = u8::MAX;

/// A belief as weighted unit vectors of direction and of yaw.
pub(super) struct Points<'a> {
    pub(super) direction: [&'a [f64]; 3],
    pub(super) cos_yaw: &'a [f64],
    pub(super) sin_yaw: &'a [f64],
    pub(super) weight: &'a [f64],
}

/// The clusters' masses, in the order of their labels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    masses: [f64; MODES_MAX],
    count: usize,
}

impl Found {
    pub(super) const fn count(&self) -> usize {
        self.count
    }

    /// Label and mass of the heaviest.
    pub(super) fn dominant(&self) -> Option<(u8, f64)> {
        (0..self.count)
            .map(|label| (label as u8, self.masses[label]))
            .max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// Direction and yaw of a point, as the unit vectors they are.
type Place = [f64; 5];

impl Points<'_> {
    fn place(&self, i: usize) -> Place {
        let [x, y, z] = self.direction;
        [x[i], y[i], z[i], self.cos_yaw[i], self.sin_yaw[i]]
    }
}

fn is_near(a: &Place, b: &Place, cos_radius: f64) -> bool {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] > cos_radius && a[3] * b[3] + a[4] * b[4] > cos_radius
}

/// Finds the clusters, densest first, and labels each point with its own. Weights are of a sum of one. The work is
/// [`MODES_MAX`] times a few passes over the points.
pub(super) fn find(points: &Points<'_>, labels: &mut [u8]) -> Found {
    labels.fill(NOWHERE);
    let mut found = Found {
        masses: [0.0; MODES_MAX],
        count: 0,
    };
    let cos_radius = RADIUS_RAD.cos();
    let mut left: f64 = points.weight.iter().sum();
    while found.count < MODES_MAX && left > MASS_MIN {
        let Some(mut middle) = densest(points, labels, left, cos_radius) else {
            break;
        };
        for _ in 0..SHIFTS {
            middle = mean_around(points, labels, &middle, cos_radius).unwrap_or(middle);
        }
        let mut mass = 0.0;
        for (i, label) in labels.iter_mut().enumerate() {
            if *label == NOWHERE && is_near(&points.place(i), &middle, cos_radius) {
                *label = found.count as u8;
                mass += points.weight[i];
            }
        }
        if mass < MASS_MIN {
            // What is densest is too little: so is the rest.
            for label in labels
                .iter_mut()
                .filter(|label| **label == found.count as u8)
            {
                *label = NOWHERE;
            }
            break;
        }
        found.masses[found.count] = mass;
        found.count += 1;
        left -= mass;
    }
    found
}

/// The candidate with most other candidates around it. Candidates are equally spaced in mass.
fn densest(points: &Points<'_>, labels: &[u8], left: f64, cos_radius: f64) -> Option<Place> {
    let mut candidates = [[0.0; 5]; CANDIDATES];
    let mut count = 0;
    let mut passed = 0.0;
    for (i, &label) in labels.iter().enumerate() {
        if label != NOWHERE {
            continue;
        }
        passed += points.weight[i];
        while count < CANDIDATES && passed > (count as f64 + 0.5) / CANDIDATES as f64 * left {
            candidates[count] = points.place(i);
            count += 1;
        }
    }
    let candidates = &candidates[..count];
    let around = |place: &&Place| {
        candidates
            .iter()
            .filter(|other| is_near(place, other, cos_radius))
            .count()
    };
    candidates.iter().max_by_key(around).copied()
}

fn mean_around(
    points: &Points<'_>,
    labels: &[u8],
    middle: &Place,
    cos_radius: f64,
) -> Option<Place> {
    let mut sum = [0.0; 5];
    for (i, &label) in labels.iter().enumerate() {
        let place = points.place(i);
        if label == NOWHERE && is_near(&place, middle, cos_radius) {
            for (sum, component) in sum.iter_mut().zip(place) {
                *sum += points.weight[i] * component;
            }
        }
    }
    let direction = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
    let yaw = sum[3].hypot(sum[4]);
    (direction > 0.0 && yaw > 0.0).then(|| {
        let [x, y, z, cos, sin] = sum;
        [
            x / direction,
            y / direction,
            z / direction,
            cos / yaw,
            sin / yaw,
        ]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many points at each azimuth, all level and with yaw zero, scattered a little.
    fn found_at(places: &[(f64, usize)]) -> (Found, Vec<u8>) {
        let azimuths: Vec<f64> = places
            .iter()
            .flat_map(|&(azimuth, count)| {
                (0..count).map(move |i| azimuth + 0.1 * (i as f64 / count as f64 - 0.5))
            })
            .collect();
        let n = azimuths.len();
        let x: Vec<f64> = azimuths.iter().map(|a| a.cos()).collect();
        let y: Vec<f64> = azimuths.iter().map(|a| a.sin()).collect();
        let (zero, one, weight) = (vec![0.0; n], vec![1.0; n], vec![1.0 / n as f64; n]);
        let points = Points {
            direction: [&x, &y, &zero],
            cos_yaw: &one,
            sin_yaw: &zero,
            weight: &weight,
        };
        let mut labels = vec![0; n];
        (find(&points, &mut labels), labels)
    }

    #[test]
    fn three_places_are_three_clusters_and_the_heaviest_is_known() {
        let (found, labels) = found_at(&[(0.0, 30), (1.5, 50), (-2.0, 20)]);
        assert_eq!(found.count(), 3);
        let (label, mass) = found.dominant().unwrap();
        assert!((mass - 0.5).abs() < 1e-9);
        assert!(labels[30..80].iter().all(|&of| of == label));
    }

    #[test]
    fn a_few_stray_points_are_no_place() {
        let (found, labels) = found_at(&[(0.0, 97), (2.0, 3)]);
        assert_eq!(found.count(), 1);
        assert_eq!(labels[99], NOWHERE);
    }

    #[test]
    fn more_places_than_are_told_apart_do_no_harm() {
        let many: Vec<_> = (0..MODES_MAX + 4).map(|i| (0.5 * i as f64, 10)).collect();
        let (found, _) = found_at(&many);
        assert!(found.count() <= MODES_MAX);
    }

    #[test]
    fn a_belief_of_nothing_has_no_cluster() {
        let (found, _) = found_at(&[]);
        assert_eq!(found.count(), 0);
        assert!(found.dominant().is_none());
    }
}
