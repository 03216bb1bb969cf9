"""Natural frequencies against closed forms: beams, a chain, the elephant's trunk."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import iv, jn_zeros, jv, kv, yv

from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.buckling import buckling_margin
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.flutter import flutter, natural_frequencies
from trunk_ocp.rod.statics import solve_statics

NONE, STILL = np.zeros(0), Loads(0.0)


def thin(build, stiffness=1.0, radius=1e-5, **changes):
    """A rod of 1 m with E I = `stiffness` N m^2 and 1 kg/m at its base.

    It is so thin that it stretches and twists much faster than it bends, and that the rotation of
    its sections does not slow it.
    """
    material = {
        "youngs_modulus": 4 * stiffness / math.pi / radius**4,
        "poisson_ratio": 0.3,
        "density": 1 / math.pi / radius**2,
    }
    return build(base_radius_over_length=radius, material=material, **changes)


def roots(function, grid):
    """Roots of a function in the order of a grid that separates them."""
    values = [function(b) for b in grid]
    pairs = zip(pairwise(grid), pairwise(values), strict=True)
    return np.array([brentq(function, a, b) for (a, b), (f, g) in pairs if f * g < 0])


def frequencies(rod, load, mesh):
    return natural_frequencies(solve_statics(rod, NONE, loads=load, mesh=mesh), NONE, load)


def test_a_uniform_cantilever(build):
    (b,) = roots(lambda b: 1 + math.cos(b) * math.cosh(b), [1.0, 3.0])
    (second,) = roots(lambda b: 1 + math.cos(b) * math.cosh(b), [4.0, 5.0])
    rod = thin(build)
    expected = np.square([b, b, second]) / (2 * math.pi)  # in both planes
    found = frequencies(rod, STILL, mesh_for(rod))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("tip", [0.7, 0.3])
def test_a_tapered_cantilever(build, tip):
    """A truncated cone, clamped at its thick end (Kirchhoff 1879), in Bessel functions.

    With x from the point of the cone, (x^4 w'')'' = k^2 x^2 w has the solutions C_2(z) / x,
    z = 2 sqrt(k x), and d/dx (C_n / x^(n/2)), d/dx (x^(n/2) C_n) are Bessel functions again.
    """
    base = 1 / (1 - tip)  # distance of the base from the point, for a length of 1

    def determinant(k):
        def row(x, n, signs):
            z = 2 * math.sqrt(k * x)
            return [s * f(n, z) for s, f in zip(signs, (jv, yv, iv, kv), strict=True)]

        end = base - 1
        matrix = [
            row(base, 2, (1, 1, 1, 1)),  # w
            row(base, 3, (-1, -1, 1, -1)),  # w'
            row(end, 4, (1, 1, 1, 1)),  # w''
            row(end, 3, (1, 1, 1, -1)),  # (x^4 w'')'
        ]
        return np.linalg.det(np.array(matrix) / np.abs(matrix).max(axis=1, keepdims=True))

    k = roots(determinant, np.linspace(1, 100, 500))[:2]
    rod = thin(build, taper_deg=math.degrees(math.atan(1e-5 * (1 - tip))))
    # E I = (x / base)^4 and the mass per length (x / base)^2: omega = k / base.
    first, second = k / base / (2 * math.pi)
    found = frequencies(rod, STILL, mesh_for(rod, elements=8))
    np.testing.assert_allclose(found, [first, first, second], rtol=1e-5)


def test_a_rod_without_stiffness_hangs_like_a_chain(build):
    """omega = j / 2 sqrt(g / L), j a zero of J_0 (Bernoulli 1732), as E I goes to 0."""
    rod = thin(build, stiffness=1e-8, radius=1e-6)
    mesh = mesh_for(rod, elements=14, at=[1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 0.03, 0.1, 0.99])
    one, two = jn_zeros(0, 2) / 2 * math.sqrt(9.8) / (2 * math.pi)
    found = frequencies(rod, Loads(9.8), mesh)
    np.testing.assert_allclose(found, [one, one, two], rtol=1e-3)


def test_the_elephants_trunk_swings_once_a_second(trunk):
    """1.04, 1.05 and 3.2 Hz by another code, whose sections have no rotary inertia; the log's mass
    at the tip, with its weight, makes it 0.72 Hz there."""
    rest = np.zeros(28)
    found = natural_frequencies(solve_statics(trunk, rest), rest, Loads())
    np.testing.assert_allclose(found[:2], [1.04, 1.05], rtol=0.01)
    np.testing.assert_allclose(found[2], 3.2, rtol=0.025)
    np.testing.assert_allclose(
        found, flutter(solve_statics(trunk, rest), rest, Loads()).rates[:3].imag / 2 / math.pi
    )
    weight = 144.5203
    load = Loads(tip_force=(0.0, 0.0, weight))
    shape = solve_statics(trunk, rest, loads=load)
    found = natural_frequencies(shape, rest, load, tip_mass=weight / 9.8)
    np.testing.assert_allclose(found[0], 0.72, rtol=0.02)


def test_a_rod_that_buckles_has_no_lowest_frequency(build):
    rod = thin(build)
    load = Loads(0.0, (0.0, 0.0, -1.01 * math.pi**2 / 4))
    shape = solve_statics(rod, NONE, loads=load, mesh=mesh_for(rod))
    assert not buckling_margin(shape, NONE, load).stable
    assert natural_frequencies(shape, NONE, load)[0] == 0


def test_a_couple_fixed_in_space_and_batches(trunk, draw):
    activation = draw(trunk, 2, seed=7)
    load = Loads(9.8, contact_from=1.4, contact_couple=(-60.0, 0.0, 0.0))
    shape = solve_statics(trunk, activation, loads=load)
    both = natural_frequencies(shape, activation, load, 10.0)
    expected = flutter(shape, activation, load, 10.0).rates[:, :3].imag / (2 * math.pi)
    np.testing.assert_allclose(both, expected)
