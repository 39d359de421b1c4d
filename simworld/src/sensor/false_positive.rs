//! What a sensor reports that is not so: single wrong measurements of real robots, times during which a whole sensor is
//! wrong, and robots that do not exist.

use super::{Kind, Noise, position};
use crate::bounded::probability;
use crate::streams::{Purpose, Streams};
use crate::truth::{self, Pose};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, UnitBall, UnitSphere};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// How a wrong measurement is wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Wrong {
    /// Anything in range: any rotation, anywhere in the ball of the sensing range.
    #[default]
    Gross,
    /// The truth with an error of 3 to 10 standard deviations of the sensor's stated noise in a random direction, in
    /// each part that the sensor tells: what is grossly improbable for the sensor, and small for the team.
    Moderate,
    /// The truth, displaced by about 0.5 m and turned by about 0.2 rad per axis: hardest to tell from a good one.
    Displaced,
}

/// The error of one wrong measurement, or of a sensor for a while.
#[derive(Clone, Copy, Debug)]
pub(super) enum Mistake {
    /// Nothing is left of the truth: this is measured.
    Instead(Pose),
    /// The truth is turned about the target and displaced, metres, in the sensor's frame.
    Moved(UnitQuaternion<f64>, Vector3<f64>),
    /// So many standard deviations about and along these axes.
    Deviations(Vector3<f64>, Vector3<f64>),
}

/// The multiples of the stated noise of a moderate mistake.
const DEVIATIONS: std::ops::Range<f64> = 3.0..10.0;

impl Wrong {
    /// Of a single measurement.
    pub(super) fn once(self, range_m: f64, rng: &mut impl Rng) -> Mistake {
        match self {
            Self::Gross => {
                let place: [f64; 3] = UnitBall.sample(rng);
                Mistake::Instead(truth::pose(
                    any_rotation(rng),
                    Vector3::from(place) * range_m,
                ))
            }
            Self::Moderate => {
                let mut deviations = || {
                    let direction: [f64; 3] = UnitSphere.sample(rng);
                    Vector3::from(direction) * rng.random_range(DEVIATIONS)
                };
                Mistake::Deviations(deviations(), deviations())
            }
            Self::Displaced => {
                let turn = UnitQuaternion::from_scaled_axis(position::normal(0.2, rng));
                Mistake::Moved(turn, position::normal(0.5, rng))
            }
        }
    }

    /// Of a sensor that is wrong for a while by one and the same error: grossly, that is turned anyhow and displaced by
    /// up to the sensing range.
    fn lasting(self, range_m: f64, rng: &mut impl Rng) -> Mistake {
        match self.once(range_m, rng) {
            Mistake::Instead(pose) => Mistake::Moved(pose.rotation, pose.translation.vector),
            mistake => mistake,
        }
    }
}

impl Mistake {
    /// The wrong `sensor_from_target` that a sensor of this kind and noise measures in the place of the true one.
    pub(super) fn of(&self, sensor_from_target: &Pose, kind: Kind, noise: &Noise) -> Pose {
        let (rotation, place) = (
            sensor_from_target.rotation,
            sensor_from_target.translation.vector,
        );
        match self {
            Self::Instead(pose) => *pose,
            Self::Moved(turn, displacement_m) => {
                truth::pose(rotation * turn, place + displacement_m)
            }
            Self::Deviations(about, along) => {
                let turn = about * noise.rotation_concentration.angle_std_rad();
                let place = match kind {
                    Kind::Pose | Kind::Orientation | Kind::Position => {
                        place + along * noise.translation_std_m
                    }
                    Kind::Bearing => {
                        let angle_rad = along.norm() * noise.bearing_concentration.angle_std_rad();
                        towards(&place, along, angle_rad)
                    }
                    // The sign of any one component of a random direction is a fair coin.
                    Kind::Distance => {
                        let error_m = along.norm() * along.x.signum() * noise.distance_std_m;
                        place + along_the_line_of_sight(&place) * error_m
                    }
                };
                truth::pose(rotation * UnitQuaternion::from_scaled_axis(turn), place)
            }
        }
    }
}

/// A place turned by an angle about the sensor, towards a direction.
fn towards(place: &Vector3<f64>, direction: &Vector3<f64>, angle_rad: f64) -> Vector3<f64> {
    let axis = nalgebra::Unit::try_new(place.cross(direction), 1e-12);
    let turned = |axis| UnitQuaternion::from_axis_angle(&axis, angle_rad) * place;
    axis.map_or(*place, turned)
}

fn along_the_line_of_sight(place: &Vector3<f64>) -> Vector3<f64> {
    place.try_normalize(1e-12).unwrap_or_else(Vector3::x)
}

/// A rotation that is uniform over all rotations: three uniform numbers, after Shoemake (1992).
fn any_rotation(rng: &mut impl Rng) -> UnitQuaternion<f64> {
    let (u, v, w): (f64, f64, f64) = (rng.random(), rng.random(), rng.random());
    let (a, b) = ((1.0 - u).sqrt(), u.sqrt());
    UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
        b * (TAU * w).cos(),
        a * (TAU * v).sin(),
        a * (TAU * v).cos(),
        b * (TAU * w).sin(),
    ))
}

/// Times during which everything that one vehicle's sensor measures is wrong by one and the same error. The vehicles'
/// sensors go wrong independently of each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrongBurst {
    /// The probability that it begins in a round in which the sensor is not wrong already.
    #[serde(deserialize_with = "probability")]
    pub start_probability: f64,
    /// For how many rounds in a row it lasts.
    pub rounds: u32,
    /// How the sensor is then wrong.
    #[serde(default)]
    pub wrong: Wrong,
}

/// The bursts of one sensor.
#[derive(Clone, Debug)]
pub(super) struct Bursts {
    settings: Option<WrongBurst>,
    range_m: f64,
    /// Rounds that it will still be wrong after this one.
    rounds_left: u32,
    mistake: Option<Mistake>,
    rng: ChaCha8Rng,
}

impl Bursts {
    pub(super) fn of_observer(
        settings: &FalsePositives,
        range_m: f64,
        observer: usize,
        streams: &Streams,
    ) -> Self {
        Self {
            settings: settings.burst,
            range_m,
            rounds_left: 0,
            mistake: None,
            rng: streams.vehicle(observer, Purpose::WrongBurst),
        }
    }

    /// Another round begins.
    pub(super) fn begin_round(&mut self) {
        if self.rounds_left > 0 {
            self.rounds_left -= 1;
            return;
        }
        self.mistake = None;
        if let Some(settings) = self.settings
            && self.rng.random::<f64>() < settings.start_probability
            && settings.rounds > 0
        {
            self.rounds_left = settings.rounds - 1;
            self.mistake = Some(settings.wrong.lasting(self.range_m, &mut self.rng));
        }
    }

    /// The error of this round, if the sensor is wrong.
    pub(super) const fn mistake(&self) -> Option<&Mistake> {
        self.mistake.as_ref()
    }
}

/// The settings of what is not so; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FalsePositives {
    /// The probability that a measurement is wrong.
    #[serde(deserialize_with = "probability")]
    pub wrong_probability: f64,
    /// How it is then wrong.
    pub wrong: Wrong,
    /// When a whole sensor is wrong.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub burst: Option<WrongBurst>,
    /// How many robots each vehicle sees that do not exist.
    pub phantoms: usize,
}

/// A robot that does not exist: it flies about its observer and is taken for one of the others.
#[derive(Clone, Debug)]
pub struct Phantom {
    taken_for: usize,
    places: Vector3<f64>,
    turns_per_s: Vector3<f64>,
    phases: Vector3<f64>,
    pub(super) rng: ChaCha8Rng,
}

impl Phantom {
    /// The phantoms of one observer; none in a fleet of one, where there is nobody to be taken for.
    pub(super) fn of_observer(
        settings: &FalsePositives,
        observer: usize,
        n_vehicles: usize,
        streams: &Streams,
    ) -> Vec<Self> {
        let others: Vec<usize> = (0..n_vehicles)
            .filter(|vehicle| *vehicle != observer)
            .collect();
        if others.is_empty() {
            return Vec::new();
        }
        (0..settings.phantoms)
            .map(|number| {
                let mut rng = streams.pair(observer, number, Purpose::Phantom);
                let direction: [f64; 3] = UnitSphere.sample(&mut rng);
                Self {
                    taken_for: others[rng.random_range(0..others.len())],
                    places: Vector3::from(direction) * rng.random_range(2.0..5.0),
                    turns_per_s: Vector3::from_fn(|_, _| rng.random_range(0.02..0.08)),
                    phases: Vector3::from_fn(|_, _| rng.random()),
                    rng,
                }
            })
            .collect()
    }

    /// The index of the vehicle that the observer takes it for.
    #[must_use]
    pub const fn taken_for(&self) -> usize {
        self.taken_for
    }

    /// Where it seems to be at `t_s`: it keeps its place about the observer in world axes and wanders by up to 2 m.
    #[must_use]
    pub fn pose_at(&self, t_s: f64, world_from_observer: &Pose) -> Pose {
        let wave = Vector3::from_fn(|axis, _| {
            (TAU * (self.turns_per_s[axis] * t_s + self.phases[axis])).sin()
        });
        let place = world_from_observer.translation.vector + self.places + 1.15 * wave;
        truth::pose_from_euler(place, wave.x * 3.0, 0.0, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gross_error_is_anywhere_in_range_and_turned_anyhow() {
        let mut rng = Streams::new(1, 0).vehicle(0, Purpose::Outlier);
        let truth = truth::pose_from_euler(Vector3::new(3.0, 0.0, 0.0), 0.0, 0.0, 0.0);
        let noise = Noise::default();
        let wrong: Vec<Pose> = (0..20_000)
            .map(|_| Wrong::Gross.once(7.0, &mut rng))
            .map(|mistake| mistake.of(&truth, Kind::Pose, &noise))
            .collect();
        let n = wrong.len() as f64;
        assert!(
            wrong
                .iter()
                .all(|pose| pose.translation.vector.norm() <= 7.0)
        );
        // Uniform in a ball: the mean distance is 3/4 of the radius. Uniform over rotations: mean angle pi/2 + 2/pi.
        let mean_distance = wrong
            .iter()
            .map(|pose| pose.translation.vector.norm())
            .sum::<f64>()
            / n;
        let mean_angle = wrong.iter().map(|pose| pose.rotation.angle()).sum::<f64>() / n;
        assert!((mean_distance - 5.25).abs() < 0.04, "{mean_distance}");
        assert!(
            (mean_angle - (TAU / 4.0 + 4.0 / TAU)).abs() < 0.02,
            "{mean_angle}"
        );
    }

    #[test]
    fn a_moderate_error_is_three_to_ten_deviations_of_what_the_sensor_states_whichever_way() {
        let mut rng = Streams::new(1, 0).vehicle(0, Purpose::Outlier);
        let truth = truth::pose_from_euler(Vector3::new(3.0, 1.0, -2.0), 0.4, 0.0, 0.0);
        let place = truth.translation.vector;
        let noise = Noise {
            translation_std_m: 0.02,
            distance_std_m: 0.05,
            ..Noise::default()
        };
        // 2 / sqrt(10,000) of an angle.
        let angle_std_rad = 0.02;
        for kind in [Kind::Pose, Kind::Bearing, Kind::Distance] {
            let (mut deviations, mut sum) = (Vec::new(), Vector3::zeros());
            for _ in 0..20_000 {
                let wrong = Wrong::Moderate.once(7.0, &mut rng).of(&truth, kind, &noise);
                let moved = wrong.translation.vector - place;
                let turned = truth.rotation.angle_to(&wrong.rotation) / angle_std_rad;
                assert!((3.0..=10.0).contains(&turned), "{turned}");
                sum += moved / place.norm();
                deviations.push(match kind {
                    Kind::Bearing => place.angle(&wrong.translation.vector) / angle_std_rad,
                    Kind::Distance => (wrong.translation.vector.norm() - place.norm()).abs() / 0.05,
                    _ => moved.norm() / 0.02,
                });
            }
            let mean = deviations.iter().sum::<f64>() / 20_000.0;
            assert!(deviations.iter().all(|x| (2.999..10.001).contains(x)));
            assert!((mean - 6.5).abs() < 0.05, "{kind:?}: {mean}");
            // A turned bearing falls short of its direction by 1 - cos 0.13 on average.
            assert!((sum / 20_000.0).norm() < 0.011, "{kind:?}: {sum}");
        }
    }

    /// In which rounds a sensor is wrong, and by which pose.
    fn wrong_rounds(burst: WrongBurst, observer: usize, rounds: usize) -> Vec<Option<Pose>> {
        let settings = FalsePositives {
            burst: Some(burst),
            ..FalsePositives::default()
        };
        let mut bursts = Bursts::of_observer(&settings, 7.0, observer, &Streams::new(4, 0));
        (0..rounds)
            .map(|_| {
                bursts.begin_round();
                let mistake = bursts.mistake()?;
                Some(mistake.of(&Pose::identity(), Kind::Pose, &Noise::default()))
            })
            .collect()
    }

    #[test]
    fn a_burst_lasts_its_rounds_with_one_error_and_comes_as_often_as_asked() {
        for wrong in [Wrong::Gross, Wrong::Moderate, Wrong::Displaced] {
            let burst = WrongBurst {
                start_probability: 0.02,
                rounds: 10,
                wrong,
            };
            let seen = wrong_rounds(burst, 0, 100_000);
            let runs = seen.chunk_by(|a, b| a == b);
            let bursts: Vec<usize> = runs
                .filter(|run| run[0].is_some())
                .map(<[Option<Pose>]>::len)
                .collect();
            // The last one may be cut short.
            let whole = &bursts[..bursts.len() - 1];
            assert!(whole.iter().all(|rounds| *rounds == 10), "{wrong:?}");
            // A burst in every 49 rounds without and 10 with; a count is off by its root.
            let expected: f64 = 100_000.0 / 59.0;
            let count = bursts.len() as f64;
            assert!((count - expected).abs() < 4.0 * expected.sqrt(), "{count}");
            let others = wrong_rounds(burst, 1, 100_000);
            let both = seen.iter().zip(&others);
            let both = both.filter(|(a, b)| a.is_some() && b.is_some()).count() as f64;
            let alone = (10.0_f64 / 59.0).powi(2) * 100_000.0;
            assert!((both / alone - 1.0).abs() < 0.15, "{both} of {alone}");
        }
    }

    #[test]
    fn bursts_are_read_from_a_scenario_and_never_begin_when_they_last_no_round() {
        let settings: FalsePositives =
            toml::from_str("burst = { start_probability = 0.1, rounds = 5, wrong = \"moderate\" }")
                .unwrap();
        let burst = settings.burst.unwrap();
        assert_eq!((burst.rounds, burst.wrong), (5, Wrong::Moderate));
        let endless = WrongBurst {
            start_probability: 1.0,
            ..burst
        };
        assert!(wrong_rounds(endless, 0, 50).iter().all(Option::is_some));
        let none = WrongBurst {
            rounds: 0,
            ..endless
        };
        assert!(wrong_rounds(none, 0, 50).iter().all(Option::is_none));
    }

    #[test]
    fn a_phantom_keeps_near_its_observer_and_is_taken_for_another_vehicle() {
        let settings = FalsePositives {
            phantoms: 3,
            ..FalsePositives::default()
        };
        let phantoms = Phantom::of_observer(&settings, 1, 4, &Streams::new(2, 0));
        assert_eq!(phantoms.len(), 3);
        let observer = truth::pose_from_euler(Vector3::new(50.0, 0.0, 0.0), 1.0, 0.0, 0.0);
        for phantom in &phantoms {
            assert!(phantom.taken_for() < 4 && phantom.taken_for() != 1);
            for second in 0..60 {
                let pose = phantom.pose_at(f64::from(second), &observer);
                assert!((pose.translation.vector - observer.translation.vector).norm() < 7.0);
            }
        }
        assert!(Phantom::of_observer(&settings, 0, 1, &Streams::new(2, 0)).is_empty());
    }
}
