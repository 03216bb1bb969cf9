// One plan as a three.js scene: muscles, the tissue inside, head, targets, log or fruit.

/* global THREE */
import { circle, makeSections, makeTube, writeSections, writeTube } from "./geometry.js";
import { activationColor } from "./colors.js";
import { instantAt, mixed, mixedRow } from "./data.js";
import { fade, linedMaterial, skinMaterial, solidMaterial } from "./materials.js";
import { PullLine, Symbols } from "./symbols.js";

const COLORS = { core: 0xcfc6bd, log: 0x8a6540, mass: 0x7a3b69, stale: 0xb9b4ae };
const WATER = 1000; // kg/m^3; a mass at the tip is drawn as a ball of water

/**
 * The scene of a plan; `show(time)` moves it, `dress(look)` colors and hides.
 *
 * While the user tries controls, `tried` has {sections, activation, head, mass, stale, pull}, which
 * are shown instead of the plan's.
 */
export class PlanScene {
  constructor(plan) {
    this.plan = plan;
    this.tried = null;
    this.planned = makeSections(plan.trunk);
    this.sections = this.planned;
    this.scene = new THREE.Scene();
    this.model = new THREE.Group();
    this.model.rotation.x = Math.PI / 2; // +Z of the model points down
    this.scene.add(this.model, ...lights());
    this.muscles = plan.trunk.muscles.map((muscle) => this.muscleBody(muscle));
    this.cores = coreTubes(plan.trunk).map((tube) => this.body(tube, solidMaterial(COLORS.core)));
    this.skin = this.body(skinTube(plan.trunk), skinMaterial());
    this.mass = new THREE.Mesh(new THREE.SphereGeometry(1, 32, 20), solidMaterial(COLORS.mass));
    this.pullLine = new PullLine();
    this.model.add(this.mass, this.pullLine.mesh);
    this.surround();
  }

  /** Show another plan of the same trunk. */
  replace(plan) {
    this.plan = plan;
    this.model.remove(...this.surroundings);
    this.symbols.dispose();
    for (const mesh of [...this.objects, ...this.solids]) {
      mesh.geometry.dispose();
      mesh.material.dispose();
    }
    this.surround();
  }

  surround() {
    const { plan } = this;
    this.objects = plan.objects.map(objectMesh);
    this.symbols = new Symbols(plan);
    this.solids = plan.solids.map((shape) => solidMesh(shape, plan.pivot));
    this.head = headGroup(plan.pivot, this.solids);
    const still = this.solids.filter((mesh) => !mesh.userData.turns);
    this.surroundings = [this.head, ...still, ...this.objects, this.symbols.group];
    this.model.add(...this.surroundings);
  }

  muscleBody(muscle) {
    const { outline, hollow, first, last } = muscle;
    const mesh = this.body(makeTube(outline, hollow, first, last), linedMaterial());
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
    const [sharp, coarse] = [tube.triangles, tube.coarse].map(indexOf);
    geometry.setIndex(sharp);
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false; // it moves, and its bounds are not updated
    mesh.userData = { tube, sharp, coarse };
    this.model.add(mesh);
    return mesh;
  }

  /** Draw tubes with fewer triangles, or with all. */
  coarsen(coarse) {
    for (const { geometry, userData } of [...this.muscles, ...this.cores, this.skin]) {
      geometry.setIndex(coarse ? userData.coarse : userData.sharp);
    }
  }

  show(time) {
    const t = Math.min(time, this.plan.duration);
    const instant = instantAt(this.plan, t);
    this.sections = this.tried?.sections ?? this.planned;
    if (!this.tried) writeSections(this.sections, this.plan, t);
    for (const mesh of [...this.muscles, ...this.cores, this.skin]) {
      if (mesh.visible) this.move(mesh);
    }
    this.showObjects(instant);
    this.showSolids(instant);
    this.symbols.show(t);
    this.pullLine.show(this.tried?.pull, this.sections, this.plan.trunk.tables.Z);
    const [z, y] = this.tried?.head ?? mixedRow(this.plan.head, 2, instant);
    this.head.rotation.set(0, y, z, "ZYX"); // about Y first, then Z, as in model/head.py
    if (this.look) this.color(instant);
  }

  move(mesh) {
    const { position, normal } = mesh.geometry.attributes;
    writeTube(mesh.userData.tube, this.sections, position.array, normal.array);
    position.needsUpdate = true;
    normal.needsUpdate = true;
    mesh.geometry.boundingSphere = null; // computed again when something is picked
  }

  showObjects(instant) {
    const shown = this.look?.parts.objects ?? true;
    this.objects.forEach((mesh, i) => {
      const object = this.plan.objects[i];
      placeObject(mesh, object.center, instant);
      const tried = this.tried && object.kind === "fruit"; // its mass may be another now
      mesh.visible = shown && !tried && isThere(object, instant);
    });
    this.mass.visible = Boolean(this.tried?.mass > 0);
    if (!this.mass.visible) return;
    const { n, position, d3 } = this.sections;
    const radius = Math.cbrt((3 * this.tried.mass) / (4 * Math.PI * WATER));
    const tip = [0, 1, 2].map((c) => position[3 * n - 3 + c] + radius * d3[3 * n - 3 + c]);
    this.mass.position.set(...tip);
    this.mass.scale.setScalar(radius);
  }

  showSolids(instant) {
    for (const mesh of this.solids) {
      const part = mesh.userData.group === "head" ? "head" : "obstacles";
      mesh.visible = (this.look?.parts[part] ?? true) && isThere(mesh.userData, instant);
    }
  }

  dress(look) {
    this.look = look;
    for (const mesh of this.muscles) {
      const { muscle } = mesh.userData;
      const glass = look.parts.glass && muscle.outer ? "glass" : "opaque";
      const other = look.selected !== null && look.selected !== muscle.name;
      mesh.visible = look.shows(muscle);
      mesh.renderOrder = muscle.outer ? 1 : 0; // what is inside is drawn before
      fade(mesh.material, other ? "clear" : look.selected ? "opaque" : glass);
    }
    for (const mesh of this.cores) {
      mesh.visible = look.parts.core;
      fade(mesh.material, look.selected !== null ? "clear" : "opaque");
    }
    this.skin.visible = look.parts.skin;
    this.symbols.group.visible = look.parts.targets;
    for (const mesh of this.objects) mesh.visible = look.parts.objects;
  }

  color(instant) {
    const { colorBy, colors, largest } = this.look;
    const count = this.muscles.length;
    this.muscles.forEach((mesh, i) => {
      const a = this.tried?.activation[i] ?? mixed(this.plan.activation, count, i, instant);
      const group = colors.get(mesh.userData.muscle.group);
      const color = colorBy === "group" ? group : activationColor(Math.abs(a) / largest);
      mesh.material.color.set(this.tried?.stale ? COLORS.stale : color);
    });
  }

  /** Name of the first muscle that a ray hits, or null. */
  pick(raycaster) {
    return this.hit(raycaster, [...this.muscles, ...this.cores, ...this.solids])
      ?.object.userData.muscle?.name ?? null;
  }

  /** What a ray hits first of some meshes, or undefined. */
  hit(raycaster, meshes) {
    this.model.updateMatrixWorld();
    return raycaster.intersectObjects(meshes.filter((mesh) => mesh.visible), false)[0];
  }
}

function indexOf(triangles) {
  return new THREE.BufferAttribute(Uint16Array.from(triangles), 1);
}

function lights() {
  const sky = new THREE.HemisphereLight(0xffffff, 0xb5ada4, 2.3);
  const sun = new THREE.DirectionalLight(0xffffff, 1.5);
  sun.position.set(1.5, 3, 4);
  return [sky, sun];
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
  return new THREE.Mesh(geometry, solidMaterial(color ?? COLORS[kind]));
}

function placeObject(mesh, center, instant) {
  mesh.position.set(...mixedRow(center, 3, instant));
}

/** Whether an object exists: a mass that was released is gone. */
function isThere({ shown }, { before, after, weight }) {
  return shown?.[weight < 1 ? before : after] ?? true;
}

/** A part of the head or an obstacle; one that turns with the head is relative to the pivot. */
function solidMesh({ points, normals, triangles, color, group, turns, shown }, pivot) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(points.slice(), 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  geometry.setIndex(triangles);
  if (turns) geometry.translate(...pivot.map((x) => -x));
  const mesh = new THREE.Mesh(geometry, solidMaterial(color));
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
