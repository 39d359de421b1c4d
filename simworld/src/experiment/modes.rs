//! Which mode of the cooperative pipeline a daemon should fly in: each one over section V with everything that goes wrong
//! outside a laboratory, flown by the production vehicle and codec.

use crate::fleet::Fleet;
use crate::plot::{self, Bar, BarGroup, PlotError};
use crate::radio::Silence;
use crate::scenario::Scenario;
use crate::sensor::{Wrong, WrongBurst};
use crate::world::nanos;
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::cooperative::{AnchorWeight, Kernel, Mode, Robust, Weighting};
use std::fmt::Write;

/// The share of measurements that are wrong in the rows with outliers.
const OUTLIERS: f64 = 0.2;
/// Rounds of the blackout: nobody's packets get through, while sensors go on seeing.
const BLACKOUT: std::ops::Range<u32> = 20..70;
/// A sensor in six is wrong at any time, for two seconds in a row.
const BURST: WrongBurst = WrongBurst {
    start_probability: 0.02,
    rounds: 10,
    wrong: Wrong::Displaced,
};
/// A kernel of this scale (rad and m) weighs everything in a flight alike.
const NO_KERNEL: f64 = 1e4;

/// What goes wrong on section V.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// Nothing.
    Clean,
    /// One measurement in five is anything in range.
    Gross,
    /// One measurement in five is off by 3 to 10 standard deviations.
    Moderate,
    /// One measurement in five is off by about 0.9 m and 0.35 rad.
    Displaced,
    /// Each sensor is now and then off by one such error for two seconds.
    Bursts,
    /// The radio is silent from round 20 to round 70.
    Blackout,
    /// Gross outliers, and the blackout.
    GrossAndBlackout,
    /// 30 % of all packets are lost.
    Loss,
    /// Every packet takes 100 ms.
    Delay,
    /// Packets take 50 to 150 ms, one in ten 200 ms more, and one in ten comes twice.
    Harsh,
}

/// All of them, in the order of the table.
pub const FAULTS: [Fault; 10] = [
    Fault::Clean,
    Fault::Gross,
    Fault::Moderate,
    Fault::Displaced,
    Fault::Bursts,
    Fault::Blackout,
    Fault::GrossAndBlackout,
    Fault::Loss,
    Fault::Delay,
    Fault::Harsh,
];

/// How the fleet flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Mode `paper`.
    Paper,
    /// Mode `star` with its default settings.
    Star,
    /// The same without its kernel: what its weights alone are worth.
    StarWithoutKernel,
    /// Mode `star` with measurements weighed by their stated noise, and anchors of 20 mrad and 5 mm.
    StarByNoise,
    /// Mode `team`.
    Team,
}

/// All of them, in the order of the table.
pub const METHODS: [Method; 5] = [
    Method::Paper,
    Method::Star,
    Method::StarWithoutKernel,
    Method::StarByNoise,
    Method::Team,
];

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Samples a cell.
    pub samples: u64,
    /// Seed of all random streams. Every method flies the same samples.
    pub seed: u64,
}

/// The result of one cell: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellResult {
    /// How the fleets flew.
    pub method: Method,
    /// What went wrong.
    pub fault: Fault,
    /// How many samples.
    pub samples: u64,
    /// First seed.
    pub seed: u64,
    /// Root of the mean of |e|^2 over all robots and samples at the end (k = 100), metres.
    pub rmse_m: f64,
    /// Its standard error, metres: robots of one flight are not independent, flights are.
    pub stderr_m: f64,
    /// The same root of the worst flight, metres.
    pub worst_flight_m: f64,
    /// The same root of odometry alone, metres.
    pub dead_reckoning_m: f64,
    /// Measurements that went into solutions, a flight.
    pub fused: f64,
    /// Measurements that the kernel rejected, a flight.
    pub gated: f64,
    /// Quarantines that began, a flight.
    pub quarantines: f64,
    /// Mean of |e|^2 over the robots of each flight, m^2.
    #[serde(skip)]
    pub squares_m2: Vec<f64>,
}

impl Fault {
    /// Section V with what goes wrong.
    #[must_use]
    pub fn scenario(self, seed: u64) -> Scenario {
        let base = if self == Self::Harsh {
            "section-v-harsh"
        } else {
            "section-v"
        };
        let mut scenario = Scenario::built_in(base).expect("built in");
        scenario.seed = seed;
        let wrong = |wrong| {
            let mut false_positives = scenario.sensor.false_positives;
            false_positives.wrong_probability = OUTLIERS;
            false_positives.wrong = wrong;
            false_positives
        };
        let blackout = Silence {
            from_s: f64::from(BLACKOUT.start) * scenario.period_s,
            to_s: f64::from(BLACKOUT.end) * scenario.period_s,
            vehicles: Vec::new(),
        };
        match self {
            Self::Clean | Self::Harsh => {}
            Self::Gross => scenario.sensor.false_positives = wrong(Wrong::Gross),
            Self::Moderate => scenario.sensor.false_positives = wrong(Wrong::Moderate),
            Self::Displaced => scenario.sensor.false_positives = wrong(Wrong::Displaced),
            Self::Bursts => scenario.sensor.false_positives.burst = Some(BURST),
            Self::Blackout => scenario.radio.silences = vec![blackout],
            Self::GrossAndBlackout => {
                scenario.sensor.false_positives = wrong(Wrong::Gross);
                scenario.radio.silences = vec![blackout];
            }
            Self::Loss => scenario.radio.loss = 0.3,
            Self::Delay => scenario.radio.delay_s = 0.1,
        }
        scenario
    }

    /// What the table calls it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Clean => "clean",
            Self::Gross => "20 % gross",
            Self::Moderate => "20 % of 3-10 sigma",
            Self::Displaced => "20 % displaced",
            Self::Bursts => "bursts",
            Self::Blackout => "blackout",
            Self::GrossAndBlackout => "gross, blackout",
            Self::Loss => "30 % loss",
            Self::Delay => "100 ms",
            Self::Harsh => "harsh radio",
        }
    }
}

impl Method {
    /// Its mode.
    #[must_use]
    pub const fn mode(self) -> Mode {
        let robust = Robust::DEFAULT;
        match self {
            Self::Paper => Mode::Paper,
            Self::Team => Mode::Team,
            Self::Star => Mode::Star(robust),
            Self::StarWithoutKernel => Mode::Star(Robust {
                kernel: Kernel {
                    rotation_floor_rad: NO_KERNEL,
                    translation_floor_m: NO_KERNEL,
                    ..Kernel::DEFAULT
                },
                ..robust
            }),
            Self::StarByNoise => Mode::Star(Robust {
                weighting: Weighting::Noise,
                anchor: AnchorWeight {
                    rotation: 1.0 / (0.02 * 0.02),
                    translation: 1.0 / (0.005 * 0.005),
                },
                oriented_rotation: 1.0 / (0.02 * 0.02),
                ..robust
            }),
        }
    }

    /// What the table calls it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Star => "star",
            Self::Team => "team",
            Self::StarWithoutKernel => "star, no kernel",
            Self::StarByNoise => "star, by noise",
        }
    }
}

/// What one flight came to.
#[derive(Clone, Copy, Debug)]
struct Flown {
    square_m2: f64,
    reckoned_m2: f64,
    fused: u64,
    gated: u64,
    quarantines: u64,
}

/// Flies every sample of a cell. `flown` is called after each, from any thread.
#[must_use]
pub fn run(method: Method, fault: Fault, request: Request, flown: impl Fn() + Sync) -> CellResult {
    let scenario = fault.scenario(request.seed);
    let flights: Vec<Flown> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let flight = fly(&scenario, sample, method.mode());
            flown();
            flight
        })
        .collect();
    let squares_m2: Vec<f64> = flights.iter().map(|flight| flight.square_m2).collect();
    let reckoned_m2: Vec<f64> = flights.iter().map(|flight| flight.reckoned_m2).collect();
    let (rmse_m, stderr_m) = root_mean(&squares_m2);
    let per_flight = |of: fn(&Flown) -> u64| {
        flights.iter().map(|flight| of(flight) as f64).sum::<f64>() / flights.len() as f64
    };
    CellResult {
        method,
        fault,
        samples: request.samples,
        seed: request.seed,
        rmse_m,
        stderr_m,
        worst_flight_m: squares_m2.iter().copied().fold(0.0, f64::max).sqrt(),
        dead_reckoning_m: root_mean(&reckoned_m2).0,
        fused: per_flight(|flight| flight.fused),
        gated: per_flight(|flight| flight.gated),
        quarantines: per_flight(|flight| flight.quarantines),
        squares_m2,
    }
}

fn fly(scenario: &Scenario, sample: u64, mode: Mode) -> Flown {
    let in_mode = |_, config| skein_vehicle::Config { mode, ..config };
    let mut fleet = Fleet::with_configs(scenario, sample, in_mode);
    let (end_ns, period_ns) = (nanos(scenario.duration_s), nanos(scenario.period_s));
    // The world prepares a round one period ahead: until the end is handled, its odometry reaches exactly to the end.
    fleet.run_until(end_ns);
    let team = fleet.len();
    let reckoned = |vehicle| {
        let truth = fleet.stage().pose(vehicle, end_ns).translation.vector;
        (fleet.stage().dead_reckoning(vehicle).translation.vector - truth).norm_squared()
    };
    let reckoned_m2 = (0..team).map(reckoned).sum::<f64>() / team as f64;
    // Just before the next round, so that what can be heard of this one by then has been heard.
    fleet.run_until(end_ns + period_ns);
    let square = |vehicle| fleet.position_error_m(vehicle).powi(2);
    let neighbours = || {
        (0..team)
            .filter_map(|vehicle| fleet.health(vehicle))
            .flat_map(|health| health.neighbours.values())
    };
    Flown {
        square_m2: (0..team).map(square).sum::<f64>() / team as f64,
        reckoned_m2,
        fused: neighbours().map(|neighbour| neighbour.fused).sum(),
        gated: neighbours()
            .filter_map(|neighbour| neighbour.refused.get("gated"))
            .sum(),
        quarantines: neighbours().map(|neighbour| neighbour.quarantines).sum(),
    }
}

/// The root of the mean of independent squares, and its standard error by the delta method.
#[must_use]
pub fn root_mean(squares: &[f64]) -> (f64, f64) {
    let n = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / n;
    let variance = squares.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let root = mean.sqrt();
    (root, (variance / n).sqrt() / (2.0 * root))
}

/// The ratio of the root means of two lists of squares of the same flights, and its standard error (delta method,
/// flight by flight).
#[must_use]
pub fn ratio_of_root_means(squares: &[f64], others: &[f64]) -> (f64, f64) {
    let n = squares.len().min(others.len()) as f64;
    let mean = |squares: &[f64]| squares.iter().sum::<f64>() / n;
    let (above, below) = (mean(squares), mean(others));
    let squared = above / below;
    let off = squares.iter().zip(others);
    let off = off.map(|(above, below)| (above - squared * below).powi(2));
    let variance = off.sum::<f64>() / (n - 1.0) / n / below.powi(2);
    (squared.sqrt(), variance.sqrt() / (2.0 * squared.sqrt()))
}

/// What mode `star` is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// What is bounded.
    pub what: &'static str,
    /// What came out.
    pub value: f64,
    /// Its standard error.
    pub stderr: f64,
    /// The most that it should be.
    pub most: f64,
}

/// The bounds of mode `star`, [`Method::Star`], beside what came out; without those whose cells were not flown.
#[must_use]
pub fn bounds(results: &[CellResult]) -> Vec<Bound> {
    let cell = |method, fault| {
        results
            .iter()
            .find(|result| (result.method, result.fault) == (method, fault))
    };
    let star = |fault| cell(Method::Star, fault);
    let metres = [
        ("clean, m", Fault::Clean, 0.24),
        ("20 % gross outliers, m", Fault::Gross, 0.30),
        (
            "gross outliers and blackout, m",
            Fault::GrossAndBlackout,
            1.6,
        ),
        ("30 % loss, m", Fault::Loss, 0.36),
    ];
    let metres = metres.into_iter().filter_map(|(what, fault, most)| {
        let (value, stderr) = star(fault).map(|result| (result.rmse_m, result.stderr_m))?;
        Some(Bound {
            what,
            value,
            stderr,
            most,
        })
    });
    let ratios = [
        (
            "blackout over the same without kernel",
            star(Fault::Blackout),
            cell(Method::StarWithoutKernel, Fault::Blackout),
        ),
        (
            "harsh radio over 100 ms",
            star(Fault::Harsh),
            star(Fault::Delay),
        ),
        (
            "harsh radio over clean",
            star(Fault::Harsh),
            star(Fault::Clean),
        ),
    ];
    let ratios = ratios.into_iter().filter_map(|(what, above, below)| {
        let (value, stderr) = ratio_of_root_means(&above?.squares_m2, &below?.squares_m2);
        Some(Bound {
            what,
            value,
            stderr,
            most: 1.1,
        })
    });
    metres.chain(ratios).collect()
}

/// The results as people read them.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut text = String::from("team RMSE at the end, m");
    for method in METHODS {
        let _ = write!(text, "  {:>17}", method.name());
    }
    text += "    odometry  gated %  quarantines (star, a flight)\n";
    for fault in FAULTS {
        let _ = write!(text, "{:<23}", fault.name());
        let mut star = None;
        for method in METHODS {
            let found = results
                .iter()
                .find(|result| (result.method, result.fault) == (method, fault));
            let shown = found.map_or_else(String::new, |result| {
                format!("{:.3} +- {:.3}", result.rmse_m, result.stderr_m)
            });
            let _ = write!(text, "  {shown:>17}");
            star = star.or(found.filter(|_| method == Method::Star));
        }
        if let Some(star) = star {
            let _ = write!(
                text,
                "  {:>8.2}  {:>8.1}  {:>7.2}",
                star.dead_reckoning_m,
                100.0 * star.gated / (star.gated + star.fused),
                star.quarantines,
            );
        }
        text += "\n";
    }
    text += "\nasked of mode star:\n";
    for bound in bounds(results) {
        let kept = if bound.value <= bound.most {
            "kept"
        } else {
            "NOT KEPT"
        };
        let _ = writeln!(
            text,
            "  {:<38} {:.3} +- {:.3}  at most {:.2}  {kept}",
            bound.what, bound.value, bound.stderr, bound.most
        );
    }
    text
}

/// Every cell, one row each.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    let mut text = String::from(
        "method,fault,samples,seed,rmse_m,stderr_m,worst_flight_m,dead_reckoning_m,fused,gated,quarantines\n",
    );
    for result in results {
        let _ = writeln!(
            text,
            "\"{}\",\"{}\",{},{},{},{},{},{},{},{},{}",
            result.method.name(),
            result.fault.name(),
            result.samples,
            result.seed,
            result.rmse_m,
            result.stderr_m,
            result.worst_flight_m,
            result.dead_reckoning_m,
            result.fused,
            result.gated,
            result.quarantines,
        );
    }
    text
}

/// All cells as bars. Bars that are higher than what mode `star` needs are cut and keep their number.
///
/// # Errors
/// [`PlotError`] when there is nothing to draw.
pub fn figure(results: &[CellResult]) -> Result<String, PlotError> {
    let group = |fault: Fault| BarGroup {
        label: fault.name().to_owned(),
        bars: METHODS
            .iter()
            .filter_map(|method| {
                results
                    .iter()
                    .find(|result| (result.method, result.fault) == (*method, fault))
            })
            .map(|result| Bar {
                label: result.method.name().to_owned(),
                height: result.rmse_m,
                stderr: result.stderr_m,
            })
            .collect(),
    };
    let groups: Vec<BarGroup> = FAULTS.into_iter().map(group).collect();
    let star = results
        .iter()
        .filter(|result| result.method == Method::Star);
    let highest = star.map(|result| result.rmse_m).fold(0.0, f64::max);
    plot::bars(
        "Section V, five robots, k = 100: RMSE of the team, m",
        &groups,
        1.3 * highest,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_makes_another_scenario_and_every_method_another_mode() {
        for (nth, fault) in FAULTS.iter().enumerate() {
            let same = |other: &&Fault| fault.scenario(1) == other.scenario(1);
            assert_eq!(FAULTS[nth..].iter().filter(same).count(), 1, "{fault:?}");
        }
        for (nth, method) in METHODS.iter().enumerate() {
            let same = |other: &&Method| method.mode() == other.mode();
            assert_eq!(METHODS[nth..].iter().filter(same).count(), 1, "{method:?}");
        }
    }

    #[test]
    fn a_root_mean_and_a_ratio_by_hand() {
        // Squares 1 and 7: mean 4, variance 18, standard error of the mean 3, of the root 3 / (2 * 2).
        let (root, stderr) = root_mean(&[1.0, 7.0]);
        assert!((root - 2.0).abs() < 1e-12 && (stderr - 0.75).abs() < 1e-12);
        // Twice the error in each flight is twice the error, without any doubt.
        let (ratio, stderr) = ratio_of_root_means(&[4.0, 28.0], &[1.0, 7.0]);
        assert!((ratio - 2.0).abs() < 1e-12 && stderr < 1e-12);
    }

    #[test]
    fn outliers_are_fatal_to_the_paper_and_not_to_the_star() {
        let request = Request {
            samples: 4,
            seed: 1,
        };
        let cells =
            [Method::Paper, Method::Star].map(|method| run(method, Fault::Gross, request, || ()));
        let [paper, star] = &cells;
        assert!(star.rmse_m < 0.5 * star.dead_reckoning_m, "{star:?}");
        assert!(paper.rmse_m > paper.dead_reckoning_m, "{paper:?}");
        let share = star.gated / (star.gated + star.fused);
        assert!((0.1..0.3).contains(&share) && paper.gated == 0.0, "{share}");
        assert!(table(&cells).contains("NOT KEPT") || table(&cells).contains("kept"));
        assert_eq!(csv(&cells).lines().count(), 3);
        assert!(figure(&cells).is_ok());
    }
}
