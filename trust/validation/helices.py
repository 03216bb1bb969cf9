"""Torque, helices and spirals in closed form."""

from __future__ import annotations

import math

import numpy as np

from trunk_ocp.model.activation import strains
from trunk_ocp.model.loads import Loads
from trunk_ocp.model.quaternions import directors
from trunk_ocp.rod.collocation import mesh_for
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.rod.unloaded import unloaded_states
from trust import reference

from .case import Case, CoveredByTest, Values, flat
from .rods import NONE, activation_for, bender, contractions, elephant, heads, wire

SUBJECT = "Helices and torque"

# Extension, curvature and twist in 1/m: right- and left-handed, flat and steep.
HELICES = ((1.0, 6.0, 2.0), (0.9, 10.0, -4.0), (1.2, 3.0, 15.0), (1.0, 20.0, 0.5))


def radius_and_pitch(position: np.ndarray) -> tuple[float, float]:
    """Radius and signed pitch of the helix through equally spaced points (n, 3).

    Second differences of a helix at equal steps point at its axis, which is
    perpendicular to all of them; the angle between neighbors is that of a step.
    """
    inward = np.diff(position, 2, axis=0)
    step = np.diff(position[1:-1], axis=0)
    axis = np.cross(inward[0], inward[1])
    axis /= np.linalg.norm(axis)
    sine = axis @ np.cross(inward[0], inward[1])
    angle = math.atan2(sine, inward[0] @ inward[1])
    along = float(step[0] @ axis)
    chord = math.sqrt(step[0] @ step[0] - along**2)
    return chord / (2 * math.sin(angle / 2)), 2 * math.pi * along / angle


def helices() -> Values:
    """Radius and pitch divided by L, measured on solved shapes."""
    found, expected = [], []
    for extension, bend, twist in HELICES:
        coil = bender()
        activation = activation_for(coil, extension, (0.6 * bend, 0.8 * bend, twist))
        mesh = mesh_for(coil, elements=16, degree=10)
        shape = solve_statics(coil, activation, loads=Loads(0.0), mesh=mesh)
        step = 0.5 / math.hypot(bend, twist)  # half a radian
        Z = step / extension * np.arange(4)
        found.append(radius_and_pitch(shape.position(Z)))
        square = bend**2 + twist**2
        expected.append((bend / square, 2 * math.pi * twist / square))
    return np.array(found), np.array(expected)


def torque() -> Values:
    """First director and position of the tip under a spread couple along the rod."""
    load = Loads(0.0, contact_from=0.5, contact_couple=(0.0, 0.0, 0.4))
    shape = solve_statics(wire(), NONE, loads=load)
    tip = np.array([1.0])
    # K_3 = E I / (1 + nu): 0.4 over half the length, falling linearly over the other half.
    twist = 0.4 * 1.3 * (0.5 + 0.25)
    found = np.concatenate([shape.directors(tip)[0, 0], shape.position(tip)[0]])
    return found, np.array([math.cos(twist), math.sin(twist), 0, 0, 0, 1])


def spirals() -> Values:
    """Positions and directors of the unloaded trunk by closed form and by a Runge-Kutta code."""
    trunk, count = elephant(), 8
    activation = contractions(trunk, count, seed=10, strongest=2.0)
    head, Z = heads(count, 11), np.linspace(0, trunk.length, 12)
    still = np.zeros((count, 3))
    r, d, _ = reference.march(
        trunk, activation, head, [Loads(0.0)] * count, still, Z, rtol=1e-13, atol=1e-13
    )
    position, q = unloaded_states(trunk, activation, head, Z)
    rows = directors(tuple(np.moveaxis(q, -1, 0)))
    frames: np.ndarray = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    return flat([position, frames], [r, d])


def spiral_angle() -> Values:
    """Curvature times section radius along an unloaded segment: constant."""
    trunk = elephant()
    activation = contractions(trunk, 1, seed=12)[0]
    Z = np.linspace(0.1, 0.8, 15)
    h = 1e-3
    every = (Z + h * np.arange(-2, 3)[:, None]).ravel()
    r = unloaded_states(trunk, activation, np.zeros(2), every)[0].reshape(5, -1, 3)
    first = (r[0] - 8 * r[1] + 8 * r[3] - r[4]) / (12 * h)
    second = (-r[0] + 16 * r[1] - 30 * r[2] + 16 * r[3] - r[4]) / (12 * h**2)
    speed = np.linalg.norm(first, axis=1)
    curvature = np.linalg.norm(np.cross(first, second), axis=1) / speed**3
    c = strains(trunk, activation)[0, 1:3]
    return curvature * trunk.radius(Z) / trunk.base_radius, np.full(Z.size, np.hypot(*c))


CASES = (
    Case(
        SUBJECT,
        "Uniform intrinsic curvature k and twist t, four helices: radius, pitch",
        "circular helix, k / (k^2 + t^2) and 2 pi t / (k^2 + t^2)",
        helices,
        1e-10,
        "collocation, 16 elements of degree 10; differences over half a radian",
        "L",
    ),
    Case(
        SUBJECT,
        "Couple along a straight rod: twist of the tip, which does not move",
        "M L / K_3, K_3 = E I / (1 + nu) (eq. 7)",
        torque,
        1e-12,
        "round-off; the twist is a polynomial",
        "rad, L",
    ),
    Case(
        SUBJECT,
        "Unloaded trunk, three conical spirals in closed form, 8 random contractions",
        "eqs. (1), (5) implemented independently, DOP853 at 1e-13",
        spirals,
        2e-11,
        "1e-13 per step, up to 200 steps",
        "m, 1",
    ),
    Case(
        SUBJECT,
        "Unloaded curvature times section radius: constant along a segment",
        "eqs. (5)-(7), (29): u = c / f(Z); fourth-order differences",
        spiral_angle,
        1e-8,
        "differences at h = 1 mm: round-off 1e-16 / h^2",
        "1/m",
    ),
    CoveredByTest(
        SUBJECT,
        "Angle by which a tapered segment turns",
        "-|u| zeta ln(1 - k L) / k",
        "tests/rod/test_unloaded.py::test_a_tapered_segment_turns_by_the_logarithm_of_its_taper",
    ),
    CoveredByTest(
        SUBJECT,
        "Torsion of the unloaded centerline",
        "eq. (40) without dividing u_3; Frenet's formula on a Chebyshev fit",
        "tests/model/test_activation.py::test_torsion_is_that_of_the_unloaded_centerline",
    ),
)
