//! Mode `team`: what everybody told of itself, this vehicle included, handed to the team estimator. Raw information only;
//! nobody's estimate.

mod teller;
mod telling;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use nalgebra::Matrix6;
use skein_estimation::cooperative::team::{Moment, Observation, Report, Settings, Team, Unused};
use skein_estimation::odometry::OdometryPoint;
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, VehicleId, World};
use skein_proto::fixed::Fixed;
use skein_proto::measured::Measured;
use skein_proto::name::Name;
use skein_proto::record::Addressed;

use crate::clock::PeerStamp;
use crate::dead_reckoning::DeadReckoning;
use crate::gathering::{AT_THE_INSTANT, INTERPOLATED_ACCELERATION_M_S2};
use crate::heard_rounds::{HeardAnchor, HeardRound};
use crate::neighbours::{Boot, Neighbours};
use crate::refused::Refused;
use crate::rounds::Round;
use crate::told_pose::ToldPose;
use crate::translate::{self, Sighting};
use teller::{NoEnds, Teller};

/// Rounds that are looked through for what is of use: as long as the window keeps its poses while nobody is heard.
const ROUNDS_BACK_MAX: i64 = 60;
/// A neighbour's rounds are taken for one if they follow each other by less than this share of our period.
const ROUND_SHARE_MIN: f64 = 0.4;
/// A measurement is tied to a pose of the measured vehicle no farther away in time than this share of our period.
const ROUND_SHARE_MAX: f64 = 0.6;
/// Rounds in a row that could not be solved, after which the estimator begins again.
const UNDETERMINED_MAX: u32 = 5;
/// Of each neighbour so many rounds are looked at for news.
const NEWEST_ROUNDS: usize = 4;
/// What placed this vehicle was said within this time: its rounds since then are smoothed, so that it counts.
const PLACED_WITHIN: Span = Span::secs(2);

/// The team estimator with what it has been told.
#[derive(Clone, Debug)]
pub(crate) struct Smoothing {
    me: VehicleId,
    period: Span,
    team: Team,
    /// This vehicle's own last rounds, as others hear them.
    own_rounds: VecDeque<HeardRound>,
    own_done: Done,
    /// Whom this vehicle measured of late, by hash: of some nothing may ever be heard.
    targets: BTreeMap<u64, Name>,
    lives: BTreeMap<Name, Life>,
    /// Where distances located somebody, this vehicle among them: where to begin with whoever was told nothing.
    found: BTreeMap<VehicleId, (Moment, ToldPose)>,
    undetermined: u32,
    last: Report,
    restarts: u64,
    pub(crate) restarted_at: Option<Stamp>,
}

/// Which measurements of which rounds need not be looked at again.
type Done = BTreeSet<(PeerStamp, usize)>;

/// The life of a neighbour that the estimator knows: one boot, one anchor.
#[derive(Clone, Debug)]
struct Life {
    boot: u64,
    anchored: Option<Stamp>,
    stepped_at: Option<PeerStamp>,
    /// Whether it was in quarantine after the last round.
    quarantined: bool,
    done: Done,
}

/// What a round is smoothed from.
pub(crate) struct Told<'a> {
    pub(crate) round: &'a Round,
    pub(crate) odometry: OdometryPoint,
    pub(crate) prior: Transform<World, Body>,
    pub(crate) neighbours: &'a Neighbours,
    pub(crate) reckoning: &'a DeadReckoning,
    pub(crate) body_from_target: Transform<Body, Sensor>,
}

/// What came of a round.
pub(crate) struct Smoothed {
    pub(crate) report: Report,
    /// Measurements and fixes that were not used, and whose they are; of this vehicle's own fixes nobody's.
    pub(crate) refused: Vec<(Option<Name>, Refused)>,
    /// Who was put into quarantine.
    pub(crate) quarantined: Vec<Name>,
    /// Of whom a hash is.
    pub(crate) names: BTreeMap<VehicleId, Name>,
}

impl Smoothing {
    pub(crate) fn new(me: Name, period: Span) -> Self {
        let me = VehicleId(me.hash());
        Self {
            me,
            period,
            team: Team::new(me, period, Settings::DEFAULT),
            own_rounds: VecDeque::new(),
            own_done: Done::new(),
            targets: BTreeMap::new(),
            lives: BTreeMap::new(),
            found: BTreeMap::new(),
            undetermined: 0,
            last: Report::default(),
            restarts: 0,
            restarted_at: None,
        }
    }

    pub(crate) const fn team(&self) -> &Team {
        &self.team
    }

    /// Everything estimated so far holds no more: this vehicle was told where it is, or nothing could be solved.
    pub(crate) fn begin_again(&mut self) {
        self.team = Team::new(self.me, self.period, Settings::DEFAULT);
        self.own_done.clear();
        self.lives.clear();
        self.undetermined = 0;
    }

    /// The own pose is another now: what was found by the one before holds no more, either.
    pub(crate) fn begin_anew(&mut self) {
        self.begin_again();
        self.found.clear();
    }

    /// Distances say where somebody was at a moment.
    pub(crate) fn find(&mut self, moment: Moment, pose: ToldPose) {
        self.found.insert(moment.vehicle, (moment, pose));
    }

    /// How certain the own pose is at a point of odometry not before the last solved round: of a twist on the body's side.
    pub(crate) fn covariance_at(&self, point: &OdometryPoint) -> Option<Matrix6<f64>> {
        let own = self.team.own()?;
        own.carried_to(point, self.team.scales())
    }

    /// Keeps an own round as others will hear it.
    pub(crate) fn note(&mut self, round: &Round) {
        let Some(point) = round.odometry else {
            return;
        };
        let addressed = |(name, list): (&Name, &Vec<Measured>)| {
            let to = name.hash();
            let list = list.iter().map(|measured| Addressed {
                to,
                measured: *measured,
            });
            list.collect::<Vec<_>>()
        };
        let fixes = round.fixes.iter();
        self.own_rounds.push_back(HeardRound {
            instant: PeerStamp::from_nanos(round.instant.as_nanos()),
            point,
            growth_known: true,
            measured: round.measured.iter().flat_map(addressed).collect(),
            fixes: fixes
                .filter_map(|fix| translate::fold_fix(&fix.value, &fix.body_from_sensor).ok())
                .collect(),
            relayed: false,
        });
        while self.own_rounds.len() as i64 > ROUNDS_BACK_MAX {
            self.own_rounds.pop_front();
        }
        let measured = round.measured.keys();
        self.targets
            .extend(measured.map(|name| (name.hash(), *name)));
        let rounds = self.own_rounds.iter();
        let kept: BTreeSet<u64> = rounds
            .flat_map(|round| &round.measured)
            .map(|addressed| addressed.to)
            .collect();
        self.targets.retain(|hash, _| kept.contains(hash));
    }

    /// Whether everybody who was told something in a round has told its own round of that time.
    pub(crate) fn is_complete(&self, round: &Round, neighbours: &Neighbours) -> bool {
        let reach = share(self.period, ROUND_SHARE_MAX);
        round.told.iter().all(|name| {
            let boot = neighbours
                .get(*name)
                .and_then(|neighbour| neighbour.usable());
            boot.is_none_or(|boot| {
                let mut rounds = boot.rounds.iter().rev();
                rounds.any(|heard| {
                    boot.clock
                        .to_mine(heard.instant)
                        .is_some_and(|mine| (mine - round.instant).abs() <= reach)
                })
            })
        })
    }

    /// Whether somebody measured something in a round, as far as is known.
    pub(crate) fn has_news(&self, round: &Round, neighbours: &Neighbours) -> bool {
        let reach = share(self.period, ROUND_SHARE_MAX);
        let tells = |heard: &HeardRound| !heard.measured.is_empty() || !heard.fixes.is_empty();
        let told = |boot: &Boot| {
            boot.rounds.iter().rev().take(NEWEST_ROUNDS).any(|heard| {
                let mine = boot.clock.to_mine(heard.instant);
                mine.is_some_and(|mine| mine - round.instant >= -reach) && tells(heard)
            })
        };
        !round.measured.is_empty()
            || !round.fixes.is_empty()
            || neighbours
                .iter()
                .filter_map(|(_, neighbour)| neighbour.usable())
                .any(told)
    }

    /// Smooths a round with everything that was told.
    pub(crate) fn solve(&mut self, now: Stamp, told: &Told<'_>) -> Smoothed {
        let mut refused = Vec::new();
        self.meet(told);
        self.locate_own(told);
        let own_rounds = std::mem::take(&mut self.own_rounds);
        let tellers = self.tellers(told, &own_rounds);
        // Whoever is located by a measurement has poses from then on, which others may have measured.
        for _ in 0..=tellers.len() {
            let located = self.located(&tellers);
            self.hear(&tellers);
            self.measure(told, &tellers, &mut refused);
            if self.located(&tellers) == located {
                break;
            }
        }
        let names = tellers
            .iter()
            .filter_map(|teller| Some((teller.id, teller.name?)));
        let names = names.collect();
        self.forget_done(told.round.instant, &tellers);
        drop(tellers);
        self.own_rounds = own_rounds;
        let report = self.team.solve();
        self.last = report.clone();
        let quarantined = self.newly_quarantined();
        self.undetermined = if report.undetermined {
            self.undetermined + 1
        } else {
            0
        };
        if self.undetermined >= UNDETERMINED_MAX {
            self.begin_again();
            self.restarts += 1;
            self.restarted_at = Some(now);
        }
        Smoothed {
            report,
            refused,
            quarantined,
            names,
        }
    }

    /// Whose quarantine began in the last round.
    fn newly_quarantined(&mut self) -> Vec<Name> {
        let mut begun = Vec::new();
        for (name, life) in &mut self.lives {
            let member = self.team.member(VehicleId(name.hash()));
            let quarantined = member.is_some_and(|member| member.quarantined);
            if quarantined && !life.quarantined {
                begun.push(*name);
            }
            life.quarantined = quarantined;
        }
        begun
    }

    /// Whoever began a new life is forgotten: of its odometry nothing holds across two.
    fn meet(&mut self, told: &Told<'_>) {
        for (name, neighbour) in told.neighbours.iter() {
            let Some(boot) = neighbour.usable() else {
                continue;
            };
            let anchored = boot.rounds.anchor().map(|anchor| anchor.point.taken);
            let known = self.lives.get(&name);
            let goes_on = known.is_some_and(|life| {
                let same_anchor = life.anchored.is_none() || life.anchored == anchored;
                life.boot == boot.id && life.stepped_at == boot.stepped_at && same_anchor
            });
            if goes_on {
                if let Some(life) = self.lives.get_mut(&name) {
                    life.anchored = anchored;
                }
                continue;
            }
            self.team.forget(VehicleId(name.hash()));
            self.found.remove(&VehicleId(name.hash()));
            self.lives.insert(
                name,
                Life {
                    boot: boot.id,
                    anchored,
                    stepped_at: boot.stepped_at,
                    quarantined: false,
                    done: Done::new(),
                },
            );
        }
        let is_known = |name: &Name| told.neighbours.get(*name).is_some();
        self.lives.retain(|name, _| is_known(name));
        let of_somebody =
            |id: &VehicleId| *id == self.me || self.lives.keys().any(|name| name.hash() == id.0);
        self.found.retain(|id, _| of_somebody(id));
    }

    /// This vehicle joins: where it was told to be, or where it was placed, of which nothing is known but that. It then
    /// joins where it was a little before, since what placed it was measured there and is to count, once.
    fn locate_own(&mut self, told: &Told<'_>) {
        if self.team.is_located(self.me) {
            return;
        }
        let me = self.me;
        let moment = |point: &OdometryPoint| Moment {
            vehicle: me,
            instant: point.taken,
            point: *point,
        };
        let now = moment(&told.odometry);
        let started = told.reckoning.anchor().is_some_and(|anchor| {
            let start = &anchor.told;
            let sigmas = (start.rotation_sigma_rad, start.translation_sigma_m);
            self.team
                .start(
                    &moment(&anchor.point),
                    &now,
                    &start.world_from_body,
                    sigmas.0,
                    sigmas.1,
                )
                .is_ok()
        });
        if started || self.start_where_found(&now) {
            return;
        }
        let since = told.round.instant - PLACED_WITHIN;
        let instant = |round: &&HeardRound| round.instant.on_its_own_clock();
        let before = self.own_rounds.iter().find(|round| {
            let is_recent = instant(round) >= since && instant(round) <= told.round.instant;
            is_recent && round.point.segment == told.odometry.segment
        });
        let point = before.map_or(told.odometry, |round| round.point);
        let (then, odometry) = (&point.odometry_from_body, &told.odometry.odometry_from_body);
        let world_from_body = told.prior * odometry.inverse() * *then;
        if self.team.place(&moment(&point), &world_from_body).is_ok() {
            // What was measured before was counted when it was refused.
            self.own_rounds
                .retain(|round| instant(&round) >= point.taken);
        }
    }

    fn located(&self, tellers: &[Teller<'_>]) -> usize {
        let located = tellers
            .iter()
            .filter(|teller| self.team.is_located(teller.id));
        located.count()
    }

    /// Everybody's poses.
    fn hear(&mut self, tellers: &[Teller<'_>]) {
        for teller in tellers {
            for (instant, round) in &teller.rounds {
                let moment = teller.moment(*instant, round);
                match self.team.heard(&moment) {
                    Err(Unused::Interrupted) => self.team.forget(teller.id),
                    Err(Unused::Unlocated)
                        if self.start(teller, &moment) || self.start_where_found(&moment) =>
                    {
                        let _ = self.team.heard(&moment);
                    }
                    _ => {}
                }
            }
        }
    }

    /// Ties a vehicle to the world by where distances located it.
    fn start_where_found(&mut self, now: &Moment) -> bool {
        let Some((at, pose)) = self.found.get(&now.vehicle) else {
            return false;
        };
        let sigmas = (pose.rotation_sigma_rad, pose.translation_sigma_m);
        self.team
            .start(at, now, &pose.world_from_body, sigmas.0, sigmas.1)
            .is_ok()
    }

    /// Ties a neighbour to the world by its anchor, if it told one that is still worth something.
    fn start(&mut self, teller: &Teller<'_>, now: &Moment) -> bool {
        let Some(boot) = teller.boot else {
            return false;
        };
        let Some(HeardAnchor {
            point,
            growth_known: true,
            told,
        }) = boot.rounds.anchor()
        else {
            return false;
        };
        let instant = boot
            .clock
            .to_mine(PeerStamp::from_nanos(point.taken.as_nanos()));
        let Some(instant) = instant else {
            return false;
        };
        let at = Moment {
            vehicle: teller.id,
            instant,
            point: *point,
        };
        let sigmas = (told.rotation_sigma_rad, told.translation_sigma_m);
        self.team
            .start(&at, now, &told.world_from_body, sigmas.0, sigmas.1)
            .is_ok()
    }

    /// Everybody's measurements and fixes that were not looked at before, in order of time: what locates a vehicle is
    /// then the first that could, and none that was taken before it comes too late.
    fn measure(
        &mut self,
        told: &Told<'_>,
        tellers: &[Teller<'_>],
        refused: &mut Vec<(Option<Name>, Refused)>,
    ) {
        let rounds = tellers.iter().flat_map(|teller| {
            let rounds = teller.rounds.iter();
            rounds.map(move |(instant, round)| (*instant, teller, *round))
        });
        let mut rounds: Vec<(Stamp, &Teller<'_>, &HeardRound)> = rounds.collect();
        rounds.sort_by_key(|(instant, ..)| *instant);
        for (instant, teller, round) in rounds {
            let mut done = std::mem::take(self.done(teller));
            self.fix_round(told, teller, (instant, round), &mut done, refused);
            self.measure_round(told, tellers, teller, (instant, round), &mut done, refused);
            *self.done(teller) = done;
        }
    }

    /// The fixes of a vehicle in one round.
    fn fix_round(
        &mut self,
        told: &Told<'_>,
        teller: &Teller<'_>,
        (instant, round): (Stamp, &HeardRound),
        done: &mut Done,
        refused: &mut Vec<(Option<Name>, Refused)>,
    ) {
        let at = teller.moment(instant, round);
        for (nth, fixed) in round.fixes.iter().enumerate() {
            let key = (round.instant, round.measured.len() + nth);
            if done.contains(&key) {
                continue;
            }
            let outcome = self.fix(&at, nth, fixed);
            if self.is_settled(&outcome, told, instant) {
                done.insert(key);
                refused.extend(outcome.err().map(|why| (teller.name, why.refused())));
            }
        }
    }

    /// What a vehicle measured in one round.
    fn measure_round(
        &mut self,
        told: &Told<'_>,
        tellers: &[Teller<'_>],
        teller: &Teller<'_>,
        (instant, round): (Stamp, &HeardRound),
        done: &mut Done,
        refused: &mut Vec<(Option<Name>, Refused)>,
    ) {
        let from = teller.moment(instant, round);
        for (nth, addressed) in round.measured.iter().enumerate() {
            if done.contains(&(round.instant, nth)) {
                continue;
            }
            let outcome = self.tie(told, tellers, &from, addressed);
            if self.is_settled(&outcome, told, instant) {
                done.insert((round.instant, nth));
                let target = || self.targets.get(&addressed.to).copied();
                let whose = teller.name.or_else(target);
                refused.extend(outcome.err().map(|why| (whose, why.refused())));
            }
        }
    }

    /// Whether nothing more can come of a measurement: what has left the window comes back no more.
    fn is_settled(&self, outcome: &Result<(), NoEnds>, told: &Told<'_>, instant: Stamp) -> bool {
        let is_last = told.round.instant - instant >= self.period * (ROUNDS_BACK_MAX - 1);
        let has_left = self.team.since().is_some_and(|since| instant < since);
        is_last || has_left || !matches!(outcome, Err(NoEnds::NotYet(_)))
    }

    fn done(&mut self, teller: &Teller<'_>) -> &mut Done {
        match teller.name.and_then(|name| self.lives.get_mut(&name)) {
            Some(life) => &mut life.done,
            None => &mut self.own_done,
        }
    }

    fn forget_done(&mut self, now: Stamp, tellers: &[Teller<'_>]) {
        let since = now - self.period * ROUNDS_BACK_MAX;
        for teller in tellers {
            let oldest = match teller.boot {
                None => Some(PeerStamp::from_nanos(since.as_nanos())),
                Some(boot) => boot.clock.to_peer(since),
            };
            if let Some(oldest) = oldest {
                let oldest = oldest.plus(-self.period);
                let done = self.done(teller);
                *done = done.split_off(&(oldest, 0));
            }
        }
    }

    /// Gives the estimator one measurement.
    fn tie(
        &mut self,
        told: &Told<'_>,
        tellers: &[Teller<'_>],
        from: &Moment,
        addressed: &Addressed,
    ) -> Result<(), NoEnds> {
        let of = tellers.iter().find(|teller| teller.id.0 == addressed.to);
        let of = of.ok_or(NoEnds::NotYet(Refused::ClockUnknown))?;
        let Sighting {
            measurement,
            mut noise,
            from_end,
        } = translate::sighting(&addressed.measured.value).map_err(NoEnds::Never)?;
        let offset = Span::micros(i64::from(addressed.measured.taken_offset_us));
        if offset > Span::ZERO {
            return Err(NoEnds::Never(Refused::FromTheFuture));
        }
        let taken = from.instant + offset;
        let nearest = of
            .rounds
            .iter()
            .min_by_key(|(instant, _)| (*instant - taken).abs())
            .filter(|(instant, _)| (*instant - taken).abs() <= share(self.period, ROUND_SHARE_MAX));
        let (instant, round) = nearest.ok_or(NoEnds::NotYet(Refused::NoOdometry))?;
        let to = of.moment(*instant, round);
        let body_round_from_taken = of.moved(&to, taken, told.reckoning)?;
        let apart_s = (taken - *instant).abs().max(offset.abs()).as_secs_f64();
        if noise.translation > 0.0 && apart_s > AT_THE_INSTANT.as_secs_f64() {
            let period_s = self.period.as_secs_f64();
            let within_s = apart_s.min(0.5 * period_s);
            let bent_m = 0.5 * INTERPOLATED_ACCELERATION_M_S2 * within_s * (period_s - within_s);
            noise.translation = noise.translation.hypot(bent_m);
        }
        let observation = Observation {
            measurement,
            noise,
            from_end,
            to_end: body_round_from_taken * of.body_from_target,
        };
        self.team
            .measured(from, &to, &observation)
            .map_err(NoEnds::of)
    }

    /// Gives the estimator one fix.
    fn fix(&mut self, at: &Moment, nth: usize, fixed: &Fixed) -> Result<(), NoEnds> {
        let observation = translate::fixed(fixed).map_err(NoEnds::Never)?;
        let nth = u8::try_from(nth).unwrap_or(u8::MAX);
        self.team.fixed(at, nth, &observation).map_err(NoEnds::of)
    }
}

/// A share of a period.
fn share(period: Span, share: f64) -> Span {
    Span::from_secs_f64(period.as_secs_f64() * share)
}
