//! Every subcommand used wrongly: the exit code, and words that name the place and a way out.

use std::path::Path;

use weldpath_tests::command::weldpath;

/// Inputs that are wrong, each in its own way.
fn home() -> tempfile::TempDir {
    let home = tempfile::Builder::new().prefix("weldpath").tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(home.path().join(name), text).unwrap();
    write("flat.xyz", &(0..900).map(|i| format!("{} {} 0\n", i / 30, i % 30)).collect::<String>());
    write("torn.ply", "ply\nformat ascii 1.0\nelement vertex 9\n");
    write("letter.docx", "hello");
    write("empty.pcd", "");
    write("bad.json", "{");
    write("path.csv", "x_mm,y_mm,z_mm\n1,2,3\n");
    write("key.toml", "input = \"flat.xyz\"\n[path]\nfeed = 3\n");
    write("name.toml", "input = \"flat.xyz\"\n[program]\nname = \"a b\"\n");
    write("paper.toml", "input = \"flat.xyz\"\nmethod = \"paper\"\nratio_threshold = 53\n");
    write("weave.toml", "input = \"flat.xyz\"\n[[pass]]\nweave.shape = \"sine\"\n");
    write("robot.toml", "input = \"flat.xyz\"\nformats = [\"motoman\"]\n");
    std::fs::create_dir(home.path().join("empty")).unwrap();
    home
}

/// Arguments, exit code, and what is said.
const CASES: &[(&str, i32, &[&str])] = &[
    ("", 2, &["weldpath plan SCAN", "weldpath open", "weldpath --help"]),
    ("plna", 2, &["'plan'"]),
    ("plan", 2, &["<INPUT>", "hint: for example `weldpath plan scan`"]),
    ("plan nowhere", 4, &["nowhere", "hint: ", "weldpath simulate"]),
    ("plan empty", 4, &["empty", "scan.json"]),
    ("plan torn.ply", 4, &["torn.ply", "cut off"]),
    ("plan letter.docx", 4, &["letter.docx", "PLY, PCD"]),
    ("plan empty.pcd", 4, &["empty.pcd", "Scan again"]),
    ("plan flat.xyz", 3, &["no seam found", "--dump-stages", "troubleshooting"]),
    ("plan flat.xyz --robot motoman", 2, &["ur, abb, kuka, fanuc, ros"]),
    ("plan flat.xyz --robots abb", 2, &["'--robot'"]),
    ("plan flat.xyz --amplitude-mm 3", 2, &["--amplitude-mm changes nothing", "hint: ", "--weave sine"]),
    ("plan flat.xyz --wavelength-mm 3", 2, &["--wavelength-mm changes nothing", "hint: "]),
    ("plan flat.xyz --stitch-mm 12", 2, &["--stitch-mm changes nothing", "hint: ", "--tacks"]),
    ("plan --job paper.toml --t 60 --method weldpath", 2, &["--t is the threshold of the paper's"]),
    ("plan --job paper.toml --method weldpath", 3, &["no seam found"]),
    ("plan --job weave.toml --amplitude-mm 3", 3, &["no seam found"]),
    ("plan flat.xyz --seam one", 2, &["\"one\" is not a whole number"]),
    ("plan flat.xyz --feed-mm-s fast", 2, &["\"fast\" is not a number"]),
    ("plan flat.xyz --near 1,2", 2, &["give three in mm, as in"]),
    ("plan flat.xyz --out flat.xyz/out", 5, &["flat.xyz/out", "hint: choose another folder with --out"]),
    ("plan --job none.toml", 2, &["none.toml", "hint: "]),
    ("plan --job key.toml", 2, &["key.toml:3", "`feed`", "hint: "]),
    ("plan --job name.toml", 2, &["name.toml:3", "at most 16 letters"]),
    ("plan --job robot.toml", 2, &["robot.toml:2", "`abb`"]),
    ("simulate", 2, &["--part", "hint: for example `weldpath simulate"]),
    ("simulate --part tee --out s", 2, &["choose one of fillet"]),
    ("simulate --part lap --out s --views two", 2, &["\"two\" is not a whole number"]),
    ("simulate --part lap --out s --views -1", 2, &["\"-1\" is not a whole number"]),
    ("simulate --part fillet --out s --angle-deg -5", 2, &["-5", "must lie between"]),
    ("simulate --part lap --out s --noise loud", 2, &["none, low, mid, high"]),
    ("evaluate", 2, &["--truth", "hint: for example `weldpath evaluate"]),
    ("evaluate path.csv --truth none.json", 4, &["none.json", "hint: "]),
    ("evaluate path.csv --truth bad.json", 4, &["bad.json", "hint: --truth is the truth.json"]),
    ("evaluate nodir --truth bad.json", 4, &["nodir", "hint: "]),
    ("stream", 2, &["--port", "hint: for example `weldpath stream"]),
    ("stream nodir --port unix:none", 4, &["nodir", "hint: `weldpath plan` writes path.json"]),
    ("stream bad.json --port unix:none", 4, &["bad.json", "hint: "]),
    ("stream x --port unix:none --back-mm -3", 2, &["--back-mm is -3, not 0 to 1000"]),
    ("monitor", 2, &["--port", "hint: for example `weldpath monitor"]),
    ("monitor --port unix:none", 6, &["unix:none", "hint: ", "pendant --sim"]),
    ("monitor --port unix:none --baud fast", 2, &["\"fast\" is not a whole number"]),
    ("pendant", 2, &["--sim", "hint: for example `weldpath pendant --sim`"]),
    ("pendant --sim --elf none", 6, &["none", "hint: ", "--elf"]),
    ("scan", 2, &["--hands", "hint: for example `weldpath scan"]),
    ("scan --hands none.csv --out o --sim", 4, &["none.csv", "--make-hands"]),
    ("scan --make-hands flat.xyz/x.csv", 5, &["flat.xyz", "hint: choose another"]),
    ("scan --hands x.csv --out o --sim --box-mm 1", 2, &["--box-mm is 1, not 10 to 1000"]),
    ("score flat.xyz --near 0,0,0", 2, &["no pendant named", "--sim"]),
    ("score flat.xyz --near 0,0,0 --sim --radius-mm -1", 2, &["--radius-mm is -1, not 0.01 to 32"]),
    ("score flat.xyz --near 0,0,0 --sim --count 0", 2, &["0 is not in 1..=10000"]),
    ("completions", 2, &["<SHELL>", "hint: for example `weldpath completions bash"]),
    ("completions tcsh", 2, &["bash"]),
];

#[cfg(unix)]
#[test]
fn an_argument_that_is_no_text_is_refused_in_words() {
    use std::os::unix::ffi::OsStrExt;
    let output = weldpath().arg(std::ffi::OsStr::from_bytes(b"\xff")).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn what_is_used_wrongly_says_where_and_what_to_do() {
    let home = home();
    let mut wrong = vec![];
    for (line, exit, parts) in CASES {
        let (code, said) = run(home.path(), line);
        if code != Some(*exit) {
            wrong.push(format!("`{line}` ends with {code:?}, not {exit}: {said}"));
        }
        let missing = parts.iter().filter(|part| !said.contains(*part));
        wrong.extend(missing.map(|part| format!("`{line}` does not say {part:?}: {said}")));
        for noise in ["invalid digit", ".tmp", ".weldpath-", "panicked"] {
            if said.contains(noise) {
                wrong.push(format!("`{line}` says {noise:?}: {said}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn run(folder: &Path, line: &str) -> (Option<i32>, String) {
    let output = weldpath().args(line.split_whitespace()).current_dir(folder).output().unwrap();
    assert!(output.stdout.is_empty(), "`{line}` prints on standard output");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}
