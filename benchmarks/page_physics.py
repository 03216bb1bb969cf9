"""How fast the page's physics is in a browser: `python -m benchmarks.page_physics`.

Headless Chromium, the elephant with a mass at its tip: shapes after the change of a slider, with
and without a start, and frames of a dragged tip, within reach and beyond it. Wall times, so it
needs a quiet machine. A browser's clock has steps of 0.1 ms; slider shapes are timed ten at a time.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))
from physics_page import physics_tab

TIMES = """() => {
  const trunk = trunks.elephant;
  const muscles = trunk.muscles;
  const loads = { tip_force: [0, 0, 40] };
  const bounds = {
    lower: [...new Array(muscles).fill(-3), -0.3, -0.3],
    upper: [...new Array(muscles).fill(0), 0.3, 0.3],
    extension: [0.67, 1.35],
  };
  let state = 1;
  const random = () => (state = (state * 16807) % 2147483647) / 2147483647;
  const timed = (count, each, work) => Array.from({ length: count }, () => {
    const start = performance.now();
    for (let i = 0; i < each; i += 1) work();
    return (performance.now() - start) / each;
  });

  const activation = new Array(muscles).fill(-0.3);
  const rest = trunk.solve({ activation, head: [0, 0], loads });
  let shape = rest;
  const slide = () => {
    const muscle = Math.floor(muscles * random());
    activation[muscle] = Math.min(0, Math.max(-3, activation[muscle] + 0.1 * (random() - 0.5)));
  };
  const warm = () => {
    slide();
    shape = trunk.solve({ activation, head: [0, 0], loads, start: shape.start });
  };
  const cold = () => {
    slide();
    trunk.solve({ activation, head: [0, 0], loads });
  };

  const tip = Array.from(rest.position.slice(-3));
  const drag = (path) => {
    let now = { ...rest, activation: new Array(muscles).fill(-0.3), head: [0, 0] };
    let frame = 0;
    return () => {
      frame += 1;
      const target = path(frame / 60).map((x, i) => tip[i] + x);
      now = trunk.follow({ ...now, Z: 1.75, target, loads, bounds });
    };
  };
  const within = (t) => [0.25 * Math.sin(t), 0.2 * Math.sin(2 * t), 0.25 * (Math.cos(t) - 1)];
  const beyond = (t) => [1.5 * Math.sin(t), 0.5 * Math.sin(2 * t), 1.0 * (1 - Math.cos(t))];
  timed(300, 1, warm);
  timed(200, 1, drag(within));
  return {
    "shape after a slider": timed(300, 10, warm),
    "the same without a start": timed(100, 10, cold),
    "frame of a dragged tip": timed(2000, 1, drag(within)),
    "the same, mostly beyond reach": timed(2000, 1, drag(beyond)),
  };
}"""


def main() -> None:
    """Print medians, 99th percentiles and maxima in ms."""
    with tempfile.TemporaryDirectory() as folder, physics_tab(Path(folder)) as tab:
        found = tab.evaluate(TIMES)
    for name, times in found.items():
        median, slow = np.quantile(times, [0.5, 0.99])
        print(f"{name:32} median {median:.2f} ms, 99th {slow:.2f} ms, most {max(times):.2f} ms")


if __name__ == "__main__":
    main()
