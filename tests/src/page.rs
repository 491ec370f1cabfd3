//! `weldpath open` as its users see it: a browser in which seams are clicked. A test that stands in front of the page calls
//! these; what goes wrong in them is what goes wrong for a user, and panics.
#![allow(clippy::missing_panics_doc)]

use std::path::Path;

use crate::browser::Browser;
use crate::command::{Running, ends_well, weldpath};

/// A scan that is planned in a page.
pub struct Page {
    _running: Running,
    /// Where the server was started: `out` is its folder of results.
    pub home: tempfile::TempDir,
    /// Who looks at it.
    pub browser: Browser,
}

const READY: &str = "document.querySelector('#settings details') && document.getElementById('cancel').hidden";

impl Page {
    /// A cross of plates, simulated into a folder with this name and planned.
    pub fn open(chromium: &Path, input: &str) -> Self {
        let mut page = Self::open_after(chromium, input, "");
        page.wait_for_plan(0);
        page
    }

    /// The same, with a script that runs before those of the page, which may say other words.
    pub fn open_after(chromium: &Path, input: &str, script: &str) -> Self {
        let home = tempfile::tempdir().unwrap();
        let scan = ["simulate", "--part", "cruciform", "--size", "320x240", "--quiet", "--out", input];
        ends_well(weldpath().args(scan).current_dir(home.path()));
        let mut page = Self::visit_after(chromium, home, &[input], script);
        page.browser
            .wait_for(&format!("Number(document.getElementById('editor').dataset.plan) > 0 && {READY}"));
        page
    }

    /// `weldpath open` of these inputs in a folder.
    pub fn visit(chromium: &Path, home: tempfile::TempDir, inputs: &[&str]) -> Self {
        Self::visit_after(chromium, home, inputs, "")
    }

    /// The same, with a script that runs before those of the page.
    pub fn visit_after(chromium: &Path, home: tempfile::TempDir, inputs: &[&str], script: &str) -> Self {
        let mut running =
            Running::start(weldpath().args(["open", "--no-browser"]).args(inputs).current_dir(home.path()));
        let address = running.wait_for(&["http://127.0.0.1:"]);
        let browser = Browser::visit_after(chromium, &address, script);
        Self { _running: running, home, browser }
    }

    /// Waits until a later plan than this one is shown, and nothing is edited that is not in it.
    pub fn wait_for_plan(&mut self, before: u64) {
        let shown = format!("Number(document.getElementById('editor').dataset.plan) > {before}");
        let planned = "document.getElementById('said').textContent.startsWith('Planned')";
        self.browser.wait_for(&format!("{shown} && {planned} && {READY}"));
    }

    /// Number of the plan that is shown.
    pub fn shown(&mut self) -> u64 {
        let number = self.browser.evaluate("Number(document.getElementById('editor').dataset.plan)");
        number.as_u64().unwrap()
    }

    /// Plans by key, and waits for it.
    pub fn plan(&mut self) {
        let before = self.shown();
        self.browser.press("p", false);
        self.wait_for_plan(before);
    }

    /// Waits until what was done is told.
    pub fn settle(&mut self, expression: &str) {
        self.browser.wait_for(expression);
    }

    /// The text of the first element that is selected.
    pub fn text(&mut self, selector: &str) -> String {
        let text = self.browser.evaluate(&format!("document.querySelector({selector:?}).textContent"));
        text.as_str().unwrap().to_owned()
    }

    /// Sets a field as one types or chooses in it.
    pub fn set(&mut self, key: &str, value: &str) {
        self.browser.evaluate(&format!(
            "(() => {{ const field = document.querySelector('#settings [data-key={key:?}]');
               field.value = {value:?}; field.dispatchEvent(new Event('change')); }})()"
        ));
    }

    /// Looks at the work from above, in the middle of the window; the picture has the size of its frame when this ends.
    pub fn look_from_above(&mut self) {
        self.browser.evaluate(
            "(() => { document.getElementById('canvas').scrollIntoView({ block: 'center' }); weldpath.scene.look('top'); })()",
        );
        self.browser.wait_until_drawn();
    }

    /// First and last welded point of a seam as the page shows them, once it shows all that was edited.
    pub fn shown_ends(&mut self, seam: u64) -> [[f64; 3]; 2] {
        self.settle("!document.getElementById('said').textContent.startsWith('Edited: the picture and the files follow')");
        let own =
            format!("weldpath.content.waypoints.filter((one) => one[8] === {seam} && one[9] === 'weld')");
        ["0", "-1"].map(|at| {
            let point = self.browser.evaluate(&format!("{own}.at({at}).slice(0, 3)"));
            [0, 1, 2].map(|axis| point[axis].as_f64().unwrap())
        })
    }

    /// Drags the end of a straight seam that is selected so far inwards along it, with the mouse.
    pub fn drag_the_end(&mut self, seam: u64, inwards_mm: f64) {
        self.browser.evaluate("document.getElementById('canvas').scrollIntoView({ block: 'center' })");
        self.browser.wait_until_drawn();
        let places = self.browser.evaluate(&format!(
            "(() => {{
               const {{ scene, content }} = weldpath;
               const Vector = scene.camera.position.constructor;
               const line = content.seams.find((one) => one.id === {seam}).line_mm.map((p) => new Vector(...p));
               const canvas = document.getElementById('canvas').getBoundingClientRect();
               const handle = document.querySelector('[data-end=\"extend_end_mm\"]').getBoundingClientRect();
               const at = [handle.left + handle.width / 2, handle.top + handle.height / 2];
               const px = (p) => {{ const q = scene.project(p); return [canvas.left + q.x, canvas.top + q.y]; }};
               const away = (p) => Math.hypot(px(p)[0] - at[0], px(p)[1] - at[1]);
               const ends = [line[0], line[line.length - 1]].sort((a, b) => away(a) - away(b));
               const to = ends[1].clone().sub(ends[0]).setLength({inwards_mm}).add(ends[0]);
               return [...at, ...px(to)];
             }})()"
        ));
        let [from, to] = [0, 2].map(|k| [k, k + 1].map(|k| places[k].as_f64().unwrap()));
        self.browser.drag(from, to);
    }

    /// Leaves a picture of the page in the `tmp` beside the build of the tests, for whoever wants to look.
    pub fn picture(&mut self, name: &str) {
        let test = std::env::current_exe().expect("a test is a file");
        let folder = test.ancestors().nth(3).expect("target/debug/deps").join("tmp");
        std::fs::create_dir_all(&folder).expect("a folder");
        std::fs::write(folder.join(format!("open-{name}.png")), self.browser.screenshot()).expect("a file");
    }

    /// Where the plate beside a place of the first seam is in the window, seen from above, with what the page shows by now.
    pub fn beside_the_first_seam(&mut self, share: f64) -> [f64; 2] {
        self.look_from_above();
        let place = self.browser.evaluate(&format!(
            "(() => {{
               const {{ scene, content }} = weldpath;
               const Vector = scene.camera.position.constructor;
               const box = document.getElementById('canvas').getBoundingClientRect();
               const seam = content.seams[0];
               const line = seam.line_mm;
               // On the plate beside it, where a person clicks: along the torch by so much.
               const middle = new Vector(...line[line.length >> 1]);
               const off = scene.anchor({{ ...content.summary.seams[0], ...seam }}).sub(middle).setLength(7);
               const place = new Vector(...line[Math.floor(line.length * {share})]);
               const {{ x, y }} = scene.project(place.add(off));
               return [box.left + x, box.top + y];
             }})()"
        ));
        [0, 1].map(|axis| place[axis].as_f64().unwrap())
    }

    /// Seams in the order in which the last plan welds them.
    pub fn order(&self) -> Vec<u64> {
        let csv = std::fs::read_to_string(self.home.path().join("out/path.csv")).unwrap();
        let seam = |line: &str| line.split(',').next().unwrap().parse().unwrap();
        let mut order: Vec<u64> = csv.lines().skip(1).map(seam).collect();
        order.dedup();
        order
    }
}

/// First and last welded point of a seam.
pub fn ends(folder: &Path, seam: u64) -> [[f64; 3]; 2] {
    let csv = std::fs::read_to_string(folder.join("path.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        csv.lines().skip(1).map(|line| line.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    let own: Vec<&Vec<f64>> = rows.iter().filter(|row| row[0] as u64 == seam).collect();
    [own[0], own[own.len() - 1]].map(|row| [row[3], row[4], row[5]])
}

/// How far two places are apart.
pub fn apart_mm(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}
