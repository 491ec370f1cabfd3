// Torch and arm as bodies: the torch at a usual size, the arm by the capsules that were held against the scan.

import * as THREE from "three";
import { mergeGeometries } from "three/examples/jsm/utils/BufferGeometryUtils.js";

// Wire 15 mm, nozzle of 22 mm, body: a common MIG torch, tip of the wire at the origin, axis along z.
const TORCH_MM = [[0, 0], [0.6, 0], [0.6, 15], [8, 15], [11, 22], [11, 70], [15, 76], [15, 130], [0, 130]];
const TORCH_LENGTH_MM = 130;
// Of what holds the torch, as a share of the flange's radius.
const BRACKET_SHARE = 0.35;
// The index of the torch among the links.
const TORCH = 7;

// Metal, lit from the eye.
function metal(dark, light, opacity = 1) {
  const material = new THREE.MeshNormalMaterial({ transparent: opacity < 1, opacity, side: THREE.DoubleSide });
  const rgb = (css) => new THREE.Color().setStyle(css, THREE.LinearSRGBColorSpace).toArray().map((v) => v.toFixed(3)).join(", ");
  material.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace(
      "gl_FragColor = vec4( normalize( normal ) * 0.5 + 0.5, diffuseColor.a );",
      `float lit = abs( normalize( normal ).z ); gl_FragColor = vec4( mix( vec3( ${rgb(dark)} ), vec3( ${rgb(light)} ), lit * lit ), diffuseColor.a );`);
  };
  // Materials of the same class share a program unless this tells them apart.
  material.customProgramCacheKey = () => dark + light;
  return material;
}

export function torchBody() {
  const shape = new THREE.LatheGeometry(TORCH_MM.map(([r, z]) => new THREE.Vector2(r, z)), 28).rotateX(Math.PI / 2);
  return new THREE.Mesh(shape, metal("#2b3645", "#c7d4e6", 0.9));
}

// Round bars, one mesh; nothing of none. A bar is its two ends and its radius.
function bars(list, material) {
  const bar = ([ax, ay, az, bx, by, bz, radius]) => {
    const [from, to] = [new THREE.Vector3(ax, ay, az), new THREE.Vector3(bx, by, bz)];
    const along = to.clone().sub(from);
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.clone().normalize());
    return new THREE.CapsuleGeometry(radius, along.length(), 8, 24).applyQuaternion(turn).translate(...from.add(to).multiplyScalar(0.5));
  };
  return list.length ? new THREE.Mesh(mergeGeometries(list.map(bar)), material) : new THREE.Group();
}

// An arm of the page's content: a chain of groups, each of which turns about the axis of its joint, all in the robot's frame.
export class Arm extends THREE.Group {
  constructor({ base_from_robot, axes, links_mm, robot_from_tcp }) {
    super();
    const placed = (object, [x, y, z, qw, qx, qy, qz]) => {
      object.position.set(x, y, z);
      object.quaternion.set(qx, qy, qz, qw).normalize();
      return object;
    };
    placed(this, base_from_robot);
    this.free = metal("#243a5c", "#8fb0dd");
    this.inside = metal("#6e1410", "#ff7a6b");
    this.links = links_mm.map((link) => bars(link, this.free));
    this.add(this.links[0]);
    this.joints = axes.map(([x, y, z, ...direction]) => ({ at: new THREE.Vector3(x, y, z), about: new THREE.Vector3(...direction), group: new THREE.Group() }));
    let carrier = this;
    this.joints.forEach(({ group }, k) => {
      carrier.add(group);
      group.add(this.links[k + 1]);
      carrier = group;
    });
    // Where the wire ends, and what holds the torch: from the flange to the torch's other end.
    this.tip = placed(new THREE.Object3D(), robot_from_tcp);
    const behind = new THREE.Vector3(0, 0, -TORCH_LENGTH_MM).applyQuaternion(this.tip.quaternion).add(this.tip.position);
    const flange = links_mm[6].at(-1);
    this.links[TORCH] = bars([[...flange.slice(3, 6), ...behind.toArray(), BRACKET_SHARE * flange[6]]], this.free);
    carrier.add(this.tip, this.links[TORCH]);
  }

  // At these angles, the link that touches something marked; without angles it is not drawn.
  stand(joints_rad, touching) {
    this.visible = Boolean(joints_rad);
    if (!this.visible) return;
    this.links.forEach((link, k) => { link.material = k === touching ? this.inside : this.free; });
    this.joints.forEach(({ at, about, group }, k) => {
      group.quaternion.setFromAxisAngle(about, joints_rad[k]);
      group.position.copy(at).applyQuaternion(group.quaternion).negate().add(at);
    });
  }
}
