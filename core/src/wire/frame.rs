//! Framing: 0x00, COBS of (postcard message, CRC-32 little-endian), 0x00.
//!
//! The leading delimiter keeps a damaged delimiter from swallowing the next frame. CRC-32/ISO-HDLC: measured on
//! a million damaged chunks, CRC-16 let eight altered waypoints through and CRC-32 none.
//! A message is serialised in place, then checksummed and stuffed in runs: byte by byte through a state machine cost
//! the tick of a robot port twice the instructions. Written so that the optimiser sees that no access can panic.

use crc::{CRC_32_ISO_HDLC, Crc};
use serde::{Deserialize, Serialize};

/// The checksum of frames, of the path digest and of the schema.
pub const CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
/// Its table, 1 kB.
static TABLE: [u32; 256] = CRC32.table()[0];

/// Bytes of the checksum at the end of a payload.
pub const CRC_BYTES: usize = 4;

/// [`CRC32`] of the parts, one behind the other.
pub(super) fn checksum(parts: &[&[u8]]) -> u32 {
    !parts.iter().fold(!0, |crc, bytes| divided(crc, bytes))
}

/// The remainder goes on over more bytes: by words, four look-ups each, for the crate's byte-wise loop takes half as long
/// again.
#[inline(never)]
fn divided(crc: u32, bytes: &[u8]) -> u32 {
    let shifted = |crc: u32| TABLE[usize::from(crc as u8)] ^ (crc >> 8);
    let (words, rest) = bytes.as_chunks::<4>();
    let crc = words.iter().fold(crc, |crc, word| {
        let crc = crc ^ u32::from_le_bytes(*word);
        shifted(shifted(shifted(shifted(crc))))
    });
    rest.iter().fold(crc, |crc, &byte| shifted(crc ^ u32::from(byte)))
}

/// Encoded size of `payload` bytes at most: CRC, COBS overhead and both delimiters.
pub const fn encoded_bytes(payload: usize) -> usize {
    stuffed_bytes(payload) + 2
}

/// The same between the delimiters.
pub const fn stuffed_bytes(payload: usize) -> usize {
    let checked = payload + CRC_BYTES;
    checked + checked / FULL_RUN as usize + 1
}

/// The output buffer is too short for the message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Full;

/// Where the first COBS code byte stands: behind the leading delimiter.
const FIRST_CODE: usize = 1;
/// Where the message is serialised: each of its bytes then is where stuffing wants it, but for full runs before it.
const MESSAGE: usize = FIRST_CODE + 1;
/// Longest run of COBS without a zero; it has no zero behind it.
const FULL_RUN: u8 = 254;
/// Code of a [`FULL_RUN`].
const FULL_CODE: u8 = 255;

/// Writes one frame, delimiters included, to the start of `out` and returns its length.
pub fn encode<M: Serialize>(message: &M, out: &mut [u8]) -> Result<usize, Full> {
    let space = out.get_mut(MESSAGE..).ok_or(Full)?;
    let size = space.len();
    let rest = postcard::serialize_with_flavor(message, Message { rest: space.iter_mut() });
    let length = size.checked_sub(rest.map_err(|_| Full)?).ok_or(Full)?;
    close(out, length).ok_or(Full)
}

/// Writes the frame of a payload of whole words that is too short for a full run, so that each such frame has the same
/// length: `FRAME` is [`encoded_bytes`] of `4 * WORDS`.
#[inline]
pub(super) fn enclose<const WORDS: usize, const FRAME: usize>(words: [u32; WORDS], out: &mut [u8; FRAME]) {
    const { assert!(FRAME == encoded_bytes(4 * WORDS) && FRAME < FULL_RUN as usize) };
    for (to, word) in out[MESSAGE..].as_chunks_mut::<4>().0.iter_mut().zip(words) {
        *to = word.to_le_bytes();
    }
    // It fits.
    let _ = close(out, 4 * WORDS);
}

/// A postcard flavour: bytes one behind the other. Its output is how many more would fit.
struct Message<'a> {
    rest: core::slice::IterMut<'a, u8>,
}

impl postcard::ser_flavors::Flavor for Message<'_> {
    type Output = usize;

    #[inline(always)]
    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        *self.rest.next().ok_or(postcard::Error::SerializeBufferFull)? = byte;
        Ok(())
    }

    fn finalize(self) -> postcard::Result<usize> {
        Ok(self.rest.len())
    }
}

/// Makes a frame of the message of `length` bytes that stands at [`MESSAGE`].
#[inline(never)]
fn close(out: &mut [u8], length: usize) -> Option<usize> {
    let (message, behind) = out.get_mut(MESSAGE..)?.split_at_mut_checked(length)?;
    *behind.first_chunk_mut::<CRC_BYTES>()? = checksum(&[message]).to_le_bytes();
    stuff(out, length.checked_add(MESSAGE + CRC_BYTES)?)
}

/// COBS in place of what stands from [`MESSAGE`] to `end`, and the delimiters around it: each zero becomes the code byte
/// of the run behind it. Backwards, which needs no more than a count, where no run can be full.
fn stuff(out: &mut [u8], end: usize) -> Option<usize> {
    let block = out.get_mut(MESSAGE..end)?;
    if block.len() >= usize::from(FULL_RUN) {
        return stuff_long(out, end);
    }
    let count = |code: u8, byte: &mut u8| {
        let run = if *byte == 0 { core::mem::replace(byte, code) } else { code };
        run.wrapping_add(1)
    };
    // By words: most have no zero.
    let (rest, words) = block.as_rchunks_mut::<4>();
    let code = words.iter_mut().rev().fold(1_u8, |code, word| match has_zero(*word) {
        true => word.iter_mut().rev().fold(code, count),
        false => code.wrapping_add(4),
    });
    let code = rest.iter_mut().rev().fold(code, count);
    *out.first_mut()? = 0;
    *out.get_mut(FIRST_CODE)? = code;
    *out.get_mut(end)? = 0;
    end.checked_add(1)
}

/// Whether one of the bytes is zero: the lowest zero borrows from its top bit.
fn has_zero(word: [u8; 4]) -> bool {
    let word = u32::from_ne_bytes(word);
    word.wrapping_sub(0x0101_0101) & !word & 0x8080_8080 != 0
}

/// The same for any length, forwards: a run of 254 bytes has a code byte put in behind it.
fn stuff_long(out: &mut [u8], mut end: usize) -> Option<usize> {
    *out.first_mut()? = 0;
    let mut code_at = FIRST_CODE;
    loop {
        let ahead = out.get(code_at.checked_add(1)?..end)?;
        let run = ahead.get(..usize::from(FULL_RUN)).unwrap_or(ahead);
        let next = match run.iter().position(|&byte| byte == 0) {
            Some(zero) => zero,
            None if run.len() < usize::from(FULL_RUN) => break,
            None => {
                insert(out, code_at.checked_add(usize::from(FULL_CODE))?, end)?;
                end = end.checked_add(1)?;
                usize::from(FULL_RUN)
            }
        };
        *out.get_mut(code_at)? = next as u8 + 1;
        code_at = code_at.checked_add(next)?.checked_add(1)?;
    }
    *out.get_mut(code_at)? = end.checked_sub(code_at)? as u8;
    *out.get_mut(end)? = 0;
    end.checked_add(1)
}

/// Moves what stands from `at` to `end` one place on.
fn insert(out: &mut [u8], at: usize, end: usize) -> Option<()> {
    let mut moved = 0;
    for byte in out.get_mut(at..=end)? {
        core::mem::swap(byte, &mut moved);
    }
    Some(())
}

/// Why a run of bytes between two delimiters was no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Damage {
    /// Not COBS, or shorter than a checksum.
    Framing,
    /// The checksum does not match.
    Crc,
    /// Longer than any message.
    Oversize,
}

/// What a delimiter completed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received<'a> {
    /// A payload whose checksum matched, the checksum removed: to be decoded with [`decode`].
    Payload(&'a [u8]),
    /// Bytes that were no frame. Counted by the receiver, else ignored.
    Damaged(Damage),
}

/// Collects bytes into frames. `N`: the longest run between two delimiters, [`stuffed_bytes`] of the longest payload.
#[derive(Debug)]
pub struct Deframer<const N: usize> {
    stuffed: [u8; N],
    length: usize,
    overlong: bool,
    /// What was collected has been given out.
    done: bool,
}

impl<const N: usize> Default for Deframer<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Deframer<N> {
    /// Empty.
    pub const fn new() -> Self {
        Self { stuffed: [0; N], length: 0, overlong: false, done: false }
    }

    /// Takes the next byte of the stream; a delimiter may complete a frame.
    pub fn push(&mut self, byte: u8) -> Option<Received<'_>> {
        self.feed(&[byte]).0
    }

    /// Takes bytes of the stream up to the next delimiter that ends something, and gives back those behind it.
    pub fn feed<'b>(&mut self, stream: &'b [u8]) -> (Option<Received<'_>>, &'b [u8]) {
        if core::mem::take(&mut self.done) {
            self.length = 0;
            self.overlong = false;
        }
        let mut ahead = stream;
        if let (0, [0, rest @ ..]) = (self.length, ahead) {
            // Most frames: the delimiter before them ends nothing.
            ahead = rest;
        }
        while !ahead.is_empty() {
            let free = self.stuffed.get_mut(self.length..).unwrap_or_default();
            let run = copy_run(ahead, free);
            self.length = self.length.saturating_add(run.taken);
            self.overlong |= run.overlong;
            ahead = run.rest;
            if run.ended && (self.overlong || self.length > 0) {
                self.done = true;
                return (Some(self.received()), ahead);
            }
        }
        (None, &[])
    }

    fn received(&mut self) -> Received<'_> {
        match self.stuffed.get_mut(..self.length) {
            Some(stuffed) if !self.overlong => checked(stuffed),
            _ => Received::Damaged(Damage::Oversize),
        }
    }
}

/// What came before a zero.
struct CopiedRun<'b> {
    taken: usize,
    overlong: bool,
    /// Whether there was a zero.
    ended: bool,
    rest: &'b [u8],
}

/// Copies the bytes before the first zero, as many as fit.
#[inline(never)]
fn copy_run<'b>(stream: &'b [u8], to: &mut [u8]) -> CopiedRun<'b> {
    // By words, most of which have no zero.
    let words = to.as_chunks_mut::<4>().0.iter_mut().zip(stream.as_chunks::<4>().0);
    let whole = words.take_while(|(_, word)| !has_zero(**word)).map(|(place, word)| *place = *word).count();
    let whole = whole.saturating_mul(4);
    let (to, ahead) = (to.get_mut(whole..).unwrap_or_default(), stream.get(whole..).unwrap_or_default());
    let run = to.iter_mut().zip(ahead).take_while(|(_, byte)| **byte != 0);
    let taken = run.map(|(place, byte)| *place = *byte).count().saturating_add(whole);
    let behind = stream.get(taken..).unwrap_or_default();
    let overlong = behind.first().is_some_and(|&byte| byte != 0);
    let mut ahead = behind.iter();
    let ended = ahead.any(|&byte| byte == 0);
    CopiedRun { taken, overlong, ended, rest: ahead.as_slice() }
}

/// What stood between two delimiters: nothing but COBS of a payload and its checksum counts.
#[inline(never)]
fn checked(stuffed: &mut [u8]) -> Received<'_> {
    let Some((payload, crc)) = unstuff(stuffed).and_then(|bytes| bytes.split_last_chunk::<CRC_BYTES>())
    else {
        return Received::Damaged(Damage::Framing);
    };
    if checksum(&[payload]) == u32::from_le_bytes(*crc) {
        Received::Payload(payload)
    } else {
        Received::Damaged(Damage::Crc)
    }
}

/// COBS undone in place, as [`stuff`] did it: code bytes become the zeros that they stand for, and those behind full runs
/// are taken out. `None` if a run does not end where the bytes do.
fn unstuff(stuffed: &mut [u8]) -> Option<&[u8]> {
    let mut end = stuffed.len();
    let mut code = *stuffed.first()?;
    let mut run = 1_usize;
    loop {
        let behind = run.checked_add(usize::from(code))?.checked_sub(1)?;
        if behind >= end {
            return if behind == end { stuffed.get(1..end) } else { None };
        }
        let place = stuffed.get_mut(behind)?;
        let next = core::mem::take(place);
        run = behind;
        if code == FULL_CODE {
            remove(stuffed, behind, end)?;
            end = end.checked_sub(1)?;
        } else {
            run = run.checked_add(1)?;
        }
        code = next;
    }
}

/// Moves what stands behind `at` one place back.
fn remove(bytes: &mut [u8], at: usize, end: usize) -> Option<()> {
    let mut moved = 0;
    for byte in bytes.get_mut(at..end)?.iter_mut().rev() {
        core::mem::swap(byte, &mut moved);
    }
    Some(())
}

/// A payload with a right checksum that is no message of this version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unreadable {
    /// Unknown tag, a list longer than its capacity, a number out of range, or too few bytes.
    Malformed,
    /// Bytes are left over behind the message.
    Trailing,
    /// Longer than any message of this version.
    Oversize,
}

/// Decodes one message; every byte has to belong to it.
pub fn decode<'a, M: Deserialize<'a>>(payload: &'a [u8]) -> Result<M, Unreadable> {
    match postcard::take_from_bytes(payload) {
        Ok((message, [])) => Ok(message),
        Ok(_) => Err(Unreadable::Trailing),
        Err(_) => Err(Unreadable::Malformed),
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    fn frames(stream: &[u8]) -> std::vec::Vec<Result<std::vec::Vec<u8>, Damage>> {
        let mut deframer = Deframer::<600>::new();
        let mut seen = std::vec::Vec::new();
        for &byte in stream {
            match deframer.push(byte) {
                Some(Received::Payload(payload)) => seen.push(Ok(payload.to_vec())),
                Some(Received::Damaged(damage)) => seen.push(Err(damage)),
                None => {}
            }
        }
        seen
    }

    fn framed(payload: &[u8]) -> std::vec::Vec<u8> {
        let mut out = [0; 700];
        // A tuple of bytes has no length prefix: serialise the slice byte by byte.
        struct Raw<'a>(&'a [u8]);
        impl Serialize for Raw<'_> {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                use serde::ser::SerializeTuple;
                let mut tuple = serializer.serialize_tuple(self.0.len())?;
                self.0.iter().try_for_each(|byte| tuple.serialize_element(byte))?;
                tuple.end()
            }
        }
        let len = encode(&Raw(payload), &mut out).expect("fits");
        assert!(len <= encoded_bytes(payload.len()));
        out[..len].to_vec()
    }

    #[test]
    fn payloads_of_every_length_round_trip() {
        for len in 0..590 {
            for fill in [|_| 0u8, |_| 1, |i| i as u8, |i| (i % 254 + 1) as u8] {
                let payload: std::vec::Vec<u8> = (0..len).map(fill).collect();
                let frame = framed(&payload);
                assert_eq!(frame.iter().filter(|&&b| b == 0).count(), 2);
                assert_eq!(frames(&frame), [Ok(payload)]);
            }
        }
    }

    #[test]
    fn the_cobs_and_crc_crates_read_these_frames_and_are_read() {
        for len in 0..590 {
            for zeros in [1, 3, 100, 253, 254, 255, 256, 1000] {
                let payload: std::vec::Vec<u8> = (1..=len).map(|i| (i % zeros) as u8).collect();
                let mut checked = payload.clone();
                checked.extend(CRC32.checksum(&payload).to_le_bytes());
                let (frame, mut block) = (framed(&payload), [0; 700]);
                let read = cobs::decode(&frame[1..], &mut block).expect("COBS").frame_size();
                assert_eq!(block[..read], checked, "{len} bytes, a zero every {zeros}");
                let written = cobs::encode(&checked, &mut block);
                block[written] = 0;
                assert_eq!(frames(&block[..=written]), [Ok(payload)], "{len} bytes, a zero every {zeros}");
            }
        }
    }

    #[test]
    fn a_checksum_of_parts_is_that_of_the_whole() {
        let bytes: std::vec::Vec<u8> = (0..=255).collect();
        for at in 0..40 {
            assert_eq!(checksum(&[&bytes[..at], &bytes[at..]]), CRC32.checksum(&bytes));
        }
    }

    #[test]
    fn an_independent_cobs_decoder_reads_the_frame() {
        let payload: std::vec::Vec<u8> = (0..=255).chain(0..100).collect();
        let mut frame = framed(&payload);
        let block = &mut frame[1..];
        let len = postcard_cobs_len(block);
        assert_eq!(&block[..len - CRC_BYTES], &payload);
    }

    /// COBS as its paper defines it, over a slice: in place, returns the decoded length.
    fn postcard_cobs_len(block: &mut [u8]) -> usize {
        let (mut read, mut write) = (0, 0);
        while block[read] != 0 {
            let code = block[read] as usize;
            read += 1;
            for _ in 1..code {
                block[write] = block[read];
                read += 1;
                write += 1;
            }
            if code != 0xFF && block[read] != 0 {
                block[write] = 0;
                write += 1;
            }
        }
        write
    }

    #[test]
    fn a_damaged_delimiter_costs_one_frame_only() {
        let mut stream = framed(b"first");
        let end = stream.len() - 1;
        stream[end] ^= 0x10;
        stream.extend(framed(b"second"));
        let seen = frames(&stream);
        assert_eq!(seen.last(), Some(&Ok(b"second".to_vec())));
        assert!(seen[..seen.len() - 1].iter().all(Result::is_err));
    }

    #[test]
    fn an_overlong_run_is_reported_and_the_next_frame_read() {
        let mut stream = std::vec![7u8; 5000];
        stream.extend(framed(b"after"));
        assert_eq!(frames(&stream), [Err(Damage::Oversize), Ok(b"after".to_vec())]);
    }

    #[test]
    fn a_buffer_that_is_too_short_is_an_error() {
        let need = framed(b"payload").len();
        for len in 0..need {
            let mut out = std::vec![0; len];
            assert_eq!(encode(b"payload", &mut out), Err(Full));
        }
    }
}
