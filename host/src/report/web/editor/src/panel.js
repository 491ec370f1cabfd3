// Everything that is set for a seam or for the whole job.

import { el } from "../../src/dom.js";
import { GROUPS, LABELS, WORDS } from "../../src/texts.js";
import { field, jobField, keysOf, setting } from "./fields.js";
import { edit } from "./server.js";
import { regions } from "./regions.js";
import { section } from "./section.js";

const TYPES = { order: "OrderSettings", path: "PathSettings", torch: "TorchSettings", weave: "WeaveSettings", stitch: "StitchSettings", arc: "ArcSettings", program: "ProgramSettings", torch_body: "TorchBodySettings" };
const LAYERS = ["path", "torch", "weave", "stitch"];
// Of a pass, beside its place: what differs from pass to pass.
const OF_PASS = [["path", "feed_mm_s"], ["torch", "work_angle_deg"], ["torch", "travel_angle_deg"], ["weave", "shape"], ["weave", "amplitude_mm"]];

const seamOf = (state, id) => state.seams.find((one) => one.id === id);
// What is said in a scope, and what holds there. A scope is { seam }, the id of one, { joint }, the type of all that have it, or {}.
const saidIn = (state, { seam, joint }) => (seam ? seamOf(state, seam)?.own ?? {} : joint ? state.job.joint?.[joint] ?? {} : state.job);
const holdsIn = (state, { seam }) => (seam ? seamOf(state, seam)?.settings ?? state.settings : state.settings);

function group(name, open, children) {
  const box = el("details", { class: "group", "data-group": name, open }, el("summary", {}, GROUPS[name] ?? WORDS[name]), children);
  box.update = (state) => children.forEach((child) => child.update?.(state));
  return box;
}

function settings(schema, table, scope, open) {
  const fields = keysOf(schema, TYPES[table], table).map((key) => {
    const row = jobField(schema, TYPES[table], table, key, scope);
    const show = row.update;
    const { default: usual } = schema.$defs[TYPES[table]].properties[key];
    row.update = (state) => {
      const own = saidIn(state, scope)[table]?.[key];
      // Tables outside the layers hold their defaults themselves.
      if (LAYERS.includes(table)) show(own, holdsIn(state, scope)[table]?.[key]);
      else show(String(own) === String(usual) ? undefined : own, usual);
    };
    return row;
  });
  return group(table, open, fields);
}

function passes(schema, scope, open) {
  const list = el("div", {});
  const add = el("button", { type: "button" }, WORDS.addPass);
  const box = group("passes", open, [list, add]);
  let now = [];
  let fields = [];
  const save = (passes) => edit(setting(scope, "pass", passes.length ? passes : null));
  // Without any there is one on the seam's line: the first that is added is the second.
  add.addEventListener("click", () => save([...(now.length ? now : [{}]), {}]));
  const withValue = (k, table, key, value) => save(now.map((pass, at) => {
    if (at !== k) return pass;
    const changed = structuredClone(pass);
    const target = table ? (changed[table] ??= {}) : changed;
    if (value === null) delete target[key];
    else target[key] = value;
    return changed;
  }));
  const build = () => {
    fields = [];
    list.replaceChildren(...now.map((_, k) => {
      const own = (table, key) => {
        const row = field(schema, table ? TYPES[table] : "PassSettings", table ?? "pass", key, (value) => withValue(k, table, key, value));
        fields.push({ row, k, table, key });
        return row;
      };
      const reverse = el("input", { type: "checkbox", "data-key": "pass.reverse", onchange: (event) => withValue(k, null, "reverse", event.target.checked) });
      fields.push({ reverse, k });
      return el("fieldset", {}, el("legend", {}, WORDS.pass(k + 1)),
        own(null, "across_mm"), own(null, "out_mm"),
        el("label", { class: "box" }, reverse, LABELS.pass.reverse),
        OF_PASS.map(([table, key]) => own(table, key)),
        el("button", { type: "button", onclick: () => save(now.filter((_, at) => at !== k)) }, WORDS.removePass(k + 1)));
    }));
    if (!now.length) list.replaceChildren(el("p", { class: "soft" }, WORDS.onePass));
  };
  box.update = (state) => {
    const before = now.length;
    now = scope.joint ? saidIn(state, scope).pass ?? holdsIn(state, scope).pass : holdsIn(state, scope).pass;
    if (before !== now.length || !list.firstChild) build();
    for (const { row, reverse, k, table, key } of fields) {
      if (reverse) reverse.checked = Boolean(now[k].reverse);
      else row.update(table ? now[k][table]?.[key] : now[k][key] || undefined, table ? holdsIn(state, scope)[table]?.[key] : 0);
    }
  };
  return box;
}

// What a type with a few words may be.
const namesOf = (schema, type) => schema.$defs[type].oneOf?.flatMap((one) => one.enum ?? [one.const]) ?? schema.$defs[type].enum;

function formats(schema) {
  const names = namesOf(schema, "Robot");
  const boxes = names.map((name) => el("input", { type: "checkbox", value: name, "data-key": `formats.${name}`, onchange: () => edit({ edit: "set", seam: null, key: "formats", value: boxes.filter((box) => box.checked).map((box) => box.value) }) }));
  const box = el("fieldset", {}, el("legend", {}, WORDS.formats), boxes.map((one) => el("label", { class: "box" }, one, one.value)));
  box.update = (state) => boxes.forEach((one) => { one.checked = state.formats.includes(one.value); });
  return box;
}

function robot(state) {
  const select = el("select", { id: "set-robot", "data-key": "robot.model", onchange: (event) => edit(event.target.value ? { edit: "set", seam: null, key: "robot.model", value: event.target.value } : { edit: "set", seam: null, key: "robot", value: null }) },
    el("option", { value: "" }, WORDS.noRobot), state.models.map((name) => el("option", { value: name }, name)));
  const box = el("div", { class: "field" }, el("label", { for: "set-robot" }, WORDS.robot), select);
  box.update = ({ job }) => {
    const own = job.robot?.model ?? "";
    // An arm of the job's own parameters has a name that is in no list.
    if (own && ![...select.options].some((option) => option.value === own)) select.append(el("option", { value: own }, own));
    select.value = own;
  };
  return box;
}

// The tool is set as a whole: its first three values are needed together.
function tool(schema, open) {
  let values = {};
  const rows = keysOf(schema, "ToolSettings", "tool").map((key) => {
    const row = field(schema, "ToolSettings", "tool", key, (value) => {
      if (value === null) delete values[key];
      else values[key] = value;
      return null;
    });
    const show = row.update;
    row.update = ({ job }) => show(values[key] ?? job.tool?.[key], undefined);
    return row;
  });
  const refusal = el("p", { class: "refusal", role: "alert", hidden: true });
  let current = {};
  const save = async (value) => {
    const words = await edit({ edit: "set", seam: null, key: "tool", value });
    refusal.hidden = !words;
    refusal.textContent = words ?? "";
    if (!words) values = {};
  };
  const box = group("tool", open, [...rows, refusal,
    el("button", { type: "button", onclick: () => save({ ...current, ...values }) }, WORDS.setTool),
    el("button", { type: "button", onclick: () => { values = {}; save(null); } }, WORDS.removeTool)]);
  box.update = (state) => {
    current = state.job.tool ?? {};
    rows.forEach((row) => row.update(state));
  };
  return box;
}

// Seams that were asked for or drawn, each with a button that takes it back.
function asked(open) {
  const list = el("div", {});
  const box = group("asked", open, [list]);
  const ends = (places) => WORDS.askedBetween(places[0].join(", "), places[places.length - 1].join(", "));
  const through = (places) => WORDS.drawnThrough(places.length, places[0].join(", "), places[places.length - 1].join(", "));
  const row = (what, button) => el("div", { class: "asked" }, el("span", {}, what), button);
  box.update = ({ job }) => {
    const asks = (job.ask ?? []).map(({ between_mm }, at) => row(ends(between_mm),
      el("button", { type: "button", "data-unask": at, "aria-label": WORDS.unask(ends(between_mm)), onclick: () => edit({ edit: "unask", at }) }, "×")));
    const draws = (job.draw ?? []).map(({ through_mm }, at) => row(through(through_mm),
      el("button", { type: "button", "data-undraw": at, "aria-label": WORDS.undraw(through(through_mm)), onclick: () => edit({ edit: "undraw", at }) }, "×")));
    list.replaceChildren(...asks, ...draws);
    if (!asks.length && !draws.length) list.replaceChildren(el("p", { class: "soft" }, WORDS.noneAsked));
  };
  return box;
}

function command() {
  const text = el("pre", { tabindex: "0", "aria-label": WORDS.command });
  const box = el("details", { class: "group", id: "command" }, el("summary", {}, WORDS.command), text);
  box.update = (state) => { text.textContent = state.command; };
  return box;
}

// The joint type of one seam: as it was found, or as the user says.
function joint(schema, seam) {
  const found = el("option", { value: "" });
  const select = el("select", { id: "set-joint", "data-key": "joint", title: WORDS.jointHint, onchange: (event) => edit(setting({ seam }, "joint", event.target.value || null)) },
    found, namesOf(schema, "Joint").map((type) => el("option", { value: type }, type)));
  const box = el("div", { class: "field" }, el("label", { for: "set-joint" }, WORDS.joint), select);
  box.update = (state) => {
    const own = seamOf(state, seam);
    found.textContent = WORDS.foundJoint(own?.found_joint ?? "");
    select.value = own?.own?.joint ?? "";
    box.classList.toggle("said", Boolean(select.value));
  };
  return box;
}

// All that can be set in a scope; `open` are the groups that stand open, `inPicture` is what boxes are clicked and drawn with.
export function parts(schema, state, scope, open, inPicture) {
  const layers = LAYERS.map((table) => settings(schema, table, scope, open.includes(table)));
  layers.push(passes(schema, scope, open.includes("passes")));
  if (scope.seam) return [joint(schema, scope.seam), section(group, inPicture.seam(scope.seam), open.includes("section"), inPicture.plane), ...layers];
  if (scope.joint) return layers;
  const of = (table) => settings(schema, table, {}, open.includes(table));
  return [formats(schema), robot(state), asked(open.includes("asked")), regions(group, open.includes("regions"), inPicture), of("order"), ...layers, tool(schema, open.includes("tool")), of("arc"), of("program"), of("torch_body"), command()];
}
