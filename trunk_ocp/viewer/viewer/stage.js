// The canvas: one view for each plan, all with the same camera; orbit, zoom and picking.

/* global THREE */
import { PlanScene } from "./scene.js";

const FIELD_OF_VIEW = 32; // degrees, vertical
const DIRECTION = { azimuth: 0.56, elevation: 0.24 }; // of the camera at the start, rad
const CLICK_DISTANCE = 5; // px that a pointer may move in a click
const BACKGROUND = 0xf6f5f2;

export class Stage {
  /** A click calls `onPick(name or null)`, a change of the view `onChange()`. */
  constructor(canvas, plans, onPick, onChange) {
    this.canvas = canvas;
    this.scenes = plans.map((plan) => new PlanScene(plan));
    this.software = drawsInSoftware();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.software });
    this.renderer.setClearColor(BACKGROUND);
    this.bounds = bounds(plans);
    const size = this.bounds.half.length(); // about 1.3 m for an elephant
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.04 * size, 40 * size);
    [this.nearest, this.farthest] = [0.2 * size, 16 * size];
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", onChange);
    this.onPick = onPick;
    this.onChange = onChange;
    this.listen();
    this.resize();
    this.reset();
  }

  listen() {
    let from = null;
    this.canvas.addEventListener("pointerdown", (event) => {
      from = event.isPrimary ? event : null;
    });
    this.canvas.addEventListener("pointerup", (event) => {
      if (from && Math.hypot(event.x - from.x, event.y - from.y) < CLICK_DISTANCE) this.click(event);
      from = null;
    });
    new ResizeObserver(() => this.resize()).observe(this.canvas.parentElement);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.software ? 1 : Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.views = views(this.scenes.length, width, height, this.extent());
    const moved = this.fitted && !this.touched();
    if (moved) this.reset();
    this.onChange();
  }

  /** Whether the user has moved the camera since `reset`. */
  touched() {
    return this.camera.position.distanceTo(this.fitted) > 1e-6 * this.nearest;
  }

  /** Half width, height and depth of the whole motion, from the camera's first direction. */
  extent() {
    const { half } = this.bounds;
    const [cos, sin] = [Math.cos(DIRECTION.azimuth), Math.sin(DIRECTION.azimuth)];
    const [wide, deep] = [half.x * cos + half.z * sin, half.x * sin + half.z * cos];
    return { wide, high: half.y, deep };
  }

  /** Move the camera so that the whole motion is in view. */
  reset() {
    const { width, height } = this.views[0];
    const { center } = this.bounds;
    const { wide, high, deep } = this.extent();
    const slope = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
    const distance = Math.max(high, (wide * height) / width) / slope + 0.45 * deep;
    this.controls.target.copy(center);
    this.camera.position.copy(center).addScaledVector(direction(DIRECTION), 1.04 * distance);
    this.controls.update();
    this.fitted = this.camera.position.clone();
    this.onChange();
  }

  /** Orbit by angles (rad) and zoom, for the keyboard. */
  nudge(across, up, zoom) {
    const arm = this.camera.position.clone().sub(this.controls.target);
    const length = Math.min(Math.max(arm.length() * zoom, this.nearest), this.farthest);
    const azimuth = Math.atan2(arm.x, arm.z) + across;
    const elevation = Math.min(Math.max(Math.asin(arm.y / arm.length()) + up, -1.5), 1.5);
    const toward = direction({ azimuth, elevation });
    this.camera.position.copy(this.controls.target).addScaledVector(toward, length);
    this.controls.update();
  }

  show(time) {
    for (const scene of this.scenes) scene.show(time);
    this.render();
  }

  render() {
    const { renderer, camera, canvas } = this;
    const height = canvas.parentElement.clientHeight;
    renderer.setScissorTest(true);
    this.views.forEach((view, i) => {
      const box = [view.x, height - view.y - view.height, view.width, view.height];
      renderer.setViewport(...box);
      renderer.setScissor(...box);
      aim(camera, view);
      renderer.render(this.scenes[i].scene, camera);
    });
  }

  dress(look) {
    for (const scene of this.scenes) scene.dress(look);
  }

  click(event) {
    const box = this.canvas.getBoundingClientRect();
    this.onPick(this.muscleAt(event.clientX - box.x, event.clientY - box.y));
  }

  /** Name of the muscle at a point of the canvas, or null. */
  muscleAt(x, y) {
    const inside = (v) => x >= v.x && x < v.x + v.width && y >= v.y && y < v.y + v.height;
    const i = this.views.findIndex(inside);
    if (i < 0) return null;
    const view = this.views[i];
    aim(this.camera, view);
    const across = (2 * (x - view.x)) / view.width - 1;
    const up = 1 - (2 * (y - view.y)) / view.height;
    const raycaster = new THREE.Raycaster();
    raycaster.setFromCamera(new THREE.Vector2(across, up), this.camera);
    return this.scenes[i].pick(raycaster);
  }

  /** Where a point of the model, in m, is on the canvas; for tests. */
  pointAt(number, point) {
    const view = this.views[number];
    aim(this.camera, view);
    const at = turned(...point).project(this.camera);
    return [view.x + ((at.x + 1) / 2) * view.width, view.y + ((1 - at.y) / 2) * view.height];
  }
}

/** Whether WebGL runs in software, where smooth edges would halve the frame rate. */
function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return false; // three.js reports it
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

function aim(camera, view) {
  camera.aspect = view.width / view.height;
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
}

/** Views side by side or stacked, whichever shows the motion larger. */
function views(count, width, height, { wide, high }) {
  const size = (w, h) => Math.min(w / wide, h / high);
  const beside = size(width / count, height) >= size(width, height / count);
  const [w, h] = beside ? [width / count, height] : [width, height / count];
  return Array.from({ length: count }, (_, i) => ({
    x: beside ? i * w : 0,
    y: beside ? 0 : i * h,
    width: w,
    height: h,
  }));
}

function turned(x, y, z) {
  return new THREE.Vector3(x, -z, y);
}

function direction({ azimuth, elevation }) {
  return new THREE.Vector3().setFromSphericalCoords(1, Math.PI / 2 - elevation, azimuth);
}

/** Center and half size of the box around the whole motion. */
function bounds(plans) {
  const low = new THREE.Vector3(Infinity, Infinity, Infinity);
  const high = low.clone().negate();
  const add = (x, y, z, margin) => {
    const point = turned(x, y, z);
    low.min(point.clone().addScalar(-margin));
    high.max(point.addScalar(margin));
  };
  const all = (array, margin) => {
    for (let k = 0; k < array.length; k += 3) add(array[k], array[k + 1], array[k + 2], margin);
  };
  for (const { trunk, frames, objects, solids } of plans) {
    all(frames.position, 0.7 * trunk.radius);
    for (const { points, bounded } of solids) if (bounded) all(points, 0);
    for (const { center, radius } of objects) all(center, radius);
  }
  const half = high.clone().sub(low).divideScalar(2);
  return { center: low.add(half), half };
}
