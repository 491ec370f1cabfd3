"""From scans of a workpiece to the motion of a welding torch.

    import weldpath

    run = weldpath.plan(weldpath.samples.cell(), job=weldpath.samples.cell_job())
    print(run.verdict)
    print(run.seams)
    run.write("out", robot=["ur", "abb"])

Positions are millimetres in the robot's base frame, quaternions x y z w, transforms `to_from` (`base_from_camera` takes a point
of the camera's frame to the base's).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from . import _weldpath, samples
from ._input import Given, JobLike, Scan, Source, Units, View, names, scan_of
from ._run import Model, Program, Reason, RegisteredView, Run, Seam, Seams, TorchPath, Verdict
from ._stages import (
    EdgeScores,
    Registration,
    bilateral,
    edge_scores,
    evaluate,
    normals,
    register,
    simulate,
)
from ._weldpath import (
    InputError,
    InternalError,
    JobError,
    NoSeam,
    OutputError,
    Refused,
    Unconfirmed,
    WeldpathError,
    __version__,
)

__all__ = [
    "EdgeScores",
    "InputError",
    "InternalError",
    "JobError",
    "Model",
    "NoSeam",
    "OutputError",
    "Program",
    "Reason",
    "Refused",
    "RegisteredView",
    "Registration",
    "Run",
    "Scan",
    "Seam",
    "Seams",
    "TorchPath",
    "Unconfirmed",
    "Verdict",
    "View",
    "WeldpathError",
    "__version__",
    "bilateral",
    "edge_scores",
    "evaluate",
    "normals",
    "plan",
    "read",
    "register",
    "samples",
    "simulate",
]


def read(
    source: Source,
    *,
    units: Units = "auto",
    base_from_camera: object = None,
    flange_from_camera: object = None,
    flange_from_tcp: object = None,
    normals: object = None,
    frame: str | None = None,
    camera_mm: Sequence[float] | None = None,
    job: JobLike = None,
    allow_outside: bool = False,
    memory_mb: int | None = None,
    threads: int | None = None,
) -> Scan:
    """Reads a scan without planning it: see `plan`, whose arguments these are."""
    given = Given(
        units, base_from_camera, flange_from_camera, flange_from_tcp, normals, frame, camera_mm, allow_outside, memory_mb,
        threads,
    )
    scan, _ = scan_of(source, job, given, {})
    return Scan(scan)


def plan(
    source: Source,
    *,
    units: Units = "auto",
    base_from_camera: object = None,
    flange_from_camera: object = None,
    flange_from_tcp: object = None,
    normals: object = None,
    frame: str | None = None,
    camera_mm: Sequence[float] | None = None,
    job: JobLike = None,
    accept: Iterable[str] | None = (),
    robot: Sequence[str] | None = None,
    allow_outside: bool = False,
    memory_mb: int | None = None,
    threads: int | None = None,
    progress: Callable[[str], object] | None = None,
) -> Run:
    """Finds the seams of a scan and plans a torch path along each.

    source
        A path (what `weldpath plan` reads); an array of points, N x 3, or H x W x 3 of an organised cloud, of any type, order and
        stride, those that are not finite dropped; a `View` or a list of them; a `Scan` that `read` made; an Open3D cloud or mesh.
    units
        "m" or "mm": unit of an array's points, and of the positions in poses. "auto" takes what the file says, guesses by the size
        of one cloud, and takes views as metres; each guess is a warning.
    base_from_camera
        Pose of the camera that took an array of points, 4 x 4. Without one the points are in the frame of the robot's base if
        `frame` says so, else in their camera's or in an unknown one: the verdict says which.
    flange_from_camera, flange_from_tcp
        Hand-eye transform and TCP, for views with poses of the flange or the tool.
    normals
        N x 3, of an array of points; not needed.
    frame, camera_mm
        "base" or "camera": whose coordinates an array of points has. Where the camera stood in them, mm.
    job
        A job.toml, or its settings as a mapping: `{"path": {"standoff_mm": 12}, "torch": {"work_angle_deg": 5}}` (docs/formats.md).
    accept
        Ids of reasons that are known to be harmless here.
    robot
        For which controllers programs are written: "ur", "abb", "kuka", "fanuc", "ros".
    memory_mb
        What reading and planning may take at most; half of the machine's memory, if not said. What needs more is an `InputError`.
    threads
        As many as the machine has, if not said; at most twice as many.
    progress
        Called with the name of each stage as it begins. What it raises ends the plan, as Ctrl-C does.

    Raises `InputError`, `JobError` or `NoSeam`. A refused plan is returned: it has seams and a report to look at, and no path.
    """
    given = Given(
        units, base_from_camera, flange_from_camera, flange_from_tcp, normals, frame, camera_mm, allow_outside, memory_mb,
        threads,
    )
    overrides = {"accept": names(accept, "accept") or None, "formats": names(robot, "robot")}
    scan, settled = scan_of(source, job, given, overrides)
    return Run(_weldpath.plan(scan, settled, threads, progress), threads)
