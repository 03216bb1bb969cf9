// The axes of the model as a small labeled triad, turned like the view.

import { inScene } from "./framing.js";
import { svg } from "./plots.js";

const SIZE = 34; // px, of an axis
const AXES = [
  { direction: [1, 0, 0], label: "X forward", color: "#B3261E" },
  { direction: [0, 1, 0], label: "Y right", color: "#2E7D32" },
  { direction: [0, 0, 1], label: "Z down", color: "#1558B0" },
];

/** Draws into an SVG element whose origin is where the axes meet. */
export class Axes {
  constructor(element) {
    this.element = element;
    this.lines = AXES.map(({ color, label }) => {
      const line = svg("line", { stroke: color });
      const name = svg("text", { fill: color });
      name.textContent = label;
      element.append(line, name);
      return { line, name };
    });
  }

  /** Turn with a camera; axes that point away from it are drawn fainter. */
  show(camera) {
    const back = camera.quaternion.clone().invert();
    AXES.forEach(({ direction }, i) => {
      const { x, y, z } = inScene(...direction).applyQuaternion(back);
      const { line, name } = this.lines[i];
      setNumbers(line, { x2: SIZE * x, y2: -SIZE * y, opacity: z < -0.2 ? 0.55 : 1 });
      const side = x < -0.25 ? "end" : x > 0.25 ? "start" : "middle";
      setNumbers(name, { x: 1.15 * SIZE * x, y: -1.25 * SIZE * y + 4, "text-anchor": side });
    });
  }
}

function setNumbers(element, attributes) {
  for (const [key, value] of Object.entries(attributes)) {
    element.setAttribute(key, typeof value === "number" ? value.toFixed(2) : value);
  }
}
