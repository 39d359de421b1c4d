//! The pipeline of one vehicle: camera frames that wait, and neighbours that tell nonsense.

use super::*;
use proptest::prelude::*;
use skein_proto::codec::Body as _;
use skein_proto::estimate::Estimate;
use skein_proto::features;

use crate::config::MutualWay;

const PERIOD: Span = Span::millis(200);

fn at(millis: i64) -> Stamp {
    Stamp::default() + Span::millis(millis)
}

fn name(text: &str) -> Name {
    Name::parse(text).unwrap()
}

fn mutual() -> Mutual {
    Mutual::new(name("v1"), 7, MutualConfig::DEFAULT)
}

fn read(mutual: &mut Mutual, millis: std::ops::Range<i64>) {
    for millis in millis.step_by(5) {
        let frame = ImuFrame {
            taken_ns: at(millis).as_nanos(),
            angular_rate_rad_s: [0.0; 3],
            specific_force_m_s2: [0.0, 0.0, 9.81],
            rate_sigma_rad_s: 0.01,
            force_sigma_m_s2: 0.1,
        };
        mutual
            .read(name("imu"), &Transform::identity(), &frame)
            .unwrap();
    }
}

fn look(mutual: &mut Mutual, camera: &str, millis: i64) -> Result<(), Refused> {
    let frame = BearingsFrame {
        taken_ns: at(millis).as_nanos(),
        sigma_rad: 0.09,
        directions: vec![[0.6, 0.8, 0.0]],
    };
    mutual.look(name(camera), Transform::identity(), frame)
}

#[test]
fn a_camera_frame_waits_for_the_readings_of_its_time_and_no_longer_than_it_may() {
    let mut mutual = mutual();
    read(&mut mutual, 0..1_000);
    look(&mut mutual, "camera", 1_050).unwrap();
    assert_eq!(mutual.next_scan(at(1_060), PERIOD), None);
    assert_eq!(mutual.wake_at(), Some(at(1_250)));
    read(&mut mutual, 1_000..1_060);
    let Some(Scanned::Told { set, .. }) = mutual.next_scan(at(1_070), PERIOD) else {
        panic!("the readings have come");
    };
    assert_eq!((set.taken, set.features.len()), (at(1_050), 1));

    look(&mut mutual, "camera", 1_300).unwrap();
    assert_eq!(mutual.next_scan(at(1_499), PERIOD), None);
    let lost = Scanned::Lost {
        camera: name("camera"),
        why: Refused::NoInertial,
    };
    assert_eq!(mutual.next_scan(at(1_500), PERIOD), Some(lost));
    assert_eq!(mutual.wake_at(), None);
}

#[test]
fn one_camera_and_one_inertial_sensor_are_the_source() {
    let mut mutual = mutual();
    read(&mut mutual, 0..100);
    look(&mut mutual, "camera", 50).unwrap();
    assert_eq!(look(&mut mutual, "other", 60), Err(Refused::SecondCamera));
    assert_eq!(look(&mut mutual, "camera", 50), Err(Refused::TooLate));
}

#[test]
fn frames_that_wait_are_bounded() {
    let mut mutual = mutual();
    for nth in 0..WAITING_MAX as i64 {
        look(&mut mutual, "camera", 100 + nth).unwrap();
    }
    assert_eq!(look(&mut mutual, "camera", 200), Err(Refused::Full));
}

/// A set as no check of the wire refuses it: every number anywhere in its range.
fn any_set() -> impl Strategy<Value = features::FeatureSet> {
    let angle = || -3.1f32..3.1;
    let zenith = || 0.0f32..3.1;
    let feature = (angle(), zenith(), 1e-6f32..1e6, any::<Option<u16>>()).prop_map(
        |(azimuth_rad, zenith_rad, sigma_rad, track)| features::Feature {
            azimuth_rad,
            zenith_rad,
            sigma_rad,
            track: track.map(features::TrackNumber),
        },
    );
    let track = (0..4u16, angle(), zenith(), 1e-6f32..1e6, 0..2u8).prop_map(
        |(number, azimuth_rad, zenith_rad, variance_rad2, confirmed)| features::Track {
            number: features::TrackNumber(number),
            azimuth_rad,
            zenith_rad,
            variance_rad2,
            confirmed,
        },
    );
    let integrals = (
        -1e9..1e9f64,
        -1e9..1e9f64,
        prop::array::uniform3(-1e11..1e11f64),
        prop::array::uniform3(-f64::MAX..f64::MAX),
    );
    let rest = (-3.1f32..3.1, -1.5f32..1.5, -1e3f32..1e3, -1e4f32..1e4);
    (
        integrals,
        rest,
        prop::collection::vec(feature, 0..33),
        prop::collection::vec(track, 0..33),
    )
        .prop_map(|(integrals, rest, features, tracks)| {
            let (elapsed_s, yaw_rad, velocity_m_s, position_m) = integrals;
            let (roll_rad, pitch_rad, yaw_rate_rad_s, acceleration) = rest;
            features::FeatureSet {
                sent_ns: 0,
                roll_rad,
                pitch_rad,
                yaw_rate_rad_s,
                acceleration_m_s2: [acceleration; 3],
                integrals: features::Integrals {
                    elapsed_s,
                    yaw_rad,
                    velocity_m_s,
                    position_m,
                },
                features,
                tracks,
            }
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn whatever_passes_the_wire_leaves_something_sayable(
        published in any::<bool>(),
        sets in prop::collection::vec((any_set(), -1_500..1_500i64, 1..4u8), 1..40),
    ) {
        let config = MutualConfig {
            way: if published { MutualWay::Published } else { MutualWay::Persistent },
            ..MutualConfig::DEFAULT
        };
        let mut mutual = Mutual::new(name("v1"), 7, config);
        read(&mut mutual, 0..3_000);
        for (nth, (set, off_ms, from)) in (0..).zip(&sets) {
            let now = at(500 + 50 * nth);
            look(&mut mutual, "camera", 500 + 50 * nth).unwrap();
            prop_assert!(
                matches!(mutual.next_scan(now, PERIOD), Some(Scanned::Told { .. })),
                "the frame is levelled"
            );
            if let Some(work) = mutual.begin_work() {
                let _ = mutual.finish_work(&work.run(), PERIOD);
            }
            prop_assert!(set.check().is_ok(), "{set:?}");
            let taken = now + Span::millis(*off_ms);
            let from = name(&format!("v{}", from + 1));
            if let Err(why) = mutual.hear(from, &from_wire(set, taken)) {
                prop_assert!(
                    ["too_late", "from_the_future", "implausible"].contains(&why.word()),
                    "{why:?}"
                );
            }
            let said = Estimate {
                status: 0,
                world_from_body: None,
                velocity: None,
                covariance: None,
                neighbours: Vec::new(),
                mutual: mutual.neighbours(now).into_values().map(|(_, said)| said).collect(),
                ranging: Vec::new(),
                permit: 0,
            };
            prop_assert!(said.check().is_ok(), "{said:?}");
        }
        prop_assert_eq!(mutual.to_document().sets_heard, sets.len() as u64);
    }
}
