"""The equilibrium next to a shape, by a solver that has nothing in common with the planner's.

Scipy's `solve_bvp` on equations written out once more: in quaternions, with curvature in place of
moment, all stretches without jumps stacked on one interval. Of the package only the trunk's data
and, as a first guess, the shape to be judged are used.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from trunk_ocp.model.anatomy import Trunk
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.shape import Shape
from trust import reference

TOLERANCE = 1e-7
MOST_NODES = 20_000

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Rod:
    """An equilibrium: points Z (n,), centerline (n, 3), directors (n, 3, 3) and least stretch."""

    Z: Array
    position: Array
    directors: Array
    least: float

    def at(self, Z: float) -> tuple[Array, Array]:
        """Position (3,) and directors (3, 3) at one of the points that were asked for."""
        i = int(np.argmin(np.abs(self.Z - Z)))
        return self.position[i], self.directors[i]


class Judge:
    """One trunk under one load, as a two-point problem for `solve_bvp` on 0 <= s <= 1.

    Unknowns are q (4) and moment times L / E I(Z) (3) of each stretch between jumps: segments, and
    where a contact begins. What a thin tip needs is resolved at its own scale: s runs evenly in
    local radii.
    """

    def __init__(self, trunk: Trunk, activation: Array, head: Array, load: Loads) -> None:
        self.trunk, self.load = trunk, load
        own = reference.strains(trunk, np.asarray(activation)[None])[0]
        self.mean = float(own[:, 0] @ np.diff(trunk.edges)) / trunk.length
        touched = load.contact_from
        jumps = {*trunk.edges} | ({touched} if touched is not None else set())
        self.stretches = list(pairwise(sorted(jumps)))
        middles = [(start + end) / 2 for start, end in self.stretches]
        self.strain = own[np.searchsorted(trunk.edges, middles) - 1]
        self.touching = [touched is not None and middle > touched for middle in middles]
        self.r0, self.frame = reference.base(trunk, head)
        self.rate = trunk.tan_taper / trunk.base_radius

    def points(self, stretch: int, s: Array) -> tuple[Array, Array]:
        """Z and dZ/ds of a stretch at s."""
        start, end = self.stretches[stretch]
        if self.rate == 0:
            return start + s * (end - start), np.full_like(s, end - start)
        first, last = (math.log1p(-self.rate * Z) for Z in (start, end))
        f = np.exp(first + s * (last - first))
        return (1 - f) / self.rate, -(last - first) * f / self.rate

    def fraction(self, stretch: int, Z: Array) -> Array:
        """The s of those points Z that lie in a stretch."""
        start, end = self.stretches[stretch]
        Z = Z[(start <= Z) & (Z <= end)]
        if self.rate == 0:
            return (Z - start) / (end - start)
        first, last = (math.log1p(-self.rate * Z) for Z in (start, end))
        return np.clip((np.log1p(-self.rate * Z) - first) / (last - first), 0.0, 1.0)

    def force(self, Z: Array) -> Array:
        """Internal force (3, n) in space axes."""
        load, L = self.load, self.trunk.length
        force = np.array(load.tip_force)[:, None] * np.ones_like(Z)
        force[2] += load.gravity * np.array([reference.weight_beyond(self.trunk, at) for at in Z])
        if load.contact_from is not None:
            share = np.minimum(1.0, (L - Z) / (L - load.contact_from))
            force += np.array(load.contact_force)[:, None] * share
        return force

    def rates(self, stretch: int, Z: Array, y: Array) -> tuple[Array, Array, Array]:
        """Derivatives by Z of the seven unknowns (7, n), dr/dZ (3, n) and zeta / zeta_hat (n,)."""
        trunk, load, L = self.trunk, self.load, self.trunk.length
        f = 1 - self.rate * Z
        radius = trunk.base_radius * f
        EA = trunk.youngs_modulus * math.pi * radius**2 / self.mean
        EI = trunk.youngs_modulus * math.pi / 4 * radius**4  # of the initial shape
        d = frames(y[:4])
        n = np.einsum("ijn,jn->in", d, self.force(Z))
        zeta_hat, c = self.strain[stretch, 0], self.strain[stretch, 1:]
        along = 1 + n[2] / EA
        zeta = zeta_hat * along
        m = y[4:] * EI / L
        soft = self.mean**2 / EI * np.array([[1.0], [1.0], [1 + trunk.poisson_ratio]])
        u = c[:, None] / f + m * soft
        q0, v = y[0], y[1:4]
        spin = zeta_hat * u
        dq = np.vstack([-(v * spin).sum(axis=0), q0 * spin + np.cross(v, spin, axis=0)]) / 2
        dm = zeta_hat * np.cross(m, u, axis=0)
        dm[0] += zeta * n[1]
        dm[1] -= zeta * n[0]
        if self.touching[stretch] and load.contact_from is not None:
            dm -= np.einsum("ijn,j->in", d, load.contact_couple) / (L - load.contact_from)
        curvature = dm * L / EI + 4 * self.rate / f * y[4:]
        return np.vstack([dq, curvature]), zeta * d[2], along

    def solve(self, shape: Shape, at: Array | None = None) -> Rod | None:
        """The equilibrium near a shape, at the points Z (n,) asked for and at others.

        None if `solve_bvp` finds none.
        """
        EI = self.trunk.youngs_modulus * math.pi / 4
        s = np.linspace(0.0, 1.0, 200)
        guess = []
        for i in range(len(self.stretches)):
            Z, _ = self.points(i, s)
            state = shape.state(np.clip(Z, 0.0, self.trunk.length)).T
            local = EI * (self.trunk.base_radius * (1 - self.rate * Z)) ** 4
            guess.append(np.vstack([state[:4], state[4:] * self.trunk.length / local]))

        def slope(s: Array, y: Array) -> Array:
            parts = []
            for i in range(len(self.stretches)):
                Z, per_s = self.points(i, s)
                parts.append(self.rates(i, Z, y[7 * i : 7 * i + 7])[0] * per_s)
            return np.vstack(parts)

        q0 = self._base(guess[0][:4, 0])

        def ends(left: Array, right: Array) -> Array:
            return np.concatenate([left[:4] - q0, left[7:] - right[:-7], right[-3:]])

        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = solve_bvp(slope, ends, s, np.vstack(guess), tol=TOLERANCE, max_nodes=MOST_NODES)
        return self._rod(found, np.zeros(0) if at is None else at) if found.success else None

    def _base(self, near: Array) -> Array:
        """The quaternion (4,) of the base, of the two that there are the one nearer to a guess."""
        x, y, z, w = Rotation.from_matrix(self.frame.T).as_quat()
        q = np.array([w, x, y, z])
        return q if q @ near >= 0 else -q

    def _rod(self, found: Any, at: Array) -> Rod:
        """The centerline by a Gauss rule on the intervals that `solve_bvp` chose."""
        nodes, weights = np.polynomial.legendre.leggauss(4)
        every_Z, every_r, every_d, least, r = [], [], [], math.inf, self.r0
        for i in range(len(self.stretches)):
            edges = np.union1d(found.x, self.fraction(i, at))
            width = np.diff(edges)[:, None]
            s = edges[:-1, None] + width * (1 + nodes) / 2
            part = slice(7 * i, 7 * i + 7)
            Z, per_s = self.points(i, s.ravel())
            _, slope, along = self.rates(i, Z, found.sol(s.ravel())[part])
            steps = (slope * per_s).reshape(3, *s.shape) @ weights * width[:, 0] / 2
            line = r + np.concatenate([np.zeros((1, 3)), steps.T.cumsum(axis=0)])
            every_Z.append(self.points(i, edges)[0])
            every_r.append(line)
            every_d.append(np.moveaxis(frames(found.sol(edges)[part][:4]), -1, 0))
            least, r = min(least, float(along.min())), line[-1]
        return Rod(np.concatenate(every_Z), np.concatenate(every_r), np.concatenate(every_d), least)

    def error(self, shape: Shape) -> float | None:
        """How far a shape is from the equilibrium next to it, in L; infinite if none exists.

        None if `solve_bvp` cannot tell.
        """
        found = self.solve(shape)
        return None if found is None else self.difference(found, shape)

    def difference(self, found: Rod, shape: Shape) -> float:
        """How far a shape is from an equilibrium, in L; infinite if that has no length left."""
        claimed = shape.position(np.clip(found.Z, 0.0, self.trunk.length))
        off = float(np.linalg.norm(claimed - found.position, axis=1).max()) / self.trunk.length
        return off if found.least > 0 else math.inf


def frames(q: Array) -> Array:
    """Directors (3, 3, n), d_i first, of quaternions (4, n) of any length."""
    w, v = q[0], q[1:]
    size = (q**2).sum(axis=0)
    d = []
    for e in np.eye(3):
        e = e[:, None] * np.ones_like(w)
        turned = (w**2 - (v**2).sum(axis=0)) * e + 2 * (v * e).sum(axis=0) * v
        d.append((turned + 2 * w * np.cross(v, e, axis=0)) / size)
    return np.array(d)
