"""How wrong quasi-statics is: inertia of a quasi-static motion, compared with weight.

Every plan is a sequence of equilibria, which its interpolation joins. Moving along it, a section of
mass rho A dZ needs the force rho A r'' dZ, which no equilibrium has. Its moment about the base,
that of what the trunk carries included, is compared with the moment of the weight of the same
masses:

    ratio = |int (r - r_0) x r'' dm| / |int (r - r_0) x g dm|.

Phases without interpolation, and loads that jump, move the trunk at once: that is not counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, TrunkError
from ..model.loads import Loads
from ..problem.motion import Motion, Step
from ..rod.collocation import gauss
from ..rod.flutter import FREQUENCIES, natural_frequencies
from ..rod.shape import Shape
from .quasi_static_motion import Instants, instants_of

LEAST_LEVER = 0.1
"""Of the distance of the masses from the base: what counts at least as the lever of their weight.
Under a trunk that hangs straight down it has none, and any inertia would be infinitely more."""


@dataclass(frozen=True, eq=False)
class Inertia:
    """What inertia would do on the way to each time step, (H,), and the trunk's vibrations there.

    NaN where the motion has no interpolation, or the trunk no equilibrium on the way.

    Attributes
    ----------
    ratio : (H,)
        Largest moment of inertia forces about the base over that of the weight of the same masses;
        no unit.
    time : (H,)
        When, in s.
    acceleration : (H,)
        Largest acceleration of any point of the centerline, in m/s^2.
    frequencies : (H, 3)
        Lowest natural frequencies in Hz of the shape at each step, with what it carries.
    """

    ratio: np.ndarray
    time: np.ndarray
    acceleration: np.ndarray
    frequencies: np.ndarray

    @property
    def worst(self) -> int | None:
        """Time step (from 0) with the largest ratio; None if none is known."""
        known = np.flatnonzero(~np.isnan(self.ratio))
        return int(known[np.argmax(self.ratio[known])]) if known.size else None

    @property
    def largest(self) -> float:
        """Largest ratio over the motion; NaN if none is known."""
        return float("nan") if self.worst is None else float(self.ratio[self.worst])

    @property
    def natural_frequencies(self) -> np.ndarray:
        """Frequencies (3,) of the slackest step, whose lowest is the lowest of all; or NaN."""
        known = np.flatnonzero(~np.isnan(self.frequencies[:, 0]))
        if not known.size:
            return np.full(FREQUENCIES, np.nan)
        return np.asarray(self.frequencies[known[np.argmin(self.frequencies[known, 0])]])


@np.errstate(all="ignore")  # without gravity, or without mass, there is no ratio
def inertia_of(motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape) -> Inertia:
    """Inertia of planned controls x (H, muscles + 2), loads and shapes (H,)."""
    ratio, time, acceleration = (np.full(len(x), np.nan) for _ in range(3))
    moving = [
        t for t in range(len(x)) if motion.phases[motion.steps[t].phase].interpolation != "none"
    ]
    for found in _instants(motion, x, loads, shape, moving):
        moments, weights = _moments(motion, found)
        sizes = np.linalg.norm(found.acceleration, axis=2).max(axis=1)
        for t in np.unique(found.step).tolist():
            here = np.flatnonzero(found.step == t)
            values = moments[here] / weights[here]
            at = int(np.argmax(values))
            ratio[t], time[t] = values[at], found.time[here[at]]
            acceleration[t] = sizes[here].max()
    ratio[~np.isfinite(ratio)] = np.nan
    return Inertia(ratio, time, acceleration, _frequencies(motion, x, loads, shape))


def _frequencies(motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape) -> np.ndarray:
    """Natural frequencies (H, 3) in Hz at the time steps; NaN for a trunk without mass."""
    found = np.full((len(x), FREQUENCIES), np.nan)
    if motion.trunk.density > 0:
        for t, (step, load) in enumerate(zip(motion.steps, loads, strict=False)):
            masses = carried_masses(motion, step)
            with suppress(InputError):  # numbers that are not finite
                found[t] = natural_frequencies(shape[t], x[t, :-2], load, *masses)
    return found


def _instants(
    motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape, steps: Sequence[int]
) -> list[Instants]:
    """Instants on the way to some time steps, without those that have no equilibrium somewhere."""
    if not len(steps):
        return []
    try:
        return [instants_of(motion, x, loads, shape, steps)]
    except TrunkError:  # no equilibrium, or numbers that are not finite
        if len(steps) == 1:
            return []
        return [found for t in steps for found in _instants(motion, x, loads, shape, [t])]


def carried_masses(motion: Motion, step: Step) -> tuple[float, float]:
    """Mass in kg that a step has in contact with the trunk, a log; and at its tip.

    From the start of the phase that carries it: what the trunk holds moves with it, also while
    something else still bears its weight.
    """
    carries = step.log is not None and step.log.contact_from is not None
    contact = step.log.mass if carries and step.log is not None else None
    return contact or 0.0, motion.spec.phases[step.phase].loads.tip_mass


def _moments(motion: Motion, at: Instants) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (B,) in N m of the moments of inertia and of weight about the base."""
    trunk, mesh = motion.trunk, at.shape.mesh
    Z = mesh.points.ravel()
    widths = (mesh.widths[:, None] * gauss(mesh.degree).quadrature).ravel()
    own = np.append(trunk.density * np.pi * trunk.radius(Z) ** 2 * widths, 0.0)
    lever = at.shape.position(np.append(Z, trunk.length)) - at.shape.edges[:, :1]
    masses = np.tile(own, (len(at.step), 1))
    d2 = at.shape.at_points()[0][..., 1, :]
    hung, arm, accelerated = np.zeros_like(masses), lever.copy(), at.acceleration.copy()
    for i, (t, load) in enumerate(zip(at.step.tolist(), at.loads, strict=True)):
        contact, masses[i, -1] = carried_masses(motion, motion.steps[t])
        if load.contact_from is not None:
            share = widths * (Z > load.contact_from) / (trunk.length - load.contact_from)
            hung[i, :-1] = contact * share
            arm[i, :-1] += load.contact_lever * d2[i]
            accelerated[i, :-1] += load.contact_lever * at.d2_acceleration[i]
    down = np.array([load.gravity for load in at.loads])[:, None, None] * np.array([0.0, 0.0, 1.0])

    def moment(own: np.ndarray, carried: np.ndarray) -> np.ndarray:
        parts = masses[..., None] * np.cross(lever, own) + hung[..., None] * np.cross(arm, carried)
        return np.linalg.norm(parts.sum(axis=1), axis=1)

    distance = (masses * np.linalg.norm(lever, axis=2)).sum(axis=1)
    distance += (hung * np.linalg.norm(arm, axis=2)).sum(axis=1)
    least = LEAST_LEVER * distance * np.linalg.norm(down[:, 0], axis=1)
    return moment(at.acceleration, accelerated), np.maximum(moment(down, down), least)
