//! Range-only localisation (Cornejo & Nagpal, section V): who moves when, what stop and move gives, what flocking makes of
//! the estimates, and what messages, bytes and time it costs.

pub mod complexity;
pub mod election;
pub mod flocking;
pub mod recorded;
pub mod schedule;
pub mod trilateration;
