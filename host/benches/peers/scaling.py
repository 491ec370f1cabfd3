#!/usr/bin/env python3
"""How the cost of a point grows with their number, and what two threads gain: measures, and draws what was measured.

    host/benches/peers/scaling.py [--most 10000000] [--rounds 3] [--out docs/scaling]     writes docs/scaling.csv and .svg
    host/benches/peers/scaling.py --draw [--out docs/scaling]                             draws the .csv anew

Stages by `ours`, and `weldpath plan` as a process, from file to files, whose peak memory is taken less that of a run without a
cloud to speak of. CPU times are medians over the rounds. Wall times, from which the gain of two threads follows, are the least of
all rounds: other processes only ever add to them."""
import argparse
import csv
import json
import math
import os
import pathlib
import statistics
import subprocess
import tempfile
import time

from run import KEPT, ROOT, own_programs

HOLDS = dict(growth=1.5, gain=1.7, bytes=200)
PLAN = "whole plan, as a process"


def stages(own, folder, threads):
    environment = dict(os.environ, **KEPT, RAYON_NUM_THREADS=str(threads))
    for mode in ("linear", "whole"):
        done = subprocess.run([own, mode, folder], capture_output=True, text=True, env=environment, check=True)
        for line in map(json.loads, done.stdout.splitlines()):
            if mode == "whole" and not line["check"]:
                continue  # too few points for a seam that can be welded
            yield line["stage"], [ms / 1e3 for ms in line["cpu_ms"]], [ms / 1e3 for ms in line["wall_ms"]]


def plan(binary, cloud, threads, out):
    """CPU seconds, wall seconds and peak bytes of a process, and whether it found a seam."""
    begin = time.perf_counter()
    environment = dict(os.environ, RAYON_NUM_THREADS=str(threads))
    quiet = dict(stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    process = subprocess.Popen([binary, "plan", "--quiet", "--out", out, cloud], env=environment, **quiet)
    _, status, used = os.wait4(process.pid, 0)
    return used.ru_utime + used.ru_stime, time.perf_counter() - begin, used.ru_maxrss * 1024, status == 0


def measure(own, binary, sizes, rounds):
    """Rows of the table. The sizes take turns: what they cost changes by more from minute to minute than from size to size."""
    cpu, wall, peak = {}, {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for points in sizes:
            os.mkdir(f"{folder}/{points}")
            subprocess.run([own, "write", f"{folder}/{points}", str(points)], check=True)
        for turn in range(rounds):
            # Ten million points take a minute, and vary less.
            for points in (n for n in sizes if n < 10**7 or turn == 0):
                for threads in (1, 2):
                    runs = list(stages(own, f"{folder}/{points}", threads))
                    cpu_s, wall_s, held, found = plan(binary, f"{folder}/{points}/butt.ply", threads, f"{folder}/out")
                    if found:
                        runs.append((PLAN, [cpu_s], [wall_s]))
                    if found and threads == 1:
                        peak.setdefault((points, PLAN, threads), []).append(held)
                    for stage, cpu_s, wall_s in runs:
                        cpu.setdefault((points, stage, threads), []).extend(cpu_s)
                        wall.setdefault((points, stage, threads), []).extend(wall_s)
            print(f"round {turn + 1} of {rounds}, load {os.getloadavg()[0]:.1f}", flush=True)
    idle = idle_bytes(own, binary)
    for key in sorted(cpu, key=lambda key: key[0]):
        points, stage, threads = key
        held = (statistics.median(peak[key]) - idle) / points if key in peak else None
        yield dict(
            stage=stage, points=points, threads=threads,
            cpu_ns_per_point=round(1e9 * statistics.median(cpu[key]) / points, 1),
            wall_ns_per_point=round(1e9 * min(wall[key]) / points, 1),
            peak_bytes_per_point="" if held is None else round(held, 1),
        )


def idle_bytes(own, binary):
    """What a run holds with ten points, in which there is nothing to find."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([own, "write", folder, "10"], check=True)
        return plan(binary, f"{folder}/butt.ply", 1, f"{folder}/out")[2]


def table(rows):
    at = {(r["stage"], int(r["points"]), int(r["threads"])): r for r in rows}
    sizes = sorted({int(r["points"]) for r in rows})
    most = min(10**6, sizes[-1])
    lines = ["| stage | " + " | ".join(f"{n:.0e}".replace("+0", "") for n in sizes) + f" | {most:.0e} to {most // 10:.0e} | two threads, {most:.0e} |".replace("+0", "")]
    lines.append("|---|" + "---:|" * (len(sizes) + 2))
    for stage in dict.fromkeys(r["stage"] for r in rows):
        cost = lambda n, threads=1, kind="cpu": float(at[stage, n, threads][f"{kind}_ns_per_point"])
        cells = [f"{cost(n):.0f}" if (stage, n, 1) in at else "" for n in sizes]
        if (stage, most // 10, 1) not in at:
            continue
        growth, gain = cost(most) / cost(most // 10), cost(most, 1, "wall") / cost(most, 2, "wall")
        words = [f"{growth:.2f}" + (" MISSED" if growth > HOLDS["growth"] else "")]
        words += [f"{gain:.2f}" + (" MISSED" if gain < HOLDS["gain"] and "whole" in stage else "")]
        lines.append(f"| {stage} | " + " | ".join(cells + words) + " |")
    held = {int(r["points"]): float(r["peak_bytes_per_point"]) for r in rows if r["peak_bytes_per_point"] != ""}
    most = [f"{b:.0f} at {n:.0e}{' MISSED' if b > HOLDS['bytes'] else ''}".replace("+0", "") for n, b in held.items()]
    return "\n".join(lines) + "\n\nPeak bytes per point of the process: " + ", ".join(most)


COLOURS = "#b08060 #0060c0 #c04000 #208040 #8040a0 #a08000 #008090 #c02070 #606060 #404080 #000000".split()


def panel(x0, title, series, low, high, sizes):
    """One logarithmic panel: lines over the number of points, named at their right ends."""
    x = lambda n: x0 + 260 * math.log10(n / sizes[0]) / math.log10(sizes[-1] / sizes[0])
    y = lambda v: 340 - 290 * math.log10(v / low) / math.log10(high / low)
    svg = [f'<text x="{x0}" y="30">{title}</text><path d="M{x0} 50V340H{x0 + 260}" fill="none" stroke="black"/>']
    for n in sizes:
        svg.append(f'<text x="{x(n):.0f}" y="358" text-anchor="middle">{n:.0e}</text>'.replace("+0", ""))
    for tick in (v for k in range(-1, 6) for v in (10**k, 3 * 10**k) if low <= v <= high):
        svg.append(f'<path d="M{x0} {y(tick):.1f}h260" stroke="#ddd"/><text x="{x0 - 6}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    below = 0
    for (name, values), colour in sorted(zip(series.items(), COLOURS), key=lambda s: y(s[0][1][-1][1])):
        line = " ".join(f"{x(n):.1f},{y(v):.1f}" for n, v in values)
        svg.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        below = max(below + 14, y(values[-1][1]) + 4)
        svg.append(f'<text x="{x0 + 268}" y="{below:.0f}" fill="{colour}">{name}</text>')
    return svg


def draw(rows):
    sizes = sorted({int(r["points"]) for r in rows})
    times, held = {}, {}
    for r in rows:
        if int(r["threads"]) == 1:
            times.setdefault(r["stage"], []).append((int(r["points"]), float(r["cpu_ns_per_point"])))
        if r["peak_bytes_per_point"] != "":
            held.setdefault("weldpath plan", []).append((int(r["points"]), float(r["peak_bytes_per_point"])))
    held["hold"] = [(n, HOLDS["bytes"]) for n in sizes]
    svg = ['<svg xmlns="http://www.w3.org/2000/svg" width="960" height="380" font-family="sans-serif" font-size="12">',
           '<rect width="960" height="380" fill="white"/>']
    svg += panel(60, "CPU ns per point, one thread, over the number of points", times, 1, 10_000, sizes)
    svg += panel(580, "peak bytes per point", held, 10, 1000, sizes)
    return "\n".join(svg + ["</svg>", ""])


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--most", type=int, default=10_000_000)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--draw", action="store_true")
    options.add_argument("--out", default=str(ROOT / "docs" / "scaling"))
    options = options.parse_args()
    data = pathlib.Path(options.out + ".csv")
    if not options.draw:
        programs = own_programs()
        own, binary = programs["peers"], programs["weldpath"]
        sizes = [10**k for k in range(4, 9) if 10**k <= options.most]
        rows = list(measure(own, binary, sizes, options.rounds))
        with data.open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    rows = list(csv.DictReader(data.open()))
    pathlib.Path(options.out + ".svg").write_text(draw(rows))
    print(table(rows))


if __name__ == "__main__":
    main()
