//! Why a job file is refused: the line, the reason, and what to write instead.

use std::path::{Path, PathBuf};

use super::Job;
use super::layer::{self, Weld};
use super::robot::RobotSettings;
use weldpath_method::pipeline::Method;

/// Why a job file is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The file cannot be read at all.
    #[error("cannot read {}: {why}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        why: String,
    },
    /// A line of it makes no sense.
    #[error("{}:{line}: {why}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong, in words.
        why: String,
        /// What to write instead.
        hint: String,
    },
}

impl Error {
    /// What is wrong, without the place in a file.
    pub fn why(&self) -> String {
        match self {
            Self::Unreadable { why, .. } | Self::Line { why, .. } => why.clone(),
        }
    }

    /// The same with another way out, where it is a line's.
    pub(super) fn with_hint(self, hint: &str) -> Self {
        match self {
            Self::Line { path, line, why, .. } => Self::Line { path, line, why, hint: hint.into() },
            unreadable => unreadable,
        }
    }

    /// What to do about it.
    pub fn hint(&self) -> &str {
        match self {
            Self::Unreadable { .. } => {
                "every run of `weldpath plan` writes a complete job.toml to start from"
            }
            Self::Line { hint, .. } => hint,
        }
    }
}

/// What to do about a calibration that is none.
pub(super) const CALIBRATION_HINT: &str = "`weldpath calibrate` writes one; docs/formats.md lists its keys";

/// The key that the method does not go with, why, and what to do.
fn against_method(job: &Job) -> Option<(&'static str, &'static str, &'static str)> {
    let by_paper = job.method == Method::Paper;
    let faults = [
        (
            job.ratio_threshold.is_some() && !by_paper,
            "ratio_threshold",
            "only the paper's method has a ratio_threshold",
            "add method = \"paper\", or leave the threshold to be found from the data",
        ),
        (
            !job.asks.is_empty() && by_paper,
            "[[ask]]",
            "the paper's method fits no faces, so it cannot search for a requested seam",
            "leave method = \"paper\" out, or [[ask]]",
        ),
        (
            !job.draws.is_empty() && by_paper,
            "[[draw]]",
            "the paper's method fits no faces, so it cannot fit a drawn line to them",
            "leave method = \"paper\" out, or [[draw]]",
        ),
    ];
    faults.into_iter().find(|fault| fault.0).map(|(_, key, why, hint)| (key, why, hint))
}

/// What only the whole job can say.
pub(super) fn check(job: &Job, text: &str, path: &Path) -> Result<(), Error> {
    let refuse = |line: usize, why: &str, hint: &str| {
        Err(Error::Line { path: path.into(), line, why: why.into(), hint: hint.into() })
    };
    if let Some((key, why, hint)) = against_method(job) {
        return refuse(line_of_key(text, key), why, hint);
    }
    if let Some(id) = job.accept.iter().find(|id| !id.may_be_accepted()) {
        let why = format!("`{}` cannot be accepted: a person looks at what is drawn each time", id.name());
        return refuse(line_of_key(text, "accept"), &why, "leave it out; the verdict stays at check");
    }
    if let Some([a, b]) = layers(job).iter().flat_map(exclusive).next() {
        let why = format!("{a} and {b} exclude each other");
        return refuse(line_of_key(text, b), &why, "keep one of the two lines");
    }
    let faults = [job.robot.as_ref().and_then(RobotSettings::fault), job.torch_body.and_then(|t| t.fault())];
    if let Some((key, why)) = faults.into_iter().flatten().next() {
        let hint = "docs/feasibility.md lists the keys of [robot] and [torch_body]";
        return refuse(line_of_key(text, key), &why, hint);
    }
    if let Some((key, why)) = job.unwritable() {
        let hint =
            "docs/programs.md, \"Frames and tools\", lists how each controller identifies frames and tools";
        return refuse(line_of_key(text, key), &why, hint);
    }
    if let Some((key, why)) = job.scan.calibration.as_ref().and_then(|c| c.fault()) {
        return refuse(line_of_key(text, key), &format!("{key}: {why}"), CALIBRATION_HINT);
    }
    if let Some(id) = twice(&job.selection.seams) {
        return refuse(
            line_of_key(text, "seams"),
            &format!("seam {id} is selected twice"),
            "name each seam once",
        );
    }
    let ids: Vec<usize> = job.seams.iter().filter_map(|seam| seam.id).collect();
    if let Some(id) = twice(&ids) {
        let line =
            text.lines().enumerate().filter(|(_, line)| is_id(line, id)).nth(1).map_or(1, |(at, _)| at + 1);
        return refuse(
            line,
            &format!("there are two [[seam]] with id = {id}"),
            "put the settings of a seam into one",
        );
    }
    if job.seams.iter().any(|seam| seam.id.is_some() == seam.near_mm.is_some()) {
        let hint = "give id = 2, or near_mm = [120, -35, 8]";
        return refuse(line_of_key(text, "[[seam]]"), "a [[seam]] has either an id or a near_mm", hint);
    }
    if job.seams.iter().any(|seam| seam.within_mm.is_some() && seam.near_mm.is_none()) {
        let hint = "give near_mm = [120, -35, 8] in place of the id, or leave within_mm out";
        return refuse(
            line_of_key(text, "within_mm"),
            "within_mm says how far from near_mm a seam may be",
            hint,
        );
    }
    Ok(())
}

/// The first id that stands twice.
fn twice(ids: &[usize]) -> Option<usize> {
    ids.iter().enumerate().find(|(at, id)| ids[..*at].contains(id)).map(|(_, id)| *id)
}

fn is_id(line: &str, id: usize) -> bool {
    line.split_once('=')
        .is_some_and(|(key, value)| key.trim() == "id" && value.trim().starts_with(&id.to_string()))
}

/// What the whole job, the joint types and the seams say of how they are welded, each for itself.
fn layers(job: &Job) -> Vec<Weld> {
    let of_joints = job.joints.values().cloned();
    let of_seams = job.seams.iter().map(layer::SeamSettings::weld);
    std::iter::once(job.weld()).chain(of_joints).chain(of_seams).collect()
}

/// Keys given together of which only one can hold.
fn exclusive(weld: &Weld) -> Vec<[&'static str; 2]> {
    let layers =
        std::iter::once((weld.path, weld.weave)).chain(weld.passes.iter().map(|p| (p.path, p.weave)));
    layers
        .flat_map(|(path, weave)| {
            let points = path.spacing_mm.is_some() && path.points.is_some();
            let waves = weave.wavelength_mm.is_some() && weave.frequency_hz.is_some();
            let names = [(points, ["spacing_mm", "points"]), (waves, ["wavelength_mm", "frequency_hz"])];
            names.into_iter().filter_map(|(both, names)| both.then_some(names))
        })
        .collect()
}

/// Where a key stands, alone or with a dotted path before it; counted from 1.
fn line_of_key(text: &str, key: &str) -> usize {
    let is_it = |line: &str| {
        let name = line.split('=').next().unwrap_or_default().trim();
        name == key || name.rsplit('.').next() == Some(key)
    };
    1 + text.lines().position(is_it).unwrap_or(0)
}

/// A key of a file whose value makes no sense.
pub(super) fn of_key(text: &str, path: &Path, key: &str, why: &str, hint: &str) -> Error {
    Error::Line { path: path.into(), line: line_of_key(text, key), why: why.into(), hint: hint.into() }
}

/// What TOML or a type of the job refuses.
pub(super) fn of_toml(text: &str, path: &Path, error: &toml::de::Error) -> Error {
    let start = error.span().map_or(0, |span| span.start);
    let line = 1 + text.bytes().take(start).filter(|&b| b == b'\n').count();
    let said = error.message();
    Error::Line { path: path.into(), line, why: in_words(said), hint: hint(said) }
}

/// The parser's names of types in words.
fn in_words(said: &str) -> String {
    const WORDS: [(&str, &str); 8] = [
        ("unknown variant", "unknown value"),
        ("expected f64", "expected a number"),
        ("expected u64", "expected a whole number of at least 0"),
        ("expected usize", "expected a whole number of at least 0"),
        ("expected a sequence", "expected a list"),
        ("invalid type: map", "invalid type: table"),
        ("invalid type: sequence", "invalid type: list"),
        ("invalid mantissa", "a number needs a digit before its point, as in 0.05"),
    ];
    let named = WORDS.iter().fold(said.to_owned(), |text, (theirs, ours)| text.replace(theirs, ours));
    // A type of ours is a table of the file.
    match named.split_once("expected struct ") {
        Some((before, rest)) => {
            let after = rest.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
            format!("{before}expected a table{after}")
        }
        None => named,
    }
}

fn hint(why: &str) -> String {
    let number_with_unit = why.starts_with("invalid type: string") && why.contains("expected f64");
    if number_with_unit {
        return "write the number alone, without quotes: its unit is in the name of the key".into();
    }
    unknown_name(why).unwrap_or_else(|| "docs/formats.md lists every key with its unit and range".into())
}

/// For "unknown field `a`, expected one of `b`, `c`": what `a` should be.
fn unknown_name(message: &str) -> Option<String> {
    let mut names = message.split('`').skip(1).step_by(2);
    let wrong = names.next().filter(|_| message.starts_with("unknown"))?;
    let names: Vec<&str> = names.collect();
    if let Some((right, unit)) = names.iter().find_map(|name| Some((name, other_unit(wrong, name)?))) {
        return Some(format!("did you mean `{right}`? It is in {unit}; convert the number"));
    }
    if let Some(table) = layer::table_of(wrong).filter(|_| !names.contains(&wrong)) {
        return Some(format!("`{wrong}` belongs in [{table}]"));
    }
    let likeness = |name: &&str| strsim::jaro_winkler(wrong, name);
    let right = names.iter().copied().max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
    Some(format!("did you mean `{right}`?"))
}

/// Endings of keys and what they mean.
const UNITS: [(&str, &str); 6] = [
    ("_mm_s", "millimetres per second"),
    ("_mm", "millimetres"),
    ("_deg", "degrees"),
    ("_hz", "hertz"),
    ("_s", "seconds"),
    ("_kg", "kilograms"),
];
/// Endings that say a unit which no key has.
const FOREIGN: [&str; 16] = [
    "_mm_min", "_cm_min", "_m_min", "_m_s", "_cm_s", "_ipm", "_in_min", "_inch", "_in", "_cm", "_um", "_m",
    "_rad", "_ms", "_min", "_sec",
];

/// The unit of `right`, if `wrong` is the same quantity in another unit.
fn other_unit(wrong: &str, right: &str) -> Option<&'static str> {
    let (stem, unit) = UNITS.iter().find_map(|(ending, unit)| Some((right.strip_suffix(ending)?, *unit)))?;
    let foreign = FOREIGN.iter().chain(UNITS.iter().map(|(ending, _)| ending));
    let same = foreign.filter_map(|ending| wrong.strip_suffix(ending)).any(|other| other == stem);
    (same && wrong != right).then_some(unit)
}
