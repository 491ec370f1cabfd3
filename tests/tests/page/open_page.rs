//! `weldpath open` as its users see it: a browser in which seams are clicked, and the files that come of it.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::Value;
use weldpath::report;
use weldpath_tests::browser;
use weldpath_tests::command::{ends_well, weldpath};
use weldpath_tests::page::{Page, apart_mm, ends};

fn web() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("host/src/report/web")
}

#[test]
fn the_bundle_of_the_editor_is_built_from_the_sources_beside_it() {
    let sum = std::process::Command::new("sh")
        .args(["-c", "cat editor/src/*.js src/dom.js src/texts.js package-lock.json | cksum"])
        .current_dir(web())
        .output();
    let sum = String::from_utf8(sum.expect("sh and cksum").stdout).unwrap().trim().replace(' ', "-");
    for name in ["editor", "start"] {
        let bundle = std::fs::read_to_string(web().join(format!("dist/{name}.js"))).unwrap();
        let banner = bundle.lines().next().unwrap();
        assert!(banner.contains(&format!("sources {sum} ")), "{banner}: run host/src/report/web/build.sh");
    }
}

#[test]
fn the_page_that_edits_is_the_report_with_a_script_behind_it() {
    let file = "<!doctype html>\n<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'\">\n\
                <title>a</title>\n<script type=\"application/json\">{}</script>\n<script>report()</script>\n</body>\n";
    let page = report::editable(file, "nonce", report::Edition { plan: 7, cloud: 2 }).unwrap();
    assert!(!page.contains("http-equiv") && page.contains("<script nonce=\"nonce\">report()</script>"));
    assert!(page.contains("data-plan=\"7\" data-cloud=\"2\" id=\"editor\">") && page.ends_with("</body>\n"));
    assert_eq!(page.matches("<script type=").count(), 1);
    assert_eq!(report::editable("<p>no report</p>", "nonce", report::Edition::default()), None);
    let waiting = report::waiting("nonce");
    assert!(
        !waiting.contains("{{")
            && waiting.contains("nonce=\"nonce\" data-plan=\"0\" data-cloud=\"0\" id=\"editor\"")
    );
}

#[test]
fn seams_are_left_out_reversed_put_in_order_and_woven_by_mouse_and_keys() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    page.picture("light");
    let first = page.order();
    let [left_out, reversed, early] = [first[0], first[1], first[3]];

    let before = choose(&mut page, left_out, reversed, early);
    weave(&mut page);
    page.drag_the_end(reversed, 12.0);
    page.settle("document.querySelector('#undo').title.includes('path.extend_end_mm')");
    let extended =
        page.browser.evaluate("Number(document.querySelector('[data-key=\"path.extend_end_mm\"]').value)");
    let short_mm = -extended.as_f64().unwrap();
    assert!((short_mm - 12.0).abs() < 1.5, "dragged inwards by {short_mm} mm");
    confirm_and_export(&mut page);

    // A reload loses nothing, and the plan is that of the job.
    let job = page.browser.evaluate("document.querySelector('#command pre').textContent");
    page.browser.evaluate("(() => { globalThis.isOld = true; location.reload(); })()");
    page.settle(&format!(
        "!globalThis.isOld && document.querySelector('#command pre').textContent === {job}"
    ));
    page.plan();
    assert!(page.text("#verdict .accepted").contains("tool-not-stated"));
    let order = page.order();
    assert_eq!(order[0], early);
    assert!(!order.contains(&left_out) && order.len() + 1 == first.len(), "{order:?} of {first:?}");
    let after = ends(&page.home.path().join("out"), reversed);
    // Both ends, within the amplitude of the weave.
    let moved_mm = [apart_mm(before[1], after[0]), apart_mm(before[0], after[1])];
    assert!(moved_mm[0] < 3.0 && (moved_mm[1] - short_mm).abs() < 3.0, "{before:?} {after:?}");
    for (size, theme, name) in [((1440, 900), "dark", "dark"), ((390, 844), "light", "phone")] {
        page.browser.resize(size.0, size.1);
        page.browser.evaluate(&format!("document.documentElement.dataset.theme = '{theme}'"));
        page.picture(name);
    }
    // What is beside a phone's window cannot be reached by a thumb.
    let beyond = page.browser.evaluate("document.documentElement.scrollWidth - innerWidth");
    assert!(beyond.as_f64().is_some_and(|px| px <= 0.0), "{beyond} px beyond the window");

    the_command_writes_the_same(&page);
    let said: Vec<_> = page
        .browser
        .console()
        .into_iter()
        .filter(|line| !line.to_string().contains("400 (Bad Request)"))
        .collect();
    assert!(said.is_empty(), "{said:?}");
}

/// One seam out by its box in the list; others first and turned round by keys.
/// Where the seam that is then reversed begins and ends before that.
fn choose(page: &mut Page, left_out: u64, reversed: u64, early: u64) -> [[f64; 3]; 2] {
    page.browser
        .evaluate(&format!("document.querySelector('#seams tr[data-seam=\"{left_out}\"] input').click()"));
    page.settle(&format!("!document.querySelector('#seams tr[data-seam=\"{left_out}\"] input').checked && !document.getElementById('undo').disabled"));
    // The picture follows without being asked to.
    page.settle(&format!(
        "document.querySelector('#seams tr[data-seam=\"{left_out}\"]').classList.contains('off')"
    ));
    page.browser.evaluate(&format!("document.querySelector('#seams tr[data-seam=\"{early}\"]').click()"));
    // The shortest way through those that are left may be another: it is first when it has passed all before it.
    let place =
        format!("Number(document.querySelector('#seams tr[data-seam=\"{early}\"] .place').textContent)");
    let before = page.browser.evaluate(&place).as_u64().unwrap();
    for passed in 1..before {
        page.browser.press("[", false);
        page.settle(&format!("{place} === {}", before - passed));
    }
    page.browser.evaluate(&format!("document.querySelector('#seams tr[data-seam=\"{reversed}\"]').click()"));
    // Those left may be welded the other way round by now.
    let before = page.shown_ends(reversed);
    page.browser.press("r", false);
    page.settle("['reverse', 'forward'].includes(document.querySelector('#settings [data-key=\"path.direction\"]').value)");
    before
}

/// A weave whose amplitude is too large first.
fn weave(page: &mut Page) {
    page.set("weave.shape", "sine");
    page.settle("document.querySelector('#settings [data-key=\"weave.shape\"]').closest('.field').classList.contains('said')");
    page.set("weave.amplitude_mm", "99");
    page.settle("!document.querySelector('#settings [data-group=\"weave\"] .refusal:not([hidden])').hidden");
    let refusal = page.text("#settings [data-group='weave'] .refusal:not([hidden])");
    assert!(refusal.contains("too much: at most 30 mm"), "{refusal}");
    page.set("weave.amplitude_mm", "1.5");
    page.settle("document.querySelector('#undo').title.includes('weave.amplitude_mm')");
}

/// A reason of the verdict is confirmed, taken back by a key, and confirmed again by another; then a dialect more.
fn confirm_and_export(page: &mut Page) {
    page.browser.evaluate("document.querySelector('#verdict [data-reason=\"tool-not-stated\"]').click()");
    page.settle("document.querySelector('#undo').title.includes('accept tool-not-stated')");
    page.browser.press("z", true);
    page.settle("!document.querySelector('#verdict [data-reason=\"tool-not-stated\"]').checked");
    page.browser.press("y", true);
    page.settle("document.querySelector('#verdict [data-reason=\"tool-not-stated\"]').checked");
    page.browser.press("j", false);
    page.browser.evaluate("document.querySelector('#settings [data-key=\"formats.kuka\"]').click()");
    page.settle("document.querySelector('#undo').title.includes('formats')");
}

/// What is counted of a page from now on: bytes that go to the graphics card, and whether it was loaded anew.
const COUNT: &str = "(() => {
    const gl = weldpath.scene.renderer.getContext();
    const send = gl.bufferData.bind(gl);
    globalThis.sent = { bytes: 0, model: weldpath.scene.groups.model };
    gl.bufferData = (target, data, use) => { sent.bytes += data.byteLength ?? data; send(target, data, use); };
    return true;
})()";

#[test]
fn an_edit_is_seen_at_once_in_the_same_page_without_its_cloud_being_sent_again() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    let seam = page.order()[0];
    page.browser.evaluate(&format!("document.querySelector('#seams tr[data-seam=\"{seam}\"]').click()"));
    page.browser.evaluate(COUNT);
    let points = page.browser.evaluate("sent.model.geometry.attributes.position.count").as_u64().unwrap();
    let welded = "weldpath.content.waypoints.filter((w) => w[9] === 'weld').length";
    let before = page.browser.evaluate(welded).as_u64().unwrap();
    let camera = "weldpath.scene.camera.position.toArray().join()";
    page.browser.evaluate("weldpath.scene.turn(0.3, 0.1)");
    let stood = page.browser.evaluate(camera);
    let first = page.shown();
    let begun = Instant::now();
    page.set("weave.shape", "sine");
    page.settle(&format!("5 * {welded} > 6 * {before}"));
    println!("an edit is in the picture after {:.0?}, the wait for another among it", begun.elapsed());
    page.wait_for_plan(first);
    assert_eq!(page.browser.evaluate("sent.model === weldpath.scene.groups.model"), true, "the page stayed");
    assert_eq!(page.browser.evaluate(camera), stood, "and so does who looks");
    assert_eq!(page.browser.evaluate("weldpath.state.seam").as_u64(), Some(seam));
    // The picture is drawn with the next frame, which a busy machine is late with.
    page.settle("sent.bytes > 0");
    let sent = page.browser.evaluate("sent.bytes").as_u64().unwrap();
    assert!(sent > 0 && sent < 12 * points, "{sent} bytes for {points} points");
    // The way of the torch is that of the files, and the boxes beside the seams are there once.
    let rows = std::fs::read_to_string(page.home.path().join("out/path.csv")).unwrap().lines().count() - 1;
    assert_eq!(page.browser.evaluate(welded).as_u64(), Some(rows as u64));
    let once = "[...document.querySelectorAll('#seams tr[data-seam]')].every((row) => row.querySelectorAll('.tick').length === 1)
        && document.querySelectorAll('#verdict [data-reason=\"tool-not-stated\"]').length === 1";
    assert_eq!(page.browser.evaluate(once), true);
    // Who works by keys stays where he was, though the list is made anew.
    page.browser.evaluate(
        "(() => { document.getElementById('verdict').open = true;
           const box = document.querySelector('#verdict [data-reason=\"tool-not-stated\"]'); box.focus(); box.click(); })()",
    );
    page.settle("document.querySelector('#verdict .accepted')");
    assert_eq!(page.browser.evaluate("document.activeElement.dataset.reason"), "tool-not-stated");
    // Nothing of the lines before stays on the card.
    let kept = "weldpath.scene.renderer.info.memory.geometries";
    // Beside the cloud, once the lines of this plan are drawn.
    page.browser.wait_for(&format!("{kept} > 1"));
    let count = page.browser.evaluate(kept);
    for feed in ["4", "5", "6"] {
        let shown = page.shown();
        page.set("path.feed_mm_s", feed);
        page.wait_for_plan(shown);
    }
    page.settle(&format!("{kept} === {count}"));
    assert!(page.browser.console().is_empty(), "{:?}", page.browser.console());
}

/// `plan --job` makes the files that the page made.
fn the_command_writes_the_same(page: &Page) {
    ends_well(
        weldpath()
            .args(["plan", "--job", "out/job.toml", "--out", "again", "--quiet"])
            .current_dir(page.home.path()),
    );
    for name in [
        "path.csv",
        "path.json",
        "path.script",
        "weldpath.src",
        "weldpath.dat",
        "job.toml",
        "model.ply",
        "report.svg",
    ] {
        let of = |folder: &str| std::fs::read(page.home.path().join(folder).join(name)).unwrap();
        assert!(of("out") == of("again"), "{name} differs");
    }
}

#[test]
fn every_control_has_a_name_every_key_of_the_job_a_field_and_no_text_becomes_markup() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "<img src=x onerror=alert(1)>&amp;");
    assert_eq!(
        page.browser
            .evaluate("document.title.includes('<img src=x') && document.querySelectorAll('img').length"),
        0
    );
    let mut keys = Vec::new();
    for scope in ["scope-seam", "scope-job"] {
        page.browser.evaluate(&format!("document.getElementById({scope:?}).click()"));
        page.settle(&format!("document.getElementById({scope:?}).getAttribute('aria-pressed') === 'true'"));
        let unnamed = page.browser.evaluate(
            "[...document.querySelectorAll('button, input, select')].filter((e) => !e.hidden && !(e.textContent.trim() && e.tagName === 'BUTTON'
               || e.getAttribute('aria-label') || e.closest('label')?.textContent.trim() || (e.id && document.querySelector(`label[for=\"${e.id}\"]`)))).map((e) => e.outerHTML)",
        );
        assert_eq!(unnamed, Value::Array(Vec::new()));
        let own = page
            .browser
            .evaluate("[...document.querySelectorAll('#settings [data-key]')].map((e) => e.dataset.key)");
        keys.push(
            own.as_array().unwrap().iter().map(|key| key.as_str().unwrap().to_owned()).collect::<Vec<_>>(),
        );
    }
    let schema: Value = serde_json::from_str(&weldpath::run::job::Job::schema()).unwrap();
    let of_type = |name: &str| {
        schema["$defs"][name]["properties"].as_object().unwrap().keys().cloned().collect::<Vec<_>>()
    };
    for (table, name, of_seam) in [
        ("path", "PathSettings", true),
        ("torch", "TorchSettings", true),
        ("weave", "WeaveSettings", true),
        ("stitch", "StitchSettings", true),
        ("order", "OrderSettings", false),
        ("arc", "ArcSettings", false),
        ("tool", "ToolSettings", false),
        ("program", "ProgramSettings", false),
        ("torch_body", "TorchBodySettings", false),
    ] {
        for key in of_type(name) {
            let key = format!("{table}.{key}");
            assert!(keys[1].contains(&key), "{key} has no field for the whole job");
            assert!(!of_seam || keys[0].contains(&key), "{key} has no field for a seam");
        }
    }
    // The command that is shown names the folder as it is, and is text.
    let command = page.text("#command pre");
    assert!(command.contains("<img src=x onerror=alert(1)>&amp;"), "{command}");
    assert!(page.browser.console().is_empty(), "{:?}", page.browser.console());
}

#[test]
fn a_box_is_clicked_put_right_by_numbers_and_excluded_and_another_is_typed() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    let seams = page.order().len();
    page.browser.press("b", false);
    for (k, share) in [0.2, 0.8].into_iter().enumerate() {
        let [x, y] = page.beside_the_first_seam(share);
        page.browser.click(x, y);
        page.settle(&format!("document.querySelectorAll('.mark-place').length === {}", k + 1));
    }
    // The sketch is in the picture, and Enter goes on to its numbers.
    let drawn = "(weldpath.scene.groups.solids?.children.length ?? 0)";
    page.settle(&format!("{drawn} === 2"));
    page.browser.press("Enter", false);
    page.settle("document.getElementById('box-exclude') && !document.querySelector('.mark-place')");
    let number = |row: &str, axis: &str| format!("document.querySelector('[aria-label=\"{row}, {axis}\"]')");
    let [low, high] = ["least, mm", "greatest, mm"].map(|row| {
        let field = number(&format!("A box, base frame, {row}"), "z");
        page.browser.evaluate(&format!("Number({field}.value)")).as_f64().unwrap()
    });
    assert!(
        high - low > 3.99,
        "2 mm below the lower of two places, and 2 mm above the other: {low} to {high}"
    );
    page.picture("box");
    page.browser.evaluate("document.getElementById('box-exclude').click()");
    page.settle("document.getElementById('undo').title.includes('exclude a part')");
    let field = number("Excluded box 1, greatest, mm", "z");
    page.browser.evaluate(&format!("(() => {{ const field = {field}; field.focus(); field.value = {high} + 7.25; field.dispatchEvent(new Event('change')); field.blur(); }})()"));
    page.settle("document.getElementById('undo').title.includes('what is excluded')");
    let command = page.text("#command pre");
    assert!(command.contains("boxes_mm") && command.contains(&format!("{}]]]", high + 7.25)), "{command}");
    page.browser.press("z", true);
    page.browser.press("z", true);
    page.settle(&format!("!document.querySelector('[aria-label^=\"Excluded box\"]') && {drawn} === 0"));

    // The box around one seam, typed: it alone is welded, as soon as it is said.
    page.browser.evaluate("(() => {
        const line = weldpath.content.seams[0].line_mm;
        const bound = (pick, by) => [0, 1, 2].map((axis) => pick(...line.map((p) => p[axis])) + by);
        const mm = [...bound(Math.min, -3), ...bound(Math.max, 3)];
        [...document.querySelectorAll('[aria-label^=\"A box\"]')].forEach((field, k) => { field.value = mm[k]; field.dispatchEvent(new Event('change')); });
        document.getElementById('box-roi').click();
    })()");
    page.settle("document.querySelectorAll('#seams tr[data-seam]:not(.off)').length === 1");
    page.browser.evaluate("[...document.querySelectorAll('[data-group=\"regions\"] button')].find((one) => one.textContent.includes('Only seams')).click()");
    page.settle(&format!("document.querySelectorAll('#seams tr[data-seam]:not(.off)').length === {seams}"));
    assert!(page.browser.console().is_empty(), "{:?}", page.browser.console());
}

/// Plans what a search with other settings finds, and takes it back.
#[test]
fn another_search_and_its_undo_come_into_the_same_page_with_the_seam_that_was_selected() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    let all = page.order().len();
    // The one that is farthest from the first, about which none is searched then.
    let last = page.browser.evaluate(
        "(() => {
            const middle = ({ line_mm }) => line_mm[line_mm.length >> 1];
            const [first] = weldpath.content.seams.map(middle);
            const away = (seam) => Math.hypot(...middle(seam).map((v, axis) => v - first[axis]));
            return [...weldpath.content.seams].sort((a, b) => away(b) - away(a))[0].id;
        })()",
    );
    let last = last.as_u64().unwrap();
    page.browser.evaluate(&format!("document.querySelector('#seams tr[data-seam=\"{last}\"]').click()"));
    page.browser.evaluate("(() => { globalThis.isHere = true; weldpath.scene.turn(0.3, 0.1); })()");
    let camera = "weldpath.scene.camera.position.toArray().join()";
    let stood = page.browser.evaluate(camera);
    let line = "weldpath.content.seams.find((seam) => seam.id === weldpath.state.seam).line_mm";
    let middle = |page: &mut Page| {
        let place = page
            .browser
            .evaluate(&format!("(() => {{ const line = {line}; return line[line.length >> 1]; }})()"));
        [0, 1, 2].map(|axis| place[axis].as_f64().unwrap())
    };
    let selected = middle(&mut page);
    page.browser.evaluate(
        "(async () => {
            const line = weldpath.content.seams[0].line_mm;
            const bound = (pick, by) => [0, 1, 2].map((axis) => pick(...line.map((p) => p[axis])) + by);
            const body = { edit: 'exclude', was: null, now: { box: [bound(Math.min, -8), bound(Math.max, 8)] } };
            const answer = await fetch('edit', { method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body) });
            if (!answer.ok) throw new Error(await answer.text());
        })()",
    );
    let cloud = page.browser.evaluate("document.getElementById('editor').dataset.cloud");
    page.plan();
    assert_ne!(
        page.browser.evaluate("document.getElementById('editor').dataset.cloud"),
        cloud,
        "another search"
    );
    let fewer = page.browser.evaluate("document.querySelectorAll('#seams tr[data-seam]').length");
    assert!(fewer.as_u64().unwrap() < all as u64, "{fewer} of {all}");
    assert!(apart_mm(middle(&mut page), selected) < 5.0, "the same seam is selected");
    page.browser.press("z", true);
    page.plan();
    assert_eq!(page.browser.evaluate("globalThis.isHere"), true, "the page was not loaded anew");
    assert_eq!(page.browser.evaluate(camera), stood);
    assert_eq!(
        page.browser.evaluate("document.querySelectorAll('#seams tr[data-seam]').length").as_u64(),
        Some(all as u64)
    );
    assert_eq!(page.browser.evaluate("weldpath.state.seam").as_u64(), Some(last));
    assert!(apart_mm(middle(&mut page), selected) < 5.0);
    // The cloud is that of the plan, and there once.
    let drawn = "weldpath.scene.groups.model.geometry.attributes.position.count === weldpath.content.clouds.model.count
        && weldpath.scene.scene.children.filter((one) => one.isPoints).length === 2";
    assert_eq!(page.browser.evaluate(drawn), true);
    assert!(page.browser.console().is_empty(), "{:?}", page.browser.console());
}

#[test]
fn a_cross_section_is_looked_at_by_keys_and_measured_and_a_joint_type_is_corrected() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    page.browser.press("s", false);
    page.settle("document.activeElement.id === 'section-at' && document.querySelectorAll('svg.section .point').length > 20");
    let words = page.browser.evaluate("document.querySelector('svg.section').getAttribute('aria-label')");
    let words = words.as_str().unwrap().to_owned();
    assert!(words.starts_with("Cross-section of seam ") && words.contains("stated error"), "{words}");
    page.browser.evaluate("(() => { const at = document.getElementById('section-at'); at.value = 10; at.dispatchEvent(new Event('input')); })()");
    page.settle("document.querySelector('output[for=section-at]').textContent.startsWith('9.') || document.querySelector('output[for=section-at]').textContent.startsWith('10.') || document.querySelector('output[for=section-at]').textContent.startsWith('11.')");
    // A place on either side of the root: 0.4 of the width of 50 mm apart, to the right.
    let places = page.browser.evaluate(
        "(() => {
        const picture = document.querySelector('svg.section');
        picture.scrollIntoView({ block: 'center' });
        const box = picture.getBoundingClientRect();
        return [box.left + 0.3 * box.width, box.left + 0.7 * box.width, box.top + 0.5 * box.height];
    })()",
    );
    let [left, right, y] = [0, 1, 2].map(|k| places[k].as_f64().unwrap());
    page.browser.click(left, y);
    page.browser.click(right, y);
    page.settle("document.querySelectorAll('svg.section .measure').length === 3");
    let said = page.text("[data-group='section'] [role='status']");
    let mm: f64 = said.split(' ').next().unwrap().parse().unwrap();
    assert!((mm - 20.4).abs() < 0.6 && said.contains("0.00 out of the work"), "{said}");
    page.picture("section");

    // The measured distance of two places of the cloud: 0.6 of the seam's length.
    let length = page.browser.evaluate("weldpath.content.summary.seams[0].length_mm").as_f64().unwrap();
    page.browser.press("m", false);
    for share in [0.3, 0.9] {
        let [x, y] = page.beside_the_first_seam(share);
        page.browser.click(x, y);
    }
    page.settle("document.getElementById('said').textContent.includes('between the two places')");
    let said = page.text("#said");
    let mm: f64 = said.split(' ').next().unwrap().parse().unwrap();
    assert!((mm - 0.6 * length).abs() < 5.0, "{said} of {length}");

    // The type of all joints of a kind has settings of its own, which hold for the seam that is said to be one.
    page.browser.evaluate("(() => { const type = document.getElementById('set-joint'); type.value = 'lap'; type.dispatchEvent(new Event('change')); })()");
    page.settle("document.getElementById('scope-joint').textContent === 'All of type lap'");
    page.browser.evaluate("document.getElementById('scope-joint').click()");
    page.settle("document.getElementById('scope-joint').getAttribute('aria-pressed') === 'true'");
    page.set("torch.work_angle_deg", "12");
    page.settle("document.getElementById('undo').title.includes('joint.lap.torch.work_angle_deg')");
    page.browser.evaluate("document.getElementById('scope-seam').click()");
    page.settle(
        "document.querySelector('#settings [data-key=\"torch.work_angle_deg\"]').placeholder === '12'",
    );
    page.settle("document.querySelector('#seams tr[aria-selected=\"true\"]').textContent.includes('lap')");
    assert!(page.browser.console().is_empty(), "{:?}", page.browser.console());
}

/// Places of the window on both faces of the first seam, 12 mm beside its middle, with what the page shows by now.
const ON_FACES: &str = "(async () => {
    const { scene, content } = weldpath;
    const Vector = scene.camera.position.constructor;
    const seam = { ...content.summary.seams[0], ...content.seams[0] };
    const section = await (await fetch(`section?seam=${seam.id}&at_mm=${0.5 * seam.length_mm}`)).json();
    const along = new Vector(...section.tangent);
    const out = scene.anchor(seam).sub(new Vector(...seam.line_mm[seam.line_mm.length >> 1]));
    out.addScaledVector(along, -along.dot(out)).normalize();
    const right = along.clone().cross(out);
    document.getElementById('canvas').scrollIntoView({ block: 'center' });
    scene.look('home');
    scene.camera.updateMatrixWorld();
    const box = document.getElementById('canvas').getBoundingClientRect();
    return section.faces.map(([o, n]) => {
        const place = new Vector(...section.root_mm).addScaledVector(right, 12 * o).addScaledVector(out, 12 * n);
        const { x, y } = scene.project(place);
        return [box.left + x, box.top + y];
    });
})()";

#[test]
fn the_seam_between_two_faces_that_are_clicked_is_asked_for_from_end_to_end() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    // The picture has its size when the lists beside it are filled.
    page.settle("document.getElementById('set-joint') && weldpath.scene.height === document.getElementById('canvas').clientHeight");
    let line = page.browser.evaluate("weldpath.content.seams[0].line_mm");
    let places = page.browser.evaluate(ON_FACES);
    page.browser.press("e", false);
    for k in 0..2 {
        let [x, y] = [0, 1].map(|axis| places[k][axis].as_f64().unwrap());
        page.browser.click(x, y);
    }
    page.settle("document.getElementById('undo').title.includes('add a seam')");
    page.browser.press("j", false);
    page.settle("document.querySelector('#command pre')?.textContent.includes('between_mm')");
    let command = page.text("#command pre");
    let job = command.split("'END_OF_JOB'\n").nth(1).unwrap().split("END_OF_JOB").next().unwrap();
    let job = weldpath::run::job::Job::parse(job, Path::new("job.toml")).unwrap();
    let asked = job.asks[0].places_mm();
    let place = |k: usize| [0, 1, 2].map(|axis| line[k][axis].as_f64().unwrap());
    let ends = [place(0), place(line.as_array().unwrap().len() - 1)];
    let away_mm = |end: [f64; 3]| asked.iter().map(|p| apart_mm((*p).into(), end)).fold(f64::MAX, f64::min);
    assert!(ends.iter().all(|end| away_mm(*end) < 6.0), "{asked:?} for {ends:?}");

    // One face has no edge with itself.
    page.browser.press("e", false);
    for _ in 0..2 {
        let [x, y] = [0, 1].map(|axis| places[0][axis].as_f64().unwrap());
        page.browser.click(x, y);
    }
    page.settle("document.getElementById('said').textContent.includes('do not meet in a straight edge')");
    assert!(page.browser.console().is_empty(), "{:?}", page.browser.console());
}

#[test]
fn without_an_input_a_page_asks_for_a_folder_and_simulates_an_example() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::visit(&chromium, tempfile::tempdir().unwrap(), &[]);
    page.settle("document.activeElement.id === 'input'");
    let unnamed = page.browser.evaluate(
        "[...document.querySelectorAll('#start input')].filter((one) => !document.querySelector(`label[for=\"${one.id}\"]`).textContent).length",
    );
    assert_eq!(unnamed, 0);
    page.picture("start");
    page.browser.evaluate("(() => { document.getElementById('input').value = 'no<b>where'; document.getElementById('open').click(); })()");
    page.settle("document.querySelector('#start .refusal:not([hidden])')");
    let refusal = page.text("#start .refusal");
    assert!(refusal.contains("cannot read no<b>where"), "{refusal}");
    page.browser.evaluate("document.getElementById('example').click()");
    page.wait_for_plan(0);
    assert!(page.home.path().join("weldpath-example/truth.json").is_file() && page.order().len() > 3);
}

#[test]
fn a_seam_is_asked_for_by_clicks_and_the_page_says_what_is_there() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    let seams = page.order().len();
    page.browser.press("a", false);
    page.settle("document.getElementById('ask').getAttribute('aria-pressed') === 'true'");
    for (k, share) in [0.2, 0.8].into_iter().enumerate() {
        let [x, y] = page.beside_the_first_seam(share);
        page.browser.click(x, y);
        page.settle(&format!("document.querySelectorAll('.mark-place').length === {}", k + 1));
    }
    page.picture("asking");
    page.browser.press("Enter", false);
    page.settle("document.getElementById('undo').title.includes('add a seam')");
    page.plan();
    assert_eq!(page.order().len(), seams, "the seam is there anyway");
    let said = [page.text("#verdict"), page.text("#warnings")].join("\n");
    assert!(said.contains("is found without asking"), "{said}");
    // It is listed, taken back, and back again.
    page.browser.press("j", false);
    page.settle("document.querySelector('[data-unask=\"0\"]')");
    page.browser.evaluate("document.querySelector('[data-unask=\"0\"]').click()");
    page.settle("!document.querySelector('[data-unask]')");
    page.browser.press("z", true);
    page.settle("document.querySelector('[data-unask=\"0\"]')");
    // What is under the cross is taken by the space bar; Escape gives up.
    page.browser.press("a", false);
    page.browser.press(" ", false);
    page.settle("document.querySelectorAll('.mark-place').length === 1");
    page.browser.press("Escape", false);
    page.settle("document.querySelectorAll('.mark-place').length === 0");
}

#[test]
fn a_seam_is_drawn_on_the_plate_and_the_command_makes_the_same_of_it() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    let seams = page.order().len();
    page.browser.evaluate("document.getElementById('draw').click()");
    page.settle("document.getElementById('draw').getAttribute('aria-pressed') === 'true'");
    page.look_from_above();
    // Amid the pocket beside the first seam, where nothing is to be found.
    let places = page.browser.evaluate(
        "(() => {
           const { scene, content } = weldpath;
           const Vector = scene.camera.position.constructor;
           const box = document.getElementById('canvas').getBoundingClientRect();
           const seam = content.seams[0];
           const [first, last] = [seam.line_mm[0], seam.line_mm[seam.line_mm.length - 1]].map((p) => new Vector(...p));
           const middle = first.clone().lerp(last, 0.5);
           const out = scene.anchor({ ...content.summary.seams[0], ...seam }).sub(middle).setZ(0).setLength(35);
           return [0.3, 0.5, 0.7].map((share) => {
             const { x, y } = scene.project(first.clone().lerp(last, share).add(out));
             return [box.left + x, box.top + y];
           });
         })()",
    );
    for k in 0..3 {
        let [x, y] = [0, 1].map(|axis| places[k][axis].as_f64().unwrap());
        page.browser.click(x, y);
        page.settle(&format!("document.querySelectorAll('.mark-place').length === {}", k + 1));
    }
    page.browser.press("Enter", false);
    page.settle("document.getElementById('undo').title.includes('draw a seam')");
    page.plan();
    assert_eq!(page.order().len(), seams + 1, "{}", page.text("#verdict"));
    page.picture("drawn");
    let verdict = page.text("#verdict");
    assert!(verdict.contains("was drawn by hand"), "{verdict}");
    let confirmed = "document.querySelector('#verdict [data-reason=\"drawn\"]')";
    assert_eq!(page.browser.evaluate(confirmed), Value::Null, "nobody confirms it beforehand");
    page.set("path.feed_mm_s", "4");
    page.settle("document.getElementById('undo').title.includes('path.feed_mm_s')");
    page.browser.press("j", false);
    page.browser.evaluate("document.querySelector('#settings [data-key=\"formats.kuka\"]').click()");
    page.settle("document.querySelector('#undo').title.includes('formats')");
    page.plan();
    the_command_writes_the_same(&page);
    page.browser.evaluate("document.querySelector('[data-undraw=\"0\"]').click()");
    page.settle("!document.querySelector('[data-undraw]')");
    page.plan();
    assert_eq!(page.order().len(), seams);
    assert!(page.browser.console().is_empty(), "{:?}", page.browser.console());
}

/// Sizes of windows, px, and the least share of each that is the picture's.
const WORKBENCHES: [((u32, u32), f64); 4] =
    [((1400, 900), 0.5), ((1920, 1080), 0.55), ((1024, 700), 0.38), ((390, 844), 0.2)];

/// Whether what is chosen above the picture stands in one line, with nothing on another or beyond the picture.
const IN_ONE_LINE: &str = "(() => {
    const [tools, looks] = ['#tools > *', '#looks > *'].map((all) => [...document.querySelectorAll(all)].map((one) => one.getBoundingClientRect()));
    const line = (all) => all.every(({ top, height }) => Math.abs(top + height / 2 - all[0].top - all[0].height / 2) < 4);
    const boxes = [...tools, ...looks];
    const apart = (a, b) => a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top;
    const { left, right } = document.getElementById('view').getBoundingClientRect();
    return tools.length === 3 && looks.length === 4 && line(tools) && line(looks)
      && boxes.every((a, k) => a.left >= left && a.right <= right && boxes.slice(k + 1).every((b) => apart(a, b)));
})()";

#[test]
fn the_picture_fills_the_window_and_nothing_is_beyond_it() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    for ((width, height), least) in WORKBENCHES {
        page.browser.resize(width, height);
        page.browser.wait_until_drawn();
        let found = page.browser.evaluate(
            "(() => {
            const box = (id) => document.getElementById(id).getBoundingClientRect();
            const [canvas, seams, more] = ['canvas', 'seams', 'more'].map(box);
            const cut = [...document.querySelectorAll('#seams th, #seams tr:first-child td')].map((cell) => cell.getBoundingClientRect().right - innerWidth);
            const { scrollWidth, scrollHeight } = document.documentElement;
            return [canvas.width * canvas.height / (innerWidth * innerHeight), scrollWidth - innerWidth, scrollHeight - innerHeight, Math.max(...cut),
              canvas.top, more.bottom - innerHeight, document.getElementById('seams').scrollWidth - seams.width];
        })()",
        );
        let number = |k: usize| found[k].as_f64().unwrap();
        assert!(number(0) >= least, "{width} px: the picture has {:.2} of the window", number(0));
        assert!(
            (1..4).all(|k| number(k) <= 0.0) && number(5) <= 0.0 && number(6) <= 1.0,
            "{width} px: {found}"
        );
        assert_eq!(page.browser.evaluate(IN_ONE_LINE), true, "{width} px: the choices above the picture");
        // One bar stands above it; on a phone its buttons have a row of their own.
        assert!(number(4) < 0.12 * f64::from(height), "{width} px: {} px above the picture", number(4));
    }
}

/// What stands below the field of a setting.
fn beside(page: &mut Page, key: &str, part: &str) -> String {
    page.text(&format!("#settings [data-key='{key}'] ~ {part}"))
}

#[test]
fn numbers_are_read_as_people_write_them_and_a_slip_of_the_point_is_marked() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    for (typed, read) in [("6,5", "6.5"), ("6.75", "6.75"), (" 7 ", "7")] {
        page.set("path.feed_mm_s", typed);
        page.settle(&format!("document.querySelector('#settings [data-key=\"path.feed_mm_s\"] ~ .about').textContent.startsWith('{read} mm/s (')"));
        let value =
            page.browser.evaluate("document.querySelector('#settings [data-key=\"path.feed_mm_s\"]').value");
        assert_eq!(value, read);
        page.settle("document.querySelector('#settings .slip:not([hidden])') === null");
    }
    for (typed, words) in [
        ("1,500", "\"1,500\" can be 1.5 or 1500: write one of them"),
        ("1.500,0", "\"1.500,0\" is no number"),
        ("fast", "\"fast\" is no number"),
    ] {
        page.set("path.feed_mm_s", typed);
        page.settle("document.querySelector('#settings [data-key=\"path.feed_mm_s\"]').getAttribute('aria-invalid') === 'true'");
        let refusal = beside(&mut page, "path.feed_mm_s", ".refusal");
        assert!(refusal.starts_with(words), "{refusal}");
        page.set("path.feed_mm_s", "7");
        page.settle("document.querySelector('#settings [data-key=\"path.feed_mm_s\"]').getAttribute('aria-invalid') === 'false'");
    }
    page.set("path.feed_mm_s", "70");
    page.settle("document.querySelector('#settings [data-key=\"path.feed_mm_s\"] ~ .slip:not([hidden])')");
    let slip = beside(&mut page, "path.feed_mm_s", ".slip");
    assert!(slip.starts_with("7 → 70 mm/s"), "{slip}");
    page.browser
        .evaluate("document.querySelector('#settings [data-key=\"path.feed_mm_s\"] ~ .slip button').click()");
    page.settle("document.querySelector('#settings [data-key=\"path.feed_mm_s\"]').placeholder === '7' || document.querySelector('#settings [data-key=\"path.feed_mm_s\"]').value === '7'");
}

#[test]
fn a_reason_leads_to_its_setting_and_the_files_are_saved_one_by_one_and_together() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    let lead = "[...document.querySelectorAll('#reasons li')].find((one) => one.querySelector('code').textContent === 'tool-not-stated').querySelector('.lead')";
    page.browser.evaluate(&format!(
        "(() => {{ document.getElementById('verdict').open = true; {lead}.click(); }})()"
    ));
    page.settle("document.querySelector('#settings [data-group=\"tool\"]').open && document.activeElement.closest('[data-group]').dataset.group === 'tool'");
    // The archive is what the folder holds, file by file.
    page.browser.evaluate(
        "(() => { globalThis.saved = null; URL.createObjectURL = (blob) => { blob.arrayBuffer().then((bytes) => { saved = new Uint8Array(bytes); }); return '#'; };
           document.getElementById('zip').click(); })()",
    );
    page.settle("saved");
    let text = "String.fromCharCode(...saved.slice(0, 4))";
    assert_eq!(page.browser.evaluate(text), "PK\u{3}\u{4}");
    let names =
        page.browser.evaluate("[...document.querySelectorAll('#files a')].map((link) => link.download)");
    let names: Vec<&str> = names.as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    for name in ["path.csv", "path.json", "path.script", "job.toml", "report.html", "summary.json"] {
        assert!(names.contains(&name), "{names:?}");
        let held = page.browser.evaluate(&format!(
            "(async () => {{
               const bytes = new Uint8Array(await (await fetch('file?name={name}')).arrayBuffer());
               const held = new TextDecoder('latin1').decode(saved).includes({name:?});
               return [bytes.length, held];
             }})()"
        ));
        let on_disk = std::fs::metadata(page.home.path().join("out").join(name)).unwrap().len();
        assert_eq!((held[0].as_u64(), held[1].as_bool()), (Some(on_disk), Some(true)), "{name}");
    }
}
