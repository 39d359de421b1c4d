//! Pose-graph files: g2o's 3-D lines, and a text form in the same spirit for the other kinds of measurement and fixes.
//!
//! One statement per line; `#` begins a comment; blank lines are skipped. Lengths in metres, angles in radians,
//! quaternions as `qx qy qz qw`. A vertex may come after the edges that name it.
//!
//! ```text
//! VERTEX_SE3:QUAT  id  x y z  qx qy qz qw                          initial pose
//! EDGE_SE3:QUAT    i j x y z  qx qy qz qw  21 numbers              pose, with its information matrix
//! FIX              id [id ...]                                     holds vertices at their initial pose
//!
//! EDGE_POSE        i j x y z  qx qy qz qw  sigma_rad sigma_m [ends]
//! EDGE_ORIENTATION i j qx qy qz qw         sigma_rad         [ends]
//! EDGE_POSITION    i j x y z               sigma_m           [ends]
//! EDGE_BEARING     i j x y z               sigma_rad         [ends]    unit vector from i to j, in frame i
//! EDGE_DISTANCE    i j d                   sigma_m           [ends]
//!
//! FIX_POSE         j x y z  qx qy qz qw    sigma_rad sigma_m [ends]    the same, measured from the world
//! FIX_ORIENTATION  j qx qy qz qw           sigma_rad         [ends]
//! FIX_POSITION     j x y z                 sigma_m           [ends]
//! ```
//!
//! `i` is the vertex that measures, `j` the one measured; a pose is that of j in frame i. The information matrix is
//! the upper triangle by rows, translation before rotation, of the SE(3) logarithm of what is left over (as GTSAM reads
//! these files: full-angle rotation). A sigma is a standard deviation per axis; the word `unit` in place of all sigmas
//! of a line gives the measurement weight one, as in the paper.
//!
//! `ends` are `FROM x y z qx qy qz qw` and `TO x y z qx qy qz qw`, each optional: the pose of the measuring sensor or
//! of the measured point (the lever arm of an antenna) in its vehicle's frame.
//!
//! A file without any `FIX` or `FIX_...` line has its first vertex held.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::str::SplitAsciiWhitespace;

use nalgebra::{Matrix6, UnitQuaternion, Vector3};
use skein_estimation::cooperative::{Edge, Graph, Measurement, NodeIndex, Noise, Refusal, Weight};
use skein_estimation::{Body, Sensor, Transform, TransformError, World};

/// Longest file that is read, bytes.
pub const FILE_BYTES_MAX: u64 = 1 << 30;

/// Longest line that is read, bytes: an edge with its information matrix at full precision takes about 800.
pub const LINE_BYTES_MAX: usize = 4096;

/// A measurement graph with what is needed to write it back.
#[derive(Debug, Clone)]
pub struct PoseGraph {
    /// The graph; solve this.
    pub graph: Graph,
    lines: Vec<Line>,
}

#[derive(Debug, Clone)]
enum Line {
    Vertex {
        id: u64,
        node: NodeIndex,
    },
    /// Anything else, written back as it was.
    Kept(String),
}

/// What is wrong with a line, and what to do about it.
#[derive(Debug, Clone, PartialEq, thiserror::Error, miette::Diagnostic)]
#[error("line {line}: {problem}")]
pub struct PoseGraphError {
    /// Counted from 1.
    pub line: usize,
    /// What is wrong.
    pub problem: Problem,
    /// What to do.
    #[help]
    pub help: String,
}

/// What can be wrong with a line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Problem {
    /// The first word is no statement.
    #[error("`{word}` is no statement of a pose-graph file")]
    UnknownStatement {
        /// The word, shortened.
        word: String,
    },
    /// The line ends before everything was said.
    #[error("the {what} is missing")]
    Missing {
        /// What should have come.
        what: &'static str,
    },
    /// A word is not the number it should be.
    #[error("`{word}` is not a {what}")]
    NotANumber {
        /// What should have come.
        what: &'static str,
        /// The word, shortened.
        word: String,
    },
    /// There are words after the end of the statement.
    #[error("`{word}` comes after the end of the statement")]
    Trailing {
        /// The first of them, shortened.
        word: String,
    },
    /// A vertex is declared twice.
    #[error("vertex {id} is declared a second time; the first is on line {first}")]
    RepeatedVertex {
        /// Its number in the file.
        id: u64,
        /// The line of the first.
        first: usize,
    },
    /// A vertex is named but never declared.
    #[error("vertex {id} is named here but declared nowhere")]
    UnknownVertex {
        /// Its number in the file.
        id: u64,
    },
    /// A pose or rotation is none.
    #[error(transparent)]
    Transform(#[from] TransformError),
    /// The measurement or its weight cannot be.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The line is longer than any statement.
    #[error("the line has {bytes} bytes; the limit is {LINE_BYTES_MAX}")]
    TooLong {
        /// Its length.
        bytes: usize,
    },
    /// The file declares no vertex.
    #[error("the file declares no vertex")]
    NoVertex,
}

impl Problem {
    fn help(&self) -> String {
        match self {
            Self::UnknownStatement { .. } => "statements are VERTEX_SE3:QUAT, EDGE_SE3:QUAT, FIX, \
                EDGE_{POSE,ORIENTATION,POSITION,BEARING,DISTANCE} and FIX_{POSE,ORIENTATION,POSITION}; \
                2-D files (SE2) are not read. Begin a line with # to skip it"
                .into(),
            Self::Missing { what } => format!("the line ends too early: add the {what}, or see whether the file was cut"),
            Self::NotANumber { what, .. } => format!("write the {what} as a plain decimal number, such as 12 or -0.5e-3"),
            Self::Trailing { .. } => "remove it, or begin a comment with #".into(),
            Self::RepeatedVertex { .. } => "give every vertex one number and one line".into(),
            Self::UnknownVertex { id } => format!("add a line `VERTEX_SE3:QUAT {id} x y z qx qy qz qw` with its initial pose"),
            Self::Transform(TransformError::NotUnit { .. }) => {
                "a rotation is a quaternion `qx qy qz qw` of length one; is the scalar part last?".into()
            }
            Self::Transform(TransformError::NotFinite { .. }) => "replace the infinite number or the NaN".into(),
            Self::Refused(Refusal::BadWeight) => {
                "the 21 numbers are the upper triangle, by rows, of a matrix without negative eigenvalues".into()
            }
            Self::Refused(Refusal::BadNoise { .. }) => {
                "a sigma is a standard deviation above zero; write `unit` for the weight one".into()
            }
            Self::Refused(Refusal::NotUnit { .. }) => "a bearing is a direction: scale it to length one".into(),
            Self::Refused(Refusal::Contradicts { .. }) => {
                "one of the two measurements is wrong, or its sigma is far too small: remove it or state its noise".into()
            }
            Self::Refused(Refusal::SameNode) => "a measurement is between two different vertices".into(),
            Self::Refused(_) => "correct the measurement or remove the line".into(),
            Self::TooLong { .. } => "put every statement on a line of its own".into(),
            Self::NoVertex => "add at least one line `VERTEX_SE3:QUAT id x y z qx qy qz qw`".into(),
        }
    }

    fn on(self, line: usize) -> PoseGraphError {
        PoseGraphError {
            line,
            help: self.help(),
            problem: self,
        }
    }
}

/// An edge or fix whose vertices may not be known yet.
struct Tie {
    line: usize,
    from: Option<u64>,
    to: u64,
    edge: Edge,
}

/// Reads a pose-graph file.
///
/// # Errors
/// [`PoseGraphError`] names the first line that cannot be understood or used, and says what to do.
pub fn parse(text: &str) -> Result<PoseGraph, PoseGraphError> {
    let mut graph = Graph::new();
    let mut vertices: BTreeMap<u64, (NodeIndex, usize)> = BTreeMap::new();
    let mut ties: Vec<Tie> = Vec::new();
    let mut held: Vec<(usize, u64)> = Vec::new();
    let mut lines = Vec::new();
    let mut first = None;
    for (index, content) in text.lines().enumerate() {
        let line = index + 1;
        match parse_line(content, line).map_err(|problem| problem.on(line))? {
            Statement::Nothing => lines.push(Line::Kept(content.to_owned())),
            Statement::Vertex { id, pose } => {
                if let Some((_, first)) = vertices.get(&id) {
                    return Err(Problem::RepeatedVertex { id, first: *first }.on(line));
                }
                let node = graph
                    .add_node(pose)
                    .map_err(|refusal| Problem::from(refusal).on(line))?;
                first.get_or_insert(node);
                vertices.insert(id, (node, line));
                lines.push(Line::Vertex { id, node });
            }
            Statement::Hold(ids) => {
                held.extend(ids.into_iter().map(|id| (line, id)));
                lines.push(Line::Kept(content.to_owned()));
            }
            Statement::Tie(tie) => {
                ties.push(tie);
                lines.push(Line::Kept(content.to_owned()));
            }
        }
    }
    let Some(first) = first else {
        return Err(Problem::NoVertex.on(lines.len().max(1)));
    };
    let find = |line: usize, id: u64| match vertices.get(&id) {
        Some((node, _)) => Ok(*node),
        None => Err(Problem::UnknownVertex { id }.on(line)),
    };
    let hangs_on_nothing = held.is_empty() && ties.iter().all(|tie| tie.from.is_some());
    if hangs_on_nothing {
        graph
            .hold(first)
            .map_err(|refusal| Problem::from(refusal).on(1))?;
    }
    for (line, id) in held {
        graph
            .hold(find(line, id)?)
            .map_err(|refusal| Problem::from(refusal).on(line))?;
    }
    for Tie {
        line,
        from,
        to,
        edge,
    } in ties
    {
        let from = from.map_or(Ok(NodeIndex::REFERENCE), |id| find(line, id))?;
        graph
            .add_edge(from, find(line, to)?, edge)
            .map_err(|refusal| Problem::from(refusal).on(line))?;
    }
    Ok(PoseGraph { graph, lines })
}

impl PoseGraph {
    /// The file again, with the graph's present poses in the vertex lines and every other line as it was.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        for line in &self.lines {
            match line {
                Line::Kept(content) => text.push_str(content),
                Line::Vertex { id, node } => {
                    // A vertex line exists only for a node that was added.
                    let pose = self
                        .graph
                        .pose(*node)
                        .copied()
                        .unwrap_or_else(Transform::identity);
                    let (t, q) = (pose.translation, pose.rotation);
                    // Writing into a string cannot fail; the numbers read back as the same numbers.
                    let _ = write!(
                        text,
                        "VERTEX_SE3:QUAT {id} {} {} {} {} {} {} {}",
                        t.x, t.y, t.z, q.i, q.j, q.k, q.w
                    );
                }
            }
            text.push('\n');
        }
        text
    }

    /// Vertices in the file.
    #[must_use]
    pub fn vertices(&self) -> usize {
        self.graph.nodes().len() - 1
    }
}

#[expect(clippy::large_enum_variant, reason = "lives for one line only")]
enum Statement {
    Nothing,
    Vertex {
        id: u64,
        pose: Transform<World, Body>,
    },
    Hold(Vec<u64>),
    Tie(Tie),
}

fn parse_line(content: &str, line: usize) -> Result<Statement, Problem> {
    if content.len() > LINE_BYTES_MAX {
        return Err(Problem::TooLong {
            bytes: content.len(),
        });
    }
    let said = content.split('#').next().unwrap_or_default();
    let mut words = Words(said.split_ascii_whitespace());
    let Some(statement) = words.0.next() else {
        return Ok(Statement::Nothing);
    };
    let parsed = match statement {
        "VERTEX_SE3:QUAT" => Statement::Vertex {
            id: words.id("vertex number")?,
            pose: words.pose()?,
        },
        "FIX" => {
            let mut ids = vec![words.id("vertex number")?];
            while !words.is_empty() {
                ids.push(words.id("vertex number")?);
            }
            Statement::Hold(ids)
        }
        "EDGE_SE3:QUAT" => tie(&mut words, line, Measured::ByVertex, Words::informed_pose)?,
        "EDGE_POSE" => tie(&mut words, line, Measured::ByVertex, Words::noisy_pose)?,
        "EDGE_ORIENTATION" => tie(&mut words, line, Measured::ByVertex, Words::orientation)?,
        "EDGE_POSITION" => tie(&mut words, line, Measured::ByVertex, Words::position)?,
        "EDGE_BEARING" => tie(&mut words, line, Measured::ByVertex, Words::bearing)?,
        "EDGE_DISTANCE" => tie(&mut words, line, Measured::ByVertex, Words::distance)?,
        "FIX_POSE" => tie(&mut words, line, Measured::FromWorld, Words::noisy_pose)?,
        "FIX_ORIENTATION" => tie(&mut words, line, Measured::FromWorld, Words::orientation)?,
        "FIX_POSITION" => tie(&mut words, line, Measured::FromWorld, Words::position)?,
        other => {
            return Err(Problem::UnknownStatement {
                word: shortened(other),
            });
        }
    };
    match words.0.next() {
        None => Ok(parsed),
        Some(word) => Err(Problem::Trailing {
            word: shortened(word),
        }),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Measured {
    ByVertex,
    FromWorld,
}

/// The rest of an edge or fix after its first word, of which `kind` reads measurement and weight.
fn tie<'a>(
    words: &mut Words<'a>,
    line: usize,
    measured: Measured,
    kind: fn(&mut Words<'a>) -> Result<(Measurement, Weight), Problem>,
) -> Result<Statement, Problem> {
    let from = match measured {
        Measured::ByVertex => Some(words.id("number of the measuring vertex")?),
        Measured::FromWorld => None,
    };
    let to = words.id("number of the measured vertex")?;
    let (measurement, weight) = kind(words)?;
    let [from_offset, to_offset] = words.ends()?;
    let edge = Edge::with_offsets(measurement, weight, from_offset, to_offset)?;
    Ok(Statement::Tie(Tie {
        line,
        from,
        to,
        edge,
    }))
}

/// The words of a line that are still to be read.
#[derive(Clone)]
struct Words<'a>(SplitAsciiWhitespace<'a>);

impl Words<'_> {
    fn is_empty(&self) -> bool {
        self.0.clone().next().is_none()
    }

    fn id(&mut self, what: &'static str) -> Result<u64, Problem> {
        let word = self.0.next().ok_or(Problem::Missing { what })?;
        word.parse().map_err(|_| Problem::NotANumber {
            what,
            word: shortened(word),
        })
    }

    fn number(&mut self, what: &'static str) -> Result<f64, Problem> {
        let word = self.0.next().ok_or(Problem::Missing { what })?;
        word.parse().map_err(|_| Problem::NotANumber {
            what,
            word: shortened(word),
        })
    }

    fn vector(&mut self, what: [&'static str; 3]) -> Result<[f64; 3], Problem> {
        Ok([
            self.number(what[0])?,
            self.number(what[1])?,
            self.number(what[2])?,
        ])
    }

    fn pose<To, From>(&mut self) -> Result<Transform<To, From>, Problem> {
        let translation = self.vector(["x coordinate", "y coordinate", "z coordinate"])?;
        let vector = self.vector(["quaternion's qx", "quaternion's qy", "quaternion's qz"])?;
        let scalar = self.number("quaternion's qw")?;
        Ok(Transform::from_quaternion(scalar, vector, translation)?)
    }

    fn rotation(&mut self) -> Result<UnitQuaternion<f64>, Problem> {
        let vector = self.vector(["quaternion's qx", "quaternion's qy", "quaternion's qz"])?;
        let scalar = self.number("quaternion's qw")?;
        Ok(Transform::<Sensor, Sensor>::from_quaternion(scalar, vector, [0.0; 3])?.rotation)
    }

    /// The sigmas of a kind, or the word `unit` for all of them.
    fn weight(&mut self, rotation: bool, translation: bool) -> Result<Weight, Problem> {
        let mut ahead = self.clone();
        if ahead.0.next() == Some("unit") {
            *self = ahead;
            return Ok(Weight::Unit);
        }
        let mut noise = Noise::UNIT;
        if rotation {
            noise.rotation_rad = self.number("sigma in radians")?;
        }
        if translation {
            noise.translation = self.number("sigma in metres")?;
        }
        Ok(Weight::Noise(noise))
    }

    fn informed_pose(&mut self) -> Result<(Measurement, Weight), Problem> {
        let measurement = Measurement::pose(self.pose()?)?;
        let mut information = Matrix6::zeros();
        for row in 0..6 {
            for column in row..6 {
                let number = self.number("information matrix's next number")?;
                // Translation first in the file, rotation first in the solver.
                let (i, j) = ((row + 3) % 6, (column + 3) % 6);
                information[(i, j)] = number;
                information[(j, i)] = number;
            }
        }
        Ok((measurement, Weight::Information(information)))
    }

    fn noisy_pose(&mut self) -> Result<(Measurement, Weight), Problem> {
        Ok((Measurement::pose(self.pose()?)?, self.weight(true, true)?))
    }

    fn orientation(&mut self) -> Result<(Measurement, Weight), Problem> {
        Ok((
            Measurement::orientation(self.rotation()?)?,
            self.weight(true, false)?,
        ))
    }

    fn position(&mut self) -> Result<(Measurement, Weight), Problem> {
        let vector = self.vector(["x coordinate", "y coordinate", "z coordinate"])?;
        Ok((
            Measurement::position(Vector3::from(vector))?,
            self.weight(false, true)?,
        ))
    }

    fn bearing(&mut self) -> Result<(Measurement, Weight), Problem> {
        let vector = self.vector([
            "x of the direction",
            "y of the direction",
            "z of the direction",
        ])?;
        Ok((
            Measurement::bearing(Vector3::from(vector))?,
            self.weight(true, false)?,
        ))
    }

    fn distance(&mut self) -> Result<(Measurement, Weight), Problem> {
        Ok((
            Measurement::distance(self.number("distance")?)?,
            self.weight(false, true)?,
        ))
    }

    fn ends(&mut self) -> Result<[Transform<Body, Sensor>; 2], Problem> {
        let mut ends = [Transform::identity(), Transform::identity()];
        for (end, name) in ends.iter_mut().zip(["FROM", "TO"]) {
            let mut ahead = self.clone();
            if ahead.0.next() == Some(name) {
                *self = ahead;
                *end = self.pose()?;
            }
        }
        Ok(ends)
    }
}

/// A word as it is safe to show: at most 32 characters.
fn shortened(word: &str) -> String {
    let mut short: String = word.chars().take(32).collect();
    if short.len() < word.len() {
        short.push('…');
    }
    short
}

#[cfg(test)]
mod tests {
    use skein_estimation::cooperative::{Optimiser, SolveStatus, solve};

    use super::*;

    const SQUARE: &str = "\
# a small file of every statement
VERTEX_SE3:QUAT 7 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 8 1.1 0 0 0 0 0 1   # off by 0.1
EDGE_SE3:QUAT 7 8 1 0 0 0 0 0 1  1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4
EDGE_POSE 7 8 1 0 0 0 0 0 1 0.1 0.1
EDGE_ORIENTATION 7 8 0 0 0 1 unit
EDGE_POSITION 7 8 1 0 0 0.1

EDGE_BEARING 7 8 1 0 0 0.1
EDGE_DISTANCE 7 8 1.5 0.1 TO 0.5 0 0 0 0 0 1
FIX_POSITION 8 1 2 0 0.1 TO 0 2 0 0 0 0 1
FIX_ORIENTATION 7 0 0 0 1 0.1
FIX_POSE 7 0 0 0 0 0 0 1 unit
FIX 7
";

    fn refused(text: &str) -> PoseGraphError {
        parse(text).unwrap_err()
    }

    #[test]
    fn every_statement_is_read_and_the_answer_written_in_the_same_form() {
        let mut file = parse(SQUARE).unwrap();
        assert_eq!((file.vertices(), file.graph.edges().len()), (2, 9));
        let solution = solve(&mut file.graph, &Optimiser::gauss_newton(), |_| ());
        assert_eq!(solution.status, SolveStatus::Converged);
        assert!(solution.cost_after < 1e-12);
        let again = parse(&file.to_text()).unwrap();
        assert_eq!(again.graph.nodes(), file.graph.nodes());
        assert_eq!(again.graph.edges(), file.graph.edges());
        assert_eq!(again.to_text(), file.to_text());
        assert!(
            file.to_text().starts_with(
                "# a small file of every statement\nVERTEX_SE3:QUAT 7 0 0 0 0 0 0 1\n"
            )
        );
    }

    #[test]
    fn a_file_that_hangs_on_nothing_has_its_first_vertex_held() {
        let file =
            parse("VERTEX_SE3:QUAT 3 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 4 1 0 0 0 0 0 1\n").unwrap();
        let held: Vec<bool> = file
            .graph
            .indices()
            .map(|node| file.graph.is_held(node))
            .collect();
        assert_eq!(held, [true, true, false]);
        let fixed = parse("VERTEX_SE3:QUAT 3 0 0 0 0 0 0 1\nFIX_POSITION 3 0 0 0 1\n").unwrap();
        assert!(
            !fixed.graph.is_held(NodeIndex::REFERENCE)
                || !fixed
                    .graph
                    .indices()
                    .skip(1)
                    .any(|n| fixed.graph.is_held(n))
        );
    }

    #[test]
    fn the_information_matrix_is_read_translation_first() {
        let text = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n\
            EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 10 0 0 0.5 0 0 20 0 0 0 0 30 0 0 0 40 0 0 50 0 60\n";
        let file = parse(text).unwrap();
        let Weight::Information(matrix) = file.graph.edges()[0].edge.weight() else {
            panic!()
        };
        assert_eq!(
            matrix.diagonal().as_slice(),
            [40.0, 50.0, 60.0, 10.0, 20.0, 30.0]
        );
        assert_eq!((matrix[(0, 3)], matrix[(3, 0)]), (0.5, 0.5));
    }

    #[test]
    fn errors_name_the_line_and_what_to_do() {
        let vertex = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n";
        let cases: Vec<(String, usize, &str)> = vec![
            ("\n\nVERTEX_SE2 0 0 0 0\n".into(), 3, "no statement"),
            ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0\n".into(), 1, "qw is missing"),
            (
                "VERTEX_SE3:QUAT 0 0 zero 0 0 0 0 1\n".into(),
                1,
                "`zero` is not a y coordinate",
            ),
            (
                "VERTEX_SE3:QUAT -1 0 0 0 0 0 0 1\n".into(),
                1,
                "`-1` is not a vertex number",
            ),
            (
                "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1 9\n".into(),
                1,
                "after the end",
            ),
            ("VERTEX_SE3:QUAT 0 0 0 0 0 0 1 1\n".into(), 1, "length"),
            (
                "VERTEX_SE3:QUAT 0 0 nan 0 0 0 0 1\n".into(),
                1,
                "not finite",
            ),
            (
                format!("{vertex}{vertex}"),
                2,
                "a second time; the first is on line 1",
            ),
            (
                format!("{vertex}EDGE_DISTANCE 0 5 1 1\n"),
                2,
                "vertex 5 is named here",
            ),
            (format!("{vertex}EDGE_DISTANCE 0 0 1 1\n"), 2, "one node"),
            (format!("{vertex}EDGE_DISTANCE 0 0 -1 1\n"), 2, "negative"),
            (format!("{vertex}EDGE_DISTANCE 0 0 1 0\n"), 2, "noise"),
            (format!("{vertex}EDGE_BEARING 0 0 1 1 1 0.1\n"), 2, "length"),
            (format!("{vertex}FIX 3\n"), 2, "vertex 3"),
            (format!("{vertex}FIX\n"), 2, "missing"),
            (
                format!("{vertex}FIX_POSITION 0 0 0 0 1 FROM 1\n"),
                2,
                "missing",
            ),
            (
                format!("{vertex}# {}\n", "x".repeat(LINE_BYTES_MAX)),
                2,
                "limit",
            ),
            ("# nothing\n".into(), 1, "no vertex"),
            (String::new(), 1, "no vertex"),
        ];
        for (text, line, part) in cases {
            let error = refused(&text);
            assert_eq!(error.line, line, "{text}");
            assert!(error.to_string().contains(part), "{error} has no `{part}`");
            assert!(!error.help.is_empty());
        }
    }

    #[test]
    fn measurements_that_exclude_each_other_are_refused_with_the_line() {
        let text = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n\
            EDGE_DISTANCE 0 1 1 0.01\nEDGE_DISTANCE 0 1 5 0.01\n";
        let error = refused(text);
        assert_eq!(error.line, 4);
        assert!(matches!(
            error.problem,
            Problem::Refused(Refusal::Contradicts { .. })
        ));
    }

    #[test]
    fn spoilt_files_are_refused_or_read_but_never_panic() {
        // Every byte of a good file replaced by a hostile one, and the file cut at every place.
        for at in (0..SQUARE.len()).filter(|&at| SQUARE.is_char_boundary(at)) {
            let _ = parse(&SQUARE[..at]);
            for spoil in [
                "-",
                "9",
                "e",
                " ",
                "\n",
                "\0",
                "ß",
                "nan",
                "1e999",
                "18446744073709551616",
            ] {
                let _ = parse(&format!("{}{spoil}{}", &SQUARE[..at], &SQUARE[at + 1..]));
            }
        }
    }
}
