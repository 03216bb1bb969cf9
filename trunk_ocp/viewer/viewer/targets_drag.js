// Dragging targets: handles of the plan (live_payload.py) move parallel to the screen.

/* global THREE */
import { bridge } from "./bridge.js";
import { isCurrent } from "./data.js";

const NEAR = 13; // px, from a target

/** Lets the pointer take handles of the first plan of a page (`trunkPage` of main.js). */
export class TargetDrag {
  constructor(canvas, page) {
    Object.assign(this, { canvas, page });
    this.held = null; // the handle, where it was taken, and where it is now
    // On the parent, and first: what a handle takes, the camera does not get.
    const outer = canvas.parentElement;
    const take = (event) => this.take(event);
    outer.addEventListener("pointerdown", take, { capture: true });
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.drop(event));
    canvas.addEventListener("pointercancel", (event) => this.drop(event));
  }

  take(event) {
    const handle = event.target === this.canvas && event.button === 0 && this.handleAt(event);
    if (!handle) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    this.canvas.setPointerCapture(event.pointerId);
    this.page.seek(handle.to); // where shapes are those of a time step
    const ray = this.rayAt(event);
    const depth = depthOf(ray, handle.position, this.normal());
    const grip = pointOn(ray, depth).map((x, i) => handle.position[i] - x);
    this.held = { handle, grip, position: handle.position, pointer: event.pointerId };
  }

  move(event) {
    if (!this.held) {
      this.canvas.style.cursor = event.buttons || !this.handleAt(event) ? "" : "move";
      return;
    }
    if (event.pointerId !== this.held.pointer) return;
    const ray = this.rayAt(event);
    const depth = depthOf(ray, this.held.handle.position, this.normal());
    this.held.position = pointOn(ray, depth).map((x, i) => x + this.held.grip[i]);
    this.tell(event, false);
  }

  drop(event) {
    if (!this.held || event.pointerId !== this.held.pointer) return;
    this.tell(event, true);
    this.held = null;
  }

  tell(event, done) {
    const { handle, position } = this.held;
    const at = event.timeStamp;
    bridge.emit("drag", { what: "target", name: handle.name, position, done, at });
  }

  /** The handle under a pointer: of this instant before others, targets before the log. */
  handleAt(event) {
    const { stage } = this.page;
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - box.x, event.clientY - box.y];
    const found = (this.page.plans[0].handles ?? []).map((handle) => {
      const [u, v] = stage.pointAt(0, handle.position);
      const size = handle.radius ? this.pixels(handle) : 0;
      const off = Math.hypot(u - x, v - y) - size;
      const late = isCurrent(handle, this.page.clock.time) ? 0 : 1;
      return { handle, off, rank: 2 * late + (size ? 1 : 0) };
    });
    const near = found.filter(({ off }) => off < NEAR);
    near.sort((a, b) => a.rank - b.rank || a.off - b.off);
    return near[0]?.handle ?? null;
  }

  /** Radius of a handle on the screen in px. */
  pixels({ position, radius }) {
    const right = toModel(new THREE.Vector3(1, 0, 0).applyQuaternion(this.page.stage.camera.quaternion));
    const rim = position.map((x, i) => x + radius * right[i]);
    const [a, b] = [position, rim].map((point) => this.page.stage.pointAt(0, point));
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  }

  /** The ray under a pointer, in the model's axes. */
  rayAt(event) {
    const { stage } = this.page;
    const box = this.canvas.getBoundingClientRect();
    const { ray } = stage.rayIn(stage.views[0], event.clientX - box.x, event.clientY - box.y);
    return { origin: toModel(ray.origin), direction: toModel(ray.direction) };
  }

  /** The direction in which the camera looks, in the model's axes. */
  normal() {
    return toModel(new THREE.Vector3(0, 0, -1).applyQuaternion(this.page.stage.camera.quaternion));
  }
}

/** From the scene's axes to the model's; see `inScene`. */
function toModel({ x, y, z }) {
  return [x, z, -y];
}

/** How far along a ray the plane through a point is. */
function depthOf({ origin, direction }, point, normal) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  return dot(point.map((x, i) => x - origin[i]), normal) / dot(direction, normal);
}

function pointOn({ origin, direction }, depth) {
  return origin.map((x, i) => x + depth * direction[i]);
}
