"""Rows found by exchange against all candidate rows at once, and what exchange must not do."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import ARM

from trunk_ocp.contact import exchange as module
from trunk_ocp.contact.exchange import Exchange
from trunk_ocp.nlp import gap_functions
from trunk_ocp.nlp.gap_rows import GapRow
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.ipopt_options import CONTACT_OPTIONS, DEFAULT_OPTIONS
from trunk_ocp.planning.options import Options, first_mesh
from trunk_ocp.planning.planning_run import PlanningRun
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec

PLACES = np.linspace(0.0, 1.0, 33)
"""Where all rows are, and of pairs at every second; exchange, too, may choose these only."""


@pytest.fixture(autouse=True)
def sharp(monkeypatch):
    """Rows as sharp as the gaps of the check, so that both see the same candidates bind."""
    functions = (gap_functions.solid_gap, gap_functions.section_gap)
    monkeypatch.setattr(gap_functions, "TILT", 1e-5)
    for function in functions:
        function.cache_clear()
    yield
    for function in functions:
        function.cache_clear()


def reaching(targets, contact, obstacles=(), **more):
    problem = {
        "name": "reach",
        "anatomy": "arm",
        "bounds": {
            "activation": (-3.0, 0.0),
            "extension": (0.5, 1.4),
            "head_z_deg": (-10.0, 10.0),
            "head_y_deg": (-10.0, 10.0),
        },
        "tolerance": {"position": 1.0},
        "obstacles": obstacles,
        "contact": contact,
        "phases": (
            {
                "name": "reach",
                "duration": 1.0,
                "interpolation": "none",
                "targets": tuple(targets),
            },
        ),
    } | more
    return build_motion(ProblemSpec.model_validate(problem), ARM)


def solved(motion, guess, rows, ipopt=CONTACT_OPTIONS):
    """The plan with these rows, from a guess, by tolerances tighter than usual."""
    options = Options()
    optimizer = Optimizer("mumps", 500, ipopt={**ipopt, "tol": 1e-10})
    mesh, count = first_mesh(motion, options), len(motion.steps)
    run = PlanningRun(motion, mesh, "horizon", count, options, optimizer, guess=guess, gaps=rows)
    plan = run.run()
    assert plan.converged
    return plan


def optimum(plan):
    """What the planner minimizes."""
    return plan.objective.total


def all_rows(motion):
    """A row at each place from each solid, or for each pair of places that are apart."""
    solids = motion.steps[0].solids
    if "self" not in motion.contact:
        return tuple(GapRow(Z, solid, None, 0.0) for solid in solids for Z in PLACES.tolist())
    places = PLACES[::2].tolist()
    pairs = [(a, b) for a in places for b in places if b - a >= 0.3]
    return tuple(GapRow(a, None, b, 0.0) for a, b in pairs)


def on_grid(row):
    return replace(
        row,
        Z=float(PLACES[np.argmin(np.abs(PLACES - row.Z))]),
        other=None if row.other is None else float(PLACES[np.argmin(np.abs(PLACES - row.other))]),
    )


def by_exchange(motion, guess, monkeypatch):
    """The plan whose rows exchange found among all places, round by round."""
    monkeypatch.setattr(module, "BRACKET", 0.0)
    monkeypatch.setattr(module, "STEP_TOL", 1e-10)
    exchange, plan = Exchange(motion, places=PLACES), solved(motion, guess, {})
    free = optimum(plan)
    for _ in range(30):
        if not exchange.add(plan.x, plan.shape):
            break
        rows = {t: tuple(dict.fromkeys(map(on_grid, rows))) for t, rows in exchange.rows.items()}
        plan = solved(motion, plan.x, rows)
    else:
        raise AssertionError("exchange did not end")
    return plan, exchange.count, free


BALL = {"name": "ball", "shape": "sphere", "center": (0.25, 0.02, 0.55), "radius": 0.1}
BOX = {
    "name": "box",
    "shape": "ellipsoid",
    "center": (0.3, 0.0, 0.5),
    "half_axes": (0.12, 0.2, 0.08),
    "rotation_deg": (10.0, 20.0, 30.0),
}


@pytest.mark.parametrize("body", [BALL, BOX], ids=["sphere", "ellipsoid"])
def test_exchange_finds_the_optimum_of_all_rows(body, monkeypatch):
    target = {"Z": 0.8, "position": (0.2, 0.02, 0.55)}
    motion = reaching([target], {"obstacles": True}, (body,))
    guess = np.zeros((1, 10))
    plan, count, free = by_exchange(motion, guess, monkeypatch)
    every = solved(motion, plan.x, {0: all_rows(motion)}, DEFAULT_OPTIONS)  # stays where it is
    assert optimum(plan) > free * (1 + 1e-3)  # the body costs something
    assert count <= 12
    assert optimum(plan) == pytest.approx(optimum(every), rel=1e-6)


def test_exchange_finds_the_optimum_of_all_pairs(monkeypatch):
    """A curl whose tip should be where the middle of the trunk should be, too."""
    place = (0.05, 0.0, 0.35)
    targets = [{"Z": 0.35, "position": place}, {"Z": 1.0, "position": place}]
    motion = reaching(targets, {"self": True})
    guess = np.zeros((1, 10))
    plan, count, free = by_exchange(motion, guess, monkeypatch)
    every = solved(motion, plan.x, {0: all_rows(motion)}, DEFAULT_OPTIONS)  # stays where it is
    assert optimum(plan) > free * (1 + 1e-3)
    assert 0 < count <= 30
    assert optimum(plan) == pytest.approx(optimum(every), rel=1e-6)
