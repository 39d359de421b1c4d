//! What the sensors see, miss and make up, against the noise that was asked for.

use super::*;
use crate::truth::pose_from_euler;
use crate::von_mises_fisher::VonMisesFisher;

fn exact() -> Noise {
    let exact = VonMisesFisher::new(1e24).unwrap();
    Noise {
        rotation_concentration: exact,
        translation_std_m: 0.0,
        bearing_concentration: exact,
        distance_std_m: 0.0,
    }
}

fn sensor(settings: &SensorSettings) -> RelativeSensor {
    RelativeSensor::new(settings, 0, 3, Streams::new(3, 0))
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    pose_from_euler(Vector3::new(x, y, z), 0.0, 0.0, 0.0)
}

fn every_kind() -> [Kind; 5] {
    [
        Kind::Pose,
        Kind::Orientation,
        Kind::Position,
        Kind::Bearing,
        Kind::Distance,
    ]
}

#[test]
fn a_mounted_sensor_measures_in_its_own_frame_and_from_its_own_place() {
    // By hand: the observer at (2, 0, 0) looks north; its sensor sits 1 m ahead, thus at (2, 1, 0), and looks to the
    // body's left, thus west. The target at (0, 1, 0) is 2 m ahead of the sensor; it looks east: turned half about.
    let settings = SensorSettings {
        noise: exact(),
        miss_probability: 0.0,
        mounts: vec![Mount {
            translation_m: [1.0, 0.0, 0.0],
            yaw_deg: 90.0,
            ..Mount::default()
        }],
        ..SensorSettings::default()
    };
    let observer = pose_from_euler(Vector3::new(2.0, 0.0, 0.0), 90_f64.to_radians(), 0.0, 0.0);
    let target = at(0.0, 1.0, 0.0);
    let ahead = Vector3::new(2.0, 0.0, 0.0);
    for kind in every_kind() {
        let mut sensor = sensor(&SensorSettings {
            kind,
            ..settings.clone()
        });
        let reading = sensor
            .observe(0.0, &observer, 1, &target)
            .reading()
            .unwrap();
        let right = match reading {
            Reading::Pose(pose) => {
                (pose.translation.vector - ahead).norm() < 1e-9
                    && (pose.rotation * Vector3::x() + Vector3::x()).norm() < 1e-9
            }
            Reading::Orientation(rotation) => {
                (rotation * Vector3::x() + Vector3::x()).norm() < 1e-9
            }
            Reading::Position(position) => (position - ahead).norm() < 1e-9,
            Reading::Bearing(bearing) => (bearing.into_inner() - Vector3::x()).norm() < 1e-9,
            Reading::Distance(distance_m) => (distance_m - 2.0).abs() < 1e-9,
        };
        assert!(right, "{reading:?}");
    }
}

#[test]
fn every_noise_has_the_size_of_section_v() {
    let n = 20_000;
    let noise = Noise::default();
    let truth = pose_from_euler(Vector3::new(3.0, -1.0, 2.0), 0.4, 0.2, -0.3);
    let place = truth.translation.vector;
    for kind in every_kind() {
        let mut rng = Streams::new(4, 0).vehicle(0, Purpose::Measurement);
        let mut sum = [0.0; 2];
        for _ in 0..n {
            let square = match measure(kind, &truth, &noise, &mut rng) {
                Reading::Pose(pose) => [
                    truth
                        .rotation
                        .rotation_to(&pose.rotation)
                        .scaled_axis()
                        .norm_squared()
                        / 3.0,
                    (pose.translation.vector - place).norm_squared() / 3.0,
                ],
                Reading::Orientation(rotation) => [
                    truth
                        .rotation
                        .rotation_to(&rotation)
                        .scaled_axis()
                        .norm_squared()
                        / 3.0,
                    1e-6,
                ],
                Reading::Position(position) => [4e-4, (position - place).norm_squared() / 3.0],
                // Only the two axes across the bearing can be seen in it.
                Reading::Bearing(bearing) => [bearing.angle(&place).powi(2) / 2.0, 1e-6],
                Reading::Distance(distance_m) => [4e-4, (distance_m - place.norm()).powi(2)],
            };
            sum[0] += square[0] / f64::from(n);
            sum[1] += square[1] / f64::from(n);
        }
        assert!(
            (sum[0].sqrt() - 0.02).abs() < 4e-4,
            "{kind:?}: {} rad",
            sum[0].sqrt()
        );
        assert!(
            (sum[1].sqrt() - 0.001).abs() < 2e-5,
            "{kind:?}: {} m",
            sum[1].sqrt()
        );
    }
}

#[test]
fn a_quarter_of_all_looks_is_missed_independently_in_both_directions() {
    let settings = SensorSettings::default();
    let n = 40_000;
    let (mut first, mut second) = (
        sensor(&settings),
        RelativeSensor::new(&settings, 1, 3, Streams::new(3, 0)),
    );
    let (a, b) = (at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0));
    let (mut missed, mut both) = (0, 0);
    for _ in 0..n {
        let forth = first.observe(0.0, &a, 1, &b) == Sight::Missed;
        let back = second.observe(0.0, &b, 0, &a) == Sight::Missed;
        missed += u32::from(forth);
        both += u32::from(forth && back);
    }
    assert!(
        (f64::from(missed) / f64::from(n) - 0.25).abs() < 0.01,
        "{missed}"
    );
    assert!(
        (f64::from(both) / f64::from(n) - 0.0625).abs() < 0.006,
        "{both}"
    );
}

#[test]
fn sight_ends_at_the_sensing_range_measured_from_the_sensor() {
    let settings = SensorSettings {
        miss_probability: 0.0,
        mounts: vec![Mount {
            translation_m: [0.3, 0.0, 0.0],
            ..Mount::default()
        }],
        ..SensorSettings::default()
    };
    let mut sensor = sensor(&settings);
    let observer = at(0.0, 0.0, 0.0);
    assert!(matches!(
        sensor.observe(0.0, &observer, 1, &at(7.29, 0.0, 0.0)),
        Sight::Seen { .. }
    ));
    assert_eq!(
        sensor.observe(0.0, &observer, 1, &at(7.31, 0.0, 0.0)),
        Sight::OutOfRange
    );
    assert_eq!(
        sensor.observe(0.0, &observer, 1, &at(-6.71, 0.0, 0.0)),
        Sight::OutOfRange
    );
}

#[test]
fn what_is_behind_a_camera_is_out_of_view() {
    let view = FieldOfView {
        horizontal_deg: 90.0,
        vertical_deg: 60.0,
    };
    let settings = SensorSettings {
        miss_probability: 0.0,
        field_of_view: Some(view),
        ..SensorSettings::default()
    };
    let mut sensor = sensor(&settings);
    assert_eq!(
        sensor.observe(0.0, &at(0.0, 0.0, 0.0), 1, &at(-2.0, 0.0, 0.0)),
        Sight::OutOfView
    );
}

#[test]
fn what_two_vehicles_see_of_each_other_does_not_change_with_the_size_of_the_fleet() {
    let settings = SensorSettings::default();
    let look = |n_vehicles: usize| {
        let mut sensor = RelativeSensor::new(&settings, 0, n_vehicles, Streams::new(3, 0));
        (0..20)
            .map(|_| {
                let seen = sensor.observe(0.0, &at(0.0, 0.0, 0.0), 1, &at(2.0, 0.0, 0.0));
                for other in 2..n_vehicles {
                    sensor.observe(0.0, &at(0.0, 0.0, 0.0), other, &at(3.0, 0.0, 0.0));
                }
                seen
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(look(2), look(5));
}

#[test]
fn wrong_measurements_come_as_often_as_asked_and_say_so() {
    let false_positives = FalsePositives {
        wrong_probability: 0.2,
        ..FalsePositives::default()
    };
    let settings = SensorSettings {
        miss_probability: 0.0,
        false_positives,
        ..SensorSettings::default()
    };
    let mut sensor = sensor(&settings);
    let mut wrongs = 0;
    for _ in 0..20_000 {
        let Sight::Seen {
            reading: Reading::Pose(pose),
            wrong,
        } = sensor.observe(0.0, &at(0.0, 0.0, 0.0), 1, &at(2.0, 0.0, 0.0))
        else {
            panic!("nothing is missed here")
        };
        let far_off = (pose.translation.vector - Vector3::new(2.0, 0.0, 0.0)).norm() > 0.01;
        assert!(wrong || !far_off);
        wrongs += i32::from(wrong);
    }
    assert!(
        (f64::from(wrongs) / 20_000.0 - 0.2).abs() < 0.01,
        "{wrongs}"
    );
}

#[test]
fn a_sensor_that_is_wrong_for_a_while_is_wrong_about_everybody_by_one_error_and_says_so() {
    let false_positives = FalsePositives {
        burst: Some(WrongBurst {
            start_probability: 0.1,
            rounds: 7,
            wrong: Wrong::Displaced,
        }),
        ..FalsePositives::default()
    };
    let settings = SensorSettings {
        miss_probability: 0.0,
        noise: exact(),
        false_positives,
        ..SensorSettings::default()
    };
    let mut sensor = sensor(&settings);
    let mut wrongs = 0;
    for k in 0..500 {
        sensor.begin_round(0.2 * f64::from(k), 0.2);
        let mut errors = Vec::new();
        for (target, x) in [(1, 2.0), (2, 4.0)] {
            let sight = sensor.observe(0.0, &at(0.0, 0.0, 0.0), target, &at(x, 0.0, 0.0));
            let Sight::Seen {
                reading: Reading::Pose(pose),
                wrong,
            } = sight
            else {
                panic!("nothing is missed here")
            };
            let off = pose.translation.vector - Vector3::new(x, 0.0, 0.0);
            assert_eq!(wrong, off.norm() > 1e-6);
            wrongs += i32::from(wrong);
            errors.push(off);
        }
        assert!((errors[0] - errors[1]).norm() < 1e-9, "{errors:?}");
    }
    assert!(wrongs > 100, "{wrongs}");
}

#[test]
fn phantoms_are_measured_as_robots_are() {
    let false_positives = FalsePositives {
        phantoms: 2,
        ..FalsePositives::default()
    };
    let settings = SensorSettings {
        kind: Kind::Bearing,
        false_positives,
        ..SensorSettings::default()
    };
    let mut sensor = sensor(&settings);
    let seen: usize = (0..400)
        .map(|k| {
            sensor
                .phantoms(0.2 * f64::from(k), &at(5.0, 0.0, 0.0))
                .len()
        })
        .sum();
    // Two at a time, a quarter missed.
    assert!((550..650).contains(&seen), "{seen}");
}

#[test]
fn a_random_measuring_time_lies_within_the_period_that_ends_with_the_round() {
    let settings = SensorSettings {
        taken: Taken::AnywhereInRound,
        ..SensorSettings::default()
    };
    let mut sensor = sensor(&settings);
    let times: Vec<f64> = (0..1000).map(|_| sensor.begin_round(4.0, 0.2)).collect();
    assert!(times.iter().all(|t_s| *t_s > 3.8 && *t_s <= 4.0));
    let mean_s = times.iter().sum::<f64>() / 1000.0;
    assert!((mean_s - 3.9).abs() < 0.01, "{mean_s}");
}
