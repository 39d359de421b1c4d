//! Registration of one scan: eight robots with two phantoms each at 5 deg and twenty at 1 deg, with nothing believed and
//! with beliefs that explain the scan. The yardstick in the same run is the published method, which has no seeds but
//! triangles and no fast path.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix4, Rotation3, UnitVector3, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use skein_estimation::VehicleId;
use skein_estimation::mutual::direction::{moved, wrapped};
use skein_estimation::mutual::registration::{
    Belief, Job, Method, Neighbour, Pose, Settings, Sighting,
};
use std::hint::black_box;

/// Scans of each kind, so that no single one decides.
const SCANS: u64 = 8;

/// What robots see that are anywhere in a box, each also so many phantoms, and where they are.
fn scan(robots: usize, phantoms: usize, sigma_rad: f64, seed: u64) -> Job {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let growth = (robots as f64 / 8.0).cbrt().max(1.0);
    let mut positions: Vec<Vector3<f64>> = Vec::new();
    while positions.len() < robots {
        let drawn =
            Vector3::from([2.6, 5.0, 1.6].map(|half| rng.random_range(-half..half) * growth));
        if positions.iter().all(|one| (one - drawn).norm() > 1.0) {
            positions.push(drawn);
        }
    }
    let yaws: Vec<f64> = (0..robots).map(|_| rng.random_range(-3.0..3.0)).collect();
    let level = |robot: usize| Rotation3::from_axis_angle(&Vector3::z_axis(), -yaws[robot]);
    let mut seen = Vec::new();
    for viewer in 0..robots {
        let others = (0..robots).filter(|target| *target != viewer);
        let offsets = others.map(|target| level(viewer) * (positions[target] - positions[viewer]));
        let mut directions: Vec<_> = offsets.map(UnitVector3::new_normalize).collect();
        for _ in 0..phantoms {
            let azimuth: f64 = rng.random_range(-3.0..3.0);
            let along = Vector3::new(azimuth.cos(), azimuth.sin(), rng.random_range(-0.5..0.5));
            directions.push(UnitVector3::new_normalize(along));
        }
        let mut noise = || -> f64 {
            let one: f64 = StandardNormal.sample(&mut rng);
            sigma_rad * one
        };
        let sighting = |direction| Sighting {
            direction,
            sigma_rad,
        };
        let noisy = directions
            .iter()
            .map(|one| moved(one, &[noise(), noise()].into()));
        seen.push(noisy.map(sighting).collect::<Vec<_>>());
    }
    let own = seen.remove(0);
    let neighbours = seen
        .into_iter()
        .zip(1..)
        .map(|(sightings, robot)| Neighbour {
            vehicle: VehicleId(robot as u64),
            sightings,
            belief: Some(Belief::Gaussian {
                mean: Pose {
                    position_m: level(0) * (positions[robot] - positions[0]),
                    yaw_rad: wrapped(yaws[robot] - yaws[0]),
                },
                covariance: Matrix4::identity() * 0.01,
            }),
        });
    Job {
        own,
        neighbours: neighbours.collect(),
        method: Method::SingleScan,
        settings: Settings::default(),
    }
}

fn without_beliefs(mut job: Job) -> Job {
    for neighbour in &mut job.neighbours {
        neighbour.belief = None;
    }
    job
}

fn one_scan(criterion: &mut Criterion) {
    let kinds = [
        ("eight robots, two phantoms, 5 deg", 8, 2, 5.0_f64),
        ("twenty robots, 1 deg", 20, 0, 1.0),
    ];
    for (kind, robots, phantoms, noise_deg) in kinds {
        let mut group = criterion.benchmark_group(format!("{SCANS} scans of {kind}"));
        group.sample_size(10);
        let believed: Vec<Job> = (0..SCANS)
            .map(|seed| scan(robots, phantoms, noise_deg.to_radians(), seed))
            .collect();
        let nothing: Vec<Job> = believed.iter().cloned().map(without_beliefs).collect();
        let published = |job: &Job| Job {
            method: Method::Published,
            ..job.clone()
        };
        let yardstick: Vec<Job> = nothing.iter().map(published).collect();
        let mut contenders = vec![("believed", believed), ("nothing believed", nothing)];
        if robots <= 8 {
            contenders.push(("published", yardstick));
        }
        for (name, jobs) in contenders {
            group.bench_function(name, |bencher| {
                bencher.iter(|| {
                    jobs.iter()
                        .map(|job| black_box(job).run().solutions.len())
                        .sum::<usize>()
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, one_scan);
criterion_main!(benches);
