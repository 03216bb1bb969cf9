"""Violated constraints: planted one by one, and named where they were planted."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from plans import in_equilibrium, shipped

from trunk_ocp.nlp.violations import MAX_VIOLATIONS, Violation, violations
from trunk_ocp.nlp.window import Window
from trunk_ocp.problem.weights import Weights
from trunk_ocp.rod.collocation import gauss, mesh_for

L = 1.75
STEPS = slice(0, 4)  # of pick-fruit: a direction held from step 1, pulls along it from step 2 on


@cache
def feasible():
    """Window, unknowns and constraints' values of a point that keeps every constraint."""
    motion = shipped("pick-fruit")
    mesh = mesh_for(motion.trunk, motion.contact_from, 8, 6)
    rest = np.zeros(30)
    rng = np.random.default_rng(5)
    x = np.tile(-0.02 * rng.random(30), (4, 1))
    window = Window(motion, mesh, motion.steps[STEPS], rest, {}, 0, Weights())
    full = window.pack(x, in_equilibrium(window, x)[0])
    return window, full


def of(window, full):
    """Values of a window's constraints."""
    nlp = window.nlp.as_casadi()
    g = ca.Function("g", [nlp["x"], nlp["p"]], [nlp["g"]])
    return np.asarray(g(full, window.parameters)).ravel()


def planted(change):
    """What is found after a change of the feasible point: (window, unknowns) -> None."""
    window, full = feasible()
    full = full.copy()
    change(window, full)
    return violations(window, full, of(window, full))


def about(found, what):
    """The one violation whose name starts so."""
    (one,) = (violation for violation in found if violation.what.startswith(what))
    return one


def test_a_point_that_keeps_every_constraint_violates_none():
    window, full = feasible()
    assert violations(window, full, of(window, full)) == ()


def test_an_activation_shows_in_what_its_muscles_make_of_a_segment():
    """0.5 of dl in segment 2 is +0.0875 of extension, +1.968 of curvature (Tables 1, 2)."""
    window, *_ = feasible()
    muscle = window.motion.trunk.muscles.index("R2-dl")

    def change(window, full):
        full[window.unknowns[2].x[muscle]] -= 0.5

    found = planted(change)
    curvature = about(found, "curvature u_1 made by the muscles of segment 2")
    assert (curvature.step, curvature.Z, curvature.unit) == (3, None, "1/m")
    assert curvature.value == pytest.approx(0.5 * 1.968056 / L, rel=1e-6)
    assert curvature.lower == curvature.upper == 0.0
    # Of one segment's strains the worst stands for all; others are not named a second time.
    assert not any("segment 2" in v.what for v in found if v is not curvature)


def test_an_extension_that_muscles_take_out_of_bounds_is_told_with_the_bounds():
    window, *_ = feasible()
    muscles = [i for i, m in enumerate(window.motion.trunk.muscles) if m[1] == "1"]

    def change(window, full):
        full[window.unknowns[1].strain[0, 0]] = 0.67  # where the variable stops
        full[window.unknowns[1].x[muscles]] -= 3.0 * np.ones(len(muscles))

    window, full = feasible()
    full = full.copy()
    change(window, full)
    g = of(window, full)
    # Take the row of the extension alone, whatever curvature comes with it.
    strains = [block for block in window.blocks if block.variables is not None]
    others = np.concatenate([block.rows[..., 1:].ravel() for block in strains])
    g[others - 1] = 0.0
    (found,) = (v for v in violations(window, full, g) if "made by the muscles" in v.what)
    by_hand = 2 * (0.126081 + 0.032572 + 0.031759 - 0.037277 - 0.031888)  # both sides, unit each
    base = full[window.unknowns[0].x[muscles]]
    sides = np.array([0.126081, 0.032572, 0.031759, -0.037277, -0.031888] * 2)
    assert found.value == pytest.approx(1 + sides @ base - 3 * by_hand, abs=1e-5)
    assert (found.step, found.lower, found.upper) == (2, 0.67, 1.35)
    assert str(found).startswith("step 2: extension made by the muscles of segment 1 is 0.")


def test_an_extension_within_bounds_is_not_said_to_leave_them():
    def change(window, full):
        full[window.unknowns[0].strain[2, 0]] += 0.1

    found = about(planted(change), "extension made by the muscles of segment 3")
    assert (found.value, found.lower, found.upper) == (pytest.approx(1.1), 1.0, 1.0)
    assert "off by 0.1" in str(found)


@pytest.mark.parametrize(("component", "what", "unit"), [
    (2, "the frame's equation", ""),
    (5, "balance of moments about d2", "N m"),
])  # fmt: skip
def test_a_rod_out_of_balance_is_located_at_its_worst_gauss_point(component, what, unit):
    """The slope of the collocation polynomial is largest where the state was changed."""
    size = 1e-2

    def change(window, full):
        full[window.unknowns[3].inner[1, 4, component]] += size

    window, *_ = feasible()
    found = about(planted(change), what)
    assert (found.step, found.unit) == (4, unit)
    # Rows are the polynomial's derivatives at the nodes; the rates change little beside them.
    slopes = np.abs(gauss(6).derivative[:, 5])
    node = int(np.argmax(slopes))
    assert found.Z == pytest.approx(window.mesh.points[1, node], rel=1e-12)
    scale = window.moment if unit else 1.0
    assert abs(found.value) == pytest.approx(size * slopes[node] * scale, rel=0.1)
    assert found.others >= 3


def test_a_break_between_elements_is_located_and_measured():
    def change(window, full):
        rod = window.unknowns[1]  # all beyond the third element: a moment about d1
        full[np.concatenate([rod.edges[3:, 4], rod.inner[3:, :, 4].ravel()])] += 0.01

    window, *_ = feasible()
    found = about(planted(change), "continuity of the moment about d1")
    assert (found.step, found.unit) == (2, "N m")
    assert found.Z == pytest.approx(window.mesh.edges[3], rel=1e-12)
    assert found.value == pytest.approx(0.01 * window.moment, rel=1e-6)
    trunk = window.motion.trunk
    stiffness = trunk.youngs_modulus * np.pi / 4 * trunk.base_radius**4  # E I(0), eq. (7)
    assert found.value == pytest.approx(0.01 * stiffness / L, rel=1e-6)


def test_a_broken_centerline_is_located_and_measured_in_metres():
    def change(window, full):
        full[window.unknowns[2].line[-1, 1]] += 0.02 / L

    (found,) = planted(change)
    assert found.what == "the centerline, coordinate Y,"
    assert (found.step, found.Z, found.unit) == (3, pytest.approx(L), "m")
    assert found.value == pytest.approx(0.02, rel=1e-6)
    assert str(found) == "step 3: the centerline, coordinate Y, at Z = 1.750 m off by 0.02 m"


def test_a_base_off_its_place_is_told():
    def change(window, full):
        full[window.unknowns[0].line[:, 2]] += 0.003 / L  # the whole centerline

    (found,) = planted(change)
    assert (found.what, found.step, found.unit) == ("position of the base", 1, "m")
    assert found.value == pytest.approx(0.003, rel=1e-6)


def test_a_pull_along_another_direction_is_measured_in_newton():
    def change(window, full):
        full[window.unknowns[3].tip_force[0]] += 2.5 / window.force

    found = about(planted(change), "the pull along a held direction, X,")
    assert (found.step, found.unit) == (4, "N")
    assert found.value - found.lower == pytest.approx(2.5, rel=1e-6)


def test_a_held_direction_that_is_not_the_trunks_is_told():
    def change(window, full):
        full[next(iter(window.held.values()))[1]] += 0.07

    found = about(planted(change), "the held direction")
    assert (found.step, found.value) == (1, pytest.approx(0.07, rel=1e-6))


def test_each_muscle_that_changes_too_fast_is_named():
    """pick-fruit allows 0.02 a step from step 2 on, and no turn of the head."""
    names = ("L2-ivo", "R1-vr")
    window, *_ = feasible()
    indices = [window.motion.trunk.muscles.index(name) for name in names]

    def change(window, full):
        full[window.unknowns[1].x[indices[0]]] -= 0.3
        full[window.unknowns[1].x[indices[1]]] -= 0.1
        full[window.unknowns[2].x[-1]] += np.radians(3.0)

    found = planted(change)
    first, second = (about(found, f"change of {name}") for name in names)
    assert (first.step, first.value) == (2, pytest.approx(-0.3))
    assert (first.lower, first.upper) == (pytest.approx(-0.02), pytest.approx(0.02))
    assert first.others == 1  # and back again at step 3
    assert second.value == pytest.approx(-0.1)
    head = about(found, "change of psi_Y")
    assert (head.step, head.value, head.unit) == (3, pytest.approx(3.0), "deg")
    assert "(and less at 1 other place)" in str(first)


def test_a_target_inside_an_element_is_named_by_its_own_place():
    """Step 5 of lift-log alone: the window's first step is not the motion's."""
    motion = shipped("lift-log")
    mesh = mesh_for(motion.trunk, motion.contact_from, 3, 6)
    x = np.zeros((1, 30))
    window = Window(motion, mesh, motion.steps[4:5], x[0], {}, 4, Weights())
    full = window.pack(x, in_equilibrium(window, x)[0])
    assert violations(window, full, of(window, full)) == ()
    Z = motion.steps[4].targets[2].Z
    q, r = window.unknowns[0].points[Z]
    full[r[2]] += 0.004 / L
    full[q[1]] += 0.001
    position, frame = violations(window, full, of(window, full))
    assert (position.what, position.unit) == ("the position at a target, coordinate Z,", "m")
    assert (frame.what, frame.unit) == ("the frame at a target", "")
    assert (position.step, position.Z) == (frame.step, frame.Z) == (5, Z)
    assert position.value == pytest.approx(0.004, rel=1e-6)
    assert frame.value == pytest.approx(0.001, rel=1e-6)


def test_a_mean_that_is_not_the_segments_is_told():
    def change(window, full):
        full[window.unknowns[1].mean] += 0.05

    found = about(planted(change), "the mean extension")
    assert (found.step, found.value) == (2, pytest.approx(0.05))


def test_the_worst_comes_first_and_no_number_before_all():
    window, full = feasible()
    full = full.copy()
    full[window.unknowns[0].line[-1]] += 0.1
    g = of(window, full)
    row = next(block.rows[0] for block in window.blocks if block.meaning.name == "mean extension")
    g[row - 1] = np.nan
    found = violations(window, full, g)
    assert found[0].what == "the mean extension"
    assert found[0].excess == np.inf
    assert [v.excess for v in found] == sorted((v.excess for v in found), reverse=True)
    assert len(found) <= MAX_VIOLATIONS


def test_a_bound_and_an_equation_read_differently():
    bound = Violation(2, "change of psi_Z", None, 9.0, -5.0, 5.0, "deg")
    assert str(bound) == "step 2: change of psi_Z is 9 deg, allowed -5 to 5"
