//! A vehicle of the team tells whatever it likes: the others stay where they are.

use super::*;
use crate::mutual::feature_set::Inertial;
use crate::mutual::unused::Unused;
use nalgebra::UnitVector3;
use proptest::prelude::*;
use proptest::sample::select;

/// Numbers that programs break on.
fn absurd() -> impl Strategy<Value = f64> {
    const ABSURD: [f64; 14] = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        0.0,
        -0.0,
        1e-300,
        -1e-12,
        1e3,
        -1e3,
        1e8,
        -1e8,
        1e12,
        f64::MAX,
        f64::MIN,
    ];
    select(ABSURD.to_vec())
}

/// Those, and some that programs do not break on.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![absurd(), -10.0..10.0f64]
}

/// What is wrong with a set.
#[derive(Clone, Debug)]
enum Lie {
    Elapsed(f64),
    ElapsedJumps(f64),
    YawJumps(f64),
    VelocityJumps(f64),
    PositionJumps(f64),
    StampJumpsMs(i64),
    Features {
        direction: [f64; 3],
        sigma: f64,
        count: usize,
    },
    Tracks {
        direction: [f64; 3],
        variance: f64,
        count: usize,
    },
    /// All features are of one track.
    OneTrack(u16),
    Nothing,
}

/// Lies that nobody could take for the truth. Plausible ones are believed, and what such a vehicle sees of others then moves
/// their distances by half: that it accelerates by 14 g this way and that for seconds, or a clock that is wrong by a tenth
/// of a second to two.
fn absurd_lie() -> impl Strategy<Value = Lie> {
    lie(prop_oneof![-100..=100i64, 5000..i64::MAX, i64::MIN..-5000].boxed())
}

fn lie(jumps_ms: BoxedStrategy<i64>) -> impl Strategy<Value = Lie> {
    let vector = || prop::array::uniform3(number());
    prop_oneof![
        absurd().prop_map(Lie::Elapsed),
        absurd().prop_map(Lie::ElapsedJumps),
        absurd().prop_map(Lie::YawJumps),
        absurd().prop_map(Lie::VelocityJumps),
        absurd().prop_map(Lie::PositionJumps),
        jumps_ms.prop_map(Lie::StampJumpsMs),
        (vector(), number(), 0..100usize).prop_map(|(direction, sigma, count)| Lie::Features {
            direction,
            sigma,
            count
        }),
        (vector(), number(), 0..100usize).prop_map(|(direction, variance, count)| Lie::Tracks {
            direction,
            variance,
            count
        }),
        any::<u16>().prop_map(Lie::OneTrack),
        Just(Lie::Nothing),
    ]
}

impl Lie {
    fn tell(&self, set: &mut FeatureSet) {
        let unchecked =
            |direction: &[f64; 3]| UnitVector3::new_unchecked(Vector3::from(*direction));
        let inertial = &mut set.inertial;
        match self {
            Self::Elapsed(number) => inertial.elapsed_s = *number,
            Self::ElapsedJumps(by) => inertial.elapsed_s += by,
            Self::YawJumps(by) => inertial.yaw_rad += by,
            Self::VelocityJumps(by) => inertial.velocity_m_s.x += by,
            Self::PositionJumps(by) => inertial.position_m.z += by,
            Self::StampJumpsMs(by) => {
                set.taken = Stamp::from_nanos(
                    set.taken
                        .as_nanos()
                        .saturating_add(by.saturating_mul(1_000_000)),
                );
            }
            Self::Features {
                direction,
                sigma,
                count,
            } => {
                let feature = Feature {
                    direction: unchecked(direction),
                    sigma_rad: *sigma,
                    track: Some(TrackNumber(*count as u16)),
                };
                set.features.extend(vec![feature; *count]);
            }
            Self::Tracks {
                direction,
                variance,
                count,
            } => {
                let track = |number: usize| Track {
                    number: TrackNumber(number as u16),
                    direction: unchecked(direction),
                    variance_rad2: *variance,
                    confirmed: true,
                };
                set.tracks.extend((0..*count).map(track));
            }
            Self::OneTrack(number) => {
                for feature in &mut set.features {
                    feature.track = Some(TrackNumber(*number));
                }
                for track in &mut set.tracks {
                    track.number = TrackNumber(*number);
                }
            }
            Self::Nothing => {}
        }
    }
}

fn is_finite(located: &Located) -> bool {
    located.identity_probability.is_finite()
        && located.relative.is_none_or(|held| {
            let numbers = held.position_m.iter().chain(held.velocity_m_s.iter());
            numbers
                .chain([&held.yaw_rad])
                .all(|number| number.is_finite())
        })
        && located
            .covariance
            .is_none_or(|covariance| covariance.iter().all(|number| number.is_finite()))
}

/// Flies a team until all are found, and then for six seconds in which one of them lies. Whatever it tells, what is held
/// of all stays finite, and what is refused changes nothing.
fn lied_to(seed: u64, liar: usize, lies: &[Lie]) -> Result<Team, TestCaseError> {
    let mut team = Team::new(seed);
    team.fly_until(14.0, |_| true);
    for lie in lies.iter().cycle().take(120) {
        team.fly_until(team.now_s() + PERIOD_S, |robot| robot != liar);
        let before = team.identity.located();
        let mut set = team.flight.set(liar, team.now_s());
        lie.tell(&mut set);
        if team.identity.heard(Flight::vehicle(liar), &set).is_err() {
            prop_assert_eq!(team.identity.located(), before);
        }
        for located in team.identity.located() {
            prop_assert!(is_finite(&located), "{:?}", located);
        }
    }
    Ok(team)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn who_tells_absurdities_does_not_move_the_others(
        seed in 0..1000u64,
        liar in 1..=TALKING,
        lies in prop::collection::vec(absurd_lie(), 1..60),
    ) {
        let team = lied_to(seed, liar, &lies)?;
        for robot in (1..TALKING).filter(|robot| *robot != liar) {
            team.expect_found(robot, 0.3);
        }
    }

    #[test]
    fn whatever_a_clock_says_nothing_breaks(
        seed in 0..1000u64,
        liar in 1..=TALKING,
        lies in prop::collection::vec(lie((-3000..3000i64).boxed()), 1..60),
    ) {
        lied_to(seed, liar, &lies)?;
    }
}

#[test]
fn every_absurdity_is_refused_for_a_reason() {
    let mut team = Team::new(9);
    team.fly_until(2.0, |_| true);
    let good = team.flight.set(1, team.now_s());
    let mut refused = |lie: Lie| {
        let mut set = good.clone();
        lie.tell(&mut set);
        team.identity.heard(Flight::vehicle(1), &set).err()
    };
    let implausible = Some(Unused::Implausible);
    assert_eq!(refused(Lie::YawJumps(3.0)), implausible);
    assert_eq!(refused(Lie::YawJumps(f64::NAN)), implausible);
    assert_eq!(refused(Lie::VelocityJumps(-20.0)), implausible);
    assert_eq!(refused(Lie::PositionJumps(1e8)), implausible);
    // Its time went back, by less than a restart would take it.
    assert_eq!(refused(Lie::ElapsedJumps(-0.1)), implausible);
    assert_eq!(refused(Lie::Elapsed(f64::INFINITY)), implausible);
    assert_eq!(refused(Lie::StampJumpsMs(-50)), Some(Unused::TooOld));
    assert_eq!(refused(Lie::StampJumpsMs(i64::MIN)), Some(Unused::TooOld));
    assert_eq!(refused(Lie::StampJumpsMs(i64::MAX)), Some(Unused::TooNew));
    assert_eq!(refused(Lie::Nothing), None);
    let own = Flight::vehicle(0);
    assert_eq!(team.identity.heard(own, &good), Err(Unused::Own));
    let mut deaf = Identity::new(own);
    assert_eq!(
        deaf.heard(Flight::vehicle(1), &good),
        Err(Unused::NothingOwn)
    );
}

#[test]
fn who_turns_and_accelerates_as_hard_as_sensors_can_measure_is_believed() {
    let mut team = Team::new(10);
    team.fly_until(2.0, |_| true);
    // A twentieth of a second after the set before.
    let mut set = team.flight.set(1, team.now_s() + 0.04);
    let hard = Inertial {
        yaw_rad: set.inertial.yaw_rad + 1.8,
        velocity_m_s: set.inertial.velocity_m_s + Vector3::x() * 9.0,
        ..set.inertial
    };
    set.inertial = hard;
    assert_eq!(team.identity.heard(Flight::vehicle(1), &set), Ok(()));
}
