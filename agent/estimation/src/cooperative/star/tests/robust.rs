//! The star with a kernel: what it accepts, what it rejects, and what it says of either.

use super::*;
use crate::cooperative::kernel::Kernel;
use crate::cooperative::mode::Robust;
use crate::odometry::Drift;

const FINE: Noise = Noise {
    rotation_rad: 0.02,
    translation: 0.001,
};

/// An empty star with the default kernel.
fn alone(prior: Node) -> Star {
    with(Robust::DEFAULT, prior)
}

fn with(robust: Robust, prior: Node) -> Star {
    let mut star = Star::new(prior).unwrap().in_mode(Mode::Star(robust));
    star.restart(prior).unwrap();
    star
}

/// A neighbour at `prior` that says where `centre` is in its frame.
fn add_seeing(star: &mut Star, prior: Node, contact: Contact, centre: &Node, kind: Kind) {
    let index = star.add_neighbour(prior, contact).unwrap();
    let seen = seen(kind, &(prior.inverse() * *centre).reframe());
    let end = Transform::identity();
    star.measured_by_neighbour(index, seen, FINE, end, end)
        .unwrap();
}

/// Eight neighbours, every kind both ways, spoilt by as much as the kernel's scale and more; by `part` of that.
pub(in crate::cooperative::star) fn crowd(seed: u64, part: f64) -> Star {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let truth: Node = pose(&mut rng, 1.0, 3.0);
    let mut star = alone(spoilt(&mut rng, &truth, 0.1 * part, 0.2 * part));
    let end = Transform::identity();
    for j in 0..8 {
        let other: Node = pose(&mut rng, 1.0, 5.0);
        let index = star
            .add_neighbour(
                spoilt(&mut rng, &other, 0.1 * part, 0.2 * part),
                Contact::FRESH,
            )
            .unwrap();
        let relative: Transform<Sensor, Sensor> = (truth.inverse() * other).reframe();
        let off = |rng: &mut ChaCha8Rng| pose::<Sensor, Sensor>(rng, 0.2 * part, 0.3 * part);
        let mine = seen(KINDS[j % 5], &(relative * off(&mut rng)));
        let theirs = seen(KINDS[(j + 2) % 5], &(relative.inverse() * off(&mut rng)));
        star.measured_by_me(index, mine, FINE, end, end).unwrap();
        star.measured_by_neighbour(index, theirs, FINE, end, end)
            .unwrap();
    }
    star.fix(seen(Kind::Position, &truth.reframe()), FINE, end)
        .unwrap();
    star
}

fn judgements(star: &Star, workspace: &StarWorkspace) -> Vec<Judgement> {
    star.verdicts(workspace)
        .map(|verdict| verdict.judgement())
        .collect()
}

fn shifted(x: f64) -> Node {
    Node::new(UnitQuaternion::identity(), Vector3::new(x, 0.0, 0.0))
}

#[test]
fn a_fix_of_one_scale_by_hand() {
    // A fix whose noise is the floor of 1 m counts one, and its scale c covers the floor and three sigmas: c^2 = 10.
    // f = (t^2 + r^2 / (1 + (r/c)^2)) / 2 with r = 5/4 c - t is least where t = r / (1 + (r/c)^2)^2: t = c/4, r = c.
    let c = 10.0_f64.sqrt();
    let kernel = Kernel {
        translation_floor_m: 1.0,
        ..Kernel::DEFAULT
    };
    let mut star = with(
        Robust {
            kernel,
            ..Robust::DEFAULT
        },
        Node::identity(),
    );
    let fix = Measurement::position(Vector3::new(1.25 * c, 0.0, 0.0)).unwrap();
    let coarse = Noise {
        translation: 1.0,
        ..FINE
    };
    star.fix(fix, coarse, Transform::identity()).unwrap();
    for optimiser in [Optimiser::gauss_newton(), Optimiser::descent()] {
        let mut workspace = StarWorkspace::new();
        let solution = star.solve(&mut workspace, &optimiser);
        assert_eq!(solution.status, SolveStatus::Converged);
        assert!((solution.world_from_body.translation.x - c / 4.0).abs() < 1e-6);
        assert!((solution.cost_after - 0.5 * (10.0 / 16.0 + 5.0)).abs() < 1e-9);
        let verdict = star.verdicts(&workspace).next().unwrap();
        assert_eq!((verdict.tie, verdict.kind), (Tie::Fix, Kind::Position));
        assert!((verdict.weight - 0.25).abs() < 1e-5);
        assert!((verdict.disagreement.translation_m.unwrap() - c).abs() < 1e-5);
        assert_eq!(verdict.disagreement.rotation_rad, None);
        assert!((verdict.scale.unwrap().translation_m - c).abs() < 1e-9);
    }
}

#[test]
fn gauss_newton_and_descent_find_the_same_robust_minimum() {
    for seed in 1..=5 {
        // Where much is in doubt there are several minima, and either may find another.
        let star = crowd(seed, 0.3);
        let mut workspace = StarWorkspace::new();
        let quick = star.solve(&mut workspace, &Optimiser::gauss_newton());
        let slow = star.solve(&mut workspace, &Optimiser::descent());
        assert_eq!(quick.status, SolveStatus::Converged, "seed {seed}");
        assert!(quick.cost_after < quick.cost_before);
        let off = apart(&quick.world_from_body, &slow.world_from_body);
        assert!(off < 1e-4, "seed {seed}: {off}");
    }
}

#[test]
fn a_gross_outlier_is_rejected_and_hardly_moves_the_vehicle() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let truth: Node = pose(&mut rng, 1.0, 3.0);
    let prior = spoilt(&mut rng, &truth, 0.02, 0.05);
    let mut star = alone(prior);
    for _ in 0..3 {
        let other = pose(&mut rng, 1.0, 5.0);
        add_seeing(&mut star, other, Contact::FRESH, &truth, Kind::Pose);
    }
    let mut workspace = StarWorkspace::new();
    let good = star.solve(&mut workspace, &Optimiser::gauss_newton());
    let (liar, lie): (Node, Node) = (pose(&mut rng, 1.0, 5.0), pose(&mut rng, 2.0, 8.0));
    add_seeing(&mut star, liar, Contact::FRESH, &lie, Kind::Pose);
    let with_outlier = star.solve(&mut workspace, &Optimiser::gauss_newton());
    let moved = apart(&good.world_from_body, &with_outlier.world_from_body);
    assert!(moved < 1e-3, "seed {SEED}: {moved}");
    let expected = [
        Judgement::Accepted,
        Judgement::Accepted,
        Judgement::Accepted,
        Judgement::Rejected,
    ];
    assert_eq!(judgements(&star, &workspace), expected);
    let verdict = star.verdicts(&workspace).last().unwrap();
    assert_eq!(verdict.tie, Tie::MeasuredByNeighbour(NeighbourIndex(3)));
    let size = verdict.disagreement.translation_m.unwrap();
    assert!(
        size > 5.0 * verdict.scale.unwrap().translation_m,
        "{size} m"
    );
}

#[test]
fn a_fix_counts_by_how_its_noise_compares_with_what_priors_err_by() {
    // The prior says 0, the fix 0.1 m: a fine one is followed, one as good as the prior meets it, a coarse one hardly counts.
    let floor_m = Kernel::DEFAULT.translation_floor_m;
    for (sigma_m, counts) in [(1e-3, 100.0), (floor_m, 1.0), (10.0 * floor_m, 0.01)] {
        let mut star = alone(Node::identity());
        let fix = Measurement::position(Vector3::new(0.1, 0.0, 0.0)).unwrap();
        // A position says nothing of angles, not even how well it knows them.
        let noise = Noise {
            rotation_rad: 0.0,
            translation: sigma_m,
        };
        star.fix(fix, noise, Transform::identity()).unwrap();
        let solution = star.solve(&mut StarWorkspace::new(), &Optimiser::gauss_newton());
        let share = solution.world_from_body.translation.x / 0.1;
        assert!(
            (share - counts / (1.0 + counts)).abs() < 0.03,
            "{sigma_m}: {share}"
        );
    }
}

#[test]
fn after_a_blackout_a_good_measurement_is_accepted_because_the_scale_was_widened() {
    // The vehicle has drifted by 1.5 m in fifty rounds alone; its neighbour knows where it is.
    let (truth, drifted, neighbour) = (Node::identity(), shifted(1.5), shifted(-3.0));
    let mut widened = Contact::FRESH;
    let drift = Drift {
        rotation_rad: 0.0,
        translation_m: 3.0,
    };
    widened.widen(drift, 50.0, &Kernel::DEFAULT);
    let mut workspace = StarWorkspace::new();
    for (contact, expected, corrected_m) in [
        (Contact::FRESH, Judgement::Rejected, 0.0),
        // Two priors and one measurement share 1.5 m.
        (widened, Judgement::Accepted, 0.5),
    ] {
        let mut star = alone(drifted);
        add_seeing(&mut star, neighbour, contact, &truth, Kind::Pose);
        let solution = star.solve(&mut workspace, &Optimiser::gauss_newton());
        assert_eq!(judgements(&star, &workspace), [expected]);
        let corrected = 1.5 - solution.world_from_body.translation.x;
        assert!((corrected - corrected_m).abs() < 0.1, "{corrected} m");
    }
}

#[test]
fn when_everything_is_rejected_the_prior_stays() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let prior: Node = pose(&mut rng, 1.0, 3.0);
    let mut star = alone(prior);
    let mut workspace = StarWorkspace::new();
    for _ in 0..4 {
        let (other, lie): (Node, Node) = (pose(&mut rng, 1.0, 5.0), pose(&mut rng, 1.0, 5.0));
        let lie = Node::new(lie.rotation, lie.translation.add_scalar(30.0));
        add_seeing(&mut star, other, Contact::FRESH, &lie, Kind::Pose);
    }
    let solution = star.solve(&mut workspace, &Optimiser::gauss_newton());
    assert_eq!(judgements(&star, &workspace), [Judgement::Rejected; 4]);
    assert!(apart(&solution.world_from_body, &prior) < 1e-4);
}

#[test]
fn fixes_are_judged_by_their_own_contact() {
    let mut workspace = StarWorkspace::new();
    for (contact, expected) in [
        (Contact::FRESH, Judgement::Rejected),
        (Contact::LOST, Judgement::Accepted),
    ] {
        let mut star = alone(Node::identity());
        star.set_fix_contact(contact);
        let fix = Measurement::position(Vector3::new(20.0, 0.0, 0.0)).unwrap();
        star.fix(fix, FINE, Transform::identity()).unwrap();
        star.solve(&mut workspace, &Optimiser::gauss_newton());
        assert_eq!(judgements(&star, &workspace), [expected]);
        star.restart(Node::identity()).unwrap();
        star.fix(fix, FINE, Transform::identity()).unwrap();
        star.solve(&mut workspace, &Optimiser::gauss_newton());
        assert_eq!(judgements(&star, &workspace), [Judgement::Rejected]);
    }
}

#[test]
fn a_coarse_sensor_is_not_rejected_for_its_own_noise() {
    // 0.6 m off: beyond the floor, and two standard deviations of this sensor.
    let mut workspace = StarWorkspace::new();
    for (sigma_m, expected) in [(0.01, Judgement::Rejected), (0.3, Judgement::Accepted)] {
        let mut star = alone(Node::identity());
        let index = star.add_neighbour(shifted(4.0), Contact::FRESH).unwrap();
        let noise = Noise {
            translation: sigma_m,
            ..FINE
        };
        let end = Transform::identity();
        let distance = Measurement::distance(4.6).unwrap();
        star.measured_by_me(index, distance, noise, end, end)
            .unwrap();
        star.solve(&mut workspace, &Optimiser::gauss_newton());
        assert_eq!(judgements(&star, &workspace), [expected]);
    }
}

#[test]
fn a_vehicle_without_a_pose_is_placed_only_by_what_was_accepted() {
    let truth = Node::identity();
    let mut workspace = StarWorkspace::new();
    let mut star = alone(truth);
    // One neighbour knows where the vehicle is but not how it is turned; another says both, and is wrong.
    star.restart_unanchored(truth).unwrap();
    let (near, liar) = (shifted(3.0), shifted(-3.0));
    add_seeing(&mut star, near, Contact::FRESH, &truth, Kind::Position);
    add_seeing(&mut star, liar, Contact::FRESH, &shifted(9.0), Kind::Pose);
    for optimiser in [Optimiser::gauss_newton(), Optimiser::descent()] {
        let solution = star.solve(&mut workspace, &optimiser);
        assert_eq!(
            judgements(&star, &workspace),
            [Judgement::Accepted, Judgement::Rejected]
        );
        assert_eq!(solution.unobservable, 3, "{optimiser:?}");
        assert_eq!(
            solution.status,
            SolveStatus::Degenerate(Degeneracy::Unobservable)
        );
    }
    star.restart_unanchored(shifted(0.4)).unwrap();
    add_seeing(&mut star, near, Contact::FRESH, &truth, Kind::Pose);
    let solution = star.solve(&mut workspace, &Optimiser::gauss_newton());
    assert_eq!(
        (solution.status, solution.unobservable),
        (SolveStatus::Converged, 0)
    );
    assert!(apart(&solution.world_from_body, &truth) < 1e-6);
}

#[test]
fn the_paper_accepts_everything_and_says_how_far_it_is_off() {
    let star = explicit();
    let mut workspace = StarWorkspace::new();
    assert_eq!(star.verdicts(&workspace).count(), 1, "the fix alone");
    star.solve(&mut workspace, &Optimiser::gauss_newton());
    let verdicts: Vec<Verdict> = star.verdicts(&workspace).collect();
    let ties: Vec<Tie> = verdicts.iter().map(|verdict| verdict.tie).collect();
    let (near, far) = (NeighbourIndex(0), NeighbourIndex(1));
    let order = [
        Tie::MeasuredByMe(near),
        Tie::MeasuredByNeighbour(near),
        Tie::MeasuredByNeighbour(far),
        Tie::MeasuredByMe(far),
        Tie::MeasuredByMe(far),
        Tie::Fix,
    ];
    assert_eq!(ties, order);
    for verdict in verdicts {
        assert_eq!(verdict.judgement(), Judgement::Accepted);
        assert_eq!((verdict.weight, verdict.scale), (1.0, None));
    }
}

#[test]
fn whatever_is_given_the_answer_is_a_pose_and_the_cost_does_not_rise() {
    let absurd = [0.0, 1e-12, 1.0, 1e6, 1e100, 1e200];
    let half_turn = so3::exp(&Vector3::new(PI, 0.0, 0.0));
    let mut workspace = StarWorkspace::new();
    for weighting in [Weighting::Unit, Weighting::Noise] {
        let robust = Robust {
            weighting,
            ..Robust::DEFAULT
        };
        for (x, kind) in absurd.iter().flat_map(|x| KINDS.map(|kind| (*x, kind))) {
            for optimiser in [Optimiser::gauss_newton(), Optimiser::descent()] {
                let mut star = with(robust, shifted(x));
                let index = star
                    .add_neighbour(Node::identity(), Contact::FRESH)
                    .unwrap();
                let end = Transform::identity();
                let told = seen(kind, &Transform::new(half_turn, Vector3::x()));
                let added = star.measured_by_me(index, told, FINE, end, end);
                let solution = star.solve(&mut workspace, &optimiser);
                assert!(solution.world_from_body.is_valid(), "{x} {kind:?}");
                if solution.status != SolveStatus::NotFinite {
                    assert!(solution.cost_after <= solution.cost_before);
                }
                let weights = star.verdicts(&workspace).map(|verdict| verdict.weight);
                let accepted = weights.filter(|weight| *weight >= ACCEPTED_FROM).count();
                assert!(added.is_ok() || accepted == 0);
            }
        }
    }
}

#[test]
fn settings_that_judge_nothing_are_refused() {
    for floor in [0.0, f64::NAN, f64::INFINITY] {
        let kernel = Kernel {
            translation_floor_m: floor,
            ..Kernel::DEFAULT
        };
        let silent = Noise {
            rotation_rad: 0.02,
            translation: 1e-300,
        };
        let mut star = with(
            Robust {
                kernel,
                ..Robust::DEFAULT
            },
            Node::identity(),
        );
        let fix = Measurement::orientation(UnitQuaternion::identity()).unwrap();
        assert_eq!(
            star.fix(fix, silent, Transform::identity()),
            Err(Refusal::BadWeight),
            "{floor}"
        );
    }
}
