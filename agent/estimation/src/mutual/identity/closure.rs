//! The relative yaws of three vehicles close: what two pairs say of a third, read out of the pair models.
//!
//! It is read out only, from what the models have seen themselves. Multiplied into the models at every epoch the same
//! evidence would be counted again and again, and wrong modes would lock for good.

use super::pair_model::{PairModel, YAW_BINS, YawBelief};

/// How often the yaws are made to agree.
const ROUNDS: usize = 2;
/// Share of doubt in what a third vehicle says.
const DOUBT: f64 = 0.2;
/// Bins less likely than this are passed over.
const NEGLIGIBLE: f64 = 1e-6;

/// What is read out of one pair.
#[derive(Clone, Debug)]
pub(super) struct Readout {
    /// Probability of the relative yaw.
    pub(super) yaw: YawBelief,
    /// For each lane of the first and of the second vehicle, the probability that it is the other one.
    pub(super) lanes: [Vec<f64>; 2],
}

/// Where the pair of members `first` < `second` is in a list of all pairs, whatever the number of members.
pub(super) fn pair_index(first: usize, second: usize) -> usize {
    second * (second - 1) / 2 + first
}

/// Reads all pairs of `members` vehicles; `models` is ordered by [`pair_index`].
pub(super) fn read(models: &[PairModel], members: usize) -> Vec<Readout> {
    let direct: Vec<YawBelief> = models.iter().map(PairModel::yaw).collect();
    let mut yaws = direct.clone();
    let mut weights = vec![[1.0; YAW_BINS]; models.len()];
    for _ in 0..ROUNDS {
        for second in 1..members {
            for first in 0..second {
                weights[pair_index(first, second)] = agreement(&yaws, members, first, second);
            }
        }
        for ((yaw, direct), weight) in yaws.iter_mut().zip(&direct).zip(&weights) {
            *yaw = normalised(direct, weight);
        }
    }
    models
        .iter()
        .zip(yaws)
        .zip(&weights)
        .map(|((model, yaw), weight)| Readout {
            yaw,
            lanes: model.lanes(weight),
        })
        .collect()
}

/// How well each yaw of a pair agrees with what every third vehicle says of it; about one where that says nothing.
fn agreement(yaws: &[YawBelief], members: usize, first: usize, second: usize) -> YawBelief {
    let mut weight = [1.0; YAW_BINS];
    for third in (0..members).filter(|third| *third != first && *third != second) {
        let chained = sum(&between(yaws, first, third), &between(yaws, third, second));
        for (weight, chained) in weight.iter_mut().zip(chained) {
            *weight *= DOUBT + (1.0 - DOUBT) * YAW_BINS as f64 * chained;
        }
        // Sixteen factors of a hundred stay far from overflow, yet the greatest is kept at one.
        let greatest = weight.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        weight.iter_mut().for_each(|weight| *weight /= greatest);
    }
    weight
}

/// Belief of the yaw from one member to another, whichever is the first of their pair.
fn between(yaws: &[YawBelief], from: usize, to: usize) -> YawBelief {
    if from < to {
        return yaws[pair_index(from, to)];
    }
    let there = &yaws[pair_index(to, from)];
    std::array::from_fn(|bin| there[(YAW_BINS - bin) % YAW_BINS])
}

/// Distribution of the sum of two independent yaws.
fn sum(one: &YawBelief, other: &YawBelief) -> YawBelief {
    let mut sum = [0.0; YAW_BINS];
    for (shift, mass) in one
        .iter()
        .enumerate()
        .filter(|(_, mass)| **mass > NEGLIGIBLE)
    {
        let (head, tail) = sum.split_at_mut(shift);
        for (sum, other) in tail.iter_mut().zip(other) {
            *sum += mass * other;
        }
        for (sum, other) in head.iter_mut().zip(&other[YAW_BINS - shift..]) {
            *sum += mass * other;
        }
    }
    sum
}

fn normalised(direct: &YawBelief, weight: &YawBelief) -> YawBelief {
    let product: YawBelief = std::array::from_fn(|bin| direct[bin] * weight[bin]);
    let total: f64 = product.iter().sum();
    product.map(|mass| mass / total.max(f64::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(bin: usize) -> YawBelief {
        let mut belief = [0.002; YAW_BINS];
        belief[bin] = 1.0;
        normalised(&belief, &[1.0; YAW_BINS])
    }

    fn likeliest(yaw: &YawBelief) -> usize {
        (0..YAW_BINS)
            .max_by(|a, b| yaw[*a].total_cmp(&yaw[*b]))
            .unwrap_or(0)
    }

    #[test]
    fn every_pair_has_a_place_of_its_own_whatever_the_number_of_members() {
        let mut places = Vec::new();
        for second in 1..17 {
            for first in 0..second {
                places.push(pair_index(first, second));
            }
        }
        assert!(places.iter().copied().eq(0..places.len()));
    }

    #[test]
    fn a_pair_of_two_yaws_is_decided_by_a_third_vehicle() {
        // From 0 to 1 it is 10 bins, from 1 to 2 it is 25, so from 0 to 2 it is 35; seen alone it may be 80 as well.
        let mut either = [0.001; YAW_BINS];
        (either[35], either[80]) = (0.4, 0.5);
        let mut yaws = vec![near(10), either, near(25)];
        yaws[pair_index(1, 2)] = near(25);
        let weight = agreement(&yaws, 3, 0, 2);
        assert_eq!(likeliest(&normalised(&either, &weight)), 35);
    }

    #[test]
    fn a_yaw_back_is_the_yaw_there_the_other_way_round() {
        let yaws = vec![near(10)];
        assert_eq!(likeliest(&between(&yaws, 0, 1)), 10);
        assert_eq!(likeliest(&between(&yaws, 1, 0)), YAW_BINS - 10);
        let around = sum(&between(&yaws, 0, 1), &between(&yaws, 1, 0));
        assert_eq!(likeliest(&around), 0);
        assert!((around.iter().sum::<f64>() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn who_knows_nothing_changes_nothing() {
        let unknown = [1.0 / YAW_BINS as f64; YAW_BINS];
        let weight = agreement(&[near(10), unknown, unknown], 3, 0, 1);
        assert!(weight.iter().all(|weight| (*weight - 1.0).abs() < 1e-9));
    }

    #[test]
    fn a_third_vehicle_that_is_wrong_does_not_make_a_yaw_impossible() {
        let only =
            |bin: usize| -> YawBelief { std::array::from_fn(|at| f64::from(u8::from(at == bin))) };
        let weight = agreement(&[near(10), only(35), only(90)], 3, 0, 1);
        let least = weight.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least > 1e-3, "{least}");
    }
}
