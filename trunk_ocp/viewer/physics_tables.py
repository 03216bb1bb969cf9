"""The anatomy as the page's physics gets it: what `viewer/physics.js` hands to its module.

Plain numbers rather than float32 arrays, so that shapes in the page agree with Python's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.activation import strain_matrix
from ..model.anatomy import Trunk
from .sections import section_grid


def physics_tables(trunk: Trunk, Z: np.ndarray | None = None) -> dict[str, Any]:
    """Numbers of a trunk, ready for JSON.

    Z : (n,)
        Points in m, increasing, at which the page wants shapes; by default where it draws
        cross-sections.

    Keys: `length`, `radius` at the base and `Z` in m, `taper_rate` in 1/m, `youngs_modulus` in Pa,
    `poisson_ratio`, `density` in kg/m^3; `head`: pivot radius in m, xi_z, xi_y, xi_d in rad;
    `edges` of segments in m; and of each muscle its `name`, its `segment`, and its `strain`, the
    change of zeta_hat and of c (3) in 1/m per unit of activation (see `strain_matrix`).
    """
    A, head = strain_matrix(trunk), trunk.head
    Z = section_grid(trunk).Z if Z is None else Z
    return {
        "length": trunk.length,
        "radius": trunk.base_radius,
        "taper_rate": trunk.taper_rate,
        "youngs_modulus": trunk.youngs_modulus,
        "poisson_ratio": trunk.poisson_ratio,
        "density": trunk.density,
        "head": [head.pivot_radius, head.xi_z, head.xi_y, head.xi_d],
        "edges": list(trunk.edges),
        "Z": np.asarray(Z, dtype=float).tolist(),
        "muscles": [
            {
                "name": muscle.name,
                "segment": muscle.segment,
                "strain": A[muscle.segment, :, column].tolist(),
            }
            for column, muscle in enumerate(trunk.subdomains)
        ],
    }
