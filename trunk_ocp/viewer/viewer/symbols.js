// Symbols of what a plan is asked: dots for positions, arrows for directions.
//
// Those of the instant shown are drawn over the trunk, because the points they are for are inside
// it. Their size follows the trunk's thickness there, so that they never hide it.

/* global THREE */
import { isCurrent } from "./data.js";

const DOT = { now: 0x111111, other: 0x8d8d8d };
export const ARROW_COLORS = ["#0A7D5A", "#7A4FC0", "#CC0055"]; // of d1, d2, d3
// Sizes are fractions of the trunk's radius there, within fractions of its length.
const DOT_SIZE = { radius: 0.3, least: 0.0055, most: 0.011 };
const ARROW_SIZE = { radius: 2.4, least: 0.07, most: 0.11 };
const SMALLER = 0.5; // dots of other times
const ARROW_THICKNESS = 0.067; // of its length

/** Dots and arrows of a plan; `show(time)` marks what is asked then. */
export class Symbols {
  constructor(plan) {
    this.plan = plan;
    this.group = new THREE.Group();
    this.dots = instances(new THREE.SphereGeometry(1, 12, 8), plan.targets.length, true);
    this.rims = instances(new THREE.SphereGeometry(1.35, 12, 8), plan.targets.length, true);
    this.others = instances(new THREE.SphereGeometry(1, 10, 6), plan.targets.length, false);
    this.arrows = instances(arrowGeometry(), plan.arrows.length, true);
    this.rims.renderOrder = 1; // under the dots
    this.dots.renderOrder = 3;
    this.arrows.renderOrder = 2;
    this.group.add(this.dots, this.rims, this.others, this.arrows);
    paint(this.dots, () => DOT.now);
    paint(this.rims, () => 0xffffff);
    paint(this.others, () => DOT.other);
    paint(this.arrows, (i) => ARROW_COLORS[plan.arrows[i].director]);
  }

  show(time) {
    const { targets, arrows, trunk } = this.plan;
    targets.forEach((target, i) => {
      const size = sizeAt(trunk, target.Z, DOT_SIZE);
      const now = isCurrent(target, time);
      for (const mesh of [this.dots, this.rims]) placeDot(mesh, i, target, now ? size : 0);
      placeDot(this.others, i, target, now ? 0 : SMALLER * size);
    });
    arrows.forEach((arrow, i) => placeArrow(this.arrows, i, arrow, trunk, isCurrent(arrow, time)));
    for (const mesh of this.group.children) mesh.instanceMatrix.needsUpdate = true;
  }

  dispose() {
    for (const mesh of this.group.children) {
      mesh.geometry.dispose();
      mesh.material.dispose();
      mesh.dispose();
    }
  }
}

/** A line from a point of the trunk to where it is pulled, while it is not there. */
export class PullLine {
  constructor() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6), 3));
    this.mesh = new THREE.LineLoop(geometry, new THREE.LineBasicMaterial({ color: 0xb00020, depthTest: false }));
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 4;
    this.mesh.visible = false;
  }

  /** Show a pull {Z, target, reached}, or nothing, on cross-sections at points Z. */
  show(pull, { position }, Z) {
    this.mesh.visible = Boolean(pull && !pull.reached);
    if (!this.mesh.visible) return;
    const j = Z.findIndex((z) => z >= pull.Z - 1e-9);
    this.mesh.geometry.attributes.position.array.set([...position.subarray(3 * j, 3 * j + 3), ...pull.target]);
    this.mesh.geometry.attributes.position.needsUpdate = true;
  }
}

/** All symbols of one kind as one mesh, because a plan may have many. */
function instances(geometry, count, above) {
  const material = new THREE.MeshBasicMaterial({ transparent: above, depthTest: !above });
  const mesh = new THREE.InstancedMesh(geometry, material, count);
  mesh.frustumCulled = false;
  return mesh;
}

function paint(mesh, colorOf) {
  const color = new THREE.Color();
  for (let i = 0; i < mesh.count; i++) mesh.setColorAt(i, color.set(colorOf(i)));
}

function sizeAt({ radius, taper, Z, length }, at, limits) {
  let j = 0;
  while (j < Z.length - 1 && Z[j] < at) j += 1;
  const size = limits.radius * radius * taper[j];
  return Math.min(Math.max(size, limits.least * length), limits.most * length);
}

function placeDot(mesh, i, { position }, size) {
  mesh.setMatrixAt(i, new THREE.Matrix4().makeScale(size, size, size).setPosition(...position));
}

function placeArrow(mesh, i, arrow, trunk, now) {
  const length = now ? sizeAt(trunk, arrow.Z, ARROW_SIZE) : 0;
  const thick = ARROW_THICKNESS * length;
  const along = new THREE.Vector3(...arrow.direction).normalize();
  const aside = Math.abs(along.x) < 0.9 ? new THREE.Vector3(1, 0, 0) : new THREE.Vector3(0, 1, 0);
  const across = aside.cross(along).normalize();
  const place = new THREE.Matrix4();
  place.makeBasis(across.clone(), along, across.clone().cross(along));
  mesh.setMatrixAt(i, place.scale(new THREE.Vector3(thick, length, thick)).setPosition(...arrow.position));
}

/** A shaft with a head, of length and radius 1 along y. */
function arrowGeometry() {
  const head = new THREE.CylinderGeometry(0, 1, 0.36, 12).translate(0, 0.82, 0);
  const shaft = new THREE.CylinderGeometry(0.4, 0.4, 0.66, 8).translate(0, 0.33, 0);
  return joined([shaft, head]);
}

/** Several geometries with an index as one, positions only. */
function joined(parts) {
  const positions = parts.map((part) => part.attributes.position.array);
  const indices = [];
  let start = 0;
  for (const part of parts) {
    for (const index of part.index.array) indices.push(start + index);
    start += part.attributes.position.count;
  }
  const geometry = new THREE.BufferGeometry();
  const all = Float32Array.from(positions.flatMap((array) => [...array]));
  geometry.setAttribute("position", new THREE.BufferAttribute(all, 3));
  geometry.setIndex(indices);
  return geometry;
}
