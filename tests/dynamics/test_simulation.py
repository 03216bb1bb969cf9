"""The trunk with inertia: closed forms, another integrator, energy, and the quasi-static limit."""

import math
from itertools import pairwise

import numpy as np
import pytest
from plans import first_steps
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit
from toys import SPEC, motion

from trunk_ocp.dynamics.simulation import simulate_controls
from trunk_ocp.errors import InputError
from trunk_ocp.problem.build import build_motion
from trunk_ocp.problem.interpolation import interpolate_all
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.flutter import natural_frequencies
from trunk_ocp.rod.statics import solve_statics

FREE = {"activation": (-1.0, 0.0), "head_y_deg": (-180.0, 180.0), "head_z_deg": (-180.0, 180.0)}


def toy(durations, gravity=0.0, interpolation="cosine", radius=0.05, **material):
    """A motion of the toy trunk, which bends and stretches with two muscles."""
    built = motion([(0.0, 0.0, 1.0)] * len(durations), durations, FREE)
    phases = tuple(
        phase.model_copy(update={"interpolation": interpolation}) for phase in built.spec.phases
    )
    spec = built.spec.model_copy(update={"gravity": gravity, "phases": phases})
    changed = {"material": SPEC.material.model_copy(update={"density": 1000.0} | material)}
    if radius != 0.05:
        changed |= {"base_radius_over_length": radius}
        (segment,) = SPEC.segments
        (muscle,) = segment.muscles
        thin = muscle.model_copy(update={"radii_over_length": (0.0, radius)})
        changed["segments"] = (segment.model_copy(update={"muscles": (thin,)}),)
    return build_motion(spec, SPEC.model_copy(update=changed))


def simulated(moved, x, dt, elements=2, degree=6, **options):
    loads = [step.loads for step in moved.steps]
    mesh = mesh_for(moved.trunk, moved.contact_from, elements, degree)
    return simulate_controls(moved, np.asarray(x, dtype=float), loads, mesh, dt, **options)


def tip(result):
    return result.shape.position(np.array([result.shape.trunk.length]))[:, 0]


# --- closed forms --------------------------------------------------------------------------


def test_a_stiff_rod_needs_the_moment_of_a_rigid_body_at_its_base():
    """I alpha, when a cosine ends, rotary inertia included; errors are of second order."""
    duration, turn, off = 1.0, 0.7, []
    moved = toy([duration], youngs_modulus=1e12)
    mass, radius = 1000.0 * math.pi * 0.05**2, 0.05
    inertia = mass / 3 + mass * radius**2 / 4
    alpha = math.pi**2 / (2 * duration**2) * turn
    for dt in (0.05, 0.025):
        result = simulated(moved, [[0.0, 0.0, 0.0, turn]], dt, degree=5)
        end = [math.sin(turn), 0.0, math.cos(turn)]
        np.testing.assert_allclose(tip(result)[-1], end, atol=1e-6)
        moment = np.linalg.norm(result.shape.moment(np.zeros(1))[-1, 0])
        off.append(abs(moment / (inertia * alpha) - 1))
    assert off[1] < 0.3 * off[0] < 0.01


def test_a_muscle_that_contracts_at_once_makes_the_trunk_ring():
    """Late, only the first mode is left: its frequency, and its damping ratio tau omega / 2."""
    tau, gamma = 0.02, -1e-3
    moved = toy([0.1, 5.0, 0.1], interpolation="none")
    x = np.zeros((3, 4))
    x[:2, 0] = gamma
    result = simulated(moved, x, 0.0125, degree=4, damping_time=tau)
    late = (result.times > 2.5) & (result.times < 5.1)
    t, deflection = result.times[late] - 2.5, tip(result)[late]
    axis = np.argmax(np.ptp(deflection, axis=0))
    shape = solve_statics(moved.trunk, x[0, :2], loads=moved.steps[0].loads)
    omega = 2 * math.pi * natural_frequencies(shape, x[0, :2], moved.steps[0].loads)[0]
    ratio = tau * omega / 2

    def ringing(t, offset, a, b, omega, ratio):
        phase = omega * math.sqrt(1 - ratio**2) * t
        return offset + np.exp(-ratio * omega * t) * (a * np.cos(phase) + b * np.sin(phase))

    size = np.ptp(deflection[:, axis])
    start = (deflection[:, axis].mean() / size, 0.5, 0.0, omega, ratio)
    found, _ = curve_fit(ringing, t, deflection[:, axis] / size, start)
    assert found[3] == pytest.approx(omega, rel=1e-3)
    assert found[4] == pytest.approx(ratio, rel=1e-2)


# --- another integrator --------------------------------------------------------------------


def chain_tip(links, turn, duration, times, tau, g=9.8):
    """Tip of a planar chain of rigid links on springs, E I = 1 N m^2, 1 kg/m and 1 m.

    Its base turns by a cosine; masses are at the middles of links, angles from straight down.
    Independent of the package in space (springs at joints) and in time (Radau of order 5).
    """
    h = 1 / links
    arms = h * (np.tri(links, k=-1) + np.eye(links) / 2)  # of mass i along link j
    mass = h * arms.T @ arms
    weight = h * g * arms.sum(axis=0)
    springs = np.full(links, 1 / h)
    springs[0] = 2 / h  # half a link from the base

    def base(t):
        phase = math.pi * min(t / duration, 1.0)
        return turn * (1 - math.cos(phase)) / 2, turn * math.pi / 2 / duration * math.sin(phase)

    def slope(t, y):
        theta, rate = y.reshape(2, links)
        angle, speed = base(t)
        bend = np.diff(theta, prepend=angle) + tau * np.diff(rate, prepend=speed)
        torque = springs * bend
        moment = np.append(torque[1:], 0.0) - torque
        between = theta[:, None] - theta
        right = moment - weight * np.sin(theta) - (mass * np.sin(between)) @ rate**2
        second = np.linalg.solve(mass * np.cos(between), right)
        return np.concatenate([rate, second])

    y = solve_ivp(
        slope, (0, times[-1]), np.zeros(2 * links), "Radau", times, rtol=1e-8, atol=1e-9
    ).y
    return h * np.stack([np.sin(y[:links]).sum(axis=0), np.cos(y[:links]).sum(axis=0)], axis=1)


def test_a_chain_of_links_swings_alike():
    """Through large angles, under gravity, base and all; the chain's error is of second order."""
    turn, duration, tau, radius = 1.2, 0.5, 0.02, 1e-3
    material = {"youngs_modulus": 4 / math.pi / radius**4, "density": 1 / math.pi / radius**2}
    moved = toy([duration, 0.7], gravity=9.8, radius=radius, **material)
    x = [[0.0, 0.0, 0.0, turn]] * 2
    result = simulated(moved, x, 0.003125, degree=5, damping_time=tau)
    times = np.array([0.3, 0.5, 0.8, 1.2])
    at = np.abs(result.times[:, None] - times).argmin(axis=0)
    coarse, fine = (chain_tip(n, turn, duration, result.times[at], tau) for n in (10, 20))
    expected = (4 * fine - coarse) / 3
    assert np.ptp(expected[:, 0]) > 0.5
    assert np.abs(fine - expected).max() > 1e-4
    np.testing.assert_allclose(tip(result)[at][:, [0, 2]], expected, atol=2e-4)


# --- energy and order ----------------------------------------------------------------------


@pytest.mark.parametrize("tau", [0.0, 0.06])
def test_motion_and_balance_of_energy_are_of_second_order(tau):
    moved = toy([0.4], gravity=9.8)
    x = [[-0.3, -0.1, 0.2, 0.4]]
    off, ends = [], []
    for dt in (0.01, 0.005, 0.0025):
        result = simulated(moved, x, dt, degree=5, damping_time=tau)
        off.append(np.abs(result.energy.imbalance).max() / result.energy.turned_over)
        ends.append(tip(result)[-1])
    first, second = (np.linalg.norm(a - b) for a, b in pairwise(ends))
    assert 1.6 < math.log2(first / second) < 2.6
    assert 1.6 < math.log2(off[1] / off[2]) < 2.6


def test_the_mesh_is_no_limit():
    """Of order 2 d in Z, as the rod is: far below what the steps in time leave."""
    moved = toy([0.2], gravity=9.8)
    ends = [
        tip(simulated(moved, [[-0.3, -0.1, 0.2, 0.4]], 0.02, elements=n, degree=3))[-1]
        for n in (1, 2, 4)
    ]
    first, second = (np.linalg.norm(a - b) for a, b in pairwise(ends))
    assert math.log2(first / second) > 4.5


def test_energy_balances_where_a_log_hangs_from_the_trunk(draw):
    moved = first_steps("lift-log-hung", 2)
    x = np.column_stack([draw(moved.trunk, 2, 3, strongest=0.2), [[0.05, -0.02], [0.1, 0.05]]])
    off = []
    for dt in (0.05, 0.025):
        energy = simulated(moved, x, dt, elements=4, degree=5).energy
        assert energy.kinetic.max() > 0.1
        off.append(np.abs(energy.imbalance).max() / energy.turned_over)
    assert off[1] < 0.4 * off[0] < 0.01


# --- the quasi-static limit ----------------------------------------------------------------


def test_a_slow_motion_is_the_quasi_static_one():
    """The lag is first of all that of damping, and goes with the speed."""
    x, lags = np.array([[-0.3, -0.1, 0.0, 0.4]]), []
    for duration in (20.0, 40.0):
        moved = toy([duration], gravity=9.8)
        result = simulated(moved, x, duration / 20)
        controls = interpolate_all(moved, np.vstack([moved.start, x]), result.times)
        loads = moved.steps[0].loads
        planned = solve_statics(
            moved.trunk, controls[:, :-2], controls[:, -2:], loads, result.shape.mesh
        ).position(np.ones(1))[:, 0]
        lag = np.linalg.norm(tip(result) - planned, axis=1).max()
        lags.append(lag / np.linalg.norm(planned[-1] - planned[0]))
    assert lags[0] < 0.01
    assert lags[1] < 0.7 * lags[0]


def test_a_trunk_without_mass_cannot_be_simulated():
    with pytest.raises(InputError, match="needs the density"):
        simulated(toy([1.0], density=0.0), np.zeros((1, 4)), 0.1)
