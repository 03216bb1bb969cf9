// The data in the page: JSON with float32 arrays in base64; see payload.py.

export function readPayload() {
  const payload = JSON.parse(document.getElementById("data").textContent);
  payload.plans = payload.plans.map(decodedPlan);
  return payload;
}

function decodedPlan(plan) {
  const times = Float64Array.from(plan.times);
  const { position, quaternion, scale } = plan.frames;
  return {
    ...plan,
    times,
    duration: times[times.length - 1],
    label: plan.mode[0].toUpperCase() + plan.mode.slice(1),
    trunk: decodedTrunk(plan.trunk),
    frames: { position: floats(position), quaternion: floats(quaternion), scale: floats(scale) },
    activation: floats(plan.activation),
    head: floats(plan.head),
    objects: plan.objects.map((thing) => ({ ...thing, center: floats(thing.center) })),
  };
}

function decodedTrunk(trunk) {
  const muscles = trunk.muscles.map((muscle) => ({ ...muscle, outline: floats(muscle.outline) }));
  return { ...trunk, muscles, taper: floats(trunk.taper) };
}

function floats(text) {
  return new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
}

/**
 * Between which samples a time lies: numbers of both and the share of the later one.
 *
 * Where loads jump there are two samples at one time: at that time the first of them, later the
 * second. Where a phase holds what it has, the earlier sample until the later one is due.
 */
export function instantAt({ times, held }, t) {
  const last = times.length - 1;
  if (t >= times[last]) return { before: last, after: last, share: 0 };
  if (t <= times[0]) return { before: 0, after: 0, share: 0 };
  let after = 1;
  while (after < last && times[after] < t) after += 1;
  const before = after - 1;
  if (held[before] && t < times[after]) return { before, after: before, share: 0 };
  const share = (t - times[before]) / (times[after] - times[before]);
  return { before, after, share: Math.max(0, share) };
}

/** Number `i` of a row of `width` numbers, between two samples. */
export function mixed(array, width, i, { before, after, share }) {
  return (1 - share) * array[before * width + i] + share * array[after * width + i];
}

export function activationAt(plan, muscle, t) {
  return mixed(plan.activation, plan.trunk.muscles.length, muscle, instantAt(plan, t));
}

export function phaseAt(plan, t) {
  const phase = plan.phases.find((one) => t <= one.end + 1e-6);
  return phase ? phase.name : "";
}

/** Smallest and largest activation of all plans; zero is always between. */
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
