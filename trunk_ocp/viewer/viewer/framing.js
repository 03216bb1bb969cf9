// Where the camera must be to see a whole motion: everything its trunk sweeps, and what is around.

/* global THREE */

const EVERY = 2; // of the cross-sections
const AROUND = 8; // points of a section's outline
const PIVOT_STEPS = 6; // samples of the motion at which the head's place counts

/** Points (three.js axes) on the surface of everything that plans show at any time. */
export function sweptPoints(plans) {
  const points = [];
  const add = (x, y, z) => points.push(inScene(x, y, z));
  for (const plan of plans) {
    addTrunk(plan, add);
    if (plan.still) addReach(plan, add);
    addSolids(plan, add);
    for (const object of plan.objects) addObject(object, add);
    for (const { position } of plan.targets) add(...position);
  }
  return points;
}

/** Model axes to those of three.js: +Z of the model points down. */
export function inScene(x, y, z) {
  return new THREE.Vector3(x, -z, y);
}

function addTrunk({ trunk, frames, times }, add) {
  const n = trunk.taper.length;
  const { position, quaternion, scale } = frames;
  const turn = new THREE.Group().quaternion;
  const point = new THREE.Vector3();
  for (let k = 0; k < times.length * n; k += k % n === n - 2 ? 1 : EVERY) {
    const [w, x, y, z] = quaternion.subarray(4 * k, 4 * k + 4);
    turn.set(x, y, z, w);
    for (let i = 0; i < AROUND; i++) {
      const angle = (2 * Math.PI * i) / AROUND;
      const radius = 1.05 * trunk.radius * scale[k];
      point.set(radius * Math.cos(angle), radius * Math.sin(angle), 0).applyQuaternion(turn);
      add(position[3 * k] + point.x, position[3 * k + 1] + point.y, position[3 * k + 2] + point.z);
    }
  }
}

/** Where a trunk at rest may be moved to: aside and up, in fractions of its length. */
function addReach({ trunk: { length }, frames: { position } }, add) {
  const [x, y, z] = position.subarray(0, 3).map((value) => value / length);
  for (const [dx, dy] of [[0.95, 0], [-0.95, 0], [0, 0.7], [0, -0.7]]) {
    add(length * (x + dx), length * (y + dy), length * (z + 0.3));
  }
}

/** Solids of bounded size, those of the head where it turns to. */
function addSolids({ solids, head, pivot, times }, add) {
  const point = new THREE.Vector3();
  const turn = new THREE.Group().rotation;
  const about = new THREE.Vector3(...pivot);
  const step = Math.max(1, Math.floor((times.length - 1) / PIVOT_STEPS));
  for (const { points, bounded, turns } of solids) {
    if (!bounded) continue;
    for (let i = 0; i < (turns ? times.length : 1); i += step) {
      turn.set(0, head[2 * i + 1], head[2 * i], "ZYX");
      for (let k = 0; k < points.length; k += 3) {
        point.set(points[k], points[k + 1], points[k + 2]);
        if (turns) point.sub(about).applyEuler(turn).add(about);
        add(point.x, point.y, point.z);
      }
    }
  }
}

function addObject({ center, radius, length }, add) {
  const along = length ? length / 2 : radius; // a log lies along y
  for (let k = 0; k < center.length; k += 3) {
    const [x, y, z] = center.subarray(k, k + 3);
    for (const sx of [-1, 1]) {
      for (const sy of [-1, 1]) {
        for (const sz of [-1, 1]) add(x + sx * radius, y + sy * along, z + sz * radius);
      }
    }
  }
}

/** Middle (three.js axes) and half diagonal of the box around points. */
export function boxAround(points) {
  const low = new THREE.Vector3(Infinity, Infinity, Infinity);
  const high = low.clone().negate();
  for (const point of points) {
    low.min(point);
    high.max(point);
  }
  const size = high.clone().sub(low).length() / 2;
  return { center: low.add(high).divideScalar(2), size };
}

/** Points in the axes of a camera that looks along -z of `turn`, a quaternion. */
export function seenFrom(points, turn) {
  const back = turn.clone().invert();
  return points.map((point) => point.clone().applyQuaternion(back));
}

/**
 * Nearest place (camera axes) of a camera that sees all points.
 *
 * `slopes` are the tangents of the angles from the line of sight to the edges of the part of the
 * view that may be used: {left, right, up, down}. A camera at (cx, cy, d) sees a point to the left
 * of the right edge if x - cx <= right (d - z), and so on: four bounds, and the least d has a
 * closed form.
 */
export function nearestPlace(points, { left, right, up, down }) {
  let [xHigh, xLow, yHigh, yLow] = [-Infinity, -Infinity, -Infinity, -Infinity];
  for (const { x, y, z } of points) {
    xHigh = Math.max(xHigh, x + right * z);
    xLow = Math.max(xLow, left * z - x);
    yHigh = Math.max(yHigh, y + up * z);
    yLow = Math.max(yLow, down * z - y);
  }
  const across = (xHigh + xLow) / (left + right);
  const along = (yHigh + yLow) / (up + down);
  const d = Math.max(across, along);
  const middle = (high, low, plus, minus) => (high - plus * d + minus * d - low) / 2;
  return new THREE.Vector3(middle(xHigh, xLow, right, left), middle(yHigh, yLow, up, down), d);
}
