//! Poses that are all wrong alike: the table that the part stands on covers itself all the same, and the part does not.

use std::path::Path;

use nalgebra::Isometry3;
use weldpath::output::verdict::{ReasonId, State};
use weldpath::run::job::Job;
use weldpath::simulation::{CellErrors, MeshRequest, Noise, simulate_mesh};
use weldpath_tests::scans::{Outcome, block, of_mesh, read};

/// A cell that is as exact as the job states.
const CELL: CellErrors = CellErrors {
    hand_eye_mm: 0.5,
    hand_eye_deg: 0.1,
    robot_mm: 0.1,
    robot_deg: 0.03,
    first_exact: false,
    seed: None,
};
const JOB: &str = "accept = [\"tool-not-stated\", \"torch-collision\"]\n\
                   [scan]\nrobot_mm = 0.1\nrobot_deg = 0.03\nhand_eye_mm = 0.5\nhand_eye_deg = 0.1\n";

/// A web on a plate on a table, looked at from all round, with each camera moved.
fn verdict(seed: u64, moved: impl Fn(&Isometry3<f64>) -> Isometry3<f64>) -> (State, Vec<ReasonId>) {
    let web = [block([0.0; 3], [160.0, 110.0, 8.0]), block([10.0, 52.0, 8.0], [150.0, 58.0, 60.0])].concat();
    let request = MeshRequest { noise: Noise::Low, cell: Some(CELL), ..of_mesh("web", web, 5, seed) };
    let simulated = simulate_mesh(&request).expect("a scan");
    let mut scan = read(&simulated);
    scan.views.iter_mut().for_each(|view| view.base_from_camera = moved(&view.base_from_camera));
    let job = Job::parse(JOB, Path::new("job.toml")).expect("a job");
    let outcome = Outcome::of(&scan, &simulated.truth, &job);
    let verdict = outcome.verdict();
    (verdict.state, verdict.reasons.iter().map(|reason| reason.id).collect())
}

#[test]
fn a_part_that_lies_at_another_place_of_its_table_in_each_view_is_refused() {
    let seed = 7;
    let (state, reasons) = verdict(seed, |pose| *pose);
    assert!(state != State::Refused && !reasons.contains(&ReasonId::PosesScatter), "{reasons:?}");
    // A hand-eye transform without its translation, a tool's poses in place of the flange's, another camera's transform.
    for shift_mm in [[35.0, -92.0, 61.0], [0.0, 0.0, 100.0], [28.0, 28.0, 0.0]] {
        let shift = Isometry3::translation(shift_mm[0], shift_mm[1], shift_mm[2]);
        let (state, reasons) = verdict(seed, |pose| pose * shift);
        assert_eq!(state, State::Refused, "{shift_mm:?}: {reasons:?}");
    }
}

#[test]
fn poses_that_scatter_more_than_the_robot_that_is_stated_are_named() {
    // 10 mm: the views fit each other once they are moved, and the path would be as far off.
    let (state, reasons) = verdict(9, |pose| pose * Isometry3::translation(0.0, 10.0, 0.0));
    assert!(state != State::Ready, "{reasons:?}");
    assert!(
        reasons
            .iter()
            .any(|id| [ReasonId::PosesScatter, ReasonId::ViewsDisagree, ReasonId::HandEyeWrong].contains(id)),
        "{reasons:?}"
    );
}
