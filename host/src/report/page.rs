//! The page itself: the template of `web/` with its style, its script and the run's data put in.
//!
//! What comes from outside (file names, messages) stands only in JSON, in which `<` is written as an escape, so that it
//! can end no element; the script puts it in the page as text. The page's own policy forbids every fetch.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

const TEMPLATE: &str = include_str!("web/page.html");
const STYLE: &str = include_str!("web/style.css");
/// Built from `web/src` and three.js by `web/build.sh`.
const SCRIPT: &str = include_str!("web/dist/report.js");

/// Where the numbers stand.
#[cfg(feature = "open")]
const CONTENT: [&str; 2] = ["<script type=\"application/json\" id=\"content\">", "</script>"];
/// Where the deviation from the truth stands.
const DEVIATION: [&str; 2] = ["<script type=\"application/json\" id=\"deviation\">", "</script>"];

/// The whole page; `content` is JSON, `bytes` are what it refers to.
pub(super) fn page(title: &str, content: &str, bytes: &[u8]) -> String {
    let parts = [
        ("{{title}}", html_text(title)),
        ("{{style}}", STYLE.to_owned()),
        ("{{content}}", inert(content)),
        ("{{points}}", STANDARD.encode(bytes)),
        ("{{script}}", SCRIPT.to_owned()),
    ];
    let (mut page, mut rest) = (String::new(), TEMPLATE);
    for (slot, text) in parts {
        // The search for the next slot begins behind what was put in, so that data cannot contain a slot.
        if let Some((before, after)) = rest.split_once(slot) {
            page.push_str(before);
            page.push_str(&text);
            rest = after;
        }
    }
    page + rest
}

/// The page with `deviation`, JSON, in the place kept for it; none if `page` is not a report.
pub fn with_deviation(page: &str, deviation: &str) -> Option<String> {
    let (before, rest) = page.split_once(DEVIATION[0])?;
    let end = rest.find(DEVIATION[1])?;
    Some(format!("{before}{}{}{}", DEVIATION[0], inert(deviation), &rest[end..]))
}

/// What edits: style and script, built from `web/editor` by `web/build.sh`.
#[cfg(feature = "open")]
const EDITOR: [&str; 2] = [include_str!("web/editor/editor.css"), include_str!("web/dist/editor.js")];
/// The page before the first plan.
#[cfg(feature = "open")]
const WAITING: &str = include_str!("web/editor/waiting.html");
/// The policy of a page that is a file; a server sends its own.
#[cfg(feature = "open")]
const POLICY: [&str; 2] = ["<meta http-equiv=\"Content-Security-Policy\" content=\"", "\">\n"];

/// Which plan a page shows, and which cloud: a plan of the same cloud can take its place without a new one.
#[cfg(feature = "open")]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Edition {
    /// Of the plan, counted from 1.
    pub plan: u64,
    /// Of the cloud, counted from 1.
    pub cloud: u64,
}

/// A report as the page that edits its job; scripts carry `nonce`. None if `page` is no report.
#[cfg(feature = "open")]
pub fn editable(page: &str, nonce: &str, edition: Edition) -> Option<String> {
    let Edition { plan, cloud } = edition;
    let (before, rest) = page.split_once(POLICY[0])?;
    let (_, rest) = rest.split_once(POLICY[1])?;
    // Data cannot begin an element: the last script is the report's own.
    let (markup, script) = rest.rsplit_once("<script>")?;
    let (script, end) = script.rsplit_once("</body>")?;
    let [style, editor] = EDITOR;
    Some(format!(
        "{before}{markup}<style>{style}</style>\n<script nonce=\"{nonce}\">{script}\
         <script nonce=\"{nonce}\" data-plan=\"{plan}\" data-cloud=\"{cloud}\" id=\"editor\">{editor}</script>\n</body>{end}"
    ))
}

/// The numbers of a report, JSON: everything but its points. None if `page` is no report.
#[cfg(feature = "open")]
pub fn numbers(page: &str) -> Option<&str> {
    let (_, rest) = page.split_once(CONTENT[0])?;
    // Inside there is no `<`.
    rest.split_once(CONTENT[1]).map(|(numbers, _)| numbers)
}

/// The page that waits for the first plan.
#[cfg(feature = "open")]
pub fn waiting(nonce: &str) -> String {
    bare(WAITING, nonce, EDITOR[1])
}

/// The page on which something to open is chosen, and its script, built by `web/build.sh`.
#[cfg(feature = "open")]
const START: [&str; 2] = [include_str!("web/editor/start.html"), include_str!("web/dist/start.js")];

/// The page on which something to open is chosen.
#[cfg(feature = "open")]
pub fn start(nonce: &str) -> String {
    let [page, script] = START;
    bare(page, nonce, script)
}

/// A page without a report, with its styles and its script.
#[cfg(feature = "open")]
fn bare(page: &str, nonce: &str, script: &str) -> String {
    let parts =
        [("{{style}}", STYLE), ("{{editor-style}}", EDITOR[0]), ("{{nonce}}", nonce), ("{{script}}", script)];
    parts.iter().fold(page.to_owned(), |page, (slot, text)| page.replacen(slot, text, 1))
}

/// JSON that ends no element and begins no comment.
fn inert(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// Text that is no markup.
pub(super) fn html_text(text: &str) -> String {
    let escaped = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    // A name may hold control characters, which no XML may.
    escaped.replace('"', "&quot;").chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_slot_of_the_template_is_filled_once() {
        let page = page("a {{content}} b", "{\"x\":1}", &[1, 2, 3]);
        assert!(page.contains("<title>a {{content}} b"));
        assert_eq!(page.matches("{\"x\":1}").count(), 1);
        assert!(page.contains("AQID"));
        for slot in ["{{style}}", "{{points}}", "{{script}}"] {
            assert!(TEMPLATE.contains(slot) && !page.contains(slot), "{slot}");
        }
    }

    #[test]
    fn hostile_text_ends_no_element() {
        let evil = "</script><img src=x onerror=alert(1)>";
        let json = serde_json::json!({ "title": evil }).to_string();
        let page = page(evil, &json, &[]);
        assert!(!page.contains("<img src=x"));
        let page = with_deviation(&page, &json).unwrap();
        assert!(!page.contains("<img src=x"));
    }

    #[cfg(feature = "open")]
    #[test]
    fn the_numbers_of_a_page_are_those_that_were_put_in() {
        let json = serde_json::json!({ "title": "</script><b>", "n": 1.5 });
        let page = page("t", &json.to_string(), &[1, 2, 3]);
        assert_eq!(serde_json::from_str::<serde_json::Value>(numbers(&page).unwrap()).unwrap(), json);
        assert_eq!(numbers("<p>no report</p>"), None);
    }

    #[test]
    fn a_deviation_replaces_the_one_before() {
        let first = with_deviation(&page("t", "{}", &[]), "{\"first\":1}").unwrap();
        let second = with_deviation(&first, "{\"second\":2}").unwrap();
        assert!(!second.contains("\"first\"") && second.contains("{\"second\":2}</script>"));
        assert_eq!(with_deviation("<p>no report</p>", "{}"), None);
    }
}
