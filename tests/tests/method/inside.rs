//! Where no torch gets in: what is listed, what is welded, and what changes it.

use std::path::Path;

use weldpath::output::verdict::{ReasonId, State};
use weldpath::pipeline::Plan;
use weldpath::run::job::Job;
use weldpath::run::planning::{self, Allowed};
use weldpath::run::postprocessing::{Output, postprocess};
use weldpath_tests::solids::Solids;

/// A plate of 600 mm whose upper face is z = 0.
fn on_a_plate() -> Solids {
    Solids::default().cuboid([-300.0, -300.0, -10.0], [300.0, 300.0, 0.0])
}

fn planned(solids: &Solids, job: &str) -> (Plan, Output) {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("part.stl");
    solids.write(&path);
    let job = Job { input: Some(path), ..Job::parse(job, Path::new("job.toml")).unwrap() };
    let scan = planning::read(&job, Allowed::default()).unwrap();
    let plan = planning::plan(&scan, &job, &mut ()).unwrap();
    let output = postprocess(&plan, &job, planning::source(&scan, &job)).unwrap();
    (plan, output)
}

/// Lengths of what is welded, and of what is left out since it is inside, mm, each in order.
fn lengths((plan, output): &(Plan, Output)) -> [Vec<f64>; 2] {
    let left = output.summary.verdict().reasons.iter().filter(|reason| reason.id == ReasonId::LeftOut);
    let left = left.filter_map(|reason| reason.seam).collect::<Vec<_>>();
    let of = |is: &dyn Fn(usize) -> bool| {
        let mut lengths: Vec<f64> =
            plan.paths.iter().filter(|path| is(path.seam)).map(|path| path.length_mm()).collect();
        lengths.sort_by(f64::total_cmp);
        lengths
    };
    let welded = |id: usize| output.paths.iter().any(|path| path.seam == id);
    [of(&welded), of(&|id| left.contains(&id))]
}

fn are(found: &[f64], right: &[f64]) -> bool {
    found.len() == right.len()
        && found.iter().zip(right).all(|(found, right)| (found - right).abs() < 0.03 * right)
}

/// Round a circle of this radius, mm.
fn round(radius_mm: f64) -> f64 {
    std::f64::consts::TAU * radius_mm
}

#[test]
fn the_foot_inside_a_narrow_pipe_is_left_out_and_inside_a_wide_one_it_stays() {
    let pipe =
        |inner: f32, job: &str| planned(&on_a_plate().tube([inner, inner + 5.0], [0.0, 100.0], 48), job);
    let narrow = pipe(20.0, "");
    let [welded, left] = lengths(&narrow);
    assert!(are(&welded, &[round(25.0)]) && are(&left, &[round(20.0)]), "{welded:?} {left:?}");
    assert_eq!(narrow.1.summary.verdict().state, State::Check);

    let [welded, left] = lengths(&pipe(150.0, ""));
    assert!(are(&welded, &[round(150.0), round(155.0)]) && left.is_empty(), "{welded:?} {left:?}");

    // The job names it, in whatever way; or it has a torch that gets in.
    let id = narrow.0.paths.iter().find(|path| path.length_mm() < round(22.0)).unwrap().seam;
    let slim = "nozzle_radius_mm = 3\nnozzle_length_mm = 150\nbody_radius_mm = 5\nstickout_mm = 20";
    for (job, count) in [
        (format!("[selection]\nseams = [{id}]"), 1),
        (format!("[[seam]]\nid = {id}\n"), 2),
        (format!("[torch_body]\n{slim}"), 2),
    ] {
        let [welded, left] = lengths(&pipe(20.0, &job));
        assert!(welded.len() == count && left.is_empty(), "{job}: {welded:?} {left:?}");
    }
}

#[test]
fn corners_of_a_closed_section_are_left_out_and_those_of_an_open_frame_stay() {
    // Walls of 120 by 5 mm around 60 by 60 mm, upright on the plate; then only two of them, then all around 400 by 400 mm.
    let walls = |side: f32, all: bool| {
        let (far, wall) = (side / 2.0 + 5.0, side / 2.0);
        let solids = on_a_plate()
            .cuboid([-far, -far, 0.0], [far, -wall, 120.0])
            .cuboid([-far, -far, 0.0], [-wall, far, 120.0]);
        match all {
            true => solids
                .cuboid([wall, -wall, 0.0], [far, wall, 120.0])
                .cuboid([-far, wall, 0.0], [far, far, 120.0]),
            false => solids,
        }
    };
    let [welded, left] = lengths(&planned(&walls(60.0, true), ""));
    assert!(!welded.is_empty() && welded.iter().all(|mm| *mm < 75.0), "the outer foot: {welded:?}");
    let inside = |mm: f64| left.iter().filter(|left| (**left - mm).abs() < 0.03 * mm).count();
    assert_eq!((inside(120.0), inside(60.0)), (4, 4), "{left:?}");

    let [welded, left] = lengths(&planned(&walls(60.0, false), ""));
    assert!(left.is_empty() && welded.iter().any(|mm| (mm - 120.0).abs() < 6.0), "{welded:?} {left:?}");
    let [welded, left] = lengths(&planned(&walls(400.0, true), ""));
    assert!(left.is_empty(), "{left:?}");
    // A seam ends at the wall across it, even where its own faces go on inside that wall.
    let count = |mm: f64| welded.iter().filter(|found| (**found - mm).abs() < 1.0).count();
    assert_eq!((count(120.0), count(400.0)), (4, 4), "{welded:?}");
}
