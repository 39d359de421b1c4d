//! Range-only localisation (Cornejo & Nagpal, section V): who moves when, how far off windows, banks and stop and move are
//! beside their bounds, what flocking makes of the estimates, and what messages, bytes and time it costs.

pub mod complexity;
pub mod election;
pub mod errors;
pub mod flocking;
pub mod following;
pub mod joining;
mod reckoning;
pub mod recorded;
pub mod schedule;
pub mod spatial;
pub mod trilateration;
