"""Dragged points in the page: reached or said not to be, within limits, with the least change."""

import numpy as np
import pytest
from physics_page import physics_tab, trunks
from scipy.optimize import Bounds, LinearConstraint, least_squares, minimize

from trunk_ocp.model.activation import strains
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.buckling import buckling_margin
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.tip_jacobian import tip_jacobian

pytestmark = pytest.mark.slow

L, MUSCLES = 1.75, 28
REACHED = 1e-4 * L
LOWER = np.array([-3.0] * MUSCLES + [-0.3, -0.3])
UPPER = np.array([0.0] * MUSCLES + [0.3, 0.3])
LOADS = {"tip_force": [0.0, 0.0, 40.0], "contact_from": 1.4, "contact_force": [0.0, 10.0, 90.0]}
START = {"activation": [-0.3] * MUSCLES, "head": [0.0, 0.05], "loads": LOADS}
BOUNDS = {"lower": LOWER.tolist(), "upper": UPPER.tolist(), "extension": [0.67, 1.35]}


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with physics_tab(tmp_path_factory.mktemp("follow")) as tab:
        yield tab


def drag(tab, targets, Z=L, bounds=BOUNDS, start=START, trunk="elephant"):
    """Shapes of a drag through targets (n, 3), each from the one before."""
    return tab.evaluate(
        """([name, targets, Z, bounds, { loads, ...start }]) => {
          let now = { ...start, start: null };
          return targets.map((target) => {
            const { activation, head, start } = now;
            now = trunks[name].follow({ Z, target, activation, head, loads, bounds, start });
            return plain(now);
          });
        }""",
        [trunk, np.asarray(targets).tolist(), Z, bounds, start],
    )


def python_shape(controls, loads=LOADS):
    return solve_statics(trunks()["elephant"], controls[:-2], controls[-2:], Loads(**loads))


def controls_of(shape):
    return np.array([*shape["activation"], *shape["head"]])


def first_controls():
    return np.array([*START["activation"], *START["head"]])


def place(controls, Z=L):
    """Where the point is by Python."""
    return python_shape(controls).position([Z])[0]


def assert_within_limits(shape):
    controls = controls_of(shape)
    assert np.all(controls >= LOWER)
    assert np.all(controls <= UPPER)
    zeta_hat = strains(trunks()["elephant"], controls[:-2])[:, 0]
    assert np.all(zeta_hat >= 0.67 - 1e-12)
    assert np.all(zeta_hat <= 1.35 + 1e-12)


@pytest.mark.parametrize("Z", [1.75, 1.31, 0.6])
def test_a_point_is_where_it_is_dragged_to(tab, Z):
    first = place(first_controls(), Z)
    turns = np.linspace(0, 2 * np.pi, 41)[1:]
    circle = [np.sin(turns), 0 * turns, np.cos(turns) - 1]
    targets = first + 0.15 * Z * np.transpose(circle)
    for shape, target in zip(drag(tab, targets, Z), targets, strict=True):
        assert shape["status"] == "ok"
        assert shape["reached"]
        assert_within_limits(shape)
        miss = np.linalg.norm(place(controls_of(shape), Z) - target)
        assert miss < REACHED
        assert shape["error"] == pytest.approx(miss, abs=1e-6)


def test_where_it_cannot_follow_it_says_so_and_stops_at_its_limits(tab):
    first = place(first_controls())
    targets = first + np.linspace(0, 1, 61)[1:, None] * [0.0, 0.0, 3.0]
    shapes = drag(tab, targets)
    for shape in shapes:
        assert shape["status"] == "ok"
        assert_within_limits(shape)
        assert shape["reached"] == (shape["error"] <= REACHED)
    assert shapes[0]["reached"]
    assert not shapes[-1]["reached"]
    miss = np.linalg.norm(place(controls_of(shapes[-1])) - targets[-1])
    assert shapes[-1]["error"] == pytest.approx(miss, abs=1e-6)
    # And it does not tremble there.
    held = drag(
        tab,
        [targets[-1]] * 30,
        start=START | {key: shapes[-1][key] for key in ("activation", "head")},
    )
    change = np.abs(controls_of(held[-1]) - controls_of(held[-2]))
    assert np.all(change <= 1e-3 * (UPPER - LOWER))


OUT_OF_REACH = [[3, 0, 1], [-1, 0, -1], [0.5, 0.5, 3], [0.3, -2.5, -0.5], [1.5, 1.5, 2.5]]


@pytest.mark.parametrize("target", OUT_OF_REACH)
def test_out_of_reach_it_ends_where_no_small_change_brings_it_nearer(tab, target):
    """As near as SciPy's trust region comes from there, and with no slope left within bounds."""
    lower, upper = np.full(MUSCLES + 2, -1.0), np.array([0.0] * MUSCLES + [1.0, 1.0])
    bounds = {"lower": lower.tolist(), "upper": upper.tolist(), "extension": [0.0, 9.0]}
    followed, calls = tab.evaluate(
        """([target, Z, bounds, { loads, ...start }]) => {
          let now = { ...start, start: null }, calls = 0;
          while (!now.settled && calls < 100) {
            const { activation, head, start, memory } = now;
            const controls = { activation, head, start, memory };
            now = trunks.elephant.follow({ Z, target, loads, bounds, ...controls });
            calls += 1;
          }
          return [plain(now), calls];
        }""",
        [target, L, bounds, START],
    )
    assert calls < 50
    assert not followed["reached"]

    def miss_and_slopes(x):
        shape = python_shape(x)
        J, _ = tip_jacobian(shape, x[:-2], x[-2:], Loads(**LOADS))
        return shape.position([L])[0] - target, J

    nearest = least_squares(
        lambda x: miss_and_slopes(x)[0],
        np.clip(first_controls(), lower + 1e-9, upper - 1e-9),
        jac=lambda x: miss_and_slopes(x)[1],
        bounds=(lower, upper),
        x_scale=upper - lower,
        xtol=1e-6,
        max_nfev=60,
    )
    assert followed["error"] <= np.linalg.norm(nearest.fun) + 1e-3 * L
    x = controls_of(followed)
    miss, J = miss_and_slopes(x)
    range_ = upper - lower
    slope = range_ * (miss @ J) / np.linalg.norm(miss)  # m, for the whole range of a control
    projected = x - np.clip(x - range_ * slope / L, lower, upper)
    assert np.abs(projected / range_).max() < 0.01


def test_a_small_drag_is_the_least_change(tab):
    """Moore-Penrose, weighted by ranges: d = S^2 J^T (J S^2 J^T)^-1 e."""
    x = first_controls()
    shape = python_shape(x)
    J, _ = tip_jacobian(shape, x[:-2], x[-2:], Loads(**LOADS))
    e = np.array([3e-4, -2e-4, -4e-4])
    S2 = (UPPER - LOWER) ** 2
    least = S2 * (J.T @ np.linalg.solve(J * S2 @ J.T, e))
    (followed,) = drag(tab, [place(x) + e])
    change = controls_of(followed) - x
    np.testing.assert_allclose(change, least, rtol=0, atol=5e-3 * np.abs(least).max())


def test_a_drag_changes_the_controls_in_proportion(tab):
    first, changes = place(first_controls()), []
    for size in (0.02, 0.01, 0.005):
        (shape,) = drag(tab, [first + size * np.array([1.0, 0.5, -1.0])])
        changes.append(np.abs(controls_of(shape) - first_controls()).max() / size)
    np.testing.assert_allclose(changes, changes[-1], rtol=0.2)


def test_each_step_is_the_least_that_keeps_all_limits(tab):
    """The bounded least squares of a step, against SciPy's interior-point method."""
    rng = np.random.default_rng(0)
    for wanted in 0.15 * rng.normal(size=(4, 3)):
        n, rows, limits = 12, rng.normal(size=(3, 12)), rng.normal(size=(2, 12))
        least, largest = -0.1 * rng.random(n), 0.1 * rng.random(n)
        low, high = -0.02 * rng.random(2), 0.02 * rng.random(2)
        request = {
            "rows": rows.tolist(),
            "wanted": wanted.tolist(),
            "damping": 1e-3,
            "limits": [
                {"row": row.tolist(), "low": a, "high": b}
                for row, a, b in zip(limits, low, high, strict=True)
            ],
            "least": least.tolist(),
            "largest": largest.tolist(),
        }
        z = np.array(tab.evaluate("(request) => leastChange(request)", request))
        H, f = np.eye(n) + rows.T @ rows / 1e-3, rows.T @ wanted / 1e-3
        best = minimize(
            lambda z, H=H, f=f: z @ H @ z / 2 - f @ z,
            np.zeros(n),
            jac=lambda z, H=H, f=f: H @ z - f,
            hess=lambda z, H=H: H,
            method="trust-constr",
            bounds=Bounds(least, largest),
            constraints=LinearConstraint(limits, low, high),
            options={"gtol": 1e-9, "xtol": 1e-12, "maxiter": 500},
        )
        assert np.all((z >= least) & (z <= largest))
        assert np.all((limits @ z >= low - 1e-12) & (limits @ z <= high + 1e-12))
        np.testing.assert_allclose(z, best.x, rtol=0, atol=1e-4)


def test_the_trunk_stops_where_it_would_buckle(tab):
    """Under a thrust at its tip it is pulled straight; Python follows its shapes."""
    loads = {"gravity": 9.8, "tip_force": [0.0, 0.0, -300.0]}
    rest = np.zeros(MUSCLES + 2)
    start = {"activation": rest[:-2].tolist(), "head": [0.0, 0.0], "loads": loads}
    trunk, bounds = trunks()["elephant"], BOUNDS | {"upper": [1.0] * MUSCLES + [0.6] * 2}
    shape = solve_statics(trunk, rest[:-2], rest[-2:], Loads(**loads))
    targets = shape.position([L])[0] + np.linspace(0, 1, 25)[1:, None] * [0.9, 0.0, 0.0]
    followed = drag(tab, targets, bounds=bounds, start=start)
    for found in followed:
        assert found["status"] == "ok"
        x = controls_of(found)
        shape = solve_statics(trunk, x[:-2], x[-2:], Loads(**loads), near=shape)
        np.testing.assert_allclose(shape.position([L])[0], found["position"][-3:], atol=1e-5)
        assert buckling_margin(shape, x[:-2], Loads(**loads)).margin > 0
    assert followed[0]["reached"]
    assert not followed[-1]["reached"]
    assert followed[-1]["margin"] < 1 / 64


def test_controls_beyond_their_bounds_are_not_thrown_back(tab):
    start = START | {"activation": [0.1, *START["activation"][1:]]}
    x = np.array([*start["activation"], *start["head"]])
    (shape,) = drag(tab, [python_shape(x).position([L])[0] + [0.01, 0.0, 0.0]], start=start)
    assert shape["reached"]
    assert np.abs(controls_of(shape) - x).max() < 0.1


def test_without_an_equilibrium_there_is_no_shape_to_drag(tab):
    start = START | {"loads": {"tip_force": [1e12, 0.0, 0.0]}}
    (shape,) = drag(tab, [[0.0, 0.0, 1.0]], start=start)
    assert shape["status"] not in ("ok", "unstable")
    assert shape["position"] is None
    assert (shape["reached"], shape["error"]) == (False, None)
    assert shape["activation"] == start["activation"]


def test_a_rod_without_muscles_follows_with_its_head(tab):
    bounds = {"lower": [-0.5, -0.5], "upper": [0.5, 0.5], "extension": [0.5, 1.5]}
    start = {"activation": [], "head": [0.0, 0.2], "loads": {"gravity": 1.0}}
    trunk = trunks()["bare"]
    tip = solve_statics(trunk, [], (0.0, 0.3), Loads(1.0)).position([1.0])[0]
    (shape,) = drag(tab, [tip], Z=1.0, bounds=bounds, start=start, trunk="bare")
    assert shape["reached"]
    np.testing.assert_allclose(shape["head"], [0.0, 0.3], atol=1e-3)
