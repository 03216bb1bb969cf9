"""Multipliers carried from one window to another with more rows, by what the rows state."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import ARM

from trunk_ocp.nlp.gap_rows import GapRow
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.ipopt_options import AGAIN_OPTIONS, CONTACT_OPTIONS
from trunk_ocp.nlp.warm_start import as_start, multipliers_of
from trunk_ocp.planning.decided_steps import DecidedSteps
from trunk_ocp.planning.options import Options, first_mesh
from trunk_ocp.planning.planning_run import PlanningRun
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec

BALL = {"name": "ball", "shape": "sphere", "center": (0.25, 0.02, 0.55), "radius": 0.1}
PROBLEM = {
    "name": "reach",
    "anatomy": "arm",
    "bounds": {"activation": (-3.0, 0.0), "extension": (0.5, 1.4)},
    "tolerance": {"position": 1.0},
    "obstacles": (BALL,),
    "contact": {"obstacles": True},
    "phases": (
        {
            "name": "reach",
            "duration": 1.0,
            "steps": 2,
            "targets": ({"Z": 0.8, "position": (0.2, 0.02, 0.55)},),
        },
    ),
}


@pytest.fixture(scope="module")
def run():
    motion = build_motion(ProblemSpec.model_validate(PROBLEM), ARM)
    optimizer = Optimizer("mumps", 300, ipopt=CONTACT_OPTIONS, warm=AGAIN_OPTIONS)
    options = Options()
    return PlanningRun(motion, first_mesh(motion, options), "horizon", 2, options, optimizer)


def window(run, places):
    ball = run.motion.steps[0].solids[0]
    rows = tuple(GapRow(Z, ball, None, 0.0) for Z in places)
    return replace(run, gaps={0: rows, 1: rows}).window(0, run.motion.steps, DecidedSteps())


def solved(run, of, **more):
    start = run.packed(of, np.zeros((2, run.controls)))
    outcome = run.optimizer.solve(of, more.pop("start", start), "horizon", "a test", **more)
    assert outcome.converged
    return outcome


def test_multipliers_survive_the_way_to_the_same_window(run):
    of = window(run, (0.6, 0.75))
    outcome = solved(run, of)
    start = as_start(of, multipliers_of(of, outcome))
    for name, values in start.items():
        known = np.asarray(outcome.multipliers[name]).ravel()
        if name == "lam_x0":
            known[of.previous] = 0.0  # these are fixed
        np.testing.assert_array_equal(values, known)


def test_a_window_with_more_rows_has_the_multipliers_of_those_it_shares(run):
    few, many = window(run, (0.6, 0.75)), window(run, (0.6, 0.75, 0.68))
    outcome = solved(run, few)
    start = as_start(many, multipliers_of(few, outcome))["lam_g0"]
    known = np.asarray(outcome.multipliers["lam_g0"]).ravel()
    for (row, step, index), (again, same, at) in zip(
        [entry for entry in many.gap_rows if entry[0].Z != 0.68], few.gap_rows, strict=True
    ):
        assert (row, step) == (again, same)
        assert start[index - 1] == known[at - 1]
    new = [index - 1 for row, _, index in many.gap_rows if row.Z == 0.68]
    assert np.all(start[new] == 0)
    assert np.abs(start).sum() == pytest.approx(np.abs(known).sum())


def test_a_solve_from_multipliers_ends_at_the_same_optimum_in_fewer_iterations(run):
    few, many = window(run, (0.6, 0.75)), window(run, (0.6, 0.75, 0.68))
    outcome = solved(run, few)
    start = run.packed(many, few.controls_of(outcome.full))
    cold = solved(run, many, start=start)
    known = as_start(many, multipliers_of(few, outcome))
    warm = solved(run, many, start=start, multipliers=known)
    assert warm.objective == pytest.approx(cold.objective, abs=1e-8)  # Ipopt's tolerance
    assert warm.iterations < cold.iterations
