"""Tables 2 and 3 of the paper, from the model: signs and ranking of each muscle group's effects."""

from __future__ import annotations

import numpy as np

from .activation import strain_matrix, torsion
from .anatomy import Trunk

MEASURES = ("zeta", "u1", "u2", "u3")
ZERO_TOL = 1e-12  # relative to the largest effect of its kind; a smaller effect counts as zero
MIXED = 2  # sign of an effect that differs between segments


def effects(trunk: Trunk) -> np.ndarray:
    """Effect of a unit contraction of each muscle on (zeta, u1, u2, u3), (muscles, 4).

    Curvatures are those at the scale of Z = 0, in 1/m (H_j / K_j of section 4).
    """
    A = strain_matrix(trunk)
    response = -np.stack([A[m.segment, :, i] for i, m in enumerate(trunk.subdomains)])
    largest = np.abs(response).max(axis=0, initial=0.0)
    response[np.abs(response) <= ZERO_TOL * largest] = 0.0
    return response


def signs(trunk: Trunk) -> dict[str, dict[str, list[int]]]:
    """Table 2: sign of each effect, and of the isolated torsion, by group and side.

    A sign that differs between segments is given as 2.
    """
    response = effects(trunk)
    table: dict[str, dict[str, list[int]]] = {}
    for index, muscle in enumerate(trunk.subdomains):
        row = [int(np.sign(value)) for value in response[index]]
        row.append(_torsion_sign(trunk, index))
        nearer_base = table.setdefault(muscle.group, {}).get(muscle.side)
        if nearer_base is not None:
            row = [a if a == b else MIXED for a, b in zip(row, nearer_base, strict=True)]
        table[muscle.group][muscle.side] = row
    return table


def _torsion_sign(trunk: Trunk, index: int) -> int:
    """Sign of the torsion when this muscle contracts alone; 0 where it does not bend."""
    activation = np.zeros(len(trunk.subdomains))
    activation[index] = -0.1
    segment = trunk.subdomains[index].segment
    middle = (trunk.edges[segment] + trunk.edges[segment + 1]) / 2
    tau = float(torsion(trunk, activation, np.array([middle]))[0])
    largest = np.abs(strain_matrix(trunk)[:, 1:]).max() * 0.1
    return 0 if np.isnan(tau) or abs(tau) <= ZERO_TOL * largest else int(np.sign(tau))


def ranks(trunk: Trunk) -> list[dict[str, tuple[list[str], list[str]]]]:
    """Table 3: for each segment and measure, groups from strongest to weakest, and those at 0."""
    response = np.abs(effects(trunk))
    table: list[dict[str, tuple[list[str], list[str]]]] = []
    for segment in range(trunk.segments):
        strength: dict[str, np.ndarray] = {}
        for index, muscle in enumerate(trunk.subdomains):
            if muscle.segment == segment:
                strength.setdefault(muscle.group, response[index])
        columns = {}
        for j, measure in enumerate(MEASURES):
            order = sorted(strength, key=lambda group: -strength[group][j])
            columns[measure] = (
                [group for group in order if strength[group][j] > 0],
                [group for group in order if strength[group][j] == 0],
            )
        table.append(columns)
    return table
