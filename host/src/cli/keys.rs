//! Single keys from standard input: a terminal gives them at once and unseen, a pipe byte by byte.

use std::io::{IsTerminal, Read, stdin};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use rustix::termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcsetattr};
use weldpath::files::interrupt::{self, Held};

/// Ctrl-C, which a terminal hands over like any key while [`Keys`] lives.
pub(super) const CTRL_C: u8 = 3;

/// Keys as they are pressed; dropping it gives the terminal back as it was. A signal that is to end the program is a Ctrl-C
/// while it lives: whoever reads the keys ends in order.
pub(super) struct Keys {
    signals: Option<Held>,
    pressed: Receiver<u8>,
    before: Option<Termios>,
    ended: bool,
}

impl Keys {
    pub(super) fn new() -> Self {
        let (press, pressed) = channel();
        thread::spawn(move || {
            stdin().lock().bytes().map_while(Result::ok).try_for_each(|key| press.send(key))
        });
        Self { signals: Some(interrupt::hold()), pressed, before: unseen(), ended: false }
    }

    /// Whether somebody sits there.
    pub(super) fn is_terminal(&self) -> bool {
        self.before.is_some()
    }

    /// Whether no key will ever come.
    pub(super) fn have_ended(&self) -> bool {
        self.ended
    }

    /// The next key, if one was pressed.
    pub(super) fn next(&mut self) -> Option<u8> {
        if let Some(signals) = self.signals.take_if(|signals| signals.asked()) {
            // It would end the program as it goes.
            std::mem::forget(signals);
            return Some(CTRL_C);
        }
        match self.pressed.try_recv() {
            Ok(key) => Some(key),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                self.ended = true;
                None
            }
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            // The terminal may have gone.
            let _ = tcsetattr(stdin(), OptionalActions::Now, before);
        }
    }
}

/// Keys without echo, at once, Ctrl-C among them; what the terminal was set to before.
fn unseen() -> Option<Termios> {
    let before = stdin().is_terminal().then(|| tcgetattr(stdin()).ok()).flatten()?;
    let mut keys = before.clone();
    keys.local_modes -= LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG;
    tcsetattr(stdin(), OptionalActions::Now, &keys).ok()?;
    Some(before)
}
