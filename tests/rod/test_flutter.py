"""Vibrations against closed forms of beams, a shooting method and a chain; flutter of Nicolai."""

import math
from itertools import pairwise

import numpy as np
import pytest
from discrete_rod import chain, vibrations
from plans import planned
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, newton

from trunk_ocp.analysis.diagnosis import explain
from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.storage import summary
from trunk_ocp.rod.buckling import buckling_margin
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.flutter import flutter
from trunk_ocp.rod.statics import solve_statics

NONE, REST = np.zeros(0), np.zeros(28)
STILL = Loads(0.0)
RADIUS, NU = 1e-4, 0.3
# L = 1 m, E I = 1 N m^2 and 1 kg/m, and so thin that rotary inertia slows by 1e-7 at most.
WIRE = {
    "base_radius_over_length": RADIUS,
    "material": {
        "youngs_modulus": 4 / math.pi / RADIUS**4,
        "poisson_ratio": NU,
        "density": 1 / math.pi / RADIUS**2,
    },
}


def rates(rod, load, mesh=None, **masses):
    """Rates of a rod without muscles."""
    shape = solve_statics(rod, NONE, loads=load, mesh=mesh or mesh_for(rod, load.contact_from, 8))
    return flutter(shape, NONE, load, **masses).rates


# --- frequencies ---------------------------------------------------------------------------


@pytest.mark.parametrize("tip_mass", [0.0, 0.7])
def test_bending_frequencies_of_a_clamped_free_beam_with_a_mass_at_its_tip(build, tip_mass):
    def determinant(b):  # 1 + cos cosh - b m (sin cosh - cos sinh) = 0, Rayleigh
        c, s, ch, sh = math.cos(b), math.sin(b), math.cosh(b), math.sinh(b)
        return 1 + c * ch - b * tip_mass * (s * ch - c * sh)

    grid = np.linspace(0.1, 12, 500)
    roots = [
        brentq(determinant, a, b) for a, b in pairwise(grid) if determinant(a) * determinant(b) < 0
    ]
    found = rates(build(**WIRE), STILL, tip_mass=tip_mass).imag
    expected = np.repeat(np.square(roots), 2)[:6]  # in both planes
    np.testing.assert_allclose(found[:6], expected, rtol=1e-6)


def test_a_thick_rod_twists_and_stretches_as_fast_as_its_waves_run(build):
    rod = build(base_radius_over_length=0.1)
    speed = math.sqrt(rod.youngs_modulus / rod.density)
    found = rates(rod, STILL).imag
    for wave in (speed, speed / math.sqrt(2 * (1 + rod.poisson_ratio))):
        for odd in (1, 3):
            expected = odd * math.pi / 2 * wave / rod.length
            assert np.min(np.abs(found / expected - 1)) < 1e-8


def test_a_rod_under_a_thrust_slows_to_rest_where_it_buckles(build):
    rod, euler = build(**WIRE), math.pi**2 / 4
    near = rates(rod, Loads(0.0, (0.0, 0.0, -0.999 * euler)))
    assert near[0].imag < 0.05 * rates(rod, STILL)[0].imag
    beyond = rates(rod, Loads(0.0, (0.0, 0.0, -1.01 * euler)))
    slow = np.argsort(np.abs(beyond))[:2]
    assert np.all(beyond[slow].real > 0)
    assert np.all(beyond[slow].imag == 0)
    assert np.all(np.delete(beyond, slow).real == 0)


# --- Nicolai's column ----------------------------------------------------------------------


def end_values(square, couple, start):
    """Moment and force at the free end of a beam of complex deflection w = x + i y, from its base.

    E I = mass = L = 1, and a couple fixed in space along the beam, spread over [start, 1]. From the
    balance of moments i w'' + T w' = M and M' = - i N, with N' = - omega^2 w (Nicolai 1928; Ziegler
    1968, sections 5.3 and 5.4).
    """

    def slope(z, y):
        w, dw, M, N = y.reshape(4, 2)
        T = couple * (1 - max(z, start)) / (1 - start)
        return np.concatenate([dw, (M - T * dw) / 1j, -1j * N, -square * w])

    y = np.array([0, 0, 0, 0, 1, 0, 0, 1], dtype=complex)
    for part in ((0.0, start), (start, 1.0)):
        if part[1] > part[0]:
            y = solve_ivp(slope, part, y, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    return np.linalg.det(y[4:].reshape(2, 2))


@pytest.mark.parametrize(("couple", "start"), [(0.3, 0.0), (1.5, 0.0), (1.5, 0.8)])
def test_nicolais_column_flutters_under_any_couple(build, couple, start):
    """An equal column in both planes: no couple fixed in space is small enough for it."""
    load = Loads(0.0, contact_from=start, contact_couple=(0.0, 0.0, couple))
    rod = build(**WIRE)
    found = rates(rod, load, mesh_for(rod, start or None, 8))
    assert buckling_margin(solve_statics(rod, NONE, loads=load), NONE, load).stable
    for mode in range(2):
        pair = found[2 * mode : 2 * mode + 2]
        assert np.all(pair.real > 0)
        # exp(rate t) with rate^2 = - omega^2, one of the pair, or its conjugate
        root = newton(lambda x: end_values(x, couple, start), -(pair[0] ** 2), tol=1e-10)
        rate = np.sqrt(-root)
        expected = abs(rate.real) + 1j * abs(rate.imag)
        np.testing.assert_allclose(pair, 2 * [expected], rtol=1e-6)


def test_a_small_couple_makes_the_growth_of_first_order(build):
    """Rate = couple int phi'^2 / (4 omega) for a couple spread evenly; phi is the first mode."""
    b, couple = 1.8751040687119611, 2e-2
    ratio = (math.cosh(b) + math.cos(b)) / (math.sinh(b) + math.sin(b))
    z = (np.polynomial.legendre.leggauss(40)[0] + 1) / 2
    weights = np.polynomial.legendre.leggauss(40)[1] / 2
    mode = np.cosh(b * z) - np.cos(b * z) - ratio * (np.sinh(b * z) - np.sin(b * z))
    slope = b * (np.sinh(b * z) + np.sin(b * z) - ratio * (np.cosh(b * z) - np.cos(b * z)))
    expected = couple * (weights @ slope**2) / (weights @ mode**2) / (4 * b**2)
    load = Loads(0.0, contact_from=0.0, contact_couple=(0.0, 0.0, couple))
    rod = build(**WIRE)
    shape = solve_statics(rod, NONE, loads=load, mesh=mesh_for(rod, None, 8))
    assert rates(rod, load, shape.mesh)[0].real == pytest.approx(expected, rel=1e-4)
    assert flutter(shape, NONE, load).flutters


def test_no_load_with_a_potential_makes_a_trunk_flutter(trunk, draw):
    activation = draw(trunk, 4, seed=5)
    loads = Loads(9.8, (20.0, -30.0, 60.0), 1.4, (10.0, -5.0, 120.0))
    result = flutter(solve_statics(trunk, activation, loads=loads), activation, loads)
    assert np.all(result.growth == 0)
    assert not np.any(result.flutters)


# --- shapes in space -----------------------------------------------------------------------


@pytest.mark.parametrize(("couple", "lever"), [((-110.0, 20.0, 15.0), 0.0), (3 * (0.0,), 0.5)])
def test_a_chain_of_rotations_with_masses_vibrates_alike(trunk, draw, couple, lever):
    activation = draw(trunk, 4, seed=6)[1]
    load = Loads(9.8, (30.0, 20.0, 80.0), 1.4, (0.0, 0.0, 200.0), couple, lever)
    masses = {"contact_mass": 20.0, "tip_mass": 3.0}
    mesh = mesh_for(trunk, 1.4, elements=10, degree=6)
    shape = solve_statics(trunk, activation, loads=load, mesh=mesh)
    found = flutter(shape, activation, load, **masses)
    assert found.flutters == (lever == 0)
    case = trunk, activation, load
    chains = (chain(*case, shape, n).frames for n in (40, 80))
    coarse, fine = (vibrations(*case, frames, **masses) for frames in chains)
    modes = slice(0, 6)
    expected = (4 * fine[modes] - coarse[modes]) / 3  # Richardson: of fourth order
    assert np.abs(fine[modes] - expected).max() > 1e-3
    np.testing.assert_allclose(found.rates[modes], expected, rtol=0, atol=1e-3)


def test_the_meshes_of_plans_resolve_the_modes_that_count(trunk):
    plan = planned("lift-log-asymmetric", "sequential")
    t = 4
    for mass in (0.0, 22.0):
        case = plan.activations[t], plan.loads[t]
        rough = flutter(plan.shape[t], *case, mass).rates
        mesh = mesh_for(trunk, 1.4, elements=40, degree=8)
        shape = solve_statics(trunk, case[0], plan.head[t], case[1], mesh)
        np.testing.assert_allclose(rough, flutter(shape, *case, mass).rates, rtol=1e-4)


def test_the_paper_lifts_its_log_off_center_with_flutter():
    """1.6 /s near 2.2 Hz, in the second bending modes of both planes, by a code of its own."""
    plan = planned("lift-log-asymmetric", "sequential")
    flutters = np.flatnonzero(plan.flutter.flutters)
    assert {1, 2, 3, 4, 5} <= set(flutters.tolist())
    assert plan.flutter.growth[1] == pytest.approx(1.6, abs=0.05)
    assert plan.flutter.frequency[1] == pytest.approx(2.2, abs=0.05)
    assert np.isnan(plan.flutter.growth[0])
    (note,) = [note for note in plan.notes if "flutter" in note]
    assert note.startswith("steps 2 to ")
    assert "growth up to 1.6 /s at 2.2 Hz, undamped; the couple is fixed in space" in note
    step = summary(plan)["timesteps"]
    assert step[0]["flutter_growth"] is None
    assert step[1]["flutter_growth"] == plan.flutter.growth[1]
    (finding,) = [f for f in explain(plan, deep=False).findings if "vibration grows" in f.what]
    assert finding.details == (note,)
    assert "hung = true" in finding.advice
    assert not np.any(planned("lift-log", "sequential").flutter.flutters)


# --- arguments -----------------------------------------------------------------------------


def test_batches_and_bad_arguments(trunk, draw, build):
    activation = draw(trunk, 2, seed=7)
    load = Loads(9.8, contact_from=1.4, contact_couple=(-60.0, 0.0, 0.0))
    shape = solve_statics(trunk, activation, loads=load)
    both = flutter(shape, activation, load, 10.0)
    assert both.rates.shape == (2, 16)
    one = flutter(shape[1], activation[1], [load], 10.0)
    np.testing.assert_allclose(one.rates, both.rates[1], rtol=1e-9)
    with pytest.raises(InputError, match="leading axes"):
        flutter(shape, activation[:1].repeat(3, axis=0), load)
    with pytest.raises(InputError, match="contact_mass = -1"):
        flutter(shape, activation, load, -1.0)
    with pytest.raises(InputError, match="needs loads with contact_from"):
        flutter(solve_statics(trunk, REST), REST, Loads(), 1.0)
    light = build(material={"youngs_modulus": 1e6, "poisson_ratio": 0.5, "density": 0.0})
    with pytest.raises(InputError, match="need the density"):
        flutter(solve_statics(light, NONE), NONE, Loads())
