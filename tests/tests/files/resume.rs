//! The rest of a weld that was broken off: what was planned, from a little before the break on.

use std::path::Path;

use weldpath::run::job::Job;
use weldpath::run::postprocessing::{self, Output, postprocess};
use weldpath::weld::SeamPath;
use weldpath::weld::program::Waypoint;
use weldpath_tests::plans;

const JOB: &str = "[path]\nstart_dwell_s = 0.4\n[[pass]]\n[[pass]]\nout_mm = 3\n[weave]\nshape = \"sine\"\namplitude_mm = 2\nwavelength_mm = 8\n";

fn plan(resume: &str) -> Result<Output, postprocessing::Error> {
    let job = Job::parse(&format!("{JOB}{resume}"), Path::new("job.toml")).unwrap();
    postprocess(&plans::pipe_and_bend(), &job, Default::default())
}

fn rest(seam: usize, pass: usize, at_mm: f64, overlap_mm: f64) -> String {
    format!("[resume]\nseam = {seam}\npass = {pass}\nat_mm = {at_mm}\noverlap_mm = {overlap_mm}\n")
}

/// Length along a polyline from its start to the point nearest to `place`, and how far off it is, mm.
fn along(path: &SeamPath, place: &Waypoint) -> (f64, f64) {
    let mut best = (0.0, f64::INFINITY);
    for pair in path.points.windows(2) {
        let way = pair[1].position_mm - pair[0].position_mm;
        let share =
            ((place.position_mm - pair[0].position_mm).dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
        let off = (pair[0].position_mm + way * share - place.position_mm).norm();
        if off < best.1 {
            best = (pair[0].s_mm + share * (pair[1].s_mm - pair[0].s_mm), off);
        }
    }
    best
}

#[test]
fn the_rest_is_the_plan_from_a_little_before_the_break_on() {
    let whole = plan("").unwrap();
    assert_eq!(whole.paths.len(), 4, "two seams of two passes");
    for broken in [0, 1, 3] {
        let path = &whole.paths[broken];
        let pass = 1 + whole.paths[..broken].iter().filter(|before| before.seam == path.seam).count();
        let output = plan(&rest(path.seam, pass, 41.0, 7.5)).unwrap();
        assert_eq!(output.paths.len(), 4 - broken);
        let welds: Vec<&Waypoint> = output.program.waypoints.iter().filter(|point| point.weld).collect();
        let (s_mm, off_mm) = along(path, welds[0]);
        assert!((s_mm - 33.5).abs() < 1e-6 && off_mm < 1e-6, "begins at {s_mm} mm, {off_mm} mm off");
        assert_eq!(welds[0].dwell_s, Some(0.4), "it is struck as the whole is");
        let first = &output.program.waypoints[0];
        assert!(
            !first.weld && (first.position_mm - welds[0].position_mm).norm() > 40.0,
            "it comes from the air"
        );
        // From then on as planned, to the last digit.
        let planned: Vec<Waypoint> =
            whole.program.waypoints.iter().copied().filter(|point| point.weld).collect();
        let tail = &planned[planned.len() - (welds.len() - 1)..];
        assert!(welds[1..].iter().zip(tail).all(|(rest, whole)| **rest == *whole));
        let script = output.files.iter().find(|file| file.name == "path.script").unwrap();
        let script = String::from_utf8_lossy(&script.bytes).replace("\n  # ", " ");
        assert!(script.contains(&format!("seam {}, pass {pass}, from 33.5 mm on", path.seam)), "{script}");
    }
}

#[test]
fn a_break_near_the_start_welds_the_whole_seam_again() {
    let whole = plan("").unwrap();
    let first = whole.paths[0].seam;
    assert_eq!(plan(&rest(first, 1, 3.0, 5.0)).unwrap().paths, whole.paths);
}

#[test]
fn a_rest_that_there_is_not_is_refused_by_what_there_is() {
    let whole = plan("").unwrap();
    let last = &whole.paths[3];
    let end_mm = last.points.last().unwrap().s_mm;
    for (resume, words) in [
        (rest(77, 1, 10.0, 5.0), "the program welds seam".to_owned()),
        (rest(last.seam, 3, 10.0, 5.0), "has 2 passes, and no pass 3".into()),
        (rest(last.seam, 0, 10.0, 5.0), "no pass 0".into()),
        (rest(last.seam, 2, end_mm + 9.0, 5.0), format!("it ends at {end_mm:.1} mm")),
    ] {
        let error = plan(&resume).unwrap_err().to_string();
        assert!(error.contains(&words), "{error}");
    }
    for text in ["2", "2:", "x:4", "2:-1", "2.x:4", "2:nan", ":"] {
        assert!(text.parse::<weldpath::run::job::resume::ResumeSettings>().is_err(), "{text}");
    }
}
