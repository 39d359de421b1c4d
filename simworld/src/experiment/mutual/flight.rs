//! One flight of one method: the first vehicle makes and hears feature sets, and after each of its own says where
//! everyone is.

use super::method::{Locator, Method};
use super::score::STEADY_FROM_S;
use super::telling::{Telling, Told};
use crate::mutual_world::{MutualWorld, Relative};
use crate::truth::wrapped_rad;
use nalgebra::{SMatrix, SVector, Vector3};
use skein_estimation::VehicleId;
use skein_estimation::mutual::{Reduced, Status};

/// The vehicle whose estimates are looked at.
const OBSERVER: usize = 0;
/// When the two pictures are taken: while everyone still hovers, and when distances are long found (s).
const PICTURES_S: [f64; 2] = [1.5, 40.0];
/// How many of the likeliest places are drawn.
const DRAWN: usize = 100;

/// How far an estimate is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Error {
    /// Azimuth (rad), positive counter-clockwise.
    pub azimuth_rad: f64,
    /// Zenith distance (rad).
    pub zenith_rad: f64,
    /// The angle between the directions (rad).
    pub bearing_rad: f64,
    /// Distance as a part of the true one.
    pub distance: f64,
    /// Relative yaw (rad).
    pub yaw_rad: f64,
}

/// What is held of a neighbour after one own set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// When that set was taken (s).
    pub taken_s: f64,
    /// The estimator says that the neighbour is there and nowhere else.
    pub published: bool,
    /// How far its likeliest place is off; none when there is none.
    pub error: Option<Error>,
    /// The squared error of position, velocity and yaw over the covariance that is told, per number of them: one in the
    /// mean when that covariance is right; none where none is told.
    pub nees: Option<f64>,
}

/// One neighbour in a picture; all in the level frame of the observer, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictured {
    /// Where it truly is.
    pub truth: Vector3<f64>,
    /// Where it is held to be.
    pub estimate: Option<Vector3<f64>>,
    /// Its likeliest places.
    pub likeliest: Vec<Vector3<f64>>,
}

/// What is believed at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// When (s).
    pub taken_s: f64,
    /// Every neighbour that talks.
    pub neighbours: Vec<Pictured>,
}

/// A flight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Flown {
    /// `[neighbour][image]`.
    pub moments: Vec<Vec<Moment>>,
    /// Two instants.
    pub snapshots: Vec<Snapshot>,
    /// What it said of own features, from [`STEADY_FROM_S`] on.
    pub identities: Identities,
}

/// How many features were said to be whom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Identities {
    /// Features that are a robot that talks, of the images that the method looked at.
    pub possible: usize,
    /// Features that it was sure of.
    pub sure: usize,
    /// Those of them that are another, or nobody.
    pub wrong: usize,
}

impl Identities {
    fn add(&mut self, world: &MutualWorld, told: &Told, said: &[(usize, VehicleId)]) {
        let talks = |who: &&Option<usize>| who.is_some_and(|who| who < world.talking());
        self.possible += told.who.iter().filter(talks).count();
        for (feature, who) in said {
            let truly = told.who.get(*feature).copied().flatten();
            self.sure += 1;
            self.wrong += usize::from(truly.map(id) != Some(*who));
        }
    }
}

/// The name of a vehicle for the estimators.
fn id(vehicle: usize) -> VehicleId {
    VehicleId(vehicle as u64 + 1)
}

/// Flies one method over what is told.
#[must_use]
pub fn fly(world: &MutualWorld, telling: &Telling, method: Method, sample: u64) -> Flown {
    let seed = world
        .scenario()
        .seed
        .wrapping_mul(1_000_003)
        .wrapping_add(sample);
    let mut locator = method.locator(id(OBSERVER), seed);
    let mut mail = mail(world, telling).into_iter().peekable();
    let mut flown = Flown {
        moments: vec![Vec::new(); world.talking() - 1],
        ..Flown::default()
    };
    let mut pictures = PICTURES_S.into_iter().peekable();
    for told in &telling.told[OBSERVER] {
        let taken_s = told.set.taken.as_nanos() as f64 / 1e9;
        while let Some(letter) = mail.next_if(|letter| letter.arrives_s <= taken_s) {
            let set = &telling.told[letter.from][letter.image].set;
            locator.heard(id(letter.from), set);
        }
        locator.own(&told.set);
        let located = locator.located();
        for (index, moments) in flown.moments.iter_mut().enumerate() {
            let neighbour = index + 1;
            let found = located
                .iter()
                .find(|located| located.vehicle == id(neighbour));
            let truth = world.relative(OBSERVER, neighbour, taken_s);
            let relative = found.and_then(|found| found.relative);
            let covariance = found.and_then(|found| found.covariance);
            moments.push(Moment {
                taken_s,
                published: found.is_some_and(|found| found.status == Status::Converged),
                error: relative.map(|relative| Error::of(&relative, &truth)),
                nees: relative
                    .zip(covariance)
                    .and_then(|(relative, covariance)| nees(&relative, covariance, &truth)),
            });
        }
        let identified = locator
            .identified(&told.set)
            .filter(|_| taken_s >= STEADY_FROM_S);
        if let Some(identified) = identified {
            flown.identities.add(world, told, &identified);
        }
        if pictures
            .next_if(|picture_s| *picture_s <= taken_s)
            .is_some()
        {
            let picture = picture(world, locator.as_ref(), &located, taken_s);
            flown.snapshots.push(picture);
        }
    }
    flown
}

/// A set on its way.
struct Letter {
    arrives_s: f64,
    from: usize,
    image: usize,
}

/// What the observer hears, in the order in which it arrives.
fn mail(world: &MutualWorld, telling: &Telling) -> Vec<Letter> {
    let mut mail = Vec::new();
    for (from, told) in telling.told.iter().enumerate() {
        for (image, told) in told.iter().enumerate() {
            let after_s = world.arrives_after_s(from, OBSERVER, image);
            if let Some(after_s) = after_s.filter(|_| from != OBSERVER) {
                let arrives_s = told.set.taken.as_nanos() as f64 / 1e9 + after_s;
                mail.push(Letter {
                    arrives_s,
                    from,
                    image,
                });
            }
        }
    }
    mail.sort_by(|a, b| a.arrives_s.total_cmp(&b.arrives_s));
    mail
}

impl Error {
    /// Of an estimate. Angles are computed here anew and not by the estimators' own formulas.
    fn of(estimate: &Reduced, truth: &Relative) -> Self {
        let (held, true_place) = (estimate.position_m, truth.position_m);
        let azimuth = |place: &Vector3<f64>| place.y.atan2(place.x);
        let zenith = |place: &Vector3<f64>| place.x.hypot(place.y).atan2(place.z);
        Self {
            azimuth_rad: wrapped_rad(azimuth(&held) - azimuth(&true_place)),
            zenith_rad: zenith(&held) - zenith(&true_place),
            bearing_rad: held.angle(&true_place),
            distance: held.norm() / true_place.norm() - 1.0,
            yaw_rad: wrapped_rad(estimate.yaw_rad - truth.yaw_rad),
        }
    }
}

/// Normalised squared error per dimension; none of a covariance that is none.
fn nees(held: &Reduced, covariance: SMatrix<f64, 7, 7>, truth: &Relative) -> Option<f64> {
    let mut error = SVector::<f64, 7>::zeros();
    error
        .fixed_rows_mut::<3>(0)
        .copy_from(&(held.position_m - truth.position_m));
    error
        .fixed_rows_mut::<3>(3)
        .copy_from(&(held.velocity_m_s - truth.velocity_m_s));
    error[6] = wrapped_rad(held.yaw_rad - truth.yaw_rad);
    let normalised = covariance.cholesky()?.solve(&error);
    Some(error.dot(&normalised) / 7.0)
}

fn picture(
    world: &MutualWorld,
    locator: &dyn Locator,
    located: &[skein_estimation::mutual::Located],
    taken_s: f64,
) -> Snapshot {
    let pictured = |neighbour: usize| {
        let found = located
            .iter()
            .find(|located| located.vehicle == id(neighbour));
        let likeliest = locator.likeliest(id(neighbour), DRAWN);
        Pictured {
            truth: world.relative(OBSERVER, neighbour, taken_s).position_m,
            estimate: found
                .and_then(|found| found.relative)
                .map(|relative| relative.position_m),
            likeliest: likeliest.iter().map(|place| place.position_m).collect(),
        }
    };
    Snapshot {
        taken_s,
        neighbours: (1..world.talking()).map(pictured).collect(),
    }
}
