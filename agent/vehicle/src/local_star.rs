//! Puts a gathered round together as the local star of the cooperative pipeline: my pose at my instant, each
//! neighbour's pose at *its* instant nearest to mine, and what either measured of the other.

use nalgebra::{UnitQuaternion, Vector3};
use skein_estimation::cooperative::{
    Contact, Disagreement, Edge, Judgement, Kernel, Kind, Measurement, NeighbourIndex, Star,
    StarWorkspace, Tie, Weight,
};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform, World};
use skein_proto::name::Name;

use crate::gathering::{self, Direction, Gathered, Spoke};
use crate::placing::agree;
use crate::refused::Refused;
use crate::rounds::{Fix, Round};
use crate::translate::{self, Sighting};
use crate::trust::Outcome;

/// Headings that are tried for a vehicle of which nobody measured the whole pose.
const HEADINGS: usize = 8;

/// A star that was built, and what went into it.
#[derive(Clone, Debug)]
pub(crate) struct Built {
    pub(crate) used: Vec<Used>,
    /// Measurements that were not used, and of or by whom they are.
    pub(crate) refused: Vec<(Name, Refused)>,
    /// Of which sensors the fixes are, in the order of the star.
    pub(crate) fixes: Vec<Name>,
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
    pub(crate) fn nothing() -> Self {
        Self {
            used: Vec::new(),
            refused: Vec::new(),
            fixes: Vec::new(),
            fixes_refused: Vec::new(),
            instant_from_solved: Transform::identity(),
        }
    }

    pub(crate) fn edges(&self) -> u64 {
        self.used.iter().map(|used| used.edges).sum::<u64>() + self.fixes.len() as u64
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

    /// Every measurement that went in was for nothing, for one reason. Not so distances: `ranging` reads them.
    pub(crate) fn in_vain(mut self, gathered: &Gathered<'_>, why: &Refused) -> Self {
        for used in self.used.drain(..) {
            let in_vain = used.edges.saturating_sub(gathered.distances_of(used.name));
            self.refused
                .extend((0..in_vain).map(|_| (used.name, why.clone())));
        }
        self.fixes.clear();
        self
    }
}

/// Where this vehicle stands in its star.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Centre {
    /// At its prior, which counts.
    Prior(Transform<World, Body>),
    /// Anywhere: only measurements count.
    Free {
        /// Where the search begins.
        start: Transform<World, Body>,
        /// What measurements are judged by: how good the start is.
        contact: Contact,
    },
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
        let solved = |pose: Transform<World, Body>| (pose * built.instant_from_solved).reframe();
        let restarted = match centre {
            Centre::Prior(prior) => star.restart(solved(prior)),
            Centre::Free { start, .. } => star.restart_unanchored(solved(start)),
        };
        if restarted.is_err() {
            return built;
        }
        for spoke in self.spokes.iter().filter(|spoke| !spoke.quarantined) {
            let contact = match centre {
                Centre::Prior(_) => spoke.contact,
                Centre::Free { contact, .. } => contact,
            };
            add(star, spoke, contact, &mut built);
        }
        star.set_fix_contact(self.fix_contact);
        let solved_from_instant = built.instant_from_solved.inverse();
        for fix in &self.round.fixes {
            let end = solved_from_instant * fix.body_from_sensor;
            let added = translate::fix(&fix.value).and_then(|fixed| {
                let end = end * fixed.sensor_from_point;
                Ok(star.fix(fixed.measurement, fixed.noise, end)?)
            });
            match added {
                Ok(()) => built.fixes.push(fix.sensor),
                Err(why) => built.fixes_refused.push((fix.sensor, why)),
            }
        }
        built
    }

    /// Where a vehicle without a pose may be at the round's instant. Each measured pose says it outright, and the one
    /// that most others agree with is the start; without any, a few headings amid the neighbours are, which may be far
    /// off.
    pub(crate) fn starts(&self) -> Vec<Centre> {
        let start = |contact| move |start| Centre::Free { start, contact };
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
            return vec![start(Contact::FRESH)(*best)];
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
            .map(start(Contact::LOST))
            .collect()
    }
}

/// What a solved round says of one neighbour, or of the fixes.
#[derive(Clone, Debug)]
pub(crate) struct Judged {
    /// None for the fixes.
    pub(crate) neighbour: Option<Name>,
    /// What it was judged by.
    pub(crate) contact: Contact,
    pub(crate) outcome: Outcome,
    /// Measurements that were accepted.
    pub(crate) accepted: u64,
    /// Measurements that were rejected; of a neighbour in quarantine, all.
    pub(crate) gated: u64,
    /// Fixes that were rejected, by their sensors.
    pub(crate) gated_fixes: Vec<Name>,
}

/// Whether a measurement that agrees pulls two vehicles together: a distance leaves them as free as they were in all
/// other directions, and what it agrees with says nothing of those.
const fn holds(kind: Kind) -> bool {
    !matches!(kind, Kind::Distance)
}

impl Judged {
    const fn new(neighbour: Option<Name>, contact: Contact) -> Self {
        Self {
            neighbour,
            contact,
            outcome: Outcome::Unclear,
            accepted: 0,
            gated: 0,
            gated_fixes: Vec::new(),
        }
    }

    /// One measurement more: one that agrees is contact, and only when all disagree does the neighbour.
    fn add(&mut self, judgement: Judgement, kind: Kind, disagreement: Disagreement, first: bool) {
        self.accepted += u64::from(judgement == Judgement::Accepted);
        self.gated += u64::from(judgement == Judgement::Rejected);
        self.outcome = match (judgement, self.outcome) {
            (Judgement::Accepted, _) if holds(kind) => Outcome::Agreed,
            (_, Outcome::Agreed) => Outcome::Agreed,
            (Judgement::Rejected, Outcome::Disagreed(_)) => self.outcome,
            (Judgement::Rejected, Outcome::Unclear) if first => Outcome::Disagreed(disagreement),
            _ => Outcome::Unclear,
        };
    }
}

impl Gathered<'_> {
    /// Judges everything that was measured by the solution in `workspace`, of the star that was `built`: what went into
    /// it, and what neighbours in quarantine would have said.
    pub(crate) fn judge(
        &self,
        star: &Star,
        workspace: &StarWorkspace,
        built: &Built,
        world_from_body: &Transform<World, Body>,
        kernel: &Kernel,
    ) -> Vec<Judged> {
        let contact_of = |name| {
            let spoke = self.spokes.iter().find(|spoke| spoke.name == name);
            spoke.map_or(Contact::FRESH, |spoke| spoke.contact)
        };
        let mut judged: Vec<Judged> = built
            .used
            .iter()
            .map(|used| Judged::new(Some(used.name), contact_of(used.name)))
            .collect();
        judged.push(Judged::new(None, self.fix_contact));
        let mut counted = vec![0; judged.len()];
        for verdict in star.verdicts(workspace) {
            let at = match verdict.tie {
                Tie::MeasuredByMe(j) | Tie::MeasuredByNeighbour(j) => {
                    built.used.iter().position(|used| used.index == j)
                }
                Tie::Fix => Some(judged.len() - 1),
            };
            let Some(at) = at else { continue };
            let judgement = verdict.judgement();
            if let (Tie::Fix, Judgement::Rejected) = (verdict.tie, judgement) {
                judged[at].gated_fixes.push(built.fixes[counted[at]]);
            }
            let (kind, apart) = (verdict.kind, verdict.disagreement);
            judged[at].add(judgement, kind, apart, counted[at] == 0);
            counted[at] += 1;
        }
        let quarantined = self.spokes.iter().filter(|spoke| spoke.quarantined);
        judged.extend(quarantined.map(|spoke| spoke.judge(world_from_body, kernel)));
        judged
    }
}

impl Spoke {
    /// What a neighbour in quarantine would have said, were this vehicle at `own`.
    fn judge(&self, own: &Transform<World, Body>, kernel: &Kernel) -> Judged {
        let mut judged = Judged::new(Some(self.name), self.contact);
        for (nth, tie) in self.ties.iter().enumerate() {
            let (from, to) = match tie.direction {
                Direction::Mine => ((own, tie.own_end), (&self.prior, tie.their_end)),
                Direction::Theirs => ((&self.prior, tie.their_end), (own, tie.own_end)),
            };
            let Sighting {
                measurement, noise, ..
            } = tie.sighting;
            let Ok(edge) = Edge::with_offsets(measurement, Weight::Unit, from.1, to.1) else {
                continue;
            };
            let ends = (from.0.reframe(), to.0.reframe());
            let scale = kernel.scale(self.contact, noise.rotation_rad, noise.translation);
            let judgement = edge.judge(&scale, &ends.0, &ends.1);
            let apart = edge.disagreement(&ends.0, &ends.1);
            judged.add(judgement, measurement.kind(), apart, nth == 0);
        }
        (judged.accepted, judged.gated) = (0, self.ties.len() as u64);
        judged
    }
}

impl gathering::Tie {
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
fn add(star: &mut Star, spoke: &Spoke, contact: Contact, built: &mut Built) {
    let instant_from_solved = spoke.instant_from_solved;
    let index = match star.add_neighbour((spoke.prior * instant_from_solved).reframe(), contact) {
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
