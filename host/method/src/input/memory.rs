//! What a file may cost: memory follows what the file can hold, and never goes over a cap.
//!
//! A few bytes can claim much: an empty list, a comma, a run of zeros in a PNG. What a reader is about to make of a file
//! is held against ten times the file (and [`FREE_BYTES`], which any file may cost), and against the cap, before it is made.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

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

/// In bytes; 0 as long as nobody has set it. One for the process, as its memory is.
static MOST_BYTES: AtomicU64 = AtomicU64::new(0);

/// From now on nothing is read that would take more than this.
pub fn limit_mb(mb: u64) {
    MOST_BYTES.store(mb.max(LEAST_MB).saturating_mul(1 << 20), Ordering::Relaxed);
}

/// The cap in bytes: as set, else half of the machine's memory.
pub fn most_bytes() -> u64 {
    match MOST_BYTES.load(Ordering::Relaxed) {
        0 => machine_bytes() / 2,
        set => set,
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

/// Refuses what `count` of `what`, of `each` bytes in memory, would cost beyond what a file of `file_bytes` may.
pub(super) fn hold(
    path: &Path,
    file_bytes: usize,
    what: &'static str,
    count: u64,
    each: u64,
) -> Result<(), Error> {
    let own = (file_bytes as u64).saturating_mul(TIMES_THE_FILE).saturating_add(FREE_BYTES);
    let (needed, most) = (count.saturating_mul(each), own.min(most_bytes()));
    if needed <= most {
        return Ok(());
    }
    let why = if most == own { "ten times the file and 80 MB" } else { "the limit of --memory-mb" };
    Err(Error::TooLarge { path: path.into(), what, count, needed_mb: mb(needed), most_mb: mb(most), why })
}

/// Refuses more bytes of a file than may be kept in memory; `most` where its kind is never that large.
pub(super) fn hold_file(path: &Path, file_bytes: u64, most: u64) -> Result<(), Error> {
    let cap = most_bytes();
    let (limit, why) = if most < cap {
        (most, "the limit of a file of this kind")
    } else {
        (cap, "the limit of --memory-mb")
    };
    if file_bytes <= limit {
        return Ok(());
    }
    let (needed_mb, most_mb) = (mb(file_bytes), mb(limit));
    Err(Error::TooLarge { path: path.into(), what: "bytes", count: file_bytes, needed_mb, most_mb, why })
}

/// Refuses more points than a plan has memory for.
pub(super) fn hold_plan(path: &Path, points: usize) -> Result<(), Error> {
    let (needed, most) = ((points as u64).saturating_mul(PLAN_BYTES_A_POINT), most_bytes());
    if needed <= most {
        return Ok(());
    }
    let (count, needed_mb, most_mb) = (points as u64, mb(needed), mb(most));
    let why = "the limit of --memory-mb";
    Err(Error::TooLarge { path: path.into(), what: "points to plan with", count, needed_mb, most_mb, why })
}

fn mb(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_may_cost_grows_with_it_and_is_named_where_it_is_too_much() {
        let path = Path::new("a.png");
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
    fn the_cap_is_half_of_what_the_machine_has() {
        assert!((1 << 20..1 << 50).contains(&machine_bytes()));
        assert_eq!(most_bytes(), machine_bytes() / 2);
        assert!(hold_plan(Path::new("a"), usize::MAX / 128).is_err());
        assert!(hold_file(Path::new("a.json"), 2, 1).unwrap_err().to_string().contains("a.json"));
    }
}
