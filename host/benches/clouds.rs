//! Clouds of known shape and density for the benchmarks, the same in every run and on every machine.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Standard deviation of the noise of every coordinate, mm.
const NOISE_MM: f64 = 0.3;
/// A V butt joint: 500 mm long, plates 100 mm wide on either side, 60 degrees, 10 mm deep, root gap 2 mm.
const LENGTH_MM: f64 = 500.0;
const PROFILE_MM: [[f64; 2]; 6] =
    [[-100.0, 0.0], [-6.7735, 0.0], [-1.0, -10.0], [1.0, -10.0], [6.7735, 0.0], [100.0, 0.0]];

/// Radius that holds about 30 neighbours on the V butt joint, mm.
pub fn radius_mm(points: usize) -> f32 {
    let area = LENGTH_MM * sides().iter().sum::<f64>();
    (30.0 * area / (std::f64::consts::PI * points as f64)).sqrt() as f32
}

/// The V butt joint, evenly and at random over its surface.
pub fn butt_joint(points: usize) -> Vec<Point3<f32>> {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let sides = sides();
    let all: f64 = sides.iter().sum();
    let place = |_| {
        let (mut along, mut side) = (random.uniform() * all, 0);
        while side < 4 && along > sides[side] {
            along -= sides[side];
            side += 1;
        }
        let share = along / sides[side];
        let [y, z] = [0, 1].map(|k| PROFILE_MM[side][k] * (1.0 - share) + PROFILE_MM[side + 1][k] * share);
        let x = random.uniform() * LENGTH_MM;
        (Vector3::new(x, y, z) + random.noise()).cast::<f32>().into()
    };
    (0..points).map(place).collect()
}

fn sides() -> [f64; 5] {
    std::array::from_fn(|k| {
        let ([a, b], [c, d]) = (PROFILE_MM[k], PROFILE_MM[k + 1]);
        (c - a).hypot(d - b)
    })
}

/// Two views of a tilted tube on a plate, all six motions of which show in the distances along normals, and the motion
/// that takes the source onto the target.
pub struct Pair {
    /// Seen by the first camera.
    pub target: Vec<Point3<f32>>,
    /// Seen by the second, moved.
    pub source: Vec<Point3<f32>>,
    /// The motion.
    pub target_from_source: Isometry3<f64>,
    /// Where the target and the source, before it was moved, were seen from.
    pub cameras_mm: [Vector3<f64>; 2],
}

/// A pair 60 degrees apart in a general pose, the source moved by 2 mm and 0.5 degrees.
pub fn pipe_pair(points: usize) -> Pair {
    let turn = |axis: [f64; 3], degrees: f64| {
        UnitQuaternion::from_scaled_axis(Vector3::from(axis).normalize() * degrees.to_radians())
    };
    let base = Isometry3::from_parts(Translation3::new(300.0, -120.0, 450.0), turn([1.0, 2.0, 0.5], 37.0));
    let toward = Vector3::new(0.5, 0.3, 0.8).normalize();
    let views = [toward, turn([0.0, 0.0, 1.0], 60.0) * toward];
    let [target, source] = [0, 1].map(|k| {
        let mut random = Random(0x9E37_79B9_7F4A_7C15 + 1_234_567 * k as u64);
        let seen: Vec<Point3<f64>> =
            (0..points).map(|_| base * (tube_on_plate(&mut random, &views[k]) + random.noise())).collect();
        seen
    });
    let centre = source.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points as f64;
    let shift = Vector3::new(1.0, -2.0, 1.5).normalize() * 2.0;
    let about = |v: Vector3<f64>| Isometry3::from_parts(Translation3::from(v), UnitQuaternion::identity());
    let moved = about(centre + shift)
        * Isometry3::from_parts(Translation3::identity(), turn([0.3, -0.5, 0.8], 0.5))
        * about(-centre);
    Pair {
        cameras_mm: views.map(|toward| (base * Point3::from(toward * 600.0)).coords),
        target: target.iter().map(|p| p.cast()).collect(),
        source: source.iter().map(|p| (moved * p).cast()).collect(),
        target_from_source: moved.inverse(),
    }
}

/// A place on a plate of 200 mm, or on a tube of 30 mm radius tilted by 30 degrees, that faces the viewer.
fn tube_on_plate(random: &mut Random, toward: &Vector3<f64>) -> Point3<f64> {
    const RADIUS_MM: f64 = 30.0;
    const ON_PLATE: f64 = 40_000.0 / (40_000.0 + std::f64::consts::TAU * RADIUS_MM * 140.0);
    let axis = Vector3::new(0.5, 0.0, 0.75f64.sqrt());
    let (u, v) = (Vector3::y().cross(&axis), Vector3::y());
    loop {
        if random.uniform() < ON_PLATE {
            let p = Vector3::new(random.uniform() - 0.5, random.uniform() - 0.5, 0.0) * 200.0;
            if (p - axis * p.dot(&axis)).norm() > RADIUS_MM {
                return p.into();
            }
        } else {
            let (s, c) = (std::f64::consts::TAU * random.uniform()).sin_cos();
            let normal = u * c + v * s;
            let p = normal * RADIUS_MM + axis * (140.0 * random.uniform() - 20.0);
            if p.z > 0.0 && normal.dot(toward) > 0.2 {
                return p.into();
            }
        }
    }
}

/// The V butt joint as binary little-endian PLY, mm.
pub fn ply(points: &[Point3<f32>]) -> Vec<u8> {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment length unit = mm\nelement vertex {}\nproperty float x\nproperty \
         float y\nproperty float z\nend_header\n",
        points.len()
    );
    header.into_bytes().into_iter().chain(bytes(points)).collect()
}

/// The V butt joint as binary PCD.
pub fn pcd(points: &[Point3<f32>]) -> Vec<u8> {
    let n = points.len();
    let header = format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 \
         0 0 0\nPOINTS {n}\nDATA binary\n"
    );
    header.into_bytes().into_iter().chain(bytes(points)).collect()
}

fn bytes(points: &[Point3<f32>]) -> impl Iterator<Item = u8> + '_ {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).flat_map(f32::to_le_bytes)
}

/// Xorshift: enough for surfaces and noise.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Isotropic Gaussian noise, mm (Box and Muller).
    fn noise(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| {
            let size = (-2.0 * self.uniform().max(f64::MIN_POSITIVE).ln()).sqrt();
            NOISE_MM * size * (std::f64::consts::TAU * self.uniform()).cos()
        })
    }
}
