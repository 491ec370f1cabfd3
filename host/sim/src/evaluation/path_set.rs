//! Torch paths as they stand in a CSV file: columns by name, millimetres, base frame.

use super::Error;
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use std::collections::HashMap;
use std::path::Path;
use weldpath_files::reading;

/// One or more torch paths, point after point.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PathSet {
    /// Positions, mm.
    pub points_mm: Vec<Vector3<f64>>,
    /// Torch frames, columns `(o, m, n)`, `n` out of the work; one per point, if the file has them.
    pub frames: Option<Vec<Matrix3<f64>>>,
    /// Name of the seam that each point belongs to, if the file has it.
    pub seams: Option<Vec<String>>,
}

/// Without a seam column, a step longer than this begins another path, mm.
const GAP_MM: f64 = 15.0;
/// A path has at most this many points: scoring compares each with every true station.
const MAX_POINTS: usize = 200_000;
const POSITION: [&str; 3] = ["x_mm", "y_mm", "z_mm"];
const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];
const ROTATION_VECTOR: [&str; 3] = ["rx", "ry", "rz"];

impl PathSet {
    /// Reads a CSV file with columns `x_mm,y_mm,z_mm`, and perhaps `qw,qx,qy,qz` or `rx,ry,rz` (radians) and `seam`.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let bytes = reading::bytes(path, reading::MOST_RESULT)
            .map_err(|source| Error::Read { path: path.into(), source })?;
        Self::parse(&bytes, path)
    }

    /// The same from bytes; `path` is for messages.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, Error> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
        let malformed = |place: String, reason: String| Error::Malformed { path: path.into(), place, reason };
        let header = reader.headers().map_err(|e| malformed("header".into(), e.to_string()))?.clone();
        let columns = Columns::of(&header).map_err(|reason| malformed("header".into(), reason))?;
        let mut paths = Self {
            points_mm: Vec::new(),
            frames: columns.rotation.is_some().then(Vec::new),
            seams: columns.seam.is_some().then(Vec::new),
        };
        for record in reader.records() {
            let record = record.map_err(|e| malformed("row".into(), e.to_string()))?;
            let line = record.position().map_or(0, csv::Position::line);
            if paths.points_mm.len() == MAX_POINTS {
                return Err(malformed(format!("line {line}"), format!("more than {MAX_POINTS} points")));
            }
            paths.push(&record, &columns).map_err(|reason| malformed(format!("line {line}"), reason))?;
        }
        Ok(paths)
    }

    fn push(&mut self, record: &csv::StringRecord, columns: &Columns) -> Result<(), String> {
        let [x, y, z] = numbers(record, columns.position)?;
        self.points_mm.push(Vector3::new(x, y, z));
        if let (Some(frames), Some(rotation)) = (&mut self.frames, &columns.rotation) {
            frames.push(rotation.frame(record)?);
        }
        if let (Some(seams), Some(column)) = (&mut self.seams, columns.seam) {
            seams.push(record.get(column).unwrap_or_default().to_owned());
        }
        Ok(())
    }

    /// The points of the seam with this name.
    pub fn of_seam(&self, name: &str) -> Self {
        let is_own = |i: &usize| self.seams.as_ref().is_some_and(|seams| seams[*i] == name);
        let own: Vec<usize> = (0..self.points_mm.len()).filter(is_own).collect();
        Self {
            points_mm: own.iter().map(|&i| self.points_mm[i]).collect(),
            frames: self.frames.as_ref().map(|frames| own.iter().map(|&i| frames[i]).collect()),
            seams: self.seams.as_ref().map(|seams| own.iter().map(|&i| seams[i].clone()).collect()),
        }
    }

    /// Points with a stand-off along the torch axis taken away.
    pub(super) fn without_standoff(&self, standoff_mm: f64) -> Vec<Vector3<f64>> {
        match &self.frames {
            Some(frames) if standoff_mm != 0.0 => self
                .points_mm
                .iter()
                .zip(frames)
                .map(|(p, frame)| p - frame.column(2) * standoff_mm)
                .collect(),
            _ => self.points_mm.clone(),
        }
    }

    /// The same paths on the seams that they were offset from by `standoff_mm`.
    pub fn on_seams(&self, standoff_mm: f64) -> Self {
        Self { points_mm: self.without_standoff(standoff_mm), ..self.clone() }
    }

    /// A number for each point that is the same along one path.
    pub(super) fn runs(&self) -> Vec<usize> {
        if let Some(seams) = &self.seams {
            let mut known = HashMap::new();
            return seams
                .iter()
                .map(|name| {
                    let next = known.len();
                    *known.entry(name.as_str()).or_insert(next)
                })
                .collect();
        }
        let mut run = 0;
        let begins = self.points_mm.windows(2).map(|w| (w[1] - w[0]).norm() > GAP_MM);
        std::iter::once(false)
            .chain(begins)
            .take(self.points_mm.len())
            .map(|begins| {
                run += usize::from(begins);
                run
            })
            .collect()
    }
}

struct Columns {
    position: [usize; 3],
    rotation: Option<Rotation>,
    seam: Option<usize>,
}

enum Rotation {
    Quaternion([usize; 4]),
    Vector([usize; 3]),
}

impl Columns {
    fn of(header: &csv::StringRecord) -> Result<Self, String> {
        let find = |name: &str| header.iter().position(|column| column == name);
        let position = all(POSITION.map(find)).ok_or_else(|| {
            let found: Vec<&str> = header.iter().collect();
            format!("needs the columns x_mm, y_mm, z_mm (millimetres); found: {}", found.join(", "))
        })?;
        let quaternion = all(QUATERNION.map(find)).map(Rotation::Quaternion);
        let rotation = quaternion.or_else(|| all(ROTATION_VECTOR.map(find)).map(Rotation::Vector));
        Ok(Self { position, rotation, seam: find("seam") })
    }
}

impl Rotation {
    fn frame(&self, record: &csv::StringRecord) -> Result<Matrix3<f64>, String> {
        let turn = match self {
            Self::Quaternion(columns) => {
                let [w, x, y, z] = numbers(record, *columns)?;
                let q = Quaternion::new(w, x, y, z);
                UnitQuaternion::try_new(q, 1e-9).ok_or("the quaternion qw, qx, qy, qz has no length")?
            }
            Self::Vector(columns) => {
                let [x, y, z] = numbers(record, *columns)?;
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_scaled_axis(Vector3::new(x, y, z)))
            }
        };
        Ok(turn.to_rotation_matrix().into_inner())
    }
}

fn all<const N: usize>(found: [Option<usize>; N]) -> Option<[usize; N]> {
    let missing = found.iter().any(Option::is_none);
    (!missing).then(|| found.map(Option::unwrap_or_default))
}

fn numbers<const N: usize>(record: &csv::StringRecord, columns: [usize; N]) -> Result<[f64; N], String> {
    let mut values = [0.0; N];
    for (value, column) in values.iter_mut().zip(columns) {
        let text = record.get(column).unwrap_or_default();
        let number: f64 = text.parse().map_err(|_| format!("`{text}` is not a number"))?;
        // Beyond a kilometre nothing is a weld; squares of such numbers still are finite.
        if !number.is_finite() || number.abs() > 1e6 {
            return Err(format!("{text} is not a position in millimetres or a rotation"));
        }
        *value = number;
    }
    Ok(values)
}
