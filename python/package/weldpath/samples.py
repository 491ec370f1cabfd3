"""Scans to try with. They were simulated, and have their exact truth beside them."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).parent / "_samples"


def cell() -> Path:
    """A T joint seen by a depth camera on a robot; what is known of the cell is in `cell_job()`."""
    return _FOLDER / "cell"


def cell_job() -> Path:
    """The job of `cell()`: how exact robot and hand-eye transform are, and the tool."""
    return _FOLDER / "cell.toml"


def pipe() -> Path:
    """A pipe on a plate."""
    return _FOLDER / "pipe"
