//! Work without the interpreter's lock: on threads of its own, while the caller's thread looks for Ctrl-C and tells of stages.
//!
//! The threads are new for each call, so that nothing is left of a process before a fork.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;
use weldpath::Observer;

use crate::errors::{InternalError, WeldpathError, python};

/// How often it is asked whether somebody has pressed Ctrl-C.
const ASKED_EVERY: Duration = Duration::from_millis(50);

/// Threads for each that the machine has, at most: more of them only wait for each other.
const MOST_A_CORE: usize = 2;

enum Event<T> {
    Stage(&'static str),
    Done(Result<T, Box<dyn Any + Send>>),
}

/// What the work tells, and asks.
pub(crate) struct Watch<T> {
    events: Sender<Event<T>>,
    is_done: Arc<AtomicBool>,
}

impl<T> Observer for Watch<T> {
    fn stage(&mut self, name: &'static str) {
        // The caller waits as long as this lives.
        let _ = self.events.send(Event::Stage(name));
    }
    fn is_done(&self) -> bool {
        self.is_done.load(Ordering::Relaxed)
    }
}

/// Does the work; a panic of it is an `InternalError`, and what Python raises meanwhile gives it up and is raised.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce(Watch<T>) -> T + Send,
) -> PyResult<T> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let count = threads.unwrap_or(cores).clamp(1, MOST_A_CORE * cores);
    let pool = ThreadPoolBuilder::new().num_threads(count).build().map_err(python::<WeldpathError>)?;
    let progress = progress.map(Bound::unbind);
    let (events, told) = channel();
    let is_done = Arc::new(AtomicBool::new(false));
    let watch = Watch { events: events.clone(), is_done: Arc::clone(&is_done) };
    py.detach(move || {
        pool.in_place_scope(move |scope| {
            scope.spawn(move |_| {
                let done = catch_unwind(AssertUnwindSafe(|| work(watch)));
                let _ = events.send(Event::Done(done));
            });
            let mut raised: Option<PyErr> = None;
            loop {
                let event = told.recv_timeout(ASKED_EVERY);
                let stage = match event {
                    Ok(Event::Done(Ok(done))) => return raised.map_or(Ok(done), Err),
                    Ok(Event::Done(Err(cause))) => return Err(internal(cause.as_ref())),
                    Ok(Event::Stage(name)) => Some(name),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => {
                        return Err(python::<InternalError>("the work is lost"));
                    }
                };
                if raised.is_some() {
                    continue;
                }
                raised = Python::attach(|py| {
                    py.check_signals()?;
                    match (&progress, stage) {
                        (Some(progress), Some(name)) => progress.call1(py, (name,)).map(drop),
                        _ => Ok(()),
                    }
                })
                .err();
                if raised.is_some() {
                    is_done.store(true, Ordering::Relaxed);
                }
            }
        })
    })
}

fn internal(cause: &(dyn Any + Send)) -> PyErr {
    let words = cause.downcast_ref::<String>().map(String::as_str);
    let words = words.or_else(|| cause.downcast_ref::<&str>().copied()).unwrap_or("a panic without words");
    python::<InternalError>(format!("weldpath failed, and should not have: {words}"))
}
