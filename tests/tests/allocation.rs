//! The step of a round allocates nothing once its memory is warm, shown with an allocator that counts.
// The one exception to the lint: an allocator cannot be written without.
#![allow(unsafe_code, clippy::unwrap_used)]

use nalgebra::Vector3;
use skein_estimation::cooperative::{
    Contact, Measurement, Mode, Noise, Optimiser, Robust, SolveStatus, Star, StarWorkspace,
};
use skein_estimation::{Transform, so3};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator; counts what each thread asks for.
struct Counting;

// SAFETY: everything is handed on to the system's allocator unchanged; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `realloc`.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count() {
    ALLOCATIONS.with(|allocations| allocations.set(allocations.get() + 1));
}

fn allocations_of(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.with(Cell::get);
    work();
    ALLOCATIONS.with(Cell::get) - before
}

/// One round among `neighbours`: each measures the centre and is measured, all five kinds in turn, with lever arms.
fn round(
    star: &mut Star,
    workspace: &mut StarWorkspace,
    optimiser: &Optimiser,
    neighbours: usize,
) -> SolveStatus {
    star.restart(Transform::identity()).unwrap();
    let noise = Noise::UNIT;
    for nth in 0..neighbours {
        let angle = nth as f64;
        let place = Vector3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 0.5 * angle);
        let turn = so3::exp(&Vector3::new(0.1, -0.2, angle));
        let neighbour = star
            .add_neighbour(Transform::new(turn, place), Contact::FRESH)
            .unwrap();
        let end = Transform::new(
            so3::exp(&Vector3::new(0.0, 0.0, 0.3)),
            Vector3::new(0.3, 0.0, 0.1),
        );
        let seen = Transform::new(
            turn * so3::exp(&Vector3::new(0.02, 0.01, -0.02)),
            place.add_scalar(0.05),
        );
        let by_me = match nth % 4 {
            0 => Measurement::pose(seen).unwrap(),
            1 => Measurement::orientation(seen.rotation).unwrap(),
            2 => Measurement::position(seen.translation).unwrap(),
            _ => Measurement::bearing(seen.translation.normalize()).unwrap(),
        };
        star.measured_by_me(neighbour, by_me, noise, end, end)
            .unwrap();
        star.measured_by_neighbour(
            neighbour,
            Measurement::distance(seen.translation.norm()).unwrap(),
            noise,
            end,
            end,
        )
        .unwrap();
    }
    star.solve(workspace, optimiser).status
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations_of(|| drop(Box::new([1u8; 100]))), 1);
}

#[test]
fn a_round_of_four_neighbours_allocates_nothing_with_either_optimiser() {
    for optimiser in [Optimiser::gauss_newton(), Optimiser::descent()] {
        let mut star = Star::new(Transform::identity()).unwrap();
        let mut workspace = StarWorkspace::new();
        let warm = round(&mut star, &mut workspace, &optimiser, 4);
        assert!(warm.is_settled(), "{optimiser:?}: {warm:?}");
        let allocations = allocations_of(|| {
            for _ in 0..10 {
                round(&mut star, &mut workspace, &optimiser, 4);
            }
        });
        assert_eq!(allocations, 0, "{optimiser:?}");
    }
}

#[test]
fn a_round_that_judges_its_measurements_allocates_nothing() {
    for optimiser in [Optimiser::gauss_newton(), Optimiser::descent()] {
        let mut star = Star::new(Transform::identity())
            .unwrap()
            .in_mode(Mode::Star(Robust::DEFAULT));
        let mut workspace = StarWorkspace::new();
        let allocations = allocations_of(|| {
            for _ in 0..3 {
                round(&mut star, &mut workspace, &optimiser, 4);
                assert_eq!(star.verdicts(&workspace).count(), 8);
            }
        });
        assert_eq!(allocations, 0, "{optimiser:?}");
    }
}

#[test]
fn not_even_the_first_and_largest_round_allocates() {
    let mut star = Star::new(Transform::identity()).unwrap();
    let mut workspace = StarWorkspace::new();
    let allocations = allocations_of(|| {
        round(&mut star, &mut workspace, &Optimiser::gauss_newton(), 16);
    });
    assert_eq!(allocations, 0);
}
