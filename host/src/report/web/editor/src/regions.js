// Boxes and planes, in numbers and in the picture: the box in which alone seams are welded ([selection] roi_mm), and what is no
// work ([exclude]). A box is sketched first, by clicks or by numbers, and then put to one of the two uses.

import { el } from "../../src/dom.js";
import { WORDS } from "../../src/texts.js";
import { read } from "./fields.js";
import { edit } from "./server.js";

// A box that is clicked reaches so far beyond the places that it holds; a plane lies so far off the face that is clicked, mm.
const AROUND_MM = 2;
const COLOURS = { roi: "#2fb866", exclude: "#d43f3a", sketch: "#efb118", section: "#4269d0" };

const tenth = (mm) => Math.round(10 * mm) / 10;
const bounds = (places, axis) => places.map(({ mm }) => mm[axis]);
const boxAround = (places) => [[0, 1, 2].map((axis) => tenth(Math.min(...bounds(places, axis)) - AROUND_MM)), [0, 1, 2].map((axis) => tenth(Math.max(...bounds(places, axis)) + AROUND_MM))];

// The plane of a face that was clicked, and away from whoever sees it.
export function beyond({ mm, normal }) {
  const round = (v) => Math.round(1e4 * v) / 1e4;
  return { at_mm: mm.map((v, axis) => tenth(v + AROUND_MM * normal[axis])), toward: normal.map((v) => round(-v)) };
}

// Two rows of three numbers; `save(rows)` takes them when all are there, and answers with the words of a refusal or nothing.
function numbers(name, rows, save) {
  const refusal = el("p", { class: "refusal", role: "alert", hidden: true });
  const inputs = rows.map((row) => ["x", "y", "z"].map((axis) => el("input", { type: "text", inputmode: "decimal", autocomplete: "off", "aria-label": `${name}, ${row}, ${axis}`, onchange: store })));
  const typed = () => inputs.map((row) => row.map((input) => read("number", input.value.trim())));
  const values = () => typed().map((row) => row.map(({ value }) => value ?? NaN));
  async function store() {
    const unread = typed().flat().find((one) => one.words)?.words;
    const words = unread ?? (values().flat().every(Number.isFinite) ? await save(values()) : null);
    refusal.hidden = !words;
    refusal.textContent = words ?? "";
  }
  const lines = inputs.map((row, k) => el("div", { class: "corner" }, el("span", {}, rows[k]), row));
  const box = el("fieldset", {}, el("legend", {}, name), lines, refusal);
  box.read = values;
  box.show = (values) => inputs.forEach((row, k) => row.forEach((input, axis) => {
    if (document.activeElement !== input) input.value = values ? values[k][axis] : "";
  }));
  box.refuse = (words) => {
    refusal.hidden = !words;
    refusal.textContent = words ?? "";
  };
  return box;
}

const CORNERS = [WORDS.least, WORDS.greatest];
const exclude = (was, now) => edit({ edit: "exclude", was, now });

// What of a job is drawn, and how it is changed.
function listed({ selection, exclude: none }) {
  const roi = selection.roi_mm ? [{ kind: "roi", name: WORDS.roi, rows: CORNERS, mm: selection.roi_mm, save: (value) => edit({ edit: "set", seam: null, key: "selection.roi_mm", value }) }] : [];
  const boxes = (none?.boxes_mm ?? []).map((mm, k) => ({
    kind: "exclude", name: WORDS.excluded(k + 1), rows: CORNERS, mm, save: (now) => exclude({ box: mm }, now && { box: now }) }));
  const planes = (none?.half_space ?? []).map((half, k) => ({
    kind: "exclude", isPlane: true, name: WORDS.beyond(k + 1), rows: [WORDS.at, WORDS.toward], mm: [half.at_mm, half.toward],
    save: (now) => exclude({ half_space: half }, now && { half_space: { at_mm: now[0], toward: now[1] } }) }));
  return [...roi, ...boxes, ...planes];
}

// The sketch outlives the panel, which is made anew.
const sketch = { mm: null, onChange: () => {} };
function draft(mm) {
  sketch.mm = mm;
  sketch.onChange();
}
export const sketchAround = (places) => draft(places.length ? boxAround(places) : null);

// Draws what a job says, what is sketched, and the plane of the cross-section that is looked at, if that is not what is drawn.
let drawn = "";
export function draw(scene, job, section) {
  const solids = listed(job).map(({ kind, isPlane, mm }) => ({ isPlane, mm, css: COLOURS[kind] }));
  if (sketch.mm) solids.push({ mm: sketch.mm, css: COLOURS.sketch });
  if (section) solids.push({ isPlane: true, mm: [section.root_mm, section.tangent], size_mm: 2 * section.reach_mm, css: COLOURS.section });
  const now = JSON.stringify(solids);
  if (now === drawn) return;
  drawn = now;
  scene.solids(solids);
}

// The group of the settings; `changed()` draws the picture, `clicks` are the two things that are asked for by clicks.
export function regions(group, open, { changed, clicks, tell }) {
  const own = numbers(WORDS.sketch, CORNERS, (mm) => draft(mm));
  const use = async (call, said) => {
    const mm = own.read();
    const words = mm.flat().every(Number.isFinite) ? await call(mm) : WORDS.sixNumbers;
    own.refuse(words);
    if (words) return;
    draft(null);
    tell(said);
  };
  const button = (id, text, title, onclick) => el("button", { type: "button", id, title, onclick }, text);
  own.append(el("div", { class: "actions" },
    button("box-exclude", WORDS.exclude, WORDS.excludeHint, () => use((mm) => exclude(null, { box: mm }), WORDS.searchLater)),
    button("box-roi", WORDS.onlyHere, WORDS.onlyHereHint, () => use((value) => edit({ edit: "set", seam: null, key: "selection.roi_mm", value }), WORDS.onlyThere))));
  const list = el("div", {});
  const box = group("regions", open, [el("div", { class: "actions" }, clicks.map(({ text, title, begin }) => button(null, text, title, begin))), own, list]);
  sketch.onChange = () => {
    own.show(sketch.mm);
    changed();
  };
  let before = "";
  box.update = ({ job }) => {
    const solids = listed(job);
    const now = JSON.stringify(solids);
    if (now === before) return;
    before = now;
    list.replaceChildren(...solids.map(({ name, rows, mm, save }) => {
      const fields = numbers(name, rows, save);
      fields.show(mm);
      fields.append(el("button", { type: "button", onclick: () => save(null) }, WORDS.takeBack(name)));
      return fields;
    }));
  };
  own.show(sketch.mm);
  return box;
}
