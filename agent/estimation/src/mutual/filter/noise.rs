//! Noise that is cheap enough for every particle at every step.

use rand::Rng;

/// Numbers drawn at a time.
pub(super) const DRAWN: usize = 256;

/// Standard deviation of the sum of four bytes.
const SPREAD: f64 = 147.800_541_271_1;
const MEAN: f64 = 510.0;

/// Fills `noise` with numbers of mean zero and variance one that are nearly normal: the sum of four random bytes each.
///
/// Beyond 3.45 standard deviations there are none, and the fourth moment is 2.7 instead of 3: what the noise of many
/// steps adds up to is normal all the same. A normal deviate proper takes several times as long.
pub(super) fn fill(noise: &mut [f64], rng: &mut impl Rng) {
    let mut bytes = [0u8; 4 * DRAWN];
    for drawn in noise.chunks_mut(DRAWN) {
        let bytes = &mut bytes[..4 * drawn.len()];
        rng.fill_bytes(bytes);
        for (number, four) in drawn.iter_mut().zip(bytes.chunks_exact(4)) {
            let sum: i32 = four.iter().map(|&byte| i32::from(byte)).sum();
            *number = (f64::from(sum) - MEAN) / SPREAD;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn it_has_the_moments_it_says() {
        let mut noise = vec![0.0; 100_000];
        fill(&mut noise, &mut ChaCha8Rng::seed_from_u64(1));
        let moment = |power| noise.iter().map(|x: &f64| x.powi(power)).sum::<f64>() / 1e5;
        assert!(moment(1).abs() < 0.02);
        assert!((moment(2) - 1.0).abs() < 0.02);
        assert!((moment(4) - 2.7).abs() < 0.1);
    }
}
