//! Every page of weldpath under axe-core: no violation of what it can tell, light and dark, wide and on a phone.

use std::fs;
use std::path::Path;

use serde_json::Value;
use weldpath_tests::browser::{self, Browser};
use weldpath_tests::command::plan_the_cell;
use weldpath_tests::page::Page;

const AXE: &str = include_str!("../../fixtures/axe-core/axe.min.js");
/// Sizes of the window, px.
const WINDOWS: [(u32, u32); 2] = [(1440, 900), (390, 844)];

/// What is wrong with the page as it is shown, one line each: rule, element, and why.
fn violations(browser: &mut Browser) -> Vec<String> {
    let found = browser.evaluate(
        "axe.run(document, { resultTypes: ['violations'] }).then(({ violations, passes }) => [passes.length, ...violations.flatMap(({ id, nodes }) =>
           nodes.map(({ target, failureSummary }) => `${id}: ${target.join(' ')}: ${failureSummary.replaceAll(/\\s+/g, ' ')}`))])",
    );
    let found = found.as_array().expect("an answer");
    assert!(found[0].as_u64().is_some_and(|passed| passed >= 10), "it looked at nothing: {found:?}");
    found[1..].iter().map(|line| line.as_str().unwrap_or_default().to_owned()).collect()
}

/// Looks at a page in each theme and size, as `prepare` leaves it.
fn look(browser: &mut Browser, page: &str, prepare: impl Fn(&mut Browser)) -> Vec<String> {
    browser.evaluate(&format!("{AXE}; true"));
    let mut wrong = Vec::new();
    for theme in ["light", "dark"] {
        for (width, height) in WINDOWS {
            browser.resize(width, height);
            browser.evaluate(&format!("document.documentElement.dataset.theme = {theme:?}"));
            prepare(browser);
            let found = violations(browser);
            println!("{page}, {theme}, {width} px: {} violations", found.len());
            wrong.extend(found.into_iter().map(|line| format!("{page}, {theme}, {width} px: {line}")));
        }
    }
    wrong
}

/// Opens whatever is folded.
fn unfold(browser: &mut Browser) {
    browser.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })");
}

fn is_clean(wrong: &[String]) {
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_page_that_edits_has_no_violation_whatever_is_open_in_it() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    let mut wrong = Vec::new();
    for scope in ["scope-seam", "scope-joint", "scope-job"] {
        page.browser.evaluate(&format!("document.getElementById({scope:?}).click()"));
        page.settle(&format!("document.getElementById({scope:?}).getAttribute('aria-pressed') === 'true'"));
        wrong.extend(look(&mut page.browser, scope, unfold));
    }
    // Amid an action: places are marked, a box is sketched, a value is refused.
    page.browser.resize(1440, 900);
    page.set("weave.amplitude_mm", "99");
    page.settle("document.querySelector('#settings .refusal:not([hidden])')");
    page.browser.press("b", false);
    for (k, share) in [0.2, 0.8].into_iter().enumerate() {
        let [x, y] = page.beside_the_first_seam(share);
        page.browser.click(x, y);
        page.settle(&format!("document.querySelectorAll('.mark-place').length === {}", k + 1));
    }
    wrong.extend(look(&mut page.browser, "amid a box", |_| {}));
    is_clean(&wrong);
}

fn report_of_the_cell(chromium: &Path) -> Browser {
    let home = tempfile::tempdir().unwrap();
    plan_the_cell(home.path());
    let page = fs::read_to_string(home.path().join("out/report.html")).unwrap();
    let mut browser = Browser::open(chromium, &page);
    browser.wait_for("document.querySelector('#seams tr[data-seam]')");
    browser
}

#[test]
fn the_report_has_no_violation() {
    let Some(chromium) = browser::chromium() else { return };
    let mut browser = report_of_the_cell(&chromium);
    is_clean(&look(&mut browser, "report", unfold));
}

#[test]
fn the_start_page_and_the_page_that_waits_have_no_violation() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::visit(&chromium, tempfile::tempdir().unwrap(), &[]);
    page.settle("document.activeElement.id === 'input'");
    page.browser.evaluate("(() => { document.getElementById('input').value = 'nowhere'; document.getElementById('open').click(); })()");
    page.settle("document.querySelector('#start .refusal:not([hidden])')");
    let mut wrong = look(&mut page.browser, "start", |_| {});
    // Nothing to weld: a page without a report, which says why.
    let home = tempfile::tempdir().unwrap();
    let plate = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures/plate");
    let mut page = Page::visit(&chromium, home, &[plate.to_str().unwrap()]);
    page.settle(
        "document.getElementById('failed')?.textContent || document.getElementById('title')?.textContent",
    );
    wrong.extend(look(&mut page.browser, "nothing to weld", |_| {}));
    is_clean(&wrong);
}

/// Puts all that can be worked in the order in which it stands, each once, behind `place`; how many there are.
const CONTROLS: &str = "(() => {
    document.activeElement.blur();
    const all = [...document.querySelectorAll('button, input, select, summary, a[href], [tabindex=\"0\"]')].filter((one) => !one.disabled
        && one.checkVisibility({ visibilityProperty: true }) && !one.closest('.labels')
        && [...document.querySelectorAll('details:not([open])')].every((box) => !box.contains(one) || one === box.querySelector('summary')));
    all.forEach((one, k) => { one.dataset.place = k; });
    return all.length;
})()";

/// Presses Tab from the page's beginning: all that can be worked is reached in its order, and nothing holds the focus.
fn tab_through(browser: &mut Browser, what: &str) {
    let count = browser.evaluate(CONTROLS).as_u64().unwrap();
    assert!(count > 10, "{what}: {count} controls");
    let mut reached: Vec<u64> = Vec::new();
    // Labels in the picture come between, and places that scroll.
    for _ in 0..count + 60 {
        browser.strike("Tab");
        let place = browser.evaluate("document.activeElement.dataset.place ?? null");
        if let Some(place) = place.as_str() {
            let place: u64 = place.parse().unwrap();
            if reached.first() == Some(&place) {
                break;
            }
            reached.push(place);
        }
    }
    let names = browser.evaluate("[...document.querySelectorAll('[data-place]')].map((one) => one.id || one.textContent.trim() || one.ariaLabel)");
    let missed: Vec<&Value> =
        (0..count).filter(|k| !reached.contains(k)).map(|k| &names[k as usize]).collect();
    assert!(missed.is_empty(), "{what}: Tab does not reach {missed:?}");
    // It begins where the focus was before.
    let first = reached.iter().position(|&place| place == 0).unwrap_or(0);
    reached.rotate_left(first);
    assert!(reached.is_sorted(), "{what}: {reached:?} of {names}");
    browser.evaluate(
        "document.querySelectorAll('[data-place]').forEach((one) => { delete one.dataset.place; })",
    );
}

/// Opens what unfolds by Enter, and closes it by Escape from inside: the focus is where it was.
fn unfolds(browser: &mut Browser, opener: &str, is_open: &str) {
    browser.evaluate(&format!("document.querySelector({opener:?}).focus()"));
    assert_eq!(browser.evaluate(is_open), false, "{opener}");
    browser.strike("Enter");
    browser.wait_for(is_open);
    browser.strike("Tab");
    browser.strike("Escape");
    browser
        .wait_for(&format!("!({is_open}) && document.activeElement === document.querySelector({opener:?})"));
}

/// The bar, the menus, the drawer and, on a phone, the sheet, by keys alone.
fn works_by_keys(browser: &mut Browser, what: &str) {
    for (width, height) in [WINDOWS[0], (1024, 700), WINDOWS[1]] {
        browser.resize(width, height);
        tab_through(browser, &format!("{what}, {width} px"));
        unfolds(browser, "#more", "!document.getElementById('drawer').hidden");
        unfolds(browser, "#verdict-line", "document.getElementById('verdict').open");
        unfolds(browser, "#shown summary", "document.getElementById('shown').open");
    }
    // Who opens the drawer is in it, and its button to close it is the first that Tab reaches.
    browser.evaluate("document.getElementById('more').focus()");
    browser.strike("Enter");
    browser.wait_for("document.activeElement.id === 'drawer' && document.activeElement.role === 'dialog' && document.activeElement.ariaLabel");
    assert_eq!(browser.evaluate("document.getElementById('more').ariaExpanded"), "true");
    browser.strike("Tab");
    assert_eq!(browser.evaluate("document.activeElement.id"), "close");
    browser.strike("Enter");
    browser
        .wait_for("document.activeElement.id === 'more' && document.activeElement.ariaExpanded === 'false'");
    // A box in a menu is ticked by the space bar, which is the player's elsewhere.
    browser.evaluate("(() => { document.getElementById('shown').open = true; document.getElementById('show-way').focus(); })()");
    let shown = browser.evaluate("document.getElementById('show-way').checked");
    browser.strike(" ");
    browser.wait_for(&format!(
        "document.getElementById('show-way').checked !== {shown} && !weldpath.state.playing"
    ));
    browser.strike("Escape");
    // The sheet of a phone; on a desk the list stays.
    let folded = "document.getElementById('panel').classList.contains('folded')";
    browser.evaluate("document.querySelector('#seams tbody button').focus()");
    browser.strike("Escape");
    browser.wait_for(&format!(
        "{folded} && document.activeElement.id === 'sheet' && document.activeElement.ariaExpanded === 'false'"
    ));
    browser.strike("Enter");
    browser.wait_for(&format!("!{folded} && document.activeElement.ariaExpanded === 'true'"));
    browser.resize(1440, 900);
    browser.evaluate("document.querySelector('#seams tbody button').focus()");
    browser.strike("Escape");
    assert_eq!(browser.evaluate(folded), false, "{what}: a list that is no sheet");
}

#[test]
fn the_report_works_by_keys_alone() {
    let Some(chromium) = browser::chromium() else { return };
    let mut browser = report_of_the_cell(&chromium);
    works_by_keys(&mut browser, "report");
    // What was seen from one side says so in the list, with the view to add below it.
    assert_eq!(browser.evaluate("document.querySelector('#seams .one-side').textContent"), "one side seen");
    let note = browser.evaluate("document.querySelector('#detail .note-of-seam').textContent");
    assert!(note.as_str().is_some_and(|note| note.contains("with the camera near (")), "{note}");
    assert_eq!(browser.evaluate("document.getElementById('assumed').hidden"), true, "nothing is assumed");
}

#[test]
fn the_page_that_edits_works_by_keys_alone() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open(&chromium, "scan");
    works_by_keys(&mut page.browser, "page");
    unfolds(&mut page.browser, "#files summary", "document.getElementById('files').open");
    for key in ["established_input", "strike_s", "stickout_mm"] {
        page.browser.evaluate("document.getElementById('scope-job').click()");
        page.settle(&format!("document.querySelector('#settings [data-key$=\".{key}\"]')"));
        let about = page.browser.evaluate(&format!(
            "(() => {{ const field = document.querySelector('#settings [data-key$=\".{key}\"]'); return [field.title, document.querySelector(`label[for=\"${{field.id}}\"]`).title]; }})()"
        ));
        assert!(
            about[0].as_str().is_some_and(|words| words.len() > 20) && about[0] == about[1],
            "{key}: {about}"
        );
    }
}

#[test]
fn what_is_wrong_is_found() {
    let Some(chromium) = browser::chromium() else { return };
    let page = "<!doctype html><html lang=en><title>a</title><main><h1>a</h1><p style='color: #aaa; background: #fff'>faint</p><input></main>";
    let mut browser = Browser::open(&chromium, page);
    browser.evaluate(&format!("{AXE}; true"));
    let rules =
        browser.evaluate("axe.run(document).then(({ violations }) => violations.map(({ id }) => id))");
    assert_eq!(rules, Value::from(vec!["color-contrast", "label"]));
}
