//! Work that can be given up amid a stage, as salsa gives up a query: it unwinds from the next place that asks.
//!
//! The work runs on threads of its own, which know the flag that gives it up; so does what rayon spreads over them. Whoever
//! waits for it looks meanwhile whether it is still wanted. A program that is built to abort on panics cannot unwind: there a
//! stage goes on to its end.

use std::any::Any;
use std::cell::OnceCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use rayon::{ThreadPool, ThreadPoolBuilder};

thread_local! {
    /// Set on the threads of a [`Worker`] only.
    static GIVEN_UP: OnceCell<Arc<AtomicBool>> = const { OnceCell::new() };
}

/// What unwinds.
struct GivenUp;

/// How often it is asked whether the work is still wanted.
const ASKED_EVERY: Duration = Duration::from_millis(50);
/// As much as the first thread of a program has on most systems.
const STACK_BYTES: usize = 8 << 20;

/// Leaves the work if it is given up. Costs nanoseconds: once in each round of a loop that may take a tenth of a second.
#[inline]
pub fn go_on() {
    let given_up = GIVEN_UP.with(|flag| flag.get().is_some_and(|flag| flag.load(Ordering::Relaxed)));
    if cfg!(panic = "unwind") && given_up {
        resume_unwind(Box::new(GivenUp));
    }
}

/// What `work` makes; none if it was given up amid [`Worker::run`].
pub fn unless_given_up<T>(work: impl FnOnce() -> T) -> Option<T> {
    // What the work had half done is its own, and is dropped with it.
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(done) => Some(done),
        Err(cause) if cause.is::<GivenUp>() => None,
        Err(cause) => resume_unwind(cause),
    }
}

/// Threads that do work which may be given up.
#[derive(Debug)]
pub struct Worker {
    /// None where the system grants no thread.
    threads: Option<ThreadPool>,
    given_up: Arc<AtomicBool>,
}

impl Default for Worker {
    /// As many threads as the caller may use.
    fn default() -> Self {
        let given_up = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&given_up);
        let know = move |_| drop(GIVEN_UP.with(|own| own.set(Arc::clone(&flag))));
        let threads = ThreadPoolBuilder::new()
            .num_threads(rayon::current_num_threads())
            .stack_size(STACK_BYTES)
            .start_handler(know);
        Self { threads: threads.build().ok(), given_up }
    }
}

impl Worker {
    /// Does the work. Unwinds if it `is_done`, which is asked about twenty times a second: to be caught by
    /// [`unless_given_up`].
    pub fn run<T: Send>(&self, is_done: impl Fn() -> bool, work: impl FnOnce() -> T + Send) -> T {
        let Some(threads) = &self.threads else { return work() };
        let (send, ended) = sync_channel::<Result<T, Box<dyn Any + Send>>>(1);
        let end = threads.in_place_scope(|scope| {
            scope.spawn(|_| drop(send.send(catch_unwind(AssertUnwindSafe(work)))));
            loop {
                match ended.recv_timeout(ASKED_EVERY) {
                    Ok(end) => return Some(end),
                    Err(RecvTimeoutError::Disconnected) => return None,
                    Err(RecvTimeoutError::Timeout) if is_done() => {
                        self.given_up.store(true, Ordering::Relaxed)
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        });
        match end {
            Some(Ok(done)) => done,
            Some(Err(cause)) => resume_unwind(cause),
            None => unreachable!("the sender is dropped after it has sent"),
        }
    }
}

#[cfg(test)]
mod tests;
