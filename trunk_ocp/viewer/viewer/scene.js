// One plan as a three.js scene: muscles, the tissue inside, head, targets, log or fruit.

/* global THREE */
import { circle, makeSections, makeTube, writeSections, writeTube } from "./geometry.js";
import { activationColor } from "./colors.js";
import { instantAt, mixed } from "./data.js";

const GHOST_OPACITY = 0.13; // of the other muscles while one is selected
const COLORS = { core: 0xcfc6bd, skin: 0x8f8780, log: 0x8a6540 };
// Sizes are fractions of the trunk's length.
const TARGET = {
  now: { color: 0x111111, radius: 0.01 },
  other: { color: 0x8d8d8d, radius: 0.0065 },
};
const ARROW = { color: 0xcc0055, length: 0.1, radius: 0.01 };

/** The scene of a plan; `show(time)` moves it, `dress(look)` colors and hides. */
export class PlanScene {
  constructor(plan) {
    this.plan = plan;
    this.sections = makeSections(plan);
    this.scene = new THREE.Scene();
    this.model = new THREE.Group();
    this.model.rotation.x = Math.PI / 2; // +Z of the model points down
    this.scene.add(this.model, ...lights());
    this.muscles = plan.trunk.muscles.map((muscle) => this.muscleBody(muscle));
    this.cores = coreTubes(plan.trunk).map((tube) => this.body(tube, solid(COLORS.core)));
    this.skin = this.body(skinTube(plan.trunk), skinMaterial());
    this.objects = plan.objects.map(objectMesh);
    this.targets = targetMesh(plan.targets);
    this.arrows = arrowMesh(plan.arrows);
    this.solids = plan.solids.map((shape) => solidMesh(shape, plan.pivot));
    this.head = headGroup(plan.pivot, this.solids);
    const still = this.solids.filter((mesh) => !mesh.userData.turns);
    this.model.add(this.head, ...still, ...this.objects, this.targets, this.arrows);
  }

  muscleBody(muscle) {
    const { outline, hollow, first, last } = muscle;
    const mesh = this.body(makeTube(outline, hollow, first, last), lined());
    mesh.userData.muscle = muscle;
    return mesh;
  }

  body(tube, material) {
    const geometry = new THREE.BufferGeometry();
    for (const name of ["position", "normal"]) {
      const attribute = new THREE.BufferAttribute(new Float32Array(3 * tube.count), 3);
      geometry.setAttribute(name, attribute.setUsage(35048)); // DYNAMIC_DRAW
    }
    geometry.setAttribute("rim", new THREE.BufferAttribute(tube.rim, 1));
    geometry.setIndex(tube.triangles);
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false; // it moves, and its bounds are not updated
    mesh.userData.tube = tube;
    this.model.add(mesh);
    return mesh;
  }

  show(time) {
    const t = Math.min(time, this.plan.duration);
    writeSections(this.sections, this.plan, t);
    for (const mesh of [...this.muscles, ...this.cores, this.skin]) {
      if (mesh.visible) this.move(mesh);
    }
    const instant = instantAt(this.plan, t);
    this.objects.forEach((mesh, i) => {
      placeObject(mesh, this.plan.objects[i].center, instant);
      mesh.visible = (this.look?.parts.objects ?? true) && isThere(this.plan.objects[i], instant);
    });
    for (const mesh of this.solids) {
      const part = mesh.userData.group === "head" ? "head" : "obstacles";
      mesh.visible = (this.look?.parts[part] ?? true) && isThere(mesh.userData, instant);
    }
    markTargets(this.targets, this.plan, t);
    turnArrows(this.arrows, this.plan, t);
    this.turnHead(instant);
    if (this.look) this.color(instant);
  }

  move(mesh) {
    const { position, normal } = mesh.geometry.attributes;
    writeTube(mesh.userData.tube, this.sections, position.array, normal.array);
    position.needsUpdate = true;
    normal.needsUpdate = true;
    mesh.geometry.boundingSphere = null; // computed again when something is picked
  }

  turnHead(instant) {
    const [z, y] = [0, 1].map((i) => mixed(this.plan.head, 2, i, instant));
    this.head.rotation.set(0, y, z, "ZYX"); // about Y first, then Z, as in model/head.py
  }

  dress(look) {
    this.look = look;
    for (const mesh of this.muscles) {
      const { muscle } = mesh.userData;
      mesh.visible = look.shows(muscle);
      fade(mesh.material, look.selected !== null && look.selected !== muscle.name);
    }
    for (const mesh of this.cores) {
      mesh.visible = look.parts.core;
      fade(mesh.material, look.selected !== null);
    }
    this.skin.visible = look.parts.skin;
    this.targets.visible = look.parts.targets;
    this.arrows.visible = look.parts.targets;
    for (const mesh of this.objects) mesh.visible = look.parts.objects;
  }

  color(instant) {
    const { colorBy, colors, largest } = this.look;
    const count = this.muscles.length;
    this.muscles.forEach((mesh, i) => {
      const a = Math.abs(mixed(this.plan.activation, count, i, instant));
      const group = colors.get(mesh.userData.muscle.group);
      mesh.material.color.set(colorBy === "group" ? group : activationColor(a / largest));
    });
  }

  /** Name of the first muscle that a ray hits, or null. */
  pick(raycaster) {
    this.model.updateMatrixWorld();
    const all = [...this.muscles, ...this.cores, ...this.solids];
    const meshes = all.filter((mesh) => mesh.visible);
    const [hit] = raycaster.intersectObjects(meshes, false);
    return hit?.object.userData.muscle?.name ?? null;
  }
}

function lights() {
  const sky = new THREE.HemisphereLight(0xffffff, 0xb5ada4, 2.3);
  const sun = new THREE.DirectionalLight(0xffffff, 1.5);
  sun.position.set(1.5, 3, 4);
  return [sky, sun];
}

function solid(color) {
  return new THREE.MeshLambertMaterial({ color });
}

/** A solid with light edges, so that neighbors of one color can be distinguished. */
function lined() {
  const material = solid(0xffffff);
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace("void main() {", `attribute float rim;
      varying float vRim;
      void main() {
        vRim = rim;`);
    shader.fragmentShader = shader.fragmentShader
      .replace("void main() {", "varying float vRim;\nvoid main() {")
      .replace("#include <color_fragment>", `#include <color_fragment>
        float wide = fwidth(vRim);
        float line = smoothstep(1.0 - 1.2 * wide, 1.0 - 0.4 * wide, vRim);
        diffuseColor.rgb = mix(diffuseColor.rgb, vec3(0.9), 0.45 * line);`);
  };
  return material;
}

function skinMaterial() {
  const color = COLORS.skin;
  const glass = { transparent: true, opacity: 0.35, depthWrite: false };
  return new THREE.MeshLambertMaterial({ color, ...glass });
}

function fade(material, ghost) {
  if (material.transparent === ghost) return;
  material.transparent = ghost;
  material.opacity = ghost ? GHOST_OPACITY : 1;
  material.depthWrite = !ghost;
  material.needsUpdate = true;
}

/** The core that no muscle reaches into, segment by segment; there may be none. */
function coreTubes({ cores }) {
  return cores
    .filter(({ radius }) => radius > 0)
    .map(({ first, last, radius }) => makeTube(circle(0.995 * radius), false, first, last));
}

function skinTube(trunk) {
  return makeTube(circle(1.01 * trunk.radius), false, 0, trunk.taper.length - 1);
}

function objectMesh({ kind, radius, length, color }) {
  // The axis of a three.js cylinder is y, like the log's.
  const geometry =
    kind === "log"
      ? new THREE.CylinderGeometry(radius, radius, length, 40)
      : new THREE.SphereGeometry(radius, 32, 20);
  return new THREE.Mesh(geometry, solid(color ?? COLORS[kind]));
}

function placeObject(mesh, center, instant) {
  mesh.position.set(...[0, 1, 2].map((c) => mixed(center, 3, c, instant)));
}

/** Whether an object exists: a mass that was released is gone. */
function isThere({ shown }, { before, after, weight }) {
  return shown?.[weight < 1 ? before : after] ?? true;
}

/** All targets as one mesh, because a plan may have many. */
function targetMesh(targets) {
  const dot = new THREE.SphereGeometry(1, 10, 6);
  const mesh = new THREE.InstancedMesh(dot, new THREE.MeshBasicMaterial(), targets.length);
  mesh.frustumCulled = false;
  return mesh;
}

/** The current targets are larger and darker. */
function markTargets(mesh, { targets, trunk }, t) {
  const place = new THREE.Matrix4();
  const color = new THREE.Color();
  targets.forEach((target, i) => {
    const mark = TARGET[isCurrent(target, t) ? "now" : "other"];
    const radius = mark.radius * trunk.length;
    place.makeScale(radius, radius, radius).setPosition(...target.position);
    mesh.setMatrixAt(i, place);
    mesh.setColorAt(i, color.set(mark.color));
  });
  if (!targets.length) return;
  mesh.instanceMatrix.needsUpdate = true;
  mesh.instanceColor.needsUpdate = true;
}

function isCurrent({ from, to }, t) {
  return t > from - 1e-6 && t < to + 1e-6;
}

/** All target directions as one mesh of spikes. */
function arrowMesh(arrows) {
  const spike = new THREE.CylinderGeometry(0, 1, 1, 12).translate(0, 0.5, 0);
  const material = new THREE.MeshBasicMaterial({ color: ARROW.color });
  const mesh = new THREE.InstancedMesh(spike, material, arrows.length);
  mesh.frustumCulled = false;
  return mesh;
}

/** Only the current ones are visible. */
function turnArrows(mesh, { arrows, trunk }, t) {
  const place = new THREE.Matrix4();
  const size = new THREE.Vector3();
  arrows.forEach((arrow, i) => {
    const along = new THREE.Vector3(...arrow.direction).normalize();
    const aside = Math.abs(along.x) < 0.9 ? new THREE.Vector3(1, 0, 0) : new THREE.Vector3(0, 1, 0);
    const across = aside.cross(along).normalize();
    const scale = isCurrent(arrow, t) ? trunk.length : 0;
    place.makeBasis(across.clone(), along, across.clone().cross(along));
    size.set(ARROW.radius * scale, ARROW.length * scale, ARROW.radius * scale);
    mesh.setMatrixAt(i, place.scale(size).setPosition(...arrow.position));
  });
  if (arrows.length) mesh.instanceMatrix.needsUpdate = true;
}

/** A part of the head or an obstacle; one that turns with the head is relative to the pivot. */
function solidMesh({ points, normals, triangles, color, group, turns, shown }, pivot) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  geometry.setIndex(triangles);
  if (turns) geometry.translate(...pivot.map((x) => -x));
  const mesh = new THREE.Mesh(geometry, solid(color));
  mesh.userData = { group, turns, shown };
  return mesh;
}

/** What turns with the head about its pivot. */
function headGroup(pivot, solids) {
  const group = new THREE.Group();
  group.position.set(...pivot);
  for (const mesh of solids) if (mesh.userData.turns) group.add(mesh);
  return group;
}
