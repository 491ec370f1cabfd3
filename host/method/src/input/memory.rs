//! What a file may cost: memory follows what the file can hold, and never goes over a cap.
//!
//! A few bytes can claim much: an empty list, a comma, a run of zeros in a PNG. What a reader is about to make of a file
//! is held against ten times the file (and [`FREE_BYTES`], which any file may cost), and against the cap, before it is made.

use std::path::Path;

use super::Error;

/// A reader takes at most this many times the bytes of its file.
pub(crate) const TIMES_THE_FILE: u64 = 10;
/// Beside it, what any file may cost: a depth image of four megapixels that is nearly all zeros.
pub const FREE_BYTES: u64 = 80 << 20;
/// What a plan needs for a point, measured on clouds of 2 and 20 million: 65 bytes.
const PLAN_BYTES_A_POINT: u64 = 65;
/// Where the machine does not tell its memory.
const ASSUMED_BYTES: u64 = 4 << 30;
/// The least memory that can be set: below it nothing can be planned.
pub const LEAST_MB: u64 = 64;

/// What sets the limit that was exceeded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Bound {
    /// Ten times the file, and [`FREE_BYTES`].
    File,
    /// Files of this kind are never that large.
    Kind,
    /// [`Limit`].
    Memory,
}

impl Bound {
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::File => "ten times the file and 80 MB",
            Self::Kind => "the limit of a file of this kind",
            Self::Memory => "the limit of --memory-mb",
        }
    }
}

/// The most that a reading may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limit {
    bytes: u64,
}

impl Default for Limit {
    /// Half of the machine's memory.
    fn default() -> Self {
        Self { bytes: machine_bytes() / 2 }
    }
}

/// Memory of the machine, or of the container that this runs in.
fn machine_bytes() -> u64 {
    let total = || {
        let text = std::fs::read_to_string("/proc/meminfo").ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
        line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kb| kb << 10)
    };
    let group = || std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok()?.trim().parse::<u64>().ok();
    total().unwrap_or(ASSUMED_BYTES).min(group().unwrap_or(u64::MAX))
}

impl Limit {
    /// At least [`LEAST_MB`].
    pub const fn of_mb(mb: u64) -> Self {
        let mb = if mb < LEAST_MB { LEAST_MB } else { mb };
        Self { bytes: mb.saturating_mul(1 << 20) }
    }

    /// Whole megabytes.
    pub fn mb(self) -> u64 {
        self.bytes >> 20
    }

    /// Refuses what `count` of `what`, of `each` bytes in memory, would cost beyond what a file of `file_bytes` may.
    pub(super) fn hold(
        self,
        path: &Path,
        file_bytes: usize,
        what: &'static str,
        count: u64,
        each: u64,
    ) -> Result<(), Error> {
        let own = (file_bytes as u64).saturating_mul(TIMES_THE_FILE).saturating_add(FREE_BYTES);
        let bound = if own < self.bytes { Bound::File } else { Bound::Memory };
        refuse_over(own.min(self.bytes), bound, count.saturating_mul(each), path, what, count)
    }

    /// Refuses more bytes of a file than may be kept in memory.
    pub(super) fn hold_file(self, path: &Path, file_bytes: u64) -> Result<(), Error> {
        refuse_over(self.bytes, Bound::Memory, file_bytes, path, "bytes", file_bytes)
    }

    /// Refuses more points than a plan has memory for.
    pub(super) fn hold_plan(self, path: &Path, points: usize) -> Result<(), Error> {
        let needed = (points as u64).saturating_mul(PLAN_BYTES_A_POINT);
        refuse_over(self.bytes, Bound::Memory, needed, path, "points to plan with", points as u64)
    }
}

/// Refuses more bytes than a file of a kind that is never large may have.
pub(super) fn hold_kind(path: &Path, file_bytes: u64, most: u64) -> Result<(), Error> {
    refuse_over(most, Bound::Kind, file_bytes, path, "bytes", file_bytes)
}

fn refuse_over(
    most: u64,
    bound: Bound,
    needed: u64,
    path: &Path,
    what: &'static str,
    count: u64,
) -> Result<(), Error> {
    if needed <= most {
        return Ok(());
    }
    Err(Error::TooLarge { path: path.into(), what, count, needed_mb: mb(needed), most_mb: mb(most), bound })
}

fn mb(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_may_cost_grows_with_it_and_is_named_where_it_is_too_much() {
        let (path, limit) = (Path::new("a.png"), Limit::default());
        let hold = |path, bytes, what, count, each| limit.hold(path, bytes, what, count, each);
        assert!(hold(path, 0, "pixels", FREE_BYTES / 14, 14).is_ok());
        assert!(hold(path, 137_000, "pixels", 64_000_000, 14).is_err());
        assert!(hold(path, 24_000_000, "pixels", 12_000_000, 18).is_ok());
        let error = hold(path, 137_000, "pixels", 64_000_000, 14).unwrap_err().to_string();
        for part in ["a.png", "64000000 pixels", "855 MB", "82 MB", "ten times the file"] {
            assert!(error.contains(part), "{error}");
        }
        assert!(hold(path, usize::MAX, "pixels", u64::MAX, u64::MAX).is_err());
    }

    #[test]
    fn the_limit_is_half_of_what_the_machine_has_or_what_is_given() {
        assert!((1 << 20..1 << 50).contains(&machine_bytes()));
        assert_eq!(Limit::default().bytes, machine_bytes() / 2);
        let (path, small) = (Path::new("a.json"), Limit::of_mb(0));
        assert_eq!(small.mb(), LEAST_MB);
        assert!(small.hold_plan(path, (LEAST_MB << 20) as usize / 65).is_ok());
        assert!(small.hold_plan(path, (LEAST_MB << 20) as usize / 65 + 1).is_err());
        assert!(small.hold_file(path, LEAST_MB << 20).is_ok());
        assert!(small.hold_file(path, (LEAST_MB << 20) + 1).unwrap_err().to_string().contains("--memory-mb"));
        assert!(hold_kind(path, 2, 1).unwrap_err().to_string().contains("a.json"));
    }
}
