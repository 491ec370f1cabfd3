//! Keys: 128 bits of everything that a result hangs on.

use std::fmt::{self, Debug, Write};
use std::hash::{DefaultHasher, Hasher};

use serde::{Deserialize, Serialize};

/// Digest of all that decides a result. Equal keys are taken for equal causes: among 128 bits no two of the few results that
/// are kept meet by accident. It is no guard against one who wants them to meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Key([u64; 2]);

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}{:016x}", self.0[0], self.0[1])
    }
}

/// Numbers go to the hash in pieces of this many bytes: one at a time each would pay for itself.
const PIECE_BYTES: usize = 4096;

/// A key as it grows. What has no fixed length is preceded by it, so that no two lists of parts are one row of bytes.
///
/// SipHash of the standard library, whose state has 256 bits; two ends of it make the 128 of a key.
#[derive(Debug, Clone, Default)]
pub(crate) struct Digest(DefaultHasher);

impl Digest {
    pub(crate) fn end(mut self) -> Key {
        let first = self.0.finish();
        self.0.write_u8(1);
        Key([first, self.0.finish()])
    }

    pub(crate) fn count(&mut self, count: usize) {
        self.0.write_u64(count as u64);
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.count(bytes.len());
        self.0.write(bytes);
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.bytes(text.as_bytes());
    }

    pub(crate) fn key(&mut self, Key([a, b]): Key) {
        self.0.write_u64(a);
        self.0.write_u64(b);
    }

    /// A part of something whose length is told elsewhere.
    pub(crate) fn piece(&mut self, bytes: &[u8]) {
        self.0.write(bytes);
    }

    /// Numbers by their bits, so that -0 and 0 are two.
    pub(crate) fn numbers<const N: usize>(&mut self, numbers: impl Iterator<Item = [u8; N]>) {
        let mut piece = Vec::with_capacity(PIECE_BYTES + N);
        let mut count = 0;
        for number in numbers {
            piece.extend(number);
            count += 1;
            if piece.len() >= PIECE_BYTES {
                self.0.write(&piece);
                piece.clear();
            }
        }
        self.0.write(&piece);
        self.count(count);
    }

    /// All that a value shows of itself: every field of it, those that are added later among them. Floating-point numbers are
    /// shown with as many digits as tell them from all others.
    pub(crate) fn shown(&mut self, value: &impl Debug) {
        struct Shown<'a>(&'a mut DefaultHasher, usize);
        impl Write for Shown<'_> {
            fn write_str(&mut self, text: &str) -> fmt::Result {
                self.0.write(text.as_bytes());
                self.1 += text.len();
                Ok(())
            }
        }
        let mut shown = Shown(&mut self.0, 0);
        // The hash takes whatever it is given.
        let _ = write!(shown, "{value:?}");
        let length = shown.1;
        self.count(length);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(fill: impl FnOnce(&mut Digest)) -> Key {
        let mut digest = Digest::default();
        fill(&mut digest);
        digest.end()
    }

    #[test]
    fn where_one_part_ends_and_the_next_begins_is_part_of_the_key() {
        let texts = |a: &'static str, b: &'static str| {
            key(|digest| {
                digest.text(a);
                digest.text(b);
            })
        };
        assert_eq!(texts("ab", "c"), texts("ab", "c"));
        assert_ne!(texts("ab", "c"), texts("a", "bc"));
        assert_ne!(texts("", "abc"), texts("abc", ""));
    }

    #[test]
    fn one_bit_of_one_number_makes_another_key() {
        let of = |numbers: &[f32]| key(|digest| digest.numbers(numbers.iter().map(|v| v.to_le_bytes())));
        let mut numbers: Vec<f32> = (0..5000).map(|k| k as f32 * 0.1).collect();
        let before = of(&numbers);
        assert_eq!(before, of(&numbers.clone()));
        for at in [0, 1023, 1024, 4999] {
            let old = numbers[at];
            numbers[at] = f32::from_bits(old.to_bits() ^ 1);
            assert_ne!(before, of(&numbers), "{at}");
            numbers[at] = old;
        }
        assert_ne!(of(&[0.0]), of(&[-0.0]));
        assert_ne!(of(&[]), of(&[0.0]));
    }

    #[test]
    fn a_key_is_written_as_32_digits() {
        assert_eq!(Key([1, 0xab]).to_string(), "000000000000000100000000000000ab");
    }
}
