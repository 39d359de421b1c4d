//! The measurement graph of a whole history (paper section II): nodes with poses, edges with measurements. Knows
//! nothing of how it is solved.

use std::collections::BTreeMap;

use super::edge::{Edge, Node, Weight};
use super::measurement::{CONTRADICTION_SIGMAS, Measurement};
use super::refusal::Refusal;
use crate::transform::{Body, Sensor, Transform};

/// Nodes that a graph takes.
pub const MAX_NODES: usize = 1_000_000;

/// Edges that a graph takes.
pub const MAX_EDGES: usize = 8_000_000;

/// Edges between one directed pair of nodes that are compared with each other for contradiction.
const COMPARED_MAX: usize = 16;

/// Names a node of one graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeIndex(usize);

impl NodeIndex {
    /// Node 0, the world itself.
    pub const REFERENCE: Self = Self(0);

    /// Its place in the order of adding; 0 is the reference.
    #[must_use]
    pub const fn get(self) -> usize {
        self.0
    }
}

/// One edge with the nodes it ties.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GraphEdge {
    /// The measuring node.
    pub from: NodeIndex,
    /// The measured node.
    pub to: NodeIndex,
    /// What was measured, its weight and end offsets.
    pub edge: Edge,
}

/// Nodes and edges. Node 0 is the reference: the world frame, held fixed; absolute fixes are edges from it.
#[derive(Debug, Clone)]
pub struct Graph {
    nodes: Vec<Node>,
    held: Vec<bool>,
    edges: Vec<GraphEdge>,
    /// The edges with stated noise of each directed pair, for the search for contradictions.
    stated: BTreeMap<(NodeIndex, NodeIndex), Vec<usize>>,
}

impl Default for Graph {
    fn default() -> Self {
        Self::new()
    }
}

impl Graph {
    /// The reference alone.
    #[must_use]
    pub fn new() -> Self {
        Self {
            nodes: vec![Transform::identity()],
            held: vec![true],
            edges: Vec::new(),
            stated: BTreeMap::new(),
        }
    }

    /// Adds a node with its initial pose.
    ///
    /// # Errors
    /// [`Refusal`] when the pose is none or there are [`MAX_NODES`] already.
    pub fn add_node(&mut self, world_from_body: Node) -> Result<NodeIndex, Refusal> {
        if !world_from_body.is_valid() {
            return Err(Refusal::NotFinite {
                what: "the initial pose",
            });
        }
        if self.nodes.len() == MAX_NODES {
            return Err(Refusal::Full {
                what: "nodes",
                limit: MAX_NODES,
            });
        }
        self.nodes.push(world_from_body);
        self.held.push(false);
        Ok(NodeIndex(self.nodes.len() - 1))
    }

    /// Holds a node at its initial pose.
    ///
    /// # Errors
    /// [`Refusal::UnknownNode`].
    pub fn hold(&mut self, node: NodeIndex) -> Result<(), Refusal> {
        self.check_node(node)?;
        self.held[node.0] = true;
        Ok(())
    }

    /// Adds what `from` measured of `to`.
    ///
    /// # Errors
    /// [`Refusal`] for unknown or equal nodes, for a measurement with stated noise that contradicts one already here,
    /// or when there are [`MAX_EDGES`] already.
    pub fn add_edge(&mut self, from: NodeIndex, to: NodeIndex, edge: Edge) -> Result<(), Refusal> {
        self.check_node(from)?;
        self.check_node(to)?;
        if from == to {
            return Err(Refusal::SameNode);
        }
        if self.edges.len() == MAX_EDGES {
            return Err(Refusal::Full {
                what: "measurements",
                limit: MAX_EDGES,
            });
        }
        self.check_contradiction(from, to, &edge)?;
        if matches!(edge.weight(), Weight::Noise(_)) {
            self.stated
                .entry((from, to))
                .or_default()
                .push(self.edges.len());
        }
        self.edges.push(GraphEdge { from, to, edge });
        Ok(())
    }

    /// Adds an absolute fix: what the reference measures of `node`, with `body_from_sensor` of the point that is
    /// fixed (the lever arm of an antenna).
    ///
    /// # Errors
    /// As [`Graph::add_edge`], or an unusable weight or offset.
    pub fn add_fix(
        &mut self,
        node: NodeIndex,
        measurement: Measurement,
        weight: Weight,
        body_from_sensor: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        let edge =
            Edge::with_offsets(measurement, weight, Transform::identity(), body_from_sensor)?;
        self.add_edge(NodeIndex::REFERENCE, node, edge)
    }

    /// The pose of a node, or nothing when there is no such node.
    #[must_use]
    pub fn pose(&self, node: NodeIndex) -> Option<&Node> {
        self.nodes.get(node.0)
    }

    /// The names of all nodes, the reference first.
    pub fn indices(&self) -> impl Iterator<Item = NodeIndex> + use<> {
        (0..self.nodes.len()).map(NodeIndex)
    }

    /// The poses, the reference first.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The edges in the order of adding.
    #[must_use]
    pub fn edges(&self) -> &[GraphEdge] {
        &self.edges
    }

    /// Whether a node is held; false for one that does not exist.
    #[must_use]
    pub fn is_held(&self, node: NodeIndex) -> bool {
        self.held.get(node.0).copied().unwrap_or(false)
    }

    pub(crate) fn is_held_at(&self, index: usize) -> bool {
        self.held[index]
    }

    /// The cost of all edges at the present poses (paper eq. 3): `1/2 sum g_e`, weighted.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.cost_at(&self.nodes)
    }

    pub(crate) fn cost_at(&self, nodes: &[Node]) -> f64 {
        let sum: f64 = self
            .edges
            .iter()
            .map(|e| e.edge.cost(&nodes[e.from.0], &nodes[e.to.0]))
            .sum();
        0.5 * sum
    }

    pub(crate) fn replace_nodes(&mut self, nodes: Vec<Node>) {
        debug_assert_eq!(nodes.len(), self.nodes.len());
        self.nodes = nodes;
    }

    fn check_node(&self, node: NodeIndex) -> Result<(), Refusal> {
        if node.0 < self.nodes.len() {
            Ok(())
        } else {
            Err(Refusal::UnknownNode { index: node.0 })
        }
    }

    /// Only edges with stated noise can be said to exclude each other.
    fn check_contradiction(
        &self,
        from: NodeIndex,
        to: NodeIndex,
        edge: &Edge,
    ) -> Result<(), Refusal> {
        let Weight::Noise(noise) = edge.weight() else {
            return Ok(());
        };
        let before = self.stated.get(&(from, to)).into_iter().flatten().rev();
        for present in before.take(COMPARED_MAX).map(|&index| &self.edges[index]) {
            let Weight::Noise(other) = present.edge.weight() else {
                continue;
            };
            let sigmas = edge.sigmas_apart(noise, &present.edge, other);
            if sigmas > CONTRADICTION_SIGMAS {
                return Err(Refusal::Contradicts {
                    kind: edge.measurement().kind(),
                    sigmas,
                });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
