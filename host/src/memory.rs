//! What becomes of freed memory between the stages of a run. The only unsafe code of the host; elsewhere than on glibc, nothing.
#![allow(unsafe_code)]

/// Keeps what one stage frees for the next: the system would take it back and hand it out again page by page, a tenth of
/// a run's time.
pub(crate) fn keep_freed() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: settings of the allocator, which takes any values.
    unsafe {
        // One store for all threads: what one frees another takes.
        libc::mallopt(libc::M_ARENA_MAX, 1);
        libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 25);
        libc::mallopt(libc::M_TRIM_THRESHOLD, i32::MAX);
    }
}
