// Puts the page together: one state, and what its changes update.

import { readPayload, activationAt, activationRange, instantAt, mixed, phaseAt } from "./data.js";
import { groupColors } from "./colors.js";
import { Clock } from "./clock.js";
import { Stage } from "./stage.js";
import { Plots, short } from "./plots.js";
import {
  PARTS, SIDES, addBoxes, addMuscleChoices, byId, drawLegend, listenToKeys, stopsOf,
} from "./controls.js";

const payload = readPayload();
const { plans } = payload;
const clock = new Clock(Math.max(...plans.map((plan) => plan.duration)), draw);

/** What is shown and how; scene and plots take it in `dress`. */
const look = {
  hidden: new Set(), // keys of groups and sides
  // If a muscle reaches the center there is no inner tissue, so the skin shows the trunk.
  parts: { core: true, skin: reachCenter(plans), head: true, obstacles: true, targets: true, objects: true },
  colorBy: "activation",
  colors: groupColors(plans),
  largest: Math.max(...activationRange(plans).map(Math.abs)),
  selected: null, // name of a muscle
  shows: (muscle) => !look.hidden.has(muscle.group) && !look.hidden.has(`side ${muscle.side}`),
};

let stage = null;
let plots = null;

function start() {
  writeTitle();
  buildPanel();
  plots = new Plots(byId("plots"), plans, { seek, pick: select });
  stage = openStage();
  if (stage) addLabels();
  listenToBar();
  listenToKeys(clock, stopsOf(plans[0]), keys());
  dress();
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) clock.play();
  document.body.dataset.ready = "yes";
}

function writeTitle() {
  byId("title").textContent = payload.title;
  byId("subtitle").textContent = `${payload.name}, ${payload.trunk}`;
}

function openStage() {
  try {
    return new Stage(byId("canvas"), plans, select, () => clock.wake());
  } catch (error) {
    console.error(error);
    byId("no-webgl").hidden = false;
    return null;
  }
}

function reachCenter(plans) {
  return plans.some(({ trunk }) => trunk.cores.some(({ radius }) => radius === 0));
}

function buildPanel() {
  const groups = [...look.colors].map(([key, color]) => ({ key, label: key, color, on: true }));
  const sides = Object.entries(SIDES).map(([key, label]) => {
    return { key: `side ${key}`, label, on: true };
  });
  addBoxes(byId("groups"), groups, hide);
  addBoxes(byId("sides"), sides, hide);
  addPartBoxes();
  document.body.dataset.muscles = groups.length;
  addMuscleChoices(byId("muscle"), plans);
  drawLegend(look.largest);
  byId("muscle").addEventListener("change", () => select(byId("muscle").value || null));
  byId("color-by").addEventListener("change", () => {
    look.colorBy = byId("color-by").value;
    dress();
  });
}

/** Check boxes for everything besides muscles that this page has. */
function addPartBoxes() {
  const exists = {
    objects: plans.some((plan) => plan.objects.length),
    head: plans.some((plan) => plan.solids.some(({ group }) => group === "head")),
    obstacles: plans.some((plan) => plan.solids.some(({ group }) => group === "obstacles")),
  };
  const parts = Object.entries(PARTS)
    .filter(([key]) => exists[key] ?? true)
    .map(([key, label]) => ({ key, label, on: look.parts[key] }));
  addBoxes(byId("parts"), parts, (key, on) => {
    look.parts[key] = on;
    dress();
  });
}

function hide(key, on) {
  if (on) look.hidden.delete(key);
  else look.hidden.add(key);
  dress();
}

/** A label over every view that names its plan. */
function addLabels() {
  for (const plan of plans) {
    const label = byId("labels").appendChild(document.createElement("div"));
    const cost = plan.objective === null ? "" : `, J = ${short(plan.objective)}`;
    label.appendChild(document.createElement("strong")).textContent = plan.label;
    label.append(`${cost}; `);
    const status = label.appendChild(document.createElement("span"));
    status.className = plan.solved ? "" : "unsolved";
    status.textContent = plan.solved ? plan.status : `NOT SOLVED: ${plan.status}`;
    label.appendChild(document.createElement("div")).className = "head";
  }
}

function listenToBar() {
  byId("play").addEventListener("click", () => clock.toggle());
  byId("time").max = clock.duration;
  byId("time").addEventListener("input", () => seek(byId("time").valueAsNumber));
  byId("speed").addEventListener("change", () => (clock.speed = Number(byId("speed").value)));
  byId("loop").addEventListener("change", () => (clock.loop = byId("loop").checked));
  byId("reset").addEventListener("click", () => stage?.reset());
  byId("help-button").addEventListener("click", help);
}

function keys() {
  return {
    toggle: () => clock.toggle(),
    seek,
    help,
    switchColors: () => {
      const choice = byId("color-by");
      choice.value = choice.value === "group" ? "activation" : "group";
      choice.dispatchEvent(new Event("change"));
    },
    resetView: () => stage?.reset(),
    deselect: () => select(null),
    nudge: (...by) => stage?.nudge(...by),
  };
}

function help() {
  byId("help").showModal();
}

/** Go to a time in s and stop. */
function seek(time) {
  clock.playing = false;
  clock.seek(time);
}

/** Highlight a muscle in scenes and plots; null for none. */
function select(name) {
  look.selected = name;
  byId("muscle").value = name ?? "";
  dress();
}

function dress() {
  stage?.dress(look);
  plots.dress(look);
  byId("legend").hidden = look.colorBy !== "activation";
  clock.wake();
}

function draw(time) {
  stage?.show(time);
  plots.show(time);
  if (stage) placeLabels(time);
  writeBar(time);
  writeSelected(time);
}

function placeLabels(time) {
  plans.forEach((plan, i) => {
    const label = byId("labels").children[i];
    const { x, y, width } = stage.views[i];
    label.style.transform = `translate(${x}px, ${y}px)`;
    label.style.maxWidth = `${width}px`;
    const instant = instantAt(plan, time);
    const [psiZ, psiY] = [0, 1].map((k) => (mixed(plan.head, 2, k, instant) * 180) / Math.PI);
    setText(label.lastChild, `head: \u03c8Z ${degrees(psiZ)}, \u03c8Y ${degrees(psiY)}`);
  });
}

function degrees(angle) {
  return `${(Math.abs(angle) < 0.05 ? 0 : angle).toFixed(1).replace("-", "\u2212")}\u00b0`;
}

function writeBar(time) {
  const phase = phaseAt(plans[0], time);
  const now = time.toFixed(2);
  const justJumped = ({ jumps }) => jumps.some((t) => t < time && t.toFixed(2) === now);
  const jumped = !clock.playing && plans.some(justJumped);
  const label = `${now} of ${clock.duration.toFixed(2)} s${jumped ? ", just after" : ""}`;
  setText(byId("now"), label);
  setText(byId("phase"), phase);
  const slider = byId("time");
  slider.value = time;
  slider.setAttribute("aria-valuetext", `${label}, ${phase}`);
  const name = clock.playing ? "Pause" : "Play";
  if (byId("play").getAttribute("aria-label") !== name) {
    byId("play").setAttribute("aria-label", name);
    byId("play").dataset.playing = clock.playing;
  }
}

function writeSelected(time) {
  const lines = plans.flatMap((plan) => {
    const i = plan.trunk.muscles.findIndex((muscle) => muscle.name === look.selected);
    if (i < 0) return [];
    const { architecture, segment } = plan.trunk.muscles[i];
    const value = activationAt(plan, i, time).toFixed(3).replace("-", "\u2212");
    return [{ kind: `${architecture}, segment ${segment + 1}`, value: `${plan.label} ${value}` }];
  });
  const label = [lines[0]?.kind, ...lines.map(({ value }) => value)].filter(Boolean).join("\n");
  setText(byId("selected"), label || "Click a muscle or a curve.");
}

function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

start();

/** For tests, and for the browser's console. */
globalThis.trunkPage = {
  clock, look, plans, seek, select,
  get stage() {
    return stage;
  },
};
