//! Threads for the work, or the one there is where the system grants no more.

use std::io;
use std::sync::{Arc, Mutex};
use std::thread;

use rayon::ThreadPoolBuilder;

/// Threads of a link to a pendant with its emulator and keys.
const MOST_OF_A_LINK: usize = 6;

/// Whether there are threads. Where the system grants none (`ulimit -u`) the work is done by the only one, slower: the
/// pool that rayon starts by itself would panic.
pub(super) fn prepare() -> bool {
    let count = thread::available_parallelism().map_or(1, usize::from);
    let granted = granted(count.max(MOST_OF_A_LINK)).is_ok();
    if !granted {
        // It fails only where a pool is there already.
        let _ = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
    }
    granted
}

/// Whether the system lets `count` threads live at once.
fn granted(count: usize) -> io::Result<()> {
    let gate = Arc::new(Mutex::new(()));
    let closed = gate.lock();
    let mut started = Vec::with_capacity(count);
    let mut answer = Ok(());
    for _ in 0..count {
        let gate = Arc::clone(&gate);
        match thread::Builder::new().spawn(move || drop(gate.lock())) {
            Ok(thread) => started.push(thread),
            Err(error) => answer = Err(error),
        }
    }
    drop(closed);
    for thread in started {
        // It has nothing to panic about.
        let _ = thread.join();
    }
    answer
}
