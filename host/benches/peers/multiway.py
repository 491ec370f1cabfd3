#!/usr/bin/env python3
"""Where registered views are in the base frame: weldpath beside Open3D's multiway registration and small_gicp.

usage: multiway.py WELDPATH SCAN...    a built command, and scans of `weldpath simulate` with truth.json

Open3D: point-to-plane ICP between all pairs of views from the reported poses, voxels of 2 mm, gates of 15, 5 and 2.5 mm, then
its pose graph with the first view held. small_gicp has no pose graph: its GICP makes the edges of the same one.
Prints for each scan the root mean square over the views of how far each puts the true seams, mm (`seam`), and its camera, mm
(`camera`). weldpath is given what they are: depth images and reported poses.
"""
import json
import subprocess
import sys
import tempfile
from itertools import combinations
from pathlib import Path

import numpy as np
import open3d as o3d
import small_gicp
from scipy.spatial.transform import Rotation

VOXEL_MM = 2.0
GATES_MM = (15.0, 5.0, 2.5)
NORMALS = o3d.geometry.KDTreeSearchParamRadius(3 * VOXEL_MM)
registration = o3d.pipelines.registration


def pose(rotation, shift_mm):
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation.as_matrix(), shift_mm
    return made


def views(folder):
    """Clouds in the cameras' frames, mm, and the poses that the robot and the hand-eye transform say."""
    scan = json.loads((folder / "scan.json").read_text())
    camera, clouds, poses = scan["camera"], [], []
    flange_from_camera = np.array(scan["flange_from_camera"], float)
    flange_from_camera[:3, 3] *= 1e3
    for view in scan["views"]:
        depth = np.asarray(o3d.io.read_image(str(folder / view["depth"])))
        rows, columns = np.nonzero(depth)
        z = depth[rows, columns] * camera["depth_scale_m"] * 1e3
        x, y = ((at - camera[c]) * z / camera[f] for at, c, f in ((columns, "cx", "fx"), (rows, "cy", "fy")))
        made = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.stack([x, y, z], 1)))
        made = made.voxel_down_sample(VOXEL_MM)
        made.estimate_normals(NORMALS)
        made.orient_normals_towards_camera_location(np.zeros(3))
        clouds.append(made)
        flange = view["base_from_flange"]
        poses.append(pose(Rotation.from_rotvec(flange[3:]), np.array(flange[:3]) * 1e3) @ flange_from_camera)
    return clouds, poses


def open3d_pair(source, target, guess):
    for gate_mm in GATES_MM:
        guess = registration.registration_icp(
            source, target, gate_mm, guess, registration.TransformationEstimationPointToPlane()
        ).transformation
    return guess


def small_gicp_pair(source, target, guess):
    points = [np.asarray(cloud.points) for cloud in (target, source)]
    for gate_mm in GATES_MM:
        guess = small_gicp.align(
            *points, guess, registration_type="GICP", downsampling_resolution=VOXEL_MM,
            max_correspondence_distance=gate_mm, num_threads=1,
        ).T_target_source
    return guess


def multiway(clouds, reported, pair):
    graph = registration.PoseGraph()
    graph.nodes.extend(registration.PoseGraphNode(at) for at in reported)
    for i, j in combinations(range(len(clouds)), 2):
        j_from_i = pair(clouds[i], clouds[j], np.linalg.inv(reported[j]) @ reported[i])
        information = registration.get_information_matrix_from_point_clouds(
            clouds[i], clouds[j], GATES_MM[-1], j_from_i
        )
        graph.edges.append(registration.PoseGraphEdge(i, j, j_from_i, information, uncertain=j > i + 1))
    options = registration.GlobalOptimizationOption(
        max_correspondence_distance=GATES_MM[-1], edge_prune_threshold=0.25, reference_node=0
    )
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        registration.global_optimization(
            graph, registration.GlobalOptimizationLevenbergMarquardt(),
            registration.GlobalOptimizationConvergenceCriteria(), options,
        )
    found = [node.pose for node in graph.nodes]
    # The first view stays where it was reported, as each of the edges is between views alone.
    back = reported[0] @ np.linalg.inv(found[0])
    return [back @ at for at in found]


def ours(command, folder):
    with tempfile.TemporaryDirectory() as out:
        subprocess.run([command, "plan", folder, "--out", out, "--quiet"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        said = json.loads((Path(out) / "views.json").read_text())["views"]
    turned = lambda view: Rotation.from_quat(view["base_from_camera_wxyz"], scalar_first=True)
    return [pose(turned(view), view["position_mm"]) for view in said]


def errors_mm(found, true, seams):
    """Of the places where each view puts the seams, and of the cameras."""
    moved = [at @ np.linalg.inv(exact) for at, exact in zip(found, true)]
    seam = np.concatenate([seams @ (m[:3, :3] - np.eye(3)).T + m[:3, 3] for m in moved])
    camera = np.array([at[:3, 3] - exact[:3, 3] for at, exact in zip(found, true)])
    return [round(float(np.sqrt((off**2).sum(1).mean())), 2) for off in (seam, camera)]


def main():
    command = str(Path(sys.argv[1]).resolve())
    for folder in map(Path, sys.argv[2:]):
        truth = json.loads((folder / "truth.json").read_text())
        seams = np.concatenate([np.array(seam["p"]) for seam in truth["seams"]])
        true = [np.array(at) for at in truth["true_cam"]]
        clouds, reported = views(folder)
        row = {"scan": str(folder)}
        for name, found in (
            ("reported", reported),
            ("Open3D", multiway(clouds, reported, open3d_pair)),
            ("small_gicp", multiway(clouds, reported, small_gicp_pair)),
            ("weldpath", ours(command, str(folder))),
        ):
            row[name] = dict(zip(("seam", "camera"), errors_mm(found, true, seams)))
        print(json.dumps(row), flush=True)


main()
