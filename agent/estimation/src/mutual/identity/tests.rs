//! Stories of a whole team: who is found, who never is, and what silence, loss, restarts and nonsense do.

use super::flight::{Flight, PERIOD_S, bearing_error_rad, stamp};
use super::*;
use crate::mutual::direction::from_angles;
use crate::mutual::feature_set::{FEATURES_MAX, Feature, TRACKS_MAX, Track, TrackNumber};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

mod hostile;

/// Four that talk and one that does not.
const TEAM: [[f64; 3]; 5] = [
    [-2.0, -2.2, 2.0],
    [2.3, -1.8, 2.8],
    [1.9, 2.4, 1.9],
    [-2.4, 1.7, 3.1],
    [0.2, 0.3, 4.2],
];
const TALKING: usize = 4;

struct Team {
    flight: Flight,
    identity: Identity,
    now: usize,
    radio: ChaCha8Rng,
    loss: f64,
}

impl Team {
    fn new(seed: u64) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Self {
            flight: Flight::new(&TEAM, TALKING, 3f64.to_radians(), rng),
            identity: Identity::new(Flight::vehicle(0)),
            now: 0,
            radio: ChaCha8Rng::seed_from_u64(seed + 1000),
            loss: 0.0,
        }
    }

    fn now_s(&self) -> f64 {
        self.now as f64 * PERIOD_S
    }

    fn fly_until(&mut self, t_s: f64, speaks: impl Fn(usize) -> bool) {
        while self.now_s() < t_s {
            self.now += 1;
            let now_s = self.now_s();
            for robot in 1..self.flight.talking {
                let set = self.flight.set(robot, now_s - 0.01);
                if speaks(robot) && self.radio.random::<f64>() >= self.loss {
                    let _ = self.identity.heard(Flight::vehicle(robot), &set);
                }
            }
            let own = self.flight.set(0, now_s);
            self.identity.own(&own);
        }
    }

    fn located(&self, robot: usize) -> Option<Located> {
        self.identity
            .located()
            .into_iter()
            .find(|located| located.vehicle == Flight::vehicle(robot))
    }

    /// Panics unless a robot is located where it is.
    fn expect_found(&self, robot: usize, distance_within: f64) {
        let located = self.located(robot).expect("it was heard");
        assert_eq!(located.status, Status::Converged, "robot {robot}");
        let held = located.relative.expect("converged ones are somewhere");
        let truth = self.flight.relative(0, robot, self.now_s());
        let bearing_rad = bearing_error_rad(&held, &truth);
        assert!(bearing_rad < 0.1, "robot {robot}: bearing {bearing_rad}");
        let yaw_rad = wrapped(held.yaw_rad - truth.yaw_rad);
        assert!(yaw_rad.abs() < 0.1, "robot {robot}: yaw {yaw_rad}");
        let ratio = held.position_m.norm() / truth.position_m.norm();
        assert!(
            (ratio - 1.0).abs() < distance_within,
            "robot {robot}: distance ratio {ratio}"
        );
    }
}

#[test]
fn a_team_is_found_with_its_distances_and_the_silent_one_is_nobody() {
    let mut team = Team::new(1);
    team.fly_until(25.0, |_| true);
    for robot in 1..TALKING {
        team.expect_found(robot, 0.15);
    }
    assert_eq!(team.identity.located().len(), TALKING - 1);
    let (mut right, mut wrong, mut all) = (0, 0, 0);
    for step in 1..=100 {
        team.fly_until(25.0 + f64::from(step) * PERIOD_S, |_| true);
        // Features are in the order of the robots, so feature n is robot n + 1.
        for identification in team.identity.identities() {
            let robot = identification.feature + 1;
            let expected = (robot < TALKING).then(|| Flight::vehicle(robot));
            all += usize::from(expected.is_some());
            right += usize::from(
                identification.confirmed.is_some() && identification.confirmed == expected,
            );
            wrong += usize::from(
                identification.confirmed.is_some() && identification.confirmed != expected,
            );
            let probabilities = identification.probabilities.iter();
            let total: f64 = probabilities.map(|(_, probability)| probability).sum();
            assert!(total <= 1.0 + 1e-9, "{total}");
        }
    }
    assert!(4 * right > 3 * all, "{right} of {all}");
    assert!(50 * wrong <= right, "{wrong} wrong, {right} right");
}

#[test]
fn a_third_of_the_messages_lost_and_a_team_is_found_all_the_same() {
    let mut team = Team::new(2);
    team.loss = 0.33;
    team.fly_until(30.0, |_| true);
    for robot in 1..TALKING {
        team.expect_found(robot, 0.2);
    }
}

#[test]
fn who_falls_silent_is_forgotten_and_found_again() {
    let mut team = Team::new(3);
    team.fly_until(20.0, |_| true);
    team.expect_found(2, 0.25);
    team.fly_until(27.0, |robot| robot != 2);
    assert_eq!(team.located(2), None);
    team.expect_found(1, 0.25);
    team.expect_found(3, 0.25);
    team.fly_until(45.0, |_| true);
    team.expect_found(2, 0.25);
}

#[test]
fn who_was_restarted_is_found_in_its_new_frame() {
    let mut team = Team::new(4);
    team.fly_until(15.0, |_| true);
    let restart = team.flight.inertial(1, team.now_s());
    let mut until = team.now;
    while until < 700 {
        until += 1;
        team.now = until;
        let now_s = team.now_s();
        for robot in 1..TALKING {
            let mut set = team.flight.set(robot, now_s - 0.01);
            if robot == 1 {
                // Its integrals begin at zero, in the level frame in which it was booted.
                let since = set.inertial.since(&restart);
                for track in &mut set.tracks {
                    track.direction = turned(&track.direction, -restart.yaw_rad);
                }
                set.inertial = crate::mutual::Inertial {
                    elapsed_s: since.elapsed_s,
                    yaw_rad: since.yaw_rad,
                    velocity_m_s: since.velocity_m_s,
                    position_m: since.position_m,
                };
            }
            let _ = team.identity.heard(Flight::vehicle(robot), &set);
        }
        let own = team.flight.set(0, now_s);
        team.identity.own(&own);
    }
    team.expect_found(1, 0.25);
}

#[test]
fn neighbours_beyond_the_bound_are_passed_over() {
    let mut flight = Flight::new(&TEAM, TALKING, 0.05, ChaCha8Rng::seed_from_u64(5));
    let mut identity = Identity::new(Flight::vehicle(0));
    identity.own(&flight.set(0, 0.0));
    let set = flight.set(1, 0.0);
    for neighbour in 0..=NEIGHBOURS_MAX {
        let _ = identity.heard(VehicleId(neighbour as u64), &set);
    }
    assert_eq!(identity.located().len(), NEIGHBOURS_MAX);
    identity.own(&flight.set(0, 0.3));
}

#[test]
fn nonsense_changes_nothing_and_breaks_nothing() {
    let mut team = Team::new(6);
    team.fly_until(12.0, |_| true);
    let before = team.identity.located();
    let now_s = team.now_s();
    let good = team.flight.set(1, now_s);
    let told = |change: &dyn Fn(&mut FeatureSet)| {
        let mut set = good.clone();
        change(&mut set);
        set
    };
    let nonsense = [
        told(&|set| set.inertial.yaw_rad = f64::NAN),
        told(&|set| set.inertial.velocity_m_s = Vector3::repeat(f64::INFINITY)),
        told(&|set| set.taken = Stamp::from_nanos(i64::MAX)),
        told(&|set| set.taken = Stamp::from_nanos(i64::MIN)),
        told(&|set| set.taken = stamp(now_s - 1.0)),
    ];
    for set in &nonsense {
        let _ = team.identity.heard(Flight::vehicle(1), set);
        // The own clock only ever goes on.
        if set.taken <= stamp(now_s) {
            team.identity.own(set);
        }
    }
    assert_eq!(team.identity.located(), before);
}

#[test]
fn a_flood_of_features_and_equal_tracks_is_bounded() {
    let mut team = Team::new(7);
    team.fly_until(5.0, |_| true);
    for step in 1..20 {
        let now_s = team.now_s() + step as f64 * PERIOD_S;
        let mut own = team.flight.set(0, now_s);
        let mut set = team.flight.set(1, now_s);
        for flooded in [&mut own, &mut set] {
            let pole = from_angles(0.0, 0.0);
            let feature = Feature {
                direction: pole,
                sigma_rad: 1e-3,
                track: Some(TrackNumber(9)),
            };
            let track = Track {
                number: TrackNumber(9),
                direction: pole,
                variance_rad2: 1e-9,
                confirmed: true,
            };
            flooded.features = vec![feature; 4 * FEATURES_MAX];
            flooded.tracks = vec![track; 4 * TRACKS_MAX];
        }
        let _ = team.identity.heard(Flight::vehicle(1), &set);
        team.identity.own(&own);
        assert!(team.identity.identities().len() <= FEATURES_MAX);
        for located in team.identity.located() {
            let finite = located
                .relative
                .is_none_or(|relative| relative.position_m.norm().is_finite());
            assert!(finite && located.identity_probability.is_finite());
        }
    }
}

#[test]
fn the_same_sets_give_the_same_answer() {
    let fly = || {
        let mut team = Team::new(8);
        team.loss = 0.2;
        team.fly_until(10.0, |_| true);
        team.identity.located()
    };
    assert_eq!(fly(), fly());
}
