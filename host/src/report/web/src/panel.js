// Everything on the page but the picture: tiles, warnings, list of seams, details, charts, tables.

import { $, el } from "./dom.js";
import { bars, card, histogram, lines } from "./charts.js";
import { content, deviation, duration, label, number, percent, place, seams, viewColour } from "./content.js";
import { total_s, waypoints, weldOf, weldTime } from "./program.js";
import { TEXTS } from "./texts.js";

const sum = (values) => values.reduce((a, b) => a + b, 0);
const known = (values) => values.filter((v) => v !== null && v !== undefined);
// Views whose points are in the model, in the order of its colours.
const usedViews = () => content.summary.views.filter((v) => v.left_out === null);
const unitAfter = (unit) => (unit === "°" ? unit : ` ${unit}`);

export function head() {
  $("title").textContent = content.title;
  const views = content.summary.views.length;
  $("subtitle").textContent = [
    views ? TEXTS.views(views) : seams.length > 0 && TEXTS.oneCloud,
    content.clouds.model && TEXTS.pointsInModel(content.clouds.model.of),
    `weldpath ${content.summary.weldpath}`,
    TEXTS.millimetres(TEXTS.frames[content.summary.frame]),
  ].filter(Boolean).join(" · ");
}

// What may be done with the program: one line, which unfolds to the reasons.
export function verdict(onSelect) {
  const { state, reasons, limits } = content.summary.verdict;
  const item = (reason) => el("li", { class: reason.accepted ? "accepted" : "" },
    el("code", {}, reason.id), reason.accepted ? TEXTS.accepted : " ", sentence(reason.words), " ",
    seams.some((seam) => seam.id === reason.seam) && el("button", { type: "button", "data-seam": reason.seam, onclick: () => onSelect(reason.seam) }, TEXTS.seam(reason.seam)));
  const open = reasons.filter((reason) => !reason.accepted).map((reason) => reason.id);
  const notes = warningsByText().size;
  $("verdict").hidden = false;
  $("verdict").classList.remove(...Object.keys(TEXTS.states));
  $("verdict").classList.add(state);
  $("verdict-line").replaceChildren(...[el("strong", {}, TEXTS.states[state]), open.length > 0 && el("span", { class: "ids" }, [...new Set(open)].join(", ")),
    notes > 0 && el("span", { class: "count" }, `${notes} ${TEXTS.warnings(notes)}`)].filter(Boolean));
  $("reasons").replaceChildren(reasons.length ? el("ul", {}, reasons.map(item)) : el("p", {}, TEXTS.noReasons),
    ...limits.map((line) => el("p", { class: "soft" }, sentence(line))));
}

// What is assumed of the pose of what the picture shows.
export function assumed() {
  const ids = content.summary.verdict.reasons.map(({ id }) => id);
  const notes = Object.entries(TEXTS.assumed).filter(([id]) => ids.includes(id));
  $("assumed").hidden = !notes.length;
  $("assumed").replaceChildren(...notes.map(([id, text]) => el("span", { "data-assumed": id }, text)));
}

function tile(value, words, state = "") {
  return el("div", { class: `tile ${state}` }, el("b", {}, value), el("span", {}, words));
}

// A file name keeps its small letter.
const sentence = (text) => `${/^[a-z]+ /.test(text) ? text.charAt(0).toUpperCase() + text.slice(1) : text}.`;

// Each warning once, with the seams that have it.
function warningsByText() {
  const all = new Map(content.summary.warnings.map((text) => [text, []]));
  for (const seam of seams) for (const text of seam.warnings) all.set(text, [...all.get(text) ?? [], seam]);
  return all;
}

export function tiles() {
  const chosen = seams.filter((seam) => seam.selected);
  const worst_mm = Math.max(...known(chosen.map((s) => s.expected_error_mm)), 0);
  const worst_deg = Math.max(...known(chosen.map((s) => s.expected_error_deg)), 0);
  const least = Math.min(...known(chosen.map((s) => s.confidence)), 1);
  const fitness = known(content.summary.views.map((v) => v.fitness_after));
  const warnings = warningsByText().size;
  const weld_s = sum(chosen.map((s) => weldOf(s.id)).filter(Boolean).map(weldTime));
  const measured = deviation?.score;
  $("tiles").replaceChildren(...[
    tile(chosen.length === seams.length ? TEXTS.seams(seams.length) : TEXTS.seamsOf(chosen.length, seams.length), TEXTS.mmToWeld(number(sum(chosen.map((s) => s.length_mm))))),
    chosen.length > 0 && tile(percent(least), TEXTS.leastConfidence, least < 0.8 ? "warn" : "good"),
    chosen.length > 0 && tile(`${number(worst_mm)} mm`, TEXTS.largestError(number(worst_deg))),
    measured && tile(measured.rmse_p === undefined ? "–" : `${number(measured.rmse_p)} mm`, TEXTS.offTruth(number(measured.rmse_deg))),
    fitness.length > 0 && tile(percent(Math.min(...fitness)), TEXTS.worstView, Math.min(...fitness) < 0.6 ? "warn" : ""),
    total_s > 0 && tile(duration(weld_s), TEXTS.weldingOf(duration(total_s))),
    tile(warnings ? String(warnings) : TEXTS.none, TEXTS.warnings(warnings), warnings ? "warn" : "good"),
  ].filter(Boolean));
}

export function warnings(onSelect) {
  const item = ([text, own]) => el("li", {},
    el("span", {}, sentence(text)),
    own.map((seam) => el("button", { type: "button", "data-seam": seam.id, onclick: () => onSelect(seam.id) }, TEXTS.seam(seam.id))));
  const all = [...warningsByText()];
  $("warnings").replaceChildren(...(all.length ? [el("h3", {}, TEXTS.warningsTitle), el("ul", {}, all.map(item))] : []));
}

export function list(onSelect) {
  $("seams").replaceChildren();
  if (!seams.length) {
    $("seams").append(el("p", { class: "note" }, TEXTS.noSeams));
    return;
  }
  const row = (seam) => el("tr", { "data-seam": seam.id, class: seam.selected ? "" : "off", onclick: () => onSelect(seam.id) },
    el("td", {}, el("i", { class: "swatch", style: { background: seam.colour } }), el("button", { type: "button" }, `${seam.id} ${seam.joint}`), seam.warnings.length ? el("span", { title: TEXTS.hasWarnings, style: { color: "var(--warn)" } }, " ▲") : null,
      seam.one_side ? el("small", { class: "one-side", title: seam.notes.join("; ") }, TEXTS.oneSide) : null),
    el("td", { class: "num" }, number(seam.length_mm)),
    el("td", { class: "num" }, number(seam.expected_error_mm)),
    el("td", { class: "num" }, percent(seam.confidence), el("span", { class: "meter" }, el("i", { style: { width: `${100 * (seam.confidence ?? 0)}%` } }))));
  $("seams").append(el("table", {},
    el("thead", {}, el("tr", {}, el("th", { scope: "col" }, TEXTS.columns.seam), el("th", { scope: "col", class: "num" }, TEXTS.columns.length), el("th", { scope: "col", class: "num", title: TEXTS.errorTitle }, TEXTS.columns.error), el("th", { scope: "col", class: "num" }, TEXTS.columns.confidence))),
    el("tbody", {}, seams.map(row))));
}

// Inside corners that are no seams; `onLook` is given the one that is clicked.
export function unwelded(onLook) {
  const all = content.summary.unwelded;
  const item = (corner) => el("li", { "data-unwelded": corner.id },
    el("button", { type: "button", onclick: () => onLook(corner) }, TEXTS.unweldedOf(number(corner.length_mm), TEXTS.whyUnwelded[corner.reason])));
  $("unwelded").hidden = !all.length;
  $("unwelded").replaceChildren(el("summary", {}, TEXTS.unwelded(all.length)), el("ul", {}, all.map(item)));
}

// Keys that the details show in words of their own.
const TOLD = ["id", "joint", "selected", "closed", "length_mm", "points", "confidence", "expected_error_mm", "expected_error_deg", "relative_mm", "error_parts_mm", "dimensions", "reason", "warnings", "colour", "line_mm", "one_side", "notes"];

// What an expected error comes from: one part of the bar each, as wide as its share of the variance.
function errorBar(parts) {
  const known = Object.keys(TEXTS.parts).map((key, k) => ({ key, mm: parts[key] ?? 0, colour: viewColour(k) })).filter(({ mm }) => mm > 0);
  const whole = sum(known.map(({ mm }) => mm * mm));
  if (!whole) return null;
  const share = ({ mm }) => `${(100 * mm * mm) / whole}%`;
  return el("div", { class: "parts" },
    el("div", { class: "part-bar", role: "img", "aria-label": TEXTS.partsLabel }, known.map((part) => el("i", { style: { width: share(part), background: part.colour } }))),
    el("p", {}, known.map(({ key, mm, colour }) => el("span", {}, el("i", { class: "swatch", style: { background: colour } }), TEXTS.partOf(TEXTS.parts[key], number(mm))))));
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
    [TEXTS.rows.length, TEXTS.length(number(seam.length_mm), seam.closed)],
    [TEXTS.rows.confidence, percent(seam.confidence)],
    [TEXTS.rows.error, `${number(seam.expected_error_mm)} mm`],
    [TEXTS.rows.relative, `${number(seam.relative_mm)} mm`],
    [TEXTS.rows.torch, `${number(seam.expected_error_deg)}°`],
    ...seam.dimensions.map((d) => [label(d.name).name, d.value === null ? TEXTS.notMeasurable(d.reason) : `${d.value.toFixed(1)} ± ${d.uncertainty.toFixed(1)}${unitAfter(label(d.name).unit)}`]),
    off.length > 0 && [TEXTS.rows.measured, TEXTS.measured(number(Math.sqrt(sum(off.map((v) => v * v)) / off.length)), number(Math.max(...off)))],
    weld && [TEXTS.rows.waypoints, String(seam.points)],
    weld && [TEXTS.rows.time, duration(weldTime(weld))],
    weld && [TEXTS.rows.begins, end(weld.start)],
    weld && [TEXTS.rows.ends, end(weld.end)],
    ...Object.entries(seam).filter(([key, v]) => !TOLD.includes(key) && v !== null && v !== "" && !(Array.isArray(v) && !v.length)).map(([key, v]) => [label(key).name, value(key, v)]),
  ].filter(Boolean);
  $("detail").replaceChildren(
    el("h3", {}, el("i", { class: "swatch", style: { background: seam.colour } }), TEXTS.seamTitle(seam.id, seam.joint), el("button", { type: "button", onclick: onZoom }, TEXTS.lookAtIt)),
    el("p", { class: "soft" }, seam.reason, seam.selected ? "" : TEXTS.notSelected),
    errorBar(seam.error_parts_mm),
    el("dl", {}, rows.map(([name, v]) => [el("dt", {}, name), el("dd", {}, v)])),
    ...seam.notes.map((text) => el("p", { class: "note-of-seam" }, sentence(text))),
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
  const series = (key) => names.map((name) => ({ name: TEXTS.seam(name), colour: colour(name), points: ofSeam(name).map((p) => [p.s_mm, p[key]]) }));
  const most = (key) => 1.15 * Math.max(...known(points.map((p) => p[key])), 1e-3);
  const long = Math.max(...points.map((p) => p.s_mm), 1);
  const expected = Math.max(...known(seams.filter((s) => s.selected).map((s) => s.expected_error_mm)), 0);
  cards.push(card(TEXTS.deviation, TEXTS.deviationWords(number(score.rmse_p), number(score.p95), percent(score.coverage), percent(score.false_frac)),
    lines(series("lateral_mm"), { x: { low: 0, high: long, label: TEXTS.alongSeam }, y: { low: 0, high: Math.max(most("lateral_mm"), 1.3 * expected), label: TEXTS.fromTrue }, levels: expected ? [{ at: expected, text: TEXTS.largestRmse }] : [] })));
  if (known(points.map((p) => p.axis_deg)).length) {
    cards.push(card(TEXTS.axis, TEXTS.axisWords(number(score.rmse_deg)),
      lines(series("axis_deg"), { x: { low: 0, high: long, label: TEXTS.alongSeam }, y: { low: 0, high: most("axis_deg"), label: TEXTS.angle } })));
  }
  return cards;
}

export function charts() {
  const { intensity, intensity_gate, ratio, ratio_threshold, ratio_decides, spacing_mm, spacing_marks_mm } = content.histograms;
  const cards = deviationCards();
  const longest = Math.max(...content.summary.views.map((v) => v.fitness_per_iteration.length), 0);
  if (longest > 1) {
    cards.push(card(TEXTS.fitness, TEXTS.fitnessWords,
      lines(usedViews().map((v, k) => ({ name: v.name, colour: viewColour(k), points: v.fitness_per_iteration.map((f, i) => [i, f]) })),
        { x: { low: 0, high: longest - 1, label: TEXTS.iteration }, y: { low: 0, high: 1, label: TEXTS.fitnessAxis } })));
  }
  if (intensity.counts.some(Boolean)) {
    cards.push(card(TEXTS.intensity, TEXTS.intensityWords,
      histogram(intensity, { label: TEXTS.intensityAxis, decided: intensity_gate ?? undefined, marks: intensity_gate ? [{ at: intensity_gate, text: TEXTS.threshold(number(intensity_gate)) }] : [] })));
  }
  if (ratio.counts.some(Boolean)) {
    cards.push(card(TEXTS.ratio, TEXTS.ratioWords(ratio_decides),
      histogram(ratio, { label: TEXTS.ratioAxis, marks: [{ at: ratio_threshold, text: TEXTS.ratioMark(number(ratio_threshold), ratio_decides) }] })));
  }
  if (spacing_mm.counts.some(Boolean)) {
    cards.push(card(TEXTS.spacing, TEXTS.spacingWords,
      histogram(spacing_mm, { label: TEXTS.distance, marks: spacing_marks_mm.map(([text, at]) => ({ at, text: TEXTS.spacingMark(TEXTS.spacingMarks[text] ?? text, number(at)) })) })));
  }
  if (content.summary.stages.length) {
    cards.push(card(TEXTS.stages, TEXTS.stagesWords(number(sum(content.summary.stages.map((s) => s.time_s)))),
      bars(content.summary.stages.map((s) => ({ name: s.name, value: 1000 * s.time_s })), { unit: "ms", label: TEXTS.stages })));
  }
  $("charts").replaceChildren(...cards);
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
  const names = TEXTS.cellRows;
  const done = (found) => (found.applied ? TEXTS.corrected : TEXTS.notSignificant);
  return [
    ...(robot ? [[names.scatterMm, number(robot.scatter_mm), "", ""], [names.scatterDeg, number(robot.scatter_deg), "", ""]] : []),
    ...(hand_eye ? [
      [names.shift, number(hand_eye.shift_mm), number(hand_eye.shift_sigma_mm), done(hand_eye)],
      [names.turn, number(hand_eye.turn_deg), number(hand_eye.turn_sigma_deg), done(hand_eye)],
    ] : []),
    ...(camera ? [
      [names.focal, number(100 * camera.focal), number(100 * camera.focal_sigma), done(camera)],
      [names.rows, number(1e3 * camera.centre[0]), number(1e3 * camera.centre_sigma[0]), done(camera)],
      [names.columns, number(1e3 * camera.centre[1]), number(1e3 * camera.centre_sigma[1]), done(camera)],
      [names.k1, number(camera.k1), number(camera.k1_sigma), done(camera)],
    ] : []),
  ];
}

export function facts() {
  const { clouds } = content;
  const used = usedViews();
  const isOpen = Boolean(document.querySelector("#facts details[open]"));
  const sample = (count, of, words) => count < of && words(count, of);
  const thinned = [sample(clouds.model?.count, clouds.model?.of, TEXTS.modelPoints), sample(clouds.raw?.count, clouds.raw?.of, TEXTS.rawPoints),
    sample(content.waypoints.length, content.waypoints_of, TEXTS.waypointsOf)].filter(Boolean);
  const parts = [];
  if (content.summary.views.length) {
    parts.push(section(TEXTS.viewsTitle, content.summary.base_frame.hand_eye
      ? TEXTS.viewsTogether
      : TEXTS.viewsFirst,
      table(TEXTS.viewColumns, content.summary.views.map((v) => [
        el("span", {}, used.includes(v) && el("i", { class: "swatch", style: { background: viewColour(used.indexOf(v)) } }), v.name, v.left_out === null ? "" : TEXTS.leftOut),
        number(v.fitness_before), number(v.fitness_after), number(v.moved_mm), number(v.moved_deg), number(v.uncertainty_mm)]))));
  }
  const found = cell();
  if (found.length) {
    parts.push(section(TEXTS.cell, TEXTS.cellWords,
      table(TEXTS.cellColumns, found)));
  }
  if (content.summary.derived.length) parts.push(section(TEXTS.derived, TEXTS.derivedWords,
    table(TEXTS.derivedColumns, content.summary.derived.map((d) => [label(d.name).name, `${number(d.value)} ${label(d.name).unit}`, d.how]))));
  parts.push(section(TEXTS.inputs, null,
    content.summary.inputs.length > 0 && el("ul", {}, content.summary.inputs.map((file) => el("li", {}, el("code", {}, file)))),
    content.summary.notes.length ? el("ul", {}, content.summary.notes.map((note) => el("li", {}, note))) : null,
    thinned.length ? el("p", {}, TEXTS.thinned(thinned)) : null,
    deviation ? null : el("p", {}, TEXTS.noTruth, el("code", {}, "weldpath evaluate DIR --truth FILE --report"), TEXTS.evaluate)));
  parts.push(el("details", { class: "card", open: isOpen }, el("summary", {}, TEXTS.job), el("pre", { tabindex: "0", "aria-label": "job.toml" }, content.job)));
  $("facts").replaceChildren(...parts);
}
