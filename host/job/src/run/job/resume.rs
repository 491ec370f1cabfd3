//! `[resume]`: the rest of a weld that was broken off, and what follows it. Reference: `docs/programs.md`, "Stops and
//! resumes".

use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::quantity::{OverlapMm, WeldedMm};

/// `[resume]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ResumeSettings {
    /// The seam that was broken off; those before it are left out.
    pub seam: usize,
    /// Which of its passes, counted from 1.
    #[serde(default = "first")]
    pub pass: usize,
    /// How far it was welded: `s_mm` of path.csv.
    pub at_mm: WeldedMm,
    /// How much of that is welded again.
    #[serde(default)]
    pub overlap_mm: OverlapMm,
}

fn first() -> usize {
    1
}

impl ResumeSettings {
    /// Where the weld begins anew, mm along the pass.
    pub fn from_mm(&self) -> f64 {
        self.at_mm.get() - self.overlap_mm.get()
    }

    /// What a program says of it in its head.
    pub fn words(&self) -> String {
        let Self { seam, pass, at_mm, overlap_mm } = self;
        format!(
            "The rest of a weld: seam {seam}, pass {pass}, from {:.1} mm on. It was welded up to {:.1} mm, of which {:.1} mm \
             are welded again.",
            self.from_mm().max(0.0),
            at_mm.get(),
            overlap_mm.get()
        )
    }
}

impl FromStr for ResumeSettings {
    type Err = String;

    /// `SEAM:MM` or `SEAM.PASS:MM`.
    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("{text:?} is not SEAM:MM or SEAM.PASS:MM, as in 2:61.5");
        let (which, at_mm) = text.split_once(':').ok_or_else(form)?;
        let (seam, pass) = which.split_once('.').unwrap_or((which, "1"));
        let whole = |text: &str| text.trim().parse::<usize>().map_err(|_| form());
        let (seam, pass) = (whole(seam)?, whole(pass)?);
        Ok(Self { seam, pass, at_mm: at_mm.parse()?, overlap_mm: OverlapMm::default() })
    }
}
