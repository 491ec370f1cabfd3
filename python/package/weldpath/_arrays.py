"""Arrays on their way to the compiled half and back."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from ._weldpath import InputError

Floats = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]
_NO_TURN_RAD = 1e-12


def rows(data: bytes, columns: int = 3) -> Floats:
    """Rows of float64, read-only."""
    return np.frombuffer(data, dtype="<f8").reshape(-1, columns)


def single_rows(data: bytes, columns: int = 3) -> Singles:
    """Rows of float32, read-only."""
    return np.frombuffer(data, dtype="<f4").reshape(-1, columns)


class Short:
    """A dataclass whose arrays are shown by their shapes."""

    def __repr__(self) -> str:
        shown = []
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                shown.append(f"{field.name}: {' x '.join(map(str, value.shape))}")
            elif isinstance(value, dict) or isinstance(value, tuple) and len(value) > 3:
                shown.append(f"{field.name}: {len(value)}")
            else:
                shown.append(f"{field.name}={value!r}")
        return f"{type(self).__name__}({', '.join(shown)})"


def numbers(value: object, what: str) -> npt.NDArray[Any]:
    """An array of real numbers of any type, order and stride; what is masked is no reading."""
    if isinstance(value, np.ma.MaskedArray):
        value = value.filled(np.nan if value.dtype.kind == "f" else 0)
    array = plain(value, what)
    if array.dtype.kind not in "fiu":
        raise InputError(f"{what}: its elements are {array.dtype}, not real numbers")
    return array


def plain(value: Any, what: str) -> npt.NDArray[Any]:
    """As an array; tensors of Open3D and others hand theirs out by `numpy()`."""
    if not isinstance(value, np.ndarray) and callable(getattr(value, "numpy", None)):
        value = value.numpy()
    try:
        return np.asarray(value)
    except ValueError as error:
        raise InputError(f"{what}: {error}") from None


def points(value: object, what: str = "points") -> tuple[bytes, bool, int]:
    """N x 3 or H x W x 3 coordinates as bytes, whether they are double, and how many points there are."""
    array = _threes(value, what)
    double = array.dtype not in (np.float16, np.float32)
    kind = "<f8" if double else "<f4"
    return np.ascontiguousarray(array, dtype=kind).tobytes(), double, len(array)


def vectors(value: object, what: str) -> bytes:
    """N x 3 or H x W x 3 as float32."""
    return np.ascontiguousarray(_threes(value, what), dtype="<f4").tobytes()


def _threes(value: object, what: str) -> npt.NDArray[Any]:
    """N x 3 or H x W x 3 numbers as rows of three."""
    array = numbers(value, what)
    if array.ndim not in (2, 3) or array.shape[-1] != 3:
        raise InputError(f"{what}: the shape is {array.shape}; give N x 3, or H x W x 3 of an organised cloud")
    return array.reshape(-1, 3)


def triangles(value: object) -> bytes:
    """M x 3 indices."""
    array = plain(value, "triangles")
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"triangles: {array.dtype} of shape {array.shape}; give M x 3 whole numbers")
    if array.size and array.min() < 0:
        raise InputError(f"triangles: {array.min()} is not an index; they are counted from 0")
    return np.ascontiguousarray(array, dtype="<i8").tobytes()


def rigid(value: object, what: str) -> list[list[float]]:
    """A transform as 4 rows: of a 4 x 4 matrix, or of x, y, z and a rotation vector in rad. Whether it is rigid the reader says."""
    array = numbers(value, what).astype(np.float64)
    if array.shape == (6,):
        array = _of_vector(array)
    if array.shape != (4, 4):
        raise InputError(
            f"{what}: the shape is {array.shape}; give a 4 x 4 matrix, or (x, y, z, rx, ry, rz) with a rotation vector in rad"
        )
    if not np.isfinite(array).all():
        raise InputError(f"{what}: a number of it is not finite")
    matrix: list[list[float]] = array.tolist()
    return matrix


def _of_vector(six: Floats) -> Floats:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(six[3:]))
    matrix = np.eye(4)
    matrix[:3, 3] = six[:3]
    if angle > _NO_TURN_RAD:
        x, y, z = six[3:] / angle
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        matrix[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return matrix


def rotations(quaternion_xyzw: Floats) -> Floats:
    """N x 3 x 3 rotation matrices of unit quaternions."""
    x, y, z, w = quaternion_xyzw.T
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.ascontiguousarray(np.moveaxis(matrix, 2, 0))
