//! Signals that end a program wait while files are being written.
//!
//! Only where the program has asked for it ([`arm`]): a library changes no signal of the program that uses it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::{flag, low_level};

/// Signals by which people and systems end a program; nothing holds SIGKILL off.
const ENDING: [i32; 2] = [SIGINT, SIGTERM];

struct Armed {
    /// Whether a signal ends the program at once, as it does by default.
    ends_at_once: Arc<AtomicBool>,
    came: [Arc<AtomicBool>; ENDING.len()],
}

static ARMED: OnceLock<Armed> = OnceLock::new();

/// From now on [`hold`] holds signals off.
///
/// # Errors
/// If the system takes no handlers; all stays as it was then.
pub fn arm() -> std::io::Result<()> {
    if ARMED.get().is_some() {
        return Ok(());
    }
    let armed = Armed { ends_at_once: Arc::new(AtomicBool::new(true)), came: Default::default() };
    for (signal, came) in ENDING.into_iter().zip(&armed.came) {
        flag::register_conditional_default(signal, Arc::clone(&armed.ends_at_once))?;
        flag::register(signal, Arc::clone(came))?;
    }
    // Another thread may have been faster; its handlers do the same.
    let _ = ARMED.set(armed);
    Ok(())
}

/// As long as it lives signals only ask; the program ends by them when it is dropped.
#[derive(Debug)]
pub struct Held(());

/// Holds signals off, if the program is [`arm`]ed.
pub fn hold() -> Held {
    if let Some(armed) = ARMED.get() {
        armed.ends_at_once.store(false, Ordering::SeqCst);
    }
    Held(())
}

impl Held {
    /// Whether a signal came.
    pub fn asked(&self) -> bool {
        ARMED.get().is_some_and(|armed| armed.came.iter().any(|came| came.load(Ordering::SeqCst)))
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let Some(armed) = ARMED.get() else { return };
        armed.ends_at_once.store(true, Ordering::SeqCst);
        for (signal, came) in ENDING.into_iter().zip(&armed.came) {
            if came.load(Ordering::SeqCst) {
                // Where that fails the program goes on to tell what was interrupted, and ends all the same.
                let _ = low_level::emulate_default_handler(signal);
            }
        }
    }
}
