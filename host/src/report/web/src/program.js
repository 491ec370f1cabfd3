// The program over time: where the torch is at any second, from the waypoints and the feed that leads to each.

import { Quaternion, Vector3 } from "three";
import { content } from "./content.js";

export const waypoints = [];
// First and last waypoint of each stretch that is welded.
export const welds = [];
export let total_s = 0;

// Whether the arc burns between a waypoint and the next.
export const burns = (i) => {
  const [a, b] = [waypoints[i], waypoints[i + 1]];
  return Boolean(a && b && a.kind === "weld" && b.kind === "weld" && a.seam === b.seam);
};

// Reads the program anew: with the page, and with each plan that is taken in its place.
export function readProgram() {
  waypoints.splice(0, waypoints.length, ...content.waypoints.map(([x, y, z, qw, qx, qy, qz, feed_mm_s, seam, kind]) => ({
    position_mm: new Vector3(x, y, z),
    rotation: new Quaternion(qx, qy, qz, qw).normalize(),
    feed_mm_s, seam, kind, time_s: 0, s_mm: 0,
  })));
  for (let i = 1; i < waypoints.length; i++) {
    const [a, b] = [waypoints[i - 1], waypoints[i]];
    const way_mm = a.position_mm.distanceTo(b.position_mm);
    b.time_s = a.time_s + way_mm / b.feed_mm_s;
    b.s_mm = burns(i - 1) ? a.s_mm + way_mm : 0;
  }
  total_s = waypoints.length ? waypoints[waypoints.length - 1].time_s : 0;
  welds.length = 0;
  for (let i = 0; i < waypoints.length; i++) {
    const last = welds[welds.length - 1];
    if (waypoints[i].kind !== "weld") continue;
    if (last && last.end === i - 1 && waypoints[last.end].seam === waypoints[i].seam) last.end = i;
    else welds.push({ seam: waypoints[i].seam, start: i, end: i });
  }
}
readProgram();

export const weldOf = (seam) => welds.find((weld) => weld.seam === seam);
export const weldTime = (weld) => waypoints[weld.end].time_s - waypoints[weld.start].time_s;

// Index of the last waypoint that has been reached.
function reached(time_s) {
  let [low, high] = [0, Math.max(waypoints.length - 1, 0)];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (waypoints[middle].time_s <= time_s) low = middle;
    else high = middle - 1;
  }
  return low;
}

// The joints, a share of the way from a waypoint to the next: null where the arm reaches no pose, undefined without an arm.
function jointsAt(i, share) {
  const moves = content.arm?.joints_rad;
  if (!moves) return undefined;
  const poses = [moves[i].at(-1), ...(moves[i + 1] ?? [])];
  const at = share * (poses.length - 1);
  const [a, b] = [poses[Math.floor(at)], poses[Math.ceil(at)]];
  return a && b && a.map((angle, k) => angle + (at % 1) * (b[k] - angle));
}

// The torch at a time: position, rotation, what it does, and how the arm stands.
export function torchAt(time_s, position_mm = new Vector3(), rotation = new Quaternion()) {
  const i = reached(time_s);
  const [a, b] = [waypoints[i], waypoints[i + 1] ?? waypoints[i]];
  const span_s = b.time_s - a.time_s;
  const share = span_s > 0 ? Math.min(Math.max((time_s - a.time_s) / span_s, 0), 1) : 0;
  position_mm.lerpVectors(a.position_mm, b.position_mm, share);
  rotation.slerpQuaternions(a.rotation, b.rotation, share);
  const arc = burns(i);
  const at = share > 0 || arc ? b : a;
  return { position_mm, rotation, arc, seam: at.seam, kind: at.kind, feed_mm_s: at.feed_mm_s, s_mm: arc ? a.s_mm + share * (b.s_mm - a.s_mm) : at.s_mm, joints_rad: jointsAt(i, share), touching: content.arm?.touching[share > 0 ? i + 1 : i] ?? null };
}
