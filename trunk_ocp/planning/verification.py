"""Independent check of plans, without CasADi, collocation or an optimizer.

`independent_rod` has a second implementation of the rod equations (14), (15), and `two_point`
solves them as a two-point boundary value problem near the planned shape. Shape, free tip, targets
and bounds of a plan are recomputed from the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from .._support.blas_threads import one_thread
from ..model.activation import mean_extension, stiffness, strains
from ..model.anatomy import Trunk
from ..model.loads import Loads, internal_forces
from ..problem.motion import Motion, allowed
from ..rod.shape import Shape
from .independent_rod import Trajectory, integrate
from .two_point import equilibria

MAX_POSITION_DIFFERENCE = 1e-4 / 1.75  # of L, between planned and integrated centerline
MAX_TURN = 3e-4  # between directors; ten times that of the shipped motions
MAX_FORCE_DIFFERENCE = 1e-3  # of the tip force, between planned and required
MAX_MOMENT_DIFFERENCE = 1e-3  # of the largest moment along the trunk; at the free tip as well
PLAUSIBLE_STRETCH = (0.5, 2.0)
"""Range of zeta / zeta_hat; at its ends the linear law (15) is off from rubber by a factor of 2."""
GROUP_STEPS = 32  # time steps that are checked together at most
GROUP_POINTS = 1000  # target points of steps that are checked together, to limit memory
MAX_LOST = 32  # steps without an equilibrium nearby, after which no more are searched for
LOST_TURN = 100 * MAX_TURN  # between directors, beyond which an equilibrium is not nearby
MAX_SLOPES = 1000  # right-hand sides per segment of a rod out of equilibrium; 100 are usual
BOUND_TOL = 1e-6  # by which a bound may be exceeded; Ipopt relaxes bounds by 1e-8 of their size


@dataclass(frozen=True, eq=False)
class Verification:
    """Results of the independent check, one entry for each time step.

    Attributes
    ----------
    trajectory : Trajectory
        Integrated shapes at the same points for every step.
    targets : tuple of Trajectory
        Integrated shape of each step at its targets and held points.
    length : float
        Length of the trunk in m.
    position_difference : (H,)
        Largest distance in m between planned and integrated centerline.
    turn : (H,)
        Largest distance between planned and integrated directors, no unit.
    stretch : (H, 2)
        Smallest and largest zeta / zeta_hat along the trunk: stretch by the loads.
    moment_difference : (H,)
        Largest distance between planned and integrated moments, as a fraction of the largest.
    end_moment : (H,)
        Moment left at the free tip, as a fraction of the largest along the trunk.
    tip_force : (H,)
        Distance between the planned tip force and that of the motion, with pulls along the
        integrated held directions, as a fraction of its size.
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
        """Position (3,) in m and directors (3, 3) of a step (from 0) at one of its targets."""
        path = self.targets[step]
        i = int(np.searchsorted(path.Z, Z))
        return path.position[0, i], path.directors[0, i]

    @property
    def too_coarse(self) -> bool:
        """Whether planned and integrated shapes differ too much."""
        near = np.all(self.position_difference <= self.max_position_difference)
        return not (near and np.all(self.turn <= MAX_TURN))

    @property
    def max_position_difference(self) -> float:
        """Largest distance in m allowed between planned and integrated centerline."""
        return MAX_POSITION_DIFFERENCE * self.length

    @property
    def doubts(self) -> list[str]:
        """Warnings on results that pass but are hardly meaningful, a sentence each."""
        if not len(self.stretch):
            return []
        low, high = PLAUSIBLE_STRETCH
        squeezed, drawn = int(np.argmin(self.stretch[:, 0])), int(np.argmax(self.stretch[:, 1]))
        warnings = []
        for t, value, word, beyond in (
            (squeezed, self.stretch[squeezed, 0], "compress", 0 < self.stretch[squeezed, 0] < low),
            (drawn, self.stretch[drawn, 1], "stretch", self.stretch[drawn, 1] > high),
        ):
            if beyond:
                warnings.append(
                    f"step {t + 1}: the loads {word} part of the trunk to {value:.3g} of its "
                    f"length; outside {low:g} to {high:g} the linear elasticity of the model is "
                    "inaccurate. Check loads, youngs_modulus and radii"
                )
        return warnings

    @property
    def faults(self) -> list[str]:
        """Checks that failed, a sentence each."""
        checks = (
            ("planned and integrated centerline differ by", self.position_difference, "m",
             self.max_position_difference),
            ("planned and integrated directors differ by", self.turn, "", MAX_TURN),
            ("planned and integrated moments differ by", self.moment_difference, "of the largest",
             MAX_MOMENT_DIFFERENCE),
            ("the moment at the free tip is", self.end_moment, "of the largest",
             MAX_MOMENT_DIFFERENCE),
            ("the tip force is off by", self.tip_force, "of its size",
             MAX_FORCE_DIFFERENCE),
            ("a bound on activation or head is exceeded by", self.bounds, "", BOUND_TOL),
            ("an extension bound is exceeded by", self.extension, "", BOUND_TOL),
            ("a bound on change is exceeded by", self.change, "", BOUND_TOL),
        )  # fmt: skip
        squeezed = [
            f"step {t + 1}: the loads compress the trunk to {least:.3g} of its length; expected "
            "more than 0"
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
@np.errstate(all="ignore")  # overflow ends as a fault
def verify(
    motion: Motion,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    auxiliary: dict[int, np.ndarray],
) -> Verification:
    """Check planned controls x (H, muscles + 2) and shapes (H,) of the first H time steps.

    `auxiliary` has the auxiliary solutions of a sequential plan, as in `Plan`.
    """
    steps, before = motion.steps[: len(x)], np.concatenate([motion.start[None], x[:-1]])
    bounds, change = np.zeros(len(x)), np.zeros(len(x))
    for t, step in enumerate(steps):
        box = allowed(motion, step, auxiliary.get(t))
        bounds[t] = _excess(x[t], box.lower, box.upper)
        if not (t in auxiliary and step.follows):
            change[t] = _excess(x[t] - before[t], step.change.lower, step.change.upper)
    zeta = strains(motion.trunk, x[:, :-2])[..., 0]  # the same all along a segment
    low, high = motion.extension
    rods = _checked_rods(motion, x, loads, shape)
    return Verification(
        rods.path,
        rods.targets,
        motion.trunk.length,
        rods.position_difference,
        rods.turn,
        rods.stretch,
        rods.moment_difference,
        rods.end_moment,
        _force_difference(motion, loads, rods.targets),
        bounds,
        np.maximum(low - zeta, zeta - high).max(axis=1).clip(0),
        change,
    )


@dataclass(frozen=True, eq=False)
class _Rods:
    """Results for the rods of some steps; see `Verification`."""

    path: Trajectory
    targets: tuple[Trajectory, ...]
    position_difference: np.ndarray
    turn: np.ndarray
    stretch: np.ndarray
    moment_difference: np.ndarray
    end_moment: np.ndarray
    lost: np.ndarray
    """(n,) bool; rods without an equilibrium nearby."""


def _checked_rods(motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape) -> _Rods:
    """Check the rods of all steps in groups."""
    points, parts, lost = _target_points(motion, len(x)), [], 0
    for group in _groups(points):
        search = lost < MAX_LOST
        part = _check(motion.trunk, x[group], loads[group], shape[group], points[group], search)
        lost += int(np.count_nonzero(part.lost))
        parts.append(part)
    paths = [part.path for part in parts]
    values = [np.concatenate(rows) for rows in zip(*map(_values, paths), strict=True)]
    numbers = [
        np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(_Rods)[2:]
    ]
    targets = tuple(path for part in parts for path in part.targets)
    return _Rods(Trajectory(paths[0].Z, *values), targets, *numbers)


def _target_points(motion: Motion, count: int) -> list[np.ndarray]:
    """Points in m at which each of a motion's first steps has a target or is held."""
    points = [{target.Z for target in step.targets} for step in motion.steps[:count]]
    for held in motion.held:
        if held.step < count:
            points[held.step].add(held.Z)
    return [np.array(sorted(Z)) for Z in points]


def _groups(points: list[np.ndarray]) -> Iterator[slice]:
    """Steps that are checked together; at least one group, which may be empty."""
    first, count = 0, 0
    for t, Z in enumerate(points):
        if t > first and (t - first == GROUP_STEPS or count + Z.size > GROUP_POINTS):
            yield slice(first, t)
            first, count = t, 0
        count += Z.size
    yield slice(first, len(points))


def _check(
    trunk: Trunk,
    x: np.ndarray,
    loads: Sequence[Loads],
    shape: Shape,
    points: list[np.ndarray],
    search: bool,
) -> _Rods:
    """Check the rods of some steps; `search` says whether to search for equilibria."""
    L, mesh = trunk.length, shape.mesh
    contact = {load.contact_from for load in loads} - {None}
    common = np.unique([*np.linspace(0, L, 101), *trunk.edges, *mesh.edges])
    middles = np.asarray(mesh.edges[:-1]) + mesh.widths / 2
    Z = np.unique(np.concatenate([common, middles, mesh.points.ravel(), [*contact], *points]))
    path, end_moment, lost = _independent(trunk, x, loads, shape, Z, search)
    # Moments below a millionth of what bends the trunk to its own length are round-off.
    floor = 1e-6 * stiffness(trunk, 0.0)[1] / L
    directors, moment = shape.frames(Z)
    turn = np.linalg.norm(path.directors - directors, axis=3).max(axis=(1, 2))
    largest = np.maximum(np.linalg.norm(path.moment, axis=2).max(axis=1), floor)
    at_common = np.searchsorted(Z, common)
    return _Rods(
        Trajectory(common, *(values[:, at_common] for values in _values(path))),
        tuple(
            Trajectory(
                own, *(values[t : t + 1, np.searchsorted(Z, own)] for values in _values(path))
            )
            for t, own in enumerate(points)
        ),
        np.linalg.norm(path.position - shape.position(Z), axis=2).max(axis=1),
        turn,
        _stretch(trunk, x, loads, path),
        np.linalg.norm(path.moment - moment, axis=2).max(axis=1) / largest,
        np.linalg.norm(end_moment, axis=1) / largest,
        lost | ~(turn <= LOST_TURN),
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
    """Equilibria near planned shapes, moments (H, 3) in N m at their tips, and lost rods (H,).

    A rod is lost if it has no equilibrium nearby or none is searched for. It is then integrated
    from the planned moment at the base.
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
        lost_loads = [load for load, is_lost in zip(loads, lost, strict=True) if is_lost]
        marched = integrate(trunk, x[lost], lost_loads, moment, Z, MAX_SLOPES)
        path.position[lost], path.directors[lost] = marched.position, marched.directors
        path.moment[lost], end_moment[lost] = marched.moment, marched.moment[:, -1]
    return path, end_moment, lost


def _stretch(trunk: Trunk, x: np.ndarray, loads: Sequence[Loads], path: Trajectory) -> np.ndarray:
    """Smallest and largest zeta / zeta_hat (H, 2) along paths."""
    mean = mean_extension(trunk, strains(trunk, x[:, :-2]))[:, None]
    n3 = np.sum(internal_forces(loads, trunk, path.Z) * path.directors[:, :, 2], axis=2)
    stretch = 1 + n3 * mean / stiffness(trunk, path.Z)[:, 0]
    return np.stack([stretch.min(axis=1), stretch.max(axis=1)], axis=1)


def _force_difference(
    motion: Motion, loads: Sequence[Loads], targets: Sequence[Trajectory]
) -> np.ndarray:
    """Distance of each tip force from that of the motion, relative to the larger."""
    difference = np.zeros(len(loads))
    for t, (load, step) in enumerate(zip(loads, motion.steps, strict=False)):
        required = np.array(step.loads.tip_force)
        if step.pull is not None:
            strength, held = step.pull
            at = int(np.searchsorted(targets[held.step].Z, held.Z))
            required = required + strength * targets[held.step].directors[0, at, held.director]
        size = max(float(np.linalg.norm(required)), float(np.linalg.norm(load.tip_force)))
        if size > 0:
            difference[t] = np.linalg.norm(required - np.array(load.tip_force)) / size
    return difference


def _excess(value: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    return float(np.maximum(lower - value, value - upper).max(initial=0.0))
