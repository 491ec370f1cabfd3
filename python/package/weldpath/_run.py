"""What a plan hands out."""

from __future__ import annotations

import html
import json
import os
import tempfile
import webbrowser
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from . import _arrays, _weldpath
from ._arrays import Floats, Singles
from ._input import PathLike, words


@dataclass(frozen=True)
class Reason:
    """Something that stands against running the program; docs/troubleshooting.md says what to do about each id."""

    id: str
    words: str
    seam: int | None
    accepted: bool
    values: Mapping[str, float]
    """What the words say in numbers, such as `error_mm` and `limit_mm`; docs/formats.md lists them."""


@dataclass(frozen=True)
class Verdict:
    """Whether the program may be run."""

    state: Literal["ready", "check", "refused"]
    reasons: tuple[Reason, ...]
    limits: tuple[str, ...]
    """What was not looked at."""

    def __str__(self) -> str:
        lines: list[str] = [self.state]
        for reason in self.reasons:
            seam = "" if reason.seam is None else f"seam {reason.seam}: "
            lines.append(f"{reason.id}{' (accepted)' if reason.accepted else ''}: {seam}{reason.words}")
        return "\n  ".join(lines)


@dataclass(frozen=True, eq=False, repr=False)
class Seam(_arrays.Short):
    """A seam that was found, whether or not it is welded. Robot base frame."""

    id: int
    joint: str
    selected: bool
    closed: bool
    length_mm: float
    confidence: float | None
    """Probability that it is a weld, within twice its stated error."""
    expected_error_mm: float | None
    """One standard deviation of the position across the seam: in the robot's base frame where the poses are the robot's, else
    within the scan alone."""
    expected_error_deg: float | None
    """The same of the torch's orientation."""
    position_mm: Floats
    """N x 3: where the two faces meet."""
    tangent: Floats
    """N x 3, unit, in the direction of the weld."""
    faces: Floats
    """2 x N x 3: unit normals of the two faces, out of the material."""
    details: dict[str, Any]
    """Its entry in summary.json: dimensions, parts of the error, warnings, why this joint."""


class Seams(Sequence[Seam]):
    """All seams of a run; a table in a notebook."""

    def __init__(self, seams: Sequence[Seam]) -> None:
        self._seams = tuple(seams)

    @overload
    def __getitem__(self, at: int) -> Seam: ...
    @overload
    def __getitem__(self, at: slice) -> Seams: ...
    def __getitem__(self, at: int | slice) -> Seam | Seams:
        return Seams(self._seams[at]) if isinstance(at, slice) else self._seams[at]

    def __len__(self) -> int:
        return len(self._seams)

    def __iter__(self) -> Iterator[Seam]:
        return iter(self._seams)

    _HEAD = ("seam", "joint", "welded", "length mm", "error mm", "error deg", "confidence")

    def _rows(self) -> list[tuple[str, ...]]:
        def number(value: float | None, digits: int) -> str:
            return "unknown" if value is None else f"{value:.{digits}f}"

        return [
            (
                str(seam.id),
                seam.joint,
                "yes" if seam.selected else "no",
                number(seam.length_mm, 1),
                number(seam.expected_error_mm, 2),
                number(seam.expected_error_deg, 1),
                number(seam.confidence, 2),
            )
            for seam in self._seams
        ]

    def __repr__(self) -> str:
        table = [self._HEAD, *self._rows()]
        wide = [max(len(row[k]) for row in table) for k in range(len(self._HEAD))]
        return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, wide)).rstrip() for row in table)

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{html.escape(name)}</th>" for name in self._HEAD)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in self._rows()
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


@dataclass(frozen=True, eq=False, repr=False)
class TorchPath(_arrays.Short):
    """The torch along one pass of a seam, in the order in which it is welded. Robot base frame."""

    seam: int
    position_mm: Floats
    """N x 3: tip of the wire."""
    quaternion_xyzw: Floats
    """N x 4, `base_from_torch`, in scipy's order: columns right of the travel, along the travel, out of the work."""
    arc: npt.NDArray[np.bool_]
    """N: the arc burns between two successive points that both say so."""

    @property
    def rotation(self) -> Floats:
        """N x 3 x 3, `base_from_torch`."""
        return _arrays.rotations(self.quaternion_xyzw)

    def __len__(self) -> int:
        return len(self.position_mm)


@dataclass(frozen=True, eq=False, repr=False)
class Program(_arrays.Short):
    """Every waypoint in order, approaches and air moves among them. Robot base frame."""

    position_mm: Floats
    """N x 3."""
    quaternion_xyzw: Floats
    """N x 4, `base_from_torch`."""
    kind: tuple[str, ...]
    """Of each move that ends here: air, approach, weld or retract."""
    arc: npt.NDArray[np.bool_]
    """N: the arc burns between two successive waypoints of one seam that both say so."""
    seam: tuple[int | None, ...]
    feed_mm_s: Floats
    """N: of the straight move that ends here."""
    dwell_s: tuple[float | None, ...]
    """How long the torch stands still; 0 stops exactly, None passes without a stop."""

    def __len__(self) -> int:
        return len(self.position_mm)


@dataclass(frozen=True, eq=False, repr=False)
class Model(_arrays.Short):
    """All views merged, registered, thinned and filtered. Robot base frame."""

    points_mm: Floats
    """N x 3."""
    normals: Singles
    """N x 3, unit, toward the camera that saw them."""


@dataclass(frozen=True, eq=False, repr=False)
class RegisteredView(_arrays.Short):
    """Where a view's camera stood, as the views agree."""

    name: str
    left_out: str | None
    """Why nothing of it is used."""
    base_from_camera: Floats
    """4 x 4, mm."""
    moved_mm: float | None
    """How far registration moved it."""
    moved_deg: float | None


def _reasons(confirm: Iterable[str]) -> list[str]:
    return [confirm] if isinstance(confirm, str) else list(confirm)


class Run:
    """What was found in a scan, and the program that a job makes of it.

    A refused run hands out no path and no program. One that has to be checked hands out its program to who names what is to be
    confirmed. Seams, model and report can always be looked at.
    """

    def __init__(self, run: _weldpath.Run, threads: int | None = None) -> None:
        self._run = run
        self._threads = threads

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The content of summary.json (docs/formats.md)."""
        summary: dict[str, Any] = json.loads(self._run.summary())
        return summary

    @property
    def verdict(self) -> Verdict:
        verdict = self.summary["verdict"]
        reasons = [
            Reason(one["id"], words(one["words"]), one["seam"], one["accepted"], MappingProxyType(one["values"]))
            for one in verdict["reasons"]
        ]
        return Verdict(verdict["state"], tuple(reasons), tuple(verdict["limits"]))

    @property
    def warnings(self) -> list[str]:
        """What the user should know of the run; what concerns one seam stands in its `details`."""
        return [words(text) for text in self.summary["warnings"]]

    @cached_property
    def seams(self) -> Seams:
        """All seams that were found, welded or not."""
        details = {one["id"]: one for one in self.summary["seams"]}
        seams = []
        for id_, closed, (position, tangent, one_face, other_face) in self._run.seams():
            own = details[id_]
            seams.append(
                Seam(
                    id=id_,
                    joint=own["joint"],
                    selected=own["selected"],
                    closed=closed,
                    length_mm=own["length_mm"],
                    confidence=own["confidence"],
                    expected_error_mm=own["expected_error_mm"],
                    expected_error_deg=own["expected_error_deg"],
                    position_mm=_arrays.rows(position),
                    tangent=_arrays.rows(tangent),
                    faces=_arrays.rows(one_face + other_face).reshape(2, -1, 3),
                    details=own,
                )
            )
        return Seams(seams)

    @property
    def paths(self) -> list[TorchPath]:
        """One for each pass, in the order in which they are welded.

        Raises `Refused` if the plan is.
        """
        return [
            TorchPath(seam, _arrays.rows(position), _arrays.rows(turn, 4), np.array(arc, dtype=np.bool_))
            for seam, position, turn, arc in self._run.paths()
        ]

    def program(self, confirm: Iterable[str] = ()) -> Program:
        """Every waypoint. `confirm` names the reasons of a verdict `check` that somebody has looked at.

        Raises `Refused`, or `Unconfirmed` with what is left.
        """
        position, turn, moves = self._run.program(_reasons(confirm))
        kind, arc, seam, feed, dwell = zip(*moves) if moves else ((), (), (), (), ())
        return Program(
            _arrays.rows(position),
            _arrays.rows(turn, 4),
            tuple(kind),
            np.array(arc, dtype=np.bool_),
            tuple(seam),
            np.array(feed, dtype=np.float64),
            tuple(dwell),
        )

    def programs(self, robot: Sequence[str] | None = None, confirm: Iterable[str] = ()) -> dict[str, bytes]:
        """The files of the robots' programs by name: `ur`, `abb`, `kuka`, `fanuc`, `ros`; those of the job if none is named.

        Raises `Refused`, or `Unconfirmed` with what is left.
        """
        return self._for(robot).program_files(_reasons(confirm))

    @cached_property
    def model(self) -> Model:
        points, normals = self._run.model()
        return Model(_arrays.rows(points), _arrays.single_rows(normals))

    @property
    def views(self) -> list[RegisteredView]:
        """One for each view that was read; none of a single cloud."""
        return [_registered(view) for view in self.summary["views"]]

    @property
    def job(self) -> str:
        """Every setting with its defaults, as `job.toml` has them."""
        return self._run.job()

    def report_html(self) -> str:
        """The page with the 3-D picture; it needs no network."""
        return self._run.report().decode()

    def show(self) -> None:
        """The report: within a notebook, else in the browser."""
        try:
            from IPython import get_ipython
            from IPython.display import HTML, display

            in_notebook = get_ipython() is not None and hasattr(get_ipython(), "kernel")
        except ImportError:
            in_notebook = False
        if in_notebook:
            page = html.escape(self.report_html(), quote=True)
            display(HTML(f'<iframe srcdoc="{page}" width="100%" height="720" style="border:0"></iframe>'))
            return
        with tempfile.NamedTemporaryFile("wb", prefix="weldpath-", suffix=".html", delete=False) as file:
            file.write(self._run.report())
        webbrowser.open(FilePath(file.name).as_uri())

    def write(
        self, folder: PathLike, *, robot: Sequence[str] | None = None, overwrite: bool = False
    ) -> FilePath:
        """Writes what `weldpath plan` writes, all files or none, and returns the folder.

        The programs of a run that has to be checked name its reasons in their heads; a refused one has none. Files that weldpath did
        not write stay, and `OutputError` says which, unless `overwrite` says otherwise.
        """
        if not os.fspath(folder):
            raise _weldpath.OutputError("the path of the folder is empty")
        self._for(robot).write(os.fspath(folder), overwrite)
        return FilePath(folder)

    def _for(self, robot: Sequence[str] | None) -> _weldpath.Run:
        if robot is None:
            return self._run
        return self._run.for_robots([robot] if isinstance(robot, str) else list(robot), self._threads)

    def to_open3d(self) -> list[Any]:
        """The model as an Open3D `PointCloud` and each seam as a `LineSet`, mm."""
        import open3d as o3d

        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(self.model.points_mm))
        cloud.normals = o3d.utility.Vector3dVector(self.model.normals.astype(np.float64))
        shown: list[Any] = [cloud]
        for seam in self.seams:
            at = np.arange(len(seam.position_mm))
            ends = np.column_stack([at, np.roll(at, -1)])
            lines = o3d.geometry.LineSet(
                o3d.utility.Vector3dVector(seam.position_mm),
                o3d.utility.Vector2iVector(ends if seam.closed else ends[:-1]),
            )
            lines.paint_uniform_color([0.9, 0.2, 0.1])
            shown.append(lines)
        return shown

    def __repr__(self) -> str:
        count = len(self.seams)
        return f"<weldpath.Run: {self.verdict.state}, {count} seam{'' if count == 1 else 's'}>"

    def _repr_html_(self) -> str:
        lines = html.escape(str(self.verdict)).replace("\n", "<br>")
        return f"<p><b>verdict: {lines}</b></p>{self.seams._repr_html_()}"


def _registered(view: dict[str, Any]) -> RegisteredView:
    w, x, y, z = view["base_from_camera_wxyz"]
    pose = np.eye(4)
    pose[:3, :3] = _arrays.rotations(np.array([[x, y, z, w]]))[0]
    pose[:3, 3] = view["position_mm"]
    return RegisteredView(view["name"], view["left_out"], pose, view["moved_mm"], view["moved_deg"])
