// The mode in which the user tries muscles, head and loads: its panel, and what a drag does.

/* global THREE */
import { bridge } from "./bridge.js";
import { byId, setText } from "./elements.js";
import { TrunkDrag } from "./drag.js";
import { loadPhysics } from "./physics.js";
import { Sliders } from "./sliders.js";
import { Trial } from "./trial.js";

const PANEL_INTERVAL = 120; // ms

/** `open(plans, time)` starts it, `close()` ends it; `wake()` is called when there is more to draw. */
export class TryIt {
  constructor(stage, look, wake) {
    this.stage = stage;
    this.look = look;
    this.wake = wake;
    this.trial = null;
    this.sliders = new Sliders((edit) => this.edit(edit));
    this.drag = new TrunkDrag(stage, {
      grab: (number, raycaster) => this.grab(number, raycaster),
      pull: (pull) => this.pullTo(pull),
    });
    byId("try-link").addEventListener("change", () => this.build());
    byId("try-reset").addEventListener("click", () => this.reset(this.time));
    byId("try-plan").addEventListener("change", () => this.open(this.plans, this.time));
    for (const input of byId("try-tip").querySelectorAll("input")) {
      input.addEventListener("change", () => this.pullTip());
    }
  }

  get isOpen() {
    return this.trial !== null;
  }

  async open(plans, time) {
    this.physics ??= await loadPhysics(moduleBytes());
    this.close();
    this.plans = plans;
    this.time = time;
    const select = byId("try-plan");
    if (select.options.length !== plans.length) {
      select.replaceChildren(...plans.map(({ label }, i) => new Option(label, i)));
      select.value = plans.length - 1;
    }
    byId("try-which").hidden = plans.length < 2;
    const plan = plans[Number(select.value)];
    this.number = Number(select.value);
    this.trial = new Trial(this.physics.trunk(plan.trunk.tables), plan, time);
    byId("try-link").checked = this.trial.alike;
    byId("try-link-label").hidden = !plan.trunk.muscles.some(({ side }) => side === "L");
    this.build();
    this.changed();
  }

  close() {
    if (this.trial) this.stage.scenes[this.number].tried = null;
    this.trial = null;
    this.pulled = null;
  }

  /** The plan's own controls at an instant in s. */
  reset(time) {
    this.time = time;
    this.pulled = null;
    this.trial.reset(time);
    this.build();
    this.changed();
  }

  build() {
    this.sliders.build(this.trial, byId("try-link").checked, this.look.colors);
  }

  /** Change controls by a function of the trial, and solve. */
  edit(change) {
    this.pulled = null;
    change(this.trial);
    this.trial.solve();
    this.changed();
  }

  /** Show what the trial has now, and say so to the outside. */
  changed() {
    const { trial, time } = this;
    const { sections, activation, head, mass, stale, pull } = trial;
    this.stage.scenes[this.number].tried = { sections, activation, head, mass, stale, pull };
    bridge.emit("controls", { activation: [...activation], head: [...head], time });
    this.writePanel();
    this.wake();
  }

  /** Write the panel, at most every `PANEL_INTERVAL`: it takes as long as to draw the trunk. */
  writePanel() {
    if (this.writing) return;
    const now = performance.now();
    const wait = Math.max(0, (this.written ?? -Infinity) + PANEL_INTERVAL - now);
    this.writing = setTimeout(() => {
      this.writing = null;
      this.written = performance.now();
      if (!this.trial) return;
      this.sliders.show(this.trial);
      this.writeTip();
      const { kind, text } = this.trial.message;
      setText(byId("try-message"), text);
      byId("try-message").dataset.kind = kind;
    }, wait);
  }

  /** The point of the trunk under a ray: Z and position in m; null beside the trunk. */
  grab(number, raycaster) {
    if (!this.trial || number !== this.number) return null;
    const scene = this.stage.scenes[number];
    const bodies = [...scene.muscles, ...scene.cores, scene.skin];
    const hit = scene.hit(raycaster, [...bodies, ...scene.solids]);
    if (!hit || !bodies.includes(hit.object)) return null;
    const j = sectionOf(hit);
    return { Z: this.trial.plan.trunk.tables.Z[j], position: this.positionOf(j) };
  }

  positionOf(j) {
    return [...this.trial.sections.position.subarray(3 * j, 3 * j + 3)];
  }

  /** Pull the trunk's point Z to a position; when let go, the trunk stays where it is. */
  pullTo({ Z, position, done }) {
    this.pulled = done ? null : { Z, position };
    if (done) this.follow({ Z, position });
    this.wake();
  }

  /** One step after the pulled point; called before every frame is drawn. */
  advance() {
    if (!this.pulled || this.pulled.settled) return;
    this.follow(this.pulled); // which wakes for the next step
    this.pulled.settled = this.trial.pull?.settled ?? true;
  }

  follow({ Z, position }) {
    this.trial.follow(Z, position);
    this.changed();
  }

  /** Pull the tip to the position that was typed, until it is there or can get no nearer. */
  pullTip() {
    const position = [...byId("try-tip").querySelectorAll("input")].map((input) => input.valueAsNumber);
    if (!position.every(Number.isFinite)) return this.writeTip(true);
    this.pulled = { Z: this.trial.plan.trunk.tables.Z.at(-1), position };
    this.wake();
  }

  /** The tip's position, in fields that are not being typed in, or in all. */
  writeTip(all = false) {
    const tip = this.positionOf(this.trial.sections.n - 1);
    byId("try-tip").querySelectorAll("input").forEach((input, i) => {
      if (all || document.activeElement !== input) input.value = tip[i].toFixed(3).replace(/^-(0\.0*)$/, "$1");
    });
  }
}

/** Number of the cross-section nearest to where a ray hits a body. */
function sectionOf({ object, face, point }) {
  const { first, last, corners } = object.userData.tube;
  const rings = last - first + 1;
  const ringOf = (index) => {
    const ring = Math.floor(index / corners.count);
    return ring < rings ? ring : index < rings * corners.count + object.userData.tube.outline.length / 2 ? 0 : rings - 1;
  };
  const places = object.geometry.attributes.position;
  const distance = (index) => {
    return object.localToWorld(new THREE.Vector3().fromBufferAttribute(places, index)).distanceTo(point);
  };
  const nearest = [face.a, face.b, face.c].sort((a, b) => distance(a) - distance(b))[0];
  return first + ringOf(nearest);
}

function moduleBytes() {
  return Uint8Array.from(atob(byId("module").textContent.trim()), (c) => c.charCodeAt(0));
}
