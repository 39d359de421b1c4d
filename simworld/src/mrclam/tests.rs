//! Recordings that are wrong in known ways, and the real one.

use super::*;
use crate::datasets;

fn small(file: &str) -> io::Result<String> {
    let text = match file {
        "Barcodes.dat" => "# subject barcode\n1 5\n2 14\n3 41\n4 32\n5 23\n6 63\n",
        "Landmark_Groundtruth.dat" => "6 0.5 -4.25 0.001 0.002\n",
        "Robot1_Measurement.dat" => {
            "10.5 14 3.75 -0.25\n10.5 63 2.0 0.1\n10.75 99 1.0 0.0\n11.0 5 1.0 0.0\n"
        }
        _ if file.ends_with("Odometry.dat") => "10.0 0.1 -0.4\n10.5 0.2 0.0\n10.5 0.3 0.0\n",
        _ if file.ends_with("Measurement.dat") => "",
        _ if file.ends_with("Groundtruth.dat") => "# truth\n10.0 1.0 2.0 0.5\n10.1 1.5 2.0 0.5\n",
        _ => return Err(io::ErrorKind::NotFound.into()),
    };
    Ok(text.to_owned())
}

fn with(file: &'static str, text: &'static str) -> Result<Recording, MrclamError> {
    Recording::parse(|name| {
        if name == file {
            Ok(text.to_owned())
        } else {
            small(name)
        }
    })
}

#[test]
fn barcodes_become_subjects_and_misreads_are_counted() {
    let recording = Recording::parse(small).unwrap();
    let robot = &recording.robots[0];
    let subjects: Vec<_> = robot
        .readings
        .iter()
        .map(|reading| reading.subject)
        .collect();
    assert_eq!(subjects, [Subject::Robot(1), Subject::Landmark(6)]);
    // One barcode that nobody has, and its own.
    assert_eq!(robot.n_misreads, 2);
    let first = robot.readings[0];
    assert_eq!(
        (first.time_ns, first.range_m, first.bearing_rad),
        (10_500_000_000, 3.75, -0.25)
    );
    assert_eq!(
        recording.landmarks,
        [Landmark {
            subject: 6,
            x_m: 0.5,
            y_m: -4.25
        }]
    );
    assert_eq!(robot.commands.len(), 3);
    assert_eq!(
        (recording.start_ns(), recording.end_ns()),
        (10_000_000_000, 10_100_000_000)
    );
}

#[test]
fn every_fault_is_told_with_its_file_and_line() {
    let cases = [
        (
            "Robot2_Odometry.dat",
            "10 0.1 0.0\n9.9 0.1 0\n",
            "Robot2_Odometry.dat:2: the time is earlier",
        ),
        (
            "Robot2_Odometry.dat",
            "# nothing\n",
            "Robot2_Odometry.dat: there is no row",
        ),
        (
            "Robot3_Measurement.dat",
            "1.0 14 -1.0 0\n",
            "Robot3_Measurement.dat:1: the range is negative",
        ),
        (
            "Robot3_Measurement.dat",
            "1.0 14 1.0\n",
            "Robot3_Measurement.dat:1: 4 columns are needed, not 3",
        ),
        (
            "Robot3_Measurement.dat",
            "1.0 x 1.0 0\n",
            "Robot3_Measurement.dat:1: `x` is not a whole number",
        ),
        (
            "Robot5_Groundtruth.dat",
            "1 0 0 0\n\n1 0 0 0\n",
            "Robot5_Groundtruth.dat:3: the time is not later",
        ),
        (
            "Robot5_Groundtruth.dat",
            "1 0 inf 0\n",
            "Robot5_Groundtruth.dat:1: `inf` is not a finite number",
        ),
        (
            "Barcodes.dat",
            "1 5\n2 5\n",
            "Barcodes.dat:2: the barcode 5 belongs to two subjects",
        ),
        (
            "Barcodes.dat",
            "0 5\n",
            "Barcodes.dat:1: subjects count from 1",
        ),
    ];
    for (file, text, expected) in cases {
        let error = with(file, text).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}");
    }
    let missing = Recording::parse(|_| Err(io::ErrorKind::NotFound.into()))
        .unwrap_err()
        .to_string();
    assert!(missing.starts_with("Barcodes.dat: "), "{missing}");
}

#[test]
fn the_real_recording_has_the_counts_it_is_known_for() {
    let Some(folder) = datasets::find("mrclam6") else {
        return;
    };
    let recording = datasets::read_mrclam(&folder).unwrap();
    let count = |robot: bool| -> usize {
        let is_robot =
            |reading: &&RangeBearing| matches!(reading.subject, Subject::Robot(_)) == robot;
        recording
            .robots
            .iter()
            .map(|record| record.readings.iter().filter(is_robot).count())
            .sum()
    };
    let misreads: usize = recording.robots.iter().map(|robot| robot.n_misreads).sum();
    println!(
        "robot-robot {}, robot-landmark {}, misread {misreads}",
        count(true),
        count(false)
    );
    assert_eq!((count(true), count(false)), (3988, 15383));
    assert!(misreads > 0 && misreads < 20);
    // All twenty ordered pairs see each other.
    for (observer, robot) in recording.robots.iter().enumerate() {
        for target in (0..ROBOTS).filter(|target| *target != observer) {
            assert!(
                robot
                    .readings
                    .iter()
                    .any(|reading| reading.subject == Subject::Robot(target))
            );
        }
    }
}
