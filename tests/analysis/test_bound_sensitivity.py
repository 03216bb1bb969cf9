"""What more of a bound would bring: first-order responses against plans with the bound moved."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plans import TOUCH, first_steps, written

from trunk_ocp.analysis.bound_sensitivity import RELAXATION, responses
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.ipopt_options import WARM_OPTIONS
from trunk_ocp.nlp.window import Window
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.motion import Bounds, allowed
from trunk_ocp.problem.weights import Weights

pytestmark = pytest.mark.slow

SHARE = 0.1  # of the told move, by which bounds are really moved, both ways


def lift():
    """Three steps of lift-log with a tighter extension: every kind of bound binds."""
    return replace(first_steps("lift-log", 3), extension=(0.75, 1.35))


@cache
def planned_lift(lookahead):
    return plan_motion(lift(), lookahead, throw=False)


def one_target(folder, bounds, target="[0.6, 0.1, 1.2]", direction=""):
    text = TOUCH.replace("[bounds]\nactivation = [-3.0, 0.0]", f"[bounds]\n{bounds}")
    return load_motion(written(folder, text.replace("[0.6, 0.1, 1.2]", f"{target}{direction}")))


def with_boxes(motion, change):
    """The motion with every box of bounds changed, its own and the steps'."""
    steps = tuple(replace(step, box=change(step.box)) for step in motion.steps)
    return replace(motion, steps=steps, box=change(motion.box))


def moved(motion, response, share):
    """The motion with the bound of a response moved by a share of what the response tells."""
    names = (*motion.trunk.muscles, "psi_Z", "psi_Y")
    by = share * response.moved
    if response.name.startswith("extension"):
        low, high = motion.extension
        ends = (low + by, high) if response.value == low else (low, high + by)
        return replace(motion, extension=ends)
    i = names.index(response.name.split()[-1])
    by = np.radians(by) if i >= len(names) - 2 else by
    value = np.radians(response.value) if i >= len(names) - 2 else response.value

    def nudged(box):
        ends = [box.lower.copy(), box.upper.copy()]
        end = ends[response.moved > 0]
        # In another phase the bound may be another one, which moves by the same share of itself.
        end[i] += by * (end[i] / value if np.isfinite(end[i]) and value else 1.0)
        return Bounds(*ends)

    if response.name.startswith("change"):
        steps = [replace(step, change=nudged(step.change)) for step in motion.steps]
        return replace(motion, steps=tuple(steps))
    return with_boxes(motion, nudged)


def optimum(plan, motion, first, last):
    """Distances at all targets of steps first to last - 1, and the objective, solved anew."""
    steps = list(motion.steps[first:last])
    if first in plan.auxiliary:
        anything = Bounds(-np.full(plan.x.shape[1], np.inf), np.full(plan.x.shape[1], np.inf))
        box = allowed(motion, steps[0], plan.auxiliary[first])
        steps = [replace(steps[0], box=box, change=anything)]
    before = plan.x[first - 1] if first else np.zeros(plan.x.shape[1])
    window = Window(motion, plan.mesh, steps, before, {}, first, plan.weights)
    start = window.pack(plan.x[first:last], plan.part(first, last))
    outcome = Optimizer(ipopt=WARM_OPTIONS | {"tol": 1e-11}).solve(window, start, "test", "moved")
    assert outcome.converged
    distances = [
        np.linalg.norm(motion.trunk.length * outcome.full[u.points[g.Z][1]] - g.position)
        for step, u in zip(steps, window.unknowns, strict=True)
        for g in step.targets
        if g.position is not None
    ]
    return np.array(distances), outcome.objective


def measured(plan, response, first, last, shares=(SHARE, -SHARE)):
    """(worst, mean, objective) of a response as `Response` has them, by a difference."""
    here, J = optimum(plan, plan.motion, first, last)
    (ahead, more), (behind, less) = (
        optimum(plan, moved(plan.motion, response, share), first, last) for share in shares
    )
    slope = (ahead - behind) / (shares[0] - shares[1])
    return slope[np.argmax(here)], slope.mean(), (more - less) / (shares[0] - shares[1]) / J


def told(response):
    """(worst, mean, objective) as a response has them."""
    return response.worst, response.mean, response.objective


def about(figures, rel=0.01):
    """What is as good as these figures; 0.02 um of a distance count as nothing."""
    worst, mean, objective = figures
    distances = (pytest.approx(distance, rel=rel, abs=2e-8) for distance in (worst, mean))
    return (*distances, pytest.approx(objective, rel=rel))


KINDS = ("extension of segment 1", "contraction of L3-dr", "change of head psi_Y", "head psi_Z")


@pytest.mark.parametrize("name", KINDS)
def test_a_horizon_answers_as_if_the_bound_were_moved(name):
    plan = planned_lift(None)
    found = {response.name: response for response in responses(plan)}
    assert told(found[name]) == about(measured(plan, found[name], 0, 3))
    assert found[name].objective < 0


@pytest.mark.parametrize(
    ("name", "step"), [("extension of segment 1", 3), ("contraction of R3-dr", 1)]
)
def test_each_step_of_a_sequential_plan_answers_for_itself(name, step):
    plan = planned_lift(1)
    (found,) = (r for r in responses(plan) if (r.name, r.steps) == (name, (step,)))
    assert told(found) == about(measured(plan, found, step - 1, step))
    assert found.objective < 0


def test_what_appendix_b_holds_near_an_unloaded_solution_is_told_apart():
    plan = planned_lift(1)
    near = [r for r in responses(plan) if "held near its unloaded value" in r.name]
    assert near
    for r in near:  # the head may not move at all away from the unloaded optimum
        angle = plan.auxiliary[r.steps[0] - 1][-2 if "psi_Z" in r.name else -1]
        assert r.value == pytest.approx(np.degrees(angle), abs=1e-9)


def test_what_is_told_goes_outwards_and_names_the_bound(tmp_path):
    for r in responses(planned_lift(None)):
        assert abs(r.moved) == pytest.approx(RELAXATION * abs(r.value), rel=1e-12)
        if not r.name.startswith("extension"):  # outward is away from 0, but for extension
            assert np.sign(r.moved) == np.sign(r.value)
    low = {r.name: r for r in responses(planned_lift(None))}["extension of segment 1"]
    assert (low.value, low.moved) == (0.75, pytest.approx(-0.0075))
    objectives = [r.objective for r in responses(planned_lift(None))]
    assert objectives == sorted(objectives)


def test_a_bound_that_does_not_bind_has_no_response(tmp_path):
    motion = one_target(tmp_path, "activation = [-3.0, 0.0]")
    plan = plan_motion(motion, throw=False)
    assert plan.activations.min() > -2.9
    assert responses(plan) == ()
    tight = one_target(tmp_path, "activation = [-0.1, 0.0]")
    plan = plan_motion(tight, throw=False)
    at = {name for name, x in zip(tight.trunk.muscles, plan.activations[0], strict=True)
          if x < -0.1 + 1e-6}  # fmt: skip
    assert at
    assert {r.name.removeprefix("contraction of ") for r in responses(plan)} == at


@pytest.mark.parametrize("lookahead", [1, None])
def test_a_plan_of_one_step_answers_alike_either_way(tmp_path, lookahead):
    plan = plan_motion(one_target(tmp_path, "activation = [-0.1, 0.0]"), lookahead, throw=False)
    found = responses(plan)[0]
    assert told(found) == about(measured(plan, found, 0, 1))
    assert found.objective < 0


@pytest.mark.parametrize("held", [-0.1, -0.6])
def test_a_muscle_held_at_a_value_answers_for_the_side_to_which_it_would_go(tmp_path, held):
    """A fixed unknown has no multiplier of its own; which of its two bounds binds follows."""
    bounds = f'activation = [-3.0, 0.0]\nmuscles = {{ "L2-dl" = [{held}, {held}] }}'
    plan = plan_motion(one_target(tmp_path, bounds))
    (found,) = (r for r in responses(plan) if "L2-dl" in r.name)
    assert (found.name, found.value) == ("contraction of L2-dl", held)
    free = plan_motion(one_target(tmp_path, "activation = [-3.0, 0.0]"))
    wanted = free.activations[0, free.motion.trunk.muscles.index("L2-dl")]
    assert np.sign(found.moved) == np.sign(wanted - held)
    assert told(found) == about(measured(plan, found, 0, 1, (SHARE, 0.0)), rel=0.02)
    assert found.objective < 0


def test_a_muscle_that_would_push_is_not_told(tmp_path):
    """Rest is no choice of the problem's: no response for any upper bound of 0."""
    plan = plan_motion(one_target(tmp_path, "activation = [-0.1, 0.0]"), throw=False)
    resting = np.flatnonzero(plan.activations[0] > -1e-6)
    assert resting.size
    names = {r.name for r in responses(plan)}
    assert not names & {f"contraction of {plan.motion.trunk.muscles[i]}" for i in resting}


def test_plans_that_are_no_optimum_have_no_responses(tmp_path):
    motion = one_target(tmp_path, "activation = [-0.1, 0.0]")
    plan = plan_motion(motion, throw=False)
    assert responses(plan)
    assert responses(replace(plan, converged=False)) == ()
    assert responses(replace(plan, mode="receding")) == ()
    elsewhere = with_boxes(motion, lambda box: Bounds(2 * box.lower, box.upper))
    assert responses(replace(plan, motion=elsewhere)) == ()


def test_many_optima_at_once_are_no_trouble(tmp_path):
    """Without effort and rate 16 directions of activation change nothing: a singular system."""
    motion = one_target(tmp_path, "activation = [-0.1, 0.0]", "[0.6, 0.1, 0.2]")
    nothing = Weights(effort=0.0, rate=0.0)
    plan = plan_motion(motion, options=Options(weights=nothing), throw=False)
    for r in responses(plan):
        assert np.all(np.isfinite([r.worst, r.mean, r.objective]))
    assert plan.converged
