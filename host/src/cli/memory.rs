//! What becomes of freed memory between the stages of a run. The only unsafe code of the host; elsewhere than on glibc, nothing.
#![allow(unsafe_code)]

/// Keeps what one stage frees for the next: the system would take it back and hand it out again page by page, a tenth of
/// a run's time.
pub(super) fn keep_freed() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: settings of the allocator, which takes any values.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 25);
        libc::mallopt(libc::M_TRIM_THRESHOLD, i32::MAX);
    }
}

/// Gives it back after all, before stages that need little of it.
pub(super) fn give_back_freed() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: only memory that is not in use is given back.
    unsafe {
        libc::malloc_trim(0);
    }
}
