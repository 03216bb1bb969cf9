"""Energy of the moving rod, and the power of all that changes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model.quaternions import COMPLEX_STEP, director_rows
from ..rod.buckling import integral_matrix
from ..rod.collocation import Mesh
from .course import Instant, Sections
from .moving_rod import G_RATE, ZETA, ZETA_RATE, G, M, N, Q


@dataclass(frozen=True, eq=False)
class Energy:
    """Energies and works since the start, in J, at each time (S + 1,).

    Attributes
    ----------
    kinetic, elastic
        Of the trunk and what it carries; of the tissue.
    loads, muscles, head, lost
        Work of weight and all loads; of the muscles, whose strains change under stress; of the
        head, which moves the base; and what damping has taken. What joins the trunk brings its own
        kinetic energy, which counts as work of loads.
    """

    kinetic: np.ndarray
    elastic: np.ndarray
    loads: np.ndarray
    muscles: np.ndarray
    head: np.ndarray
    lost: np.ndarray

    @property
    def imbalance(self) -> np.ndarray:
        """What the balance of energy is off by, in J: 0 but for errors of the method in time."""
        stored = self.kinetic + self.elastic
        return np.asarray(stored - stored[0] - (self.loads + self.muscles + self.head - self.lost))

    @property
    def turned_over(self) -> float:
        """Largest work of any of the four, in J, to which the imbalance compares."""
        works = (self.loads, self.muscles, self.head, self.lost)
        return float(max(np.abs(work).max() for work in works))


def velocities(
    sections: Sections, mesh: Mesh, instant: Instant, states: np.ndarray, changing: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocity (n + 1, 3) at the Gauss points and the tip, spin (n, 3), and directors (n, 3, 3).

    The spin, in rad/s, is in the directors.
    """
    g, rate = changing[:, G], changing[:, G_RATE]
    omega = 2 / (1 + np.sum(g * g, axis=1, keepdims=True)) * (rate - np.cross(g, rate))
    q = states[:, 1:, Q].reshape(-1, 4)
    d = director_rows(q / np.linalg.norm(q, axis=1, keepdims=True))
    stretch = np.column_stack([np.zeros((len(g), 2)), changing[:, ZETA_RATE]])
    axis = np.column_stack([np.zeros((len(g), 2)), changing[:, ZETA]])
    slope = np.einsum("ni,nij->nj", stretch + np.cross(omega, axis), d)
    inner = np.vstack([integral_matrix(mesh), sections.weights]) @ slope
    return instant.velocity + inner, omega, d


def _on_lever(v: np.ndarray, omega: np.ndarray, d: np.ndarray, lever: float) -> np.ndarray:
    """Velocity (n, 3) of what hangs at a lever along d_2."""
    turned = np.cross(omega, np.array([0.0, lever, 0.0]))
    return np.asarray(v[:-1] + np.einsum("ni,nij->nj", turned, d))


def energies(
    sections: Sections,
    mesh: Mesh,
    instant: Instant,
    states: np.ndarray,
    changing: np.ndarray,
    w: np.ndarray,
) -> tuple[float, float]:
    """Kinetic and elastic energy in J."""
    v, omega, d = velocities(sections, mesh, instant, states, changing)
    _, _, _, mass = sections.density(instant)
    _, _, mean = sections.material(instant.strain)
    hung = _on_lever(v, omega, d, instant.loads.contact_lever)
    density = sections.mu * np.sum(v[:-1] ** 2, axis=1) + mass * np.sum(hung**2, axis=1)
    density += np.sum(sections.J / mean * omega**2, axis=1)
    kinetic = (sections.weights @ density + instant.tip_mass * v[-1] @ v[-1]) / 2
    return float(kinetic), float(_elastic(sections, instant.strain, changing[:, ZETA], w))


def _elastic(sections: Sections, strain: np.ndarray, zeta: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Elastic energy in J for strain numbers (segments, 4), which may be complex."""
    zeta_hat, u_hat, mean = sections.material(strain)
    K = sections.K
    stretch = zeta / zeta_hat - 1
    bend = w / zeta_hat[:, None] - u_hat
    density = K[:, 0] / mean * stretch**2 + np.sum(K[:, 1:] / mean**2 * bend**2, axis=1)
    return np.asarray(sections.weights @ (zeta_hat * density) / 2)


def powers(
    sections: Sections,
    mesh: Mesh,
    instant: Instant,
    states: np.ndarray,
    changing: np.ndarray,
    bend: np.ndarray,
    tau: float,
) -> tuple[float, float, float, float]:
    """Power in W of loads, muscles and head, and what damping takes."""
    v, omega, d = velocities(sections, mesh, instant, states, changing)
    weight, force, couple, _ = sections.density(instant)
    load, weights = instant.loads, sections.weights
    hung = _on_lever(v, omega, d, load.contact_lever)
    space = np.einsum("ni,nij->nj", omega, d)
    density = np.sum(weight * v[:-1] + force * hung + couple * space, axis=1)
    loads = weights @ density + np.dot(load.tip_force, v[-1])

    zeta_hat, _, mean = sections.material(instant.strain)
    _, _, mean_rate = sections.material(instant.strain_rate)
    varied = instant.strain + 1j * COMPLEX_STEP * instant.strain_rate
    muscles = (
        float(np.imag(_elastic(sections, varied, changing[:, ZETA], bend[:, :3]))) / COMPLEX_STEP
    )
    # A thinner trunk spins faster: the muscles that make it thin do that work.
    spinning = np.sum(sections.J / mean * omega**2, axis=1)
    muscles += mean_rate / mean * float(weights @ spinning) / 2
    base = states[0, 0]
    head = -(base[N] @ instant.velocity) - base[M] @ instant.spin
    K = sections.K
    lost = K[:, 0] / mean * changing[:, ZETA_RATE] ** 2
    lost = lost + np.sum(K[:, 1:] / mean**2 * bend[:, 3:] ** 2, axis=1)
    return float(loads), muscles, float(head), tau * float(weights @ (lost / zeta_hat))
