"""The rod written out a second time, for checks: no CasADi, no collocation, no optimizer.

Equations (14), (15) in NumPy, with rotation matrices where the package's own code has
quaternions, integrated by scipy's DOP853.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from .activation import mean_extension, segment_at, stiffness, strains
from .anatomy import Trunk
from .head import base_pose
from .loads import Loads, mass_beyond
from .rotations import directors as directors_of

TOLERANCE = 1e-10  # of DOP853, in units of L, 1 and E I(0) / L
MOST_SLOPES = 30_000  # of an integration, in 2,500 steps; the shipped motions take about 100


@dataclass(frozen=True)
class Trajectory:
    """Independently integrated shapes of H rods at points Z (n,).

    `position` (H, n, 3) m; `directors` (H, n, 3, 3), row i is d_i; `moment` (H, n, 3) N m.
    """

    Z: np.ndarray
    position: np.ndarray
    directors: np.ndarray
    moment: np.ndarray


class Rows:
    """Right-hand side of eq. (14) for n rods, each on a stretch without jumps.

    Parameters
    ----------
    activation : (n, muscles)
    loads : one for each rod
    middle : (n,)
        Some Z inside each rod's stretch.
    """

    def __init__(
        self, trunk: Trunk, activation: np.ndarray, loads: Sequence[Loads], middle: np.ndarray
    ) -> None:
        L, strain = trunk.length, strains(trunk, activation)
        own = strain[np.arange(len(loads)), segment_at(trunk, middle)]
        start = np.array([[L if x.contact_from is None else x.contact_from] for x in loads])
        self.trunk = trunk
        self.mean = mean_extension(trunk, strain)[:, None]
        self.zeta_hat, self.c = own[:, :1], own[:, 1:]
        self.gravity = np.array([[0.0, 0.0, load.gravity] for load in loads])
        self.tip = np.array([load.tip_force for load in loads])
        self.log = np.array([load.contact_force for load in loads])
        self.touching, self.touched = start <= middle[:, None], start < L
        self.spread = np.where(self.touched, L - start, 1.0)
        couple = np.array([load.contact_couple for load in loads])
        self.couple = self.touching * couple / self.spread

    def repeated(self, count: int) -> Rows:
        """Each of the rods `count` times, one after the other."""
        many = copy(self)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                setattr(many, name, np.repeat(value, count, axis=0))
        return many

    def rates(self, Z: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Derivatives of y (n, 15), r, d_1, d_2, d_3 and m in SI units, at Z (n, 1) or (1, 1)."""
        d, m = y[:, 3:12].reshape(-1, 3, 3), y[:, 12:]
        K = stiffness(self.trunk, Z[:, 0])
        share = np.where(self.touching, (self.trunk.length - Z) / self.spread, self.touched)
        force = self.tip + self.gravity * mass_beyond(self.trunk, Z) + self.log * share
        n = np.einsum("hij,hj->hi", d, force)
        zeta = self.zeta_hat * (1 + n[:, 2:] * self.mean / K[:, :1])
        u = self.c / self.trunk.taper(Z) + m * self.mean**2 / K[:, 1:]
        dm = self.zeta_hat * _cross(m, u) - np.einsum("hij,hj->hi", d, self.couple)
        dm[:, 0] += zeta[:, 0] * n[:, 1]
        dm[:, 1] -= zeta[:, 0] * n[:, 0]
        darboux = np.einsum("hi,hij->hj", self.zeta_hat * u, d)
        dd = _cross(darboux[:, None], d)
        return np.concatenate([zeta * d[:, 2], dd.reshape(-1, 9), dm], axis=1)


def base_frames(trunk: Trunk, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Base positions (H, 3) in m and directors (H, 3, 3) of head angles (H, 2)."""
    r0, q0 = base_pose(trunk.head, head[:, 0], head[:, 1])
    d0 = [np.stack(np.broadcast_arrays(*row), axis=-1) for row in directors_of(q0)]
    return np.stack(r0, axis=-1), np.stack(d0, axis=-2)


def jumps_of(trunk: Trunk, loads: Sequence[Loads]) -> list[float]:
    """Where the equations of some rod jump, both ends included."""
    return sorted({*trunk.edges} | {x.contact_from for x in loads if x.contact_from is not None})


def integrate(
    trunk: Trunk, x: np.ndarray, loads: Sequence[Loads], moment: np.ndarray, Z: np.ndarray
) -> Trajectory:
    """Integrate H rods together from the base to every point of Z, sorted.

    Parameters
    ----------
    x : (H, muscles + 2)
        Activations and head angles; they fix everything at the base but the moment.
    moment : (H, 3)
        m(0) in N m, in the directors.
    """
    if not len(loads):
        return Trajectory(Z, *(np.zeros((0, Z.size, *n)) for n in ((3,), (3, 3), (3,))))
    finite = np.all(np.isfinite(np.hstack([x, moment])), axis=1)
    if not np.all(finite):
        return _integrate_some(trunk, x, loads, moment, Z, finite)
    H, activation = len(loads), x[:, :-2]
    unit = np.ones(15)
    unit[:3], unit[12:] = trunk.length, stiffness(trunk, 0.0)[1] / trunk.length
    r0, d0 = base_frames(trunk, x[:, -2:])
    state = np.concatenate([r0, d0.reshape(H, 9), moment], axis=1) / unit
    values = np.full((Z.size, H, 15), np.nan)
    values[Z <= 0] = state
    for start, end in pairwise(jumps_of(trunk, loads)):
        inside = (Z > start) & (Z <= end)
        rows = Rows(trunk, activation, loads, np.full(H, (start + end) / 2))

        def slope(at: float, y: np.ndarray, rows: Rows = rows) -> np.ndarray:
            return (rows.rates(np.full((1, 1), at), y.reshape(H, 15) * unit) / unit).ravel()

        path = dop853(slope, (start, end), state.ravel(), np.union1d(Z[inside], [end]))
        if path is None:
            break  # NaN from here on: never called verified
        path = path.reshape(-1, H, 15)
        values[inside] = path[: np.count_nonzero(inside)]
        state = path[-1]
    values = (values * unit).swapaxes(0, 1)
    directors = values[..., 3:12].reshape(H, Z.size, 3, 3)
    return Trajectory(Z, values[..., :3], directors, values[..., 12:])


def _integrate_some(
    trunk: Trunk,
    x: np.ndarray,
    loads: Sequence[Loads],
    moment: np.ndarray,
    Z: np.ndarray,
    some: np.ndarray,
) -> Trajectory:
    """Integrate some of the rods; NaN for the others."""
    chosen = [load for load, keep in zip(loads, some, strict=True) if keep]
    path = integrate(trunk, x[some], chosen, moment[some], Z)
    every = []
    for part in (path.position, path.directors, path.moment):
        whole = np.full((len(some), *part.shape[1:]), np.nan)
        whole[some] = part
        every.append(whole)
    return Trajectory(Z, *every)


class _EndlessError(Exception):
    """An integration comes to no end, as of a rod that coils in itself."""


def dop853(
    slope: Callable[[float, np.ndarray], np.ndarray],
    ends: tuple[float, float],
    start: np.ndarray,
    at: np.ndarray,
) -> np.ndarray | None:
    """Values (points, n) at sorted points; None where there is no end to it, or no number."""
    calls = itertools.count(1)

    def counted(Z: float, y: np.ndarray) -> np.ndarray:
        if next(calls) > MOST_SLOPES:
            raise _EndlessError
        return slope(Z, y)

    try:
        with np.errstate(all="ignore"):  # a rod that diverges ends as NaN
            result = solve_ivp(
                counted,
                ends,
                start,
                method="DOP853",
                t_eval=at,
                rtol=TOLERANCE,
                atol=TOLERANCE,
            )
    except _EndlessError:
        return None
    return result.y.T if result.success and np.all(np.isfinite(result.y[:, -1])) else None


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product along the last axis; np.cross takes longer than all else of the slope."""
    ahead, back = [1, 2, 0], [2, 0, 1]
    return a[..., ahead] * b[..., back] - a[..., back] * b[..., ahead]
