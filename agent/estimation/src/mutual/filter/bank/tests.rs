//! The bank's own bounds.

use super::*;
use crate::mutual::filter::mixture::{Answer, Tempering};
use nalgebra::Matrix3;

fn everywhere(first: usize) -> Mixture {
    let answers: Vec<_> = (first..first + COMPONENTS_MAX)
        .map(|i| Answer {
            direction: direction::from_angles(0.35 * i as f64, 1.0 + 0.03 * i as f64),
            yaw_rad: 0.7 * i as f64,
            covariance_rad2: Matrix3::identity() * 0.005,
            log_likelihood: 0.0,
            own_feature: Some(i),
        })
        .collect();
    Mixture::new(&answers, &[], &Tempering::CAUTIOUS).unwrap()
}

#[test]
fn there_are_never_more_hypotheses_than_stated() {
    let mut bank = Bank::born(BankSettings::QUADROTOR, &everywhere(0));
    for round in 1..6 {
        bank.update(&everywhere(5 * round));
        assert!(bank.hypotheses.len() <= HYPOTHESES_MAX);
        let sum: f64 = bank.hypotheses.iter().map(|h| h.weight).sum();
        assert!((sum - 1.0).abs() < 1e-9);
    }
}

#[test]
fn what_has_become_the_same_is_one() {
    let mut bank = Bank::born(BankSettings::QUADROTOR, &everywhere(0));
    bank.hypotheses.truncate(2);
    bank.hypotheses[1] = bank.hypotheses[0].clone();
    bank.prune();
    assert_eq!(bank.hypotheses.len(), 1);
    assert!((bank.hypotheses[0].weight - 1.0).abs() < 1e-12);
}
