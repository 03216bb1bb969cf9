// Sliders for everything that can be tried.

import { swatch } from "./controls.js";
import { byId, setText } from "./elements.js";
import { degrees } from "./bar.js";

const DEGREE = Math.PI / 180;

/** Rows of sliders for a trial; a slider calls `change(edit)`, `edit(trial)` writes the controls. */
export class Sliders {
  constructor(change) {
    this.change = change;
    this.rows = [];
  }

  /** Sliders for a trial's controls; `linked`: one for both sides. */
  build(trial, linked, colors) {
    const { muscles } = trial.plan.trunk;
    const rows = muscleRows(muscles, linked).map(({ label, indices }) => ({
      indices,
      ...this.row({
        label: linked ? label : muscles[indices[0]].name,
        name: `activation of ${indices.map((i) => muscles[i].name).join(" and ")}`,
        range: boundsOf(trial, indices),
        step: 0.01,
        color: colors.get(muscles[indices[0]].group),
        write: (tried, value) => indices.forEach((i) => (tried.activation[i] = value)),
        read: (tried) => indices.map((i) => tried.activation[i]),
        say: (values) => {
          const texts = new Set(values.map((value) => signed(value, 2)));
          return texts.size > 1 ? "differ" : [...texts][0];
        },
      }),
    }));
    const segments = [...new Set(muscles.map(({ segment }) => segment))].sort((a, b) => a - b);
    const inSegment = (segment) => rows.filter(({ indices }) => muscles[indices[0]].segment === segment);
    byId("try-muscles").replaceChildren(
      ...segments.map((segment) => group(`Segment ${segment + 1}`, inSegment(segment))),
    );
    const head = ["\u03c8Z (turn)", "\u03c8Y (raise)"].map((label, i) => this.headRow(trial, label, i));
    byId("try-head").replaceChildren(...head.map(({ element }) => element));
    const mass = this.massRow(trial);
    byId("try-mass").replaceChildren(mass.element);
    this.rows = [...rows, ...head, mass];
    this.show(trial);
  }

  headRow({ lower, upper }, label, i) {
    const at = lower.length - 2 + i;
    return this.row({
      label,
      name: `head angle ${label} in degrees`,
      range: [lower[at] / DEGREE, upper[at] / DEGREE],
      step: 0.1,
      write: (tried, value) => (tried.head[i] = atEnd(value * DEGREE, lower[at], upper[at])),
      read: (tried) => [tried.head[i] / DEGREE],
      say: ([value]) => degrees(value),
    });
  }

  massRow({ plan }) {
    const largest = plan.controls.largest_mass;
    return this.row({
      label: "mass at tip",
      name: "mass at the tip in kg",
      range: [0, largest],
      step: largest / 200,
      write: (tried, value) => (tried.mass = value),
      read: (tried) => [tried.mass],
      say: ([value]) => `${Number(value.toPrecision(3))} kg`,
    });
  }

  row({ label, name, range: [low, high], step, color, write, read, say }) {
    const element = document.createElement("label");
    element.className = "slider";
    const title = element.appendChild(document.createElement("span"));
    if (color) title.append(swatch(color));
    title.append(label);
    const input = element.appendChild(document.createElement("input"));
    Object.assign(input, { type: "range", min: low, max: high, step, disabled: low === high });
    input.setAttribute("aria-label", name);
    const output = element.appendChild(document.createElement("output"));
    input.addEventListener("input", () => {
      const value = atEnd(input.valueAsNumber, low, high);
      this.change((tried) => write(tried, value));
    });
    const show = (tried) => {
      const values = read(tried);
      input.value = values[0];
      setText(output, say(values));
      input.setAttribute("aria-valuetext", output.textContent);
    };
    return { element, show };
  }

  /** Show a trial's controls. */
  show(trial) {
    for (const row of this.rows) row.show(trial);
  }
}

/** Muscles for each row of sliders; linked, both sides of a group in a segment share one. */
function muscleRows(muscles, linked) {
  const rows = new Map();
  muscles.forEach(({ name, group, segment }, i) => {
    const key = linked ? `${segment} ${group}` : name;
    const row = rows.get(key) ?? { label: group, indices: [] };
    row.indices.push(i);
    rows.set(key, row);
  });
  return [...rows.values()];
}

function boundsOf({ lower, upper }, indices) {
  const low = Math.max(...indices.map((i) => lower[i]));
  const high = Math.min(...indices.map((i) => upper[i]));
  return [Math.min(low, high), high];
}

function group(title, rows) {
  const details = document.createElement("details");
  details.open = true;
  details.appendChild(document.createElement("summary")).textContent = title;
  details.append(...rows.map(({ element }) => element));
  return details;
}

/** A value that rounding moved just past the end of a slider is at the end. */
function atEnd(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

function signed(value, digits) {
  return value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "\u2212");
}
