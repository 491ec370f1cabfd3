//! The plane that the work rests on: the table (ours).
//!
//! Where a plate lies on the table, its edge makes a true inside corner that nobody welds; only knowing the table tells
//! it apart. The support is the largest plane that has (almost) nothing behind it.

use crate::geometry::cloud::PointCloud;
use crate::geometry::plane::Moments;
use crate::geometry::statistics::DEVIATION_OF_MEDIAN;
use crate::geometry::table::{self, Rim};
use crate::model::downsampling::Voxels;
use crate::seam::input::{RawScan, Seen};
use nalgebra::{Matrix2, Point3, Vector2, Vector3};
use rayon::prelude::*;
use std::collections::HashSet;

// All chosen on the simulated scans, unless told otherwise.

/// Least share of all points that the support holds.
const LEAST_SHARE: f32 = 0.15;
/// Largest share of all points that may lie behind it, and from how far behind they do, half thicknesses.
const MOST_BEHIND: f32 = 0.01;
const BEHIND_HALVES: f32 = 3.0;

/// Directions of normals are counted in bins of this many to a unit; of the most common, so many are tried.
const BINS_PER_UNIT: f32 = 5.0;
const BINS: usize = 2 * BINS_PER_UNIT as usize + 1;
const DIRECTIONS: usize = 6;
/// Cosine within which a point faces as the plane does; of a face that may be the support, which is also this near to it,
/// half thicknesses.
const FACING: f32 = 0.9;
const SAME_FACE: f32 = 0.96;
const SAME_HALVES: f32 = 1.5;

/// Ratio of half thicknesses from which on the thicker of two planes of about the same direction is a mixture.
const MIXED: f32 = 1.5;

/// Rounds of finding the plane and fitting it.
const ROUNDS: usize = 3;
/// Voxels about the middle of a layer among which all of it is, and the share of the least support that lies closely there: the
/// rest is spread by noise and by a first direction that slants.
const LAYER_VOXELS: f32 = 4.0;
const PEAK_SHARE: f32 = 0.6;

/// Standard deviations beyond which points are left out of the second fit, the least such distance, voxels, and what of a
/// normal scatter then remains: 0.88 of its deviation lies within two.
const TRIM: f32 = 2.0;
const TRIM_VOXELS: f32 = 0.25;
const TRIMMED: f32 = 1.0 / 0.88;
/// Standard deviations in the half thickness, and the least of it, voxels.
const HALF_DEVIATIONS: f32 = 3.0;

/// Cosine within which a normal is of the same plane where their mean is its direction: 8 degrees, three standard deviations
/// of the normals of thin noisy voxels.
const ALIGNED: f32 = 0.99;
/// Directions that have settled within this cosine of each other are one: a quarter of a degree.
const ONE_DIRECTION: f32 = 0.999_99;
/// Heights among which the lowest layer is sought, and points among which planes are, at most.
const SAMPLE: usize = 5000;
/// Two layers are told apart where the heights between them are spread this many times as thinly as in the lower one.
const VALLEY: f32 = 3.0;
/// So many points to a window of heights that is narrower than this count as this wide, voxels: single precision and
/// quantised heights have none.
const LEAST_WIDTH_VOXELS: f32 = 0.05;
/// Share of the table's points below which what lies over it is no layer of its own, and the least number of them.
const LAYER_SHARE: f32 = 0.02;
const LEAST_LAYER: usize = 100;
/// Largest share of a layer's points that may lie over points of the table: those at its edges do, a fifth of a plate of
/// ten voxels a side.
const MOST_TWICE: f32 = 0.3;
/// A layer over the table ends halfway to it.
const HALFWAY: f32 = 0.5;

/// Largest half thickness of a table, voxels, and where that is more, mm: three standard deviations of the waves of a stereo camera.
const FLAT_VOXELS: f32 = 2.5;
const WAVED_MM: f32 = 6.0;

/// Largest share of the spread of a table's normals that goes with the place: noise leaves none, a tube nearly all.
const MOST_CURVED: f32 = 0.4;
/// Spread of the normals, as a mean squared sine, below which a surface is flat however it is spread.
const FLAT_SPREAD: f32 = 0.004;

/// Shorter vectors have no direction.
const LEAST_LENGTH: f32 = 1e-3;

/// Whether the edge of a table may be seen below it, or has to be out of the cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableEdge {
    /// The pictures tell where a plane ends, and so whether it is a table.
    Seen,
    /// Nothing else tells a table from a plate of the work.
    Hidden,
}

/// A plane and how far its points scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    /// Unit, toward the work.
    pub normal: Vector3<f32>,
    /// Distance of the plane from the cloud's origin along `normal`, mm.
    pub offset_mm: f32,
    /// Three standard deviations of its points, mm.
    own_mm: f32,
    /// Half thickness within which a point belongs to it, mm: as much, or a voxel.
    pub half_mm: f32,
    /// Height from which on a face is not its own, but that of a sheet which lies on it, mm.
    pub clear_mm: f32,
    /// Share of all points that lie on it.
    pub share: f32,
}

impl Support {
    /// Height over the plane, mm.
    pub fn height_mm(&self, p: &Point3<f32>) -> f32 {
        self.normal.dot(&p.coords) - self.offset_mm
    }

    /// Whether it reaches farther than what stands on it, whichever way one looks along it.
    pub(crate) fn surrounds(&self, voxels: &Voxels) -> bool {
        table::surrounds(&voxels.cloud.points_mm, &self.normal, self.offset_mm, self.half_mm)
    }

    /// Whether it is a table: its border is not seen. That of a plate of the work is, whatever noise hides of its sides.
    pub(crate) fn is_table(&self, scan: &RawScan) -> bool {
        !scan.cameras_known || self.leaves_pictures(scan)
    }

    /// Whether the pictures end before it does, for the most part: a table, or a plate as large.
    pub(crate) fn leaves_pictures(&self, scan: &RawScan) -> bool {
        let half_mm = self.half_mm;
        Rim::of_all((0..scan.view_names.len()).filter_map(|k| {
            let Seen { points_mm, cloud_from_camera, picture } = scan.seen_by(k)?;
            Some(table::rim(&points_mm, &cloud_from_camera, picture, |p| self.height_mm(p).abs() < half_mm))
        }))
        .is_far()
    }

    /// The plane of a face with this normal at this place, a voxel thick to either side.
    pub fn of_face(normal: Vector3<f32>, place: &Point3<f32>, voxel_mm: f32) -> Self {
        let clear_mm = SAME_HALVES * voxel_mm;
        Self {
            normal,
            offset_mm: normal.dot(&place.coords),
            own_mm: voxel_mm,
            half_mm: voxel_mm,
            clear_mm,
            share: 0.0,
        }
    }

    /// Whether a face with this normal at this place is the support itself.
    pub(crate) fn is_face(&self, normal: &Vector3<f32>, place: &Point3<f32>) -> bool {
        normal.dot(&self.normal) > SAME_FACE && self.height_mm(place).abs() < self.clear_mm
    }
}

/// Whether a cloud shows the table that the work stands on, and so all of the scene.
pub(crate) fn is_table_shown(voxels: &Voxels) -> bool {
    find(voxels, TableEdge::Hidden).is_some_and(|table| table.surrounds(voxels))
}

/// The support of a cloud, if it has one.
pub fn find(voxels: &Voxels, edge: TableEdge) -> Option<Support> {
    let directions = common_normals(&voxels.cloud.normals);
    let found: Vec<Support> = directions.par_iter().filter_map(|n| along(voxels, n, edge)).collect();
    // What holds a thinner plane of about its direction is two layers taken for one, at a slant.
    let is_layer = |a: &&Support| {
        let holds = |b: &Support| MIXED * b.half_mm < a.half_mm && a.normal.dot(&b.normal) > SAME_FACE;
        !found.iter().any(holds)
    };
    let table = found.iter().filter(is_layer).max_by(|a, b| a.share.total_cmp(&b.share))?;
    Some(table.clear_of_sheet(voxels))
}

/// The largest plane that may be a table as well as a plate of the work: it surrounds what stands on it, and nothing faces as it does
/// under it, but for a floor. That is farther below than what is over it is wide; what holds work in the air is lower. None where the
/// support of the cloud is `known` and no floor.
pub fn possible(voxels: &Voxels, known: Option<&Support>) -> Option<Support> {
    let found: Vec<Support> = if let Some(known) = known {
        let over = over_floor(voxels, known)?;
        lowest(&over, &known.normal).filter(|plane| is_bare(&over.cloud, plane)).into_iter().collect()
    } else {
        let sample = sample(voxels);
        let over = |direction: &Vector3<f32>| {
            let over = over_floor(&sample, &lowest_layer(&sample, direction)?);
            let scene = over.as_ref().unwrap_or(&sample);
            lowest(scene, direction).filter(|plane| is_bare(&scene.cloud, plane))
        };
        common_normals(&sample.cloud.normals).par_iter().filter_map(over).collect()
    };
    let around = found.into_iter().filter(|plane| plane.surrounds(voxels));
    let largest = around.max_by(|a, b| a.share.total_cmp(&b.share))?;
    Some(largest.clear_of_sheet(voxels))
}

/// Some points of a cloud, evenly: they tell where large planes are.
fn sample(voxels: &Voxels) -> Voxels {
    part(voxels, points(voxels).step_by(voxels.cloud.len() / SAMPLE + 1))
}

/// What stands over a plane that is a floor.
fn over_floor(voxels: &Voxels, floor: &Support) -> Option<Voxels> {
    let is_over = |p: &Point3<f32>| floor.height_mm(p) > table::STANDS * floor.half_mm;
    let over = part(voxels, points(voxels).filter(|(p, _)| is_over(p)));
    let clear_mm = -table::reach_mm(&over.cloud.points_mm, &-floor.normal)? - floor.offset_mm;
    (clear_mm > table::width_mm(&over.cloud.points_mm, &floor.normal)?).then_some(over)
}

/// Points and normals of a cloud.
fn points(voxels: &Voxels) -> impl Iterator<Item = (&Point3<f32>, &Vector3<f32>)> {
    voxels.cloud.points_mm.iter().zip(&voxels.cloud.normals)
}

/// Some points of a cloud, in voxels as wide.
fn part<'a>(voxels: &Voxels, points: impl Iterator<Item = (&'a Point3<f32>, &'a Vector3<f32>)>) -> Voxels {
    let (points_mm, normals) = points.map(|(p, n)| (*p, *n)).unzip();
    let cloud = PointCloud { origin_mm: voxels.cloud.origin_mm, points_mm, normals };
    Voxels { cloud, edge_mm: voxels.edge_mm, ..Voxels::default() }
}

/// Whether (almost) nothing faces as a plane does, or away from it, no farther below than it is wide.
fn is_bare(cloud: &PointCloud, plane: &Support) -> bool {
    let on = cloud.points_mm.iter().filter(|p| plane.height_mm(p).abs() < plane.half_mm);
    let on: Vec<Point3<f32>> = on.copied().collect();
    let Some(width_mm) = table::width_mm(&on, &plane.normal) else { return false };
    let under = -width_mm..-BEHIND_HALVES * plane.half_mm;
    let both = cloud.points_mm.iter().zip(&cloud.normals);
    let is_under = |(p, n): &(&Point3<f32>, &Vector3<f32>)| {
        n.dot(&plane.normal).abs() > FACING && under.contains(&plane.height_mm(p))
    };
    both.filter(is_under).count() as f32 <= MOST_BEHIND * cloud.len() as f32
}

/// The most common directions of normals.
fn common_normals(normals: &[Vector3<f32>]) -> Vec<Vector3<f32>> {
    let mut bins = vec![(0usize, Vector3::zeros()); BINS * BINS * BINS];
    for n in normals {
        let c =
            |v: f32| ((v * BINS_PER_UNIT).round() + BINS_PER_UNIT).clamp(0.0, 2.0 * BINS_PER_UNIT) as usize;
        let bin = &mut bins[(c(n.x) * BINS + c(n.y)) * BINS + c(n.z)];
        *bin = (bin.0 + 1, bin.1 + n);
    }
    bins.sort_by_key(|b| std::cmp::Reverse(b.0));
    let means = bins.iter().take(DIRECTIONS).filter_map(|(_, sum)| sum.try_normalize(LEAST_LENGTH));
    let mut directions: Vec<Vector3<f32>> = Vec::new();
    for direction in means.filter_map(|mean| settled(normals, mean)) {
        // Noise spreads the normals of one plane over several bins.
        if directions.iter().all(|known| known.dot(&direction) < ONE_DIRECTION) {
            directions.push(direction);
        }
    }
    directions
}

/// The mean of the normals about a direction, sought again about itself.
fn settled(normals: &[Vector3<f32>], mut direction: Vector3<f32>) -> Option<Vector3<f32>> {
    for _ in 0..ROUNDS {
        let aligned = normals.iter().filter(|n| n.dot(&direction) > ALIGNED);
        direction = aligned.sum::<Vector3<f32>>().try_normalize(LEAST_LENGTH)?;
    }
    Some(direction)
}

/// The lowest large plane about normal to `direction`, if it has (almost) nothing behind it.
fn along(voxels: &Voxels, direction: &Vector3<f32>, edge: TableEdge) -> Option<Support> {
    let support = lowest(voxels, direction)?;
    // What is square to it as a face of its own is parallel to it: no bevel of a groove in a plate.
    let is_edge = |n: &Vector3<f32>| n.dot(&support.normal).powi(2) < 1.0 - SAME_FACE * SAME_FACE;
    let is_behind = |(p, n): &(&Point3<f32>, &Vector3<f32>)| {
        support.height_mm(p) < -BEHIND_HALVES * support.half_mm && (edge == TableEdge::Hidden || !is_edge(n))
    };
    let behind = points(voxels).filter(is_behind).count();
    (behind as f32 <= MOST_BEHIND * voxels.cloud.len() as f32).then_some(support)
}

/// The lowest large plane about normal to `direction`. A curved or rough surface is none.
fn lowest(voxels: &Voxels, direction: &Vector3<f32>) -> Option<Support> {
    let support = lowest_layer(voxels, direction)?;
    let flat = support.half_mm <= WAVED_MM.max(FLAT_VOXELS * voxels.edge_mm) && !is_curved(voxels, &support);
    (flat && support.share > LEAST_SHARE).then_some(support)
}

/// The plane fitted to the lowest layer of points that face about along `direction`.
fn lowest_layer(voxels: &Voxels, direction: &Vector3<f32>) -> Option<Support> {
    let mut normal = settled(&voxels.cloud.normals, *direction)?;
    let mut found = None;
    for _ in 0..ROUNDS {
        let support = fitted(voxels, &normal)?;
        normal = support.normal;
        found = Some(support);
    }
    found
}

/// The plane fitted to the lowest full layer of the points that face along `normal`.
fn fitted(voxels: &Voxels, normal: &Vector3<f32>) -> Option<Support> {
    let total = voxels.cloud.len() as f32;
    let facing = facing(&voxels.cloud, normal);
    let every = facing.len() / SAMPLE + 1;
    let least = (PEAK_SHARE * LEAST_SHARE * total / every as f32) as usize;
    let mut sorted_mm: Vec<f32> = facing.iter().step_by(every).map(|p| normal.dot(p)).collect();
    sorted_mm.sort_unstable_by(f32::total_cmp);
    let heights = Heights { sorted_mm: &sorted_mm, voxel_mm: voxels.edge_mm };
    let middle_mm = heights.lowest(least)?.middle_mm;
    // A sheet on the table is another layer next to it, and would lift, tilt and thicken it.
    sorted_mm.retain(|h| (h - middle_mm).abs() < LAYER_VOXELS * voxels.edge_mm);
    let heights = Heights { sorted_mm: &sorted_mm, voxel_mm: voxels.edge_mm };
    let lowest = heights.lowest(least)?;
    let within_mm = (TRIM * lowest.deviation_mm).max(TRIM_VOXELS * voxels.edge_mm);
    let Layer { normal, offset_mm, deviation_mm, count } =
        layer(&facing, normal, lowest.middle_mm, within_mm);
    let own_mm = HALF_DEVIATIONS * TRIMMED * deviation_mm;
    let half_mm = own_mm.max(voxels.edge_mm);
    Some(Support {
        normal,
        offset_mm,
        own_mm,
        half_mm,
        clear_mm: SAME_HALVES * half_mm,
        share: count / total,
    })
}

/// The points that face about as a plane does.
fn facing(cloud: &PointCloud, normal: &Vector3<f32>) -> Vec<Vector3<f32>> {
    let both = cloud.points_mm.iter().zip(&cloud.normals);
    both.filter(|(_, n)| n.dot(normal) > FACING).map(|(p, _)| p.coords).collect()
}

/// Heights over a plane, sorted.
struct Heights<'a> {
    sorted_mm: &'a [f32],
    voxel_mm: f32,
}

/// The densest place of a layer, and its scatter as the points on its lower side show it: nothing lies under a table.
struct Mode {
    middle_mm: f32,
    deviation_mm: f32,
}

impl Heights<'_> {
    /// How far `count` successive heights are spread, from each one on.
    fn widths_mm(&self, count: usize) -> impl Iterator<Item = f32> {
        let least_mm = LEAST_WIDTH_VOXELS * self.voxel_mm;
        self.sorted_mm.windows(count).map(move |window| (window[count - 1] - window[0]).max(least_mm))
    }

    /// The lowest layer of at least `count` points: where so many lie closest, up to where they lie far more thinly.
    fn lowest(&self, count: usize) -> Option<Mode> {
        let count = count.max(2);
        let mut densest: Option<(f32, usize)> = None;
        for (k, width_mm) in self.widths_mm(count).enumerate() {
            match densest {
                Some((least, _)) if width_mm > VALLEY * least => break,
                Some((least, _)) if width_mm >= least => {}
                _ => densest = Some((width_mm, k)),
            }
        }
        let (_, first) = densest?;
        let middle = first + count / 2;
        let middle_mm = self.sorted_mm[middle];
        let deviation_mm = DEVIATION_OF_MEDIAN as f32 * (middle_mm - self.sorted_mm[middle / 2]);
        Some(Mode { middle_mm, deviation_mm })
    }

    /// Where `count` of them lie closest, higher than the lower layer's own scatter reaches and beyond heights that are spread more
    /// thinly by far, if anywhere.
    fn beyond_valley(&self, count: usize, own_mm: f32) -> Option<f32> {
        let mut widest_mm = 0.0f32;
        let mut densest: Option<(f32, usize)> = None;
        for (k, width_mm) in self.widths_mm(count).enumerate() {
            widest_mm = widest_mm.max(width_mm);
            let is_beyond = VALLEY * width_mm < widest_mm && self.sorted_mm[k + count / 2] > own_mm;
            if is_beyond && densest.is_none_or(|(least, _)| width_mm < least) {
                densest = Some((width_mm, k));
            }
        }
        densest.map(|(_, k)| self.sorted_mm[k + count / 2])
    }
}

impl Support {
    /// Clear of a sheet that lies on it, too.
    fn clear_of_sheet(self, voxels: &Voxels) -> Self {
        let clear_mm = self.sheet_mm(voxels).map_or(self.clear_mm, |height| HALFWAY * height);
        Self { clear_mm, ..self }
    }

    /// Height of a sheet that lies on it no higher than it would pass for it, if there is one: heights lie closest there beyond a
    /// valley, and it hides what of the table is under it. What two views see twice lies over itself.
    fn sheet_mm(&self, voxels: &Voxels) -> Option<f32> {
        let (own_mm, voxel_mm) = (self.own_mm, voxels.edge_mm);
        let height = |p: &Vector3<f32>| self.height_mm(&Point3::from(*p));
        let facing = facing(&voxels.cloud, &self.normal);
        let own = facing.iter().filter(|p| height(p).abs() < own_mm).count();
        let over = |h: &f32| (0.0..self.clear_mm / HALFWAY).contains(h);
        let mut sorted_mm: Vec<f32> = facing.iter().map(height).filter(over).collect();
        sorted_mm.sort_unstable_by(f32::total_cmp);
        let least = ((LAYER_SHARE * own as f32) as usize).max(LEAST_LAYER);
        let sheet_mm = Heights { sorted_mm: &sorted_mm, voxel_mm }.beyond_valley(least, own_mm)?;
        let axes = table::axes(&self.normal);
        let cell = |p: &Vector3<f32>| axes.map(|axis| (axis.dot(p) / voxel_mm).floor() as i32);
        let near_mm = own_mm.min(HALFWAY * sheet_mm);
        let bare: HashSet<[i32; 2]> = facing.iter().filter(|p| height(p).abs() < near_mm).map(cell).collect();
        let of_sheet: Vec<_> = facing.iter().filter(|p| (height(p) - sheet_mm).abs() < near_mm).collect();
        let twice = of_sheet.iter().filter(|p| bare.contains(&cell(p))).count();
        (twice as f32 <= MOST_TWICE * of_sheet.len() as f32).then_some(sheet_mm)
    }
}

/// A plane through some points.
struct Layer {
    normal: Vector3<f32>,
    offset_mm: f32,
    deviation_mm: f32,
    count: f32,
}

/// The plane through the points that are nearer than `within_mm` to one square to `axis`, fitted in axes along it: in any others
/// the scatter about a large plane is lost in single precision.
fn layer(points: &[Vector3<f32>], axis: &Vector3<f32>, middle_mm: f32, within_mm: f32) -> Layer {
    let [a, b] = table::axes(axis);
    let mut moments = Moments::default();
    for p in points {
        let height_mm = axis.dot(p) - middle_mm;
        if height_mm.abs() < within_mm {
            moments.add(Vector3::new(a.dot(p), b.dot(p), height_mm));
        }
    }
    let plane = moments.plane();
    let local = if plane.normal.z < 0.0 { -plane.normal } else { plane.normal };
    let normal = a * local.x + b * local.y + axis * local.z;
    let offset_mm = local.dot(&plane.mean) + local.z * middle_mm;
    Layer { normal, offset_mm, deviation_mm: plane.variance_mm2.sqrt(), count: moments.count }
}

/// Whether the normals of a support's points turn with their place on it, as on a tube.
fn is_curved(voxels: &Voxels, support: &Support) -> bool {
    let both = voxels.cloud.points_mm.iter().copied().zip(voxels.cloud.normals.iter().copied());
    let own =
        both.filter(|(p, n)| n.dot(&support.normal) > FACING && support.height_mm(p).abs() < support.half_mm);
    curves(&support.normal, &own.collect::<Vec<_>>())
}

/// Whether the normals of points about a plane go with the place, as they do along a tube.
pub(in crate::seam) fn curves(normal: &Vector3<f32>, rows: &[(Point3<f32>, Vector3<f32>)]) -> bool {
    let [a, b] = table::axes(normal);
    let rows = || {
        rows.iter().map(|(p, n)| {
            (Vector2::new(p.coords.dot(&a), p.coords.dot(&b)), Vector2::new(n.dot(&a), n.dot(&b)))
        })
    };
    let count = rows().count().max(1) as f32;
    let sum = rows().fold((Vector2::zeros(), Vector2::zeros()), |s, r| (s.0 + r.0, s.1 + r.1));
    let (place, tilt) = (sum.0 / count, sum.1 / count);
    let (mut places, mut crossed, mut spread) = (Matrix2::zeros(), Matrix2::zeros(), 0.0);
    for (p, n) in rows() {
        let (p, n) = (p - place, n - tilt);
        places += p * p.transpose();
        crossed += n * p.transpose();
        spread += n.norm_squared();
    }
    let Some(inverse) = places.try_inverse() else { return false };
    let explained = (crossed * inverse * crossed.transpose()).trace();
    spread > FLAT_SPREAD * count && explained > MOST_CURVED * spread
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Unit, UnitQuaternion};

    const EDGE_MM: f32 = 1.2;

    /// Points a voxel apart on a level square of so many, at heights that scatter by 0.15 mm, where `is_there` says so.
    fn level(side: i32, height_mm: f32, is_there: impl Fn(i32, i32) -> bool) -> Vec<Point3<f32>> {
        let places = (0..side).flat_map(|x| (0..side).map(move |y| (x, y))).filter(|(x, y)| is_there(*x, *y));
        let noise = |x: i32, y: i32| {
            // The sum of three uniform numbers is nearly normal; its deviation is a half.
            let uniform =
                |salt: i32| (x * 7919 + y * 104_729 + salt * 1_299_709).rem_euclid(9973) as f32 / 9973.0;
            0.3 * ((1..=3).map(uniform).sum::<f32>() - 1.5)
        };
        let at =
            |(x, y): (i32, i32)| Point3::new(EDGE_MM * x as f32, EDGE_MM * y as f32, height_mm + noise(x, y));
        places.map(at).collect()
    }

    fn table(points_mm: Vec<Point3<f32>>) -> Support {
        table_facing(points_mm, Vector3::z())
    }

    fn table_facing(points_mm: Vec<Point3<f32>>, normal: Vector3<f32>) -> Support {
        let normals = vec![normal; points_mm.len()];
        let cloud = PointCloud { origin_mm: Point3::origin(), points_mm, normals };
        find(&Voxels { cloud, edge_mm: EDGE_MM, ..Voxels::default() }, TableEdge::Hidden).expect("a table")
    }

    fn is_sheet(x: i32, y: i32) -> bool {
        (20..50).contains(&x) && (5..60).contains(&y)
    }

    #[test]
    fn a_sheet_is_told_from_the_table_under_it() {
        for height_mm in [1.0, 1.5, 3.0] {
            let bare = level(80, 0.0, |x, y| !is_sheet(x, y));
            let found = table([bare, level(80, height_mm, is_sheet)].concat());
            assert!(found.offset_mm.abs() < 0.05, "{height_mm} mm: {found:?}");
            assert!((found.clear_mm - 0.5 * height_mm).abs() < 0.1, "{height_mm} mm: {found:?}");
            let on = |z: f32| found.is_face(&Vector3::z(), &Point3::new(40.0, 40.0, z));
            assert!(on(0.0) && !on(height_mm), "{height_mm} mm");
        }
    }

    /// The fullest layer is not the lowest, and what scatters about a large plane is told in no axes but its own.
    #[test]
    fn the_table_is_told_under_a_plate_that_hides_most_of_it_in_any_frame() {
        let is_plate = |x: i32, y: i32| (8..75).contains(&x) && y > 5;
        for height_mm in [5.0, 8.0, 30.0] {
            let points = [level(80, 0.0, |x, y| !is_plate(x, y)), level(80, height_mm, is_plate)].concat();
            let upright = table(points.clone());
            assert!(upright.offset_mm.abs() < 0.05, "{height_mm} mm: {upright:?}");
            for axis in [Vector3::x(), Vector3::new(1.0, 2.0, -0.5), Vector3::new(-1.0, 1.0, 0.0)] {
                let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), 0.955);
                let turned = points.iter().map(|p| turn * p + Vector3::new(150.0, -80.0, 60.0)).collect();
                let found = table_facing(turned, turn * Vector3::z());
                assert!((found.own_mm / upright.own_mm - 1.0).abs() < 0.02, "{height_mm} mm: {found:?}");
            }
        }
    }

    #[test]
    fn a_table_may_show_its_edge_where_pictures_tell_that_it_is_one() {
        let edge = level(80, 0.0, |_, y| y < 20).into_iter().map(|p| Point3::new(0.0, p.x, p.z - p.y));
        let top = level(80, 0.0, |_, _| true);
        let normals = [vec![Vector3::z(); top.len()], vec![-Vector3::x(); edge.len()]].concat();
        let points_mm = top.into_iter().chain(edge).collect();
        let cloud = PointCloud { origin_mm: Point3::origin(), points_mm, normals };
        let voxels = Voxels { cloud, edge_mm: EDGE_MM, ..Voxels::default() };
        assert!(find(&voxels, TableEdge::Seen).is_some_and(|table| table.offset_mm.abs() < 0.05));
        assert_eq!(find(&voxels, TableEdge::Hidden), None);
    }

    #[test]
    fn a_plate_with_a_groove_in_it_is_no_table() {
        let is_groove = |x: i32, _| (36..44).contains(&x);
        let bevel = level(80, 0.0, is_groove).into_iter().map(|p| {
            let deep_mm = 1.7 * (4.8 - (p.x - 48.0).abs());
            Point3::new(p.x, p.y, p.z - deep_mm)
        });
        let top = level(80, 0.0, |x, y| !is_groove(x, y));
        let bevel: Vec<_> = bevel.collect();
        let facing = |p: &Point3<f32>| Vector3::new(if p.x < 48.0 { 0.86 } else { -0.86 }, 0.0, 0.51);
        let normals = vec![Vector3::z(); top.len()].into_iter().chain(bevel.iter().map(facing)).collect();
        let points_mm = [top, bevel].concat();
        let cloud = PointCloud { origin_mm: Point3::origin(), points_mm, normals };
        let voxels = Voxels { cloud, edge_mm: EDGE_MM, ..Voxels::default() };
        assert_eq!([TableEdge::Seen, TableEdge::Hidden].map(|edge| find(&voxels, edge)), [None, None]);
    }

    #[test]
    fn a_table_has_nothing_under_it_but_a_floor_that_is_farther_below_than_it_is_wide() {
        const SIDE: i32 = 80;
        let is_plate = |x: i32, y: i32| (20..50).contains(&x) && (25..60).contains(&y);
        let wide_mm = EDGE_MM * SIDE as f32;
        for (below, height_mm) in
            [(1.5 * wide_mm, Some(0.0)), (5.0 * wide_mm, Some(0.0)), (0.3 * wide_mm, None)]
        {
            let floor = level(2 * SIDE, -below, |x, y| x.min(y) > SIDE);
            let bare = level(SIDE, 0.0, |x, y| !is_plate(x, y));
            let points_mm = [floor, bare, level(SIDE, 8.0, is_plate)].concat();
            let normals = vec![Vector3::z(); points_mm.len()];
            let cloud = PointCloud { origin_mm: Point3::origin(), points_mm, normals };
            let voxels = Voxels { cloud, edge_mm: EDGE_MM, ..Voxels::default() };
            for known in [None, find(&voxels, TableEdge::Hidden)] {
                let found_mm = possible(&voxels, known.as_ref()).map(|table| table.offset_mm);
                let is_near = found_mm.zip(height_mm).is_none_or(|(a, b): (f32, f32)| (a - b).abs() < 0.1);
                assert!(found_mm.is_some() == height_mm.is_some() && is_near, "{below} mm: {found_mm:?}");
            }
        }
    }

    #[test]
    fn a_bare_table_and_one_that_two_views_put_at_two_heights_have_no_sheet() {
        let twice = [level(80, 0.0, |_, _| true), level(80, 1.0, is_sheet)].concat();
        for points_mm in [level(80, 0.0, |_, _| true), twice] {
            let found = table(points_mm);
            assert!((found.clear_mm - SAME_HALVES * found.half_mm).abs() < 1e-6, "{found:?}");
        }
    }
}
