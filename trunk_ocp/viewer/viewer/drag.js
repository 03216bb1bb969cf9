// Dragging a point of the trunk with a pointer, parallel to the screen.

/* global THREE */
import { bridge } from "./bridge.js";

/**
 * Turns pointers on the canvas into pulls.
 *
 * `grab(number, raycaster)` gives {Z, position} of the trunk's point under a ray, or null;
 * `pull({Z, position, done})` is called while it is dragged. Positions are in m, in model axes.
 */
export class TrunkDrag {
  constructor(stage, { grab, pull }) {
    Object.assign(this, { stage, grab, pull });
    this.held = null;
    // On the parent and in the capture phase, before the camera's controls get the event.
    const parent = stage.canvas.parentElement;
    parent.addEventListener("pointerdown", (event) => this.down(event), { capture: true });
    parent.addEventListener("pointermove", (event) => this.move(event), { capture: true });
    for (const name of ["pointerup", "pointercancel"]) {
      parent.addEventListener(name, (event) => this.up(event), { capture: true });
    }
  }

  down(event) {
    if (this.held) return event.stopImmediatePropagation(); // a second finger
    if (event.target !== this.stage.canvas || !event.isPrimary || event.button !== 0) return;
    const at = this.stage.rayAt(event);
    const point = at && this.grab(at.number, at.raycaster);
    if (!point) return;
    event.stopImmediatePropagation();
    this.stage.canvas.setPointerCapture(event.pointerId);
    const plane = planeThrough(point.position, this.stage.camera);
    const from = this.onPlane(event, at.number, plane);
    this.held = { ...point, number: at.number, plane, from, pointer: event.pointerId, moved: false };
  }

  move(event) {
    if (this.held?.pointer !== event.pointerId) return;
    event.stopPropagation();
    this.held.moved = true;
    this.tell(event, false);
  }

  up(event) {
    const { held } = this;
    if (held?.pointer !== event.pointerId) return;
    event.stopPropagation();
    if (held.moved) this.tell(event, true);
    else this.stage.click(event);
    this.held = null;
  }

  tell(event, done) {
    const { number, plane, from, position, Z } = this.held;
    const now = this.onPlane(event, number, plane);
    if (now) this.held.place = position.map((x, c) => x + now[c] - from[c]);
    const place = this.held.place ?? position;
    this.pull({ Z, position: place, done });
    bridge.emit("drag", { what: "trunk", name: `Z = ${Z.toFixed(3)}`, position: place, done });
  }

  /** Where the ray under a pointer meets a plane, in model axes, or null. */
  onPlane({ clientX, clientY }, number, { normal, distance }) {
    const box = this.stage.canvas.getBoundingClientRect();
    const { ray } = this.stage.rayIn(this.stage.views[number], clientX - box.x, clientY - box.y);
    const along = (distance - normal.dot(ray.origin)) / normal.dot(ray.direction);
    if (!(along > 0)) return null;
    const { x, y, z } = ray.origin.clone().addScaledVector(ray.direction, along);
    return [x, z, -y];
  }
}

/** The plane through a point of the model that faces the camera. */
function planeThrough([x, y, z], camera) {
  const normal = camera.getWorldDirection(new THREE.Vector3());
  return { normal, distance: normal.dot(new THREE.Vector3(x, -z, y)) };
}
