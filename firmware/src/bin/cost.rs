//! Counts the instructions of the pendant's work, in QEMU with `-icount shift=10`; `docs/cost.md` holds the figures.
//!
//! Prints `name<TAB>instructions` per line on the semihosting console and ends the emulator.
#![no_std]
#![no_main]

use core::hint::black_box;

use cortex_m_semihosting::{debug, hprintln};
use weldpath_core::gesture::{Attitude, CameraPose, CaptureGesture, Config, Fingers, HandFrame, Steering};
use weldpath_core::path::TorchPose;
use weldpath_core::path::interpolation::Segment;
use weldpath_core::{Orientation, Point, Vector, rotation};
use weldpath_firmware::board::Stopwatch;

#[cortex_m_rt::entry]
fn main() -> ! {
    let watch = Stopwatch::start();
    set_points(&watch);
    gestures(&watch);
    debug::exit(debug::EXIT_SUCCESS);
    loop {}
}

fn print(name: &str, instructions: u32) {
    hprintln!("{}\t{}", name, instructions);
}

/// Mean over `runs` of `work`, whose result is kept from being optimised away.
fn mean<T>(watch: &Stopwatch, runs: u32, mut work: impl FnMut(u32) -> T) -> u32 {
    let total: u32 = (0..runs).map(|run| watch.instructions(|| black_box(work(black_box(run))))).sum();
    total / runs
}

fn pose(x_mm: f32, turn_rad: f32) -> TorchPose {
    let orientation = rotation::from_rotation_vector(&Vector::new(0.0, turn_rad, 3.0));
    TorchPose { position_mm: Point::new(x_mm, 20.0, 300.0), orientation }
}

fn set_points(watch: &Stopwatch) {
    let (from, to) = black_box((pose(400.0, 0.1), pose(402.0, 0.15)));
    print("segment set-up", mean(watch, 10, |_| Segment::new(&from, &to)));
    let segment = black_box(Segment::new(&from, &to));
    print("pose on a segment", mean(watch, 100, |run| segment.at(run as f32 * 0.01)));
}

fn gestures(watch: &Stopwatch) {
    let start =
        CameraPose { position_mm: Point::new(400.0, 0.0, 300.0), orientation: Orientation::identity() };
    let frame = |run: u32, palm_mm: Point| {
        let tilt = run as f32 * 0.01;
        let attitude =
            Attitude::from_direction_and_normal(&Vector::new(tilt, 0.1, -1.0), &Vector::new(0.0, -1.0, tilt));
        HandFrame::new(u64::from(run) * 9000, palm_mm, attitude?, 0.1, 0.9, Fingers::ALL)
    };
    for (name, palm_mm) in [
        ("gesture frame, home", Point::new(0.0, 200.0, 0.0)),
        ("gesture frame, right", Point::new(90.0, 200.0, 0.0)),
    ] {
        let mut steering = Steering::new(Config::default());
        let mut capture = CaptureGesture::default();
        let mut camera = start;
        let instructions = mean(watch, 100, |run| {
            let hand = frame(run, black_box(palm_mm));
            camera = steering.follow(hand.as_ref(), &camera).target;
            capture.observe(hand.as_ref(), u64::from(run) * 9000)
        });
        print(name, instructions);
        black_box(camera);
    }
}
