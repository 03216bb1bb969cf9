// A dragged trunk: a few steps of damped Gauss-Newton in the controls, muscles and head.
//
// trunk.follow({ Z, target, activation, head, loads, bounds, start }) moves the point Z of the
// centerline toward `target` (m). bounds: { lower, upper (muscles, then psi_Z, psi_Y),
// extension: [low, high] of the unloaded trunk in every segment, optional }. Returns what `solve`
// does and
//   activation, head   the controls of that shape, within bounds if the first ones were
//   reached            whether the point is at the target, to 1e-4 of the length
//   error              distance of the point from the target, m; null where there is no shape
//   settled            whether no small change of the controls brings it nearer
//   memory             to pass to the next call for the same target: it makes that one faster
// Each step changes the controls as little as it can, relative to their ranges: a Gauss-Newton step
// with Levenberg and Marquardt's damping. Where the target is out of reach, J^T J lacks much of the
// curvature of the distance, so what the last steps have shown of it is added: the positive ones of
// symmetric rank-one updates. Repeated calls end at a local minimum of the distance. The trunk stops
// where it would lose its equilibrium or buckle: the shape is always one that was found.

const VISITS = 3; // shapes of a call
const REACHED = 1e-4; // of the length
const CLOSE = 1e-6; // of the length: no more steps
const SETTLED = 1e-5; // of the length: what the best step would gain, where it is at its best
const LARGEST_MOVE = 0.15; // of the length, that one step asks for
const LARGEST_CHANGE = 0.1; // of a control's range, in one step
const DAMPING = 1e-5; // relative, of the point's response to controls, if caution is 1
const CAUTION = { more: 4, most: 1e8 }; // factor after a poor step
const SHARES = { least: 0.1, poor: 0.25, good: 0.4, bent: 0.6 }; // of a step's gain by its slope
const SLOW = 0.9; // ratio of errors from one step to the next, from which curvature matters
const BENDS = 6; // rank-one updates that are kept
const SMALLEST_ANGLE = 1e-2; // cosine, of an update with its step
const LIMIT_SOFTNESS = 1e-11; // relative, with which a step keeps limits of extension,
const LIMIT_MARGIN = 1e-7; // and how far inside it keeps them

/** See above; `trunk` is a PhysicsTrunk. */
export function followed(trunk, { activation, head, bounds, start = null, ...request }) {
  const drag = new Drag(trunk, request);
  let now = drag.visit([...activation, ...head], start, false);
  if (!now.response) {
    return { ...trunk.reported(now.status), activation, head, reached: false, error: null };
  }
  drag.bound(bounds, now);
  for (let visits = 1; visits < VISITS && !drag.settled(now); visits += 1) {
    now = drag.improved(now) ?? now;
  }
  return drag.result(now);
}

class Drag {
  constructor(trunk, { Z, target, loads = {}, memory = { caution: 1, bends: [] } }) {
    Object.assign(this, { trunk, Z, target, loads, ...memory, length: trunk.tables.length });
  }

  /** Take bounds, widened where the first controls are beyond them. */
  bound({ lower, upper, extension: [low, high] = [0, Infinity] }, { controls }) {
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
    return muscles.reduce(
      (sum, muscle, i) => sum + (muscle.segment === segment ? muscle.strain[0] * controls[i] : 0),
      1,
    );
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

  /** The shape after one step, or null if the step gains less than it should. */
  improved(now) {
    const { change, gain } = this.step(now, this);
    const controls = now.controls.map((x, i) =>
      Math.min(Math.max(x + change[i], this.lower[i]), this.upper[i]));
    const next = this.visit(controls, now.start, true);
    if (next.error > SLOW * now.error) this.learn(now, next);
    const kept = next.response && (this.mayBuckle || this.trunk.stable());
    const share = kept ? (now.error ** 2 - next.error ** 2) / 2 / gain : 0;
    if (share > SHARES.bent) this.bends = this.bends.slice(1); // there is less curvature
    if (share < SHARES.poor) this.caution = Math.min(CAUTION.most, this.caution * CAUTION.more);
    else if (share > SHARES.good) this.caution = Math.max(1, this.caution / CAUTION.more);
    return share > SHARES.least ? next : null;
  }

  /** Keep what a step shows of the curvature: row^T row, for a miss of 1 m, joins the others. */
  learn(now, next) {
    const z = this.range.map((r, i) => (r ? (next.controls[i] - now.controls[i]) / r : 0));
    const lacking = this.range.map((r, i) => next.miss.reduce((sum, x, k) =>
      sum - ((r * x) / next.error) * (next.response.rows[k][i] - now.response.rows[k][i]), 0));
    for (const row of this.bends) {
      const part = dotProduct(row, z);
      row.forEach((x, i) => (lacking[i] -= part * x));
    }
    const along = dotProduct(lacking, z);
    if (!(along > SMALLEST_ANGLE * Math.hypot(...lacking) * Math.hypot(...z))) return;
    this.bends = [...this.bends.slice(1 - BENDS), lacking.map((x) => x / Math.sqrt(along))];
  }

  /** Whether the point is at the target, or no step within all limits brings it nearer. */
  settled(now) {
    if (now.error <= CLOSE * this.length) return true;
    return this.step(now, { caution: 1, bends: [] }).gain < SETTLED * this.length * now.error;
  }

  /** Change of the controls that one step wants, within all limits, and its gain by the slope. */
  step({ controls, response, miss, error }, { caution, bends }) {
    const { range, lower, upper, stretches } = this;
    const rows = response.rows.map((row) => range.map((r, i) => r * row[i]));
    const most = LARGEST_MOVE * this.length;
    const wanted = miss.map((x) => x * Math.min(1, most / error));
    const damping = caution * DAMPING * rows.reduce((sum, row) => sum + dotProduct(row, row), 1e-30);
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
    const bent = bends.map((row) => row.map((x) => x * Math.sqrt(Math.min(error, most))));
    const all = { rows: [...rows, ...bent], wanted: [...wanted, ...bent.map(() => 0)] };
    const z = leastChange({ ...all, damping, limits, least, largest });
    const gain = rows.reduce((sum, row, k) => sum + miss[k] * dotProduct(row, z), 0);
    return { change: z.map((value, i) => value * range[i]), gain };
  }

  /** What callers get of the last shape that was found. */
  result(now) {
    const { controls, start, error } = now;
    const held = this.trunk.last === start;
    return {
      ...this.trunk.reported(held ? "ok" : this.visit(controls, start, false).status),
      activation: controls.slice(0, -2),
      head: controls.slice(-2),
      reached: error <= REACHED * this.length,
      error,
      settled: this.settled(now),
      memory: { caution: this.caution, bends: this.bends },
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
 * Limits join as equations, one by one, while they are violated, and leave where they would pull.
 */
function leastChange({ rows, wanted, damping, limits, least, largest }) {
  const joined = new Map(); // values that limits have, by index
  let z = null;
  for (let round = 0; round < 3 * limits.length + 1; round += 1) {
    const keys = [...joined.keys()];
    const equations = [
      ...rows.map((row, k) => ({ row, value: wanted[k], softness: damping })),
      ...keys.map((key) => ({ row: limits[key].row, ...joined.get(key) })),
    ];
    const found = boundedSolution(equations, least, largest);
    z = found.z;
    const pulling = keys.filter((key, k) => found.y[rows.length + k] * joined.get(key).side < 0);
    pulling.forEach((key) => joined.delete(key));
    const worst = pulling.length ? null : worstLimit(z, limits, joined);
    if (worst) joined.set(worst.key, worst.equation);
    else if (!pulling.length) break;
  }
  const part = feasiblePart(z, limits);
  return z.map((value) => value * part);
}

/** The limit that is violated most, and the equation that keeps it; null if there is none. */
function worstLimit(z, limits, joined) {
  let [worst, most] = [null, LIMIT_MARGIN / 2];
  limits.forEach(({ row, low, high }, key) => {
    const now = dotProduct(row, z);
    const violation = Math.max(low + LIMIT_MARGIN - now, now - high + LIMIT_MARGIN);
    if (joined.has(key) || violation <= most) return;
    const side = now < low + LIMIT_MARGIN ? 1 : -1; // the sign of a multiplier that holds it
    const softness = LIMIT_SOFTNESS * dotProduct(row, row);
    const value = side > 0 ? low + LIMIT_MARGIN : high - LIMIT_MARGIN;
    worst = { key, equation: { side, softness, value } };
    most = violation;
  });
  return worst;
}

/**
 * The z within bounds that minimizes |z|^2 + sum of |row z - value|^2 / softness, and y.
 *
 * Free variables have z = sum of y row. By an active set: those that hit a bound on their way stay
 * there until the others are at their best, and the one that most wants to leave is let go.
 */
function boundedSolution(equations, least, largest) {
  const z = least.map(() => 0);
  const bound = least.map((low, i) => low === largest[i]);
  const wantedOf = (y, i) => equations.reduce((sum, { row }, k) => sum + y[k] * row[i], 0);
  for (let round = 0; ; round += 1) {
    const y = multipliers(equations, z, bound);
    const goal = z.map((value, i) => (bound[i] ? value : wantedOf(y, i)));
    const parts = goal.map((x, i) => partTo(x, z[i], least[i], largest[i]));
    const part = Math.min(1, ...parts);
    goal.forEach((x, i) => {
      if (bound[i]) return;
      bound[i] = part < 1 && parts[i] <= part;
      z[i] += part * (x - z[i]);
      if (bound[i]) z[i] = x > z[i] ? largest[i] : least[i];
    });
    if (part < 1) continue;
    const leaves = leavingVariable((i) => wantedOf(y, i), z, bound, least, largest);
    if (leaves === null || round > 4 * z.length) return { z, y };
    bound[leaves] = false;
  }
}

/** The y of the best free variables, while the others are at their bounds. */
function multipliers(equations, z, bound) {
  const matrix = equations.map(({ row, softness }, k) => equations.map((other, l) =>
    row.reduce((sum, r, i) => (bound[i] ? sum : sum + r * other.row[i]), k === l ? softness : 0)));
  const rest = equations.map(({ row, value }) =>
    row.reduce((sum, r, i) => (bound[i] ? sum - r * z[i] : sum), value));
  return linearSolution(matrix, rest);
}

/** The share of the way from `now` to `goal` that is within bounds, at most 1. */
function partTo(goal, now, low, high) {
  if (goal > high) return (high - now) / (goal - now);
  if (goal < low) return (low - now) / (goal - now);
  return 1;
}

/** The variable at a bound that gains most by leaving it; null if none gains. */
function leavingVariable(wanted, z, bound, least, largest) {
  let [leaves, most] = [null, 1e-12];
  z.forEach((value, i) => {
    if (!bound[i] || least[i] === largest[i]) return;
    const gain = value === largest[i] ? value - wanted(i) : wanted(i) - value;
    if (gain > most) [leaves, most] = [i, gain];
  });
  return leaves;
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
