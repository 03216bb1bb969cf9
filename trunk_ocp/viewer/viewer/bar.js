// The bar with time: play, slider, speed; and the labels over the views.

import { instantAt, mixedRow, phaseAt } from "./data.js";
import { byId, setText } from "./elements.js";
import { short } from "./plots.js";

/** Connect the bar's elements to a clock. */
export function listenToBar(clock, { seek, toggle, resetView, help }) {
  byId("play").addEventListener("click", toggle);
  byId("time").addEventListener("input", () => seek(byId("time").valueAsNumber));
  byId("speed").addEventListener("change", () => (clock.speed = Number(byId("speed").value)));
  byId("loop").addEventListener("change", () => (clock.loop = byId("loop").checked));
  byId("reset").addEventListener("click", resetView);
  byId("help-button").addEventListener("click", help);
}

export function writeBar(clock, plans) {
  const { time, playing, duration } = clock;
  const phase = phaseAt(plans[0], time);
  const now = time.toFixed(2);
  const justJumped = ({ jumps }) => jumps.some((t) => t < time && t.toFixed(2) === now);
  const jumped = !playing && plans.some(justJumped);
  const label = `${now} of ${duration.toFixed(2)} s${jumped ? ", just after" : ""}`;
  setText(byId("now"), label);
  setText(byId("phase"), phase);
  const slider = byId("time");
  slider.max = duration;
  slider.value = time;
  slider.setAttribute("aria-valuetext", `${label}, ${phase}`);
  const name = playing ? "Pause" : "Play";
  if (byId("play").getAttribute("aria-label") !== name) {
    byId("play").setAttribute("aria-label", name);
    byId("play").dataset.playing = playing;
  }
}

/** A label over every view that names its plan. */
export function writeLabels(plans) {
  byId("labels").replaceChildren(...plans.map(planLabel));
}

function planLabel(plan) {
  const label = document.createElement("div");
  if (!plan.still) {
    const cost = plan.objective === null ? "" : `, J = ${short(plan.objective)}`;
    label.appendChild(document.createElement("strong")).textContent = plan.label;
    const words = label.appendChild(document.createElement("span"));
    words.className = "plan-only"; // as what is tried has neither
    words.append(`${cost}; `);
    const status = words.appendChild(document.createElement("span"));
    status.className = plan.solved ? "" : "unsolved";
    status.textContent = plan.solved ? plan.status : `NOT SOLVED: ${plan.status}`;
  }
  label.appendChild(document.createElement("div")).className = "head";
  return label;
}

/** Put labels over their views, with the head's angles. */
export function placeLabels(plans, stage, time) {
  plans.forEach((plan, i) => {
    const label = byId("labels").children[i];
    const { x, y, width } = stage.views[i];
    label.style.transform = `translate(${x}px, ${y}px)`;
    label.style.maxWidth = `${width}px`;
    label.dataset.tried = Boolean(stage.scenes[i].tried);
    const angles = stage.scenes[i].tried?.head ?? mixedRow(plan.head, 2, instantAt(plan, time));
    const [psiZ, psiY] = angles.map((angle) => (angle * 180) / Math.PI);
    setText(label.lastChild, `head: \u03c8Z ${degrees(psiZ)}, \u03c8Y ${degrees(psiY)}`);
  });
}

export function degrees(angle) {
  return `${(Math.abs(angle) < 0.05 ? 0 : angle).toFixed(1).replace("-", "\u2212")}\u00b0`;
}
