// Torch and arm as bodies. Both are drawn at usual sizes: neither is held against the scan here.

import * as THREE from "three";
import { mergeGeometries } from "three/examples/jsm/utils/BufferGeometryUtils.js";

// Wire 15 mm, nozzle of 22 mm, body: a common MIG torch, tip of the wire at the origin, axis along z.
const TORCH_MM = [[0, 0], [0.6, 0], [0.6, 15], [8, 15], [11, 22], [11, 70], [15, 76], [15, 130], [0, 130]];
const TORCH_LENGTH_MM = 130;
// Of what holds the torch, as a share of the wrist's radius.
const BRACKET_SHARE = 0.35;

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

// Round bars along a line, one mesh; nothing of a single place.
function bars(places, radius, material) {
  const bar = (from, to) => {
    const along = to.clone().sub(from);
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.clone().normalize());
    return new THREE.CapsuleGeometry(radius, along.length(), 8, 24).applyQuaternion(turn).translate(...from.clone().add(to).multiplyScalar(0.5));
  };
  const parts = places.slice(1).map((to, k) => bar(places[k], to));
  return parts.length ? new THREE.Mesh(mergeGeometries(parts), material) : new THREE.Group();
}

// An arm of the page's content: a chain of groups, each of which turns about the axis of its joint, all in the robot's frame.
export class Arm extends THREE.Group {
  constructor({ base_from_robot, axes, links_mm, radii_mm, robot_from_tcp }) {
    super();
    const placed = (object, [x, y, z, qw, qx, qy, qz]) => {
      object.position.set(x, y, z);
      object.quaternion.set(qx, qy, qz, qw).normalize();
      return object;
    };
    placed(this, base_from_robot);
    const material = metal("#243a5c", "#8fb0dd");
    const [radius, wrist] = radii_mm;
    const link = (k) => bars(links_mm[k].map((p) => new THREE.Vector3(...p)), k < 4 ? radius : wrist, material);
    this.add(link(0));
    this.joints = axes.map(([x, y, z, ...direction]) => ({ at: new THREE.Vector3(x, y, z), about: new THREE.Vector3(...direction), group: new THREE.Group() }));
    let carrier = this;
    this.joints.forEach(({ group }, k) => {
      carrier.add(group);
      group.add(link(k + 1));
      carrier = group;
    });
    // Where the wire ends, and what holds the torch: from the flange to the torch's other end.
    this.tip = placed(new THREE.Object3D(), robot_from_tcp);
    const behind = new THREE.Vector3(0, 0, -TORCH_LENGTH_MM).applyQuaternion(this.tip.quaternion).add(this.tip.position);
    carrier.add(this.tip, bars([new THREE.Vector3(...links_mm[6].at(-1)), behind], BRACKET_SHARE * wrist, material));
  }

  // At these angles; without them it is not drawn.
  stand(joints_rad) {
    this.visible = Boolean(joints_rad);
    if (!this.visible) return;
    this.joints.forEach(({ at, about, group }, k) => {
      group.quaternion.setFromAxisAngle(about, joints_rad[k]);
      group.position.copy(at).applyQuaternion(group.quaternion).negate().add(at);
    });
  }
}
