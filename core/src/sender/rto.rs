//! When to send again: the retransmission time-out of RFC 6298, fed by pings and by chunks that were sent only once,
//! so that a repeated message never measures the wrong copy (Karn). Times are microseconds.

const LEAST_US: u32 = 25_000;
const MOST_US: u32 = 2_000_000;
/// Before the first measurement.
const FIRST_US: u32 = 250_000;

/// Smoothed round trip and its deviation.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rto {
    smoothed: Option<(u32, u32)>,
}

impl Rto {
    pub(super) fn measured(&mut self, round_trip_us: u32) {
        let sample = round_trip_us.min(MOST_US);
        self.smoothed = Some(match self.smoothed {
            None => (sample, sample / 2),
            Some((mean, deviation)) => {
                let error = mean.abs_diff(sample);
                (mean - mean / 8 + sample / 8, deviation - deviation / 4 + error / 4)
            }
        });
    }

    /// Round trip, as far as it is known.
    pub(super) fn round_trip_us(&self) -> u32 {
        self.smoothed.map_or(FIRST_US, |(mean, _)| mean)
    }

    /// Time-out of the `sends`-th sending: doubles with each.
    pub(super) fn timeout_us(&self, sends: u8) -> u64 {
        let first = match self.smoothed {
            None => FIRST_US,
            Some((mean, deviation)) => {
                mean.saturating_add(deviation.saturating_mul(4)).clamp(LEAST_US, MOST_US)
            }
        };
        let doublings = u32::from(sends.saturating_sub(1).min(8));
        u64::from(first << doublings).min(u64::from(MOST_US))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_out_follows_the_round_trip_within_its_bounds() {
        let mut rto = Rto::default();
        (0..100).for_each(|_| rto.measured(400));
        assert_eq!(rto.timeout_us(1), 25_000);
        (0..100).for_each(|_| rto.measured(300_000));
        assert!((300_000..400_000).contains(&rto.timeout_us(1)));
        (0..100).for_each(|_| rto.measured(u32::MAX));
        assert_eq!(rto.timeout_us(1), 2_000_000);
        assert_eq!(rto.timeout_us(255), 2_000_000);
    }

    #[test]
    fn each_sending_waits_twice_as_long() {
        let rto = Rto::default();
        assert_eq!([1, 2, 3, 4].map(|sends| rto.timeout_us(sends)), [250_000, 500_000, 1_000_000, 2_000_000]);
    }
}
