"""Many starts: what is found, what counts as the same, and the mirror image of it all."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from plans import TOUCH, first_steps, shipped, with_phases, written
from toys import pointing, shortening

from trunk_ocp.analysis.multistart import (
    BETTER_RTOL,
    SAME_PLAN_TOL,
    Optima,
    distinct,
    find_optima,
    random_motion,
)
from trunk_ocp.cli import commands
from trunk_ocp.errors import InputError
from trunk_ocp.model.activation import strains
from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.planning.planner import plan_from, plan_motion
from trunk_ocp.problem.mirror import mirror_order, mirrored_controls, mirrored_motion
from trunk_ocp.rod.statics import solve_statics

ANGLE = 0.7  # rad, of the rod from +Z


@cache
def aimed():
    """A rod that its head alone may turn, from twelve starts."""
    return find_optima(pointing((np.sin(ANGLE), 0.0, np.cos(ANGLE))), starts=12, processes=1)


# --- a problem whose optima are known ------------------------------------------------------


def test_the_three_ways_of_a_head_are_found():
    """(psi_Z, psi_Y) and (psi_Z +- pi, -psi_Y) turn a rod to the same place."""
    heads = np.array([optimum.plan.head[0] for optimum in aimed().distinct])
    order = np.argsort(heads[:, 0])
    expected = [(-np.pi, -ANGLE), (0, ANGLE), (np.pi, -ANGLE)]
    np.testing.assert_allclose(heads[order], expected, atol=1e-3)


def test_the_best_comes_first_and_is_reported():
    first, *others = aimed().distinct
    np.testing.assert_allclose(first.plan.head[0], (0, ANGLE), atol=1e-3)
    # All reach the target; the head's rate is what differs: 1e-5 (pi^2 + angle^2) / 1 s.
    for other in others:
        more = other.plan.objective.total - first.plan.objective.total
        assert more == pytest.approx(1e-5 * np.pi**2, rel=1e-2)
    assert aimed().reported_is_best
    assert "reported" in first.starts


def test_every_start_is_accounted_for():
    starts = [name for optimum in aimed().distinct for name in optimum.starts]
    assert sorted([*starts, *aimed().failed]) == sorted(["reported", *aimed().plans])
    assert {"reported plan", "mirror image", "rest", "random 12"} <= set(aimed().plans)


def test_a_plan_that_is_not_the_best_is_told():
    worse = aimed().distinct[-1].plan
    assert worse.objective.total > aimed().reported.objective.total * (1 + BETTER_RTOL)
    assert not Optima(worse, aimed().plans).reported_is_best


def test_numbers_are_ready_for_json():
    report = json.loads(json.dumps(aimed().as_dict()))
    assert [round(entry["distance"], 2) for entry in report["optima"]] == [0.0, 3.14, 3.14]
    assert report["starts"] == 15
    assert report["same_within"] == SAME_PLAN_TOL


def test_plans_within_the_tolerance_count_as_one():
    plan = aimed().distinct[0].plan
    near = replace(plan, x=plan.x + 0.9 * SAME_PLAN_TOL)
    far = replace(plan, x=plan.x + 1.1 * SAME_PLAN_TOL)
    found = distinct([("a", plan), ("b", near), ("c", far)])
    # "c" is within the tolerance of "b", but "b" stands for no optimum of its own.
    assert [optimum.starts for optimum in found] == [("a", "b"), ("c",)]


# --- starts --------------------------------------------------------------------------------


def test_random_motions_keep_bounds_and_depend_on_the_seed_alone():
    motion = shipped("lift-log")
    x = random_motion(motion, np.random.default_rng(3))
    np.testing.assert_array_equal(x, random_motion(motion, np.random.default_rng(3)))
    assert np.abs(x - random_motion(motion, np.random.default_rng(4))).max() > 0.1
    assert x.shape == (10, 30)
    assert np.all((x[:, :28] >= -3.5) & (x[:, :28] <= 0))
    head = motion.steps[0].box
    assert np.all((x[:, 28:] >= head.lower[28:]) & (x[:, 28:] <= head.upper[28:]))
    zeta = strains(motion.trunk, x[:, :28])[..., 0]
    assert zeta.min() >= 0.67 - 1e-12
    assert zeta.max() <= 1.35 + 1e-12


@pytest.mark.parametrize("lookahead", [1, 2, None])
def test_an_optimum_leads_to_itself(lookahead):
    motion = shortening((-0.1, -0.8, -0.8), most=0.4)
    plan = plan_motion(motion, lookahead, throw=False)
    again = plan_from(motion, plan.x, lookahead)
    assert (again.mode, again.lookahead) == (plan.mode, plan.lookahead)
    np.testing.assert_allclose(again.x, plan.x, atol=1e-4)


def test_the_papers_sequential_solve_takes_starts_too():
    motion = first_steps("lift-log", 1)
    plan = plan_motion(motion, 1)
    again = plan_from(motion, plan.auxiliary[0][None], 1)
    assert set(again.auxiliary) == {0}
    assert again.objective.total == pytest.approx(plan.objective.total, rel=1e-4)


# --- the mirror ----------------------------------------------------------------------------


def test_muscles_swap_sides_and_nothing_else():
    trunk = load_anatomy("asian-elephant")
    order = mirror_order(trunk)
    assert [trunk.muscles[i] for i in order] == [
        {"R": "L", "L": "R"}[name[0]] + name[1:] for name in trunk.muscles
    ]
    x = np.random.default_rng(0).normal(size=(3, 30))
    image = mirrored_controls(trunk, x)
    np.testing.assert_array_equal(image[:, 28:], x[:, 28:] * [-1, 1])
    np.testing.assert_array_equal(mirrored_controls(trunk, image), x)


def test_the_mirrored_trunk_has_the_mirrored_shape():
    """Under every load; directors d1 and d3 are reflected, d2 is reflected and reversed."""
    motion = shipped("lift-log-asymmetric")
    loads = motion.spec.phases[-1].loads.model_copy(update={"tip_force": (20.0, -30.0, 40.0)})
    motion = with_phases(motion, loads=loads)
    rng = np.random.default_rng(1)
    x = np.append(-0.4 * rng.random(28), [0.2, -0.1])
    image = mirrored_controls(motion.trunk, x)
    loads, theirs = motion.steps[4].loads, mirrored_motion(motion).steps[4].loads
    Z = np.linspace(0.1, 1.75, 7)
    a = solve_statics(motion.trunk, x[:28], x[28:], loads)
    b = solve_statics(motion.trunk, image[:28], image[28:], theirs)
    reflect = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(b.position(Z), a.position(Z) * reflect, atol=1e-9)
    signs = np.array([1, -1, 1])[:, None]
    np.testing.assert_allclose(b.directors(Z), signs * a.directors(Z) * reflect, atol=1e-9)


@pytest.mark.parametrize("name", ["pick-fruit", "lift-log-asymmetric"])
def test_the_mirror_image_of_an_optimum_is_one_of_the_mirrored_motion(name):
    motion = first_steps(name, 2)
    plan = plan_motion(motion)
    image = mirrored_controls(motion.trunk, plan.x)
    again = plan_from(mirrored_motion(motion), image)
    assert again.converged
    assert again.objective.total == pytest.approx(plan.objective.total, rel=1e-4)
    np.testing.assert_allclose(again.x, image, atol=SAME_PLAN_TOL)


def test_a_motion_seen_twice_in_the_mirror_is_itself():
    motion = shipped("pick-fruit")
    twice = mirrored_motion(mirrored_motion(motion))
    for a, b in zip(motion.steps, twice.steps, strict=True):
        assert a.targets == b.targets
        assert a.loads == b.loads
        np.testing.assert_array_equal(a.box.lower, b.box.lower)
        np.testing.assert_array_equal(a.change.upper, b.change.upper)


def test_a_trunk_without_another_side_has_no_mirror_image(trunk):
    crooked = replace(trunk, head=replace(trunk.head, xi_z=0.1))
    with pytest.raises(InputError, match="xi_z_deg"):
        mirror_order(crooked)
    single = replace(trunk, subdomains=trunk.subdomains[:14])
    with pytest.raises(InputError, match="R1-dl has no partner L1-dl"):
        mirror_order(single)


# --- command line --------------------------------------------------------------------------


def test_optima_writes_what_it_found(tmp_path):
    problem = str(written(tmp_path, TOUCH))
    arguments = ["optima", problem, "--out", str(tmp_path), "--starts", "2", "--processes", "1"]
    result = CliRunner().invoke(commands.main, arguments)
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "optima.json").read_text())
    assert report["starts"] == 5
    assert report["optima"][0]["distance"] == 0.0
    assert "distinct local optima" in result.stdout
