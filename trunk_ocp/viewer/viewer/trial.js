// Controls that the user tries: activations, head angles, a mass at the tip, and the shape that
// the trunk takes. No elements of the page here.

import { instantAt, isCurrent, mixedRow } from "./data.js";
import { makeSections, writeSections, writeSolution } from "./geometry.js";

const NEAR_BUCKLING = 0.1; // share of the stiffness that the loads leave
const CLOSE = 1e-6; // to a bound, in which case a control is at it

const WEIGHTLESS = "Shown without gravity, because the passive trunk does not hold its own weight.";

/** Why there is no shape, by the statuses of physics.js. */
const REFUSALS = {
  "no-equilibrium": "The trunk has no equilibrium at these settings, or none that was found.",
  "search-limit": "The trunk may have an equilibrium at these settings, but the search took too long.",
  collapsed: "These activations would shorten a segment to nothing.",
  compressed: "The loads would compress the trunk to nothing.",
  "too-sharp": "The trunk would bend too sharply to be computed.",
  "not-finite": "A setting is not a number.",
  lever: "At this instant the log hangs by a lever, which can be planned but not tried here.",
};

export class Trial {
  /** Try the trunk of a plan (`rod`, of physics.js) from an instant in s. */
  constructor(rod, plan, time) {
    this.rod = rod;
    this.plan = plan;
    this.sections = makeSections(plan.trunk);
    this.reset(time);
  }

  /** The plan's own controls and loads at an instant in s. */
  reset(time) {
    const { plan } = this;
    const instant = instantAt(plan, time);
    const count = plan.trunk.muscles.length;
    const boxes = plan.controls.boxes;
    const box = boxes.find((each) => isCurrent(each, time)) ?? boxes[boxes.length - 1];
    const planned = [...mixedRow(plan.activation, count, instant), ...mixedRow(plan.head, 2, instant)];
    const values = planned.map((value, i) => atBound(value, box.lower[i], box.upper[i]));
    this.lower = values.map((value, i) => Math.min(value, box.lower[i]));
    this.upper = values.map((value, i) => Math.max(value, box.upper[i]));
    [this.activation, this.head] = [values.slice(0, -2), values.slice(-2)];
    this.planned = mixedLoads(plan.controls.loads, instant);
    this.mass = this.planned.tip_mass;
    this.start = null;
    writeSections(this.sections, plan, time); // in case that there is no equilibrium
    this.solve();
  }

  /** Loads with the mass at the tip that is tried. */
  get loads() {
    const { tip_force: [x, y, z], gravity, tip_mass: planned } = this.planned;
    return { ...this.planned, tip_force: [x, y, z + (this.mass - planned) * gravity] };
  }

  /**
   * The equilibrium at the present controls, searched from the unloaded shape, so that the same
   * settings always have the same shape.
   */
  solve() {
    const { activation, head, loads } = this;
    this.pull = null;
    this.take(loads.contact_lever ? { status: "lever" } : this.rod.solve({ activation, head, loads }));
  }

  /** Change the controls so that the trunk's point Z (m) gets nearer to a target (3) in m. */
  follow(Z, target) {
    if (this.stale) return;
    const { activation, head, loads, lower, upper, start } = this;
    const bounds = { lower, upper, extension: this.plan.controls.extension };
    const memory = this.pull?.target === target ? this.pull.memory : undefined;
    const found = this.rod.follow({ Z, target, activation, head, loads, bounds, start, memory });
    this.take(found);
    if (this.stale) return;
    [this.activation, this.head] = [[...found.activation], [...found.head]];
    const { reached, error } = found;
    const settled = reached || found.settled;
    this.pull = { Z, target, reached, error, settled, memory: found.memory };
  }

  /** Whether muscles of both sides have the same activations. */
  get alike() {
    const { muscles } = this.plan.trunk;
    return muscles.every(({ side, group, segment }, i) => {
      const twin = muscles.findIndex((other) => {
        return other.side !== side && other.group === group && other.segment === segment;
      });
      return twin < 0 || Math.abs(this.activation[i] - this.activation[twin]) < 1e-3;
    });
  }

  /** Keep a shape, or the last good one if there is none. */
  take(solution) {
    this.status = solution.status;
    this.stale = !solution.position;
    if (this.stale) return;
    this.start = solution.start;
    this.margin = solution.margin;
    writeSolution(this.sections, solution, this.plan.trunk);
  }

  /** Extensions of the unloaded segments, which have limits: zeta_hat (eq. 5). */
  get extensions() {
    const { edges, muscles } = this.plan.trunk.tables;
    const extensions = new Array(edges.length - 1).fill(1);
    muscles.forEach(({ segment, strain }, i) => (extensions[segment] += strain[0] * this.activation[i]));
    return extensions;
  }

  /** What there is to say about the shape: {kind: "bad", "warning" or "good", text}. */
  get message() {
    if (this.stale) {
      const why = REFUSALS[this.status] ?? `There is no shape to show: ${this.status}.`;
      return { kind: "bad", text: `${why} Gray is the last shape that has an equilibrium.` };
    }
    const weightless = this.plan.still && this.planned.gravity === 0 ? [WEIGHTLESS] : [];
    const warnings = [...weightless, ...this.pullWarnings(), ...this.stabilityWarnings(), ...this.extensionWarnings()];
    if (warnings.length) return { kind: "warning", text: warnings.join(" ") };
    return { kind: "good", text: "In equilibrium." };
  }

  pullWarnings() {
    if (!this.pull || this.pull.reached || !this.pull.settled) return [];
    return [`The trunk cannot follow within its limits: ${lengthText(this.pull.error)} away.`];
  }

  stabilityWarnings() {
    if (this.status === "unstable") return ["Unstable: the trunk would buckle out of this shape."];
    if (this.margin === null || this.margin > NEAR_BUCKLING) return [];
    return [`Near buckling: the loads leave ${Math.round(100 * this.margin)} % of the stiffness.`];
  }

  extensionWarnings() {
    const [low, high] = this.plan.controls.extension;
    return this.extensions.flatMap((extension, i) => {
      if (extension > low - 1e-6 && extension < high + 1e-6) return [];
      const limit = extension < low ? low : high;
      return [`Segment ${i + 1} has ${extension.toFixed(2)} of its length; the limit is ${limit}.`];
    });
  }
}

function atBound(value, lower, upper) {
  if (Math.abs(value - lower) < CLOSE) return lower;
  return Math.abs(value - upper) < CLOSE ? upper : value;
}

/** Loads between two samples; contact is where the later one, or else the earlier one, has it. */
function mixedLoads(loads, { before, after, weight }) {
  const [a, b] = [loads[before], loads[after]];
  const mix = (x, y) => (1 - weight) * x + weight * y;
  const mixedVector = (name) => a[name].map((x, i) => mix(x, b[name][i]));
  const touching = b.contact_from === null ? a : b;
  return {
    gravity: mix(a.gravity, b.gravity),
    tip_force: mixedVector("tip_force"),
    contact_force: mixedVector("contact_force"),
    contact_couple: mixedVector("contact_couple"),
    contact_from: touching.contact_from,
    contact_lever: touching.contact_lever,
    tip_mass: b.tip_mass,
  };
}

/** A length in m as text. */
function lengthText(length) {
  if (length >= 1) return `${length.toFixed(2)} m`;
  return length < 0.1 ? `${(1e3 * length).toPrecision(2)} mm` : `${(100 * length).toFixed(0)} cm`;
}
