"""Redundancy: ranges, versions and needs against hand calculation, enumeration and sampling."""

import itertools
import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.collections import PolyCollection
from plans import planned, soft_rod, written
from scipy.linalg import null_space
from scipy.optimize import linprog, lsq_linear

from trunk_ocp.analysis.redundancy.ablation import AblationResult, ablate_muscles, motion_without
from trunk_ocp.analysis.redundancy.activation_ranges import Freedom, feasible_ranges, muscle_freedom
from trunk_ocp.analysis.redundancy.alternatives import (
    can_be_off,
    fewest_muscles,
    least_cost,
    least_effort,
    least_peak,
)
from trunk_ocp.analysis.redundancy.report import Redundancy, analyze_redundancy
from trunk_ocp.cli import commands
from trunk_ocp.cli.tables import redundancy_table
from trunk_ocp.errors import InputError
from trunk_ocp.figures import redundancy as figure
from trunk_ocp.model.activation import strain_matrix, strains
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import save_plan
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.motion import allowed
from trunk_ocp.rod.statics import solve_statics

pytestmark = pytest.mark.slow

VERSIONS = ("plan", "least effort", "fewest muscles")

# Half a ring of a longitudinal and a radial muscle on each side, in the same place. Without
# taper the radial one does -nu = -1/2 of what the other does, to all four strain numbers.
ANTAGONISTS = (
    soft_rod("antagonists")
    + """
muscles = [
  { group = "long", architecture = "longitudinal", radii_over_length = [0.02, 0.05], sector = [0.0, 3.141592653589793] },
  { group = "wide", architecture = "radial", radii_over_length = [0.02, 0.05], sector = [0.0, 3.141592653589793] },
]
"""  # noqa: E501  # TOML inline tables stand on one line
)
LEAN = """
name = "lean"
anatomy = "antagonists.toml"

[bounds]
activation = [-2.0, 0.0]
extension = [0.5, 1.5]

[[phases]]
name = "lean"
duration = 1.0
steps = 2
CHANGE

[[phases.targets]]
Z = 1.0
path = [[0.0, 0.1, 0.9], [0.0, 0.2, 0.85]]
"""
MOST = 0.6  # change of an activation


@pytest.fixture(scope="module")
def lean(tmp_path_factory):
    """Plans of two steps with antagonists: without and with bounds on change."""
    folder = tmp_path_factory.mktemp("lean")
    written(folder, ANTAGONISTS, "antagonists.toml")

    def plan(change):
        motion = load_motion(written(folder, LEAN.replace("CHANGE", change)))
        return plan_motion(motion, throw=False)

    return plan(""), plan(f"change = [{{ activation = {MOST} }}]")


@cache
def lift(mode="horizon"):
    return planned("lift-log", mode)


@cache
def free(mode="horizon"):
    return muscle_freedom(lift(mode))


def left_right_pairs(motion):
    """Muscles grouped with their mirror images: names that differ only in the side."""
    groups = {}
    for muscle in motion.trunk.subdomains:
        groups.setdefault(f"{muscle.segment} {muscle.group}", []).append(muscle.name)
    return tuple(tuple(names) for names in groups.values())


def columns(plan, segment):
    return np.flatnonzero([m.segment == segment for m in plan.motion.trunk.subdomains])


def boxes(plan):
    """Bounds (H, muscles) of a plan, a little wider for what Ipopt exceeds them by."""
    steps = enumerate(plan.motion.steps)
    every = [allowed(plan.motion, step, plan.auxiliary.get(t)) for t, step in steps]
    return (
        np.array([box.lower[:-2] for box in every]) - 1e-8,
        np.array([box.upper[:-2] for box in every]) + 1e-8,
    )


def changes(plan):
    """Bounds (H, muscles) on change."""
    steps = plan.motion.steps
    return (
        np.array([s.change.lower[:-2] for s in steps]) - 1e-8,
        np.array([s.change.upper[:-2] for s in steps]) + 1e-8,
    )


def from_rest(activations):
    return np.diff(np.concatenate([np.zeros((1, activations.shape[1])), activations]), axis=0)


def nlp(plan, segment, lower, upper):
    """A segment's linear program over all steps, written out densely a second time."""
    own, H = columns(plan, segment), len(plan.x)
    A = strain_matrix(plan.motion.trunk)[segment][:, own]
    least, most = (bound[:, own].ravel() for bound in changes(plan))
    D = np.eye(H * len(own)) - np.eye(H * len(own), k=-len(own))
    bounded = np.isfinite(most)
    return {
        "A_eq": np.kron(np.eye(H), A),
        "b_eq": (plan.activations[:, own] @ A.T).ravel(),
        "A_ub": np.concatenate([D[bounded], -D[bounded]]),
        "b_ub": np.concatenate([most[bounded], -least[bounded]]),
        "bounds": np.stack([lower[:, own].ravel(), upper[:, own].ravel()], axis=1),
    }


def possible(nlp):
    return linprog(np.zeros(len(nlp["bounds"])), **nlp).status == 0


# --- ranges ------------------------------------------------------------------------------


def by_hand(v):
    """Ranges of the radial and the longitudinal muscle of a side with long - wide / 2 = v."""
    wide = np.stack([np.maximum(-2.0, -2.0 * v - 4.0), np.minimum(0.0, -2.0 * v)], axis=-1)
    return wide, v[..., None] + wide / 2


def test_the_range_of_two_antagonists_is_that_found_by_hand(lean):
    plan, _ = lean
    names = plan.motion.trunk.muscles
    found = feasible_ranges(plan)
    for side in "RL":
        long, wide = names.index(f"{side}1-long"), names.index(f"{side}1-wide")
        v = plan.activations[:, long] - plan.activations[:, wide] / 2
        expected = by_hand(v)
        np.testing.assert_allclose(found[:, wide], expected[0], rtol=0, atol=1e-7)
        np.testing.assert_allclose(found[:, long], expected[1], rtol=0, atol=1e-7)


def test_the_joint_range_of_two_antagonists_is_that_found_by_hand(lean):
    _, plan = lean
    names = plan.motion.trunk.muscles
    found = feasible_ranges(plan, joint=True)
    for side in "RL":
        long, wide = names.index(f"{side}1-long"), names.index(f"{side}1-wide")
        v = plan.activations[:, long] - plan.activations[:, wide] / 2
        box = by_hand(v)[0]
        # From rest: |wide| and |long| at most MOST.
        low = max(box[0, 0], -MOST, 2 * (-MOST - v[0]))
        high = min(box[0, 1], MOST, 2 * (MOST - v[0]))
        # Then |change of wide| and |change of v + half of that| at most MOST.
        down = max(-MOST, 2 * (-MOST - (v[1] - v[0])))
        up = min(MOST, 2 * (MOST - (v[1] - v[0])))
        first = max(low, box[1, 0] - up), min(high, box[1, 1] - down)
        second = max(box[1, 0], low + down), min(box[1, 1], high + up)
        np.testing.assert_allclose(found[:, wide], [first, second], rtol=0, atol=1e-7)


def test_ranges_without_bounds_on_change_are_those_of_each_step_alone(lean):
    plan, bounded = lean
    np.testing.assert_allclose(
        feasible_ranges(plan, joint=True), feasible_ranges(plan), rtol=0, atol=1e-8
    )
    assert (
        np.ptp(feasible_ranges(bounded, joint=True), axis=-1).max()
        < np.ptp(feasible_ranges(bounded)).max()
    )


@pytest.mark.parametrize("segment", [0, 1, 2])
def test_ranges_are_those_of_all_vertices(segment):
    """Every vertex has all but four muscles at a bound."""
    plan, step = lift(), 6
    own = columns(plan, segment)
    A = strain_matrix(plan.motion.trunk)[segment][:, own]
    x = plan.activations[step, own]
    lower, upper = (bound[step, own] for bound in boxes(plan))
    vertices = []
    for basis in itertools.combinations(range(len(own)), 4):
        inner = list(basis)
        outer = [i for i in range(len(own)) if i not in basis]
        if np.linalg.matrix_rank(A[:, inner]) < 4:
            continue
        at = np.array(list(itertools.product(*zip(lower[outer], upper[outer], strict=True))))
        z = np.zeros((len(at), len(own)))
        z[:, outer] = at
        z[:, inner] = np.linalg.solve(A[:, inner], (A @ x)[:, None] - A[:, outer] @ at.T).T
        vertices.append(z[np.all((z >= lower - 1e-7) & (z <= upper + 1e-7), axis=1)])
    every = np.concatenate(vertices)
    expected = np.stack([every.min(axis=0), every.max(axis=0)], axis=-1)
    np.testing.assert_allclose(free().alone[step, own], expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("mode", ["horizon", "sequential"])
def test_ranges_contain_the_plan_and_the_joint_ones_are_within_the_others(mode):
    plan, found = lift(mode), free(mode)
    for band in (found.alone, found.joint):
        assert np.all(band[..., 0] <= plan.activations + 1e-7)
        assert np.all(band[..., 1] >= plan.activations - 1e-7)
    assert np.all(found.joint[..., 0] >= found.alone[..., 0] - 1e-7)
    assert np.all(found.joint[..., 1] <= found.alone[..., 1] + 1e-7)


def test_the_ends_of_joint_ranges_are_those_of_a_second_nlp():
    plan, rng = lift(), np.random.default_rng(0)
    for segment in range(3):
        one, own = nlp(plan, segment, *boxes(plan)), columns(plan, segment)
        for k in rng.choice(len(one["bounds"]), 6, replace=False).tolist():
            cost = np.zeros(len(one["bounds"]))
            cost[k] = 1.0
            ends = linprog(cost, **one).fun, -linprog(-cost, **one).fun
            step, muscle = divmod(k, len(own))
            found = free().joint[step, own[muscle]]
            np.testing.assert_allclose(found, ends, rtol=0, atol=1e-5)


def walk(plan, count, seed):
    """Hit-and-run through all activations (count, H, muscles) with the plan's shapes."""
    rng = np.random.default_rng(seed)
    trunk, (lower, upper), (least, most) = plan.motion.trunk, boxes(plan), changes(plan)
    H, N = plan.activations.shape
    starts = []
    for _ in range(12):  # the mean of many vertices is inside
        z = np.zeros((H, N))
        for segment in range(trunk.segments):
            one, own = nlp(plan, segment, lower, upper), columns(plan, segment)
            cost = rng.normal(size=len(one["bounds"]))
            z[:, own] = linprog(cost, **one).x.reshape(H, -1)
        starts.append(z)
    x = np.mean(starts, axis=0)
    spaces = []
    for step, segment in itertools.product(range(H), range(trunk.segments)):
        own = columns(plan, segment)
        own = own[(upper - lower)[step, own] > 1e-6]
        spaces.append((step, own, null_space(strain_matrix(trunk)[segment][:, own])))
    for _ in range(count):
        d = np.zeros((H, N))
        step, own, basis = spaces[rng.integers(len(spaces))]
        d[step, own] = basis @ rng.normal(size=basis.shape[1])
        room = [(lower - x, upper - x, d)]
        room.append((least - from_rest(x), most - from_rest(x), from_rest(d)))
        low, high = -np.inf, np.inf
        for below, above, rate in room:
            moves = np.abs(rate) > 1e-12
            ends = np.sort([below[moves] / rate[moves], above[moves] / rate[moves]], axis=0)
            low, high = max(low, ends[0].max()), min(high, ends[1].min())
        x = x + rng.uniform(low, high) * d
        yield x


def test_no_activation_with_the_same_shapes_is_outside_its_range():
    plan, found = lift(), free()
    effort = np.sum(least_effort(plan).activations ** 2)
    wanted = strains(plan.motion.trunk, plan.activations)
    seen = []
    for x in walk(plan, 3000, seed=1):
        np.testing.assert_allclose(strains(plan.motion.trunk, x), wanted, rtol=0, atol=1e-7)
        assert np.all(x >= found.joint[..., 0] - 1e-6)
        assert np.all(x <= found.joint[..., 1] + 1e-6)
        assert np.sum(x**2) >= effort - 1e-6
        seen.append(x)
    assert np.ptp(seen, axis=0).max() > 1.0  # it did go places


def test_kinds_of_muscles_follow_from_their_ranges():
    found, names = free(), lift().motion.trunk.muscles
    for i, kind in enumerate(found.kinds):
        low, high = found.joint[:, i].T
        if kind == "must work":
            assert np.any(high < 0)
        if kind == "can be off":
            assert np.all((low <= 1e-8) & (high >= -1e-8))
    assert {names[i] for i, kind in enumerate(found.kinds) if kind == "must work"} >= {
        f"{side}3-{group}" for side in "RL" for group in ("ovo", "dr", "vr")
    }


def test_what_the_solver_leaves_behind_is_no_need_of_the_task():
    """One muscle, one step: 0.004 is what an interior point leaves, 0.05 is work."""
    kinds = []
    for most in (-0.004, -0.05):
        band = np.array([[[-0.5, most]]])
        kinds += Freedom(band, band, np.array([False])).kinds
    assert kinds == ["free", "must work"]


def test_the_table_says_what_its_words_mean():
    alone = redundancy_table(Redundancy(lift(), free(), dict.fromkeys(VERSIONS, lift())))
    for word in ("must work", "free", "can be off", "determined"):
        assert f"{word}: " in str(alone.caption)
    assert "cost without" not in str(alone.caption)
    need = AblationResult(("R1-dl",), False, "missed", 1.0, 1.0, 2.0, 0.1, 0.1, 0.1)
    found = Redundancy(lift(), free(), dict.fromkeys(VERSIONS, lift()), (need,))
    caption = str(redundancy_table(found).caption)
    assert "For the task" in caption
    assert "!: not solved" in caption


def test_a_muscle_without_a_choice_is_determined(lean):
    """One muscle a side makes one curvature: what is left of the antagonists when one is off."""
    plan, _ = lean
    motion = motion_without(plan.motion, ("R1-wide", "L1-wide"))
    alone = replace(least_effort(plan, off=("R1-wide", "L1-wide")), motion=motion)
    assert muscle_freedom(alone).kinds == ("determined",) * 4


# --- versions ----------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["horizon", "sequential"])
@pytest.mark.parametrize("version", [least_effort, least_cost, least_peak, fewest_muscles])
def test_every_version_is_the_same_motion_within_its_bounds(version, mode):
    plan = lift(mode)
    other = version(plan)
    assert other.verified
    assert np.abs(other.activations - plan.activations).max() > 1e-3
    before, after = (
        solve_statics(p.motion.trunk, p.activations, p.head, list(p.loads), p.mesh)
        for p in (plan, other)
    )
    np.testing.assert_allclose(after.states, before.states, rtol=0, atol=1e-8)
    Z = np.linspace(0, 1.75, 50)
    np.testing.assert_allclose(after.position(Z), before.position(Z), rtol=0, atol=1e-9)
    integrated = other.verification.trajectory.position
    expected = plan.verification.trajectory.position
    np.testing.assert_allclose(integrated, expected, rtol=0, atol=1e-8)


def test_least_effort_has_multipliers():
    """Karush, Kuhn and Tucker: -z is a sum of normals of the active bounds, pointing outward."""
    plan = lift()
    z, (lower, upper), (least, most) = least_effort(plan).activations, boxes(plan), changes(plan)
    for segment in range(3):
        own = columns(plan, segment)
        one = nlp(plan, segment, lower, upper)
        n = len(one["bounds"])
        D = np.eye(n) - np.eye(n, k=-len(own))
        change = from_rest(z[:, own]).ravel()
        tight = 1e-7
        normals = [
            np.eye(n)[(upper[:, own] - z[:, own]).ravel() < tight],
            -np.eye(n)[(z[:, own] - lower[:, own]).ravel() < tight],
            D[most[:, own].ravel() - change < tight],
            -D[change - least[:, own].ravel() < tight],
        ]
        matrix = np.concatenate([one["A_eq"], *normals]).T
        signs = np.zeros(matrix.shape[1])
        signs[: len(one["A_eq"])] = -np.inf
        result = lsq_linear(matrix, -z[:, own].ravel(), bounds=(signs, np.inf), tol=1e-14)
        assert np.linalg.norm(result.fun) < 1e-6 * np.linalg.norm(z[:, own])


@pytest.mark.parametrize("name", ["lift-log", "lift-log-asymmetric"])
def test_a_horizon_plan_chooses_its_muscles_best_by_its_own_weights(name):
    """Ipopt on the whole NLP and the active-set method on the convex rest agree."""
    plan = planned(name, "horizon")
    ours, best = (p.objective.effort + p.objective.rate for p in (plan, least_cost(plan)))
    assert best <= ours * (1 + 1e-9)
    assert ours <= best * (1 + 1e-4)


def test_no_segment_has_a_smaller_peak():
    plan = lift()
    found = least_peak(plan).activations
    for segment in range(3):
        peak = np.abs(found[:, columns(plan, segment)]).max()
        lower, upper = boxes(plan)
        assert possible(nlp(plan, segment, np.maximum(lower, -peak - 1e-7), upper))
        assert not possible(nlp(plan, segment, np.maximum(lower, -peak + 1e-4), upper))


def test_no_smaller_set_of_muscles_does_it():
    plan, segment = lift(), 2
    own = columns(plan, segment)
    works = np.abs(fewest_muscles(plan).activations[:, own]).max(axis=0) > 0
    lower, upper = boxes(plan)
    for off in itertools.combinations(own.tolist(), len(own) - int(works.sum()) + 1):
        tight = lower.copy()
        tight[:, list(off)] = -1e-8
        assert not possible(nlp(plan, segment, tight, upper))


def test_the_fewest_of_two_antagonists_is_one_a_side(lean):
    plan, _ = lean
    other = fewest_muscles(plan)
    assert np.count_nonzero(np.abs(other.activations).max(axis=0)) == 2


# --- without a muscle --------------------------------------------------------------------


def test_a_muscle_that_can_be_off_changes_no_target():
    plan = lift()
    name = "R1-dr"
    assert can_be_off(plan, (name,))
    other = least_cost(plan, off=(name,))
    assert not np.any(other.activations[:, plan.motion.trunk.muscles.index(name)])
    (need,) = ablate_muscles(plan, [(name,)])
    assert (need.spare, need.status) == (True, "solved")
    worst = max(e.position.max() for e in plan.errors)
    assert need.worst_position_error == pytest.approx(worst, abs=1e-8)
    assert need.ratio == pytest.approx(1.0, abs=1e-3)


def test_a_muscle_that_must_work_costs_something():
    plan = lift()
    name = "R3-dr"
    assert not can_be_off(plan, (name,))
    (need,) = ablate_muscles(plan, [(name,)], processes=1)
    assert not need.spare
    assert need.ratio > 1
    assert need.planner_objective > plan.objective.total


def test_muscles_are_taken_away_in_other_processes_too(lean):
    plan, _ = lean
    seen = []
    tasks = [*left_right_pairs(plan.motion)]
    found = ablate_muscles(plan, tasks, processes=2, progress=lambda *now: seen.append(now))
    assert [need.muscles for need in found] == tasks
    assert [done for done, _, _ in seen] == [1, 2]
    for need, here in zip(found, ablate_muscles(plan, tasks, processes=1), strict=True):
        assert need.planner_objective == pytest.approx(here.planner_objective, rel=1e-6)
    assert found[0].worst_position_error > 0.01  # nothing else makes this arm shorter


# --- what is shown -----------------------------------------------------------------------


def test_bands_are_the_ranges_and_lie_behind_the_plan(lean):
    _, plan = lean
    found = analyze_redundancy(plan)
    artists = figure.redundancy_figure(found).findobj()
    bands = [a for a in artists if isinstance(a, PolyCollection) and a.get_gid() == "joint"]
    lines = [a for a in artists if a.get_gid() == "plan"]
    assert len(bands) == len(lines) == 4
    for band, line in zip(bands, lines, strict=True):
        assert band.get_zorder() < line.get_zorder()
        muscle = np.flatnonzero(np.all(plan.activations.T == line.get_ydata()[1:], axis=1))[0]
        drawn = band.get_paths()[0].vertices
        for step, time in enumerate(plan.motion.times):
            heights = drawn[np.isclose(drawn[:, 0], time), 1]
            ends = heights.min(), heights.max()
            np.testing.assert_allclose(ends, found.freedom.joint[step, muscle], atol=1e-12)


def test_the_command_writes_ranges_needs_and_a_figure_beside_the_plan(lean, tmp_path):
    _, plan = lean
    save_plan(plan, tmp_path / "horizon")
    arguments = ["redundancy", str(tmp_path), "--needed"]
    result = CliRunner().invoke(commands.main, arguments)
    assert result.exit_code == 0, result.output
    written = json.loads((tmp_path / "horizon" / "redundancy.json").read_text())
    names = [entry["name"] for entry in written["muscles"]]
    assert names == list(plan.motion.trunk.muscles)
    np.testing.assert_allclose(
        np.array([entry["range_joint"] for entry in written["muscles"]]).swapaxes(0, 1),
        feasible_ranges(plan, joint=True),
        rtol=0,
        atol=1e-8,
    )
    assert [need["muscles"] for need in written["without"]] == [[name] for name in names]
    assert written["versions"]["fewest muscles"]["working_muscles"] == 2
    assert (tmp_path / "horizon" / "figures" / "redundancy.pdf").exists()
    for name in names:
        assert name in result.stdout


def test_the_command_asks_for_a_plan_first(tmp_path):
    result = CliRunner().invoke(commands.main, ["redundancy", str(tmp_path)])
    assert result.exit_code == 2
    assert "Plan it first, solve-motion" in result.stderr


# --- what cannot be asked ----------------------------------------------------------------


def test_a_plan_cut_short_has_no_ranges():
    plan = lift()
    short = replace(plan, x=plan.x[:3], tip_forces=plan.tip_forces[:3], shape=plan.part(0, 3))
    with pytest.raises(InputError, match="verified plan of all time steps"):
        feasible_ranges(short)


def test_an_unknown_muscle_is_named():
    with pytest.raises(InputError, match=r"R9-dl: no such muscle.*Did you mean R3-dl\?"):
        can_be_off(lift(), ("R9-dl",))


def test_too_many_muscles_off_are_refused():
    with pytest.raises(InputError, match="segment 3 cannot keep its shapes"):
        least_effort(lift(), off=("R3-ovo",))


def test_needs_of_a_sequential_plan_are_refused():
    with pytest.raises(InputError, match="expected a horizon plan"):
        ablate_muscles(lift("sequential"))
