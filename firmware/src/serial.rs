//! Byte queues between interrupts and the main loop. Nothing here waits: what does not fit is dropped and counted.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use critical_section::Mutex;
use heapless::Deque;

use crate::board::{Board, Fitted};

/// The host's line: room for two full chunks each way.
pub static LINK: Port<1024, 1024> = Port::new(Fitted::wake_link);

/// The robot's line: some frames each way; what waits longer is late anyhow.
pub static ROBOT: Port<256, 256> = Port::new(Fitted::wake_robot);

/// A serial port's registers, for its interrupts alone.
pub trait Registers {
    /// The received byte, if there is one, and whether one was lost.
    fn receive(&mut self) -> (Option<u8>, bool);

    /// Whether a byte may be sent.
    fn can_send(&mut self) -> bool;

    /// Sends a byte.
    fn send(&mut self, byte: u8);

    /// Nothing waits: no more transmit interrupts until woken.
    fn rest(&mut self);
}

/// A serial port's queues.
pub struct Port<const RX: usize, const TX: usize> {
    received: Mutex<RefCell<Deque<u8, RX>>>,
    waiting: Mutex<RefCell<Deque<u8, TX>>>,
    lost: AtomicU32,
    wake: fn(),
}

impl<const RX: usize, const TX: usize> Port<RX, TX> {
    /// Empty queues; `wake` makes the transmit interrupt run.
    pub const fn new(wake: fn()) -> Self {
        Self {
            received: Mutex::new(RefCell::new(Deque::new())),
            waiting: Mutex::new(RefCell::new(Deque::new())),
            lost: AtomicU32::new(0),
            wake,
        }
    }

    /// The receive interrupt.
    pub fn receive_from(&self, mut registers: impl Registers) {
        let (byte, lost) = registers.receive();
        let push = |byte| critical_section::with(|cs| self.received.borrow_ref_mut(cs).push_back(byte));
        let full = byte.is_some_and(|byte| push(byte).is_err());
        self.lost.fetch_add(u32::from(lost) + u32::from(full), Relaxed);
    }

    /// The transmit interrupt.
    pub fn send_to(&self, mut registers: impl Registers) {
        if registers.can_send() {
            match critical_section::with(|cs| self.waiting.borrow_ref_mut(cs).pop_front()) {
                Some(byte) => registers.send(byte),
                None => registers.rest(),
            }
        }
    }

    /// Bytes lost since the start.
    pub fn lost(&self) -> u32 {
        self.lost.load(Relaxed)
    }

    /// Moves the oldest received bytes to the start of `to`, as many as are there and fit, and gives that part back.
    pub fn take<'t>(&self, to: &'t mut [u8]) -> &'t [u8] {
        let taken = critical_section::with(|cs| {
            let mut received = self.received.borrow_ref_mut(cs);
            let mut taken = 0;
            for place in &mut *to {
                let Some(byte) = received.pop_front() else { break };
                *place = byte;
                taken += 1;
            }
            taken
        });
        to.get(..taken).unwrap_or_default()
    }

    /// Bytes that [`Self::send`] would take.
    pub fn room(&self) -> usize {
        critical_section::with(|cs| {
            let waiting = self.waiting.borrow_ref(cs);
            waiting.capacity() - waiting.len()
        })
    }

    /// Queues a whole frame, or refuses it when it does not fit.
    pub fn send(&self, frame: &[u8]) -> bool {
        let fits = critical_section::with(|cs| {
            let mut waiting = self.waiting.borrow_ref_mut(cs);
            let fits = waiting.capacity() - waiting.len() >= frame.len();
            if fits {
                waiting.extend(frame.iter().copied());
            }
            fits
        });
        if fits {
            (self.wake)();
        }
        fits
    }
}
