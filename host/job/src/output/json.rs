//! `path.json`: the complete program, written and read back. Schema: `docs/formats.md`.
//!
//! This is what is streamed to a pendant, so reading checks everything a controller would have to refuse.

use nalgebra::{Point3, Quaternion, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::frame::PathFrame;
use weldpath_method::weld::program::{Kind, Waypoint};

/// Value of `format`.
pub const FORMAT: &str = "weldpath-program";
/// Value of `version`; raised when a reader of the old one would misunderstand the new one.
pub const VERSION: u32 = 1;

/// How far a quaternion's norm may be from 1.
const NORM_TOLERANCE: f64 = 1e-3;
/// Longest standstill, s: beyond it a number is surely in milliseconds.
const MOST_DWELL_S: f64 = 600.0;

/// Why a program cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Not JSON, or not of this shape.
    #[error("not a weldpath program: {0}; write one with `weldpath plan`")]
    Shape(#[from] serde_json::Error),
    /// A program of another format or version.
    #[error("this is {format} version {version}; this weldpath reads {FORMAT} version {VERSION}")]
    Version {
        /// What it says it is.
        format: String,
        /// And which version of that.
        version: u32,
    },
    /// A waypoint that no robot could execute.
    #[error("waypoint {index} (counted from 0): {why}")]
    Waypoint {
        /// Its place in `waypoints`.
        index: usize,
        /// What is wrong with it.
        why: String,
    },
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: String,
    version: u32,
    frame: PathFrame,
    waypoints: Vec<Row>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    kind: Kind,
    seam: Option<usize>,
    weld: bool,
    feed_mm_s: f64,
    position_mm: [f64; 3],
    base_from_torch_wxyz: [f64; 4],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    dwell_s: Option<f64>,
}

/// What a reader looks at before the rest.
#[derive(Deserialize)]
struct Label {
    format: String,
    version: u32,
}

/// The program as text, in the coordinates of `frame`: one waypoint per line.
pub fn write(waypoints: &[Waypoint], frame: PathFrame) -> String {
    let rows: Vec<String> = waypoints.iter().map(|w| format!("    {}", line(w))).collect();
    format!(
        "{{\n  \"format\": \"{FORMAT}\",\n  \"version\": {VERSION},\n  \"frame\": \"{}\",\n  \
         \"waypoints\": [\n{}\n  ]\n}}\n",
        frame.name(),
        rows.join(",\n")
    )
}

fn line(waypoint: &Waypoint) -> String {
    let (p, q) = (waypoint.position_mm, waypoint.base_from_torch);
    let row = Row {
        kind: waypoint.kind,
        seam: waypoint.seam,
        weld: waypoint.weld,
        feed_mm_s: rounded(waypoint.feed_mm_s, 1e6),
        position_mm: [p.x, p.y, p.z].map(|v| rounded(v, 1e6)),
        base_from_torch_wxyz: [q.w, q.i, q.j, q.k].map(|v| rounded(v, 1e9)),
        dwell_s: waypoint.dwell_s.map(|v| rounded(v, 1e6)),
    };
    serde_json::json!(row).to_string()
}

/// To the nearest multiple of `1 / per_unit`, and never minus zero.
pub(super) fn rounded(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit + 0.0
}

/// Reads what [`write()`] wrote, or anything of that schema: the waypoints, and whose frame they are in.
///
/// ```
/// use nalgebra::{Point3, UnitQuaternion};
/// use weldpath_method::weld::program::{Kind, Waypoint};
/// use weldpath_job::output::{frame::PathFrame, json};
///
/// let at = |x_mm| Waypoint {
///     position_mm: Point3::new(x_mm, 0.0, 0.0),
///     base_from_torch: UnitQuaternion::identity(),
///     feed_mm_s: 8.0,
///     weld: true,
///     seam: Some(1),
///     kind: Kind::Weld,
///     dwell_s: None,
/// };
/// let program = [at(0.0), at(10.0)];
/// assert_eq!(json::read(&json::write(&program, PathFrame::Base))?, (program.into(), PathFrame::Base));
/// # Ok::<(), json::Error>(())
/// ```
pub fn read(text: &str) -> Result<(Vec<Waypoint>, PathFrame), Error> {
    let Label { format, version } = serde_json::from_str(text)?;
    if format != FORMAT || version != VERSION {
        return Err(Error::Version { format, version });
    }
    let document: Document = serde_json::from_str(text)?;
    let checked = |(index, row)| waypoint(row).map_err(|why| Error::Waypoint { index, why });
    let waypoints: Result<_, Error> = document.waypoints.into_iter().enumerate().map(checked).collect();
    Ok((waypoints?, document.frame))
}

fn waypoint(row: Row) -> Result<Waypoint, String> {
    let [w, x, y, z] = row.base_from_torch_wxyz;
    let q = Quaternion::new(w, x, y, z);
    if (q.norm() - 1.0).abs() > NORM_TOLERANCE {
        return Err(format!("base_from_torch_wxyz has norm {}, not 1", q.norm()));
    }
    if row.feed_mm_s <= 0.0 {
        return Err(format!("feed_mm_s is {}, not above 0", row.feed_mm_s));
    }
    if row.weld != (row.kind == Kind::Weld) || row.weld && row.seam.is_none() {
        return Err(
            "weld belongs to the waypoints of kind \"weld\", which name their seam, and to no others".into(),
        );
    }
    if row.dwell_s.is_some_and(|dwell_s| !(0.0..=MOST_DWELL_S).contains(&dwell_s)) {
        return Err(format!("dwell_s is {}, not 0 to {MOST_DWELL_S}", row.dwell_s.unwrap_or_default()));
    }
    Ok(Waypoint {
        position_mm: Point3::from(row.position_mm),
        base_from_torch: UnitQuaternion::from_quaternion(q),
        feed_mm_s: row.feed_mm_s,
        weld: row.weld,
        seam: row.seam,
        kind: row.kind,
        dwell_s: row.dwell_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn program() -> Vec<Waypoint> {
        let turn = |i: f64| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.37 * i);
        let at = |i: f64, kind| Waypoint {
            position_mm: Point3::new(1_234.567_891 + i, -0.1 * i, 1e-9),
            base_from_torch: turn(i),
            feed_mm_s: 7.3,
            weld: kind == Kind::Weld,
            seam: (kind != Kind::Air).then_some(3),
            kind,
            dwell_s: (kind == Kind::Weld).then_some(0.4),
        };
        vec![at(0.0, Kind::Air), at(1.0, Kind::Approach), at(2.0, Kind::Weld), at(9.0, Kind::Retract)]
    }

    #[test]
    fn a_program_read_back_is_the_program() {
        let (back, frame) = read(&write(&program(), PathFrame::Camera)).unwrap();
        assert_eq!(frame, PathFrame::Camera);
        assert_eq!(back.len(), program().len());
        for (a, b) in program().iter().zip(&back) {
            assert!((a.position_mm - b.position_mm).norm() < 1e-6);
            assert!(a.base_from_torch.angle_to(&b.base_from_torch) < 1e-7);
            let rest = |w: &Waypoint| (w.feed_mm_s, w.weld, w.seam, w.kind, w.dwell_s);
            assert_eq!(rest(a), rest(b));
        }
        assert!(read(&write(&[], PathFrame::Base)).unwrap().0.is_empty());
    }

    #[test]
    fn what_no_robot_could_execute_is_refused_with_its_place() {
        let good = write(&program(), PathFrame::Base);
        for (from, to, why) in [
            ("7.3", "0.0", "waypoint 0 (counted from 0): feed_mm_s"),
            ("\"weld\":true", "\"weld\":false", "waypoint 2"),
            ("[1.0,0.0,0.0,0.0]", "[1.0,1.0,0.0,0.0]", "norm"),
            ("[1.0,0.0,0.0,0.0]", "[1.0,0.0,0.0]", "line"),
            ("1234.567891", "1e999", "line"),
            ("\"dwell_s\":0.4", "\"dwell_s\":-0.4", "waypoint 2 (counted from 0): dwell_s"),
            ("\"dwell_s\":0.4", "\"dwell_s\":1e9", "not 0 to"),
            ("\"feed_mm_s\"", "\"feed_m_s\"", "feed_m_s"),
            ("\"version\": 1", "\"version\": 2", "version 2"),
            ("weldpath-program", "other", "other"),
            ("\"base\"", "\"flange\"", "flange"),
            ("\n  ]\n}", "", "EOF"),
        ] {
            assert!(good.contains(from), "{from}");
            let error = read(&good.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(why), "{to}: {error}");
        }
    }
}
