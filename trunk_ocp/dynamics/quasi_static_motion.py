"""Accelerations of a quasi-static motion, at instants.

The trunk is in equilibrium at every time t. With controls and loads p(t) its states x(t) solve
D x = h rates(x, p(t)), which is differentiated in time along the motion: once for the rates of the
states, and twice for what the accelerations need. Both are linear problems with the same matrix as
Newton's method. Derivatives of what is given, p(t), are one-sided differences, because an
interpolation is smooth on the way to a time step only, not across it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..model.head import base_pose
from ..model.loads import Loads
from ..model.quaternions import director_rows
from ..problem.interpolation import interpolate_all, loads_before
from ..problem.motion import Motion
from ..rod.buckling import integral_matrix
from ..rod.collocation import Mesh, gauss
from ..rod.condensed import condense
from ..rod.equations import ORIENTATION, POSITION, STATES, rates
from ..rod.newton import rates_and_slope
from ..rod.rod_batch import RodBatch, evaluate
from ..rod.shape import Shape
from ..rod.statics import solve_statics

DIFFERENCE = 1e-5
"""Step of differences in time, as a share of a time step: truncation and round-off are 1e-4."""
PER_STEP = 3
"""Instants on the way to a time step: its start, its middle and its end. Interpolations accelerate
most at an end; with 33 instants the shipped motions have the same largest values to 0.1 %."""

LOAD_ROUND_OFF = 1e-13


@dataclass(frozen=True, eq=False)
class Instants:
    """B instants of a motion and the trunk's accelerations there.

    Attributes
    ----------
    step : (B,) int
        Time step (from 0) that the motion is on the way to.
    time : (B,)
        In s.
    loads : tuple of Loads
    shape : Shape
        Batch (B,).
    acceleration : (B, n + 1, 3)
        Of the centerline in m/s^2, at the n Gauss points of the mesh and at the tip.
    d2_acceleration : (B, n, 3)
        Second derivative in time of d_2 at the Gauss points, in 1/s^2.
    """

    step: np.ndarray
    time: np.ndarray
    loads: tuple[Loads, ...]
    shape: Shape
    acceleration: np.ndarray
    d2_acceleration: np.ndarray


def instants_of(
    motion: Motion, x: np.ndarray, loads: Sequence[Loads], shape: Shape, steps: Sequence[int]
) -> Instants:
    """The motion at `PER_STEP` instants on the way to each of some time steps (from 0).

    x : (H, muscles + 2), loads and shape (H,) as in a plan.

    Raises
    ------
    StaticsError
        If the trunk has no equilibrium at one of them.
    """
    knots = np.append(0.0, motion.times[: len(x)])
    step = np.repeat(steps, PER_STEP)
    share = np.tile(np.linspace(0.0, 1.0, PER_STEP), len(steps))
    duration = knots[step + 1] - knots[step]
    time = np.where(share < 1, knots[step] + share * duration, knots[step + 1])
    e = DIFFERENCE * duration * np.where(share < 1, 1.0, -1.0)  # into the time step
    rods = _rods(motion, x, loads, shape.mesh, step, np.stack([time, time + e, time + 2 * e]))
    found = _equilibria(motion, loads, shape, rods[0], step, share)
    return Instants(step, time, tuple(rods[0].loads), found, *_accelerations(rods, found, e))


def _equilibria(
    motion: Motion,
    planned: Sequence[Loads],
    shape: Shape,
    rods: RodBatch,
    step: np.ndarray,
    share: np.ndarray,
) -> Shape:
    """Shapes (B,) on the way to time steps (B,), at shares (B,) of the way.

    Those at time steps are planned ones, unless loads have jumped. Others are between their
    neighbors, which is where Newton's method starts.
    """
    before = np.maximum(step - 1, 0)
    same = [_same(load, planned[i]) for load, i in zip(rods.loads, before.tolist(), strict=True)]
    at_start = (share == 0) & (step > 0) & np.array(same)
    known = at_start | (share == 1)
    at = np.where(at_start, before, step)
    states = shape.states[at]
    new = np.flatnonzero(~known)
    if not new.size:
        return rods.shape(states, (len(step),))
    part = share[new].reshape(-1, 1, 1, 1)
    guess = (1 - part) * shape.states[before[new]] + part * shape.states[step[new]]
    near = replace(shape[at[new]], states=guess)
    each = [rods.loads[i] for i in new.tolist()]
    found = solve_statics(motion.trunk, rods.activation[new], rods.head[new], each, near=near)
    states[new] = found.states
    return rods.shape(states, (len(step),))


def _same(a: Loads, b: Loads) -> bool:
    """Whether two loads on one trunk have the same equilibria."""
    if any(a.contact_force + a.contact_couple + b.contact_force + b.contact_couple):
        contact = a.contact_from, a.contact_lever
        if contact != (b.contact_from, b.contact_lever):
            return False
    return a.gravity == b.gravity and all(
        np.abs(np.subtract(x, y)).max() <= LOAD_ROUND_OFF * np.abs(y).max()
        for x, y in (
            (a.tip_force, b.tip_force),
            (a.contact_force, b.contact_force),
            (a.contact_couple, b.contact_couple),
        )
    )


def _rods(
    motion: Motion,
    x: np.ndarray,
    loads: Sequence[Loads],
    mesh: Mesh,
    step: np.ndarray,
    times: np.ndarray,
) -> list[RodBatch]:
    """Rods on the way to time steps (B,), at times (3, B): three batches of B."""
    controls = interpolate_all(motion, np.vstack([motion.start, x]), times.ravel())
    controls = controls.reshape(*times.shape, -1)
    steps = np.broadcast_to(step, times.shape)
    each = loads_before(motion, loads, steps.ravel() + 1, times.ravel())
    return [
        RodBatch(
            motion.trunk,
            mesh,
            controls[k, :, :-2],
            controls[k, :, -2:],
            each[k * step.size : (k + 1) * step.size],
        )
        for k in range(len(times))
    ]


def _accelerations(
    rods: Sequence[RodBatch], shape: Shape, e: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations (B, n + 1, 3) and second derivatives of d_2 (B, n, 3); see `Instants`.

    rods : at the instants of the shapes (B,), and by e and 2 e (B,) in s later.
    """
    now, soon, later = (rod.arguments for rod in rods)
    mesh, trunk, hung, x = shape.mesh, shape.trunk, rods[0].hung, shape.states
    rate, columns = evaluate(rates_and_slope(hung), x[..., 1:, :], *now)
    slope = columns.reshape(*columns.shape[:3], STATES, STATES)
    poses = [base_pose(trunk.head, rod.head[:, 0], rod.head[:, 1]) for rod in rods]
    r0, q0 = ([np.stack(pose[k], axis=-1) for pose in poses] for k in (0, 1))

    def rates_of(states: np.ndarray, arguments: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        return evaluate(rates(hung), states[..., 1:, :], *arguments)[0]

    def changes(forcing: np.ndarray, base: np.ndarray) -> np.ndarray:
        """Changes of the states, (B, E, d + 1, 7), where those of q at the base are (B, 4)."""
        widths = mesh.widths[:, None, None, None]
        elements = condense(mesh, slope, widths * forcing[..., :STATES, None])
        gaps = np.zeros_like(elements.offsets)
        gaps[:, 0] = elements.maps[:, 0, :, ORIENTATION] @ base[..., None]
        edges = elements.at_edges(trunk, mesh, gaps)[:, :-1]
        edges[:, 0, ORIENTATION, 0] = base
        return np.concatenate([edges[:, :, None], elements.at_points(edges)], axis=2)[..., 0]

    by = _column(e, x)
    first = changes((rates_of(x, soon) - rate) / by, (q0[1] - q0[0]) / e[:, None])
    straight = rate, rates_of(x + by * first, soon), rates_of(x + 2 * by * first, later)
    second = changes(_second(straight, e), _second(q0, e))
    path = x, x + by * first + by**2 / 2 * second, x + 2 * by * first + 2 * by**2 * second
    along = rate, rates_of(path[1], soon), rates_of(path[2], later)

    stretch = _second([each[..., POSITION] for each in along], e).reshape(len(e), -1, 3)
    ends = (mesh.widths[:, None] * gauss(mesh.degree).quadrature).ravel()
    inner = np.vstack([integral_matrix(mesh), ends]) @ stretch
    turned = _second([director_rows(at[..., 1:, ORIENTATION])[..., 1, :] for at in path], e)
    return _second(r0, e)[:, None] + inner, turned.reshape(len(e), -1, 3)


def _column(e: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Numbers (B,) as factors of values (B, ...)."""
    return e.reshape(-1, *(1,) * (values.ndim - 1))


def _second(values: Sequence[np.ndarray], e: np.ndarray) -> np.ndarray:
    """Second derivative at the first of three times that are e (B,) apart; of first order."""
    return (values[0] - 2 * values[1] + values[2]) / _column(e, values[0]) ** 2
