// The page: joins the numbers, the picture and the player.

import { $, el, svg } from "./dom.js";
import { BORDERS, content, deviation, duration, layers, number, place, seams, takeContent, viewColour } from "./content.js";
import { Scene } from "./scene.js";
import { readProgram, torchAt, total_s, waypoints, weldOf, welds } from "./program.js";
import * as panel from "./panel.js";
import { LANGUAGE, PAGE, TEXTS } from "./texts.js";

const state = { time_s: 0, seam: null, playing: false, colouring: 0, cloud: "model" };
let scene = null;
let tags = [];

// What a link or a test may ask for: #seam=2&colour=intensity&cloud=raw&look=top&theme=dark&t=12&show=cameras
const wish = new URLSearchParams(location.hash.slice(1));

const COLOURINGS = ["height", "intensity", "normals", "view", "filter", "surfaces"];
const CLOUDS = ["model", "unfiltered", "raw"];
// What can be hidden, and whether it is shown at first.
const SHOWN = [["unwelded", true], ["frames", true], ["way", true], ["torch", true], ["arm", true], ["truth", true], ["cameras", false]];

function select(id, move = true) {
  const seam = seams.find((s) => s.id === id);
  if (!seam) return;
  state.seam = id;
  panel.detail(seam, () => scene?.look("home", seam));
  scene?.highlight(seam);
  for (const { button, seam: own } of tags) button.setAttribute("aria-pressed", String(own.id === id));
  const weld = weldOf(id);
  if (move && weld) seek(waypoints[weld.start].time_s);
}

function seek(time_s) {
  state.time_s = Math.min(Math.max(time_s, 0), total_s);
  if (!waypoints.length) return;
  const torch = torchAt(state.time_s);
  state.torch_mm = torch.position_mm.toArray();
  $("slider").value = state.time_s;
  const doing = TEXTS.doing[torch.kind === "weld" && !torch.arc ? "still" : torch.kind];
  $("slider").setAttribute("aria-valuetext", TEXTS.sliderAt(number(state.time_s), doing));
  const item = (name, value) => el("span", {}, `${name} `, el("b", {}, value));
  const weld = torch.arc && weldOf(torch.seam);
  $("readout").replaceChildren(...[
    item("", TEXTS.timeOf(duration(state.time_s), duration(total_s))),
    item("", torch.seam && torch.kind !== "air" ? TEXTS.seamDoing(torch.seam, doing) : doing),
    weld && item(TEXTS.along, TEXTS.alongOf(number(torch.s_mm), number(waypoints[weld.end].s_mm))),
    item(TEXTS.feed, `${number(torch.feed_mm_s)} mm/s`),
    item(TEXTS.xyz, `${place(state.torch_mm)} mm`),
    torch.joints_rad && item(TEXTS.joints, `${torch.joints_rad.map((angle) => Math.round((180 * angle) / Math.PI)).join(", ")}°`),
    torch.joints_rad === null && item(content.arm.name, TEXTS.notReached),
    torch.joints_rad && torch.touching !== null && item(content.arm.name, TEXTS.touches),
  ].filter(Boolean));
  scene?.moveTorch(torch);
}

function play(on) {
  state.playing = on && total_s > 0;
  $("play").textContent = state.playing ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", state.playing ? TEXTS.pause : TEXTS.play);
  if (!state.playing) return;
  if (state.time_s >= total_s) seek(0);
  let before;
  const step = (now) => {
    if (!state.playing) return;
    seek(state.time_s + (before === undefined ? 0 : ((now - before) / 1000) * Number($("rate").value)));
    before = now;
    if (state.time_s >= total_s) play(false);
    else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function player() {
  const slider = $("slider");
  slider.addEventListener("input", () => {
    play(false);
    seek(Number(slider.value));
  });
  $("play").addEventListener("click", () => play(!state.playing));
  bands();
}

// The player's track, with what is welded when.
function bands() {
  $("player").hidden = !waypoints.length;
  $("slider").max = total_s;
  const share = (s) => `${(100 * s) / (total_s || 1)}%`;
  $("bands").replaceChildren(...welds.map(({ seam, start, end }) => el("span", {
    style: { left: share(waypoints[start].time_s), width: share(waypoints[end].time_s - waypoints[start].time_s), background: seams.find((s) => s.id === seam)?.colour },
  })));
}

function tools() {
  const choice = (id, name, options, chosen, onchange) => el("label", {}, el("span", {}, name),
    el("select", { id, onchange }, options.map(([value, text]) => el("option", { value, selected: value === chosen }, text))));
  const boxes = SHOWN.map(([name, on]) => {
    const shown = on || Boolean(wish.get("show")?.split(",").includes(name));
    scene.show(name, shown);
    return el("label", {}, el("input", { type: "checkbox", id: `show-${name}`, checked: shown, onchange: (event) => scene.show(name, event.target.checked) }), TEXTS.shown[name]);
  });
  const colourings = COLOURINGS.map((name, k) => [String(k), TEXTS.colourings[name]]);
  $("tools").append(
    choice("cloud", TEXTS.cloud, CLOUDS.filter((name) => name !== "raw" || scene.groups.raw).map((name) => [name, TEXTS.clouds[name]]), state.cloud, (event) => cloud(event.target.value)),
    choice("colour-by", TEXTS.colourBy, colourings, String(state.colouring), (event) => colouring(Number(event.target.value))),
    el("details", { class: "popup", id: "shown" }, el("summary", {}, TEXTS.show), el("div", { class: "list" }, boxes)));
  $("tools").addEventListener("submit", (event) => event.preventDefault());
  for (const [from, text] of Object.entries(TEXTS.looks)) {
    $("looks").append(el("button", { type: "button", title: TEXTS.looksTitle[from], onclick: () => scene.look(from) }, text));
  }
}

// Nobody is asked about what is not there; an edit may bring the robot.
function offered() {
  for (const [name] of SHOWN) {
    const box = $(`show-${name}`);
    box.closest("label").hidden = !scene.groups[name];
    scene.show(name, box.checked);
  }
}

function cloud(which) {
  state.cloud = which;
  scene.cloud(which);
  legend();
}

function colouring(k) {
  state.colouring = k;
  scene.colouring(k);
  legend();
}

// Views whose points are in the model, in the order of its colours.
const used = () => content.summary.views.filter((v) => v.left_out === null);

// What the colours mean.
function legend() {
  const css = (c) => `rgb(${c.join(" ")})`;
  const ramp = (stops, low, high) => [el("div", { class: "ramp", style: { background: `linear-gradient(90deg, ${stops.join(", ")})` } }), el("div", { class: "ends" }, el("span", {}, low), el("span", {}, high))];
  const key = (colour, text) => el("span", {}, el("i", { style: { background: colour } }), text);
  const stops = content.ramp.map(css);
  const gate = content.histograms.intensity_gate ?? 0.1;
  const base = content.up.reduce((sum, u, k) => sum + u * content.centre_mm[k], 0);
  const parts = [
    () => [TEXTS.legend.height, ramp(stops, number(base + content.heights_mm[0]), number(base + content.heights_mm[1]))],
    () => [TEXTS.legend.intensity, ramp([`#8b98a8 ${(100 * gate) / (0.5 * content.intensity_full)}%`, ...stops.slice(2)], TEXTS.flat(number(gate)), TEXTS.andMore(number(0.5 * content.intensity_full)))],
    () => [TEXTS.legend.normals, el("div", { class: "keys" }, key("#ff8080", "x"), key("#80ff80", "y"), key("#8080ff", "z"))],
    () => [TEXTS.legend.view, el("div", { class: "keys" }, (used().length ? used().slice(0, 10) : [{ name: TEXTS.theCloud }]).map((v, k) => key(viewColour(k), v.name)))],
    () => [TEXTS.legend.filter, ramp(["#2673f2", "#8b98a8", "#f27319"], TEXTS.below(number(filterScale())), TEXTS.above(number(filterScale())))],
    () => [TEXTS.legend.surfaces(...["plane", "cylinder", "freeform"].map((shape) => content.surfaces.filter((s) => s.shape === shape).length)),
      el("div", { class: "keys" }, BORDERS.map(([border, css]) => key(css, TEXTS.borders[border])))],
  ];
  const arm = scene.groups.arm && content.arm;
  $("legend").replaceChildren(...parts[state.colouring]().flat(),
    ...(arm ? [el("div", {}, TEXTS.armLegend(arm.name))] : []));
}

// Two standard deviations of the noise fill the colours of the filter's work.
const filterScale = () => 2 * (content.summary.derived.find((d) => d.name === "noise_mm")?.value || 0.25);

// Buttons with the seams' ids, each at the middle of its seam.
function labels() {
  tags.forEach((tag) => tag.button.remove());
  tags = seams.map((seam) => {
    const button = el("button", { type: "button", title: TEXTS.seamTitle(seam.id, seam.joint), "aria-pressed": "false", style: { background: seam.selected ? seam.colour : "#7c8795" }, onclick: () => select(seam.id) }, String(seam.id));
    return { seam, button, at: scene.anchor(seam) };
  });
  $("labels").prepend(...tags.map((tag) => tag.button));
}

function afterFrame(drawn) {
  for (const { button, at } of tags) {
    const { x, y, z } = drawn.project(at);
    button.style.transform = `translate(${(x - 12).toFixed(1)}px, ${(y - 12).toFixed(1)}px)`;
    button.style.visibility = z < 1 ? "visible" : "hidden";
  }
  const axes = drawn.compass().map((v, k) => ({ v, name: "xyz"[k], colour: ["#f0584c", "#2fb866", "#4b8bff"][k] })).sort((a, b) => a.v.z - b.v.z);
  $("axes").replaceChildren(...axes.flatMap(({ v, name, colour }) => [
    svg("line", { x2: 25 * v.x, y2: -25 * v.y, stroke: colour, "stroke-width": 3 }),
    svg("text", { x: 34 * v.x, y: -34 * v.y + 4.5, fill: colour, "text-anchor": "middle" }, name)]));
  const most = 150 / drawn.pxPerMm();
  const power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((f) => f * power).find((mm) => mm <= most);
  $("scale").style.width = `${(length * drawn.pxPerMm()).toFixed(1)}px`;
  $("scale").replaceChildren(el("span", {}, `${length} mm`));
}

// A click that is no drag selects the seam under it.
function picking(canvas) {
  let down = null;
  canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 4) return;
    const box = canvas.getBoundingClientRect();
    const seam = scene.seamAt(event.clientX - box.left, event.clientY - box.top);
    if (seam) select(seam.id);
  });
}

function keyboard() {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const tag = event.target.tagName;
    // What has keys of its own; a slider leaves the space bar and the digits.
    if (["SELECT", "BUTTON", "SUMMARY", "TEXTAREA"].includes(tag) || (tag === "INPUT" && event.target.type !== "range")) return;
    if (event.key === " ") play(!state.playing);
    else if (event.key >= "0" && event.key <= "9") typed(event.key, event.timeStamp);
    else if (tag !== "CANVAS") return;
    else if (event.key === "f" || event.key === "F" || event.key === "Home") scene.look("home");
    else if (event.key === "+" || event.key === "=") scene.nearer(0.85);
    else if (event.key === "-") scene.nearer(1 / 0.85);
    else if (event.key === "ArrowLeft") scene.turn(-0.1, 0);
    else if (event.key === "ArrowRight") scene.turn(0.1, 0);
    else if (event.key === "ArrowUp") scene.turn(0, -0.1);
    else if (event.key === "ArrowDown") scene.turn(0, 0.1);
    else return;
    event.preventDefault();
  });
}

// Digits that follow each other within this time, in ms, are one number: 1 2 selects seam 12, if there is one.
const SAME_NUMBER_MS = 900;
const typing = { text: "", at: -Infinity };

function typed(digit, at) {
  const longer = at - typing.at < SAME_NUMBER_MS ? typing.text + digit : digit;
  const known = (text) => seams.some((seam) => seam.id === Number(text));
  // What no seam's number begins with begins anew.
  const begins = seams.some((seam) => String(seam.id).startsWith(longer));
  Object.assign(typing, { text: begins ? longer : digit, at });
  if (known(typing.text)) select(Number(typing.text));
}

// The texts that stand in the page itself.
function pageTexts() {
  document.documentElement.lang = LANGUAGE;
  document.title = TEXTS.title(content.title);
  for (const element of document.querySelectorAll("[data-text]")) element.textContent = PAGE[element.dataset.text];
  for (const element of document.querySelectorAll("[data-label]")) element.setAttribute("aria-label", PAGE[element.dataset.label]);
  for (const element of document.querySelectorAll("[data-title]")) element.title = PAGE[element.dataset.title];
}

function theme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
}

function themes() {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const dark = () => document.documentElement.dataset.theme === "dark";
  theme(wish.has("theme") ? wish.get("theme") === "dark" : system.matches);
  system.addEventListener("change", () => theme(system.matches));
  $("theme").addEventListener("click", () => theme(!dark()));
  $("print").addEventListener("click", () => window.print());
  // On paper nothing can be unfolded.
  let before = {};
  window.addEventListener("beforeprint", () => {
    before = { dark: dark(), open: $("verdict").open };
    theme(false);
    $("verdict").open = true;
  });
  window.addEventListener("afterprint", () => {
    theme(before.dark);
    $("verdict").open = before.open;
  });
}

function picture() {
  try {
    scene = new Scene($("canvas"), layers($("points")), afterFrame);
  } catch (error) {
    // Without WebGL the numbers are still worth reading.
    $("nogl").hidden = false;
    $("canvas").hidden = true;
    return;
  }
  scene.filterScale(filterScale());
  state.colouring = Math.max(COLOURINGS.indexOf(wish.get("colour")), 0);
  state.cloud = CLOUDS.find((name) => name === wish.get("cloud")) ?? "model";
  tools();
  offered();
  labels();
  cloud(state.cloud);
  colouring(state.colouring);
  picking($("canvas"));
  if (wish.has("look")) scene.look(wish.get("look"));
}

// What a plan says in words and numbers.
function words() {
  panel.verdict(select);
  panel.assumed();
  panel.tiles();
  panel.warnings(select);
  panel.list(select);
  panel.unwelded((corner) => scene?.look("home", corner));
  panel.facts();
}

// On a phone the list is a sheet below the picture, which can be folded.
const isSheet = () => getComputedStyle($("sheet")).display !== "none";

function fold(folded) {
  $("panel").classList.toggle("folded", folded);
  $("sheet").setAttribute("aria-expanded", String(!folded));
  $("sheet").textContent = folded ? "▴" : "▾";
}

// What unfolds: the details of the run over the picture, and on a phone the list below it.
function unfolding() {
  const drawer = (open) => {
    $("drawer").hidden = !open;
    $("more").setAttribute("aria-expanded", String(open));
    $(open ? "drawer" : "more").focus();
  };
  $("more").addEventListener("click", () => drawer($("drawer").hidden));
  $("close").addEventListener("click", () => drawer(false));
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    const focus = document.activeElement;
    const popup = focus?.closest("details.popup[open]");
    if (!$("drawer").hidden) drawer(false);
    else if (popup) {
      popup.open = false;
      popup.querySelector("summary").focus();
    } else if (isSheet() && !$("panel").classList.contains("folded") && $("panel").contains(focus)) {
      fold(true);
      $("sheet").focus();
    } else return;
    event.stopImmediatePropagation();
  }, { capture: true });
  $("sheet").addEventListener("click", () => fold(!$("panel").classList.contains("folded")));
  // A refusal is read before anything else.
  $("verdict").open = content.summary.verdict.state === "refused";
}

// The seam at the place of another one, as a new search may number it otherwise; else one that is welded.
function seamNear(line_mm) {
  const middle = line_mm?.[line_mm.length >> 1];
  const away = (seam) => Math.min(...seam.line_mm.map((p) => Math.hypot(...p.map((v, axis) => v - middle[axis]))));
  const near = middle ? seams.filter((seam) => away(seam) < SAME_SEAM_MM).sort((a, b) => away(a) - away(b)) : [];
  return near[0] ?? seams.find((seam) => seam.selected) ?? seams[0];
}

const SAME_SEAM_MM = 10;

// Another plan in place of this one: lines, torch, words and player are made anew. Whoever looks stays where he is, and so do the
// clouds, unless `points` holds those of another search.
function renew(next, points) {
  const { line_mm } = seams.find((seam) => seam.id === state.seam) ?? {};
  takeContent(next);
  readProgram();
  if (!waypoints.length) play(false);
  words();
  bands();
  if (points) {
    panel.head();
    panel.charts();
    scene?.replaceClouds(layers(points));
    scene?.filterScale(filterScale());
    scene?.cloud(state.cloud);
    state.seam = seamNear(line_mm)?.id ?? null;
    if (state.seam === null) $("detail").replaceChildren();
  }
  scene?.renew();
  if (scene) {
    labels();
    offered();
    legend();
  }
  if (state.seam !== null) select(state.seam, false);
  seek(state.time_s);
}

pageTexts();
themes();
panel.head();
words();
unfolding();
player();
picture();
keyboard();
panel.charts();
seek(0);
const first = seams.find((seam) => seam.selected) ?? seams[0];
if (first) select(Number(wish.get("seam") ?? first.id));
if (wish.has("t")) seek(Number(wish.get("t")));
$("footer").textContent = TEXTS.footer(content.summary.weldpath);

// For tests and the curious.
globalThis.weldpath = { state, content, deviation, scene, renew };
