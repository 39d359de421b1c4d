//! The distributed step of one vehicle (paper section IV): the measurement graph of itself and its neighbours, which
//! is a star, solved by eliminating the neighbours one by one.
//!
//! Anchors are the priors as pose edges from node 0 (`R_0 = I`, `t_0 = 0`, held fixed). Only edges that touch the
//! centre take part, so no two neighbours are coupled and the Schur complement costs one 6x6 factor per neighbour.
//! Only the centre's pose is an answer; what the star thinks of the neighbours is dropped.

mod anchor;
mod solver;
mod verdict;

use self::anchor::Anchor;
pub use self::solver::StarWorkspace;
pub use self::verdict::{ACCEPTED_FROM, Judgement, REJECTED_BELOW, Verdict};
use super::contact::Contact;
use super::edge::{Edge, Node, Weight};
use super::kernel::Scale;
use super::measurement::{CONTRADICTION_SIGMAS, Kind, Measurement, Noise};
use super::mode::{AnchorWeight, Mode, Weighting};
use super::optimise::{Optimiser, SolveStatus};
use super::refusal::Refusal;
use crate::transform::{Body, Sensor, Transform};

/// Neighbours that one step takes.
pub const MAX_NEIGHBOURS: usize = 16;

/// Measurements and fixes together that one step takes: 16 neighbours, both directions, four each.
pub const MAX_EDGES: usize = 128;

/// Names a neighbour within one star.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NeighbourIndex(usize);

impl NeighbourIndex {
    /// Its place in the order of adding, from 0.
    #[must_use]
    pub const fn get(self) -> usize {
        self.0
    }
}

/// The local measurement graph of one vehicle in one round.
///
/// Can be kept from round to round: [`Star::restart`] empties it without giving its memory back.
#[derive(Debug, Clone)]
pub struct Star {
    centre: Anchor,
    neighbours: Vec<Neighbour>,
    edges: Vec<StarEdge>,
    fix_contact: Contact,
    mode: Mode,
}

#[derive(Debug, Clone, Copy)]
struct Neighbour {
    anchor: Anchor,
    contact: Contact,
}

#[derive(Debug, Clone, Copy)]
struct StarEdge {
    edge: Edge,
    noise: Noise,
    tie: Tie,
    /// What the kernel judges it by; nothing without a kernel.
    scale: Option<Scale>,
}

/// What an edge ties the centre to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tie {
    /// The centre measured this neighbour.
    MeasuredByMe(NeighbourIndex),
    /// This neighbour measured the centre.
    MeasuredByNeighbour(NeighbourIndex),
    /// Node 0 measured the centre: an absolute fix.
    Fix,
}

/// The answer of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The centre's pose; finite in every case.
    pub world_from_body: Node,
    /// Why the solver stopped and what the pose is worth.
    pub status: SolveStatus,
    /// In how many of its six directions nothing is known of the centre, so that the prior was kept there. Without an
    /// anchor what was rejected does not count as known.
    pub unobservable: u8,
    /// Iterations that were accepted.
    pub iterations: usize,
    /// The cost (paper eq. 3, rad^2 and m^2; with a kernel the robust one) at the priors.
    pub cost_before: f64,
    /// The cost at the answer.
    pub cost_after: f64,
}

impl Star {
    /// A star of the centre alone, as in the paper.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`] when the prior is no pose.
    pub fn new(world_from_body: Node) -> Result<Self, Refusal> {
        Ok(Self {
            centre: Anchor::new(world_from_body, AnchorWeight::UNIT)?,
            neighbours: Vec::with_capacity(MAX_NEIGHBOURS),
            edges: Vec::with_capacity(MAX_EDGES),
            fix_contact: Contact::FRESH,
            mode: Mode::Paper,
        })
    }

    /// The same star weighed in another way; what is there keeps its weight until [`Star::restart`].
    #[must_use]
    pub const fn in_mode(mut self, mode: Mode) -> Self {
        self.mode = mode.of_a_star();
        self
    }

    /// Empties the star for another round, keeping its memory and mode. The prior counts what the mode says.
    ///
    /// # Errors
    /// [`Refusal`] when the prior is no pose or the mode's weight is negative or not finite; the star is then unchanged.
    pub fn restart(&mut self, world_from_body: Node) -> Result<(), Refusal> {
        self.restart_with_anchor(world_from_body, self.mode.anchor())
    }

    /// As [`Star::restart`], for a vehicle that has no pose: `start` is only where the search begins. The solution then
    /// says by [`Solution::unobservable`] whether what was accepted places the vehicle.
    ///
    /// # Errors
    /// As [`Star::restart`].
    pub fn restart_unanchored(&mut self, start: Node) -> Result<(), Refusal> {
        self.restart_with_anchor(start, AnchorWeight::NONE)
    }

    fn restart_with_anchor(&mut self, prior: Node, weight: AnchorWeight) -> Result<(), Refusal> {
        self.centre = Anchor::new(prior, weight)?;
        self.neighbours.clear();
        self.edges.clear();
        self.fix_contact = Contact::FRESH;
        Ok(())
    }

    /// How measurements are weighed.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// The number of neighbours.
    #[must_use]
    pub const fn neighbours(&self) -> usize {
        self.neighbours.len()
    }

    /// The number of measurements and fixes.
    #[must_use]
    pub const fn edges(&self) -> usize {
        self.edges.len()
    }

    /// Adds a neighbour by its prior of this round. `contact` widens the kernel for everything measured between the two;
    /// in [`Mode::Paper`] it is not looked at.
    ///
    /// # Errors
    /// [`Refusal`] when the prior is no pose, the mode's weight is none, or there are [`MAX_NEIGHBOURS`] already.
    pub fn add_neighbour(
        &mut self,
        world_from_body: Node,
        contact: Contact,
    ) -> Result<NeighbourIndex, Refusal> {
        self.add_neighbour_with_anchor(world_from_body, self.mode.anchor(), contact)
    }

    fn add_neighbour_with_anchor(
        &mut self,
        prior: Node,
        weight: AnchorWeight,
        contact: Contact,
    ) -> Result<NeighbourIndex, Refusal> {
        if self.neighbours.len() == MAX_NEIGHBOURS {
            return Err(Refusal::Full {
                what: "neighbours",
                limit: MAX_NEIGHBOURS,
            });
        }
        self.neighbours.push(Neighbour {
            anchor: Anchor::new(prior, weight)?,
            contact,
        });
        Ok(NeighbourIndex(self.neighbours.len() - 1))
    }

    /// By how much the kernel is widened for the fixes that are added after this. [`Star::restart`] resets it.
    pub const fn set_fix_contact(&mut self, contact: Contact) {
        self.fix_contact = contact;
    }

    /// Adds what the centre measured of a neighbour. An end is `body_from_sensor` of that vehicle, the motion between
    /// its round instant and the measurement included.
    ///
    /// # Errors
    /// [`Refusal`] for an unknown neighbour, unusable noise or offsets, a measurement that contradicts one already
    /// here, or when there are [`MAX_EDGES`] already.
    pub fn measured_by_me(
        &mut self,
        neighbour: NeighbourIndex,
        measurement: Measurement,
        noise: Noise,
        own_end: Transform<Body, Sensor>,
        their_end: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        self.add(
            Tie::MeasuredByMe(neighbour),
            measurement,
            noise,
            own_end,
            their_end,
        )
    }

    /// Adds what a neighbour measured of the centre.
    ///
    /// # Errors
    /// As [`Star::measured_by_me`].
    pub fn measured_by_neighbour(
        &mut self,
        neighbour: NeighbourIndex,
        measurement: Measurement,
        noise: Noise,
        own_end: Transform<Body, Sensor>,
        their_end: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        self.add(
            Tie::MeasuredByNeighbour(neighbour),
            measurement,
            noise,
            their_end,
            own_end,
        )
    }

    /// Adds an absolute fix of the centre: what node 0, the world's origin, measures of it. A position fix is the
    /// antenna's position in the world with the lever arm as `own_end`.
    ///
    /// # Errors
    /// As [`Star::measured_by_me`].
    pub fn fix(
        &mut self,
        measurement: Measurement,
        noise: Noise,
        own_end: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        self.add(Tie::Fix, measurement, noise, Transform::identity(), own_end)
    }

    fn add(
        &mut self,
        tie: Tie,
        measurement: Measurement,
        noise: Noise,
        from_offset: Transform<Body, Sensor>,
        to_offset: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        if let Tie::MeasuredByMe(NeighbourIndex(index))
        | Tie::MeasuredByNeighbour(NeighbourIndex(index)) = tie
            && index >= self.neighbours.len()
        {
            return Err(Refusal::UnknownNode { index });
        }
        if self.edges.len() == MAX_EDGES {
            return Err(Refusal::Full {
                what: "measurements",
                limit: MAX_EDGES,
            });
        }
        noise.check(measurement.kind())?;
        let weight = match self.mode {
            // No star is in mode `Team`: `in_mode` says so.
            Mode::Paper | Mode::Team => Weight::Unit,
            Mode::Star(robust) => match (robust.weighting, tie) {
                (Weighting::Unit, Tie::Fix) => Weight::Noise(robust.kernel.against_priors(&noise)),
                (Weighting::Unit, _) => Weight::Unit,
                (Weighting::Noise, _) => Weight::Noise(noise),
            },
        };
        let edge = Edge::with_offsets(measurement, weight, from_offset, to_offset)?;
        for present in self.edges.iter().filter(|present| present.tie == tie) {
            let sigmas = edge.sigmas_apart(&noise, &present.edge, &present.noise);
            if sigmas > CONTRADICTION_SIGMAS {
                return Err(Refusal::Contradicts {
                    kind: measurement.kind(),
                    sigmas,
                });
            }
        }
        let scale = self.scale(&edge, &noise, tie)?;
        if matches!(measurement.kind(), Kind::Pose | Kind::Orientation) {
            self.orient(tie)?;
        }
        self.edges.push(StarEdge {
            edge,
            noise,
            tie,
            scale,
        });
        Ok(())
    }

    /// An orientation is measured along a tie: the priors of both its vehicles count accordingly.
    fn orient(&mut self, tie: Tie) -> Result<(), Refusal> {
        if self.mode == Mode::Paper {
            return Ok(());
        }
        let weight = self.mode.oriented_anchor().check()?;
        if let Tie::MeasuredByMe(j) | Tie::MeasuredByNeighbour(j) = tie {
            self.neighbours[j.0].anchor.weight = weight;
        }
        if self.centre.is_anchored() {
            self.centre.weight = weight;
        }
        Ok(())
    }

    /// What an edge will be judged by: settled before solving, at the priors, so that the cost stays one function.
    fn scale(&self, edge: &Edge, noise: &Noise, tie: Tie) -> Result<Option<Scale>, Refusal> {
        let Mode::Star(robust) = self.mode else {
            return Ok(None);
        };
        let contact = match tie {
            Tie::MeasuredByMe(j) | Tie::MeasuredByNeighbour(j) => self.neighbours[j.0].contact,
            Tie::Fix => self.fix_contact,
        };
        let (from, to) = tie.ends(self.centre.prior, |j| self.neighbours[j.0].anchor.prior);
        let (rotation_rad, translation_m) = edge.residual_noise(noise, &from, &to);
        let scale = robust.kernel.scale(contact, rotation_rad, translation_m);
        if scale.is_valid() {
            Ok(Some(scale))
        } else {
            Err(Refusal::BadWeight)
        }
    }

    /// Minimises the star's cost from the priors. Deterministic, never panics, and allocates nothing.
    pub fn solve(&self, workspace: &mut StarWorkspace, optimiser: &Optimiser) -> Solution {
        solver::solve(self, workspace, optimiser)
    }

    /// What became of each edge, in the order of adding, at the solution that `workspace` holds. Of this star and no
    /// other: call it after [`Star::solve`], before anything is added.
    pub fn verdicts<'a>(
        &'a self,
        workspace: &'a StarWorkspace,
    ) -> impl Iterator<Item = Verdict> + 'a {
        self.edges
            .iter()
            .filter_map(|edge| Verdict::of(edge, workspace))
    }
}

impl Tie {
    /// The measuring and the measured node.
    fn ends(self, centre: Node, neighbour: impl FnOnce(NeighbourIndex) -> Node) -> (Node, Node) {
        match self {
            Self::MeasuredByMe(j) => (centre, neighbour(j)),
            Self::MeasuredByNeighbour(j) => (neighbour(j), centre),
            Self::Fix => (Transform::identity(), centre),
        }
    }
}

#[cfg(test)]
mod tests;
