//! The program `weldpath` as its users run it, watched with a deadline, and the commands that the documents show.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use crate::markdown::blocks;

/// How long a command may take to say or do what a test waits for, on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(300);
/// The same where it computes or compiles.
const LONG_PATIENCE: Duration = Duration::from_secs(3600);

/// The program, built if need be.
///
/// # Panics
/// If it cannot be built.
pub fn weldpath() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    let program = PROGRAM.get_or_init(|| {
        let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
        let test = std::env::current_exe().expect("a test is a file");
        let folder = test.ancestors().nth(2).expect("target/debug/deps");
        // In the tests' own profile: else all of the host is compiled twice.
        let built = Command::new(cargo)
            .args(["build", "--quiet", "-p", "weldpath"])
            .args(folder.ends_with("release").then_some("--release"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .status();
        assert!(built.is_ok_and(|status| status.success()), "weldpath cannot be built");
        folder.join("weldpath")
    });
    let mut command = Command::new(program);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A command that runs, and everything that it has said; dropping it ends it.
pub struct Running {
    child: Child,
    lines: Receiver<String>,
    said: Vec<String>,
}

/// How a command ended.
#[derive(Debug)]
pub struct Ended {
    /// Exit code; none after a signal.
    pub code: Option<i32>,
    /// Both of its outputs, line by line.
    pub said: String,
}

impl Running {
    /// Starts it with a pipe for its keys.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn start(command: &mut Command) -> Self {
        Self::with_keys_from(command, Stdio::piped())
    }

    /// Starts it with this standard input.
    ///
    /// # Panics
    /// If it cannot be started.
    pub fn with_keys_from(command: &mut Command, keys: Stdio) -> Self {
        command.stdin(keys).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let (say, lines) = channel();
        forward(child.stdout.take(), say.clone());
        forward(child.stderr.take(), say);
        Self { child, lines, said: Vec::new() }
    }

    /// The next line that holds one of the parts.
    ///
    /// # Panics
    /// After [`PATIENCE`], or if the command ends first, with everything that it said.
    pub fn wait_for(&mut self, parts: &[&str]) -> String {
        let end = Instant::now() + PATIENCE;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let line = self.lines.recv_timeout(left).unwrap_or_else(|why| {
                panic!("waited for {parts:?}: {why}; it said:\n{}", self.said.join("\n"))
            });
            self.said.push(line.clone());
            if parts.iter().any(|part| line.contains(part)) {
                return line;
            }
        }
    }

    /// Types.
    ///
    /// # Panics
    /// If nobody reads.
    pub fn press(&mut self, keys: &[u8]) {
        if let Err(error) = self.child.stdin.as_mut().expect("a pipe").write_all(keys) {
            self.said.extend(self.lines.iter());
            panic!("nobody reads the keys, {error}; it said:\n{}", self.said.join("\n"));
        }
    }

    /// No more keys.
    pub fn close_keys(&mut self) {
        drop(self.child.stdin.take());
    }

    /// A signal by its name: INT, TERM.
    ///
    /// # Panics
    /// If it cannot be sent.
    pub fn signal(&self, name: &str) {
        let command = format!("kill -{name} {}", self.child.id());
        assert!(Command::new("sh").args(["-c", &command]).status().expect("sh").success(), "{command}");
    }

    /// Ends it as nothing else can be ended.
    pub fn kill(mut self) {
        self.child.kill().expect("it ran");
        self.child.wait().expect("it has ended");
    }

    /// Waits for its end.
    ///
    /// # Panics
    /// After [`PATIENCE`], with everything that it said.
    pub fn end(self) -> Ended {
        self.end_within(PATIENCE)
    }

    fn end_within(mut self, patience: Duration) -> Ended {
        let begin = Instant::now();
        let status = loop {
            match self.child.try_wait().expect("a child") {
                Some(status) => break status,
                None if begin.elapsed() < patience => sleep(Duration::from_millis(5)),
                None => {
                    self.said.extend(self.lines.try_iter());
                    panic!("no end after {patience:?}; it said:\n{}", self.said.join("\n"));
                }
            }
        };
        // Its outputs end with it.
        self.said.extend(self.lines.iter());
        Ended { code: status.code(), said: self.said.join("\n") }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a command to its end, which may take an hour.
///
/// # Panics
/// If it takes longer.
pub fn end_of(command: &mut Command) -> Ended {
    Running::with_keys_from(command, Stdio::null()).end_within(LONG_PATIENCE)
}

/// Runs a command to its end, which has to be a good one; what it said.
///
/// # Panics
/// If it fails or does not end.
pub fn ends_well(command: &mut Command) -> String {
    let ended = end_of(command);
    assert_eq!(ended.code, Some(0), "{command:?}: {}", ended.said);
    ended.said
}

/// Plans the fixture of a robot's cell into `out` of a folder, for a robot that reaches it; where the fixture is.
///
/// # Panics
/// If the job cannot be written or planned.
pub fn plan_the_cell(home: &Path) -> PathBuf {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a workspace").join("fixtures/cell");
    let job = format!("input = {fixture:?}\n[robot]\nmodel = \"ur10e\"\n");
    std::fs::write(home.join("a.toml"), job).expect("a file");
    ends_well(weldpath().args(["plan", "--job", "a.toml", "--quiet"]).current_dir(home));
    fixture
}

fn forward(output: Option<impl Read + Send + 'static>, say: Sender<String>) {
    let Some(output) = output else { return };
    let lines = BufReader::new(output).lines().map_while(Result::ok);
    thread::spawn(move || lines.into_iter().try_for_each(|line| say.send(line)));
}

/// Lines of the fenced `sh` blocks of a Markdown text.
pub fn commands_of(markdown: &str) -> Vec<&str> {
    let lines = blocks(markdown, "sh").into_iter().flat_map(str::lines).map(str::trim);
    lines.filter(|line| !line.is_empty()).collect()
}
