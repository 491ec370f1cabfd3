// The cross-section of the selected seam at a place along it: points of the scan, fitted faces, root, torch and stated error, to
// scale; and what is between two places that are clicked in it.

import { el, svg } from "../../src/dom.js";
import { GROUPS, WORDS } from "../../src/texts.js";
import { section as fetchSection } from "./server.js";

// Width of the drawing, and what is left for words at its edge, in its own units.
const SIZE = 360;
const MARGIN = 4;
const TORCH_MM = 30;
const SCALE_MM = 10;

// Looks outlive the panel, which is made anew: how far along which seam.
const at = new Map();

const shown = (mm) => (mm === null ? WORDS.unknown : `${mm.toFixed(2)} mm`);
const angleDeg = ([a, b]) => (180 / Math.PI) * Math.acos(Math.min(Math.max(a[0] * b[0] + a[1] * b[1], -1), 1));

// From millimetres to the drawing: the root lies below its middle, for the torch stands above it.
function frame(reach) {
  const scale = (SIZE - 2 * MARGIN) / (2 * reach);
  const down = 0.7 * SIZE;
  return {
    scale,
    to: ([o, n]) => [SIZE / 2 + scale * o, down - scale * n],
    from: (x, y) => [(x - SIZE / 2) / scale, (down - y) / scale],
  };
}

function line(to, a, b, attributes) {
  const [[x1, y1], [x2, y2]] = [to(a), to(b)];
  return svg("line", { x1, y1, x2, y2, ...attributes });
}

const along = ([o, n], mm, [a, b] = [0, 0]) => [a + mm * o, b + mm * n];

function parts(found, { to, scale }) {
  const root = to([0, 0]);
  const reach = found.reach_mm;
  const dots = found.points_mm.map((p) => { const [cx, cy] = to(p); return svg("circle", { cx, cy, r: 1.3, class: "point" }); });
  const faces = found.faces.map((face) => line(to, [0, 0], along(face, 0.8 * reach), { class: "face" }));
  const torches = found.torches.flatMap(({ tip_mm, axis }) => {
    const [cx, cy] = to(tip_mm);
    return [line(to, tip_mm, along(axis, TORCH_MM, tip_mm), { class: "torch" }), svg("circle", { cx, cy, r: 3, class: "tip" })];
  });
  const error = found.error_mm === null ? [] : [svg("circle", { cx: root[0], cy: root[1], r: scale * found.error_mm, class: "error" })];
  const rule = [MARGIN + 6, SIZE - 10];
  return [...dots, ...faces, ...torches, ...error,
    svg("path", { d: `M${root[0] - 5} ${root[1]}h10M${root[0]} ${root[1] - 5}v10`, class: "root" }),
    svg("path", { d: `M${rule[0]} ${rule[1] - 4}v4h${SCALE_MM * scale}v-4`, class: "rule" }),
    svg("text", { x: rule[0] + 0.5 * SCALE_MM * scale, y: rule[1] - 6, "text-anchor": "middle" }, `${SCALE_MM} mm`)];
}

// Two places that are clicked, and what is between them.
function ruler(picture, result) {
  let places = [];
  let marks = [];
  return {
    click(event, { to, from }) {
      const box = picture.getBoundingClientRect();
      if (places.length === 2) this.clear();
      places.push(from(((event.clientX - box.left) * SIZE) / box.width, ((event.clientY - box.top) * SIZE) / box.height));
      const [cx, cy] = to(places.at(-1));
      marks.push(svg("circle", { cx, cy, r: 3, class: "measure" }));
      if (places.length === 2) marks.push(line(to, ...places, { class: "measure" }));
      picture.append(...marks);
      const [o, n] = places.length === 2 ? [0, 1].map((k) => places[1][k] - places[0][k]) : [0, 0];
      result.textContent = places.length === 2 ? WORDS.between(Math.hypot(o, n), o, n) : WORDS.secondPlace;
    },
    clear() {
      marks.forEach((mark) => mark.remove());
      [places, marks] = [[], []];
      result.textContent = WORDS.measureHere;
    },
  };
}

// The group of a seam's settings; `onPlane(section)` is told what is looked at, and nothing when it is no longer.
export function section(group, { seam, length_mm }, open, onPlane) {
  const picture = svg("svg", { viewBox: `0 0 ${SIZE} ${SIZE}`, class: "section", role: "img", "aria-label": GROUPS.section });
  const slider = el("input", { type: "range", id: "section-at", min: 0, step: "any", "aria-label": WORDS.alongSeam(seam) });
  const place = el("output", { for: "section-at" });
  const words = el("p", { class: "soft", "aria-live": "polite" });
  const result = el("p", { class: "soft", role: "status" }, WORDS.measureHere);
  const box = group("section", open, [el("div", { class: "along" }, slider, place), picture, words, result]);
  const measure = ruler(picture, result);
  const half = () => 0.5 * length_mm;
  let now = null;
  let wanted = 0;
  let plan = null;
  picture.addEventListener("click", (event) => now && measure.click(event, now));
  async function look(at_mm) {
    wanted += 1;
    const mine = wanted;
    const found = await fetchSection(seam, at_mm);
    // Of several that were asked for the last one counts.
    if (mine !== wanted) return;
    measure.clear();
    if (typeof found === "string") {
      now = null;
      picture.replaceChildren();
      words.textContent = found;
      return;
    }
    now = frame(found.reach_mm);
    picture.replaceChildren(...parts(found, now));
    slider.max = found.length_mm;
    slider.value = at_mm;
    place.textContent = WORDS.ofLength(found.at_mm, found.length_mm);
    slider.setAttribute("aria-valuetext", place.textContent);
    words.textContent = WORDS.section(angleDeg(found.faces), shown(found.error_mm), shown(found.relative_mm), found.points_mm.length);
    picture.setAttribute("aria-label", `${WORDS.sectionOf(seam, found.at_mm)} ${words.textContent}`);
    onPlane(box.open ? found : null);
  }
  slider.addEventListener("input", () => {
    at.set(seam, Number(slider.value));
    look(at.get(seam));
  });
  box.addEventListener("toggle", () => {
    if (box.open) look(at.get(seam) ?? half());
    else onPlane(null);
  });
  box.update = (state) => {
    if (state.plan === plan) return;
    plan = state.plan;
    if (box.open) look(at.get(seam) ?? half());
  };
  return box;
}
