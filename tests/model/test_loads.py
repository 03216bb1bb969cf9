"""Weight, tip force and contact, eqs. (12), (13), (15), (28), against quadrature."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import (
    Loads,
    contact_share,
    couple_density,
    internal_force,
    internal_forces,
    mass_beyond,
)

LOG = Loads(9.8, (3.0, -4.0, 5.0), 1.4, (10.0, 20.0, 144.5), (-113.8, 7.0, 2.0))


def test_the_elephant_trunk_weighs_what_the_design_notes_say(trunk):
    assert float(mass_beyond(trunk, 0.0)) == pytest.approx(114.743, abs=5e-4)  # as printed
    assert float(mass_beyond(trunk, trunk.length)) == 0.0


@pytest.mark.parametrize("taper", [0.0, 1e-7, 2.0])
@pytest.mark.parametrize("Z", [0.0, 0.31, 0.999, 1.0])
def test_mass_beyond_is_the_integral_of_the_linear_density(build, taper, Z):
    rod = build(taper_deg=taper)

    def linear_density(at):
        return 1000.0 * math.pi * (0.05 - at * math.tan(math.radians(taper))) ** 2

    expected = quad(linear_density, Z, 1.0, epsabs=0, epsrel=1e-13)[0] if Z < 1 else 0.0
    # Near the tip (28) subtracts numbers of the size of the whole mass: absolute round-off.
    whole = 1000.0 * math.pi * 0.05**2
    assert float(mass_beyond(rod, Z)) == pytest.approx(expected, rel=1e-12, abs=1e-15 * whole)


def test_contact_share_is_one_before_contact_and_falls_linearly_to_zero(trunk):
    Z = np.array([0.0, 1.4, 1.4 + 0.25 * 0.35, 1.75])
    np.testing.assert_allclose(contact_share(LOG, trunk, Z), [1, 1, 0.75, 0], atol=1e-15)
    np.testing.assert_array_equal(contact_share(Loads(), trunk, Z), np.zeros(4))


def test_the_force_on_a_section_is_everything_that_hangs_beyond_it(trunk):
    for Z in (0.0, 0.9, 1.5, 1.75):
        touched = max(0.0, 1.75 - max(Z, 1.4)) / 0.35
        R = [0.1185 * 1.75 - at * math.tan(math.radians(4.81)) for at in (Z, 1.75)]
        cone = math.pi / 3 * (1.75 - Z) * (R[0] ** 2 + R[0] * R[1] + R[1] ** 2)
        expected = np.array([3, -4, 5]) + touched * np.array([10, 20, 144.5])
        expected[2] += 9.8 * 1059.7 * cone
        # 1.2 kN of weight, rounded at 1e-16 several times.
        found = internal_force(LOG, trunk, np.array([Z]))[0]
        np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize("contact_from", [0.0, 1.0, 1.4])
def test_contact_force_and_couple_are_spread_evenly_and_add_up(trunk, contact_from):
    load = Loads(0.0, (0, 0, 0), contact_from, (10.0, 20.0, 144.5), (-113.8, 7.0, 2.0))
    n = internal_force(load, trunk, np.array([0.0, 1.75]))
    np.testing.assert_allclose(n[0] - n[1], (10.0, 20.0, 144.5), rtol=1e-14)  # eq. (12)
    points = [contact_from] if contact_from else None
    for axis in range(3):
        density = lambda Z, axis=axis: couple_density(load, trunk, np.array([Z]))[0, axis]
        total = quad(density, 0, 1.75, points=points, epsabs=1e-12)[0]
        assert total == pytest.approx(load.contact_couple[axis], rel=1e-12)  # eq. (13)


def test_without_contact_there_is_no_couple(trunk):
    density = couple_density(Loads(), trunk, np.array([0.0, 1.7]))
    np.testing.assert_array_equal(density, np.zeros((2, 3)))


def test_scaled_loads_are_every_load_times_the_fraction():
    half = LOG.scaled(0.5)
    assert half == Loads(4.9, (1.5, -2.0, 2.5), 1.4, (5.0, 10.0, 72.25), (-56.9, 3.5, 1.0))


def test_vectors_may_be_arrays_or_lists_and_loads_stay_hashable():
    load = Loads(tip_force=np.array([1, 2, 3]), contact_from=1.4, contact_force=[0, 0, 5])
    assert (load.tip_force, load.contact_force) == ((1.0, 2.0, 3.0), (0.0, 0.0, 5.0))
    assert hash(load) == hash(load.scaled(1.0))


@pytest.mark.parametrize("name", ["tip_force", "contact_force", "contact_couple"])
@pytest.mark.parametrize("bad", [(1.0, 2.0), 3.0, (0, 0, math.nan), (0, 0, math.inf), "down"])
def test_a_vector_that_is_not_three_finite_numbers_is_refused(name, bad):
    with pytest.raises(InputError, match=rf"loads\.{name} = .*: expected three finite numbers"):
        Loads(contact_from=1.0, **{name: bad})


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_gravity_that_is_not_finite_is_refused(bad):
    with pytest.raises(InputError, match=r"loads\.gravity"):
        Loads(gravity=bad)


@pytest.mark.parametrize("name", ["contact_force", "contact_couple"])
def test_a_contact_load_needs_a_place(name):
    with pytest.raises(InputError, match=r"loads\.contact_from: missing"):
        Loads(**{name: (0.0, 0.0, 1.0)})


@pytest.mark.parametrize("bad", [-0.1, 1.75, 2.0])
def test_contact_starts_on_the_trunk(trunk, bad):
    load = Loads(contact_from=bad, contact_force=(0, 0, 1.0))
    with pytest.raises(InputError, match=r"loads\.contact_from.*0 <= Z_w < L"):
        internal_force(load, trunk, np.array([0.5]))


def test_forces_of_several_loads_are_those_of_each(trunk):
    Z = np.linspace(0, trunk.length, 7)
    loads = [LOG, Loads(), Loads(0.0, (1.0, 2.0, 3.0))]
    together = internal_forces(loads, trunk, Z)
    each = [internal_force(load, trunk, Z) for load in loads]
    np.testing.assert_allclose(together, each, rtol=1e-14)
    assert internal_forces([], trunk, Z).shape == (0, 7, 3)
