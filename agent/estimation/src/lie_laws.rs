//! The laws every Lie group of this crate must pass, as one macro: a new group is accepted by one `lie_laws!` line in
//! its tests.

/// Writes the tests of one group. `exp`, `log`, `compose`, `inverse` and the four Jacobians are closures over the
/// group's own functions; rotation is the first three numbers of the tangent.
macro_rules! lie_laws {
    (
        group: $group:ty,
        dimension: $dimension:literal,
        exp: $exp:expr,
        log: $log:expr,
        compose: $compose:expr,
        inverse: $inverse:expr,
        right_jacobian: $right_jacobian:expr,
        right_jacobian_inverse: $right_jacobian_inverse:expr,
        left_jacobian: $left_jacobian:expr,
        left_jacobian_inverse: $left_jacobian_inverse:expr,
    ) => {
        mod laws {
            use super::*;
            use nalgebra::{SMatrix, SVector};
            use rand::{RngExt as _, SeedableRng as _};

            use std::f64::consts::PI;

            type Tangent = SVector<f64, $dimension>;
            type Square = SMatrix<f64, $dimension, $dimension>;
            const SEED: u64 = 20;

            /// Tangents of every size that matters: ordinary, tiny, zero and with an angle close to pi.
            fn tangents() -> Vec<Tangent> {
                let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(SEED);
                let mut all = vec![Tangent::zeros()];
                for angle in [
                    1e-12,
                    1e-9,
                    1e-7,
                    1e-5,
                    1e-3,
                    0.1,
                    0.19,
                    0.21,
                    0.49,
                    0.51,
                    1.0,
                    2.0,
                    3.0,
                    PI - 1e-4,
                    PI - 7e-7,
                ] {
                    for _ in 0..8 {
                        let mut x = Tangent::from_fn(|_, _| rng.random_range(-1.0..1.0));
                        let scale = angle / x.fixed_rows::<3>(0).norm();
                        for k in 0..3 {
                            x[k] *= scale;
                        }
                        all.push(x);
                    }
                }
                all
            }

            fn elements() -> Vec<$group> {
                tangents().iter().map(|x| ($exp)(x)).collect()
            }

            fn apart(a: &$group, b: &$group) -> f64 {
                ($log)(&($compose)(&($inverse)(a), b)).norm()
            }

            /// `minus(plus(a, x), a) = x`: the tangent that leads from `a` to `b`, on the right.
            fn minus(b: &$group, a: &$group) -> Tangent {
                ($log)(&($compose)(&($inverse)(a), b))
            }

            fn plus(a: &$group, x: &Tangent) -> $group {
                ($compose)(a, &($exp)(x))
            }

            #[test]
            fn zero_is_the_identity_and_changes_nothing() {
                let identity = ($exp)(&Tangent::zeros());
                for a in elements() {
                    let error = apart(&($compose)(&a, &identity), &a);
                    assert!(error < 1e-14, "seed {SEED}, apart by {error}");
                    let error = apart(&($compose)(&identity, &a), &a);
                    assert!(error < 1e-14, "seed {SEED}, apart by {error}");
                    let error = apart(&plus(&a, &Tangent::zeros()), &a);
                    assert!(error < 1e-14, "seed {SEED}, apart by {error}");
                }
            }

            #[test]
            fn an_element_times_its_inverse_is_the_identity() {
                let identity = ($exp)(&Tangent::zeros());
                for a in elements() {
                    let error = apart(&($compose)(&a, &($inverse)(&a)), &identity);
                    assert!(error < 1e-14, "seed {SEED}, apart by {error}");
                    let error = apart(&($compose)(&($inverse)(&a), &a), &identity);
                    assert!(error < 1e-14, "seed {SEED}, apart by {error}");
                }
            }

            #[test]
            fn composition_is_associative() {
                let all = elements();
                for (k, a) in all.iter().enumerate() {
                    let (b, c) = (
                        &all[(k * 7 + 3) % all.len()],
                        &all[(k * 11 + 5) % all.len()],
                    );
                    let one = ($compose)(&($compose)(a, b), c);
                    let other = ($compose)(a, &($compose)(b, c));
                    let error = apart(&one, &other);
                    assert!(error < 1e-13, "seed {SEED}, apart by {error}");
                }
            }

            #[test]
            fn log_undoes_exp_up_to_half_a_turn() {
                for x in tangents() {
                    let error = (($log)(&($exp)(&x)) - x).norm();
                    assert!(
                        error < 1e-9 * x.norm().max(1e-6),
                        "seed {SEED}, {x}, error {error}"
                    );
                }
            }

            #[test]
            fn exp_undoes_log() {
                for a in elements() {
                    let error = apart(&($exp)(&($log)(&a)), &a);
                    assert!(error < 1e-13, "seed {SEED}, apart by {error}");
                }
            }

            #[test]
            fn plus_and_minus_undo_each_other() {
                let all = elements();
                for (k, a) in all.iter().enumerate() {
                    let b = &all[(k * 13 + 1) % all.len()];
                    let error = apart(&plus(a, &minus(b, a)), b);
                    assert!(error < 1e-13, "seed {SEED}, apart by {error}");
                }
            }

            #[test]
            fn the_inverse_of_exp_is_exp_of_minus() {
                for x in tangents() {
                    let error = apart(&($inverse)(&($exp)(&x)), &($exp)(&-x));
                    assert!(error < 1e-13, "seed {SEED}, apart by {error}");
                }
            }

            #[test]
            fn the_jacobians_are_the_numeric_derivatives() {
                let step = 1e-6;
                for x in tangents() {
                    let a = ($exp)(&x);
                    let mut right = Square::zeros();
                    let mut left = Square::zeros();
                    for k in 0..$dimension {
                        let mut ahead = x;
                        ahead[k] += step;
                        let mut behind = x;
                        behind[k] -= step;
                        let (ahead, behind) = (($exp)(&ahead), ($exp)(&behind));
                        let on_right = (minus(&ahead, &a) - minus(&behind, &a)) / (2.0 * step);
                        right.set_column(k, &on_right);
                        let undo = ($inverse)(&a);
                        let on_left = (($log)(&($compose)(&ahead, &undo))
                            - ($log)(&($compose)(&behind, &undo)))
                            / (2.0 * step);
                        left.set_column(k, &on_left);
                    }
                    assert!(
                        (($right_jacobian)(&x) - right).norm() < 2e-8,
                        "seed {SEED}, {x}"
                    );
                    assert!(
                        (($left_jacobian)(&x) - left).norm() < 2e-8,
                        "seed {SEED}, {x}"
                    );
                }
            }

            #[test]
            fn the_inverse_jacobians_are_inverses() {
                for x in tangents() {
                    let right = ($right_jacobian)(&x) * ($right_jacobian_inverse)(&x);
                    let left = ($left_jacobian)(&x) * ($left_jacobian_inverse)(&x);
                    assert!(
                        (right - Square::identity()).norm() < 1e-10,
                        "seed {SEED}, {x}"
                    );
                    assert!(
                        (left - Square::identity()).norm() < 1e-10,
                        "seed {SEED}, {x}"
                    );
                }
            }
        }
    };
}

pub(crate) use lie_laws;
