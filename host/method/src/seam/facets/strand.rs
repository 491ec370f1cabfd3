//! Pieces strung together: each once, end to end, as long as neither the way nor the faces turn sharply.

use super::corner::Piece;
use crate::geometry::mesh::Tree;
use nalgebra::{Point3, Vector3};

/// Pieces in their order, each from its first end to its second, faces on the same hand throughout.
#[derive(Debug, Clone)]
pub(super) struct Strand {
    pub pieces: Vec<Piece>,
    pub closed: bool,
}

impl Strand {
    pub(super) fn length_mm(&self) -> f64 {
        self.pieces.iter().map(Piece::length_mm).sum()
    }

    /// Whether it is seen from outside: one answer for the whole of it, so that alike corners are as long as each other, however
    /// few of the rays find the mouth of a bore. Whether a torch gets in is another question.
    pub(super) fn is_seen(&self) -> bool {
        let seen_mm: f64 = self.pieces.iter().map(|piece| piece.seen * piece.length_mm()).sum();
        seen_mm >= LEAST_SEEN * self.length_mm()
    }
}

/// Share of a corner that must be seen: at one place rays leave a closed body through a fault of its mesh, too.
const LEAST_SEEN: f64 = 0.1;
/// Pieces side by side nearer than this, with the same faces, are one corner drawn twice, mm: bodies that touch with a gap.
const BESIDE_MM: f64 = 0.6;
/// Ends nearer than this go on into each other, mm; in a straight line farther ones, past a crack between plates.
const JOIN_MM: f64 = 0.5;
const JOIN_STRAIGHT_MM: f64 = 1.0;
/// Cosines of the largest turn of way and faces from piece to piece, about 35 degrees, and of a straight line.
const JOIN_COSINE: f64 = 0.82;
const STRAIGHT_COSINE: f64 = 0.9986;
/// Cosine of the largest angle between pieces that are the same.
const SAME_COSINE: f64 = 0.98;
/// What is left of a piece that was drawn twice counts from here, mm.
const LEAST_MM: f64 = 0.02;

/// Whether the faces of two pieces are alike, and in the same order or swapped.
fn alike(a: &[Vector3<f64>; 2], b: &[Vector3<f64>; 2], cosine: f64) -> Option<bool> {
    let same = |b: [&Vector3<f64>; 2]| (0..2).map(|k| a[k].dot(b[k])).fold(f64::MAX, f64::min);
    let (straight, swapped) = (same([&b[0], &b[1]]), same([&b[1], &b[0]]));
    (straight.max(swapped) > cosine).then_some(swapped > straight)
}

fn tree(pieces: &[Piece]) -> Tree {
    Tree::new(&pieces.iter().map(|p| [p.ends[0], p.ends[1], p.ends[1]]).collect::<Vec<_>>())
}

/// Drops what is drawn twice: of two the shorter.
pub(super) fn once(mut pieces: Vec<Piece>) -> Vec<Piece> {
    pieces.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
    let tree = tree(&pieces);
    let left = |(i, piece): (usize, &Piece)| {
        let length = piece.length_mm();
        let mut spans = vec![[0.0, length]];
        let [low, high] = [piece.ends[0].inf(&piece.ends[1]), piece.ends[0].sup(&piece.ends[1])];
        let margin = Vector3::repeat(BESIDE_MM);
        tree.in_box(&(low - margin), &(high + margin), |j| {
            let longer = &pieces[j as usize];
            let beside = (j as usize) < i && longer.along.dot(&piece.along).abs() > SAME_COSINE;
            if let Some(covered) = beside.then(|| covered(piece, longer)).flatten() {
                spans = spans.iter().flat_map(|span| without(*span, covered)).collect();
            }
        });
        let part = |[from, to]: [f64; 2]| Piece {
            ends: [from, to].map(|t| piece.ends[0] + piece.along * t),
            ..*piece
        };
        spans.retain(|[from, to]| to - from > LEAST_MM);
        spans.into_iter().map(part).collect::<Vec<_>>()
    };
    pieces.iter().enumerate().flat_map(left).collect()
}

/// The stretch of `piece` beside which `longer` runs with the same faces.
fn covered(piece: &Piece, longer: &Piece) -> Option<[f64; 2]> {
    alike(&piece.normals, &longer.normals, SAME_COSINE)?;
    let t = longer.ends.map(|end| (end - piece.ends[0]).dot(&piece.along));
    let span = [t[0].min(t[1]).max(0.0), t[0].max(t[1]).min(piece.length_mm())];
    let middle = piece.ends[0] + piece.along * (0.5 * (span[0] + span[1]));
    let off = (middle - longer.ends[0]).cross(&longer.along).norm();
    (span[0] < span[1] && off < BESIDE_MM).then_some(span)
}

fn without([from, to]: [f64; 2], [a, b]: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
    [[from, to.min(a)], [from.max(b), to]].into_iter().filter(|[from, to]| from < to)
}

/// An end of a piece: which, and whether it is its second.
type End = (usize, usize);

/// Strings pieces together.
pub(super) fn strands(pieces: Vec<Piece>) -> Vec<Strand> {
    let links = links(&pieces);
    let mut done = vec![false; pieces.len()];
    let free = (0..pieces.len()).flat_map(|i| [(i, 0), (i, 1)]).filter(|&(i, e)| links[i][e].is_none());
    let seeds: Vec<End> = free.chain((0..pieces.len()).map(|i| (i, 0))).collect();
    let mut strands = Vec::new();
    for seed in seeds {
        if !done[seed.0] {
            strands.push(walk(&pieces, &links, &mut done, seed));
        }
    }
    strands
}

/// From an end of a piece on until there is no next.
fn walk(pieces: &[Piece], links: &[[Option<End>; 2]], done: &mut [bool], seed: End) -> Strand {
    let mut strand = Strand { pieces: Vec::new(), closed: false };
    let mut next = Some(seed);
    while let Some((i, enter)) = next {
        if std::mem::replace(&mut done[i], true) {
            strand.closed = (i, enter) == seed;
            break;
        }
        let mut piece = pieces[i];
        if enter == 1 {
            piece.ends.swap(0, 1);
            piece.along = -piece.along;
        }
        if strand.pieces.last().is_some_and(|last| alike(&last.normals, &piece.normals, -2.0) == Some(true)) {
            piece.normals.swap(0, 1);
        }
        strand.pieces.push(piece);
        next = links[i][1 - enter];
    }
    strand
}

/// Which end each end goes on into: the nearest first, each once.
fn links(pieces: &[Piece]) -> Vec<[Option<End>; 2]> {
    let point = |&(i, e): &End| pieces[i].ends[e];
    let outward = |&(i, e): &End| if e == 1 { pieces[i].along } else { -pieces[i].along };
    let ends: Vec<End> = (0..pieces.len()).flat_map(|i| [(i, 0), (i, 1)]).collect();
    let places: Vec<[Point3<f64>; 3]> = ends.iter().map(|end| [point(end); 3]).collect();
    let tree = Tree::new(&places);
    let mut near: Vec<(f64, f64, End, End)> = Vec::new();
    for (a, own) in ends.iter().enumerate() {
        let margin = Vector3::repeat(JOIN_STRAIGHT_MM);
        tree.in_box(&(point(own) - margin), &(point(own) + margin), |b| {
            let other = ends[b as usize];
            let away_mm = (point(&other) - point(own)).norm();
            let cosine = -outward(own).dot(&outward(&other));
            let reach_mm = if cosine > STRAIGHT_COSINE { JOIN_STRAIGHT_MM } else { JOIN_MM };
            let goes_on = cosine > JOIN_COSINE
                && away_mm < reach_mm
                && alike(&pieces[own.0].normals, &pieces[other.0].normals, JOIN_COSINE).is_some();
            if (b as usize) > a && other.0 != own.0 && goes_on {
                near.push((away_mm, 1.0 - cosine, *own, other));
            }
        });
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3))));
    let mut links = vec![[None; 2]; pieces.len()];
    for (_, _, a, b) in near {
        if links[a.0][a.1].is_none() && links[b.0][b.1].is_none() {
            links[a.0][a.1] = Some(b);
            links[b.0][b.1] = Some(a);
        }
    }
    links
}
