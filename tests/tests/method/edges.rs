//! The edges of the system: files made to take memory, streams that are closed or full, no threads, names that are no
//! text or that hold a terminal's commands. Each ends in words and an exit code, never in a panic.
#![cfg(unix)]

use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use weldpath::input::{self, Options};
use weldpath_tests::command::weldpath;

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn refused(name: &str, bytes: Vec<u8>) -> String {
    let began = Instant::now();
    let error = input::read_bytes(bytes, Path::new(name), &Options::default()).unwrap_err().to_string();
    assert!(began.elapsed() < Duration::from_secs(20), "{name}: {:?}", began.elapsed());
    assert!(error.contains(name), "{error}");
    error
}

#[test]
fn files_that_claim_far_more_memory_than_they_have_bytes_are_refused_with_the_limit() {
    let vertices = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let faces = "element face 20000000\nproperty list uchar int vertex_indices\nend_header\n";
    let head = format!("ply\nformat binary_little_endian 1.0\n{vertices}{faces}");
    let empty_lists = [head.as_bytes(), &[0; 36], &vec![0; 20_000_000]].concat();
    assert!(refused("lists.ply", empty_lists).contains("claimed"));

    let other = "element strip 20000000\nproperty list uchar int a\n";
    let head = format!("ply\nformat binary_little_endian 1.0\n{other}{vertices}end_header\n");
    let lists_before = [head.as_bytes(), &vec![0; 20_000_000], &[0; 36]].concat();
    assert!(refused("strips.ply", lists_before).contains("ten times the file"));

    let commas = [b"1,2,3".to_vec(), vec![b','; 1_000_000], b"\n".to_vec()].concat();
    assert!(refused("commas.csv", commas).contains("longer than 65536 bytes"));

    let fan =
        [b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf".to_vec(), b" 1 2 3".repeat(4_000_000), b"\n".to_vec()].concat();
    assert!(refused("fan.obj", fan).contains("ten times the file"));
}

#[test]
fn an_image_of_zeros_costs_what_its_bytes_may_and_says_so() {
    let home = tempfile::tempdir().unwrap();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 8000, 8000);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&vec![0; 128_000_000]).unwrap();
    assert!(bytes.len() < 1_000_000);
    std::fs::write(home.path().join("d.png"), bytes).unwrap();
    let camera = r#""camera":{"width":8000,"height":8000,"fx":6000,"fy":6000,"cx":4000,"cy":4000,"depth_scale_m":0.0001}"#;
    let eye = r#""flange_from_camera":[0,0,0,0,0,0]"#;
    let views = r#""views":[{"depth":"d.png","base_from_flange":[0,0,0,0,0,0]}]"#;
    std::fs::write(home.path().join("scan.json"), format!("{{\"units\":\"m\",{camera},{eye},{views}}}"))
        .unwrap();
    let error = input::read(home.path(), &Options::default()).unwrap_err().to_string();
    for part in ["d.png", "64000000 pixels", "ten times the file and 80 MB"] {
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn four_hundred_thousand_points_at_one_place_are_read_as_a_few() {
    let home = tempfile::tempdir().unwrap();
    let file = home.path().join("one.xyz");
    std::fs::write(&file, "1 2 3\n".repeat(400_000)).unwrap();
    let scan = input::read(&file, &Options::default()).unwrap();
    assert_eq!(scan.views[0].points_mm.len(), 64);
    assert!(
        scan.notes.iter().any(|note| note.contains("dropped 399936 of 400000 points")),
        "{:?}",
        scan.notes
    );
}

#[test]
fn an_endless_job_file_is_refused() {
    // It may have to be built first.
    let mut command = weldpath();
    let began = Instant::now();
    let output = command.args(["plan", "--job", "/dev/zero"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("larger than 1 MB") && began.elapsed() < Duration::from_secs(20));
}

#[test]
fn a_path_that_is_no_text_is_refused_and_nothing_is_written() {
    let home = tempfile::tempdir().unwrap();
    let name = std::ffi::OsStr::from_bytes(b"part\xff.xyz");
    std::fs::write(home.path().join(name), "1 2 3\n").unwrap();
    let output = weldpath().arg("plan").arg(name).current_dir(home.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(4), "{}", said(&output));
    assert!(said(&output).contains("is no text (UTF-8)") && !home.path().join("out").exists());
}

#[test]
fn what_a_terminal_would_take_for_a_command_is_shown() {
    let home = tempfile::tempdir().unwrap();
    let name = "torn\u{1b}[31m.ply";
    std::fs::write(home.path().join(name), "ply\nformat ascii 1.0\nelement vertex 9\n").unwrap();
    let output = weldpath().args(["plan", name]).current_dir(home.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(4));
    assert!(
        !said(&output).contains('\u{1b}') && said(&output).contains("torn\\u{1b}[31m.ply"),
        "{}",
        said(&output)
    );
}

#[test]
fn full_and_closed_streams_end_in_the_exit_code_alone() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("torn.ply"), "ply\n").unwrap();
    let full = || std::fs::File::options().write(true).open("/dev/full").unwrap();
    let run = |words: &[&str], out: Stdio, err: Stdio| {
        let mut command = weldpath();
        command.args(words).current_dir(home.path()).stdout(out).stderr(err);
        command.status().unwrap().code()
    };
    assert_eq!(run(&["plan", "torn.ply"], Stdio::null(), full().into()), Some(4));
    assert_eq!(run(&["plna"], full().into(), full().into()), Some(2));
    assert_eq!(run(&["schema"], full().into(), full().into()), Some(5));
    let mut shell = std::process::Command::new("sh");
    shell
        .args(["-c", "exec \"$0\" plan torn.ply >&- 2>&-"])
        .arg(weldpath().get_program())
        .current_dir(home.path());
    assert_eq!(shell.status().unwrap().code(), Some(4));
}

#[test]
fn without_threads_the_work_is_done_and_a_link_is_refused_in_words() {
    // The limit holds for nobody who may exceed it, such as root: then it is set for another user.
    let home = tempfile::tempdir().unwrap();
    let program = home.path().join("weldpath");
    std::fs::copy(weldpath().get_program(), &program).unwrap();
    let all = std::os::unix::fs::PermissionsExt::from_mode(0o777);
    std::fs::set_permissions(home.path(), all).unwrap();
    std::fs::write(
        home.path().join("flat.xyz"),
        (0..900).map(|i| format!("{} {} 0\n", i / 30, i % 30)).collect::<String>(),
    )
    .unwrap();
    let run = |line: &str| {
        let is_root = std::fs::read_to_string("/proc/self/status").unwrap().contains("Uid:\t0\t0");
        let mut limited = std::process::Command::new(if is_root { "setpriv" } else { "prlimit" });
        if is_root {
            limited.args(["--reuid=65534", "--regid=65534", "--clear-groups", "prlimit"]);
        }
        limited
            .args(["--nproc=1:1", "./weldpath"])
            .args(line.split(' '))
            .current_dir(home.path())
            .output()
            .unwrap()
    };
    let planned = run("plan flat.xyz");
    assert_eq!(planned.status.code(), Some(3), "{}", said(&planned));
    assert!(!said(&planned).contains("panicked"), "{}", said(&planned));
    let linked = run("monitor --port unix:none");
    assert_eq!(linked.status.code(), Some(6), "{}", said(&linked));
    assert!(said(&linked).contains("no threads"), "{}", said(&linked));
}

#[test]
fn names_of_robot_languages_and_ids_said_twice_are_refused_with_their_line() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("flat.xyz"), "1 2 3\n").unwrap();
    for (job, parts) in [
        ("[program]\nname = \"END\"\n", ["job.toml:3", "a word of a robot language"]),
        ("[program]\nname = \"proc\"\n", ["job.toml:3", "a word of a robot language"]),
        ("[program]\nname = \"DEF\"\n", ["job.toml:3", "a word of a robot language"]),
        ("[[seam]]\nid = 2\n[[seam]]\nid = 2\n", ["job.toml:5", "two [[seam]] with id = 2"]),
        ("[selection]\nseams = [1, 3, 1]\n", ["job.toml:3", "seam 1 is selected twice"]),
    ] {
        std::fs::write(home.path().join("job.toml"), format!("input = \"flat.xyz\"\n{job}")).unwrap();
        let output =
            weldpath().args(["plan", "--job", "job.toml"]).current_dir(home.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{job}: {}", said(&output));
        assert!(parts.iter().all(|part| said(&output).contains(part)), "{job}: {}", said(&output));
    }
    let twice = weldpath()
        .args(["plan", "flat.xyz", "--seam", "2", "--seam", "2"])
        .current_dir(home.path())
        .output()
        .unwrap();
    assert!(said(&twice).contains("--seam 2 is given twice"), "{}", said(&twice));
}

#[test]
fn the_doctor_names_what_is_there_and_what_is_missing_and_tries_a_plan() {
    let said = |path: Option<&Path>| {
        let mut command = weldpath();
        command.arg("doctor");
        if let Some(path) = path {
            command.env("PATH", path);
        }
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let nowhere = tempfile::tempdir().unwrap();
    let bare = said(Some(nowhere.path()));
    let row = |text: &str, name: &str| {
        text.lines()
            .find(|line| line.starts_with(name))
            .unwrap_or_else(|| panic!("no {name} in {text}"))
            .to_owned()
    };
    assert!(row(&bare, "QEMU").contains("apt-get install qemu-system-arm"), "{bare}");
    assert!(row(&bare, "browser").contains("none found"), "{bare}");
    for (name, part) in
        [("weldpath", env!("CARGO_PKG_VERSION")), ("readers", "PLY"), ("machine", "threads"), ("ports", "")]
    {
        assert!(row(&bare, name).contains(part), "{bare}");
    }
    assert!(row(&bare, "trial").contains("mm off its truth"), "{bare}");

    std::fs::write(nowhere.path().join("firefox"), "").unwrap();
    assert!(row(&said(Some(nowhere.path())), "browser").contains("firefox"));
}
