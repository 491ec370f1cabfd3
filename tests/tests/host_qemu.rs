//! The command and the firmware in the emulator, as anybody would try them: a planned fixture, and a hand-guided scan.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use weldpath_tests::command::weldpath;
use weldpath_tests::qemu::firmware;

/// `weldpath pendant --sim`, ended with the test.
struct Pendant {
    child: Child,
    port: String,
    panel: UnixStream,
}

impl Pendant {
    fn start(program: &Path) -> Self {
        let mut child = weldpath()
            .args(["pendant", "--sim", "--elf"])
            .arg(program)
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
        let mut after = |word: &str| said.find_map(|line| line.strip_prefix(word).map(String::from)).unwrap();
        let (port, panel) = (after("port "), after("panel "));
        std::thread::spawn(move || said.for_each(drop));
        Self { child, port, panel: UnixStream::connect(panel).unwrap() }
    }
}

impl Drop for Pendant {
    fn drop(&mut self) {
        // `q` lets it clean up; it may be gone.
        let _ = self.child.stdin.take().map(|mut keys| keys.write_all(b"q"));
        let _ = self.child.wait();
    }
}

fn ends_well(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    said
}

#[test]
#[ignore = "open fault: hangs on a loaded machine, where a grip of the panel is missed; qemu_link holds the same with its own client"]
fn a_planned_fixture_is_welded_held_and_resumed_by_the_simulated_pendant() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let folder = tempfile::tempdir().unwrap();
    let fixture = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/butt-v");
    let plan = ["plan", fixture, "--feed-mm-s", "50", "--quiet", "--out"];
    ends_well(weldpath().args(plan).arg(folder.path()));
    let mut pendant = Pendant::start(&program);
    let arguments = ["stream", "--port", &pendant.port, "--back-mm", "3"];
    let mut host = weldpath().args(arguments).arg(folder.path()).stdin(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(host.stdout.take().unwrap()).lines().map_while(Result::ok);
    let mut wait_for = |part: &str| assert!(lines.any(|line| line.contains(part)), "no {part:?}");
    wait_for("waiting");
    // Whatever stop the firmware saw before its panel spoke is acknowledged; then a fresh grip.
    pendant.panel.write_all(b"r").unwrap();
    sleep(Duration::from_millis(500));
    pendant.panel.write_all(b"g").unwrap();
    wait_for("running");
    host.stdin.as_mut().unwrap().write_all(b"h").unwrap();
    wait_for("hold was asked for; r resumes");
    host.stdin.as_mut().unwrap().write_all(b"r").unwrap();
    wait_for("finished");
    assert!(host.wait().unwrap().success());
}

#[test]
fn a_made_recording_scans_the_groove_through_the_firmware_and_the_scan_plans() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let folder = tempfile::tempdir().unwrap();
    let [hands, scan, out] = ["hands.csv", "scan", "out"].map(|name| folder.path().join(name));
    ends_well(weldpath().args(["scan", "--make-hands"]).arg(&hands));
    let said = ends_well(
        weldpath()
            .args(["scan", "--sim", "--elf"])
            .arg(&program)
            .arg("--hands")
            .arg(&hands)
            .arg("--out")
            .arg(&scan),
    );
    println!("{said}");
    let agreed =
        said.lines().next().and_then(|line| line.split_once(" frames")).map(|(count, _)| count.to_string());
    assert!(said.contains(&format!("{} poses are the host's own", agreed.unwrap())), "{said}");
    assert!(said.contains(": 6 views"), "{said}");
    let planned = ends_well(weldpath().arg("plan").arg(&scan).arg("--out").arg(&out));
    assert!(planned.contains("butt-v"), "{planned}");
}
