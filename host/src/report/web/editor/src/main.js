// The report as a page that edits its job. The report itself stays as it is in a file: this script comes behind it, adds what
// can be clicked, and puts another plan in its place: the numbers alone where the cloud is the same, else the points, too.

import { $, el } from "../../src/dom.js";
import { GROUPS, LABELS, LANGUAGE, WORDS } from "../../src/texts.js";
import { act, content, edit, follow, onState, report, schema as ofJob } from "./server.js";
import { Files } from "./files.js";
import { parts } from "./panel.js";
import { Ends } from "./ends.js";
import { Clicks } from "./clicks.js";
import { edgeBetween } from "./faces.js";
import { beyond, draw, sketchAround } from "./regions.js";

const own = { plan: Number($("editor").dataset.plan), cloud: Number($("editor").dataset.cloud), taking: false, schema: null, state: null, scope: "seam", parts: [], built: null };
const page = globalThis.weldpath;
const seamIds = () => page?.content.summary.seams.map((seam) => seam.id) ?? [];
const chosen = () => page?.state.seam ?? null;
const seamState = (id) => own.state?.seams.find((seam) => seam.id === id);
// The seam that is edited; null where it is all of a joint type, or the whole job.
const target = () => (own.scope === "seam" && seamIds().length ? chosen() : null);
const jointOf = (id) => seamState(id)?.own?.joint ?? seamState(id)?.found_joint;
const scopeNow = () => (target() ? { seam: target() } : own.scope === "joint" && jointOf(chosen()) ? { joint: jointOf(chosen()) } : {});

const button = (id, text, title, onclick) => el("button", { type: "button", id, title, onclick }, text);

const bar = el("progress", { max: 100, hidden: true, "aria-label": WORDS.plan });
const said = el("p", { id: "said", role: "status" });
const failed = el("p", { id: "failed", role: "alert", hidden: true });
const files = new Files((words) => tell(words));
let note = "";

function toolbar() {
  const tools = el("div", { class: "work", role: "toolbar", "aria-label": WORDS.toolbar },
    button("undo", WORDS.undo, WORDS.undoHint(null), () => act("undo")),
    button("redo", WORDS.redo, WORDS.redoHint(null), () => act("redo")),
    button("plan", WORDS.plan, WORDS.planHint, plan),
    button("cancel", WORDS.cancel, WORDS.cancelHint, () => act("cancel")),
    button("copy", WORDS.copy, WORDS.copyHint, copy),
    ...Object.values(clicks ? KINDS : {}).map((kind) => button(kind.id, kind.text, kind.title, () => begin(kind))));
  document.querySelector("header.bar .names").after(tools);
  const verdict = $("verdict");
  if (verdict) verdict.after(bar, said, files.box);
  else $("status").append(bar, said);
  $("status").append(failed);
}

// What is asked for by clicks on the cloud, by its key.
const KINDS = {
  a: {
    id: "ask", text: WORDS.ask, title: WORDS.askHint, least: 2, words: WORDS.asking, said: WORDS.asked,
    done: (places) => edit({ edit: "ask", between_mm: places.map(({ mm }) => mm) }),
  },
  e: {
    id: "faces", text: WORDS.faces, title: WORDS.facesHint, least: 2, most: 2, words: WORDS.clickingFaces, said: WORDS.asked,
    done: (places) => {
      const edge = edgeBetween(clicks.points(), places);
      return edge ? edit({ edit: "ask", between_mm: edge.map((mm) => mm.map((v) => Math.round(10 * v) / 10)) }) : WORDS.noEdge;
    },
  },
  d: {
    id: "draw", text: WORDS.draw, title: WORDS.drawHint, least: 2, words: WORDS.drawingSeam, said: WORDS.drawn,
    done: (places) => edit({ edit: "draw", through_mm: places.map(({ mm }) => mm) }),
  },
  b: { id: "box", text: WORDS.box, title: WORDS.boxHint, least: 2, words: WORDS.boxing, said: WORDS.boxed, changed: (places) => { sketchAround(places); inPicture.changed(); }, done: () => showGroup("regions") },
  m: {
    id: "measure", text: WORDS.measure, title: WORDS.measureHint, least: 2, most: 2, words: WORDS.measuring, done: () => null,
    said: ([a, b]) => { const by = a.mm.map((v, axis) => Math.abs(b.mm[axis] - v)); return WORDS.measured(Math.hypot(...by), by); },
  },
  h: {
    id: "plane", text: WORDS.plane, title: WORDS.planeHint, least: 1, most: 1, words: WORDS.planing, said: WORDS.searchLater,
    done: async ([place]) => (await edit({ edit: "exclude", was: null, now: { half_space: beyond(place) } })) ?? showGroup("regions"),
  },
};

function begin(kind) {
  // Nothing that is unfolded lies over what is clicked.
  for (const name of ["verdict", "files"]) $(name).open = false;
  clicks?.toggle(kind);
}

function crossSection() {
  showGroup("section", "seam");
  $("section-at")?.focus();
}

// Opens a group of the settings; answers with nothing.
function showGroup(name, which = "job") {
  scope(which);
  const group = document.querySelector(`#settings [data-group="${name}"]`);
  if (!group) return null;
  group.open = true;
  group.scrollIntoView({ block: "nearest" });
  return null;
}

async function plan() {
  const words = await act("plan");
  if (words) tell(words);
}

function tell(words) {
  note = words;
  if (own.state) status(own.state);
}

async function copy() {
  try {
    await navigator.clipboard.writeText(own.state.command);
    tell(WORDS.copied);
  } catch {
    scope("job");
    const text = $("command");
    text.open = true;
    getSelection().selectAllChildren(text.querySelector("pre"));
    tell(WORDS.notCopied);
  }
}

const isRefused = () => page?.content.summary.verdict.state === "refused";

function status(state) {
  const { running, drawing, failure, unplanned, undo, redo } = state;
  bar.hidden = !running;
  if (running) bar.value = running[1];
  said.textContent = running ? WORDS.planning(WORDS.stages[running[0]] ?? running[0])
    : note || (drawing ? WORDS.drawing : unplanned ? WORDS.unplanned : !state.plan ? WORDS.nothing : isRefused() ? WORDS.plannedRefused : WORDS.planned(state.out));
  $("status").classList.toggle("unplanned", unplanned && !running && !drawing);
  failed.hidden = !failure;
  failed.textContent = failure ? `${failure.message} (${failure.hint})` : "";
  $("plan").disabled = Boolean(running);
  $("cancel").hidden = !running;
  $("undo").disabled = !undo;
  $("undo").title = WORDS.undoHint(undo);
  $("redo").disabled = !redo;
  $("redo").title = WORDS.redoHint(redo);
  files.show(state);
}

// A box before each seam of the report's list.
function ticks() {
  const head = document.querySelector("#seams thead tr");
  head?.prepend(el("th", { scope: "col" }, WORDS.weldColumn));
  for (const row of document.querySelectorAll("#seams tr[data-seam]")) {
    const id = Number(row.dataset.seam);
    const box = el("input", { type: "checkbox", "aria-label": WORDS.weldSeam(id), onchange: (event) => weld(id, event.target.checked) });
    row.prepend(el("td", { class: "tick" }, box, el("span", { class: "place" })));
  }
}

function showTicks(state) {
  const on = state.order.filter((id) => seamState(id)?.on);
  for (const row of document.querySelectorAll("#seams tr[data-seam]")) {
    const id = Number(row.dataset.seam);
    row.querySelector(".tick input").checked = on.includes(id);
    const place = row.querySelector(".place");
    place.textContent = on.includes(id) ? String(on.indexOf(id) + 1) : "";
    place.title = WORDS.orderOf(on.indexOf(id) + 1);
  }
}

// Does an edit; what is refused is told where a field cannot.
async function change(body) {
  tell((await edit(body)) ?? "");
  if (own.state) render(own.state);
}

const weld = (seam, on) => change({ edit: "weld", seam, on });

// Whether a seam is welded against the direction in which it was found: as the job says, or as it was planned.
function isReversed(seam) {
  const way = seam.settings.path.direction;
  return way === "reverse" || (way !== "forward" && seam.reversed);
}

function reverse(id) {
  const seam = seamState(id);
  if (seam) change({ edit: "set", seam: id, key: "path.direction", value: isReversed(seam) ? "forward" : "reverse" });
}

// One place earlier or later among the seams that are welded.
function move(id, by) {
  const order = [...own.state.order];
  const on = order.filter((one) => seamState(one)?.on);
  const other = on[on.indexOf(id) + by];
  if (!on.includes(id) || other === undefined) return;
  const [a, b] = [order.indexOf(id), order.indexOf(other)];
  [order[a], order[b]] = [order[b], order[a]];
  change({ edit: "order", seams: order });
}

// What a person drew, a person looks at each time; and without a seam there is nothing to confirm.
const NEVER_ACCEPTED = ["drawn", "no-seam", "sparse"];

// Keys of the job that a text names, as in [tool] or approach_mm: each with the group of settings that it stands in.
const GROUP_OF_REASON = { infeasible: "robot", "odd-posture": "robot", "dialect-and-arm-differ": "robot", "first-move-unchecked": "robot" };
const NAMES = { ...GROUPS, tool: WORDS.tool, robot: WORDS.robot };
const KEYS = new Map(Object.entries(LABELS).filter(([table]) => NAMES[table]).flatMap(([table, keys]) => Object.keys(keys).map((key) => [key, table])));
function groupNamedIn(text, id) {
  const table = [...text.matchAll(/\[(\w+)\]/g)].map(([, name]) => name).find((name) => NAMES[name]);
  const key = !table && text.match(/\b[a-z]+(_[a-z]+)+\b/g)?.find((word) => KEYS.has(word));
  const group = table ?? (key ? KEYS.get(key) : GROUP_OF_REASON[id]);
  return group && { group, key };
}

// Beside each inside corner that is no seam, a button that asks for one there. On the table none is found.
function asks() {
  for (const item of document.querySelectorAll("#unwelded li")) {
    const { line_mm, reason } = page.content.summary.unwelded.find(({ id }) => id === Number(item.dataset.unwelded));
    if (reason === "table") continue;
    // Places enough to follow a bend, as few as a person would click.
    const every = Math.max(1, Math.ceil(line_mm.length / 12));
    const between_mm = line_mm.filter((_, k) => k % every === 0 || k === line_mm.length - 1);
    item.append(el("button", { type: "button", "data-ask": item.dataset.unwelded, title: WORDS.askHereHint, onclick: () => change({ edit: "ask", between_mm }) }, WORDS.askHere));
  }
}

// A button behind a text that leads to the setting it names: of its seam, or of the whole job.
function leads() {
  for (const item of document.querySelectorAll("#reasons li, #warnings li")) {
    const found = groupNamedIn(item.textContent, item.querySelector("code")?.textContent);
    if (!found) continue;
    const { group, key } = found;
    const seam = item.querySelector("button[data-seam]");
    const name = NAMES[group];
    item.append(el("button", { type: "button", class: "lead", "data-lead": group, title: WORDS.leadHint(name), onclick: () => {
      $("verdict").open = false;
      if (seam && key) seam.click();
      showGroup(group, seam && key ? "seam" : "job");
      const field = key ? document.querySelector(`#settings [data-key="${group}.${key}"]`) : document.querySelector(group === "robot" ? "#set-robot" : `#settings [data-group="${group}"] summary`);
      field?.focus();
      field?.scrollIntoView({ block: "center" });
    } }, WORDS.lead(name)));
  }
}

// "I have checked this" beside the first of each reason of the verdict: a job accepts all of one kind, or none.
function reasons() {
  const items = [...document.querySelectorAll("#reasons li")];
  const ids = items.map((item) => item.querySelector("code").textContent);
  items.forEach((item, k) => {
    const id = ids[k];
    if (ids.indexOf(id) < k || NEVER_ACCEPTED.includes(id)) return;
    const more = ids.filter((other) => other === id).length - 1;
    item.append(el("label", { class: "box", title: WORDS.checkedHint(id) },
      el("input", { type: "checkbox", "data-reason": id, onchange: (event) => change({ edit: "accept", reason: id, on: event.target.checked }) }), WORDS.checked(more)));
  });
}

function panel() {
  const scopes = el("div", { class: "scopes", role: "group", "aria-label": WORDS.scopeHint },
    button("scope-seam", "", WORDS.scopeHint, () => scope("seam")),
    button("scope-joint", "", WORDS.scopeHint, () => scope("joint")),
    button("scope-job", WORDS.scopeJob, WORDS.scopeHint, () => scope("job")));
  const actions = el("div", { id: "actions", class: "actions" },
    button("on", "", WORDS.onHint, () => weld(target(), !seamState(target())?.on)),
    button("reverse", WORDS.reverse, WORDS.reverseHint, () => reverse(target())),
    button("earlier", WORDS.earlier, WORDS.earlierHint, () => move(target(), -1)),
    button("later", WORDS.later, WORDS.laterHint, () => move(target(), 1)));
  const box = el("section", { id: "edit", "aria-label": WORDS.edit }, scopes, actions, el("div", { id: "settings" }));
  // What is typed there is no key of the picture.
  box.addEventListener("keydown", (event) => {
    if (typing(event.target)) event.stopPropagation();
  });
  $("seams").after(box);
  // The report selects seams by list, label, picture and digits, and shows each in its details.
  new MutationObserver(() => own.state && render(own.state)).observe($("detail"), { childList: true });
}

const typing = (element) => ["SELECT", "TEXTAREA"].includes(element.tagName) || (element.tagName === "INPUT" && !["checkbox", "range"].includes(element.type));

function scope(which) {
  own.scope = which;
  if (own.state) render(own.state);
}

const openGroups = () => [...document.querySelectorAll("#settings details[open]")].map((one) => one.dataset.group).filter(Boolean);

function render(state) {
  status(state);
  if (!page || !own.schema) return;
  showTicks(state);
  for (const box of document.querySelectorAll("#reasons input")) box.checked = state.job.accept.includes(box.dataset.reason);
  const id = target();
  const where = scopeNow();
  const name = JSON.stringify(where);
  if (own.built !== name || !own.parts.length) {
    const open = own.parts.length ? openGroups() : stored().open ?? ["path"];
    own.parts = parts(own.schema, state, where, open, inPicture);
    own.built = name;
    inPicture.section = null;
    $("settings").replaceChildren(...own.parts);
  }
  own.parts.forEach((part) => part.update(state));
  inPicture.changed();
  const selected = seamState(chosen());
  ends?.show(selected && seamLine(selected.id), selected?.settings, selected && isReversed(selected));
  $("scope-seam").hidden = !seamIds().length;
  $("scope-seam").textContent = WORDS.scopeSeam(chosen());
  $("scope-seam").setAttribute("aria-pressed", String(id !== null));
  $("scope-joint").hidden = !jointOf(chosen());
  $("scope-joint").textContent = WORDS.scopeJoint(jointOf(chosen()));
  $("scope-joint").setAttribute("aria-pressed", String(Boolean(where.joint)));
  $("scope-job").setAttribute("aria-pressed", String(id === null && !where.joint));
  $("actions").hidden = id === null;
  $("on").textContent = seamState(id)?.on ? WORDS.leaveOut : WORDS.weld;
}

function keyboard() {
  const acts = {
    ...Object.fromEntries(Object.entries(KINDS).map(([key, kind]) => [key, () => begin(kind)])), p: plan, x: () => weld(chosen(), !seamState(chosen())?.on), r: () => reverse(chosen()), "[": () => move(chosen(), -1), "]": () => move(chosen(), 1),
    j: () => scope({ seam: "job", job: "joint", joint: "seam" }[own.scope]), c: copy, s: crossSection, Escape: () => own.state.running && act("cancel"),
  };
  // Before the report takes the space bar for its player. A button in focus keeps Enter and space for itself.
  document.addEventListener("keydown", (event) => {
    const itsOwn = event.target.closest?.("button, summary, a, select, input");
    if (itsOwn && event.key !== "Escape") return;
    if (event.ctrlKey || event.metaKey || event.altKey || !clicks?.key(event.key)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }, { capture: true });
  document.addEventListener("keydown", (event) => {
    if (typing(event.target) || !own.state || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const control = event.ctrlKey || event.metaKey;
    const call = control ? { z: () => act(event.shiftKey ? "redo" : "undo"), y: () => act("redo") }[key] : acts[key];
    if (!call || (!page && !["p", "Escape"].includes(key))) return;
    event.preventDefault();
    call();
  });
}

// Where one looks outlives the page: it is loaded anew with each plan.
const STORE = `weldpath ${location.pathname}`;
const stored = () => JSON.parse(sessionStorage.getItem(STORE) ?? "{}");

function keep() {
  const { scene, state } = page;
  const camera = scene && { position: scene.camera.position.toArray(), target: scene.controls.target.toArray() };
  sessionStorage.setItem(STORE, JSON.stringify({ seam: state.seam, scope: own.scope, open: openGroups(), camera: scene?.fits ? null : camera, scroll: $("panel").scrollTop, reasons: $("verdict").open }));
}

function restore() {
  const { seam, scope: last, camera, scroll, reasons: unfolded } = stored();
  own.scope = last ?? "seam";
  if (seamIds().includes(seam)) document.querySelector(`#seams tr[data-seam="${seam}"]`).click();
  if (camera && page.scene) {
    page.scene.fits = null;
    page.scene.camera.position.fromArray(camera.position);
    page.scene.controls.target.fromArray(camera.target);
    page.scene.controls.update();
    page.scene.redraw();
  }
  if (unfolded !== undefined) $("verdict").open = unfolded;
  $("panel").scrollTop = scroll ?? 0;
}

if (!page) {
  document.documentElement.lang = LANGUAGE;
  $("waiting").textContent = WORDS.waiting;
}
if (!page) document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
const seamLine = (id) => page.content.seams.find((seam) => seam.id === id);
const clicks = page?.scene ? new Clicks(page.scene, new page.scene.camera.position.constructor(...page.content.centre_mm), tell) : null;
const inPicture = {
  tell,
  changed: () => own.state && page?.scene && draw(page.scene, own.state.job, scopeNow().seam ? inPicture.section : null),
  seam: (id) => ({ seam: id, length_mm: page.content.summary.seams.find((one) => one.id === id).length_mm }),
  plane: (section) => { inPicture.section = section; inPicture.changed(); },
  clicks: clicks ? [KINDS.b, KINDS.h].map((kind) => ({ ...kind, begin: () => begin(kind) })) : [],
};
const ends = page?.scene ? new Ends(page.scene, (seam, key, mm) => change({ edit: "set", seam, key: `path.${key}`, value: mm })) : null;

toolbar();
keyboard();
if (page) {
  ticks();
  asks();
  reasons();
  leads();
  panel();
  restore();
  addEventListener("pagehide", keep);
  $("footer").append(" ", WORDS.keys);
}

// What is in focus of the lists that are made anew with each plan: a box, by what it is about.
const LISTED = ["#seams tr[data-seam] input", "#seams tr[data-seam] td button", "#reasons input"];
const about = (element) => element.dataset.reason ?? element.closest("tr")?.dataset.seam;
function focused() {
  const list = LISTED.find((selector) => document.activeElement?.matches(selector));
  const what = list && about(document.activeElement);
  return () => list && [...document.querySelectorAll(list)].find((one) => about(one) === what)?.focus();
}

// Takes the last plan, its points, too, if they are of another cloud than the one that is drawn; whether there is one.
async function takePlan() {
  const numbers = own.state.cloud === own.cloud ? await content() : null;
  const last = numbers?.cloud === own.cloud ? numbers : await report();
  if (!last) return false;
  const refocus = focused();
  page.renew(last.content, last.points);
  ticks();
  asks();
  reasons();
  leads();
  refocus();
  Object.assign(own, { plan: last.plan, cloud: last.cloud });
  Object.assign($("editor").dataset, { plan: last.plan, cloud: last.cloud });
  return true;
}

// Shows the last plan, and those that come while it is fetched.
async function bringUp() {
  if (own.taking) return;
  own.taking = true;
  while (own.state.plan !== own.plan) {
    if (page && (await takePlan())) continue;
    location.reload();
    return;
  }
  own.taking = false;
  render(own.state);
}

onState((state) => {
  if (own.state && state.revision !== own.state.revision && state.running && !clicks?.kind) note = "";
  own.state = state;
  if (state.plan === own.plan) render(state);
  else bringUp();
});
ofJob().then((schema) => {
  own.schema = schema;
  return follow((gone) => {
    $("status").classList.toggle("gone", gone);
    if (gone) said.textContent = WORDS.gone;
  });
});
