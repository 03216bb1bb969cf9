"""Simulation: activations, head angles and loads of a plan, played on the trunk with inertia.

In time by backward differences of order 2 (BDF2), which start anew, with an implicit Euler step,
at each time step of the plan, as accelerations jump there. Each step is one boundary value problem
in Z, solved by the same collocation as equilibria; see `moving_rod`.
Runge-Kutta methods of implicit stages (Alexander 1977; Hairer & Wanner, Solving ODEs II, table
IV.6.5) were tried: positions are as good for the same work, but stages respond out of proportion
where the rod is too stiff for the steps, so that their moments are wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.loads import Loads, internal_force
from ..model.quaternions import director_rows, product
from ..problem.motion import Motion
from ..rod.collocation import Mesh, gauss
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from .course import Instant, Sections, course
from .energy import Energy, energies, powers, velocities
from .moving_rod import CHANGING, G_RATE, G_SLOPE, GIVEN, STATES, ZETA, ZETA_RATE, G, N, Q
from .stepping import Ends, StageSolver

TIME_STEP = 0.01
"""In s. With it, a trunk that lifts a log is within 1.5 mm of the limit of short steps."""
DAMPING_TIME = 0.06
"""In s, of a trunk's tissue. Nobody has measured that of elephants."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated motion, sampled at the ends of its steps in time, (S + 1,).

    Attributes
    ----------
    times : (S + 1,)
        In s.
    shape : Shape
        Batch (S + 1,).
    velocity : (S + 1, n + 1, 3)
        Of the centerline at the n Gauss points and the tip, in m/s.
    energy : Energy
    """

    times: np.ndarray
    shape: Shape
    velocity: np.ndarray
    energy: Energy


@dataclass(eq=False)
class _State:
    """The trunk at one instant.

    states : (E, d + 1, 13); frames : (n, 4); spin w and its rate : (n, 3) in 1/m and
    1/(m s); changing : (n, 11), counted
    from these frames; power : (4,) in W, see `powers`.
    """

    states: np.ndarray
    frames: np.ndarray
    w: np.ndarray
    w_rate: np.ndarray
    changing: np.ndarray
    power: np.ndarray


def simulate_controls(
    motion: Motion,
    x: np.ndarray,
    loads: Sequence[Loads],
    mesh: Mesh,
    time_step: float = TIME_STEP,
    damping_time: float = DAMPING_TIME,
    advance: Callable[[float], None] | None = None,
) -> Simulation:
    """Play controls x (H, muscles + 2) and loads of time steps on the trunk with inertia.

    It starts at rest, in equilibrium. Each way to a time step is divided evenly, into parts of at
    most `time_step` in s. `damping_time` is tau in s; `advance` is told the time that is reached.

    Raises
    ------
    InputError
        For a trunk without mass, and if there are no time steps.
    StaticsError
        If there is no equilibrium to start from, or no motion is found.
    """
    if not len(x):
        raise InputError(f"{motion.name}: no time steps were planned; nothing to simulate.")
    if motion.trunk.density == 0:
        raise InputError(f"{motion.trunk.name}: inertia needs the density of the trunk; it is 0.")
    return _Player(motion, x, loads, mesh, damping_time).play(time_step, advance)


class _Player:
    """Plays a motion and records it."""

    def __init__(
        self,
        motion: Motion,
        x: np.ndarray,
        loads: Sequence[Loads],
        mesh: Mesh,
        tau: float,
    ) -> None:
        self.motion, self.x, self.loads, self.mesh, self.tau = motion, x, loads, mesh, tau
        self.sections = Sections.of(motion.trunk, mesh)
        self.solver = StageSolver(motion.trunk, mesh)

    def play(self, time_step: float, advance: Callable[[float], None] | None) -> Simulation:
        """Play all of it, in steps of at most `time_step` in s."""
        knots = np.append(0.0, self.motion.times[: len(self.x)])
        state = self._start()
        (first,) = course(self.motion, self.x, self.loads, 0, np.zeros(1))
        record = [self._recorded(state, first)]
        ledger = [np.zeros(4)]
        before = state
        for step in range(len(self.x)):
            parts = max(1, math.ceil((knots[step + 1] - knots[step]) / time_step - 1e-9))
            edges = np.linspace(knots[step], knots[step + 1], parts + 1)
            begin, *instants = course(self.motion, self.x, self.loads, step, edges)
            # What jumps: the mass of what joins or leaves, and strains that are not interpolated.
            jump = np.append(np.array(self._energies(state, begin)) - record[-1][2], [0.0, 0.0])
            state = self._with_power(state, begin, np.hstack([state.w, state.w_rate]))
            dt, ratio = (
                float(edges[1] - edges[0]),
                0.0,
            )  # accelerations jump, so what was is no guide
            for instant in instants:
                after = self._advance(before, state, instant, dt, ratio)
                ledger.append(ledger[-1] + jump + dt / 2 * (state.power + after.power))
                before, state, ratio, jump = state, after, 1.0, np.zeros(4)
                record.append(self._recorded(state, instant))
                if advance is not None:
                    advance(instant.time)
        return self._result(record, np.array(ledger))

    def _start(self) -> _State:
        motion, mesh = self.motion, self.mesh
        load = Loads(motion.gravity)
        shape = solve_statics(motion.trunk, motion.start[:-2], motion.start[-2:], load, mesh)
        E, d = mesh.elements, mesh.degree
        Z = np.hstack([np.asarray(mesh.edges[:-1])[:, None], mesh.points])
        states = np.zeros((E, d + 1, STATES))
        states[..., :7] = shape.states
        states[..., N] = internal_force(load, motion.trunk, Z.ravel()).reshape(E, d + 1, 3)
        zeta, u = shape.strain(mesh.points.ravel())
        zeta_hat, _, _ = self.sections.material(shape.intrinsic)
        changing = np.zeros((E * d, CHANGING))
        changing[:, ZETA] = zeta
        w = zeta_hat[:, None] * u
        return _State(states, _frames(states), w, 0 * w, changing, np.zeros(4))

    def _advance(
        self, before: _State, state: _State, instant: Instant, dt: float, ratio: float
    ) -> _State:
        """The state after a step in time, `ratio` times as long as the one before.

        With a ratio of 0 it is the implicit Euler method, which forgets the one before.
        """
        share = 1 / (1 + 2 * ratio)
        past = _counted_from(state, before)
        known = share * ((1 + ratio) ** 2 * state.changing - ratio**2 * past)
        c = dt * (1 + ratio) * share
        tip = np.array(instant.loads.tip_force)
        ends = Ends(instant.base, instant.acceleration, tip, instant.tip_mass)
        given = self._given(state, known, c, instant)
        self.solver.forget()
        states, changing, bend = self.solver.solve(state.states, given, ends)
        after = np.zeros_like(changing)  # counted from the new frames
        after[:, ZETA : ZETA_RATE + 1] = changing[:, ZETA : ZETA_RATE + 1]
        after[:, G_RATE] = spin_of(changing) / 2
        found = _State(states, _frames(states), bend[:, :3], bend[:, 3:], after, np.zeros(4))
        return self._with_power(found, instant, bend)

    def _with_power(self, state: _State, instant: Instant, bend: np.ndarray) -> _State:
        parts = self.sections, self.mesh, instant, state.states, state.changing, bend
        return replace(state, power=np.array(powers(*parts, self.tau)))

    def _given(self, state: _State, known: np.ndarray, c: float, instant: Instant) -> np.ndarray:
        """Numbers (p, n) of `moving_rod.GIVEN`."""
        sections, n = self.sections, len(state.frames)
        zeta_hat, u_hat, mean = sections.material(instant.strain)
        _, _, mean_rate = sections.material(instant.strain_rate)
        weight, contact, couple, mass = sections.density(instant)
        values: dict[str, Any] = {
            "q_n": state.frames,
            "w_n": state.w,
            "known": known,
            "c": c,
            "tau": self.tau,
            "zeta_hat": zeta_hat[:, None],
            "u_hat": u_hat,
            "mean": mean,
            "mean_rate": mean_rate,
            "K": sections.K,
            "mu": sections.mu[:, None],
            "J": sections.J,
            "force": weight,
            "couple": couple,
            "hung_mu": mass[:, None],
            "lever": instant.loads.contact_lever,
            "hung_force": contact,
        }
        return np.concatenate(
            [np.broadcast_to(values[name], (n, count)) for name, count in GIVEN.items()], axis=1
        ).T

    def _energies(self, state: _State, instant: Instant) -> tuple[float, float]:
        return energies(self.sections, self.mesh, instant, state.states, state.changing, state.w)

    def _recorded(self, state: _State, instant: Instant) -> tuple[_State, Instant, np.ndarray]:
        return state, instant, np.array(self._energies(state, instant))

    def _result(
        self, record: list[tuple[_State, Instant, np.ndarray]], ledger: np.ndarray
    ) -> Simulation:
        trunk, mesh = self.motion.trunk, self.mesh
        states = np.stack([state.states for state, _, _ in record])
        zeta = np.stack([state.changing[:, ZETA] for state, _, _ in record])
        d3 = director_rows(states[..., 1:, Q])[..., 2, :]
        slopes = zeta.reshape(*d3.shape[:-1], 1) * d3
        base = np.stack([instant.position for _, instant, _ in record])
        steps = np.einsum("d,tkdc->tkc", gauss(mesh.degree).quadrature, slopes)
        edges = np.concatenate([base[:, None], mesh.widths[:, None] * steps], axis=1).cumsum(axis=1)
        intrinsic = np.stack([instant.strain for _, instant, _ in record])
        shape = Shape(trunk, mesh, intrinsic, states[..., :7], edges, slopes)
        velocity = np.stack(
            [velocities(self.sections, mesh, at, s.states, s.changing)[0] for s, at, _ in record]
        )
        times = np.array([instant.time for _, instant, _ in record])
        stored = np.stack([energy for _, _, energy in record])
        return Simulation(times, shape, velocity, Energy(*stored.T, *ledger.T))


def _frames(states: np.ndarray) -> np.ndarray:
    """Unit quaternions (n, 4) at the Gauss points."""
    q = states[:, 1:, Q].reshape(-1, 4)
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def spin_of(changing: np.ndarray) -> np.ndarray:
    """Angular velocity (n, 3) in the directors, in rad/s."""
    g, rate = changing[:, G], changing[:, G_RATE]
    scale = 2 / (1 + np.sum(g * g, axis=1, keepdims=True))
    return np.asarray(scale * (rate - np.cross(g, rate)))


def _counted_from(state: _State, before: _State) -> np.ndarray:
    """What changed (n, 11) at the time of `before`, counted from the frames of `state`."""
    start, q = state.frames, before.frames
    turn = product((start[:, 0], *(-start[:, 1:].T)), tuple(q.T))
    g = np.stack(turn[1:], axis=1) / turn[0][:, None]
    scale = 2 / (1 + np.sum(g * g, axis=1, keepdims=True))
    along = np.cross(state.w, g)  # P^T w_n = w_n + scale (w_n x g + (w_n x g) x g)
    along = state.w + scale * (along + np.cross(along, g))
    past = before.changing.copy()
    past[:, G], past[:, G_RATE] = g, _rate_of(spin_of(before.changing), g)
    past[:, G_SLOPE] = _rate_of(before.w - along, g)
    return past


def _rate_of(spin: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Rate of a Gibbs vector g with which the spin is S (rate - g x rate)."""
    along = np.sum(g * spin, axis=1, keepdims=True)
    return np.asarray((spin + np.cross(g, spin) + along * g) / 2)
