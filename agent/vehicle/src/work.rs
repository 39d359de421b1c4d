//! Long computations that the shell runs beside the vehicle: values that hold all they need.

use skein_estimation::mutual;
use skein_estimation::ranging::Team;
use skein_estimation::ranging::team::Formation;
use skein_estimation::ranging::window::WindowSettings;

/// A computation to be run, anywhere and at any time. The vehicle has at most one of either pipeline out.
#[derive(Clone, Debug, PartialEq)]
pub struct Work {
    number: u64,
    job: Job,
}

/// What is to be computed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Job {
    /// Who is who in a camera frame.
    Registration(mutual::Work),
    /// Where all are at once, by distances.
    Formation {
        team: Team,
        settings: WindowSettings,
    },
}

/// A computation that has been run.
#[derive(Clone, Debug, PartialEq)]
pub struct Done {
    pub(crate) number: u64,
    pub(crate) outcome: Outcome,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Outcome {
    Registration(mutual::Done),
    /// The best formation, if there is any.
    Formation(Option<Formation>),
}

impl Work {
    pub(crate) const fn new(number: u64, job: Job) -> Self {
        Self { number, job }
    }

    /// Its number: results are taken back by it.
    #[must_use]
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// Runs it.
    #[must_use]
    pub fn run(&self) -> Done {
        let outcome = match &self.job {
            Job::Registration(work) => Outcome::Registration(work.run()),
            Job::Formation { team, settings } => {
                Outcome::Formation(team.solve(settings).into_iter().next())
            }
        };
        Done {
            number: self.number,
            outcome,
        }
    }
}
