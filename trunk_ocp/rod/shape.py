"""Equilibrium shapes of a trunk, sampled anywhere along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._support.arguments import real_array
from .._support.outputs import Displayed
from ..errors import InputError
from ..model.activation import mean_extension, segment_at, stiffness
from ..model.anatomy import Trunk
from ..model.quaternions import director_rows
from .collocation import Mesh, gauss
from .equations import MOMENT, ORIENTATION, STATES, loaded_curvature


@dataclass(frozen=True, repr=False, eq=False)
class Shape(Displayed):
    """Equilibrium shapes of a trunk, with any leading batch axes (...).

    Positions are in m and space axes, moments in N m and in the directors.
    """

    trunk: Trunk
    mesh: Mesh
    intrinsic: np.ndarray
    """(..., segments, 4): strain numbers that the muscles cause; see `activation.strains`."""
    states: np.ndarray
    """(..., elements, degree + 1, 7): q and m at each element's left edge and Gauss points."""
    edges: np.ndarray
    """(..., elements + 1, 3): centerline at the element edges."""
    slopes: np.ndarray
    """(..., elements, degree, 3): dr/dZ at the Gauss points."""

    def __repr__(self) -> str:
        batch = self.states.shape[:-3]
        return f"<Shape of {self.trunk.name}: batch {batch}, {self.mesh.elements} elements>"

    def __getitem__(self, index: int | slice | tuple[int | np.ndarray, ...] | np.ndarray) -> Shape:
        """Some shapes of a batch, by its first axes."""
        return Shape(self.trunk, self.mesh, *(array[index] for array in self._arrays))

    @staticmethod
    def stack(shapes: Sequence[Shape], mesh: Mesh | None = None) -> Shape:
        """Shapes of one trunk as a batch with a new first axis; by default on the first's mesh."""
        mesh = mesh or shapes[0].mesh
        on_mesh = [shape if shape.mesh == mesh else shape.on(mesh) for shape in shapes]
        arrays = zip(*(shape._arrays for shape in on_mesh), strict=True)
        return Shape(shapes[0].trunk, mesh, *map(np.stack, arrays))

    def position(self, Z: np.ndarray) -> np.ndarray:
        """Centerline r(Z), (..., n, 3) m, at points Z (n,) in m."""
        element, tau = self._locate(Z)
        weights = gauss(self.mesh.degree).integral(tau) * self.mesh.widths[element, None]
        inside = np.einsum("nd,...ndc->...nc", weights, self.slopes[..., element, :, :])
        return self.edges[..., element, :] + inside

    def directors(self, Z: np.ndarray) -> np.ndarray:
        """Directors, (..., n, 3, 3): row i is d_i in space axes."""
        return self.frames(Z)[0]

    def moment(self, Z: np.ndarray) -> np.ndarray:
        """Internal moment m(Z), (..., n, 3) N m, in the directors."""
        return self.state(Z)[..., MOMENT]

    def frames(self, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directors (..., n, 3, 3) and moment (..., n, 3) together, which saves time."""
        return _frames(self.state(Z))

    def at_points(self) -> tuple[np.ndarray, np.ndarray]:
        """`frames` at all n Gauss points, where the states are known."""
        states = self.states[..., 1:, :]
        return _frames(states.reshape(*states.shape[:-3], -1, STATES))

    def strain(self, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Extension zeta (..., n) and curvature u (..., n, 3) in 1/m of the loaded trunk (eq. 15).

        At a jump of the loads or of the muscles, the value on the side of the base.
        """
        state, slope = self.state(Z), self._slope(Z)
        Z = points_on(self.trunk, np.atleast_1d(np.asarray(Z, dtype=float)))
        c = self.intrinsic[..., segment_at(self.trunk, Z), 1:]
        mean = mean_extension(self.trunk, self.intrinsic)[..., None, None]
        K = stiffness(self.trunk, Z)[:, 1:]
        u = loaded_curvature(c / self.trunk.taper(Z)[:, None], mean, state[..., MOMENT], K)
        return extension(state[..., ORIENTATION], slope), u

    def state(self, Z: np.ndarray) -> np.ndarray:
        """State (q, m) at points Z, (..., n, 7); |q| = 1 to collocation accuracy."""
        element, tau = self._locate(Z)
        weights = gauss(self.mesh.degree).value(tau)
        return np.einsum("nd,...ndx->...nx", weights, self.states[..., element, :, :])

    @property
    def defect(self) -> np.ndarray:
        """Largest | |q|^2 - 1 | at the Gauss points, (...,): how well the mesh resolves the shape.

        Collocation keeps |q| = 1 exactly at element edges, and inside only to its own accuracy,
        so this estimates the error at no cost: for this trunk, positions are off by about
        0.02 to 2 times as much (in m) on every mesh and load tried.
        """
        return defects(self.states).max(axis=-1)

    @property
    def extension(self) -> np.ndarray:
        """Loaded extension zeta, (..., elements, degree): dr/dZ . d_3 at the Gauss points."""
        return extension(self.states[..., 1:, ORIENTATION], self.slopes)

    def on(self, mesh: Mesh) -> Shape:
        """The same shapes on another mesh, with the same state and centerline at its points."""
        starts = np.asarray(mesh.edges[:-1])[:, None]
        points = np.hstack([starts, mesh.points])
        batch = self.states.shape[:-3]
        return replace(
            self,
            mesh=mesh,
            states=self.state(points.ravel()).reshape(*batch, *points.shape, STATES),
            edges=self.position(np.asarray(mesh.edges)),
            slopes=self._slope(mesh.points.ravel()).reshape(*batch, *mesh.points.shape, 3),
        )

    @property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        """The fields with the batch axes."""
        return self.intrinsic, self.states, self.edges, self.slopes

    def _slope(self, Z: np.ndarray) -> np.ndarray:
        """dr/dZ, (..., n, 3), at points Z (n,)."""
        element, tau = self._locate(Z)
        weights = gauss(self.mesh.degree).from_nodes(tau)
        return np.einsum("nd,...ndc->...nc", weights, self.slopes[..., element, :, :])

    def _locate(self, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = np.atleast_1d(real_array(Z, "Z"))
        if points.ndim != 1:
            raise InputError(f"Z = {Z!r}: expected points of the trunk in m, one number or (n,).")
        return self.mesh.locate(points_on(self.trunk, points))


def _frames(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directors (..., n, 3, 3) and moment (..., n, 3) of states (..., n, 7)."""
    q = states[..., ORIENTATION]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return director_rows(q), states[..., MOMENT]


def points_on(trunk: Trunk, Z: np.ndarray) -> np.ndarray:
    """Points Z (n,) in m, with rounding errors beyond the trunk's ends cut off.

    Raises
    ------
    InputError
        For a point that is off the trunk or not a number.
    """
    Z = trunk.clipped(Z)
    outside = Z[~((Z >= 0) & (Z <= trunk.length))]
    if outside.size:
        raise InputError(f"Z = {outside[0]:.12g}: expected 0 <= Z <= L = {trunk.length:.12g} m.")
    return Z


def defects(states: np.ndarray) -> np.ndarray:
    """Largest | |q|^2 - 1 | in each element, (..., elements); see `Shape.defect`."""
    norms = np.sum(states[..., ORIENTATION] ** 2, axis=-1)
    return np.asarray(np.abs(norms - 1).max(axis=-1))


def extension(q: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Extension (...) of a rod with dr/dZ (..., 3) along d_3 of quaternions (..., 4)."""
    d3 = director_rows(q)[..., 2, :]
    norm = np.sum(d3**2, axis=-1)  # not quite 1 between the edges of elements
    return np.asarray(np.sum(slope * d3, axis=-1) / norm)
