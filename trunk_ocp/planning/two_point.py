"""Independent equilibria near planned shapes, as solutions of a two-point boundary value problem.

A rod with a thin loaded tip cannot be integrated from the base: an error in m(0) grows by
exp(int (|N| / E I)^(1/2) dZ), a billion times on an arm that tapers from 20 mm to 1 mm. So the rod
is cut into intervals over which errors grow little, all of them are integrated together, and
Newton's method closes the gaps between them, with the pose at the base and m(L) = 0 at the tip
(multiple shooting: Ascher, Mattheij & Russell 1995, chapter 4). The planned shape is only its
start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from ..model.activation import intrinsic_strain, mean_extension, stiffness, strains
from ..model.anatomy import Trunk
from ..model.loads import Loads, internal_force
from ..rod.linear_bvp import solve_linear_bvp
from ..rod.shape import Shape
from .independent_rod import TOLERANCE, Rods, Trajectory, base_frames, dop853, jumps_of

TURN = 2.0
"""Growth exponent and angle of an interval, about; differences resolve a tangent of e^2."""
MAX_INTERVALS = 400
MAX_TURN = 10.0  # of an interval; beyond, differences and Newton steps are meaningless
MAX_SLOPE = 100.0  # of the states across an interval; it starts at 2, or at most 10
MAX_RATES = 300  # right-hand sides per interval; 40 to 60 are usual
MAX_FAILURES = 6  # integrations of a group of rods that do not finish
GROWTH_POINTS = 100  # points at which the growth is evaluated
GROUP_RODS = 32
MAX_ROWS = 640  # intervals of rods that are solved together, to limit memory
MAX_ITERATIONS = 8
TANGENT_TOL = 1e-8  # of the integrations for tangents
STEP_TOL = 1e-8  # of the last Newton step, rad and in local units of moment
REUSE_STEP = 1e-3  # Newton step up to which tangents are used again
MAX_STEP = 1e6  # Newton step of a rod that diverges
NUDGE = 1e-6  # of the differences that make tangents


def equilibria(
    trunk: Trunk, x: np.ndarray, loads: Sequence[Loads], shape: Shape, Z: np.ndarray
) -> Trajectory:
    """Equilibria of H rods near given shapes (H,) at points Z, sorted; NaN where there is none.

    If some rods of a group take very long, other slow ones are given up together with them.

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
    nodes, units = growth.nodes()
    if some.size > 1 and some.size * (nodes.size - 1) > MAX_ROWS:
        middle = some.size // 2
        for half in (some[:middle], some[middle:]):
            _solve_some(trunk, x, loads, shape, half, path)
        return None
    found = _TwoPoint.of(trunk, x[some], own_loads, part, nodes, units).solve(path.Z)
    if found is not None:
        path.fill(some, found)
    return None


@dataclass(eq=False)
class _TwoPoint:
    """H rods cut into K intervals; a row is an interval of a rod, rod by rod.

    Attributes
    ----------
    nodes : (K + 1,)
        Ends of the intervals in m.
    units : (K + 1,)
        Moment in N m that bends a rod there as far as it is bent, for scale.
    d, m : (H, K + 1, 3, 3), (H, K + 1, 3)
        Directors and moment (N m) at the nodes, improved in place; m at the tip is zero.
    r0 : (H, 3)
        Base positions in m.
    lost : (H,) bool
        Rods that coil up or diverge; they are frozen, so that they do not slow down the others.
    steepness : (H,)
        Largest slope of each rod at the last step of an integration.
    failures : int
        Integrations that did not finish.
    """

    rods: Rods
    nodes: np.ndarray
    units: np.ndarray
    r0: np.ndarray
    d: np.ndarray
    m: np.ndarray
    lost: np.ndarray
    steepness: np.ndarray
    failures: int = 0

    @classmethod
    def of(
        cls,
        trunk: Trunk,
        x: np.ndarray,
        loads: Sequence[Loads],
        shape: Shape,
        nodes: np.ndarray,
        units: np.ndarray,
    ) -> _TwoPoint:
        """Rods with the states of a shape at their nodes."""
        K = nodes.size - 1
        middle = np.tile(nodes[:-1] + np.diff(nodes) / 2, len(x))
        row_loads = [load for load in loads for _ in range(K)]
        rods = Rods(trunk, np.repeat(x[:, :-2], K, axis=0), row_loads, middle)
        d, m = shape.directors(nodes), shape.moment(nodes)
        r0, d[:, 0] = base_frames(trunk, x[:, -2:])
        m[:, -1] = 0.0
        lost, steepness = np.zeros(len(x), dtype=bool), np.zeros(len(x))
        return cls(rods, nodes, units, r0, d, m, lost, steepness)

    def solve(self, Z: np.ndarray) -> tuple[np.ndarray, ...] | None:
        """Position, directors and moment at points Z, NaN where Newton's method fails.

        None where it fails for all.
        """
        tangents, size = np.zeros(0), np.full(len(self.m), math.inf)
        for _ in range(MAX_ITERATIONS):
            again = bool(np.any(size > REUSE_STEP))  # at first, and after large steps
            found: tuple[np.ndarray, ...] | None = self._nudged() if again else self._at_points(Z)
            if found is None:
                return None
            if again:
                tangents = self._tangents(found[-1])
            step = solve_linear_bvp(tangents, self._gaps(found[-1][0])[..., None])[..., 0]
            size = np.abs(step).max(axis=(1, 2))
            self.lost |= ~(size < MAX_STEP)
            size[self.lost] = 0.0
            if not again and np.all(size < STEP_TOL):
                return self._unless_lost(found[:3])
            step[self.lost] = 0.0
            self._move(step)
        self.lost |= ~(size < STEP_TOL)
        found = self._at_points(Z)
        return None if found is None else self._unless_lost(found[:3])

    def _unless_lost(self, found: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        for values in found:
            values[self.lost] = np.nan
        return found

    @property
    def widths(self) -> np.ndarray:
        """Lengths of the intervals (K,) in m."""
        return np.diff(self.nodes)

    def _starts(self) -> np.ndarray:
        """States (H, K, 15) at the intervals' left ends: r from there, d, m in local units."""
        H, K = len(self.m), self.widths.size
        m = self.m[:, :-1] / self.units[:-1, None]
        return np.concatenate([np.zeros((H, K, 3)), self.d[:, :-1].reshape(H, K, 9), m], axis=2)

    def _march(
        self, y: np.ndarray, tolerance: float, at: np.ndarray, pick: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """States from y (copies, H, K, 15), integrated together: at points, and at the right ends.

        At points `at` from 0 to 1 they are the entries `pick` (points, m) of the flattened
        (15, copies, H, K). None if all rods are lost.
        """
        H, K = len(self.m), self.widths.size
        Z, h = np.tile(self.nodes[:-1], H), np.tile(self.widths, H)
        unit = np.ones((15, 1, h.size))
        unit[:3], unit[12:] = h, np.tile(self.units[:-1], H)
        scale, shape = h / unit, (15, len(y), h.size)

        def slope(tau: float, flat: np.ndarray) -> np.ndarray:
            values = scale * self.rods.rates(Z + tau * h, flat.reshape(shape) * unit)
            return self._kept(values.reshape(15, -1, H, K)).ravel()

        def watch(slopes: np.ndarray) -> None:
            values = slopes.reshape(15, -1, H, K)
            self.steepness = np.abs(values[3:]).max(axis=(0, 1, 3))
            self.lost |= ~(self.steepness <= MAX_SLOPE)
            self._kept(values)

        start = np.moveaxis(y, 3, 0).ravel()
        while self.failures < MAX_FAILURES and not np.all(self.lost):
            self.steepness = np.full(H, math.inf)
            path = dop853(slope, (0.0, 1.0), start, at, tolerance, MAX_RATES, pick, watch)
            if path is not None:
                return path[0], np.moveaxis(path[1].reshape(15, -1, H, K), 0, -1)
            self.failures += 1
            self.lost |= ~(self.steepness <= min(MAX_TURN, self.steepness.max() / 2))
        return None

    def _kept(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes (15, copies, H, K) with zeros for lost rods."""
        if np.any(self.lost):
            slopes[:, :, self.lost] = 0.0
        return slopes

    def _nudged(self) -> tuple[np.ndarray] | None:
        """States (7, H, K, 15) at the right ends, from the left ends and six perturbed copies."""
        y = np.repeat(self._starts()[None], 7, axis=0)
        d = self.d[:, :-1]
        for i in range(3):
            y[1 + i, ..., 3:12] += NUDGE * np.cross(np.eye(3)[i], d).reshape(*d.shape[:2], 9)
            y[4 + i, ..., 12 + i] += NUDGE
        found = self._march(y, TANGENT_TOL, np.zeros(0), np.zeros((0, 0), dtype=int))
        return None if found is None else (found[1],)

    def _tangents(self, ends: np.ndarray) -> np.ndarray:
        """Derivatives (H, K, 6, 6) of turn and moment at the right ends by those at the left."""
        change = (ends[1:] - ends[0]) / NUDGE  # (6, H, K, 15)
        d = ends[0, ..., 3:12].reshape(*ends.shape[1:3], 3, 3)
        turn = np.cross(d, change[..., 3:12].reshape(*change.shape[:3], 3, 3)).sum(axis=3) / 2
        moment = change[..., 12:] * (self.units[:-1] / self.units[1:])[:, None]
        return np.moveaxis(np.concatenate([turn, moment], axis=3), 0, -1)

    def _gaps(self, ends: np.ndarray) -> np.ndarray:
        """Turn and moment (H, K, 6) from the nodes to where the intervals before them end."""
        d = ends[..., 3:12].reshape(*ends.shape[:2], 3, 3)
        turn = np.cross(self.d[:, 1:], d).sum(axis=2) / 2
        m = ends[..., 12:] * self.units[:-1, None]
        return np.concatenate([turn, (m - self.m[:, 1:]) / self.units[1:, None]], axis=2)

    def _move(self, step: np.ndarray) -> None:
        turn = Rotation.from_rotvec(step[..., :3].reshape(-1, 3)).as_matrix()
        self.d = self.d @ turn.reshape(self.d.shape).swapaxes(-1, -2)
        self.m = self.m + step[..., 3:] * self.units[:, None]

    def _at_points(self, Z: np.ndarray) -> tuple[np.ndarray, ...] | None:
        """Position, directors and moment (H, points, ...) at points, states at the right ends."""
        H, K = len(self.m), self.widths.size
        interval = np.searchsorted(self.nodes[1:-1], Z, side="left")
        tau = (Z - self.nodes[interval]) / self.widths[interval]
        order = np.argsort(tau, kind="stable")
        own = np.arange(15 * H) * K + interval[order, None]  # of (15, H, K) made flat
        found = self._march(self._starts()[None], TOLERANCE, tau[order], own)
        if found is None:
            return None
        y = np.empty((Z.size, 15, H))
        y[order] = found[0].reshape(-1, 15, H)
        y = np.moveaxis(y, 2, 0)  # (H, points, 15)
        h, ends = self.widths[:, None], found[1]
        edges = np.concatenate([self.r0[:, None], ends[0, ..., :3] * h], axis=1).cumsum(axis=1)
        return (
            edges[:, interval] + y[..., :3] * h[interval],
            y[..., 3:12].reshape(*y.shape[:2], 3, 3),
            y[..., 12:] * self.units[interval, None],
            ends,
        )


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
        N = np.array([np.linalg.norm(internal_force(load, trunk, Z), axis=1) for load in loads])
        u = u_hat + shape.moment(Z) * mean[..., None] ** 2 / K[:, 1:]
        pull = N * (1 + N * mean / K[:, 0]) * mean**2 / K[:, 1]
        rates = np.abs(zeta_hat) * (np.linalg.norm(u, axis=2) + np.sqrt(np.abs(pull)))
        return cls(jumps, Z, rates + trunk.taper_rate / trunk.taper(Z) + 1 / trunk.length, trunk)

    @property
    def bearable(self) -> np.ndarray:
        """Which rods (H,) can be cut into intervals over which errors grow little."""
        growth = np.sum(np.diff(self.Z) * (self.rates[:, 1:] + self.rates[:, :-1]) / 2, axis=1)
        return np.asarray(growth < MAX_TURN * MAX_INTERVALS)

    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (K + 1,) between which errors grow little, and units of moment there in N m."""
        Z, rate = self.Z, self.rates.max(axis=0)
        growth = np.concatenate([[0.0], np.cumsum(np.diff(Z) * (rate[1:] + rate[:-1]) / 2)])
        each = max(TURN, growth[-1] / MAX_INTERVALS)
        nodes = [0.0]
        for start, end in pairwise(np.searchsorted(Z, self.jumps).tolist()):
            count = max(1, math.ceil((growth[end] - growth[start]) / each))
            levels = np.linspace(growth[start], growth[end], count + 1)[1:-1]
            nodes += [*np.interp(levels, growth[start : end + 1], Z[start : end + 1]), Z[end]]
        units = np.interp(nodes, Z, rate) * stiffness(self.trunk, np.asarray(nodes))[:, 1]
        return np.asarray(nodes), units
