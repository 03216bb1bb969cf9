// Buttons, check boxes and keys. They change the state through functions that `main` passes in.

import { activationGradient } from "./colors.js";
import { short } from "./plots.js";

export const SIDES = { R: "right (solid)", L: "left (dotted)" };
export const PARTS = {
  core: "inner tissue",
  skin: "skin",
  head: "head",
  obstacles: "obstacles",
  targets: "targets",
  objects: "objects",
};
const KEY_STEP = 0.04; // s, of an arrow key
const AFTER_JUMP = 1e-3; // s, after a jump of the loads

export function byId(id) {
  return document.getElementById(id);
}

/** Check boxes that show or hide; they call `change(key, on)`. */
export function addBoxes(container, entries, change) {
  for (const { key, label, color, on } of entries) {
    const line = container.appendChild(document.createElement("label"));
    const box = line.appendChild(document.createElement("input"));
    box.type = "checkbox";
    box.checked = on;
    box.dataset.key = key;
    box.addEventListener("change", () => change(key, box.checked));
    if (color) line.appendChild(swatch(color));
    line.append(label);
  }
}

function swatch(color) {
  const square = document.createElement("span");
  square.className = "swatch";
  square.style.background = color;
  return square;
}

export function addMuscleChoices(select, plans) {
  const names = new Set(plans.flatMap((plan) => plan.trunk.muscles.map((muscle) => muscle.name)));
  for (const name of names) select.add(new Option(name, name));
}

/** Color bar of activation. */
export function drawLegend(largest) {
  byId("gradient").style.background = activationGradient();
  [0, largest / 2, largest].forEach((value, i) => {
    byId("legend-ticks").children[i].textContent = short(value);
  });
}

/** Keys of the whole page; `actions` has functions by name. */
export function listenToKeys(clock, stops, actions) {
  const byKey = {
    " ": actions.toggle,
    ArrowLeft: (event) => actions.seek(clock.time + (event.shiftKey ? toStop(-1) : -KEY_STEP)),
    ArrowRight: (event) => actions.seek(clock.time + (event.shiftKey ? toStop(1) : KEY_STEP)),
    Home: () => actions.seek(0),
    End: () => actions.seek(clock.duration),
    "?": actions.help,
    c: actions.switchColors,
    r: actions.resetView,
    Escape: actions.deselect,
    a: () => actions.nudge(-0.1, 0, 1),
    d: () => actions.nudge(0.1, 0, 1),
    w: () => actions.nudge(0, 0.1, 1),
    s: () => actions.nudge(0, -0.1, 1),
    "+": () => actions.nudge(0, 0, 1 / 1.1),
    "-": () => actions.nudge(0, 0, 1.1),
  };
  const toStop = (direction) => nextStop(stops, clock.time, direction) - clock.time;
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || keyBelongsTo(event)) return;
    const action = byKey[event.key];
    if (!action) return;
    action(event);
    event.preventDefault();
  });
}

/** Whether the element with the focus handles a key itself. */
function keyBelongsTo({ target, key }) {
  if (byId("help").open) return true;
  if (target.closest("select")) return true;
  return key === " " && Boolean(target.closest("button, input[type=checkbox], summary"));
}

/** Times at which shift and an arrow stop: the start, the time steps, and just after jumps. */
export function stopsOf(plan) {
  return [0, ...plan.steps, ...plan.jumps.map((jump) => jump + AFTER_JUMP)];
}

/** The stop after (direction 1) or before (-1) a time. */
export function nextStop(stops, time, direction) {
  const ahead = stops.filter((stop) => direction * (stop - time) > 1e-4);
  if (!ahead.length) return time;
  return direction > 0 ? Math.min(...ahead) : Math.max(...ahead);
}
