// Data of the page: JSON with float32 arrays in base64; see payload.py.

export function readPayload() {
  return JSON.parse(document.getElementById("data").textContent);
}

/** Plans of a payload; one whose `trunk` is left out has the trunk of the plan shown before. */
export function decodedPlans(payload, before = []) {
  return payload.plans.map((plan, i) => decodedPlan(plan, before[i]?.trunk));
}

function decodedPlan(plan, trunk) {
  const times = Float64Array.from(plan.times);
  const { position, quaternion, scale } = plan.frames;
  return {
    ...plan,
    times,
    duration: times[times.length - 1],
    label: plan.mode[0].toUpperCase() + plan.mode.slice(1),
    trunk: plan.trunk ? decodedTrunk(plan.trunk) : trunk,
    frames: { position: floats(position), quaternion: floats(quaternion), scale: floats(scale) },
    activation: floats(plan.activation),
    head: floats(plan.head),
    objects: plan.objects.map((object) => ({ ...object, center: floats(object.center) })),
    solids: plan.solids.map((solid) => ({
      ...solid, points: floats(solid.points), normals: floats(solid.normals),
    })),
  };
}

function decodedTrunk(trunk) {
  const muscles = trunk.muscles.map((muscle) => ({ ...muscle, outline: floats(muscle.outline) }));
  return { ...trunk, muscles, Z: floats(trunk.Z), taper: floats(trunk.taper) };
}

/** Numbers from base64; numbers stay as they are. */
function floats(text) {
  if (text instanceof Float32Array) return text;
  return new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
}

/**
 * The two samples around a time, by index, and the weight of the later one.
 *
 * Where loads jump there are two samples at one time; the first applies at that time, the second
 * after it. Where a phase holds its values, the earlier sample applies until the next one.
 */
export function instantAt({ times, held }, t) {
  const last = times.length - 1;
  if (t >= times[last]) return { before: last, after: last, weight: 0 };
  if (t <= times[0]) return { before: 0, after: 0, weight: 0 };
  let after = 1;
  while (after < last && times[after] < t) after += 1;
  const before = after - 1;
  if (held[before] && t < times[after]) return { before, after: before, weight: 0 };
  const weight = (t - times[before]) / (times[after] - times[before]);
  return { before, after, weight: Math.max(0, weight) };
}

/** Entry `i` of rows of `width` numbers, interpolated between two samples. */
export function mixed(array, width, i, { before, after, weight }) {
  return (1 - weight) * array[before * width + i] + weight * array[after * width + i];
}

/** A row of `width` numbers, interpolated between two samples. */
export function mixedRow(array, width, instant) {
  return Array.from({ length: width }, (_, i) => mixed(array, width, i, instant));
}

export function activationAt(plan, muscle, t) {
  return mixed(plan.activation, plan.trunk.muscles.length, muscle, instantAt(plan, t));
}

export function phaseAt(plan, t) {
  const phase = plan.phases.find(({ end }) => t <= end + 1e-6);
  return phase ? phase.name : "";
}

/** Whether something is asked, or bounds hold, at a time: after `from`, up to `to`. */
export function isCurrent({ from, to }, t) {
  return (t > from + 1e-6 || from <= 0) && t < to + 1e-6;
}

/** Smallest and largest activation of all plans, with zero in the range. */
export function activationRange(plans) {
  let [low, high] = [0, 0];
  for (const plan of plans) {
    for (const value of plan.activation) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low === high ? [-1, 0] : [low, high];
}
