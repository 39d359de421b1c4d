//! Solving rounds in order, each once: by a star about the vehicle's prior, by the team estimator, or, of a vehicle without a
//! pose, by what others say of it. The solution becomes the present correction of its odometry.

use skein_estimation::cooperative::{Solution, SolveStatus};
use skein_estimation::odometry::OdometryPoint;
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform, VehicleId, World};
use skein_proto::name::Name;

use crate::dead_reckoning::Correction;
use crate::gathering::Material;
use crate::local_star::{Built, Centre, Judged};
use crate::neighbours::Relative;
use crate::placing;
use crate::refused::Refused;
use crate::rounds::{OPEN_MAX, Round};
use crate::smoothing::{Smoothed, Smoothing, Told};
use crate::translate;
use crate::trust::Mark;
use crate::vehicle::Vehicle;

impl Vehicle {
    /// What the oldest open round would come to with what is there. A round that still waits for somebody when the next
    /// begins must not cost the others what it knows already: this is for the priors that are told, and nothing else.
    pub(crate) fn foresee(&mut self) -> Option<Correction> {
        if self.smoothing.is_some() {
            return None;
        }
        let round = self.rounds.open.pop_front()?;
        let foreseen = self.foresee_round(&round);
        self.rounds.open.push_front(round);
        foreseen
    }

    fn foresee_round(&mut self, round: &Round) -> Option<Correction> {
        let odometry = round.odometry?;
        let prior = self.reckoning.placed_at(&odometry)?;
        let gathered = self.material(round, true).gather().ok()?;
        let built = gathered.build(&mut self.star, Centre::Prior(prior));
        if built.edges() == 0 {
            return None;
        }
        let (solution, world_from_body) = self.solve_star(&built);
        let good = solution.status != SolveStatus::NotFinite;
        (good && translate::is_sayable(&world_from_body))
            .then(|| Correction::placed(&odometry, world_from_body))
    }

    /// What a round's star is gathered from.
    fn material<'r>(&self, round: &'r Round, deadline_passed: bool) -> Material<'_, 'r> {
        Material {
            round,
            neighbours: &self.neighbours,
            reckoning: &self.reckoning,
            body_from_target: self.config.body_from_target,
            period: self.config.period,
            kernel: self.config.mode.kernel(),
            placed_since: self.placed_since,
            fix_trust: self.fix_trust,
            deadline_passed,
        }
    }

    /// Solves the star that was built: where this vehicle was at the round's instant.
    fn solve_star(&mut self, built: &Built) -> (Solution, Transform<World, Body>) {
        let solution = self.star.solve(&mut self.workspace, &self.config.optimiser);
        let world_from_body =
            solution.world_from_body.reframe() * built.instant_from_solved.inverse();
        (solution, world_from_body)
    }

    /// Solves rounds in order, each once: when everybody told has answered, or its time is up.
    pub(crate) fn solve_rounds(&mut self, now: Stamp) {
        while let Some(round) = self.rounds.open.pop_front() {
            let deadline_passed =
                now >= self.rounds.deadline(&round) || self.rounds.open.len() >= OPEN_MAX;
            let early = now < self.rounds.earliest(&round) && !deadline_passed;
            if early || !self.solve_round(now, &round, deadline_passed) {
                self.rounds.open.push_front(round);
                return;
            }
            self.read_distances(now, &round);
            self.rounds.close(round.index);
            self.neighbours.forget_exchanges(round.index);
        }
    }

    /// Solves one round. False when it must wait.
    fn solve_round(&mut self, now: Stamp, round: &Round, deadline_passed: bool) -> bool {
        let Some(odometry) = round.odometry else {
            self.count_refusals(now, &Built::without_odometry(round));
            return true;
        };
        match self.reckoning.placed_at(&odometry) {
            Some(prior) if self.smoothing.is_some() => {
                self.smooth(now, round, odometry, prior, deadline_passed)
            }
            Some(prior) => self.solve_placed(now, round, &odometry, prior, deadline_passed),
            None => self.solve_unplaced(now, round, &odometry, deadline_passed),
        }
    }

    /// Solves a round of a vehicle that has a pose, by a star about its prior.
    fn solve_placed(
        &mut self,
        now: Stamp,
        round: &Round,
        odometry: &OdometryPoint,
        prior: Transform<World, Body>,
        deadline_passed: bool,
    ) -> bool {
        let Ok(gathered) = self.material(round, deadline_passed).gather() else {
            return false;
        };
        let built = gathered.build(&mut self.star, Centre::Prior(prior));
        if built.edges() == 0 {
            // A round with nothing to solve costs nothing while it waits for the next one: a first contact still counts.
            if self.rounds.open.is_empty() && !deadline_passed {
                return false;
            }
            self.counts.coasted += 1;
            self.count_refusals(now, &built);
            return true;
        }
        let (solution, world_from_body) = self.solve_star(&built);
        let judged = match self.config.mode.kernel() {
            None => Vec::new(),
            Some(kernel) => gathered.judge(
                &self.star,
                &self.workspace,
                &built,
                &world_from_body,
                &kernel,
            ),
        };
        self.finish(now, round, odometry, &built, &solution, world_from_body);
        self.judge(now, Mark::of(odometry), &judged);
        let accepted = |judged: &Judged| judged.accepted > 0;
        if judged.is_empty() || judged.iter().any(accepted) {
            self.counts.corrected_at = Some(round.instant);
        }
        self.count_refusals(now, &built);
        true
    }

    /// Solves a round of a vehicle that has no pose: others, or a fix, may say where it is.
    fn solve_unplaced(
        &mut self,
        now: Stamp,
        round: &Round,
        odometry: &OdometryPoint,
        deadline_passed: bool,
    ) -> bool {
        let Ok(gathered) = self.material(round, deadline_passed).gather() else {
            return false;
        };
        let starts = gathered.starts();
        let found = placing::search(
            &mut self.star,
            &mut self.workspace,
            &self.config.optimiser,
            &gathered,
            &starts,
        );
        let by_distances = self.found_by_distances(round, odometry);
        let built = match (found.pose, by_distances) {
            (Some(world_from_body), _) => {
                self.place(round, odometry, world_from_body);
                found.built
            }
            (None, Some(told)) => {
                if self.place(round, odometry, told.world_from_body) {
                    self.join(odometry, told);
                }
                found.built
            }
            (None, None) => found.built.in_vain(&gathered, &Refused::Unplaced),
        };
        self.count_refusals(now, &built);
        true
    }

    /// Solves a round by the team estimator.
    fn smooth(
        &mut self,
        now: Stamp,
        round: &Round,
        odometry: OdometryPoint,
        prior: Transform<World, Body>,
        deadline_passed: bool,
    ) -> bool {
        self.find_neighbours(round, &odometry, &prior);
        let Some(smoothing) = &mut self.smoothing else {
            return true;
        };
        let may_wait = !deadline_passed;
        if may_wait && !smoothing.is_complete(round, &self.neighbours) {
            return false;
        }
        // As of a star: a round in which nobody measured anything costs nothing while it waits for the next one.
        let is_last = self.rounds.open.is_empty();
        if may_wait && is_last && !smoothing.has_news(round, &self.neighbours) {
            return false;
        }
        let smoothed = smoothing.solve(
            now,
            &Told {
                round,
                odometry,
                prior,
                neighbours: &self.neighbours,
                reckoning: &self.reckoning,
                body_from_target: self.config.body_from_target,
            },
        );
        for (name, why) in &smoothed.refused {
            match name {
                Some(name) => self.count_refusal(*name, why),
                None => self.refused.refuse(why),
            }
        }
        for name in &smoothed.quarantined {
            if let Some(neighbour) = self.neighbours.get_mut(*name) {
                neighbour.counts.quarantines += 1;
            }
        }
        self.take_smoothed(now, round, &odometry, &smoothed);
        if !smoothed.quarantined.is_empty() {
            self.report_health(now);
        }
        true
    }

    /// Makes what the team estimator found the present estimate.
    fn take_smoothed(
        &mut self,
        now: Stamp,
        round: &Round,
        odometry: &OdometryPoint,
        smoothed: &Smoothed,
    ) {
        let me = VehicleId(self.config.vehicle.hash());
        let verdicts = &smoothed.report.verdicts;
        self.counts.last_latency = Some(now - round.instant);
        self.counts.last_edges = verdicts.len() as u64;
        if verdicts.is_empty() {
            self.counts.coasted += 1;
        } else {
            self.counts.solved += 1;
            let undetermined = u64::from(smoothed.report.undetermined);
            self.counts.troubled.add("undetermined", undetermined);
        }
        for verdict in verdicts {
            let mine = verdict.by == me || verdict.of == me;
            if verdict.accepted && mine {
                self.counts.corrected_at = Some(round.instant);
            }
            if verdict.is_fix && mine && !verdict.accepted {
                self.refused.refuse(&Refused::Gated);
            }
            let other = if verdict.by == me {
                verdict.of
            } else {
                verdict.by
            };
            let neighbour = smoothed
                .names
                .get(&other)
                .and_then(|name| self.neighbours.get_mut(*name));
            if let Some(neighbour) = neighbour {
                if verdict.accepted {
                    neighbour.counts.fused += 1;
                } else {
                    neighbour.counts.refused.refuse(&Refused::Gated);
                }
            }
        }
        let Some(team) = self.smoothing.as_ref().map(Smoothing::team) else {
            return;
        };
        let own = team
            .own()
            .filter(|own| own.point.taken == odometry.taken && !smoothed.report.undetermined);
        let Some(own) = own else {
            return;
        };
        if !translate::is_sayable(&own.world_from_body) {
            self.counts.troubled.count("thrown_away");
            return;
        }
        for (id, name) in &smoothed.names {
            let relative = team.relative(*id).map(|relative| Relative {
                taken: relative.instant,
                body_from_neighbour: relative.body_from_neighbour,
                covariance: Some(relative.covariance),
            });
            if let Some(neighbour) = self.neighbours.get_mut(*name) {
                neighbour.relative = relative;
            }
        }
        self.reckoning.correct(odometry, own.world_from_body);
        self.moved = true;
    }

    /// A round says where this vehicle is, which has no pose to build on. A second one that agrees makes it the pose, and
    /// that it did is returned.
    fn place(
        &mut self,
        round: &Round,
        odometry: &OdometryPoint,
        world_from_body: Transform<World, Body>,
    ) -> bool {
        let is_present = self
            .reckoning
            .newest()
            .is_some_and(|newest| newest.segment == odometry.segment);
        let is_placed = is_present
            && self
                .placing
                .propose(round.instant, odometry, &world_from_body);
        if is_placed {
            self.reckoning.correct(odometry, world_from_body);
            self.counts.corrected_at = Some(round.instant);
            self.begin_anew(Mark::of(odometry));
        }
        is_placed
    }

    fn count_refusals(&mut self, now: Stamp, built: &Built) {
        for (name, why) in &built.refused {
            self.count_refusal(*name, why);
        }
        for (sensor, why) in &built.fixes_refused {
            self.sensors.count(now, *sensor, 0, &Err(why.clone()));
        }
    }

    /// Makes the solution of a round the present correction.
    fn finish(
        &mut self,
        now: Stamp,
        round: &Round,
        odometry: &OdometryPoint,
        built: &Built,
        solution: &Solution,
        world_from_body: Transform<World, Body>,
    ) {
        self.counts.last_latency = Some(now - round.instant);
        self.counts.last_edges = built.edges();
        self.counts.solved += 1;
        self.counts.troubled.add(
            trouble(solution),
            u64::from(solution.status != SolveStatus::Converged),
        );
        if solution.status == SolveStatus::NotFinite || !translate::is_sayable(&world_from_body) {
            self.counts.troubled.count("thrown_away");
            return;
        }
        self.reckoning.correct(odometry, world_from_body);
        self.moved = true;
        for used in &built.used {
            let Some(neighbour) = self.neighbours.get_mut(used.name) else {
                continue;
            };
            neighbour.counts.fused += used.edges;
            if let Some(world_from_neighbour) = self.workspace.neighbour(used.index) {
                let world_from_neighbour =
                    world_from_neighbour.reframe() * used.instant_from_solved.inverse();
                let body_from_neighbour = world_from_body.inverse() * world_from_neighbour;
                neighbour.relative = Some(Relative {
                    taken: used.taken,
                    body_from_neighbour,
                    covariance: None,
                });
            }
        }
    }

    /// Takes what a round said of each neighbour and of the fixes: contact narrows, silence and disagreement do not, and
    /// whoever goes on disagreeing while others agree is put into quarantine.
    fn judge(&mut self, now: Stamp, mark: Mark, judged: &[Judged]) {
        let Some(kernel) = self.config.mode.kernel() else {
            return;
        };
        for judged in judged {
            let Some(name) = judged.neighbour else {
                self.fix_trust
                    .judge(mark, judged.contact, judged.outcome, &kernel);
                for sensor in &judged.gated_fixes {
                    self.sensors.count(now, *sensor, 0, &Err(Refused::Gated));
                }
                continue;
            };
            let Some(neighbour) = self.neighbours.get_mut(name) else {
                continue;
            };
            if neighbour.trust.is_quarantined() {
                let why = Refused::Quarantined.word();
                neighbour.counts.refused.add(why, judged.gated);
            } else {
                let why = Refused::Gated.word();
                neighbour.counts.refused.add(why, judged.gated);
                neighbour.counts.fused = neighbour.counts.fused.saturating_sub(judged.gated);
            }
            neighbour
                .trust
                .judge(mark, judged.contact, judged.outcome, &kernel);
        }
        let (mut good, mut doubted) = (0, 0);
        for (_, neighbour) in self.neighbours.iter() {
            good += usize::from(neighbour.trust.is_good(now));
            doubted += usize::from(neighbour.trust.is_doubted());
        }
        let names: Vec<Name> = judged
            .iter()
            .filter_map(|judged| judged.neighbour)
            .collect();
        for name in names {
            if let Some(neighbour) = self.neighbours.get_mut(name)
                && neighbour.trust.quarantine(mark, good, doubted)
            {
                neighbour.counts.quarantines += 1;
            }
        }
    }
}

/// The solver's status in one word.
const fn trouble(solution: &Solution) -> &'static str {
    match solution.status {
        SolveStatus::Converged => "converged",
        SolveStatus::NothingMeasured => "nothing_measured",
        SolveStatus::IterationLimit => "iteration_limit",
        SolveStatus::Stalled => "stalled",
        SolveStatus::Degenerate(_) => "degenerate",
        SolveStatus::NotFinite => "not_finite",
    }
}
