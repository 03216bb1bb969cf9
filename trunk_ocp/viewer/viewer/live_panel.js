// What `trunk-ocp live` adds to the page: how the plan is doing, and bounds to change.

import { byId, setText } from "./elements.js";

const PANEL = `
  <legend>Plan again</legend>
  <p id="live-hint"></p>
  <p id="live-fault" role="alert"></p>
  <label>muscles <select id="live-muscles"><option value="*">all</option></select></label>
  <p>Bounds of their activation:</p>
  <label>from <input id="live-lower" type="number" step="0.1"></label>
  <label>to <input id="live-upper" type="number" step="0.1"></label>
  <label>change per s <input id="live-rate" type="number" step="0.1" min="0" placeholder="any"></label>
  <button id="live-reset" type="button">Undo all</button>`;

/** Build the panel; it calls `send(change)` with a change as in live_messages.py. */
export function buildLivePanel(plan, send) {
  const status = byId("stage").appendChild(document.createElement("output"));
  status.id = "live-status";
  const panel = document.createElement("fieldset");
  panel.id = "live";
  panel.innerHTML = PANEL;
  document.querySelector("aside").prepend(panel);
  addChoices(plan.trunk);
  showBounds(plan);
  byId("live-muscles").addEventListener("change", () => showBounds(plan));
  for (const id of ["live-lower", "live-upper"]) {
    byId(id).addEventListener("change", () => {
      const activation = ["live-lower", "live-upper"].map((end) => byId(end).valueAsNumber);
      if (activation.every(Number.isFinite)) send({ bound: { muscles: chosen(), activation } });
    });
  }
  byId("live-rate").addEventListener("change", () => {
    const largest = byId("live-rate").valueAsNumber;
    send({ speed: { largest: Number.isFinite(largest) ? largest : null } });
  });
  byId("live-reset").addEventListener("click", () => {
    byId("live-rate").value = "";
    showBounds(plan);
    send({ reset: true });
  });
}

/** Say what can be dragged: handles of live_payload.py, which come once the planner answers. */
export function writeHint(handles) {
  const logs = handles.some(({ name }) => name.endsWith(":log"));
  setText(byId("live-hint"), `Drag a target${logs ? ", or the log" : ""}.`);
}

function chosen() {
  return byId("live-muscles").value;
}

/** Groups, by a pattern of their muscles' names, and muscles. */
function addChoices({ colors, muscles }) {
  for (const group of Object.keys(colors)) byId("live-muscles").add(new Option(group, `*-${group}`));
  for (const { name } of muscles) byId("live-muscles").add(new Option(name, name));
}

/** Bounds of the chosen muscles in the problem file, over all time steps. */
function showBounds({ trunk, controls }) {
  const names = trunk.muscles.map(({ name }) => name);
  const ends = chosen().replace("*", "");
  const found = names.flatMap((name, i) => (name.endsWith(ends) ? [i] : []));
  const all = (key) => controls.boxes.flatMap((box) => found.map((i) => box[key][i]));
  byId("live-lower").value = Math.min(...all("lower"));
  byId("live-upper").value = Math.max(...all("upper"));
}
