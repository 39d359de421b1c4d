//! One vehicle: what it is given goes in by [`Vehicle::handle`], what it wants done comes out by [`Vehicle::poll`].

use std::collections::VecDeque;

use skein_estimation::cooperative::{Mode, Star, StarWorkspace};
use skein_estimation::odometry::Growth;
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Transform, VehicleId};
use skein_proto::frame::{Frame, RelativeValue};
use skein_proto::name::Name;
use skein_proto::record::Schedule;

use crate::checkpoint::Checkpoint;
use crate::config::{Config, Start};
use crate::counters::Counters;
use crate::dead_reckoning::{BRIDGE_MAX, Correction, DeadReckoning};
use crate::hearing::{Heard, Listener};
use crate::input::{Input, PacketKey};
use crate::mutual::{self, IdentifiedBearing, Mutual, Scanned};
use crate::neighbours::Neighbours;
use crate::output::Output;
use crate::placing::Placing;
use crate::ranging::Ranging;
use crate::refused::Refused;
use crate::relaying::Relaying;
use crate::reporting::RoundCounts;
use crate::rounds::{Loss, Round, Rounds};
use crate::scheduling::Scheduling;
use crate::sensors::{Reading, Sensors};
use crate::smoothing::Smoothing;
use crate::speaking::{PARTNERS_MAX, Speech};
use crate::told_pose::ToldPose;
use crate::translate;
use crate::trust::{Mark, Trust};
use crate::work::{Done, Job, Outcome, Work};

/// How often the health is published.
const HEALTH_EVERY: Span = Span::secs(1);

/// A clock that goes back by more than this was set; less is two threads that read it in turn.
const SET_BACK_MIN: Span = Span::secs(1);

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
    pub(crate) rounds: Rounds,
    pub(crate) placing: Placing,
    /// Since when it has a pose.
    pub(crate) placed_since: Mark,
    pub(crate) fix_trust: Trust,
    pub(crate) speech: Speech,
    /// What it repeats of others, when it does.
    relaying: Option<Relaying>,
    /// The team estimator, in its mode.
    pub(crate) smoothing: Option<Smoothing>,
    /// Who is in sight and where.
    pub(crate) mutual: Mutual,
    /// Where neighbours are by distances alone.
    pub(crate) ranging: Ranging,
    /// When it may move, where it takes part in the schedule.
    pub(crate) scheduling: Option<Scheduling>,
    pub(crate) star: Star,
    pub(crate) workspace: StarWorkspace,
    pub(crate) counts: RoundCounts,
    pub(crate) refused: Counters,
    pub(crate) outputs: VecDeque<Output>,
    /// Long computations handed out.
    pub(crate) works: u64,
    pub(crate) reported_at: Option<Stamp>,
    health_at: Stamp,
    /// Whether odometry moved the estimate since it was last published.
    pub(crate) moved: bool,
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
            reckoning: DeadReckoning::new(usable(config.start, now)),
            neighbours: Neighbours::default(),
            rounds: Rounds::new(now, config.period, config.round_wait),
            placing: Placing::default(),
            placed_since: Mark {
                instant: now,
                growth: Growth::zero(),
            },
            fix_trust: Trust::default(),
            speech,
            relaying: config.relay.then(Relaying::default),
            smoothing: (config.mode == Mode::Team)
                .then(|| Smoothing::new(config.vehicle, config.period)),
            mutual: Mutual::new(config.vehicle, config.boot, config.mutual),
            ranging: Ranging::new(config.ranging.dimension),
            scheduling: (config.ranging.schedule)
                .then(|| Scheduling::new(config.vehicle, config.boot, config.period)),
            star: Star::new(Transform::identity())
                .expect("the identity is a pose")
                .in_mode(config.mode),
            workspace: StarWorkspace::new(),
            counts: RoundCounts::default(),
            refused: Counters::default(),
            outputs: VecDeque::new(),
            works: 0,
            reported_at: None,
            health_at: now,
            moved: true,
            config,
        }
    }

    /// Takes one input at its time. Time never runs backwards: an earlier `now` is taken for the last one. A clock that
    /// was set back by more than a second has taken the odometry of that time with it: the pose is lost until somebody
    /// places the vehicle again.
    pub fn handle(&mut self, now: Stamp, input: Input) {
        if self.now - now > SET_BACK_MIN {
            self.reckoning.interrupt(self.now - now);
        }
        self.now = self.now.max(now);
        let now = self.now;
        match input {
            Input::Frame { sensor, bytes } => self.take_frame(now, sensor, &bytes),
            Input::Packet { key, bytes } => self.take_packet(now, key, &bytes),
            Input::Appeared { vehicle, boot } => self.note_token(vehicle, boot, true),
            Input::Vanished { vehicle, boot } => self.note_token(vehicle, boot, false),
            Input::Wake => {}
            Input::Done { done, .. } => self.finish_work(done.as_deref()),
            Input::SetPose {
                world_from_body,
                rotation_sigma_rad,
                translation_sigma_m,
            } => self.set_pose(&world_from_body, rotation_sigma_rad, translation_sigma_m),
            Input::Asked {
                query,
                since_ns,
                boot,
            } => self.answer_question(now, query, since_ns, boot),
        }
        self.scan(now);
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
        let wake = self.mutual.wake_at().map_or(wake, |at| wake.min(at));
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
            Frame::Bearings(frame) => self.mutual.look(sensor, body_from_sensor, frame),
            Frame::Imu(frame) => self.mutual.read(sensor, &body_from_sensor, &frame),
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
            smooths: self.smoothing.is_some(),
        };
        match listener.hear(now, &mut self.neighbours, key, bytes) {
            Ok(Some(Heard::Exchange { from, round })) => self.answer(now, from, round),
            Ok(Some(Heard::Features { from, set })) => {
                if let Err(why) = self.mutual.hear(from, &set) {
                    self.count_refusal(from, &why);
                }
            }
            Ok(Some(Heard::Turn { from, said })) => {
                if let Some(scheduling) = &mut self.scheduling {
                    scheduling.hear(VehicleId(from.hash()), &said);
                }
            }
            Ok(None) => {}
            Err(why) => self.refused.refuse(&why),
        }
        self.ask(now, key.from());
        if std::mem::take(&mut self.neighbours.alarmed) {
            self.report_health(now);
        }
    }

    /// Asks a neighbour for what is missing of it, where that can still be used.
    fn ask(&mut self, now: Stamp, to: Name) {
        if self.config.mode != Mode::Team {
            return;
        }
        let neighbour = self.neighbours.get_mut(to);
        if let Some((boot, since)) = neighbour.and_then(|neighbour| neighbour.ask(now)) {
            let since_ns = since.on_its_own_clock().as_nanos();
            self.outputs.push_back(Output::Ask { to, boot, since_ns });
        }
    }

    /// Somebody has missed rounds of this vehicle, or of one before it under its name.
    fn answer_question(&mut self, now: Stamp, query: u64, since_ns: i64, boot: u64) {
        let answer = if boot == self.config.boot {
            self.speech.answer(now, since_ns).ok_or(Refused::Full)
        } else {
            Err(Refused::OldBoot)
        };
        let packets = answer.unwrap_or_else(|why| {
            self.refused.refuse(&why);
            Vec::new()
        });
        self.outputs.push_back(Output::Answer { query, packets });
    }

    /// Whoever speaks to us in a round in which we have not spoken to it is answered at once, so that a first contact
    /// counts.
    fn answer(&mut self, now: Stamp, from: Name, index: i64) {
        let Some(at) = self
            .rounds
            .open
            .iter()
            .position(|round| round.index == index)
        else {
            return;
        };
        let mut round = self.rounds.open.remove(at).expect("just found");
        if !round.told.contains(&from) && round.told.len() < PARTNERS_MAX {
            self.tell(now, &mut round, from, None);
        }
        self.rounds.open.insert(at, round);
    }

    /// Takes every camera frame whose time the inertial readings have reached: everybody is told what is seen, and a
    /// bearing of a known neighbour is a measurement like any other.
    fn scan(&mut self, now: Stamp) {
        while let Some(scanned) = self.mutual.next_scan(now, self.config.period) {
            let (set, bearings) = match scanned {
                Scanned::Told { set, bearings } => (set, bearings),
                Scanned::Lost { camera, why } => {
                    self.sensors.count(now, camera, 0, &Err(why));
                    continue;
                }
            };
            self.moved = true;
            if let Some(work) = self.mutual.begin_work() {
                self.hand_out(Job::Registration(work));
            }
            let packet = self
                .speech
                .features(now, set.taken, &mutual::to_wire(&set, now));
            self.outputs
                .extend(packet.map(|(key, bytes)| Output::Send { key, bytes }));
            self.take_bearings(now, bearings);
        }
    }

    /// Asks for a long computation, by the next number.
    pub(crate) fn hand_out(&mut self, job: Job) {
        self.works += 1;
        let work = Work::new(self.works, job);
        self.outputs.push_back(Output::Work(Box::new(work)));
    }

    /// Takes what came of a long computation.
    fn finish_work(&mut self, done: Option<&Done>) {
        let Some(Done { number, outcome }) = done else {
            return;
        };
        match outcome {
            Outcome::Registration(done) => {
                let bearings = self.mutual.finish_work(done, self.config.period);
                self.take_bearings(self.now, bearings);
            }
            Outcome::Formation(best) => self.ranging.finish_work(*number, best.as_ref()),
        }
    }

    fn take_bearings(&mut self, now: Stamp, bearings: Vec<IdentifiedBearing>) {
        for bearing in bearings {
            self.measured(now, bearing.target);
            let kept = self.rounds.keep_relative(
                bearing.camera,
                bearing.taken,
                bearing.body_from_sensor,
                bearing.target,
                bearing.value,
            );
            if let Err(why) = kept {
                self.count_refusal(bearing.target, &why);
            }
        }
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
            let foreseen = self.foresee();
            if round.odometry.is_none() {
                self.counts.skipped.refuse(&Refused::NoOdometry);
            }
            let timeout = self.config.presence_timeout;
            for to in self
                .speech
                .partners(now, round.index, &self.neighbours, timeout)
            {
                self.tell(now, &mut round, to, foreseen);
            }
            let (status, _) = self.status(now);
            let schedule = self.take_turn(now, round.instant);
            let anchor = self.reckoning.anchor();
            let record =
                self.speech
                    .record(now, &round, status, schedule, &self.neighbours, anchor);
            self.outputs
                .extend(record.map(|(key, bytes)| Output::Send { key, bytes }));
            if let Some(relaying) = &mut self.relaying {
                let rounds = relaying.rounds(now, &self.neighbours);
                let packets = self.speech.relay(now, round.instant, rounds);
                let sends = packets.into_iter();
                self.outputs
                    .extend(sends.map(|(key, bytes)| Output::Send { key, bytes }));
            }
            if let Some(smoothing) = &mut self.smoothing {
                smoothing.note(&round);
            }
            self.rounds.open.push_back(round);
        }
        for loss in losses {
            self.count_loss(now, &loss);
        }
    }

    /// What this vehicle says of its turn to move. A permit that changes is told at once.
    fn take_turn(&mut self, now: Stamp, instant: Stamp) -> Option<Schedule> {
        let (said, changed) = self.scheduling.as_mut()?.speak(instant)?;
        if changed {
            self.moved = false;
            self.report_estimate(now);
        }
        Some(said)
    }

    /// Sends one neighbour the exchange of a round, its prior by the present correction or a foreseen one.
    fn tell(&mut self, now: Stamp, round: &mut Round, to: Name, foreseen: Option<Correction>) {
        let prior = round.odometry.as_ref().and_then(|point| {
            let foreseen = foreseen.and_then(|foreseen| foreseen.pose_at(point));
            foreseen.or_else(|| self.reckoning.placed_at(point))
        });
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

    /// The vehicle has a new pose from `since` on: how far it was in agreement with others before tells nothing.
    pub(crate) fn begin_anew(&mut self, since: Mark) {
        self.moved = true;
        self.placed_since = since;
        self.fix_trust = Trust::default();
        self.neighbours.forget_trust();
        if let Some(smoothing) = &mut self.smoothing {
            smoothing.begin_anew();
        }
    }

    /// An operator says where the vehicle is: it holds from now on, whatever was thought before.
    fn set_pose(&mut self, numbers: &[f64; 6], rotation_sigma_rad: f64, translation_sigma_m: f64) {
        let pose = translate::transform(numbers)
            .ok()
            .filter(translate::is_sayable);
        let told = pose.map(|world_from_body| ToldPose {
            world_from_body,
            rotation_sigma_rad,
            translation_sigma_m,
        });
        let Some(told) = told.filter(ToldPose::is_sayable) else {
            self.refused.count("set_pose");
            return;
        };
        self.reckoning.set_pose(told);
        let newest = self.reckoning.newest();
        let begun = Mark {
            instant: self.now,
            growth: Growth::zero(),
        };
        self.begin_anew(newest.map_or(begun, Mark::of));
    }

    /// What a restart begins with: the newest pose that may be told.
    fn checkpoint(&self) -> Option<Checkpoint> {
        let newest = self.reckoning.newest()?;
        let world_from_body = self.reckoning.placed_at(newest)?;
        let lost = self.now - newest.taken > BRIDGE_MAX;
        (!lost && translate::is_sayable(&world_from_body)).then_some(Checkpoint {
            boot: self.config.boot,
            taken: newest.taken,
            world_from_body,
        })
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

    pub(crate) fn count_refusal(&mut self, name: Name, why: &Refused) {
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
            self.outputs
                .extend(self.checkpoint().map(Output::Checkpoint));
            self.health_at = now + HEALTH_EVERY;
        }
    }
}

/// A checkpoint of the future tells nothing of its age, as the clock was set back: it is shown, never used.
fn usable(start: Start, now: Stamp) -> Start {
    match start {
        Start::Checkpoint(checkpoint) if checkpoint.taken > now => Start::Unknown,
        start => start,
    }
}
