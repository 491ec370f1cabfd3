//! Points as the page carries them: 14 bytes each, quantised, little endian, in three columns.
//!
//! First column, four `u16`: x, y, z in steps of [`Layer::step_mm`] from [`Layer::low_mm`], and how far the filter moved
//! the point along its normal, in micrometres about 32768. Second column, four `u8`: the normal in octahedral
//! coordinates, edge intensity with [`INTENSITY_FULL`] at 255, and the view. Third column, two `u8`: the surface, from 1 to 255 and then
//! from 1 again, and the border in the order of [`Border::ALL`], from 1; 0 is none.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use weldpath_method::seam::segmentation::Border;

/// Edge intensity that fills the byte; few corners reach it.
pub(super) const INTENSITY_FULL: f32 = 0.5;
/// `most` of `count` indices, or all; one from each of as many equal stretches, at a place that looks random: an even
/// stride would draw stripes across the rows of a depth image.
pub(super) fn even_sample(count: usize, most: usize) -> impl Iterator<Item = usize> {
    let picks = count.min(most);
    let begin = move |k: usize| (k as u64 * count as u64 / picks.max(1) as u64) as usize;
    (0..picks).map(move |k| begin(k) + (k.wrapping_mul(2_654_435_761) >> 7) % (begin(k + 1) - begin(k)))
}

/// Bytes of a point in all columns.
#[cfg(test)]
const POINT_BYTES: usize = 14;
/// A displacement of 0.
const NOT_MOVED: f32 = 32_768.0;

/// A point to be packed; positions are relative to the layer's origin.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Sample {
    pub(super) position_mm: Point3<f32>,
    pub(super) normal: Vector3<f32>,
    pub(super) moved_mm: f32,
    pub(super) intensity: f32,
    pub(super) view: u16,
    /// As the page has it.
    pub(super) surface: u8,
    /// As the page has it.
    pub(super) border: u8,
}

/// Number of a surface in the page; 0 is none.
pub(super) fn surface_number(surface: Option<u16>) -> u8 {
    surface.map_or(0, |surface| (1 + surface % u16::from(u8::MAX)) as u8)
}

/// Number of a border in the page; 0 is none.
pub(super) fn border_number(border: Option<Border>) -> u8 {
    let place = |border| Border::ALL.iter().position(|other| *other == border).map_or(0, |k| 1 + k as u8);
    border.map_or(0, place)
}

/// Box in which positions are quantised, mm, relative to an origin in the base frame.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Frame {
    pub(super) origin_mm: Point3<f64>,
    pub(super) low_mm: Point3<f32>,
    pub(super) step_mm: f32,
}

impl Frame {
    /// The box of `points`, grown by `margin` of its diagonal on every side.
    pub(super) fn around(origin_mm: Point3<f64>, points: &[Point3<f32>], margin: f32) -> Self {
        let first = points.first().copied().unwrap_or_default();
        let (low, high) = points.iter().fold((first, first), |(low, high), p| {
            (low.coords.inf(&p.coords).into(), high.coords.sup(&p.coords).into())
        });
        let grow = Vector3::repeat(margin * (high - low).norm() + 1.0);
        let extent = high - low + 2.0 * grow;
        Self { origin_mm, low_mm: low - grow, step_mm: extent.max() / f32::from(u16::MAX) }
    }

    /// Whether a point can be expressed.
    pub(super) fn holds(&self, p: &Point3<f32>) -> bool {
        let steps = (p - self.low_mm) / self.step_mm;
        steps.iter().all(|s| (0.0..=f32::from(u16::MAX)).contains(s))
    }
}

/// Where a layer lies in the binary block, and how to read it.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Layer {
    count: usize,
    /// Of how many points these are an even sample.
    of: usize,
    low_mm: [f64; 3],
    step_mm: f64,
    positions_at: usize,
    attributes_at: usize,
    surfaces_at: usize,
}

/// Appends a layer to the binary block.
pub(super) fn pack(frame: &Frame, samples: &[Sample], of: usize, block: &mut Vec<u8>) -> Layer {
    let low_mm = frame.origin_mm + frame.low_mm.coords.cast::<f64>();
    let positions_at = block.len();
    for s in samples {
        let steps = (s.position_mm - frame.low_mm) / frame.step_mm;
        let moved = NOT_MOVED + 1e3 * s.moved_mm;
        // Float to integer conversion saturates.
        block
            .extend([steps.x, steps.y, steps.z, moved].iter().flat_map(|v| (v.round() as u16).to_le_bytes()));
    }
    let attributes_at = block.len();
    for s in samples {
        let [u, v] = octahedral(&s.normal);
        let intensity = (255.0 * s.intensity / INTENSITY_FULL).round() as u8;
        block.extend([u, v, intensity, s.view.min(255) as u8]);
    }
    let surfaces_at = block.len();
    block.extend(samples.iter().flat_map(|s| [s.surface, s.border]));
    let step_mm = f64::from(frame.step_mm);
    let count = samples.len();
    Layer { count, of, low_mm: low_mm.into(), step_mm, positions_at, attributes_at, surfaces_at }
}

/// A unit vector folded onto a square (Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit
/// Vectors"): error below 1 degree.
fn octahedral(n: &Vector3<f32>) -> [u8; 2] {
    let sum = n.x.abs() + n.y.abs() + n.z.abs();
    if sum <= 0.0 {
        return [128, 128];
    }
    let (u, v) = (n.x / sum, n.y / sum);
    let sign = |x: f32| if x < 0.0 { -1.0 } else { 1.0 };
    let (u, v) = if n.z < 0.0 { ((1.0 - v.abs()) * sign(u), (1.0 - u.abs()) * sign(v)) } else { (u, v) };
    [u, v].map(|c| (127.5 + 127.5 * c).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(position_mm: [f32; 3], normal: Vector3<f32>) -> Sample {
        Sample {
            position_mm: position_mm.into(),
            normal,
            moved_mm: -0.25,
            intensity: 0.25,
            view: 3,
            surface: surface_number(Some(255)),
            border: border_number(Some(Border::Unseen)),
        }
    }

    #[test]
    fn positions_come_back_within_a_step() {
        let points: Vec<Point3<f32>> = (0..50).map(|i| Point3::new(i as f32, 0.3 * i as f32, 7.0)).collect();
        let frame = Frame::around(Point3::new(1000.0, 0.0, 0.0), &points, 0.1);
        let samples: Vec<Sample> = points.iter().map(|p| sample((*p).into(), Vector3::z())).collect();
        let mut block = Vec::new();
        let layer = pack(&frame, &samples, 50, &mut block);
        assert_eq!(block.len(), 50 * POINT_BYTES);
        for (i, p) in points.iter().enumerate() {
            let at = |k: usize| u16::from_le_bytes([block[8 * i + 2 * k], block[8 * i + 2 * k + 1]]);
            for k in 0..3 {
                let back_mm = layer.low_mm[k] + f64::from(at(k)) * layer.step_mm;
                let true_mm = f64::from(p[k]) + if k == 0 { 1000.0 } else { 0.0 };
                assert!((back_mm - true_mm).abs() <= layer.step_mm);
            }
            assert_eq!(at(3), 32_768 - 250);
            assert_eq!(block[layer.attributes_at + 4 * i + 2..][..2], [128, 3]);
            assert_eq!(block[layer.surfaces_at + 2 * i..][..2], [1, 7]);
        }
    }

    #[test]
    fn normals_come_back_within_a_degree_and_a_half() {
        for i in 0..500 {
            let (z, turn) = (-1.0 + 2.0 * i as f32 / 499.0, 2.4 * i as f32);
            let r = (1.0 - z * z).max(0.0).sqrt();
            let n = Vector3::new(r * turn.cos(), r * turn.sin(), z);
            let [u, v] = octahedral(&n).map(|c| f32::from(c) / 127.5 - 1.0);
            let mut back = Vector3::new(u, v, 1.0 - u.abs() - v.abs());
            if back.z < 0.0 {
                let fold = |a: f32, b: f32| (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 };
                (back.x, back.y) = (fold(u, v), fold(v, u));
            }
            assert!(back.normalize().angle(&n).to_degrees() < 1.5, "{n:?}");
        }
    }

    #[test]
    fn a_point_outside_the_box_is_not_held() {
        let frame = Frame::around(Point3::origin(), &[Point3::origin(), Point3::new(10.0, 0.0, 0.0)], 0.1);
        assert!(frame.holds(&Point3::new(-1.0, 0.0, 0.0)));
        assert!(!frame.holds(&Point3::new(-100.0, 0.0, 0.0)));
        assert!(!frame.holds(&Point3::new(1e30, 0.0, 0.0)));
    }
}
