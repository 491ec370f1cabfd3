// What the page was given: numbers as JSON, points as one binary block.

import { TEXTS } from "./texts.js";

const text = (id) => document.getElementById(id).textContent;

export const content = JSON.parse(text("content"));
// Null unless `weldpath evaluate --report` has put it in.
export const deviation = JSON.parse(text("deviation"));

function bytes(base64) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
  const packed = atob(base64);
  const out = new Uint8Array(packed.length);
  for (let i = 0; i < packed.length; i++) out[i] = packed.charCodeAt(i);
  return out;
}

// The columns of both layers, from the element that holds them; taken out of the page, since they are large.
export function layers(element) {
  const block = bytes(element.textContent.trim()).buffer;
  element.remove();
  const layer = (meta) => meta && {
    ...meta,
    positions: new Uint16Array(block, meta.positions_at, 4 * meta.count),
    attributes: new Uint8Array(block, meta.attributes_at, 4 * meta.count),
    surfaces: new Uint8Array(block, meta.surfaces_at, 2 * meta.count),
  };
  return { model: layer(content.clouds.model), raw: layer(content.clouds.raw) };
}

export const seams = [];
function join() {
  seams.splice(0, seams.length, ...content.summary.seams.map((seam) => ({
    ...seam,
    ...content.seams.find((line) => line.id === seam.id),
  })));
}
join();

// Numbers of another plan in place of these. Where one looks from stays: what has changed is to be seen.
export function takeContent(next) {
  const { centre_mm, radius_mm, up, eye, heights_mm } = content;
  Object.assign(content, next, { centre_mm, radius_mm, up, eye, heights_mm });
  join();
}

const COLOURS = ["#4269d0", "#efb118", "#ff725c", "#6cc5b0", "#9c6b4e", "#a463f2", "#97bbf5", "#3ca951", "#ff8ab7", "#9498a0"];
export const viewColour = (k) => COLOURS[k % COLOURS.length];
// Borders of surfaces, in the order of their numbers in the block, from 1.
export const BORDERS = [["inside", "#e63946"], ["outside", "#2454d6"], ["tangent", "#6b7785"], ["step", "#d633c8"], ["edge", "#101418"], ["hidden", "#7a4a12"], ["unseen", "#f2c500"]];

// Unit of a key by its ending; every number of the summary names its unit.
const UNITS = [["_mm_s", "mm/s"], ["_mm2", "mm²"], ["_mm", "mm"], ["_deg", "°"], ["_rad", "rad"], ["_kg", "kg"], ["_s", "s"]];
export function label(key) {
  const [ending, unit] = UNITS.find(([ending]) => key.endsWith(ending)) ?? ["", ""];
  return { name: TEXTS.keys[key] ?? key.slice(0, key.length - ending.length).replaceAll("_", " "), unit };
}

// Three significant digits, and no more decimals than a reader needs.
export function number(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return TEXTS.unknown;
  if (Number.isInteger(value)) return String(value);
  const size = Math.abs(value);
  return value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.1 || size === 0 ? 2 : 3);
}
export const percent = (share) => (share === null || share === undefined ? TEXTS.unknown : `${Math.round(100 * share)} %`);
export function duration(s) {
  if (s < 90) return TEXTS.seconds(s.toFixed(1));
  if (s > 5400) return TEXTS.hours((s / 3600).toFixed(1));
  return TEXTS.minutes(Math.floor(s / 60), String(Math.round(s % 60)).padStart(2, "0"));
}
export const place = (p) => p.map((v) => v.toFixed(1)).join(", ");
