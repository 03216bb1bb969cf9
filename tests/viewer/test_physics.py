"""The page's physics in a real browser, opened from disk: shapes, refusals, margins, drags."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from physics_page import WASM, physics_tab, trunks

from trunk_ocp.codegen.webassembly import digest, module_source, recorded_digest
from trunk_ocp.errors import InputError, StaticsError
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.buckling import buckling_margin
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.tip_jacobian import tip_jacobian
from trunk_ocp.rod.unloaded import unloaded_states
from trunk_ocp.rod.volume import section_scale
from trust.validation import rods

pytestmark = pytest.mark.slow

POSITION = 1e-9  # promised, of the length
OTHER = 1e-8  # directors and strains, which converge one order later
MARGIN_STEP = 1 / 64  # to which margins are found
FINDERS = {"ok", "unstable"}  # statuses of shapes


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with physics_tab(tmp_path_factory.mktemp("physics")) as tab:
        yield tab


@dataclass(frozen=True)
class Setting:
    """What one shape depends on."""

    trunk: str
    activation: np.ndarray
    head: np.ndarray
    loads: Loads

    @property
    def arguments(self):
        return trunks()[self.trunk], self.activation, self.head, self.loads

    @property
    def request(self):
        """The argument of `solve` in the page."""
        loads = {
            "gravity": self.loads.gravity,
            "tip_force": self.loads.tip_force,
            "contact_from": self.loads.contact_from,
            "contact_force": self.loads.contact_force,
            "contact_couple": self.loads.contact_couple,
        }
        return {
            "activation": self.activation.tolist(),
            "head": self.head.tolist(),
            "loads": loads,
        }


def solved(tab, settings):
    """What the page finds for settings, each cold."""
    requests = [(setting.trunk, setting.request) for setting in settings]
    found = tab.evaluate(
        "(all) => all.map(([name, request]) => plain(trunks[name].solve(request)))", requests
    )
    return [_arrays(shape) for shape in found]


def _arrays(shape):
    return {key: np.array(x) if isinstance(x, list) else x for key, x in shape.items()}


def settings(name, count, seed, activation, force):
    """Random settings; loads up to `force` in N, half of them with contact and a couple."""
    trunk, rng = trunks()[name], np.random.default_rng(seed)
    for _ in range(count):
        low, high = activation
        gamma = rng.uniform(low, high, len(trunk.muscles))
        head = rng.uniform(-0.6, 0.6, 2)
        tip, contact, couple = force * rng.uniform(-1, 1, (3, 3))
        loads = Loads(9.8 * rng.integers(2), tuple(tip))
        if rng.random() < 0.5:
            start = rng.uniform(0.0, 0.9) * trunk.length
            loads = Loads(9.8, tuple(tip), start, tuple(contact), tuple(couple * trunk.length / 2))
        yield Setting(name, gamma, head, loads)


@cache
def random_settings():
    """200 of them, some beyond what a trunk can bear."""
    return [
        *settings("elephant", 90, 1, (-3.0, 0.0), 60.0),  # bounds of the shipped motions
        *settings("elephant", 20, 2, (-3.0, 0.0), 500.0),
        *settings("elephant", 5, 3, (-40.0, 0.0), 60.0),  # segments collapse
        *settings("elephant", 5, 4, (-3.0, 0.0), 1e12),
        *settings("bender", 35, 5, (-0.5, 0.3), 3.0),
        *settings("toy", 25, 6, (-0.5, 0.0), 3.0),
        *settings("bare", 18, 7, (0.0, 0.0), 2.0),
        *settings("wire", 2, 8, (0.0, 0.0), 1.0),
    ]


@cache
def expected(number):
    """A setting's shape by `solve_statics`, and to round-off; None if it refuses."""
    trunk, activation, head, loads = random_settings()[number].arguments
    try:
        shape = solve_statics(trunk, activation, head, loads)
    except (StaticsError, InputError):
        return None
    fine = mesh_for(trunk, loads.contact_from, 14, 10)
    return shape, solve_statics(trunk, activation, head, loads, near=shape.on(fine))


@pytest.fixture(scope="module")
def pairs(tab):
    """Each random setting with the page's shape and Python's, coarse and fine, or None."""
    found = solved(tab, random_settings())
    return [(s, found[i], expected(i)) for i, s in enumerate(random_settings())]


@pytest.fixture(scope="module")
def shapes(pairs):
    return [(setting, found, both[1]) for setting, found, both in pairs if both is not None]


# Shapes


def test_every_refusal_agrees(pairs):
    assert len(pairs) == 200
    for setting, found, wanted in pairs:
        assert (found["status"] in FINDERS) == (wanted is not None), (setting, found["status"])
    refused = {found["status"] for _, found, wanted in pairs if wanted is None}
    assert "collapsed" in refused
    assert len(refused) > 1


def test_positions_are_those_of_solve_statics(shapes):
    assert len(shapes) > 180
    for setting, found, wanted in shapes:
        L = trunks()[setting.trunk].length
        error = np.abs(found["position"].reshape(-1, 3) - wanted.position(found["Z"])).max()
        assert error < POSITION * L, setting


def test_the_rest_of_a_shape_is_that_of_solve_statics(shapes):
    for setting, found, wanted in shapes:
        directors = found["directors"].reshape(-1, 3, 3)
        np.testing.assert_allclose(directors, wanted.directors(found["Z"]), rtol=0, atol=OTHER)
        np.testing.assert_allclose(found["strain"], wanted.strain(found["Z"])[0], atol=OTHER)
        moment = wanted.moment([0.0])[0]
        size = np.abs(moment).max() + 1e-6
        np.testing.assert_allclose(found["base_moment"], moment, rtol=0, atol=OTHER * size)
        trunk = trunks()[setting.trunk]
        scale = section_scale(trunk, wanted)
        np.testing.assert_allclose(found["scale"], scale, rtol=OTHER)


def test_unloaded_shapes_are_the_closed_form(pairs):
    for setting, found, _ in pairs:
        trunk, activation, head, _ = setting.arguments
        if found["status"] == "collapsed":
            assert found["unloaded"] is None
            continue
        Z = np.array(found["Z"])
        r, _ = unloaded_states(trunk, activation, head, Z)
        position = np.reshape(found["unloaded"]["position"], (-1, 3))
        np.testing.assert_allclose(position, r, rtol=0, atol=1e-13 * trunk.length)


def test_the_verdict_on_stability_is_that_of_the_second_variation(pairs):
    for setting, found, both in pairs:
        if both is None:
            continue
        stability = buckling_margin(both[0], setting.activation, setting.loads)
        assert (found["status"] == "ok") == stability.stable, setting
        if stability.stable:
            assert 0 < found["margin"]
            assert -1e-5 <= stability.margin - found["margin"] <= MARGIN_STEP + 1e-5, setting
        else:
            assert found["margin"] == 0


def test_a_column_buckles_at_eulers_load(tab):
    euler = math.pi**2 / 4  # N, for E I = 1 N m^2 and L = 1 m
    thrusts = np.array([0.0, 0.3, 0.9, 0.999, 1.001, 2.0, 20.0])
    columns = [
        Setting("wire", rods.NONE, np.zeros(2), Loads(0.0, (0.0, 0.0, -euler * thrust)))
        for thrust in thrusts
    ]
    found = solved(tab, columns)
    assert [shape["status"] for shape in found] == ["ok"] * 4 + ["unstable"] * 3
    margins = np.array([shape["margin"] for shape in found])
    wanted = np.maximum(1 - thrusts, 0)
    assert np.all((margins <= wanted + 1e-5) & (margins >= wanted - MARGIN_STEP))


def test_a_warm_shape_is_the_cold_one(tab):
    setting = random_settings()[0]
    warm, cold, again = tab.evaluate(
        """([name, request]) => {
          const trunk = trunks[name];
          const rest = request.activation.map(() => 0);
          let shape = trunk.solve({ ...request, activation: rest });
          const first = shape;
          for (let i = 1; i <= 10; i += 1) {
            const activation = request.activation.map((x) => (x * i) / 10);
            shape = trunk.solve({ ...request, activation, start: shape.start });
          }
          const cold = trunk.solve(request);
          return plain([shape, cold, trunk.solve({ ...request, start: first.start })]);
        }""",
        [setting.trunk, setting.request],
    )
    for other in (warm, again):
        np.testing.assert_allclose(other["position"], cold["position"], rtol=0, atol=2e-9)


def test_two_trunks_in_turn_do_not_disturb_each_other(tab):
    chosen = [random_settings()[0], random_settings()[130]]
    alone = solved(tab, chosen)
    requests = [(setting.trunk, setting.request) for setting in chosen]
    together = tab.evaluate(
        """(requests) => {
          const starts = [null, null];
          const last = [null, null];
          for (let i = 0; i < 3; i += 1) {
            requests.forEach(([name, request], k) => {
              // With the other trunk's start, too: it is no help, but it does no harm.
              trunks[name].solve({ ...request, start: starts[1 - k] });
              last[k] = trunks[name].solve({ ...request, start: starts[k] });
              starts[k] = last[k].start;
            });
          }
          return plain(last);
        }""",
        requests,
    )
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_allclose(other["position"], one["position"], rtol=0, atol=2e-9)


def test_the_jacobian_is_that_of_the_tip(tab):
    setting = random_settings()[0]
    trunk, activation, head, loads = setting.arguments
    rows = tab.evaluate(
        """([{ activation, head, loads }, Z]) => {
          trunks.elephant.enter(activation, head, loads);
          trunks.elephant.found(loads, { asked: Z });
          return plain(trunks.elephant.slopes().rows);
        }""",
        [setting.request, trunk.length],
    )
    wanted, _ = tip_jacobian(expected(0)[1], activation, head, loads)
    np.testing.assert_allclose(rows, wanted, rtol=0, atol=OTHER * np.abs(wanted).max())


def test_a_shape_that_is_not_found_is_not_there(pairs):
    for _, found, wanted in pairs:
        if wanted is None:
            missing = [found[key] for key in ("position", "directors", "strain", "margin")]
            assert missing == [None] * 4


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"activation": [0.0] * 27}, "activation: expected 28 numbers, got 27"),
        ({"head": [0.0]}, "head: expected 2 numbers, got 1"),
        ({"loads": {"tip_force": [1.0]}}, "tip_force: expected 3 numbers, got 1"),
        (
            {"loads": {"contact_from": 1.75}},
            "contact_from = 1.75: expected Z in m from 0 to below 1.75",
        ),
    ],
)
def test_wrong_arguments_are_refused(tab, change, told):
    request = random_settings()[0].request | change
    message = tab.evaluate(
        """(request) => {
          try {
            return trunks.elephant.solve(request).status;
          } catch (error) {
            return error.message;
          }
        }""",
        request,
    )
    assert told in message


def test_numbers_that_are_not_finite_give_no_shape(tab):
    status = tab.evaluate(
        """() => [NaN, Infinity].map((x) =>
          trunks.toy.solve({ activation: [x, 0], head: [0, 0] }).status)"""
    )
    assert status == ["not-finite"] * 2


# The module


def test_the_module_is_made_from_the_sources_as_they_are():
    told = "run `make module` and commit trunk_ocp/viewer/viewer/physics.wasm"
    assert recorded_digest(WASM) == digest(module_source()), told


def test_the_module_asks_for_nothing_and_is_small(tab):
    imports = tab.evaluate("WebAssembly.compile(bytes).then((m) => WebAssembly.Module.imports(m))")
    assert imports == []
    assert len(WASM) < 64_000
