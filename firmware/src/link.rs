//! The main loop's part: bytes to frames, frames to the pendant, answers and telemetry to the line.

use static_cell::ConstStaticCell;
use weldpath_core::pendant::Action;
use weldpath_core::tasks::{Tasks, Workspace};
use weldpath_core::wire::frame::{self, Deframer};
use weldpath_core::wire::{FromPendant, MAX_FROM_HOST, MAX_PENDANT_FRAME};

use crate::{serial, torch};

static WORKSPACE: ConstStaticCell<Workspace> = ConstStaticCell::new(Workspace::empty());

/// The longest payload with its checksum.
const PAYLOAD: usize = MAX_FROM_HOST + frame::CRC_BYTES;

/// State of the line between two turns of the main loop.
pub struct Link {
    deframer: Deframer<PAYLOAD>,
    tasks: Tasks,
    workspace: &'static mut Workspace,
    lost: u32,
}

impl Link {
    /// Nothing received yet. Once.
    ///
    /// # Panics
    /// The second time.
    #[allow(clippy::new_without_default, reason = "there is one workspace")]
    pub fn new() -> Self {
        Self { deframer: Deframer::new(), tasks: Tasks::default(), workspace: WORKSPACE.take(), lost: 0 }
    }

    /// Handles what has come and sends what is due and fits.
    pub fn turn(&mut self) {
        self.count_lost();
        while let Some(byte) = serial::LINK.take_received() {
            if let Some(received) = self.deframer.push(byte) {
                if let Some(action) = torch::with(|pendant| pendant.receive(received)) {
                    perform(action, &mut self.tasks, self.workspace);
                }
            }
        }
        while serial::LINK.room() >= MAX_PENDANT_FRAME {
            let Some(message) = torch::with(|pendant| pendant.transmit()).flatten() else { break };
            send(&message);
        }
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

/// Computes outside the lock, so that the tick goes on.
fn perform(action: Action, tasks: &mut Tasks, workspace: &mut Workspace) {
    match action {
        Action::Idle => {}
        Action::Send(message) => send(&message),
        Action::Perform { request, task } => {
            let answer = tasks.perform(&task, workspace);
            if let Some(Action::Send(message)) = torch::with(|pendant| pendant.answer(request, answer)) {
                send(&message);
            }
        }
    }
}

/// What does not fit is dropped: every message may be lost, and the host asks again.
fn send(message: &FromPendant) {
    let mut out = [0; MAX_PENDANT_FRAME];
    if let Ok(length) = frame::encode(message, &mut out) {
        serial::LINK.send(out.get(..length).unwrap_or_default());
    }
}
