"""Weights of the costs beside tracking, in the NLP of a window."""

import numpy as np
import pytest
from scenes import ARM

from trunk_ocp.nlp.window import Window
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.statics import solve_statics

STEPS = 3
SPEC = ProblemSpec.model_validate(
    {
        "name": "bend",
        "bounds": {"activation": (-2.0, 0.0), "extension": (0.5, 1.5)},
        "phases": (
            {
                "name": "bend",
                "duration": 0.9,
                "steps": STEPS,
                "free_steps": 1,
                "targets": ({"Z": 1.0, "position": (0.4, 0.0, 0.7), "d3": (1.0, 0.0, 0.0)},),
            },
        ),
    }
)
MOTION = build_motion(SPEC, ARM)
MESH = mesh_for(MOTION.trunk, None, 2, 4)


def window(motion, weights=None):
    previous = np.zeros(len(motion.trunk.muscles) + 2)
    return Window(motion, MESH, motion.steps, previous, {}, 0, weights or motion.weights)


@pytest.fixture(scope="module")
def drawn():
    """Controls (steps, muscles + 2) of all steps and the decision vector of their equilibria."""
    rng, count = np.random.default_rng(5), len(MOTION.trunk.muscles)
    steps = len(MOTION.steps)
    x = np.hstack([-0.3 * rng.random((steps, count)), 0.2 * rng.random((steps, 2))])
    shapes = solve_statics(MOTION.trunk, x[:, :-2], x[:, -2:], MOTION.steps[0].loads, MESH)
    return x, window(MOTION).pack(x, shapes)


def objective(w, full):
    return float(w.nlp.derivatives()["grad_f"](full, w.nlp.parameters)[0])


def test_each_cost_is_its_sum_by_hand(drawn):
    x, full = drawn
    muscles, working = MOTION.trunk.muscles, x[1::2]  # the others are free of targets and effort
    dorsal = np.array(["dorsal" in name for name in muscles])
    nothing = objective(window(MOTION, Weights(0.0, 0.0)), full)
    squares, angles = working[:, :-2] ** 2, working[:, -2:] ** 2
    change = np.diff(x, axis=0, prepend=0.0)
    for weights, expected in (
        (Weights(3.0, 0.0), 3.0 * squares.sum()),
        (Weights({"*": 3.0, "*-dorsal": 5.0}, 0.0),
         3.0 * squares.sum() + 2.0 * squares[:, dorsal].sum()),
        (Weights(0.0, 7.0), 7.0 * (change**2).sum() / 0.15),
        (Weights(0.0, 0.0, 11.0), 11.0 * angles.sum()),
    ):  # fmt: skip
        cost = objective(window(MOTION, weights), full) - nothing
        assert cost == pytest.approx(expected, rel=1e-9)


def test_the_factor_of_the_last_step_multiplies_its_tracking(drawn):
    """Affine in the factor, with a slope that is the tracking of the last step alone."""
    _, full = drawn
    none = Weights(0.0, 0.0)
    tracking = [
        objective(window(MOTION.weighted(terminal=factor), none), full) for factor in (1, 2, 5)
    ]
    w = window(MOTION, none)
    *_, position, direction = w.goals()
    errors = [
        float(goal.function(full[goal.variables], np.append(goal.parameters, goal.weight)))
        for goal in (position, direction)
    ]
    assert tracking[1] - tracking[0] == pytest.approx(sum(errors), rel=1e-9)
    assert tracking[2] - tracking[0] == pytest.approx(4 * sum(errors), rel=1e-9)


def test_edited_motions_have_the_structure_that_a_replanner_accepts():
    expected = window(MOTION)
    others = (
        MOTION.retarget(position=(0.3, 0.1, 0.6), d3=(0, 1, 0), position_weight=3),
        MOTION.retarget(through=np.arange(9.0).reshape(3, 3) / 9),
        MOTION.with_loads(tip_force=(1, 2, 3), gravity=1.6),
        MOTION.weighted({"*": 1e-4, "*-dorsal": 1e-2}, 1e-3, 1e-3, terminal=4),
        MOTION.shifted((0.1, 0.0, 0.0)),
    )
    for motion in others:
        other = window(motion)
        assert other.structure == expected.structure
        assert not np.array_equal(other.parameters, expected.parameters)


def test_symmetry_is_a_row_for_each_pair_of_muscles(drawn):
    x, full = drawn
    w = window(MOTION.weighted(symmetric=True))
    blocks = [block for block in w.blocks if block.meaning.name == "symmetry"]
    assert [block.step for block in blocks] == list(range(len(MOTION.steps)))
    g = np.asarray(w.nlp.linear @ full)
    half = len(MOTION.trunk.muscles) // 2  # the right side comes first
    for block, row in zip(blocks, x, strict=True):
        np.testing.assert_allclose(g[block.rows], row[:half] - row[half:-2], atol=1e-15)
        assert np.all(w.bounds["lbg"][block.rows - 1] == 0)
        assert np.all(w.bounds["ubg"][block.rows - 1] == 0)
