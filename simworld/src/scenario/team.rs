//! Who flies: either a number of vehicles in a named formation, or every vehicle one by one.

use super::VEHICLES_MAX;
use crate::quadrotor::{Course, Weave, WeaveOf};
use crate::trajectory::{Hover, Parallel, SectionV, Trajectory};
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// How much a vehicle knows of its own pose when it starts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Start {
    /// Its true pose.
    #[default]
    Pose,
    /// Nothing: others must place it.
    Unknown,
}

/// One vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// Its name in the fleet; `v1`, `v2`, ... when not given.
    #[serde(default)]
    pub name: String,
    /// Where it flies.
    pub trajectory: Trajectory,
    /// What it knows at the start.
    #[serde(default)]
    pub start: Start,
}

/// Paths for any number of vehicles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Formation {
    /// The zig-zag paths of section V.
    SectionV,
    /// Straight parallel lines 2 m apart.
    ParallelLines,
    /// A square grid of 3 m, each swaying in its own rhythm.
    Hover,
    /// Quadrotors that start in a square that looks the same to each of them; of more than four, the others start
    /// where one of them does.
    Square,
    /// Quadrotors in two columns at several heights.
    Eight,
}

impl Formation {
    /// The path of the vehicle with this index, from 0.
    #[must_use]
    pub fn trajectory(self, index: usize) -> Trajectory {
        let robot = u32::try_from(index + 1)
            .ok()
            .and_then(NonZeroU32::new)
            .expect("a vehicle's number fits into 32 bits and is not 0");
        match self {
            Self::SectionV => Trajectory::SectionV(SectionV { robot }),
            Self::Square => weave(WeaveOf::Square, index),
            Self::Eight => weave(WeaveOf::Eight, index),
            Self::ParallelLines => Trajectory::Parallel(Parallel::of_robot(robot)),
            Self::Hover => {
                let (column, row) = spiral(index);
                Trajectory::Hover(Hover {
                    position_m: [3.0 * column, 3.0 * row, 5.0 + 0.5 * (index % 3) as f64],
                    yaw_deg: 0.0,
                    sway_m: [0.5, 0.3, 0.2],
                    sway_period_s: 10.0 + 1.3 * (index % 7) as f64,
                })
            }
        }
    }
}

fn weave(team: WeaveOf, index: usize) -> Trajectory {
    Trajectory::Quadrotor(Course::Weave(Weave {
        team,
        robot: index + 1,
    }))
}

/// Column and row of the places of a square that grows by one row and one column at a time: 4 vehicles are a square
/// of 2 by 2, 9 of 3 by 3, and a vehicle's place does not depend on how many others there are.
fn spiral(index: usize) -> (f64, f64) {
    let shell = index.isqrt();
    let within = index - shell * shell;
    let (column, row) = if within <= shell {
        (shell, within)
    } else {
        (2 * shell - within, shell)
    };
    (column as f64, row as f64)
}

/// The vehicles of a scenario, at least one and at most `VEHICLES_MAX`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Team {
    vehicles: Vec<Vehicle>,
}

/// A team as it is written.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(skip_serializing_if = "Option::is_none")]
    count: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    formation: Option<Formation>,
    /// With `count`: whose start is unknown, by index from 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    unknown_start: Vec<usize>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    vehicles: Vec<Vehicle>,
}

impl TryFrom<Written> for Team {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        let mut vehicles = match (written.count, written.formation, written.vehicles) {
            (Some(count), Some(formation), listed) if listed.is_empty() => {
                if count > VEHICLES_MAX {
                    return Err(format!("{count} vehicles are more than {VEHICLES_MAX}"));
                }
                Self::in_formation(count, formation).vehicles
            }
            (None, None, listed) if !listed.is_empty() => listed,
            _ => {
                return Err(
                    "a team is either `count` and `formation`, or a list of `vehicles`".into(),
                );
            }
        };
        for index in written.unknown_start {
            let vehicle = vehicles.get_mut(index).ok_or_else(|| {
                format!("unknown_start: there is no vehicle {index} (they count from 0)")
            })?;
            vehicle.start = Start::Unknown;
        }
        if vehicles.is_empty() || vehicles.len() > VEHICLES_MAX {
            return Err(format!(
                "a team has 1 to {VEHICLES_MAX} vehicles, not {}",
                vehicles.len()
            ));
        }
        for (index, vehicle) in vehicles.iter_mut().enumerate() {
            if vehicle.name.is_empty() {
                vehicle.name = format!("v{}", index + 1);
            }
        }
        let mut names: Vec<&str> = vehicles
            .iter()
            .map(|vehicle| vehicle.name.as_str())
            .collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(format!("two vehicles have the name `{}`", twice[0]));
        }
        Ok(Self { vehicles })
    }
}

impl From<Team> for Written {
    fn from(team: Team) -> Self {
        Self {
            count: None,
            formation: None,
            unknown_start: Vec::new(),
            vehicles: team.vehicles,
        }
    }
}

impl Team {
    /// This many vehicles (1 to `VEHICLES_MAX`) in a formation, named `v1`, `v2`, ..., all with a known start.
    #[must_use]
    pub fn in_formation(count: usize, formation: Formation) -> Self {
        let vehicle = |index: usize| Vehicle {
            name: format!("v{}", index + 1),
            trajectory: formation.trajectory(index),
            start: Start::Pose,
        };
        Self {
            vehicles: (0..count).map(vehicle).collect(),
        }
    }

    /// The vehicles, in their order.
    #[must_use]
    pub fn vehicles(&self) -> &[Vehicle] {
        &self.vehicles
    }

    /// The vehicles, to change them.
    pub fn vehicles_mut(&mut self) -> &mut [Vehicle] {
        &mut self.vehicles
    }

    /// Keeps the first `count` vehicles.
    pub fn truncate(&mut self, count: usize) {
        self.vehicles.truncate(count);
    }

    /// How many vehicles there are.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "a team is never empty")]
    pub fn len(&self) -> usize {
        self.vehicles.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hovering_formation_gives_every_vehicle_a_place_of_its_own() {
        let places: Vec<_> = (0..25)
            .map(|index| Formation::Hover.trajectory(index).pose_at(0.0))
            .collect();
        for (index, place) in places.iter().enumerate() {
            for other in &places[..index] {
                assert!(
                    (place.translation.vector - other.translation.vector)
                        .xy()
                        .norm()
                        > 2.9
                );
            }
        }
        // The first four are a square of 3 m.
        assert!(
            places[..4]
                .iter()
                .all(|place| place.translation.x <= 3.0 && place.translation.y <= 3.0)
        );
    }

    #[test]
    fn a_team_is_written_one_way_or_the_other() {
        assert!(toml::from_str::<Team>("count = 3").is_err());
        assert!(toml::from_str::<Team>("vehicles = []").is_err());
        let both = "count = 1\nformation = 'hover'\nvehicles = [{ trajectory.hover = { position_m = [0, 0, 0] } }]";
        assert!(toml::from_str::<Team>(both).is_err());
        let team: Team =
            toml::from_str("count = 3\nformation = 'section-v'\nunknown_start = [1]").unwrap();
        assert_eq!(team.vehicles()[1].start, Start::Unknown);
        assert!(
            toml::from_str::<Team>("count = 3\nformation = 'section-v'\nunknown_start = [3]")
                .is_err()
        );
    }

    #[test]
    fn two_vehicles_of_one_name_are_refused() {
        let text = "vehicles = [
            { name = 'a', trajectory.hover = { position_m = [0, 0, 0] } },
            { name = 'a', trajectory.hover = { position_m = [1, 0, 0] } },
        ]";
        assert!(
            toml::from_str::<Team>(text)
                .unwrap_err()
                .to_string()
                .contains("the name `a`")
        );
    }
}
