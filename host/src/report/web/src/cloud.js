// The points: one draw call a layer; every colouring is done by the graphics card, so a change costs nothing.

import * as THREE from "three";
import { BORDERS, content, viewColour } from "./content.js";

const VERTEX = `
precision highp float;
precision highp int;
in vec4 position;
in vec4 detail;
in vec2 segment;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform vec3 low, up, views[10], borders[7], ramp[6];
uniform float radius, span, unfiltered, size_mm, px_at_1mm, least_px, full, gate, moved_mm;
uniform vec2 heights;
uniform int colouring;
uniform vec3 plain;
out vec3 colour;

vec3 normalOf(vec2 folded) {
  vec2 f = folded * 2.0 - 1.0;
  vec3 n = vec3(f, 1.0 - abs(f.x) - abs(f.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  return normalize(n);
}
vec3 onRamp(float t) {
  float place = clamp(t, 0.0, 1.0) * 5.0;
  int k = int(min(place, 4.0));
  return mix(ramp[k], ramp[k + 1], place - float(k));
}
void main() {
  vec3 n = normalOf(detail.xy);
  float moved = (position.w * 65535.0 - 32768.0) * 1e-3;
  vec3 p = low + position.xyz * span + n * moved * unfiltered;
  vec4 eye = modelViewMatrix * vec4(p, 1.0);
  gl_Position = projectionMatrix * eye;
  gl_PointSize = clamp(size_mm * px_at_1mm / -eye.z, least_px, 40.0);
  float intensity = detail.z * full;
  int view = int(detail.w * 255.0 + 0.5);
  if (colouring == 0) colour = onRamp((dot(up, p) - heights.x) / (heights.y - heights.x));
  else if (colouring == 1) colour = intensity < gate ? plain * (0.75 + 0.25 * intensity / gate) : onRamp(0.35 + 0.65 * (intensity - gate) / (0.5 * full - gate));
  else if (colouring == 2) colour = n * 0.5 + 0.5;
  else if (colouring == 3) colour = views[view % 10];
  else if (colouring == 5) {
    int surface = int(segment.x * 255.0 + 0.5), border = int(segment.y * 255.0 + 0.5);
    vec3 own = surface == 0 ? plain : mix(views[(surface - 1) % 10], vec3(1.0), 0.35 + 0.12 * float((surface - 1) / 10 % 3));
    colour = border == 0 ? own : borders[border - 1];
  }
  else colour = moved < 0.0 ? mix(plain, vec3(0.15, 0.45, 0.95), min(-moved / moved_mm, 1.0)) : mix(plain, vec3(0.95, 0.45, 0.1), min(moved / moved_mm, 1.0));
  // What is not the work steps back.
  colour = mix(colour, plain, 0.72 * smoothstep(1.1 * radius, 1.5 * radius, length(p)));
  float facing = abs(dot(normalize(mat3(modelViewMatrix) * n), normalize(eye.xyz)));
  colour *= colouring == 2 ? 0.75 + 0.25 * facing : 0.45 + 0.55 * facing;
}`;

const FRAGMENT = `
precision mediump float;
in vec3 colour;
out vec4 shown;
void main() {
  vec2 c = gl_PointCoord - 0.5;
  if (dot(c, c) > 0.25) discard;
  shown = vec4(colour, 1.0);
}`;

const rgb = (css) => new THREE.Color().setStyle(css, THREE.LinearSRGBColorSpace);

// One material for both layers; the uniforms are shared but for the layer's frame.
export const shared = {
  up: { value: new THREE.Vector3(...content.up) },
  views: { value: Array.from({ length: 10 }, (_, k) => rgb(viewColour(k))) },
  borders: { value: BORDERS.map(([, css]) => rgb(css)) },
  ramp: { value: content.ramp.map((c) => new THREE.Vector3(...c.map((v) => v / 255))) },
  heights: { value: new THREE.Vector2(...content.heights_mm) },
  full: { value: content.intensity_full },
  gate: { value: content.histograms.intensity_gate ?? 0.1 },
  moved_mm: { value: 1 },
  unfiltered: { value: 0 },
  radius: { value: content.radius_mm },
  colouring: { value: 0 },
  plain: { value: rgb("#8b98a8") },
  px_at_1mm: { value: 1 },
};

export function pointsOf(layer, centre, size_mm, least_px) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(layer.positions, 4, true));
  geometry.setAttribute("detail", new THREE.BufferAttribute(layer.attributes, 4, true));
  geometry.setAttribute("segment", new THREE.BufferAttribute(layer.surfaces, 2, true));
  const low = new THREE.Vector3(...layer.low_mm).sub(centre);
  const own = { low: { value: low }, span: { value: 65535 * layer.step_mm }, size_mm: { value: size_mm }, least_px: { value: least_px } };
  const material = new THREE.RawShaderMaterial({
    glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: { ...shared, ...own },
  });
  const points = new THREE.Points(geometry, material);
  points.frustumCulled = false;
  return points;
}
