// The 3-D picture. It is drawn when something has changed, and not otherwise.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
import { content, deviation, seams, viewColour } from "./content.js";
import { pointsOf, shared } from "./cloud.js";
import { burns, waypoints, welds } from "./program.js";
import { Arm, torchBody } from "./robot.js";

const centre = new THREE.Vector3(...content.centre_mm);
const up = new THREE.Vector3(...content.up);
const radius = content.radius_mm;
const local = (p) => new THREE.Vector3(...p).sub(centre);
const FOV = 32;
// The paper's edge points come in no order: lines between them would hide everything.
const ORDERED = !content.histograms.ratio_decides;
// Lines that lie among points win over them.
const ABOVE = { polygonOffset: true, polygonOffsetFactor: -8, polygonOffsetUnits: -400 };

// Pairs of points as one draw call of wide lines.
function wide(pairs, colours, width, options = {}) {
  const geometry = new LineSegmentsGeometry().setPositions(pairs);
  if (colours) geometry.setColors(colours);
  const material = new LineMaterial({ linewidth: width, vertexColors: Boolean(colours), ...options });
  const line = new LineSegments2(geometry, material);
  line.frustumCulled = false;
  return line;
}

function pairsOf(places, closed) {
  const pairs = [];
  for (let i = 0; i + 1 < places.length + (closed ? 1 : 0); i++) pairs.push(...places[i], ...places[(i + 1) % places.length]);
  return pairs;
}

const repeat = (colour, pairs) => Array.from({ length: pairs.length / 3 }, () => colour.toArray()).flat();

function boxGeometry([least, greatest]) {
  const [low, high] = [local(least), local(greatest)];
  const size = high.clone().sub(low);
  return new THREE.BoxGeometry(...size).translate(...low.add(high).multiplyScalar(0.5));
}

// A square across the picture, where the plane is nearest to its middle; or one of the given size.
function planeGeometry([at, toward], size_mm) {
  const normal = new THREE.Vector3(...toward).normalize();
  const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), normal);
  const middle = size_mm ? local(at) : normal.multiplyScalar(local(at).dot(normal));
  const size = size_mm ?? 2 * radius;
  return new THREE.PlaneGeometry(size, size).applyQuaternion(turn).translate(...middle);
}

// Share of the picture's half that what is looked at fills at most: menus and legend lie along its rim.
const FILLED = 0.8;

// Where a camera looks at, and how far away it stands, that sees all places from a direction, each with a margin about it, mm.
function fitted(places, toward, margin_mm, aspect) {
  const right = up.clone().cross(toward).normalize();
  const above = toward.clone().cross(right);
  const seen = places.map((p) => [right, above, toward].map((axis) => p.dot(axis)));
  const middle = [0, 1, 2].map((k) => (Math.min(...seen.map((p) => p[k])) + Math.max(...seen.map((p) => p[k]))) / 2);
  const slope = FILLED * Math.tan((FOV * Math.PI) / 360);
  const needs = ([x, y, z]) => z - middle[2] + margin_mm + Math.max((Math.abs(x - middle[0]) + margin_mm) / aspect, Math.abs(y - middle[1]) + margin_mm) / slope;
  const at = new THREE.Vector3().addScaledVector(right, middle[0]).addScaledVector(above, middle[1]).addScaledVector(toward, middle[2]);
  return { middle: at, away: Math.max(...seen.map(needs)) };
}

export class Scene {
  constructor(canvas, layers, onFrame) {
    this.canvas = canvas;
    this.onFrame = onFrame;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(FOV, 1, radius / 200, radius * 60);
    this.camera.up.copy(up);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.zoomToCursor = true;
    this.controls.maxDistance = radius * 20;
    this.controls.addEventListener("change", () => this.redraw());
    // Whoever turns the picture keeps it as it is; until then it fits the window, however that changes.
    this.controls.addEventListener("start", () => { this.fits = null; });
    this.groups = {};
    this.addClouds(layers);
    this.addCameras();
    this.addTruth();
    this.addProgram();
    this.stats = { frames: 0, script_ms: 0, drawCalls: 0, points: 0 };
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
    this.look("home");
  }

  add(name, object, shown = true) {
    object.visible = shown;
    this.groups[name] = object;
    this.scene.add(object);
    return object;
  }

  addClouds({ model, raw }) {
    const voxel = content.summary.derived.find((d) => d.name === "voxel_mm")?.value ?? radius / 100;
    const spacing = content.summary.derived.find((d) => d.name === "spacing_mm")?.value ?? voxel;
    // Of a thinned layer the points that are left fill more.
    const thinned = (layer) => Math.sqrt(layer.of / layer.count);
    if (model?.count) this.add("model", pointsOf(model, centre, 1.45 * voxel * thinned(model), 1.6));
    if (raw?.count) this.add("raw", pointsOf(raw, centre, 0.6 * spacing * thinned(raw), 1.6), false);
  }

  // The lines of a program, torch and arm. The clouds stay as they are on the graphics card.
  addProgram() {
    this.addSeams();
    this.addUnwelded();
    this.addFrames();
    this.addWay();
    this.addTorch();
    this.addArm();
  }

  // Those of another search; whoever looks stays where he is.
  replaceClouds(layers) {
    for (const name of ["model", "raw", "cameras"]) this.drop(name);
    shared.full.value = content.intensity_full;
    shared.gate.value = content.histograms.intensity_gate ?? 0.1;
    this.addClouds(layers);
    this.addCameras();
  }

  // What is drawn of a program anew, shown or hidden as it was.
  renew() {
    const hidden = ["hidden", "seams", "unwelded", "frames", "way", "torch", "arm", "chosen"].filter((name) => this.drop(name) === false);
    this.addProgram();
    for (const name of hidden) if (this.groups[name]) this.groups[name].visible = false;
    this.redraw();
  }

  // Takes something out of the picture and off the graphics card; whether it was shown, undefined if it was not there.
  drop(name) {
    const object = this.groups[name];
    if (!object) return undefined;
    object.removeFromParent();
    object.traverse(({ geometry, material }) => {
      geometry?.dispose();
      material?.dispose();
    });
    delete this.groups[name];
    return object.visible;
  }

  addSeams() {
    const [pairs, colours] = [[], []];
    for (const seam of seams) {
      const own = pairsOf(seam.line_mm.map((p) => local(p).toArray()), seam.closed);
      const colour = new THREE.Color(seam.selected ? seam.colour : "#8b98a8");
      pairs.push(...own);
      colours.push(...repeat(colour, own));
    }
    if (!pairs.length) return;
    // Hidden stretches show faintly.
    if (ORDERED) this.add("hidden", wide(pairs, colours, 3, { depthTest: false, depthWrite: false, transparent: true, opacity: 0.35 }));
    this.add("seams", wide(pairs, colours, ORDERED ? 4.5 : 1, { transparent: true, ...ABOVE })).renderOrder = 2;
  }

  // Inside corners that are no seams.
  addUnwelded() {
    const pairs = content.summary.unwelded.flatMap(({ line_mm }) => pairsOf(line_mm.map((p) => local(p).toArray())));
    if (pairs.length) this.add("unwelded", wide(pairs, null, 1.8, { color: "#b36b00", transparent: true, opacity: 0.8, ...ABOVE })).renderOrder = 1;
  }

  // o red, m green, n blue, at most 60 a seam.
  addFrames() {
    const [pairs, colours] = [[], []];
    const axes = [["#ff5a4d", [1, 0, 0], 0.5], ["#35c26b", [0, 1, 0], 0.7], ["#4d8dff", [0, 0, 1], 1]];
    const length = Math.max(radius * 0.11, 5);
    for (const weld of welds) {
      const every = Math.max(1, Math.ceil((weld.end - weld.start) / 60));
      for (let i = weld.start; i <= weld.end; i += every) {
        const { position_mm, rotation } = waypoints[i];
        const at = position_mm.clone().sub(centre);
        for (const [css, axis, share] of axes) {
          const end = new THREE.Vector3(...axis).applyQuaternion(rotation).multiplyScalar(length * share).add(at);
          const pair = [...at.toArray(), ...end.toArray()];
          pairs.push(...pair);
          colours.push(...repeat(new THREE.Color(css), pair));
        }
      }
    }
    if (pairs.length) this.add("frames", wide(pairs, colours, 1.4)).renderOrder = 1;
  }

  // Approach, retract and air moves.
  addWay() {
    const pairs = [];
    for (let i = 0; i + 1 < waypoints.length; i++) {
      if (burns(i)) continue;
      pairs.push(...waypoints[i].position_mm.clone().sub(centre).toArray(), ...waypoints[i + 1].position_mm.clone().sub(centre).toArray());
    }
    if (pairs.length) this.add("way", wide(pairs, null, 1.6, { color: "#9aa7b8", dashed: true, dashSize: 4, gapSize: 3 }));
    this.groups.way?.computeLineDistances();
  }

  addCameras() {
    const [pairs, colours] = [[], []];
    content.cameras_mm.forEach((camera, k) => {
      const tip = local(camera);
      const ahead = tip.clone().negate().normalize();
      const side = ahead.clone().cross(up);
      if (side.lengthSq() < 1e-6) side.set(1, 0, 0).cross(ahead);
      side.normalize();
      const above = side.clone().cross(ahead);
      const size = radius * 0.12;
      const corner = (a, b) => tip.clone().addScaledVector(ahead, size).addScaledVector(side, 0.5 * a * size).addScaledVector(above, 0.38 * b * size).toArray();
      const corners = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
      const own = [...pairsOf(corners, true), ...corners.flatMap((c) => [...tip.toArray(), ...c])];
      pairs.push(...own);
      colours.push(...repeat(new THREE.Color(viewColour(k)), own));
    });
    if (pairs.length) this.add("cameras", wide(pairs, colours, 1.8), false);
  }

  addTruth() {
    const pairs = (deviation?.lines ?? []).flatMap((line) => pairsOf(line.line_mm.map((p) => local(p).toArray()), line.closed));
    if (pairs.length) this.add("truth", wide(pairs, null, 1.6, { color: "#ffffff", depthTest: false, transparent: true })).renderOrder = 3;
  }

  addTorch() {
    this.arc = null;
    if (!waypoints.length) return;
    const torch = this.add("torch", new THREE.Group());
    const body = torchBody();
    body.renderOrder = 4;
    this.arc = new THREE.Mesh(new THREE.SphereGeometry(1, 16, 12), new THREE.MeshBasicMaterial({ color: "#ff9a1f", depthTest: false, transparent: true, opacity: 0.9 }));
    this.arc.renderOrder = 5;
    torch.add(body, this.arc);
  }

  addArm() {
    this.arm = null;
    if (!waypoints.length || !content.arm) return;
    this.arm = new Arm(content.arm);
    this.arm.position.sub(centre);
    this.add("arm", new THREE.Group()).add(this.arm);
  }

  moveTorch({ position_mm, rotation, arc, joints_rad, touching }) {
    const torch = this.groups.torch;
    if (!torch) return;
    this.arm?.stand(joints_rad, touching);
    torch.position.copy(position_mm).sub(centre);
    torch.quaternion.copy(rotation);
    this.arc.visible = arc;
    this.redraw();
  }

  highlight(seam) {
    this.drop("chosen");
    if (seam && ORDERED) {
      const pairs = pairsOf(seam.line_mm.map((p) => local(p).toArray()), seam.closed);
      const chosen = wide(pairs, null, 9, { color: "#ffffff", transparent: true, opacity: 0.85, depthWrite: false, ...ABOVE });
      this.add("chosen", chosen).renderOrder = 1;
    }
    this.redraw();
  }

  // Boxes, by their least and greatest corner, and squares that stand for all beyond a plane, by a place on it and its normal;
  // or of the given size about that place; all are seen through: [{ isPlane, mm: [[x, y, z], [x, y, z]], size_mm, css }].
  solids(list) {
    this.drop("solids");
    const group = new THREE.Group();
    const [pairs, colours] = [[], []];
    for (const { isPlane, mm, size_mm, css } of list) {
      const geometry = isPlane ? planeGeometry(mm, size_mm) : boxGeometry(mm);
      const face = new THREE.MeshBasicMaterial({ color: css, transparent: true, opacity: 0.22, depthWrite: false, side: THREE.DoubleSide });
      group.add(new THREE.Mesh(geometry, face));
      const edges = new THREE.EdgesGeometry(geometry);
      pairs.push(...edges.attributes.position.array);
      colours.push(...repeat(new THREE.Color(css), edges.attributes.position.array));
      edges.dispose();
    }
    if (pairs.length) group.add(wide(pairs, colours, 2));
    if (pairs.length) this.add("solids", group);
    this.redraw();
  }

  show(name, shown) {
    if (this.groups[name]) this.groups[name].visible = shown;
    this.redraw();
  }

  filterScale(moved_mm) {
    shared.moved_mm.value = moved_mm;
  }

  // Where a seam's label stands: off its middle, along the torch, base frame.
  anchor(seam) {
    const weld = welds.find((w) => w.seam === seam.id);
    const middle = new THREE.Vector3(...seam.line_mm[seam.line_mm.length >> 1]);
    const away = weld ? new THREE.Vector3(0, 0, 1).applyQuaternion(waypoints[(weld.start + weld.end) >> 1].rotation) : up.clone();
    return middle.addScaledVector(away, Math.max(0.14 * radius, 6));
  }

  // Denoised, before the filter, or raw.
  cloud(which) {
    this.show("model", which !== "raw");
    this.show("raw", which === "raw");
    shared.unfiltered.value = which === "unfiltered" ? 1 : 0;
  }

  colouring(k) {
    shared.colouring.value = k;
    this.redraw();
  }

  // The whole work is looked at, a seam alone where `about` is given: as near as the window lets it be seen whole.
  look(from, about) {
    const eye = new THREE.Vector3(...content.eye);
    const level = eye.clone().addScaledVector(up, -eye.dot(up)).normalize();
    const directions = { home: eye, top: up.clone().addScaledVector(level, 0.001), front: level.addScaledVector(up, 0.04), side: level.clone().cross(up).addScaledVector(up, 0.04) };
    const places = about ? about.line_mm.map(local) : content.outline_mm.map(local);
    const toward = directions[from].normalize();
    const { middle, away } = fitted(places, toward, about ? 15 : 8, this.camera.aspect);
    this.fits = about ? null : from;
    this.controls.target.copy(middle);
    this.camera.position.copy(toward).multiplyScalar(away).add(middle);
    this.controls.update();
    this.redraw();
  }

  // By the keyboard: turn about the target, radians, or come nearer.
  turn(about, above) {
    this.fits = null;
    const offset = this.camera.position.clone().sub(this.controls.target);
    const side = up.clone().cross(offset).normalize();
    const angle = offset.angleTo(up);
    offset.applyAxisAngle(up, about).applyAxisAngle(side, THREE.MathUtils.clamp(above, 0.02 - angle, Math.PI - 0.02 - angle));
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.redraw();
  }

  nearer(factor) {
    this.fits = null;
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
    this.redraw();
  }

  // Place on the canvas, px; z beyond 1 is behind the eye.
  project(p_mm) {
    const v = p_mm.clone().sub(centre).project(this.camera);
    return { x: (0.5 + 0.5 * v.x) * this.width, y: (0.5 - 0.5 * v.y) * this.height, z: v.z };
  }

  // The seam within a few px of a place on the canvas.
  seamAt(x, y) {
    let best = { seam: null, px: 14 };
    for (const seam of seams) {
      const places = seam.line_mm.map((p) => this.project(new THREE.Vector3(...p)));
      for (let i = 0; i + 1 < places.length + (seam.closed ? 1 : 0); i++) {
        const [a, b] = [places[i], places[(i + 1) % places.length]];
        if (a.z > 1 || b.z > 1) continue;
        const [dx, dy] = [b.x - a.x, b.y - a.y];
        const t = THREE.MathUtils.clamp(((x - a.x) * dx + (y - a.y) * dy) / (dx * dx + dy * dy || 1), 0, 1);
        const px = Math.hypot(x - a.x - t * dx, y - a.y - t * dy);
        if (px < best.px) best = { seam, px };
      }
    }
    return best.seam;
  }

  pxPerMm() {
    const distance = this.camera.position.distanceTo(this.controls.target);
    return this.height / (2 * Math.tan((FOV * Math.PI) / 360) * distance);
  }

  // Where the axes of the base frame point on the screen.
  compass() {
    const turn = this.camera.quaternion.clone().invert();
    return [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => new THREE.Vector3(...axis).applyQuaternion(turn));
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    Object.assign(this, { width, height });
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    shared.px_at_1mm.value = (ratio * height) / (2 * Math.tan((FOV * Math.PI) / 360));
    if (this.fits) this.look(this.fits);
    this.redraw();
  }

  redraw() {
    this.wanted ??= requestAnimationFrame(() => {
      this.wanted = undefined;
      this.draw();
    });
  }

  draw() {
    const begin = performance.now();
    if (this.arc?.visible) this.arc.scale.setScalar(4.5 / this.pxPerMm());
    this.renderer.render(this.scene, this.camera);
    this.onFrame(this);
    const { calls, points } = this.renderer.info.render;
    Object.assign(this.stats, { frames: this.stats.frames + 1, script_ms: performance.now() - begin, drawCalls: calls, points });
  }
}
