//! The inertial sensor of a EuRoC flight (Burri et al. 2016) with a truth of its own file: a quadrotor in a room, that
//! stands on the ground at first.

use crate::inertial_recording::{InertialReading, RecordingError, rows};
use nalgebra::Vector3;

/// Rows before this are not scored (s): the filter may find its biases.
pub const SCORED_FROM_S: f64 = 20.0;

/// A truth so near to a reading is of its time (ns): half of a sensor's step.
const NEAR_NS: i64 = 2_500_000;

/// A flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// The readings.
    pub readings: Vec<InertialReading>,
    /// The mean of the accelerometer's true bias (m/s^2, sensor frame), as a calibration would find it.
    pub force_bias_m_s2: Vector3<f64>,
}

/// Reads a flight from `imu0_data.csv` (`ns, gyro x y z rad/s, force x y z m/s^2`) and its truth (`ns, p x y z, q w x y z
/// body to world, v x y z, gyro bias x y z, accelerometer bias x y z`), each with one heading line.
pub fn parse(sensor: (&str, &str), truth: (&str, &str)) -> Result<Flight, RecordingError> {
    let mut verticals: Vec<(i64, Vector3<f64>)> = Vec::new();
    let mut force_bias_m_s2 = Vector3::zeros();
    for row in rows(truth.0, truth.1, 17) {
        let row = row?;
        let time_ns = row.nanoseconds(0)?;
        if verticals
            .last()
            .is_some_and(|(before, _)| time_ns <= *before)
        {
            return Err(row.wrong("the time is not later than the one before".to_owned()));
        }
        if let Some(up) = row.up_in_body(4)? {
            verticals.push((time_ns, up));
            force_bias_m_s2 += row.vector(14)?;
        }
    }
    force_bias_m_s2 /= verticals.len().max(1) as f64;
    let mut readings: Vec<InertialReading> = Vec::new();
    let mut start_ns = None;
    let mut verticals = verticals.into_iter().peekable();
    for row in rows(sensor.0, sensor.1, 7) {
        let row = row?;
        let time_ns = row.nanoseconds(0)?;
        let since_ns = time_ns.saturating_sub(*start_ns.get_or_insert(time_ns));
        let time_s = since_ns as f64 * 1e-9;
        if readings
            .last()
            .is_some_and(|before| time_s <= before.time_s)
        {
            return Err(row.wrong("the time is not later than the one before".to_owned()));
        }
        while verticals
            .next_if(|(at_ns, _)| at_ns.saturating_add(NEAR_NS) < time_ns)
            .is_some()
        {}
        let up = verticals
            .next_if(|(at_ns, _)| *at_ns <= time_ns.saturating_add(NEAR_NS))
            .map(|(_, up)| up);
        readings.push(InertialReading {
            time_s,
            rate_rad_s: row.vector(1)?,
            force_m_s2: row.vector(4)?,
            up,
            is_scored: time_s >= SCORED_FROM_S,
        });
    }
    Ok(Flight {
        readings,
        force_bias_m_s2,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: &str = "#\n\
        1000,0,0,0,1,0,0,0,0,0,0,0,0,0,0.1,0.2,0.3\n\
        50001000,0,0,0,0.5,0.5,0.5,0.5,0,0,0,0,0,0,0.3,0.2,0.1\n";
    const SENSOR: &str = "#\n\
        2000,0.1,0.2,0.3,1,2,9\n\
        25002000,0.1,0.2,0.3,1,2,9\n\
        50002000,0.4,0.2,0.3,1,2,8\n\
        20000002000,0.4,0.2,0.3,1,2,8\n";

    #[test]
    fn a_truth_goes_to_the_reading_of_its_time() {
        let flight = parse((SENSOR, "imu"), (TRUTH, "truth")).unwrap();
        let ups: Vec<_> = flight.readings.iter().map(|reading| reading.up).collect();
        assert_eq!(ups[0], Some(Vector3::z()));
        assert_eq!((ups[1], ups[3]), (None, None));
        assert!((ups[2].unwrap() - Vector3::y()).norm() < 1e-12);
        assert!((flight.force_bias_m_s2 - Vector3::new(0.2, 0.2, 0.2)).norm() < 1e-12);
        assert!((flight.readings[2].time_s - 0.05).abs() < 1e-12);
        let scored = flight.readings.iter().map(|reading| reading.is_scored);
        assert_eq!(scored.collect::<Vec<_>>(), [false, false, false, true]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_file_and_line() {
        let error = parse((&SENSOR.replace("25002000", "x"), "imu"), (TRUTH, "truth"));
        let error = error.unwrap_err().to_string();
        assert_eq!(error, "imu:3: `x` is not a time in nanoseconds");
        let error = parse((SENSOR, "imu"), (&TRUTH.replace("50001000", "5"), "truth"));
        assert!(error.unwrap_err().reason.contains("not later"));
    }
}
