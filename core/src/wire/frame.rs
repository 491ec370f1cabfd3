//! Framing: 0x00, COBS of (postcard message, CRC-32 little-endian), 0x00.
//!
//! The leading delimiter keeps a damaged delimiter from swallowing the next frame. CRC-32/ISO-HDLC: measured on
//! a million damaged chunks, CRC-16 let eight altered waypoints through and CRC-32 none.
//! Encoding streams message, CRC and COBS in one pass; the COBS state machines are the `cobs` crate's, the
//! buffers ours, because the buffer handling of postcard's and cobs' own cannot be shown to be free of panics.

use cobs::{DecodeResult, DecoderState, EncoderState, PushResult};
use crc::{CRC_32_ISO_HDLC, Crc, Digest};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// The checksum of frames, of the path digest and of the schema.
pub const CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
static CRC: Crc<u32> = CRC32;

/// Bytes of the checksum at the end of a payload.
pub const CRC_BYTES: usize = 4;

/// Encoded size of `payload` bytes at most: CRC, COBS overhead and both delimiters.
pub const fn encoded_bytes(payload: usize) -> usize {
    let checked = payload + CRC_BYTES;
    checked + checked / 254 + 1 + 2
}

/// The output buffer is too short for the message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Full;

/// Writes one frame, delimiters included, to the start of `out` and returns its length.
pub fn encode<M: Serialize>(message: &M, out: &mut [u8]) -> Result<usize, Full> {
    let framer = Framer::new(out).ok_or(Full)?;
    postcard::serialize_with_flavor(message, framer).map_err(|_| Full)
}

/// A postcard flavour: checksums and stuffs each byte as it is serialised.
struct Framer<'a> {
    out: &'a mut [u8],
    len: usize,
    cobs: EncoderState,
    digest: Digest<'static, u32>,
}

/// Where the COBS block begins: behind the leading delimiter.
const COBS_START: usize = 1;

impl<'a> Framer<'a> {
    fn new(out: &'a mut [u8]) -> Option<Self> {
        let mut framer = Self { out, len: 0, cobs: EncoderState::default(), digest: CRC.digest() };
        framer.append(0)?;
        framer.append(0)?; // the first code byte's place
        Some(framer)
    }

    fn append(&mut self, byte: u8) -> Option<()> {
        *self.out.get_mut(self.len)? = byte;
        self.len += 1;
        Some(())
    }

    fn set_code(&mut self, at: usize, code: u8) -> Option<()> {
        *self.out.get_mut(at.checked_add(COBS_START)?)? = code;
        Some(())
    }

    fn stuff(&mut self, byte: u8) -> Option<()> {
        match self.cobs.push(byte) {
            PushResult::AddSingle(byte) => self.append(byte),
            PushResult::ModifyFromStartAndSkip((at, code)) => {
                self.set_code(at, code)?;
                self.append(0)
            }
            PushResult::ModifyFromStartAndPushAndSkip((at, code, byte)) => {
                self.set_code(at, code)?;
                self.append(byte)?;
                self.append(0)
            }
        }
    }

    fn close(mut self) -> Option<usize> {
        let crc = self.digest.clone().finalize().to_le_bytes();
        crc.into_iter().try_for_each(|byte| self.stuff(byte))?;
        let (at, code) = self.cobs.clone().finalize();
        self.set_code(at, code)?;
        self.append(0)?;
        Some(self.len)
    }
}

impl postcard::ser_flavors::Flavor for Framer<'_> {
    type Output = usize;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.digest.update(&[byte]);
        self.stuff(byte).ok_or(postcard::Error::SerializeBufferFull)
    }

    fn finalize(self) -> postcard::Result<usize> {
        self.close().ok_or(postcard::Error::SerializeBufferFull)
    }
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

/// Collects bytes into frames. `N`: the longest payload with its checksum.
#[derive(Debug, Default)]
pub struct Deframer<const N: usize> {
    cobs: DecoderState,
    bytes: Vec<u8, N>,
    begun: bool,
    overlong: bool,
}

impl<const N: usize> Deframer<N> {
    /// Empty.
    pub const fn new() -> Self {
        Self { cobs: DecoderState::Idle, bytes: Vec::new(), begun: false, overlong: false }
    }

    /// Takes the next byte of the stream; a delimiter may complete a frame.
    pub fn push(&mut self, byte: u8) -> Option<Received<'_>> {
        if !self.begun {
            if byte == 0 {
                return None;
            }
            self.bytes.clear();
            self.begun = true;
            self.overlong = false;
        }
        match self.cobs.feed(byte) {
            Ok(DecodeResult::NoData | DecodeResult::DataStart) => None,
            Ok(DecodeResult::DataContinue(decoded)) => {
                self.overlong |= self.bytes.push(decoded).is_err();
                None
            }
            Ok(DecodeResult::DataComplete) => Some(self.complete()),
            Err(_) => Some(self.broken()),
        }
    }

    /// A delimiter inside a COBS run.
    fn broken(&mut self) -> Received<'_> {
        self.begun = false;
        Received::Damaged(if self.overlong { Damage::Oversize } else { Damage::Framing })
    }

    fn complete(&mut self) -> Received<'_> {
        self.begun = false;
        if self.overlong {
            return Received::Damaged(Damage::Oversize);
        }
        match self.bytes.split_last_chunk::<CRC_BYTES>() {
            None => Received::Damaged(Damage::Framing),
            Some((payload, crc)) if CRC.checksum(payload) == u32::from_le_bytes(*crc) => {
                Received::Payload(payload)
            }
            Some(_) => Received::Damaged(Damage::Crc),
        }
    }
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
