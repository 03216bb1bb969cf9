// The exact loaded trunk: shapes, stability and dragged points, by the module physics.wasm.
//
//   const physics = await loadPhysics(bytes);          // bytes of physics.wasm
//   const trunk = physics.trunk(tables);                // tables of physics_tables.py
//   const shape = trunk.solve({ activation, head: [psiZ, psiY], loads, start: before?.start });
//
// SI units, angles in rad, space axes with +Z down. `loads`: gravity in m/s^2 (default 9.8),
// tip_force [3] in N; contact_from in m, contact_force [3] in N, contact_couple [3] in N m.
// `start`, of an earlier shape, makes `solve` start from there: faster, and on the same branch
// where a trunk has several equilibria. A shape has
//   status     "ok" or "unstable" (an equilibrium, but it would buckle); else there is no shape:
//              "no-equilibrium", "search-limit" (there may be one), "collapsed" (activations
//              shorten a segment to nothing), "compressed" (loads do), "too-sharp", "not-finite"
//   Z          (n) m, of `tables`; what follows is there, or null where there is no shape
//   position   (3 n) m; directors (9 n): d_1, d_2, d_3 of each point; strain (n): extension zeta
//   scale      factor on radii that keeps the trunk's volume
//   base_moment [3] N m, in the directors
//   margin     share of the stiffness that the loads leave: 1 without loads, near 0 next to
//              buckling; a lower bound to within 1/64; 0 if unstable
//   unloaded   { position, directors } without loads; null if collapsed or not finite
//   start
// trunk.follow is described in follow.js.

import { followed } from "./follow.js";

const PHYSICS_STATUSES = [
  "ok", "no-equilibrium", "collapsed", "not-finite", "too-sharp", "compressed", "search-limit",
];
const POINT_OUTPUTS = 19; // of an export; position comes first
const NO_SHAPE = {
  position: null, directors: null, strain: null, scale: null, base_moment: null, margin: null,
  start: null,
};

/** The module, ready for trunks of any anatomy. */
export function loadPhysics(bytes) {
  return WebAssembly.instantiate(bytes).then(({ instance }) => new Physics(instance.exports));
}

class Physics {
  constructor(exports) {
    this.exports = exports;
    this.owner = null; // trunk whose anatomy the module has
  }

  trunk(tables) {
    return new PhysicsTrunk(this, tables);
  }

  /** Numbers at the place in memory that an export names. */
  at(name, count) {
    return new Float64Array(this.exports.memory.buffer, this.exports[name](), count);
  }
}

class PhysicsTrunk {
  constructor(physics, tables) {
    this.physics = physics;
    this.tables = tables;
    this.muscles = tables.muscles.length;
    this.Z = Float64Array.from(tables.Z);
    this.last = null; // start of the shape that the module holds
  }

  /** The equilibrium shape; see above. */
  solve({ activation, head, loads = {}, start = null }) {
    this.enter(activation, head, loads);
    return this.reported(this.found(loads, { start }));
  }

  /** The shape with a point of the centerline dragged toward a target; see follow.js. */
  follow(request) {
    return followed(this, request);
  }

  /** Hand inputs to the module. */
  enter(activation, head, loads) {
    this.own();
    const { gravity = 9.8, tip_force, contact_from, contact_force, contact_couple } = loads;
    const numbers = [
      ...checked("activation", activation, this.muscles), ...checked("head", head, 2), gravity,
      ...checked("tip_force", tip_force ?? [0, 0, 0], 3),
      ...checked("contact_force", contact_force ?? [0, 0, 0], 3),
      ...checked("contact_couple", contact_couple ?? [0, 0, 0], 3),
    ];
    if (contact_from != null && !(contact_from >= 0 && contact_from < this.tables.length)) {
      const { length } = this.tables;
      const told = `contact_from = ${contact_from}: expected Z in m from 0 to below ${length}`;
      throw new RangeError(told);
    }
    this.physics.at("input", numbers.length).set(numbers);
  }

  /** Find the shape for the inputs; returns a status. `asked`: point for `slopes`, Z in m. */
  found(loads, { start = null, asked = NaN, warmOnly = false } = {}) {
    const { exports } = this.physics;
    const contactFrom = loads.contact_from ?? NaN;
    if (start?.trunk !== this) exports.forget();
    else if (start !== this.last) this.restore(start);
    this.last = null;
    return PHYSICS_STATUSES[exports.solve(contactFrom, asked, Number(warmOnly))];
  }

  stable() {
    return Boolean(this.physics.exports.stable());
  }

  /** Position of the point that was asked for, and its derivatives: rows X, Y, Z by all inputs. */
  slopes() {
    const { physics } = this;
    if (physics.exports.differentiate() !== 0) return null;
    const inputs = this.muscles + 12;
    const all = physics.at("slopes", POINT_OUTPUTS * inputs);
    return {
      point: Array.from(physics.at("point", 3)),
      rows: [0, 1, 2].map((i) => all.slice(i * inputs, i * inputs + this.muscles + 2)),
    };
  }

  /** What callers get of the shape that the module holds. */
  reported(status) {
    const { physics, Z } = this;
    const { exports } = physics;
    const unloaded = exports.unloaded() === 0 ? {
      position: physics.at("unloaded_position", 3 * Z.length).slice(),
      directors: physics.at("unloaded_directors", 9 * Z.length).slice(),
    } : null;
    if (status !== "ok") return { status, Z, ...NO_SHAPE, unloaded };
    exports.describe();
    const stable = this.stable();
    return {
      status: stable ? "ok" : "unstable",
      Z,
      position: physics.at("position", 3 * Z.length).slice(),
      directors: physics.at("directors", 9 * Z.length).slice(),
      strain: physics.at("strain", Z.length).slice(),
      scale: exports.scale(),
      base_moment: Array.from(physics.at("base_moment", 3)),
      margin: stable ? exports.margin() : 0,
      unloaded,
      start: this.last ?? this.kept(),
    };
  }

  /** The shape that the module holds, to start another one from. */
  kept() {
    const count = this.physics.exports.keep();
    this.last = { trunk: this, numbers: this.physics.at("kept", count).slice() };
    return this.last;
  }

  restore({ numbers }) {
    this.physics.at("kept", numbers.length).set(numbers);
    this.physics.exports.restart();
  }

  /** Make the module's anatomy this trunk's. */
  own() {
    const { physics, tables } = this;
    if (physics.owner === this) return;
    const numbers = [
      tables.length, tables.radius, tables.taper_rate, tables.youngs_modulus, tables.poisson_ratio,
      tables.density, ...tables.head, ...tables.edges, ...tables.Z,
      ...tables.muscles.flatMap(({ segment, strain }) => [segment, ...strain]),
    ];
    physics.at("given", numbers.length).set(numbers);
    if (physics.exports.set_anatomy(this.muscles, tables.edges.length - 1, tables.Z.length)) {
      throw new RangeError("more muscles, segments or points Z than physics.wasm has room for");
    }
    physics.owner = this;
    this.last = null;
  }
}

function checked(name, numbers, count) {
  if (numbers?.length !== count) {
    throw new RangeError(`${name}: expected ${count} numbers, got ${numbers?.length ?? numbers}`);
  }
  return numbers;
}
