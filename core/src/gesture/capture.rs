//! The right hand's "ok" (paper II-B): take a view here. One event per gesture.

use super::HandFrame;

/// "ok" is a pinch without a fist, middle to little finger stretched out ...
const PINCH_ABOVE: f32 = 0.7;
const GRAB_BELOW: f32 = 0.5;
/// ... for this long; and it is over when it has not been seen for as long again.
const HELD_US: u64 = 50_000;

/// Watches the capturing hand for "ok".
#[derive(Debug, Clone, Default)]
pub struct CaptureGesture {
    state: State,
}

#[derive(Debug, Clone, Copy, Default)]
enum State {
    /// No gesture.
    #[default]
    Idle,
    /// Seen since then, not long enough yet.
    Seen { since_us: u64 },
    /// Captured; last seen then.
    Captured { seen_us: u64 },
}

impl CaptureGesture {
    /// True once for each gesture, in the frame in which it has been held for 50 ms.
    ///
    /// `now_us` is the sensor's clock, which goes on when the hand is lost.
    pub fn observe(&mut self, hand: Option<&HandFrame>, now_us: u64) -> bool {
        let ok = hand.is_some_and(is_ok);
        let held = |since_us| now_us.saturating_sub(since_us) >= HELD_US;
        let (state, captured) = match (self.state, ok) {
            (State::Idle, true) => (State::Seen { since_us: now_us }, false),
            (State::Idle | State::Seen { .. }, false) => (State::Idle, false),
            (State::Seen { since_us }, true) if held(since_us) => (State::Captured { seen_us: now_us }, true),
            (State::Captured { .. }, true) => (State::Captured { seen_us: now_us }, false),
            (State::Captured { seen_us }, false) if held(seen_us) => (State::Idle, false),
            (unchanged, _) => (unchanged, false),
        };
        self.state = state;
        captured
    }
}

fn is_ok(hand: &HandFrame) -> bool {
    hand.pinch() > PINCH_ABOVE && hand.grab() < GRAB_BELOW && hand.fingers().middle_to_little()
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::gesture::{Attitude, Fingers};
    use crate::{Point, Vector};

    const OPEN: Fingers = Fingers::from_bits(0b1_1100);

    fn hand(pinch: f32, grab: f32, fingers: Fingers) -> HandFrame {
        let attitude = Attitude::from_direction_and_normal(&-Vector::z(), &-Vector::y()).unwrap();
        HandFrame::new(0, Point::origin(), attitude, grab, pinch, fingers).unwrap()
    }

    /// Captures in a list of (frames at 10 ms, is it "ok").
    fn captures(parts: &[(u64, bool)]) -> usize {
        let mut gesture = CaptureGesture::default();
        let frames = parts.iter().flat_map(|&(n, ok)| core::iter::repeat_n(ok, n as usize));
        let (ok, open) = (hand(0.9, 0.1, OPEN), hand(0.1, 0.1, OPEN));
        let seen =
            |(i, is): (usize, bool)| gesture.observe(Some(if is { &ok } else { &open }), i as u64 * 10_000);
        frames.enumerate().map(seen).filter(|&captured| captured).count()
    }

    #[test]
    fn one_gesture_is_one_capture_however_long_it_is_held() {
        assert_eq!(captures(&[(10, false), (300, true), (10, false)]), 1);
        assert_eq!(captures(&[(20, true), (10, false), (20, true), (10, false)]), 2);
    }

    #[test]
    fn a_glimpse_is_no_capture_and_a_flicker_not_a_second_one() {
        assert_eq!(captures(&[(5, true), (5, false)]), 0);
        assert_eq!(captures(&[(6, true), (5, false)]), 1);
        assert_eq!(captures(&[(20, true), (2, false), (20, true)]), 1);
    }

    #[test]
    fn a_fist_a_weak_pinch_and_folded_fingers_are_not_ok() {
        assert!(is_ok(&hand(0.9, 0.2, OPEN)));
        assert!(!is_ok(&hand(0.9, 0.6, OPEN)));
        assert!(!is_ok(&hand(0.7, 0.2, OPEN)));
        assert!(!is_ok(&hand(0.9, 0.2, Fingers::new([true, true, true, true, false]))));
    }

    #[test]
    fn a_lost_hand_ends_the_gesture() {
        let mut gesture = CaptureGesture::default();
        let ok = hand(0.9, 0.1, OPEN);
        let mut at = |present: bool, t: u64| gesture.observe(present.then_some(&ok), t);
        assert!(!at(true, 0) && at(true, 60_000) && !at(false, 70_000) && !at(false, 130_000));
        assert!(!at(true, 140_000) && at(true, 200_000));
    }
}
