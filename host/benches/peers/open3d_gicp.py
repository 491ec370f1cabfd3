"""Open3D and small_gicp: files, voxel grid, neighbours, normals, boundary, ICP, registration. usage: open3d_gicp.py DIR"""
import json
import sys
import time

import numpy as np
import open3d as o3d
import small_gicp

DIR = sys.argv[1]
META = json.load(open(f"{DIR}/meta.json"))
RADIUS = META["radius_mm"]
TRUTH = np.array(META["target_from_source"])


def floats(name):
    return np.fromfile(f"{DIR}/{name}.f32", np.float32).reshape(-1, 3)


def stage(peer, name, work, check=lambda made: None):
    begin = time.process_time()
    made = work()
    runs = 1 if time.process_time() - begin > 3 else 3
    took = []
    for _ in range(runs):
        begin = time.process_time()
        made = work()
        took.append((time.process_time() - begin) * 1e3)
    print(json.dumps(dict(peer=peer, stage=name, cpu_ms=took, check=check(made))), flush=True)


def cloud(points, normals=None):
    made = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
    if normals is not None:
        made.normals = o3d.utility.Vector3dVector(normals.astype(np.float64))
    return made


def tensor_cloud(points, normals=None):
    made = o3d.t.geometry.PointCloud(o3d.core.Tensor(points))
    if normals is not None:
        made.point.normals = o3d.core.Tensor(normals)
    return made


def error(found, centre):
    turn = found[:3, :3] @ TRUTH[:3, :3].T
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    apart = (found - TRUTH)[:3, :3] @ centre + (found - TRUTH)[:3, 3]
    return dict(error_deg=float(np.degrees(np.arcsin(min(1, np.linalg.norm(skew) / 2)))), error_mm=float(np.linalg.norm(apart)))


def plate_error_deg(points, normals):
    on = (np.abs(points[:, 1]) >= 20) & (np.abs(points[:, 1]) < 95)
    n = normals[on]
    return float(np.degrees(np.arctan2(np.hypot(n[:, 0], n[:, 1]), np.abs(n[:, 2]))).mean())


def stages_of_a_cloud():
    points = floats("butt")
    tensor = tensor_cloud(points)
    for kind in ("ply", "pcd"):
        load = lambda: o3d.io.read_point_cloud(f"{DIR}/butt.{kind}")
        stage("Open3D", f"load {kind}", load, lambda made: dict(points=len(made.points)))
    legacy = cloud(points)
    stage("Open3D", "voxel grid", lambda: legacy.voxel_down_sample(1.0), lambda made: dict(voxels=len(made.points)))
    stage("Open3D", "index", lambda: o3d.geometry.KDTreeFlann(legacy))
    normals = lambda: tensor.estimate_normals(max_nn=60, radius=RADIUS)
    check = lambda made: dict(plate_error_deg=plate_error_deg(points, tensor.point.normals.numpy()))
    stage("Open3D", "normals", normals, check)
    tensor.point.normals = o3d.core.Tensor(np.tile(np.float32([0, 0, 1]), (len(points), 1)))
    stage("Open3D", "edge intensity", lambda: tensor.compute_boundary_points(RADIUS, 30, 90.0))


def icp():
    source, target, normals = floats("source"), floats("target"), floats("target_normals")
    centre = source.mean(0, dtype=np.float64)
    reg = o3d.pipelines.registration
    a, b = cloud(source), cloud(target, normals)
    criteria = reg.ICPConvergenceCriteria(1e-7, 1e-7, 100)
    plane = reg.TransformationEstimationPointToPlane()
    align = lambda: reg.registration_icp(a, b, 5.0, np.eye(4), plane, criteria).transformation
    stage("Open3D", "icp, given normals", align, lambda made: error(made, centre))
    s, t = small_gicp.PointCloud(source.astype(float)), small_gicp.PointCloud(target.astype(float))
    small_gicp.estimate_normals_covariances(t, num_neighbors=30)
    small_gicp.estimate_covariances(s, num_neighbors=30)
    settings = dict(registration_type="GICP", max_correspondence_distance=5.0, num_threads=1, max_iterations=100,
                    rotation_epsilon=1e-5, translation_epsilon=1e-3)
    gicp = lambda: small_gicp.align(t, s, small_gicp.KdTree(t), np.eye(4), **settings).T_target_source
    stage("small_gicp", "icp, given normals", gicp, lambda made: error(made, centre))

    def registration():
        thin = [cloud(points).voxel_down_sample(2.0) for points in (source, target)]
        thin[1].estimate_normals(o3d.geometry.KDTreeSearchParamKNN(30))
        pose = np.eye(4)
        for gate in (5.0, 1.5):
            pose = reg.registration_icp(*thin, gate, pose, plane, criteria).transformation
        return pose

    stage("Open3D", "registration", registration, lambda made: error(made, centre))


stages_of_a_cloud()
icp()
