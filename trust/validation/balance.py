"""Force and moment balance, and energy: these hold for any equilibrium."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from trunk_ocp.model.activation import mean_extension, segment_at, stiffness, strains
from trunk_ocp.model.loads import Loads, vector
from trunk_ocp.rod.collocation import gauss, mesh_for
from trunk_ocp.rod.shape import Shape
from trunk_ocp.rod.statics import solve_statics

from .case import Case, Values
from .rods import CONTACT, EVERYTHING, activation_for, bender, contractions, elephant, heads

SUBJECT = "Balance and energy"
COUNT = 4
NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)
DEAD = replace(EVERYTHING, contact_couple=(0.0, 0.0, 0.0))
"""The loads that have a potential: all but the couple, as a couple fixed in space has none."""


def solved() -> tuple[np.ndarray, Shape]:
    """Random contractions and their fine shapes under every load."""
    trunk = elephant()
    activation = contractions(trunk, COUNT, seed=44)
    mesh = mesh_for(trunk, CONTACT, elements=12, degree=8)
    return activation, solve_statics(trunk, activation, heads(COUNT, 45), EVERYTHING, mesh)


def force_density(Z: np.ndarray) -> np.ndarray:
    """External force (n, 3) in N per m of initial length at Z, off Z_w: weight and contact."""
    trunk, load = elephant(), EVERYTHING
    R = trunk.base_radius - Z * trunk.tan_taper
    weight = np.outer(trunk.density * np.pi * R**2, [0, 0, load.gravity])
    touching = Z > CONTACT
    return weight + touching[:, None] * np.array(load.contact_force) / (1.75 - CONTACT)


def beyond(shape: Shape, Z: float) -> tuple[np.ndarray, np.ndarray]:
    """Sum of forces (3,) and of moments about r(Z) (B, 3), by Gauss rules on the deformed shape."""
    load = EVERYTHING
    here, tip = (shape.position(np.array([at]))[:, 0] for at in (Z, 1.75))
    force = np.array(load.tip_force)
    share = (1.75 - max(Z, CONTACT)) / (1.75 - CONTACT)
    moment = np.cross(tip - here, force) + share * np.array(load.contact_couple)
    for start, end in pairwise(np.unique([Z, *(e for e in shape.mesh.edges if e > Z)])):
        at = (start + end) / 2 + (end - start) / 2 * NODES
        density, weights = force_density(at), (end - start) / 2 * WEIGHTS
        force = force + weights @ density
        arm = shape.position(at) - here[:, None]
        moment = moment + np.einsum("n,bni->bi", weights, np.cross(arm, density))
    return force, moment


SECTIONS = (0.0, 0.4, 0.875, 1.2, 1.45, 1.6)  # m


def moment_balance() -> Values:
    """Internal moments in space axes, and the moments of all loads beyond the section, in N m."""
    _, shape = solved()
    found, expected = [], []
    for Z in SECTIONS:
        at = np.array([Z])
        m, d = shape.moment(at)[:, 0], shape.directors(at)[:, 0]
        found.append(np.einsum("bi,bij->bj", m, d))
        expected.append(beyond(shape, Z)[1])
    return np.array(found), np.array(expected)


def force_balance() -> Values:
    """Tensions from the stretch of the centerline, and from the loads beyond the section, in N."""
    activation, shape = solved()
    trunk, strain = elephant(), strains(elephant(), activation)
    mean = mean_extension(trunk, strain)
    found, expected, h = [], [], 1e-3
    for Z in (0.3, 0.7, 1.1, 1.43, 1.6):
        r = np.moveaxis(shape.position(Z + h * np.arange(-2, 3)), 1, 0)
        slope = (r[0] - 8 * r[1] + 8 * r[3] - r[4]) / (12 * h)
        zeta_hat = strain[:, segment_at(trunk, Z), 0]
        stretch = np.linalg.norm(slope, axis=1) / zeta_hat - 1
        found.append(stretch * stiffness(trunk, Z)[0] / mean)  # eq. (30)
        tangent = slope / np.linalg.norm(slope, axis=1, keepdims=True)
        expected.append(tangent @ beyond(shape, Z)[0])
    return np.array(found), np.array(expected)


def first_integral() -> Values:
    """H(Z) divided by its largest term, for a uniform active rod under a tip force.

    H = m.K^-1 m / 2 + m.u_hat + n_3 + n_3^2 / 2 K_0 is constant along Z where only the state
    depends on Z.
    """
    coil, force = bender(), np.array([3.0, -2.0, 4.0])
    activation = activation_for(coil, 0.9, (2.0, -3.0, 4.0))
    mesh = mesh_for(coil, elements=12, degree=8)
    shape = solve_statics(coil, activation, (0.4, 0.3), Loads(0.0, vector(force)), mesh)
    Z = np.linspace(0, 1, 23)
    m, n3 = shape.moment(Z), shape.directors(Z)[:, 2] @ force
    zeta_hat, *u_hat = strains(coil, activation)[0]
    K = stiffness(coil, 0.0) / zeta_hat ** np.array([1, 2, 2, 2])
    terms = [np.sum(m**2 / K[1:], axis=1) / 2, m @ u_hat, n3, n3**2 / (2 * K[0])]
    H = sum(terms) / max(np.abs(term).max() for term in terms)
    return H, np.full(Z.size, H[-1])


def energies(loads: list[Loads]) -> tuple[np.ndarray, np.ndarray]:
    """Potential energy (B,) in J of a contracted trunk under each load, and its tips (B, 3)."""
    trunk = elephant()
    activation, psi = contractions(trunk, 1, seed=70)[0], heads(1, 71)[0]
    mesh = mesh_for(trunk, CONTACT, elements=12, degree=8)
    shape = solve_statics(trunk, activation, psi, loads, mesh)
    Z = mesh.points.ravel()
    weights = (mesh.widths[:, None] * gauss(mesh.degree).integral(1.0)).ravel()
    strain = strains(trunk, activation)
    zeta_hat = strain[segment_at(trunk, Z), 0]
    mean = float(mean_extension(trunk, strain))
    K = stiffness(trunk, Z) / mean ** np.array([1, 2, 2, 2])
    stretch = shape.slopes.reshape(len(loads), -1, 3)
    extension = np.linalg.norm(stretch, axis=2) / zeta_hat - 1
    density = zeta_hat * (K[:, 0] * extension**2 + np.sum(shape.moment(Z) ** 2 / K[:, 1:], axis=2))
    r, tip = shape.position(Z), shape.position(np.array([1.75]))[:, 0]
    work = np.einsum("bni,ni->bn", r, force_density(Z))
    tips = np.array([load.tip_force for load in loads])
    return (density / 2 - work) @ weights - np.sum(tips * tip, axis=1), tip


STEPS = np.array([-2, -1, 1, 2])
SLOPE = np.array([1, -8, 8, -1]) / 12


def pulled(load: Loads, h: float) -> list[Loads]:
    """12 loads: the tip force changed by multiples of h along each axis."""
    force = np.array(load.tip_force)
    return [
        replace(load, tip_force=vector(force + k * h * axis)) for axis in np.eye(3) for k in STEPS
    ]


def castigliano() -> Values:
    """Derivative of the potential by the tip force, and minus the tip position, in m."""
    h = 2.0
    energy, _ = energies(pulled(DEAD, h))
    _, tip = energies([DEAD, DEAD])
    return energy.reshape(3, 4) @ SLOPE / h, -tip[0]


def compliance(load: Loads) -> np.ndarray:
    """Derivative (3, 3) of the tip position with respect to the tip force, in m/N."""
    h = 2.0
    _, tip = energies(pulled(load, h))
    return np.einsum("k,ikj->ij", SLOPE, tip.reshape(3, 4, 3)) / h


def reciprocity() -> Values:
    """Compliance of the tip and its transpose, divided by its largest entry."""
    C = compliance(DEAD)
    return C / np.abs(C).max(), C.T / np.abs(C).max()


def asymmetry_with_couple() -> float:
    """Relative asymmetry of the compliance under a couple fixed in space."""
    C = compliance(EVERYTHING)
    return float(np.abs(C - C.T).max() / np.abs(C).max())


CASES = (
    Case(
        SUBJECT,
        "Moments at six sections, 4 random contractions and heads under every load",
        "moments about r(Z) of all loads beyond Z, Gauss rules on the deformed centerline",
        moment_balance,
        1e-7,
        "positions to 1e-10 m times 1.5 kN",
        "N m",
    ),
    Case(
        SUBJECT,
        "Tension from the centerline's stretch at five sections, same shapes",
        "sum of all loads beyond Z, projected on the tangent",
        force_balance,
        1e-5,
        "stretch to 1e-10 by differences, times E A up to 1e5 N",
        "N",
    ),
    Case(
        SUBJECT,
        "Uniform active rod under a tip force: first integral along it",
        "m.K^-1 m / 2 + m.u_hat + n_3 + n_3^2 / 2 K_0 is constant (Noether)",
        first_integral,
        1e-11,
        "collocation inside elements; Newton's last step",
    ),
    Case(
        SUBJECT,
        "Derivative of potential energy by tip force: minus the tip position",
        "Castigliano; elastic energy by quadrature over the solved shape",
        castigliano,
        1e-8,
        "fourth-order differences over 2 N, energy rounded at 1e-13 J",
        "m",
    ),
    Case(
        SUBJECT,
        "Compliance of the loaded tip: symmetric under dead forces",
        "Maxwell-Betti",
        reciprocity,
        1e-7,
        "fourth-order differences over 2 N",
    ),
)
