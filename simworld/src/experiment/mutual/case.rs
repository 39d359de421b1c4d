//! What is flown: the two published scenarios, other roles and other trajectories, and what goes wrong.

use crate::anonymous::CameraSettings;
use crate::mutual_scenario::{Flight, Formation, MutualScenario, Roles};
use crate::quadrotor::{ImuSettings, WeaveOf};

/// A case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// What it is called.
    pub name: &'static str,
    formation: Formation,
    flight: Flight,
    roles: Roles,
    noise_deg: f64,
    phantoms: usize,
    false_alarms: f64,
    loss: f64,
    late_s: f64,
    rate_bias_deg_s: f64,
}

const SQUARE: Case = Case {
    name: "square",
    formation: Formation::Of(WeaveOf::Square),
    flight: Flight::Weave,
    roles: Roles::InOrder,
    noise_deg: 5.0,
    phantoms: 0,
    false_alarms: 0.0,
    loss: 0.0,
    late_s: 0.0,
    rate_bias_deg_s: 0.0,
};

const EIGHT: Case = Case {
    name: "eight",
    formation: Formation::Of(WeaveOf::Eight),
    ..SQUARE
};

/// All of them, in the order of the table.
pub const CASES: [Case; 14] = [
    SQUARE,
    EIGHT,
    Case {
        name: "eight-2-deg",
        noise_deg: 2.0,
        ..EIGHT
    },
    Case {
        name: "eight-phantoms-loss",
        phantoms: 2,
        loss: 0.3,
        ..EIGHT
    },
    Case {
        name: "eight-roles",
        roles: Roles::Drawn,
        ..EIGHT
    },
    Case {
        name: "eight-roles-phantoms-loss",
        roles: Roles::Drawn,
        phantoms: 2,
        loss: 0.3,
        ..EIGHT
    },
    Case {
        name: "eight-circles",
        flight: Flight::Round,
        roles: Roles::Drawn,
        ..EIGHT
    },
    Case {
        name: "eight-waypoints",
        flight: Flight::Legs,
        roles: Roles::Drawn,
        ..EIGHT
    },
    Case {
        name: "square-circles",
        flight: Flight::Round,
        roles: Roles::Drawn,
        ..SQUARE
    },
    Case {
        name: "square-waypoints",
        flight: Flight::Legs,
        roles: Roles::Drawn,
        ..SQUARE
    },
    Case {
        name: "eight-loss-late",
        loss: 0.3,
        late_s: 0.15,
        ..EIGHT
    },
    Case {
        name: "eight-gyro-bias",
        rate_bias_deg_s: 0.2,
        ..EIGHT
    },
    Case {
        name: "eight-false-alarms",
        false_alarms: 1.0,
        ..EIGHT
    },
    Case {
        name: "twelve-waypoints",
        formation: Formation::Scattered {
            robots: 12,
            silent: 2,
        },
        flight: Flight::Legs,
        ..SQUARE
    },
];

impl Case {
    /// The case of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        CASES.into_iter().find(|case| case.name == name)
    }

    /// Its scenario.
    #[must_use]
    pub fn scenario(&self, seed: u64) -> MutualScenario {
        MutualScenario {
            seed,
            formation: self.formation,
            flight: self.flight,
            roles: self.roles,
            imu: ImuSettings {
                rate_bias_deg_s: self.rate_bias_deg_s,
                ..ImuSettings::default()
            },
            camera: CameraSettings {
                noise_deg: self.noise_deg,
                phantoms: self.phantoms,
                false_alarms: self.false_alarms,
                ..CameraSettings::default()
            },
            loss: self.loss,
            late_s_max: self.late_s,
            ..MutualScenario::square()
        }
    }
}
