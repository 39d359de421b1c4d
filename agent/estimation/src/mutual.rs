//! Mutual localisation from anonymous bearings (Cognetti et al.): which robot is that, and where?
//!
//! A camera sees robots but not which robots. Each vehicle levels what its camera and its inertial sensor say by its own
//! attitude and tells it as a [`FeatureSet`]; from the sets of all, each vehicle finds where every team-mate is.
//!
//! All equations are in the *level* frame of a vehicle: its body's origin, z up, x along the body's heading. The paper's
//! frames point north, east and down; its relative equations keep their form, the sign of gravity and the attitude
//! formulas do not.

pub mod direction;

pub mod feature_set;

pub mod assignment;

pub mod located;

mod unused;

pub mod attitude;

pub mod own_motion;

pub mod propagation;

pub mod identity;

pub mod registration;

pub mod filter;

pub mod registered;

pub use attitude::Attitude;
pub use feature_set::{Feature, FeatureSet, Inertial, Motion, Track, TrackNumber};
pub use identity::{Identity, Tracker};
pub use located::{Located, Reduced, Status};
pub use own_motion::OwnMotion;
pub use registered::{Done, Registered, Work};
pub use unused::Unused;
