// The two ends of the selected seam as handles in the picture: dragged along the seam, or moved by arrow keys.

import { $, el } from "../../src/dom.js";
import { WORDS } from "../../src/texts.js";

// A handle is drawn so far beyond its seam at most, mm; the field takes more. This much of the seam stays between both.
const MOST_BEYOND_MM = 100;
const LEAST_LEFT_MM = 5;
// Dragging sets whole steps of this, an arrow key one step of that, mm.
const DRAG_MM = 0.5;
const KEY_MM = 1;

// The seam as it was found, by the way along it.
function along(seam, Vector) {
  const points = seam.line_mm.map((p) => new Vector(...p));
  const ways = [0];
  for (let i = 1; i < points.length; i++) ways.push(ways[i - 1] + points[i].distanceTo(points[i - 1]));
  const length = ways[ways.length - 1];
  // Before the start and beyond the end it goes straight on.
  const at = (way) => {
    let i = ways.findIndex((one, k) => k > 0 && one >= way);
    if (i < 0) i = points.length - 1;
    const span = ways[i] - ways[i - 1] || 1;
    return points[i - 1].clone().lerp(points[i], (way - ways[i - 1]) / span);
  };
  return { length, at, ways: [-MOST_BEYOND_MM, ...ways, length + MOST_BEYOND_MM] };
}

// The way along the seam that is drawn nearest to a place of the canvas, px.
function nearest({ at, ways }, scene, x, y) {
  let best = { px: Infinity, way: 0 };
  for (let i = 1; i < ways.length; i++) {
    const [a, b] = [scene.project(at(ways[i - 1])), scene.project(at(ways[i]))];
    if (a.z > 1 || b.z > 1) continue;
    const [dx, dy] = [b.x - a.x, b.y - a.y];
    const t = Math.min(Math.max(((x - a.x) * dx + (y - a.y) * dy) / (dx * dx + dy * dy || 1), 0), 1);
    const px = Math.hypot(x - a.x - t * dx, y - a.y - t * dy);
    if (px < best.px) best = { px, way: ways[i - 1] + t * (ways[i] - ways[i - 1]) };
  }
  return best.way;
}

// `save(seam, key, mm)` stores how far an end is beyond that of the seam.
export class Ends {
  constructor(scene, save) {
    Object.assign(this, { scene, save, seam: null });
    this.handles = ["extend_start_mm", "extend_end_mm"].map((key) => this.handle(key));
    $("labels").append(...this.handles.map(({ button }) => button));
    const before = scene.onFrame;
    scene.onFrame = (drawn) => {
      before(drawn);
      this.place();
    };
  }

  handle(key) {
    const button = el("button", { type: "button", class: "end", "data-end": key, hidden: true });
    const handle = { key, button, mm: 0, drag: false };
    button.addEventListener("pointerdown", (event) => {
      handle.drag = true;
      button.setPointerCapture(event.pointerId);
      event.preventDefault();
      button.focus();
    });
    button.addEventListener("pointermove", (event) => {
      if (!handle.drag) return;
      const box = $("canvas").getBoundingClientRect();
      const way = nearest(this.line, this.scene, event.clientX - box.left, event.clientY - box.top);
      const beyond = this.isLow(handle) ? -way : way - this.line.length;
      this.move(handle, Math.round(beyond / DRAG_MM) * DRAG_MM);
    });
    const end = (stores) => {
      if (!handle.drag) return;
      handle.drag = false;
      if (stores && handle.mm !== handle.said) this.save(this.seam.id, key, handle.mm);
      else this.move(handle, handle.said);
    };
    button.addEventListener("pointerup", () => end(true));
    button.addEventListener("pointercancel", () => end(false));
    button.addEventListener("keydown", (event) => {
      const by = { ArrowRight: KEY_MM, ArrowUp: KEY_MM, ArrowLeft: -KEY_MM, ArrowDown: -KEY_MM }[event.key];
      if (!by) return;
      event.preventDefault();
      event.stopPropagation();
      this.move(handle, handle.mm + by);
      this.save(this.seam.id, key, handle.mm);
    });
    return handle;
  }

  // Whether a handle is where the seam was found to begin: it may be welded the other way.
  isLow(handle) {
    return (handle.key === "extend_start_mm") !== this.reversed;
  }

  move(handle, mm) {
    const other = this.handles.find((one) => one !== handle).mm;
    handle.mm = Math.min(Math.max(mm, LEAST_LEFT_MM - this.line.length - other), MOST_BEYOND_MM);
    const words = WORDS.end(handle.key === "extend_start_mm", this.seam.id, handle.mm);
    handle.button.setAttribute("aria-label", words);
    handle.button.title = words;
    handle.button.textContent = handle.drag ? `${handle.mm} mm` : "";
    this.place();
  }

  // Shows the ends of a seam with its settings; none of a closed one, which has no ends to move.
  show(seam, settings, reversed) {
    if (this.handles.some((handle) => handle.drag)) return;
    this.seam = seam && !seam.closed && seam.line_mm.length > 1 ? seam : null;
    for (const { button } of this.handles) button.hidden = !this.seam;
    if (!this.seam) return;
    this.reversed = reversed;
    this.line = along(seam, this.scene.camera.position.constructor);
    for (const handle of this.handles) handle.mm = handle.said = settings.path[handle.key] ?? 0;
    for (const handle of this.handles) this.move(handle, handle.said);
  }

  place() {
    if (!this.seam) return;
    for (const handle of this.handles) {
      const way = this.isLow(handle) ? -handle.mm : this.line.length + handle.mm;
      const { x, y, z } = this.scene.project(this.line.at(way));
      handle.button.style.transform = `translate(${(x - 8).toFixed(1)}px, ${(y - 8).toFixed(1)}px)`;
      handle.button.style.visibility = z < 1 ? "visible" : "hidden";
    }
  }
}
