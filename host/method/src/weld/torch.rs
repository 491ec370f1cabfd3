//! Torch poses along a seam (paper II-F): core's frame at every station.

use crate::seam::{Seam, Station};
use crate::weld::{PathPoint, Process, SeamPath};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use weldpath_core::Direction;
use weldpath_core::path::torch;

impl SeamPath {
    /// One pose per station, the torch along the bisector of the adjoining faces; a closed path ends where it began.
    /// A station without a torch frame is left out.
    pub fn along(seam: &Seam) -> Self {
        let ends = seam.stations.iter().chain(seam.stations.first().filter(|_| seam.closed));
        let mut points: Vec<PathPoint> = Vec::with_capacity(seam.stations.len() + 1);
        for station in ends {
            let Some(mut base_from_torch) = orientation(station) else { continue };
            let mut s_mm = 0.0;
            if let Some(before) = points.last() {
                s_mm = before.s_mm + (station.position_mm - before.position_mm).norm();
                if before.base_from_torch.coords.dot(&base_from_torch.coords) < 0.0 {
                    base_from_torch = UnitQuaternion::new_unchecked(-base_from_torch.into_inner());
                }
            }
            let process = Process::default();
            points.push(PathPoint { s_mm, position_mm: station.position_mm, base_from_torch, process });
        }
        Self { seam: seam.id, points }
    }
}

fn orientation(station: &Station) -> Option<UnitQuaternion<f64>> {
    let normal = Direction::new_unchecked(station.bisector()?.cast::<f32>());
    let travel: Vector3<f32> = station.tangent.cast();
    let q = torch::orientation(normal, &travel).ok()?;
    let wide = q.into_inner().coords.cast::<f64>();
    Some(UnitQuaternion::from_quaternion(Quaternion::from_vector(wide)))
}
