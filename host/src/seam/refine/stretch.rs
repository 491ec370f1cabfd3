//! From single stations to one smooth seam (ours): what is trusted of them, the stretch that holds together, the curve.

use crate::geometry::statistics::median;
use crate::seam::refine::smooth::Samples;
use crate::seam::refine::{Config, Path, Refined, Section, Station, cross_section, frames, resampled};
use nalgebra::{Vector2, Vector3};
use std::ops::Range;

/// Stations without outliers, in one stretch, smoothed.
pub(in crate::seam) fn smoothed(
    path: &Path,
    stations: &[Option<Station>],
    inside: Range<usize>,
    section: &Section,
    voxel_mm: f32,
    config: &Config,
) -> Option<Refined> {
    let mut good = trusted(&present(stations), voxel_mm);
    good.iter_mut().enumerate().for_each(|(k, g)| *g &= inside.contains(&k));
    let longest_gap = (config.gap * voxel_mm / path.step_mm) as usize;
    let (from, to) = if path.closed { (0, good.len()) } else { longest_run(&good, longest_gap)? };
    let kept = &stations[from..to];
    let good = &good[from..to];
    if good.iter().filter(|g| **g).count() < 6 {
        return None;
    }
    let mut places = Vec::with_capacity(kept.len());
    let mut normals = Vec::with_capacity(kept.len());
    let mut weights = Vec::with_capacity(kept.len());
    for (k, station) in kept.iter().enumerate() {
        let frame = &path.frames[from + k];
        let (o, n) = cross_section(frame);
        let lift = |v: &Vector2<f64>| (o * v.x as f32 + n * v.y as f32).cast::<f64>();
        let (place, faces) = match station {
            Some(s) if good[k] => (lift(&s.across), [lift(&s.normals[0]), lift(&s.normals[1])]),
            _ => (Vector3::zeros(), frame.faces.map(|f| f.cast())),
        };
        let p = frame.position.coords.cast::<f64>() + place;
        places.push([p.x, p.y, p.z]);
        normals.push([faces[0].x, faces[0].y, faces[0].z, faces[1].x, faces[1].y, faces[1].z]);
        let one_sided = station.as_ref().map_or(0.0, |s| {
            let balance = s.fits.iter().map(|f| f.support.1.min(-f.support.0)).fold(f64::MAX, f64::min);
            if path.closed {
                1.0
            } else {
                (balance / f64::from(section.half_mm)).clamp(0.0, 1.0).powi(2).max(0.03)
            }
        });
        weights.push(if good[k] { one_sided } else { 0.0 });
    }
    let step_mm = f64::from(path.step_mm);
    let block_mm = f64::from(2.0 * section.half_mm);
    let line = Samples { values: &places, weights: &weights, step_mm, closed: path.closed };
    let tilt = Samples { values: &normals, weights: &weights, step_mm, closed: path.closed };
    let curve = line.stiffest(block_mm);
    let smooth_places = line.smooth(curve);
    let freedom = curve.freedom(path.closed, step_mm * places.len() as f64, step_mm);
    let smooth_normals = tilt.smooth(tilt.stiffest(block_mm));
    let rows: Vec<[f64; 9]> = smooth_places
        .iter()
        .zip(&smooth_normals)
        .map(|(p, n)| [p[0], p[1], p[2], n[0], n[1], n[2], n[3], n[4], n[5]])
        .collect();
    let rows = if path.closed { rows } else { section.trim(rows, from as f32 * path.step_mm, path.step_mm) };
    let (rows, new_step_mm) = resampled(&rows, path.closed, path.step_mm);
    let frames = frames(&rows, path.closed)?;
    let misses = |curve: &[[f64; 3]]| -> f64 {
        let mut d: Vec<f64> = curve
            .iter()
            .zip(&places)
            .zip(good)
            .filter(|(_, g)| **g)
            .map(|((a, b), _)| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt())
            .collect();
        median(&mut d)
    };
    let scatter_mm = misses(&smooth_places);
    let fits = || kept.iter().flatten().flat_map(|s| s.fits);
    let sigma_mm = median(&mut fits().map(|f| f.sigma).collect::<Vec<_>>());
    let tilt_rad = median(&mut fits().map(|f| f.sigma * (5.5 * f.slope_variance).sqrt()).collect::<Vec<_>>());
    // Shares are indexed by old stations; after resampling the nearest serves.
    let shares: Vec<[Vec<f32>; 2]> = (0..frames.len())
        .map(|k| {
            let old = (k * kept.len() / frames.len()).min(kept.len() - 1);
            let beside = |by: usize| old.checked_sub(by).into_iter().chain([old + by]);
            let near = (0..kept.len()).flat_map(beside).find_map(|j| kept.get(j)?.as_ref());
            near.map(|s| s.view_share.clone()).unwrap_or_default()
        })
        .collect();
    let measured =
        (0..frames.len()).map(|k| good[(k * good.len() / frames.len()).min(good.len() - 1)]).collect();
    Some(Refined {
        frames,
        step_mm: new_step_mm,
        closed: path.closed,
        measured,
        sigma_mm,
        scatter_mm,
        tilt_rad,
        reach_mm: section.reach_mm,
        window_mm: 2.0 * section.half_mm * 0.6,
        freedom,
        view_share: shares,
        near: Vec::new(),
    })
}

/// Stations that have a fair share of points on both faces; the rest is beyond the end of the seam, or in a gap.
fn present(stations: &[Option<Station>]) -> Vec<Option<&Station>> {
    const FAIR_SHARE: f64 = 0.25;
    let usual = |f: usize| {
        let mut counts: Vec<f64> = stations.iter().flatten().map(|s| s.present[f] as f64).collect();
        median(&mut counts)
    };
    let least = [FAIR_SHARE * usual(0), FAIR_SHARE * usual(1)];
    let fair =
        |s: &&Station| s.present[0] as f64 >= least[0].max(1.0) && s.present[1] as f64 >= least[1].max(1.0);
    stations.iter().map(|s| s.as_ref().filter(fair)).collect()
}

/// Stations whose correction is near that of their neighbours.
fn trusted(stations: &[Option<&Station>], voxel_mm: f32) -> Vec<bool> {
    let far = 3.3 * f64::from(voxel_mm);
    let mut good: Vec<bool> =
        stations.iter().map(|s| s.as_ref().is_some_and(|s| s.across.norm() < far)).collect();
    for axis in 0..2 {
        let index: Vec<usize> = (0..good.len()).filter(|&k| good[k]).collect();
        let value: Vec<f64> = index.iter().map(|&k| stations[k].map_or(0.0, |s| s.across[axis])).collect();
        let running: Vec<f64> = (0..value.len())
            .map(|k| median(&mut value[k.saturating_sub(4)..(k + 5).min(value.len())].to_vec()))
            .collect();
        let mut misses: Vec<f64> = value.iter().zip(&running).map(|(v, r)| (v - r).abs()).collect();
        let limit = (0.3 * f64::from(voxel_mm)).max(5.0 * 1.4826 * median(&mut misses.clone()));
        for (&k, miss) in index.iter().zip(misses.drain(..)) {
            good[k] &= miss <= limit;
        }
    }
    good
}

/// The longest stretch of good stations whose gaps are at most `gap` stations long.
pub(in crate::seam) fn longest_run(good: &[bool], gap: usize) -> Option<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for k in (0..good.len()).filter(|&k| good[k]) {
        match runs.last_mut() {
            Some(run) if k - run.1 <= gap + 1 => run.1 = k,
            _ => runs.push((k, k)),
        }
    }
    runs.into_iter().map(|(a, b)| (a, b + 1)).max_by_key(|(a, b)| b - a)
}
