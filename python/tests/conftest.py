"""Fixtures of the repository, from files and as arrays."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import weldpath

FIXTURES = Path(__file__).resolve().parents[2] / "fixtures"
NAMES = ("butt-v", "cell", "fillet", "lap", "pipe")


def views(folder: Path) -> tuple[list[weldpath.View], dict[str, Any]]:
    """The views of a scan.json as arrays, and what they share."""
    scan = json.loads((folder / "scan.json").read_text())
    camera = scan["camera"]
    intrinsics = [camera[key] for key in ("fx", "fy", "cx", "cy")]
    made = [
        weldpath.View(
            depth=np.asarray(Image.open(folder / view["depth"])).astype(np.uint16),
            intrinsics=intrinsics,
            depth_scale_m=camera["depth_scale_m"],
            base_from_flange=view["base_from_flange"],
            name=view["depth"],
        )
        for view in scan["views"]
    ]
    return made, {"units": scan["units"], "flange_from_camera": scan["flange_from_camera"]}


@pytest.fixture(scope="session")
def lap_cloud() -> np.ndarray[Any, Any]:
    """All points of a lap joint in the base frame, mm, as one cloud."""
    scan = weldpath.read(FIXTURES / "lap")
    parts = [points @ pose[:3, :3].T + pose[:3, 3] for _, points, pose in scan.views]
    return np.concatenate(parts)[::7]
