"""Every answer checked by other means: no CasADi, no collocation, no optimiser.

The rod equations (14), (15) are written out again in NumPy with rotation matrices, and
integrated by scipy's DOP853 from the planned moment at the base. What a plan claims - shape,
free tip, targets, bounds - is recomputed from that.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from .activation import intrinsic_strain, mean_extension, stiffness, strains
from .anatomy import Trunk
from .deferred_signals import deferred_interrupts
from .head import base_pose
from .loads import Loads, mass_beyond
from .motion import Motion, allowed
from .rotations import directors as directors_of
from .statics import Shape
from .threads import one_thread

TOLERANCE = 1e-10
LARGEST_DIFFERENCE = 1e-4  # m, between the planned and the integrated centerline
LARGEST_FORCE_DIFFERENCE = 1e-3  # of the largest force that pulls, between planned and held pull
LARGEST_END_MOMENT = 1e-3  # of the largest moment along the trunk
MOST_SLOPES = 30_000  # of an integration, in 2,500 steps; the shipped motions take about 100
SLACK = 1e-6  # by which a bound may be exceeded; Ipopt relaxes bounds by 1e-8 of their size


@dataclass(frozen=True)
class Trajectory:
    """Independently integrated shapes of H rods at points Z (n,).

    `position` (H, n, 3) m; `directors` (H, n, 3, 3), row i is d_i; `moment` (H, n, 3) N m.
    """

    Z: np.ndarray
    position: np.ndarray
    directors: np.ndarray
    moment: np.ndarray


@dataclass(frozen=True)
class Verification:
    """What the independent check found, one entry for each time step.

    Attributes
    ----------
    position_difference : (H,)
        Largest distance in m between planned and integrated centerline.
    end_moment : (H,)
        Moment left at the free tip, as a fraction of the largest along the trunk.
    tip_force : (H,)
        Distance between the planned tip force and what the motion asks for, along held
        directions as integrated, as a fraction of its size.
    bounds, extension, change : (H,)
        Largest excess over the bounds on activations (no unit) and head angles (rad), on
        zeta_hat anywhere along the trunk, and on the change from the step before.
    """

    trajectory: Trajectory
    position_difference: np.ndarray
    end_moment: np.ndarray
    tip_force: np.ndarray
    bounds: np.ndarray
    extension: np.ndarray
    change: np.ndarray

    @property
    def too_coarse(self) -> bool:
        """Whether planned and integrated centerlines differ by more than is allowed."""
        return bool(np.any(self.position_difference > LARGEST_DIFFERENCE))

    @property
    def faults(self) -> list[str]:
        """What does not hold, a sentence each; empty if all does."""
        checks = (
            ("planned and integrated centerline differ by", self.position_difference, "m",
             LARGEST_DIFFERENCE),
            ("the moment at the free tip is", self.end_moment, "of the largest",
             LARGEST_END_MOMENT),
            ("the tip force is off by", self.tip_force, "of its size",
             LARGEST_FORCE_DIFFERENCE),
            ("a bound on activation or head is exceeded by", self.bounds, "", SLACK),
            ("an extension bound is exceeded by", self.extension, "", SLACK),
            ("a bound on change is exceeded by", self.change, "", SLACK),
        )  # fmt: skip
        return [
            f"step {int(np.argmax(_nan_high(values))) + 1}: {what} "
            f"{_nan_high(values).max():.3g} {unit}".rstrip()
            + f", {limit:g} is allowed"
            for what, values, unit, limit in checks
            if not np.all(values <= limit)
        ]


def _nan_high(values: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(values), np.inf, values)


@deferred_interrupts()
@one_thread()
def verify(
    motion: Motion,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    near: dict[int, np.ndarray],
) -> Verification:
    """Check planned unknowns x (H, muscles + 2) and shapes (H,) of the first H time steps.

    `near` has the auxiliary solutions that steps of a sequential plan are bound to.
    """
    steps = motion.steps[: len(x)]
    L = motion.trunk.length
    own = [target.Z for step in steps for target in step.targets]
    own += [held.Z for held in motion.held]
    Z = np.unique(np.concatenate([np.linspace(0, L, 101), own]))
    moment = shape.moment(np.array([0.0]))[:, 0]
    path = integrate(motion.trunk, x, loads, moment, Z)
    zeta, _ = intrinsic_strain(motion.trunk, x[:, :-2], Z)
    low, high = motion.extension
    # Moments below a millionth of what bends the trunk to its own length are round-off.
    floor = 1e-6 * stiffness(motion.trunk, 0.0)[1] / L
    largest = np.maximum(np.linalg.norm(path.moment, axis=2).max(axis=1), floor)
    before = np.concatenate([np.zeros((1, x.shape[1])), x[:-1]])
    bounds, change = np.zeros(len(x)), np.zeros(len(x))
    for t, step in enumerate(steps):
        box = allowed(motion, step, near.get(t))
        bounds[t] = _excess(x[t], box.lower, box.upper)
        if t not in near:
            change[t] = _excess(x[t] - before[t], step.change.lower, step.change.upper)
    return Verification(
        path,
        np.linalg.norm(path.position - shape.position(Z), axis=2).max(axis=1),
        np.linalg.norm(path.moment[:, -1], axis=1) / largest,
        _force_difference(motion, loads, path),
        bounds,
        np.maximum(low - zeta, zeta - high).max(axis=1).clip(0),
        change,
    )


def _force_difference(motion: Motion, loads: Sequence[Loads], path: Trajectory) -> np.ndarray:
    """Distance of each tip force from what its step asks for, relative to the larger."""
    difference = np.zeros(len(loads))
    for t, (load, step) in enumerate(zip(loads, motion.steps, strict=False)):
        asked = np.array(step.loads.tip_force)
        if step.pull is not None:
            strength, held = step.pull
            at = int(np.searchsorted(path.Z, held.Z))
            asked = asked + strength * path.directors[held.step, at, held.director]
        size = max(float(np.linalg.norm(asked)), float(np.linalg.norm(load.tip_force)))
        if size > 0:
            difference[t] = np.linalg.norm(asked - np.array(load.tip_force)) / size
    return difference


def _excess(value: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    return float(np.maximum(lower - value, value - upper).max(initial=0.0))


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
    r0, q0 = base_pose(trunk.head, x[:, -2], x[:, -1])
    d0 = [np.stack(np.broadcast_arrays(*row), axis=-1) for row in directors_of(q0)]
    state = np.concatenate([np.stack(r0, axis=-1), *d0, moment], axis=1)
    jumps = sorted({*trunk.edges} | {x.contact_from for x in loads if x.contact_from is not None})
    values = np.full((Z.size, H, 15), np.nan)
    values[Z <= 0] = state
    for start, end in pairwise(jumps):
        inside = (Z > start) & (Z <= end)
        try:
            with np.errstate(all="ignore"):  # a rod that diverges ends as NaN
                result = solve_ivp(
                    _patient(_slope(trunk, activation, loads, (start + end) / 2)),
                    (start, end),
                    state.ravel(),
                    method="DOP853",
                    t_eval=np.union1d(Z[inside], [end]),
                    rtol=TOLERANCE,
                    atol=TOLERANCE,
                )
        except _EndlessError:
            break  # NaN from here on: never called verified
        if not result.success:
            break
        path = result.y.T.reshape(-1, H, 15)
        values[inside] = path[: np.count_nonzero(inside)]
        state = path[-1]
    values = values.swapaxes(0, 1)
    directors = values[..., 3:12].reshape(H, Z.size, 3, 3)
    return Trajectory(Z, values[..., :3], directors, values[..., 12:])


class _EndlessError(Exception):
    """An integration comes to no end, as of a rod that coils in itself."""


def _patient(
    slope: Callable[[float, np.ndarray], np.ndarray],
) -> Callable[[float, np.ndarray], np.ndarray]:
    """A slope that ends an integration after `MOST_SLOPES` calls."""
    calls = itertools.count(1)

    def counted(Z: float, y: np.ndarray) -> np.ndarray:
        if next(calls) > MOST_SLOPES:
            raise _EndlessError
        return slope(Z, y)

    return counted


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


def _slope(
    trunk: Trunk, activation: np.ndarray, loads: Sequence[Loads], middle: float
) -> Callable[[float, np.ndarray], np.ndarray]:
    """Right-hand side of eq. (14) for H rods, on the stretch without jumps around `middle`."""
    L, H = trunk.length, len(loads)
    mean = mean_extension(trunk, strains(trunk, activation))[:, None]
    zeta_hat, u_hat = intrinsic_strain(trunk, activation, np.array([middle]))
    c = u_hat[:, 0] * trunk.taper(middle)
    gravity = np.array([[0.0, 0.0, load.gravity] for load in loads])
    tip = np.array([load.tip_force for load in loads])
    start = np.array([[L if x.contact_from is None else x.contact_from] for x in loads])
    spread = np.where(start < L, L - start, 1.0)
    touching = start <= middle
    log = np.array([load.contact_force for load in loads])
    couple = touching * np.array([load.contact_couple for load in loads]) / spread

    def slope(Z: float, y: np.ndarray) -> np.ndarray:
        rod = y.reshape(H, 15)
        d, m = rod[:, 3:12].reshape(H, 3, 3), rod[:, 12:]
        K = stiffness(trunk, Z)
        share = np.where(touching, (L - Z) / spread, start < L)
        force = tip + gravity * mass_beyond(trunk, Z) + log * share
        n = np.einsum("hij,hj->hi", d, force)
        zeta = zeta_hat * (1 + n[:, 2:] * mean / K[0])
        u = c / trunk.taper(Z) + m * mean**2 / K[1:]
        dm = zeta_hat * _cross(m, u) - np.einsum("hij,hj->hi", d, couple)
        dm[:, :2] += zeta * np.stack([n[:, 1], -n[:, 0]], axis=1)
        darboux = np.einsum("hi,hij->hj", zeta_hat * u, d)
        dd = _cross(darboux[:, None], d)
        return np.concatenate([zeta * d[:, 2], dd.reshape(H, 9), dm], axis=1).ravel()

    return slope


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product along the last axis; np.cross takes longer than all else of the slope."""
    ahead, back = [1, 2, 0], [2, 0, 1]
    return a[..., ahead] * b[..., back] - a[..., back] * b[..., ahead]
