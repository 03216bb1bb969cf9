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

    A state is y (15, copies, n) in SI units: the centerline r (3) in space axes, then d_i (3) in
    space axes and m_i, for i = 1, 2, 3. The last axis of arrays is that of the rods, so that
    operations run along contiguous memory.

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
        self.tip = np.array([load.tip_force for load in loads]).T[:, None]
        self.log = np.array([load.contact_force for load in loads]).T[:, None]
        self.touching, self.touched = start <= middle, start < L
        self.spread = np.where(self.touched, L - start, 1.0)
        couple = np.array([load.contact_couple for load in loads]).T
        self.couple = (self.touching * couple / self.spread)[:, None]
        lever = np.array([load.contact_lever for load in loads])
        self.hung = (self.touching * lever / self.spread) * self.log
        self.has_couple, self.is_hung = bool(self.couple.any()), bool(self.hung.any())

    def sections(self, Z: np.ndarray) -> Sections:
        """The rods' cross sections at points Z (..., n) in m."""
        K = np.moveaxis(stiffness(self.trunk, Z), -1, -2)[..., None, :]
        share = np.where(self.touching, (self.trunk.length - Z) / self.spread, self.touched)
        force = self.tip + self.log * share[..., None, None, :]
        force[..., 2, 0, :] += self.gravity * mass_beyond(self.trunk, Z)
        return Sections(
            force,
            self.zeta_hat * (self.mean / K[..., 0, :, :]),
            self.zeta_hat * self.c / self.trunk.taper(Z)[..., None, None, :],
            self.zeta_hat * self.mean**2 / K[..., 1:, :, :],
            self,
        )


@dataclass(frozen=True, eq=False)
class Sections:
    """All that eq. (14) takes at points (...) of n rods besides their states.

    Attributes
    ----------
    force : (..., 3, 1, n)
        On the section, in N and space axes.
    stretch : (..., 1, n)
        Of zeta by n_3, in 1/N.
    turn, bend : (..., 3, 1, n)
        zeta_hat u_hat in 1/m, and what zeta_hat u gains by m, in 1/(N m^2).
    """

    force: np.ndarray
    stretch: np.ndarray
    turn: np.ndarray
    bend: np.ndarray
    rods: Rods

    def rates(self, y: np.ndarray, at: int | tuple[()] = ()) -> np.ndarray:
        """Derivatives of states y (15, copies, n) by Z, at one of the points."""
        rods, rows = self.rods, y[3:].reshape(3, 4, *y.shape[1:])
        d, m = rows[:, :3], rows[:, 3]
        n = (d * self.force[at]).sum(axis=1)
        zeta = rods.zeta_hat + self.stretch[at] * n[2]
        spin = self.turn[at] + self.bend[at] * m
        dy = np.empty_like(y)
        dy[:3] = zeta * d[2]
        # A spin turns directors as it changes the components of a fixed vector, m apart from loads.
        changes = dy[3:].reshape(rows.shape)
        _cross(rows, spin[:, None], changes)
        dm = changes[:, 3]
        dm[0] += zeta * n[1]
        dm[1] -= zeta * n[0]
        if rods.has_couple:
            dm -= (d * rods.couple).sum(axis=1)
        if rods.is_hung:
            couple = np.empty_like(d[1])
            _cross(d[1], np.broadcast_to(rods.hung, d[1].shape), couple)
            dm -= (d * couple).sum(axis=1)
        return dy


def packed(r: np.ndarray, d: np.ndarray, m: np.ndarray) -> np.ndarray:
    """States (15, n) of positions (n, 3), directors (n, 3, 3) and moments (n, 3)."""
    rows = np.concatenate([d, m[..., None]], axis=2)
    return np.concatenate([r, rows.reshape(len(r), 12)], axis=1).T


def unpacked(y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position (..., 3), directors (..., 3, 3) and moment (..., 3) of states y (15, ...)."""
    rows = np.moveaxis(y[3:].reshape(3, 4, *y.shape[1:]), (0, 1), (-2, -1))
    return np.moveaxis(y[:3], 0, -1), rows[..., :3], rows[..., 3]


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
    H, L = len(loads), trunk.length
    unit = packed(
        np.full((1, 3), L), np.ones((1, 3, 3)), np.full((1, 3), stiffness(trunk, 0.0)[1] / L)
    )[..., None]
    r0, d0 = base_frames(trunk, x[:, -2:])
    state = packed(r0, d0, moment)[:, None] / unit
    values = np.full((Z.size, 15, 1, H), np.nan)
    values[Z <= 0] = state
    for start, end in pairwise(jumps_of(trunk, loads)):
        inside = (Z > start) & (Z <= end)
        rods = Rods(trunk, x[:, :-2], loads, np.full(H, (start + end) / 2))

        def slope(at: float, y: np.ndarray, rods: Rods = rods) -> np.ndarray:
            y = y.reshape(15, 1, H) * unit
            return (rods.sections(np.full(H, at)).rates(y) / unit).ravel()

        result = dop853(slope, (start, end), state.ravel(), Z[inside], max_slopes)
        if result is None:
            break  # NaN from here on fails the check
        values[inside] = result[0].reshape(-1, 15, 1, H)
        state = result[1].reshape(15, 1, H)
    path = Trajectory(Z, *unpacked(np.transpose((values * unit)[:, :, 0], (1, 2, 0))))
    path.moment[:, Z <= 0] = moment[:, None]  # without the round-off of scaling
    return path


def dop853(
    slope: Callable[[float, np.ndarray], np.ndarray],
    ends: tuple[float, float],
    start: np.ndarray,
    at: np.ndarray,
    max_slopes: int = MAX_SLOPES,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Values (points, n) at sorted points, and those (n,) at the end.

    None if the integration does not finish within a number of right-hand sides, as for a rod that
    coils up, or is not finite.
    """
    if not np.all(np.isfinite(start)):
        return None
    known: list[np.ndarray] = []
    with np.errstate(all="ignore"):  # a rod that diverges ends as NaN
        solver = DOP853(slope, ends[0], start, ends[1], rtol=TOLERANCE, atol=TOLERANCE)
        if not np.isfinite(solver.h_abs):  # scipy would try steps of NaN forever
            return None
        while solver.status == "running" and solver.nfev <= max_slopes:
            solver.step()
            reached = int(np.searchsorted(at, solver.t, side="right"))
            if reached > len(known):
                between = solver.dense_output()
                known += [between(at[i]) for i in range(len(known), reached)]
    if solver.status != "finished" or not np.all(np.isfinite(solver.y)):
        return None
    return np.array(known).reshape(len(at), -1 if len(at) else 0), solver.y


def _cross(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Cross product along the first axis; np.cross would take longer than the rest of `rates`.

    The other axes may broadcast.
    """
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[j] * b[k], a[k] * b[j], out=out[i])
