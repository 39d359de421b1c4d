//! The cells of the study: who flies, what they measure, what goes wrong, and what is asked of the team estimator.

use super::hearing::{Air, is_one_half};
use super::history::{self, History};
use super::{fixes, mistakes, odometer};
use crate::experiment::solver_only::NotBare;
use crate::scenario::{Formation, Scenario, Team};
use crate::sensor::Kind;
use crate::streams::{Purpose, Streams};
use crate::world::World;
use nalgebra::Vector3;

/// Who errs in the cells in which one does.
pub const LIAR: usize = 1;
/// Who is told where it is in the cell with absolute fixes.
const FIXED: usize = 0;
/// The round in which two halves of a team meet.
pub const MEETING: usize = 100;
/// The round in which a vehicle has fixes again: after a minute.
const REGAINED: usize = 300;
/// How far noise that is not white remembers: `exp(-1/5)`, five rounds.
const CORRELATION: f64 = 0.818_730_753;
/// The five kinds, a vehicle each in turn when they are mixed.
const KINDS: [Kind; 5] = [
    Kind::Pose,
    Kind::Orientation,
    Kind::Position,
    Kind::Bearing,
    Kind::Distance,
];

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trouble {
    /// Nothing.
    None,
    /// This share of the measurements is anything in range.
    Gross(f64),
    /// This share is off by 3 to 10 standard deviations.
    Moderate(f64),
    /// One edge is wrong in the same way for ten rounds.
    Burst,
    /// One measurement in ten is grossly wrong, one in ten moderately, and there is a burst.
    AllOutliers,
    /// So many times the noise is stated of everything.
    Misstated(f64),
    /// 2 % of odometer scale and 2 mrad a round of gyroscope bias.
    Biased,
    /// Odometry's noise is correlated over five rounds.
    Correlated,
    /// The same, and odometry states for each round what its noise adds up to over many.
    CorrelatedStated,
    /// One vehicle has absolute fixes.
    Fixes,
    /// One vehicle has them after a minute without.
    Regained,
    /// The even half of the team has fixes, by one vehicle, and does not see the odd half until they meet.
    Meeting,
    /// The odometry of one vehicle tells 10 % too much motion.
    LyingOdometry,
    /// What one vehicle measures is 1 m off from round 30 to round 60.
    LyingSensor,
}

/// What the vehicles measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensing {
    /// All the same.
    All(Kind),
    /// Each another kind.
    Mixed,
    /// Poses, by sensors off the body's centre.
    Mounted,
}

/// What is asked of the team estimator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Asked {
    /// The most that its error should be over the bound.
    pub ratio: Option<f64>,
    /// The most that its error should be, metres.
    pub rmse_m: Option<f64>,
    /// Where its NEES should be.
    pub nees: Option<(f64, f64)>,
    /// The most standard deviations that those may move who are scored apart, when they meet the others.
    pub moved_sigmas: Option<f64>,
}

/// One cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// What it is called.
    pub name: &'static str,
    /// How many vehicles.
    pub robots: usize,
    /// What they measure.
    pub sensing: Sensing,
    /// How many rounds.
    pub rounds: usize,
    /// What becomes of packets.
    pub air: Air,
    /// What goes wrong.
    pub trouble: Trouble,
    /// What is asked.
    pub asked: Asked,
}

/// A flight as it was told, and as an oracle knows it.
#[derive(Clone, Debug)]
pub struct Case {
    /// What the estimators are told.
    pub told: History,
    /// The same with true odometry noise, no biases, and true statements; wrong measurements are marked in both.
    pub known: History,
    /// Whether the two are the same and nothing is wrong.
    pub is_clean: bool,
}

const BASE: Cell = Cell {
    name: "",
    robots: 5,
    sensing: Sensing::All(Kind::Pose),
    rounds: 100,
    air: Air::PERFECT,
    trouble: Trouble::None,
    asked: Asked {
        ratio: None,
        rmse_m: None,
        nees: None,
        moved_sigmas: None,
    },
};
const HONEST: Option<(f64, f64)> = Some((0.85, 1.15));
const WIDE: Option<(f64, f64)> = Some((0.55, 1.2));

const fn at_most(ratio: f64) -> Asked {
    Asked {
        ratio: Some(ratio),
        ..BASE.asked
    }
}

const fn honest(ratio: f64) -> Asked {
    Asked {
        nees: HONEST,
        ..at_most(ratio)
    }
}

const fn team(name: &'static str, robots: usize, asked: Asked) -> Cell {
    Cell {
        name,
        robots,
        asked,
        ..BASE
    }
}

const fn sensing(name: &'static str, sensing: Sensing, asked: Asked) -> Cell {
    Cell {
        name,
        sensing,
        asked,
        ..BASE
    }
}

const fn loss(name: &'static str, loss: f64, repeats: usize, asked: Asked) -> Cell {
    Cell {
        name,
        air: Air {
            loss,
            repeats,
            ..Air::PERFECT
        },
        asked,
        ..BASE
    }
}

const fn trouble(name: &'static str, trouble: Trouble, asked: Asked) -> Cell {
    Cell {
        name,
        trouble,
        asked,
        ..BASE
    }
}

/// All cells, in the order of the table.
pub const CELLS: [Cell; 40] = [
    team("pose-2", 2, honest(1.02)),
    team("pose-3", 3, honest(1.02)),
    team("pose-5", 5, honest(1.02)),
    team("pose-10", 10, at_most(1.03)),
    team("pose-20", 20, at_most(1.03)),
    sensing(
        "orientation",
        Sensing::All(Kind::Orientation),
        at_most(1.03),
    ),
    sensing("position", Sensing::All(Kind::Position), at_most(1.03)),
    sensing("bearing", Sensing::All(Kind::Bearing), at_most(1.03)),
    sensing("distance", Sensing::All(Kind::Distance), at_most(1.05)),
    sensing("mixed", Sensing::Mixed, BASE.asked),
    sensing("levers", Sensing::Mounted, BASE.asked),
    trouble("fixes", Trouble::Fixes, BASE.asked),
    Cell {
        rounds: REGAINED + 20,
        ..trouble("fixes-regained", Trouble::Regained, honest(1.1))
    },
    Cell {
        robots: 6,
        // Two seconds after they meet.
        rounds: MEETING + 10,
        air: Air {
            apart_rounds: MEETING,
            ..Air::PERFECT
        },
        ..trouble(
            "meeting",
            Trouble::Meeting,
            Asked {
                moved_sigmas: Some(3.0),
                ..at_most(1.1)
            },
        )
    },
    loss("loss-30", 0.3, 0, BASE.asked),
    loss(
        "loss-30-repeats",
        0.3,
        3,
        Asked {
            rmse_m: Some(0.09),
            ..BASE.asked
        },
    ),
    loss("loss-60", 0.6, 0, BASE.asked),
    loss("loss-60-repeats", 0.6, 3, BASE.asked),
    Cell {
        name: "delay",
        air: Air {
            delay_rounds: 1,
            ..Air::PERFECT
        },
        ..BASE
    },
    trouble("gross-10", Trouble::Gross(0.1), at_most(1.05)),
    trouble("gross-20", Trouble::Gross(0.2), at_most(1.05)),
    trouble("gross-30", Trouble::Gross(0.3), BASE.asked),
    trouble("moderate-10", Trouble::Moderate(0.1), at_most(1.0)),
    trouble("moderate-20", Trouble::Moderate(0.2), at_most(1.0)),
    trouble("moderate-30", Trouble::Moderate(0.3), BASE.asked),
    trouble("burst", Trouble::Burst, at_most(1.1)),
    Cell {
        sensing: Sensing::All(Kind::Bearing),
        ..trouble("burst-bearing", Trouble::Burst, at_most(1.1))
    },
    trouble("all-outliers", Trouble::AllOutliers, BASE.asked),
    trouble(
        "noise-half",
        Trouble::Misstated(0.5),
        Asked {
            nees: WIDE,
            ..at_most(1.05)
        },
    ),
    trouble(
        "noise-double",
        Trouble::Misstated(2.0),
        Asked {
            nees: WIDE,
            ..at_most(1.05)
        },
    ),
    trouble("biased", Trouble::Biased, at_most(1.05)),
    Cell {
        robots: 2,
        ..trouble("biased-2", Trouble::Biased, BASE.asked)
    },
    Cell {
        sensing: Sensing::All(Kind::Distance),
        ..trouble("biased-distance", Trouble::Biased, BASE.asked)
    },
    trouble("correlated", Trouble::Correlated, BASE.asked),
    trouble("correlated-stated", Trouble::CorrelatedStated, BASE.asked),
    trouble("lying-odometry", Trouble::LyingOdometry, at_most(1.1)),
    trouble("lying-sensor", Trouble::LyingSensor, at_most(1.1)),
    Cell {
        air: Air {
            loss: 0.3,
            repeats: 3,
            ..Air::PERFECT
        },
        ..trouble("outliers-and-loss", Trouble::AllOutliers, BASE.asked)
    },
    Cell {
        rounds: 2000,
        ..team("long-2", 2, at_most(1.02))
    },
    Cell {
        rounds: 2000,
        ..team("long-5", 5, at_most(1.02))
    },
];

impl Cell {
    /// The cell of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        CELLS.into_iter().find(|cell| cell.name == name)
    }

    /// Section V with its team, its sensors, its air and its length; not with its trouble.
    #[must_use]
    pub fn scenario(&self, seed: u64) -> Scenario {
        let mut scenario = Scenario::built_in("section-v").expect("built in");
        scenario.seed = seed;
        scenario.duration_s = self.rounds as f64 * scenario.period_s;
        scenario.team = Team::in_formation(self.robots, Formation::SectionV);
        scenario.radio.loss = self.air.loss;
        scenario.radio.delay_s = self.air.delay_rounds as f64 * scenario.period_s;
        match self.sensing {
            Sensing::All(kind) => scenario.sensor.kind = kind,
            Sensing::Mixed => {}
            Sensing::Mounted => {
                let mounted = Scenario::built_in("section-v-mounted").expect("built in");
                scenario.sensor.mounts = mounted.sensor.mounts;
            }
        }
        scenario
    }

    /// Flies a sample and lets go wrong what does.
    ///
    /// # Errors
    /// [`NotBare`] for a world whose readings are not taken on their rounds.
    pub fn case(&self, seed: u64, sample: u64) -> Result<Case, NotBare> {
        let scenario = self.scenario(seed);
        let streams = scenario.streams(sample);
        let mut known = match self.sensing {
            Sensing::Mixed => mixed(&scenario, sample)?,
            Sensing::All(_) | Sensing::Mounted => {
                history::record(&mut World::new(&scenario, sample))?
            }
        };
        self.go_wrong(&mut known, &streams);
        let mut told = known.clone();
        let is_told_right = match self.trouble {
            Trouble::Misstated(times) => {
                odometer::misstate(&mut told, times);
                false
            }
            Trouble::Biased => {
                odometer::bias(&mut told, 0.02, 0.002);
                false
            }
            Trouble::LyingOdometry => {
                odometer::exaggerate(&mut told, LIAR, 1.1);
                false
            }
            _ => true,
        };
        let mut sightings = known.rounds.iter().flat_map(|round| &round.sightings);
        let is_clean = is_told_right && !sightings.any(|sighting| sighting.is_wrong);
        Ok(Case {
            told,
            known,
            is_clean,
        })
    }

    /// What is really so, or marked.
    fn go_wrong(&self, history: &mut History, streams: &Streams) {
        let outliers = &mut streams.vehicle(0, Purpose::Outlier);
        let bursts = &mut streams.vehicle(0, Purpose::WrongBurst);
        let fixed = &mut streams.vehicle(FIXED, Purpose::Fix);
        match self.trouble {
            Trouble::None | Trouble::Misstated(_) | Trouble::Biased | Trouble::LyingOdometry => {}
            Trouble::Gross(share) => mistakes::gross(history, share, outliers),
            Trouble::Moderate(share) => mistakes::moderate(history, share, outliers),
            Trouble::Burst => mistakes::burst(history, bursts),
            Trouble::AllOutliers => {
                mistakes::moderate(history, 0.1, outliers);
                mistakes::gross(history, 0.1, outliers);
                mistakes::burst(history, bursts);
            }
            Trouble::Correlated => odometer::correlate(history, CORRELATION),
            Trouble::CorrelatedStated => {
                odometer::correlate(history, CORRELATION);
                // The variance of a long sum of such noise over that of as much white noise.
                let adds_up = (1.0 + CORRELATION) / (1.0 - CORRELATION);
                odometer::restate(history, adds_up.sqrt());
            }
            Trouble::Fixes => fixes::add(history, FIXED, 0, fixed),
            Trouble::Regained => fixes::add(history, FIXED, REGAINED, fixed),
            Trouble::Meeting => {
                fixes::add(history, FIXED, 0, fixed);
                for round in history.rounds.iter_mut().take(MEETING) {
                    let sightings = &mut round.sightings;
                    sightings.retain(|sighting| is_one_half(sighting.from, sighting.to));
                }
            }
            Trouble::LyingSensor => {
                mistakes::displaced_sensor(history, LIAR, 30..60, &Vector3::x());
            }
        }
    }

    /// Whether a vehicle does what it should.
    #[must_use]
    pub const fn is_honest(&self, vehicle: usize) -> bool {
        !(vehicle == LIAR && matches!(self.trouble, Trouble::LyingOdometry | Trouble::LyingSensor))
    }

    /// Whether a vehicle is scored apart from the others: who lies, and the half that has fixes when two meet.
    #[must_use]
    pub const fn is_scored_apart(&self, vehicle: usize) -> bool {
        let has_fixes = matches!(self.trouble, Trouble::Meeting) && is_one_half(vehicle, FIXED);
        has_fixes || !self.is_honest(vehicle)
    }
}

/// A flight in which each vehicle measures another kind: five recordings of one world put together.
fn mixed(scenario: &Scenario, sample: u64) -> Result<History, NotBare> {
    let mut scenario = scenario.clone();
    let mut mixed: Option<History> = None;
    for (nth, kind) in KINDS.into_iter().enumerate() {
        scenario.sensor.kind = kind;
        let recorded = history::record(&mut World::new(&scenario, sample))?;
        let mixed = mixed.get_or_insert_with(|| {
            let mut bare = recorded.clone();
            bare.rounds
                .iter_mut()
                .for_each(|round| round.sightings.clear());
            bare
        });
        for (round, recorded) in mixed.rounds.iter_mut().zip(recorded.rounds) {
            let own = recorded.sightings.into_iter();
            let own = own.filter(|sighting| sighting.from % KINDS.len() == nth);
            round.sightings.extend(own);
        }
    }
    Ok(mixed.expect("there are five kinds"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_is_found_by_a_name_of_its_own_and_is_another_flight() {
        for (nth, cell) in CELLS.iter().enumerate() {
            assert_eq!(Cell::named(cell.name), Some(*cell));
            let same = |other: &&Cell| {
                Cell {
                    name: "",
                    asked: Asked::default(),
                    ..**other
                } == Cell {
                    name: "",
                    asked: Asked::default(),
                    ..*cell
                }
            };
            assert_eq!(CELLS[nth..].iter().filter(same).count(), 1, "{}", cell.name);
        }
        assert_eq!(Cell::named("nowhere"), None);
    }

    #[test]
    fn when_kinds_are_mixed_every_vehicle_measures_its_own() {
        let mut cell = Cell::named("mixed").unwrap();
        cell.rounds = 10;
        let case = cell.case(1, 0).unwrap();
        let mut seen = std::collections::BTreeSet::new();
        for sighting in case.told.rounds.iter().flat_map(|round| &round.sightings) {
            seen.insert((sighting.from, sighting.observation.measurement.kind()));
        }
        let mut kinds: Vec<_> = seen.iter().map(|(_, kind)| *kind).collect();
        kinds.dedup();
        assert_eq!((seen.len(), kinds.len()), (5, 5), "{seen:?}");
    }

    #[test]
    fn what_is_told_and_what_is_known_differ_by_the_trouble_only() {
        let case = |name: &str| {
            let mut cell = Cell::named(name).unwrap();
            cell.rounds = 20;
            cell.case(1, 0).unwrap()
        };
        assert!(case("pose-5").is_clean && case("correlated").is_clean);
        let gross = case("gross-20");
        assert!(!gross.is_clean);
        let wrong = |history: &History| {
            let sightings = history.rounds.iter().flat_map(|round| &round.sightings);
            sightings.filter(|sighting| sighting.is_wrong).count()
        };
        assert!(wrong(&gross.told) > 0 && wrong(&gross.told) == wrong(&gross.known));
        let biased = case("biased");
        let apart = |history: &History| {
            let last = history.last();
            let reckoned = history.starts[0] * history.step(0, 0, last);
            (reckoned.translation - history.true_pose(last, 0).translation).norm()
        };
        assert!(!biased.is_clean && apart(&biased.told) != apart(&biased.known));
    }
}
