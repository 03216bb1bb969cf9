"""Linear two-point boundary value problems along the trunk, as Newton's method makes them.

The changes of the states at the K + 1 nodes of H rods obey step_(k+1) = map_k step_k + gap_k. The
pose at the base is fixed, and so is the moment at the tip. Marching from base to tip is fastest,
but it fails where the maps amplify small errors, as on a thin tip under load: the moment at the
base is then found from a tip that depends on it far too strongly. All equations in one banded
matrix, solved with row exchanges, are as accurate as the problem allows (Ascher, Mattheij &
Russell 1995, chapter 7).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import LinAlgError, solve_banded


def solve_linear_bvp(maps: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Steps (H, K + 1, n, columns) at the nodes; NaN for a rod whose problem is singular.

    The last three components are the moment, those before it the pose. The pose does not change
    at the first node, nor the moment at the last.

    Parameters
    ----------
    maps : (H, K, n, n)
    gaps : (H, K, n, columns)
        The last one includes the moment that is left at the tip.
    """
    steps = np.full((len(maps), maps.shape[1] + 1, *gaps.shape[2:]), np.nan)
    finite = np.isfinite(maps).all(axis=(1, 2, 3)) & np.isfinite(gaps).all(axis=(1, 2, 3))
    solvable = np.flatnonzero(finite)
    if solvable.size:
        steps[solvable] = _solve(maps[solvable], gaps[solvable])
    return steps


def _solve(maps: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """The same for finite numbers: one matrix for all rods, whose blocks do not touch."""
    H, K, n, columns = gaps.shape
    pose = n - 3
    lower, upper = n - 1 + pose, n - pose
    diagonal, column, k, a, b = _band_places(K, n)
    matrix = np.zeros((lower + 1 + upper, H, n * K))
    matrix[diagonal, :, column] = -maps[:, k, a, b].T
    matrix[0, :, n - pose :] = 1.0
    steps = np.zeros((H, n * (K + 1), columns))
    flat, right = matrix.reshape(len(matrix), -1), gaps.reshape(-1, columns)
    try:
        with np.errstate(all="ignore"):
            inner = solve_banded((lower, upper), flat, right, check_finite=False)
    except LinAlgError:
        inner = np.full_like(right, np.nan)
    if H > 1 and not np.all(np.isfinite(inner)):
        # One rod's zero pivot spoils the solution of all, so each is solved alone.
        return np.concatenate([_solve(maps[i : i + 1], gaps[i : i + 1]) for i in range(H)])
    steps[:, pose : n * K + pose] = inner.reshape(H, n * K, columns)
    return steps.reshape(H, K + 1, n, columns)


@lru_cache(maxsize=64)
def _band_places(K: int, n: int) -> tuple[np.ndarray, ...]:
    """Where entry (a, b) of map k stands in the band: diagonal and column; and k, a, b.

    Row a of map k is row n k + a of the matrix. Component b of node k is its column n k + b - pose:
    the pose at the base is known, and so is left out.
    """
    pose = n - 3
    k, a, b = (index.ravel() for index in np.indices((K, n, n)))
    free = (k > 0) | (b >= pose)
    k, a, b = k[free], a[free], b[free]
    return (n - pose) + a - b + pose, n * k + b - pose, k, a, b
