"""Open3D and small_gicp: files, voxel grid, neighbours, normals, boundary, ICP, registration. usage: open3d_gicp.py DIR"""
import json
import os
import sys
import time

import numpy as np
import open3d as o3d
import small_gicp

DIR = sys.argv[1]
META = json.load(open(f"{DIR}/meta.json"))
RADIUS = META["radius_mm"]
SKIP = os.environ.get("SKIP", "").split(";")


def floats(name):
    return np.fromfile(f"{DIR}/{name}.f32", np.float32).reshape(-1, 3)


def stage(peer, name, work, check=lambda made: None):
    """Runs once to warm up and three times for the record, or only once where a run takes long."""
    if name in SKIP:
        return
    took = []
    while not took or len(took) < 4 and took[0] <= 1000:
        begin = time.process_time()
        made = work()
        took.append((time.process_time() - begin) * 1e3)
    print(json.dumps(dict(peer=peer, stage=name, cpu_ms=took[len(took) > 1:], check=check(made))), flush=True)


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
    cornered = cloud(floats("cornered"))
    stage("Open3D", "voxel grid", lambda: cornered.voxel_down_sample(1.0), lambda made: dict(voxels=len(made.points)))
    stage("Open3D", "index", lambda: o3d.geometry.KDTreeFlann(legacy))
    normals = lambda: tensor.estimate_normals(max_nn=60, radius=RADIUS)
    check = lambda made: dict(plate_error_deg=plate_error_deg(points, tensor.point.normals.numpy()))
    stage("Open3D", "normals", normals, check)
    tensor.point.normals = o3d.core.Tensor(np.tile(np.float32([0, 0, 1]), (len(points), 1)))
    stage("Open3D", "edge intensity", lambda: tensor.compute_boundary_points(RADIUS, 30, 90.0))


def icp():
    source, target, normals = floats("source"), floats("target"), floats("target_normals")
    reg = o3d.pipelines.registration
    a, b = cloud(source), cloud(target, normals)
    criteria = reg.ICPConvergenceCriteria(1e-7, 1e-7, 100)
    plane = reg.TransformationEstimationPointToPlane()
    align = lambda: reg.registration_icp(a, b, 5.0, np.eye(4), plane, criteria).transformation
    stage("Open3D", "icp, given normals", align, lambda made: dict(pose=made.tolist()))
    s, t = small_gicp.PointCloud(source.astype(float)), small_gicp.PointCloud(target.astype(float))
    small_gicp.estimate_normals_covariances(t, num_neighbors=30)
    small_gicp.estimate_covariances(s, num_neighbors=30)
    settings = dict(registration_type="GICP", max_correspondence_distance=5.0, num_threads=1, max_iterations=100,
                    rotation_epsilon=1e-5, translation_epsilon=1e-3)
    gicp = lambda: small_gicp.align(t, s, small_gicp.KdTree(t), np.eye(4), **settings)
    check = lambda made: dict(pose=made.T_target_source.tolist(), iterations=made.iterations + 1)
    stage("small_gicp GICP", "icp, given normals", gicp, check)

    def thinned():
        thin = [cloud(points).voxel_down_sample(2.0) for points in (source, target)]
        thin[1].estimate_normals(o3d.geometry.KDTreeSearchParamKNN(30))
        return thin

    def chain(thin):
        pose = np.eye(4)
        for gate in (5.0, 1.5):
            pose = reg.registration_icp(*thin, gate, pose, plane, criteria).transformation
        return pose

    thin = thinned()
    for name, values in [("thin_source", thin[0].points), ("thin_target", thin[1].points), ("thin_target_normals", thin[1].normals)]:
        np.asarray(values).astype(np.float32).tofile(f"{DIR}/{name}.f32")
    pose = lambda made: dict(pose=made.tolist())
    stage("Open3D", "icp, voxels of 2 mm", lambda: chain(thin), pose)
    stage("Open3D", "registration", lambda: chain(thinned()), pose)


stages_of_a_cloud()
icp()
