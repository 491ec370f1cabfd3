// Small charts, drawn as SVG so that they follow the theme and print.

import { el, svg } from "./dom.js";
import { number } from "./content.js";
import { TEXTS } from "./texts.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [440, 220, 46, 14, 18, 40];

// Round values that divide [low, high] into about `count` parts.
function ticks(low, high, count = 5) {
  const raw = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= raw);
  const out = [];
  for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + 1e-9 * step; v += step) out.push(Math.abs(v) < 1e-12 ? 0 : v);
  return { out, text: (v) => v.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9))) };
}

function frame({ x, y, height = HEIGHT, summary }) {
  const at = (axis, from, to) => (v) => from + ((v - axis.low) / (axis.high - axis.low || 1)) * (to - from);
  const [px, py] = [at(x, LEFT, WIDTH - RIGHT), at(y, height - BOTTOM, TOP)];
  const root = svg("svg", { viewBox: `0 0 ${WIDTH} ${height}`, class: "chart", role: "img", "aria-label": summary });
  const [xs, ys] = [ticks(x.low, x.high, 6), ticks(y.low, y.high, 4)];
  for (const v of ys.out) {
    root.append(svg("path", { class: "rule", d: `M${LEFT} ${py(v)}H${WIDTH - RIGHT}` }),
      svg("text", { x: LEFT - 7, y: py(v) + 4, "text-anchor": "end" }, ys.text(v)));
  }
  for (const v of xs.out) {
    root.append(svg("path", { class: "axis", d: `M${px(v)} ${height - BOTTOM}v4` }),
      svg("text", { x: px(v), y: height - BOTTOM + 17, "text-anchor": "middle" }, xs.text(v)));
  }
  root.append(svg("path", { class: "axis", d: `M${LEFT} ${height - BOTTOM}H${WIDTH - RIGHT}` }),
    svg("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: height - 5, "text-anchor": "middle" }, x.label),
    svg("text", { x: 0, y: 10 }, y.label));
  return { root, px, py, bottom: height - BOTTOM };
}

function mark({ root, px, bottom }, { at, text }, row = 0) {
  const x = px(at);
  const right = x > 0.62 * WIDTH;
  root.append(svg("path", { class: "mark", d: `M${x} ${TOP - 4}V${bottom}` }),
    svg("text", { class: "mark-text", x: x + (right ? -6 : 6), y: TOP + 6 + 15 * row, "text-anchor": right ? "end" : "start" }, text));
}

export function histogram({ low, high, counts }, { label, marks = [], decided }) {
  const most = Math.max(...counts, 1);
  const total = counts.reduce((a, b) => a + b, 0);
  const chart = frame({ x: { low, high, label }, y: { low: 0, high: (100 * most) / total, label: TEXTS.share }, summary: TEXTS.histogram(label) });
  const width = (high - low) / counts.length;
  counts.forEach((count, k) => {
    const [from, to] = [chart.px(low + k * width), chart.px(low + (k + 1) * width)];
    const y = chart.py((100 * count) / total);
    const bar = svg("rect", { class: decided !== undefined && low + (k + 0.5) * width < decided ? "fill dim" : "fill", x: from + 0.5, y, width: Math.max(to - from - 1, 0.5), height: Math.max(chart.bottom - y, 0) });
    bar.append(svg("title", {}, TEXTS.barTitle(number(low + k * width), number(low + (k + 1) * width), ((100 * count) / total).toFixed(1))));
    chart.root.append(bar);
  });
  marks.filter(({ at }) => at >= low && at <= high).forEach((m, row) => mark(chart, m, row));
  return chart.root;
}

export function lines(series, { x, y, levels = [] }) {
  const chart = frame({ x, y, summary: TEXTS.over(y.label, x.label) });
  for (const { at, text } of levels) {
    chart.root.append(svg("path", { class: "mark", d: `M${LEFT} ${chart.py(at)}H${WIDTH - RIGHT}` }),
      svg("text", { class: "mark-text", x: WIDTH - RIGHT, y: chart.py(at) - 5, "text-anchor": "end" }, text));
  }
  for (const { points, colour, name } of series) {
    const known = points.filter(([, v]) => v !== null && Number.isFinite(v));
    const path = known.map(([u, v], i) => `${i ? "L" : "M"}${chart.px(u).toFixed(1)} ${chart.py(Math.min(v, y.high)).toFixed(1)}`).join("");
    const last = known[known.length - 1];
    const line = svg("path", { class: "series", d: path, stroke: colour }, svg("title", {}, last ? TEXTS.endsAt(name, number(last[1])) : name));
    chart.root.append(line);
    if (known.length === 1) chart.root.append(svg("circle", { cx: chart.px(last[0]), cy: chart.py(last[1]), r: 3.5, fill: colour }));
  }
  return el("div", {}, chart.root, el("div", { class: "chart-keys" },
    series.map(({ colour, name }) => el("span", {}, el("i", { class: "swatch", style: { background: colour } }), name))));
}

// Horizontal bars, one a row.
export function bars(rows, { unit, label }) {
  const most = Math.max(...rows.map((row) => row.value), 1e-9);
  const root = svg("svg", { viewBox: `0 0 ${WIDTH} ${rows.length * 26 + 8}`, class: "chart", role: "img", "aria-label": label });
  rows.forEach(({ name, value }, k) => {
    const [y, width] = [k * 26 + 4, (value / most) * (WIDTH - 210)];
    root.append(svg("text", { x: 0, y: y + 14 }, name),
      svg("rect", { class: "fill", x: 120, y: y + 3, width: Math.max(width, 1), height: 14, rx: 2 }),
      svg("text", { class: "strong", x: 126 + Math.max(width, 1), y: y + 14 }, `${number(value)} ${unit}`));
  });
  return root;
}

export function card(title, words, ...children) {
  return el("figure", { class: "card" }, el("h2", {}, title), el("figcaption", {}, words), children);
}
