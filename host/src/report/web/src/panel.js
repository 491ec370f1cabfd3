// Everything on the page but the picture: tiles, warnings, list of seams, details, charts, tables.

import { $, el } from "./dom.js";
import { bars, card, histogram, lines } from "./charts.js";
import { content, deviation, duration, label, number, percent, place, seams, viewColour } from "./content.js";
import { total_s, waypoints, weldOf, weldTime } from "./program.js";

const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;
const sum = (values) => values.reduce((a, b) => a + b, 0);
const known = (values) => values.filter((v) => v !== null && v !== undefined);
// Views whose points are in the model, in the order of its colours.
const usedViews = () => content.summary.views.filter((v) => v.left_out === null);
const unitAfter = (unit) => (unit === "°" ? unit : ` ${unit}`);

// Whose frame all coordinates are in.
const FRAMES = { base: "base frame", camera: "the camera's frame", unknown: "the scan's own frame" };

export function head() {
  $("title").textContent = content.title;
  const views = content.summary.views.length;
  $("subtitle").textContent = [
    views ? plural(views, "view") : seams.length > 0 && "one cloud",
    content.clouds.model && `${content.clouds.model.of.toLocaleString("en")} points in the model`,
    `weldpath ${content.summary.weldpath}`,
    `${FRAMES[content.summary.frame]}, millimetres`,
  ].filter(Boolean).join(" · ");
}

// What may be done with the program, before all else.
const STATES = { ready: "Ready", check: "Check: a person has to confirm", refused: "Refused: no program is written" };

export function verdict(onSelect) {
  const { state, reasons } = content.summary.verdict;
  const item = (reason) => el("li", { class: reason.accepted ? "accepted" : "" },
    el("code", {}, reason.id), reason.accepted ? " (accepted) " : " ", sentence(reason.words), " ",
    seams.some((seam) => seam.id === reason.seam) && el("button", { type: "button", onclick: () => onSelect(reason.seam) }, `seam ${reason.seam}`));
  $("verdict").hidden = false;
  $("verdict").classList.remove(...Object.keys(STATES));
  $("verdict").classList.add(state);
  $("verdict").replaceChildren(el("h2", {}, STATES[state]), reasons.length ? el("ul", {}, reasons.map(item)) : "");
}

function tile(value, words, state = "") {
  return el("div", { class: `tile ${state}` }, el("b", {}, value), el("span", {}, words));
}

// A file name keeps its small letter.
const sentence = (text) => `${/^[a-z]+ /.test(text) ? text.charAt(0).toUpperCase() + text.slice(1) : text}.`;

const allWarnings = () => [
  ...content.summary.warnings.map((text) => ({ text })),
  ...seams.flatMap((seam) => seam.warnings.map((text) => ({ text, seam }))),
];

export function tiles() {
  const chosen = seams.filter((seam) => seam.selected);
  const worst_mm = Math.max(...known(chosen.map((s) => s.expected_error_mm)), 0);
  const worst_deg = Math.max(...known(chosen.map((s) => s.expected_error_deg)), 0);
  const least = Math.min(...known(chosen.map((s) => s.confidence)), 1);
  const fitness = known(content.summary.views.map((v) => v.fitness_after));
  const warnings = allWarnings().length;
  const weld_s = sum(chosen.map((s) => weldOf(s.id)).filter(Boolean).map(weldTime));
  const measured = deviation?.score;
  $("tiles").replaceChildren(...[
    tile(chosen.length === seams.length ? plural(seams.length, "seam") : `${chosen.length} of ${plural(seams.length, "seam")}`, `${number(sum(chosen.map((s) => s.length_mm)))} mm to weld`),
    chosen.length > 0 && tile(percent(least), "least confidence", least < 0.8 ? "warn" : "good"),
    chosen.length > 0 && tile(`${number(worst_mm)} mm`, `largest expected error, ${number(worst_deg)}°`),
    measured && tile(measured.rmse_p === undefined ? "–" : `${number(measured.rmse_p)} mm`, `off the truth (RMSE), ${number(measured.rmse_deg)}°`),
    fitness.length > 0 && tile(percent(Math.min(...fitness)), "of the worst view aligned within 2 mm", Math.min(...fitness) < 0.6 ? "warn" : ""),
    total_s > 0 && tile(duration(weld_s), `welding, of ${duration(total_s)} moving`),
    tile(warnings ? String(warnings) : "none", warnings === 1 ? "warning" : "warnings", warnings ? "warn" : "good"),
  ].filter(Boolean));
}

// Warnings that are shown at once.
const UNFOLDED = 3;

export function warnings(onSelect) {
  const all = allWarnings();
  const isOpen = Boolean(document.querySelector("#warnings details[open]"));
  $("warnings").replaceChildren();
  if (!all.length) return;
  const item = ({ text, seam }) => el("li", {},
    el("span", {}, sentence(text)),
    seam && el("button", { type: "button", onclick: () => onSelect(seam.id) }, `seam ${seam.id}`));
  $("warnings").append(el("ul", {}, all.slice(0, UNFOLDED).map(item)));
  // The picture stays on the screen, however many there are.
  const rest = all.slice(UNFOLDED);
  if (rest.length) {
    $("warnings").append(el("details", { open: isOpen },
      el("summary", {}, `${plural(rest.length, "more warning")}`),
      el("ul", {}, rest.map(item))));
  }
}

export function list(onSelect) {
  $("seams").replaceChildren();
  if (!seams.length) {
    $("seams").append(el("p", { class: "note" }, "None was found. Colour the model by edge intensity to see where an edge stood out."));
    return;
  }
  const row = (seam) => el("tr", { "data-seam": seam.id, class: seam.selected ? "" : "off", onclick: () => onSelect(seam.id) },
    el("td", {}, el("i", { class: "swatch", style: { background: seam.colour } }), el("button", { type: "button" }, `${seam.id} ${seam.joint}`), seam.warnings.length ? el("span", { title: "has warnings", style: { color: "var(--warn)" } }, " ▲") : null),
    el("td", { class: "num" }, number(seam.length_mm)),
    el("td", { class: "num" }, number(seam.expected_error_mm)),
    el("td", { class: "num" }, percent(seam.confidence), el("span", { class: "meter" }, el("i", { style: { width: `${100 * (seam.confidence ?? 0)}%` } }))));
  $("seams").append(el("table", {},
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "seam, joint"), el("th", { scope: "col", class: "num" }, "length, mm"), el("th", { scope: "col", class: "num", title: "expected error of the tip, one standard deviation across the seam" }, "error, mm"), el("th", { scope: "col", class: "num" }, "confidence"))),
    el("tbody", {}, seams.map(row))));
}

// Keys that the details show in words of their own.
const TOLD = ["id", "joint", "selected", "closed", "length_mm", "points", "confidence", "expected_error_mm", "expected_error_deg", "relative_mm", "error_parts_mm", "dimensions", "reason", "warnings", "colour", "line_mm"];

// What an expected error comes from: one part of the bar each, as wide as its share of the variance.
const PARTS = {
  noise: "noise of the points",
  registration: "views against each other",
  calibration: "hand-eye, camera, robot",
  corner: "rounded corner",
  touch: "touches",
};

function errorBar(parts) {
  const known = Object.keys(PARTS).map((key, k) => ({ key, mm: parts[key] ?? 0, colour: viewColour(k) })).filter(({ mm }) => mm > 0);
  const whole = sum(known.map(({ mm }) => mm * mm));
  if (!whole) return null;
  const share = ({ mm }) => `${(100 * mm * mm) / whole}%`;
  return el("div", { class: "parts" },
    el("div", { class: "part-bar", role: "img", "aria-label": "Shares of the expected error's variance" }, known.map((part) => el("i", { style: { width: share(part), background: part.colour } }))),
    el("p", {}, known.map(({ key, mm, colour }) => el("span", {}, el("i", { class: "swatch", style: { background: colour } }), `${PARTS[key]} ${number(mm)} mm`))));
}

function value(key, v) {
  if (typeof v === "number") return `${number(v)}${label(key).unit && unitAfter(label(key).unit)}`;
  if (Array.isArray(v)) return v.every((x) => typeof x === "number") ? place(v) : v.join(", ");
  return v !== null && typeof v === "object" ? JSON.stringify(v) : String(v);
}

export function detail(seam, onZoom) {
  const weld = weldOf(seam.id);
  const own = deviation?.points.filter((p) => p.seam === String(seam.id)) ?? [];
  const off = known(own.map((p) => p.lateral_mm));
  const end = (k) => place(waypoints[k].position_mm.toArray());
  const rows = [
    ["length", `${number(seam.length_mm)} mm${seam.closed ? ", closed" : ""}`],
    ["confidence", percent(seam.confidence)],
    ["expected error of the tip", `${number(seam.expected_error_mm)} mm`],
    ["within the scan", `${number(seam.relative_mm)} mm`],
    ["expected error of the torch", `${number(seam.expected_error_deg)}°`],
    ...seam.dimensions.map((d) => [label(d.name).name, d.value === null ? `not measurable: ${d.reason}` : `${d.value.toFixed(1)} ± ${d.uncertainty.toFixed(1)}${unitAfter(label(d.name).unit)}`]),
    off.length > 0 && ["measured error (RMSE, largest)", `${number(Math.sqrt(sum(off.map((v) => v * v)) / off.length))}, ${number(Math.max(...off))} mm`],
    weld && ["waypoints", String(seam.points)],
    weld && ["weld time", duration(weldTime(weld))],
    weld && ["begins at x, y, z, mm", end(weld.start)],
    weld && ["ends at x, y, z, mm", end(weld.end)],
    ...Object.entries(seam).filter(([key, v]) => !TOLD.includes(key) && v !== null && v !== "" && !(Array.isArray(v) && !v.length)).map(([key, v]) => [label(key).name, value(key, v)]),
  ].filter(Boolean);
  $("detail").replaceChildren(
    el("h3", {}, el("i", { class: "swatch", style: { background: seam.colour } }), `Seam ${seam.id}: ${seam.joint}`, el("button", { type: "button", onclick: onZoom }, "look at it")),
    el("p", { class: "soft" }, seam.reason, seam.selected ? "" : "; not selected, so it is not welded"),
    errorBar(seam.error_parts_mm),
    el("dl", {}, rows.map(([name, v]) => [el("dt", {}, name), el("dd", {}, v)])),
    ...seam.warnings.map((text) => el("p", { class: "mind" }, `▲ ${text}`)));
  for (const row of document.querySelectorAll("#seams tr[data-seam]")) row.setAttribute("aria-selected", String(row.dataset.seam === String(seam.id)));
}

function deviationCards() {
  const cards = [];
  if (!deviation) return cards;
  const { score, points } = deviation;
  const names = [...new Set(points.map((p) => p.seam))];
  const ofSeam = (name) => points.filter((p) => p.seam === name);
  const colour = (name) => seams.find((s) => String(s.id) === name)?.colour ?? viewColour(0);
  const series = (key) => names.map((name) => ({ name: `seam ${name}`, colour: colour(name), points: ofSeam(name).map((p) => [p.s_mm, p[key]]) }));
  const most = (key) => 1.15 * Math.max(...known(points.map((p) => p[key])), 1e-3);
  const long = Math.max(...points.map((p) => p.s_mm), 1);
  const expected = Math.max(...known(seams.filter((s) => s.selected).map((s) => s.expected_error_mm)), 0);
  cards.push(card("Deviation from the truth: position", `RMSE ${number(score.rmse_p)} mm across the seam, 95 % of the points below ${number(score.p95)} mm; ${percent(score.coverage)} of the required seams covered, ${percent(score.false_frac)} of the path points on no seam. Gaps: beyond the end of a true seam.`,
    lines(series("lateral_mm"), { x: { low: 0, high: long, label: "along the seam, mm" }, y: { low: 0, high: Math.max(most("lateral_mm"), 1.3 * expected), label: "distance from the true seam, mm" }, levels: expected ? [{ at: expected, text: "largest expected RMSE" }] : [] })));
  if (known(points.map((p) => p.axis_deg)).length) {
    cards.push(card("Deviation from the truth: torch axis", `Angle between the planned and the true torch axis. RMSE of the whole orientation: ${number(score.rmse_deg)}°.`,
      lines(series("axis_deg"), { x: { low: 0, high: long, label: "along the seam, mm" }, y: { low: 0, high: most("axis_deg"), label: "angle, degrees" } })));
  }
  return cards;
}

export function charts() {
  const { intensity, intensity_gate, ratio, ratio_threshold, ratio_decides, spacing_mm, spacing_marks_mm } = content.histograms;
  const cards = deviationCards();
  const longest = Math.max(...content.summary.views.map((v) => v.fitness_per_iteration.length), 0);
  if (longest > 1) {
    cards.push(card("Registration: fitness per iteration", "Share of each view's overlap with a partner nearer than 2 mm; 0 is the pose that the robot reported. A line that stays low is a view that does not fit: check its pose, or leave it out.",
      lines(usedViews().map((v, k) => ({ name: v.name, colour: viewColour(k), points: v.fitness_per_iteration.map((f, i) => [i, f]) })),
        { x: { low: 0, high: longest - 1, label: "iteration" }, y: { low: 0, high: 1, label: "fitness" } })));
  }
  if (intensity.counts.some(Boolean)) {
    cards.push(card("Edge intensity and its automatic threshold", "How far the middle of a point's surroundings lies from the point, in radii (eq. 12). Points to the right of the threshold may be edges; it follows from the median.",
      histogram(intensity, { label: "edge intensity", decided: intensity_gate ?? undefined, marks: intensity_gate ? [{ at: intensity_gate, text: `threshold ${number(intensity_gate)}` }] : [] })));
  }
  if (ratio.counts.some(Boolean)) {
    const words = ratio_decides ? "Points to the right of t are edges." : "This run does not use it: it is scale free, so flat noise looks like edges. Shown for comparison.";
    cards.push(card("Intensity ratio of the paper, Tr³/Det", `Eq. (16); 27 is the least value there is, and the last bar holds all above it. ${words}`,
      histogram(ratio, { label: "Tr³/Det", marks: [{ at: ratio_threshold, text: `t = ${number(ratio_threshold)}${ratio_decides ? "" : ", not used"}` }] })));
  }
  if (spacing_mm.counts.some(Boolean)) {
    cards.push(card("Spacing of the raw points", "Distance from a point of the first view to its nearest neighbour there. Voxels that are finer than the spacing would leave holes.",
      histogram(spacing_mm, { label: "distance, mm", marks: spacing_marks_mm.map(([text, at]) => ({ at, text: `${text} ${number(at)} mm` })) })));
  }
  if (content.summary.stages.length) {
    cards.push(card("Time per stage", `${number(sum(content.summary.stages.map((s) => s.time_s)))} s in all, reading and writing not included.`,
      bars(content.summary.stages.map((s) => ({ name: s.name, value: 1000 * s.time_s })), { unit: "ms", label: "Time per stage" })));
  }
  $("charts").append(...cards);
}

function table(heads, rows) {
  const kind = (k) => (heads[k].startsWith("#") ? "num" : "");
  return el("table", {}, el("thead", {}, el("tr", {}, heads.map((h, k) => (h ? el("th", { scope: "col", class: kind(k) }, h.replace("#", "")) : el("td"))))),
    el("tbody", {}, rows.map((row) => el("tr", {}, row.map((cell, k) => el("td", { class: kind(k) }, cell))))));
}

function section(title, words, ...children) {
  return el("section", { class: "card" }, el("h2", {}, title), words && el("p", {}, words), children);
}

// What the views say of the cell: rows of name, value, standard deviation, and what was done about it.
function cell() {
  const { robot, hand_eye, camera } = content.summary.base_frame;
  const done = (found) => (found.applied ? "corrected" : "not significant");
  return [
    ...(robot ? [["reported poses scatter by, mm", number(robot.scatter_mm), "", ""], ["and by, °", number(robot.scatter_deg), "", ""]] : []),
    ...(hand_eye ? [
      ["hand-eye transform off by, mm", number(hand_eye.shift_mm), number(hand_eye.shift_sigma_mm), done(hand_eye)],
      ["and by, °", number(hand_eye.turn_deg), number(hand_eye.turn_sigma_deg), done(hand_eye)],
    ] : []),
    ...(camera ? [
      ["focal length longer by, %", number(100 * camera.focal), number(100 * camera.focal_sigma), done(camera)],
      ["optical axis off along rows, ‰ of the focal length", number(1e3 * camera.centre[0]), number(1e3 * camera.centre_sigma[0]), done(camera)],
      ["along columns", number(1e3 * camera.centre[1]), number(1e3 * camera.centre_sigma[1]), done(camera)],
      ["k1 larger by", number(camera.k1), number(camera.k1_sigma), done(camera)],
    ] : []),
  ];
}

export function facts() {
  const { clouds } = content;
  const used = usedViews();
  const isOpen = Boolean(document.querySelector("#facts details[open]"));
  const sample = (layer, name) => layer && layer.count < layer.of && `${layer.count.toLocaleString("en")} of ${layer.of.toLocaleString("en")} ${name}`;
  const thinned = [sample(clouds.model, "model points"), sample(clouds.raw, "raw points"), content.waypoints.length < content.waypoints_of && `${content.waypoints.length} of ${content.waypoints_of} waypoints`].filter(Boolean);
  const parts = [];
  if (content.summary.views.length) {
    parts.push(section("Views", content.summary.base_frame.hand_eye
      ? "All poses are adjusted together with the hand-eye transform, within what is stated of robot and cell."
      : "The pose of the first view that fits is taken as exact: its own error comes on top of everything here.",
      table(["view", "#fitness before", "#after", "#moved, mm", "#turned, °", "#uncertainty, mm"], content.summary.views.map((v) => [
        el("span", {}, used.includes(v) && el("i", { class: "swatch", style: { background: viewColour(used.indexOf(v)) } }), v.name, v.left_out === null ? "" : " (left out)"),
        number(v.fitness_before), number(v.fitness_after), number(v.moved_mm), number(v.moved_deg), number(v.uncertainty_mm)]))));
  }
  const found = cell();
  if (found.length) {
    parts.push(section("Robot and camera", "What the views say of them. What is not significant is left as stated, and counts in the expected error.",
      table(["", "#found", "#±", ""], found)));
  }
  if (content.summary.derived.length) parts.push(section("Derived from the data", "Nobody typed these.",
    table(["parameter", "#value", "how"], content.summary.derived.map((d) => [label(d.name).name, `${number(d.value)} ${label(d.name).unit}`, d.how]))));
  parts.push(section("Inputs", null,
    content.summary.inputs.length > 0 && el("ul", {}, content.summary.inputs.map((file) => el("li", {}, el("code", {}, file)))),
    content.summary.notes.length ? el("ul", {}, content.summary.notes.map((note) => el("li", {}, note))) : null,
    thinned.length ? el("p", {}, `To keep this page small it shows ${thinned.join(" and ")}, evenly picked; the files beside it hold all.`) : null,
    deviation ? null : el("p", {}, "No truth was given. ", el("code", {}, "weldpath evaluate DIR --truth FILE --report"), " adds the deviation from it to this page.")));
  parts.push(el("details", { class: "card", open: isOpen }, el("summary", {}, "Settings of this run (job.toml)"), el("pre", { tabindex: "0", "aria-label": "job.toml" }, content.job)));
  $("facts").replaceChildren(...parts);
}
