// Places that are clicked on the cloud, for whatever asks for them: a seam that the search passed over, a box, a plane.

import { $, el } from "../../src/dom.js";
import { WORDS } from "../../src/texts.js";

// A click takes the foremost point of the cloud within the first of these that holds any, px: an edge that stands before the
// place is not what is meant. Points nearer to each other than this count as one surface, mm.
const CLICK_PX = [4, 12];
const SURFACE_MM = 3;
// Fewer points are no surface where there are more behind them: strays that a camera left hanging before the work.
const SUPPORT = 3;
// A press that moved farther turned the picture, px.
const STILL_PX = 4;

// The point of the model that is seen at a place of the canvas, from the picture's centre, and its number; null where there is none.
function cloudAt(scene, x, y) {
  const cloud = scene.groups.model;
  if (!cloud) return null;
  const { low, span } = cloud.material.uniforms;
  const steps = cloud.geometry.attributes.position;
  const { camera, width, height } = scene;
  const p = camera.position.clone();
  const q = p.clone();
  const eye = camera.position;
  const within = [];
  for (let k = 0; k < steps.count; k++) {
    p.set(steps.getX(k), steps.getY(k), steps.getZ(k)).multiplyScalar(span.value).add(low.value);
    q.copy(p).project(camera);
    const px = Math.hypot((0.5 + 0.5 * q.x) * width - x, (0.5 - 0.5 * q.y) * height - y);
    if (q.z < 1 && px < CLICK_PX.at(-1)) within.push({ k, px, away: p.distanceTo(eye), at: p.clone() });
  }
  if (!within.length) return null;
  const near = CLICK_PX.map((most) => within.filter((one) => one.px < most)).find((some) => some.length);
  near.sort((a, b) => a.away - b.away);
  const { away: front } = near.find((one, k) => near[k + SUPPORT - 1]?.away < one.away + SURFACE_MM) ?? near[0];
  const seen = near.filter((one) => one.away >= front && one.away < front + SURFACE_MM);
  return seen.reduce((best, one) => (one.px < best.px ? one : best));
}

// The unit normal of a point of the model, toward the camera that saw it: folded to two bytes, as the picture's shader has it.
function normalOf(cloud, k) {
  const detail = cloud.geometry.attributes.detail;
  const [x, y] = [2 * detail.getX(k) - 1, 2 * detail.getY(k) - 1];
  const z = 1 - Math.abs(x) - Math.abs(y);
  const fold = (v, other) => (z < 0 ? (1 - Math.abs(other)) * (v < 0 ? -1 : 1) : v);
  const normal = [fold(x, y), fold(y, x), z];
  const length = Math.hypot(...normal);
  return normal.map((v) => v / length);
}

// What places are asked for: the `id` of its button, how many at `least` and at `most`, its `words(count, places)`, and
// `done(places)`, which answers with the words of a refusal or nothing; `said`, or what it makes of the places, is told then, `changed(places)` with each of them.
// A place is { mm, normal }, base frame. `tell(words)` says what is going on.
export class Clicks {
  constructor(scene, centre, tell) {
    Object.assign(this, { scene, centre, tell, kind: null, places: [], marks: [] });
    const canvas = $("canvas");
    let down = null;
    canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
    // Before the report takes the click for one on a seam.
    canvas.addEventListener("click", (event) => {
      if (!this.kind) return;
      event.stopImmediatePropagation();
      if (down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) > STILL_PX) return;
      const box = canvas.getBoundingClientRect();
      this.take(event.clientX - box.left, event.clientY - box.top);
    }, { capture: true });
    const before = scene.onFrame;
    scene.onFrame = (drawn) => {
      before(drawn);
      this.place();
    };
    this.cross = el("span", { class: "cross", "aria-hidden": "true", hidden: true }, "+");
    $("labels").append(this.cross);
  }

  // All points of the model, mm, with their normals.
  points() {
    const cloud = this.scene.groups.model;
    const { low, span } = cloud.material.uniforms;
    const steps = cloud.geometry.attributes.position;
    const from = low.value.clone().add(this.centre);
    return Array.from({ length: steps.count }, (_, k) => ({
      mm: [from.x + span.value * steps.getX(k), from.y + span.value * steps.getY(k), from.z + span.value * steps.getZ(k)], normal: normalOf(cloud, k) }));
  }

  // Begins to ask, or gives up if it is this that is asked for.
  toggle(kind) {
    const again = this.kind === kind;
    if (this.kind) this.giveUp();
    if (again) return;
    this.kind = kind;
    this.cross.hidden = false;
    $("view").classList.add("clicking");
    $(kind.id)?.setAttribute("aria-pressed", "true");
    $("canvas").focus();
    this.changed();
    this.scene.redraw();
  }

  end() {
    $(this.kind.id)?.setAttribute("aria-pressed", "false");
    this.kind = null;
    $("view").classList.remove("clicking");
    this.cross.hidden = true;
    this.places = [];
    this.marks.forEach((mark) => mark.remove());
    this.marks = [];
  }

  giveUp() {
    this.places = [];
    this.kind.changed?.([]);
    this.end();
    this.tell("");
  }

  changed() {
    this.kind.changed?.(this.places);
    this.tell(this.kind.words(this.places.length, this.places));
  }

  // The point of the cloud at a place of the canvas, or amid it for those who have no mouse.
  take(x = this.scene.width / 2, y = this.scene.height / 2) {
    const found = cloudAt(this.scene, x, y);
    if (!found) {
      this.tell(WORDS.noPoint);
      return;
    }
    const mm = found.at.add(this.centre).toArray().map((v) => Math.round(10 * v) / 10);
    this.places.push({ mm, normal: normalOf(this.scene.groups.model, found.k) });
    const mark = el("span", { class: "mark-place", role: "img", "aria-label": WORDS.placeOf(this.places.length) }, String(this.places.length));
    this.marks.push(mark);
    $("labels").append(mark);
    this.changed();
    this.scene.redraw();
    if (this.places.length === this.kind.most) this.done();
  }

  drop() {
    this.places.pop();
    this.marks.pop()?.remove();
    this.changed();
  }

  async done() {
    const { kind, places } = this;
    if (places.length < kind.least) {
      this.changed();
      return;
    }
    const words = await kind.done(places);
    if (this.kind !== kind) return;
    if (!words) this.end();
    else if (places.length === kind.most) this.drop();
    this.tell(words ?? (typeof kind.said === "function" ? kind.said(places) : kind.said));
  }

  place() {
    if (!this.kind) return;
    this.cross.style.transform = `translate(${this.scene.width / 2 - 8}px, ${this.scene.height / 2 - 10}px)`;
    const Vector = this.scene.camera.position.constructor;
    this.places.forEach(({ mm }, k) => {
      const { x, y, z } = this.scene.project(new Vector(...mm));
      this.marks[k].style.transform = `translate(${(x - 8).toFixed(1)}px, ${(y - 8).toFixed(1)}px)`;
      this.marks[k].style.visibility = z < 1 ? "visible" : "hidden";
    });
  }

  // Whether a key was meant for this.
  key(key) {
    if (!this.kind) return false;
    const call = { Enter: () => this.done(), Escape: () => this.giveUp(), Backspace: () => this.drop(), " ": () => this.take() }[key];
    call?.();
    return Boolean(call);
  }
}
