//! The plain filter that a levelling filter has to beat (Mahony et al., without the bias): the gyro is integrated, and the
//! vertical pulled towards the direction of the force with a fixed gain.

use nalgebra::Vector3;

/// The vertical as such a filter sees it. It needs no attitude: the vertical alone turns with the body.
#[derive(Clone, Debug)]
pub struct FixedGain {
    gain_per_s: f64,
    up: Option<Vector3<f64>>,
}

impl FixedGain {
    /// A filter of this gain (1/s).
    #[must_use]
    pub const fn new(gain_per_s: f64) -> Self {
        Self {
            gain_per_s,
            up: None,
        }
    }

    /// Takes a reading in the body, so long after the one before (s), and gives straight up in the body.
    pub fn update(
        &mut self,
        elapsed_s: f64,
        rate_rad_s: &Vector3<f64>,
        force_m_s2: &Vector3<f64>,
    ) -> Vector3<f64> {
        let felt = force_m_s2.try_normalize(1e-6);
        let Some(up) = self.up.or(felt) else {
            return Vector3::z();
        };
        // What stands still in the world turns in the body with the opposite of the body's rate: u' = u x (w + k f x u).
        let pull = felt.map_or_else(Vector3::zeros, |felt| felt.cross(&up) * self.gain_per_s);
        let turn = (rate_rad_s + pull) * -elapsed_s;
        let turned = nalgebra::Rotation3::new(turn) * up;
        self.up = Some(turned.normalize());
        turned
    }
}
