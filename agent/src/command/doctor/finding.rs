//! What one check found, and the page of all of them.

use crate::command::output::plain;
use serde::Serialize;

/// How much it matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Level {
    Ok,
    /// Could not be told here.
    Skipped,
    /// Works, but not as well as it might.
    Warning,
    /// Needs to be mended.
    Problem,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    pub(super) check: String,
    pub(super) level: Level,
    pub(super) found: String,
    pub(super) means: Option<String>,
    pub(super) advice: Option<String>,
}

impl Finding {
    pub(super) fn ok(check: &str, found: impl Into<String>) -> Self {
        Self::of(check, Level::Ok, found)
    }

    pub(super) fn skipped(check: &str, found: impl Into<String>) -> Self {
        Self::of(check, Level::Skipped, found)
    }

    pub(super) fn warning(
        check: &str,
        found: impl Into<String>,
        means: &str,
        advice: &str,
    ) -> Self {
        Self::of(check, Level::Warning, found).explained(means, advice)
    }

    pub(super) fn problem(
        check: &str,
        found: impl Into<String>,
        means: &str,
        advice: &str,
    ) -> Self {
        Self::of(check, Level::Problem, found).explained(means, advice)
    }

    fn of(check: &str, level: Level, found: impl Into<String>) -> Self {
        Self {
            check: check.to_owned(),
            level,
            found: plain(&found.into()),
            means: None,
            advice: None,
        }
    }

    fn explained(self, means: &str, advice: &str) -> Self {
        Self {
            means: Some(plain(means)),
            advice: Some(plain(advice)),
            ..self
        }
    }
}

/// All checks, in the order in which they were made.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) problems: usize,
    pub(super) warnings: usize,
    pub(super) checks: Vec<Finding>,
}

impl Report {
    pub(super) fn of(checks: Vec<Finding>) -> Self {
        let count = |level| checks.iter().filter(|check| check.level == level).count();
        Self {
            problems: count(Level::Problem),
            warnings: count(Level::Warning),
            checks,
        }
    }

    /// For people. Writing to a string cannot fail, so its results are dropped.
    pub(super) fn page(&self) -> String {
        use std::fmt::Write;
        let mut page = String::new();
        for finding in &self.checks {
            let word = match finding.level {
                Level::Ok => "ok",
                Level::Skipped => "skipped",
                Level::Warning => "WARNING",
                Level::Problem => "PROBLEM",
            };
            let _ = writeln!(page, "{word:<8} {}: {}", finding.check, finding.found);
            if let Some(means) = &finding.means {
                let _ = writeln!(page, "           means: {means}");
            }
            if let Some(advice) = &finding.advice {
                let _ = writeln!(page, "           do:    {advice}");
            }
        }
        let _ = writeln!(
            page,
            "{} problems, {} warnings",
            self.problems, self.warnings
        );
        page
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_what_was_found_what_it_means_and_what_to_do() {
        let report = Report::of(vec![
            Finding::ok("clock", "2026"),
            Finding::warning("fleet", "nobody", "alone", "start one"),
            Finding::problem("log", "no", "nothing is kept", "mend it"),
        ]);
        assert_eq!((report.problems, report.warnings), (1, 1));
        let page = report.page();
        assert!(page.contains(
            "PROBLEM  log: no\n           means: nothing is kept\n           do:    mend it"
        ));
        assert!(page.ends_with("1 problems, 1 warnings\n"), "{page}");
    }
}
