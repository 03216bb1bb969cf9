// The page of `trunk-ocp live`: changes go to the planner, new plans come back.

/* global trunkPage */
import { bridge } from "./bridge.js";
import { byId, setText } from "./elements.js";
import { readPayload } from "./data.js";
import { buildLivePanel, writeHint } from "./live_panel.js";
import { TargetDrag } from "./targets_drag.js";

const MOST_DELAYS = 10000; // that are kept
const ENDED = "The planner has ended. Start trunk-ocp live again to go on.";

/** The planner at the other end of a socket. One drag is on its way at a time, then the newest. */
class Planner {
  constructor(receive) {
    this.sent = 0; // the number of the last message
    this.answered = 0;
    this.waiting = null; // the newest drag that was not sent yet
    this.sentAt = null; // time in ms of the event behind the last message, until its plan is there
    this.socket = new WebSocket(`ws://${location.host}/socket${location.search}`);
    this.socket.addEventListener("message", ({ data }) => {
      const update = JSON.parse(data);
      receive(update);
      this.answered = Math.max(this.answered, update.answers ?? 0);
      if (this.waiting && this.answered === this.sent) this.send(this.waiting);
    });
    this.socket.addEventListener("close", () => receive({ status: { text: ENDED, state: "bad" } }));
  }

  /** Send a change; `at` is the time in ms of the event behind it. */
  send({ at, ...change }) {
    this.waiting = null;
    this.sent += 1;
    this.sentAt = at;
    if (this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(JSON.stringify({ n: this.sent, ...change }));
    }
  }

  drag(change) {
    if (change.drag.done || this.answered === this.sent) this.send(change);
    else this.waiting = change;
  }
}

/** Shows what the planner says on a page (`trunkPage` of main.js). */
class LivePage {
  constructor(page) {
    this.page = page;
    const { plans, ...about } = readPayload();
    this.about = about;
    this.plan = plans[0]; // as received; `page.plans` has it decoded
    this.delays = []; // from an event to its plan on the screen, in ms
    this.planner = new Planner((update) => this.receive(update));
    buildLivePanel(this.plan, (change) => this.planner.send({ at: performance.now(), ...change }));
    bridge.on("drag", ({ what, at, name, position, done }) => {
      if (what === "target") this.planner.drag({ at, drag: { name, position, done } });
    });
    new TargetDrag(byId("canvas"), page);
  }

  receive({ plan, status, fault, answers }) {
    if (plan) this.change(plan);
    if (status) this.say(status);
    if (plan || (status && status.state !== "busy")) this.show(status?.state === "open");
    if (fault !== undefined) setText(byId("live-fault"), fault.replace(/^(message|live):\s*/, ""));
    if (plan && answers === this.planner.sent) this.measure();
  }

  /** Show the plan; where a frame takes long, the plots wait until nothing is dragged. */
  show(dragged) {
    const quick = dragged && this.page.stage?.software;
    this.page.showPlan({ ...this.about, plans: [{ ...this.plan, trunk: null }] }, { quick });
  }

  change({ shown, ...changes }) {
    const { solids: before } = this.page.plans[0]; // decoded
    const solids = before.map((solid, i) => ({ ...solid, shown: shown?.[i] ?? solid.shown }));
    this.plan = { ...this.plan, ...changes, solids };
    if (changes.handles) writeHint(changes.handles);
  }

  say({ text, state, objective = null }) {
    setText(byId("live-status"), text);
    byId("live-status").dataset.state = state;
    this.plan = { ...this.plan, status: text, solved: state !== "bad", objective };
  }

  /** Note how long the first plan after an event took until it was drawn. */
  measure() {
    const at = this.planner.sentAt;
    if (at === null) return;
    this.planner.sentAt = null;
    requestAnimationFrame(() => {
      this.delays.push(performance.now() - at);
      if (this.delays.length > MOST_DELAYS) this.delays.shift();
    });
  }
}

trunkPage.live = new LivePage(trunkPage);
