"""Simulation: activations, head angles and loads of a plan, played on the trunk with inertia.

A diagonally implicit Runge-Kutta method, each of whose stages is one boundary value problem in Z,
solved by the same collocation as equilibria; see `moving_rod`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.loads import Loads, internal_force
from ..model.quaternions import director_rows
from ..problem.motion import Motion
from ..rod.collocation import Mesh, gauss
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from .course import Instant, Sections, course
from .energy import Energy, energies, powers, velocities
from .moving_rod import CHANGING, G_RATE, GIVEN, STATES, ZETA, ZETA_RATE, G, N, Q
from .stepping import Ends, StageSolver

TIME_STEP = 0.025
"""In s. With it, a trunk that lifts a log is within 0.05 mm of the limit of short steps."""
DAMPING_TIME = 0.06
"""In s, of a trunk's tissue. Nobody has measured that of elephants."""

METHOD = np.array(
    [
        [1 / 4, 0, 0, 0, 0],
        [1 / 2, 1 / 4, 0, 0, 0],
        [17 / 50, -1 / 25, 1 / 4, 0, 0],
        [371 / 1360, -137 / 2720, 15 / 544, 1 / 4, 0],
        [25 / 24, -49 / 48, 125 / 16, -85 / 12, 1 / 4],
    ]
)
"""Of order 4, L-stable (Hairer & Wanner, Solving ODEs II, table IV.6.5). Rows are stages, the last
is the end of the time step. Damping makes the rod stiff, and accelerations jump where phases start,
which reduces the order of positions and energy to 1.6. That of internal moments is reduced to 1, as
vibrations that are too fast for the steps respond to forces out of proportion: moments of the last
stage are 5 to 8 % off for a soft rod and useless for an almost rigid one. Do not report them."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated motion, sampled at the ends of its steps in time, (S + 1,).

    Attributes
    ----------
    times : (S + 1,)
        In s.
    shape : Shape
        Batch (S + 1,). Its moments are rough; see `METHOD`.
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

    states : (E, d + 1, 13); frames : (n, 4); spin w : (n, 3) in 1/m; changing : (n, 11), counted
    from these frames.
    """

    states: np.ndarray
    frames: np.ndarray
    w: np.ndarray
    changing: np.ndarray


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
        for step in range(len(self.x)):
            parts = max(1, math.ceil((knots[step + 1] - knots[step]) / time_step - 1e-9))
            edges = np.linspace(knots[step], knots[step + 1], parts + 1)
            widths = np.diff(edges)
            stages = edges[:-1, None] + widths[:, None] * METHOD.sum(axis=1)
            (begin,) = course(self.motion, self.x, self.loads, step, edges[:1])
            instants = course(self.motion, self.x, self.loads, step, stages.ravel())
            # What jumps: the mass of what joins or leaves, and strains that are not interpolated.
            jump = np.append(np.array(self._energies(state, begin)) - record[-1][2], [0.0, 0.0])
            for k, dt in enumerate(widths.tolist()):
                count = len(METHOD)
                own = instants[k * count : (k + 1) * count]
                state, work = self._advance(state, own, dt)
                record.append(self._recorded(state, own[-1]))
                ledger.append(ledger[-1] + work + (jump if k == 0 else 0.0))
                if advance is not None:
                    advance(own[-1].time)
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
        return _State(states, _frames(states), zeta_hat[:, None] * u, changing)

    def _advance(
        self, state: _State, instants: Sequence[Instant], dt: float
    ) -> tuple[_State, np.ndarray]:
        """The state after a step in time, and works (4,) in J; see `powers`."""
        c = dt * METHOD[0, 0]
        rates: list[np.ndarray] = []
        states, work = state.states, np.zeros(4)
        self.solver.forget()
        for row, instant in zip(METHOD, instants, strict=True):
            known = state.changing + dt * sum(
                (a * k for a, k in zip(row, rates, strict=False)), np.zeros_like(state.changing)
            )
            ends = Ends(
                instant.base,
                instant.acceleration,
                np.array(instant.loads.tip_force),
                instant.tip_mass,
            )
            given = self._given(state, known, c, instant)
            states, changing, bend = self.solver.solve(states, given, ends)
            rates.append((changing - known) / c)
            parts = self.sections, self.mesh, instant, states
            share = dt * METHOD[-1, len(rates) - 1]
            work += share * np.array(powers(*parts, changing, bend, self.tau))
        after = np.zeros_like(changing)  # counted from the new frames
        after[:, ZETA : ZETA_RATE + 1] = changing[:, ZETA : ZETA_RATE + 1]
        after[:, G_RATE] = spin_of(changing) / 2
        return _State(states, _frames(states), bend[:, :3], after), work

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
