//! Seams that a person draws (ours), the last resort: a chain of places on the surface, which nothing has to bear out.
//!
//! The line is laid onto the thinned model from place to place. Where two faces meet beside a whole stretch of it, within what
//! a click may be off, it lies where they meet, with the torch on their bisector; else it stays where it was drawn, with the
//! torch square to the face. It is refused where nothing was scanned, and where something stands in the torch's way.
//! Millimetres; the places are in the base frame, everything else is about the cloud's origin.

use super::description::warnings;
use super::input::Input;
use super::refine::Refined;
use super::refine::expected::{self, Expected, MEDIAN_OF_RMS};
use super::refine::frame::Frame;
use super::{Joint, Seam, Station};
use nalgebra::{Matrix3, Point3, Vector3};
use std::ops::Range;

/// A line between two clicks on a curved face is so far off it at most, mm: 30 mm apart on a tube of 15 mm radius.
const OFF_MM: f32 = 15.0;
/// A face goes on where the next point of the model is nearer than this, voxels: a full face leaves 0.9 at most, the
/// diagonal of a voxel's half, and lone empty voxels are no hole.
const HOLE_VOXELS: f32 = 2.0;
/// Surroundings in which a face is fitted, voxels; the model is looked up in cells of this size.
const REACH_VOXELS: f32 = super::INDEX_VOXELS;
/// Two faces whose normals differ by less are one that is curved, as a cosine: 40 degrees.
const ONE_FACE: f32 = 0.77;
/// Normals of one face lie within this of its own, as a cosine; and its points within so many voxels of its plane.
const ALIKE: f32 = 0.9;
const CLEARLY_ALIKE: f32 = 0.95;
const LAYER_VOXELS: f32 = 1.0;
/// Fewest points of a face, and its least share of those about the line.
const LEAST_POINTS: usize = 5;
const LEAST_SHARE: f32 = 0.1;
/// Nearer to where two faces meet than this, voxels, the model is rounded.
const ROUNDED_VOXELS: f32 = 1.5;
/// A corner is meant within this of the line, voxels, and by a stretch of which so much is as near.
const MEANT_VOXELS: f32 = 2.5;
const MEANT_SHARE: f32 = 0.5;
/// Stations each way over which positions are averaged, within a stretch.
const SMOOTH: usize = 3;
/// Where the contact tip and the nozzle behind it are: from so far above the place to so far, in this radius, mm.
const TIP_MM: [f32; 2] = [10.0, 30.0];
const TIP_RADIUS_MM: f32 = 4.0;
/// Fewer points there are flying pixels.
const LEAST_IN_TIP: usize = 3;
/// One standard deviation across the line of a place that is clicked, voxels: the point of the model that is hit is anywhere
/// in its voxel. Two faces that are fitted to the model are not known to meet more exactly, on the simulated scans.
const CLICK_VOXELS: f64 = 0.29;
/// The same of a face's height. Chosen on the simulated scans.
const HEIGHT_VOXELS: f64 = 0.1;
/// Nothing that was measured says that there is a seam.
const CONFIDENCE: f64 = 0.5;
/// A station of another seam nearer than this is beside it, mm; more than half of them are the same seam.
const BESIDE_MM: f64 = 3.0;
/// A line that ends nearer to its beginning is closed, voxels.
const CLOSED_VOXELS: f32 = 1.0;
/// Fewest places of a loop; the last of them is the first again.
const LEAST_OF_LOOP: usize = 4;

/// The seam along a line of places, base frame; not yet numbered.
///
/// # Errors
/// In words, with the place, if the scan does not bear the line.
pub fn draw(input: &Input, places_mm: &[Point3<f64>], known: &[Seam]) -> Result<Seam, String> {
    let origin_mm = input.scan.merged.origin_mm;
    let places: Vec<_> = places_mm.iter().map(|p| Point3::from((p - origin_mm).cast::<f32>())).collect();
    let drawing = Drawing::new(input, places)?;
    let touches = drawing.touches()?;
    let stations = drawing.stations(&touches)?;
    drawing.clear_of_scene(&stations)?;
    Ok(drawing.described(&stations, &touches, known))
}

/// A line and what it is laid onto.
struct Drawing<'a> {
    input: &'a Input<'a>,
    voxel_mm: f32,
    places: Vec<Point3<f32>>,
    closed: bool,
}

/// A place on the line, before it is laid onto anything.
struct Sample {
    stretch: usize,
    place: Point3<f32>,
    along: Vector3<f32>,
}

/// A face about a place of the line.
#[derive(Debug, Clone)]
struct Face {
    centre: Point3<f32>,
    normal: Vector3<f32>,
    /// Scatter of its points about it, mm, and how many there are.
    scatter_mm: f32,
    points: Vec<usize>,
}

/// What the line touches at one of its places.
struct Touch {
    sample: Sample,
    /// The face that it is on, and the place there.
    own: Face,
    on_face: Point3<f32>,
    /// The other face, and where both meet, if they meet near the line.
    corner: Option<(Face, Point3<f32>)>,
}

impl Face {
    fn height_mm(&self, p: &Point3<f32>) -> f32 {
        self.normal.dot(&(p - self.centre))
    }

    fn foot(&self, p: &Point3<f32>) -> Point3<f32> {
        p - self.normal * self.height_mm(p)
    }
}

impl<'a> Drawing<'a> {
    fn new(input: &'a Input<'a>, mut places: Vec<Point3<f32>>) -> Result<Self, String> {
        let voxel_mm = input.model.voxel_mm();
        places.dedup_by(|b, a| (*b - *a).norm() < 0.1 * voxel_mm);
        let (Some(first), Some(last)) = (places.first(), places.last()) else { return Err(same_place()) };
        let closed = places.len() >= LEAST_OF_LOOP && (last - first).norm() < CLOSED_VOXELS * voxel_mm;
        if closed {
            let first = *first;
            places.pop();
            places.push(first);
        }
        if places.len() < 2 { Err(same_place()) } else { Ok(Self { input, voxel_mm, places, closed }) }
    }

    /// Places along the line at equal steps of about a voxel; the last of a closed one is not the first again.
    fn samples(&self) -> impl Iterator<Item = Sample> + '_ {
        let chords = self.places.windows(2).enumerate().flat_map(|(stretch, pair)| {
            let chord = pair[1] - pair[0];
            let steps = (chord.norm() / self.voxel_mm).ceil().max(1.0) as usize;
            let along = chord.normalize();
            (0..steps).map(move |k| Sample {
                stretch,
                place: pair[0] + chord * (k as f32 / steps as f32),
                along,
            })
        });
        let last = (!self.closed).then(|| {
            let [.., before, place] = self.places[..] else { unreachable!("two places or more") };
            Sample { stretch: self.places.len() - 2, place, along: (place - before).normalize() }
        });
        chords.chain(last)
    }

    fn words(&self, p: &Point3<f32>) -> String {
        let p = self.input.scan.merged.origin_mm + p.coords.cast::<f64>();
        format!("{:.0},{:.0},{:.0}", p.x, p.y, p.z)
    }

    /// What the line touches, from its beginning to its end.
    fn touches(&self) -> Result<Vec<Touch>, String> {
        // A line may be drawn into the void for kilometres: it is left at the first place that has nothing.
        self.samples().map(|sample| self.touch(sample)).collect()
    }

    fn touch(&self, sample: Sample) -> Result<Touch, String> {
        let v = self.voxel_mm;
        let index = self.input.model.index;
        let nothing =
            |p: &Point3<f32>, mm: f32| format!("nothing was scanned within {mm:.1} mm of {}", self.words(p));
        let nearest = index.nearest(&sample.place, OFF_MM, |_| true);
        let (slot, _) = nearest.ok_or_else(|| nothing(&sample.place, OFF_MM))?;
        // About the nearest point first: a chord is off a curved face.
        let mut seed = index.index(slot);
        let mut on_face = index.point(slot);
        let mut faces = self.faces(&on_face, seed);
        for _ in 0..2 {
            on_face = faces[0].foot(&sample.place);
            let hole_mm = HOLE_VOXELS * v;
            let nearest =
                index.nearest(&on_face, hole_mm, |_| true).ok_or_else(|| nothing(&on_face, hole_mm))?;
            seed = index.index(nearest.0);
            faces = self.faces(&on_face, seed);
        }
        on_face = faces[0].foot(&on_face);
        let root = |faces: &[Face], at: &Point3<f32>| {
            let root = meeting(&faces[0], faces.get(1)?, at, &sample.along)?;
            ((root - on_face).norm() < MEANT_VOXELS * v).then_some(root)
        };
        // About the corner both faces show alike.
        if let Some(first) = root(&faces, &on_face) {
            let mut about = self.faces(&first, seed);
            self.leave_the_corner(&mut about, &first);
            if root(&about, &first).is_some() {
                faces = about;
            }
        }
        let corner = root(&faces, &on_face).map(|root| (faces[1].clone(), root));
        Ok(Touch { sample, own: faces.swap_remove(0), on_face, corner })
    }

    /// The face that a place is on, and the one that it meets there, if there is another; points that look away from this one
    /// are of the back of a thin plate.
    fn faces(&self, at: &Point3<f32>, seed: usize) -> Vec<Face> {
        let normals = &self.input.model.cloud.normals;
        let mut about = Vec::new();
        let index = self.input.model.index;
        index.within(at, REACH_VOXELS * self.voxel_mm, |slot, _| about.push(index.index(slot)));
        about.retain(|&k| normals[k].dot(&normals[seed]) > -0.5);
        let Some([a, b]) = self.two_normals(&about) else {
            let sum: Vector3<f32> = about.iter().map(|&k| normals[k]).sum();
            return vec![self.face(about, sum.try_normalize(1e-3).unwrap_or(normals[seed]))];
        };
        let (on_a, on_b) = about.into_iter().partition(|&k| normals[k].dot(&a) >= normals[k].dot(&b));
        let mut faces = vec![self.face(on_a, a), self.face(on_b, b)];
        faces.sort_by(|a, b| a.height_mm(at).abs().total_cmp(&b.height_mm(at).abs()));
        faces
    }

    /// Fits two faces anew without what is near the place where they meet: voxels and filter round it.
    fn leave_the_corner(&self, faces: &mut [Face], root: &Point3<f32>) {
        let [a, b] = faces else { return };
        let Some(axis) = a.normal.cross(&b.normal).try_normalize(1e-3) else { return };
        let points_mm = &self.input.model.cloud.points_mm;
        let is_far = |k: &usize| (points_mm[*k] - root).cross(&axis).norm() > ROUNDED_VOXELS * self.voxel_mm;
        for face in [a, b] {
            let far: Vec<usize> = face.points.iter().copied().filter(is_far).collect();
            if far.len() >= LEAST_POINTS {
                *face = self.face(far, face.normal);
            }
        }
    }

    /// Normals of two faces, if these points are of two: the filter leaves others between them where they meet.
    fn two_normals(&self, about: &[usize]) -> Option<[Vector3<f32>; 2]> {
        let normals = &self.input.model.cloud.normals;
        let farthest = |from: &Vector3<f32>| {
            let least = about.iter().map(|&k| normals[k]).min_by(|a, b| a.dot(from).total_cmp(&b.dot(from)));
            least.unwrap_or(*from)
        };
        let sum: Vector3<f32> = about.iter().map(|&k| normals[k]).sum();
        let mut pair = [farthest(&sum), Vector3::zeros()];
        pair[1] = farthest(&pair[0]);
        let is_of = |k: usize, own: usize, pair: &[Vector3<f32>; 2]| {
            normals[k].dot(&pair[own]) > normals[k].dot(&pair[1 - own])
        };
        for alike in [-1.0, -1.0, ALIKE, ALIKE] {
            let mean = |own: usize| {
                let of_it =
                    about.iter().filter(|&&k| is_of(k, own, &pair) && normals[k].dot(&pair[own]) > alike);
                of_it.map(|&k| normals[k]).sum::<Vector3<f32>>().try_normalize(1e-3)
            };
            pair = [mean(0)?, mean(1)?];
        }
        let least = LEAST_POINTS.max((LEAST_SHARE * about.len() as f32) as usize);
        let clear = |normal: &Vector3<f32>| about.iter().filter(|&&k| normals[k].dot(normal) > ALIKE).count();
        (pair[0].dot(&pair[1]) < ONE_FACE && pair.iter().all(|normal| clear(normal) >= least)).then_some(pair)
    }

    /// The plane through those of these points that are of one face, which looks about this way.
    fn face(&self, mut points: Vec<usize>, normal: Vector3<f32>) -> Face {
        let cloud = self.input.model.cloud;
        let fitted = |points: &[usize], usual: Vector3<f32>| {
            let count = points.len().max(1) as f32;
            let centre = points.iter().map(|&k| cloud.points_mm[k].coords).sum::<Vector3<f32>>() / count;
            let sum: Vector3<f32> = points.iter().map(|&k| cloud.normals[k]).sum();
            let normal = sum.try_normalize(1e-3).unwrap_or(usual);
            let mut face = Face { centre: centre.into(), normal, scatter_mm: 0.0, points: points.to_vec() };
            let squared: f32 = points.iter().map(|&k| face.height_mm(&cloud.points_mm[k]).powi(2)).sum();
            face.scatter_mm = (squared / count).sqrt();
            face
        };
        let of_it: Vec<usize> =
            points.iter().copied().filter(|&k| cloud.normals[k].dot(&normal) > ALIKE).collect();
        let mut face = fitted(if of_it.is_empty() { &points } else { &of_it }, normal);
        for (layer_voxels, alike) in [(2.0 * LAYER_VOXELS, ALIKE), (LAYER_VOXELS, CLEARLY_ALIKE)] {
            points.retain(|&k| {
                let height_mm = face.height_mm(&cloud.points_mm[k]).abs();
                cloud.normals[k].dot(&face.normal) > alike && height_mm < layer_voxels * self.voxel_mm
            });
            if points.is_empty() {
                break;
            }
            face = fitted(&points, face.normal);
        }
        face
    }

    /// Which stretches lie where two faces meet.
    fn in_corners(&self, touches: &[Touch]) -> Vec<bool> {
        let mut counts = vec![[0.0_f32; 2]; self.places.len() - 1];
        for touch in touches {
            let [all, near] = &mut counts[touch.sample.stretch];
            *all += 1.0;
            *near += f32::from(u8::from(touch.corner.is_some()));
        }
        counts.iter().map(|[all, near]| *near >= MEANT_SHARE * *all).collect()
    }

    /// The face that the line meets in a stretch along a corner, about one of its places: that about the nearest which shows it.
    fn other(touches: &[Touch], k: usize) -> Option<&Face> {
        let of = |j: usize| touches.get(j).filter(|touch| touch.sample.stretch == touches[k].sample.stretch);
        let near = (0..touches.len()).flat_map(|n| [k.checked_sub(n), Some(k + n)]).flatten();
        near.filter_map(of).find_map(|touch| touch.corner.as_ref()).map(|(face, _)| face)
    }

    /// Places of the seam, and the two faces beside each.
    fn laid(&self, touches: &[Touch]) -> Vec<(Point3<f32>, [Vector3<f32>; 2])> {
        let in_corners = self.in_corners(touches);
        let lay = |(k, touch): (usize, &Touch)| {
            let other = in_corners[touch.sample.stretch].then(|| Self::other(touches, k)).flatten();
            let meet = |other: &Face| {
                let root = meeting(&touch.own, other, &touch.on_face, &touch.sample.along)?;
                Some((root, [touch.own.normal, other.normal]))
            };
            match &touch.corner {
                Some((face, root)) if other.is_some() => (*root, [touch.own.normal, face.normal]),
                _ => other.and_then(meet).unwrap_or((touch.on_face, [touch.own.normal; 2])),
            }
        };
        touches.iter().enumerate().map(lay).collect()
    }

    /// The stations of the seam.
    fn stations(&self, touches: &[Touch]) -> Result<Vec<Frame>, String> {
        let laid = self.laid(touches);
        let smooth: Vec<Point3<f32>> =
            (0..laid.len()).map(|k| mean(&laid[same_stretch(touches, k).both])).collect();
        let frame = |(k, (_, faces)): (usize, &(Point3<f32>, [Vector3<f32>; 2]))| {
            let Beside { before, behind, .. } = same_stretch(touches, k);
            // The place alone, where a stretch is one: its direction is that of the line on the face.
            let chord =
                if before == behind { touches[k].sample.along } else { smooth[behind] - smooth[before] };
            let along = chord - faces[0] * chord.dot(&faces[0]);
            Frame::new(smooth[k], along, *faces).ok_or_else(|| {
                format!("at {} the line leaves the face that it is on", self.words(&smooth[k]))
            })
        };
        laid.iter().enumerate().map(frame).collect()
    }

    /// Refuses a line along which something scanned would be in the torch's tip.
    fn clear_of_scene(&self, stations: &[Frame]) -> Result<(), String> {
        let reach_mm = TIP_MM[1] + TIP_RADIUS_MM;
        let bound = |axis: usize, fold: fn(f32, f32) -> f32, first: f32| {
            stations.iter().map(|s| s.position[axis]).fold(first, fold)
        };
        let low = [0, 1, 2].map(|axis| bound(axis, f32::min, f32::MAX) - reach_mm);
        let high = [0, 1, 2].map(|axis| bound(axis, f32::max, f32::MIN) + reach_mm);
        let inside = |p: &&Point3<f32>| (0..3).all(|axis| (low[axis]..high[axis]).contains(&p[axis]));
        let near: Vec<&Point3<f32>> = self.input.scene.cloud.points_mm.iter().filter(inside).collect();
        for station in stations {
            let axis = station.bisector();
            let in_tip = |p: &&&Point3<f32>| {
                let off = **p - station.position;
                let height = off.dot(&axis);
                (TIP_MM[0]..TIP_MM[1]).contains(&height) && (off - axis * height).norm() < TIP_RADIUS_MM
            };
            if near.iter().filter(in_tip).count() >= LEAST_IN_TIP {
                let place = self.words(&station.position);
                return Err(format!("something was scanned above {place}, where the torch's tip would be"));
            }
        }
        Ok(())
    }

    fn described(&self, stations: &[Frame], touches: &[Touch], known: &[Seam]) -> Seam {
        let scan = &self.input.scan;
        let in_corners = self.in_corners(touches);
        let cornered = touches.iter().filter(|touch| in_corners[touch.sample.stretch]).count();
        let refined = self.refined(stations, touches);
        let expected = expected::expect(&refined, scan, self.input.waves());
        let is_corner = 2 * cornered > touches.len();
        let reason = if is_corner { "drawn where two faces meet" } else { "drawn on one face" };
        let station = |f: &Frame| Station {
            position_mm: scan.merged.origin_mm + f.position.coords.cast::<f64>(),
            tangent: f.tangent.cast(),
            faces: f.faces.map(|n| n.cast()),
        };
        let Expected { position_mm, relative_mm, parts, fit, orientation_rad, base_mm, base_rad, .. } =
            expected;
        let mut seam = Seam {
            id: 0,
            joint: if is_corner { Joint::Fillet } else { Joint::ButtV },
            reason: reason.into(),
            stations: stations.iter().map(station).collect(),
            closed: self.closed,
            confidence: CONFIDENCE,
            expected_error_mm: position_mm,
            expected_error_deg: orientation_rad.to_degrees(),
            relative_error_mm: relative_mm,
            error_parts: parts,
            fit_error: fit,
            base_error_mm: base_mm,
            base_error_deg: base_rad.to_degrees(),
            contact: None,
            drawn: true,
            dimensions: Vec::new(),
            warnings: warnings(scan, &refined, &expected),
        };
        if let Some(other) = known.iter().find(|other| runs_beside(&seam, other)) {
            let words = format!("it is drawn along seam {}: leave one of the two out", other.id);
            seam.warnings.push(words);
        }
        seam
    }

    /// The line as the error of a seam is told of it: it moves with the cloud that it was drawn on, in both axes across it.
    fn refined(&self, stations: &[Frame], touches: &[Touch]) -> Refined {
        let v = f64::from(self.voxel_mm);
        let both = |f: &Frame| {
            let (n, o) = (f.bisector(), f.tangent.cross(&f.bisector()));
            Frame { faces: [n + o, n - o].map(|face| face.normalize()), ..*f }
        };
        let mean = |of: &dyn Fn(&Face) -> f64| {
            touches.iter().map(|touch| of(&touch.own)).sum::<f64>() / touches.len() as f64
        };
        let own_mm2 = mean(&|face| f64::from(face.scatter_mm).powi(2) / face.points.len() as f64)
            + (HEIGHT_VOXELS * v).powi(2);
        let reach_mm = REACH_VOXELS * self.voxel_mm;
        let sigma_mm = mean(&|face| f64::from(face.scatter_mm));
        Refined {
            frames: stations.iter().map(both).collect(),
            step_mm: self.voxel_mm,
            closed: self.closed,
            measured: vec![true; stations.len()],
            sigma_mm,
            scatter_mm: MEDIAN_OF_RMS * own_mm2.sqrt().hypot(CLICK_VOXELS * v),
            tilt_rad: own_mm2.sqrt() / f64::from(reach_mm),
            reach_mm: [reach_mm; 2],
            lift_unknown_mm: [0.0; 2],
            window_mm: self.voxel_mm,
            // Neighbouring stations share their points and a click its error: averaging makes nothing of it less.
            freedom: stations.len() as f64,
            view_share: touches.iter().map(|touch| self.shares(touch)).collect(),
            near: Vec::new(),
        }
    }

    /// Share of each view in what the line is laid onto.
    fn shares(&self, touch: &Touch) -> [Vec<f32>; 2] {
        let mut share = vec![0.0; self.input.scan.merged.cameras_mm.len()];
        let points = &touch.own.points;
        for &k in points {
            if let Some(sum) = share.get_mut(usize::from(self.input.model.voxels.view[k])) {
                *sum += 1.0 / points.len() as f32;
            }
        }
        [share.clone(), share]
    }
}

fn same_place() -> String {
    "the places are identical: give two along the seam".into()
}

/// Where two faces meet in the plane across the line at a place.
fn meeting(a: &Face, b: &Face, at: &Point3<f32>, along: &Vector3<f32>) -> Option<Point3<f32>> {
    let rows = Matrix3::from_rows(&[a.normal.transpose(), b.normal.transpose(), along.transpose()]);
    let heights = Vector3::new(-a.height_mm(at), -b.height_mm(at), 0.0);
    let by = rows.try_inverse()? * heights;
    by.iter().all(|mm| mm.is_finite()).then(|| at + by)
}

/// Places beside one that are of the same stretch.
struct Beside {
    /// As many on either side, itself among them.
    both: Range<usize>,
    before: usize,
    behind: usize,
}

fn same_stretch(touches: &[Touch], k: usize) -> Beside {
    let stretch = touches[k].sample.stretch;
    let of = |j: usize| touches.get(j).is_some_and(|touch| touch.sample.stretch == stretch);
    let before = (1..=SMOOTH).take_while(|n| k >= *n && of(k - n)).count();
    let behind = (1..=SMOOTH).take_while(|n| of(k + n)).count();
    let each = before.min(behind);
    Beside { both: k - each..k + each + 1, before: k - before, behind: k + behind }
}

fn mean(laid: &[(Point3<f32>, [Vector3<f32>; 2])]) -> Point3<f32> {
    Point3::from(laid.iter().map(|(p, _)| p.coords).sum::<Vector3<f32>>() / laid.len() as f32)
}

/// Whether most of a seam runs along another.
fn runs_beside(seam: &Seam, other: &Seam) -> bool {
    let near =
        |a: &Station| other.stations.iter().any(|b| (b.position_mm - a.position_mm).norm() < BESIDE_MM);
    2 * seam.stations.iter().filter(|station| near(station)).count() > seam.stations.len()
}
