"""How much work the planner needs, in counts that no noise touches."""

import numpy as np
import pytest
from plans import MOTIONS, first_steps, planned, shipped

from trunk_ocp.nlp import ipopt as solver
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.planning import planner
from trunk_ocp.planning.decided_steps import DecidedSteps
from trunk_ocp.planning.options import Options, first_mesh
from trunk_ocp.planning.planning_run import PlanningRun

# Iterations of each of the sequential plan's solves, and of the horizon from there. Seen were
# 16, 17 and 14; 28, 21 and 20; a third to spare for other processors.
EACH_SOLVE = 21
MOST = {"lift-log": 38, "lift-log-asymmetric": 28, "pick-fruit": 28}


@pytest.mark.parametrize("name", MOTIONS)
def test_iterations_of_a_plan(name):
    sequential, horizon = planned(name, "sequential"), planned(name, "horizon")
    solves = sum(1 + (step.auxiliary is not None) for step in shipped(name).steps)
    assert 0 < sequential.iterations <= EACH_SOLVE * solves
    assert 0 < horizon.iterations - sequential.iterations <= MOST[name]


def test_evaluations_of_an_iteration(monkeypatch):
    """One Hessian, one Jacobian and hardly more than one value each: few steps are cut."""
    seen = []
    monkeypatch.setattr(solver, "derivative_seconds", lambda stats: seen.append(stats) or 0.0)
    motion = shipped("lift-log-asymmetric")
    planner.plan_motion(motion, start=planned(motion.name, "sequential"))
    (stats,) = seen
    iterations = stats["iter_count"]
    assert stats["n_call_nlp_hess_l"] <= iterations + 1
    assert stats["n_call_nlp_jac_g"] <= iterations + 3
    assert stats["n_call_nlp_f"] <= 1.3 * iterations + 3


@pytest.mark.parametrize("name", MOTIONS)
def test_graphs_do_not_grow_with_the_steps(name):
    """Four steps or eight: the same few operations on longer vectors."""

    def operations(count):
        motion, options = first_steps(name, count), Options()
        mesh = first_mesh(motion, options)
        one = PlanningRun(motion, mesh, "horizon", count, options, Optimizer())
        nlp = one.window(0, motion.steps, DecidedSteps()).nlp
        return [f.n_instructions() for f in nlp.derivatives().values()]

    few, more = operations(4), operations(8)
    assert np.all(np.array(more) <= np.array(few))
    assert max(more) < 250


def test_unknowns_of_a_step():
    """What MUMPS gets to see: proportional to the steps, some 300 unknowns each."""
    motion, options = shipped("lift-log"), Options()
    mesh = first_mesh(motion, options)
    sizes = []
    for count in (5, 10):
        one = PlanningRun(motion, mesh, "horizon", count, options, Optimizer())
        nlp = one.window(0, motion.steps[:count], DecidedSteps()).nlp
        hessian = nlp.derivatives()["hess_lag"].sparsity_out(0)
        sizes.append((*nlp.size, hessian.nnz()))
    few, many = np.array(sizes)
    np.testing.assert_allclose(many / few, 2.0, atol=0.05)
    assert many[0] <= 10 * 310
