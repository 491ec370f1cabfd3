//! A whole job in the browser: a Y of webs with a clamp beside it and a flat bar whose feet the search passes over.
//!
//! Everything that a welding engineer does with it is clicked; what `weldpath plan` makes of the job that is left is the same to
//! the byte. Truth is the piece's own geometry, and what the simulator says where it put it.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use nalgebra::{Point3, Rotation3, Vector3};
use serde_json::Value;
use weldpath::evaluation::{Truth, TruthSeam};
use weldpath_tests::browser;
use weldpath_tests::command::{ends_well, weldpath};
use weldpath_tests::page::{Page, ends};

/// Sizes of the piece, mm: thickness of its plate, length and height of the bar, edge and height of the clamp.
const PLATE_MM: f64 = 9.0;
const BAR_MM: [f64; 2] = [60.0, 4.0];
const CLAMP_MM: [f64; 2] = [40.0, 36.0];
/// Feet of the webs are longer than this, and nothing else is, mm.
const FOOT_MM: f64 = 90.0;
/// How far an end is dragged, and how well a mouse does it, mm.
const DRAGGED_MM: f64 = 12.0;
const MOUSE_MM: f64 = 1.5;

/// A box, turned about z and moved, as lines of an OBJ file that has so many corners already.
fn cuboid(obj: &mut String, low: [f64; 3], high: [f64; 3], (turn_deg, at): (f64, [f64; 2])) {
    let before = obj.lines().filter(|line| line.starts_with('v')).count();
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_deg.to_radians());
    for k in 0..8 {
        let corner = Point3::from([0, 1, 2].map(|axis| [low, high][k >> axis & 1][axis]));
        let corner = turn * corner + Vector3::new(at[0], at[1], 0.0);
        writeln!(obj, "v {:.4} {:.4} {:.4}", corner.x, corner.y, corner.z).unwrap();
    }
    // Each side by its corners, counter-clockwise from outside.
    for side in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        let [a, b, c, d] = side.map(|corner| corner + before + 1);
        writeln!(obj, "f {a} {b} {c}\nf {a} {c} {d}").unwrap();
    }
}

fn piece() -> String {
    let mut obj = String::new();
    let here = (0.0, [0.0; 2]);
    cuboid(&mut obj, [-130.0, -130.0, 0.0], [130.0, 130.0, PLATE_MM], here);
    for turn_deg in [150.0, -90.0, 30.0] {
        cuboid(&mut obj, [0.0, -4.0, PLATE_MM], [110.0, 4.0, PLATE_MM + 60.0], (turn_deg, [0.0; 2]));
    }
    let [edge, height] = CLAMP_MM;
    cuboid(&mut obj, [75.0, -110.0, PLATE_MM], [75.0 + edge, -110.0 + edge, PLATE_MM + height], here);
    let [length, height] = BAR_MM;
    let bar = [[-0.5 * length, -4.0, PLATE_MM], [0.5 * length, 4.0, PLATE_MM + height]];
    cuboid(&mut obj, bar[0], bar[1], (90.0, [-85.0, -60.0]));
    obj
}

fn vector(p: [f64; 3]) -> Vector3<f64> {
    Vector3::from(p)
}

/// The true edges of about this length, mm.
fn edges(truth: &Truth, length_mm: f64) -> Vec<&TruthSeam> {
    let length = |edge: &TruthSeam| (vector(edge.p[edge.p.len() - 1]) - vector(edge.p[0])).norm();
    truth.seams.iter().filter(|edge| (length(edge) - length_mm).abs() < 2.5).collect()
}

/// The piece, planned in a page.
struct Bench {
    page: Page,
    truth: Truth,
}

impl Bench {
    fn open(chromium: &Path) -> Self {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join("y.obj"), piece()).unwrap();
        let scan = ["simulate", "--mesh", "y.obj", "--size", "320x240", "--quiet", "--out", "scan"];
        ends_well(weldpath().args(scan).current_dir(home.path()));
        let truth = fs::read(home.path().join("scan/truth.json")).unwrap();
        let truth = serde_json::from_slice(&truth).unwrap();
        let mut page = Page::visit(chromium, home, &["scan"]);
        page.wait_for_plan(0);
        Self { page, truth }
    }

    /// All that was found, as `id`, first and last place, and what is said of where it comes from.
    fn seams(&mut self) -> Vec<(u64, [Point3<f64>; 2], String)> {
        let seams = self.page.browser.evaluate(
            "weldpath.content.seams.map(({ id, line_mm }, k) => [id, line_mm[0], line_mm[line_mm.length - 1], weldpath.content.summary.seams[k].reason])",
        );
        let place = |p: &Value| Point3::from([0, 1, 2].map(|axis| p[axis].as_f64().unwrap()));
        let seam = |one: &Value| {
            (one[0].as_u64().unwrap(), [place(&one[1]), place(&one[2])], one[3].as_str().unwrap().to_owned())
        };
        seams.as_array().unwrap().iter().map(seam).collect()
    }

    /// The seam that begins and ends where this one did, in whichever direction; a plan of fewer points moves its ends a little.
    fn again(&mut self, [a, b]: [Point3<f64>; 2]) -> u64 {
        let seams = self.seams();
        let off =
            |[c, d]: [Point3<f64>; 2]| ((a - c).norm() + (b - d).norm()).min((a - d).norm() + (b - c).norm());
        seams.iter().find(|(_, ends, _)| off(*ends) < 8.0).map(|one| one.0).expect("it is there again")
    }

    /// Clicks on the cloud, seen from above, where these places are.
    fn click_from_above(&mut self, places: &[Point3<f64>]) {
        self.page.look_from_above();
        let browser = &mut self.page.browser;
        for (k, place) in places.iter().enumerate() {
            let px = browser.evaluate(&format!(
                "(() => {{
                   const {{ scene }} = weldpath;
                   const box = document.getElementById('canvas').getBoundingClientRect();
                   const {{ x, y }} = scene.project(new scene.camera.position.constructor({}, {}, {}));
                   return [box.left + x, box.top + y];
                 }})()",
                place.x, place.y, place.z
            ));
            browser.click(px[0].as_f64().unwrap(), px[1].as_f64().unwrap());
            browser.wait_for(&format!("document.querySelectorAll('.mark-place').length === {}", k + 1));
        }
    }

    fn select(&mut self, seam: u64) {
        self.page
            .browser
            .evaluate(&format!("document.querySelector('#seams tr[data-seam=\"{seam}\"]').click()"));
        self.page.settle(&format!("document.getElementById('scope-seam').textContent.endsWith(' {seam}')"));
    }

    fn job(&self) -> String {
        fs::read_to_string(self.page.home.path().join("out/job.toml")).unwrap()
    }

    fn undo_says(&mut self, words: &str) {
        self.page.settle(&format!("document.getElementById('undo').title.includes({words:?})"));
    }
}

#[test]
fn a_whole_job_is_clicked_and_the_command_makes_the_same_files_of_it() {
    let Some(chromium) = browser::chromium() else { return };
    let mut bench = Bench::open(&chromium);
    let found = bench.seams();
    let long = |[a, b]: &[Point3<f64>; 2]| (a - b).norm() > FOOT_MM;
    let feet: Vec<(u64, [Point3<f64>; 2])> =
        found.iter().filter(|(_, ends, _)| long(ends)).map(|(id, ends, _)| (*id, *ends)).collect();
    assert!(feet.len() >= 4, "{found:?}");

    let dropped = [feet[0], feet[1]];
    for (seam, _) in dropped {
        bench
            .page
            .browser
            .evaluate(&format!("document.querySelector('#seams tr[data-seam=\"{seam}\"] input').click()"));
        bench.undo_says(&format!("leave out seam {seam}"));
    }
    let turned = feet[2];
    let before = bench.page.shown_ends(turned.0);
    let short_mm = turn_and_shorten(&mut bench, turned.0);
    box_the_clamp_away(&mut bench);
    ask_for_the_bar(&mut bench);

    let id = bench.again(turned.1);
    for (_, ends) in dropped {
        let gone = bench.again(ends);
        assert!(!bench.page.order().contains(&gone), "still left out, whatever its number");
    }
    let after = ends(&bench.page.home.path().join("out"), id).map(vector);
    let [first, last] = before.map(vector);
    assert!((after[0] - last).norm() < 3.0, "it begins where it ended: {after:?} {before:?}");
    assert!(((after[1] - first).norm() - short_mm).abs() < 3.0, "{after:?} {before:?}");

    weave_check_and_export(&mut bench);
    reload(&mut bench);
    the_command_makes_the_same(&bench);
    assert!(bench.page.browser.console().is_empty(), "{:?}", bench.page.browser.console());
}

/// A seam is turned round by a key, and its end dragged inwards; by how much.
fn turn_and_shorten(bench: &mut Bench, seam: u64) -> f64 {
    bench.select(seam);
    let way = "document.querySelector('#settings [data-key=\"path.direction\"]').value";
    bench.page.browser.press("r", false);
    bench.page.settle(&format!("['reverse', 'forward'].includes({way})"));
    bench.page.drag_the_end(seam, DRAGGED_MM);
    bench.undo_says("path.extend_end_mm");
    let field = "Number(document.querySelector('[data-key=\"path.extend_end_mm\"]').value)";
    let short_mm = -bench.page.browser.evaluate(field).as_f64().unwrap();
    assert!((short_mm - DRAGGED_MM).abs() < MOUSE_MM, "{short_mm} mm");
    short_mm
}

/// One foot of the bar is asked for by a click beside either of its ends, and is where it is.
fn ask_for_the_bar(bench: &mut Bench) {
    let bar = edges(&bench.truth, BAR_MM[0])[0].clone();
    let (a, b) = (Point3::from(bar.p[0]), Point3::from(bar.p[bar.p.len() - 1]));
    let away = |p: Point3<f64>| {
        let along = (b - a).normalize();
        (p - a - along * (p - a).dot(&along)).norm()
    };
    let found = bench.seams();
    assert!(
        found.iter().all(|(_, ends, _)| ends.iter().any(|end| away(*end) > 8.0)),
        "the search passes it over"
    );
    let beside = Vector3::new(bar.n[0][0], bar.n[0][1], 0.0).normalize() * 5.0;
    bench.page.browser.press("a", false);
    bench.click_from_above(&[a + beside, b + beside]);
    bench.page.browser.press("Enter", false);
    bench.undo_says("add a seam");
    bench.page.plan();
    let (id, ends, reason) = bench.seams().pop().unwrap();
    assert!(reason.contains("asked for"), "{reason}");
    assert!(
        ends.iter().all(|end| away(*end) < 1.0) && (ends[0] - ends[1]).norm() > BAR_MM[0] - 8.0,
        "{ends:?}"
    );
    assert!(bench.page.order().contains(&id));
}

/// The clamp is boxed by a click beside it at two corners and one on top, the box lifted off the plate, and excluded.
fn box_the_clamp_away(bench: &mut Bench) {
    let clamp: Vec<TruthSeam> = edges(&bench.truth, CLAMP_MM[0]).into_iter().cloned().collect();
    assert_eq!(clamp.len(), 4);
    let corners: Vec<Point3<f64>> = clamp.iter().map(|edge| Point3::from(edge.p[0])).collect();
    let middle = Point3::from(corners.iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 4.0);
    let outside = |axis: usize, sign: f64| {
        let far = corners.iter().max_by(|a, b| (sign * a[axis]).total_cmp(&(sign * b[axis]))).unwrap();
        far + (far - middle) * 0.2
    };
    let top = middle + Vector3::z() * CLAMP_MM[1];
    let places = [outside(0, -1.0), outside(0, 1.0), outside(1, -1.0), outside(1, 1.0), top];
    bench.page.browser.press("b", false);
    bench.click_from_above(&places);
    bench.page.browser.press("Enter", false);
    bench.page.settle("document.getElementById('box-exclude') && !document.querySelector('.mark-place')");
    let above = middle.z + 2.0;
    bench.page.browser.evaluate(&format!(
        "(() => {{ const low = document.querySelector('[aria-label=\"A box, base frame, least, mm, z\"]'); low.value = {above}; low.dispatchEvent(new Event('change')); }})()"
    ));
    bench.page.picture("clamp");
    let before = bench.seams().len();
    bench.page.browser.evaluate("document.getElementById('box-exclude').click()");
    bench.undo_says("exclude a part");
    bench.page.plan();
    let seams = bench.seams();
    let at_clamp = |ends: &[Point3<f64>; 2]| ends.iter().all(|end| (end - middle).norm() < CLAMP_MM[0]);
    assert!(seams.iter().all(|(_, ends, _)| !at_clamp(ends)), "{seams:?}");
    assert!(seams.len() < before, "{seams:?}");
}

/// All seams are woven, an arm is chosen, and ABB's program is written beside the usual one.
fn weave_check_and_export(bench: &mut Bench) {
    bench.page.browser.evaluate("document.getElementById('scope-job').click()");
    bench.page.settle("document.getElementById('scope-job').getAttribute('aria-pressed') === 'true'");
    bench.page.set("weave.shape", "sine");
    bench.undo_says("weave.shape");
    bench.page.set("weave.amplitude_mm", "1.5");
    bench.undo_says("weave.amplitude_mm");
    bench.page.set("robot.model", "ur10e");
    bench.undo_says("robot.model");
    // It stands amid the work and cannot run the program: a person has to say that this is known.
    let infeasible = "document.querySelector('#verdict [data-reason=\"infeasible\"]')";
    bench.page.settle(infeasible);
    bench.page.browser.evaluate(&format!("{infeasible}.click()"));
    bench.undo_says("accept infeasible");
    bench.page.browser.evaluate("document.querySelector('#settings [data-key=\"formats.abb\"]').click()");
    bench.undo_says("formats");
    bench.page.plan();
    let out = bench.page.home.path().join("out");
    assert!(out.join("feasibility.csv").is_file(), "the arm is checked");
    let program = fs::read_to_string(out.join("weldpath.mod")).expect("ABB's program");
    assert!(program.contains("MODULE"), "{program}");
    bench.page.picture("script");
}

/// A page that is loaded anew shows the same job, and all of it.
fn reload(bench: &mut Bench) {
    let command = bench.page.text("#command pre");
    let seams = bench.seams();
    bench.page.browser.evaluate("(() => { globalThis.isOld = true; location.reload(); })()");
    bench.page.settle("!globalThis.isOld && document.querySelector('#command pre')?.textContent");
    assert_eq!(bench.page.text("#command pre"), command);
    assert_eq!(bench.seams(), seams);
    assert!(seams.last().unwrap().2.contains("asked for"), "{seams:?}");
    let job = bench.job();
    for said in [
        "model = \"ur10e\"",
        "shape = \"sine\"",
        "abb",
        "[[ask]]",
        "boxes_mm",
        "weld = false",
        "extend_end_mm = -1",
    ] {
        assert!(job.contains(said), "{said} is not in\n{job}");
    }
}

/// Every file, without how long each stage took, which no two runs share.
fn the_command_makes_the_same(bench: &Bench) {
    let home = bench.page.home.path();
    let again = ["plan", "--job", "out/job.toml", "--out", "again", "--no-cache", "--quiet"];
    ends_well(weldpath().args(again).current_dir(home));
    let timeless = |bytes: Vec<u8>| match String::from_utf8_lossy(&bytes).split_once("\"stages\"") {
        Some((before, rest)) => {
            format!("{before}{}", rest.split_once(']').map_or(rest, |(_, after)| after)).into()
        }
        None => bytes,
    };
    let mut names: Vec<_> =
        fs::read_dir(home.join("again")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.retain(|name| name != "weldpath-manifest.json");
    for name in &names {
        let of = |folder: &str| timeless(fs::read(home.join(folder).join(name)).unwrap());
        assert!(of("out") == of("again"), "{name:?} differs");
    }
    assert!(names.len() > 8, "{names:?}");
}
