//! `[scan.calibration]`: what `weldpath calibrate` found of a cell, which is taken out of its scans.

use std::path::Path;

use nalgebra::{Isometry3, SMatrix, UnitQuaternion};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::refusal::{self, CALIBRATION_HINT, Error};
use weldpath_files::reading;
use weldpath_method::pipeline::{Calibration, CameraErrors};

/// Unknowns of a calibration.
const SHARED: usize = 11;
/// No camera that is worth calibrating is off by more: as a share or rad; k1; its place, mm.
const MOST: f64 = 0.2;
const MOST_K1: f64 = 1.0;
const MOST_MM: f64 = 100.0;

/// `[scan.calibration]`, and the whole of a `calibration.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Calibration")]
pub struct CalibrationSettings {
    /// Position of the camera in the frame where the hand-eye transform puts it.
    pub camera_shift_mm: [f64; 3],
    /// Rotation vector of the same.
    pub camera_turn_rad: [f64; 3],
    /// Depths are too large by this share.
    pub depth_scale: f64,
    /// The focal length is larger than stated by this share.
    pub focal: f64,
    /// The optical axis is this far from where it is stated, in focal lengths: columns, rows.
    pub centre: [f64; 2],
    /// First radial coefficient beyond the stated.
    pub k1: f64,
    /// Lower triangle, row by row, of the covariance of turn, rad, shift, mm, depth scale, focal length, centre (two), k1.
    pub covariance: Vec<Vec<f64>>,
}

impl From<&Calibration> for CalibrationSettings {
    fn from(found: &Calibration) -> Self {
        let motion = &found.camera_from_corrected;
        let CameraErrors { depth_scale, focal, centre, k1 } = found.camera;
        Self {
            camera_shift_mm: motion.translation.vector.into(),
            camera_turn_rad: motion.rotation.scaled_axis().into(),
            depth_scale,
            focal,
            centre,
            k1,
            covariance: (0..SHARED).map(|r| (0..=r).map(|c| found.covariance[(r, c)]).collect()).collect(),
        }
    }
}

impl CalibrationSettings {
    /// Reads a `calibration.toml`.
    ///
    /// # Errors
    /// If it cannot be read, or is none.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = reading::text(path, reading::MOST_JOB)
            .map_err(|error| Error::Unreadable { path: path.into(), why: error.to_string() })?;
        let read: Self = toml::from_str(&text)
            .map_err(|error| refusal::of_toml(&text, path, &error).with_hint(CALIBRATION_HINT))?;
        match read.fault() {
            None => Ok(read),
            Some((key, why)) => {
                Err(refusal::of_key(&text, path, key, &format!("{key}: {why}"), CALIBRATION_HINT))
            }
        }
    }

    /// The text of a `calibration.toml`.
    pub fn to_toml(&self) -> String {
        // Numbers alone: every one has a TOML form.
        toml::to_string(self).unwrap_or_default()
    }

    /// As the pipeline takes it.
    pub fn calibration(&self) -> Calibration {
        let turn = UnitQuaternion::from_scaled_axis(self.camera_turn_rad.into());
        let shift: nalgebra::Vector3<f64> = self.camera_shift_mm.into();
        let entry = |r: usize, c: usize| self.covariance[r.max(c)][r.min(c)];
        Calibration {
            camera_from_corrected: Isometry3::from_parts(shift.into(), turn),
            camera: CameraErrors {
                depth_scale: self.depth_scale,
                focal: self.focal,
                centre: self.centre,
                k1: self.k1,
            },
            covariance: SMatrix::from_fn(entry),
        }
    }

    /// A key whose value no calibration has, and why.
    pub(super) fn fault(&self) -> Option<(&'static str, String)> {
        let share = |key, value: f64, most: f64| {
            let is_usual = value.abs() <= most;
            (!is_usual).then(|| (key, format!("{value} is not -{most} to {most}")))
        };
        let [column, row] = self.centre;
        let values = [
            self.camera_shift_mm.iter().find_map(|&mm| share("camera_shift_mm", mm, MOST_MM)),
            self.camera_turn_rad.iter().find_map(|&rad| share("camera_turn_rad", rad, MOST)),
            share("depth_scale", self.depth_scale, MOST),
            share("focal", self.focal, MOST),
            share("centre", column, MOST),
            share("centre", row, MOST),
            share("k1", self.k1, MOST_K1),
        ];
        if let Some(fault) = values.into_iter().flatten().next() {
            return Some(fault);
        }
        let lengths: Vec<usize> = self.covariance.iter().map(Vec::len).collect();
        if lengths != (1..=SHARED).collect::<Vec<_>>() {
            return Some(("covariance", format!("{SHARED} rows of 1 to {SHARED} numbers are needed")));
        }
        let is_covariance = self.covariance.iter().flatten().all(|value| value.is_finite())
            && self.calibration().covariance.cholesky().is_some();
        (!is_covariance).then(|| ("covariance", "it is not a covariance: not positive definite".into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weldpath_method::pipeline::CellAccuracy;

    fn some() -> CalibrationSettings {
        let mut calibration = Calibration::unknown(CellAccuracy::default());
        calibration.camera.focal = 0.004;
        calibration.covariance[(7, 5)] = 1e-4;
        calibration.covariance[(5, 7)] = 1e-4;
        CalibrationSettings::from(&calibration)
    }

    #[test]
    fn a_calibration_survives_its_file() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("calibration.toml");
        std::fs::write(&path, some().to_toml()).unwrap();
        let read = CalibrationSettings::read(&path).unwrap();
        assert_eq!(read, some());
        assert_eq!(CalibrationSettings::from(&read.calibration()), some());
    }

    #[test]
    fn what_is_no_calibration_is_refused_with_its_line() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("calibration.toml");
        for (from, to, why) in [
            ("focal = 0.004", "focal = 4.0", "focal"),
            ("focal = 0.004", "focal = nan", "NaN"),
            ("k1 = 0.0", "k2 = 0.0", "k2"),
            ("covariance = [[", "covariance = [[1.0], [", "rows"),
            ("covariance = [[", "covariance = [[-", "positive"),
        ] {
            let text = some().to_toml();
            assert!(text.contains(from), "{text}");
            std::fs::write(&path, text.replace(from, to)).unwrap();
            let error = CalibrationSettings::read(&path).unwrap_err().to_string();
            assert!(error.contains(why) && error.contains("calibration.toml"), "{from} {to}: {error}");
        }
    }
}
