//! Recordings of hands: Leap Motion's JSON, plain or compressed (LZ-String, base64), and CSV with one hand a row.
//!
//! Positions are millimetres in the sensor's frame, x right, y up, z toward the user; times are microseconds. The
//! columns of the CSV are those of [`CSV_COLUMNS`]; lines that begin with # are comments.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use weldpath_core::wire::{Hand, Q15_ONE, WireHandFrame};

/// Columns that a CSV must have, in any order; others are left aside.
pub const CSV_COLUMNS: &str = "timestamp_us,is_right,palm_x_mm,palm_y_mm,palm_z_mm,direction_x,direction_y,\
                               direction_z,normal_x,normal_y,normal_z,grab,pinch,extended";
/// Largest file that is read.
const MOST_BYTES: u64 = 64 << 20;
/// Between joined recordings no hand is seen for so long, ms.
const PAUSE_MS: u32 = 1000;
/// A palm farther away is a broken number, mm.
const FARTHEST_MM: f64 = 10_000.0;

/// Why a recording cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read the recording {path}: {why}")]
pub struct Error {
    path: PathBuf,
    why: String,
}

#[derive(Deserialize)]
struct Recording {
    frames: Vec<LeapFrame>,
}

#[derive(Deserialize)]
struct LeapFrame {
    timestamp: f64,
    #[serde(default)]
    hands: Vec<LeapHand>,
    #[serde(default)]
    pointables: Vec<Pointable>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct LeapHand {
    id: i64,
    #[serde(rename = "type")]
    side: String,
    palm_position: [f64; 3],
    palm_normal: [f64; 3],
    direction: [f64; 3],
    grab_strength: f64,
    pinch_strength: f64,
    #[serde(default = "certain")]
    confidence: f64,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Pointable {
    hand_id: i64,
    #[serde(rename = "type", default)]
    finger: u8,
    #[serde(default)]
    extended: bool,
}

/// One hand of the CSV.
#[derive(Deserialize)]
pub(super) struct Row {
    pub(super) timestamp_us: f64,
    is_right: u8,
    palm_x_mm: f64,
    palm_y_mm: f64,
    palm_z_mm: f64,
    direction_x: f64,
    direction_y: f64,
    direction_z: f64,
    normal_x: f64,
    normal_y: f64,
    normal_z: f64,
    grab: f64,
    pinch: f64,
    extended: String,
    #[serde(default = "certain")]
    confidence: f64,
}

/// Confidence where none is told.
pub(super) fn certain() -> f64 {
    1.0
}

/// One hand as each of the formats says it.
pub(super) struct Seen {
    pub(super) is_right: bool,
    pub(super) palm_mm: [f64; 3],
    pub(super) direction: [f64; 3],
    pub(super) normal: [f64; 3],
    pub(super) grab: f64,
    pub(super) pinch: f64,
    pub(super) confidence: f64,
    pub(super) extended: u8,
}

/// Reads a recording; its frames count from 0 ms.
pub fn read(path: &Path) -> Result<Vec<WireHandFrame>, Error> {
    let failed = |why: String| Error { path: path.into(), why };
    let text = text(path).map_err(failed)?;
    let frames = parse(&text).map_err(failed)?;
    let timed = timed(frames).map_err(failed)?;
    if timed.is_empty() { Err(failed("it holds no frame".into())) } else { Ok(timed) }
}

/// Several recordings one after the other; between them the hands are away for a second.
pub fn join(recordings: impl IntoIterator<Item = Vec<WireHandFrame>>) -> Vec<WireHandFrame> {
    let mut joined: Vec<WireHandFrame> = Vec::new();
    for recording in recordings {
        let start_ms = joined.last().map_or(0, |last| last.time_ms.saturating_add(PAUSE_MS));
        if start_ms > 0 {
            joined.push(WireHandFrame { time_ms: start_ms - PAUSE_MS / 2, left: None, right: None });
        }
        let later =
            |frame: WireHandFrame| WireHandFrame { time_ms: frame.time_ms.saturating_add(start_ms), ..frame };
        joined.extend(recording.into_iter().map(later));
    }
    joined
}

fn text(path: &Path) -> Result<String, String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    let mut text = String::new();
    file.take(MOST_BYTES + 1).read_to_string(&mut text).map_err(|error| error.to_string())?;
    if text.len() as u64 > MOST_BYTES {
        return Err(format!("it is larger than {} MB", MOST_BYTES >> 20));
    }
    Ok(text)
}

fn parse(text: &str) -> Result<Vec<(f64, Vec<Seen>)>, String> {
    let trimmed = text.trim();
    match trimmed.bytes().next() {
        None => Err("it is empty".into()),
        Some(b'{') => json(trimmed),
        Some(_) if trimmed.lines().any(|line| line.split(',').any(|name| name.trim() == "timestamp_us")) => {
            csv(text)
        }
        Some(_) => {
            let shape =
                "neither Leap Motion JSON, nor that compressed (LZ-String base64), nor CSV with the columns ";
            let unknown = || format!("{shape}{CSV_COLUMNS}");
            let base64 = trimmed.bytes().all(|b| b.is_ascii_alphanumeric() || b"+/=\r\n".contains(&b));
            let decoded = base64.then(|| unpacked(trimmed)).flatten();
            json(&String::from_utf16(&decoded.ok_or_else(unknown)?).map_err(|_| unknown())?)
        }
    }
}

/// LZ-String in base64, as UTF-16.
#[cfg(feature = "gestures")]
fn unpacked(text: &str) -> Option<Vec<u16>> {
    lz_str::decompress_from_base64(text)
}

/// This build reads no compressed recordings.
#[cfg(not(feature = "gestures"))]
fn unpacked(_: &str) -> Option<Vec<u16>> {
    None
}

fn json(text: &str) -> Result<Vec<(f64, Vec<Seen>)>, String> {
    let recording: Recording =
        serde_json::from_str(text).map_err(|error| format!("as Leap Motion JSON: {error}"))?;
    Ok(recording.frames.into_iter().map(|frame| (frame.timestamp, seen(&frame))).collect())
}

fn seen(frame: &LeapFrame) -> Vec<Seen> {
    let extended = |id| {
        let fingers = frame.pointables.iter().filter(|p| p.hand_id == id && p.extended && p.finger < 5);
        fingers.fold(0, |bits, p| bits | 1 << p.finger)
    };
    let hand = |hand: &LeapHand| Seen {
        is_right: hand.side == "right",
        palm_mm: hand.palm_position,
        direction: hand.direction,
        normal: hand.palm_normal,
        grab: hand.grab_strength,
        pinch: hand.pinch_strength,
        confidence: hand.confidence,
        extended: extended(hand.id),
    };
    frame.hands.iter().map(hand).collect()
}

fn csv(text: &str) -> Result<Vec<(f64, Vec<Seen>)>, String> {
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let mut frames: Vec<(f64, Vec<Seen>)> = Vec::new();
    for row in reader.deserialize() {
        let row: Row = row.map_err(|error| error.to_string())?;
        let time_us = row.timestamp_us;
        match frames.last_mut().filter(|(at, _)| *at == time_us) {
            Some((_, hands)) => hands.push(hand_of(row)),
            None => frames.push((time_us, vec![hand_of(row)])),
        }
    }
    Ok(frames)
}

pub(super) fn hand_of(row: Row) -> Seen {
    Seen {
        is_right: row.is_right == 1,
        palm_mm: [row.palm_x_mm, row.palm_y_mm, row.palm_z_mm],
        direction: [row.direction_x, row.direction_y, row.direction_z],
        normal: [row.normal_x, row.normal_y, row.normal_z],
        grab: row.grab,
        pinch: row.pinch,
        confidence: row.confidence,
        extended: extended(&row.extended),
    }
}

/// Five digits from thumb to little finger, 1 for an extended one, as bits.
pub(super) fn extended(digits: &str) -> u8 {
    let extended = digits.bytes().take(5).enumerate().filter(|(_, b)| *b == b'1');
    extended.fold(0, |bits, (finger, _)| bits | 1 << finger)
}

fn timed(frames: Vec<(f64, Vec<Seen>)>) -> Result<Vec<WireHandFrame>, String> {
    let mut timeline = Timeline::default();
    frames.into_iter().map(|(time_us, hands)| timeline.frame(time_us, &hands)).collect()
}

/// Times from 0, in order; hands in the wire's integers.
#[derive(Debug, Default)]
pub(super) struct Timeline {
    start_us: Option<f64>,
    before_us: f64,
    index: usize,
}

impl Timeline {
    /// The next frame.
    pub(super) fn frame(&mut self, time_us: f64, hands: &[Seen]) -> Result<WireHandFrame, String> {
        let index = self.index;
        self.index += 1;
        let start_us = *self.start_us.get_or_insert(time_us);
        let ms = (time_us - start_us) / 1000.0;
        if !(time_us - start_us >= self.before_us && ms < f64::from(u32::MAX / 2)) {
            return Err(format!("frame {index} (counted from 0): its time does not follow the frame before"));
        }
        self.before_us = time_us - start_us;
        let mut frame = WireHandFrame { time_ms: ms.round() as u32, left: None, right: None };
        for hand in hands {
            let wire = wire_hand(hand).map_err(|why| format!("frame {index} (counted from 0): {why}"))?;
            let side = if hand.is_right { &mut frame.right } else { &mut frame.left };
            *side = side.or(Some(wire));
        }
        Ok(frame)
    }
}

pub(super) fn wire_hand(seen: &Seen) -> Result<Hand, &'static str> {
    let near = seen.palm_mm.iter().all(|mm| mm.abs() < FARTHEST_MM);
    let strengths = [seen.grab, seen.pinch, seen.confidence];
    let unit = |v: &[f64; 3]| v.iter().all(|c| c.abs() <= 1.001);
    if !near
        || !unit(&seen.direction)
        || !unit(&seen.normal)
        || !strengths.iter().all(|s| (-0.001..=1.001).contains(s))
    {
        return Err(
            "a palm that is no place within 10 m, a direction that is no unit vector, or a strength that is not 0 to 1",
        );
    }
    let q15 = |v: [f64; 3]| v.map(|c| (c.clamp(-1.0, 1.0) * f64::from(Q15_ONE)).round() as i16);
    let permille = |s: f64| (s.clamp(0.0, 1.0) * 1000.0).round() as u16;
    Ok(Hand {
        palm_um: seen.palm_mm.map(|mm| (mm * 1000.0).round() as i32),
        direction_q15: q15(seen.direction),
        normal_q15: q15(seen.normal),
        grab_permille: permille(seen.grab),
        pinch_permille: permille(seen.pinch),
        confidence_permille: permille(seen.confidence),
        extended: seen.extended,
    })
}

/// Hand frames as CSV, with a comment that says whence they are.
pub fn to_csv(frames: &[WireHandFrame], origin: &str) -> String {
    let mut text = format!("# {origin}\n{CSV_COLUMNS},confidence\n");
    for frame in frames {
        let hands = [(0, &frame.left), (1, &frame.right)];
        for (side, hand) in hands.into_iter().filter_map(|(side, hand)| Some((side, hand.as_ref()?))) {
            let vector = |v: [f64; 3]| v.map(|c| format!("{c:.6}")).join(",");
            let palm = vector(hand.palm_um.map(|um| f64::from(um) / 1000.0));
            let [direction, normal] = [hand.direction_q15, hand.normal_q15]
                .map(|v| vector(v.map(|c| f64::from(c) / f64::from(Q15_ONE))));
            let [grab, pinch, confidence] =
                [hand.grab_permille, hand.pinch_permille, hand.confidence_permille]
                    .map(|permille| f64::from(permille) / 1000.0);
            let extended: String =
                (0..5).map(|bit| if hand.extended >> bit & 1 == 1 { '1' } else { '0' }).collect();
            let time_us = u64::from(frame.time_ms) * 1000;
            text += &format!(
                "{time_us},{side},{palm},{direction},{normal},{grab},{pinch},{extended},{confidence}\n"
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand(x_um: i32) -> Hand {
        Hand {
            palm_um: [x_um, 200_000, -5],
            direction_q15: [0, 0, -Q15_ONE],
            normal_q15: [123, -Q15_ONE, 7],
            grab_permille: 100,
            pinch_permille: 900,
            confidence_permille: 1000,
            extended: 0b1_1100,
        }
    }

    fn frames() -> Vec<WireHandFrame> {
        let frame = |k: u32| WireHandFrame {
            time_ms: 10 * k,
            left: (k != 3).then(|| hand(k as i32)),
            right: Some(hand(-(k as i32))),
        };
        (0..6).map(frame).collect()
    }

    #[test]
    fn a_recording_that_was_written_is_read_as_it_was() {
        let read = timed(parse(&to_csv(&frames(), "made for a test")).unwrap()).unwrap();
        assert_eq!(read, frames());
    }

    #[test]
    fn the_columns_of_a_csv_may_come_in_any_order() {
        let turned: Vec<String> = to_csv(&frames(), "made for a test")
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| line.rsplit(',').collect::<Vec<_>>().join(", "))
            .collect();
        assert_eq!(timed(parse(&turned.join("\n")).unwrap()).unwrap(), frames());
    }

    #[test]
    fn joined_recordings_have_a_pause_without_hands_between() {
        let joined = join([frames(), frames()]);
        assert_eq!(joined.len(), 13);
        assert!(joined.windows(2).all(|pair| pair[0].time_ms < pair[1].time_ms));
        assert_eq!((joined[6].left, joined[6].right), (None, None));
    }

    #[test]
    fn what_is_no_recording_is_refused_with_its_place() {
        let good = to_csv(&frames(), "test");
        for (text, part) in [
            (String::new(), "empty"),
            ("hello".into(), "neither"),
            ("{\"frames\": 3}".into(), "JSON"),
            (good.replace("0.000000,0.000000,-1.000000", "nan,0,-1"), "unit vector"),
            (good.replacen("\n10000,", "\n99000000,", 1), "does not follow"),
            (good.replace("timestamp_us,is_right", "timestamp_us,side"), "is_right"),
        ] {
            let error = parse(&text).and_then(timed).expect_err(part);
            assert!(error.contains(part), "{error}");
        }
    }
}
