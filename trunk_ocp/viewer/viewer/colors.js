// Colors of muscle groups, and cividis for the size of activation: both work for any color vision.

// Without its darkest fifth, which would hide the shading of a body at rest.
const CIVIDIS = [
  "#33456C", "#48546C", "#5D636F", "#717274", "#868278",
  "#9C9376", "#B3A570", "#CBB866", "#E4CC56", "#FEE838",
];

/** Color of every muscle group by name, the same as in all figures. */
export function groupColors(plans) {
  return new Map(plans.flatMap((plan) => Object.entries(plan.trunk.colors)));
}

/** Color, as a number, of a fraction from 0 to 1 of the largest activation. */
export function activationColor(fraction) {
  const at = Math.min(Math.max(fraction, 0), 1) * (CIVIDIS.length - 1);
  const i = Math.min(Math.floor(at), CIVIDIS.length - 2);
  const [low, high] = [channels(CIVIDIS[i]), channels(CIVIDIS[i + 1])];
  const [r, g, b] = low.map((value, c) => Math.round(value + (at - i) * (high[c] - value)));
  return (r << 16) | (g << 8) | b;
}

function channels(color) {
  return [1, 3, 5].map((start) => parseInt(color.slice(start, start + 2), 16));
}

export function activationGradient() {
  return `linear-gradient(to right, ${CIVIDIS.join(", ")})`;
}
