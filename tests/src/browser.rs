//! A page as Chromium sees it: loaded without a window or network, a script run in it, its answer read from the DOM.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What a browser made of a page.
#[derive(Debug)]
pub struct Seen {
    /// What the script put into the element with the id `answer`, as JSON.
    pub answer: serde_json::Value,
    /// Lines of the console: errors, warnings and messages of page and browser.
    pub console: Vec<String>,
}

/// Names under which distributions install it.
const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
/// Virtual time that a page has, ms; it passes as fast as the page computes.
const BUDGET_MS: u32 = 20_000;

/// Chromium, or none, after saying so.
///
/// # Panics
/// With `WELDPATH_REQUIRE_CHROMIUM` set, as `tests/all.sh` does, instead of none.
pub fn chromium() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let found = NAMES.iter().flat_map(|name| folders.iter().map(move |f| f.join(name))).find(|p| p.is_file());
    if found.is_none() {
        let reason = "no chromium in PATH; install it: apt-get install chromium";
        assert!(std::env::var_os("WELDPATH_REQUIRE_CHROMIUM").is_none(), "{reason}");
        println!("skipped: {reason}");
    }
    found
}

/// Loads `page` in a window of 1440 x 900 px and runs `script` at its end.
///
/// # Panics
/// If the browser does not start, or the script never answers.
pub fn look(chromium: &Path, page: &str, script: &str) -> Seen {
    let home = tempfile::tempdir().expect("a folder");
    let file = home.path().join("page.html");
    let end = page.rfind("</body>").expect("a body");
    let answer = "<pre id=\"answer\"></pre>";
    let page = format!("{}{answer}<script>{script}</script>{}", &page[..end], &page[end..]);
    std::fs::write(&file, page).expect("the page is written");
    let output = Command::new(chromium)
        .args([
            "--headless",
            "--no-sandbox",
            "--no-first-run",
            "--disable-dev-shm-usage",
            "--disable-extensions",
        ])
        // Software rendering: the same on a machine without a graphics card.
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        .args(["--window-size=1440,900", "--enable-logging=stderr", "--dump-dom"])
        .arg(format!("--virtual-time-budget={BUDGET_MS}"))
        .arg(format!("--user-data-dir={}", home.path().join("profile").display()))
        .arg(format!("file://{}", file.display()))
        .stdin(Stdio::null())
        .output()
        .expect("chromium starts");
    let (dom, log) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let text = dom.rsplit_once("<pre id=\"answer\">").and_then(|(_, rest)| rest.split_once("</pre>"));
    let text =
        text.map_or("", |(text, _)| text).replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    let console = log.lines().filter(|line| line.contains(":CONSOLE:")).map(str::to_owned).collect();
    let answer = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: `{text}`\n{log}"));
    Seen { answer, console }
}
