// The edge between two flat faces that were clicked: where their planes cross, as far as both are seen beside it. The planner
// looks for the seam there, as for any that is asked for.

// What lies within this of a click and faces as it does is its face; that close to a plane a point is on it, mm.
const ABOUT_MM = 10;
const ALIKE = 0.9;
const ON_MM = 1.5;
// A face counts beside the edge up to this far from it, in steps of this along it, and over so many steps that show nothing.
const BESIDE_MM = 12;
const STEP_MM = 3;
const GAP_STEPS = 2;
// Planes whose normals are nearer to each other than this, as a sine, have no edge; a shorter one is none, mm.
const LEAST_SINE = 0.2;
const LEAST_MM = 6;

const sub = (a, b) => a.map((v, k) => v - b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (p, d, s) => p.map((v, k) => v + s * d[k]);
function unit(v) {
  const length = Math.hypot(...v);
  return v.map((one) => one / length);
}

// The plane of a face about a place on it: mean place and mean normal of what faces as it does.
function planeOf(points, { mm, normal }) {
  const sum = { mm: [0, 0, 0], normal: [0, 0, 0], count: 0 };
  for (const point of points) {
    if (Math.hypot(...sub(point.mm, mm)) > ABOUT_MM || dot(point.normal, normal) < ALIKE) continue;
    sum.mm = along(sum.mm, point.mm, 1);
    sum.normal = along(sum.normal, point.normal, 1);
    sum.count += 1;
  }
  return sum.count ? { mm: sum.mm.map((v) => v / sum.count), normal: unit(sum.normal) } : { mm, normal };
}

// A place where two planes cross, the nearest to the middle between theirs, and the direction in which they do; null if they do not.
function crossing(a, b) {
  const direction = cross(a.normal, b.normal);
  if (Math.hypot(...direction) < LEAST_SINE) return null;
  const d = unit(direction);
  let at = a.mm.map((v, k) => 0.5 * (v + b.mm[k]));
  // Two steps in the plane that both normals span.
  const c = dot(a.normal, b.normal);
  const [ha, hb] = [dot(sub(a.mm, at), a.normal), dot(sub(b.mm, at), b.normal)];
  at = along(along(at, a.normal, (ha - c * hb) / (1 - c * c)), b.normal, (hb - c * ha) / (1 - c * c));
  return { at, d };
}

// Both ends of the edge between two faces, mm; null if there is none. `points` are { mm, normal }.
export function edgeBetween(points, clicked) {
  const faces = clicked.map((place) => planeOf(points, place));
  const line = crossing(...faces);
  if (!line) return null;
  const seen = [new Set(), new Set()];
  for (const { mm, normal } of points) {
    const off = sub(mm, line.at);
    const s = dot(off, line.d);
    if (Math.hypot(...along(off, line.d, -s)) > BESIDE_MM) continue;
    faces.forEach((face, k) => {
      if (Math.abs(dot(sub(mm, face.mm), face.normal)) < ON_MM && dot(normal, face.normal) > ALIKE) seen[k].add(Math.floor(s / STEP_MM));
    });
  }
  const both = [...seen[0]].filter((step) => seen[1].has(step)).sort((a, b) => a - b);
  // Of several stretches the one beside the clicks.
  const middle = dot(sub(clicked[0].mm, line.at), line.d) + dot(sub(clicked[1].mm, line.at), line.d);
  const runs = [];
  for (const step of both) {
    if (runs.length && step - runs.at(-1)[1] <= 1 + GAP_STEPS) runs.at(-1)[1] = step;
    else runs.push([step, step]);
  }
  const away = ([low, high]) => Math.max(low * STEP_MM - 0.5 * middle, 0.5 * middle - (high + 1) * STEP_MM, 0);
  const run = runs.sort((a, b) => away(a) - away(b))[0];
  if (!run || (run[1] + 1 - run[0]) * STEP_MM < LEAST_MM) return null;
  return [run[0], run[1] + 1].map((step) => along(line.at, line.d, step * STEP_MM));
}
