//! A refined chain as a seam: stations in the base frame, confidence, expected errors and warnings (ours).

use super::input::RawScan;
use super::measure::dimension::Dimension;
use super::refine::Refined;
use super::refine::expected::Expected;
use super::trace::Chain;
use super::{Joint, Seam, Station, confidence};

/// Error from the registration, in standard deviations of the points' noise, above which a seam carries a warning. Chosen
/// on the simulated scans.
const LOOSE_NOISES: f64 = 0.38;
/// Standard deviations that a warning names.
const NAMED_DEVIATIONS: f64 = 2.0;
/// Longest bridged stretch that is not told, mm.
const UNTOLD_BRIDGE_MM: f64 = 4.0;
/// Least quality, and largest expected error of the torch, degrees, with which a seam is offered. Chosen on the
/// simulated scans.
const LEAST_QUALITY: f64 = 0.6;
const MOST_ERROR_DEG: f64 = 6.0;
/// The least quality where several views show both sides of a wall: of the points about a corner of a thin rib a third
/// may then be of the far side, on neither face, and five sixths of [`FULL_SHARE`] are all that there can be.
const LEAST_QUALITY_OF_VIEWS: f64 = LEAST_QUALITY * 5.0 / 6.0;
/// Largest expected error of the torch, degrees, with which that is enough. The ribs' corners are known to 1 to 2; what
/// widened or blurred image edges make up, at the same quality, to 2.1 to 5.8 (250 seams of pieces and effects, simulated).
const MOST_ERROR_OF_RIB_DEG: f64 = 2.0;
/// Views up to which a seam is offered with all that one of them knows of it. The foot inside a pipe, seen over its rim by one of
/// six, has the torch 1 to 4 degrees off; with its limit for any number of views, a twentieth of the weld length that is found on
/// 40 scans of another person's generator is lost, hardly any of it false.
const FEW_VIEWS: usize = 4;
/// Corners to a link of a chain, and share of the points about them on the two faces, from which on nothing is missing to
/// full quality. Chosen on the simulated scans.
const FULL_CORNERS: f64 = 3.0;
const FULL_SHARE: f32 = 0.8;

/// What kind of joint a seam is, why, and what was measured of it.
pub(super) struct Identity {
    pub(super) joint: Joint,
    pub(super) reason: String,
    pub(super) dimensions: Vec<Dimension>,
}

/// A refined chain as a seam; its number is given when all are known.
pub(super) fn described(
    scan: &RawScan,
    chain: &Chain,
    seam: &Refined,
    expected: &Expected,
    identity: Identity,
) -> Seam {
    let station = |f: &super::refine::frame::Frame| Station {
        position_mm: scan.merged.origin_mm + f.position.coords.cast::<f64>(),
        tangent: f.tangent.cast(),
        faces: f.faces.map(|n| n.cast()),
    };
    let Identity { joint, reason, dimensions } = identity;
    Seam {
        id: 0,
        joint,
        reason,
        stations: seam.frames.iter().map(station).collect(),
        closed: seam.closed,
        confidence: confidence::probability(quality(chain, seam)),
        expected_error_mm: expected.position_mm,
        expected_error_deg: expected.orientation_rad.to_degrees(),
        relative_error_mm: expected.relative_mm,
        error_parts: expected.parts,
        fit_error: expected.fit,
        base_error_mm: expected.base_mm,
        base_error_deg: expected.base_rad.to_degrees(),
        contact: None,
        drawn: false,
        dimensions,
        warnings: warnings(scan, seam, expected),
    }
}

/// 0..1: by the share of stations that were measured, the corners that support each link, and how clean these are.
fn quality(chain: &Chain, seam: &Refined) -> f64 {
    let measured = seam.measured.iter().filter(|m| **m).count() as f64 / seam.measured.len() as f64;
    let density = chain.support as f64 / (FULL_CORNERS * chain.links.len() as f64);
    (measured * density.min(1.0) * f64::from(chain.share / FULL_SHARE).min(1.0)).clamp(0.0, 1.0)
}

/// What is said of it.
pub(super) fn warnings(scan: &RawScan, seam: &Refined, expected: &Expected) -> Vec<String> {
    let mut warnings = Vec::new();
    if expected.registration_mm > LOOSE_NOISES * seam.sigma_mm {
        let views: Vec<&str> =
            expected.loose_views.iter().filter_map(|&k| scan.view_names.get(k).copied()).collect();
        let d = expected.loosest;
        warnings.push(format!(
            "{} not constrained along ({:.2}, {:.2}, {:.2}) by surfaces that other views share: the seam may be off by {:.1} mm \
             in that direction; add a view that shows those faces and the first view's",
            if views.len() == 1 { format!("{} is", views[0]) } else { format!("{} are", views.join(", ")) },
            d.x,
            d.y,
            d.z,
            NAMED_DEVIATIONS * expected.registration_mm
        ));
    }
    let bridged_mm = seam.longest_gap() as f64 * f64::from(seam.step_mm);
    if bridged_mm > UNTOLD_BRIDGE_MM {
        warnings.push(format!("{bridged_mm:.0} mm were bridged without points: scan that part again"));
    }
    warnings
}

/// Shorter than this is no weld but a spot of one, as wide as a bead, mm.
const LEAST_LENGTH_MM: f64 = 5.0;

/// Whether a seam is sure enough to be offered.
///
/// Whoever takes many views can take one more: a seam with a face that one of many alone saw (`is_seen_alone`) is offered where its
/// torch is as well known as a rib's, and named else.
pub(super) fn is_sure(scan: &RawScan, seam: &Seam, is_seen_alone: bool) -> bool {
    if seam.length_mm() < LEAST_LENGTH_MM {
        return false;
    }
    let may_be_rib = scan.merged.cameras_mm.len() > 1 && seam.fit_error.torch_deg <= MOST_ERROR_OF_RIB_DEG;
    let least = if may_be_rib { LEAST_QUALITY_OF_VIEWS } else { LEAST_QUALITY };
    let could_see_better = is_seen_alone && scan.merged.cameras_mm.len() > FEW_VIEWS;
    let most_deg = if could_see_better { MOST_ERROR_OF_RIB_DEG } else { MOST_ERROR_DEG };
    seam.confidence >= confidence::probability(least) && seam.fit_error.torch_deg <= most_deg
}

/// Least quality of a seam that was asked for: the corners of a faint one are few, and a person saw it.
const LEAST_QUALITY_ASKED: f64 = 0.3;

/// Whether a seam that a person asked for is sure enough to be offered: all but the number of its corners counts as it does
/// for one that was found.
pub(super) fn is_sure_if_asked(seam: &Seam) -> bool {
    seam.length_mm() >= LEAST_LENGTH_MM
        && seam.confidence >= confidence::probability(LEAST_QUALITY_ASKED)
        && seam.fit_error.torch_deg <= MOST_ERROR_DEG
}

/// What is said of a seam that is not.
pub(super) fn left_out(seam: &Seam) -> String {
    if seam.length_mm() < LEAST_LENGTH_MM {
        return format!("{} is too short to weld: check the units", seam.as_inside_corner());
    }
    format!(
        "{} is too uncertain to weld (confidence {:.0} %, torch to {:.0} deg): scan it again from closer, or \
         from more sides",
        seam.as_inside_corner(),
        100.0 * seam.confidence,
        seam.expected_error_deg
    )
}
