//! `skein get`: the newest estimate of one vehicle or of all, as a table or as JSON.

use super::Ending;
use super::observer::{Observer, ObserverArgs, WaitArgs};
use super::output::{plain, print, print_json};
use super::sigma;
use crate::clock::Clock;
use crate::queries::About;
use skein_estimation::time::Stamp;
use skein_proto::document::{
    CovarianceDocument, EstimateDocument, MutualDocument, Permit, PoseDocument, RangedBy,
    RangingDocument,
};
use skein_proto::name::Name;

/// An age beyond this is another clock (a recording, a simulation), not an age.
const AGE_MAX_S: f64 = 86_400.0;

#[derive(clap::Args)]
#[command(after_help = "Examples:
  skein get                          all vehicles of the fleet `skein`
  skein get v1 --json                one, as JSON
  skein get --fleet geese --connect tcp/10.0.0.1:7447   without multicast
The columns +- are one standard deviation over all three axes, where the estimator supplies a covariance.
It ends with 3 when nobody answers.")]
pub(super) struct GetArgs {
    /// The vehicle; all of the fleet without it.
    vehicle: Option<Name>,
    /// Print a JSON array of estimates, one for each vehicle, as documented in ZENOH_API.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    wait: WaitArgs,
    #[command(flatten)]
    observer: ObserverArgs,
}

pub(super) fn run(args: &GetArgs) -> miette::Result<Ending> {
    let (network, fleet) = (args.observer.network(), args.observer.fleet());
    let observer = Observer::open(&network, fleet, args.wait.wait)?;
    let selector = observer.selector(About::Estimate, args.vehicle);
    eprintln!("selector: {selector}");
    let answers = observer.ask::<EstimateDocument>(About::Estimate, args.vehicle)?;
    for (vehicle, reason) in &answers.silent {
        eprintln!("{vehicle}: {reason}");
    }
    if answers.documents.is_empty() {
        eprintln!("{}", observer.advice(args.vehicle));
        return Ok(Ending::NobodyAnswered);
    }
    let estimates: Vec<EstimateDocument> = answers.documents.into_values().collect();
    if args.json {
        print_json(&estimates)
    } else {
        print(&table(&estimates, Clock::real().now()))
    }
}

/// Rows of equal width; a neighbour's row stands under the vehicle that sees it, in that vehicle's body frame.
fn table(estimates: &[EstimateDocument], now: Stamp) -> String {
    use std::fmt::Write;
    let mut page = String::new();
    let _ = writeln!(
        page,
        "{:<20} {:<14} {:>8} {:>10} {:>10} {:>10} {:>9} {:>8} {:>8} {:>8} {:>8}",
        "vehicle",
        "status",
        "age s",
        "x m",
        "y m",
        "z m",
        "+- m",
        "yaw deg",
        "pitch",
        "roll",
        "+- deg"
    );
    for estimate in estimates {
        let age = age(now, estimate.taken_ns);
        let vehicle = estimate.vehicle.to_string();
        row(
            &mut page,
            &vehicle,
            estimate.status.words(),
            &age,
            estimate.pose.as_ref(),
            estimate.covariance.as_ref(),
        );
        for neighbour in &estimate.neighbours {
            let name = format!("  sees {}", neighbour.vehicle);
            let status = neighbour
                .status
                .map_or("-", skein_proto::status::Status::words);
            let age = neighbour
                .taken_ns
                .map_or_else(|| "-".to_owned(), |ns| self::age(now, ns));
            row(
                &mut page,
                &name,
                status,
                &age,
                neighbour.pose.as_ref(),
                neighbour.covariance.as_ref(),
            );
            if let Some(mutual) = &neighbour.mutual {
                let _ = writeln!(page, "{}", bearings_line(now, mutual));
            }
            if let Some(ranging) = &neighbour.ranging {
                let _ = writeln!(page, "{}", distances_line(now, ranging));
                if let Some(why) = &ranging.why {
                    let _ = writeln!(page, "      {}", plain(why));
                }
            }
        }
        if let Some(motion) = &estimate.motion {
            let permit = match motion.permit {
                Permit::Move => "it may move",
                Permit::Stay => "it must stand still",
            };
            let _ = writeln!(page, "  turn {}: {permit}", motion.round);
        }
        if let Some(why) = &estimate.why {
            let _ = writeln!(page, "  {}", plain(why));
        }
    }
    page
}

fn row(
    page: &mut String,
    name: &str,
    status: &str,
    age: &str,
    pose: Option<&PoseDocument>,
    covariance: Option<&CovarianceDocument>,
) {
    use std::fmt::Write;
    let _ = write!(page, "{name:<20} {status:<14} {age:>8}");
    match pose {
        Some(pose) => {
            let [x, y, z] = pose.position_m;
            let [yaw, pitch, roll] = pose.yaw_pitch_roll_deg;
            let sigma_m = sigma::position_m(covariance, 3);
            let sigma_deg = sigma::rotation_deg(covariance, 2);
            let _ = writeln!(
                page,
                " {x:>10.3} {y:>10.3} {z:>10.3} {sigma_m:>9} {yaw:>8.2} {pitch:>8.2} {roll:>8.2} {sigma_deg:>8}"
            );
        }
        None => {
            let _ = writeln!(
                page,
                " {:>10} {:>10} {:>10} {:>9} {:>8} {:>8} {:>8} {:>8}",
                "-", "-", "-", "-", "-", "-", "-", "-"
            );
        }
    }
}

/// Where a neighbour is by anonymous bearings.
fn bearings_line(now: Stamp, mutual: &MutualDocument) -> String {
    let sigmas = mutual.reduced.as_ref().map(|reduced| {
        let yaw_deg = reduced.yaw_sigma_rad().map(f64::to_degrees);
        (reduced.position_sigma_m(), yaw_deg)
    });
    let age = age(now, mutual.taken_ns);
    located_line(
        "by bearings",
        &mutual.words(),
        &age,
        mutual.pose.as_ref(),
        sigmas,
    )
}

/// Where a neighbour is by distances alone.
fn distances_line(now: Stamp, ranging: &RangingDocument) -> String {
    let sigmas = ranging.reduced.as_ref().map(|reduced| {
        let yaw_deg = reduced.yaw_sigma_rad().map(f64::to_degrees);
        (reduced.position_sigma_m(), yaw_deg)
    });
    let age = age(now, ranging.taken_ns);
    located_line(
        match ranging.by {
            Some(RangedBy::All) => "by all distances",
            Some(RangedBy::Pair) | None => "by distances",
        },
        &ranging.words(),
        &age,
        ranging.pose.as_ref(),
        sigmas,
    )
}

/// One way of knowing where a neighbour is, with the standard deviations of position (m) and yaw (degrees).
fn located_line(
    way: &str,
    words: &str,
    age: &str,
    pose: Option<&PoseDocument>,
    sigmas: Option<(Option<f64>, Option<f64>)>,
) -> String {
    let Some((pose, (position_m, yaw_deg))) = pose.zip(sigmas) else {
        return format!("    {way:<16} {words:<14} {age:>8}");
    };
    let [x, y, z] = pose.position_m;
    let [yaw, pitch, roll] = pose.yaw_pitch_roll_deg;
    let sigma_m = sigma::plus_minus(position_m, 3);
    let sigma_deg = sigma::plus_minus(yaw_deg, 2);
    format!(
        "    {way:<16} {words:<14} {age:>8} {x:>10.3} {y:>10.3} {z:>10.3} {sigma_m:>9} {yaw:>8.2} {pitch:>8.2} \
         {roll:>8.2} {sigma_deg:>8}"
    )
}

/// Seconds since something was taken.
pub(super) fn age(now: Stamp, taken_ns: i64) -> String {
    let age_s = (now - Stamp::from_nanos(taken_ns)).as_secs_f64();
    if age_s.abs() < AGE_MAX_S {
        format!("{age_s:.2}")
    } else {
        "-".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::sigma::tests::covariance;
    use skein_proto::document::NeighbourDocument;
    use skein_proto::status::Status;

    fn pose(position_m: [f64; 3]) -> PoseDocument {
        PoseDocument {
            position_m,
            quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
            yaw_pitch_roll_deg: [90.0, 0.0, 0.0],
            rotation_vector_rad: [0.0; 3],
        }
    }

    /// A vehicle that reckons on, and sees `v2` without knowing where it is.
    fn estimate() -> EstimateDocument {
        EstimateDocument {
            vehicle: Name::parse("v1").unwrap(),
            boot: "00000000000000ab".to_owned(),
            taken_ns: 1_000_000_000,
            status: Status::DeadReckoning,
            pose: Some(pose([1.0, -2.0, 3.0])),
            velocity: None,
            covariance: None,
            neighbours: vec![NeighbourDocument {
                vehicle: Name::parse("v2").unwrap(),
                status: Some(Status::Tracking),
                taken_ns: None,
                pose: None,
                covariance: None,
                mutual: None,
                ranging: None,
            }],
            features: vec![],
            motion: None,
            why: Some("nobody measures".to_owned()),
        }
    }

    #[test]
    fn the_table_has_a_row_for_each_vehicle_and_each_neighbour_and_says_why() {
        let page = table(&[estimate()], Stamp::from_nanos(1_500_000_000));
        let lines: Vec<&str> = page.lines().collect();
        assert_eq!(lines.len(), 4, "{page}");
        assert!(
            lines[1].contains("dead reckoning")
                && lines[1].contains("0.50")
                && lines[1].contains("-2.000")
        );
        assert!(lines[2].starts_with("  sees v2") && lines[2].contains("tracking"));
        assert!(lines[3].contains("nobody measures"));
        assert!(!page.contains("+-0"), "nobody said how far off it is");
    }

    #[test]
    fn beside_each_pose_stands_how_far_off_it_may_be_when_the_estimator_says() {
        let mut estimate = estimate();
        estimate.covariance = Some(covariance(0.1, 0.2));
        estimate.neighbours[0].pose = Some(pose([0.0, 1.0, 0.0]));
        estimate.neighbours[0].covariance = Some(covariance(0.01, 0.02));
        let page = table(&[estimate], Stamp::from_nanos(1_500_000_000));
        let lines: Vec<&str> = page.lines().collect();
        for (line, sigma_m, sigma_deg) in [
            (lines[1], "+-0.346", "+-9.92"),
            (lines[2], "+-0.035", "+-0.99"),
        ] {
            for (sigma, title) in [(sigma_m, "+- m"), (sigma_deg, "+- deg")] {
                let ends = |text: &str, word: &str| text.find(word).map(|at| at + word.len());
                assert!(line.contains(sigma), "{page}");
                assert_eq!(ends(line, sigma), ends(lines[0], title), "{page}");
            }
        }
    }

    #[test]
    fn json_has_the_covariances_as_they_were_published() {
        let mut estimate = estimate();
        estimate.covariance = Some(covariance(0.1, 0.2));
        estimate.neighbours[0].covariance = Some(covariance(0.01, 0.02));
        let json = crate::queries::json(&[&estimate]);
        let read: Vec<EstimateDocument> = serde_json::from_slice(&json).unwrap();
        assert_eq!(read, [estimate]);
    }
}
