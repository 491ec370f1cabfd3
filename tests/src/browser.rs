//! A page as a reader sees it: Chromium without a window, driven over its DevTools protocol through a pipe.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use crate::command::PATIENCE;

/// Names under which distributions install it.
const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// Commands arrive at its descriptor 3, answers leave at 4, each message with a zero behind it. Software rendering: the
/// same on a machine without a graphics card. A browser that hangs is ended after ten minutes.
const START: &str = "exec timeout 600 \"$0\" --headless --no-sandbox --no-first-run --disable-dev-shm-usage \
     --use-angle=swiftshader --enable-unsafe-swiftshader --remote-debugging-pipe --user-data-dir=\"$1\" \
     3<&0 4>&1 0</dev/null 1>&2 2>/dev/null";

/// Events that are a line of the page's console.
const CONSOLE: [&str; 3] = ["Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"];

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

/// A browser that shows one page, 1440 x 900 px.
#[derive(Debug)]
pub struct Browser {
    child: Child,
    commands: ChildStdin,
    answers: BufReader<ChildStdout>,
    session: Option<String>,
    sent: u64,
    events: Vec<Value>,
    _home: tempfile::TempDir,
}

impl Browser {
    /// Opens `page` and waits until it is loaded.
    ///
    /// # Panics
    /// If the browser does not start.
    pub fn open(chromium: &Path, page: &str) -> Self {
        let home = tempfile::tempdir().expect("a folder");
        let file = home.path().join("page.html");
        std::fs::write(&file, page).expect("the page is written");
        Self::at(chromium, home, &format!("file://{}", file.display()), "")
    }

    /// Opens the page at an address and waits until it is loaded.
    ///
    /// # Panics
    /// If the browser does not start.
    pub fn visit(chromium: &Path, address: &str) -> Self {
        Self::visit_after(chromium, address, "")
    }

    /// The same, with a script that runs before those of the page.
    ///
    /// # Panics
    /// If the browser does not start.
    pub fn visit_after(chromium: &Path, address: &str, script: &str) -> Self {
        Self::at(chromium, tempfile::tempdir().expect("a folder"), address, script)
    }

    fn at(chromium: &Path, home: tempfile::TempDir, address: &str, script: &str) -> Self {
        let mut child = Command::new("sh")
            .args(["-c", START])
            .arg(chromium)
            .arg(home.path().join("profile"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("sh starts");
        let (commands, answers) = (child.stdin.take().expect("a pipe"), child.stdout.take().expect("a pipe"));
        let answers = BufReader::new(answers);
        let mut browser =
            Self { child, commands, answers, session: None, sent: 0, events: Vec::new(), _home: home };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }))["targetId"].clone();
        let session = browser.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        browser.session = session["sessionId"].as_str().map(str::to_owned);
        for domain in ["Runtime", "Log", "Page"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser.resize(1440, 900);
        browser.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": script }));
        browser.call("Page.navigate", json!({ "url": address }));
        while !browser.events.iter().any(|event| event["method"] == "Page.loadEventFired") {
            let event = browser.read();
            browser.events.push(event);
        }
        browser
    }

    fn read(&mut self) -> Value {
        let mut message = Vec::new();
        self.answers.read_until(0, &mut message).expect("the pipe is read");
        message.pop();
        serde_json::from_slice(&message).expect("the browser answers")
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.answer(method, params).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    fn answer(&mut self, method: &str, params: Value) -> Result<Value, Value> {
        self.sent += 1;
        let mut message = json!({ "id": self.sent, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        self.commands.write_all(format!("{message}\0").as_bytes()).expect("the browser listens");
        loop {
            let mut answer = self.read();
            if answer["id"] == self.sent {
                return if answer["error"].is_null() { Ok(answer["result"].take()) } else { Err(answer) };
            }
            self.events.push(answer);
        }
    }

    /// The value of an expression in the page; a promise is waited for.
    ///
    /// # Panics
    /// If it throws.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let mut answer = self.call("Runtime.evaluate", params);
        assert!(answer["exceptionDetails"].is_null(), "{answer}");
        answer["result"]["value"].take()
    }

    /// Waits until an expression is true in the page, which may be loaded anew meanwhile.
    ///
    /// # Panics
    /// If it never is.
    pub fn wait_for(&mut self, expression: &str) {
        let end = Instant::now() + PATIENCE;
        let params = json!({ "expression": format!("Boolean({expression})"), "returnByValue": true });
        loop {
            // Amid a load there is no page that could answer, and what it has not got yet throws.
            let answer = self.answer("Runtime.evaluate", params.clone()).unwrap_or_default();
            if answer["result"]["value"] == true {
                return;
            }
            assert!(Instant::now() < end, "never: {expression}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Presses a key, as `p` or `Escape`; with the control key where it is asked for.
    pub fn press(&mut self, key: &str, control: bool) {
        let modifiers = if control { 2 } else { 0 };
        let text = if key.len() == 1 && !control { key } else { "" };
        let down = json!({ "type": "keyDown", "key": key, "text": text, "modifiers": modifiers });
        self.call("Input.dispatchKeyEvent", down);
        self.call("Input.dispatchKeyEvent", json!({ "type": "keyUp", "key": key, "modifiers": modifiers }));
    }

    /// Presses one of these keys with all that it does by itself: Tab moves on, Enter and the space bar work what is in focus.
    ///
    /// # Panics
    /// At another key.
    pub fn strike(&mut self, key: &str) {
        let keys = [("Tab", 9, ""), ("Enter", 13, "\r"), ("Escape", 27, ""), (" ", 32, " ")];
        let (_, code, text) = keys.into_iter().find(|one| one.0 == key).expect("one of these keys");
        for kind in ["keyDown", "keyUp"] {
            let text = if kind == "keyDown" { text } else { "" };
            let event = json!({ "type": kind, "key": key, "code": if key == " " { "Space" } else { key }, "windowsVirtualKeyCode": code, "text": text });
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Makes the window this large, px.
    pub fn resize(&mut self, width: u32, height: u32) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
        self.wait_until_drawn();
    }

    /// Waits until the page is drawn as it is now: what is measured next is of that picture.
    pub fn wait_until_drawn(&mut self) {
        self.evaluate(
            "new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(() => drawn(true))))",
        );
    }

    /// A picture of the whole page: PNG.
    ///
    /// # Panics
    /// If the browser makes none.
    pub fn screenshot(&mut self) -> Vec<u8> {
        let picture = self.call("Page.captureScreenshot", json!({ "captureBeyondViewport": true }));
        STANDARD.decode(picture["data"].as_str().expect("a picture")).expect("base64")
    }

    /// A picture of the window as it is scrolled: WebP.
    ///
    /// # Panics
    /// If the browser makes none.
    pub fn photograph(&mut self) -> Vec<u8> {
        let picture = self.call("Page.captureScreenshot", json!({ "format": "webp", "quality": 50 }));
        STANDARD.decode(picture["data"].as_str().expect("a picture")).expect("base64")
    }

    /// Clicks with the mouse at a place of the window, px.
    pub fn click(&mut self, x: f64, y: f64) {
        for kind in ["mousePressed", "mouseReleased"] {
            let params = json!({ "type": kind, "x": x, "y": y, "button": "left", "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", params);
        }
    }

    /// Drags with the mouse from one place of the window to another, px, over places between them.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        const STEPS: u32 = 5;
        let mut mouse = |kind: &str, [x, y]: [f64; 2]| {
            let params =
                json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", params);
        };
        mouse("mousePressed", from);
        for k in 1..=STEPS {
            let share = f64::from(k) / f64::from(STEPS);
            mouse("mouseMoved", [0, 1].map(|c| from[c] + share * (to[c] - from[c])));
        }
        mouse("mouseReleased", to);
    }

    /// Everything that page and browser have said on the console.
    pub fn console(&self) -> Vec<&Value> {
        let said = |event: &&Value| CONSOLE.iter().any(|method| event["method"] == *method);
        self.events.iter().filter(said).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It ends by itself when nobody listens any more.
        let _ = self.commands.write_all(b"{\"id\":0,\"method\":\"Browser.close\"}\0");
        let _ = self.child.wait();
    }
}
