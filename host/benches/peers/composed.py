"""The paper's method composed from Open3D, numpy and scipy, vectorised: what one would write today. usage: composed.py DIR

Voxel grid 1.5 mm, normals, bilateral filter, edge intensity, gradient, smoothed tensor, Tr^3/Det, clustering, ordering,
poses by slerp. It knows which part of the cloud holds the seam, and takes a quantile for its threshold."""
import json
import resource
import sys
import time

import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation, Slerp

DIR = sys.argv[1]
VOXEL_MM = 1.5


def pairs(points, radius):
    lists = cKDTree(points).query_ball_point(points, radius, return_sorted=False)
    sizes = np.fromiter(map(len, lists), np.int64, len(points))
    return np.repeat(np.arange(len(points)), sizes), np.concatenate(lists).astype(np.int64), sizes


def bilateral(points, normals):
    radius = 2.5 * VOXEL_MM
    i, j, _ = pairs(points, radius)
    apart = points[j] - points[i]
    height = np.einsum("ij,ij->i", apart, normals[i])
    weight = np.exp(-0.5 * (apart**2).sum(1) / (radius / 2) ** 2 - 0.5 * height**2 / 0.6**2)
    n = len(points)
    return points + (np.bincount(i, weight * height, n) / np.bincount(i, weight, n))[:, None] * normals


def edge_score(points, radius=5.0):
    n = len(points)
    i, j, sizes = pairs(points, radius)
    centroid = np.stack([np.bincount(i, points[j, k], n) for k in range(3)], 1) / sizes[:, None]
    intensity = np.linalg.norm(points - centroid, axis=1) / radius
    intensity[sizes < 12] = 0
    a, b = i[i != j], j[i != j]
    apart = points[b] - points[a]
    rise = (intensity[b] - intensity[a]) * np.linalg.norm(apart, axis=1)
    first = np.r_[0, np.flatnonzero(np.diff(a)) + 1]
    gradient = np.zeros((n, 3))
    for k in range(3):
        delta = np.where(np.abs(apart[:, k]) < 1e-3, np.copysign(1e-3, apart[:, k]), apart[:, k])
        gradient[a[first], k] = np.maximum.reduceat(rise / delta, first)
    outer = gradient[:, [0, 0, 0, 1, 1, 2]] * gradient[:, [0, 1, 2, 1, 2, 2]]
    squared = ((points[j] - points[i]) ** 2).sum(1)
    width = np.sqrt(np.bincount(i, squared, n) / sizes)
    weight = np.exp(-0.5 * squared / np.maximum(width[i], 1e-6) ** 2)
    total = np.bincount(i, weight, n)
    a, b, c, d, e, f = [np.bincount(i, weight * outer[j, k], n) / total for k in range(6)]
    determinant = a * (d * f - e * e) - b * (b * f - e * c) + c * (b * e - d * c)
    return intensity, (a + d + f) ** 3 / np.maximum(determinant, 1e-30)


def path(edges, normals):
    cluster = np.asarray(o3d.geometry.PointCloud(o3d.utility.Vector3dVector(edges)).cluster_dbscan(eps=6.0, min_points=8))
    largest = cluster == np.bincount(cluster[cluster >= 0]).argmax()
    edges, normals = edges[largest], normals[largest]
    along = (edges - edges.mean(0)) @ np.linalg.svd(edges - edges.mean(0), full_matrices=False)[2][0]
    bins = np.round((along - along.min()) / 5).astype(int)
    counts = np.bincount(bins)
    some = counts > 0
    mean = lambda v: np.stack([np.bincount(bins, v[:, k])[some] for k in range(3)], 1) / counts[some, None]
    place, up = mean(edges), mean(normals)
    up /= np.linalg.norm(up, axis=1)[:, None]
    travel = np.gradient(place, axis=0)
    travel -= (travel * up).sum(1)[:, None] * up
    travel /= np.linalg.norm(travel, axis=1)[:, None]
    turns = Rotation.from_matrix(np.stack([np.cross(travel, up), travel, up], 2))
    fine = np.linspace(0, len(place) - 1, 300)
    Slerp(np.arange(len(place)), turns)(fine)
    return np.stack([np.interp(fine, np.arange(len(place)), place[:, k]) for k in range(3)], 1)


def whole():
    cloud = o3d.io.read_point_cloud(f"{DIR}/butt.ply").voxel_down_sample(VOXEL_MM)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamRadius(2.5 * VOXEL_MM))
    cloud.orient_normals_to_align_with_direction([0, 0, 1.0])
    normals = np.asarray(cloud.normals)
    thinned = np.asarray(cloud.points)
    begin = time.process_time()
    points = bilateral(thinned, normals)
    filtering.append((time.process_time() - begin) * 1e3)
    begin = time.process_time()
    intensity, ratio = edge_score(points)
    scoring.append((time.process_time() - begin) * 1e3)
    inner = (np.abs(points[:, 1]) < 90) & (points[:, 0] > 8) & (points[:, 0] < 492)
    edge = (ratio >= 50) & (intensity > np.quantile(intensity[inner], 0.93)) & inner
    return (thinned, normals, points), intensity, path(points[edge], normals[edge])


filtering, scoring, took = [], [], []
while not took or len(took) < 4 and took[0] <= 5000:
    begin = time.process_time()
    (thinned, normals, scored), intensity, seam = whole()
    took.append((time.process_time() - begin) * 1e3)
warm = len(took) > 1
for name, values in [("thinned", thinned), ("thinned_normals", normals), ("scored", scored)]:
    values.astype(np.float32).tofile(f"{DIR}/{name}.f32")
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
check = dict(across_rms_mm=float(np.sqrt((seam[:, 1] ** 2).mean())), peak_mib=peak)
print(json.dumps(dict(peer="Open3D + numpy", stage="whole method", cpu_ms=took[warm:], check=check)))
check = dict(intensity=float(np.median(intensity)))
print(json.dumps(dict(peer="Open3D + numpy", stage="edge score", cpu_ms=scoring[warm:], points=len(scored), check=check)))
check = dict(moved_rms_mm=float(np.sqrt(((scored - thinned) ** 2).sum(1).mean())))
print(json.dumps(dict(peer="Open3D + numpy", stage="bilateral, thinned", cpu_ms=filtering[warm:], check=check)))
