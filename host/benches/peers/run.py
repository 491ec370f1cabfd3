#!/usr/bin/env python3
"""Sets weldpath's stages against the libraries that it could be assembled from: same clouds, same machine, same run.

    host/benches/peers/run.py [--points 100000] [--rounds 3] [--build DIR] [--python PYTHON]

Peers that are absent are left out and named: Open3D, small_gicp, scipy (pip install open3d small_gicp scipy, for the Python
given by --python), PCL, CGAL, nanoflann (Debian: libpcl-dev libcgal-dev libnanoflann-dev), kiddo and threecrate (cargo).
All run on one thread. The programs take turns, `rounds` times; CPU times are medians over all runs. Each row says
whether the work was the same: number of points, voxels, neighbours, or the error of the result."""
import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
ONE = dict(os.environ, OMP_NUM_THREADS="1", RAYON_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
PCL = "common features filters io io_ply kdtree octree sample_consensus search".split()

# What a ratio has to reach at least, and what it should.
GOALS = {
    ("load ply", "Open3D"): (8, 8), ("load pcd", "Open3D"): (8, 8),
    ("load ply", "threecrate"): (1 / 1.5, 1), ("load pcd", "threecrate"): (1 / 1.5, 1),
    ("voxel grid", "PCL"): (1.5, 2), ("index", "kiddo"): (3, 5),
    ("radius neighbours", "nanoflann"): (6, 12), ("radius neighbours", "PCL"): (6, 12),
    ("normals", "Open3D"): (4, 8), ("normals", "PCL"): (4, 8), ("bilateral", "CGAL"): (10, 30),
    ("edge score", "Open3D + numpy"): (10, 20), ("edge intensity", "Open3D"): (6, 10),
    ("icp, given normals", "threecrate"): (3, 5), ("icp, given normals", "small_gicp"): (3, 5),
    ("icp, given normals", "Open3D"): (3, 5), ("registration", "Open3D"): (5, 5),
    ("whole method", "Open3D + numpy"): (10, 20),
}
# Counts agree to this share; errors may not exceed the peer's by more than this.
SAME = dict(points=0, voxels=0.01, neighbours=2e-4)
NO_WORSE = dict(plate_error_deg=0.02, plate_rms_mm=0.02, error_deg=0.005, error_mm=0.005, across_rms_mm=0)


def built(name, build, python):
    """The command that runs a peer, or None where it cannot be built."""
    def quiet(command, **more):
        return subprocess.run(command, capture_output=True, text=True, **more)

    if name in ("open3d_gicp", "composed"):
        needs = "open3d, small_gicp" if name == "open3d_gicp" else "open3d, scipy"
        return quiet([python, "-c", f"import {needs}"]).returncode == 0 and [python, str(HERE / f"{name}.py")]
    if name == "rust":
        target = build / "rust"
        done = quiet(["cargo", "build", "--release", "--target-dir", str(target)], cwd=HERE / "rust")
        return done.returncode == 0 and [str(target / "release" / "peers")]
    # PCL's library is built for every x86-64, and a mixture breaks Eigen's alignment.
    flags = ["-O3", "-DNDEBUG", "-std=c++17", "-w", "-I/usr/include/eigen3"]
    extra = {
        "nanoflann": ["-march=native"],
        "cgal": ["-march=native", "-lgmp", "-lmpfr"],
        "pcl": ["-I/usr/include/pcl-1.13"] + [f"-lpcl_{part}" for part in PCL],
    }[name]
    program = build / name
    done = quiet(["g++", str(HERE / f"{name}.cpp"), "-o", str(program)] + flags + extra)
    return done.returncode == 0 and [str(program)]


def lines(command):
    done = subprocess.run(command, capture_output=True, text=True, env=ONE, cwd=ROOT)
    if done.returncode:
        sys.stderr.write(f"{command[0]} failed: {done.stderr[-500:]}\n")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def same_work(ours, theirs):
    """What was compared, and whether it holds."""
    words = []
    for key in sorted(set(ours or {}) & set(theirs or {})):
        a, b = ours[key], theirs[key]
        holds = abs(a - b) <= SAME[key] * b if key in SAME else a <= b + NO_WORSE.get(key, 0)
        words.append(f"{key} {a:.4g} / {b:.4g}{'' if holds else ' DIFFERS'}")
    return ", ".join(words)


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--points", type=int, default=100_000)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--build", type=pathlib.Path, default=ROOT / "target" / "peers")
    options.add_argument("--python", default=sys.executable)
    options = options.parse_args()
    options.build.mkdir(parents=True, exist_ok=True)
    message = subprocess.run(
        ["cargo", "bench", "-p", "weldpath", "--bench", "peers", "--no-run", "--message-format=json"],
        cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True,
    ).stdout
    targets = [json.loads(line) for line in message.splitlines()]
    own = [t["executable"] for t in targets if t.get("executable") and t["target"]["name"] == "peers"][0]
    commands = {name: built(name, options.build, options.python)
                for name in ("nanoflann", "pcl", "cgal", "rust", "open3d_gicp", "composed")}
    for name in [name for name, command in commands.items() if not command]:
        print(f"left out, since it is absent or does not build: {name}")
    with tempfile.TemporaryDirectory() as folder:
        compare(own, [c for c in commands.values() if c], folder, options)


def compare(own, peers, folder, options):
    subprocess.run([own, "write", folder, str(options.points)], check=True)
    radius = json.load(open(f"{folder}/meta.json"))["radius_mm"]
    took, last = {}, {}
    for _ in range(options.rounds):
        for command in [[own, "run", folder, str(options.points)]] + [c + [folder, str(radius)] for c in peers]:
            for line in lines(command):
                key = (line["stage"], line["peer"])
                per_point = 1e6 / line.get("points", options.points)
                took.setdefault(key, []).extend(ms * per_point for ms in line["cpu_ms"])
                last[key] = line["check"]
    print(f"{options.points} points, CPU ns per point, medians of {options.rounds} rounds\n")
    print(f"| {'stage':18} | {'peer':14} | {'ours':>8} | {'theirs':>9} | {'ratio':>6} | {'hold':>5} | {'aim':>5} | same work: ours / theirs |")
    print("|---|---|---:|---:|---:|---:|---:|---|")
    for (stage, peer), theirs in took.items():
        if peer == "weldpath" or (stage, "weldpath") not in took:
            continue
        ours = statistics.median(took[stage, "weldpath"])
        theirs = statistics.median(theirs)
        hold, aim = GOALS.get((stage, peer), ("", ""))
        goal = [f"{g:.2g}" if g else "" for g in (hold, aim)]
        print(f"| {stage:18} | {peer:14} | {ours:8.1f} | {theirs:9.1f} | {theirs / ours:6.2f} | {goal[0]:>5} | {goal[1]:>5} "
              f"| {same_work(last[stage, 'weldpath'], last[stage, peer])} |")


if __name__ == "__main__":
    main()
