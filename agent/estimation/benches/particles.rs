//! One second of particle filters of eight neighbours: 20 motions and 10 measurements of three answers each, 2000 particles
//! a neighbour. Beside it, in the same run, the same filter written straightforwardly, and the bank of Kalman filters.

mod straightforward;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use skein_estimation::mutual::Motion;
use skein_estimation::mutual::direction;
use skein_estimation::mutual::filter::bank::BankSettings;
use skein_estimation::mutual::filter::mixture::{Answer, Mixture, Tempering};
use skein_estimation::mutual::filter::particles::ParticleSettings;
use skein_estimation::mutual::filter::{FilterSettings, NeighbourFilter};
use std::hint::black_box;
use straightforward::Straightforward;

const NEIGHBOURS: usize = 8;
const MOTIONS: usize = 20;
/// Every so many motions, a measurement.
const MEASURED_EVERY: usize = 2;

/// One answer that is right and two that are not, a little different each time.
fn answers(time: usize) -> [Answer; 3] {
    let off = 0.05 * (time as f64 * 1.7).sin();
    [0.0, 1.7, -2.1].map(|azimuth| Answer {
        direction: direction::from_angles(0.3 + azimuth + off, 1.4 - off),
        yaw_rad: 0.5 + azimuth + off,
        covariance_rad2: Matrix3::identity() * 0.0076,
        log_likelihood: -azimuth.abs(),
        own_feature: None,
    })
}

/// Both vehicles do much the same.
fn motions(time: usize) -> (Motion, Motion) {
    let motion = |phase: f64| {
        let phase = phase + 0.1 * time as f64;
        Motion {
            elapsed_s: 0.05,
            yaw_rad: 0.01 * phase.sin(),
            velocity_m_s: Vector3::new(0.05 * phase.cos(), 0.04 * phase.sin(), 0.01),
            position_m: Vector3::new(0.001 * phase.cos(), 0.001 * phase.sin(), 0.0),
        }
    };
    (motion(0.0), motion(0.5))
}

fn one_second(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("one second of eight neighbours");
    group.sample_size(20);
    let mixtures: Vec<_> = (0..MOTIONS)
        .filter_map(|time| Mixture::new(&answers(time), &[], &Tempering::CAUTIOUS))
        .collect();
    let filters = [
        (
            "particles",
            FilterSettings::Particles(ParticleSettings::PAPER),
        ),
        ("bank", FilterSettings::Bank(BankSettings::QUADROTOR)),
    ];
    for (name, settings) in filters {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut neighbours: Vec<_> = (0..NEIGHBOURS)
            .map(|_| NeighbourFilter::born(&settings, &mixtures[0], &mut rng))
            .collect();
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for (time, mixture) in mixtures.iter().enumerate() {
                    let (own, neighbour) = motions(time);
                    for filter in &mut neighbours {
                        filter.predict(&own, &neighbour, &mut rng);
                        if time % MEASURED_EVERY == 0 {
                            black_box(filter.update(mixture, &mut rng));
                        }
                    }
                }
            });
        });
        group.bench_function(format!("{name}, estimates"), |bencher| {
            bencher.iter(|| {
                for _ in 0..MOTIONS / MEASURED_EVERY {
                    for filter in &mut neighbours {
                        black_box(filter.estimate());
                    }
                }
            });
        });
    }
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut neighbours: Vec<_> = (0..NEIGHBOURS)
        .map(|_| Straightforward::born(&answers(0), &mut rng))
        .collect();
    group.bench_function("particles, straightforward", |bencher| {
        bencher.iter(|| {
            for time in 0..MOTIONS {
                let (own, neighbour) = motions(time);
                for filter in &mut neighbours {
                    filter.predict(&own, &neighbour, &mut rng);
                    if time % MEASURED_EVERY == 0 {
                        filter.update(&answers(time), &mut rng);
                        black_box(&filter);
                    }
                }
            }
        });
    });
    group.finish();
}

criterion_group!(benches, one_second);
criterion_main!(benches);
