// Buttons, boxes and keys: they read and change the state through the functions of `main`.

import { activationGradient } from "./colors.js";
import { short } from "./plots.js";

export const SIDES = { R: "right (solid)", L: "left (dashed)" };
export const PARTS = {
  core: "inner tissue",
  skin: "skin",
  head: "head pivot",
  targets: "targets",
  objects: "objects",
};
const FRAME = 0.04; // s, of an arrow key
const AFTER = 1e-3; // s, after a jump of the loads

export function byId(id) {
  return document.getElementById(id);
}

/** Boxes that show or hide; `change(key, on)` is told. */
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
  const names = new Set(plans.flatMap((plan) => plan.trunk.muscles.map((one) => one.name)));
  for (const name of names) select.add(new Option(name, name));
}

/** Legend of the colors by activation. */
export function drawLegend(largest) {
  byId("gradient").style.background = activationGradient();
  [0, largest / 2, largest].forEach((value, i) => {
    byId("legend-ticks").children[i].textContent = short(value);
  });
}

/** Keys of the whole page; `does` has what they do by name. */
export function listenToKeys(clock, stops, does) {
  const actions = {
    " ": does.toggle,
    ArrowLeft: (event) => does.seek(clock.time + (event.shiftKey ? toStep(-1) : -FRAME)),
    ArrowRight: (event) => does.seek(clock.time + (event.shiftKey ? toStep(1) : FRAME)),
    Home: () => does.seek(0),
    End: () => does.seek(clock.duration),
    "?": does.help,
    c: does.switchColors,
    r: does.resetView,
    Escape: does.deselect,
    a: () => does.nudge(-0.1, 0, 1),
    d: () => does.nudge(0.1, 0, 1),
    w: () => does.nudge(0, 0.1, 1),
    s: () => does.nudge(0, -0.1, 1),
    "+": () => does.nudge(0, 0, 1 / 1.1),
    "-": () => does.nudge(0, 0, 1.1),
  };
  const toStep = (way) => nextStop(stops, clock.time, way) - clock.time;
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isBusy(event)) return;
    const action = actions[event.key];
    if (!action) return;
    action(event);
    event.preventDefault();
  });
}

/** Whether a key belongs to the element that has the focus. */
function isBusy({ target, key }) {
  if (byId("help").open) return true;
  if (target.closest("select")) return true;
  return key === " " && Boolean(target.closest("button, input[type=checkbox], summary"));
}

/** Where keys stop: the start, the time steps, and just after those where loads jump. */
export function stopsOf(plan) {
  return [0, ...plan.steps, ...plan.jumps.map((jump) => jump + AFTER)];
}

/** Time of the stop after (way 1) or before (-1) a time. */
export function nextStop(times, time, way) {
  const ahead = times.filter((step) => way * (step - time) > 1e-4);
  if (!ahead.length) return time;
  return way > 0 ? Math.min(...ahead) : Math.max(...ahead);
}
