//! `weldpath open`: what is edited in the page is what `weldpath plan --job` makes, and nobody else is let in.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use weldpath::geometry::cloud::View;
use weldpath::input;
use weldpath::pipeline::{self, Observer, PlanError};
use weldpath::run::job::Job;
use weldpath_tests::command::{PATIENCE, Running, ends_well, weldpath};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures").join(name)
}

/// A page that is open, without a browser; its folder of results is `out` in `home`.
struct Open {
    _running: Running,
    home: tempfile::TempDir,
    port: u16,
    token: String,
}

/// An answer: its status, its head and its body.
struct Answer {
    status: u16,
    head: String,
    body: String,
}

impl Open {
    fn new(input: &Path) -> Self {
        Self::with(tempfile::tempdir().unwrap(), input)
    }

    fn with(home: tempfile::TempDir, input: &Path) -> Self {
        Self::start(home, &[input])
    }

    fn start(home: tempfile::TempDir, inputs: &[&Path]) -> Self {
        let mut running =
            Running::start(weldpath().args(["open", "--no-browser"]).args(inputs).current_dir(home.path()));
        let address = running.wait_for(&["http://127.0.0.1:"]);
        let mut parts = address.strip_prefix("http://127.0.0.1:").expect("the address alone").split('/');
        let mut part = || parts.next().unwrap().to_owned();
        let (port, token) = (part().parse().unwrap(), part());
        Self { _running: running, home, port, token }
    }

    fn out(&self) -> PathBuf {
        self.home.path().join("out")
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).expect("the server listens");
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends bytes as they are, and reads until the server closes.
    fn raw(&self, request: &[u8]) -> Option<Answer> {
        let mut stream = self.connect();
        // A server that has refused already may have closed.
        let _ = stream.write_all(request);
        answer_of(&mut stream)
    }

    fn host(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    fn get(&self, path: &str) -> Answer {
        let request = format!("GET /{}/{path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.token, self.host());
        self.raw(request.as_bytes()).expect("an answer")
    }

    fn post(&self, path: &str, body: &str) -> Answer {
        let (host, token, bytes) = (self.host(), &self.token, body.len());
        let request = format!(
            "POST /{token}/{path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\
             Content-Type: application/json\r\nContent-Length: {bytes}\r\n\r\n{body}"
        );
        self.raw(request.as_bytes()).expect("an answer")
    }

    fn state(&self) -> Value {
        serde_json::from_str(&self.get("state").body).unwrap()
    }

    /// Waits until no plan is being made, this many have been, and what was edited is in the last or has come to nothing.
    fn planned(&self, plans: u64) -> Value {
        let end = Instant::now() + PATIENCE;
        loop {
            let state = self.state();
            let is_quiet = state["running"].is_null() && state["drawing"] == false;
            let is_told = state["unplanned"] == false || !state["failure"].is_null();
            if is_quiet && is_told && state["plan"].as_u64().is_some_and(|plan| plan >= plans) {
                return state;
            }
            assert!(Instant::now() < end, "{state}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn edit(&self, edit: Value) -> Value {
        let answer = self.post("edit", &edit.to_string());
        assert_eq!(answer.status, 200, "{edit}: {}", answer.body);
        serde_json::from_str(&answer.body).unwrap()
    }

    /// The words with which an edit is refused.
    fn refused(&self, edit: &Value) -> String {
        let answer = self.post("edit", &edit.to_string());
        assert_eq!(answer.status, 400, "{edit}: {}", answer.body);
        answer.body
    }

    fn replan(&self) -> Value {
        let plans = self.state()["plan"].as_u64().unwrap() + 1;
        assert_eq!(self.post("plan", "{}").status, 200);
        self.planned(plans)
    }
}

fn answer_of(stream: &mut TcpStream) -> Option<Answer> {
    let mut bytes = Vec::new();
    // What was sent before a reset counts.
    let _ = stream.read_to_end(&mut bytes);
    let text = String::from_utf8_lossy(&bytes);
    let (head, body) = text.split_once("\r\n\r\n")?;
    let status = head.split(' ').nth(1)?.parse().ok()?;
    Some(Answer { status, head: head.to_ascii_lowercase(), body: body.to_owned() })
}

/// A file of a run without what differs from run to run: times.
fn lasting(folder: &Path, name: &str) -> Vec<u8> {
    let bytes = std::fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    if name != "summary.json" {
        return bytes;
    }
    let mut summary: Value = serde_json::from_slice(&bytes).unwrap();
    summary["stages"] = Value::Null;
    summary.to_string().into_bytes()
}

fn same_files(a: &Path, b: &Path) {
    let names = [
        "path.csv",
        "path.json",
        "path.script",
        "weldpath.mod",
        "model.ply",
        "views.json",
        "job.toml",
        "summary.json",
        "report.svg",
    ];
    for name in names {
        assert!(lasting(a, name) == lasting(b, name), "{name} differs");
    }
}

#[test]
fn what_is_clicked_is_what_the_command_plans_from_the_job() {
    let open = Open::new(&fixture("fillet"));
    let first = open.planned(1);
    assert_eq!((&first["unplanned"], &first["failure"]), (&false.into(), &Value::Null));
    let ids: Vec<u64> =
        first["seams"].as_array().unwrap().iter().map(|s| s["id"].as_u64().unwrap()).collect();
    assert!(!ids.is_empty(), "{first}");
    let seam = ids[0];
    for (key, value) in [
        ("path.direction", json!("reverse")),
        ("path.extend_end_mm", json!(-12)),
        ("weave.shape", json!("zigzag")),
        ("torch.work_angle_deg", json!(7.5)),
    ] {
        open.edit(json!({ "edit": "set", "seam": seam, "key": key, "value": value }));
    }
    open.edit(json!({ "edit": "set", "seam": null, "key": "path.standoff_mm", "value": 12 }));
    open.edit(json!({ "edit": "set", "seam": null, "key": "formats", "value": ["ur", "abb"] }));
    let state = open.edit(json!({ "edit": "accept", "reason": "tool-not-stated", "on": true }));
    assert_eq!(state["unplanned"], true);
    let state = open.replan();
    assert_eq!((&state["unplanned"], &state["failure"]), (&false.into(), &Value::Null), "{state}");
    let plan = |arguments: &[&str]| {
        ends_well(weldpath().arg("plan").args(arguments).arg("--quiet").current_dir(open.home.path()));
    };
    plan(&["--job", "out/job.toml", "--out", "again"]);
    same_files(&open.out(), &open.home.path().join("again"));
    let job = std::fs::read_to_string(open.out().join("job.toml")).unwrap();
    for line in ["within_mm = 5.0", "shape = \"zigzag\"", "accept = [\"tool-not-stated\"]"] {
        assert!(job.contains(line), "{line}: {job}");
    }
    assert!(job.contains("near_mm") && !job.contains("\nid ="), "{job}");

    // The command that can be copied makes the same elsewhere.
    let command = state["command"].as_str().unwrap();
    let elsewhere = open.home.path().join("elsewhere");
    let command = command.replace(open.out().to_str().unwrap(), elsewhere.to_str().unwrap());
    let bin = Path::new(weldpath().get_program()).parent().unwrap().to_owned();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    ends_well(std::process::Command::new("sh").args(["-c", &command]).env("PATH", path));
    same_files(&open.out(), &elsewhere);
}

/// Four seams that meet nowhere but in one cross.
fn cross() -> (tempfile::TempDir, PathBuf) {
    let home = tempfile::tempdir().unwrap();
    ends_well(
        weldpath()
            .args(["simulate", "--part", "cruciform", "--size", "320x240", "--out", "scan", "--quiet"])
            .current_dir(home.path()),
    );
    let scan = home.path().join("scan");
    (home, scan)
}

fn order_in(folder: &Path) -> Vec<u64> {
    let csv = std::fs::read_to_string(folder.join("path.csv")).unwrap();
    let mut order: Vec<u64> =
        csv.lines().skip(1).map(|line| line.split(',').next().unwrap().parse().unwrap()).collect();
    order.dedup();
    order
}

#[test]
fn seams_are_left_out_and_put_in_order_and_all_can_be_undone() {
    let (home, scan) = cross();
    let open = Open::with(home, &scan);
    let first = open.planned(1);
    let all: Vec<u64> = first["order"].as_array().unwrap().iter().map(|id| id.as_u64().unwrap()).collect();
    assert!(all.len() >= 3, "{first}");
    assert_eq!(order_in(&open.out()), all);
    let mut turned = all.clone();
    turned.reverse();
    open.edit(json!({ "edit": "order", "seams": turned }));
    open.edit(json!({ "edit": "weld", "seam": all[1], "on": false }));
    open.replan();
    let without: Vec<u64> = turned.iter().copied().filter(|id| *id != all[1]).collect();
    assert_eq!(order_in(&open.out()), without);

    // All seams cannot be left out, and what is refused changes nothing.
    for id in &without[1..] {
        open.edit(json!({ "edit": "weld", "seam": id, "on": false }));
    }
    let before = open.state();
    let words = open.refused(&json!({ "edit": "weld", "seam": without[0], "on": false }));
    assert!(words.contains("none is left"), "{words}");
    assert_eq!(open.state()["job"], before["job"]);

    let mut undone = 0;
    while !open.state()["undo"].is_null() {
        assert_eq!(open.post("undo", "{}").status, 200);
        undone += 1;
    }
    assert_eq!(undone, 2 + without.len() - 1);
    assert_eq!(open.state()["job"], first["job"]);
    for _ in 0..undone {
        assert_eq!(open.post("redo", "{}").status, 200);
    }
    assert_eq!(open.state()["job"], before["job"]);
    assert_eq!(open.state()["redo"], Value::Null);
}

#[test]
fn a_seam_that_a_box_or_a_list_left_out_can_be_taken_in() {
    let (home, scan) = cross();
    let job = home.path().join("some.toml");
    std::fs::write(&job, format!("input = {:?}\n[selection]\nseams = [2]\n", scan.to_str().unwrap()))
        .unwrap();
    let open = Open::with(home, &job);
    let on = |state: &Value| -> Vec<u64> {
        let seams = state["seams"].as_array().unwrap().iter().filter(|seam| seam["on"] == true);
        seams.map(|seam| seam["id"].as_u64().unwrap()).collect()
    };
    assert_eq!(on(&open.planned(1)), [2]);
    assert_eq!(on(&open.edit(json!({ "edit": "weld", "seam": 1, "on": true }))), [1, 2]);
    open.replan();
    let mut order = order_in(&open.out());
    order.sort_unstable();
    assert_eq!(order, [1, 2]);
}

/// The box of a seam and 3 mm about it, as the page has its line.
fn box_around(content: &Value, seam: &Value) -> Value {
    let line = content["seams"].as_array().unwrap().iter().find(|one| one["id"] == *seam).unwrap();
    let points = line["line_mm"].as_array().unwrap();
    let bound = |pick: fn(f64, f64) -> f64, grown_mm: f64| {
        [0, 1, 2]
            .map(|axis| points.iter().map(|p| p[axis].as_f64().unwrap()).reduce(pick).unwrap() + grown_mm)
    };
    json!([bound(f64::min, -3.0), bound(f64::max, 3.0)])
}

fn roi(value: &Value) -> Value {
    json!({ "edit": "set", "seam": null, "key": "selection.roi_mm", "value": value })
}

fn exclude(was: &Value, now: &Value) -> Value {
    json!({ "edit": "exclude", "was": was, "now": now })
}

/// A cross whose programs are those of `same_files`, its state, and the box about the seam that is welded first.
fn boxed() -> (Open, Value, Value) {
    let (home, scan) = cross();
    let open = Open::with(home, &scan);
    open.planned(1);
    open.edit(json!({ "edit": "set", "seam": null, "key": "formats", "value": ["ur", "abb"] }));
    let first = open.planned(2);
    let content: Value = serde_json::from_str(&open.get("content").body).unwrap();
    let around = box_around(&content["content"], &json!(order_in(&open.out())[0]));
    (open, first, around)
}

#[test]
fn the_box_in_which_alone_is_welded_is_drawn_at_once_and_one_without_a_seam_is_refused() {
    let (open, first, around) = boxed();
    let found = order_in(&open.out());
    open.edit(roi(&around));
    open.planned(3);
    assert_eq!(order_in(&open.out()), [found[0]]);
    let words = open.refused(&roi(&json!([[9000, 0, 0], [9001, 1, 1]])));
    assert!(words.contains("no seam has half of its points in the region of interest; seam"), "{words}");
    open.edit(roi(&Value::Null));
    assert_eq!(open.state()["job"], first["job"]);
}

/// Shares of each seam's welded points that lie in a box.
fn shares_in(folder: &Path, region: &Value) -> Vec<f64> {
    let csv = std::fs::read_to_string(folder.join("path.csv")).unwrap();
    let is_in = |row: &&str| {
        let columns: Vec<f64> = row.split(',').map(|v| v.parse().unwrap()).collect();
        let bound = |end: usize, axis: usize| region[end][axis].as_f64().unwrap();
        (0..3).all(|axis| (bound(0, axis)..=bound(1, axis)).contains(&columns[3 + axis]))
    };
    let share = |seam: u64| {
        let own = || csv.lines().skip(1).filter(|row| row.starts_with(&format!("{seam},")));
        own().filter(is_in).count() as f64 / own().count() as f64
    };
    order_in(folder).into_iter().map(share).collect()
}

#[test]
fn what_is_excluded_by_a_click_holds_with_the_next_plan_and_the_command_plans_the_same() {
    let (open, first, around) = boxed();
    // A box far away, moved onto a seam, and all below the table.
    let far = json!({ "box": [[9000.5, 0, 0], [9001, 1, 1]] });
    let near = json!({ "box": around });
    let below = json!({ "half_space": { "at_mm": [0, 0, -900], "toward": [0, 0, -1] } });
    for (was, now) in [(&Value::Null, &far), (&far, &near), (&Value::Null, &below)] {
        open.edit(exclude(was, now));
    }
    assert!(shares_in(&open.out(), &around).contains(&1.0), "nothing is sought before it is asked for");
    let state = open.replan();
    assert_eq!(state["job"]["exclude"]["boxes_mm"], json!([around]));
    // Others may end in it, where they met that seam.
    let shares = shares_in(&open.out(), &around);
    assert!(!shares.is_empty() && shares.iter().all(|share| *share < 0.5), "{shares:?}");
    ends_well(
        weldpath()
            .args(["plan", "--job", "out/job.toml", "--out", "again", "--quiet"])
            .current_dir(open.home.path()),
    );
    same_files(&open.out(), &open.home.path().join("again"));
    open.edit(exclude(&near, &Value::Null));
    open.edit(exclude(&below, &Value::Null));
    assert_eq!(open.state()["job"], first["job"]);
}

#[test]
fn what_excludes_nothing_or_names_a_file_is_refused_in_words() {
    let open = Open::new(&fixture("butt-v"));
    let before = open.planned(1);
    let nothing = Value::Null;
    let unit = json!({ "box": [[0, 0, 0], [1, 1, 1]] });
    let no_direction = json!({ "half_space": { "at_mm": [0, 0, 0], "toward": [0, 0, 0] } });
    let background = json!({ "edit": "set", "seam": null, "key": "exclude.background", "value": "/etc" });
    for (edit, words) in [
        (exclude(&unit, &nothing), "not excluded any more"),
        (exclude(&nothing, &json!({ "box": [[1, 0, 0], [0, 1, 1]] })), "the first corner has the greater x"),
        (exclude(&nothing, &json!({ "box": [[0, 0, 0]] })), "length"),
        (exclude(&nothing, &no_direction), "cannot be zero"),
        (exclude(&nothing, &json!({ "background": "/etc" })), "unknown variant `background`"),
        (background, "cannot be set on this page"),
    ] {
        let said = open.refused(&edit);
        assert!(said.contains(words), "{edit}: {said}");
    }
    assert_eq!(open.state()["job"], before["job"]);
}

/// What lies in a folder, by name.
fn names_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_start_page_opens_what_is_typed_and_touches_nothing_else() {
    let open = Open::start(tempfile::tempdir().unwrap(), &[]);
    let page = open.get("");
    assert!(page.body.contains("id=\"start\"") && page.head.contains("script-src 'nonce-"), "{}", page.body);
    let state = open.state();
    let home = open.home.path().to_str().unwrap().to_owned();
    assert!(state["open"] == false && state["out"].as_str().unwrap().ends_with("/out"), "{state}");
    for path in ["content", "schema", "section?seam=1&at_mm=1", "/etc/passwd"] {
        assert_eq!(open.get(path).status, 404, "{path}");
    }
    for path in ["edit", "undo", "plan", "cancel", "other"] {
        assert_eq!(open.post(path, "{}").status, 404, "{path}");
    }
    for (body, words) in [
        (json!({ "choose": "input", "input": "nowhere" }), "cannot read nowhere: No such file"),
        (json!({ "choose": "input", "input": "nowhere.toml" }), "nowhere.toml"),
        (json!({ "choose": "input", "input": fixture("fillet"), "more": 1 }), "unknown field `more`"),
        (json!([]), "missing field"),
        (json!({}), "missing field `choose`"),
    ] {
        let answer = open.post("start", &body.to_string());
        assert!(answer.status == 400 && answer.body.contains(words), "{body}: {}", answer.body);
    }
    assert!(names_in(open.home.path()).is_empty(), "{:?}", names_in(open.home.path()));

    let mine = json!({ "choose": "input", "input": fixture("fillet"), "out": "mine" });
    let answer = open.post("start", &mine.to_string());
    assert_eq!(answer.status, 200, "{}", answer.body);
    let state = open.planned(1);
    assert!(state["out"].as_str().unwrap().starts_with(&home) && state["failure"].is_null(), "{state}");
    assert_eq!(names_in(open.home.path()), ["mine"]);
    assert!(open.home.path().join("mine/path.script").is_file());
    // What is open stays open.
    assert_eq!(open.post("start", &mine.to_string()).status, 404);
}

/// Direction of the torch axis at each welded point.
fn torch_axes(folder: &Path) -> Vec<Vector3<f64>> {
    let csv = std::fs::read_to_string(folder.join("path.csv")).unwrap();
    let axis = |row: &str| {
        let v: Vec<f64> = row.split(',').map(|v| v.parse().unwrap()).collect();
        UnitQuaternion::from_quaternion(Quaternion::new(v[6], v[7], v[8], v[9])) * Vector3::z()
    };
    csv.lines().skip(1).map(axis).collect()
}

#[test]
fn a_corrected_joint_type_is_welded_as_that_type_is_and_bound_to_its_place() {
    let open = Open::new(&fixture("fillet"));
    let first = open.planned(1);
    assert_eq!(first["seams"][0]["found_joint"], "fillet");
    let bisector = torch_axes(&open.out());
    let set = |seam: Value, key: &str, value: Value| json!({ "edit": "set", "seam": seam, "key": key, "value": value });
    // What holds for lap joints says nothing of a fillet, until this one is a lap joint.
    open.edit(set(Value::Null, "joint.lap.torch.work_angle_deg", json!(20)));
    open.edit(set(Value::Null, "formats", json!(["ur", "abb"])));
    open.planned(2);
    assert_eq!(torch_axes(&open.out()), bisector);
    let plans = open.state()["plan"].as_u64().unwrap();
    let state = open.edit(set(json!(1), "joint", json!("lap")));
    assert_eq!(state["seams"][0]["settings"]["torch"]["work_angle_deg"], 20.0);
    open.planned(plans + 1);
    let leaned = torch_axes(&open.out());
    assert_eq!(leaned.len(), bisector.len());
    for (a, b) in leaned.iter().zip(&bisector) {
        let lean_deg = a.angle(b).to_degrees();
        assert!((lean_deg - 20.0).abs() < 0.01, "{lean_deg}");
    }
    let summary: Value =
        serde_json::from_slice(&std::fs::read(open.out().join("summary.json")).unwrap()).unwrap();
    let seam = &summary["seams"][0];
    assert_eq!(seam["joint"], "lap");
    let reason = seam["reason"].as_str().unwrap();
    assert!(reason.starts_with("lap as stated in the job; detected and measured as fillet: "), "{reason}");
    let job = std::fs::read_to_string(open.out().join("job.toml")).unwrap();
    assert!(job.contains("near_mm") && job.contains("joint = \"lap\"") && !job.contains("\nid ="), "{job}");
    ends_well(
        weldpath()
            .args(["plan", "--job", "out/job.toml", "--out", "again", "--quiet"])
            .current_dir(open.home.path()),
    );
    same_files(&open.out(), &open.home.path().join("again"));
    let words = open.refused(&set(json!(1), "joint", json!("scarf")));
    assert!(words.contains("unknown variant `scarf`") && words.contains("`fillet`"), "{words}");
    let words = open.refused(&set(Value::Null, "joint.scarf.path.feed_mm_s", json!(3)));
    assert!(words.contains("unknown variant `scarf`"), "{words}");
    open.edit(set(json!(1), "joint", Value::Null));
    open.edit(set(Value::Null, "joint.lap.torch.work_angle_deg", Value::Null));
    open.edit(set(Value::Null, "formats", Value::Null));
    assert_eq!(open.state()["job"], first["job"], "nothing is left of it");
}

#[test]
fn a_cross_section_shows_points_on_the_fitted_faces_about_the_root_and_the_torch_between_them() {
    let open = Open::new(&fixture("fillet"));
    for (query, status) in [
        ("", 400),
        ("?seam=1", 400),
        ("?seam=1&at_mm=nan", 400),
        ("?seam=x&at_mm=1", 400),
        ("?at_mm=1&seam=1", 400),
    ] {
        assert_eq!(open.get(&format!("section{query}")).status, status, "{query}");
    }
    open.planned(1);
    let of = |query: &str| open.get(&format!("section?{query}"));
    let unknown = of("seam=7&at_mm=1");
    assert_eq!((unknown.status, unknown.body.as_str()), (404, "there is no seam 7"));
    let section: Value = serde_json::from_str(&of("seam=1&at_mm=30").body).unwrap();
    let pair = |value: &Value| [0, 1].map(|k| value[k].as_f64().unwrap());
    let faces = [0, 1].map(|k| pair(&section["faces"][k]));
    // The fixture's plates stand at 90 degrees; the bisector is the second axis.
    assert!(
        faces[0][0] * faces[1][0] < 0.0 && faces.iter().all(|face| (face[1] - 0.5_f64.sqrt()).abs() < 0.02)
    );
    let off_mm = |[o, n]: [f64; 2]| {
        let off = |face: [f64; 2]| (o * face[1] - n * face[0]).abs();
        off(faces[0]).min(off(faces[1]))
    };
    let mut offs_mm: Vec<f64> =
        section["points_mm"].as_array().unwrap().iter().map(|p| off_mm(pair(p))).collect();
    offs_mm.sort_by(f64::total_cmp);
    assert!(offs_mm.len() > 20 && offs_mm[offs_mm.len() / 2] < 0.3, "{offs_mm:?}");
    let torch = &section["torches"][0];
    assert!(
        pair(&torch["tip_mm"]).iter().all(|mm| mm.abs() < 0.1) && pair(&torch["axis"])[1] > 0.999,
        "{torch}"
    );
    let summary: Value =
        serde_json::from_slice(&std::fs::read(open.out().join("summary.json")).unwrap()).unwrap();
    assert_eq!(section["error_mm"], summary["seams"][0]["expected_error_mm"]);
    let at_mm = section["at_mm"].as_f64().unwrap();
    assert!((at_mm - 30.0).abs() < 3.0 && section["length_mm"] == summary["seams"][0]["length_mm"]);
    // Beyond the end it is that at the end.
    let last: Value = serde_json::from_str(&of("seam=1&at_mm=1e9").body).unwrap();
    assert!((last["at_mm"].as_f64().unwrap() - last["length_mm"].as_f64().unwrap()).abs() < 1e-6);
}

#[test]
fn an_edit_of_how_seams_are_welded_searches_for_none_and_a_scan_that_changed_is_read_again() {
    let (home, scan) = cross();
    let open = Open::with(home, &scan);
    open.planned(1);
    let times = || {
        let text = std::fs::read_to_string(open.out().join("summary.json")).unwrap();
        serde_json::from_str::<Value>(&text).unwrap()["stages"].clone()
    };
    let searched = times();
    let begun = Instant::now();
    open.edit(json!({ "edit": "set", "seam": null, "key": "path.feed_mm_s", "value": 5 }));
    open.replan();
    let edited_s = begun.elapsed().as_secs_f64();
    assert_eq!(times(), searched, "the search of before, to the microsecond");
    // A file that was written anew with what it held is the same scan; one without its last view is another.
    let json = scan.join("scan.json");
    let text = std::fs::read(&json).unwrap();
    std::fs::write(&json, &text).unwrap();
    open.replan();
    assert_eq!(times(), searched);
    let mut fewer: Value = serde_json::from_slice(&text).unwrap();
    fewer["views"].as_array_mut().unwrap().pop();
    std::fs::write(&json, fewer.to_string()).unwrap();
    let begun = Instant::now();
    open.replan();
    assert_ne!(times(), searched);
    println!("planned in {:.2} s, after an edit in {edited_s:.2} s", begun.elapsed().as_secs_f64());
}

#[test]
fn an_edit_of_how_seams_are_welded_is_drawn_without_being_asked_for_and_a_new_search_is_not() {
    let open = Open::new(&fixture("fillet"));
    let first = open.planned(1);
    let feed = |value: f64| json!({ "edit": "set", "seam": null, "key": "path.feed_mm_s", "value": value });
    // Of edits that follow each other closely the last is drawn, and few of the others.
    const EDITS: u64 = 20;
    (0..EDITS).for_each(|k| drop(open.edit(feed(3.0 + 0.125 * k as f64))));
    let state = open.planned(2);
    let plans = state["plan"].as_u64().unwrap();
    assert!(plans < 1 + EDITS, "{plans}");
    assert_eq!((&state["cloud"], &state["failure"]), (&first["cloud"], &Value::Null));
    let job = || std::fs::read_to_string(open.out().join("job.toml")).unwrap();
    assert!(job().contains("feed_mm_s = 5.375"), "{}", job());

    // The page is given the numbers of it, which are those of the report, without its points.
    let told: Value = serde_json::from_str(&open.get("content").body).unwrap();
    assert_eq!((&told["plan"], &told["cloud"]), (&state["plan"], &state["cloud"]));
    assert_eq!(told["content"]["job"], job());
    let page = open.get("").body;
    assert!(page.contains(&format!("data-plan=\"{plans}\" data-cloud=\"{}\"", state["cloud"])));
    assert!(told.to_string().len() * 4 < page.len());

    // Undone, it is drawn as it was; and what was undone meanwhile is not drawn after all.
    assert_eq!(open.post("undo", "{}").status, 200);
    open.planned(plans + 1);
    assert!(job().contains("feed_mm_s = 5.25"), "{}", job());
    let ask = json!({ "edit": "ask", "between_mm": [[0, 0, 0], [50, 0, 0]] });
    open.edit(ask);
    std::thread::sleep(Duration::from_millis(600));
    let state = open.state();
    assert_eq!((&state["unplanned"], &state["drawing"]), (&true.into(), &false.into()), "{state}");
    assert!(state["running"].is_null() && state["failure"].is_null(), "{state}");
}

#[test]
fn an_edit_that_makes_no_job_is_refused_in_words() {
    let open = Open::new(&fixture("butt-v"));
    let before = open.planned(1);
    let set = |seam: Value, key: &str, value: Value| json!({ "edit": "set", "seam": seam, "key": key, "value": value });
    for (edit, words) in [
        (set(Value::Null, "path.feed_mm_s", json!(900)), "too much: at most 250 mm/s"),
        (set(Value::Null, "path.feed_mm_s", json!("fast")), "path.feed_mm_s: invalid type"),
        (set(Value::Null, "path.points", json!(50)), ""),
        (set(Value::Null, "path.fed_mm_s", json!(5)), "unknown field `fed_mm_s`"),
        (set(Value::Null, "input", json!("/etc/passwd")), "\"input\" cannot be set on this page"),
        (set(Value::Null, "seam", json!([])), "\"seam\" cannot be set on this page"),
        (set(Value::Null, "accept.0", json!("units")), "cannot be set on this page"),
        (set(json!(1), "order.sequence", json!("found")), "cannot be set on this page"),
        (set(json!(99), "path.feed_mm_s", json!(5)), "there is no seam 99"),
        (set(Value::Null, "robot.model", json!("r2d2")), "r2d2"),
        (json!({ "edit": "order", "seams": [1, 1] }), "twice"),
        (json!({ "edit": "order", "seams": [7] }), "there is no seam 7"),
        (json!({ "edit": "accept", "reason": "all", "on": true }), "unknown variant"),
        (json!({ "edit": "fly" }), "unknown variant"),
        (json!({ "edit": "weld", "seam": 1, "on": true, "more": 1 }), "unknown field"),
    ] {
        if words.is_empty() {
            // Two ways to say one thing: the second is refused.
            open.edit(edit);
            let spacing = set(Value::Null, "path.spacing_mm", json!(3));
            assert!(open.refused(&spacing).contains("spacing_mm and points exclude each other"));
            open.post("undo", "{}");
            continue;
        }
        let said = open.refused(&edit);
        assert!(said.contains(words), "{edit}: {said}");
    }
    assert_eq!(open.state()["job"], before["job"]);
}

#[test]
fn without_the_token_from_another_host_or_from_another_page_nothing_is_told_or_done() {
    let open = Open::new(&fixture("butt-v"));
    let before = open.planned(1);
    let (host, token) = (open.host(), open.token.clone());
    let status = |request: String| {
        open.raw(request.as_bytes()).map(|answer| {
            assert!(!answer.body.contains("feed_mm_s"), "{}", answer.body);
            answer.status
        })
    };
    let get = |path: &str, host: &str, more: &str| {
        status(format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n{more}\r\n"))
    };
    for path in
        ["/", "/state", "/schema", &format!("/{}/state", "0".repeat(32)), &format!("/{}/state", &token[1..])]
    {
        assert_eq!(get(path, &host, ""), Some(403), "{path}");
    }
    let state = format!("/{token}/state");
    for foreign in ["evil.example", "evil.example:80", "127.0.0.1", "0.0.0.0:80", "[::1]:80"] {
        assert_eq!(get(&state, foreign, ""), Some(421), "{foreign}");
    }
    assert_eq!(get(&state, &host, "Origin: http://evil.example\r\n"), Some(403));
    assert_eq!(get(&state, &host, "Origin: null\r\n"), Some(403));
    let body = "{\"edit\":\"accept\",\"reason\":\"units\",\"on\":true}";
    let post = |head: &str, kind: &str| {
        let bytes = body.len();
        status(format!(
            "POST /{token}/edit HTTP/1.1\r\nHost: {host}\r\n{head}Content-Type: {kind}\r\nContent-Length: {bytes}\r\n\r\n{body}"
        ))
    };
    let own = format!("Origin: http://{host}\r\n");
    assert_eq!(post("", "application/json"), Some(403), "a form of another page may come without an origin");
    assert_eq!(post("Origin: http://evil.example\r\n", "application/json"), Some(403));
    assert_eq!(post(&format!("{own}Sec-Fetch-Site: cross-site\r\n"), "application/json"), Some(403));
    assert_eq!(post(&own, "text/plain"), Some(415), "what a form can send without asking");
    for method in ["PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"] {
        let request =
            format!("{method} /{token}/edit HTTP/1.1\r\nHost: {host}\r\n{own}Content-Length: 0\r\n\r\n");
        assert_eq!(status(request), Some(405), "{method}");
    }
    assert_eq!(open.state()["job"], before["job"]);
    // No answer may be read, framed or kept by others.
    let head = open.get("").head;
    for line in [
        "x-frame-options: deny",
        "cache-control: no-store",
        "referrer-policy: no-referrer",
        "cross-origin-resource-policy: same-origin",
        "default-src 'none'; script-src 'nonce-",
        "frame-ancestors 'none'",
    ] {
        assert!(head.contains(line), "{line}: {head}");
    }
    assert!(!head.contains("access-control-allow"), "{head}");
}

#[test]
fn no_path_leads_to_a_file() {
    let open = Open::new(&fixture("butt-v"));
    open.planned(1);
    for path in [
        "../../../../etc/passwd",
        "..%2f..%2f..%2fetc%2fpasswd",
        "%2e%2e/%2e%2e/etc/passwd",
        "/etc/passwd",
        "..\\..\\etc\\passwd",
        "job.toml",
        "out/job.toml",
        "./report.html",
        "state/../job.toml",
        "file:///etc/passwd",
        "file",
    ] {
        let answer = open.get(path);
        let known = ["there is nothing here", "the last plan wrote no file of this name"];
        assert!(answer.status == 404 && known.contains(&answer.body.as_str()), "{path}: {}", answer.body);
        assert_eq!(open.post(path, "{}").status, 404, "{path}");
    }
}

#[test]
fn files_of_the_last_plan_are_handed_out_and_no_others() {
    let open = Open::new(&fixture("butt-v"));
    let state = open.planned(1);
    let names: Vec<&str> =
        state["files"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    assert!(names.contains(&"path.script") && names.contains(&"job.toml"), "{names:?}");
    for name in names.iter().filter(|name| !name.ends_with(".ply")) {
        let answer = open.get(&format!("file?name={name}"));
        let on_disk = std::fs::read_to_string(open.out().join(name)).unwrap();
        assert_eq!((answer.status, answer.body == on_disk), (200, true), "{name}");
    }
    std::fs::write(open.out().join("own.txt"), "mine").unwrap();
    for name in ["own.txt", "../scan.json", "", "..", "/etc/passwd", "%2e%2e/scan.json", ".weldpath.json"] {
        let answer = open.get(&format!("file?name={name}"));
        assert_eq!((answer.status, answer.body.contains("mine")), (404, false), "{name}");
    }
    // A plan that is refused leaves no program to be saved.
    open.edit(json!({ "edit": "set", "seam": null, "key": "path.standoff_mm", "value": -20 }));
    let refused = open.planned(2);
    if refused["failure"]["message"].as_str().is_some_and(|words| words.contains("refused")) {
        assert!(!refused["files"].as_array().unwrap().iter().any(|name| name == "path.script"));
        assert_eq!(open.get("file?name=path.script").status, 404);
    } else {
        panic!("a tip 20 mm inside the plate is refused: {}", refused["failure"]);
    }
}

#[test]
fn what_is_no_request_too_large_or_too_slow_is_refused_and_the_page_goes_on() {
    let open = Open::new(&fixture("butt-v"));
    let before = open.planned(1);
    let (host, token) = (open.host(), &open.token);
    let head = format!(
        "POST /{token}/edit HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nContent-Type: application/json\r\n"
    );
    for body in [
        "",
        "{",
        "[]",
        "nul",
        "{\"edit\":\"weld\"}",
        "\u{0}",
        &"[".repeat(60_000),
        "{\"edit\":\"set\",\"key\":1e999}",
    ] {
        assert_eq!(open.post("edit", body).status, 400, "{}", &body[..body.len().min(30)]);
    }
    let giant = "x".repeat(10 << 20);
    // A server that closes on what is still being sent takes its answer with it.
    let giant = format!("{head}Content-Length: {}\r\n\r\n{giant}", giant.len());
    assert!(open.raw(giant.as_bytes()).is_none_or(|answer| answer.status == 413));
    let said = format!("{head}Content-Length: 1000000000000\r\n\r\n");
    assert_eq!(open.raw(said.as_bytes()).map(|answer| answer.status), Some(413), "before any of it is read");
    let chunks = format!(
        "{head}Transfer-Encoding: chunked\r\n\r\n{}",
        "1000\r\n".to_owned() + &"x".repeat(4096) + "\r\n"
    );
    let chunk = &chunks[chunks.len() - 4104..].to_owned();
    assert!(open.raw((chunks + &chunk.repeat(40)).as_bytes()).is_none_or(|answer| answer.status == 413));
    let long = format!("GET /{token}/{} HTTP/1.1\r\nHost: {host}\r\n\r\n", "a".repeat(1 << 20));
    assert!(open.raw(long.as_bytes()).is_none_or(|answer| [400, 404, 414, 431].contains(&answer.status)));
    for noise in ["\r\n\r\n", "hello\r\n\r\n", "GET\r\n\r\n", "\u{16}\u{3}\u{1}", "GET / HTTP/9.9\r\n\r\n"] {
        assert!(
            open.raw(format!("{noise}\r\n\r\n").as_bytes()).is_none_or(|answer| answer.status >= 400),
            "{noise:?}"
        );
    }

    // A body that does not end, and a head that does not: both are given up after five seconds.
    let begun = Instant::now();
    let mut slow =
        [format!("{head}Content-Length: 100\r\n\r\n{{"), format!("GET /{token}/state HTT")].map(|text| {
            let mut stream = open.connect();
            stream.write_all(text.as_bytes()).unwrap();
            stream
        });
    let body = answer_of(&mut slow[0]).expect("an answer");
    assert_eq!(body.status, 408);
    assert!(answer_of(&mut slow[1]).is_none_or(|answer| answer.status == 408));
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
    assert_eq!(open.state()["job"], before["job"]);
}

#[test]
fn two_hundred_connections_that_say_nothing_keep_nobody_out_for_long() {
    let open = Open::new(&fixture("butt-v"));
    open.planned(1);
    let idle: Vec<TcpStream> = (0..200).map(|_| open.connect()).collect();
    let begun = Instant::now();
    let request = format!("GET /{}/state HTTP/1.1\r\nHost: {}\r\n\r\n", open.token, open.host());
    while open.raw(request.as_bytes()).is_none() {
        assert!(begun.elapsed() < Duration::from_secs(30), "still shut after {:?}", begun.elapsed());
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(idle.len(), 200);
}

#[test]
fn a_plan_that_is_given_up_changes_no_file_and_the_next_one_ends_well() {
    let open = Open::new(&fixture("pipe"));
    assert!(open.state()["running"].is_array());
    assert_eq!(open.post("cancel", "{}").status, 200);
    let given_up = open.planned(0);
    assert!(given_up["failure"]["message"].as_str().unwrap().contains("given up"), "{given_up}");
    assert!(!open.out().join("path.csv").exists());
    assert!(open.get("").body.contains("id=\"editor\""), "a page from which one can plan again");
    assert!(
        open.refused(&json!({ "edit": "weld", "seam": 1, "on": false })).contains("nothing is planned yet")
    );
    let planned = open.replan();
    assert_eq!(planned["failure"], Value::Null);
    assert!(open.out().join("path.script").is_file());
}

#[test]
fn a_folder_of_results_goes_on_with_its_job_and_files_of_ones_own_are_kept() {
    let home = tempfile::tempdir().unwrap();
    let scan = fixture("butt-v");
    let scan = scan.to_str().unwrap();
    ends_well(weldpath().args(["plan", scan, "--feed-mm-s", "6.5", "--quiet"]).current_dir(home.path()));
    let open = Open::with(home, Path::new("out"));
    let state = open.planned(1);
    assert_eq!((&state["job"]["path"]["feed_mm_s"], &state["failure"]), (&6.5.into(), &Value::Null));

    // A program that somebody has edited meanwhile is not replaced, and the page says so.
    let program = open.out().join("path.script");
    std::fs::write(&program, "mine").unwrap();
    open.edit(json!({ "edit": "set", "seam": null, "key": "path.feed_mm_s", "value": 5 }));
    assert_eq!(open.post("plan", "{}").status, 200);
    let refused = open.planned(1);
    assert!(refused["failure"]["message"].as_str().unwrap().contains("path.script"), "{refused}");
    assert_eq!(
        (std::fs::read_to_string(&program).unwrap().as_str(), &refused["unplanned"]),
        ("mine", &true.into())
    );
}

#[test]
fn a_scan_without_a_seam_or_that_cannot_be_read_is_told_in_the_page() {
    let open = Open::new(&fixture("plate"));
    let state = open.planned(1);
    assert!(state["failure"]["message"].as_str().unwrap().starts_with("no seam found"), "{state}");
    assert!(open.get("").body.contains("weldpath-report"), "what was seen is shown");
    let home = tempfile::tempdir().unwrap();
    let broken = home.path().join("a.ply");
    std::fs::write(&broken, "ply\nformat ascii 1.0\nelement vertex 3\n<img src=x>").unwrap();
    let open = Open::with(home, &broken);
    let state = open.planned(0);
    assert!(state["failure"]["message"].as_str().unwrap().contains("a.ply"), "{state}");
}

/// Wants no more of the plan once this stage has begun.
struct UntilStage {
    last: &'static str,
    begun: Vec<&'static str>,
}

impl Observer for UntilStage {
    fn stage(&mut self, name: &'static str) {
        self.begun.push(name);
    }

    fn is_done(&self) -> bool {
        self.begun.contains(&self.last)
    }
}

#[test]
fn a_plan_ends_with_the_stage_at_which_it_is_given_up() {
    let views: Vec<View> = input::read(&fixture("butt-v"), &input::Options::default()).unwrap().views;
    let stages = ["normals", "reconstruction", "downsampling", "denoising", "seam"];
    for (k, last) in stages.into_iter().enumerate() {
        let mut until = UntilStage { last, begun: Vec::new() };
        let planned = pipeline::plan(&views, &Job::default().pipeline(), &mut until);
        assert_eq!(planned.err(), Some(PlanError::GivenUp), "{last}");
        // Thinning and filtering are one step.
        let most = if last == "downsampling" { k + 2 } else { k + 1 };
        assert_eq!(until.begun, stages[..most], "{last}");
    }
}
