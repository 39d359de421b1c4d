//! Range-only localisation (Cornejo & Nagpal, section V): who moves when, how far off windows, banks and stop and move are
//! beside their bounds, whether windows find their global optimum, what flocking makes of the estimates, and what messages, bytes and time it costs.

pub mod complexity;
pub mod election;
pub mod errors;
pub mod flocking;
pub mod following;
pub mod joining;
pub mod optimum;
mod reckoning;
pub mod recorded;
pub mod schedule;
pub mod spatial;
pub mod trilateration;
