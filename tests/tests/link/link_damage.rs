//! Damaged frames: none is ever accepted as another message.

use weldpath_core::wire::frame::{Received, encode};
use weldpath_core::wire::{
    Chunk, Command, FromHost, HostDeframer, HostMessage, MAX_CHUNK, MAX_HOST_FRAME, MAX_PATCH, Offset,
    WirePatch,
};
use weldpath_tests::adversary::Random;
use weldpath_tests::world::winding_path;

const GOLDEN: &str = include_str!("../../golden/wire_v1.txt");

struct Sent {
    frame: Vec<u8>,
    payload: Vec<u8>,
}

impl Sent {
    fn new(message: HostMessage) -> Self {
        let mut out = [0; MAX_HOST_FRAME];
        let len = encode(&FromHost { session: 0x0BAD_CAFE, message }, &mut out).expect("fits");
        let frame = out[..len].to_vec();
        let payload = payloads(&frame).remove(0);
        Self { frame, payload }
    }
}

fn payloads(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut deframer = HostDeframer::new();
    let received = bytes.iter().filter_map(|&byte| match deframer.push(byte) {
        Some(Received::Payload(payload)) => Some(payload.to_vec()),
        _ => None,
    });
    received.collect()
}

/// How many payloads other than the one sent come out of these bytes.
fn altered(bytes: &[u8], payload: &[u8]) -> u64 {
    let mut deframer = HostDeframer::new();
    let mut count = 0;
    for &byte in bytes.iter().chain(&[0]) {
        if let Some(Received::Payload(received)) = deframer.push(byte) {
            count += u64::from(received != payload);
        }
    }
    count
}

fn chunk(random: &mut Random, len: usize) -> Sent {
    let path = winding_path(random, len as u32);
    let waypoints = heapless::Vec::from_slice(&path).expect("a chunk");
    Sent::new(HostMessage::Chunk(Chunk { path: 1, first: 0, waypoints }))
}

fn largest_score() -> Sent {
    let mut random = Random::new(4);
    let points =
        (0..MAX_PATCH).map(|_| Offset { um: [0; 3].map(|_: i16| random.below(8_000) as i16 - 4_000) });
    let patch = WirePatch { radius_um: 4_800, threshold_milli: 60_000, points: points.collect() };
    Sent::new(HostMessage::Control { request: 7, command: Command::Score(patch) })
}

/// Every golden frame of both directions and a full chunk.
fn every_message() -> Vec<Sent> {
    let bytes = |text: &str| -> Vec<u8> {
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).expect("hex")).collect()
    };
    let golden = GOLDEN.lines().map(|line| {
        let words: Vec<&str> = line.split(' ').collect();
        Sent { frame: bytes(words[2]), payload: bytes(words[1]) }
    });
    golden.chain([chunk(&mut Random::new(3), MAX_CHUNK)]).collect()
}

/// Flips each `stride`-th bit, alone and with every later one; how many pairs, and how many were accepted altered.
fn flip(sent: &Sent, stride: usize) -> (u64, u64) {
    let bits = sent.frame.len() * 8;
    let mut bytes = sent.frame.clone();
    let (mut flips, mut accepted) = (0, 0);
    for first in (0..bits).step_by(stride) {
        bytes[first / 8] ^= 1 << (first % 8);
        accepted += altered(&bytes, &sent.payload);
        for second in first + 1..bits {
            bytes[second / 8] ^= 1 << (second % 8);
            accepted += altered(&bytes, &sent.payload);
            bytes[second / 8] ^= 1 << (second % 8);
        }
        flips += (bits - first) as u64;
        bytes[first / 8] ^= 1 << (first % 8);
    }
    (flips, accepted)
}

#[test]
fn no_flip_of_one_or_two_bits_of_any_message_is_accepted() {
    // The largest patch has five million pairs: every seventh first bit, hence all of them over the bytes' bits.
    let patch = flip(&largest_score(), 7);
    let all = every_message()
        .iter()
        .map(|sent| flip(sent, 1))
        .fold(patch, |sum, one| (sum.0 + one.0, sum.1 + one.1));
    println!("{} flips of one and two bits, {} accepted altered", all.0, all.1);
    assert_eq!(all.1, 0);
}

#[test]
fn none_of_a_million_bursts_of_up_to_32_bits_is_accepted() {
    let mut random = Random::new(11);
    let chunks: Vec<Sent> = (0..64).map(|_| chunk(&mut random, 4)).collect();
    let mut accepted = 0;
    for _ in 0..1_000_000 {
        let sent = &chunks[random.below(64) as usize];
        let mut bytes = sent.frame.clone();
        let len = 1 + random.below(32) as usize;
        let start = random.below((bytes.len() * 8 - len) as u64) as usize;
        let pattern = random.bits() | 1 | 1 << (len - 1);
        for bit in (0..len).filter(|bit| pattern >> bit & 1 == 1) {
            bytes[(start + bit) / 8] ^= 1 << ((start + bit) % 8);
        }
        accepted += altered(&bytes, &sent.payload);
    }
    println!("1000000 bursts, {accepted} accepted altered");
    assert_eq!(accepted, 0);
}

#[test]
fn none_of_ten_million_random_damages_is_accepted() {
    let mut random = Random::new(12);
    let chunks: Vec<Sent> = (0..64).map(|_| chunk(&mut random, 4)).collect();
    let mut bytes = Vec::with_capacity(512);
    let mut accepted = 0;
    for _ in 0..10_000_000_u32 {
        let sent = &chunks[random.below(64) as usize];
        bytes.clear();
        bytes.extend_from_slice(&sent.frame);
        damage(&mut bytes, &mut random);
        accepted += altered(&bytes, &sent.payload);
    }
    println!("10000000 damages, {accepted} accepted altered");
    assert_eq!(accepted, 0);
}

/// Some wrong bytes, a run of noise, a missing, an added or a swapped byte, a cut.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len() as u64 - 1) as usize;
    match random.below(6) {
        0 => {
            for _ in 0..=random.below(8) {
                let at = random.below(bytes.len() as u64) as usize;
                bytes[at] = random.bits() as u8;
            }
        }
        1 => bytes.iter_mut().skip(at).take(16).for_each(|byte| *byte = random.bits() as u8),
        2 => drop(bytes.remove(at)),
        3 => bytes.insert(at, random.bits() as u8),
        4 => bytes.swap(at, at + 1),
        _ => bytes.truncate(at),
    }
}
