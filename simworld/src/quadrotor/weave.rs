//! To and fro along each axis, each with its own frequency: how the quadrotors of the scenarios `square` and `eight` fly.
//!
//! The formulas are in the frame in which the paper writes, x north, y east, z down, headings clockwise from north
//! (Cognetti et al., section II). They leave it here, once, in [`Weave::place_at`].

use super::course::Place;
use super::ramp::Smooth;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// Which team.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WeaveOf {
    /// Four that start in a level square, which looks the same from each of them.
    Square,
    /// Eight in two columns at several heights.
    Eight,
}

/// One robot of one of the two teams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weave {
    /// Which team.
    pub team: WeaveOf,
    /// Which robot of it, from 1.
    pub robot: usize,
}

impl WeaveOf {
    /// How many robots it has.
    #[must_use]
    pub const fn robots(self) -> usize {
        match self {
            Self::Square => 4,
            Self::Eight => 8,
        }
    }
}

/// A scalar with its first and second derivative in time.
type Derivatives = [f64; 3];

impl Weave {
    /// Where it starts: north, east, down, metres.
    fn p0(self) -> Vector3<f64> {
        let k = self.robot as f64;
        match self.team {
            WeaveOf::Square => {
                // Clockwise from the south-west.
                const CORNERS: [(f64, f64); 4] =
                    [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)];
                let (north, east) = CORNERS[self.robot.saturating_sub(1) % CORNERS.len()];
                Vector3::new(north, east, -2.5)
            }
            WeaveOf::Eight => {
                let place = self.robot.saturating_sub(1);
                let (c, q) = ((place % 2) as f64, (place / 2) as f64);
                Vector3::new(
                    -1.8 + 3.6 * c + 0.4 * (2.1 * k).sin(),
                    -4.2 + 2.8 * q + 0.3 * (1.7 * k).cos(),
                    -2.6 - 1.1 * (2.4 * k).sin(),
                )
            }
        }
    }

    /// Amplitude along each axis, metres.
    fn amplitude_m(self) -> Vector3<f64> {
        let k = self.robot;
        let step = |times: usize, plus: usize, modulo: usize| ((times * k + plus) % modulo) as f64;
        match self.team {
            WeaveOf::Square => Vector3::new(
                1.1 + 0.1 * step(3, 0, 4),
                1.2 + 0.1 * step(5, 1, 4),
                0.6 + 0.15 * step(1, 0, 3),
            ),
            WeaveOf::Eight => Vector3::new(
                0.8 + 0.1 * step(3, 0, 4),
                0.7 + 0.1 * step(5, 1, 3),
                0.5 + 0.12 * step(1, 0, 3),
            ),
        }
    }

    /// Angular frequency along each axis, rad/s.
    fn w(self) -> Vector3<f64> {
        let k = self.robot;
        Vector3::new(
            0.55 + 0.09 * ((2 * k) % 5) as f64,
            0.6 + 0.08 * ((3 * k + 1) % 5) as f64,
            0.7 + 0.1 * ((k + 2) % 4) as f64,
        )
    }

    /// Phase along each axis, radians.
    fn phase(self) -> Vector3<f64> {
        let k = self.robot as f64;
        Vector3::new(1.3 * k, 0.7 + 2.1 * k, 0.4 + 1.7 * k)
    }

    /// Heading clockwise from north, radians.
    fn psi(self, t_s: f64) -> Derivatives {
        let k = self.robot as f64;
        let amplitude = 0.7 + 0.1 * (self.robot % 3) as f64;
        let w = 0.3 + 0.05 * (self.robot % 4) as f64;
        let swing = swing(t_s, amplitude, w, 1.1 * k);
        [0.9 * k * k + swing[0], swing[1], swing[2]]
    }

    pub(super) fn place_at(self, t_s: f64) -> Place {
        let (p0, amplitude, w, phase) = (self.p0(), self.amplitude_m(), self.w(), self.phase());
        // p(t) = p0 + r(t) A * sin(w t + ph), axis by axis: north, east, down.
        let axes: [Derivatives; 3] = [0, 1, 2].map(|axis| {
            let [value, rate, rate2] = swing(t_s, amplitude[axis], w[axis], phase[axis]);
            [p0[axis] + value, rate, rate2]
        });
        let psi = self.psi(t_s);
        let in_world = |order: usize| Vector3::new(axes[1][order], axes[0][order], -axes[2][order]);
        Place {
            position_m: in_world(0),
            velocity_m_s: in_world(1),
            acceleration_m_s2: in_world(2),
            heading_rad: FRAC_PI_2 - psi[0],
            heading_rate_rad_s: -psi[1],
        }
    }
}

/// `r(t) A sin(w t + ph)` with its derivatives, where `r` is the start of the motion.
fn swing(t_s: f64, amplitude: f64, w: f64, phase: f64) -> Derivatives {
    let r = Smooth::start(t_s);
    let (sin, cos) = (w * t_s + phase).sin_cos();
    [
        amplitude * r.value * sin,
        amplitude * (r.rate_per_s * sin + r.value * w * cos),
        amplitude * (r.rate_per_s2 * sin + 2.0 * r.rate_per_s * w * cos - r.value * w * w * sin),
    ]
}
