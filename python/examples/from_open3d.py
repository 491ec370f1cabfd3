# %% [markdown]
# # From an Open3D reconstruction to a torch path
#
# Open3D works in metres and gives a camera's pose as its inverse, the `extrinsic`. Here its depth images and trajectory are made from the
# sample, so that this runs without Open3D; with it, take `depth`, `intrinsic` and `extrinsic` from your own reconstruction.

# %%
import json

import numpy as np

import weldpath

scan = weldpath.read(weldpath.samples.cell())
camera = json.loads((weldpath.samples.cell() / "scan.json").read_text())["camera"]


def depth_image(points_mm):
    """Float depths in metres, as `open3d.geometry.Image` holds them; NaN where nothing was seen."""
    z = points_mm[:, 2].astype(float)
    column = np.rint(points_mm[:, 0] / z * camera["fx"] + camera["cx"]).astype(int)
    row = np.rint(points_mm[:, 1] / z * camera["fy"] + camera["cy"]).astype(int)
    depth = np.full((camera["height"], camera["width"]), np.nan, dtype=np.float32)
    depth[row, column] = z / 1000.0
    return depth


def in_metres(pose_mm):
    pose = pose_mm.copy()
    pose[:3, 3] /= 1000.0
    return pose


images = [(depth_image(points), np.linalg.inv(in_metres(pose))) for _, points, pose in scan.views]

# %% [markdown]
# ## Plan
#
# `intrinsics` may be an Open3D `PinholeCameraIntrinsic`, and `depth` an `RGBDImage`.

# %%
intrinsics = [camera[key] for key in ("fx", "fy", "cx", "cy")]
views = [
    weldpath.View(depth=depth, intrinsics=intrinsics, camera_from_base=extrinsic) for depth, extrinsic in images
]
run = weldpath.plan(views, units="m", job={"path": {"standoff_mm": 12.0}})
print(run.verdict)
print(run.seams)

# %% [markdown]
# ## Look at it
#
# `run.show()` opens the report. With Open3D: `open3d.visualization.draw_geometries(run.to_open3d())`.

# %%
for path in run.paths:
    print(f"seam {path.seam}: {len(path)} poses from {path.position_mm[0].round(1)} to {path.position_mm[-1].round(1)} mm")
