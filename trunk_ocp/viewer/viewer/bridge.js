// What the page says to whoever shows it: a server of live plans, or a notebook around an iframe.

/**
 * Events of the page, by name:
 *
 * - "ready" {}: the page shows its first plan.
 * - "time" {time}: the instant in s that is shown.
 * - "controls" {activation, head, time}: what the user set; angles in rad.
 * - "drag" {what: "target" or "trunk", name, position, done}: a target, by its name in the problem
 *   file, or a point of the trunk ("Z = 1.75") is pulled to a position in m; `done` when let go.
 *
 * Nobody listens by default. Only a live page has targets that can be dragged.
 */
export const bridge = {
  handlers: new Map(),

  /** Call `handler(detail)` at every event of a name; returns a function that ends that. */
  on(name, handler) {
    const handlers = this.handlers.get(name) ?? new Set();
    this.handlers.set(name, handlers.add(handler));
    return () => handlers.delete(handler);
  },

  emit(name, detail) {
    for (const handler of this.handlers.get(name) ?? []) handler(detail);
  },
};

/**
 * Connect the page to the window around it, if it is in an iframe.
 *
 * Events go out as messages {trunkPage: name, detail}. Messages of the same form, from that window
 * only, call the function of that name in `commands`.
 */
export function connectParent(commands, names = ["ready", "time", "controls", "drag"]) {
  if (window.parent === window) return;
  const send = (name, detail) => window.parent.postMessage({ trunkPage: name, detail }, "*");
  for (const name of names) bridge.on(name, (detail) => send(name, detail));
  addEventListener("message", ({ source, data }) => {
    const known = typeof data?.trunkPage === "string" && Object.hasOwn(commands, data.trunkPage);
    if (source === window.parent && known) commands[data.trunkPage](data.detail);
  });
}
