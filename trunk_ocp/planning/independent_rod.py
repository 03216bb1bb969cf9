"""A second implementation of the rod for checks, without CasADi, collocation or an optimizer.

Equations (14), (15) in NumPy, with rotation matrices where the package's own code has
quaternions, integrated by scipy's DOP853.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from scipy.integrate import DOP853

from ..model.activation import mean_extension, segment_at, stiffness, strains
from ..model.anatomy import Trunk
from ..model.head import base_pose
from ..model.loads import Loads, mass_beyond
from ..model.quaternions import directors as directors_of

TOLERANCE = 1e-10  # of DOP853, in units of L, 1 and E I(0) / L
MAX_SLOPES = 30_000  # right-hand sides per integration (2,500 steps); 100 are usual


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Independently integrated shapes of H rods at points Z (n,).

    `position` (H, n, 3) m; `directors` (H, n, 3, 3), row i is d_i; `moment` (H, n, 3) N m.
    """

    Z: np.ndarray
    position: np.ndarray
    directors: np.ndarray
    moment: np.ndarray

    @classmethod
    def unknown(cls, count: int, Z: np.ndarray) -> Self:
        """As many shapes without numbers: all are NaN."""
        return cls(Z, *(np.full((count, Z.size, *n), np.nan) for n in ((3,), (3, 3), (3,))))

    def fill(self, some: np.ndarray, values: Sequence[np.ndarray]) -> None:
        """Set position, directors and moment of some of the rods."""
        self.position[some], self.directors[some], self.moment[some] = values


class Rods:
    """Right-hand side of eq. (14) for n rods, each on an interval without jumps.

    The last axis of arrays is that of the rods, so that operations run along contiguous memory.

    Parameters
    ----------
    activation : (n, muscles)
    loads : one for each rod
    middle : (n,)
        A point Z inside each rod's interval.
    """

    def __init__(
        self, trunk: Trunk, activation: np.ndarray, loads: Sequence[Loads], middle: np.ndarray
    ) -> None:
        L, strain = trunk.length, strains(trunk, activation)
        own = strain[np.arange(len(loads)), segment_at(trunk, middle)]
        start = np.array([L if x.contact_from is None else x.contact_from for x in loads])
        self.trunk, self.mean = trunk, mean_extension(trunk, strain)
        self.zeta_hat, self.c = own[:, 0], own[:, 1:].T[:, None]
        self.gravity = np.array([load.gravity for load in loads])
        self.tip = np.array([load.tip_force for load in loads]).T
        self.log = np.array([load.contact_force for load in loads]).T
        self.touching, self.touched = start <= middle, start < L
        self.spread = np.where(self.touched, L - start, 1.0)
        couple = np.array([load.contact_couple for load in loads]).T
        self.couple = (self.touching * couple / self.spread)[:, None]
        lever = np.array([load.contact_lever for load in loads])
        self.hung = (self.touching * lever * self.log / self.spread)[:, None]

    def rates(self, Z: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Derivatives of y (15, copies, n), r, d_1, d_2, d_3 and m in SI units, at Z (n,)."""
        d, m = y[3:12].reshape(3, 3, *y.shape[1:]), y[12:]
        K = stiffness(self.trunk, Z).T
        share = np.where(self.touching, (self.trunk.length - Z) / self.spread, self.touched)
        force = self.tip + self.log * share
        force[2] += self.gravity * mass_beyond(self.trunk, Z)
        n = (d * force[:, None]).sum(axis=1)
        zeta = self.zeta_hat * (1 + n[2] * (self.mean / K[0]))
        u = self.c / self.trunk.taper(Z) + m * (self.mean**2 / K[1:])[:, None]
        dy = np.empty_like(y)
        dy[:3] = zeta * d[2]
        darboux = (self.zeta_hat * u[:, None] * d).sum(axis=0)
        for d_i, dd_i in zip(d, dy[3:12].reshape(d.shape), strict=True):
            _cross(darboux, d_i, dd_i)
        _cross(self.zeta_hat * m, u, dy[12:])
        if self.couple.any():
            dy[12:] -= (d * self.couple).sum(axis=1)
        if self.hung.any():
            couple = np.empty_like(d[1])
            _cross(d[1], np.broadcast_to(self.hung, d[1].shape), couple)
            dy[12:] -= (d * couple).sum(axis=1)
        dy[12] += zeta * n[1]
        dy[13] -= zeta * n[0]
        return dy


def base_frames(trunk: Trunk, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Base positions (H, 3) in m and directors (H, 3, 3) of head angles (H, 2)."""
    r0, q0 = base_pose(trunk.head, head[:, 0], head[:, 1])
    d0 = [np.stack(np.broadcast_arrays(*row), axis=-1) for row in directors_of(q0)]
    return np.stack(r0, axis=-1), np.stack(d0, axis=-2)


def jumps_of(trunk: Trunk, loads: Sequence[Loads]) -> list[float]:
    """Points Z in m at which the equations of some rod jump, both ends included."""
    return sorted({*trunk.edges} | {x.contact_from for x in loads if x.contact_from is not None})


def integrate(
    trunk: Trunk,
    x: np.ndarray,
    loads: Sequence[Loads],
    moment: np.ndarray,
    Z: np.ndarray,
    max_slopes: int = MAX_SLOPES,
) -> Trajectory:
    """Integrate H rods together from the base to every point of Z, sorted.

    Parameters
    ----------
    x : (H, muscles + 2)
        Activations and head angles; they fix everything at the base but the moment.
    moment : (H, 3)
        m(0) in N m, in the directors.
    max_slopes
        Right-hand sides allowed in a segment; the result is NaN beyond a segment that needs more.
    """
    if not len(loads):
        return Trajectory.unknown(0, Z)
    finite = np.all(np.isfinite(np.hstack([x, moment])), axis=1)
    if not np.all(finite):
        path = Trajectory.unknown(len(loads), Z)
        chosen = [load for load, keep in zip(loads, finite, strict=True) if keep]
        known = integrate(trunk, x[finite], chosen, moment[finite], Z, max_slopes)
        path.fill(finite, (known.position, known.directors, known.moment))
        return path
    H, activation = len(loads), x[:, :-2]
    unit = np.ones((15, 1, 1))
    unit[:3], unit[12:] = trunk.length, stiffness(trunk, 0.0)[1] / trunk.length
    r0, d0 = base_frames(trunk, x[:, -2:])
    state = np.concatenate([r0, d0.reshape(H, 9), moment], axis=1).T[:, None] / unit
    values = np.full((Z.size, 15, 1, H), np.nan)
    values[Z <= 0] = state
    for start, end in pairwise(jumps_of(trunk, loads)):
        inside = (Z > start) & (Z <= end)
        rods = Rods(trunk, activation, loads, np.full(H, (start + end) / 2))

        def slope(at: float, y: np.ndarray, rods: Rods = rods) -> np.ndarray:
            return (rods.rates(np.full(H, at), y.reshape(15, 1, H) * unit) / unit).ravel()

        result = dop853(slope, (start, end), state.ravel(), Z[inside], max_slopes=max_slopes)
        if result is None:
            break  # NaN from here on fails the check
        values[inside] = result[0].reshape(-1, 15, 1, H)
        state = result[1].reshape(15, 1, H)
    values = np.moveaxis((values * unit)[:, :, 0], 2, 0)
    values[:, Z <= 0, 12:] = moment[:, None]  # without the round-off of scaling
    directors = values[..., 3:12].reshape(H, Z.size, 3, 3)
    return Trajectory(Z, values[..., :3], directors, values[..., 12:])


def dop853(
    slope: Callable[[float, np.ndarray], np.ndarray],
    ends: tuple[float, float],
    start: np.ndarray,
    at: np.ndarray,
    tolerance: float = TOLERANCE,
    max_slopes: int = MAX_SLOPES,
    pick: np.ndarray | None = None,
    watch: Callable[[np.ndarray], None] | None = None,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Values (points, n) at sorted points, and those (n,) at the end.

    None if the integration does not finish, as for a rod that coils up, or is not finite.

    Parameters
    ----------
    max_slopes : right-hand sides allowed
    pick : (points, m), which of the n values are kept at each point; all by default
    watch : is called with the slopes (n,) after each step, and may change them in place
    """
    if not np.all(np.isfinite(start)):
        return None
    known: list[np.ndarray] = []
    with np.errstate(all="ignore"):  # a rod that diverges ends as NaN
        solver = DOP853(slope, ends[0], start, ends[1], rtol=tolerance, atol=tolerance)
        if not np.isfinite(solver.h_abs):  # scipy would try steps of NaN forever
            return None
        while solver.status == "running" and solver.nfev <= max_slopes:
            solver.step()
            if watch is not None:
                watch(solver.f)
            reached = int(np.searchsorted(at, solver.t, side="right"))
            if reached > len(known):
                between = solver.dense_output()
                # Point by point, because all n values at all points would fill the memory.
                for i in range(len(known), reached):
                    values = between(at[i])
                    known.append(values if pick is None else values[pick[i]])
    if solver.status != "finished" or not np.all(np.isfinite(solver.y)):
        return None
    return np.array(known).reshape(len(at), -1 if len(at) else 0), solver.y


def _cross(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Cross product along the first axis; np.cross would take longer than the rest of `rates`."""
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[j] * b[k], a[k] * b[j], out=out[i])
