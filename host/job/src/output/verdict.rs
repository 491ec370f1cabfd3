//! The verdict on a run (ours): whether its programs may be run, what a person must confirm first, or why none are written.
//!
//! Every reason has an id that stays the same from version to version; `docs/troubleshooting.md` says what each means and
//! what to do. A job accepts reasons by their ids, one by one; programs say so in their heads.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What may be done with the programs of a run, the best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// Nothing is known that speaks against running them.
    #[default]
    Ready,
    /// A person has to confirm the reasons first.
    Check,
    /// No program is written.
    Refused,
}

impl State {
    /// The word in files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ready => "ready",
            Self::Check => "check",
            Self::Refused => "refused",
        }
    }
}

/// The table of reasons: a name, its id in files and options, and what it makes of a plan that does not accept it.
macro_rules! reasons {
    ($($(#[$about:meta])* $name:ident => $id:literal, $state:ident;)*) => {
        /// What may stand against running a plan.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
        pub enum ReasonId {
            $($(#[$about])* #[serde(rename = $id)] $name,)*
        }

        impl ReasonId {
            /// All of them, the refusals first.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// The id in files, options and messages.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$name => $id,)*
                }
            }

            /// What it makes of a plan.
            pub const fn state(self) -> State {
                match self {
                    $(Self::$name => State::$state,)*
                }
            }
        }
    };
}

impl ReasonId {
    /// Whether a job may accept it: what a person drew, a person looks at each time.
    pub const fn may_be_accepted(self) -> bool {
        !matches!(self, Self::Drawn)
    }
}

reasons! {
    /// Fewer than two views agree.
    ViewsDisagree => "views-disagree", Refused;
    /// So many views do not fit that the poses cannot belong to the images.
    PosesDoNotBelong => "poses-do-not-belong", Refused;
    /// The views show that the camera is not where the hand-eye transform puts it.
    HandEyeWrong => "hand-eye-wrong", Refused;
    /// Points lie where no camera of a robot measures.
    DepthScale => "depth-scale", Refused;
    /// The unit of positions cannot be right.
    Units => "units", Refused;
    /// The unit of angles cannot be right.
    Angles => "angles", Refused;
    /// A transform is given the wrong way round.
    TransformInverted => "transform-inverted", Refused;
    /// A cloud in the frame of its camera, for which a robot program is requested.
    CameraFrame => "camera-frame", Refused;
    /// No seam's error is within the limit.
    ErrorOverLimit => "error-over-limit", Refused;
    /// A seam is larger than what was scanned.
    BeyondScan => "beyond-scan", Refused;
    /// Nothing was found that could be welded.
    NoSeam => "no-seam", Refused;
    /// No seam was found, and the points are too far apart to show one.
    Sparse => "sparse", Refused;
    /// The tip would be inside the work.
    TipInside => "tip-inside", Refused;
    /// The arm cannot run the program.
    Infeasible => "infeasible", Refused;
    /// A view that fits no others is left out.
    ViewLeftOut => "view-left-out", Check;
    /// A view could not be registered.
    ViewUnregistered => "view-unregistered", Check;
    /// The views fit each other only with their poses moved by more than the stated accuracy of the robot.
    PosesScatter => "poses-scatter", Check;
    /// The views turn too little to show an error of the hand-eye transform, or a tool in place of the flange.
    HandEyeUntested => "hand-eye-untested", Check;
    /// It is unknown where the robot's base is: a mesh, or a cloud merged elsewhere.
    FrameUnknown => "frame-unknown", Check;
    /// It is unclear whether a mesh was drawn or scanned; it is taken as a scan.
    CadOrScan => "cad-or-scan", Check;
    /// It is unclear which side of the faces is air; the one seen from above is taken.
    SideAssumed => "side-assumed", Check;
    /// A seam that the torch cannot reach; it is not welded.
    LeftOut => "left-out", Check;
    /// More seams are welded than a part has.
    ManySeams => "many-seams", Check;
    /// The tool is not stated, so the controller's own setting applies.
    ToolNotStated => "tool-not-stated", Check;
    /// A seam that was asked for is not there.
    AskedNotThere => "asked-not-there", Check;
    /// A line that was drawn is not supported by the scan.
    DrawnNotThere => "drawn-not-there", Check;
    /// A seam that a person drew: no measurement supports it.
    Drawn => "drawn", Check;
    /// A seam whose error is over the limit; it is not welded.
    SeamUncertain => "seam-uncertain", Check;
    /// A seam that may be a contact with the fixture or the table; it is not welded.
    MayBeContact => "may-be-contact", Check;
    /// The tip may be farther from a seam in the robot's base frame than the limit.
    BaseErrorOverLimit => "base-error-over-limit", Check;
    /// The torch would touch what was scanned.
    TorchCollision => "torch-collision", Check;
    /// The arm is in an unusual posture, because no other posture is free.
    OddPosture => "odd-posture", Check;
    /// The joint move to the first waypoint is unknown.
    FirstMoveUnchecked => "first-move-unchecked", Check;
    /// A program is written for another maker's controller than the arm's.
    DialectAndArmDiffer => "dialect-and-arm-differ", Check;
}

impl std::str::FromStr for ReasonId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().copied().find(|id| id.name() == text.trim());
        let known: Vec<&str> = Self::ALL.iter().map(|id| id.name()).collect();
        found.ok_or_else(|| format!("{text:?} is not the id of a reason; the ids are {}", known.join(", ")))
    }
}

/// Something that stands against running a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What.
    pub id: ReasonId,
    /// In words.
    pub words: String,
    /// The seam it is about; none for the whole run.
    pub seam: Option<usize>,
    /// What the words say in numbers.
    pub values: Values,
}

/// Numbers by name, with the unit in it; `docs/formats.md` lists those of each reason.
pub type Values = BTreeMap<&'static str, f64>;

impl Finding {
    /// Of the whole run.
    pub fn new(id: ReasonId, words: impl Into<String>) -> Self {
        Self { id, words: words.into(), seam: None, values: Values::new() }
    }

    /// Of one seam.
    pub fn of_seam(id: ReasonId, seam: usize, words: impl Into<String>) -> Self {
        Self { seam: Some(seam), ..Self::new(id, words) }
    }

    /// With what the words say in numbers; those that are not finite are left out.
    #[must_use]
    pub fn with(mut self, values: &[(&'static str, f64)]) -> Self {
        self.values.extend(values.iter().copied().filter(|(_, value)| value.is_finite()));
        self
    }
}

/// One reason of a verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reason {
    /// Which.
    pub id: ReasonId,
    /// What was found, in words.
    pub words: String,
    /// The seam it is about; none for the whole run.
    pub seam: Option<usize>,
    /// Whether the job accepts it.
    pub accepted: bool,
    /// What the words say in numbers.
    pub values: Values,
}

impl Reason {
    /// The id, whether it is accepted, and the words, in one line.
    pub fn line(&self) -> String {
        let seam = self.seam.map(|id| format!("seam {id}: ")).unwrap_or_default();
        let accepted = if self.accepted { " (accepted)" } else { "" };
        format!("{}{accepted}: {seam}{}", self.id.name(), self.words)
    }
}

/// The verdict with its reasons, the gravest first.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Verdict {
    /// What may be done.
    pub state: State,
    /// Why; of one that is ready only what the job accepts.
    pub reasons: Vec<Reason>,
    /// What was not looked at, in words: a plan without a reason is no surer than this.
    pub limits: Vec<String>,
}

impl Verdict {
    /// From what stands against a plan, and what of it the job accepts.
    pub fn new(found: impl IntoIterator<Item = Finding>, accepted: &[ReasonId]) -> Self {
        let reason = |Finding { id, words, seam, values }| {
            let accepted = id.may_be_accepted() && accepted.contains(&id);
            Reason { id, words, seam, accepted, values }
        };
        let mut reasons: Vec<Reason> = found.into_iter().map(reason).collect();
        reasons.sort_by_key(|reason| (reason.accepted, std::cmp::Reverse(reason.id.state())));
        let open = reasons.iter().filter(|reason| !reason.accepted);
        let state = open.map(|reason| reason.id.state()).max().unwrap_or_default();
        Self { state, reasons, limits: Vec::new() }
    }

    /// With what was not looked at.
    pub fn with_limits(self, limits: Vec<String>) -> Self {
        Self { limits, ..self }
    }

    /// The verdict in lines: the state, every reason with its id, and what was not looked at.
    pub fn lines(&self) -> Vec<String> {
        self.with_reasons(self.reasons.iter().map(Reason::line))
    }

    /// The same with one line for all reasons that have the same id: the first of them, and how many more there are.
    pub fn short_lines(&self) -> Vec<String> {
        let alike = |one: &Reason, other: &Reason| (one.id, one.accepted) == (other.id, other.accepted);
        let is_first =
            |(at, reason): &(usize, &Reason)| !self.reasons[..*at].iter().any(|before| alike(before, reason));
        let count = |reason: &Reason| self.reasons.iter().filter(|other| alike(other, reason)).count();
        let counted = |(_, reason): (usize, &Reason)| match count(reason) {
            1 => reason.line(),
            count => format!("{} (and {} more: --verbose lists them)", reason.line(), count - 1),
        };
        self.with_reasons(self.reasons.iter().enumerate().filter(is_first).map(counted))
    }

    fn with_reasons(&self, reasons: impl Iterator<Item = String>) -> Vec<String> {
        let state = match self.state {
            State::Ready => "verdict: ready",
            State::Check => "verdict: check, a person has to confirm:",
            State::Refused => "verdict: refused, no program is written:",
        };
        std::iter::once(state.to_owned()).chain(reasons).chain(self.limits.iter().cloned()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(ids: &[ReasonId], accepted: &[ReasonId]) -> Verdict {
        Verdict::new(ids.iter().map(|id| Finding::new(*id, "why")), accepted)
    }

    #[test]
    fn reasons_of_one_kind_share_a_short_line_and_none_is_lost() {
        let ids = [ReasonId::TorchCollision, ReasonId::ToolNotStated, ReasonId::TorchCollision];
        let verdict = verdict(&ids, &[]).with_limits(vec!["not looked at".into()]);
        assert_eq!(verdict.lines().len(), 5);
        let short = verdict.short_lines();
        assert_eq!(short.len(), 4, "{short:?}");
        assert!(
            short.iter().any(|line| line == "torch-collision: why (and 1 more: --verbose lists them)"),
            "{short:?}"
        );
        assert!(short.contains(&"tool-not-stated: why".to_owned()) && short[3] == "not looked at");
    }

    #[test]
    fn nothing_against_it_is_ready_and_the_gravest_reason_decides() {
        assert_eq!(verdict(&[], &[]).state, State::Ready);
        assert_eq!(verdict(&[ReasonId::ToolNotStated], &[]).state, State::Check);
        let both = verdict(&[ReasonId::ToolNotStated, ReasonId::ViewsDisagree], &[]);
        assert_eq!(both.state, State::Refused);
        assert_eq!(both.reasons[0].id, ReasonId::ViewsDisagree);
    }

    #[test]
    fn accepting_one_reason_leaves_the_others() {
        let ids = [ReasonId::ToolNotStated, ReasonId::ViewsDisagree];
        assert_eq!(verdict(&ids, &[ReasonId::ViewsDisagree]).state, State::Check);
        assert_eq!(verdict(&ids, &[ReasonId::ToolNotStated]).state, State::Refused);
        assert_eq!(verdict(&ids, &ids).state, State::Ready);
        assert!(verdict(&ids, &ids).lines()[1].contains("(accepted)"));
    }

    #[test]
    fn what_is_drawn_is_never_ready() {
        assert_eq!(verdict(&[ReasonId::Drawn], &[ReasonId::Drawn]).state, State::Check);
    }

    #[test]
    fn every_id_reads_back() {
        for id in ReasonId::ALL {
            assert_eq!(id.name().parse(), Ok(*id));
            assert_eq!(serde_json::to_value(id).unwrap(), id.name());
        }
        assert!("view".parse::<ReasonId>().unwrap_err().contains("views-disagree"));
    }
}
