// Dragging with a pointer: a point of the trunk while the user tries, or a target that someone
// outside plans for.

/* global THREE */
import { bridge } from "./bridge.js";

const TARGET_DISTANCE = 16; // px from a target's dot

/**
 * Turns pointers on the canvas into drags.
 *
 * `grabTrunk(number, raycaster)` gives {Z, position} of the trunk's point under a ray, or null;
 * `pull({Z, position, done})` is called while it is dragged. Positions are in m, in model axes.
 */
export class Drag {
  constructor(stage, { grabTrunk, pull }) {
    this.stage = stage;
    this.grabTrunk = grabTrunk;
    this.pull = pull;
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
    if (this.held) return event.stopPropagation(); // a second finger
    if (event.target !== this.stage.canvas || !event.isPrimary || event.button !== 0) return;
    const at = this.stage.rayAt(event);
    const grabbed = at && (this.grab(at) ?? this.grabTarget(at.number, event));
    if (!grabbed) return;
    event.stopPropagation();
    this.stage.canvas.setPointerCapture(event.pointerId);
    const depth = depthPlane(at.raycaster, grabbed.position);
    const from = this.onPlane(event, at.number, depth);
    this.held = { ...grabbed, number: at.number, depth, from, pointer: event.pointerId, moved: false };
  }

  grab({ number, raycaster }) {
    const point = this.grabTrunk(number, raycaster);
    return point && { what: "trunk", name: `Z = ${point.Z.toFixed(3)}`, ...point };
  }

  /** The target shown nearest to a pointer, if someone plans for targets. */
  grabTarget(number, event) {
    if (!bridge.heard("drag")) return null;
    const box = this.stage.canvas.getBoundingClientRect();
    const scene = this.stage.scenes[number];
    let best = { distance: TARGET_DISTANCE, target: null };
    for (const target of scene.symbols.current()) {
      const [x, y] = this.stage.pointAt(number, target.position);
      const distance = Math.hypot(event.clientX - box.x - x, event.clientY - box.y - y);
      if (distance < best.distance) best = { distance, target };
    }
    const { target } = best;
    return target && { what: "target", name: target.name, Z: target.Z, position: target.position };
  }

  move(event) {
    const { held } = this;
    if (held?.pointer !== event.pointerId) return;
    event.stopPropagation();
    held.moved = true;
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
    const { number, depth, from, position, what, name, Z } = this.held;
    const now = this.onPlane(event, number, depth);
    if (now) this.held.last = position.map((x, c) => x + now[c] - from[c]);
    const place = this.held.last ?? position;
    if (what === "trunk") this.pull({ Z, position: place, done });
    bridge.emit("drag", { what, name, position: place, done });
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
function depthPlane({ camera }, [x, y, z]) {
  const normal = camera.getWorldDirection(new THREE.Vector3());
  return { normal, distance: normal.dot(new THREE.Vector3(x, -z, y)) };
}
