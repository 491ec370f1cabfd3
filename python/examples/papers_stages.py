# %% [markdown]
# # The stages of the paper, one by one
#
# From the views of a scan to the points that lie on edges, with the quantities of Zhou et al. as arrays. The scan is the sample of a
# pipe on a plate; put the path of yours in its place.

# %%
import numpy as np

import weldpath

scan = weldpath.read(weldpath.samples.pipe())
print("\n".join(scan.notes))

# %% [markdown]
# ## Registration, eqs. (2)-(8)
#
# The robot says where the camera stood, within millimetres. The views themselves say it better.

# %%
registration = weldpath.register(scan)
for (name, _, reported), found, fitness in zip(scan.views, registration.base_from_camera, registration.fitness):
    moved_mm = np.linalg.norm(found[:3, 3] - reported[:3, 3])
    print(f"{name}: moved by {moved_mm:.2f} mm, {100 * fitness:.1f} % of the overlap nearer than 2 mm")

# %% [markdown]
# ## Normals and bilateral filter, eqs. (9) and (10)
#
# Of a part of the merged cloud, about the foot of the pipe.

# %%
merged = np.concatenate(
    [points @ pose[:3, :3].T + pose[:3, 3] for (_, points, _), pose in zip(scan.views, registration.base_from_camera)]
)
run = weldpath.plan(weldpath.samples.pipe())
foot = run.seams[0].position_mm.mean(axis=0)
near = merged[np.linalg.norm(merged - foot, axis=1) < 60.0][::2]
normals = weldpath.normals(near, radius_mm=4.0)
smooth = weldpath.bilateral(near, normals, radius_mm=4.0, distance_mm=2.0, height_mm=0.6)
print(f"{len(near)} points, moved by {np.linalg.norm(smooth - near, axis=1).mean():.2f} mm on average")

# %% [markdown]
# ## Edge scores, eqs. (11)-(17)
#
# The intensity (12) is 0 amid a face and 0.21 where two faces meet at a right angle. The ratio (16) is what the paper compares with its
# threshold t.

# %%
scores = weldpath.edge_scores(smooth, radius_mm=5.0)
line = np.concatenate([seam.position_mm for seam in run.seams])
off_mm = np.array([np.linalg.norm(line - point, axis=1).min() for point in smooth[::20]])
on_seam, away = scores.intensity[::20][off_mm < 1.0], scores.intensity[::20][off_mm > 12.0]
print(f"median intensity on the seams {np.median(on_seam):.2f}, elsewhere {np.median(away):.2f}")

# %% [markdown]
# ## Picture

# %%
try:
    import matplotlib.pyplot as plt
except ImportError:
    plt = None
if plt is not None:
    figure, axes = plt.subplots(1, 2, figsize=(10, 5), subplot_kw={"projection": "3d"})
    shown = slice(None, None, 10)
    for axis, values, title in (
        (axes[0], scores.intensity, "intensity, eq. (12)"),
        (axes[1], np.log10(np.clip(scores.ratio, 27, 1e4)), "log10 of Tr³/Det, eq. (16)"),
    ):
        axis.scatter(*smooth[shown].T, c=values[shown], s=2)
        axis.set_title(title)
