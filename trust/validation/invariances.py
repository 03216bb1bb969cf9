"""What turning, mirroring and scaling must do to a shape, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from trunk_ocp.model.activation import intrinsic_strain
from trunk_ocp.model.anatomy import build_trunk, read_anatomy
from trunk_ocp.model.loads import Loads, vector
from trunk_ocp.rod.statics import solve_statics

from .case import Case, CoveredByTest, Values, flat
from .rods import CONTACT, EVERYTHING, contractions, elephant, heads

SUBJECT = "Invariances"
Z = np.linspace(0, 1.75, 9)
COUNT = 5


def turned(load: Loads, turn: Rotation) -> Loads:
    """Loads rotated in space, except the weight."""
    return replace(
        load,
        tip_force=vector(turn.apply(load.tip_force)),
        contact_force=vector(turn.apply(load.contact_force)),
        contact_couple=vector(turn.apply(load.contact_couple)),
    )


def rotation(psi: tuple[float, float], vertical: bool) -> Values:
    """Shapes with rotated head and loads, and rotated shapes: positions, directors, moments.

    A rotation about the vertical leaves the weight unchanged; otherwise there is no gravity. The
    head rotates the base about its pivot.
    """
    trunk = elephant()
    activation = contractions(trunk, COUNT, seed=54)
    load = EVERYTHING if vertical else replace(EVERYTHING, gravity=0.0)
    rest = np.array([0.0, 0.3 if vertical else 0.0])
    turn = Rotation.from_euler("ZY", psi)
    pivot = -trunk.head.pivot_radius * Rotation.from_euler(
        "ZY", [trunk.head.xi_z, trunk.head.xi_y]
    ).apply([0, 0, 1])
    one = solve_statics(trunk, activation, rest, load)
    two = solve_statics(trunk, activation, rest + psi, turned(load, turn))
    found = [two.position(Z), two.directors(Z), two.moment(Z) / 100]
    position = turn.apply((one.position(Z) - pivot).reshape(-1, 3)).reshape(COUNT, -1, 3) + pivot
    directors = one.directors(Z) @ turn.as_matrix().T
    expected = [position, directors, one.moment(Z) / 100]
    return flat(found, expected)


def mirror() -> Values:
    """Shapes with sides swapped and loads mirrored beside mirrored shapes, in Y.

    Forces are mirrored as vectors, couples as axial vectors. Directors d_1 and d_3 are
    mirrored; d_2 comes out reversed, as a mirrored frame is left-handed. Moments, axial again,
    keep m_2 and reverse m_1 and m_3.
    """
    trunk, M = elephant(), np.array([1.0, -1.0, 1.0])
    activation, psi = contractions(trunk, COUNT, seed=49), heads(COUNT, 50)
    image_of = [
        trunk.muscles.index({"R": "L", "L": "R"}[name[0]] + name[1:]) for name in trunk.muscles
    ]
    mirrored = replace(
        EVERYTHING,
        tip_force=vector(M * EVERYTHING.tip_force),
        contact_force=vector(M * EVERYTHING.contact_force),
        contact_couple=vector(-M * EVERYTHING.contact_couple),
    )
    shape = solve_statics(trunk, activation, psi, EVERYTHING)
    image = solve_statics(trunk, activation[:, image_of], psi * [-1, 1], mirrored)
    found = [image.position(Z), image.directors(Z), image.moment(Z) / 100]
    frames = shape.directors(Z) * M * np.array([1.0, -1.0, 1.0])[:, None]
    expected = [shape.position(Z) * M, frames, shape.moment(Z) * [-1, 1, -1] / 100]
    return flat(found, expected)


def superposition() -> Values:
    """Strain of a sum of activations, and the sum of their strains."""
    trunk = elephant()
    one, two = contractions(trunk, 2, seed=55)
    at = np.linspace(0, 1.75, 40)
    (z1, u1), (z2, u2), (both, u) = (intrinsic_strain(trunk, x, at) for x in (one, two, one + two))
    found = np.concatenate([both - 1, u.ravel()])
    return found, np.concatenate([z1 - 1 + z2 - 1, (u1 + u2).ravel()])


def similarity() -> Values:
    """Shapes over L of the trunk and of one 3 times as long, 0.2 times as stiff.

    Forces scale with E L^2, couples with E L^3 and gravity with E / rho L.
    """
    s, k, spec = 3.0, 0.2, read_anatomy("asian-elephant")
    material = spec.material.model_copy(update={"youngs_modulus": k * spec.material.youngs_modulus})
    head = spec.head.model_copy(update={"pivot_radius": s * spec.head.pivot_radius})
    changes = {"length": s * spec.length, "material": material, "head": head, "name": "giant"}
    trunk, giant = elephant(), build_trunk(spec.model_copy(update=changes))
    activation, psi = contractions(trunk, COUNT, seed=56), heads(COUNT, 57)
    load = Loads(
        EVERYTHING.gravity * k / s,
        vector(k * s**2 * np.array(EVERYTHING.tip_force)),
        CONTACT * s,
        vector(k * s**2 * np.array(EVERYTHING.contact_force)),
        vector(k * s**3 * np.array(EVERYTHING.contact_couple)),
    )
    one = solve_statics(trunk, activation, psi, EVERYTHING)
    two = solve_statics(giant, activation, psi, load)
    return two.position(np.minimum(s * Z, giant.length)) / s, one.position(Z)


NEWTON = "Newton's last step, 1e-7 of the shape, squared"

CASES = (
    Case(
        SUBJECT,
        "Head and all loads rotated about the vertical: positions, directors, moments",
        "objectivity",
        lambda: rotation((0.7, 0.0), vertical=True),
        1e-12,
        NEWTON,
        "m, 1, 100 N m",
    ),
    Case(
        SUBJECT,
        "Head and all loads rotated about any axis of the head, no gravity",
        "objectivity",
        lambda: rotation((0.7, -0.5), vertical=False),
        1e-12,
        NEWTON,
        "m, 1, 100 N m",
    ),
    Case(
        SUBJECT,
        "Sides swapped, head and loads mirrored: positions, directors, moments",
        "reflection in Y; couples and moments axial",
        mirror,
        1e-12,
        NEWTON,
        "m, 1, 100 N m",
    ),
    Case(
        SUBJECT,
        "Strains of the sum of two activations",
        "eqs. (5), (24): superposition",
        superposition,
        1e-13,
        "round-off",
        "1, 1/m",
    ),
    Case(
        SUBJECT,
        "A trunk 3 times as long and 0.2 times as stiff, loads scaled: same shape",
        "dimensional analysis",
        similarity,
        1e-12,
        NEWTON,
        "m",
    ),
    CoveredByTest(
        SUBJECT,
        "16 directions of activation that change no loaded shape",
        "null space of the strain map by adaptive quadrature",
        "tests/rod/test_statics.py::test_directions_that_change_no_strain_change_no_loaded_shape",
    ),
    CoveredByTest(
        SUBJECT,
        "|q| = 1 at element edges, however coarse the mesh",
        "Gauss methods keep quadratic invariants (Hairer, Lubich & Wanner, IV.2)",
        "tests/rod/test_collocation.py::test_quaternions_are_unit_at_the_edges_of_the_coarsest_mesh",
    ),
)
