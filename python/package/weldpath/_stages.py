"""Stages of the method one by one, and the simulator with its truth."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arrays, _weldpath
from ._arrays import Floats, Singles
from ._input import PathLike, Scan
from ._weldpath import InputError, WeldpathError


_FARTHEST_MM = 1e9


def _about(points_mm: object) -> tuple[bytes, Floats]:
    """Points relative to their middle in single precision, and the middle: all of them have to be finite."""
    array = _arrays.numbers(points_mm, "points_mm").astype(np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
        raise InputError(f"points_mm: the shape is {array.shape}; give N x 3")
    if not (np.abs(array) < _FARTHEST_MM).all():
        raise InputError("points_mm: some are not finite, or farther off than 1000 km; drop them first")
    middle: Floats = np.round(np.median(array, axis=0))
    return np.ascontiguousarray(array - middle, dtype="<f4").tobytes(), middle


def _length(value: float, what: str) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{what}: {value} is not above 0")
    return float(value)


def normals(points_mm: npt.ArrayLike, radius_mm: float) -> Singles:
    """Eq. (9): a unit normal for each of N x 3 points, from the plane through its neighbours within `radius_mm`.

    The sign is arbitrary, as the paper leaves it: N x 3.
    """
    data, _ = _about(points_mm)
    return _arrays.single_rows(_weldpath.estimate_normals(data, _length(radius_mm, "radius_mm")))


def bilateral(
    points_mm: npt.ArrayLike,
    normals: npt.ArrayLike,
    *,
    radius_mm: float,
    distance_mm: float,
    height_mm: float,
) -> Floats:
    """Eq. (10): N x 3 points, each moved along its normal by what its neighbours within `radius_mm` say.

    `distance_mm` and `height_mm` are the standard deviations of the two Gaussians, along the surface and off it.
    """
    data, middle = _about(points_mm)
    given = _arrays.vectors(normals, "normals")
    if len(given) != len(data):
        raise InputError(f"normals: {len(given) // 12} for {len(data) // 12} points")
    widths = (
        _length(radius_mm, "radius_mm"),
        _length(distance_mm, "distance_mm"),
        _length(height_mm, "height_mm"),
    )
    return _arrays.single_rows(_weldpath.bilateral(data, given, widths)) + middle


@dataclass(frozen=True, eq=False, repr=False)
class EdgeScores(_arrays.Short):
    """How much of an edge each of N points is."""

    intensity: Singles
    """N, eq. (12): 0 amid a face, 0.21 where two faces meet at a right angle."""
    gradient: Singles
    """N x 3, eq. (13)."""
    ratio: Singles
    """N, eq. (16): Tr³/Det of the smoothed tensor (14), (15), (17); 27 at least, infinite where the tensor is flat."""


def edge_scores(points_mm: npt.ArrayLike, radius_mm: float) -> EdgeScores:
    """Eqs. (11)-(17) of each of N x 3 points, over its neighbours within `radius_mm`."""
    data, _ = _about(points_mm)
    intensity, gradient, ratio = _weldpath.edge_scores(data, _length(radius_mm, "radius_mm"))
    return EdgeScores(
        _arrays.single_rows(intensity, 1)[:, 0],
        _arrays.single_rows(gradient),
        _arrays.single_rows(ratio, 1)[:, 0],
    )


@dataclass(frozen=True, eq=False, repr=False)
class Registration(_arrays.Short):
    """Where the cameras of a scan's views stood, put right against each other."""

    base_from_camera: Floats
    """V x 4 x 4, mm."""
    fitness: Floats
    """V, eq. (20): share of each view's overlap that is nearer than 2 mm; NaN where nothing overlaps."""


def register(scan: Scan) -> Registration:
    """Eqs. (2)-(8): all views at once, point to plane, with the reported poses as priors."""
    if not isinstance(scan, Scan):
        raise InputError(f"a {type(scan).__name__} is no Scan: weldpath.read makes one")
    found = _weldpath.register(scan._scan)
    poses = np.stack([_arrays.rows(pose, 4) for pose, _ in found])
    return Registration(poses, np.array([np.nan if share is None else share for _, share in found]))


def _command(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "weldpath", *arguments], capture_output=True, text=True, encoding="utf-8"
    )
    if done.returncode != 0:
        raise WeldpathError(done.stderr.strip().removeprefix("error: ") or f"exit code {done.returncode}")
    return done.stdout


def simulate(part: str, out: PathLike, **options: object) -> Path:
    """Simulates a scan with exact truth and returns its folder.

    `options` are those of `weldpath simulate`, such as `seed=3`, `noise="low"`, `views=5`, `pose="vertical"`. Plan it with
    `weldpath.plan(folder, job=folder / "cell.toml")`: the job says how exact its poses are.
    """
    words = []
    for name, value in options.items():
        flag = f"--{name.replace('_', '-')}"
        words += [flag] if value is True else [] if value is False or value is None else [flag, str(value)]
    _command("simulate", "--part", part, "--out", os.fspath(out), "--quiet", *words)
    return Path(out)


def evaluate(out: PathLike, truth: PathLike) -> dict[str, Any]:
    """How far a plan that was written to `out` is from a `truth.json`, or from a taught path: as `weldpath evaluate --json`."""
    found: dict[str, Any] = json.loads(_command("evaluate", os.fspath(out), "--truth", os.fspath(truth), "--json"))
    return found
