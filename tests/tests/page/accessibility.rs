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

#[test]
fn the_report_has_no_violation() {
    let Some(chromium) = browser::chromium() else { return };
    let home = tempfile::tempdir().unwrap();
    plan_the_cell(home.path());
    let page = fs::read_to_string(home.path().join("out/report.html")).unwrap();
    let mut browser = Browser::open(&chromium, &page);
    browser.wait_for("document.querySelector('#seams tr[data-seam]')");
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
