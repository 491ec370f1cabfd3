// A seam that the search passed over: places are clicked on the cloud, along the seam, and the planner looks there. The last
// word is the planner's: it adds the seam with the next plan, or says what is there instead.

import { $, el } from "../../src/dom.js";
import { WORDS } from "./words.js";

// A click takes the foremost point of the cloud within the first of these that holds any, px: an edge that stands before the
// place is not what is meant. Points nearer to each other than this count as one surface, mm.
const CLICK_PX = [4, 12];
const SURFACE_MM = 3;
// A press that moved farther turned the picture, px.
const STILL_PX = 4;

// The point of the model that is seen at a place of the canvas, mm, base frame; null where there is none.
export function cloudAt(scene, x, y) {
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
    if (q.z < 1 && px < CLICK_PX.at(-1)) within.push({ px, away: p.distanceTo(eye), at: p.clone() });
  }
  if (!within.length) return null;
  const near = CLICK_PX.map((most) => within.filter((one) => one.px < most)).find((some) => some.length);
  const front = Math.min(...near.map((one) => one.away));
  const seen = near.filter((one) => one.away < front + SURFACE_MM);
  return seen.reduce((best, one) => (one.px < best.px ? one : best)).at;
}

// `ask(places)` hands the places over, and answers with the words of a refusal or nothing; `tell(words)` says what is going on.
export class Asking {
  constructor(scene, centre, ask, tell) {
    Object.assign(this, { scene, centre, ask, tell, on: false, places: [], marks: [] });
    const canvas = $("canvas");
    let down = null;
    canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
    // Before the report takes the click for one on a seam.
    canvas.addEventListener("click", (event) => {
      if (!this.on) return;
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

  begin() {
    this.end();
    this.on = true;
    this.cross.hidden = false;
    $("canvas").focus();
    this.say();
    this.scene.redraw();
  }

  end() {
    this.on = false;
    this.cross.hidden = true;
    this.places = [];
    this.marks.forEach((mark) => mark.remove());
    this.marks = [];
    $("ask").setAttribute("aria-pressed", "false");
  }

  say() {
    $("ask").setAttribute("aria-pressed", String(this.on));
    this.tell(WORDS.asking(this.places.length));
  }

  // The point of the cloud at a place of the canvas, or amid it for those who have no mouse.
  take(x = this.scene.width / 2, y = this.scene.height / 2) {
    const at = cloudAt(this.scene, x, y);
    if (!at) {
      this.tell(WORDS.noPoint);
      return;
    }
    this.places.push(at);
    const mark = el("span", { class: "mark-place", role: "img", "aria-label": WORDS.placeOf(this.places.length) }, String(this.places.length));
    this.marks.push(mark);
    $("labels").append(mark);
    this.say();
    this.scene.redraw();
  }

  drop() {
    this.places.pop();
    this.marks.pop()?.remove();
    this.say();
  }

  async done() {
    if (this.places.length < 2) {
      this.say();
      return;
    }
    const tenth = (mm) => Math.round(10 * mm) / 10;
    const words = await this.ask(this.places.map((p) => p.clone().add(this.centre).toArray().map(tenth)));
    if (!words) this.end();
    this.tell(words ?? WORDS.asked);
  }

  place() {
    this.cross.style.transform = `translate(${this.scene.width / 2 - 8}px, ${this.scene.height / 2 - 10}px)`;
    this.places.forEach((p, k) => {
      const { x, y, z } = this.scene.project(p.clone().add(this.centre));
      this.marks[k].style.transform = `translate(${(x - 8).toFixed(1)}px, ${(y - 8).toFixed(1)}px)`;
      this.marks[k].style.visibility = z < 1 ? "visible" : "hidden";
    });
  }

  // Whether a key was meant for this.
  key(key) {
    if (!this.on) return false;
    const call = { Enter: () => this.done(), Escape: () => { this.end(); this.tell(""); }, Backspace: () => this.drop(), " ": () => this.take() }[key];
    call?.();
    return Boolean(call);
  }
}
