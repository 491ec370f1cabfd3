//! The pictures of the page in docs/guide.md: made here of a scan, and held against what the guide names.
//!
//! With `WELDPATH_WRITE_PICTURES` set they are written anew. Pixels are not compared: fonts and browsers differ.

use std::fs;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use weldpath_tests::browser::{self, Browser};
use weldpath_tests::page::Page;

const MOST_BYTES: usize = 100_000;
const MOST_PICTURES: usize = 5;
/// Of the window, px.
const SIZE: (u32, u32) = (1280, 760);
/// A picture of which so much has one colour shows nothing.
const UNIFORM: f64 = 0.8;

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("docs")
}

/// Width and height of a picture, px, and the share of its commonest colour, told by a browser.
fn looked_at(browser: &mut Browser, webp: &[u8]) -> (u32, u32, f64) {
    let found = browser.evaluate(&format!(
        "(async () => {{
           const bytes = Uint8Array.from(atob('{}'), (c) => c.charCodeAt(0));
           const picture = await createImageBitmap(new Blob([bytes], {{ type: 'image/webp' }}));
           const canvas = new OffscreenCanvas(picture.width, picture.height);
           const context = canvas.getContext('2d');
           context.drawImage(picture, 0, 0);
           const counts = new Map();
           const {{ data }} = context.getImageData(0, 0, picture.width, picture.height);
           // Colours alike in their upper five bits are one.
           for (let k = 0; k < data.length; k += 4) {{
             const colour = (data[k] >> 3) << 10 | (data[k + 1] >> 3) << 5 | data[k + 2] >> 3;
             counts.set(colour, (counts.get(colour) ?? 0) + 1);
           }}
           return [picture.width, picture.height, Math.max(...counts.values()) / (data.length / 4)];
         }})()",
        STANDARD.encode(webp)
    ));
    let number = |k: usize| found[k].as_f64().unwrap();
    (number(0) as u32, number(1) as u32, number(2))
}

/// Names of the pictures of the page that the guide shows, in its order.
fn named() -> Vec<String> {
    let guide = fs::read_to_string(docs().join("guide.md")).unwrap();
    let names = guide.split("](pictures/").skip(1).map(|rest| rest.split(')').next().unwrap().to_owned());
    names.filter(|name| name.starts_with("open-")).collect()
}

fn scroll_to(page: &mut Page, selector: &str, block: &str) {
    page.browser.evaluate(&format!(
        "document.querySelector({selector:?}).scrollIntoView({{ block: {block:?}, behavior: 'instant' }})"
    ));
}

/// The page as it is, once all is drawn that followed from the last click.
fn photograph(page: &mut Page) -> Vec<u8> {
    page.browser.wait_until_drawn();
    page.browser.photograph()
}

/// The README's cell, with its tool.
fn open(chromium: &Path) -> Page {
    let home = tempfile::tempdir().unwrap();
    let fixtures = docs().parent().unwrap().join("fixtures");
    let job = fs::read_to_string(fixtures.join("cell.toml")).unwrap();
    fs::write(home.path().join("cell.toml"), format!("input = {:?}\n{job}", fixtures.join("cell"))).unwrap();
    let mut page = Page::visit(chromium, home, &["cell.toml"]);
    page.wait_for_plan(0);
    page.browser.resize(SIZE.0, SIZE.1);
    page.browser.evaluate("document.documentElement.dataset.theme = 'light'");
    page
}

/// As it opens.
fn whole(_: &mut Page) {}

fn weave(page: &mut Page) {
    page.set("weave.shape", "zigzag");
    page.set("weave.amplitude_mm", "4");
    page.settle("document.querySelector('#undo').title.includes('weave.amplitude_mm')");
    page.wait_for_plan(1);
    page.browser.evaluate(
        "(() => { document.querySelector('[data-group=\"path\"]').open = false; document.querySelector('[data-group=\"weave\"]').open = true;
           document.querySelector('.detail button').click(); })()",
    );
}

fn section(page: &mut Page) {
    page.browser.press("s", false);
    page.settle("document.querySelector('svg.section .torch')");
    page.browser.evaluate("document.querySelector('[data-group=\"weave\"]').open = false");
    scroll_to(page, "[data-group='section']", "center");
}

fn ask(page: &mut Page) {
    page.browser.evaluate("document.querySelector('[data-group=\"section\"]').open = false");
    page.browser.press("a", false);
    for (k, share) in [0.2, 0.8].into_iter().enumerate() {
        let [x, y] = page.beside_the_first_seam(share);
        page.browser.click(x, y);
        page.settle(&format!("document.querySelectorAll('.mark-place').length === {}", k + 1));
    }
}

fn robot(page: &mut Page) {
    page.browser.press("Escape", false);
    page.browser.evaluate("document.getElementById('scope-job').click()");
    page.settle("document.querySelector('[data-key=\"robot.model\"]')");
    let before = page.shown();
    page.set("robot.model", "ur10e");
    page.wait_for_plan(before);
    page.browser.evaluate(
        "(() => { const slider = document.getElementById('slider'); slider.value = 0.4 * slider.max; slider.dispatchEvent(new Event('input'));
           weldpath.scene.look('home'); weldpath.scene.nearer(1.4); })()",
    );
    assert_eq!(page.browser.evaluate("weldpath.scene.arm.visible"), true, "the piece is within reach");
    assert_eq!(page.browser.evaluate("document.getElementById('show-arm').closest('label').hidden"), false);
}

/// A picture's name, and what is done on the page before it is taken.
type State = (&'static str, fn(&mut Page));

/// The states of the page that the guide tells of, one after the other.
const STATES: [State; 5] = [
    ("open-page.webp", whole),
    ("open-weave.webp", weave),
    ("open-section.webp", section),
    ("open-ask.webp", ask),
    ("open-robot.webp", robot),
];

#[test]
fn the_guide_shows_pictures_of_the_page_as_it_is() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = open(&chromium);
    let made = STATES.map(|(name, prepare)| {
        prepare(&mut page);
        (name, photograph(&mut page))
    });
    let folder = docs().join("pictures");
    let mut names: Vec<&str> = made.iter().map(|(name, _)| *name).collect();
    if std::env::var_os("WELDPATH_WRITE_PICTURES").is_some() {
        made.iter().for_each(|(name, webp)| fs::write(folder.join(name), webp).unwrap());
    }
    let mut shown = named();
    shown.sort();
    names.sort_unstable();
    assert_eq!(shown, names, "what the guide names, and what is made here");
    let files = fs::read_dir(&folder).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap());
    let mut kept: Vec<String> = files.filter(|name| !name.ends_with(".svg")).collect();
    kept.sort();
    assert_eq!(kept, names, "a picture that nothing shows");
    assert!(made.len() <= MOST_PICTURES);
    let mut browser = Browser::open(&chromium, "<!doctype html><title>pictures</title>");
    for (name, webp) in &made {
        let kept = fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(kept.len() <= MOST_BYTES, "{name} has {} bytes", kept.len());
        for (what, bytes) in [("made", webp), ("kept", &kept)] {
            let (width, height, share) = looked_at(&mut browser, bytes);
            assert_eq!((width, height), SIZE, "{name}, {what}");
            assert!(share < UNIFORM, "{name}, {what}: {share:.2} of it is one colour");
        }
    }
}

#[test]
fn a_picture_that_shows_nothing_is_found() {
    let Some(chromium) = browser::chromium() else { return };
    let mut browser = Browser::open(&chromium, "<!doctype html><title>nothing</title>");
    browser.resize(300, 200);
    let nothing = browser.photograph();
    let (width, height, share) = looked_at(&mut browser, &nothing);
    assert!((width, height) == (300, 200) && share > UNIFORM, "{share}");
}
