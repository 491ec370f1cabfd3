//! What can be clicked: each edit changes the job, and nothing but the job.
//!
//! An edit of a seam goes to the `[[seam]]` that names it. Where there is none yet, one is made that names it by its place:
//! a job that is planned on another scan refuses it where no seam is there any more.

use std::collections::BTreeSet;

use nalgebra::Point3;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use weldpath_job::output::verdict::ReasonId;
use weldpath_job::run::job::ask::{AskSettings, DrawSettings};
use weldpath_job::run::job::exclude::{ExcludeSettings, HalfSpaceSettings};
use weldpath_job::run::job::quantity::{Place, Region, WithinMm};
use weldpath_job::run::job::{Job, SeamSettings, Selection, Sequence};
use weldpath_job::run::{access, postprocessing, selection};
use weldpath_method::pipeline::Plan;
use weldpath_method::weld::SeamPath;

/// A seam that was clicked is found again within this of its middle, mm: a second scan of the same part moves it by less,
/// and its neighbours are farther.
const WITHIN_MM: f64 = 5.0;
/// Two numbers of a box or a plane are the same within this, mm: what is read again of a text may differ in its last digit.
const SAME_MM: f64 = 1e-6;
/// Keys of the whole job that a page may set; `input` and what decides how it is read are not among them.
const OF_JOB: [&str; 13] = [
    "formats",
    "joint",
    "order",
    "path",
    "torch",
    "weave",
    "stitch",
    "arc",
    "tool",
    "robot",
    "torch_body",
    "program",
    "selection.roi_mm",
];
/// Those of a seam.
const OF_SEAM: [&str; 5] = ["joint", "path", "torch", "weave", "stitch"];
/// The list of passes, of both.
const PASSES: &str = "pass";

/// One click.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Edit {
    /// Of what decides which seams there are.
    Search(SearchEdit),
    /// Of what is made of them.
    Seams(SeamEdit),
}

/// What decides which seams there are; it holds with the next plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "edit", rename_all = "kebab-case", deny_unknown_fields)]
pub(super) enum SearchEdit {
    /// A seam that the search passed over is asked for.
    Ask(AskSettings),
    /// One of the asked seams is asked for no longer, by its place in the job's list.
    Unask { at: usize },
    /// A line on the surface is drawn, which nothing has to bear out.
    Draw(DrawSettings),
    /// One of the drawn lines is taken back, by its place in the job's list.
    Undraw { at: usize },
    /// Something is no work, was named otherwise before, or is work again.
    Exclude { was: Option<NoWork>, now: Option<NoWork> },
}

/// How [`SearchEdit`]s are named; any other name is a [`SeamEdit`]'s, or none.
const OF_SEARCH: [&str; 5] = ["ask", "unask", "draw", "undraw", "exclude"];

/// What is made of the seams that there are.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "edit", rename_all = "kebab-case", deny_unknown_fields)]
pub(super) enum SeamEdit {
    /// A setting of the whole job, or of one seam; null takes it back to what holds without it.
    Set { seam: Option<usize>, key: String, value: Value },
    /// Whether a seam is welded.
    Weld { seam: usize, on: bool },
    /// In which order the seams are welded, by their ids.
    Order { seams: Vec<usize> },
    /// Whether a reason of the verdict is confirmed.
    Accept { reason: ReasonId, on: bool },
}

impl<'de> Deserialize<'de> for Edit {
    fn deserialize<D: Deserializer<'de>>(click: D) -> Result<Self, D::Error> {
        let click = Value::deserialize(click)?;
        let name = click.get("edit").and_then(Value::as_str).unwrap_or_default();
        let edit = match OF_SEARCH.contains(&name) {
            true => SearchEdit::deserialize(click).map(Self::Search),
            false => SeamEdit::deserialize(click).map(Self::Seams),
        };
        edit.map_err(D::Error::custom)
    }
}

/// What is scanned and is no work: one entry of `[exclude]`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum NoWork {
    Box(Region),
    HalfSpace(HalfSpaceSettings),
}

impl Edit {
    /// In a few words, for undo and redo.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Search(edit) => edit.words(),
            Self::Seams(edit) => edit.words(),
        }
    }

    /// The job with this edit; where no seam was found there is no plan, and one may still be asked for.
    ///
    /// # Errors
    /// In words, if it makes no job that could be planned.
    pub(super) fn on(&self, job: &Job, plan: Option<&Plan>) -> Result<Job, String> {
        match self {
            Self::Search(edit) => edit.on(job),
            Self::Seams(edit) => edit.on(job, plan.ok_or("nothing is planned yet that could be edited")?),
        }
    }
}

impl SearchEdit {
    fn words(&self) -> String {
        match self {
            Self::Ask(_) => "add a seam".into(),
            Self::Unask { at } => format!("no longer ask for seam {} of those that were added", at + 1),
            Self::Draw(_) => "draw a seam".into(),
            Self::Undraw { at } => format!("take back drawn seam {}", at + 1),
            Self::Exclude { was: None, .. } => "exclude a part of the scan".into(),
            Self::Exclude { now: None, .. } => "no longer exclude a part of the scan".into(),
            Self::Exclude { .. } => "what is excluded of the scan".into(),
        }
    }

    fn on(&self, job: &Job) -> Result<Job, String> {
        let mut edited = job.clone();
        match self {
            Self::Ask(ask) => edited.asks.push(ask.clone()),
            Self::Unask { at } => take_back(&mut edited.asks, *at, "that seam is not asked for")?,
            Self::Draw(draw) => edited.draws.push(draw.clone()),
            Self::Undraw { at } => take_back(&mut edited.draws, *at, "that seam is not drawn")?,
            Self::Exclude { was, now } => exclude(&mut edited.exclude, *was, *now)?,
        }
        edited.check().map_err(|error| error.why())?;
        Ok(edited)
    }
}

fn take_back<T>(list: &mut Vec<T>, at: usize, why_not: &str) -> Result<(), String> {
    if at >= list.len() {
        return Err(why_not.into());
    }
    list.remove(at);
    Ok(())
}

impl SeamEdit {
    fn words(&self) -> String {
        match self {
            Self::Set { seam: Some(id), key, .. } => format!("{key} of seam {id}"),
            Self::Set { seam: None, key, .. } => key.clone(),
            Self::Weld { seam, on: true } => format!("weld seam {seam}"),
            Self::Weld { seam, on: false } => format!("leave out seam {seam}"),
            Self::Order { .. } => "order of the seams".into(),
            Self::Accept { reason, on: true } => format!("accept {}", reason.name()),
            Self::Accept { reason, on: false } => format!("no longer accept {}", reason.name()),
        }
    }

    fn on(&self, job: &Job, plan: &Plan) -> Result<Job, String> {
        let mut edited = job.clone();
        match self {
            Self::Set { seam: None, key, value } => {
                edited = with_key(&edited, key, value, &OF_JOB)?;
            }
            Self::Set { seam: Some(id), key, value } => {
                let own = entry(&mut edited, plan, *id)?;
                *own = with_key(own, key, value, &OF_SEAM)?;
            }
            Self::Weld { seam, on } => switch(&mut edited, plan, *seam, *on)?,
            Self::Order { seams } => arrange(&mut edited, plan, seams)?,
            Self::Accept { reason, on } => {
                edited.accept.retain(|id| id != reason);
                edited.accept.extend(on.then_some(*reason));
                edited.accept.sort_unstable();
            }
        }
        if edited.order.sequence != Sequence::Listed {
            edited.seams.retain(says_something);
        }
        edited.check().map_err(|error| error.why())?;
        postprocessing::chosen(plan, &edited).map_err(|error| error.to_string())?;
        Ok(edited)
    }
}

/// Whether a `[[seam]]` says more than which seam it is about.
fn says_something(own: &SeamSettings) -> bool {
    let SeamSettings { id, near_mm, within_mm, .. } = *own;
    *own != SeamSettings { id, near_mm, within_mm, ..SeamSettings::default() }
}

/// Settings with the value of a dotted key in place of what was there.
fn with_key<T>(settings: &T, key: &str, value: &Value, known: &[&str]) -> Result<T, String>
where
    T: serde::Serialize + serde::de::DeserializeOwned,
{
    let words = |error: serde_json::Error| format!("{key}: {error}");
    let mut tree = serde_json::to_value(settings).map_err(words)?;
    let names: Vec<&str> = key.split('.').collect();
    if !(known.contains(&names[0]) || known.contains(&key) || key == PASSES) {
        return Err(format!("{key:?} cannot be set on this page"));
    }
    put(&mut tree, &names, value);
    serde_json::from_value(tree).map_err(words)
}

/// Puts a value where the names lead to; null takes what is there away, and a table that is empty then.
fn put(tree: &mut Value, names: &[&str], value: &Value) {
    let [name, rest @ ..] = names else { return };
    if !tree.is_object() {
        *tree = Value::Object(serde_json::Map::new());
    }
    let Some(table) = tree.as_object_mut() else { return };
    if !rest.is_empty() {
        let inner = table.entry(*name).or_insert_with(|| Value::Object(serde_json::Map::new()));
        put(inner, rest, value);
        if inner.as_object().is_some_and(serde_json::Map::is_empty) {
            table.remove(*name);
        }
    } else if value.is_null() {
        table.remove(*name);
    } else {
        table.insert((*name).to_owned(), value.clone());
    }
}

/// The last `[[seam]]` that names this seam, which is the one that holds; a new one, by its place, if there is none.
fn entry<'a>(job: &'a mut Job, plan: &Plan, id: usize) -> Result<&'a mut SeamSettings, String> {
    let path =
        plan.paths.iter().find(|path| path.seam == id).ok_or_else(|| format!("there is no seam {id}"))?;
    let names_it = |own: &SeamSettings| selection::named(&plan.paths, own) == Ok(Some(id));
    let at = match job.seams.iter().rposition(names_it) {
        Some(at) => at,
        None => {
            let (near_mm, within_mm) = (middle(path), WithinMm::try_from(WITHIN_MM).ok());
            // What an edit names is not welded for that, where the torch does not get.
            let weld = !access::inside(plan, job).contains(&id);
            let by_place = SeamSettings { near_mm, within_mm, weld, ..SeamSettings::default() };
            let by_id = SeamSettings { id: Some(id), weld, ..SeamSettings::default() };
            // Where two seams cross amid both of them, a place names either.
            job.seams.push(if names_it(&by_place) { by_place } else { by_id });
            job.seams.len() - 1
        }
    };
    Ok(&mut job.seams[at])
}

/// Amid the seam, to the tenth of a millimetre: where it is told from those that it meets at its ends.
fn middle(path: &SeamPath) -> Option<Place> {
    let place = path.points.get(path.points.len() / 2)?.position_mm;
    let tenth = |mm: f64| (mm * 10.0).round() / 10.0 + 0.0;
    Place::try_from([place.x, place.y, place.z].map(tenth)).ok()
}

/// One entry of `[exclude]` in place of another; without `was` it is a new one.
fn exclude(settings: &mut ExcludeSettings, was: Option<NoWork>, now: Option<NoWork>) -> Result<(), String> {
    let of_box = |region: &Region| region.corners_mm();
    let of_half = |half: &HalfSpaceSettings| [half.at_mm.point_mm(), half.toward.get().into_inner().into()];
    let boxed = |one| if let NoWork::Box(region) = one { Some(region) } else { None };
    let halved = |one| if let NoWork::HalfSpace(half) = one { Some(half) } else { None };
    replace(&mut settings.boxes_mm, was.and_then(boxed), now.and_then(boxed), of_box)?;
    replace(&mut settings.half_spaces, was.and_then(halved), now.and_then(halved), of_half)
}

fn replace<T>(
    list: &mut Vec<T>,
    was: Option<T>,
    now: Option<T>,
    numbers: impl Fn(&T) -> [Point3<f64>; 2],
) -> Result<(), String> {
    let same = |a: &T, b: &T| (0..2).all(|k| (numbers(a)[k] - numbers(b)[k]).amax() < SAME_MM);
    let Some(was) = was else {
        list.extend(now);
        return Ok(());
    };
    let at = list.iter().position(|one| same(one, &was));
    let at = at.ok_or("that part is not excluded any more, or not as the page shows it: look again")?;
    list.splice(at..=at, now);
    Ok(())
}

fn switch(job: &mut Job, plan: &Plan, id: usize, on: bool) -> Result<(), String> {
    let welded = postprocessing::chosen(plan, job).map_err(|error| error.to_string())?;
    let welded: BTreeSet<usize> = welded.iter().map(|path| path.seam).collect();
    if on && !welded.contains(&id) && job.selection != Selection::default() {
        // What chose the others by ids, a place or a box is said seam by seam instead.
        job.selection = Selection::default();
        for other in plan.paths.iter().map(|path| path.seam).filter(|seam| !welded.contains(seam)) {
            entry(job, plan, other)?.weld = false;
        }
    }
    // Of several that name a seam, one that switches it off is enough.
    for own in &mut job.seams {
        if selection::named(&plan.paths, own) == Ok(Some(id)) {
            own.weld = true;
        }
    }
    entry(job, plan, id)?.weld = on;
    Ok(())
}

fn arrange(job: &mut Job, plan: &Plan, ids: &[usize]) -> Result<(), String> {
    let once: BTreeSet<usize> = ids.iter().copied().collect();
    if once.len() != ids.len() {
        return Err("a seam stands twice in the order".into());
    }
    for id in ids {
        entry(job, plan, *id)?;
    }
    let place = |own: &SeamSettings| {
        let named = selection::named(&plan.paths, own).ok().flatten();
        ids.iter().position(|id| Some(*id) == named).unwrap_or(usize::MAX)
    };
    job.seams.sort_by_key(place);
    job.order.sequence = Sequence::Listed;
    Ok(())
}
