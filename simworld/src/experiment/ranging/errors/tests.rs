//! The errors study, a little of it.

use super::*;

const FEW: Request = Request {
    samples: 24,
    seed: 1,
};

fn of(method: Method, noise: SwarmNoise) -> MethodResult {
    run(&[method], noise, FEW, || {}).remove(0)
}

#[test]
fn a_bank_is_nearly_as_good_as_any_filter_can_be_and_as_good_as_it_says() {
    let bank = of(Method::Bank(6), SwarmNoise::USUAL);
    assert!((0.7..1.5).contains(&bank.position_ratio.mean), "{bank:?}");
    assert!(
        (0.7..1.5).contains(&bank.orientation_ratio.mean),
        "{bank:?}"
    );
    let nees = bank.nees.unwrap();
    assert!((1.6..3.0).contains(&nees.median), "{bank:?}");
    assert!(nees.astray < 0.03 && bank.unanswered < 0.03, "{bank:?}");
    let window = of(Method::Window(6), SwarmNoise::USUAL);
    assert!(
        window.position_m2.mean > 2.0 * bank.position_m2.mean,
        "{window:?}"
    );
}

#[test]
fn a_longer_window_may_be_better_and_is() {
    let windows = WINDOWS.map(|ranges| of(Method::Window(ranges), SwarmNoise::USUAL));
    for pair in windows.windows(2) {
        let [shorter, longer] = pair else {
            unreachable!()
        };
        assert!(
            longer.position_bound_m2.mean < shorter.position_bound_m2.mean,
            "{pair:?}"
        );
        assert!(longer.orientation_bound_rad2.mean < shorter.orientation_bound_rad2.mean);
        assert!(
            longer.position_median_m < shorter.position_median_m,
            "{pair:?}"
        );
        assert!(
            longer.position_m2.mean < shorter.position_m2.mean,
            "{pair:?}"
        );
    }
}

#[test]
fn more_noise_of_any_kind_is_worse_for_the_bank_and_for_its_bound() {
    for axis in AXES {
        let values = axis.values();
        assert_eq!(axis.at(values[2]), SwarmNoise::USUAL);
        let [less, more] = [values[0], values[4]].map(|value| of(Method::Bank(6), axis.at(value)));
        assert!(
            more.position_bound_m2.mean > 1.5 * less.position_bound_m2.mean,
            "{axis:?}"
        );
        assert!(
            more.position_m2.mean > 1.5 * less.position_m2.mean,
            "{axis:?}"
        );
        assert!(
            more.orientation_rad2.mean > 1.5 * less.orientation_rad2.mean,
            "{axis:?}"
        );
    }
    assert_eq!(noises().len(), 13);
}

#[test]
fn both_of_a_pair_find_each_other_when_hardly_anything_is_wrong() {
    let clean = SwarmNoise {
        range_sigma_m: 1e-3,
        translation_sigma_m: 1e-4,
        rotation_sigma_rad: 1e-5,
        outliers: 0.0,
    };
    let together = Pair::gone(Turns::Together, ROUNDS, clean, &Streams::new(2, 0));
    let alternating = Pair::gone(
        Turns::Alternating,
        ALTERNATING_ROUNDS + 1,
        clean,
        &Streams::new(2, 0),
    );
    for method in methods(&SwarmNoise::USUAL) {
        let pair = match method.turns() {
            Turns::Together => &together,
            Turns::Alternating => &alternating,
        };
        let trial = Trial::of(method, pair);
        let asked = 2 * (method.last_round() + 1 - method.scored_from());
        assert_eq!(
            (trial.asked, trial.answers.len()),
            (asked, asked),
            "{method:?}"
        );
        // Three distances leave several places, and plain trilateration keeps a flip that it once took.
        let is_unsure = matches!(
            method,
            Method::Window(3) | Method::Tracked(3) | Method::Trilateration
        );
        if !is_unsure {
            let near = trial
                .answers
                .iter()
                .filter(|one| one.off_m < 0.2 && one.off_rad < 0.05);
            assert!(10 * near.count() >= 9 * asked, "{method:?}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_figures_and_another_seed_others() {
    let methods = [Method::Bank(6), Method::TrilaterationBank];
    let of = |seed| {
        let request = Request { samples: 3, seed };
        run(&methods, SwarmNoise::USUAL, request, || {})
    };
    assert_eq!(of(1), of(1));
    assert_ne!(of(1)[0].position_m2, of(2)[0].position_m2);
    assert_ne!(of(1)[1].position_m2, of(2)[1].position_m2);
}

#[test]
fn every_noise_and_method_is_in_the_table_the_spreadsheet_and_the_figure() {
    let request = Request {
        samples: 2,
        seed: 1,
    };
    let results: Vec<MethodResult> = noises()
        .into_iter()
        .flat_map(|noise| run(&methods(&noise), noise, request, || {}))
        .collect();
    let csv = report::csv(&results);
    let columns = |line: &str| line.split(',').count();
    assert!(
        csv.lines()
            .all(|line| columns(line) == columns(csv.lines().next().unwrap()))
    );
    assert_eq!(csv.lines().count(), 1 + results.len());
    let table = report::table(&results);
    assert!(
        table.contains("bank from 6 over its recursive bound"),
        "{table}"
    );
    for method in methods(&SwarmNoise::USUAL) {
        let rows = table
            .lines()
            .filter(|line| line.starts_with(&format!("{} ", method.name())));
        let tracked = matches!(method, Method::Tracked(_));
        assert!(
            rows.count() >= if tracked { 1 } else { 7 },
            "{method:?} {table}"
        );
    }
    let figure = report::figure(&results).unwrap();
    for axis in AXES {
        assert_eq!(figure.matches(axis.name()).count(), 2);
    }
    assert!(report::figure(&[]).is_err());
}
