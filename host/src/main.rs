//! The command `weldpath`. Each subcommand is one file in `cli/`; all they do is in the library.

mod cli;

fn main() -> std::process::ExitCode {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    keep_freed_memory();
    cli::start()
}

/// Keeps what one stage frees for the next: the system would take it back, and hand it out again page by page, which took
/// a tenth of a run.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)]
fn keep_freed_memory() {
    const FROM_BYTES: i32 = 1 << 25;
    // SAFETY: settings of the allocator, which takes any values, and no other thread runs yet.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, FROM_BYTES);
        libc::mallopt(libc::M_TRIM_THRESHOLD, i32::MAX);
    }
}
