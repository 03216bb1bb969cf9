"""Every answer checked by other means: no CasADi, no collocation, no optimizer.

The rod equations (14), (15) are written out again in `independent_rod` and solved again as a
two-point problem in `two_point`, next to the planned shape. What a plan claims - shape, free tip,
targets, bounds - is recomputed from that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from .._support.blas_threads import one_thread
from ..model.activation import mean_extension, stiffness, strains
from ..model.anatomy import Trunk
from ..model.loads import Loads, internal_force
from ..problem.motion import Motion, allowed
from ..rod.shape import Shape
from .independent_rod import Trajectory, integrate
from .two_point import equilibria

LARGEST_DIFFERENCE = 1e-4 / 1.75  # of L, between planned and independent centerline
LARGEST_TURN = 3e-4  # of a director, ten times that of the shipped motions
LARGEST_FORCE_DIFFERENCE = 1e-3  # of the largest force that pulls, between planned and held pull
LARGEST_MOMENT_DIFFERENCE = 1e-3  # of the largest moment along the trunk; at the free tip as well
PLAUSIBLE_STRETCH = (0.5, 2.0)
"""Of zeta / zeta_hat; at either end the linear law (15) is off by a factor of two from rubber's."""
MOST_TOGETHER = 32  # time steps that are checked together, if they have few targets
MOST_POINTS = 1000  # of targets of steps that are checked together, for memory
MOST_LOST = 32  # steps without an equilibrium nearby; for later ones none is looked for
LOST = 100 * LARGEST_TURN  # of a director; an equilibrium that far is not nearby
MOST_SLOPES = 1000  # of a segment of a rod that is no equilibrium; the shipped motions take 100
SLACK = 1e-6  # by which a bound may be exceeded; Ipopt relaxes bounds by 1e-8 of their size


@dataclass(frozen=True, eq=False)
class Verification:
    """What the independent check found, one entry for each time step.

    Attributes
    ----------
    trajectory : Trajectory
        As integrated, at points that are the same for every step.
    targets : tuple of Trajectory
        As integrated, of each step at its own targets and held points.
    length : float
        Of the trunk, in m.
    position_difference : (H,)
        Largest distance in m between planned and integrated centerline.
    turn : (H,)
        Largest distance between planned and integrated directors, no unit.
    stretch : (H, 2)
        Least and largest zeta / zeta_hat along the trunk: what the loads make of its length.
    moment_difference : (H,)
        Largest distance between planned and integrated moments, as a fraction of the largest.
    end_moment : (H,)
        Moment left at the free tip, as a fraction of the largest along the trunk.
    tip_force : (H,)
        Distance between the planned tip force and what the motion asks for, along held
        directions as integrated, as a fraction of its size.
    bounds, extension, change : (H,)
        Largest excess over the bounds on activations (no unit) and head angles (rad), on
        zeta_hat of any segment, and on the change from the step before.
    """

    trajectory: Trajectory
    targets: tuple[Trajectory, ...]
    length: float
    position_difference: np.ndarray
    turn: np.ndarray
    stretch: np.ndarray
    moment_difference: np.ndarray
    end_moment: np.ndarray
    tip_force: np.ndarray
    bounds: np.ndarray
    extension: np.ndarray
    change: np.ndarray

    def at(self, step: int, Z: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) in m and directors (3, 3) of a step (from 0) at one of its own points."""
        path = self.targets[step]
        i = int(np.searchsorted(path.Z, Z))
        return path.position[0, i], path.directors[0, i]

    @property
    def too_coarse(self) -> bool:
        """Whether planned and integrated shapes differ by more than is allowed."""
        near = np.all(self.position_difference <= self.largest_difference)
        return not (near and np.all(self.turn <= LARGEST_TURN))

    @property
    def largest_difference(self) -> float:
        """Distance in m by which planned and integrated centerline may differ."""
        return LARGEST_DIFFERENCE * self.length

    @property
    def doubts(self) -> list[str]:
        """What holds but hardly means anything, a sentence each."""
        if not len(self.stretch):
            return []
        low, high = PLAUSIBLE_STRETCH
        squeezed, drawn = int(np.argmin(self.stretch[:, 0])), int(np.argmax(self.stretch[:, 1]))
        told = []
        for t, value, word, beyond in (
            (squeezed, self.stretch[squeezed, 0], "compress", 0 < self.stretch[squeezed, 0] < low),
            (drawn, self.stretch[drawn, 1], "stretch", self.stretch[drawn, 1] > high),
        ):
            if beyond:
                told.append(
                    f"step {t + 1}: the loads {word} part of the trunk to {value:.3g} of its "
                    f"length; outside {low:g} to {high:g} the linear elasticity of the model means "
                    "little. Check loads, youngs_modulus and radii"
                )
        return told

    @property
    def faults(self) -> list[str]:
        """What does not hold, a sentence each; empty if all does."""
        checks = (
            ("planned and integrated centerline differ by", self.position_difference, "m",
             self.largest_difference),
            ("planned and integrated directors differ by", self.turn, "", LARGEST_TURN),
            ("planned and integrated moments differ by", self.moment_difference, "of the largest",
             LARGEST_MOMENT_DIFFERENCE),
            ("the moment at the free tip is", self.end_moment, "of the largest",
             LARGEST_MOMENT_DIFFERENCE),
            ("the tip force is off by", self.tip_force, "of its size",
             LARGEST_FORCE_DIFFERENCE),
            ("a bound on activation or head is exceeded by", self.bounds, "", SLACK),
            ("an extension bound is exceeded by", self.extension, "", SLACK),
            ("a bound on change is exceeded by", self.change, "", SLACK),
        )  # fmt: skip
        squeezed = [
            f"step {t + 1}: the loads compress the trunk to {least:.3g} of its length, which must "
            "stay above 0"
            for t, least in enumerate(self.stretch[:, 0].tolist())
            if least <= 0
        ]
        return squeezed[:1] + [
            f"step {int(np.argmax(_nan_high(values))) + 1}: {what} "
            f"{_nan_high(values).max():.3g} {unit}".rstrip()
            + f", {limit:g} is allowed"
            for what, values, unit, limit in checks
            if not np.all(values <= limit)
        ]


def _nan_high(values: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(values), np.inf, values)


@one_thread()
@np.errstate(all="ignore")  # what overflows ends as a fault
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
    steps, before = motion.steps[: len(x)], np.concatenate([np.zeros((1, x.shape[1])), x[:-1]])
    bounds, change = np.zeros(len(x)), np.zeros(len(x))
    for t, step in enumerate(steps):
        box = allowed(motion, step, near.get(t))
        bounds[t] = _excess(x[t], box.lower, box.upper)
        if not (t in near and step.follows):
            change[t] = _excess(x[t] - before[t], step.change.lower, step.change.upper)
    zeta = strains(motion.trunk, x[:, :-2])[..., 0]  # the same all along a segment
    low, high = motion.extension
    rods = _checked_rods(motion, x, loads, shape)
    return Verification(
        rods.path,
        rods.own,
        motion.trunk.length,
        rods.position_difference,
        rods.turn,
        rods.stretch,
        rods.moment_difference,
        rods.end_moment,
        _force_difference(motion, loads, rods.own),
        bounds,
        np.maximum(low - zeta, zeta - high).max(axis=1).clip(0),
        change,
    )


@dataclass(frozen=True, eq=False)
class _Rods:
    """What is found of the rods of some steps; see `Verification`."""

    path: Trajectory
    own: tuple[Trajectory, ...]
    position_difference: np.ndarray
    turn: np.ndarray
    stretch: np.ndarray
    moment_difference: np.ndarray
    end_moment: np.ndarray
    lost: np.ndarray
    """(n,) bool, where no equilibrium is nearby."""


def _checked_rods(motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape) -> _Rods:
    """Check the rods of all steps, some at a time; see `MOST_LOST`."""
    asked, parts, lost = _asked(motion, len(x)), [], 0
    for some in _groups(asked):
        own = asked[some]
        part = _check(motion.trunk, x[some], loads[some], shape[some], own, lost < MOST_LOST)
        lost += int(np.count_nonzero(part.lost))
        parts.append(part)
    paths = [part.path for part in parts]
    whole = [np.concatenate(rows) for rows in zip(*map(_values, paths), strict=True)]
    numbers = [
        np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(_Rods)[2:]
    ]
    every = tuple(path for part in parts for path in part.own)
    return _Rods(Trajectory(paths[0].Z, *whole), every, *numbers)


def _asked(motion: Motion, count: int) -> list[np.ndarray]:
    """Points in m at which each of a motion's first steps has a target or is held."""
    asked = [{target.Z for target in step.targets} for step in motion.steps[:count]]
    for held in motion.held:
        if held.step < count:
            asked[held.step].add(held.Z)
    return [np.array(sorted(points)) for points in asked]


def _groups(asked: list[np.ndarray]) -> Iterator[slice]:
    """Steps that are checked together; at least one group, if an empty one."""
    first, points = 0, 0
    for t, own in enumerate(asked):
        if t > first and (t - first == MOST_TOGETHER or points + own.size > MOST_POINTS):
            yield slice(first, t)
            first, points = t, 0
        points += own.size
    yield slice(first, len(asked))


def _check(
    trunk: Trunk,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    asked: list[np.ndarray],
    search: bool,
) -> _Rods:
    """Check the rods of some steps; `search`: whether to look for equilibria."""
    L, mesh = trunk.length, shape.mesh
    contact = {load.contact_from for load in loads} - {None}
    same = np.unique([*np.linspace(0, L, 101), *trunk.edges, *mesh.edges])
    middles = np.asarray(mesh.edges[:-1]) + mesh.widths / 2
    Z = np.unique(np.concatenate([same, middles, mesh.points.ravel(), [*contact], *asked]))
    path, end_moment, lost = _independent(trunk, x, loads, shape, Z, search)
    # Moments below a millionth of what bends the trunk to its own length are round-off.
    floor = 1e-6 * stiffness(trunk, 0.0)[1] / L
    turn = np.linalg.norm(path.directors - shape.directors(Z), axis=3).max(axis=(1, 2))
    largest = np.maximum(np.linalg.norm(path.moment, axis=2).max(axis=1), floor)
    at_same = np.isin(Z, same)
    return _Rods(
        Trajectory(same, *(values[:, at_same] for values in _values(path))),
        tuple(
            Trajectory(own, *(values[t : t + 1, np.isin(Z, own)] for values in _values(path)))
            for t, own in enumerate(asked)
        ),
        np.linalg.norm(path.position - shape.position(Z), axis=2).max(axis=1),
        turn,
        _stretch(trunk, x, loads, path),
        np.linalg.norm(path.moment - shape.moment(Z), axis=2).max(axis=1) / largest,
        np.linalg.norm(end_moment, axis=1) / largest,
        lost | ~(turn <= LOST),
    )


def _values(path: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return path.position, path.directors, path.moment


def _independent(
    trunk: Trunk,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    Z: np.ndarray,
    search: bool,
) -> tuple[Trajectory, np.ndarray, np.ndarray]:
    """Equilibria next to the planned shapes, moments (H, 3) in N m at planned tips, and the lost.

    Where there is none, or none is looked for, what follows from the planned moment at the base,
    and its end moment.
    """
    if search:
        path = equilibria(trunk, x, loads, shape, Z)
    else:
        parts = ((3,), (3, 3), (3,))
        path = Trajectory(Z, *(np.full((len(x), Z.size, *part), np.nan) for part in parts))
    end_moment = shape.moment(np.array([trunk.length]))[:, 0]
    lost = ~np.isfinite(path.moment).all(axis=(1, 2))
    if np.any(lost):
        moment = shape.moment(np.array([0.0]))[lost, 0]
        own = [load for load, is_lost in zip(loads, lost, strict=True) if is_lost]
        marched = integrate(trunk, x[lost], own, moment, Z, MOST_SLOPES)
        path.position[lost], path.directors[lost] = marched.position, marched.directors
        path.moment[lost], end_moment[lost] = marched.moment, marched.moment[:, -1]
    return path, end_moment, lost


def _stretch(trunk: Trunk, x: np.ndarray, loads: Sequence[Loads], path: Trajectory) -> np.ndarray:
    """Least and largest zeta / zeta_hat (H, 2) along paths."""
    mean = mean_extension(trunk, strains(trunk, x[:, :-2]))[:, None]
    force = np.reshape([internal_force(load, trunk, path.Z) for load in loads], path.position.shape)
    n3 = np.sum(force * path.directors[:, :, 2], axis=2)
    stretch = 1 + n3 * mean / stiffness(trunk, path.Z)[:, 0]
    return np.stack([stretch.min(axis=1), stretch.max(axis=1)], axis=1)


def _force_difference(
    motion: Motion, loads: Sequence[Loads], own: Sequence[Trajectory]
) -> np.ndarray:
    """Distance of each tip force from what its step asks for, relative to the larger."""
    difference = np.zeros(len(loads))
    for t, (load, step) in enumerate(zip(loads, motion.steps, strict=False)):
        asked = np.array(step.loads.tip_force)
        if step.pull is not None:
            strength, held = step.pull
            at = int(np.searchsorted(own[held.step].Z, held.Z))
            asked = asked + strength * own[held.step].directors[0, at, held.director]
        size = max(float(np.linalg.norm(asked)), float(np.linalg.norm(load.tip_force)))
        if size > 0:
            difference[t] = np.linalg.norm(asked - np.array(load.tip_force)) / size
    return difference


def _excess(value: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    return float(np.maximum(lower - value, value - upper).max(initial=0.0))
