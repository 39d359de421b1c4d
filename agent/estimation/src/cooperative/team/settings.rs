//! What the team estimator is told: how long its window is, how it weighs, and what it expects of odometry.

use crate::time::Span;

/// The settings of [`super::Team`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// How many rounds the window holds.
    pub lag: Lag,
    /// Of each vehicle, the others with which measurements are used at most, nearest first.
    pub nearest: usize,
    /// Squared innovation, in standard deviations and for six degrees of freedom, above which a new measurement fails
    /// the gate; in proportion for fewer.
    pub gate: f64,
    /// The Cauchy kernel's `c^2`: a measurement with squared residual `s` weighs `c2 / (c2 + s)`, one that failed the
    /// gate the square of it.
    pub cauchy: f64,
    /// Rounds at the start in which those that failed the gate weigh like the others, while the noise scales settle.
    pub settling_rounds: u32,
    /// Gauss-Newton iterations of a round; more while they still take it far.
    pub iterations: usize,
    /// What is expected of everybody's odometry.
    pub bias: BiasNoise,
    /// Standard deviation added to every round of odometry, radians and metres: that of a standing robot is zero.
    pub odometry_floor: (f64, f64),
}

/// The length of the window in rounds, by who is in it and what they measure. One rule for all flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lag {
    /// In general.
    pub usual: u32,
    /// With no more than [`Lag::SEVERAL`] vehicles.
    pub several: u32,
    /// While distances are measured.
    pub distances: u32,
    /// With no more than [`Lag::FEW`] vehicles, this one among them.
    pub few: u32,
    /// With more than [`Lag::MANY`] vehicles.
    pub many: u32,
}

impl Lag {
    /// So many are few: their common turn shows late.
    pub const FEW: usize = 3;
    /// So many are several: one wrong linearisation shows, and is affordable to avoid.
    pub const SEVERAL: usize = 5;
    /// More are many: the window's cost grows with the cube of the number.
    pub const MANY: usize = 12;

    pub(super) fn rounds(&self, members: usize, distances: bool) -> u32 {
        if members <= Self::FEW {
            self.few
        } else if members <= Self::SEVERAL {
            self.several
        } else if members > Self::MANY {
            self.many
        } else if distances {
            self.distances
        } else {
            self.usual
        }
    }
}

/// How far odometry may be off in the same way all the time, and how that changes.
///
/// Room for a bias is not free: with millimetre odometry a scale unknown by one in a thousand costs section V 4 % of its
/// accuracy, by 3 % it costs 8 %. So both begin narrow and get room when they leave the range in which they were expected.
/// A scale gets it with the first measurement that has a length in it, too, and is held at none as soon as the measurements
/// show none: to learn that late costs nothing, as the prior knows what the scale did to the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BiasNoise {
    /// Of the gyroscope: rad/s per axis.
    pub gyro: BiasRange,
    /// Of the odometer's scale: its share.
    pub scale: BiasRange,
    /// Standard deviations of what is expected, beyond which a bias gets room.
    pub room_beyond: f64,
    /// How many times as likely none must be as any within the room, before a bias is held at none.
    pub none_beyond: f64,
}

/// How one kind of bias is expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BiasRange {
    /// Standard deviation at the start.
    pub start: f64,
    /// The room that it gets when it leaves its range.
    pub room: f64,
    /// Standard deviation once it is held at none.
    pub held: f64,
    /// Its random walk, per root second.
    pub walk: f64,
}

impl Settings {
    /// The paper's period, for which the figures were found.
    const PERIOD_S: f64 = 0.2;
    /// Its root.
    const ROOT_PERIOD: f64 = 0.447_213_595_499_958;

    /// Found on the scenario of section V with five kinds, loss, outliers and wrong noise
    /// (`skein-sim experiment consistency`).
    pub const DEFAULT: Self = Self {
        lag: Lag {
            usual: 3,
            several: 8,
            distances: 5,
            few: 20,
            many: 1,
        },
        nearest: 6,
        gate: 100.0,
        cauchy: 20.0,
        settling_rounds: 30,
        iterations: 3,
        bias: BiasNoise {
            // A tenth of a milliradian a round, with room five: ten vehicles pay 4 % for a start of half a milliradian. It
            // walks as those of small gyroscopes do, 1e-5 rad/s per root second; twenty times as far cost a flight of 2000
            // rounds 4 %.
            gyro: BiasRange {
                start: 0.0001 / Self::PERIOD_S,
                room: 0.005 / Self::PERIOD_S,
                held: 0.0001 / Self::PERIOD_S,
                walk: 1e-6 / (Self::PERIOD_S * Self::ROOT_PERIOD),
            },
            scale: BiasRange {
                start: 3e-4,
                room: 0.03,
                held: 3e-4,
                walk: 1.5e-6 / Self::ROOT_PERIOD,
            },
            room_beyond: 3.0,
            none_beyond: 5.0,
        },
        odometry_floor: (1e-4, 1e-4),
    };
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Vehicles whose odometry is smoothed at most; beyond, the absent one that was heard longest ago is given up.
pub const MEMBERS_MAX: usize = 20;
/// Poses in the window at most; beyond, no more are taken but this vehicle's own.
pub const POSES_MAX: usize = 512;
/// Poses of one vehicle at most, this one too: what is kept for somebody who returns, and some more.
pub const POSES_OF_ONE_MAX: usize = 64;
/// Measurements in the window at most.
pub const EDGES_MAX: usize = 4096;
/// Measurements of one vehicle at most, this one too: no flood of one shuts out the others.
pub const EDGES_BY_ONE_MAX: usize = 512;
/// Standard deviations of a vehicle of which nobody said where it started: no more than a guard against directions that
/// nothing determines. Radians and metres. Odometry that knows less than that is taken for as much.
pub(super) const UNKNOWN_START: (f64, f64) = (3.0, 1e3);
/// Standard deviations below which nobody is believed, of a start or a measurement, radians and metres. Information is
/// their inverse square, and beside that of [`UNKNOWN_START`] the equations must keep their digits.
pub(super) const NOISE_MIN: (f64, f64) = (1e-5, 1e-5);
/// Farthest from this vehicle that another is followed, metres: levers of that length cost digits.
pub(super) const REACH_M: f64 = 1e5;
/// Longest lever from a body to the end of a measurement, metres; it holds the way since the round, too.
pub(super) const LEVER_MAX_M: f64 = 1e3;
/// Largest variance that odometry may state between two rounds, rad^2 or m^2: with larger ones what is left between angles
/// and lengths is rounding.
pub(super) const ODOMETRY_VARIANCE_MAX: f64 = 1e6;
/// A start that odometry has since made this uncertain in orientation, radians, says nothing any more.
pub(super) const WORN_START_RAD: f64 = 0.5;
/// Longest stretch of odometry over which a bias adds up along a path of constant twist; over a longer one it is noise.
pub(super) const BIASED_STRETCH_MAX: Span = Span::secs(4);
