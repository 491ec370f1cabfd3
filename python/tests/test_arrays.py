"""Whatever an array looks like, the same numbers give the same plan, and what is no scan is named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import FIXTURES, views
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import weldpath


def points_of(cloud: Any, **named: Any) -> np.ndarray[Any, Any]:
    """The points that are read, in the base frame."""
    _, points, pose = weldpath.read(cloud, **named).views[0]
    return points @ pose[:3, :3].T + pose[:3, 3]


LAYOUTS = {
    "C order": lambda a: np.ascontiguousarray(a),
    "F order": lambda a: np.asfortranarray(a),
    "every other row": lambda a: np.repeat(a, 2, axis=0)[::2],
    "backwards": lambda a: a[::-1].copy()[::-1],
    "columns of a wider one": lambda a: np.hstack([np.ones((len(a), 2)), a, np.ones((len(a), 1))])[:, 2:5],
    "big-endian": lambda a: a.astype(">f8"),
    "read-only": lambda a: _locked(a),
    "lists": lambda a: a.tolist(),
    "with NaN rows": lambda a: np.insert(a, [0, 7, 7], np.nan, axis=0),
}


def _locked(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    array = array.copy()
    array.setflags(write=False)
    return array


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_layout_of_an_array_changes_nothing(layout: str, lap_cloud: np.ndarray[Any, Any]) -> None:
    cloud = lap_cloud.astype(np.float64)
    expected = points_of(cloud, units="mm", frame="base")
    assert np.array_equal(points_of(LAYOUTS[layout](cloud), units="mm", frame="base"), expected)


def test_metres_are_a_thousand_millimetres_and_a_guess_says_so(lap_cloud: np.ndarray[Any, Any]) -> None:
    in_mm = points_of(lap_cloud, units="mm", frame="base")
    in_m = points_of(lap_cloud / 1000.0, units="m", frame="base")
    assert np.abs(in_mm - in_m).max() < 1e-3
    guessed = weldpath.read(lap_cloud / 1000.0)
    assert any(note.startswith("units: metres (extent") for note in guessed.notes), guessed.notes
    doubtful = weldpath.read(lap_cloud * 40.0)
    assert any('units="' in warning for warning in doubtful.warnings), doubtful.warnings


def test_one_cloud_is_planned_and_its_frame_is_asked_for(lap_cloud: np.ndarray[Any, Any]) -> None:
    run = weldpath.plan(lap_cloud, units="mm")
    assert run.verdict.state == "check"
    assert "frame-unknown" in [one.id for one in run.verdict.reasons]
    assert len(run.seams) >= 1 and run.seams[0].joint == "lap"
    stated = weldpath.plan(lap_cloud, units="mm", frame="base")
    assert "frame-unknown" not in [one.id for one in stated.verdict.reasons]


def test_a_mesh_of_arrays_is_that_of_a_file(tmp_path: Any) -> None:
    class Mesh:
        """As Open3D's TriangleMesh looks."""

        def __init__(self, vertices: Any, triangles: Any) -> None:
            self.vertices, self.triangles = vertices, triangles

    vertices, triangles = corner()
    run = weldpath.plan(Mesh(vertices, triangles), units="mm", frame="base")
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    (tmp_path / "corner.obj").write_text("\n".join(lines))
    of_file = weldpath.plan(tmp_path / "corner.obj", units="mm", frame="base")
    assert [seam.length_mm for seam in run.seams] == [seam.length_mm for seam in of_file.seams]
    assert np.array_equal(run.paths[0].position_mm, of_file.paths[0].position_mm)
    with pytest.raises(weldpath.InputError, match="row 0"):
        weldpath.plan(Mesh(vertices, [[0, 1, 99]]))


def corner() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """A web of 10 mm on a plate, as boxes."""
    def box(low: tuple[float, ...], high: tuple[float, ...]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        at = np.array([[(low, high)[k >> axis & 1][axis] for axis in range(3)] for k in range(8)])
        quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        return at, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])

    (one, faces), (other, more) = box((-100, -60, -10), (100, 60, 0)), box((-80, -5, 0), (80, 5, 60))
    return np.vstack([one, other]), np.vstack([faces, more + len(one)])


def test_an_extrinsic_given_as_a_pose_is_found_out() -> None:
    made, shared = views(FIXTURES / "fillet")
    eye = np.array(shared["flange_from_camera"])
    from weldpath._arrays import rigid

    poses = [np.array(rigid(view.base_from_flange, "pose")) @ eye for view in made]
    fixed = [weldpath.View(view.depth, view.intrinsics, view.depth_scale_m, base_from_camera=pose)
             for view, pose in zip(made, poses)]
    right = weldpath.plan(fixed, units="m")
    assert right.verdict.state == "check" and len(right.seams) == 1
    inverse = [weldpath.View(view.depth, view.intrinsics, view.depth_scale_m, base_from_camera=np.linalg.inv(pose))
               for view, pose in zip(made, poses)]
    with pytest.raises(weldpath.InputError, match="camera_from_base"):
        weldpath.plan(inverse, units="m")
    extrinsic = [weldpath.View(view.depth, view.intrinsics, view.depth_scale_m, camera_from_base=np.linalg.inv(pose))
                 for view, pose in zip(made, poses)]
    same = weldpath.plan(extrinsic, units="m")
    assert np.allclose(same.paths[0].position_mm, right.paths[0].position_mm, atol=1e-3)


def test_a_depth_image_in_metres_is_the_one_in_counts() -> None:
    made, _ = views(FIXTURES / "lap")
    view = made[0]
    counts = weldpath.read(weldpath.View(view.depth, view.intrinsics, view.depth_scale_m))
    depth_m = (np.asarray(view.depth) * view.depth_scale_m).astype(np.float32)
    metres = weldpath.read(weldpath.View(depth_m, np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])))
    assert np.array_equal(counts.views[0][1], metres.views[0][1])


@pytest.mark.parametrize(
    ("source", "part"),
    [
        (np.zeros((0, 3)), "empty"),
        (np.zeros((5, 2)), r"\(5, 2\)"),
        (np.zeros(9), "N x 3"),
        (np.full((4, 3), np.nan), "holds no point"),
        (np.array([["a", "b", "c"]]), "not real numbers"),
        (np.zeros((3, 3), complex), "not real numbers"),
        ([], "a list cannot be planned|N x 3"),
        (7, "int cannot be planned"),
        ("no/such/scan", "no/such/scan"),
        (weldpath.View(), "depth or points"),
        (weldpath.View(np.ones((4, 4)), None), "intrinsics"),
        (weldpath.View(np.ones((4, 4), int), (9, 9, 2, 2)), "depth_scale_m"),
        (weldpath.View(np.full((4, 4), 70000), (9, 9, 2, 2), 0.001), "16 bits"),
        (weldpath.View(np.ones((4, 4)), (0, 9, 2, 2)), "fx"),
        (weldpath.View(points=np.ones((4, 3)), base_from_camera=np.eye(3)), "4 x 4"),
        (weldpath.View(points=np.ones((4, 3)), base_from_camera=2 * np.eye(4)), "base_from_camera"),
        (weldpath.View(points=np.ones((4, 3)), base_from_camera=np.full((4, 4), np.nan)), "base_from_camera"),
        (weldpath.View(points=np.ones((4, 3)), base_from_camera=np.eye(4), base_from_flange=np.eye(4)), "one pose"),
        ([weldpath.View(points=np.ones((4, 3)))] * 2, r"views\[0\]"),
    ],
)
def test_what_is_no_scan_is_named(source: Any, part: str) -> None:
    with pytest.raises(weldpath.InputError, match=part):
        weldpath.plan(source)


NUMBERS = st.floats(width=32) | st.floats(-500.0, 500.0, width=32)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    cloud=arrays.arrays(
        st.sampled_from(["<f4", ">f4", "<f8", "<i4", "<u2"]),
        st.tuples(st.integers(0, 40), st.just(3)) | st.tuples(st.integers(0, 6), st.integers(0, 6), st.just(3)),
    ),
    units=st.sampled_from(["auto", "m", "mm"]),
    scale=st.sampled_from([1.0, 1e-3, 1e12]),
)
def test_no_array_is_more_than_an_error_of_ours(cloud: Any, units: Any, scale: float) -> None:
    try:
        with np.errstate(all="ignore"):
            weldpath.plan(cloud * scale if scale != 1.0 else cloud, units=units)
    except weldpath.WeldpathError as error:
        assert str(error)


def test_the_papers_quantities_are_those_of_its_equations() -> None:
    # Two faces at a right angle, a point each millimetre.
    u, v = (axis.ravel().astype(float) for axis in np.meshgrid(np.arange(-20, 21), np.arange(1, 21)))
    cloud = np.vstack([np.column_stack([u, v, 0 * v]), np.column_stack([u, 0 * v, v])]) + [1e4, -2e4, 500.0]
    normals = weldpath.normals(cloud, 3.0)
    amid = (np.abs(cloud[:, 0] - 1e4) < 10) & (cloud[:, 2] == 500.0) & (cloud[:, 1] > -2e4 + 10)
    assert np.allclose(np.abs(normals[amid]) @ [0, 0, 1], 1.0, atol=1e-4)
    scores = weldpath.edge_scores(cloud, 5.0)
    # Eq. (12) by hand for one point: the mean offset of all within the radius, over the radius.
    for k in (0, 400, 830, 1200):
        offset = cloud - cloud[k]
        near = (offset**2).sum(axis=1) < 25.0
        assert scores.intensity[k] == pytest.approx(np.linalg.norm(offset[near].mean(axis=0)) / 5.0, abs=1e-4)
    edge = (cloud[:, 1] + cloud[:, 2] < -2e4 + 500 + 2) & (np.abs(cloud[:, 0] - 1e4) < 10)
    assert scores.intensity[edge].min() > 3 * scores.intensity[amid].min()
    assert np.nanmin(scores.ratio) >= 27.0 - 1e-3
    noisy = cloud + np.random.default_rng(1).normal(0.0, 0.3, cloud.shape)
    flat = np.abs(np.sign(normals @ [0, 1, 1])[:, None] * normals)
    smooth = weldpath.bilateral(noisy, flat, radius_mm=4.0, distance_mm=2.0, height_mm=1.0)
    assert np.abs(smooth[amid, 2] - 500.0).mean() < 0.7 * np.abs(noisy[amid, 2] - 500.0).mean()
    for bad in (np.nan, 0.0, -1.0):
        with pytest.raises(weldpath.InputError, match="radius_mm"):
            weldpath.edge_scores(cloud, bad)
    for far in (np.nan, 1e300):
        with pytest.raises(weldpath.InputError, match="not finite"):
            weldpath.normals(np.full((3, 3), far), 3.0)
    with pytest.raises(weldpath.InputError, match="no Scan"):
        weldpath.register(cloud)  # type: ignore[arg-type]


class Like:
    """An object with these attributes, as Open3D's are used here."""

    def __init__(self, **attributes: Any) -> None:
        vars(self).update(attributes)


SQUARE = [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0]]


@pytest.mark.parametrize(
    ("source", "named", "part"),
    [
        ([np.ones((5, 3)), np.ones((5, 3))], {}, "a list of clouds"),
        (np.ones((5, 3)), {"base_from_camera": np.eye(4), "frame": "base"}, 'frame="base"'),
        (np.ones((5, 3)), {"base_from_camera": np.eye(4), "camera_mm": (0, 0, 9)}, "camera_mm"),
        (Like(vertices=SQUARE, triangles=[[0, 1, -1]]), {}, "-1 is not an index"),
        (Like(vertices=SQUARE, triangles=[[0, 1, 2]]), {"base_from_camera": np.eye(4)}, "a mesh has"),
        (Like(points=SQUARE, lines=[[0, 1]]), {}, "cannot be planned"),
        (weldpath.View(np.ones((4, 4)), Like(intrinsic_matrix=np.eye(3), width=8, height=4)), {}, "8 x 4"),
        (weldpath.View(np.full((4, 4), 520.3), (9, 9, 2, 2)), {}, "metres are expected"),
        ([weldpath.View(points=SQUARE, base_from_camera=np.eye(4))], {"flange_from_camera": np.eye(4)}, "flange"),
        (weldpath.View(points=SQUARE, base_from_camera=[[1, 2], [3]]), {}, "base_from_camera"),
    ],
)
def test_what_contradicts_itself_is_refused(source: Any, named: dict[str, Any], part: str) -> None:
    with pytest.raises(weldpath.InputError, match=part):
        weldpath.plan(source, **named)


def test_what_is_masked_is_no_reading(lap_cloud: np.ndarray[Any, Any]) -> None:
    cloud = lap_cloud.astype(np.float64)
    hidden = np.zeros(cloud.shape, bool)
    hidden[::3] = True
    spoilt = np.where(hidden, 77.0, cloud)
    read = points_of(np.ma.masked_array(spoilt, hidden), units="mm", frame="base")
    assert np.abs(read - points_of(cloud[~hidden[:, 0]], units="mm", frame="base")).max() < 1e-3


def test_arrays_are_shown_by_their_shapes() -> None:
    run = weldpath.plan(FIXTURES / "lap")
    for shown in (run.paths, run.seams[0], run.model, run.views, views(FIXTURES / "lap")[0][0]):
        assert len(repr(shown)) < 1500, repr(shown)
    assert repr(run) == "<weldpath.Run: check, 1 seam>"


def test_the_usual_mistakes_with_a_cameras_pose_are_named() -> None:
    from weldpath._arrays import rigid

    made, shared = views(FIXTURES / "fillet")
    eye = np.array(shared["flange_from_camera"])
    poses = [np.array(rigid(view.base_from_flange, "pose")) @ eye for view in made]

    def plan(poses: list[Any], units: Any = "m", **changed: Any) -> str:
        told = [weldpath.View(**{**vars(view), "base_from_flange": None, "base_from_camera": pose, **changed})
                for view, pose in zip(made, poses)]
        with pytest.raises(weldpath.InputError) as caught:
            weldpath.plan(told, units=units)
        return str(caught.value)

    opengl = np.diag([1.0, -1.0, -1.0, 1.0])
    assert "OpenGL" in plan([pose @ opengl for pose in poses])
    assert "belongs to the pose" in plan(poses[1:] + poses[:1])
    assert "in metres and not in millimetres" in plan(poses, units="mm")
    turned = [np.block([[pose[:3, :3].T, pose[:3, 3:]], [np.zeros((1, 3)), np.ones((1, 1))]]) for pose in poses]
    assert "transposed" in plan(turned)
    assert "each step of the images is" in plan(poses, depth_scale_m=made[0].depth_scale_m * 10)


def test_normals_that_are_no_numbers_are_none(lap_cloud: np.ndarray[Any, Any]) -> None:
    bare = weldpath.plan(lap_cloud, units="mm", frame="base")
    with_nan = weldpath.plan(lap_cloud, units="mm", frame="base", normals=np.full(lap_cloud.shape, np.nan))
    assert np.array_equal(bare.paths[0].position_mm, with_nan.paths[0].position_mm)


def test_the_limit_of_memory_is_that_of_one_reading() -> None:
    points = np.random.default_rng(1).uniform(size=(1_100_000, 3)).astype(np.float32)
    with pytest.raises(weldpath.InputError, match="limit of memory_mb"):
        weldpath.read(points, units="m", memory_mb=64)
    assert weldpath.read(points[:100_000], units="m", memory_mb=64).views
