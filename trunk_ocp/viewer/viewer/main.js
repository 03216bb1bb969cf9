// Puts the page together: one state, and what its changes update.

import { bridge, connectParent } from "./bridge.js";
import { readPayload, decodedPlans, activationAt, activationRange } from "./data.js";
import { groupColors } from "./colors.js";
import { Clock } from "./clock.js";
import { Axes } from "./axes.js";
import { Stage, hasWebGL } from "./stage.js";
import { Plots } from "./plots.js";
import { listenToBar, placeLabels, writeBar, writeLabels } from "./bar.js";
import { buildBoxes, drawLegend, listenToKeys, stopsOf, writeSymbolLegend } from "./controls.js";
import { byId, setText } from "./elements.js";
import { TryIt } from "./tryit.js";

let plans = [];
let stage = null;
let tryIt = null; // as long as there is a stage
const clock = new Clock(0, draw);
const plots = new Plots(byId("plots"), { seek, pick: select });
const axes = new Axes(byId("axes"));

/** What is shown and how; scene and plots take it in `dress`. */
const look = {
  hidden: new Set(), // keys of groups and sides
  parts: {
    glass: false, core: true, skin: false, head: true, obstacles: true, targets: true, objects: true,
  },
  colorBy: "activation",
  colors: new Map(),
  largest: 1,
  selected: null, // name of a muscle
  shows: (muscle) => !look.hidden.has(muscle.group) && !look.hidden.has(`side ${muscle.side}`),
};

function start() {
  showPlan(readPayload());
  listenToBar(clock, actions);
  listenToKeys(clock, () => stopsOf(plans[0]), actions);
  listenToPanel();
  connectParent({ plan: showPlan, time: ({ time }) => seek(time), controls: setControls });
  document.body.dataset.ready = "yes";
  bridge.emit("ready", {});
  if (plans.every(({ still }) => still)) switchTrying(true);
  else if (!matchMedia("(prefers-reduced-motion: reduce)").matches) clock.play();
}

/**
 * Show the plans of a payload (payload.py) instead of those shown now, at the same instant.
 *
 * Plans without a `trunk` have that of the plan they replace; then the camera, the check boxes and
 * the bodies of the muscles stay, so that it takes a few milliseconds. With `quick`, so do the plots.
 */
export function showPlan(payload, { quick = false } = {}) {
  const before = plans;
  plans = decodedPlans(payload, before);
  const same = before.length === plans.length && plans.every(({ trunk }, i) => trunk === before[i].trunk);
  clock.setDuration(Math.max(...plans.map((plan) => plan.duration)));
  look.colors = groupColors(plans);
  look.largest = Math.max(...activationRange(plans).map(Math.abs));
  document.body.dataset.still = plans.every(({ still }) => still);
  document.body.dataset.plans = plans.length;
  document.title = payload.title;
  byId("title").textContent = payload.title;
  byId("subtitle").textContent = [payload.name, payload.trunk].filter(Boolean).join(", ");
  if (!same) startLook(before.length === 0);
  if (!quick) plots.setPlans(plans);
  if (stage) stage.setPlans(plans);
  else stage = openStage();
  writeLabels(stage ? plans : []);
  drawLegend(look.largest);
  dress();
  if (tryIt?.isOpen) switchTrying(true);
}

/** Start or end trying controls at the instant shown. */
async function switchTrying(on) {
  if (!tryIt || (!on && document.body.dataset.still === "true")) return;
  clock.pause();
  document.body.dataset.trying = on;
  byId("try-button").setAttribute("aria-pressed", on);
  byId("show-panel").open = !on;
  if (on) await tryIt.open(plans, clock.time);
  else tryIt.close();
  dress();
}

/** Try controls: {activation, head, mass} in the order of the anatomy, rad and kg; some or all. */
export async function setControls({ activation, head, mass }) {
  if (!tryIt) return;
  if (!tryIt.isOpen) await switchTrying(true);
  tryIt.edit((trial) => {
    if (activation) trial.activation = [...activation];
    if (head) trial.head = [...head];
    if (mass !== undefined) trial.mass = mass;
  });
}

/** Check boxes for the parts of other trunks than before; at first, what shows the trunk best. */
function startLook(first) {
  // If a muscle reaches the center there is no inner tissue, so the skin shows the trunk.
  if (first) look.parts.skin = plans.some(({ trunk }) => trunk.cores.some(({ radius }) => radius === 0));
  look.hidden.clear();
  look.selected = null;
  buildBoxes(plans, look, { hide, part });
}

function openStage() {
  if (hasWebGL()) {
    const opened = new Stage(byId("canvas"), plans, select, () => clock.wake());
    tryIt = new TryIt(opened, look, () => clock.wake());
    return opened;
  }
  byId("no-webgl").hidden = false;
  for (const id of ["canvas", "axes", "keys", "try-button", "reset"]) byId(id).hidden = true;
  return null;
}

function listenToPanel() {
  byId("try-button").addEventListener("click", actions.tryIt);
  byId("muscle").addEventListener("change", () => select(byId("muscle").value || null));
  byId("color-by").addEventListener("change", () => {
    look.colorBy = byId("color-by").value;
    dress();
  });
}

/** What buttons and keys do. */
const actions = {
  toggle: () => {
    if (tryIt?.isOpen) switchTrying(false);
    clock.toggle();
  },
  seek,
  help: () => byId("help").showModal(),
  switchColors: () => {
    const choice = byId("color-by");
    choice.value = choice.value === "group" ? "activation" : "group";
    choice.dispatchEvent(new Event("change"));
  },
  resetView: () => stage?.reset(),
  tryIt: () => switchTrying(!tryIt?.isOpen),
  escape: () => (look.selected === null && tryIt?.isOpen ? switchTrying(false) : select(null)),
  nudge: (...by) => stage?.nudge(...by),
};

function hide(key, on) {
  if (on) look.hidden.delete(key);
  else look.hidden.add(key);
  dress();
}

function part(key, on) {
  look.parts[key] = on;
  dress();
}

/** Go to a time in s and stop. */
function seek(time) {
  clock.playing = false;
  clock.seek(time);
  if (tryIt?.isOpen) tryIt.reset(clock.time);
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
  byId("legend").hidden = !stage || look.colorBy !== "activation";
  writeSymbolLegend(plans, stage && look.parts.targets);
  clock.wake();
}

function draw(time) {
  tryIt?.advance();
  stage?.show(time);
  plots.show(time);
  if (stage) {
    placeLabels(plans, stage, time);
    axes.show(stage.camera);
  }
  writeBar(clock, plans);
  writeSelected(time);
  if (time !== draw.last) bridge.emit("time", { time });
  draw.last = time;
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

/** For tests, for modules that connect the page to a server, and for the browser's console. */
globalThis.trunkPage = {
  clock, look, seek, select, bridge, showPlan, setControls,
  get plans() {
    return plans;
  },
  get stage() {
    return stage;
  },
  get trial() {
    return tryIt?.trial ?? null;
  },
  /** What is tried and drawn now, as plain numbers. */
  tried() {
    const { activation, head, mass, loads, status, stale, sections, extensions } = tryIt.trial;
    return { activation, head, mass, loads, status, stale, extensions, position: [...sections.position] };
  },
};

start();
