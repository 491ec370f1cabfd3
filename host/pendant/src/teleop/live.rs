//! Hands as a sensor sees them now: one line a frame on a stream, the newest one played.
//!
//! JSON lines, a frame each, or the rows of the recordings' CSV after their header, where a frame is complete at the first
//! row of another time or at an empty line. Units, frame and columns are those of [`super::recording`]. What comes while
//! the pendant is busy with a frame is left out but for the newest: a hand that is followed late is worse than one seen
//! less often.

use std::io::{BufRead, Read};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use serde::Deserialize;
use weldpath_core::wire::WireHandFrame;

use super::recording::{Row, Seen, Timeline, extended, hand_of};

/// Longest line that is read, bytes.
const MOST_LINE: u64 = 64 << 10;

/// A frame of the JSON lines.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonFrame {
    timestamp_us: f64,
    #[serde(default)]
    hands: Vec<JsonHand>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonHand {
    is_right: bool,
    palm_mm: [f64; 3],
    direction: [f64; 3],
    normal: [f64; 3],
    grab: f64,
    pinch: f64,
    extended: String,
    #[serde(default = "super::recording::certain")]
    confidence: f64,
}

impl From<JsonHand> for Seen {
    fn from(hand: JsonHand) -> Self {
        Self {
            is_right: hand.is_right,
            palm_mm: hand.palm_mm,
            direction: hand.direction,
            normal: hand.normal,
            grab: hand.grab,
            pinch: hand.pinch,
            confidence: hand.confidence,
            extended: extended(&hand.extended),
        }
    }
}

/// What has come of a line.
#[derive(Default)]
struct Lines {
    number: usize,
    header: Option<csv::StringRecord>,
    /// Rows of the CSV's frame that is not complete.
    rows: Option<(f64, Vec<Seen>)>,
    timeline: Timeline,
}

impl Lines {
    /// One line without its end; a frame, if it completes one.
    fn take(&mut self, line: &str) -> Result<Option<WireHandFrame>, String> {
        self.number += 1;
        let (number, line) = (self.number, line.trim());
        self.read(line).map_err(|why| format!("line {number}: {why}"))
    }

    fn read(&mut self, line: &str) -> Result<Option<WireHandFrame>, String> {
        if line.is_empty() {
            return self.complete();
        }
        if line.starts_with('#') {
            return Ok(None);
        }
        if line.starts_with('{') {
            let JsonFrame { timestamp_us, hands } =
                serde_json::from_str(line).map_err(|error| error.to_string())?;
            let hands: Vec<Seen> = hands.into_iter().map(Seen::from).collect();
            return self.timeline.frame(timestamp_us, &hands).map(Some);
        }
        let fields = csv::StringRecord::from(line.split(',').map(str::trim).collect::<Vec<_>>());
        let Some(header) = &self.header else {
            if !fields.iter().any(|name| name == "timestamp_us") {
                return Err("neither a JSON frame nor the header of a CSV".into());
            }
            self.header = Some(fields);
            return Ok(None);
        };
        let row: Row = fields.deserialize(Some(header)).map_err(|error| error.to_string())?;
        let time_us = row.timestamp_us;
        let before = self.rows.as_ref().is_some_and(|(at, _)| *at != time_us);
        let complete = if before { self.complete()? } else { None };
        self.rows.get_or_insert((time_us, Vec::new())).1.push(hand_of(row));
        Ok(complete)
    }

    fn complete(&mut self) -> Result<Option<WireHandFrame>, String> {
        self.rows.take().map(|(time_us, hands)| self.timeline.frame(time_us, &hands)).transpose()
    }
}

/// Frames as they come, until the stream ends or holds something else.
pub struct Live {
    frames: Receiver<Result<WireHandFrame, String>>,
    /// Why it ended before the stream did.
    failure: Option<String>,
    skipped: usize,
}

impl Live {
    /// Reads in a thread of its own, so that nobody who sends has to wait.
    pub fn listen(input: impl BufRead + Send + 'static) -> Self {
        let (told, frames) = channel();
        thread::spawn(move || {
            let mut lines = Lines::default();
            let mut input = input;
            while let Some(read) = next(&mut input, &mut lines) {
                let over = read.is_err();
                if read.transpose().is_some_and(|frame| told.send(frame).is_err()) || over {
                    return;
                }
            }
        });
        Self { frames, failure: None, skipped: 0 }
    }

    /// Frames that were left out because a newer one was there.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// What was wrong with the stream, if anything was.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }
}

impl Iterator for Live {
    type Item = WireHandFrame;

    /// Waits for a frame if there is none; the newest, if there are several.
    fn next(&mut self) -> Option<WireHandFrame> {
        let mut newest = None;
        while self.failure.is_none() {
            let read = if newest.is_some() {
                self.frames.try_recv()
            } else {
                self.frames.recv().map_err(|_| TryRecvError::Disconnected)
            };
            match read {
                Ok(Ok(frame)) => self.skipped += usize::from(newest.replace(frame).is_some()),
                Ok(Err(why)) => self.failure = Some(why),
                Err(_) => break,
            }
        }
        newest
    }
}

/// What the next line brings; none at the end, where an incomplete frame of rows is complete.
fn next(input: &mut impl BufRead, lines: &mut Lines) -> Option<Result<Option<WireHandFrame>, String>> {
    let mut line = Vec::new();
    match input.by_ref().take(MOST_LINE).read_until(b'\n', &mut line) {
        Err(error) => Some(Err(error.to_string())),
        Ok(0) => lines.complete().transpose().map(|frame| frame.map(Some)),
        Ok(_) if line.len() as u64 == MOST_LINE && !line.ends_with(b"\n") => {
            Some(Err(format!("line {}: longer than {} kB", lines.number + 1, MOST_LINE >> 10)))
        }
        Ok(_) => Some(lines.take(&String::from_utf8_lossy(&line))),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;
    use std::sync::mpsc::Sender;

    use super::super::recording;
    use super::*;

    const JSON: &str = r#"{"timestamp_us": 5000, "hands": [{"is_right": true, "palm_mm": [1, 200, -3], "direction": [0, 0, -1], "normal": [0, -1, 0], "grab": 0.1, "pinch": 0.9, "extended": "00111"}]}"#;

    fn all(text: &str) -> Result<Vec<WireHandFrame>, String> {
        let (mut input, mut lines, mut frames) = (Cursor::new(text.as_bytes()), Lines::default(), Vec::new());
        while let Some(read) = next(&mut input, &mut lines) {
            frames.extend(read?);
        }
        Ok(frames)
    }

    fn recorded() -> Vec<WireHandFrame> {
        let hand = recording::wire_hand(&Seen {
            is_right: false,
            palm_mm: [3.0, 180.0, 7.0],
            direction: [0.0, 0.0, -1.0],
            normal: [0.0, -1.0, 0.0],
            grab: 0.0,
            pinch: 0.25,
            confidence: 0.5,
            extended: 0b1_0101,
        });
        let hand = hand.expect("sound");
        let frame =
            |k: u32| WireHandFrame { time_ms: 10 * k, left: Some(hand), right: (k % 2 == 1).then_some(hand) };
        (0..5).map(frame).collect()
    }

    #[test]
    fn rows_that_come_live_are_the_frames_of_the_same_recording() {
        let text = recording::to_csv(&recorded(), "made for a test");
        assert_eq!(all(&text).unwrap(), recorded());
        let spaced = text.replace("\n10000,0", "\n\n10000,0");
        assert_eq!(all(&spaced).unwrap(), recorded(), "an empty line ends a frame early");
    }

    #[test]
    fn a_line_of_json_is_a_frame_and_its_time_counts_from_the_first() {
        let later = r#"{"timestamp_us": 26000, "hands": []}"#;
        let frames = all(&format!("# a sensor\n{JSON}\n{later}\n")).unwrap();
        assert_eq!((frames[0].time_ms, frames[1].time_ms), (0, 21));
        let right = frames[0].right.expect("seen");
        assert_eq!(
            (right.palm_um, right.extended, right.confidence_permille),
            ([1_000, 200_000, -3_000], 0b1_1100, 1000)
        );
        assert_eq!((frames[0].left, frames[1].right), (None, None));
    }

    #[test]
    fn what_is_no_frame_is_refused_with_its_line() {
        let turned = JSON.replace("[0, 0, -1]", "[0, 0, -2]");
        for (text, part) in [
            ("\nhello\n".to_string(), "line 2: neither"),
            (format!("{JSON}\n{turned}"), "line 2: frame 1"),
            (format!("{JSON}\n{}", JSON.replace("5000", "4000")), "line 2: frame 1"),
            (format!("{JSON}\n{{\"time\": 3}}"), "line 2"),
            ("a".repeat(MOST_LINE as usize + 1), "line 1: longer than 64 kB"),
        ] {
            let error = all(&text).expect_err(part);
            assert!(error.contains(part), "{error}");
        }
    }

    fn live() -> (Sender<Result<WireHandFrame, String>>, Live) {
        let (told, frames) = channel();
        (told, Live { frames, failure: None, skipped: 0 })
    }

    #[test]
    fn whoever_falls_behind_gets_the_newest_frame_and_a_broken_stream_ends_after_it() {
        let (told, mut live) = live();
        for frame in recorded() {
            told.send(Ok(frame)).expect("listens");
        }
        assert_eq!(live.next(), recorded().last().copied());
        assert_eq!(live.skipped(), 4);
        told.send(Ok(recorded()[0])).expect("listens");
        told.send(Err("line 9: torn".into())).expect("listens");
        assert_eq!(live.next(), Some(recorded()[0]));
        assert_eq!((live.next(), live.failure()), (None, Some("line 9: torn")));
    }
}
