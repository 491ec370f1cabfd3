//! Scores of paths whose errors are known from how they were made.

use super::*;
use std::path::Path;

/// A fillet of 100 mm along x at the origin: plate normal z, wall normal y.
fn straight() -> Truth {
    let n = Vector3::new(0.0, 1.0, 1.0).normalize();
    let count = 101;
    let p: Vec<[f64; 3]> = (0..count).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    let seam = TruthSeam {
        name: "fillet".into(),
        required: true,
        visible: vec![1; p.len()],
        n: vec![n.into(); p.len()],
        t: vec![[1.0, 0.0, 0.0]; p.len()],
        p_root: p.clone(),
        p,
        ..TruthSeam::default()
    };
    Truth { name: "straight".into(), seams: vec![seam], ..Truth::default() }
}

/// The truth's own stations as a path, every other one, moved by `shift` and turned by `turn` in its own frame.
fn path_of(truth: &Truth, shift: Vector3<f64>, turn: Vector3<f64>) -> PathSet {
    let mut paths = PathSet { points_mm: Vec::new(), frames: Some(Vec::new()), seams: Some(Vec::new()) };
    for seam in &truth.seams {
        for i in (0..seam.p.len()).step_by(2) {
            let (n, t) = (Vector3::from(seam.n[i]), Vector3::from(seam.t[i]));
            let frame = nalgebra::Matrix3::from_columns(&[t.cross(&n), t, n]);
            paths.points_mm.push(Vector3::from(seam.p[i]) + shift);
            let frame = frame * nalgebra::Rotation3::from_scaled_axis(turn).matrix();
            paths.frames.get_or_insert_default().push(frame);
            paths.seams.get_or_insert_default().push(seam.name.clone());
        }
    }
    paths
}

fn near(a: Option<f64>, b: f64) -> bool {
    a.is_some_and(|a| (a - b).abs() < 1e-9)
}

#[test]
fn the_truth_itself_scores_nothing_wrong() {
    let truth = straight();
    let score = score(&path_of(&truth, Vector3::zeros(), Vector3::zeros()), &truth, &Options::default());
    assert!(near(score.rmse_mm, 0.0) && score.rmse_deg.is_some_and(|deg| deg < 1e-5));
    assert_eq!((score.coverage, score.false_share), (1.0, 0.0));
}

#[test]
fn a_path_beside_the_seam_is_off_by_its_distance_across_it() {
    let truth = straight();
    let shifted = path_of(&truth, Vector3::new(0.4, 0.3, 0.4), Vector3::zeros());
    let score = score(&shifted, &truth, &Options::default());
    assert!(near(score.rmse_mm, 0.5) && near(score.p95_mm, 0.5), "{score:?}");
    let seam = &score.seams["fillet"];
    assert!(near(seam.max_mm, 0.5) && near(seam.overshoot_mm, 0.0));
    assert!(near(seam.bias_n_mm, 0.7 / 2.0_f64.sqrt()), "{seam:?}");
}

#[test]
fn a_turned_torch_is_off_by_its_angle_whatever_the_direction_of_travel() {
    let truth = straight();
    let three_deg = 3.0_f64.to_radians();
    let mut paths = path_of(&truth, Vector3::zeros(), Vector3::new(0.0, 0.0, three_deg));
    let forward = score(&paths, &truth, &Options::default());
    paths.points_mm.reverse();
    for frame in paths.frames.iter_mut().flatten() {
        frame.column_mut(0).neg_mut();
        frame.column_mut(1).neg_mut();
    }
    let backward = score(&paths, &truth, &Options::default());
    for score in [forward, backward] {
        assert!((score.rmse_deg.unwrap() - 3.0).abs() < 1e-6);
        assert!(score.seams["fillet"].n_deg.unwrap() < 1e-5);
    }
}

#[test]
fn half_a_path_covers_half_the_seam() {
    let truth = straight();
    let mut paths = path_of(&truth, Vector3::zeros(), Vector3::zeros());
    paths.points_mm.truncate(26);
    paths.frames.as_mut().unwrap().truncate(26);
    paths.seams.as_mut().unwrap().truncate(26);
    let score = score(&paths, &truth, &Options::default());
    // Points up to 50 mm, stations strictly nearer than 2 mm: 0 to 51.
    assert!((score.coverage - 52.0 / 101.0).abs() < 1e-12, "{}", score.coverage);
}

#[test]
fn points_far_from_every_seam_are_false() {
    let truth = straight();
    let mut paths = path_of(&truth, Vector3::zeros(), Vector3::zeros());
    for point in paths.points_mm.iter_mut().take(17) {
        point.z += 8.5;
    }
    let score = score(&paths, &truth, &Options::default());
    assert!((score.false_share - 17.0 / 51.0).abs() < 1e-12);
}

#[test]
fn an_empty_path_covers_nothing() {
    let paths = PathSet { points_mm: Vec::new(), frames: None, seams: None };
    let score = score(&paths, &straight(), &Options::default());
    assert_eq!((score.coverage, score.false_share, score.points), (0.0, 0.0, 0));
    assert_eq!(score.rmse_mm, None);
}

#[test]
fn a_standoff_is_taken_away_along_the_torch() {
    let truth = straight();
    let n = Vector3::new(0.0, 1.0, 1.0).normalize();
    let options = Options { standoff_mm: 15.0, near_mm: 8.0, ..Options::default() };
    let score = score(&path_of(&truth, n * 15.0, Vector3::zeros()), &truth, &options);
    assert!(score.rmse_mm.unwrap() < 1e-9);
}

#[test]
fn a_rigid_fit_undoes_a_rigid_motion_across_the_seams() {
    let mut truth = straight();
    let mut other = truth.seams[0].clone();
    other.name = "upright".into();
    other.p = (0..80).map(|i| [0.0, 40.0, f64::from(i)]).collect();
    other.p_root = other.p.clone();
    other.t = vec![[0.0, 0.0, 1.0]; 80];
    other.n = vec![[1.0, 0.0, 0.0]; 80];
    other.visible = vec![1; 80];
    truth.seams.push(other);
    let mut paths = path_of(&truth, Vector3::zeros(), Vector3::zeros());
    let turn = nalgebra::Rotation3::from_scaled_axis(Vector3::new(0.01, -0.015, 0.008));
    for point in &mut paths.points_mm {
        *point = turn * *point + Vector3::new(0.5, -0.7, 0.3);
    }
    let aligned = align(&paths, &truth, Target::Apex);
    let after = score(&aligned.paths, &truth, &Options::default());
    assert!(after.rmse_mm.unwrap() < 1e-3, "{after:?}");
    assert!((aligned.turned_deg - turn.angle().to_degrees()).abs() < 0.05);
}

#[test]
fn the_papers_rmse_pairs_points_by_arc_length_in_either_direction() {
    let truth = straight();
    let mut line: Vec<Vector3<f64>> = (0..=10).map(|i| Vector3::new(f64::from(i) * 10.0, 0.6, 0.8)).collect();
    assert!(near(paper_rmse(&line, &truth.seams[0], Target::Apex), 1.0));
    line.reverse();
    assert!(near(paper_rmse(&line, &truth.seams[0], Target::Apex), 1.0));
    assert_eq!(paper_rmse(&[], &truth.seams[0], Target::Apex), None);
}

#[test]
fn f1_is_one_for_equal_sets_and_falls_with_what_is_missing() {
    let line = |n: i32| -> Vec<[f64; 3]> { (0..n).map(|i| f64::from(i) * 2.0).map(|s| [s, s, s]).collect() };
    let (whole, half) = (line(100), line(50));
    let same = f1(&whole, &whole, 2.0).unwrap();
    assert_eq!((same.dice, same.recall, same.precision), (1.0, 1.0, 1.0));
    let part = f1(&half, &whole, 2.0).unwrap();
    assert_eq!(part.precision, 1.0);
    // One cell of tolerance reaches one cell beyond the end.
    assert!((part.recall - 0.51).abs() < 1e-12, "{}", part.recall);
    assert!((part.dice - 2.0 * 0.51 / 1.51).abs() < 1e-12);
    assert_eq!(f1(&[], &whole, 2.0), None);
}

fn refusal(text: &str) -> String {
    PathSet::parse(text.as_bytes(), Path::new("path.csv")).unwrap_err().to_string()
}

#[test]
fn columns_are_found_by_name_in_any_order() {
    let text = " z_mm , seam, x_mm,y_mm,qx,qy,qz,qw\n3,a,1,2,0,0,0,-2\n";
    let paths = PathSet::parse(text.as_bytes(), Path::new("path.csv")).unwrap();
    assert_eq!(paths.points_mm, vec![Vector3::new(1.0, 2.0, 3.0)]);
    assert_eq!(paths.frames.unwrap()[0], nalgebra::Matrix3::identity());
    assert_eq!(paths.seams.unwrap(), vec!["a"]);
}

#[test]
fn a_bad_path_file_is_refused_with_its_name_and_place() {
    assert!(refusal("x,y,z\n1,2,3\n").contains("x_mm"));
    assert!(refusal("").contains("path.csv"));
    let bad = refusal("x_mm,y_mm,z_mm\n1,2,3\n1,two,3\n");
    assert!(bad.contains("line 3") && bad.contains("two"), "{bad}");
    assert!(refusal("x_mm,y_mm,z_mm\n1,NaN,3\n").contains("line 2"));
    assert!(refusal("x_mm,y_mm,z_mm\n1,2\n").contains("path.csv"));
    assert!(refusal("x_mm,y_mm,z_mm,qw,qx,qy,qz\n1,2,3,0,0,0,0\n").contains("quaternion"));
}

#[test]
fn a_bad_truth_is_refused_with_the_seam() {
    let mut truth = straight();
    truth.seams[0].t.pop();
    let parse = |truth: &Truth| {
        let bytes = serde_json::to_vec(truth).unwrap();
        Truth::parse(&bytes, Path::new("truth.json")).unwrap_err().to_string()
    };
    assert!(parse(&truth).contains("seam `fillet`"));
    let along_the_torch = truth.seams[0].n[0];
    truth.seams[0].t.push(along_the_torch);
    assert!(parse(&truth).contains("station 100"));
    let cut = Truth::parse(b"{\"name\": \"x\", \"sea", Path::new("truth.json")).unwrap_err().to_string();
    assert!(cut.contains("truth.json") && cut.contains("line 1"));
}

#[test]
fn a_taught_path_serves_as_truth() {
    // A square of 40 mm in the plane z = 7, torch upright, every 10 mm, closed.
    let mut text = String::from("seam,x_mm,y_mm,z_mm,qw,qx,qy,qz\n");
    let corners = [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0), (0.0, 0.0)];
    for side in corners.windows(2) {
        for k in 0..4 {
            let share = f64::from(k) / 4.0;
            let (x, y) =
                (side[0].0 + (side[1].0 - side[0].0) * share, side[0].1 + (side[1].1 - side[0].1) * share);
            let turn = (side[1].1 - side[0].1).atan2(side[1].0 - side[0].0) - std::f64::consts::FRAC_PI_2;
            text += &format!("1,{x},{y},7,{},0,0,{}\n", (turn / 2.0).cos(), (turn / 2.0).sin());
        }
    }
    text += "1,0,0,7,1,0,0,0\n";
    let truth = taught::parse(text.as_bytes(), Path::new("taught.csv")).unwrap();
    assert!(truth.seams[0].closed && truth.seams[0].required);
    assert_eq!(truth.seams[0].p.len(), 160);
    let paths = PathSet::parse(text.as_bytes(), Path::new("taught.csv")).unwrap();
    let own = score(&paths, &truth, &Options::default());
    assert!(own.rmse_mm.unwrap() < 1e-9 && own.coverage == 1.0, "{own:?}");
    let bare = "x_mm,y_mm,z_mm\n1,2,3\n";
    assert!(taught::parse(bare.as_bytes(), Path::new("t.csv")).unwrap_err().to_string().contains("qw"));
    let empty = "x_mm,y_mm,z_mm,rx,ry,rz\n";
    assert!(
        taught::parse(empty.as_bytes(), Path::new("t.csv")).unwrap_err().to_string().contains("no point")
    );
}

#[test]
fn a_file_cut_anywhere_is_read_or_refused_but_never_a_panic() {
    let json = serde_json::to_vec(&straight()).unwrap();
    for end in (0..json.len() - 1).step_by(13) {
        assert!(Truth::parse(&json[..end], Path::new("truth.json")).is_err());
    }
    let csv = b"seam,x_mm,y_mm,z_mm,qw,qx,qy,qz\n1,10,20,30,1,0,0,0\n1,12,20,30,1,0,0,0\n\xff\xfe,1e999,,,";
    for end in 0..=csv.len() {
        let path = Path::new("path.csv");
        if let Ok(paths) = PathSet::parse(&csv[..end], path) {
            score(&paths, &straight(), &Options::default());
            assert!(paths.points_mm.len() <= 2);
        }
        if let Ok(truth) = taught::parse(&csv[..end], path) {
            assert!(!truth.seams.is_empty());
        }
    }
    assert!(PathSet::parse(csv, Path::new("path.csv")).is_err());
}

#[test]
fn a_taught_path_that_fills_the_memory_is_refused() {
    let mut text = String::from("seam,x_mm,y_mm,z_mm,qw,qx,qy,qz\n");
    for i in 0..300 {
        text += &format!("1,{},0,0,1,0,0,0\n", (i % 2) * 900);
    }
    let refused = taught::parse(text.as_bytes(), Path::new("taught.csv")).unwrap_err().to_string();
    assert!(refused.contains("too much"), "{refused}");
}
