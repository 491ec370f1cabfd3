//! Seams that a person asks for (ours): two places or more near a corner that the search passed over.
//!
//! Nothing is drawn: corners are fitted beside the line that was clicked, first to the points that the search takes, then to
//! all, and go the way of all others, through chains, refinement and judgement. Where they make no seam, the answer says
//! what is there instead. Millimetres; the clicked places are in the base frame.

mod line;

use self::line::{AskedLine, MEANT_MM, REACH_MM};
use super::description::{is_sure_if_asked, left_out};
use super::extraction::{
    STEP_ERROR_VOXELS, SeamConfig, corner_seam, refined, shows_better, shows_sheets, step_seam, traced,
};
use super::input::Input;
use super::refine::frame::Frame;
use super::refine::{Refined, layers, overlap};
use super::score::edges::{self, Scores};
use super::trace::chain::TraceConfig;
use super::trace::corner::{self, CornerConfig};
use super::trace::step::{self, StepModel};
use super::trace::support::{self, Support};
use super::trace::{Chain, InsideCorner};
use super::{Joint, Seam};
use nalgebra::Point3;
use std::cell::OnceCell;

/// What became of the wish for a seam.
#[derive(Debug)]
pub enum Answer {
    /// It is there; not yet numbered.
    Found(Box<Seam>),
    /// It is this seam, which is known already.
    Known(usize),
    /// It is not there; what is instead, in words.
    Nothing(String),
}

// All chosen on the simulated scans.

/// Two faces about a point that the search does not take: flatter and sharper corners, and fewer points on the faces.
const EASED_DEG: (f32, f32) = (20.0, 160.0);
const EASED_SHARE: f32 = 0.4;
/// Shortest chain that is refined, voxels: as many steps as make the least number of stations.
const SHORTEST_VOXELS: f32 = 7.65;
/// Least share of what was asked for that a seam runs beside.
const LEAST_COVERED: f32 = 0.6;
/// A seam is another than those that are known if more than this share of it is.
const LEAST_NEW: f32 = 0.5;
/// Of points that look one way so many are one face; and the cosine of one way.
const FLUSH_SHARE: f32 = 0.97;
const ONE_WAY: f32 = 0.94;
/// Fewer points about the line show no face.
const LEAST_POINTS: usize = 20;

/// What all wishes of one plan ask of the same cloud: made once, where the first asks.
#[derive(Default)]
pub struct Shared {
    scores: OnceCell<Scores>,
    table: OnceCell<Option<Support>>,
    /// The chains of the search.
    chains: OnceCell<Vec<Chain>>,
}

/// The seam along a line of places, mm, base frame, that is none of those that are `known`.
pub fn find(
    input: &Input,
    shared: &Shared,
    places_mm: &[Point3<f64>],
    known: &[Seam],
    config: &SeamConfig,
) -> Answer {
    let origin_mm = input.scan.merged.origin_mm;
    let places = places_mm.iter().map(|p| Point3::from((p - origin_mm).cast::<f32>())).collect();
    let Some(line) = AskedLine::new(places) else {
        return Answer::Nothing("the places are identical: give two along the seam".into());
    };
    let taken =
        |seam: &Seam| -> Vec<Frame> { seam.stations.iter().map(|s| Frame::of(s, &origin_mm)).collect() };
    let known = known.iter().map(|seam| (seam.id, taken(seam))).collect();
    let wish = Wish { input, shared, line, known, config };
    wish.answer()
}

/// A wish for a seam, and where it is looked for.
struct Wish<'a> {
    input: &'a Input<'a>,
    shared: &'a Shared,
    line: AskedLine,
    known: Vec<(usize, Vec<Frame>)>,
    config: &'a SeamConfig,
}

impl Wish<'_> {
    /// Each kind of evidence in its turn; the first that makes a seam, or the reason of the one that came farthest.
    fn answer(&self) -> Answer {
        let near = self.points_near();
        if near.len() < LEAST_POINTS {
            return Answer::Nothing(format!("no surface was scanned within {REACH_MM} mm of that line"));
        }
        let corners = self.config.corner.for_scan(&self.input.scan);
        let eased = CornerConfig { angle_deg: EASED_DEG, least_share: EASED_SHARE, ..corners };
        let mut candidates = self.scores().candidates();
        candidates.retain(|&k| self.is_near(k));
        let clear = self.corners(&candidates, &corners);
        let all = self.corners(&near, &eased);
        let trace = TraceConfig {
            shortest_voxels: SHORTEST_VOXELS,
            shortest_end_voxels: SHORTEST_VOXELS,
            ..self.config.trace
        };
        let near_by = [(&clear.0, trace), (&all.0, trace), (&all.0, trace.blurred())];
        let near_by = near_by.into_iter().map(|(corners, trace)| traced(self.input, corners, &trace));
        // First as the search strings them: a line that was clicked cuts the corners of a curved seam.
        let mut missed = None;
        for chains in std::iter::once(self.searched(&corners)).chain(near_by) {
            match self.best(&chains) {
                Err(why) => missed = missed.or(why),
                Ok(Answer::Found(lap)) if lap.joint == Joint::Lap => return self.better_by_step(lap),
                Ok(answer) => return answer,
            }
        }
        let on_table = !all.1.is_empty();
        match self.step() {
            Ok(answer) => answer,
            Err(why) => Answer::Nothing(missed.or(why).unwrap_or_else(|| self.absent(&near, on_table))),
        }
    }

    /// A lap, or the step at its place if that shows it better.
    fn better_by_step(&self, lap: Box<Seam>) -> Answer {
        match self.step() {
            Ok(Answer::Found(step)) if shows_better(&step, &lap, self.input.model.voxel_mm()) => {
                Answer::Found(step)
            }
            _ => Answer::Found(lap),
        }
    }

    fn is_near(&self, k: usize) -> bool {
        let most_mm = REACH_MM + self.config.corner.move_voxels * self.input.model.voxel_mm();
        self.line.away_mm(&self.input.model.voxels.cloud.points_mm[k]) <= most_mm
    }

    fn points_near(&self) -> Vec<usize> {
        (0..self.input.model.voxels.cloud.len()).filter(|&k| self.is_near(k)).collect()
    }

    /// Corners at these points that may be meant: off the table, and on it.
    fn corners(&self, at: &[usize], config: &CornerConfig) -> (Vec<InsideCorner>, Vec<InsideCorner>) {
        let mut corners = corner::corners_at(&self.input.model, at, config);
        corners.retain(|c| self.line.may_mean(&c.position, &c.direction));
        self.parted(corners)
    }

    /// The chains of the search that come near to the line.
    fn searched(&self, config: &CornerConfig) -> Vec<Chain> {
        let chains = self.shared.chains.get_or_init(|| {
            let corners = corner::corners(&self.input.model, self.scores(), config);
            traced(self.input, &self.parted(corners).0, &self.config.trace)
        });
        let is_near =
            |chain: &&Chain| chain.links.iter().any(|link| self.line.away_mm(&link.position) <= MEANT_MM);
        chains.iter().filter(is_near).cloned().collect()
    }

    fn scores(&self) -> &Scores {
        self.shared.scores.get_or_init(|| edges::score(&self.input.model))
    }

    /// Those off the table, and those on it.
    fn parted(&self, corners: Vec<InsideCorner>) -> (Vec<InsideCorner>, Vec<InsideCorner>) {
        let table = self.table();
        let is_on_table =
            |c: &InsideCorner| table.is_some_and(|t| c.faces.iter().any(|face| t.is_face(face, &c.position)));
        corners.into_iter().partition(|corner| !is_on_table(corner))
    }

    /// The table, if it is one: the lowest plane of a cropped cloud is part of the work.
    fn table(&self) -> Option<&Support> {
        let scan = &self.input.scan;
        let find = || {
            let support =
                scan.has_whole_views().then(|| support::find(self.input.scene, scan.table_edge())).flatten();
            support.filter(|support| support.is_table(scan))
        };
        self.shared.table.get_or_init(find).as_ref()
    }

    /// The chain that lies best, refined; why there is none, if something was there.
    fn best(&self, chains: &[Chain]) -> Result<Answer, Option<String>> {
        let refine = |chain: &Chain| refined(self.input, chain, self.config);
        let most_mm = self.config.refine.reach * self.input.model.voxel_mm();
        self.chosen(chains, refine, |chain, seam| corner_seam(self.input, chain, seam, most_mm))
    }

    /// The same at the foot of a step, where no side of the upper plate was seen.
    fn step(&self) -> Result<Answer, Option<String>> {
        if !self.input.cues.steps {
            return Err(None);
        }
        let v = self.input.model.voxel_mm();
        let model = StepModel::new(&self.input.model.voxels.cloud, v);
        let plates = self.config.step;
        let step = if shows_sheets(self.input) { plates.for_layers_of(&model) } else { plates };
        let most_mm = MEANT_MM + step.reach_voxels() * v;
        let line = &self.line;
        let mut corners = step::corners_beside(&model, &step, |p| line.away_mm(p) <= most_mm);
        let table = self.table();
        corners.retain(|c| {
            self.line.may_mean(&c.position, &c.direction)
                && !table.is_some_and(|t| t.is_face(&c.faces[0], &c.position))
        });
        let chains = traced(self.input, &corners, &self.config.trace);
        let refine = |chain: &Chain| layers::refine(&self.input.scan, chain, v, &self.config.refine, &step);
        match self.chosen(&chains, refine, |chain, seam| step_seam(self.input, chain, seam)) {
            Ok(Answer::Found(seam)) if seam.fit_error.position_mm >= STEP_ERROR_VOXELS * f64::from(v) => {
                Err(Some(left_out(&seam)))
            }
            answer => answer,
        }
    }

    /// Of the refined chains that run beside the line and are sure: the nearest that is new, else the nearest known one.
    fn chosen(
        &self,
        chains: &[Chain],
        refine: impl Fn(&Chain) -> Option<Refined>,
        describe: impl Fn(&Chain, &Refined) -> Seam,
    ) -> Result<Answer, Option<String>> {
        let mut missed = (!chains.is_empty()).then(|| {
            "two faces meet there, but too little of them was scanned to fit a seam: scan it from closer, or \
             from more sides"
                .to_owned()
        });
        let mut found: Vec<(f32, Answer)> = Vec::new();
        for chain in chains {
            let Some(mut whole) = refine(chain) else { continue };
            let places = |seam: &Refined| seam.frames.iter().map(|f| f.position).collect::<Vec<_>>();
            let covered = self.line.covered(&places(&whole));
            if covered < LEAST_COVERED {
                missed = Some(format!("two faces meet beside {:.0} % of that line only", 100.0 * covered));
                continue;
            }
            let away_mm = self.away_mm(&whole);
            if let Some(id) = self.known(&whole.frames) {
                found.push((away_mm, Answer::Known(id)));
                continue;
            }
            let meant = self.line.meant(&places(&whole));
            cut(&mut whole, &meant);
            let seam = describe(chain, &whole);
            if is_sure_if_asked(&seam) {
                found.push((away_mm, Answer::Found(Box::new(seam))));
            } else {
                missed = Some(left_out(&seam));
            }
        }
        let rank = |(away_mm, answer): &(f32, Answer)| (matches!(answer, Answer::Known(_)), *away_mm);
        let best = found.into_iter().min_by(|a, b| {
            let (a, b) = (rank(a), rank(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        best.map(|(_, answer)| answer).ok_or(missed)
    }

    /// Mean distance of a seam's stations from the line, mm.
    fn away_mm(&self, seam: &Refined) -> f32 {
        let sum: f32 = seam.frames.iter().map(|f| self.line.away_mm(&f.position)).sum();
        sum / seam.frames.len().max(1) as f32
    }

    /// The known seam that runs where these stations are.
    fn known(&self, frames: &[Frame]) -> Option<usize> {
        let voxel_mm = self.input.model.voxel_mm();
        let same = |taken: &[Frame]| {
            overlap::free(frames, taken, voxel_mm).iter().filter(|free| !**free).count() as f32
                / frames.len().max(1) as f32
        };
        let shares = self.known.iter().map(|(id, taken)| (*id, same(taken)));
        let (id, share) = shares.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (share > LEAST_NEW).then_some(id)
    }

    /// What is there in place of an inside corner.
    fn absent(&self, near: &[usize], on_table: bool) -> String {
        if on_table {
            return "the only inside corner there is where the work rests on the table".into();
        }
        let normals = &self.input.model.voxels.cloud.normals;
        let alike = |n: usize| near.iter().filter(|&&k| normals[k].dot(&normals[n]) > ONE_WAY).count();
        let few = near.iter().step_by(1 + near.len() / LEAST_POINTS);
        let most = few.map(|&k| alike(k)).max().unwrap_or(0) as f32;
        if most > FLUSH_SHARE * near.len() as f32 {
            return "there is one face, or two that are flush, and no corner".into();
        }
        "no two faces meet there in an inside corner: the edge is an outside one, or runs in another \
         direction"
            .into()
    }
}

/// Leaves the longest stretch of a seam that is meant.
fn cut(seam: &mut Refined, meant: &[bool]) {
    let Some(from) = meant.iter().position(|meant| *meant) else { return };
    let length = meant[from..].iter().take_while(|meant| **meant).count();
    if length < meant.len() {
        seam.keep(from..from + length);
    }
}
