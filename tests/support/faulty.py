"""solve-motion, with a fault at a moment of our choosing: `faulty.py FAULT MOMENT COUNT ...`.

FAULT is KILL (as by kill -9), INT (as by Ctrl-C) or TWICE (Ctrl-C two times at once). It comes at
the COUNT-th time of MOMENT: `window` after one is kept, `keeping` amid that, `iteration` of the
optimizer, `drawing`, `reading` the problem, `beginning` to plan, or the name of a file, just before
it is in its place.
"""

import os
import signal
import sys
import threading
from pathlib import Path

import trunk_ocp.cli.run_figures
from trunk_ocp.cli import commands, progress
from trunk_ocp.cli import solve as cli
from trunk_ocp.planning import checkpoint

FAULT, MOMENT, COUNT = sys.argv[1], sys.argv[2], int(sys.argv[3])
left = COUNT


def strike():
    global left
    left -= 1
    if left == 0:
        name = signal.SIGKILL if FAULT == "KILL" else signal.SIGINT
        for _ in range(2 if FAULT == "TWICE" else 1):
            signal.raise_signal(name)


def before(owner, name, moment=lambda *arguments: True):
    real = getattr(owner, name)

    def struck(*arguments, **options):
        if moment(*arguments):
            strike()
        return real(*arguments, **options)

    setattr(owner, name, struck)


def after(owner, name):
    real = getattr(owner, name)

    def struck(*arguments, **options):
        result = real(*arguments, **options)
        strike()
        return result

    setattr(owner, name, struck)


def draw(*arguments, real=trunk_ocp.cli.run_figures.draw_run):
    threading.Timer(1.5, strike).start() if FAULT == "KILL" else strike()
    return real(*arguments)


if __name__ == "__main__":
    if MOMENT == "window":
        after(checkpoint.Checkpoint, "save")
    elif MOMENT == "keeping":
        before(Path, "rename")
    elif MOMENT == "iteration":
        before(progress.ProgressDisplay, "iteration")
    elif MOMENT == "beginning":
        before(checkpoint.Checkpoint, "enter")
    elif MOMENT == "reading":
        before(cli, "load_problem")
    elif MOMENT == "drawing":
        trunk_ocp.cli.run_figures.draw_run = draw
    else:
        before(os, "replace", lambda source, target: Path(target).name == MOMENT)
    sys.argv[1:4] = []
    commands.solve()
