#!/usr/bin/env python3
"""Sets weldpath's stages against the libraries that it could be assembled from: same clouds, same machine, same run.

    host/benches/peers/run.py [--points 100000] [--rounds 5] [--build DIR] [--python PYTHON] [--out TABLE.md] [--skip "STAGE;STAGE"]

Peers that are absent are left out and named: Open3D, small_gicp, scipy (pip install open3d small_gicp scipy, for the Python
given by --python), PCL, CGAL, nanoflann (Debian: libpcl-dev libcgal-dev libnanoflann-dev), kiddo and threecrate (cargo).
All run on one thread, with an allocator that keeps freed memory. The programs take turns, `rounds` times; CPU times are medians
over all runs; what takes longer than ten seconds runs in the first round only. Each row says what shows that the work was the
same. Where it was not, the row says DIFFERS and the exit code is 1; a ratio below its goal says MISSED."""
import argparse
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
# The allocator keeps freed memory, in one store for all threads, as `weldpath` has it do: for everybody, so that nobody fetches pages anew.
KEPT = dict(MALLOC_ARENA_MAX="1", MALLOC_MMAP_THRESHOLD_=str(1 << 25), MALLOC_TRIM_THRESHOLD_=str(2**31 - 1))
ONE = dict(os.environ, **KEPT, OMP_NUM_THREADS="1", RAYON_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
PCL = "common features filters io io_ply kdtree octree sample_consensus search".split()
LONG_MS = 10_000

# What a ratio has to reach at least, and what it should; and where that differs at a million points.
GOALS = {
    ("load ply", "Open3D"): (8, 8), ("load pcd", "Open3D"): (8, 8),
    ("load ply", "threecrate"): (1 / 1.5, 1), ("load pcd", "threecrate"): (1 / 1.5, 1),
    ("voxel grid", "PCL"): (1.5, 2), ("index", "kiddo"): (3, 5),
    ("radius neighbours", "nanoflann"): (6, 12), ("radius neighbours", "PCL"): (6, 12),
    ("normals", "Open3D"): (4, 8), ("normals", "PCL"): (4, 8), ("bilateral", "CGAL"): (10, 30),
    ("edge score", "Open3D + numpy"): (10, 20), ("edge intensity", "Open3D"): (6, 10),
    ("icp, given normals", "threecrate"): (3, 5), ("icp, given normals", "small_gicp GICP"): (3, 5),
    ("icp, given normals", "Open3D"): (3, 5), ("registration", "Open3D"): (5, 5),
    ("icp, voxels of 2 mm", "Open3D"): (5, 5), ("whole method", "Open3D + numpy"): (10, 20),
}
MILLION = {("voxel grid", "PCL"): (1, 2), ("whole method", "Open3D + numpy"): (None, None)}
# Counts and means agree to this share of the peer's.
SAME = dict(points=0, voxels=1e-3, mean_z_mm=1e-3, neighbours=2e-4, intensity=0.01, moved_rms_mm=0.01)
# Open3D lays its voxels from another corner, and noise across a boundary makes more of them.
ELSEWHERE = {("voxels", "Open3D"), ("mean_z_mm", "Open3D")}
# Errors may not exceed the peer's by more than this.
NO_WORSE = dict(plate_error_deg=0.02, across_rms_mm=0)
# Peers that solve the same equations as ours reach the same place, to so many degrees and mm.
SAME_PLACE = {("icp, given normals", "Open3D"), ("icp, given normals", "threecrate"), ("icp, voxels of 2 mm", "Open3D")}
APART = (0.005, 0.005)
# Furthest from the truth that a registration of 100 000 points may be, degrees and mm.
TRUE = {"registration": (0.035, 0.05), "icp, voxels of 2 mm": (0.035, 0.05)}
NOTES = {
    ("index", "kiddo"): "the index of the neighbours below",
    ("radius neighbours", "PCL"): "listed, ours counted", ("radius neighbours", "kiddo"): "listed, ours counted",
    ("radius neighbours", "nanoflann"): "listed, ours counted",
    ("edge intensity", "Open3D"): "another measure for the same purpose",
    ("icp, given normals", "small_gicp GICP"): "plane to plane, other equations",
    ("voxel grid", "Open3D"): "its lattice begins elsewhere", ("bilateral", "CGAL"): "another formula, as many neighbours, same normals",
}


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
    program, sources = build / name, [HERE / f"{name}.cpp", HERE / "bench.h"]
    if program.exists() and all(source.stat().st_mtime < program.stat().st_mtime for source in sources):
        return [str(program)]
    done = quiet(["g++", str(HERE / f"{name}.cpp"), "-o", str(program)] + flags + extra)
    return done.returncode == 0 and [str(program)]


def lines(command, skipped):
    environment = dict(ONE, SKIP=";".join(sorted(skipped)))
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    if done.returncode:
        sys.exit(f"{command[0]} failed: {done.stderr[-500:]}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def between(a, b, centre):
    """How far two poses are apart: degrees, and mm at a place of the source."""
    turn = [[sum(a[r][k] * b[c][k] for k in range(3)) for c in range(3)] for r in range(3)]
    skew = math.hypot(turn[2][1] - turn[1][2], turn[0][2] - turn[2][0], turn[1][0] - turn[0][1]) / 2
    moved = lambda m: [sum(m[r][k] * centre[k] for k in range(3)) + m[r][3] for r in range(3)]
    return math.degrees(math.asin(min(1, skew))), math.dist(moved(a), moved(b))


def same_pose(stage, peer, ours, theirs, meta):
    """The errors of both poses and how far they are apart, and whether that is near enough."""
    truth, centre = meta["target_from_source"], meta["centre_mm"]
    errors = [between(found["pose"], truth, centre) for found in (ours, theirs)]
    words = ["error {:.4f} deg {:.4f} mm / {:.4f} deg {:.4f} mm".format(*errors[0], *errors[1])]
    holds = True
    if (stage, peer) in SAME_PLACE:
        apart = between(ours["pose"], theirs["pose"], centre)
        holds = all(a <= most for a, most in zip(apart, APART))
        words.append("apart {:.4f} deg {:.4f} mm".format(*apart))
    if stage in TRUE and meta["pair_points"] == 100_000:
        near = all(e <= most for e, most in zip(errors[0], TRUE[stage]))
        words.append("at most {} deg {} mm{}".format(*TRUE[stage], "" if near else " MISSED"))
    if "iterations" in ours and "iterations" in theirs:
        words.append(f"{ours['iterations']} / {theirs['iterations']} iterations")
    return words, holds


def same_work(stage, peer, ours, theirs, meta):
    """What was compared, and whether it holds."""
    ours, theirs = ours or {}, theirs or {}
    words, holds = ([NOTES[stage, peer]] if (stage, peer) in NOTES else []), True
    for key in sorted(set(ours) & set(theirs)):
        a, b = ours[key], theirs[key]
        if a is None or b is None:
            words.append(f"{key}: not a number")
            continue
        if key == "pose":
            more, same = same_pose(stage, peer, ours, theirs, meta)
            words += more
        elif key in SAME:
            same = (key, peer) in ELSEWHERE or abs(a - b) <= SAME[key] * abs(b)
            words.append(f"{key} {a:.6g} / {b:.6g}")
        elif key in NO_WORSE:
            same = a <= b + NO_WORSE[key]
            words.append(f"{key} {a:.4g} / {b:.4g}")
        elif key == "plate_rms_mm":
            same = True
            words.append(f"plates 0.3 mm to {a:.3f} / {b:.3f}")
        elif key == "peak_mib":
            same = True
            words.append(f"peak {a:.0f} / {b:.0f} MiB, at most a tenth{'' if a <= b / 10 else ' MISSED'}")
        else:
            continue
        holds &= same
    return ", ".join(words) + ("" if holds else " DIFFERS"), holds


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--points", type=int, default=100_000)
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--build", type=pathlib.Path, default=ROOT / "target" / "peers")
    options.add_argument("--python", default=sys.executable)
    options.add_argument("--skip", default="", help="stages that are left out, separated by semicolons")
    options.add_argument("--out", type=pathlib.Path, help="also write the table to this file")
    options = options.parse_args()
    options.build.mkdir(parents=True, exist_ok=True)
    own = own_programs()["peers"]
    names = ("composed", "nanoflann", "pcl", "cgal", "rust", "open3d_gicp")
    commands = {name: built(name, options.build, options.python) for name in names}
    absent = [name for name, command in commands.items() if not command]
    with tempfile.TemporaryDirectory() as folder:
        table, same = compare(own, [c for c in commands.values() if c], folder, options)
    table += "".join(f"\nLeft out, since it is absent or does not build: {name}." for name in absent)
    print(table)
    if options.out:
        options.out.write_text(table + "\n")
    sys.exit(0 if same else 1)


def own_programs():
    """Where the bench and the command are, built anew."""
    targets = []
    for build in ["bench -p weldpath-benches --bench peers --no-run", "build --release -p weldpath"]:
        command = ["cargo", *build.split(), "--message-format=json"]
        message = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
        targets += [json.loads(line) for line in message.splitlines()]
    return {t["target"]["name"]: t["executable"] for t in targets if t.get("executable")}


def compare(own, peers, folder, options):
    """The table, and whether all work was the same."""
    subprocess.run([own, "write", folder, str(options.points)], check=True)
    meta = json.load(open(f"{folder}/meta.json"))
    took, last, long, skipped = {}, {}, set(), set(options.skip.split(";"))
    # The composed method comes first: it leaves the cloud whose edges all score.
    programs = [(*c, folder, str(meta["radius_mm"])) for c in peers] + [(own, "run", folder), (own, "whole", folder)]
    for k in range(options.rounds):
        for program in programs:
            for line in lines(program, skipped | {stage for first, stage in long if first == program[:2]}):
                key = (line["stage"], line["peer"])
                took.setdefault(key, []).extend(line["cpu_ms"])
                last[key] = line["check"]
                if max(line["cpu_ms"]) > LONG_MS:
                    long.add((program[:2], line["stage"]))
        print(f"round {k + 1} of {options.rounds}, load {os.getloadavg()[0]:.1f}", file=sys.stderr)
    rows = [f"{options.points} points ({meta['pair_points']} in each cloud of the pair), one thread, CPU ms, medians of {options.rounds} rounds\n",
            "| stage | peer | ours | theirs | ratio | hold | aim | same work: ours / theirs |",
            "|---|---|---:|---:|---:|---:|---:|---|"]
    goals = GOALS | (MILLION if options.points >= 1_000_000 else {})
    all_same = True
    for stage in [stage for stage, peer in took if peer == "weldpath"]:
        for peer in [peer for other, peer in took if other == stage and peer != "weldpath"]:
            ours, theirs = (statistics.median(took[stage, name]) for name in ("weldpath", peer))
            hold, aim = goals.get((stage, peer), (None, None))
            ratio = theirs / ours
            goal = [f"{g:.2g}" if g else "" for g in (hold, aim)]
            missed = " MISSED" if hold and ratio < hold else ""
            words, same = same_work(stage, peer, last[stage, "weldpath"], last[stage, peer], meta)
            all_same &= same
            rows.append(f"| {stage} | {peer} | {ours:.3g} | {theirs:.3g} | {ratio:.2f}{missed} | {goal[0]} | {goal[1]} | {words} |")
    return "\n".join(rows), all_same


if __name__ == "__main__":
    main()
