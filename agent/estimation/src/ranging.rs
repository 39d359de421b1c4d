//! Relative localisation from distances and odometry alone (Cornejo & Nagpal): where is a neighbour of which all that is
//! measured is how far it is?

pub mod schedule;

pub mod trilateration;
