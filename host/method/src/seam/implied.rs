//! Joints that two faces imply (ours): flat faces that would meet in an inside corner if they went on, where the corner itself was
//! hardly seen. A camera loses the foot of a web to grazing sight, to the light between the faces or to its matcher's window,
//! and no neighbourhood holds both faces then; the faces themselves are known better than any of their points.
//!
//! Where corners show that are too wide for the faces about them, they are the edges of what a camera has rounded, and the seam is
//! sought in the joint. All other joints are named.

use super::input::SurfaceModel;
use super::joined::{ALONG, ONE_TORCH, SHARPER_DEG};
use super::surfaces::Face;
use super::trace::support::Support;
use super::trace::{Chain, ChainLink};
use super::unwelded::{Unwelded, WhyUnwelded};
use super::{Seam, Station};
use crate::geometry::statistics::median;
use nalgebra::{Point3, Vector3};

/// Faces meet at 30 to 150 degrees through the air; flatter ones are bends, and sharper ones let no torch in.
const MOST_ALIKE: f32 = 0.87;
/// A face ends this near to the joint at most, mm: a matcher's window of ten pixels at 400 mm rounds a corner over as much; or so
/// many voxels.
const GAP_MM: f32 = 12.0;
const GAP_VOXELS: f32 = 5.0;
/// Places along a joint, voxels; so many of them without faces are bridged.
const PLACE_VOXELS: f32 = 2.0;
const BRIDGED: usize = 2;
/// Where one face goes on unbroken below the end of the other, the other stands off it: of the places there, this share shows it.
const THROUGH: f32 = 0.5;
/// Fewer points of a face at a place of the joint do not show it; whole, there are ten.
const SHOWN: u32 = 4;
/// From a joint that a camera rounded the surface stays so far at most, mm: over a matcher's window of 15 mm a right angle, seen from
/// its middle, is 3.75 mm deep in the mean. From one that is rolled or bent it stays farther.
pub(super) const MOST_ROUNDED_MM: f64 = 4.0;

/// An inside corner that two faces imply.
pub(super) struct Joint {
    /// Places along it, about the origin of the scan.
    places_mm: Vec<Point3<f32>>,
    along: Vector3<f32>,
    faces: [Vector3<f32>; 2],
    on_table: bool,
}

/// Joints of the faces of a model, the longest first.
pub(super) fn joints(faces: &[Face], voxel_mm: f32, table: Option<&Support>) -> Vec<Joint> {
    let mut joints = Vec::new();
    for (k, one) in faces.iter().enumerate() {
        for other in &faces[k + 1..] {
            let faces = [one.normal, other.normal];
            let along = faces[0].cross(&faces[1]).normalize();
            for places_mm in met(one, other, voxel_mm) {
                let middle = places_mm[places_mm.len() / 2];
                let is_table = |t: &Support| faces.iter().any(|normal| t.is_face(normal, &middle));
                joints.push(Joint { on_table: table.is_some_and(is_table), places_mm, along, faces });
            }
        }
    }
    joints.sort_by_key(|joint| std::cmp::Reverse(joint.places_mm.len()));
    joints
}

impl Joint {
    /// As a corner that is not welded; `origin_mm` is that of the scan.
    pub(super) fn unwelded(&self, origin_mm: &Point3<f64>) -> Unwelded {
        let reason = if self.on_table { WhyUnwelded::Table } else { WhyUnwelded::Implied };
        let line_mm: Vec<_> = self.places_mm.iter().map(|p| origin_mm + p.coords.cast::<f64>()).collect();
        let air = vec![(self.faces[0] + self.faces[1]).cast(); line_mm.len()];
        Unwelded { line_mm, air, reason, words: String::new() }
    }

    /// Whether a seam that runs beside it is wider: it runs along the rounding. A neighbourhood that is smaller than a rounding sees two
    /// wider corners in it, each between a face and a ramp.
    pub(super) fn is_sharper_than(&self, seam: &Seam) -> bool {
        seam.included_deg() - self.included_deg() > SHARPER_DEG
    }

    /// The part of it beside some seams as a chain of corners, and how far from it they run, mm; `origin_mm` is that of the scan.
    pub(super) fn beside(&self, seams: &[&Seam], voxel_mm: f32, origin_mm: &Point3<f64>) -> (Chain, f32) {
        let stations = seams.iter().flat_map(|seam| &seam.stations);
        let stations: Vec<_> = stations.map(|station| station.about(origin_mm)).collect();
        let off_mm = |p: &Point3<f32>| stations.iter().map(|q| (q - p).norm()).fold(f32::INFINITY, f32::min);
        let beside = self.places_mm.iter().map(|p| (p, off_mm(p))).filter(|(_, off)| *off < gap_mm(voxel_mm));
        let link = |p: &Point3<f32>| ChainLink { position: *p, direction: self.along, faces: self.faces };
        let (links, mut off_mm): (Vec<_>, Vec<_>) = beside.map(|(p, off_mm)| (link(p), off_mm)).unzip();
        (Chain { links, ..Chain::default() }, median(&mut off_mm))
    }

    /// How far from it what is seen between its faces stays, the median of its places, mm.
    pub(super) fn rounding_mm(&self, model: &SurfaceModel) -> f64 {
        let off_mm = |place: &Point3<f32>| {
            let is_between = |slot: usize| {
                let p = model.index.point(slot) - place;
                let [a, b] = self.faces.map(|face| p.dot(&face));
                a.min(b) > 0.5 * a.max(b)
            };
            let (_, squared_mm2) = model.index.nearest(place, gap_mm(model.voxel_mm()), is_between)?;
            Some(squared_mm2.sqrt())
        };
        f64::from(median(&mut self.places_mm.iter().filter_map(off_mm).collect::<Vec<_>>()))
    }

    /// Whether most of a seam runs in it or beside it.
    pub(super) fn is_beside(&self, seam: &Seam, voxel_mm: f32, origin_mm: &Point3<f64>) -> bool {
        let along = self.along.cast::<f64>();
        let torch = (self.faces[0] + self.faces[1]).cast::<f64>().normalize();
        let is_beside = |station: &&Station| {
            let place = station.about(origin_mm);
            station.tangent.dot(&along).abs() > ALONG
                && station.bisector().is_some_and(|own| own.dot(&torch) > ONE_TORCH)
                && self.places_mm.iter().any(|p| (p - place).norm() < gap_mm(voxel_mm))
        };
        2 * seam.stations.iter().filter(is_beside).count() > seam.stations.len()
    }

    fn included_deg(&self) -> f64 {
        180.0 - f64::from(self.faces[0].angle(&self.faces[1]).to_degrees())
    }
}

pub(super) fn gap_mm(voxel_mm: f32) -> f32 {
    GAP_MM.max(GAP_VOXELS * voxel_mm)
}

/// Where two faces would meet in an inside corner: places along it, a run for each joint.
fn met(one: &Face, other: &Face, voxel_mm: f32) -> Vec<Vec<Point3<f32>>> {
    let alike = one.normal.dot(&other.normal);
    let gap_mm = gap_mm(voxel_mm);
    if alike.abs() > MOST_ALIKE || one.apart_mm(other) > 2.0 * gap_mm {
        return Vec::new();
    }
    let along = one.normal.cross(&other.normal).normalize();
    // The foot of the line: the point of both planes nearest to the middle of the smaller face.
    let smaller = if one.points.len() < other.points.len() { one } else { other };
    let middle = smaller.points[smaller.points.len() / 2];
    let sine2 = 1.0 - alike * alike;
    let off = [one, other].map(|face| face.level_mm - face.normal.dot(&middle.coords));
    let foot = middle
        + one.normal * ((off[0] - alike * off[1]) / sine2)
        + other.normal * ((off[1] - alike * off[0]) / sine2);
    let place_mm = PLACE_VOXELS * voxel_mm;
    let [a, b] = [(one, other), (other, one)].map(|(face, other)| {
        // In an inside corner a face lies where the other's normal points to.
        let away = (other.normal - face.normal * alike).normalize();
        Ends::of(face.near(other, 2.0 * gap_mm), [&foot.coords, &along, &away], gap_mm, voxel_mm)
    });
    let (first, last) = (a.first.max(b.first), a.last.min(b.last));
    let is_joint = |at: i32| {
        let ([near_a, near_b], [under_a, under_b]) =
            ([a.near_mm(at), b.near_mm(at)], [a.under(at), b.under(at)]);
        let is_shown = a.is_shown(at) && b.is_shown(at) && near_a < gap_mm && near_b < gap_mm;
        // One of them ends there, at the other: faces that both go on cross in free space.
        is_shown && !(under_a && (under_b || near_b > 0.0)) && !(under_b && near_a > 0.0)
    };
    let joint: Vec<i32> = (first..=last).filter(|at| is_joint(*at)).collect();
    let runs = joint.chunk_by(|a, b| (b - a) as usize <= 1 + BRIDGED);
    let place = |at: i32| foot + along * ((at as f32 + 0.5) * place_mm);
    runs.map(|run| (run[0]..=run[run.len() - 1]).map(place).collect()).collect()
}

/// How near a face comes to a line, place by place along it.
struct Ends {
    first: i32,
    last: i32,
    /// Of each place, the nearest distance beyond the line on the face's side, mm; infinite without points there.
    near_mm: Vec<f32>,
    /// Points before and behind the line, but for those within a voxel of it.
    counts: Vec<[u32; 2]>,
    unsure_mm: f32,
}

impl Ends {
    fn of<'a>(
        points: impl Iterator<Item = &'a Point3<f32>>,
        [foot, along, away]: [&Vector3<f32>; 3],
        gap_mm: f32,
        voxel_mm: f32,
    ) -> Self {
        let place_mm = PLACE_VOXELS * voxel_mm;
        let of = |p: &Point3<f32>| {
            (((p.coords - foot).dot(along) / place_mm).floor() as i32, (p.coords - foot).dot(away))
        };
        let near: Vec<(i32, f32)> = points.map(of).filter(|(_, u)| u.abs() < gap_mm).collect();
        let first = near.iter().map(|(at, _)| *at).min().unwrap_or(0);
        let last = near.iter().map(|(at, _)| *at).max().unwrap_or(-1);
        let places = (last - first + 1).max(0) as usize;
        let mut ends = Self {
            first,
            last,
            near_mm: vec![f32::INFINITY; places],
            counts: vec![[0; 2]; places],
            unsure_mm: voxel_mm,
        };
        for (at, u) in near {
            let k = (at - first) as usize;
            if u > -voxel_mm {
                ends.near_mm[k] = ends.near_mm[k].min(u.max(0.0));
            }
            if u.abs() > voxel_mm {
                ends.counts[k][usize::from(u < 0.0)] += 1;
            }
        }
        ends
    }

    /// Beyond what is unsure of the line itself: 0 within two voxels.
    fn near_mm(&self, at: i32) -> f32 {
        let near_mm = self.near_mm.get((at - self.first) as usize).copied().unwrap_or(f32::INFINITY);
        if near_mm < 2.0 * self.unsure_mm { 0.0 } else { near_mm }
    }

    /// Whether the face was seen on its own side of the line: of an outside corner both lie on the other.
    fn is_shown(&self, at: i32) -> bool {
        self.counts.get((at - self.first) as usize).is_some_and(|[before, _]| *before >= SHOWN)
    }

    /// Whether the face goes on behind the line as it is before it.
    fn under(&self, at: i32) -> bool {
        let [before, behind] = self.counts.get((at - self.first) as usize).copied().unwrap_or_default();
        behind as f32 > THROUGH * before as f32
    }
}

#[cfg(test)]
mod tests {
    use super::super::surfaces::tests::surfaces;
    use super::*;

    /// A plate of 80 x 60 mm with a web 50 mm high that stands across it, seen from one side: nothing within `lost_mm` of the foot.
    fn web(lost_mm: i32, lifted_mm: f32) -> Vec<(Point3<f32>, Vector3<f32>)> {
        let plate = (-40..=40).flat_map(|x| (0..=60).map(move |y| (x, y)));
        let under = lifted_mm > 0.0;
        let seen = move |&(_, y): &(i32, i32)| under || y >= 30 + lost_mm;
        let plate = plate.filter(seen).map(|(x, y)| (Point3::new(x as f32, y as f32, 0.0), Vector3::z()));
        let wall = (-40..=40).flat_map(|x| (lost_mm..=50).map(move |z| (x, z)));
        let wall = wall.map(|(x, z)| (Point3::new(x as f32, 30.0, z as f32 + lifted_mm), Vector3::y()));
        plate.chain(wall).collect()
    }

    fn joints_of(rows: Vec<(Point3<f32>, Vector3<f32>)>) -> Vec<Unwelded> {
        joints(&surfaces(rows).0, 1.0, None).iter().map(|joint| joint.unwelded(&Point3::origin())).collect()
    }

    #[test]
    fn faces_that_end_before_their_corner_imply_it_where_it_is() {
        for lost_mm in [3, 8] {
            let found = joints_of(web(lost_mm, 0.0));
            assert_eq!(found.len(), 1);
            assert!((found[0].length_mm() - 80.0).abs() < 5.0, "{}", found[0].length_mm());
            assert!(found[0].line_mm.iter().all(|p| (p.y - 30.0).abs() < 0.1 && p.z.abs() < 0.1));
        }
        assert!(joints_of(web(16, 0.0)).is_empty(), "too far apart to tell");
    }

    /// A plate, a ramp that rises by 45 degrees from 7 mm before a wall on, and the wall.
    fn rounded() -> Vec<(Point3<f32>, Vector3<f32>)> {
        let along = |x: i32| x as f32;
        let plate =
            (-40..=40).flat_map(move |x| (37..=80).map(move |y| Point3::new(along(x), y as f32, 0.0)));
        let wall = (-40..=40).flat_map(move |x| (7..=50).map(move |z| Point3::new(along(x), 30.0, z as f32)));
        let ramp = (-40..=40)
            .flat_map(move |x| (1..7).map(move |k| Point3::new(along(x), (37 - k) as f32, k as f32)));
        let facing = |y: f32, z: f32| Vector3::new(0.0, y, z).normalize();
        let plate = plate.map(|p| (p, Vector3::z())).chain(wall.map(|p| (p, Vector3::y())));
        plate.chain(ramp.map(|p| (p, facing(1.0, 1.0)))).collect()
    }

    /// A seam along x through a place, between faces with these normals in y and z.
    fn seam([y, z]: [f64; 2], faces: [[f64; 2]; 2]) -> Seam {
        let faces = faces.map(|[y, z]| Vector3::new(0.0, y, z).normalize());
        let place = |k: i32| Point3::new(-38.0 + 2.0 * f64::from(k), y, z);
        let station = |k| Station { position_mm: place(k), tangent: Vector3::x(), faces };
        Seam::through((0..38).map(station).collect())
    }

    #[test]
    fn an_edge_of_a_rounding_runs_beside_a_sharper_joint() {
        let joints = joints(&surfaces(rounded()).0, 1.0, None);
        let joint =
            joints.iter().min_by(|a, b| a.included_deg().total_cmp(&b.included_deg())).expect("a joint");
        let runs_in_rounding =
            |seam: &Seam| joint.is_beside(seam, 1.0, &Point3::origin()) && joint.is_sharper_than(seam);
        let level_and_slope = [[0.0, 1.0], [1.0, 1.0]];
        assert!(runs_in_rounding(&seam([37.0, 0.0], level_and_slope)));
        assert!(!runs_in_rounding(&seam([30.0, 0.0], [[0.0, 1.0], [1.0, 0.0]])), "the joint itself");
        assert!(!runs_in_rounding(&seam([60.0, 0.0], level_and_slope)), "another place");
        let (chain, off_mm) = joint.beside(&[&seam([37.0, 0.0], level_and_slope)], 1.0, &Point3::origin());
        assert!((off_mm - 7.0).abs() < 0.5 && chain.length_mm() > 70.0, "{off_mm} mm");
    }

    #[test]
    fn a_wall_that_stands_off_a_plate_and_an_outside_edge_imply_nothing() {
        assert!(joints_of(web(0, 8.0)).is_empty(), "the plate goes on under the wall");
        let edge = (0..=60).flat_map(|a| (0..=60).map(move |b| (a as f32, b as f32)));
        let edge = edge.flat_map(|(a, b)| {
            [(Point3::new(a, b, 0.0), Vector3::z()), (Point3::new(a, 0.0, -b), -Vector3::y())]
        });
        assert!(joints_of(edge.collect()).is_empty());
    }
}
