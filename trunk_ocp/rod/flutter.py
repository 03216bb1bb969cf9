"""Vibrations about an equilibrium of the rod, and flutter: those that grow by themselves.

The linearized equations of motion, without damping, are M y'' + K y = 0 in the small rotation
y(Z) of `buckling` and a change of stretch e(Z) of its own, because stretching waves are not much
faster than bending waves on a trunk this thick. K is Q of `buckling`, in which e counts from its
quasi-static value, and the tangent of a couple l that keeps its direction in space,

    - 1/2 l x y  per unit of initial length,

which is skew: no potential has it (Ziegler, Principles of Structural Stability, 1968). So two
frequencies may meet and become complex, however small the couple is where they were equal before
(Nicolai 1928): the trunk flutters, although it cannot buckle. The kinetic energy is that of

    v(Z) = int_0^Z (zeta y x d_3 + e d_3) dZ

with the mass per initial length, which activation does not change, and the rotary inertia of
sections of the radius that keeps the volume (eq. 30).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, lu_factor, lu_solve
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from .._support.arguments import check_arguments
from .._support.wording import step_list
from ..errors import InputError
from ..model.activation import intrinsic_strain, mean_extension, stiffness, strains
from ..model.loads import Loads, couple_density, internal_force, lever_density
from .buckling import integral_matrix, integrand, matched, quadratic_form
from .collocation import gauss
from .equations import loaded_extension
from .shape import Shape

MODES = 16
"""Lowest modes that count. The meshes of plans resolve them to 1e-4, and tissue damps others."""
FREQUENCIES = 3  # that `natural_frequencies` reports
MAX_DENSE_UNKNOWNS = 400  # of one matrix; beyond, only the lowest modes are computed
ROUND_OFF = 1e-6  # of a rate, below which its real or imaginary part is zero
MIN_GROWTH = 1e-3
"""Share of |rate| above which a mode counts as growing; errors of equal frequencies make less."""


@dataclass(frozen=True, eq=False)
class Flutter:
    """Rates of the lowest modes of small vibrations, with the batch axes (...) of their shapes.

    Attributes
    ----------
    rates : (..., 16) complex
        The modes move as exp(rate t), in 1/s, slowest first: the real part is the rate of growth,
        0 where the mode neither grows nor decays, and the imaginary part 2 pi times the frequency.
        NaN where there is no equilibrium.
    """

    rates: np.ndarray

    @property
    def growth(self) -> np.ndarray:
        """Rate of growth (...,) in 1/s of the mode that grows fastest, beyond numerical errors."""
        return np.asarray(self._fastest.real)

    @property
    def frequency(self) -> np.ndarray:
        """Frequency (...,) in Hz of the mode that grows fastest, or of the lowest if none grows.

        0 if the shape buckles.
        """
        return np.asarray(self._fastest.imag / (2 * math.pi))

    @property
    def flutters(self) -> np.ndarray:
        """Whether a vibration grows, (...,) bool."""
        fastest = self._fastest
        return np.asarray((fastest.real > MIN_GROWTH * abs(fastest)) & (fastest.imag > 0))

    @property
    def sentences(self) -> list[str]:
        """A sentence on the time steps (H,) that flutter, if any do."""
        steps = np.flatnonzero(self.flutters)
        if not steps.size:
            return []
        worst = steps[np.argmax(self.growth[steps])]
        growth, frequency = self.growth[worst], self.frequency[worst]
        words = f"up to {growth:.2g}" if steps.size > 1 else f"{growth:.2g}"
        return [
            f"{step_list((steps + 1).tolist())} flutter{'s' * (steps.size == 1)}: growth {words} "
            f"/s at {frequency:.2g} Hz, undamped; the couple is fixed in space"
        ]

    @property
    def _fastest(self) -> np.ndarray:
        counts = self.rates.real > MIN_GROWTH * abs(self.rates)  # False for NaN
        index = np.argmax(np.where(counts, self.rates.real, 0.0), axis=-1)[..., None]
        return np.take_along_axis(self.rates, index, axis=-1)[..., 0]


@check_arguments
def flutter(
    shape: Shape,
    activation: np.ndarray,
    loads: Loads | Sequence[Loads],
    contact_mass: float = 0.0,
    tip_mass: float = 0.0,
) -> Flutter:
    """Small undamped vibrations about equilibria (...) as `solve_statics` returned them.

    Parameters
    ----------
    activation : (..., muscles)
    loads : Loads, or one for each shape along the last batch axis
    contact_mass : float
        In kg, spread over [Z_w, L] and on the lever of the contact force: what the trunk carries.
    tip_mass : float
        In kg, at the tip.

    Raises
    ------
    InputError
        For activations or loads that do not match the shape's batch axes, masses below 0, a trunk
        without mass, and a contact mass without contact.
    """
    activations, each, which = _checked(shape, activation, loads, contact_mass, tip_mass)
    batch = shape.states.shape[:-3]
    rates = np.full((*batch, MODES), np.nan, dtype=complex)
    for i in np.ndindex(batch):
        masses = contact_mass, tip_mass
        found = _rates(*_matrices(shape[i], activations[i], each[which[i]], *masses))
        rates[i][: len(found)] = found
    return Flutter(rates)


@check_arguments
def natural_frequencies(
    shape: Shape,
    activation: np.ndarray,
    loads: Loads | Sequence[Loads],
    contact_mass: float = 0.0,
    tip_mass: float = 0.0,
) -> np.ndarray:
    """Lowest three frequencies of small undamped vibrations about equilibria, (..., 3) in Hz.

    Ascending; 0 for a direction in which the shape buckles, and NaN where there is no equilibrium.
    Arguments and errors are those of `flutter`.
    """
    activations, each, which = _checked(shape, activation, loads, contact_mass, tip_mass)
    batch = shape.states.shape[:-3]
    frequencies = np.full((*batch, FREQUENCIES), np.nan)
    for i in np.ndindex(batch):
        load = each[which[i]]
        K, M = _matrices(shape[i], activations[i], load, contact_mass, tip_mass)
        found = None if any(load.contact_couple) else _slowest(K, M)
        if found is None:
            found = _rates(K, M, FREQUENCIES).imag / (2 * math.pi)
        frequencies[i][: len(found)] = found
    return frequencies


def _slowest(K: np.ndarray, M: np.ndarray) -> np.ndarray | None:
    """Lowest frequencies (3,) in Hz of a symmetric K, in a third of the time of `_rates`.

    None if K is not positive definite: the shape buckles.
    """
    last = [len(K) - FREQUENCIES, len(K) - 1]
    try:
        squares = eigh(M, K, eigvals_only=True, subset_by_index=last)
    except (np.linalg.LinAlgError, ValueError):
        return None
    found: np.ndarray = 1 / np.sqrt(squares[::-1]) / (2 * math.pi)
    return found


def _checked(
    shape: Shape,
    activation: np.ndarray,
    loads: Loads | Sequence[Loads],
    contact_mass: float,
    tip_mass: float,
) -> tuple[np.ndarray, list[Loads], np.ndarray]:
    """Arguments as `matched` returns them, checked."""
    activations, each, which = matched(shape, activation, loads)
    for name, mass in (("contact_mass", contact_mass), ("tip_mass", tip_mass)):
        if not 0 <= mass < math.inf:
            raise InputError(f"{name} = {mass:g}: expected a mass in kg, 0 or more.")
    if shape.trunk.density == 0:
        raise InputError(f"{shape.trunk.name}: vibrations need the density of the trunk; it is 0.")
    if contact_mass > 0 and any(load.contact_from is None for load in each):
        raise InputError(f"contact_mass = {contact_mass:g}: needs loads with contact_from.")
    return activations, each, which


def _matrices(
    shape: Shape, activation: np.ndarray, load: Loads, contact_mass: float, tip_mass: float
) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (4 n, 4 n) in scaled changes of curvature s (n, 3) and stretch (n,).

    The unknowns at the n Gauss points are scaled so that the rod's own stiffness is the identity.
    """
    trunk, mesh = shape.trunk, shape.mesh
    Z, n = mesh.points.ravel(), mesh.points.size
    weights = (mesh.widths[:, None] * gauss(mesh.degree).integral(1.0)).ravel()
    integral, N = integral_matrix(mesh), internal_force(load, trunk, Z)
    parts = integrand(shape, activation, N, lever_density(load, trunk, Z))
    turn = np.einsum("kl,lai->kali", integral, parts[0]).reshape(n, 3, 3 * n)
    K = np.eye(4 * n)
    K[: 3 * n, : 3 * n] = quadratic_form(integral, *parts)
    couple = weights[:, None, None] * couple_density(load, trunk, Z)[:, None, :]
    skew = np.cross(couple, np.eye(3)).swapaxes(1, 2)  # skew y = couple x y
    K[: 3 * n, : 3 * n] -= _sum_of(turn, skew @ turn) / 2

    zeta_hat, _ = intrinsic_strain(trunk, activation, Z)
    mean = mean_extension(trunk, strains(trunk, activation))
    d, _ = shape.at_points()
    d3, K0 = d[:, 2], stiffness(trunk, Z)[:, 0]
    zeta = loaded_extension(zeta_hat, mean, np.sum(N * d3, axis=-1), K0)
    # The stretch changes by zeta_hat mean / K_0 times the change of n_3, and by its own unknown.
    softness = zeta_hat * mean / K0
    follows = (softness[:, None] * np.cross(d3, N))[:, None] @ turn
    v = np.empty((n, 3, 4 * n))
    v[..., : 3 * n] = np.cross((zeta[:, None] * d3)[:, None], turn, axisb=1, axisc=1)
    v[..., : 3 * n] = d3[..., None] * follows - v[..., : 3 * n]
    v[..., 3 * n :] = d3[..., None] * np.diag(np.sqrt(softness / weights))[:, None]
    tip = np.tensordot(weights, v, axes=1)
    v = np.tensordot(integral, v, axes=1)

    radius = trunk.radius(Z)
    own = weights * trunk.density * math.pi * radius**2
    carried = np.zeros(n)
    if load.contact_from is not None:
        carried = weights * (Z > load.contact_from) / (trunk.length - load.contact_from)
    M = _sum_of(v, own[:, None, None] * v) + tip_mass * tip.T @ tip
    v[..., : 3 * n] -= np.cross((load.contact_lever * d[:, 1])[:, None], turn, axisb=1, axisc=1)
    M += _sum_of(v, (contact_mass * carried)[:, None, None] * v)
    spin = d @ turn
    inertia = (own * radius**2 / mean / 4)[:, None] * np.array([1.0, 1.0, 2.0])
    M[: 3 * n, : 3 * n] += _sum_of(spin, inertia[..., None] * spin)
    return K, M


def _sum_of(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sum over points of a^T b, for a and b (n, 3, size)."""
    size = a.shape[-1]
    return np.asarray(a.reshape(-1, size).T @ b.reshape(-1, size))


def _rates(K: np.ndarray, M: np.ndarray, count: int = MODES) -> np.ndarray:
    """Rates of the lowest modes, from the largest eigenvalues of K^-1 M, which are - 1 / rate^2."""
    if not (np.all(np.isfinite(K)) and np.all(np.isfinite(M))):
        return np.zeros(0, dtype=complex)
    try:
        values = _largest(lu_factor(K), M, count)
    except (np.linalg.LinAlgError, ValueError):  # exactly where the shape buckles
        return np.zeros(0, dtype=complex)
    values = values[np.argsort(-abs(values), kind="stable")][:count].astype(complex)
    with np.errstate(all="ignore"):
        rates = np.sqrt(-1 / values)
    rates = np.abs(rates.real) + 1j * np.abs(rates.imag)
    rates.real[rates.real < ROUND_OFF * abs(rates)] = 0.0
    rates.imag[rates.imag < ROUND_OFF * abs(rates)] = 0.0
    return rates


def _largest(factors: tuple[np.ndarray, np.ndarray], M: np.ndarray, count: int) -> np.ndarray:
    """Eigenvalues of K^-1 M, at least the `count` largest."""
    size = len(M)
    if size > MAX_DENSE_UNKNOWNS:
        inverse = LinearOperator(M.shape, matvec=lambda x: lu_solve(factors, M @ x), dtype=float)
        few = MODES + 8
    else:
        inverse, few = lu_solve(factors, M), 2 * count
    if size > MAX_DENSE_UNKNOWNS or 4 * few < size:  # few of many
        with suppress(ArpackError):
            largest: np.ndarray = eigs(inverse, few, v0=np.ones(size), return_eigenvectors=False)
            return largest
    return np.linalg.eigvals(lu_solve(factors, M))
