//! The rest of a program whose weld was broken off.

use crate::run::job::layer::Weld;
use crate::run::job::resume::ResumeSettings;
use weldpath_method::weld::SeamPath;
use weldpath_method::weld::ends::rest;
use weldpath_method::weld::program::Pass;

/// Why there is no such rest.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The program does not weld it.
    #[error("the rest cannot begin in seam {seam}: the program welds {}", list(.welded))]
    Seam {
        /// What was asked for.
        seam: usize,
        /// In their order.
        welded: Vec<usize>,
    },
    /// It has no such pass.
    #[error("seam {seam} has {passes} passes, and no pass {pass}")]
    Pass {
        /// The seam.
        seam: usize,
        /// Which was asked for, counted from 1.
        pass: usize,
        /// How many there are.
        passes: usize,
    },
    /// It ends before.
    #[error("nothing of seam {seam} is left after {from_mm:.1} mm: it ends at {end_mm:.1} mm")]
    Nothing {
        /// The seam.
        seam: usize,
        /// Where the rest would begin.
        from_mm: f64,
        /// Where it ends.
        end_mm: f64,
    },
}

fn list(seams: &[usize]) -> String {
    seams.iter().map(|seam| format!("seam {seam}")).collect::<Vec<_>>().join(", ")
}

/// The seams from the broken one on.
pub(super) fn seams(
    mut seams: Vec<(SeamPath, Weld)>,
    resume: Option<&ResumeSettings>,
) -> Result<Vec<(SeamPath, Weld)>, Error> {
    let Some(resume) = resume else { return Ok(seams) };
    let Some(first) = seams.iter().position(|(path, _)| path.seam == resume.seam) else {
        let welded = seams.iter().map(|(path, _)| path.seam).collect();
        return Err(Error::Seam { seam: resume.seam, welded });
    };
    Ok(seams.split_off(first))
}

/// The passes from the broken one on, which begins where it was broken off; the first are those of the broken seam.
pub(super) fn passes(mut passes: Vec<Pass>, resume: Option<&ResumeSettings>) -> Result<Vec<Pass>, Error> {
    let Some(&ResumeSettings { seam, pass, .. }) = resume else { return Ok(passes) };
    let from_mm = resume.map_or(0.0, ResumeSettings::from_mm);
    let own = passes.iter().take_while(|pass| pass.path.seam == seam).count();
    if !(1..=own).contains(&pass) {
        return Err(Error::Pass { seam, pass, passes: own });
    }
    let mut left = passes.split_off(pass - 1);
    if let Some(broken) = left.first_mut() {
        let end_mm = broken.path.points.last().map_or(0.0, |last| last.s_mm);
        broken.path = rest(&broken.path, from_mm);
        if broken.path.points.len() < 2 {
            return Err(Error::Nothing { seam, from_mm, end_mm });
        }
    }
    Ok(left)
}
