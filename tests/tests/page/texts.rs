//! All texts of the page are in `host/src/report/web/src/texts.js`: with another language set there, no English is left on
//! the page. The language is made up: English with an accent on every letter.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use weldpath_tests::browser::{self, Browser};
use weldpath_tests::command::{ends_well, plan_the_cell, weldpath};
use weldpath_tests::page::Page;

fn web() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("host/src/report/web")
}

/// Every text of `texts.js` in a language that is English with accents; what is put into a text stays as it is.
const LANGUAGE: &str = "
    const accented = (text) => text.replace(/[a-z]/gi, (c) => c + '\\u0301');
    const foreign = (text) => {
        if (typeof text === 'string') return accented(text);
        if (Array.isArray(text)) return text.map(foreign);
        if (typeof text === 'object') return Object.fromEntries(Object.entries(text).map(([key, one]) => [key, foreign(one)]));
        return (...values) => {
            const kept = [];
            const keep = (value) => (typeof value === 'string' ? String.fromCharCode(0xe000 + kept.push(value) - 1)
                : Array.isArray(value) ? value.map(keep) : value);
            return accented(text(...values.map(keep))).replace(/[\\ue000-\\uf8ff]/g, (c) => kept[c.charCodeAt(0) - 0xe000]);
        };
    };
    globalThis.weldpathTexts = { lang: 'de', ...foreign(ENGLISH) };
";

/// A script that sets the made-up language: the tables of `texts.js` as they are, and each text of them accented.
fn language() -> String {
    let texts = fs::read_to_string(web().join("src/texts.js")).unwrap();
    let names: Vec<&str> = texts
        .split("export const ")
        .skip(1)
        .filter_map(|rest| rest.split_once(" = /* @__PURE__ */ texts(").map(|(name, _)| name))
        .collect();
    assert_eq!(names, ["PAGE", "TEXTS", "WORDS", "GROUPS", "LABELS"]);
    let plain = texts.replace("export const ", "const ");
    format!("(() => {{ {plain}\nconst ENGLISH = {{ {} }};\n{LANGUAGE} }})();", names.join(", "))
}

/// Words of three letters and more that a reader sees or hears on the page, each with the text it stands in.
const WORDS: &str = "(() => {
    const texts = [document.title];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const { parentElement, textContent } = walker.currentNode;
        if (!parentElement.closest('script, style, noscript, pre, code')) texts.push(textContent);
    }
    for (const element of document.querySelectorAll('*')) {
        for (const name of ['aria-label', 'aria-valuetext', 'title', 'placeholder', 'alt']) {
            if (element.hasAttribute(name)) texts.push(element.getAttribute(name));
        }
    }
    return texts.flatMap((text) => (text.match(/(?<![\\p{L}\\p{M}])[A-Za-z]{3,}(?![\\p{L}\\p{M}])/gu) ?? []).map((word) => [word, text.trim()]));
})()";

/// What is written alike in all languages.
const NAMES: [&str; 3] = ["weldpath", "job", "toml"];

/// Words of the page that are neither of the made-up language nor of `data`.
fn english(browser: &mut Browser, data: &str) -> Vec<String> {
    let data: BTreeSet<&str> = data.split(|c: char| !c.is_ascii_alphabetic()).collect();
    let words = browser.evaluate(WORDS);
    let words = words.as_array().unwrap();
    let left = |pair: &&Value| {
        let word = pair[0].as_str().unwrap();
        // A name of data may begin a sentence.
        let small = word[..1].to_lowercase() + &word[1..];
        !NAMES.contains(&word) && !data.contains(word) && !data.contains(small.as_str())
    };
    words.iter().filter(left).map(|pair| format!("{} in {}", pair[0], pair[1])).collect()
}

/// Numbers and words of the plan in a page; keys of its numbers name them in tables.
const DATA: &str = "JSON.stringify(weldpath.content)";

#[test]
fn another_language_leaves_no_english_in_the_report() {
    let Some(chromium) = browser::chromium() else { return };
    let home = tempfile::tempdir().unwrap();
    let fixture = plan_the_cell(home.path());
    let truth = fixture.join("truth.json");
    let scored = ["evaluate", "out", "--report", "--quiet", "--truth", truth.to_str().unwrap()];
    ends_well(weldpath().args(scored).current_dir(home.path()));
    let page = fs::read_to_string(home.path().join("out/report.html")).unwrap();
    let page = page.replacen("<script type=", &format!("<script>{}</script><script type=", language()), 1);
    let mut browser = Browser::open(&chromium, &page);
    assert!(browser.console().is_empty(), "{:?}", browser.console());
    assert_eq!(browser.evaluate("document.documentElement.lang"), "de");
    let data = browser.evaluate(DATA);
    let data = data.as_str().unwrap();
    for colouring in 0..6 {
        browser.evaluate(&format!(
            "(() => {{ const choice = document.getElementById('colour-by'); choice.value = '{colouring}'; choice.dispatchEvent(new Event('change')); }})()"
        ));
        let left = english(&mut browser, data);
        assert!(left.is_empty(), "{}", left.join("\n"));
    }
}

#[test]
fn another_language_leaves_no_english_in_the_page_that_edits() {
    let Some(chromium) = browser::chromium() else { return };
    let mut page = Page::open_after(&chromium, "scan", &language());
    for scope in ["scope-seam", "scope-joint", "scope-job"] {
        page.browser.evaluate(&format!("document.getElementById({scope:?}).click()"));
        page.settle(&format!("document.getElementById({scope:?}).getAttribute('aria-pressed') === 'true'"));
        for key in ["a", "b", "d", "e", "h", "m"] {
            page.browser.press(key, false);
            // What the server says (units, limits and descriptions of settings, the last edit) is data.
            let data = page.browser.evaluate(
                "(async () => JSON.stringify(weldpath.content) + await (await fetch('schema')).text() + await (await fetch('state')).text())()",
            );
            let left = english(&mut page.browser, data.as_str().unwrap());
            assert!(left.is_empty(), "{scope}, {key}:\n{}", left.join("\n"));
            page.browser.press("Escape", false);
        }
    }
}

#[test]
fn another_language_leaves_no_english_on_the_start_page() {
    let Some(chromium) = browser::chromium() else { return };
    let home = tempfile::tempdir().unwrap();
    let mut page = Page::visit_after(&chromium, home, &[], &language());
    page.settle("document.activeElement.id === 'input'");
    let data = page.browser.evaluate("fetch('state').then((answer) => answer.text())");
    let left = english(&mut page.browser, data.as_str().unwrap());
    assert!(left.is_empty(), "{}", left.join("\n"));
}
