// Stub until the module is there.
export async function loadPhysics() {
  return { trunk: (tables) => new StubRod(tables) };
}
class StubRod {
  constructor(tables) { this.tables = tables; }
  solve({ activation, head, loads }) {
    const n = this.tables.Z.length;
    const bend = activation.reduce((sum, a, i) => sum + a * this.tables.muscles[i].strain[2], 0);
    if (Math.abs(bend) > 8) return { status: "no-equilibrium" };
    const position = new Float64Array(3 * n), directors = new Float64Array(9 * n);
    let [x, z, angle, last] = [0, 0, 0.5 + head[1], 0];
    for (let j = 0; j < n; j++) {
      const step = this.tables.Z[j] - last;
      last = this.tables.Z[j];
      angle += step * (bend * 0.3 - 0.4 - 0.0002 * loads.tip_force[2]);
      x += step * Math.sin(angle); z += step * Math.cos(angle);
      position.set([x, 0, z], 3 * j);
      directors.set([Math.cos(angle), 0, -Math.sin(angle), 0, 1, 0, Math.sin(angle), 0, Math.cos(angle)], 9 * j);
    }
    return { status: "ok", position, directors, scale: 1, margin: 0.5 - Math.abs(bend) / 16, start: {} };
  }
  follow({ Z, target, activation, head, loads, bounds }) {
    const j = this.tables.Z.findIndex((z) => z >= Z - 1e-9);
    let best = null;
    for (const da of [-0.02, 0, 0.02]) for (const dh of [-0.01, 0, 0.01]) {
      const a = activation.map((v, i) => Math.min(Math.max(v + da, bounds.lower[i]), bounds.upper[i]));
      const h = [head[0], Math.min(Math.max(head[1] + dh, bounds.lower.at(-1)), bounds.upper.at(-1))];
      const s = this.solve({ activation: a, head: h, loads });
      if (s.status !== "ok") continue;
      const error = Math.hypot(...target.map((t, c) => s.position[3 * j + c] - t));
      if (!best || error < best.error - 1e-9) best = { ...s, activation: a, head: h, error, reached: error < 0.01 };
    }
    return best;
  }
}
