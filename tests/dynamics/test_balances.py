"""What a simulation keeps: rest, angular momentum, frequencies, the plan's steps or not."""

import math
from itertools import pairwise

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.optimize import curve_fit
from test_simulation import simulated, tip, toy

from trunk_ocp.dynamics.energy import velocities
from trunk_ocp.dynamics.simulation import _Player
from trunk_ocp.rod.collocation import gauss
from trunk_ocp.rod.flutter import natural_frequencies
from trunk_ocp.rod.statics import solve_statics


def test_a_trunk_at_rest_stays_at_rest():
    moved = toy([0.2, 0.2], gravity=9.8)
    result = simulated(moved, np.zeros((2, 4)), 0.02)
    positions = result.shape.position(np.linspace(0.0, 1.0, 9))
    assert np.abs(positions - positions[0]).max() < 1e-9
    assert result.energy.kinetic.max() < 1e-16


def test_it_swings_with_its_natural_frequencies_where_it_hangs():
    """Two modes in a plane. Weight stiffens: without it the lower is more than a tenth lower.

    BDF2 with steps dt makes a frequency lower by (omega dt)^2 / 3, which is corrected.
    """
    dt = 0.01
    moved = toy([0.1, 4.0, 0.1], gravity=9.8, interpolation="none", radius=0.02)
    x = np.zeros((3, 4))
    x[:2, 0] = -1e-3
    result = simulated(moved, x, dt, degree=4, damping_time=0.02)
    late = (result.times > 1.0) & (result.times < 4.1)
    t, deflection = result.times[late] - 1.0, tip(result)[late]
    deflection = deflection[:, np.argmax(np.ptp(deflection, axis=0))]

    def frequencies(moved):
        load, activation = moved.steps[0].loads, x[0, :2]
        shape = solve_statics(moved.trunk, activation, loads=load)
        return 2 * math.pi * natural_frequencies(shape, activation, load)

    first, _, second = frequencies(moved)
    assert first > 1.1 * frequencies(toy([0.1], radius=0.02))[0]

    def ringing(t, offset, *modes):
        value = np.full_like(t, offset)
        for a, b, omega, rate in np.reshape(modes, (2, 4)):
            value += np.exp(-rate * t) * (a * np.cos(omega * t) + b * np.sin(omega * t))
        return value

    size = np.ptp(deflection)
    start = (deflection.mean() / size, 0.5, 0.0, first, 0.03, 0.1, 0.0, second, 1.0)
    found, _ = curve_fit(ringing, t, deflection / size, start)
    swung = np.hypot(found[[3, 7]], found[[4, 8]])
    undamped = swung * (1 + (swung * dt) ** 2 / 3)
    np.testing.assert_allclose(undamped, [first, second], rtol=1e-3)


def test_angular_momentum_about_the_base_follows_from_weight_and_its_moment(monkeypatch):
    """H(t) - H(0) is the integral of the moments, to the second order of the method in time.

    The mass of what contracts stays, but not the radius of sections: their own spin counts.
    """
    kept = []
    advance = _Player._advance

    def record(self, before, state, instant, dt, ratio):
        after = advance(self, before, state, instant, dt, ratio)
        sections, mesh = self.sections, self.mesh
        v, omega, d = velocities(sections, mesh, instant, after.states, after.changing)
        _, _, mean = sections.material(instant.strain)
        space = np.einsum("ni,nij->nj", sections.J / mean * omega, d)
        kept.append((v[:-1], space))
        return after

    monkeypatch.setattr(_Player, "_advance", record)
    off = []
    for dt in (0.02, 0.01):
        kept.clear()
        moved = toy([0.1, 0.4], gravity=9.8)
        result = simulated(moved, [[-0.2, -0.1, 0.0, 0.0]] * 2, dt, degree=5, damping_time=0.02)
        mesh, trunk = result.shape.mesh, result.shape.trunk
        Z = mesh.points.ravel()
        weights = (mesh.widths[:, None] * gauss(mesh.degree).quadrature).ravel()
        mu = weights * trunk.density * math.pi * trunk.radius(Z) ** 2
        arm = result.shape.position(Z)[1:] - result.shape.edges[1:, :1]
        H = np.array(
            [mu @ np.cross(r, v) + weights @ spin for r, (v, spin) in zip(arm, kept, strict=True)]
        )
        weight = np.einsum("n,tnc->tc", mu, np.cross(arm, [0.0, 0.0, 9.8]))
        moment = result.shape.moment(np.zeros(1))[1:, 0]
        d = result.shape.directors(np.zeros(1))[1:, 0]
        torque = weight - np.einsum("ti,tij->tj", moment, d)
        t = result.times[1:]
        after = t > 0.1 + 1e-9  # away from the jump of accelerations between the steps
        change = cumulative_simpson(torque[after], x=t[after], axis=0, initial=0.0)
        error = H[after] - H[after][0] - change
        off.append(np.abs(error).max() / np.abs(change).max())
    assert off[1] < 0.01
    assert 1.5 < math.log2(off[0] / off[1])


def test_time_steps_of_the_plan_do_not_matter():
    """Each starts the method anew; the same course in more steps ends alike, to second order."""
    x, off = [-0.3, -0.1, 0.0, 0.4], []
    for dt in (0.02, 0.01, 0.005):
        ends = [
            tip(simulated(toy([0.3, *[0.4 / n] * n], 9.8), [x] * (n + 1), dt, degree=4))[-1]
            for n in (1, 4)
        ]
        off.append(np.linalg.norm(ends[0] - ends[1]))
    assert off[2] < 1e-3
    assert all(1.5 < math.log2(a / b) for a, b in pairwise(off))
