// A dragged trunk: a few steps of damped Gauss-Newton in the controls, muscles and head.
//
// trunk.follow({ Z, target, activation, head, loads, bounds, start }) moves the point Z of the
// centerline toward `target` (m). bounds: { lower, upper (muscles, then psi_Z, psi_Y),
// extension: [low, high] of the unloaded trunk in every segment }. Returns what `solve` does and
//   activation, head   the controls of that shape, within bounds if the first ones were
//   reached            whether the point is at the target, to 1e-4 of the length
//   error              distance of the point from the target, m; null where there is no shape
// Each step changes the controls as little as it can, relative to their ranges. The trunk stops
// where it would lose its equilibrium or buckle: the shape is always one that was found.

const STEPS = 6; // of a call
const REACHED = 1e-4; // of the length
const CLOSE = 1e-6; // of the length: no more steps
const LARGEST_MOVE = 0.15; // of the length, that one step asks for
const LARGEST_CHANGE = 0.1; // of a control's range, in one step
const DAMPING = 1e-5; // relative, of the point's response to controls
const HALVINGS = 3;
const LIMIT_SOFTNESS = 1e-9; // relative, with which a step keeps limits of extension,
const LIMIT_MARGIN = 1e-7; // and how far inside it keeps them
const DUAL_STEPS = 20;
const WORTHWHILE = 0.98; // ratio of errors from one step to the next that is worth another one

/** See above; `trunk` is a PhysicsTrunk. */
export function followed(trunk, { Z, target, activation, head, loads = {}, bounds, start = null }) {
  const drag = new Drag(trunk, Z, target, loads);
  let now = drag.visit([...activation, ...head], start, false);
  if (!now.response) return { ...trunk.reported(now.status), activation, head, reached: false, error: null };
  drag.bound(bounds, now);
  for (let step = 0; step < STEPS && now.error > CLOSE * drag.length; step += 1) {
    const next = drag.improved(now);
    if (!next) break;
    const slow = next.error > WORTHWHILE * now.error;
    now = next;
    if (slow) break;
  }
  return drag.result(now);
}

class Drag {
  constructor(trunk, Z, target, loads) {
    Object.assign(this, { trunk, Z, target, loads, length: trunk.tables.length });
  }

  /** Take bounds, widened where the first controls are beyond them. */
  bound({ lower, upper, extension: [low, high] }, { controls }) {
    this.lower = controls.map((x, i) => Math.min(lower[i], x));
    this.upper = controls.map((x, i) => Math.max(upper[i], x));
    this.range = controls.map((_, i) => this.upper[i] - this.lower[i]);
    this.stretches = this.trunk.tables.edges.slice(1).map((_, segment) => {
      const now = this.stretch(segment, controls);
      return { low: Math.min(low, now), high: Math.max(high, now) };
    });
    this.mayBuckle = !this.trunk.stable();
  }

  /** Extension of a segment of the unloaded trunk. */
  stretch(segment, controls) {
    const { muscles } = this.trunk.tables;
    return muscles.reduce((sum, m, i) => sum + (m.segment === segment ? m.strain[0] * controls[i] : 0), 1);
  }

  /** The shape at some controls: where the point is, its response, and how to start from there. */
  visit(controls, start, warmOnly) {
    const { trunk, loads, Z, target } = this;
    trunk.enter(controls.slice(0, -2), controls.slice(-2), loads);
    const status = trunk.found(loads, { start, asked: Z, warmOnly });
    const response = status === "ok" ? trunk.slopes() : null;
    if (!response) return { status };
    const miss = response.point.map((x, i) => target[i] - x);
    return { status, controls, response, miss, error: Math.hypot(...miss), start: trunk.kept() };
  }

  /** The shape after one step, or null if no step brings the point nearer. */
  improved(now) {
    const change = this.change(now);
    for (let part = 1, tries = 0; tries <= HALVINGS; part /= 2, tries += 1) {
      const controls = now.controls.map((x, i) =>
        Math.min(Math.max(x + part * change[i], this.lower[i]), this.upper[i]));
      const next = this.visit(controls, now.start, true);
      if (next.error < now.error && (this.mayBuckle || this.trunk.stable())) return next;
    }
    return null;
  }

  /** Change of the controls that one step wants, within all limits. */
  change({ controls, response, miss, error }) {
    const { range, lower, upper, stretches } = this;
    const rows = response.rows.map((row) => range.map((r, i) => r * row[i]));
    const most = LARGEST_MOVE * this.length;
    const wanted = miss.map((x) => x * Math.min(1, most / error));
    const damping = DAMPING * rows.reduce((sum, row) => sum + dotProduct(row, row), 1e-30);
    const limits = stretches.map(({ low, high }, segment) => {
      const stretch = this.stretch(segment, controls);
      const row = range.map((r, i) => {
        const muscle = this.trunk.tables.muscles[i];
        return muscle?.segment === segment ? r * muscle.strain[0] : 0;
      });
      return { row, low: low - stretch, high: high - stretch };
    });
    const least = controls.map((x, i) => boundedRatio(lower[i] - x, range[i], -LARGEST_CHANGE));
    const largest = controls.map((x, i) => boundedRatio(upper[i] - x, range[i], LARGEST_CHANGE));
    const z = leastChange({ rows, wanted, damping, limits, least, largest });
    return z.map((value, i) => value * range[i]);
  }

  /** What callers get of the last shape that was found. */
  result({ controls, start, error }) {
    if (this.trunk.last !== start) this.visit(controls, start, false);
    return {
      ...this.trunk.reported("ok"),
      activation: controls.slice(0, -2),
      head: controls.slice(-2),
      reached: error <= REACHED * this.length,
      error,
    };
  }
}

/** room / range, no farther from 0 than `most`. */
function boundedRatio(room, range, most) {
  if (range === 0) return 0;
  return most < 0 ? Math.max(room / range, most) : Math.min(room / range, most);
}

/**
 * The z that minimizes |z|^2 + |rows z - wanted|^2 / damping within `least` and `largest` and with
 * every limit's `row` z between its `low` and `high`.
 *
 * By its dual: z = clip(rows^T y) for multipliers y of rows and limits, whose equations are
 * piecewise linear, and Newton's method solves them in a few steps.
 */
function leastChange({ rows, wanted, damping, limits, least, largest }) {
  const all = [...rows, ...limits.map(({ row }) => row)];
  const soft = limits.map(({ row }) => LIMIT_SOFTNESS * (dotProduct(row, row) + 1e-30));
  const y = all.map(() => 0);
  let z = least.map(() => 0);
  for (let round = 0; round < DUAL_STEPS; round += 1) {
    const free = z.map((value, i) => (value > least[i] && value < largest[i] ? 1 : 0));
    if (round === 0) free.fill(1);
    const residual = all.map((row, k) => {
      const value = dotProduct(row, z);
      if (k < rows.length) return value + damping * y[k] - wanted[k];
      const { low, high } = limits[k - rows.length];
      const inside = Math.min(Math.max(value, low + LIMIT_MARGIN), high - LIMIT_MARGIN);
      return value - inside + soft[k - rows.length] * y[k];
    });
    const matrix = all.map((row, k) => {
      const softness = k < rows.length ? damping : soft[k - rows.length];
      const value = dotProduct(row, z);
      const limit = limits[k - rows.length];
      const acts = !limit || value < limit.low + LIMIT_MARGIN || value > limit.high - LIMIT_MARGIN;
      return all.map((other, l) => {
        const same = k === l ? softness : 0;
        return acts ? row.reduce((sum, r, i) => sum + r * free[i] * other[i], same) : same;
      });
    });
    const step = linearSolution(matrix, residual);
    step.forEach((value, k) => (y[k] -= value));
    const before = z;
    z = least.map((low, i) => Math.min(Math.max(all.reduce((sum, row, k) => sum + row[i] * y[k], 0), low), largest[i]));
    if (Math.max(...z.map((value, i) => Math.abs(value - before[i]))) < 1e-12) break;
  }
  return z.map((value) => value * feasiblePart(z, limits));
}

/** Largest share of z, at most 1, that keeps all limits. */
function feasiblePart(z, limits) {
  return limits.reduce((part, { row, low, high }) => {
    const value = dotProduct(row, z);
    if (value > high) return Math.min(part, Math.max(high, 0) / value);
    if (value < low) return Math.min(part, Math.min(low, 0) / value);
    return part;
  }, 1);
}

function dotProduct(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i += 1) sum += a[i] * b[i];
  return sum;
}

/** Gaussian elimination with row pivoting; a zero pivot gives a zero. */
function linearSolution(matrix, right) {
  const rows = matrix.map((row, i) => [...row, right[i]]);
  const n = right.length;
  for (let k = 0; k < n; k += 1) {
    let best = k;
    for (let i = k + 1; i < n; i += 1) if (Math.abs(rows[i][k]) > Math.abs(rows[best][k])) best = i;
    [rows[k], rows[best]] = [rows[best], rows[k]];
    for (let i = k + 1; i < n; i += 1) {
      const factor = rows[i][k] / (rows[k][k] || 1);
      for (let c = k; c <= n; c += 1) rows[i][c] -= factor * rows[k][c];
    }
  }
  const x = new Array(n).fill(0);
  for (let k = n - 1; k >= 0; k -= 1) {
    let sum = rows[k][n];
    for (let c = k + 1; c < n; c += 1) sum -= rows[k][c] * x[c];
    x[k] = rows[k][k] ? sum / rows[k][k] : 0;
  }
  return x;
}
