//! Long flights with every fault on, which must cost as much memory at the end as near the beginning: [`Virtual`] in
//! virtual time, [`Live`] with agents over real Zenoh. The program `skein-soak` flies them for long, `tests/tests/soak.rs`
//! for a short time.

mod live;
mod process;
mod virtual_flight;

pub use live::{Live, LiveSample};
pub use process::Footprint;
pub use virtual_flight::{Virtual, VirtualSample};
