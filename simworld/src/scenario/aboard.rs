//! The laws of inertial sensors and cameras, and of those that fly along: nothing may be read without end.

use super::Scenario;
use crate::trajectory::Trajectory;

/// How many may fly along.
pub const BYSTANDERS_MAX: usize = 32;
/// Readings a second of one sensor.
pub const READINGS_PER_S_MAX: f64 = 2_000.0;
/// Phantoms of one camera, and false alarms in one image on average.
pub const SIGHTINGS_MAX: usize = 32;
/// How long a flight with a camera may last, whose gaps and phantoms are drawn before it begins (s): a day.
pub const CAMERA_TIME_MAX_S: f64 = 86_400.0;

/// Checks them; the key to blame comes first.
pub(super) fn check(scenario: &Scenario) -> Result<(), (&'static str, String)> {
    if scenario.bystanders.len() > BYSTANDERS_MAX {
        let message = format!("more than {BYSTANDERS_MAX} fly along");
        return Err(("bystanders", message));
    }
    let too_often = |rate_hz: f64| {
        (rate_hz > READINGS_PER_S_MAX)
            .then(|| format!("{rate_hz} readings a second are more than {READINGS_PER_S_MAX}"))
    };
    if let Some(imu) = &scenario.imu {
        if let Some(message) = too_often(imu.rate_hz) {
            return Err(("imu", message));
        }
        if !imu
            .force_noise
            .iter()
            .chain(&imu.rate_noise)
            .all(|noise| *noise >= 0.0)
        {
            return Err(("imu", "noise is a number, 0 or more".into()));
        }
        for vehicle in scenario.team.vehicles() {
            if !matches!(vehicle.trajectory, Trajectory::Quadrotor(_)) {
                let message = format!("the path of `{}` is not a quadrotor's", vehicle.name);
                return Err(("imu", message));
            }
        }
    }
    if let Some(camera) = &scenario.camera {
        let blame = |message: String| Err(("camera", message));
        if let Some(message) = too_often(camera.rate_hz) {
            return blame(message);
        }
        let most = SIGHTINGS_MAX as f64;
        if camera.phantoms > SIGHTINGS_MAX || camera.false_alarms > most || camera.gaps_per_s > most
        {
            return blame(format!(
                "phantoms, false_alarms and gaps_per_s are at most {most}"
            ));
        }
        if scenario.standstill_s + scenario.duration_s > CAMERA_TIME_MAX_S {
            return blame(format!(
                "a flight with cameras lasts {CAMERA_TIME_MAX_S} s at most"
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_be_read_without_end_is_refused_with_its_key() {
        let square = Scenario::built_in_text("square").unwrap();
        let with = |line: &str, setting: &str| square.replace(line, &format!("{line}\n{setting}"));
        let lists = "quadrotor.weave = { team = \"eight\", robot = 7 }";
        let many = |count: usize| vec![format!("{{ {lists} }}"); count].join(", ");
        let cases = [
            (with("[imu]", "rate_hz = 2001"), "imu"),
            (with("[imu]", "force_noise = [0.1, -0.1, 0.1]"), "imu"),
            (with("[camera]", "rate_hz = 1e9"), "camera"),
            (with("[camera]", "phantoms = 33"), "camera"),
            (with("[camera]", "gaps_per_s = 1e9"), "camera"),
            (
                square.replace("duration_s = 60.0", "duration_s = 86400"),
                "camera",
            ),
            (square.replace("\"square\"\n\n#", "\"hover\"\n\n#"), "imu"),
            (
                with(
                    "seed = 1",
                    &format!("bystanders = [{}]", many(BYSTANDERS_MAX + 1)),
                ),
                "bystanders",
            ),
        ];
        for (text, key) in cases {
            let error = Scenario::parse(&text, "mine.toml").unwrap_err();
            assert_eq!(error.key(), Some(key), "{error}");
        }
        for (line, setting) in [("[imu]", "rate_hz = 2000"), ("[camera]", "phantoms = 32")] {
            assert!(
                Scenario::parse(&with(line, setting), "mine.toml").is_ok(),
                "{setting}"
            );
        }
        let most = with(
            "seed = 1",
            &format!("bystanders = [{}]", many(BYSTANDERS_MAX)),
        );
        assert!(Scenario::parse(&most, "mine.toml").is_ok());
    }
}
