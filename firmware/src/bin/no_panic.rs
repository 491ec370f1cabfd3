//! Proof that core cannot panic: this links only if the optimiser has removed every panic from what it calls.
//!
//! The panic handler calls a function that does not exist. Everything that the pendant runs of core is called with
//! arguments that the compiler cannot know. With feature `negative-control` one panic is left, and it must not link.
#![no_std]
#![no_main]
#![allow(unsafe_code)]

use core::hint::black_box;
use core::panic::PanicInfo;

use weldpath_core::gesture::{Attitude, Fingers, HandFrame};
use weldpath_core::interlock::channels::{Pump, PumpModel, TwoChannel};
use weldpath_core::path::TorchPose;
use weldpath_core::path::interpolation::densify;
use weldpath_core::pendant::{Action, Panel, Pendant, Slot, Task};
use weldpath_core::seam::Patch;
use weldpath_core::tasks::{Tasks, Workspace};
use weldpath_core::wire::port::ActualDeframer;
use weldpath_core::wire::{Answer, FromPendant, HostDeframer, MAX_PENDANT_FRAME, frame};
use weldpath_core::{Orientation, Point, Vector, math, rotation};

type Lent = Pendant<512, &'static mut [Slot]>;

/// An argument that the compiler cannot know: the linker never sees who makes it.
fn any<T>() -> T {
    unsafe extern "C" {
        static ANYTHING: [u64; 1024];
    }
    // SAFETY: this program is linked and never run.
    unsafe { black_box(&raw const ANYTHING).cast::<T>().read_volatile() }
}

#[unsafe(no_mangle)]
static ANYTHING: [u64; 1024] = [0; 1024];

#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [u32; 32] = [0; 32];

#[cortex_m_rt::entry]
fn main() -> ! {
    maths();
    paths();
    gestures();
    tasks(any(), any(), any());
    link(any(), any(), any());
    #[cfg(feature = "negative-control")]
    black_box(any::<&[u32]>()[any::<usize>()]);
    loop {
        cortex_m::asm::wfi();
    }
}

#[inline(never)]
fn maths() {
    let x: f32 = any();
    black_box((math::sqrt(x), math::acos(x), math::atan2(x, any()), math::exp_of_negative(x)));
    black_box((math::sin_cos(x), math::sin_cos_coarse(x), math::direction(&any(), x)));
    let (q, v): (Orientation, Vector) = any();
    black_box(rotation::from_rotation_vector(&v));
    black_box((rotation::from_basis(&v, &any(), &any()), rotation::unit(x, any(), any(), any())));
    black_box(rotation::Arc::between(&q, &any()).slerp(x));
}

#[inline(never)]
fn paths() {
    let poses: &[TorchPose] = any();
    densify(poses, any()).for_each(|pose| {
        black_box(pose);
    });
}

#[inline(never)]
fn gestures() {
    let attitude = Attitude::from_roll_pitch_yaw(any());
    let frame = attitude.and_then(|attitude| {
        HandFrame::new(
            any(),
            Point::new(any(), any(), any()),
            attitude,
            any(),
            any(),
            Fingers::from_bits(any()),
        )
    });
    black_box(frame);
}

#[inline(never)]
fn tasks(tasks: &mut Tasks, task: &Task, workspace: &mut Workspace) {
    black_box(tasks.perform(task, workspace));
    black_box(any::<&Patch<64, 32>>().len());
}

#[inline(never)]
fn link(pendant: &mut Lent, deframer: &mut HostDeframer, panel: &Panel) {
    if let (Some(received), _) = deframer.feed(any()) {
        match pendant.receive(received) {
            Action::Send(message) => send(&message),
            other => {
                let _ = black_box(other);
            }
        }
    }
    if let Some(told) = black_box(pendant.tick(panel)).robot {
        told.write(black_box(any()));
    }
    let _ = black_box(pendant.answer(any(), any::<Answer>()));
    if let Some(message) = pendant.transmit() {
        send(&message);
    }
    pendant.overrun(any());
    if let (Some(received), _) = any::<&mut ActualDeframer>().feed(any()) {
        pendant.receive_robot(received);
    }
    let contacts: (&mut TwoChannel, &mut Pump, &mut PumpModel) = any();
    black_box((contacts.0.tick(any()), contacts.1.tick(any()), contacts.1.reads_wrong(any(), any())));
    black_box(contacts.2.tick(any()));
}

#[inline(never)]
fn send(message: &FromPendant) {
    let mut out = [0; MAX_PENDANT_FRAME];
    let _ = black_box(frame::encode(message, &mut out));
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    unsafe extern "C" {
        fn core_can_panic() -> !;
    }
    // SAFETY: it does not exist; the linker says so if this is reachable.
    unsafe { core_can_panic() }
}
