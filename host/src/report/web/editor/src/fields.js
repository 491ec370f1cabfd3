// Fields for settings, made from the schema of a job: kind, limits and description of each stand there.

import { el } from "../../src/dom.js";
import { LABELS, WORDS } from "../../src/texts.js";
import { act, edit } from "./server.js";

const UNITS = [["_mm_s", "mm/s"], ["_mm", "mm"], ["_deg", "°"], ["_rad", "rad"], ["_kg", "kg"], ["_hz", "Hz"], ["_s", "s"]];
const bare = (key) => key.replace(/_(mm_s|mm|deg|rad|kg|hz|s)$/, "").replaceAll("_", " ");
const unitOf = (key) => UNITS.find(([ending]) => key.endsWith(ending))?.[1] ?? "";

let count = 0;

// What a property may be: a number, one of a few words, a list of numbers, a text, yes or no.
function kindOf(schema, property) {
  const found = [property, ...(property.anyOf ?? [])].find((one) => one.$ref);
  const type = found ? schema.$defs[found.$ref.split("/").pop()] : property;
  const kinds = [type.type].flat();
  if (type.oneOf || type.enum) return { kind: "choice", options: (type.oneOf ?? type.enum.map((value) => ({ const: value }))).flatMap((one) => (one.enum ?? [one.const]).map((value) => ({ value, about: one.description ?? "" }))) };
  if (kinds.includes("array")) return { kind: "list" };
  if (kinds.includes("boolean")) return { kind: "flag" };
  if (kinds.includes("string")) return { kind: "text" };
  return { kind: "number" };
}

// Names of the properties of a table, those with a label first.
export function keysOf(schema, type, table) {
  const known = Object.keys(LABELS[table] ?? {});
  const all = Object.keys(schema.$defs[type].properties);
  return [...known.filter((key) => all.includes(key)), ...all.filter((key) => !known.includes(key))];
}

const shown = (value) => (Array.isArray(value) ? value.join(", ") : value === undefined || value === null ? "" : String(value));

// A number as people write it, with a point or a comma; null where none can be read, or two can.
function decimal(text) {
  if (!/^[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?$/i.test(text)) return null;
  const value = Number(text.replace(",", "."));
  return Number.isFinite(value) ? value : null;
}

// 1,500 may be one and a half, or fifteen hundred.
const isAmbiguous = (text) => /^[+-]?[1-9]\d{0,2},\d{3}$/.test(text);

// What was typed as a value, or why it is none: { value } or { words }. Nothing typed takes the setting back.
export function read(kind, text) {
  if (text === "") return { value: null };
  if (kind === "number") {
    const value = decimal(text);
    if (isAmbiguous(text)) return { words: WORDS.ambiguous(text, String(value), text.replace(",", "")) };
    return value === null ? { words: WORDS.badNumber(text) } : { value };
  }
  if (kind !== "list") return { value: text };
  const numbers = text.split(text.includes(";") ? ";" : ",").map((one) => decimal(one.trim()));
  return numbers.length === 3 && numbers.every((one) => one !== null) ? { value: numbers } : { words: WORDS.badList };
}

// A slip of the decimal point: a change by this factor is marked.
const TENFOLD = 10;
const isTenfold = (before, now) => [before, now].every((one) => typeof one === "number" && one !== 0) && Math.max(Math.abs(now / before), Math.abs(before / now)) >= TENFOLD;

function control(what, id, attributes) {
  if (what.kind === "choice") {
    return el("select", { id, ...attributes }, el("option", { value: "" }, ""), what.options.map(({ value, about }) => el("option", { value, title: about }, value)));
  }
  if (what.kind === "number") return el("input", { id, type: "text", inputmode: "decimal", autocomplete: "off", ...attributes });
  return el("input", { id, type: "text", autocomplete: "off", spellcheck: "false", ...attributes });
}

// One setting: `save(value)` stores it, null takes it back, and answers with the words of a refusal or nothing. The field's
// `update(said, holds)` shows what is said here, and what holds where nothing is.
export function field(schema, type, table, key, save) {
  const property = schema.$defs[type].properties[key];
  const what = kindOf(schema, property);
  const id = `set-${table}-${key}-${(count += 1)}`;
  const name = LABELS[table]?.[key] ?? bare(key);
  const limits = property.title ?? (what.kind === "list" ? `${WORDS.xyz}${unitOf(key) && `, ${unitOf(key)}`}` : unitOf(key));
  const about = el("span", { id: `${id}-about`, class: "about" }, limits);
  const refusal = el("p", { id: `${id}-refusal`, class: "refusal", role: "alert", hidden: true });
  const input = control(what, id, { "data-key": `${table}.${key}`, title: property.description, "aria-describedby": `${id}-about ${id}-refusal` });
  const reset = el("button", { type: "button", class: "reset", "aria-label": WORDS.reset(name), title: WORDS.reset(name), onclick: () => store({ value: null }) }, "×");
  const slip = el("p", { class: "slip", role: "status", hidden: true });
  let current;
  async function store({ value, words: unread }) {
    const before = current;
    const words = unread ?? await save(value);
    refusal.hidden = !words;
    refusal.textContent = words ?? "";
    input.setAttribute("aria-invalid", String(Boolean(words)));
    slip.hidden = Boolean(words) || !isTenfold(before, value);
    slip.replaceChildren(WORDS.tenfold(shown(before), shown(value), unitOf(key)), " ",
      el("button", { type: "button", onclick: async () => { slip.hidden = true; await act("undo"); input.focus(); } }, WORDS.undo));
  }
  input.addEventListener("change", () => store(read(what.kind, input.value.trim())));
  const row = el("div", { class: "field" }, el("label", { for: id, title: property.description }, name), input, reset, about, refusal, slip);
  row.update = (said, holds) => {
    current = said ?? holds;
    if (what.kind === "number") about.textContent = said === undefined || said === null ? limits : WORDS.holds(shown(said), unitOf(key), limits);
    reset.hidden = said === undefined || said === null;
    row.classList.toggle("said", !reset.hidden);
    const below = shown(holds);
    if (what.kind === "choice") input.options[0].textContent = below ? WORDS.inherited(below) : WORDS.unset;
    else input.placeholder = below;
    // What is being typed, and what was refused, stays.
    if (document.activeElement !== input && refusal.hidden) input.value = shown(said);
  };
  return row;
}

// A field whose setting is a key of the job, of all seams of a joint type, or of one seam.
export const jobField = (schema, type, table, key, scope) => field(schema, type, table, key, (value) => edit(setting(scope, `${table}.${key}`, value)));
export const setting = ({ seam, joint }, key, value) => ({ edit: "set", seam: seam ?? null, key: joint ? `joint.${joint}.${key}` : key, value });
