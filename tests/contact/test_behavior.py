"""What plans with contact say, keep in files, and do in scenes that cannot be cleared."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import xarray as xr
from dense_contact import deepest
from reaching import BALL, BEYOND, reaching
from scenes import TRUNK

from trunk_ocp.contact.exchange import rows_for
from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.plan import PlanError
from trunk_ocp.planning.planner import plan_from, plan_motion
from trunk_ocp.planning.replanning import Replanner
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan, summary
from trunk_ocp.rod.statics import solve_statics

OBSTACLES = {"obstacles": True}
TOL = 6e-5


def around(**more):
    return reaching([BEYOND], OBSTACLES, [BALL | more])


@cache
def avoided():
    """A plan of one step that has to keep clear of the ball to reach beyond it."""
    return plan_motion(around(), throw=False)


def test_a_plan_around_a_ball_reaches_the_target_and_touches_the_ball():
    blind = plan_motion(around().with_contact("none"))
    assert deepest(replace(blind, motion=around()))[0] > 0.01  # straight through
    assert blind.clearance.min.gap == pytest.approx(
        -deepest(replace(blind, motion=around()))[0], abs=1e-3
    )
    plan = avoided()
    assert plan.status is Status.SOLVED
    depth, _ = deepest(plan)
    assert -1e-3 < depth < TOL  # no wider a detour than it takes
    assert plan.gaps
    assert all(row.body == "ball" for rows in plan.gaps.values() for row in rows)


@pytest.mark.parametrize("clear", [False, True])
def test_a_glance_finds_what_collides_between_steps_and_bounds_what_does_not(clear):
    ball = BALL | {"center": (0.25, 0.25, 0.55)} if clear else BALL
    motion = reaching([BEYOND], OBSTACLES, [ball], interpolation="cosine")
    blind = plan_motion(motion.with_contact("none"))
    plan = replace(blind, motion=motion)
    (glance,) = (gap for gap in plan.gaps_on_ways(hurry=True) if gap.body == "ball")
    (proved,) = (gap for gap in plan.gaps_between if gap.body == "ball")
    assert (proved.gap > 0) == clear
    assert glance.gap == pytest.approx(proved.gap, abs=1e-3)
    assert glance.bound == (proved.bound if clear else -np.inf)


def test_sequential_plans_keep_clear_too():
    plan = plan_motion(around(), lookahead=1, throw=False)
    assert plan.mode == "sequential"
    assert plan.status is Status.SOLVED
    assert deepest(plan)[0] < TOL


@pytest.mark.parametrize("seed", range(3))
def test_a_guess_deep_in_a_body_does_no_harm(seed):
    """From wherever: a plan, and one that does not collide if it says so."""
    x = np.random.default_rng(seed).uniform(-0.8, 0.0, (1, 10))
    blind = plan_motion(around().with_contact("none"))
    plan = plan_from(around(), blind.x if seed == 0 else x)
    if plan.status in (Status.SOLVED, Status.MISSED):
        assert deepest(plan)[0] < TOL
    assert seed or plan.status is Status.SOLVED


# --- scenes that cannot be cleared -----------------------------------------------------------


def test_a_target_in_a_body_is_named_with_its_depth():
    inside = np.add(BALL["center"], (-0.07, 0.0, 0.0))  # 30 mm below the surface
    plan = plan_motion(
        reaching([{"Z": 1.0, "position": tuple(inside)}], OBSTACLES, [BALL]), throw=False
    )
    assert plan.status is not Status.SOLVED
    assert any("30 mm too deep in the ball" in note for note in plan.notes)
    assert deepest(plan)[0] < TOL or plan.status in (Status.COLLIDING, Status.INFEASIBLE)
    with pytest.raises(PlanError, match=r"\bball\b"):
        plan.checked()


def test_a_trunk_that_rests_in_a_body_is_told_so():
    rest = solve_statics(TRUNK, np.zeros((1, 8)), np.zeros((1, 2)), Loads())
    place, radius = rest.position(np.array([0.7]))[0, 0], TRUNK.radius(0.7)
    ball = BALL | {"name": "stone", "center": tuple(np.add(place, (0.1, 0, 0))), "radius": 0.09}
    motion = reaching([BEYOND], OBSTACLES, [ball], interpolation="cosine")
    plan = plan_motion(motion, throw=False)
    (note,) = [note for note in plan.notes if "at the start" in note]
    depth = float(re.search(r"([\d.]+) mm", note)[1])
    assert "stone" in note
    assert depth == pytest.approx(1e3 * (0.09 + radius - 0.1), rel=0.1)
    assert plan.status in (Status.COLLIDING, Status.INFEASIBLE, Status.MISSED)
    assert len(plan.motion.steps) == 1  # more steps would not help


def test_a_slot_that_is_narrower_than_the_trunk_is_named():
    """Two walls 60 mm apart, in which the trunk, 80 mm thick, has to point somewhere."""
    walls = [
        {"name": f"wall {side:+d}", "shape": "box", "center": (0.45, side * 0.23, 0.6)}
        | {"half_sizes": (0.25, 0.2, 0.5)}
        for side in (-1, 1)
    ]
    plan = plan_motion(
        reaching([{"Z": 0.8, "position": (0.5, 0.0, 0.5)}], OBSTACLES, walls), throw=False
    )
    assert plan.status is not Status.SOLVED
    said = [
        *plan.collisions,
        *plan.notes,
        *plan.missed,
        *map(str, plan.failure.violations if plan.failure else ()),
    ]
    assert plan.status is Status.MISSED or any("wall" in sentence for sentence in said)
    if plan.status in (Status.MISSED, Status.SOLVED):
        assert deepest(plan)[0] < TOL


# --- files, re-planning ----------------------------------------------------------------------


def test_a_saved_plan_comes_back_with_its_gaps(tmp_path):
    save_plan(avoided(), tmp_path)
    back = load_plan(tmp_path)
    assert back.gaps == avoided().gaps
    assert back.status is avoided().status
    assert back.clearance.min.gap == pytest.approx(avoided().clearance.min.gap, abs=1e-12)
    told = json.loads((tmp_path / "summary.json").read_text())
    assert (
        told == json.loads(json.dumps(summary(back)))
        or told["clearance"] == summary(back)["clearance"]
    )


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[",
        "{}",
        "[[1]]",
        '[[2, "ball", 0.5, null, 0.0]]',
        '[[0, "ball", 0.5, null, 0.0]]',
        '[[1, "wall", 0.5, null, 0.0]]',
        '[[1, "ball", 1.5, null, 0.0]]',
        '[[1, "ball", "a", null, 0.0]]',
        '[[1, "ball", 0.5, null, "a"]]',
        '[[1, "itself", 0.5, null, 0.0]]',
        '[[1, "itself", 0.5, 7.0, 0.0]]',
        '[[1, "ball", 0.5, null, 1e999]]',
        '[[1, "ball", NaN, null, 0.0]]',
    ],
)
def test_a_file_with_damaged_gaps_is_refused(tmp_path, text):
    save_plan(avoided(), tmp_path)
    path = tmp_path / "solution.nc"
    with xr.open_dataset(path) as kept:
        contents = kept.load()
    contents.attrs["gaps_json"] = text
    contents.to_netcdf(path, engine="scipy")
    with pytest.raises(InputError, match=re.escape(str(tmp_path))):
        load_plan(tmp_path)


def test_a_body_that_appears_later_is_kept_clear_of_where_it_appears(tmp_path):
    """The step before has to be clear of it as well, since the way on starts there."""
    there = {"Z": 1.0, "position": (0.3, 0.02, 0.6)}
    phases = [
        {"name": name, "duration": 1.0, "targets": (target,)}
        for name, target in (("before", there), ("after", BEYOND))
    ]
    ball = BALL | {"phases": ("after",), "radius": 0.05}
    motion = reaching(
        [], OBSTACLES, [ball], {"phases": tuple(phases), "tolerance": {"position": 0.5}}
    )
    plan = plan_motion(motion, throw=False)
    assert plan.status is Status.SOLVED
    assert {row.body for row in plan.gaps[0]} == {"ball"}
    save_plan(plan, tmp_path)
    assert load_plan(tmp_path).gaps == plan.gaps


def test_a_replanner_keeps_the_gaps_and_follows_the_body(tmp_path):
    again = Replanner(avoided())
    for shift in (0.0, 0.004):
        center = tuple(np.add(BALL["center"], (0.0, shift, 0.0)))
        plan = again(around(center=center), throw=False)
        assert plan.converged
        assert plan.gaps.keys() == avoided().gaps.keys()
        assert deepest(plan)[0] < 3e-4
        assert plan.status in (Status.SOLVED, Status.COLLIDING)
        assert (plan.status is Status.SOLVED) <= (deepest(plan)[0] < TOL)


def test_rows_follow_a_body_s_clearance_and_miss_no_body():
    moved = rows_for(around(clearance=0.02), avoided().gaps)
    least = [row.least for rows in moved.values() for row in rows]
    assert least
    assert 0.02 <= min(least) <= max(least) <= 0.0201
    with pytest.raises(InputError, match="ball"):
        rows_for(around(name="sphere"), avoided().gaps)
    later = {5: avoided().gaps[0]}
    with pytest.raises(InputError, match="time step 6"):
        rows_for(around(), later)


@pytest.mark.parametrize("name", ["itself", "log"])
def test_no_obstacle_has_the_name_of_another_body(name):
    with pytest.raises(InputError, match=name):
        around(name=name)


# --- parts of the trunk ----------------------------------------------------------------------


@pytest.mark.parametrize("part", [(0.5, 0.5 + 1e-9), (0.0, 1e-9), (1 - 1e-9, 1.0), (0.7, 0.701)])
def test_a_short_part_of_the_trunk_is_looked_at_where_it_is(part):
    blind = plan_motion(around(Z=part).with_contact("none"))
    (gap,) = [gap for gap in blind.clearance.at_steps if gap.body == "ball"]
    assert gap.Z == pytest.approx(np.mean(part), abs=1 / 256)
    center = blind.shape.position(np.array([gap.Z]))[0, 0]
    radius = gap.gap + 0.1 - np.linalg.norm(center - BALL["center"])
    assert -1.3 * TRUNK.radius(gap.Z) <= radius <= 0  # at most the section's own radius away


def test_a_deadline_ends_planning_around_bodies():
    late = plan_motion(around(), throw=False, deadline=1e-3)
    assert late.status is Status.TIME_LIMIT
