//! Random numbers for the simulator: the same on every machine and in any order of evaluation.
//!
//! Values are hashes of (seed, stream, counter) by the SplitMix64 finaliser (Steele, Lea, Flood 2014), so pixels can be
//! computed in parallel. No logarithm or sine is used: those differ between machines in the last bit.

/// A source of random numbers, named by what it is for.
#[derive(Debug, Clone)]
pub(super) struct Stream {
    key: u64,
    counter: u64,
}

impl Stream {
    /// The stream of `purpose` (a short name) and `index` (view, say) under `seed`.
    pub(super) fn new(seed: u64, purpose: &str, index: u64) -> Self {
        let fnv = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        let name = purpose.bytes().fold(0xcbf2_9ce4_8422_2325, fnv);
        Self { key: mix(mix(seed ^ name).wrapping_add(index)), counter: 0 }
    }

    /// The same stream, at place `counter`: the same number whatever was drawn before.
    pub(super) fn at(&self, counter: u64) -> Self {
        Self { key: mix(self.key ^ counter.wrapping_mul(0xd6e8_feb8_6659_fd93)), counter: 0 }
    }

    /// Any 64 bits: a seed for something else.
    pub(super) fn next(&mut self) -> u64 {
        self.counter = self.counter.wrapping_add(1);
        mix(self.key.wrapping_add(self.counter.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [`low`, `high`).
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Mean 0, standard deviation 1, as the sum of twelve uniform numbers: exact arithmetic, tails end at 6.
    pub(super) fn gaussian(&mut self) -> f64 {
        let quarters = |word: u64| (0..4).map(move |i| (word >> (16 * i)) & 0xffff).sum::<u64>();
        let sum = quarters(self.next()) + quarters(self.next()) + quarters(self.next());
        (sum as f64 + 6.0) / 65536.0 - 6.0
    }

    /// A direction, uniform on the sphere.
    pub(super) fn direction(&mut self) -> nalgebra::Vector3<f64> {
        loop {
            let v = nalgebra::Vector3::new(
                self.between(-1.0, 1.0),
                self.between(-1.0, 1.0),
                self.between(-1.0, 1.0),
            );
            if v.norm() > 0.1 && v.norm() < 1.0 {
                return v.normalize();
            }
        }
    }
}

/// SplitMix64's finaliser.
fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::Stream;

    #[test]
    fn gaussian_numbers_have_mean_zero_and_unit_variance() {
        let mut stream = Stream::new(7, "test", 0);
        let n = 200_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let x = stream.gaussian();
            sum += x;
            squares += x * x;
        }
        assert!((sum / f64::from(n)).abs() < 0.01);
        assert!((squares / f64::from(n) - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_place_in_a_stream_does_not_depend_on_what_was_drawn_before() {
        let mut used = Stream::new(1, "pixels", 3);
        used.unit();
        assert_eq!(used.at(42).unit(), Stream::new(1, "pixels", 3).at(42).unit());
        assert_ne!(Stream::new(1, "pixels", 3).at(42).unit(), Stream::new(2, "pixels", 3).at(42).unit());
        assert_ne!(Stream::new(1, "pixels", 3).at(42).unit(), Stream::new(1, "pixels", 4).at(42).unit());
    }
}
