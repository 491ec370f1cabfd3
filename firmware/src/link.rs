//! The main loop's part: bytes to frames, frames to the pendant, answers and telemetry to the line.

use static_cell::ConstStaticCell;
use weldpath_core::pendant::{Action, Task};
use weldpath_core::tasks::{Tasks, Workspace};
use weldpath_core::wire::frame::{self, Received};
use weldpath_core::wire::{FromPendant, HostDeframer, MAX_PENDANT_FRAME};

use crate::{serial, torch};

static WORKSPACE: ConstStaticCell<Workspace> = ConstStaticCell::new(Workspace::empty());
static DEFRAMER: ConstStaticCell<HostDeframer> = ConstStaticCell::new(HostDeframer::new());

/// Bytes taken from the line at once: interrupts wait so long.
const TAKEN: usize = 32;

/// State of the line between two turns of the main loop.
pub struct Link {
    deframer: &'static mut HostDeframer,
    tasks: Tasks,
    workspace: &'static mut Workspace,
    lost: u32,
}

impl Link {
    /// Nothing received yet. Once.
    ///
    /// # Panics
    /// The second time.
    #[allow(clippy::new_without_default, reason = "there is one")]
    pub fn new() -> Self {
        Self { deframer: DEFRAMER.take(), tasks: Tasks::default(), workspace: WORKSPACE.take(), lost: 0 }
    }

    /// Handles what has come and sends what is due and fits.
    pub fn turn(&mut self) {
        self.count_lost();
        let mut taken = [0; TAKEN];
        loop {
            let mut rest = serial::LINK.take(&mut taken);
            if rest.is_empty() {
                break;
            }
            while !rest.is_empty() {
                let received;
                (received, rest) = self.deframer.feed(rest);
                if let Some(received) = received {
                    handle(received, &mut self.tasks, self.workspace);
                }
            }
        }
        while serial::LINK.room() >= MAX_PENDANT_FRAME && report() {}
    }

    fn count_lost(&mut self) {
        let lost = serial::LINK.lost();
        let more = lost.wrapping_sub(self.lost) as u16;
        if more > 0 {
            torch::with(|pendant| pendant.overrun(more));
            self.lost = lost;
        }
    }
}

// Messages are hundreds of bytes: none of these functions may be inlined, or one frame holds the messages of all.

/// Gives a frame to the pendant and does what it asks; computes outside the lock, so that the tick goes on.
#[inline(never)]
fn handle(received: Received<'_>, tasks: &mut Tasks, workspace: &mut Workspace) {
    match torch::with(|pendant| pendant.receive(received)) {
        None | Some(Action::Idle) => {}
        Some(Action::Send(message)) => send(&message),
        Some(Action::Perform { request, task }) => perform(request, &task, tasks, workspace),
    }
}

#[inline(never)]
fn perform(request: u16, task: &Task, tasks: &mut Tasks, workspace: &mut Workspace) {
    let answer = tasks.perform(task, workspace);
    if let Some(Action::Send(message)) = torch::with(|pendant| pendant.answer(request, answer)) {
        send(&message);
    }
}

/// Sends what the pendant has to say of its own accord; false if nothing.
#[inline(never)]
fn report() -> bool {
    let message = torch::with(|pendant| pendant.transmit()).flatten();
    message.as_ref().map(send).is_some()
}

/// What does not fit is dropped: every message may be lost, and the host asks again.
#[inline(never)]
fn send(message: &FromPendant) {
    let mut out = [0; MAX_PENDANT_FRAME];
    if let Ok(length) = frame::encode(message, &mut out) {
        serial::LINK.send(out.get(..length).unwrap_or_default());
    }
}
