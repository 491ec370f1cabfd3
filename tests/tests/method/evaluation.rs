//! `weldpath::evaluation` against the reference script `../shared/tools/evaluate.py` (ignored without it or without numpy and scipy):
//! the same files go through both, and every number agrees within 1e-3.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use weldpath::evaluation::{Options, PathSet, Target, Truth, align, f1, paper_rmse, score};
use weldpath::simulation::{Part, Request, stage};
use weldpath_tests::beside;

const TOLERANCE: f64 = 1e-3;

/// Reads pairs of (path.csv, truth.json) and prints what the reference script makes of each, one JSON per line.
const REFERENCE: &str = r#"
import sys, json
sys.path.insert(0, sys.argv[1])
from evaluate import load_gt, load_csv, score, align, paper_rmse, f1_raster
import numpy as np
for csv, gt in zip(sys.argv[2::2], sys.argv[3::2]):
    P, R, S = load_csv(csv); g = load_gt(gt)
    out = dict(apex=score(P, R, S, g), root=score(P, R, S, g, 'root', d=1.5))
    A, B, mm, deg = align(P, R, g)
    out['aligned'] = score(A, B, S, g); out['moved'] = mm; out['turned'] = deg
    seen = np.vstack([s['p'][s['visible']] for s in g['seams']])
    out['f1'] = f1_raster(P, seen)
    for s in g['seams']: s['p_use'] = s['p']
    out['paper'] = paper_rmse(P, R, g['seams'][0])
    print(json.dumps(out))
"#;

/// Truth files: those given with the project, where they are, and freshly simulated ones.
fn truths(tools: &Path, folder: &Path) -> Vec<PathBuf> {
    let given = std::fs::read_dir(tools.join("../data/scans/truth")).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = given.map(|entry| entry.path()).collect();
    files.sort();
    for part in [Part::Cruciform, Part::RoundLap, Part::Saddle, Part::ButtV] {
        let truth = stage(&Request::new(part, 11)).expect("a scene").truth;
        let path = folder.join(format!("{part}.json"));
        std::fs::write(&path, serde_json::to_vec(&truth).expect("JSON")).expect("a file");
        files.push(path);
    }
    files
}

/// Numbers in -1..1 that look random and are the same each time.
struct Wobble(u64);

impl Wobble {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.next(), self.next(), self.next())
    }
}

/// A flawed path along the truth: noise, a stretch left out, points from nowhere, an end run over, seams reversed.
fn flawed(truth: &Truth, seed: u64) -> String {
    let mut wobble = Wobble(seed);
    let mut csv = String::from("seam,x_mm,y_mm,z_mm,qw,qx,qy,qz\n");
    let shift = wobble.vector() * 0.8;
    for (k, seam) in truth.seams.iter().enumerate() {
        let count = seam.p.len();
        let mut order: Vec<usize> = (0..count).step_by(3 - k % 2).collect();
        order.drain(order.len() / 3..order.len() / 3 + order.len() / 10);
        if k % 2 == 1 {
            order.reverse();
        }
        let turned = if k % 2 == 1 { -1.0 } else { 1.0 };
        for &i in &order {
            let (n, t) = (Vector3::from(seam.n[i]).normalize(), Vector3::from(seam.t[i]));
            let m = (t - n * n.dot(&t)).normalize() * turned;
            let tilt = Rotation3::from_scaled_axis(wobble.vector() * 0.04);
            let frame = tilt.matrix() * Matrix3::from_columns(&[m.cross(&n), m, n]);
            row(&mut csv, k, Vector3::from(seam.p[i]) + shift + wobble.vector() * 0.4, &frame);
            if i + 3 >= count {
                row(&mut csv, k, Vector3::from(seam.p[i]) + m * 4.0, &frame);
            }
        }
        for _ in 0..k + 2 {
            let stray = Vector3::from(seam.p[0]) + Vector3::new(0.0, 0.0, 30.0) + wobble.vector() * 15.0;
            row(&mut csv, k, stray, &Matrix3::identity());
        }
    }
    csv
}

/// The same path without its seam column: runs then follow from gaps.
fn without_seams(csv: &str) -> String {
    csv.lines().filter_map(|line| line.split_once(',')).map(|(_, rest)| format!("{rest}\n")).collect()
}

fn row(csv: &mut String, seam: usize, p: Vector3<f64>, frame: &Matrix3<f64>) {
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*frame));
    let line = format!("{seam},{:.4},{:.4},{:.4},{:.8},{:.8},{:.8},{:.8}", p.x, p.y, p.z, q.w, q.i, q.j, q.k);
    writeln!(csv, "{line}").expect("a string takes all");
}

/// What weldpath makes of the same pair of files.
fn ours(csv: &Path, truth: &Path) -> Value {
    let (paths, truth) = (PathSet::read(csv).expect("a path"), Truth::read(truth).expect("a truth"));
    let root = Options { target: Target::Root, standoff_mm: 1.5, ..Options::default() };
    let aligned = align(&paths, &truth, Target::Apex);
    let points: Vec<[f64; 3]> = paths.points_mm.iter().map(|p| (*p).into()).collect();
    serde_json::json!({
        "apex": score(&paths, &truth, &Options::default()),
        "root": score(&paths, &truth, &root),
        "aligned": score(&aligned.paths, &truth, &Options::default()),
        "moved": aligned.moved_mm,
        "turned": aligned.turned_deg,
        "f1": f1(&points, &truth.visible_mm(Target::Apex), 2.0),
        "paper": paper_rmse(&paths.points_mm, &truth.seams[0], Target::Apex),
    })
}

/// Number of numbers compared; panics where one differs or is missing.
fn compare(place: &str, reference: &Value, own: &Value) -> usize {
    match reference {
        Value::Object(entries) => {
            entries.iter().map(|(key, value)| compare(&format!("{place}.{key}"), value, &own[key])).sum()
        }
        Value::Number(number) => {
            let (a, b) = (number.as_f64().expect("a number"), own.as_f64());
            let b = b.unwrap_or_else(|| panic!("{place}: reference has {a}, we have {own}"));
            assert!((a - b).abs() < TOLERANCE, "{place}: reference {a}, ours {b}");
            1
        }
        other => {
            assert_eq!(other, own, "{place}");
            1
        }
    }
}

#[test]
#[cfg_attr(
    not(reference_script),
    ignore = "needs ../shared/tools/evaluate.py and python3 with numpy and scipy"
)]
fn every_number_agrees_with_the_reference_script() {
    let tools = beside("tools").expect("the folder of the reference script");
    let folder = tempfile::tempdir().expect("a folder");
    let mut pairs = Vec::new();
    for (i, truth) in truths(&tools, folder.path()).into_iter().enumerate() {
        let csv = folder.path().join(format!("path{i}.csv"));
        let named = flawed(&Truth::read(&truth).expect("a truth"), i as u64 + 1);
        let path = if i % 2 == 0 { named } else { without_seams(&named) };
        std::fs::write(&csv, path).expect("a file");
        pairs.extend([csv, truth]);
    }
    let output =
        Command::new("python3").args(["-c", REFERENCE]).arg(&tools).args(&pairs).output().expect("python3");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).expect("text");
    assert_eq!(lines.lines().count(), pairs.len() / 2);
    let mut compared = 0;
    for (line, pair) in lines.lines().zip(pairs.chunks(2)) {
        let reference: Value = serde_json::from_str(line).expect("JSON");
        let name = pair[1].file_stem().unwrap_or_default().to_string_lossy();
        compared += compare(&name, &reference, &ours(&pair[0], &pair[1]));
    }
    println!("{compared} numbers of {} scans agree", pairs.len() / 2);
}
