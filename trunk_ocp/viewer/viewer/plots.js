// Activations over time, a panel for each segment: SVG curves, and a cursor at the current time.

import { activationRange } from "./data.js";

const MARGIN = { right: 12, top: 20, bottom: 22 };
const LETTER_WIDTH = 6.5; // px, about
const LEVELS = 4; // labeled grid lines, about
const HEIGHT = 150; // px, of a panel
const PICK_DISTANCE = 10; // px, from a curve
const STROKE = { plain: 1.6, selected: 4 }; // px

/** Plots of all plans; the pointer calls `seek(time)` and `pick(name or null)`. */
export class Plots {
  constructor(container, { seek, pick }) {
    this.container = container;
    this.actions = { seek, pick };
    this.panels = [];
  }

  /** Show plans; panels stay if the trunks are those of before, which takes less time. */
  setPlans(plans) {
    const axes = axesOf(plans);
    const same = this.trunks?.length === plans.length
      && plans.every(({ trunk }, i) => trunk === this.trunks[i]);
    this.trunks = plans.map(({ trunk }) => trunk);
    this.container.hidden = plans.every(({ still }) => still);
    if (!same) return this.build(plans, axes);
    this.headings.forEach((heading, i) => (heading.textContent = headingOf(plans[i])));
    for (const panel of this.panels) panel.setPlan(plans[panel.number], axes);
  }

  build(plans, axes) {
    this.container.replaceChildren();
    this.headings = [];
    this.panels = plans.flatMap((plan, number) => {
      const { section, heading } = planSection(this.container, plan);
      this.headings.push(heading);
      return segmentsOf(plan).map((segment) => {
        const panel = new Panel(plan, number, segment, axes, this.actions);
        section.append(panel.element);
        return panel;
      });
    });
  }

  show(time) {
    for (const panel of this.panels) panel.show(time);
  }

  dress(look) {
    for (const panel of this.panels) panel.dress(look);
  }
}

/** Range of activations, end of time and width of labels, the same for all panels. */
function axesOf(plans) {
  const range = activationRange(plans);
  const end = Math.max(...plans.map((plan) => plan.duration));
  const letters = Math.max(...ticks(...range, LEVELS).map((y) => short(y).length));
  return { range, end, left: 10 + LETTER_WIDTH * letters };
}

function planSection(container, plan) {
  const section = container.appendChild(document.createElement("section"));
  const heading = section.appendChild(document.createElement("h2"));
  heading.textContent = headingOf(plan);
  const panels = section.appendChild(document.createElement("div"));
  panels.className = "panels";
  if (!plan.trunk.muscles.length) panels.textContent = "This trunk has no muscles.";
  return { section: panels, heading };
}

function headingOf(plan) {
  return `${plan.label}: activations${plan.solved ? "" : " (NOT SOLVED)"}`;
}

/** Indices of the segments that have muscles. */
function segmentsOf(plan) {
  return [...new Set(plan.trunk.muscles.map((muscle) => muscle.segment))].sort((a, b) => a - b);
}

class Panel {
  constructor(plan, number, segment, axes, actions) {
    this.number = number; // of its plan
    this.segment = segment;
    this.actions = actions;
    this.time = 0;
    this.setPlan(plan, axes);
    this.build();
    this.listen();
    new ResizeObserver(() => this.redraw()).observe(this.element);
  }

  setPlan(plan, axes) {
    this.plan = plan;
    this.axes = axes;
    this.curves = curvesOf(plan, this.segment);
    this.width = 0; // so that all is drawn again
    if (this.element) this.redraw();
  }

  build() {
    this.element = document.createElement("figure");
    this.svg = this.element.appendChild(svg("svg", { role: "img", height: HEIGHT }));
    const names = this.curves.map(({ muscle }) => muscle.name).join(", ");
    const label = `${this.plan.label} plan, segment ${this.segment + 1}: activation over time of`;
    this.svg.setAttribute("aria-label", `${label} ${names}`);
    this.cursor = this.element.appendChild(document.createElement("div"));
    this.cursor.className = "cursor";
    this.cursor.style.top = `${MARGIN.top}px`;
    this.cursor.style.height = `${HEIGHT - MARGIN.top - MARGIN.bottom}px`;
  }

  x(time) {
    const { right } = MARGIN;
    const { left } = this.axes;
    return left + (time / this.axes.end) * (this.width - left - right);
  }

  /** Contraction, which is negative, is upward, as in the figures. */
  y(activation) {
    const [low, high] = this.axes.range;
    const { top, bottom } = MARGIN;
    return top + ((activation - low) / (high - low)) * (HEIGHT - top - bottom);
  }

  timeAt(x) {
    const { right } = MARGIN;
    const { left } = this.axes;
    return ((x - left) / (this.width - left - right)) * this.axes.end;
  }

  redraw() {
    const width = this.element.clientWidth;
    if (!width || width === this.width) return;
    this.width = width;
    this.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    this.svg.replaceChildren(...this.grid(), ...this.phases(), ...this.lines(), this.title());
    if (this.look) this.dress(this.look);
    this.show(this.time);
  }

  title() {
    return text(`Segment ${this.segment + 1}`, { x: this.axes.left, y: 13, class: "title" });
  }

  grid() {
    const { right, bottom } = MARGIN;
    const { left } = this.axes;
    const level = (value) => [
      svg("line", { x1: left, x2: this.width - right, y1: this.y(value), y2: this.y(value) }),
      text(short(value), { x: left - 5, y: this.y(value) + 4, "text-anchor": "end" }),
    ];
    const foot = HEIGHT - bottom + 15;
    const mark = (time, i, all) => {
      const label = i === all.length - 1 ? `${short(time)} s` : short(time);
      return text(label, { x: this.x(time), y: foot, "text-anchor": "middle" });
    };
    const [low, high] = this.axes.range;
    const times = ticks(0, this.axes.end, Math.max(3, Math.round(this.width / 70)));
    return [...ticks(low, high, LEVELS).flatMap(level), ...times.map(mark)];
  }

  /** Lines where one phase ends and the next begins. */
  phases() {
    const inner = this.plan.phases.filter(({ end }) => end < this.plan.duration - 1e-6);
    return inner.map(({ name, end }) => {
      const y2 = HEIGHT - MARGIN.bottom;
      const x = this.x(end);
      const line = svg("line", { x1: x, x2: x, y1: MARGIN.top, y2, class: "phase" });
      line.append(svg("title", {}));
      line.lastChild.textContent = `end of ${name}`;
      return line;
    });
  }

  lines() {
    this.paths = this.curves.map(({ muscle, values }) => {
      const { times, held } = this.plan;
      const points = values.flatMap((value, i) => {
        const point = `${this.x(times[i])},${this.y(value)}`;
        return held[i - 1] ? [`${this.x(times[i])},${this.y(values[i - 1])}`, point] : [point];
      });
      const path = svg("polyline", { points: points.join(" "), class: "curve" });
      path.dataset.muscle = muscle.name;
      if (muscle.side === "L") path.setAttribute("stroke-dasharray", "2 3");
      return path;
    });
    return this.paths;
  }

  show(time) {
    this.time = time;
    if (this.width) this.cursor.style.transform = `translateX(${this.x(time)}px)`;
  }

  dress(look) {
    this.look = look;
    this.paths?.forEach((path, i) => {
      const { muscle } = this.curves[i];
      const selected = look.selected === muscle.name;
      const faint = look.selected !== null && !selected;
      path.style.display = look.shows(muscle) ? "" : "none";
      path.style.stroke = look.colors.get(muscle.group);
      path.style.strokeWidth = STROKE[selected ? "selected" : "plain"];
      path.style.opacity = faint ? 0.22 : 1;
      path.classList.toggle("selected", selected);
    });
    const selected = this.svg.querySelector(".selected");
    if (selected) this.svg.append(selected); // on top
  }

  listen() {
    let dragging = false;
    const local = (event) => {
      const box = this.svg.getBoundingClientRect();
      return [event.clientX - box.x, event.clientY - box.y];
    };
    this.svg.addEventListener("pointerdown", (event) => {
      const [x, y] = local(event);
      const near = this.muscleNear(x, y);
      if (near) this.actions.pick(near === this.look.selected ? null : near);
      else this.actions.seek(this.timeAt(x));
      dragging = !near;
      if (dragging) this.svg.setPointerCapture(event.pointerId);
    });
    this.svg.addEventListener("pointermove", (event) => {
      if (dragging) this.actions.seek(this.timeAt(local(event)[0]));
      else this.svg.classList.toggle("over", Boolean(this.muscleNear(...local(event))));
    });
    for (const end of ["pointerup", "pointercancel"]) {
      this.svg.addEventListener(end, () => (dragging = false));
    }
  }

  /** Name of the visible muscle whose curve is nearest to a point, or null if none is near. */
  muscleNear(x, y) {
    let best = { distance: PICK_DISTANCE, name: null };
    for (const { muscle, values } of this.curves) {
      if (!this.look.shows(muscle)) continue;
      const distance = this.distance(values, x, y);
      if (distance < best.distance) best = { distance, name: muscle.name };
    }
    return best.name;
  }

  distance(values, x, y) {
    let least = Infinity;
    for (let i = 1; i < values.length; i++) {
      const { times } = this.plan;
      const a = [this.x(times[i - 1]), this.y(values[i - 1])];
      const b = [this.x(times[i]), this.y(values[i])];
      if (b[0] < x - PICK_DISTANCE || a[0] > x + PICK_DISTANCE) continue;
      least = Math.min(least, toSegment([x, y], a, b));
    }
    return least;
  }
}

function curvesOf(plan, segment) {
  const count = plan.trunk.muscles.length;
  return plan.trunk.muscles.flatMap((muscle, m) => {
    if (muscle.segment !== segment) return [];
    const values = Array.from(plan.times, (_, i) => plan.activation[i * count + m]);
    return [{ muscle, values }];
  });
}

function toSegment([x, y], a, b) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const fraction = ((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy || 1);
  const at = Math.min(Math.max(fraction, 0), 1);
  return Math.hypot(x - a[0] - at * dx, y - a[1] - at * dy);
}

/** About `count` round numbers from low to high. */
export function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((size) => size >= rough);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
}

export function short(value) {
  return String(Number(value.toPrecision(3))).replace("-", "\u2212");
}

/** An element of an SVG picture. */
export function svg(name, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

function text(content, attributes) {
  const element = svg("text", attributes);
  element.textContent = content;
  return element;
}
