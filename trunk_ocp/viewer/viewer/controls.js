// What is shown and how: check boxes and choices beside the trunk, and the keys of the page.

import { activationGradient } from "./colors.js";
import { byId } from "./elements.js";
import { short } from "./plots.js";
import { ARROW_COLORS } from "./symbols.js";

export const SIDES = { R: "right (solid)", L: "left (dotted)" };
export const PARTS = {
  glass: "outer muscles translucent",
  core: "inner tissue",
  skin: "skin",
  head: "head",
  obstacles: "obstacles",
  targets: "targets",
  objects: "objects",
};
const KEY_STEP = 0.04; // s, of an arrow key
const AFTER_JUMP = 1e-3; // s, after a jump of the loads

/** Check boxes for muscle groups, sides and parts; they call `hide(key, on)`, `part(key, on)`. */
export function buildBoxes(plans, look, { hide, part }) {
  const groups = [...look.colors].map(([key, color]) => ({ key, label: key, color, on: true }));
  const sides = Object.entries(SIDES).map(([key, label]) => ({ key: `side ${key}`, label, on: true }));
  const parts = partsOf(plans).map((key) => ({ key, label: PARTS[key], on: look.parts[key] }));
  addBoxes(byId("groups"), groups, hide);
  addBoxes(byId("sides"), sides, hide);
  addBoxes(byId("parts"), parts, part);
  document.body.dataset.muscles = groups.length;
  addMuscleChoices(byId("muscle"), plans);
}

/** Everything besides muscles that plans have. */
function partsOf(plans) {
  const some = (has) => plans.some(has);
  const exists = {
    glass: some(({ trunk }) => trunk.muscles.some(({ outer }) => outer)),
    objects: some(({ objects }) => objects.length),
    head: some(({ solids }) => solids.some(({ group }) => group === "head")),
    obstacles: some(({ solids }) => solids.some(({ group }) => group === "obstacles")),
    targets: some(({ targets, arrows }) => targets.length + arrows.length),
  };
  return Object.keys(PARTS).filter((key) => exists[key] ?? true);
}

/** Check boxes that show or hide; they call `change(key, on)`. */
export function addBoxes(container, entries, change) {
  container.replaceChildren();
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

export function swatch(color) {
  const square = document.createElement("span");
  square.className = "swatch";
  square.style.background = color;
  return square;
}

function addMuscleChoices(select, plans) {
  const names = new Set(plans.flatMap((plan) => plan.trunk.muscles.map((muscle) => muscle.name)));
  select.replaceChildren(new Option("none", ""));
  for (const name of names) select.add(new Option(name, name));
}

/** Color bar of activation. */
export function drawLegend(largest) {
  byId("gradient").style.background = activationGradient();
  [0, largest / 2, largest].forEach((value, i) => {
    byId("legend-ticks").children[i].textContent = short(value);
  });
}

/** What the symbols of targets mean, for those that plans have. */
export function writeSymbolLegend(plans, shown) {
  const entries = [];
  if (plans.some(({ targets }) => targets.length)) entries.push(["\u25cf", "asked position", "#111"]);
  const times = ({ targets }) => new Set(targets.map(({ from }) => from));
  if (plans.some((plan) => times(plan).size > 1)) entries.push(["\u2022", "at another time", "#8d8d8d"]);
  ARROW_COLORS.forEach((color, i) => {
    const asked = plans.some(({ arrows }) => arrows.some(({ director }) => director === i));
    if (asked) entries.push(["\u2191", `asked d${i + 1}${i === 2 ? " (tangent)" : ""}`, color]);
  });
  byId("symbols").replaceChildren(...(shown ? entries : []).map(([sign, label, color]) => {
    const line = document.createElement("div");
    line.append(document.createElement("b"), label);
    line.firstChild.textContent = sign;
    line.firstChild.style.color = color;
    return line;
  }));
}

/** Keys of the whole page; `actions` has functions by name, `stops()` times to stop at. */
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
    t: actions.tryIt,
    Escape: actions.escape,
    a: () => actions.nudge(-0.1, 0, 1),
    d: () => actions.nudge(0.1, 0, 1),
    w: () => actions.nudge(0, 0.1, 1),
    s: () => actions.nudge(0, -0.1, 1),
    "+": () => actions.nudge(0, 0, 1 / 1.1),
    "-": () => actions.nudge(0, 0, 1.1),
  };
  const toStop = (direction) => nextStop(stops(), clock.time, direction) - clock.time;
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
  if (target.closest("select, input[type=number]")) return true;
  if (target.closest("#try-panel input[type=range]")) return /^(Arrow|Home|End)/.test(key);
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
