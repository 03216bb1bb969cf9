"""Independent equilibria near planned shapes, as solutions of a two-point boundary value problem.

A rod with a thin loaded tip cannot be integrated from the base: an error in m(0) grows by
exp(int (|N| / E I)^(1/2) dZ), a billion times on an arm that tapers from 20 mm to 1 mm. So the rod
is cut into short intervals, each a single step of the eighth-order method of Dormand & Prince, all
of them are integrated together, and Newton's method closes the gaps between them, with the pose at
the base and m(L) = 0 at the tip (multiple shooting: Ascher, Mattheij & Russell 1995, chapter 4).
The planned shape is only its start. Intervals are halved until the method's own estimate of its
error is small everywhere. The tangents of Newton's method come from a step of the fifth-order
method: they decide how fast the gaps close, not whether they are closed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import DOP853, RK45
from scipy.spatial.transform import Rotation

from ..model.activation import intrinsic_strain, mean_extension, stiffness, strains
from ..model.anatomy import Trunk
from ..model.loads import Loads, internal_forces
from ..rod.linear_bvp import solve_linear_bvp
from ..rod.shape import Shape
from .independent_rod import Rods, Sections, Trajectory, base_frames, jumps_of, packed, unpacked

TURN = 0.45
"""Growth exponent and angle of an interval, about, before it is halved."""
MAX_GROWTH = 4000.0  # of a rod; beyond, differences and Newton steps are meaningless
TOLERANCE = 1e-9  # on the estimated error of an interval, in rad and local units
MAX_HALVINGS = 3
GROWTH_POINTS = 100  # points at which the growth is evaluated
GROUP_RODS = 32
MAX_ROWS = 4000  # intervals of rods that are solved together, to limit memory
MAX_ITERATIONS = 10
STEP_TOL = 1e-8  # of the last Newton step, rad and in local units of moment
REUSE_STEP = 1e-3  # Newton step up to which tangents are used again
MAX_STEP = 10.0  # Newton step of a rod that diverges; right plans take 1e-4
NUDGE = 1e-6  # of the differences that make tangents

EIGHTH, DENSE = 12, 16
"""Stages of the eighth-order method of Dormand & Prince, and those that interpolate as well."""
_A = np.zeros((DENSE, DENSE))
_A[:EIGHTH, :EIGHTH], _A[EIGHTH, :EIGHTH], _A[EIGHTH + 1 :] = DOP853.A, DOP853.B, DOP853.A_EXTRA
_C = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])


def equilibria(
    trunk: Trunk, x: np.ndarray, loads: Sequence[Loads], shape: Shape, Z: np.ndarray
) -> Trajectory:
    """Equilibria of H rods near given shapes (H,) at points Z, sorted; NaN where there is none.

    Parameters
    ----------
    x : (H, muscles + 2)
        Activations and head angles.
    loads : one for each rod
    """
    path = Trajectory.unknown(len(loads), Z)
    finite = np.isfinite(x).all(axis=1) & np.isfinite(shape.states).all(axis=(1, 2, 3))
    known = np.flatnonzero(finite)
    for first in range(0, known.size, GROUP_RODS):
        _solve_some(trunk, x, loads, shape, known[first : first + GROUP_RODS], path)
    return path


def _solve_some(
    trunk: Trunk,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    some: np.ndarray,
    path: Trajectory,
) -> None:
    """Fill in the path of some rods, in halves where they need many intervals."""
    own_loads, part = [loads[t] for t in some], shape[some]
    growth = _Growth.of(trunk, x[some, :-2], own_loads, part)
    if not np.all(growth.bearable):
        some = some[growth.bearable]
        return _solve_some(trunk, x, loads, shape, some, path) if some.size else None
    nodes = growth.nodes()
    if some.size > 1 and some.size * (nodes.size - 1) > MAX_ROWS:
        middle = some.size // 2
        for half in (some[:middle], some[middle:]):
            _solve_some(trunk, x, loads, shape, half, path)
        return None
    for _ in range(MAX_HALVINGS + 1):
        rods = _TwoPoint(trunk, x[some], own_loads, part, nodes, growth.units(nodes))
        rough = np.any(rods.error() > TOLERANCE, axis=0)
        if not np.any(rough):
            break
        nodes = np.union1d(nodes, (nodes[:-1] + np.diff(nodes) / 2)[rough])
    path.fill(some, rods.solve(path.Z))
    return None


class _TwoPoint:
    """H rods cut into K intervals, each a step; a row is an interval of a rod, rod by rod.

    Attributes
    ----------
    nodes : (K + 1,)
        Ends of the intervals in m.
    units : (K + 1,)
        Moment in N m that bends a rod there as far as it is bent, for scale.
    r0 : (H, 3)
        Base positions in m.
    d, m : (H, K + 1, 3, 3), (H, K + 1, 3)
        Directors and moment (N m) at the nodes, which Newton's method improves; m at the tip is 0.
    h : (rows,)
        Lengths of the steps in m.
    unit : (15, 1, rows)
        Of the components of states, in which errors compare.
    starts : (15, 1, rows)
        States at the left ends, with r = 0.
    changes : (16, 15, 1, rows)
        h times the slopes of a step's stages, of which the last four only interpolate.
    """

    def __init__(
        self,
        trunk: Trunk,
        x: np.ndarray,
        loads: Sequence[Loads],
        shape: Shape,
        nodes: np.ndarray,
        units: np.ndarray,
    ) -> None:
        H, K = len(x), nodes.size - 1
        self.nodes, self.units = nodes, units
        self.h, left = np.tile(np.diff(nodes), H), np.tile(nodes[:-1], H)
        row_loads = [load for load in loads for _ in range(K)]
        rods = Rods(trunk, np.repeat(x[:, :-2], K, axis=0), row_loads, left + self.h / 2)
        self.sections = rods.sections(left + _C[:, None] * self.h)
        self.rough_sections = rods.sections(left + RK45.C[:, None] * self.h)
        self.d, self.m = shape.frames(nodes)
        self.r0, self.d[:, 0] = base_frames(trunk, x[:, -2:])
        self.m[:, -1] = 0.0
        bend = np.tile(units[:-1], H)[:, None] * np.ones(3)
        self.unit = packed(self.h[:, None] * np.ones(3), np.ones((H * K, 3, 3)), bend)[:, None]
        self.changes = np.empty((DENSE, 15, 1, H * K))
        self._march()

    def solve(self, Z: np.ndarray) -> tuple[np.ndarray, ...]:
        """Position, directors and moment at points Z, NaN where Newton's method fails."""
        size, tangents = np.full(len(self.m), math.inf), np.zeros(0)
        lost = np.zeros(len(self.m), dtype=bool)
        for _ in range(MAX_ITERATIONS):
            if np.any(size > REUSE_STEP):  # at first, and after large steps
                tangents = self._tangents()
            step = solve_linear_bvp(tangents, self._gaps()[..., None])[..., 0]
            size = np.abs(step).max(axis=(1, 2))
            lost |= ~(size < MAX_STEP)
            size[lost], step[lost] = 0.0, 0.0
            if np.all(size < STEP_TOL):
                break
            self._move(step)
        lost |= ~((size < STEP_TOL) & np.all(self.error() < 2 * TOLERANCE, axis=1))
        found = self._at_points(Z)
        for values in found:
            values[lost] = np.nan
        return found

    def error(self) -> np.ndarray:
        """Estimated errors (H, K) of the steps, in rad and local units, as DOP853 makes them."""
        fifth, third = (
            np.mean((_weighted(E[:EIGHTH], self.changes) / self.unit) ** 2, axis=0)
            for E in (DOP853.E5, DOP853.E3)
        )
        error = fifth / np.sqrt(np.maximum(fifth + 0.01 * third, np.finfo(float).tiny))
        return np.asarray(error.reshape(len(self.m), -1))

    def _march(self) -> None:
        """Make a step from every node but the last."""
        d, m = self.d[:, :-1].reshape(-1, 3, 3), self.m[:, :-1].reshape(-1, 3)
        self.starts = packed(np.zeros_like(m), d, m)[:, None]
        _fill(self.changes, range(EIGHTH), self.starts, self.h, self.sections, _A)

    def _ends(self) -> tuple[np.ndarray, ...]:
        """Position from the left ends, directors and moment (H, K, ...) at the right ends."""
        y = self.starts + _weighted(DOP853.B, self.changes)
        return unpacked(y.reshape(15, len(self.m), -1))

    def _gaps(self) -> np.ndarray:
        """Turn and moment (H, K, 6) from the nodes to where the intervals before them end."""
        _, d, m = self._ends()
        turn = np.cross(self.d[:, 1:], d).sum(axis=2) / 2
        return np.concatenate([turn, (m - self.m[:, 1:]) / self.units[1:, None]], axis=2)

    def _tangents(self) -> np.ndarray:
        """Derivatives (H, K, 6, 6) of turn and moment at the right ends by those at the left.

        From steps of the fifth-order method and six states that differ a little.
        """
        H, K = len(self.m), self.nodes.size - 1
        y = np.repeat(self.starts, 7, axis=1)
        rows = y[3:].reshape(3, 4, 7, -1)
        for i in range(3):
            rows[:, :3, 1 + i] += NUDGE * np.cross(np.eye(3)[i], rows[:, :3, 0], axisb=1, axisc=1)
            rows[i, 3, 4 + i] += NUDGE * self.unit[-1, 0]
        changes = np.empty((len(RK45.A), *y.shape))
        _fill(changes, range(len(RK45.A)), y, self.h, self.rough_sections, RK45.A)
        _, d, m = unpacked((y + _weighted(RK45.B, changes)).reshape(15, 7, H, K))
        turn = np.cross(d[0], d[1:]).sum(axis=3) / 2
        change = np.concatenate([turn, (m[1:] - m[0]) / self.units[1:, None]], axis=3)
        return np.moveaxis(change / NUDGE, 0, -1)

    def _move(self, step: np.ndarray) -> None:
        """Change turn and moment at the nodes by a step (H, K + 1, 6)."""
        turn = Rotation.from_rotvec(step[..., :3].reshape(-1, 3)).as_matrix()
        self.d = self.d @ turn.reshape(self.d.shape).swapaxes(-1, -2)
        self.m = self.m + step[..., 3:] * self.units[:, None]
        self._march()

    def _at_points(self, Z: np.ndarray) -> tuple[np.ndarray, ...]:
        """Position, directors and moment (H, points, ...) at sorted points."""
        H, K = len(self.m), self.nodes.size - 1
        _fill(self.changes, range(EIGHTH, DENSE), self.starts, self.h, self.sections, _A)
        interval = np.searchsorted(self.nodes[1:-1], Z, side="left")
        weights = _dense((Z - self.nodes[interval]) / np.diff(self.nodes)[interval])
        y = np.array(self.starts.reshape(15, H, K)[..., interval])
        changes = self.changes.reshape(DENSE, 15 * H, K)
        first = np.searchsorted(interval, np.arange(K + 1))
        for k in np.unique(interval):
            own = slice(first[k], first[k + 1])
            y[..., own] += (changes[..., k].T @ weights[own].T).reshape(15, H, -1)
        ends = self._ends()[0]
        r, d, m = unpacked(y)
        edges = np.concatenate([self.r0[:, None], ends], axis=1).cumsum(axis=1)
        return r + edges[:, interval], d, m


def _fill(
    changes: np.ndarray,
    stages: range,
    y: np.ndarray,
    h: np.ndarray,
    sections: Sections,
    A: np.ndarray,
) -> None:
    """Set h times the slopes of some stages of an explicit Runge-Kutta step from y.

    changes : (stages, *y.shape)
    """
    for s in stages:
        np.multiply(h, sections.rates(y + _weighted(A[s, :s], changes), s), out=changes[s])


def _weighted(weights: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Weighted sum of the first changes; of none it is 0."""
    flat = changes.reshape(len(changes), -1)[: weights.size]
    return np.asarray((weights @ flat).reshape(changes.shape[1:]))


def _dense(tau: np.ndarray) -> np.ndarray:
    """Weights (..., 16) of the stages of a step, which interpolate it at tau from 0 to 1.

    The seventh-order interpolation of DOP853: Hairer, Norsett & Wanner, Solving ODEs I, II.6.
    """
    start, end = np.eye(DENSE)[0], np.eye(DENSE)[EIGHTH]
    step = np.append(DOP853.B, np.zeros(DENSE - EIGHTH))
    terms = np.stack([step, start - step, 2 * step - start - end, *DOP853.D])
    factors = np.stack([tau, 1 - tau] * 4, axis=-1)[..., : len(terms)]
    return np.asarray(np.cumprod(factors, axis=-1) @ terms)


@dataclass(frozen=True, eq=False)
class _Growth:
    """Growth of turns and errors along H rods.

    Turns grow by curvature, errors of bending by the tensile or compressive force and by 1 / f(Z).

    Attributes
    ----------
    jumps : list of float
        Points in m at which the equations jump.
    Z : (n,)
        Points in m, evenly spaced in units of the local radius, jumps included.
    rates : (H, n)
        Growth exponent and angle in 1/m.
    """

    jumps: list[float]
    Z: np.ndarray
    rates: np.ndarray
    trunk: Trunk

    @classmethod
    def of(
        cls, trunk: Trunk, activation: np.ndarray, loads: Sequence[Loads], shape: Shape
    ) -> _Growth:
        """Growth along rods that have about a shape (H,)."""
        jumps = jumps_of(trunk, loads)
        k, levels = trunk.taper_rate, np.linspace(0.0, 1.0, GROWTH_POINTS)
        local = -np.expm1(levels * np.log1p(-k * trunk.length)) / k if k else levels * trunk.length
        Z = np.unique([*jumps, *local[1:-1]])  # evenly in local radii
        zeta_hat, u_hat = intrinsic_strain(trunk, activation, Z)
        mean = mean_extension(trunk, strains(trunk, activation))[:, None]
        K = stiffness(trunk, Z)
        N = np.linalg.norm(internal_forces(loads, trunk, Z), axis=2)
        u = u_hat + shape.moment(Z) * mean[..., None] ** 2 / K[:, 1:]
        pull = N * (1 + N * mean / K[:, 0]) * mean**2 / K[:, 1]
        rates = np.abs(zeta_hat) * (np.linalg.norm(u, axis=2) + np.sqrt(np.abs(pull)))
        return cls(jumps, Z, rates + trunk.taper_rate / trunk.taper(Z) + 1 / trunk.length, trunk)

    @property
    def bearable(self) -> np.ndarray:
        """Which rods (H,) are not so wound up that their equations are meaningless."""
        growth = np.sum(np.diff(self.Z) * (self.rates[:, 1:] + self.rates[:, :-1]) / 2, axis=1)
        return np.asarray(growth < MAX_GROWTH)

    def nodes(self) -> np.ndarray:
        """Nodes (K + 1,) between which errors grow little."""
        Z, rate = self.Z, self.rates.max(axis=0)
        growth = np.concatenate([[0.0], np.cumsum(np.diff(Z) * (rate[1:] + rate[:-1]) / 2)])
        nodes = [0.0]
        for start, end in pairwise(np.searchsorted(Z, self.jumps).tolist()):
            count = max(1, math.ceil((growth[end] - growth[start]) / TURN))
            levels = np.linspace(growth[start], growth[end], count + 1)[1:-1]
            nodes += [*np.interp(levels, growth[start : end + 1], Z[start : end + 1]), Z[end]]
        return np.asarray(nodes)

    def units(self, nodes: np.ndarray) -> np.ndarray:
        """Moment in N m that bends a rod at nodes as far as it is bent, for scale."""
        rate = np.interp(nodes, self.Z, self.rates.max(axis=0))
        return np.asarray(rate * stiffness(self.trunk, nodes)[:, 1])
