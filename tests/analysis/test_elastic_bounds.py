"""Bounds that would have to give: amounts known by hand, or by another NLP."""

from dataclasses import replace

import numpy as np
import pytest
from plans import MOTIONS, POINT, TOUCH, first_steps, shipped, soft_rod, written

from trunk_ocp._support.wording import step_list
from trunk_ocp.analysis.diagnosis import explain
from trunk_ocp.analysis.elastic_bounds import (
    Bound,
    Excess,
    contradictions,
    elastic_rows,
    in_words,
    nearest,
    reach,
)
from trunk_ocp.model.activation import strain_matrix
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.motion import Bounds

pytestmark = pytest.mark.slow

# A straight weightless rod whose head is held: two muscles, that together only change its length.
ROD = (
    soft_rod("rod")
    + """
muscles = [
  { group = "ring", architecture = "longitudinal", radii_over_length = [0.02, 0.05], \
sector = [0.0, 3.141592653589793] },
]
"""
)
SHORTEN = """
name = "shorten"
anatomy = "rod.toml"
gravity = 0.0

[bounds]
activation = [{strongest}, 0.0]
extension = [{shortest}, 1.5]
head_z_deg = [0.0, 0.0]
head_y_deg = {head}

[tolerance]
position = 1.0e-3

[[phases]]
name = "shorten"
duration = 1.0

[[phases.targets]]
Z = 1.0
position = {target}
position_weight = {weight}
"""
PER_ACTIVATION = (0.05**2 - 0.02**2) / 0.05**2 / 2
"""zeta_hat - 1 for one muscle of half the ring at activation 1: its share of the section."""


def shorten(folder, *, strongest=-2.0, shortest=0.5, length=0.8, weight=1.0, head="[0.0, 0.0]"):
    target = f"[0.0, 0.0, {length}]" if np.ndim(length) == 0 else list(length)
    written(folder, ROD, "rod.toml")
    text = SHORTEN.format(
        strongest=strongest, shortest=shortest, target=target, weight=weight, head=head
    )
    return load_motion(written(folder, text))


def told(excesses):
    return {(excess.bound.name, excess.bound.steps): excess.amount for excess in excesses}


# --- bounds that exclude each other ------------------------------------------------------


@pytest.mark.parametrize("name", MOTIONS)
def test_bounds_of_the_shipped_motions_do_not_exclude_each_other(name):
    assert contradictions(shipped(name)) == ()


def test_a_trunk_that_may_not_move_cannot_be_longer(tmp_path):
    text = TOUCH.replace("activation = [-3.0, 0.0]", "activation = [0.0, 0.0]")
    motion = load_motion(written(tmp_path, text.replace("[0.67, 1.35]", "[1.2, 1.35]")))
    found = contradictions(motion)
    # Radial muscles lengthen it by 0.037 a unit at most: 5 units, at ten times the price.
    assert told(found) == {
        (f"least extension of segment {i}", (1,)): pytest.approx(0.2) for i in (1, 2, 3)
    }
    assert plan_motion(motion, throw=False).status is Status.INFEASIBLE


def test_a_change_that_cannot_get_into_the_box_is_measured_by_hand(tmp_path):
    """psi_Z must be at least 10 deg at step 1, and may change by 4 from 0: 6 are missing."""
    phase = "duration = 1.0\nbounds.head_z_deg = [10.0, 20.0]\n"
    phase += "change = [{ head_z_deg = [-4.0, 4.0] }]"
    motion = load_motion(written(tmp_path, TOUCH.replace("duration = 1.0", phase)))
    (found,) = contradictions(motion)
    assert found.amount == pytest.approx(6.0, rel=1e-6)
    change = "largest change of head psi_Z (step 1): from 4 to 10.01 deg"
    box = "least head psi_Z (step 1): from 10 to 3.999 deg"
    assert str(found) in (change, box)
    # The cheaper of the two: the box's range is 180 deg, a change is priced by 0.2 rad.
    assert str(found) == box


def test_the_excess_of_a_bound_is_the_largest_of_its_steps(tmp_path):
    """From 0 by 1 deg a step to 10 deg: 9 missing at step 1, 8 at step 2; one bound, one excess."""
    text = POINT.replace("steps = 2\n\n[[phases.targets]]", "steps = 2\n"
        "bounds.head_z_deg = [10.0, 20.0]\nchange = [{ head_z_deg = [-1.0, 1.0] }]\n\n"
        "[[phases.targets]]", 1)  # fmt: skip
    (found,) = contradictions(load_motion(written(tmp_path, text)))
    assert told([found]) == {("least head psi_Z", (1, 2)): pytest.approx(9.0)}


def test_an_excess_is_the_cheapest_there_is(tmp_path):
    """Two unknowns and a bound on their sum: the price over a grid is nowhere lower.

    The rod must not be shorter than 0.9, while both muscles contract by at least 0.3. Between
    grid points the price changes by no more than its steepest slope times the spacing.
    """
    motion = shorten(tmp_path, shortest=0.9)
    box = Bounds(motion.box.lower, np.append(np.full(2, -0.3), motion.box.upper[2:]))
    motion = replace(motion, box=box, steps=tuple(replace(s, box=box) for s in motion.steps))
    price = sum(e.amount / e.bound.scale for e in contradictions(motion))
    zeta, scale = strain_matrix(motion.trunk)[0, 0], box.upper[:2] - box.lower[:2]
    a = np.linspace(-0.4, 0.0, 161)
    first, second = np.meshgrid(a, a)
    extension = 1 + zeta[0] * first + zeta[1] * second
    cost = np.maximum(first + 0.3, 0) / scale[0] + np.maximum(second + 0.3, 0) / scale[1]
    cost += np.maximum(0.9 - extension, 0) / 0.3
    steepest = np.sum(1 / scale + np.abs(zeta) / 0.3)
    assert 0 <= cost.min() - price <= steepest * (a[1] - a[0]) / 2
    assert price > 0.1


def test_rest_never_gives(tmp_path):
    """No muscle pushes: an upper bound of 0 is physics, not a choice."""
    bounds = elastic_rows(first_steps("lift-log", 3)).bounds
    rest = [b for b in bounds if b.name.startswith("largest activation")]
    assert rest
    assert all(b.most == 0 and b.value == 0 for b in rest)
    changes = [b for b in bounds if "change" in b.name]
    assert changes
    assert all(b.most == np.inf for b in changes)


def test_a_trunk_without_muscles_has_bounds_too(tmp_path):
    written(tmp_path, ROD.split("muscles")[0], "rod.toml")
    text = SHORTEN.format(
        strongest=-1.0, shortest=1.1, target=[0.0, 0.0, 1.0], weight=1.0, head="[0.0, 0.0]"
    )
    found = contradictions(load_motion(written(tmp_path, text)))
    assert told(found) == {("least extension of segment 1", (1,)): pytest.approx(0.1)}


# --- bounds that keep the trunk from its targets -----------------------------------------


def test_the_extension_that_a_target_needs_is_found(tmp_path):
    """To 0.801 m within a tolerance of 1 mm; 0.85 is allowed: 0.049 are missing."""
    plan = plan_motion(shorten(tmp_path, shortest=0.85), throw=False)
    assert plan.status is Status.MISSED
    (found,) = reach(plan)
    assert (found.bound.name, found.bound.value) == ("least extension of segment 1", 0.85)
    assert found.amount == pytest.approx(0.049, abs=1e-6)
    hair = 1e-5
    enough = plan_motion(shorten(tmp_path, shortest=0.85 - found.amount - hair), throw=False)
    barely = plan_motion(shorten(tmp_path, shortest=0.85 - found.amount + hair), throw=False)
    assert (enough.status, barely.status) == (Status.SOLVED, Status.MISSED)
    assert reach(enough) == ()


@pytest.mark.parametrize("weight", [1e-3, 1.0, 1e4])
def test_the_activation_that_a_target_needs_is_found_whatever_its_weight(tmp_path, weight):
    plan = plan_motion(shorten(tmp_path, strongest=-0.2, weight=weight), throw=False)
    assert plan.status is Status.MISSED
    needed = (1 - 0.801) / (2 * PER_ACTIVATION)
    found = told(reach(plan))
    assert found.keys() == {(f"least activation of {s}1-ring", (1,)) for s in "RL"}
    for amount in found.values():
        assert amount == pytest.approx(needed - 0.2, abs=1e-6)
    enough = plan_motion(shorten(tmp_path, strongest=-needed - 1e-5), throw=False)
    barely = plan_motion(shorten(tmp_path, strongest=-needed + 1e-5), throw=False)
    assert (enough.status, barely.status) == (Status.SOLVED, Status.MISSED)


def test_only_what_stands_in_the_way_gives(tmp_path):
    """A rod that the head alone can tilt: by 30 deg, less the tolerance; 10 are allowed."""
    target = (0.5, 0.0, 0.8660254037844386)
    plan = plan_motion(
        shorten(tmp_path, length=target, head="[-10.0, 10.0]", strongest=-0.1), throw=False
    )
    assert plan.status is Status.MISSED
    (found,) = reach(plan)
    less = np.degrees(2 * np.arcsin(1e-3 / 2))
    assert found.amount == pytest.approx(20.0 - less, abs=1e-3)
    assert str(found) == "largest head psi_Y (step 1): from 10 to 29.95 deg"


def test_what_no_bound_can_mend_is_none(tmp_path):
    """A rod without muscles does not reach beyond its length."""
    written(tmp_path, ROD.split("muscles")[0], "rod.toml")
    text = SHORTEN.format(
        strongest=-1.0, shortest=0.5, target=[0.0, 0.0, 1.2], weight=1.0, head="[0.0, 0.0]"
    )
    plan = plan_motion(load_motion(written(tmp_path, text)), throw=False)
    assert plan.status is Status.MISSED
    assert reach(plan) is None


def test_step_numbers_are_said_in_runs():
    assert step_list((1, 2, 3, 7)) == "steps 1 to 3, 7"
    assert step_list((4,)) == "step 4"
    assert step_list((1, 2)) == "steps 1 to 2"


# --- advice within physics ---------------------------------------------------------------


def test_a_change_is_told_by_the_key_that_the_file_has(tmp_path):
    """All muscles have one key for their change, either way, so one line and the largest."""
    text = POINT.replace('interpolation = "hermite"', "change = [{ activation = 0.0 }]")
    motion = load_motion(written(tmp_path, text))
    bounds = {
        (name, sign): Bound(f"{word} change of {name}", 0.0, sign, "", 0.5, (3,), 9.0, name)
        for sign, word in ((-1, "least"), (1, "largest"))
        for name in ("R1-dl", "L2-ivo")
    }
    excesses = [Excess(bound, 0.1 * i) for i, bound in enumerate(bounds.values(), 1)]
    (line,) = in_words(excesses, motion)
    assert line == "change.activation of phases[2] (step 3): from 0 to 0.4001, for L2-ivo"
    other = Excess(Bound("least activation of R1-dl", -1.0, -1, "", 3.0, (1,), 3.5), 0.5)
    assert in_words([*excesses, other], motion)[1] == str(other)


def test_advice_stays_within_what_a_body_can_do(tmp_path):
    """Whatever the price, no bound gives beyond the paper's activations and a neck's angles."""
    for bound in elastic_rows(shorten(tmp_path, strongest=-0.1, head="[-10.0, 10.0]")).bounds:
        if "change" in bound.name:
            continue
        amount = np.degrees(bound.most) if bound.unit == "deg" else bound.most
        given = bound.value + bound.sign * amount
        if "activation" in bound.name:
            assert -3.5 - 1e-12 <= given <= 0
        elif "extension" in bound.name:
            assert 0.5 - 1e-12 <= given <= 1.6 + 1e-12
        elif "psi_Y" in bound.name:
            assert abs(given) <= 60 + 1e-9
        else:  # this rod has no head, and is clamped in this direction
            assert bound.most == 0


@pytest.mark.parametrize("length", [0.3, 2.0])
def test_what_is_beyond_physics_is_said_to_be(tmp_path, length):
    plan = plan_motion(shorten(tmp_path, length=length, strongest=-1.0), throw=False)
    assert plan.status is Status.MISSED
    assert reach(plan) is None
    # Straight, with a segment of 0.5 to 1.6; no muscle lengthens it beyond 1.
    least = {0.3: 0.2, 2.0: 1.0}[length]
    assert nearest(plan) == pytest.approx(least, abs=5e-3)
    failures = [f for f in explain(plan).findings if f.level == "failure"]
    assert any("bounds suffice" in f.what and "activations to -3.5" in f.what for f in failures)
    assert any(f"{1e3 * nearest(plan):.4g} mm" in d for f in failures for d in f.details)


def test_a_clamped_base_is_not_advised_to_turn(tmp_path):
    target = (0.5, 0.0, 0.8)
    plan = plan_motion(shorten(tmp_path, length=target), throw=False)
    assert plan.status is Status.MISSED
    told = [str(finding) for finding in explain(plan).findings]
    assert not any("head psi" in text for text in told)
    assert not any("psi" in response.name for response in explain(plan).responses)
