//! One vehicle: what it is given goes in by [`Vehicle::handle`], what it wants done comes out by [`Vehicle::poll`].

use std::collections::VecDeque;

use skein_estimation::Transform;
use skein_estimation::cooperative::{Solution, SolveStatus, Star, StarWorkspace};
use skein_estimation::time::{Span, Stamp};
use skein_proto::frame::{Frame, RelativeValue};
use skein_proto::name::Name;

use crate::config::Config;
use crate::counters::Counters;
use crate::dead_reckoning::DeadReckoning;
use crate::hearing::{Heard, Listener};
use crate::input::{Input, PacketKey};
use crate::local_star::{Built, Material};
use crate::neighbours::{Neighbours, Relative};
use crate::output::Output;
use crate::refused::Refused;
use crate::reporting::RoundCounts;
use crate::rounds::{Fix, Loss, OPEN_MAX, Round, Rounds};
use crate::sensors::{Reading, Sensors};
use crate::speaking::{PARTNERS_MAX, Speech};
use crate::translate;

/// How often the health is published.
const HEALTH_EVERY: Span = Span::secs(1);

/// The whole daemon minus sockets, for one vehicle and one boot.
///
/// Deterministic: the same inputs at the same times give the same outputs, bit by bit.
#[derive(Debug)]
pub struct Vehicle {
    pub(crate) config: Config,
    pub(crate) started: Stamp,
    pub(crate) now: Stamp,
    pub(crate) sensors: Sensors,
    pub(crate) reckoning: DeadReckoning,
    pub(crate) neighbours: Neighbours,
    rounds: Rounds,
    pub(crate) speech: Speech,
    star: Star,
    workspace: StarWorkspace,
    pub(crate) counts: RoundCounts,
    pub(crate) refused: Counters,
    pub(crate) outputs: VecDeque<Output>,
    pub(crate) reported_at: Option<Stamp>,
    health_at: Stamp,
    /// Whether odometry moved the estimate since it was last published.
    moved: bool,
}

impl Vehicle {
    /// A vehicle that has just started.
    pub fn new(config: Config, now: Stamp) -> Self {
        let speech = Speech::new(
            config.vehicle,
            config.boot,
            config.period,
            config.repeats,
            &config.body_from_target,
        );
        Self {
            started: now,
            now,
            sensors: Sensors::new(&config.sensors),
            reckoning: DeadReckoning::new(config.start),
            neighbours: Neighbours::default(),
            rounds: Rounds::new(now, config.period, config.round_wait),
            speech,
            star: Star::new(Transform::identity())
                .expect("the identity is a pose")
                .in_mode(config.mode),
            workspace: StarWorkspace::new(),
            counts: RoundCounts::default(),
            refused: Counters::default(),
            outputs: VecDeque::new(),
            reported_at: None,
            health_at: now,
            moved: true,
            config,
        }
    }

    /// Takes one input at its time. Time never runs backwards: an earlier `now` is taken for the last one.
    pub fn handle(&mut self, now: Stamp, input: Input) {
        self.now = self.now.max(now);
        let now = self.now;
        match input {
            Input::Frame { sensor, bytes } => self.take_frame(now, sensor, &bytes),
            Input::Packet { key, bytes } => self.take_packet(now, key, &bytes),
            Input::Appeared { vehicle, boot } => self.note_token(vehicle, boot, true),
            Input::Vanished { vehicle, boot } => self.note_token(vehicle, boot, false),
            Input::Wake => {}
        }
        self.open_rounds(now);
        self.solve_rounds(now);
        self.report(now);
    }

    /// The next wish; [`Output::WakeAt`] when there is no other.
    pub fn poll(&mut self) -> Output {
        self.outputs
            .pop_front()
            .unwrap_or_else(|| Output::WakeAt(self.wake_at()))
    }

    fn wake_at(&self) -> Stamp {
        let report = self
            .reported_at
            .filter(|_| self.moved)
            .map(|at| at + self.config.estimate_spacing);
        let wake = self.rounds.wake_at(self.now).min(self.health_at);
        report.map_or(wake, |report| wake.min(report))
    }

    fn take_frame(&mut self, now: Stamp, sensor: Name, bytes: &[u8]) {
        let decoded = self.sensors.decode(now, sensor, bytes);
        let (taken_ns, outcome) = match decoded {
            Ok(reading) => (reading.frame.taken_ns(), self.take_reading(now, reading)),
            Err(why) => (0, Err(why)),
        };
        if !self.sensors.count(now, sensor, taken_ns, &outcome) {
            self.refused.refuse(&Refused::UnknownSensor);
        }
    }

    /// Routes a reading to whoever uses it.
    fn take_reading(&mut self, now: Stamp, reading: Reading) -> Result<(), Refused> {
        let Reading {
            sensor,
            body_from_sensor,
            frame,
        } = reading;
        match frame {
            Frame::Odometry(frame) => {
                self.reckoning.add(sensor, &body_from_sensor, &frame)?;
                self.moved = true;
                Ok(())
            }
            Frame::Relative(frame) => {
                self.measured(now, frame.target);
                let taken = Stamp::from_nanos(frame.taken_ns);
                self.rounds.keep_relative(
                    sensor,
                    taken,
                    body_from_sensor,
                    frame.target,
                    frame.value,
                )
            }
            Frame::Ranges(frame) => {
                let taken = Stamp::from_nanos(frame.taken_ns);
                let mut outcome = Ok(());
                for range in frame.ranges {
                    self.measured(now, range.target);
                    let value = RelativeValue::Distance {
                        distance_m: range.distance_m,
                        sigma_m: range.sigma_m,
                    };
                    let kept = self.rounds.keep_relative(
                        sensor,
                        taken,
                        body_from_sensor,
                        range.target,
                        value,
                    );
                    if let Err(why) = kept {
                        self.count_refusal(range.target, &why);
                        outcome = Err(why);
                    }
                }
                outcome
            }
            Frame::Fix(frame) => {
                let taken = Stamp::from_nanos(frame.taken_ns);
                self.rounds
                    .keep_fix(sensor, taken, body_from_sensor, frame.value)
            }
            Frame::Bearings(_) | Frame::Imu(_) => Err(Refused::NoPipeline),
        }
    }

    /// Notes that a neighbour was measured, so that it is told.
    fn measured(&mut self, now: Stamp, target: Name) {
        if let Some(neighbour) = self.neighbours.get_mut(target) {
            neighbour.measured_at = Some(now);
        }
    }

    fn take_packet(&mut self, now: Stamp, key: PacketKey, bytes: &[u8]) {
        let listener = Listener {
            me: self.config.vehicle,
            boot: self.config.boot,
            period: self.config.period,
            horizon: self.rounds.horizon(now),
            sent: &self.speech.sent,
        };
        match listener.hear(now, &mut self.neighbours, key, bytes) {
            Ok(Some(heard)) => self.answer(now, heard),
            Ok(None) => {}
            Err(why) => self.refused.refuse(&why),
        }
        if std::mem::take(&mut self.neighbours.alarmed) {
            self.report_health(now);
        }
    }

    /// Whoever speaks to us in a round in which we have not spoken to it is answered at once, so that a first contact
    /// counts.
    fn answer(&mut self, now: Stamp, heard: Heard) {
        let Some(at) = self
            .rounds
            .open
            .iter()
            .position(|round| round.index == heard.round)
        else {
            return;
        };
        let mut round = self.rounds.open.remove(at).expect("just found");
        if !round.told.contains(&heard.from) && round.told.len() < PARTNERS_MAX {
            self.tell(now, &mut round, heard.from);
        }
        self.rounds.open.insert(at, round);
    }

    fn note_token(&mut self, vehicle: Name, boot: u64, present: bool) {
        if vehicle == self.config.vehicle {
            if boot != self.config.boot && present {
                self.refused.refuse(&Refused::NamesakeToken);
            }
            return;
        }
        if !present {
            if let Some(neighbour) = self.neighbours.get_mut(vehicle) {
                neighbour.lose_token(boot);
            }
            return;
        }
        match self.neighbours.entry(vehicle) {
            Some(neighbour) => neighbour.boot(boot).token = true,
            None => self.refused.refuse(&Refused::Full),
        }
    }

    /// Opens every round whose instant has come: readings are laid to it and the neighbours are told.
    fn open_rounds(&mut self, now: Stamp) {
        let mut losses = Vec::new();
        while let Some(mut round) = self.rounds.open_next(now, &self.reckoning, &mut losses) {
            if round.odometry.is_none() {
                self.counts.skipped.refuse(&Refused::NoOdometry);
            }
            let timeout = self.config.presence_timeout;
            for to in self
                .speech
                .partners(now, round.index, &self.neighbours, timeout)
            {
                self.tell(now, &mut round, to);
            }
            let (status, _) = self.status(now);
            let record = self.speech.record(now, &round, status, &self.neighbours);
            self.outputs
                .extend(record.map(|(key, bytes)| Output::Send { key, bytes }));
            self.rounds.open.push_back(round);
        }
        for loss in losses {
            self.count_loss(now, &loss);
        }
    }

    /// Sends one neighbour the exchange of a round.
    fn tell(&mut self, now: Stamp, round: &mut Round, to: Name) {
        let prior = round
            .odometry
            .as_ref()
            .and_then(|point| self.reckoning.pose_at(point));
        let (status, _) = self.status(now);
        let exchange =
            self.speech
                .exchange(now, to, round, prior.as_ref(), status, &self.neighbours);
        let Some((key, bytes)) = exchange else {
            return;
        };
        self.outputs.push_back(Output::Send { key, bytes });
        round.told.insert(to);
        if let Some(neighbour) = self.neighbours.get_mut(to) {
            neighbour.spoken_to_at = Some(now);
        }
    }

    /// Solves rounds in order, each once: when everybody told has answered, or its time is up.
    fn solve_rounds(&mut self, now: Stamp) {
        while let Some(round) = self.rounds.open.pop_front() {
            let deadline_passed =
                now >= self.rounds.deadline(&round) || self.rounds.open.len() >= OPEN_MAX;
            self.place(&round);
            let prior = round
                .odometry
                .as_ref()
                .and_then(|point| self.reckoning.pose_at(point));
            let material = Material {
                round: &round,
                neighbours: &self.neighbours,
                reckoning: &self.reckoning,
                body_from_target: self.config.body_from_target,
                period: self.config.period,
                deadline_passed,
            };
            let built = match prior {
                Some(prior) => material.build(&mut self.star, prior),
                None => Ok(material.without_prior()),
            };
            // A round with nothing to solve costs nothing while it waits for the next one: a first contact still counts.
            let idle = |built: &Built| {
                built.edges() == 0 && self.rounds.open.is_empty() && !deadline_passed
            };
            let Some(built) = built.ok().filter(|built| !idle(built)) else {
                self.rounds.open.push_front(round);
                return;
            };
            self.rounds.close(round.index);
            self.finish(now, &round, &built);
            self.neighbours.forget_exchanges(round.index);
        }
    }

    /// A pose fix places a vehicle that has no pose.
    fn place(&mut self, round: &Round) {
        let unplaced = self
            .reckoning
            .newest()
            .is_some_and(|point| self.reckoning.pose_at(point).is_none());
        let (true, Some(odometry)) = (unplaced, round.odometry) else {
            return;
        };
        let is_present = |segment| {
            self.reckoning
                .newest()
                .is_some_and(|point| point.segment == segment)
        };
        let placed = round.fixes.iter().find_map(Fix::world_from_body);
        if let Some(world_from_body) = placed.filter(|_| is_present(odometry.segment)) {
            self.reckoning.correct(&odometry, world_from_body);
        }
    }

    /// Solves one round and makes its solution the present correction.
    fn finish(&mut self, now: Stamp, round: &Round, built: &Built) {
        for (name, why) in &built.refused {
            self.count_refusal(*name, why);
        }
        for (sensor, why) in &built.fixes_refused {
            self.sensors.count(now, *sensor, 0, &Err(why.clone()));
        }
        let Some(odometry) = round.odometry else {
            return;
        };
        if built.edges() == 0 {
            self.counts.coasted += 1;
            return;
        }
        self.counts.last_latency = Some(now - round.instant);
        self.counts.last_edges = built.edges();
        let solution = self.star.solve(&mut self.workspace, &self.config.optimiser);
        self.counts.solved += 1;
        self.counts.troubled.add(
            trouble(&solution),
            u64::from(solution.status != SolveStatus::Converged),
        );
        let world_from_body =
            solution.world_from_body.reframe() * built.instant_from_solved.inverse();
        if solution.status == SolveStatus::NotFinite || !translate::is_sayable(&world_from_body) {
            self.counts.troubled.count("thrown_away");
            return;
        }
        self.counts.corrected_at = Some(round.instant);
        self.reckoning.correct(&odometry, world_from_body);
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
                });
            }
        }
    }

    fn count_loss(&mut self, now: Stamp, loss: &Loss) {
        match loss.target {
            Some(target) => self.count_refusal(target, &loss.why),
            None => {
                self.sensors
                    .count(now, loss.sensor, 0, &Err(loss.why.clone()));
            }
        }
    }

    fn count_refusal(&mut self, name: Name, why: &Refused) {
        match self.neighbours.get_mut(name) {
            Some(neighbour) => neighbour.counts.refused.refuse(why),
            None => self.refused.refuse(why),
        }
    }

    fn report(&mut self, now: Stamp) {
        let spaced = self
            .reported_at
            .is_none_or(|at| now - at >= self.config.estimate_spacing);
        if self.moved && spaced {
            self.moved = false;
            self.report_estimate(now);
        }
        if now >= self.health_at {
            // Also when nothing moves, so that a lost sensor shows.
            if self.reported_at.is_none_or(|at| now - at >= HEALTH_EVERY) {
                self.report_estimate(now);
            }
            self.report_health(now);
            self.health_at = now + HEALTH_EVERY;
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
