// The canvas: one view for each plan, all with the same camera; orbit, zoom and picking.

/* global THREE */
import { PlanScene } from "./scene.js";
import { boxAround, inScene, nearestPlace, seenFrom, sweptPoints } from "./framing.js";

const FIELD_OF_VIEW = 32; // degrees, vertical
const DIRECTION = { azimuth: 0.56, elevation: 0.24 }; // of the camera at the start, rad
const CLICK_DISTANCE = 5; // px that a pointer may move in a click
const BACKGROUND = 0xf6f5f2;
const SLOW = { least: 22, most: 250, frames: 3 }; // ms between frames in motion that are too slow
const COARSE = 0.6; // resolution of a slow browser's frames while something moves
const STILL_AFTER = 200; // ms
const INSETS = { left: 12, right: 12, top: 50, bottom: 20 }; // px of a view that stay free

export class Stage {
  /** A click calls `onPick(name or null)`, a change of the view `onChange()`. */
  constructor(canvas, plans, onPick, onChange) {
    this.canvas = canvas;
    this.software = drawsInSoftware();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.software });
    this.renderer.setClearColor(BACKGROUND);
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 1, 2);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", onChange);
    this.onPick = onPick;
    this.onChange = onChange;
    this.coarse = false;
    this.setPlans(plans);
    this.listen();
  }

  /** Draw in full resolution, or coarsely: fewer pixels and fewer triangles. */
  sharpen(coarse) {
    this.coarse = coarse;
    const full = this.software ? 1 : Math.min(devicePixelRatio, 2);
    this.renderer.setPixelRatio(coarse ? COARSE : full);
    for (const scene of this.scenes) scene.coarsen(coarse);
  }

  /** Draw coarsely as soon as frames come too slowly, and sharply again when nothing moves. */
  watchPace() {
    const now = performance.now();
    const gap = now - (this.drawn ?? 0);
    this.drawn = now;
    this.slow = gap > SLOW.least && gap < SLOW.most ? (this.slow ?? 0) + 1 : 0;
    if (this.slow === SLOW.frames && !this.coarse) this.sharpen(true);
    if (!this.coarse) return;
    clearTimeout(this.still);
    this.still = setTimeout(() => {
      this.sharpen(false);
      this.onChange();
    }, STILL_AFTER);
  }

  /** Show plans; the camera stays if the trunks are those of before. */
  setPlans(plans) {
    const same = this.scenes?.length === plans.length
      && plans.every((plan, i) => plan.trunk === this.scenes[i].plan.trunk);
    if (same) {
      this.scenes.forEach((scene, i) => scene.replace(plans[i]));
    } else {
      this.scenes = plans.map((plan) => new PlanScene(plan));
    }
    this.points = null; // those of these plans, when they are needed
    if (same) return;
    const { center, size } = boxAround(this.swept()); // size: about 1.3 m for an elephant
    this.center = center;
    [this.camera.near, this.camera.far] = [0.04 * size, 40 * size];
    [this.nearest, this.farthest] = [0.2 * size, 16 * size];
    this.fitted = null;
    this.resize();
    this.reset();
  }

  /** Points on all that is shown at any time. */
  swept() {
    this.points ??= sweptPoints(this.scenes.map(({ plan }) => plan));
    return this.points;
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
    this.renderer.setSize(width, height, false);
    this.sharpen(this.coarse);
    const moved = this.fitted && this.touched();
    this.arrange(width, height);
    if (this.fitted && !moved) this.reset();
    this.onChange();
  }

  /** Put views side by side or one above the other, whichever shows the motion larger. */
  arrange(width, height) {
    const arrangements = [true, false].map((beside) => views(this.scenes.length, width, height, beside));
    const turn = this.lookAlong(DIRECTION);
    const points = seenFrom(this.swept(), turn);
    const distances = arrangements.map(([view]) => nearestPlace(points, slopes(view)).z);
    this.views = arrangements[distances[0] <= distances[1] ? 0 : 1];
  }

  /** Whether the user has moved the camera since `reset`. */
  touched() {
    return this.camera.position.distanceTo(this.fitted) > 1e-6 * this.nearest;
  }

  /** The rotation (a quaternion) of a camera that looks from a direction at the middle. */
  lookAlong(from) {
    const eye = new THREE.PerspectiveCamera();
    eye.position.copy(direction(from));
    eye.lookAt(0, 0, 0);
    return eye.quaternion;
  }

  /** Move the camera so that the whole motion fills the view. */
  reset() {
    if (!this.views) return;
    const turn = this.lookAlong(DIRECTION);
    const place = nearestPlace(seenFrom(this.swept(), turn), slopes(this.views[0]));
    const depth = this.center.clone().applyQuaternion(turn.clone().invert()).z;
    this.controls.target.set(place.x, place.y, depth).applyQuaternion(turn);
    this.camera.position.copy(place).applyQuaternion(turn);
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
    if (!this.views) return;
    this.watchPace();
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
    const at = this.rayAt(event);
    this.onPick(at && this.scenes[at.number].pick(at.raycaster));
  }

  /** The view (its number) under a pointer and the ray into it, or null. */
  rayAt({ clientX, clientY }) {
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [clientX - box.x, clientY - box.y];
    const inside = (v) => x >= v.x && x < v.x + v.width && y >= v.y && y < v.y + v.height;
    const number = this.views.findIndex(inside);
    return number < 0 ? null : { number, raycaster: this.rayIn(this.views[number], x, y) };
  }

  /** The ray through a point of the canvas, in px, as if it was in a view. */
  rayIn(view, x, y) {
    aim(this.camera, view);
    const raycaster = new THREE.Raycaster();
    const point = new THREE.Vector2((2 * (x - view.x)) / view.width - 1, 1 - (2 * (y - view.y)) / view.height);
    raycaster.setFromCamera(point, this.camera);
    return raycaster;
  }

  /** Where a point of the model, in m, is on the canvas, in px. */
  pointAt(number, point) {
    const view = this.views[number];
    aim(this.camera, view);
    const at = inScene(...point).project(this.camera);
    return [view.x + ((at.x + 1) / 2) * view.width, view.y + ((1 - at.y) / 2) * view.height];
  }
}

/** Whether this browser has WebGL. */
export function hasWebGL() {
  return Boolean(context());
}

/** Whether WebGL runs in software, where smooth edges would halve the frame rate. */
function drawsInSoftware() {
  const gl = context();
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

function context() {
  return document.createElement("canvas").getContext("webgl2");
}

function aim(camera, view) {
  camera.aspect = view.width / view.height;
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
}

function views(count, width, height, beside) {
  const [w, h] = beside ? [width / count, height] : [width, height / count];
  return Array.from({ length: count }, (_, i) => ({
    x: beside ? i * w : 0,
    y: beside ? 0 : i * h,
    width: w,
    height: h,
  }));
}

/** Tangents of the angles from the line of sight to the edges of a view's free part. */
function slopes({ width, height }) {
  const up = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
  const across = (up * width) / height;
  const free = (inset, size) => Math.max(0.3, 1 - (2 * inset) / size);
  return {
    left: across * free(INSETS.left, width),
    right: across * free(INSETS.right, width),
    up: up * free(INSETS.top, height),
    down: up * free(INSETS.bottom, height),
  };
}

function direction({ azimuth, elevation }) {
  return new THREE.Vector3().setFromSphericalCoords(1, Math.PI / 2 - elevation, azimuth);
}
