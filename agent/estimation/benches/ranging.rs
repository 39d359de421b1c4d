//! Where one neighbour is, from ranges alone: a window solved from where it is believed to be and from everywhere, and
//! one range for the bank of filters; and a round of the motion schedule of a thousand robots. Beside them, in the same run,
//! the plainest solver of the same window: descents with unit weights and numerical derivatives from a grid of starts, as a
//! first draft would do it; and a robot that knows all of the thousand and elects for them.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Vector3};
use skein_estimation::odometry::Growth;
use skein_estimation::ranging::bank::BankSettings;
use skein_estimation::ranging::schedule::{PHASES, Permit, Scheduler, Slot};
use skein_estimation::ranging::window::{Starts, WindowSettings};
use skein_estimation::ranging::{Bank, LevelOdometry, RangeSample, RelativePose, Window};
use skein_estimation::{Span, Stamp, VehicleId};
use std::hint::black_box;

/// Both drive curves of different radii; ranges are a decimetre wrong, now to this side and now to that.
fn sample(round: i64) -> RangeSample {
    let k = round as f64;
    let curve = |rate: f64, speed: f64| {
        let place = |step: i64| {
            let k = step as f64;
            let (along, across) = (0.3 * rate * k, 0.5 * rate * k);
            Vector3::new(speed * k * along.cos(), speed * k * across.sin(), 0.0)
        };
        let growth = (0..=round).fold(Growth::zero(), |growth, step| {
            growth.after(&place(step), 0.01, 0.05)
        });
        let position_m = place(round);
        let yaw_rad = rate * k + 0.4 * (1.3 * k * speed).sin();
        LevelOdometry {
            segment: 0,
            position_m,
            yaw_rad,
            growth,
        }
    };
    let (own, neighbour) = (curve(0.35, 2.8), curve(-0.5, 3.2));
    // The neighbour's odometry began at (6, 2), turned by one radian.
    let (sin, cos) = 1.0_f64.sin_cos();
    let there = &neighbour.position_m;
    let between = Vector3::new(
        6.0 + cos * there.x - sin * there.y,
        2.0 + sin * there.x + cos * there.y,
        0.0,
    ) - own.position_m;
    RangeSample {
        taken: Stamp::from_nanos(0) + Span::secs(round),
        range_m: between.norm() + 0.1 * (2.9 * k).sin(),
        sigma_m: 0.1,
        own,
        neighbour,
    }
}

fn window(ranges: i64) -> Window {
    let mut window = Window::new();
    for round in 0..ranges {
        window.push(&sample(round)).expect("the samples are sound");
    }
    window
}

/// Places of both in their newest frames, and ranges.
fn places(window: &Window) -> Vec<(Vector3<f64>, Vector3<f64>, f64)> {
    let newest = window.newest().expect("there are samples");
    let seen = |now: &LevelOdometry, then: &LevelOdometry| {
        let off = then.position_m - now.position_m;
        let (sin, cos) = (-now.yaw_rad).sin_cos();
        Vector3::new(cos * off.x - sin * off.y, sin * off.x + cos * off.y, 0.0)
    };
    window
        .samples()
        .map(|one| {
            (
                seen(&newest.own, &one.own),
                seen(&newest.neighbour, &one.neighbour),
                one.range_m,
            )
        })
        .collect()
}

/// Gauss-Newton with damping from 36 starts, unit weights, numerical derivatives.
fn straightforward(places: &[(Vector3<f64>, Vector3<f64>, f64)]) -> (f64, Vector3<f64>) {
    let residuals = |state: &Vector3<f64>| -> Vec<f64> {
        let (sin, cos) = state.z.sin_cos();
        let of = |(own, theirs, range): &(Vector3<f64>, Vector3<f64>, f64)| {
            let x = state.x + cos * theirs.x - sin * theirs.y - own.x;
            let y = state.y + sin * theirs.x + cos * theirs.y - own.y;
            range - x.hypot(y)
        };
        places.iter().map(of).collect()
    };
    let cost = |state: &Vector3<f64>| residuals(state).iter().map(|r| r * r).sum::<f64>();
    let range = places[places.len() - 1].2;
    let mut best = (f64::INFINITY, Vector3::zeros());
    for start in 0..36 {
        let bearing = f64::from(start % 6) * 1.047;
        let yaw = f64::from(start / 6) * 1.047;
        let mut state = Vector3::new(range * bearing.cos(), range * bearing.sin(), yaw);
        let mut damping = 1e-3;
        for _ in 0..30 {
            let at = residuals(&state);
            let (mut hessian, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            let columns: Vec<Vec<f64>> = (0..3)
                .map(|i| {
                    let mut moved = state;
                    moved[i] += 1e-6;
                    residuals(&moved)
                })
                .collect();
            for (j, residual) in at.iter().enumerate() {
                let row = Vector3::from_fn(|i, _| (residual - columns[i][j]) * 1e6);
                hessian += row * row.transpose();
                gradient += row * *residual;
            }
            hessian += Matrix3::identity() * damping;
            let Some(step) = hessian.try_inverse().map(|inverse| inverse * gradient) else {
                break;
            };
            if cost(&(state + step)) < cost(&state) {
                state += step;
                damping *= 0.3;
                if step.norm() < 1e-5 {
                    break;
                }
            } else {
                damping *= 5.0;
            }
        }
        let reached = cost(&state);
        if reached < best.0 {
            best = (reached, state);
        }
    }
    best
}

fn windows(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("a window of ranges");
    group.sample_size(20);
    for ranges in [4, 6, 9] {
        let window = window(ranges);
        let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
        let Some(best) = modes.best() else { continue };
        let near = [RelativePose::new(
            best.pose.position_m * 1.02,
            best.pose.yaw_rad + 0.05,
        )];
        group.bench_function(format!("{ranges}, tracked"), |bencher| {
            bencher.iter(|| {
                black_box(window.solve(&WindowSettings::PLANAR, Starts::Tracked(&near), None))
            });
        });
        group.bench_function(format!("{ranges}, exhaustive"), |bencher| {
            bencher.iter(|| {
                black_box(window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None))
            });
        });
        group.bench_function(format!("{ranges}, exhaustive, in space"), |bencher| {
            bencher.iter(|| {
                black_box(window.solve(&WindowSettings::SPATIAL, Starts::Exhaustive, None))
            });
        });
        let places = places(&window);
        group.bench_function(format!("{ranges}, straightforward"), |bencher| {
            bencher.iter(|| black_box(straightforward(black_box(&places))));
        });
    }
    group.finish();
}

fn bank(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("a range for the bank");
    let window = window(4);
    let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
    // Nothing is dropped, so that the update has all the minima of the window to move.
    let settings = BankSettings {
        negligible: f64::MIN_POSITIVE,
        ..BankSettings::PLANAR
    };
    let newest = window.newest().expect("there are samples");
    let started = Bank::started(settings, &modes, newest).expect("there are modes");
    let next = sample(4);
    group.bench_function(
        format!("{} hypotheses", started.places().count()),
        |bencher| {
            bencher.iter(|| {
                let mut bank = started;
                black_box(bank.update(&next));
                bank
            });
        },
    );
    group.finish();
}

/// Robots that stand in a grid and hear the eight around them.
const COLUMNS: usize = 40;
const ROBOTS: usize = 1000;

fn neighbours(robot: usize) -> Vec<usize> {
    let (row, column) = (robot / COLUMNS, robot % COLUMNS);
    let near = |other: &usize| {
        let apart = (other / COLUMNS)
            .abs_diff(row)
            .max((other % COLUMNS).abs_diff(column));
        apart == 1
    };
    (0..ROBOTS).filter(near).collect()
}

/// The numbers that are drawn: spread over all bits (the finaliser of MurmurHash3), different in every phase.
fn drawn(robot: usize, phase: u32) -> u32 {
    let mut bits = robot as u32 ^ phase.wrapping_mul(0x9e37_79b9);
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ (bits >> 13)).wrapping_mul(0xc2b2_ae35);
    bits ^ (bits >> 16)
}

/// Lets a round go by. Who may move is decided when the next begins.
fn round(schedulers: &mut [Scheduler], near: &[Vec<usize>], round: u32) {
    for phase in 0..PHASES {
        let slot = Slot::new(round, phase).expect("rounds are counted from one");
        let draw = |robot| drawn(robot, round * u32::from(PHASES) + u32::from(phase));
        let said: Vec<_> = (schedulers.iter_mut().enumerate())
            .map(|(robot, scheduler)| scheduler.begin_phase(slot, draw(robot)))
            .collect();
        for (from, message) in said.iter().enumerate() {
            for to in &near[from] {
                let heard = schedulers[*to].hear(VehicleId(from as u64 + 1), message);
                debug_assert!(heard.is_ok());
            }
        }
    }
}

/// Who moves, elected by one that knows all: whoever drew the most among its undecided neighbours, until all are decided.
fn elected(near: &[Vec<usize>], round: u32) -> Vec<bool> {
    let mut undecided = vec![true; near.len()];
    let mut moves = vec![false; near.len()];
    let value = |robot: usize| (drawn(robot, round), robot);
    while undecided.contains(&true) {
        let wins = |robot: &usize| {
            let rivals = near[*robot].iter().filter(|rival| undecided[**rival]);
            undecided[*robot] && rivals.copied().all(|rival| value(rival) < value(*robot))
        };
        let winners: Vec<usize> = (0..near.len()).filter(wins).collect();
        for winner in winners {
            moves[winner] = true;
            undecided[winner] = false;
            for beaten in &near[winner] {
                undecided[*beaten] = false;
            }
        }
    }
    moves
}

fn schedule(criterion: &mut Criterion) {
    const ROUNDS_BEFORE: u32 = 10;
    let mut group = criterion.benchmark_group("a round of the schedule of a thousand");
    group.sample_size(20);
    let near: Vec<_> = (0..ROBOTS).map(neighbours).collect();
    let mut schedulers: Vec<_> = (1..=ROBOTS as u64)
        .map(|robot| Scheduler::new(VehicleId(robot)))
        .collect();
    for nth in 1..=ROUNDS_BEFORE {
        round(&mut schedulers, &near, nth);
    }
    let movers = schedulers.iter().filter(|one| one.permit() == Permit::Move);
    assert!(movers.count() > 0, "they have been electing for a while");
    group.bench_function("each by what it hears", |bencher| {
        let mut nth = ROUNDS_BEFORE;
        bencher.iter(|| {
            nth += 1;
            round(black_box(&mut schedulers), &near, nth);
        });
    });
    group.bench_function("one that knows all", |bencher| {
        let mut nth = 0;
        bencher.iter(|| {
            nth += 1;
            black_box(elected(&near, nth))
        });
    });
    group.finish();
}

criterion_group!(benches, windows, bank, schedule);
criterion_main!(benches);
