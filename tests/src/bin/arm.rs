//! An arm model in a process of its own, at the robot port of an emulated pendant: `arm SOCKET X,Y,Z` in micrometres.
//!
//! It answers every tenth frame: QEMU hands its serial ports a byte at a time, and answers that it has no time for would wait and grow old.
//! Lines on standard input: `stop` and `follow` set its drives, `mute` and `speak` end and begin its answers. At the end of
//! the line it prints what it saw: frames, frames with the arc on, and the farthest jump of a set-point.

use std::error::Error;
use std::io::{BufRead, Read, Write, stdin};
use std::os::unix::net::UnixStream;
use std::sync::mpsc::channel;
use std::thread;

use weldpath_core::wire::WirePose;
use weldpath_core::wire::port::Drives;
use weldpath_tests::arm::{Arm, Limits};

/// Set-point frames between two answers.
const ANSWER_FRAMES: u64 = 10;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let usage = "arm SOCKET X,Y,Z";
    let mut line = UnixStream::connect(arguments.next().ok_or(usage)?)?;
    let place = arguments.next().ok_or(usage)?;
    let place: Vec<i32> = place.split(',').map(str::parse).collect::<Result<_, _>>()?;
    let position_um = place.try_into().map_err(|_| usage)?;
    let mut arm = Arm::at(&WirePose { position_um, ..WirePose::IDENTITY }, Limits::default(), 1);
    let (order, orders) = channel();
    thread::spawn(move || stdin().lock().lines().map_while(Result::ok).try_for_each(|said| order.send(said)));
    let (mut buffer, mut mute, mut answered) = ([0; 1024], false, 0);
    // An emulator that has ended with bytes unread resets the line: an end like another.
    while let Ok(count @ 1..) = line.read(&mut buffer) {
        for said in orders.try_iter() {
            match said.as_str() {
                "stop" => arm.drives = Drives::Stopped,
                "follow" => arm.drives = Drives::Following,
                "mute" => mute = true,
                "speak" => mute = false,
                _ => {}
            }
        }
        arm.take(&buffer[..count]);
        if !mute && arm.frames >= answered + ANSWER_FRAMES {
            answered = arm.frames;
            let answer = arm.answer();
            if line.write_all(&answer).is_err() {
                break;
            }
        }
    }
    println!("frames {} arc {} jump_mm {:.3}", arm.frames, arm.arc_frames, arm.farthest_jump_mm);
    Ok(())
}
