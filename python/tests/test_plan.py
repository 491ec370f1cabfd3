"""A plan from arrays is that of the command from files; what is withheld is withheld."""

from __future__ import annotations

import csv
import json
import multiprocessing
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIXTURES, NAMES, views
from scipy.spatial.transform import Rotation

import weldpath


def by_command(folder: Path, out: Path) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """What the command makes of a fixture: its summary, and the rows of its path."""
    arguments = [sys.executable, "-m", "weldpath", "plan", str(folder), "--out", str(out), "--quiet", "--no-cache"]
    done = subprocess.run([*arguments, "--no-report"], capture_output=True, text=True)
    assert done.returncode in (0, 8), done.stderr
    with (out / "path.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return json.loads((out / "summary.json").read_text()), rows


def told(summary: dict[str, Any]) -> dict[str, Any]:
    """What a summary says but for names, words and times."""
    keep = ("id", "joint", "selected", "closed", "points", "passes", "order", "positions")
    return {
        "state": summary["verdict"]["state"],
        "reasons": [(one["id"], one["seam"]) for one in summary["verdict"]["reasons"]],
        "frame": summary["frame"],
        "seams": [{key: seam[key] for key in keep} for seam in summary["seams"]],
    }


def numbers(summary: dict[str, Any]) -> list[float | None]:
    """What it measured and derived."""
    keys = ("length_mm", "confidence", "expected_error_mm", "expected_error_deg", "relative_mm")
    of_seams = [seam[key] for seam in summary["seams"] for key in keys]
    return [*of_seams, *(one["value"] for one in summary["derived"])]


@pytest.mark.parametrize("name", NAMES)
def test_files_and_arrays_give_the_plan_of_the_command(name: str, tmp_path: Path) -> None:
    summary, rows = by_command(FIXTURES / name, tmp_path)
    arrays, shared = views(FIXTURES / name)
    for run in (weldpath.plan(FIXTURES / name), weldpath.plan(arrays, **shared)):
        assert told(run.summary) == told(summary)
        assert numbers(run.summary) == pytest.approx(numbers(summary), rel=1e-9)
        position = np.concatenate([path.position_mm for path in run.paths])
        turn = np.concatenate([path.quaternion_xyzw for path in run.paths])
        expected = np.array([[float(row[key]) for key in ("x_mm", "y_mm", "z_mm")] for row in rows])
        wxyz = np.array([[float(row[key]) for key in ("qw", "qx", "qy", "qz")] for row in rows])
        # As path.csv is written: 0.1 micrometres, nine digits of a quaternion.
        assert np.abs(position - expected).max() < 1e-4
        assert np.abs(turn - wxyz[:, [1, 2, 3, 0]]).max() < 1e-7


def test_a_plate_has_no_seam_and_says_what_was_seen() -> None:
    with pytest.raises(weldpath.NoSeam, match="no seam found: "):
        weldpath.plan(FIXTURES / "plate")


def test_rotations_are_those_of_scipy() -> None:
    path = weldpath.plan(FIXTURES / "pipe").paths[0]
    assert np.allclose(path.rotation, Rotation.from_quat(path.quaternion_xyzw).as_matrix(), atol=1e-12)
    # Along the travel is the second column.
    step = np.diff(path.position_mm, axis=0)
    along = np.einsum("ij,ij->i", step / np.linalg.norm(step, axis=1)[:, None], path.rotation[:-1, :, 1])
    assert np.median(along) > 0.99


def test_what_is_to_be_checked_gives_a_program_only_to_who_confirms() -> None:
    run = weldpath.plan(FIXTURES / "fillet")
    assert run.verdict.state == "check"
    with pytest.raises(weldpath.Unconfirmed) as caught:
        run.programs()
    reasons = caught.value.reasons
    assert "tool-not-stated" in reasons
    with pytest.raises(weldpath.Unconfirmed) as caught:
        run.program(confirm=reasons[1:])
    assert caught.value.reasons == reasons[:1]
    program = run.program(confirm=reasons)
    assert program.kind[0] in ("air", "approach") and program.arc.any() and not program.arc[0]
    assert list(run.programs(["ur", "fanuc"], confirm=reasons)) == ["path.json", "path.script", "weldpath.ls"]
    accepted = weldpath.plan(FIXTURES / "fillet", accept=reasons)
    assert accepted.verdict.state == "ready"
    assert accepted.programs(confirm=())["path.script"]


def test_a_refused_plan_shows_its_seams_and_hands_out_no_path(tmp_path: Path) -> None:
    # The hand-eye transform is turned: the views do not belong together.
    arrays, shared = views(FIXTURES / "fillet")
    eye = np.array(shared["flange_from_camera"])
    eye[:3, 3] += [0.0, 0.18, 0.0]
    try:
        run = weldpath.plan(arrays, units="m", flange_from_camera=eye)
    except (weldpath.InputError, weldpath.NoSeam):
        pytest.fail("expected a plan that is refused")
    assert run.verdict.state == "refused" and len(run.seams) > 0 and len(run.model.points_mm) > 1000
    for hand_out in (lambda: run.paths, run.program, run.programs):
        with pytest.raises(weldpath.Refused) as caught:
            hand_out()
        assert set(caught.value.reasons) & {one.id for one in run.verdict.reasons}
    names = {file.name for file in run.write(tmp_path / "out").iterdir()}
    assert "report.html" in names and not names & {"path.json", "path.script"}


def test_a_job_is_a_mapping_or_a_file_and_its_mistakes_are_named(tmp_path: Path) -> None:
    settings = {"path": {"standoff_mm": np.float32(12.0)}, "selection": {"seams": [1]}, "order": None}
    run = weldpath.plan(FIXTURES / "pipe", job=settings)
    (tmp_path / "job.toml").write_text("[path]\nstandoff_mm = 12\n[selection]\nseams = [1]\n")
    of_file = weldpath.plan(FIXTURES / "pipe", job=tmp_path / "job.toml")
    assert np.array_equal(run.paths[0].position_mm, of_file.paths[0].position_mm)
    assert "standoff_mm = 12.0" in run.job
    for job in ({"path": {"feed_mm_min": 400}}, {"path": {"feed_mm_s": -1}}, {"accept": ["drawn"]}, {"x": object()}):
        with pytest.raises(weldpath.JobError):
            weldpath.plan(FIXTURES / "pipe", job=job)
    with pytest.raises(weldpath.JobError, match="did you mean `feed_mm_s`"):
        weldpath.plan(FIXTURES / "pipe", job={"path": {"feed_mm_min": 400}})
    with pytest.raises(weldpath.JobError, match="none.toml"):
        weldpath.plan(FIXTURES / "pipe", job=tmp_path / "none.toml")


def test_a_folder_keeps_what_others_wrote(tmp_path: Path) -> None:
    run = weldpath.plan(FIXTURES / "lap")
    (tmp_path / "path.csv").write_text("mine")
    with pytest.raises(weldpath.OutputError, match="path.csv"):
        run.write(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["path.csv"]
    run.write(tmp_path, overwrite=True)
    assert (tmp_path / "path.csv").read_text() != "mine" and (tmp_path / "report.html").exists()


def test_ctrl_c_ends_a_plan_within_half_a_second() -> None:
    # A shell that starts the tests in the background has them ignore it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    arrays, shared = views(FIXTURES / "pipe")
    # Four times the points: long enough to be interrupted.
    big = [weldpath.View(**{**vars(view), "depth": np.kron(view.depth, np.ones((2, 2), np.uint16)),
                            "intrinsics": [2 * v for v in view.intrinsics]}) for view in arrays]
    pressed: list[float] = []

    def press() -> None:
        import _thread

        pressed.append(time.monotonic())
        _thread.interrupt_main()

    stages: list[str] = []

    def progress(stage: str) -> None:
        stages.append(stage)
        if stage == "reconstruction":
            threading.Timer(0.1, press).start()

    try:
        with pytest.raises(KeyboardInterrupt):
            weldpath.plan(big, progress=progress, **shared)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - pressed[0] < 0.5
    assert stages[0] == "normals"


def test_a_scan_is_planned_as_it_was_read() -> None:
    scan = weldpath.read(FIXTURES / "lap")
    run = weldpath.plan(scan, job={"path": {"standoff_mm": 5}})
    of_file = weldpath.plan(FIXTURES / "lap", job={"path": {"standoff_mm": 5}})
    assert np.array_equal(run.paths[0].position_mm, of_file.paths[0].position_mm)
    with pytest.raises(weldpath.InputError, match="units: the scan is read"):
        weldpath.plan(scan, units="mm")
    with pytest.raises(ValueError, match="read-only"):
        run.seams[0].position_mm[0] = 0.0


def test_what_progress_raises_is_raised() -> None:
    def progress(stage: str) -> None:
        raise LookupError(stage)

    with pytest.raises(LookupError, match="normals"):
        weldpath.plan(FIXTURES / "lap", progress=progress)


def test_the_interpreter_goes_on_while_a_plan_is_made() -> None:
    counted = 0
    done = threading.Event()

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0.002)

    thread = threading.Thread(target=count)
    thread.start()
    begun = time.monotonic()
    weldpath.plan(FIXTURES / "lap", threads=1)
    took = time.monotonic() - begun
    done.set()
    thread.join()
    assert counted > took / 0.002 / 20


def _length(folder: str) -> float:
    return weldpath.plan(folder).seams[0].length_mm


def test_it_works_after_a_fork() -> None:
    here = _length(str(FIXTURES / "lap"))
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(_length, (str(FIXTURES / "lap"),)).get(timeout=60) == here


def test_threads_do_not_change_the_plan() -> None:
    one, two = (weldpath.plan(FIXTURES / "lap", threads=count).paths[0].position_mm for count in (1, 2))
    assert np.array_equal(one, two)


def test_what_a_notebook_shows() -> None:
    run = weldpath.plan(FIXTURES / "lap")
    table = run.seams._repr_html_()
    assert table.count("<tr>") == 1 + len(run.seams) and "lap" in table
    assert run._repr_html_().startswith("<p><b>verdict: ")
    assert "seam" in repr(run.seams)
    assert "<html" in run.report_html()[:500]
    view = run.views[0]
    assert view.left_out is None and np.allclose(view.base_from_camera[:3, :3] @ view.base_from_camera[:3, :3].T, np.eye(3))


def test_a_simulated_scan_is_planned_and_held_against_its_truth(tmp_path: Path) -> None:
    folder = weldpath.simulate("fillet", tmp_path / "scan", seed=3, noise="low", views=4)
    run = weldpath.plan(folder, job=folder / "cell.toml")
    score = weldpath.evaluate(run.write(tmp_path / "out"), folder / "truth.json")
    assert 0.0 < score["rmse_p"] < 0.5 and score["coverage"] > 0.9
    with pytest.raises(weldpath.WeldpathError, match="filet"):
        weldpath.simulate("filet", tmp_path / "other")


@pytest.mark.parametrize(
    ("named", "part"),
    [
        ({"job": 5}, "a int is neither"),
        ({"job": {"path": {"standoff_mm": float("nan")}}}, r"job.path.standoff_mm: nan"),
        ({"job": {"path": 5}}, "job: .*expected a table"),
        ({"job": {"path": {"feed_mm_s": [1]}}}, "expected a number"),
        ({"job": {"input": "other"}}, "first argument"),
        ({"accept": ["nothing"]}, "nothing"),
        ({"accept": 3}, "accept: 3"),
        ({"robot": "bla"}, "bla"),
        ({"threads": -1}, "threads: -1"),
        ({"threads": "2"}, "threads: '2'"),
        ({"memory_mb": 8}, "memory_mb: 8"),
    ],
)
def test_a_setting_that_cannot_be_is_named_as_it_was_given(named: dict[str, Any], part: str) -> None:
    with pytest.raises(weldpath.JobError, match=part):
        weldpath.plan(FIXTURES / "lap", **named)


def test_names_may_stand_alone() -> None:
    run = weldpath.plan(FIXTURES / "lap", accept="tool-not-stated", robot="abb", threads=10**6)
    assert "tool-not-stated" in [one.id for one in run.verdict.reasons if one.accepted]
    with pytest.raises(weldpath.JobError, match="bla"):
        run.programs("bla", confirm=[])
