//! The targets of `cargo fuzz` by chance instead of coverage, on a stable compiler:
//! `cargo run --release --bin mutate -- TARGET SECONDS SEED`, or `... -- seeds FOLDER` to write the seeds out.
//!
//! An input that fails is kept in `artifacts/TARGET/`; memory is counted, and more than ten times the input is a fault.

use std::alloc::{GlobalAlloc, Layout, System};
use std::panic::catch_unwind;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use weldpath_fuzz::{TARGETS, seeds};

/// Counts what is allocated, to hold it against the input.
struct Counted;

static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: all is left to the system's allocator; only numbers are kept beside it.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = NOW.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(now, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

/// Memory that any input may cost, beside ten times its own size: tables, threads, a mesh's points.
const FREE_BYTES: usize = 128 << 20;

/// xorshift64*, Vigna 2016.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % end.max(1)
    }
}

/// What readers trip over: ends of ranges, and what is no number.
const WORDS: [&[u8]; 12] = [
    b"0",
    b"-1",
    b"4294967295",
    b"1e308",
    b"nan",
    b"\xff\xff\xff\xff",
    b"\x00\x00\xc0\x7f",
    b"\n",
    b"{",
    b"\"",
    b"..",
    b"/",
];

fn mutated(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(6) {
        let at = random.below(bytes.len() + 1);
        let end = (at + random.below(16)).min(bytes.len());
        match random.below(8) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..end)),
            2 => drop(bytes.splice(at..end, WORDS[random.below(WORDS.len())].iter().copied())),
            3 => {
                let again = bytes[at..end].repeat(1 + random.below(40));
                drop(bytes.splice(at..at, again));
            }
            4 => {
                let other = &seeds[random.below(seeds.len())];
                let from = random.below(other.len() + 1);
                bytes.truncate(at);
                bytes.extend(&other[from..]);
            }
            5 if at < bytes.len() => bytes[at] = b'0' + random.below(10) as u8,
            _ if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            _ => {}
        }
    }
    bytes
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["seeds", folder] => write_seeds(Path::new(folder)),
        [name, seconds, seed] => {
            match (TARGETS.iter().find(|(known, _)| *known == name), seconds.parse(), seed.parse()) {
                (Some(target), Ok(seconds), Ok(seed)) => run(*target, Duration::from_secs(seconds), seed),
                _ => usage(),
            }
        }
        _ => usage(),
    }
}

fn usage() -> ExitCode {
    let names: Vec<&str> = TARGETS.iter().map(|(name, _)| *name).collect();
    eprintln!("mutate TARGET SECONDS SEED, or mutate seeds FOLDER; targets: {}", names.join(", "));
    ExitCode::from(2)
}

fn write_seeds(folder: &Path) -> ExitCode {
    for (name, _) in TARGETS {
        let folder = folder.join(name);
        let made = std::fs::create_dir_all(&folder);
        let mut seeds = seeds::of(name).into_iter().enumerate();
        if made.is_err()
            || !seeds.all(|(i, bytes)| std::fs::write(folder.join(format!("seed-{i}")), bytes).is_ok())
        {
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

fn run((name, target): weldpath_fuzz::Target, time: Duration, seed: u64) -> ExitCode {
    // A panic is told with its input below.
    std::panic::set_hook(Box::new(|_| {}));
    let (seeds, began) = (seeds::of(name), Instant::now());
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let (mut inputs, mut faults, mut slowest) = (0_u64, 0, Duration::ZERO);
    while began.elapsed() < time {
        let bytes = mutated(&seeds, &mut random);
        MOST.store(NOW.load(Ordering::Relaxed), Ordering::Relaxed);
        let (before, start) = (NOW.load(Ordering::Relaxed), Instant::now());
        let panicked = catch_unwind(|| target(&bytes)).is_err();
        slowest = slowest.max(start.elapsed());
        let taken = MOST.load(Ordering::Relaxed).saturating_sub(before);
        inputs += 1;
        if panicked || taken > 10 * bytes.len() + FREE_BYTES {
            faults += 1;
            keep(name, &bytes, faults, if panicked { "panics" } else { "takes too much memory" });
        }
    }
    println!(
        "{name}: {inputs} inputs in {:.0} s, seed {seed}: {faults} faults; slowest {slowest:.1?}",
        time.as_secs_f64()
    );
    if faults == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// A few are enough.
const MOST_KEPT: u32 = 20;

fn keep(name: &str, bytes: &[u8], number: u32, why: &str) {
    let folder = Path::new("artifacts").join(name);
    let file = folder.join(format!("mutated-{number}"));
    if number <= MOST_KEPT
        && std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&file, bytes)).is_ok()
    {
        println!("{name}: {} {why}", file.display());
    }
}
