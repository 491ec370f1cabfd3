"""What is planned: files, arrays, views, Open3D's objects."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Union

import numpy as np
import numpy.typing as npt

from . import _arrays, _weldpath
from ._arrays import Floats, Singles
from ._weldpath import InputError, JobError

Units = Literal["auto", "m", "mm"]
"""Unit of coordinates and of the positions in poses."""

PathLike = Union[str, "os.PathLike[str]"]
JobLike = Union[PathLike, Mapping[str, Any], None]

_POSES = ("base_from_camera", "camera_from_base", "base_from_flange", "flange_from_base", "base_from_tcp")


@dataclass(frozen=True, eq=False, repr=False)
class View(_arrays.Short):
    """What a camera saw from one pose: a depth image or points, in the camera's frame (x right, y down, z forward).

    Give `depth` with `intrinsics`, or `points`. Of the poses give one, or none if there is only one view; a pose is a 4 x 4
    matrix or `(x, y, z, rx, ry, rz)` with a rotation vector in rad, its position in the `units` of the plan.

    Open3D calls `camera_from_base` the extrinsic.
    """

    depth: object = None
    """H x W: whole numbers of `depth_scale_m` each (0 and 65535 are no readings), or metres as floating point (NaN and 0 are
    none); an Open3D image or RGBD image."""
    intrinsics: object = None
    """fx, fy, cx, cy in pixels, and k1, k2, p1, p2, k3 of a lens that distorts (OpenCV's order); a 3 x 3 matrix; or an Open3D
    `PinholeCameraIntrinsic`."""
    depth_scale_m: float | None = None
    """Metres in one count of a depth image of whole numbers, often 0.001."""
    points: object = None
    """N x 3, or H x W x 3 of an organised cloud."""
    normals: object = None
    """N x 3, of any length; not needed."""
    base_from_camera: object = None
    camera_from_base: object = None
    base_from_flange: object = None
    """With `flange_from_camera` of the plan."""
    flange_from_base: object = None
    base_from_tcp: object = None
    """With `flange_from_tcp` of the plan as well."""
    name: str | None = None
    """For messages."""

    def _raw(self) -> _weldpath.RawView:
        if (self.depth is None) == (self.points is None):
            raise InputError("a view has depth or points, one of the two")
        raw = self._of_points() if self.depth is None else self._of_depth()
        poses = [(name, getattr(self, name)) for name in _POSES if getattr(self, name) is not None]
        if len(poses) > 1:
            raise InputError(f"a view has one pose, and {' and '.join(name for name, _ in poses)} are given")
        for name, pose in poses:
            raw = raw.posed(name, _arrays.rigid(pose, name))
        return raw if self.name is None else raw.named(self.name)

    def _of_points(self) -> _weldpath.RawView:
        points, normals, faces = _of_open3d(self.points) or (self.points, None, None)
        if faces is not None:
            raise InputError("a view holds points that a camera saw; plan a mesh by itself")
        given = normals if self.normals is None else self.normals
        return _weldpath.RawView.of_cloud(_cloud(points, given, None))

    def _of_depth(self) -> _weldpath.RawView:
        depth = _arrays.numbers(getattr(self.depth, "depth", self.depth), "depth")
        if depth.ndim == 3 and depth.shape[-1] == 1:
            depth = depth[..., 0]
        if depth.ndim != 2:
            raise InputError(f"depth: the shape is {depth.shape}; give H x W")
        if self.intrinsics is None:
            raise InputError("depth needs intrinsics: fx, fy, cx, cy in pixels")
        height, width = depth.shape
        lens = getattr(self.intrinsics, "intrinsic", self.intrinsics)
        size = (getattr(lens, "width", width), getattr(lens, "height", height))
        if size != (width, height) and all(size):
            raise InputError(f"depth is {width} x {height}, and the intrinsics are those of an image of {size[0]} x {size[1]}")
        scale = self.depth_scale_m
        if depth.dtype.kind in "iu":
            if scale is None:
                raise InputError("depth: whole numbers need depth_scale_m, the metres in one of them, often 0.001")
            if depth.size and (depth.min() < 0 or depth.max() > 65535):
                raise InputError(f"depth: {depth.min()} to {depth.max()} are not counts of 16 bits")
            data = np.ascontiguousarray(depth, dtype="<u2").tobytes()
        else:
            if scale not in (None, 1.0):
                raise InputError("depth: floating point is metres, and needs no depth_scale_m")
            scale = None
            data = np.ascontiguousarray(depth, dtype="<f4").tobytes()
        return _weldpath.RawView.of_depth(data, width, height, _intrinsics(lens), scale)


@dataclass(frozen=True, eq=False)
class Scan:
    """What was read, cleaned and understood."""

    _scan: _weldpath.Scan

    @property
    def views(self) -> list[tuple[str, Singles, Floats]]:
        """Per view: its name, points (N x 3, mm, the view's own frame), and `base_from_camera` (4 x 4, mm)."""
        return [
            (name, _arrays.single_rows(points), _arrays.rows(pose, 4))
            for name, points, pose in self._scan.views()
        ]

    @property
    def notes(self) -> list[str]:
        """How it was understood: units, frame, what was dropped."""
        return [words(note) for note in self._scan.notes()[0]]

    @property
    def warnings(self) -> list[str]:
        """What may be wrong with it."""
        return [words(note) for note in self._scan.notes()[1]]


Source = Union[PathLike, npt.NDArray[Any], View, Sequence[View], Scan, Any]
"""A path, an array of points, views, a scan that was read, or an Open3D cloud or mesh."""


def _intrinsics(value: object) -> list[float]:
    array = _arrays.numbers(getattr(value, "intrinsic_matrix", value), "intrinsics").astype(np.float64)
    if array.shape == (3, 3):
        if array[0, 1] != 0.0 or not np.array_equal(array[2], [0.0, 0.0, 1.0]):
            raise InputError("intrinsics: a 3 x 3 matrix is fx 0 cx, 0 fy cy, 0 0 1, row by row")
        array = array[[0, 1, 0, 1], [0, 1, 2, 2]]
    if array.ndim != 1:
        raise InputError(f"intrinsics: the shape is {array.shape}; give fx, fy, cx, cy in pixels")
    flat: list[float] = array.tolist()
    return flat


def _cloud(points: object, normals: object, triangles: object) -> _weldpath.RawCloud:
    data, double, count = _arrays.points(points)
    if count == 0:
        raise InputError("points: the array is empty")
    given = None if normals is None else _arrays.vectors(normals, "normals")
    faces = None if triangles is None else _arrays.triangles(triangles)
    return _weldpath.RawCloud(data, double, given, faces)


def _of_open3d(source: Any) -> tuple[Any, Any, Any] | None:
    """Points, normals and triangles of an Open3D cloud or mesh, old or tensor interface."""
    if isinstance(source, np.ndarray) or hasattr(source, "lines"):
        return None
    if hasattr(source, "to_legacy"):
        source = source.to_legacy()
    if hasattr(source, "vertices") and hasattr(source, "triangles"):
        return np.asarray(source.vertices), None, np.asarray(source.triangles)
    if hasattr(source, "points"):
        normals = np.asarray(source.normals) if getattr(source, "has_normals", lambda: False)() else None
        return np.asarray(source.points), normals, None
    return None


def words(text: str) -> str:
    """Options of the command as what they are called here."""
    text = re.sub(r"--(units|frame) (m|mm|camera|base)\b", r'\1="\2"', text)
    text = text.replace("--camera x,y,z", "camera_mm=(x, y, z)").replace("--allow-outside", "allow_outside=True")
    text = text.replace("--memory-mb", "memory_mb")
    return text.replace("--depth-scale-m", "depth_scale_m").replace("--units", "units")


def _plain(value: object) -> object:
    """Numbers of numpy, arrays and paths as JSON has them."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise JobError(f"{value!r} cannot be stored in a job")


def _without_none(value: object, place: str = "job") -> object:
    """Without what is None; each number is one."""
    if isinstance(value, Mapping):
        return {str(key): _without_none(item, f"{place}.{key}") for key, item in value.items() if item is not None}
    if isinstance(value, (list, tuple)):
        return [_without_none(item, place) for item in value]
    if isinstance(value, (float, np.floating)) and not np.isfinite(value):
        raise JobError(f"{place}: {value} is not a number that a job can hold")
    return value


def names(value: object, what: str) -> list[str] | None:
    """One name or several."""
    several = [value] if isinstance(value, str) else value
    if several is None:
        return None
    if not isinstance(several, Iterable):
        raise JobError(f"{what}: {value!r} is neither a name nor a list of names")
    return [str(name) for name in several]


def job_of(job: JobLike, allow_outside: bool, memory_mb: int | None, overrides: Mapping[str, object]) -> _weldpath.Job:
    """The job from a file or a mapping, with what was given by name on top."""
    on_top = json.dumps(_without_none(overrides), default=_plain)
    if isinstance(job, Mapping) and "input" in job:
        raise JobError("job: `input` is what is planned, the first argument")
    if job is None or isinstance(job, Mapping):
        settings = json.dumps(_without_none(job or {}), default=_plain)
        try:
            return _weldpath.Job(None, settings, on_top, allow_outside, memory_mb)
        except JobError as error:
            # Of a mapping there are no lines.
            raise JobError(re.sub(r"^job:\d+: ", "job: ", str(error))) from None
    if not isinstance(job, (str, os.PathLike)):
        raise JobError(f"job: a {type(job).__name__} is neither a path nor a mapping")
    return _weldpath.Job(os.fspath(job), None, on_top, allow_outside, memory_mb)


@dataclass(frozen=True, eq=False)
class Given:
    """How a source is read, as `plan` and `read` were told; None where they were not."""

    units: Units
    base_from_camera: object
    flange_from_camera: object
    flange_from_tcp: object
    normals: object
    frame: str | None
    camera_mm: Sequence[float] | None
    allow_outside: bool
    memory_mb: int | None
    threads: int | None

    def refuse(self, names: Iterable[str], why: str) -> None:
        """What was told and means nothing here."""
        for name in names:
            if getattr(self, name) is not None:
                raise InputError(f"{name}: {why}")

    def job(self, job: JobLike, overrides: Mapping[str, object], **more: object) -> _weldpath.Job:
        units = None if self.units == "auto" else self.units
        told = {"units": units, "frame": self.frame, "camera_mm": self.camera_mm}
        return job_of(job, self.allow_outside, self.memory_mb, {**told, **overrides, **more})


_POSES_OF_ALL = ("base_from_camera", "flange_from_camera", "flange_from_tcp")


def scan_of(
    source: Source, job: JobLike, given: Given, overrides: Mapping[str, object]
) -> tuple[_weldpath.Scan, _weldpath.Job]:
    """Reads a source of any kind, as a job says."""
    threads = given.threads
    for name, least in (("threads", 1), ("memory_mb", 64)):
        count = getattr(given, name)
        if count is not None and (not isinstance(count, (int, np.integer)) or count < least):
            raise JobError(f"{name}: {count!r} is not a whole number of at least {least}")
    try:
        if isinstance(source, Scan):
            told = [*_POSES_OF_ALL, "normals", "frame", "camera_mm", *(["units"] if given.units != "auto" else [])]
            given.refuse(told, "the scan is read already; give it to weldpath.read")
            return source._scan, given.job(job, overrides)
        if isinstance(source, (str, os.PathLike)):
            if not os.fspath(source):
                raise InputError("the path is empty")
            given.refuse([*_POSES_OF_ALL, "normals"], "it is for arrays; a file states it itself")
            settled = given.job(job, overrides, input=os.path.abspath(source))
            return _weldpath.read(settled, threads), settled
        if isinstance(source, View):
            source = [source]
        if isinstance(source, (list, tuple)) and source and all(isinstance(view, View) for view in source):
            settled = given.job(job, overrides)
            return _of_views(source, given, settled), settled
        if given.base_from_camera is None:
            settled = given.job(job, overrides)
            return _weldpath.read_cloud(_of_points(source, given), "points", settled), settled
        here = "base_from_camera takes them from the camera's frame to the base's"
        if given.frame == "base":
            raise InputError(f'frame="base": the points are there already, and {here}')
        given.refuse(["camera_mm"], f"the camera is at the points' origin: {here}")
        # That the points are the camera's is what the pose says, too.
        settled = given.job(job, overrides, frame=None)
        pose = _arrays.rigid(given.base_from_camera, "base_from_camera")
        view = _weldpath.RawView.of_cloud(_of_points(source, given)).posed("base_from_camera", pose)
        return _weldpath.read_views([view], None, None, settled), settled
    except InputError as error:
        raise InputError(words(str(error))) from None


def _of_views(views: Sequence[View], given: Given, job: _weldpath.Job) -> _weldpath.Scan:
    given.refuse(["base_from_camera", "normals"], "give it to each View")
    of_flange = [pose for view in views for pose in (view.base_from_flange, view.flange_from_base, view.base_from_tcp)]
    if all(pose is None for pose in of_flange):
        given.refuse(_POSES_OF_ALL, "it is for poses of the flange or the tool, and no view has one")
    eye, tcp = (
        None if getattr(given, name) is None else _arrays.rigid(getattr(given, name), name)
        for name in ("flange_from_camera", "flange_from_tcp")
    )
    return _weldpath.read_views([view._raw() for view in views], eye, tcp, job)


def _of_points(source: Any, given: Given) -> _weldpath.RawCloud:
    given.refuse(["flange_from_camera", "flange_from_tcp"], "it is for views with poses; give base_from_camera")
    if isinstance(source, (list, tuple)):
        if any(isinstance(part, np.ndarray) and part.ndim > 1 or _of_open3d(part) for part in source):
            raise InputError(
                "a list of clouds: give a list of View(points=..., base_from_camera=...), or join them by numpy.concatenate if they are "
                "in one frame"
            )
    elif not hasattr(source, "__array__") and not callable(getattr(source, "numpy", None)):
        of_open3d = _of_open3d(source)
        if of_open3d is None:
            raise InputError(
                f"a {type(source).__name__} cannot be planned: give a path, an array N x 3, a list of View, or an Open3D cloud or mesh"
            )
        points, own, triangles = of_open3d
        if triangles is not None:
            given.refuse(["normals", "base_from_camera"], "a mesh has its own normals and no camera")
        return _cloud(points, own if given.normals is None else given.normals, triangles)
    return _cloud(source, given.normals, None)
