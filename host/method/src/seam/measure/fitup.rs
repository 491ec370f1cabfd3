//! Fit-up: groove angle, depth and width, sheet thickness and root opening of a joint, each with its uncertainty (ours).
//!
//! Everything is measured in cross-sections square to the seam. The root opening needs the registered raw points, because
//! the voxel grid and the filter round what lies next to it (`root`); surfaces beyond the lips need not (`surface`).
//! A value that the scan does not show is not guessed: its place is taken by the reason.

mod evidence;
mod root;
mod sight;
mod surface;

pub use evidence::JointEvidence;
pub(crate) use root::groove_end_mm;

use super::dimension::{Dimension, Quantity, Value};
use crate::seam::Joint;

/// The dimensions that a joint of this kind has.
pub fn measure(evidence: &JointEvidence) -> Vec<Dimension> {
    let opening = root::opening(evidence);
    let angle = Dimension::new(Quantity::IncludedAngle, Ok(opening.angle_deg));
    let gap = Dimension::new(Quantity::RootOpening, opening.width_mm);
    let rest = match evidence.joint {
        Joint::ButtV => groove(evidence, opening.angle_deg, opening.width_mm),
        Joint::Lap => vec![sheet(evidence, opening.width_mm)],
        _ => Vec::new(),
    };
    std::iter::once(angle).chain(rest).chain([gap]).collect()
}

/// The same of a plate on a plate whose side nobody saw.
pub(crate) fn of_step(height_mm: f64, error_mm: f64) -> Vec<Dimension> {
    let step = Value { value: height_mm, uncertainty: 2.0 * error_mm };
    vec![
        Dimension::new(Quantity::SheetThickness, Ok(step)),
        Dimension::new(Quantity::RootOpening, Err("the side of the upper sheet was not seen")),
    ]
}

/// Depth and width of a groove between bevels that include `angle_deg`.
fn groove(evidence: &JointEvidence, angle_deg: Value, gap: Result<Value, &'static str>) -> Vec<Dimension> {
    let cotangent = 1.0 / (0.5 * angle_deg.value).to_radians().tan();
    // Of the cotangent, and of heights that come from the place of the seam.
    let unsure = (0.5 * angle_deg.uncertainty).to_radians() * (1.0 + cotangent * cotangent);
    let place_mm = 2.0 * evidence.expected.position_mm;
    let lips = [0, 1].map(|side| surface::above_bevel(evidence, side, cotangent));
    let both = match lips {
        [Some(a), Some(b)] => Ok((a, b)),
        _ => Err("the surface of the plates beside the groove was not seen"),
    };
    let width = both.map(|(a, b)| {
        let value = a.out_mm + b.out_mm;
        let top_mm = a.uncertainty_mm.hypot(b.uncertainty_mm).hypot(2.0 * place_mm);
        Value { value, uncertainty: top_mm.hypot(value * unsure) / cotangent }
    });
    let depth = both.and_then(|(a, b)| {
        let gap = gap?;
        let top_mm = (0.5 * a.uncertainty_mm.hypot(b.uncertainty_mm)).hypot(place_mm);
        let end_mm = (0.5 * gap.uncertainty * cotangent).hypot(0.5 * gap.value * unsure);
        let value = 0.5 * (a.up_mm + b.up_mm - gap.value * cotangent);
        Ok(Value { value, uncertainty: top_mm.hypot(end_mm) })
    });
    vec![Dimension::new(Quantity::GrooveDepth, depth), Dimension::new(Quantity::CapWidth, width)]
}

/// Thickness of the upper sheet of a lap joint.
fn sheet(evidence: &JointEvidence, gap: Result<Value, &'static str>) -> Dimension {
    let side = usize::from(evidence.short[1] && !evidence.short[0]);
    let step = surface::above_edge(evidence, side).ok_or("the top of the upper sheet was not seen");
    // A gap that cannot be told is part of the step.
    let (gap_mm, unsure_mm) = gap.map_or((0.0, 0.0), |gap| (gap.value, gap.uncertainty));
    let value = step
        .map(|step| Value { value: step.up_mm - gap_mm, uncertainty: step.uncertainty_mm.hypot(unsure_mm) });
    Dimension::new(Quantity::SheetThickness, value)
}
