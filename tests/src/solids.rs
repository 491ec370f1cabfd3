//! Bodies of exact planes, as a CAD program writes them: binary STL, mm.

use std::f32::consts::TAU;
use std::fs;
use std::path::Path;

type Corner = [f32; 3];

/// Bodies, each a closed surface of its own.
#[derive(Debug, Default)]
pub struct Solids(Vec<[Corner; 3]>);

impl Solids {
    fn quad(&mut self, [a, b, c, d]: [Corner; 4]) {
        self.0.extend([[a, b, c], [a, c, d]]);
    }

    /// A box between two corners.
    pub fn cuboid(mut self, low: Corner, high: Corner) -> Self {
        let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { low[axis] } else { high[axis] });
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]] {
            self.quad(face.map(corner));
        }
        self
    }

    /// An upright tube about the z axis: a prism of so many `sides` without its core.
    pub fn tube(mut self, radii: [f32; 2], heights: [f32; 2], sides: usize) -> Self {
        let at = |k: usize, radius: f32, z: f32| {
            let (sin, cos) = (TAU * k as f32 / sides as f32).sin_cos();
            [radius * cos, radius * sin, z]
        };
        let ([inner, outer], [low, high]) = (radii, heights);
        for k in 0..sides {
            let ring = |radius: f32, z: f32| [at(k, radius, z), at((k + 1) % sides, radius, z)];
            for (from, to) in [
                (ring(outer, low), ring(outer, high)),
                (ring(outer, high), ring(inner, high)),
                (ring(inner, high), ring(inner, low)),
                (ring(inner, low), ring(outer, low)),
            ] {
                self.quad([from[0], from[1], to[1], to[0]]);
            }
        }
        self
    }

    /// Writes the file.
    ///
    /// # Panics
    /// If it cannot be written.
    pub fn write(&self, path: &Path) {
        let mut stl = vec![0; 80];
        stl.extend((self.0.len() as u32).to_le_bytes());
        for facet in &self.0 {
            // Without a normal: the order of the corners tells it.
            stl.extend([0; 12]);
            stl.extend(facet.iter().flatten().flat_map(|v| v.to_le_bytes()));
            stl.extend([0; 2]);
        }
        fs::write(path, stl).expect("a file");
    }
}
