//! Options of `weldpath plan` that say how the seams are welded: the frequent ones of the job file's.

use super::{Exit, Failure};
use weldpath::run::job::Job;
use weldpath::run::job::layer::Direction;
use weldpath::run::job::quantity::{
    AmplitudeMm, ExtendMm, LeadMm, PitchMm, StitchMm, Tacks, TravelAngleDeg, WavelengthMm, WorkAngleDeg,
};
use weldpath::weld::stitching::Pattern;
use weldpath::weld::weave::Shape;

/// They hold for every seam that has no setting of its own in the job file; docs/welding.md shows each.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "How the seams are welded")]
pub(super) struct WeldArgs {
    /// Lean the torch to the right of the travel; negative to the left [default: 0]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    work_angle_deg: Option<WorkAngleDeg>,
    /// Push (positive) or drag (negative) [default: 0]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    travel_angle_deg: Option<TravelAngleDeg>,
    /// Which way the seams are welded [default: free]
    #[arg(long, value_name = "WAY")]
    direction: Option<Direction>,
    /// Weld this much beyond both ends; negative shortens [default: 0]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    extend_mm: Option<ExtendMm>,
    /// Move straight onto the start and off the end for this long, arc off [default: 0]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    lead_mm: Option<LeadMm>,
    /// Swing about the seam [default: none]
    #[arg(long, value_name = "SHAPE")]
    weave: Option<Shape>,
    /// From the seam to the farthest place of the weave on either side [default: 2]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    amplitude_mm: Option<AmplitudeMm>,
    /// Travel in one wave [default: 4]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    wavelength_mm: Option<WavelengthMm>,
    /// Weld stitches with this distance from centre to centre
    #[arg(long, value_name = "MM", allow_negative_numbers = true, conflicts_with = "tacks")]
    pitch_mm: Option<PitchMm>,
    /// Weld this many tacks on each seam
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    tacks: Option<Tacks>,
    /// Length of each stitch or tack [default: 20]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    stitch_mm: Option<StitchMm>,
}

impl WeldArgs {
    /// Puts what was given over the job's settings.
    pub(super) fn put_on(&self, job: &mut Job) {
        let (path, torch, weave, stitch) = (&mut job.path, &mut job.torch, &mut job.weave, &mut job.stitch);
        torch.work_angle_deg = self.work_angle_deg.or(torch.work_angle_deg);
        torch.travel_angle_deg = self.travel_angle_deg.or(torch.travel_angle_deg);
        path.direction = self.direction.or(path.direction);
        path.extend_start_mm = self.extend_mm.or(path.extend_start_mm);
        path.extend_end_mm = self.extend_mm.or(path.extend_end_mm);
        path.lead_in_mm = self.lead_mm.or(path.lead_in_mm);
        path.lead_out_mm = self.lead_mm.or(path.lead_out_mm);
        weave.shape = self.weave.or(weave.shape);
        weave.amplitude_mm = self.amplitude_mm.or(weave.amplitude_mm);
        if self.wavelength_mm.is_some() {
            (weave.wavelength_mm, weave.frequency_hz) = (self.wavelength_mm, None);
        }
        stitch.length_mm = self.stitch_mm.or(stitch.length_mm);
        if self.pitch_mm.is_some() {
            (stitch.pattern, stitch.pitch_mm) = (Some(Pattern::Stitches), self.pitch_mm);
        }
        if self.tacks.is_some() {
            (stitch.pattern, stitch.count) = (Some(Pattern::Tacks), self.tacks);
        }
    }

    /// Refuses options that nothing in the job makes use of.
    pub(super) fn check(&self, job: &Job) -> Result<(), Failure> {
        let recipes = job.recipes();
        let refused = |option: &str, hint: &str| {
            Err(Failure::new(Exit::Usage, format!("{option} changes nothing in this job")).hint(hint))
        };
        let swings = [
            ("--amplitude-mm", self.amplitude_mm.is_some()),
            ("--wavelength-mm", self.wavelength_mm.is_some()),
        ];
        if let Some((option, _)) = swings.iter().find(|(_, given)| *given)
            && recipes.iter().all(|recipe| recipe.weave.shape == Shape::None)
        {
            return refused(option, "no seam weaves: add --weave sine, or another shape");
        }
        if self.stitch_mm.is_some()
            && recipes.iter().all(|recipe| recipe.stitch.pattern == Pattern::Continuous)
        {
            return refused("--stitch-mm", "every seam is welded through: add --pitch-mm or --tacks");
        }
        Ok(())
    }
}
