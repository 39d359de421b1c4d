//! Cameras and phantoms: what is seen, missed and made up.

use super::*;
use crate::mutual_scenario::MutualScenario;
use crate::mutual_world::MutualWorld;
use crate::sensor::FieldOfView;
use std::collections::BTreeSet;

/// What one camera saw of `square` in all images of a minute.
fn scans(camera: CameraSettings) -> (MutualWorld, Vec<Scan>) {
    let scenario = MutualScenario {
        camera,
        ..MutualScenario::square()
    };
    let world = MutualWorld::new(&scenario, 0);
    let scans = (0..1200).map(|index| world.scan(0, index)).collect();
    (world, scans)
}

#[test]
fn noise_is_on_azimuth_and_zenith_distance_of_the_body_frame() {
    let settings = CameraSettings {
        gaps_per_s: 0.0,
        ..CameraSettings::default()
    };
    let (world, scans) = scans(settings);
    let (mut azimuth, mut zenith) = (Vec::new(), Vec::new());
    for scan in &scans {
        assert_eq!(scan.sightings.len(), 3);
        for sighting in &scan.sightings {
            let (own, target) = (
                world.pose(0, scan.taken_s),
                world.pose(sighting.who.unwrap(), scan.taken_s),
            );
            let place =
                own.rotation.inverse() * (target.translation.vector - own.translation.vector);
            let seen = sighting.direction;
            let turn = seen.y.atan2(seen.x) - place.y.atan2(place.x);
            azimuth.push(turn.sin().atan2(turn.cos()).to_degrees());
            zenith.push((seen.z.acos() - (place.z / place.norm()).acos()).to_degrees());
        }
    }
    for errors in [azimuth, zenith] {
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let sigma = (errors.iter().map(|error| error * error).sum::<f64>() / n).sqrt();
        assert!(
            mean.abs() < 0.3 && (sigma / 5.0 - 1.0).abs() < 0.05,
            "{mean} {sigma}"
        );
    }
}

#[test]
fn a_robot_is_unseen_for_up_to_three_seconds_now_and_then() {
    // 0.1 gaps a second of 1.5 s each on average hide a robot for 1 - exp(-0.15) = 13.9 % of the time.
    let streams = |sample| Streams::new(2, sample);
    let settings = CameraSettings::default();
    let (mut hidden, mut longest_s) = (0.0, 0.0_f64);
    for sample in 0..200 {
        let camera = Camera::new(settings, 0, 2, 0.0..60.0, streams(sample));
        let unseen = (0..1200).filter(|step| camera.gap(1, 0.05 * f64::from(*step)));
        hidden += unseen.count() as f64 / 1200.0 / 200.0;
        let lengths = camera.gaps_s[1].iter().map(|(from, to)| to - from);
        longest_s = lengths.fold(longest_s, f64::max);
    }
    assert!((hidden - 0.139).abs() < 0.015, "{hidden}");
    assert!(longest_s <= 3.0 && longest_s > 2.9, "{longest_s}");
}

#[test]
fn the_order_says_nothing_about_who_it_is() {
    let (_, scans) = scans(CameraSettings::perfect());
    let orders: BTreeSet<Vec<Option<usize>>> = scans
        .iter()
        .map(|scan| scan.sightings.iter().map(|sighting| sighting.who).collect())
        .collect();
    assert_eq!(orders.len(), 6);
}

#[test]
fn phantoms_and_false_alarms_are_nobody() {
    let settings = CameraSettings {
        phantoms: 2,
        false_alarms: 0.5,
        ..CameraSettings::perfect()
    };
    let (_, scans) = scans(settings);
    let nobody = |scan: &Scan| {
        scan.sightings
            .iter()
            .filter(|sighting| sighting.who.is_none())
            .count()
    };
    let mean = scans.iter().map(nobody).sum::<usize>() as f64 / scans.len() as f64;
    assert!((mean - 2.5).abs() < 0.07, "{mean}");
    assert!(scans.iter().all(|scan| nobody(scan) >= 2));
}

#[test]
fn a_camera_sees_what_is_in_view() {
    let view = FieldOfView {
        horizontal_deg: 90.0,
        vertical_deg: 60.0,
    };
    let settings = CameraSettings {
        view: Some(view),
        false_alarms: 1.0,
        ..CameraSettings::perfect()
    };
    let (_, scans) = scans(settings);
    let sightings = scans.iter().flat_map(|scan| &scan.sightings);
    assert!(
        sightings
            .clone()
            .all(|sighting| view.contains(&sighting.direction))
    );
    assert!(sightings.filter(|sighting| sighting.who.is_some()).count() > 100);
}

#[test]
fn images_come_at_twenty_a_second_with_four_milliseconds_of_jitter() {
    let (_, scans) = scans(CameraSettings::default());
    let late: Vec<f64> = scans
        .iter()
        .enumerate()
        .map(|(n, scan)| scan.taken_s - 0.05 * n as f64)
        .collect();
    let sigma = (late.iter().map(|late| late * late).sum::<f64>() / late.len() as f64).sqrt();
    assert!((sigma / 0.004 - 1.0).abs() < 0.08, "{sigma}");
    assert!(
        scans
            .windows(2)
            .all(|pair| pair[0].taken_s < pair[1].taken_s)
    );
}
