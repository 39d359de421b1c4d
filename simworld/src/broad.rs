//! A trial of BROAD (Laidig et al. 2021): an inertial sensor in a hand with markers on it, watched by cameras. Only rows in
//! which it moves are scored, and the truth has gaps.

use crate::inertial_recording::{InertialReading, RecordingError, rows};

/// Columns of a row: time, turn rate, force, magnetic field, quaternion, position, movement.
const COLUMNS: usize = 18;

/// Reads a trial (`t_s, gx, gy, gz, ax, ay, az, mx, my, mz, qw, qx, qy, qz, px, py, pz, movement`, one heading line).
/// `file` is what an error calls it.
pub fn parse(text: &str, file: &str) -> Result<Vec<InertialReading>, RecordingError> {
    let mut readings: Vec<InertialReading> = Vec::new();
    for row in rows(text, file, COLUMNS) {
        let row = row?;
        let reading = InertialReading {
            time_s: row.number(0)?,
            rate_rad_s: row.vector(1)?,
            force_m_s2: row.vector(4)?,
            up: row.up_in_body(10)?,
            is_scored: row.number(17)? != 0.0,
        };
        let before = readings.last();
        if before.is_some_and(|before| reading.time_s <= before.time_s) {
            return Err(row.wrong("the time is not later than the one before".to_owned()));
        }
        readings.push(reading);
    }
    Ok(readings)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADING: &str =
        "t_s,gx_rad_s,gy,gz,ax_m_s2,ay,az,mx_uT,my,mz,qw,qx,qy,qz,px_m,py,pz,movement\n";
    const FIRST: &str = "0.0,0.1,0.2,0.3,1,2,9,0,0,0,nan,nan,nan,nan,0,0,1,0\n";
    const SECOND: &str = "0.0035,0.1,0.2,0.3,1,2,9,0,0,0,0.5,0.5,0.5,0.5,0,0,1,1\n";

    #[test]
    fn a_row_is_a_reading_and_the_truth_may_be_missing() {
        let readings = parse(&format!("{HEADING}{FIRST}{SECOND}"), "trial").unwrap();
        assert_eq!((readings[0].up, readings[0].is_scored), (None, false));
        let second = readings[1];
        assert_eq!((second.time_s, second.is_scored), (0.0035, true));
        assert_eq!(second.rate_rad_s.as_slice(), [0.1, 0.2, 0.3]);
        assert_eq!(second.force_m_s2.as_slice(), [1.0, 2.0, 9.0]);
        // A third of a turn about (1, 1, 1) takes y of the body to z of the world.
        let up = second.up.unwrap();
        assert!((up - nalgebra::Vector3::y()).norm() < 1e-12, "{up}");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        let failed = |rows: &str| parse(&format!("{HEADING}{rows}"), "trial").unwrap_err();
        let error = failed(&format!("{FIRST}1,2\n"));
        assert_eq!(error.to_string(), "trial:3: 18 columns are needed, not 2");
        let error = failed(&FIRST.replace("0.2", "nan"));
        assert_eq!(error.to_string(), "trial:2: column 3 is not a number");
        let error = failed(&FIRST.replace("0.2", "inf"));
        assert_eq!(error.to_string(), "trial:2: `inf` is not a number");
        let error = failed(&format!("{SECOND}{FIRST}"));
        assert!(error.reason.contains("not later"), "{error}");
        let error = failed(&SECOND.replace("0.5,0.5,0.5,0.5", "0,0,0,0"));
        assert!(error.reason.contains("quaternion"), "{error}");
    }
}
