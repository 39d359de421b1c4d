//! A fleet in virtual time: the production vehicle and codec over simworld's radio, deterministic for a seed.
//!
//! What is tested here is what flies: only the sockets and the clocks are replaced.

use crate::radio::{Radio, RadioSettings, Verdict};
use crate::scenario::Scenario;
use crate::stage::Stage;
use crate::truth::Pose;
use crate::world::{Delivery, World};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use skein_estimation::time::Stamp;
use skein_proto::backlog::Question;
use skein_proto::document::{EstimateDocument, HealthDocument, PoseDocument};
use skein_proto::name::Name;
use skein_vehicle::{Checkpoint, Config, Input, Output, PacketKey, Vehicle};
use std::collections::{BTreeMap, BTreeSet};

/// Several vehicles and the air between them.
#[derive(Debug)]
pub struct Fleet<S = World> {
    stage: S,
    radio: Radio,
    members: Vec<Member>,
    events: BTreeMap<(i64, u64), Event>,
    order: u64,
    now_ns: i64,
    lingering: Vec<Lingering>,
    deaf: BTreeSet<(usize, Name)>,
    /// Who waits for the answer to a question, by its number.
    questions: BTreeMap<u64, usize>,
    asked: u64,
    log: Option<Vec<Logged>>,
}

/// How long a computation takes that a vehicle hands out.
const WORK_NS: i64 = 10_000_000;

/// Questions that wait for an answer; of a lost one, or one to a dead process, there is none.
const QUESTIONS_MAX: usize = 256;

/// A liveliness token that is still seen though its process is dead.
#[derive(Clone, Copy, Debug)]
struct Lingering {
    vehicle: Name,
    boot: u64,
    until_ns: i64,
}

/// One process of a fleet. Two may bear one name.
#[derive(Debug)]
struct Member {
    config: Config,
    vehicle: Option<Vehicle>,
    starts: usize,
    wake_ns: i64,
    estimate: Option<Box<EstimateDocument>>,
    health: Option<Box<HealthDocument>>,
    /// What it wrote down last; it survives its process.
    checkpoint: Option<Checkpoint>,
}

#[derive(Clone, Debug)]
enum Event {
    /// The drivers of a vehicle prepare the round that ends one period later.
    Prepare { vehicle: usize, instant_ns: i64 },
    /// Something reaches a vehicle.
    Input { vehicle: usize, input: Input },
    /// A vehicle asked to be woken.
    Wake { vehicle: usize },
}

/// Something that went into or came out of a vehicle, for comparing runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Logged {
    /// Which vehicle.
    pub vehicle: usize,
    /// When, on its clock.
    pub stamp: Stamp,
    /// What went in, or came out.
    pub what: LoggedValue,
}

/// What was logged.
#[derive(Clone, Debug, PartialEq)]
pub enum LoggedValue {
    /// It went in.
    Input(Input),
    /// It came out.
    Output(Output),
}

impl Fleet {
    /// A fleet on one sample of a scenario, before its standstill.
    #[must_use]
    pub fn new(scenario: &Scenario, sample: u64) -> Self {
        Self::with_configs(scenario, sample, |_, config| config)
    }

    /// The same with configurations changed by `change`, which is given the vehicle's index.
    #[must_use]
    pub fn with_configs(
        scenario: &Scenario,
        sample: u64,
        change: impl Fn(usize, Config) -> Config,
    ) -> Self {
        let world = World::new(scenario, sample);
        let radio = Radio::new(&scenario.radio, world.streams());
        Self::on(world, radio, change)
    }
}

impl Fleet<World> {
    /// The clock of a vehicle's host steps, forward or back: of its process and of its drivers, from the next frame
    /// that they prepare. Whole rounds leave the drivers in phase.
    pub fn step_clock(&mut self, vehicle: usize, by_s: f64) {
        self.stage.step_clock(vehicle, crate::world::nanos(by_s));
        // Its timer was set on the old clock.
        let input = Input::Wake;
        self.push(self.now_ns, Event::Input { vehicle, input });
    }
}

impl<S: Stage> Fleet<S> {
    /// A fleet on a stage, with configurations changed by `change`.
    #[must_use]
    pub fn on(stage: S, radio: Radio, change: impl Fn(usize, Config) -> Config) -> Self {
        let start_ns = stage.begins_ns();
        let member = |vehicle| Member {
            config: change(vehicle, stage.config(vehicle, 0)),
            vehicle: None,
            starts: 0,
            wake_ns: i64::MAX,
            estimate: None,
            health: None,
            checkpoint: None,
        };
        let members: Vec<Member> = (0..stage.vehicles()).map(member).collect();
        let mut fleet = Self {
            stage,
            radio,
            members,
            events: BTreeMap::new(),
            order: 0,
            now_ns: start_ns,
            lingering: Vec::new(),
            deaf: BTreeSet::new(),
            questions: BTreeMap::new(),
            asked: 0,
            log: None,
        };
        for vehicle in 0..fleet.len() {
            fleet.start(vehicle);
            let instant_ns = fleet.stage.first_instant_ns(vehicle, start_ns + 1);
            fleet.push(
                start_ns,
                Event::Prepare {
                    vehicle,
                    instant_ns,
                },
            );
        }
        fleet
    }

    /// Keeps everything that goes in and comes out from now on.
    pub fn log(&mut self) {
        self.log.get_or_insert_default();
    }

    /// What was kept.
    pub fn take_log(&mut self) -> Vec<Logged> {
        self.log.take().unwrap_or_default()
    }

    /// Number of vehicles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.members.is_empty()
    }

    /// What it flies on.
    #[must_use]
    pub const fn stage(&self) -> &S {
        &self.stage
    }

    /// Ends the flight and gives the stage back.
    #[must_use]
    pub fn into_stage(self) -> S {
        self.stage
    }

    /// The air between the vehicles, with its counts.
    #[must_use]
    pub const fn radio(&self) -> &Radio {
        &self.radio
    }

    /// Changes the air from now on.
    pub fn change_radio(&mut self, settings: &RadioSettings) {
        self.radio.change(settings);
    }

    /// Nanoseconds since the start of the motion.
    #[must_use]
    pub const fn now_ns(&self) -> i64 {
        self.now_ns
    }

    /// The configuration that a vehicle was last started with.
    #[must_use]
    pub fn config(&self, vehicle: usize) -> &Config {
        &self.members[vehicle].config
    }

    /// The newest estimate that a vehicle published.
    #[must_use]
    pub fn estimate(&self, vehicle: usize) -> Option<&EstimateDocument> {
        self.members[vehicle].estimate.as_deref()
    }

    /// The newest health that a vehicle published.
    #[must_use]
    pub fn health(&self, vehicle: usize) -> Option<&HealthDocument> {
        self.members[vehicle].health.as_deref()
    }

    /// What a vehicle wrote down last, in this process or one before it.
    #[must_use]
    pub fn checkpoint(&self, vehicle: usize) -> Option<Checkpoint> {
        self.members[vehicle].checkpoint
    }

    /// A vehicle is given an input at once: an operator's, say.
    pub fn give(&mut self, vehicle: usize, input: Input) {
        self.feed(vehicle, input);
    }

    /// A vehicle's newest estimated pose and the truth at the time that it speaks of.
    #[must_use]
    pub fn scored(&self, vehicle: usize) -> Option<(Pose, Pose)> {
        let estimate = self.estimate(vehicle)?;
        let at_ns = self.stage.time_ns(vehicle, estimate.taken_ns);
        Some((
            self.stage.truth(vehicle, at_ns)?,
            pose_of(estimate.pose.as_ref()?),
        ))
    }

    /// Distance between a vehicle's newest estimate and the truth, in metres; infinite when it has none.
    #[must_use]
    pub fn position_error_m(&self, vehicle: usize) -> f64 {
        self.scored(vehicle)
            .map_or(f64::INFINITY, |(truth, estimate)| {
                (estimate.translation.vector - truth.translation.vector).norm()
            })
    }

    /// A vehicle's process dies without a word, and the others see it at once.
    pub fn kill(&mut self, vehicle: usize) {
        self.kill_under_a_lingering_token(vehicle, 0.0);
    }

    /// A vehicle's process dies without a word, and its liveliness token is seen for some seconds more, as over a
    /// connection whose end is only noticed when the lease is over.
    pub fn kill_under_a_lingering_token(&mut self, vehicle: usize, lingers_s: f64) {
        let member = &mut self.members[vehicle];
        member.vehicle = None;
        member.wake_ns = i64::MAX;
        member.estimate = None;
        member.health = None;
        let token = Lingering {
            vehicle: member.config.vehicle,
            boot: member.config.boot,
            until_ns: self.now_ns + crate::world::nanos(lingers_s),
        };
        let vanished = Input::Vanished {
            vehicle: token.vehicle,
            boot: token.boot,
        };
        for other in (0..self.len()).filter(|other| lingers_s > 0.0 || *other != vehicle) {
            let input = vanished.clone();
            self.push(
                token.until_ns,
                Event::Input {
                    vehicle: other,
                    input,
                },
            );
        }
        self.lingering.push(token);
    }

    /// A vehicle's process is started again, under a new boot id, but with the name of another vehicle: its own
    /// sensors, its own place, the other's configuration file.
    pub fn impersonate(&mut self, vehicle: usize, other: usize) {
        self.members[vehicle].config.vehicle = self.members[other].config.vehicle;
        self.start(vehicle);
    }

    /// From now on no packet of that name reaches a vehicle; tokens do.
    pub fn deafen(&mut self, vehicle: usize, to: Name) {
        self.deaf.insert((vehicle, to));
    }

    /// Packets of that name reach a vehicle again.
    pub fn undeafen(&mut self, vehicle: usize, to: Name) {
        self.deaf.remove(&(vehicle, to));
    }

    /// A packet that none of the processes sent reaches a vehicle now.
    pub fn inject(&mut self, vehicle: usize, key: PacketKey, bytes: Vec<u8>) {
        let input = Input::Packet { key, bytes };
        self.push(self.now_ns, Event::Input { vehicle, input });
    }

    /// A vehicle's process is started again, under a new boot id, with a start of its own.
    pub fn restart(&mut self, vehicle: usize, start: skein_vehicle::Start) {
        self.members[vehicle].config.start = start;
        self.start(vehicle);
    }

    fn start(&mut self, vehicle: usize) {
        let boot = self.stage.boot(vehicle, self.members[vehicle].starts);
        let stamp = self.stamp(vehicle);
        let member = &mut self.members[vehicle];
        member.config.boot = boot;
        member.starts += 1;
        member.vehicle = Some(Vehicle::new(member.config.clone(), stamp));
        let name = member.config.vehicle;
        self.push(
            self.now_ns,
            Event::Input {
                vehicle,
                input: Input::Wake,
            },
        );
        self.tell_all_but(
            vehicle,
            &Input::Appeared {
                vehicle: name,
                boot,
            },
        );
        self.lingering.retain(|token| token.until_ns > self.now_ns);
        let alive = (0..self.len())
            .filter(|other| *other != vehicle && self.members[*other].vehicle.is_some())
            .map(|other| &self.members[other].config)
            .map(|config| (config.vehicle, config.boot));
        let lingering = self
            .lingering
            .iter()
            .map(|token| (token.vehicle, token.boot));
        let others: Vec<Input> = alive
            .chain(lingering)
            .map(|(vehicle, boot)| Input::Appeared { vehicle, boot })
            .collect();
        for input in others {
            self.push(self.now_ns, Event::Input { vehicle, input });
        }
    }

    fn tell_all_but(&mut self, vehicle: usize, input: &Input) {
        for other in (0..self.len()).filter(|other| *other != vehicle) {
            self.push(
                self.now_ns,
                Event::Input {
                    vehicle: other,
                    input: input.clone(),
                },
            );
        }
    }

    /// Flies until a time, which is not yet handled itself: at `k P` the round k is still to come.
    pub fn run_until(&mut self, until_ns: i64) {
        while let Some(entry) = self.events.first_entry() {
            let at_ns = entry.key().0;
            if at_ns >= until_ns {
                break;
            }
            let event = entry.remove();
            self.now_ns = at_ns;
            self.happen(event);
        }
        self.now_ns = self.now_ns.max(until_ns);
    }

    /// Flies for some seconds.
    pub fn run_s(&mut self, seconds: f64) {
        self.run_until(self.now_ns + crate::world::nanos(seconds));
    }

    fn happen(&mut self, event: Event) {
        match event {
            Event::Prepare {
                vehicle,
                instant_ns,
            } => self.prepare(vehicle, instant_ns),
            Event::Input {
                vehicle,
                input: Input::Packet { key, .. },
            } if self.deaf.contains(&(vehicle, key.from())) => {}
            Event::Input { vehicle, input } => self.feed(vehicle, input),
            Event::Wake { vehicle } if self.members[vehicle].wake_ns == self.now_ns => {
                self.feed(vehicle, Input::Wake)
            }
            Event::Wake { .. } => {}
        }
    }

    /// Lays out what the drivers of a vehicle will bring for its next round.
    fn prepare(&mut self, vehicle: usize, instant_ns: i64) {
        for Delivery {
            at_ns,
            sensor,
            frame,
        } in self.stage.round(vehicle, instant_ns)
        {
            let input = Input::Frame {
                sensor,
                bytes: frame.encode(),
            };
            self.push(at_ns, Event::Input { vehicle, input });
        }
        let next_ns = instant_ns + self.stage.period_ns();
        self.push(
            instant_ns,
            Event::Prepare {
                vehicle,
                instant_ns: next_ns,
            },
        );
    }

    fn feed(&mut self, vehicle: usize, input: Input) {
        let stamp = self.stamp(vehicle);
        let Some(mut flying) = self.members[vehicle].vehicle.take() else {
            return;
        };
        self.note(vehicle, stamp, || LoggedValue::Input(input.clone()));
        flying.handle(stamp, input);
        loop {
            let output = flying.poll();
            self.note(vehicle, stamp, || LoggedValue::Output(output.clone()));
            match output {
                Output::Send { key, bytes } => self.send(vehicle, key, &bytes),
                Output::Estimate { document, .. } => {
                    self.stage.told(vehicle, &document);
                    self.members[vehicle].estimate = Some(document);
                }
                Output::Health(document) => self.members[vehicle].health = Some(document),
                Output::Checkpoint(checkpoint) => {
                    self.members[vehicle].checkpoint = Some(checkpoint);
                }
                Output::Ask { to, boot, since_ns } => {
                    self.ask(vehicle, to, Question { since_ns, boot });
                }
                Output::Work(work) => {
                    let number = work.number();
                    let done = Some(Box::new(work.run()));
                    let input = Input::Done { number, done };
                    self.push(self.now_ns + WORK_NS, Event::Input { vehicle, input });
                }
                Output::Answer { query, packets } => self.answer(vehicle, query, packets),
                Output::WakeAt(at) => {
                    let wake_ns = self.stage.time_ns(vehicle, at.as_nanos()).max(self.now_ns);
                    if self.members[vehicle].wake_ns != wake_ns {
                        self.members[vehicle].wake_ns = wake_ns;
                        self.push(wake_ns, Event::Wake { vehicle });
                    }
                    break;
                }
            }
        }
        self.members[vehicle].vehicle = Some(flying);
    }

    /// A packet goes into the air: an exchange to its addressee, a record to everybody.
    fn send(&mut self, from: usize, key: PacketKey, bytes: &[u8]) {
        for to in (0..self.len()).filter(|to| *to != from) {
            if matches!(key, PacketKey::Exchange { to: addressee, .. } if addressee != self.members[to].config.vehicle)
            {
                continue;
            }
            let packet = || Input::Packet {
                key,
                bytes: bytes.to_vec(),
            };
            self.transmit(from, to, bytes.len(), packet);
        }
    }

    /// A question goes into the air, to every process of that name.
    fn ask(&mut self, from: usize, name: Name, question: Question) {
        let Question { since_ns, boot } = question;
        for to in 0..self.len() {
            if to == from || self.members[to].config.vehicle != name {
                continue;
            }
            self.asked += 1;
            let query = self.asked;
            self.questions.insert(query, from);
            if self.questions.len() > QUESTIONS_MAX {
                self.questions.pop_first();
            }
            let bytes = question.selector(name, name).len();
            let asked = || Input::Asked {
                query,
                since_ns,
                boot,
            };
            self.transmit(from, to, bytes, asked);
        }
    }

    /// An answer goes into the air, once: a copy of its question finds nobody waiting.
    fn answer(&mut self, from: usize, query: u64, packets: Vec<Vec<u8>>) {
        let Some(to) = self.questions.remove(&query) else {
            return;
        };
        let key = PacketKey::Backlog {
            from: self.members[from].config.vehicle,
        };
        for bytes in packets {
            let length = bytes.len();
            self.transmit(from, to, length, || Input::Packet {
                key,
                bytes: bytes.clone(),
            });
        }
    }

    /// Whatever the radio lets through reaches a vehicle, when and as often as it says.
    fn transmit(&mut self, from: usize, to: usize, bytes: usize, input: impl Fn() -> Input) {
        let apart_m = self.apart_m(from, to);
        let verdict = self.radio.transmit(self.now_ns, from, to, apart_m, bytes);
        if let Verdict::Deliver { at_ns, copy_at_ns } = verdict {
            for at_ns in std::iter::once(at_ns).chain(copy_at_ns) {
                let input = input();
                self.push(at_ns, Event::Input { vehicle: to, input });
            }
        }
    }

    /// Distance between two vehicles; none where truth is not known, so that the radio reaches.
    fn apart_m(&self, a: usize, b: usize) -> f64 {
        let place = |vehicle| {
            self.stage
                .truth(vehicle, self.now_ns)
                .map(|pose| pose.translation.vector)
        };
        place(a).zip(place(b)).map_or(0.0, |(a, b)| (a - b).norm())
    }

    fn stamp(&self, vehicle: usize) -> Stamp {
        Stamp::from_nanos(self.stage.stamp_ns(vehicle, self.now_ns))
    }

    fn push(&mut self, at_ns: i64, event: Event) {
        self.order += 1;
        self.events.insert((at_ns, self.order), event);
    }

    fn note(&mut self, vehicle: usize, stamp: Stamp, what: impl FnOnce() -> LoggedValue) {
        if let Some(log) = &mut self.log {
            log.push(Logged {
                vehicle,
                stamp,
                what: what(),
            });
        }
    }
}

/// A published pose as truth writes it.
#[must_use]
pub fn pose_of(document: &PoseDocument) -> Pose {
    let [w, x, y, z] = document.quaternion_wxyz;
    Pose::from_parts(
        Translation3::from(document.position_m),
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section_v() -> Scenario {
        Scenario::built_in("section-v").expect("built in")
    }

    fn mean_of(error: impl Fn(usize) -> f64) -> f64 {
        (0..5).map(error).sum::<f64>() / 5.0
    }

    #[test]
    fn five_vehicles_hold_each_other_better_than_odometry_alone() {
        let mut fleet = Fleet::new(&section_v(), 3);
        fleet.run_until(20_000_000_000);
        let reckoned = mean_of(|vehicle| {
            let truth = fleet
                .stage()
                .pose(vehicle, 20_000_000_000)
                .translation
                .vector;
            (fleet.stage().dead_reckoning(vehicle).translation.vector - truth).norm()
        });
        fleet.run_until(20_000_000_001);
        let estimate = mean_of(|vehicle| fleet.position_error_m(vehicle));
        assert!(estimate < 0.4 * reckoned, "{estimate} against {reckoned}");
    }

    #[test]
    fn the_same_seed_gives_the_same_flight_bit_by_bit() {
        let fly = || {
            let mut fleet = Fleet::new(&section_v(), 5);
            fleet.log();
            fleet.run_until(4_000_000_000);
            fleet.take_log()
        };
        let (one, two) = (fly(), fly());
        assert!(one.len() > 1000);
        assert!(one == two);
    }

    #[test]
    fn over_a_radio_without_order_a_flight_is_the_same_again_too() {
        let fly = || {
            let harsh = Scenario::built_in("section-v-harsh").expect("built in");
            let mut fleet = Fleet::new(&harsh, 5);
            fleet.log();
            fleet.run_until(4_000_000_000);
            let count = fleet.radio().total();
            assert!(count.duplicated > 50 && count.reordered > 50, "{count:?}");
            fleet.take_log()
        };
        assert!(fly() == fly());
    }

    #[test]
    fn every_copy_that_the_radio_makes_reaches_its_vehicle() {
        let mut doubling = section_v();
        doubling.team.truncate(2);
        doubling.radio.duplicate = Some(crate::radio::Duplicate {
            probability: 1.0,
            delay_s: 0.0,
        });
        let mut fleet = Fleet::new(&doubling, 0);
        fleet.log();
        fleet.run_until(10_000_000_000);
        let count = fleet.radio().total();
        let log = fleet.take_log();
        let is_packet =
            |entry: &&Logged| matches!(entry.what, LoggedValue::Input(Input::Packet { .. }));
        let arrived = log.iter().filter(is_packet).count() as u64;
        assert!(count.sent > 100);
        assert_eq!(arrived, 2 * count.sent);
    }

    #[test]
    fn a_fleet_in_two_parts_hears_nothing_across_until_it_heals() {
        let split = Scenario::built_in("section-v-partition").expect("built in");
        let mut fleet = Fleet::new(&split, 0);
        let across = |fleet: &Fleet| {
            let links = fleet.radio().counts();
            let mut count = crate::radio::LinkCount::default();
            for ((from, to), link) in links {
                if (from < 2) != (to < 2) {
                    count += link;
                }
            }
            count
        };
        fleet.run_until(6_000_000_000);
        let before = across(&fleet);
        assert_eq!(before.partitioned, 0);
        fleet.run_until(12_000_000_000);
        let during = across(&fleet);
        assert_eq!(during.delivered, before.delivered);
        assert_eq!(during.partitioned, during.sent - before.sent);
        assert!(during.partitioned > 100, "{during:?}");
        fleet.run_until(20_000_000_000);
        let after = across(&fleet);
        assert_eq!(after.partitioned, during.partitioned);
        assert!(after.delivered > during.delivered + 100, "{after:?}");
        for vehicle in 0..5 {
            let error_m = fleet.position_error_m(vehicle);
            assert!(error_m < 2.0, "v{}: {error_m} m", vehicle + 1);
        }
    }
}
