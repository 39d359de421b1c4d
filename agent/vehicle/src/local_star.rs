//! Puts a gathered round together as the local star of the cooperative pipeline: my pose at my instant, each
//! neighbour's pose at *its* instant nearest to mine, and what either measured of the other.

use nalgebra::{UnitQuaternion, Vector3};
use skein_estimation::cooperative::{AnchorWeight, Measurement, NeighbourIndex, Star};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform, World};
use skein_proto::name::Name;

use crate::gathering::{Direction, Gathered, Spoke, Tie};
use crate::placing::agree;
use crate::refused::Refused;
use crate::rounds::{Fix, Round};
use crate::translate::{self, Sighting};

/// Headings that are tried for a vehicle of which nobody measured the whole pose.
const HEADINGS: usize = 8;

/// A star that was built, and what went into it.
#[derive(Clone, Debug)]
pub(crate) struct Built {
    pub(crate) used: Vec<Used>,
    /// Measurements that were not used, and of or by whom they are.
    pub(crate) refused: Vec<(Name, Refused)>,
    pub(crate) fixes: usize,
    /// Fixes that were not used, and of which sensor they are.
    pub(crate) fixes_refused: Vec<(Name, Refused)>,
    /// As in [`Gathered`].
    pub(crate) instant_from_solved: Transform<Body, Body>,
}

/// One neighbour in a star.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Used {
    pub(crate) name: Name,
    pub(crate) index: NeighbourIndex,
    pub(crate) edges: u64,
    /// Its instant, on our clock.
    pub(crate) taken: Stamp,
    /// The same as [`Built::instant_from_solved`], of the neighbour.
    pub(crate) instant_from_solved: Transform<Body, Body>,
}

impl Built {
    fn nothing() -> Self {
        Self {
            used: Vec::new(),
            refused: Vec::new(),
            fixes: 0,
            fixes_refused: Vec::new(),
            instant_from_solved: Transform::identity(),
        }
    }

    pub(crate) fn edges(&self) -> u64 {
        self.used.iter().map(|used| used.edges).sum::<u64>() + self.fixes as u64
    }

    /// What becomes of a round without odometry at its instant: nothing of it can be used.
    pub(crate) fn without_odometry(round: &Round) -> Self {
        let lost = |(name, list): (&Name, &Vec<_>)| vec![(*name, Refused::NoOdometry); list.len()];
        let fixes = round.fixes.iter();
        Self {
            refused: round.measured.iter().flat_map(lost).collect(),
            fixes_refused: fixes.map(|fix| (fix.sensor, Refused::NoOdometry)).collect(),
            ..Self::nothing()
        }
    }

    /// Every measurement that went in was for nothing, for one reason.
    pub(crate) fn in_vain(mut self, why: &Refused) -> Self {
        for used in self.used.drain(..) {
            self.refused
                .extend((0..used.edges).map(|_| (used.name, why.clone())));
        }
        self.fixes = 0;
        self
    }
}

/// Where this vehicle stands in its star.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Centre {
    /// At its prior, which counts.
    Prior(Transform<World, Body>),
    /// Anywhere: the search begins here, and only measurements count.
    Free(Transform<World, Body>),
}

impl Gathered<'_> {
    /// Fills `star` with the round.
    ///
    /// Each vehicle's unknown is its pose at its instant, but its anchor stands at the mean time of its readings: held
    /// at the instant, a prior resists that a turn at the time of the readings also moves the vehicle since then, and
    /// late readings cost a third of the accuracy (0.185 m against 0.140 m for readings 150 ms late).
    pub(crate) fn build(&self, star: &mut Star, centre: Centre) -> Built {
        let mut built = Built {
            refused: self.refused.clone(),
            instant_from_solved: self.instant_from_solved,
            ..Built::nothing()
        };
        let (pose, weight) = match centre {
            Centre::Prior(prior) => (prior, star.mode().anchor()),
            Centre::Free(start) => (start, AnchorWeight::NONE),
        };
        let pose = pose * built.instant_from_solved;
        if star.restart(pose.reframe(), weight).is_err() {
            return built;
        }
        for spoke in &self.spokes {
            add(star, spoke, &mut built);
        }
        let solved_from_instant = built.instant_from_solved.inverse();
        for fix in &self.round.fixes {
            let end = solved_from_instant * fix.body_from_sensor;
            let added = translate::fix(&fix.value).and_then(|fixed| {
                let end = end * fixed.sensor_from_point;
                Ok(star.fix(fixed.measurement, fixed.noise, end)?)
            });
            match added {
                Ok(()) => built.fixes += 1,
                Err(why) => built.fixes_refused.push((fix.sensor, why)),
            }
        }
        built
    }

    /// Where a vehicle without a pose may be at the round's instant. Each measured pose says it outright, and the one
    /// that most others agree with is the start; without any, a few headings amid the neighbours are.
    pub(crate) fn starts(&self) -> Vec<Transform<World, Body>> {
        let by_neighbours = self.spokes.iter().flat_map(|spoke| {
            spoke
                .ties
                .iter()
                .filter_map(|tie| tie.own_pose(&spoke.prior))
        });
        let by_fixes = self.round.fixes.iter().filter_map(Fix::world_from_body);
        let told: Vec<Transform<World, Body>> = by_neighbours.chain(by_fixes).collect();
        let agreeing =
            |pose: &&Transform<World, Body>| told.iter().filter(|other| agree(pose, other)).count();
        // The first of the best: deterministic.
        if let Some(best) = told.iter().rev().max_by_key(agreeing) {
            return vec![*best];
        }
        let places = self.spokes.iter().map(|spoke| spoke.prior.translation);
        let count = self.spokes.len();
        if count == 0 {
            return Vec::new();
        }
        let amid = places.sum::<Vector3<f64>>() / count as f64;
        let heading = |nth| std::f64::consts::TAU * nth as f64 / HEADINGS as f64;
        (0..HEADINGS)
            .map(|nth| {
                Transform::new(
                    UnitQuaternion::from_euler_angles(0.0, 0.0, heading(nth)),
                    amid,
                )
            })
            .collect()
    }
}

impl Tie {
    /// This vehicle's pose at its instant, where the measurement is of a whole pose.
    fn own_pose(&self, neighbour: &Transform<World, Body>) -> Option<Transform<World, Body>> {
        let Measurement::Pose(pose) = &self.sighting.measurement else {
            return None;
        };
        let from_from_to = pose.relative();
        let world_from_their_end = *neighbour * self.their_end;
        let world_from_own_end = match self.direction {
            Direction::Mine => world_from_their_end * from_from_to.inverse(),
            Direction::Theirs => world_from_their_end * from_from_to,
        };
        Some(world_from_own_end * self.own_end.inverse())
    }
}

/// Puts a neighbour and all its measurements into a star whose centre is solved at `built.instant_from_solved`.
fn add(star: &mut Star, spoke: &Spoke, built: &mut Built) {
    let instant_from_solved = spoke.instant_from_solved;
    let index = match star.add_neighbour_with_anchor(
        (spoke.prior * instant_from_solved).reframe(),
        star.mode().anchor(),
    ) {
        Ok(index) => index,
        Err(why) => {
            let why = Refused::from(why);
            built
                .refused
                .extend(spoke.ties.iter().map(|_| (spoke.name, why.clone())));
            return;
        }
    };
    let (own_back, their_back) = (
        built.instant_from_solved.inverse(),
        instant_from_solved.inverse(),
    );
    let mut edges = 0;
    for tie in &spoke.ties {
        let Sighting {
            measurement, noise, ..
        } = tie.sighting;
        let (own_end, their_end) = (own_back * tie.own_end, their_back * tie.their_end);
        let added = match tie.direction {
            Direction::Mine => star.measured_by_me(index, measurement, noise, own_end, their_end),
            Direction::Theirs => {
                star.measured_by_neighbour(index, measurement, noise, own_end, their_end)
            }
        };
        match added {
            Ok(()) => edges += 1,
            Err(why) => built.refused.push((spoke.name, why.into())),
        }
    }
    built.used.push(Used {
        name: spoke.name,
        index,
        edges,
        taken: spoke.taken,
        instant_from_solved,
    });
}
