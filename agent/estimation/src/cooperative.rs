//! Cooperative localisation (Knuth and Barooah): poses from relative measurements between vehicles, by optimisation
//! over the measurement graph.
//!
//! In reading order: what can be measured ([`Measurement`]), how it ties two nodes ([`Edge`]), the graph of a whole
//! history ([`Graph`]) with its centralised solver ([`batch`]), and the step that each vehicle runs by itself every
//! round ([`Star`]). Both minimise the same cost (paper eq. 3): `f = 1/2 sum g_e`.

pub mod measurement;

pub mod edge;

pub mod optimise;

pub mod mode;

pub mod kernel;

pub mod contact;

pub mod star;

pub mod graph;

pub mod batch;

pub mod team;

mod block;
mod refusal;

pub use batch::{BatchSolution, solve};
pub use contact::Contact;
pub use edge::{Edge, Weight};
pub use graph::{Graph, NodeIndex};
pub use kernel::{Disagreement, Kernel, Scale};
pub use measurement::{Kind, Measurement, Noise};
pub use mode::{AnchorWeight, Mode, Robust, Weighting};
pub use optimise::{Degeneracy, Descent, GaussNewton, Optimiser, Progress, SolveStatus};
pub use refusal::Refusal;
pub use star::{Judgement, NeighbourIndex, Solution, Star, StarWorkspace, Tie, Verdict};
pub use team::Team;
