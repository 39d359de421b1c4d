//! Whether an estimate is as good as it can be and as good as it says: error over the bound of a batch, and NEES.

pub mod history;
