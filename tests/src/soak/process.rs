//! What this process costs the system, as Linux counts it.

/// Memory, files and threads of this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Footprint {
    /// Resident memory, bytes.
    pub resident_bytes: u64,
    /// Open file descriptors.
    pub files: usize,
    /// Threads.
    pub threads: usize,
}

/// Bytes of a page of memory on every machine that this runs on.
const PAGE_BYTES: u64 = 4_096;

impl Footprint {
    /// Now. None where there is no `/proc`.
    pub fn now() -> Option<Self> {
        let pages = std::fs::read_to_string("/proc/self/statm").ok()?;
        let resident: u64 = pages.split_whitespace().nth(1)?.parse().ok()?;
        Some(Self {
            resident_bytes: resident * PAGE_BYTES,
            files: std::fs::read_dir("/proc/self/fd").ok()?.count(),
            threads: std::fs::read_dir("/proc/self/task").ok()?.count(),
        })
    }
}
