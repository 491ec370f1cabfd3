"""A peer of the check of the arm's links, written from docs/feasibility.md by somebody who did not read its sources.

All branches of the inverse kinematics (ur-analytic-ik, py-opw-kinematics) and all whole turns are followed at every sample of
the program; it is feasible where one continuous way stays in range and touches nothing. Lengths are mm, angles rad; geometry
is in the frame of the robot's base.

`python arm_links_peer.py WELDPATH` plans the cases below and compares; `python arm_links_peer.py WELDPATH DIR...` looks at
folders that `weldpath plan --robot-model` wrote.
"""

import csv
import json
import math
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import py_opw_kinematics as opw
import ur_analytic_ik
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

STEP_MM, STEP_RAD, JUMP_RAD, LINKS_MAY_MM = 10.0, math.radians(5), 0.35, 5.0
CELL_MM, STRAY_MM, WALL_POINTS = 6.0, 12.0, 3
DECIDING = {"out-of-reach", "joint-limit", "jump", "link-collision"}
KINDS = ("floor", "work", "links")
# The torch is link 7: from, to along its axis from the tip, radius; behind the body a bar runs on to the flange.
NECK, BODY, BAR_RADIUS, TORCH = (75.0, 115.0, 17.5), (115.0, 265.0, 25.0), 25.0, 7
# About the flange, for floor and work.
CABLE_RADIUS, FLANGE = 60.0, 6
TURN = 2 * math.pi
SHARES = np.array([0.11, 0.10, 0.075, 0.075, 0.055, 0.045, 0.04])

# d1, a2, a3, d4, d5, d6; how far upper arm and forearm stand aside; radii of base, shoulder, upper arm, forearm, wrists.
OFFSET = {
    "ur5e": ([162.5, -425.0, -392.2, 133.3, 99.7, 99.6], (138.0, 7.0), [75, 70, 59, 54, 40, 40, 40]),
    "ur10e": ([180.7, -612.7, -571.55, 174.15, 119.85, 116.55], (176.2, 39.3), [95, 86, 75, 60, 46, 46, 46]),
}
# a1, a2, b, c1 to c4; offsets; which joints count backwards; limits; mounting surface.
SPHERICAL = {
    "abb-irb1600-10-145": ([150, 0, 0, 486.5, 700, 600, 65], [0, 0, -90, 0, 0, 0], [],
                           [[-180, 180], [-90, 150], [-245, 65], [-200, 200], [-115, 115], [-400, 400]], 0.0),
    "kuka-kr10-r1420": ([150, -20, 0, 450, 610, 660, 80], [0, -90, 0, 0, 0, 0], [0, 3, 5],
                        [[-170, 170], [-185, 65], [-137, 163], [-185, 185], [-120, 120], [-350, 350]], 0.0),
    "fanuc-m10ia": ([150, -200, 0, 0, 600, 640, 100], [0, 0, -90, 0, 0, 180], [2, 3, 4, 5],
                    [[-180, 180], [-90, 160], [-180, 264], [-190, 190], [-190, 190], [-360, 360]], -450.0),
}
Segments = list[tuple[int, np.ndarray, np.ndarray, float]]


class OffsetWrist:
    """A Universal Robot: joints and links along its DH parameters."""

    pairs = {(1, 3), (1, 4), (1, 5), (1, 6), (2, 4), (2, 5), (2, 6), (3, 6)}
    mounting_mm, limits = 0.0, np.radians([[-360, 360]] * 2 + [[-180, 180]] + [[-360, 360]] * 3)

    def __init__(self, name: str) -> None:
        self.lengths, self.aside, self.radii = OFFSET[name]
        self.solver = getattr(ur_analytic_ik, name)

    def inverse(self, flange: np.ndarray) -> np.ndarray:
        found = np.full((len(flange), 8, 6), np.nan)
        for row, pose in zip(found, flange, strict=True):
            metres = pose * np.array([1, 1, 1, 0.001])
            metres[3, 3] = 1
            for branch, q in enumerate(self.solver.inverse_kinematics(metres)):
                row[branch] = q
        return found

    def forward(self, q: np.ndarray) -> np.ndarray:
        poses = np.array([self.solver.forward_kinematics(*row) for row in q])
        poses[:, :3, 3] *= 1000
        return poses

    def segments(self, q: np.ndarray, flange: np.ndarray) -> Segments:
        d1, a2, a3, d4, _, d6 = self.lengths
        c, s, base = np.cos(q[:, 0]), np.sin(q[:, 0]), np.zeros((len(q), 3))
        sideways = np.stack([s, -c, 0 * c], 1)
        along = [np.stack([c * np.cos(t), s * np.cos(t), np.sin(t)], 1) for t in (q[:, 1], q[:, 1] + q[:, 2])]
        shoulder = base + [0, 0, d1]
        elbow = shoulder + a2 * along[0]
        wrist = elbow + a3 * along[1]
        upper, fore = (mm * sideways for mm in self.aside)
        second, third = wrist + d4 * sideways, flange[:, :3, 3] - d6 * flange[:, :3, 2]
        ends = [(1, base, shoulder), (1, shoulder, shoulder + upper), (2, shoulder + upper, elbow + upper),
                (2, elbow + upper, elbow + fore), (3, elbow + fore, wrist + fore), (3, wrist + fore, wrist),
                (4, wrist, second), (5, second, third), (6, third, flange[:, :3, 3])]
        return [(link, start, end, self.radii[link]) for link, start, end in ends]


class SphericalWrist:
    """An arm by its OPW parameters."""

    pairs = {(1, 4), (1, 5), (1, 6), (2, 5), (2, 6)}

    def __init__(self, name: str) -> None:
        self.lengths, offsets, backwards, limits, self.mounting_mm = SPHERICAL[name]
        self.offsets, self.signs = np.radians(offsets), np.array([-1.0 if i in backwards else 1.0 for i in range(6)])
        self.limits, self.radii = np.radians(limits), np.round(SHARES * sum(self.lengths[4:6]))
        flips = tuple(i in backwards for i in range(6))
        model = opw.KinematicModel(*map(float, self.lengths), offsets=tuple(self.offsets), flip_axes=flips)
        self.solver = opw.Robot(model, degrees=False)

    def inverse(self, flange: np.ndarray) -> np.ndarray:
        return np.array(self.solver.reach(RigidTransform.from_matrix(flange)).joints)

    def forward(self, q: np.ndarray) -> np.ndarray:
        return self.solver.batch_forward(np.ascontiguousarray(q)).as_matrix()

    def segments(self, q: np.ndarray, flange: np.ndarray) -> Segments:
        a1, a2, _, c1, c2, c3, _ = self.lengths
        turn, upper, third = (q * self.signs - self.offsets)[:, :3].T
        fore = upper + third

        def plane(x: np.ndarray | float, z: np.ndarray | float) -> np.ndarray:
            return np.stack([x * np.cos(turn), x * np.sin(turn), z + 0 * turn], 1)

        axis2 = plane(a1, c1)
        axis3 = axis2 + c2 * plane(np.sin(upper), np.cos(upper))
        elbow = axis3 + a2 * plane(np.cos(fore), -np.sin(fore))
        wrist = elbow + c3 * plane(np.sin(fore), np.cos(fore))
        ends = [(1, plane(0, self.mounting_mm), plane(0, c1)), (1, plane(0, c1), axis2), (2, axis2, axis3),
                (3, axis3, elbow), (4, elbow, wrist), (5, wrist, wrist), (6, wrist, flange[:, :3, 3])]
        return [(link, start, end, self.radii[link]) for link, start, end in ends]


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)


def away(points: np.ndarray, start: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Distance of each point from the segment of the same row."""
    share = np.clip(dot(points - start, along) / np.maximum(dot(along, along), 1e-9), 0, 1)
    return np.linalg.norm(points - start - share[:, None] * along, axis=1)


def between(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Distance of the segments ab and cd, row by row: they are nearest at an end of one, or where their lines are."""
    u, v, w = b - a, d - c, a - c
    cross = np.maximum(dot(u, u) * dot(v, v) - dot(u, v) ** 2, 1e-9)
    s = np.clip((dot(u, v) * dot(v, w) - dot(v, v) * dot(u, w)) / cross, 0, 1)[:, None]
    t = np.clip((dot(u, u) * dot(v, w) - dot(u, v) * dot(u, w)) / cross, 0, 1)[:, None]
    lines = np.linalg.norm(w + s * u - t * v, axis=1)
    return np.min([lines, away(a, c, v), away(b, c, v), away(c, a, u), away(d, a, u)], axis=0)


def third_nearest(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """How far from each segment the third nearest point is."""
    far, points = np.empty(len(start)), points.astype(np.float32)
    for i in range(0, len(start), 64):
        a, along = start[i:i + 64].astype(np.float32), (end - start)[i:i + 64].astype(np.float32)
        long = dot(along, along)[:, None]
        onto = along @ points.T - dot(a, along)[:, None]
        share = np.clip(onto / np.maximum(long, 1e-6), 0, 1)
        squared = dot(a, a)[:, None] - 2 * a @ points.T + dot(points, points) - share * (2 * onto - share * long)
        far[i:i + 64] = np.sqrt(np.maximum(np.partition(squared, WALL_POINTS - 1, 1)[:, WALL_POINTS - 1], 0))
    return far


def sampled(waypoints: RigidTransform) -> RigidTransform:
    """The straight moves in steps, each ending at its waypoint."""
    places, turns = waypoints.translation, waypoints.rotation
    ways, angles = np.linalg.norm(np.diff(places, axis=0), axis=1), (turns[:-1].inv() * turns[1:]).magnitude()
    steps = np.maximum(1, np.ceil(np.maximum(ways / STEP_MM, angles / STEP_RAD) - 1e-9)).astype(int)
    when = np.concatenate([[0.0], *(i + np.arange(1, n + 1) / n for i, n in enumerate(steps))])
    at = np.stack([np.interp(when, range(len(places)), axis) for axis in places.T], 1)
    return RigidTransform.from_components(at, Slerp(range(len(places)), turns)(when))


class Scene:
    """What `weldpath plan` wrote to a folder, in the frame of the robot's base."""

    def __init__(self, folder: Path) -> None:
        job = tomllib.loads((folder / "job.toml").read_text())
        robot, tool = job["robot"], job.get("tool", {"flange_from_tcp_mm": [0, 0, 350], "flange_from_tcp_rotation_rad": [0, 0, 0]})
        self.arm = (OffsetWrist if robot["model"] in OFFSET else SphericalWrist)(robot["model"])
        scan_from_base = RigidTransform.from_components(robot["base_mm"], Rotation.from_rotvec(robot["base_rotation_rad"]))
        turned = Rotation.from_rotvec(tool["flange_from_tcp_rotation_rad"])
        self.tool_from_flange = RigidTransform.from_components(tool["flange_from_tcp_mm"], turned).inv()
        waypoints = json.loads((folder / "path.json").read_text())["waypoints"]
        torch = Rotation.from_quat([w["base_from_torch_wxyz"] for w in waypoints], scalar_first=True)
        tools = RigidTransform.from_components([w["position_mm"] for w in waypoints], torch * Rotation.from_rotvec([0, math.pi, 0]))
        self.waypoints = scan_from_base.inv() * tools
        self.samples = sampled(self.waypoints)
        raw = (folder / "model.ply").read_bytes().partition(b"end_header\n")[2]
        points = np.frombuffer(raw, "<f4").reshape(-1, 6)[:, :3].astype(float)
        self.up = scan_from_base.rotation.inv().apply([0, 0, 1])
        mounting = scan_from_base.apply([0, 0, self.arm.mounting_mm])[2]
        floor = robot.get("floor_z_mm", min(mounting, points[:, 2].min()))
        self.floor = floor - scan_from_base.translation[2]
        thin = points[np.unique(np.floor(points / CELL_MM).astype(int), axis=0, return_index=True)[1]]
        self.points = scan_from_base.inv().apply(thin[cKDTree(thin).query(thin, 2)[0][:, 1] <= STRAY_MM])

    def depths(self, q: np.ndarray, tools: RigidTransform) -> dict[str, np.ndarray]:
        """How deep the arm at each row of `q`, holding the tool, is in what it must not touch; below 0 it is free."""
        flange = (tools * self.tool_from_flange).as_matrix()
        tip, back = tools.translation, -tools.as_matrix()[:, :3, 2]
        torch = [(TORCH, tip + start * back, tip + end * back, radius) for start, end, radius in (NECK, BODY)]
        torch.append((TORCH, torch[1][2], flange[:, :3, 3], BAR_RADIUS))
        links = self.arm.segments(q, flange)
        pairs = self.arm.pairs | {(1, TORCH), (2, TORCH), (3, TORCH)}
        outer = [(link, a, b, max(r, CABLE_RADIUS) if link == FLANGE else r) for link, a, b, r in links]
        floor = [self.floor + r - np.minimum(a @ self.up, b @ self.up) for link, a, b, r in outer + torch if link > 1]
        work = [r - third_nearest(self.points, a, b) for link, a, b, r in outer if link > 1]
        others = [r + o - between(a, b, c, d) - LINKS_MAY_MM
                  for (one, a, b, r), (two, c, d, o) in product(links, links + torch) if (one, two) in pairs]
        return {kind: np.max(of, axis=0) for kind, of in zip(KINDS, (floor, work, others), strict=True)}


def runs(branches: np.ndarray, free: np.ndarray, limits: np.ndarray, jump: float = JUMP_RAD) -> bool:
    """Whether there is one continuous way over free branches within the limits, whole turns included."""
    states = (branches[0][free[0]][:, None] + TURN * np.array(list(product((-1, 0, 1), repeat=6)))).reshape(-1, 6)
    states = states[np.all((states >= limits[:, 0]) & (states <= limits[:, 1]), axis=-1)]
    for row in (found[clear] for found, clear in zip(branches[1:], free[1:], strict=True)):
        turns = np.round((states[:, None] - row) / TURN)
        there = row + TURN * turns
        may = (there >= limits[:, 0]) & (there <= limits[:, 1]) & (np.abs(there - states[:, None]) <= jump)
        old, new = np.nonzero(np.all(may, axis=-1))
        state = np.column_stack([new, turns[old, new]]).astype(int)
        once = np.unique(state @ 8 ** np.arange(7), return_index=True)[1]
        states = there[old, new][once]
    return len(states) > 0


@dataclass
class Comparison:
    """What tool and peer say of a program; strict and loose: the peer with 3 mm more or less, 0.5 degrees, 5 % of a jump."""

    tool: bool
    peer: bool
    strict: bool
    loose: bool
    stands_against: list[str]
    tip_mm: float
    turn_deg: float
    tool_depths: dict[str, float]

    @property
    def verdict(self) -> str:
        if self.tool == self.peer:
            return "agree-feasible" if self.peer else "agree-infeasible"
        return "borderline" if self.strict != self.loose else "tool-only" if self.tool else "peer-only"


def compare(folder: Path) -> Comparison:
    """The peer's verdict beside the tool's, and what the tool's own joints are worth."""
    scene = Scene(folder)
    arm, problems = scene.arm, json.loads((folder / "summary.json").read_text())["feasibility"]["problems"]
    branches = arm.inverse((scene.samples * scene.tool_from_flange).as_matrix())
    exists = ~np.isnan(branches[..., 0])
    depths = {kind: np.full(exists.shape, np.inf) for kind in KINDS}
    for kind, of in scene.depths(branches[exists], scene.samples[np.nonzero(exists)[0]]).items():
        depths[kind][exists] = of

    def feasible(allow_mm: float = 0, kinds: tuple[str, ...] = KINDS, tight: float = 0) -> bool:
        free = exists & np.all([depths[kind] <= allow_mm for kind in kinds], axis=0)
        limits = arm.limits + tight * math.radians(0.5) * np.array([1, -1])
        return runs(branches, free, limits, JUMP_RAD * (1 - 0.05 * tight))

    peer, strict, loose = feasible(), feasible(-3, tight=1), feasible(3, tight=-1)
    against = [] if peer else [kind for kind in KINDS if not feasible(kinds=(kind,))]
    if not peer and not feasible(math.inf):
        against = ["range or jump" if exists.any(axis=1).all() else "reach"]
    rows = {i: [float(row[f"j{j}_deg"]) for j in range(1, 7)]
            for i, row in enumerate(csv.DictReader((folder / "feasibility.csv").open())) if row["reachable"] == "true"}
    tip_mm, turn_deg, own = 0.0, 0.0, {}
    if rows:
        at, q = scene.waypoints[list(rows)], np.radians(list(rows.values()))
        off = at.inv() * (RigidTransform.from_matrix(arm.forward(q)) * scene.tool_from_flange.inv())
        tip_mm = float(np.linalg.norm(off.translation, axis=1).max())
        turn_deg = float(np.degrees(off.rotation.magnitude()).max())
        own = {kind: round(float(of.max()), 1) for kind, of in scene.depths(q, at).items()}
    tool = not any(problem["kind"] in DECIDING for problem in problems)
    return Comparison(tool, peer, strict, loose, against, round(tip_mm, 3), round(turn_deg, 4), own)


@dataclass
class Case:
    """A fixture, an arm and its base (mm and a rotation vector), and whether both must call it feasible."""

    fixture: str
    arm: str
    base_mm: tuple[float, float, float]
    base_rotation_rad: tuple[float, float, float]
    feasible: bool
    more: str = ""

    def plan(self, weldpath: Path, fixtures: Path, out: Path) -> None:
        """Whatever the verdict, with what a scan cannot tell of the cell."""
        job = (fixtures / "cell.toml").read_text() if self.fixture == "cell" else ""
        robot = f'[robot]\nmodel = "{self.arm}"\nbase_mm = {list(self.base_mm)}\nbase_rotation_rad = {list(self.base_rotation_rad)}\n'
        (out / "robot.toml").write_text(job + robot + self.more)
        command = [weldpath, "plan", fixtures / self.fixture, "--job", out / "robot.toml", "--out", out / "plan"]
        subprocess.run([*command, "--no-report", "--quiet", "--accept", "infeasible"], check=True)


# One free, one in the work, one in the floor, and two that the peer found: the upper arm in a thinly seen table, and the torch in
# the column of an arm whose origin is above its mounting surface.
CASES = [
    Case("cell", "abb-irb1600-10-145", (-700, -300, 0), (0, 0, 0), True),
    Case("fillet", "ur10e", (-278.6, -577.4, -218.5), (0.0093, 0.6986, 1.3067), False),
    Case("lap", "ur5e", (357.7, -680.1, -41.7), (-1.4099, -0.5945, -0.4374), False, "floor_z_mm = -41.7\n"),
    Case("fillet", "ur10e", (-124.7, -269.3, -88.8), (0, 0, 1.021), False),
    Case("lap", "fanuc-m10ia", (137.1, -683.4, 647.6), (0, 0, 1.3505), False),
]


def main(weldpath: Path, folders: list[Path]) -> None:
    """Compares what is given, or the cases; ends with an error where tool and peer differ."""
    for folder in folders:
        print(folder, compare(folder))
    wrong = []
    for case in [] if folders else CASES:
        with tempfile.TemporaryDirectory() as out:
            case.plan(weldpath, Path(__file__).parent.parent / "fixtures", Path(out))
            result = compare(Path(out) / "plan")
        print(case.fixture, case.arm, result.verdict, result.stands_against, result.tool_depths)
        agreed = result.verdict == ("agree-feasible" if case.feasible else "agree-infeasible")
        if not agreed or result.tip_mm > 0.1 or result.turn_deg > 0.05:
            wrong.append(f"{case}: {result}")
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), [Path(name) for name in sys.argv[2:]])
