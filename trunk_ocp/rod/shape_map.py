"""Loaded shapes and their Jacobians in microseconds, for controllers and large samples.

The same rod as in `statics` and `tip_jacobian`, by the compiled method of `shooting_kernels`. Needs
numba: `pip install trunk_ocp[fast]`.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from .._support.arguments import check_arguments, real_array
from .._support.ranges import check
from ..errors import InputError, StaticsError, TrunkError
from ..model.activation import (
    mean_extension,
    segment_at,
    segment_fractions,
    stiffness,
    strain_matrix,
    strains,
)
from ..model.anatomy import Trunk
from ..model.head import base_pose
from ..model.loads import Loads
from .collocation import mesh_for
from .equations import point_parameters
from .point_shapes import PointShapes
from .statics import check_controls, points_on
from .tip_jacobian import base_slopes, tangent_slope

DEFECT = 1e-7  # with which a shape counts as resolved; see PointShapes.defect
HALVINGS = 4  # of the steps, where a shape bends too sharply for them


@dataclass(frozen=True, eq=False)
class _Controls:
    """Checked arguments of a batch, with its axes in one: B shapes."""

    batch: tuple[int, ...]
    activation: np.ndarray  # (B, muscles)
    head: np.ndarray  # (B, 2)
    strain: np.ndarray  # (B, segments, 4)
    mean: np.ndarray  # (B,)
    collapsed: np.ndarray  # (B,), whether a segment's extension is not above 0


class ShapeMap:
    """Equilibrium shapes of one trunk under one set of loads, for any activations and head.

    Compiled at its first use in a process, which takes some seconds.

    Parameters
    ----------
    loads : Loads
        Default: weight alone.
    at : (n,)
        Points Z in m to report besides the steps' own edges.
    steps : int
        Integration steps from base to tip. Shapes that they do not resolve
        (`PointShapes.defect` above 1e-7) are solved again with the steps halved.
    threads : int
        Among which a batch is shared. Results do not depend on it.
    strict : bool
        Whether a shape that is not found raises StaticsError, and an activation that collapses a
        segment InputError; otherwise such shapes are NaN, and the others of the batch are kept.

    Attributes
    ----------
    Z : (n,)
        Where shapes are reported, in m from 0 to L.

    Raises
    ------
    TrunkError
        If numba is not installed.
    InputError
        For points outside the trunk, and other arguments that are not what they should be.

    Notes
    -----
    Under loads of several times the trunk's weight there may be several equilibria. Which one
    is found depends on the start and on the steps, here as in `solve_statics`; none is checked
    for stability. To follow one, raise the load or the activation by and by, with `start`.
    """

    @check_arguments
    def __init__(
        self,
        trunk: Trunk,
        loads: Loads | None = None,
        at: Sequence[float] = (),
        steps: int = 8,
        threads: int = 1,
        strict: bool = True,
    ) -> None:
        loads = Loads() if loads is None else loads
        _check_arguments(trunk, at, steps, threads)
        self.trunk, self.loads, self.threads, self.strict = trunk, loads, threads, strict
        self._kernels, self._halvings = _kernels(), HALVINGS
        edges = mesh_for(trunk, self.loads.contact_from, steps, degree=1).edges
        points = points_on(trunk, np.asarray(at, dtype=float)).tolist()
        self._step_between(np.array(sorted({*edges, *points})))

    def __getstate__(self) -> dict[str, Any]:
        """What pickle and deepcopy take: all but the compiled kernels, and what follows anyway."""
        left_out = ("_kernels", "_finer")
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _kernels=_kernels())

    def _step_between(self, edges: np.ndarray) -> None:
        """Prepare what does not depend on the activation: steps and their parameters."""
        self.Z, self._widths = edges, np.diff(edges)
        stages = edges[:-1, None] + self._widths[:, None] * self._kernels.NODES
        p = point_parameters(self.trunk, self.loads, stages.ravel())
        p[5:8] += np.asarray(self.loads.tip_force)[:, None]
        self._points = np.ascontiguousarray(p.T).reshape(*stages.shape, len(p))
        if self.loads.contact_from is not None:
            # A step that ends where contact starts does not feel its couple yet.
            self._points[stages[:, 0] < self.loads.contact_from, :, 8:] = 0.0
        self._segment = segment_at(self.trunk, edges[:-1] + self._widths / 2)
        self._taper = np.asarray(self.trunk.taper(edges))
        self._floor = 1e-3 * float(stiffness(self.trunk, 0.0)[1]) / self.trunk.length

    @cached_property
    def _finer(self) -> ShapeMap:
        """The map of halved steps, and the last one that tries more."""
        finer = copy.copy(self)
        finer._halvings = self._halvings - 1
        middle = self.Z[:-1] + self._widths / 2
        finer._step_between(np.sort(np.concatenate([self.Z, middle])))
        return finer

    def __call__(
        self,
        activation: np.ndarray,
        head: np.ndarray | tuple[float, float] = (0.0, 0.0),
        start: PointShapes | None = None,
    ) -> PointShapes:
        """Loaded shapes (eqs. 14, 15), to about 1e-7 of the trunk's length, rarely 1e-6.

        Parameters
        ----------
        activation : (..., muscles)
            Negative values contract.
        head : (..., 2)
            psi_Z, psi_Y in radians.
        start : PointShapes
            Shapes near the ones asked for, such as a controller's last one: fewer iterations,
            and the same branch where there are several equilibria. Default: the unloaded shapes,
            also for those of `start` that are NaN.

        Raises
        ------
        InputError
            For wrong shapes, or an activation that collapses a segment.
        StaticsError
            If no equilibrium is found, or none that the finest steps resolve; names the load
            fraction reached.
        """
        controls = self._controls(activation, head)
        unloaded = self._unloaded(controls)
        paths = unloaded.copy()
        if start is not None:
            self._check_points(start)
            self._check_axes(start, controls.batch)
            known = np.broadcast_to(start.path, (*controls.batch, *unloaded.shape[1:]))
            known = known.reshape(unloaded.shape)
            usable = np.isfinite(known).all(axis=(1, 2))
            paths[usable] = known[usable]
            paths[:, 0, :4], paths[:, 0, 7:] = unloaded[:, 0, :4], unloaded[:, 0, 7:]
        self._solve(controls, paths, unloaded, np.arange(len(paths)))
        return self._shapes(paths, controls.batch)

    def unloaded(
        self, activation: np.ndarray, head: np.ndarray | tuple[float, float] = (0.0, 0.0)
    ) -> PointShapes:
        """Shapes without any load, in closed form; arguments and errors as for loaded ones."""
        controls = self._controls(activation, head)
        return self._shapes(self._unloaded(controls), controls.batch)

    def jacobian(
        self,
        shapes: PointShapes,
        activation: np.ndarray,
        head: np.ndarray | tuple[float, float] = (0.0, 0.0),
    ) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of loaded shapes, through the equilibrium: exact for the steps taken.

        Parameters
        ----------
        shapes : PointShapes
            As this map returned them for the other arguments.

        Returns
        -------
        position : (..., n, 3, muscles + 2)
            Of the centerline at Z, in m per unit of activation, and m per radian of psi_Z, psi_Y
            in the last two columns.
        tangent : (..., n, 3, muscles + 2)
            Of d_3 at Z.

        Raises
        ------
        InputError
            For wrong shapes, or shapes of other points.
        """
        self._check_points(shapes)
        controls = self._controls(activation, head, shapes.path.shape[:-2])
        paths = np.broadcast_to(shapes.path, (*controls.batch, self.Z.size, 10))
        slopes = self._slopes(controls, np.ascontiguousarray(paths).reshape(-1, self.Z.size, 10))
        slopes = slopes.reshape(*controls.batch, *slopes.shape[1:])
        return slopes[..., :3, :], slopes[..., 3:, :]

    # --- pieces ----------------------------------------------------------------------

    def _controls(
        self,
        activation: np.ndarray,
        head: np.ndarray | tuple[float, float],
        shapes: tuple[int, ...] = (),
    ) -> _Controls:
        """Checked arguments, with the axes of `shapes` that come with them."""
        activation, head = check_controls(self.trunk, activation, head, collapsed=not self.strict)
        axes = [activation.shape[:-1], head.shape[:-1], *([shapes] if shapes else [])]
        try:
            batch = np.broadcast_shapes(*axes)
        except ValueError:
            raise InputError(
                "activation, head and shapes: expected leading axes that match, got "
                f"{', '.join(map(str, axes))}."
            ) from None
        count, muscles = math.prod(batch), activation.shape[-1]
        gamma = np.broadcast_to(activation, (*batch, muscles)).reshape(count, muscles)
        psi = np.broadcast_to(head, (*batch, 2)).reshape(count, 2)
        strain = np.ascontiguousarray(strains(self.trunk, gamma))
        mean, collapsed = mean_extension(self.trunk, strain), np.any(strain[..., 0] <= 0, axis=1)
        return _Controls(batch, gamma, psi, strain, mean, np.asarray(collapsed))

    def _check_points(self, shapes: PointShapes) -> None:
        """Raise InputError unless shapes are of this map's points."""
        if not isinstance(shapes, PointShapes):
            raise InputError(
                f"shapes: expected what a ShapeMap returned, got {type(shapes).__name__}."
            )
        if not np.array_equal(shapes.Z, self.Z):
            raise InputError(
                f"shapes: expected shapes of this map's {self.Z.size} points, got {shapes.Z.size} "
                "points of another map."
            )

    def _check_axes(self, shapes: PointShapes, batch: tuple[int, ...]) -> None:
        """Raise InputError unless there is a start for each shape of a batch."""
        given = shapes.path.shape[:-2]
        try:
            fits = np.broadcast_shapes(given, batch) == batch
        except ValueError:
            fits = False
        if not fits:
            raise InputError(f"start: expected shapes with leading axes {batch}, got {given}.")

    def _unloaded(self, controls: _Controls) -> np.ndarray:
        """Unloaded paths (B, n, 10)."""
        r, q = base_pose(self.trunk.head, controls.head[:, 0], controls.head[:, 1])
        paths = np.zeros((len(controls.head), self.Z.size, 10))
        for i, value in enumerate((*q, 0.0, 0.0, 0.0, *r)):
            paths[:, 0, i] = value
        k = float(self.trunk.taper_rate)

        def work(some: slice) -> None:
            self._kernels.unloaded_paths(
                paths[some], controls.strain[some], self._segment, self.Z, self._taper, k
            )

        self._share(work, len(paths))
        return paths

    def _solve(
        self, controls: _Controls, paths: np.ndarray, unloaded: np.ndarray, number: np.ndarray
    ) -> None:
        """Loaded paths (B, n, 10), in place of guesses; `number` (B,) is theirs in the batch."""
        reached = np.empty(len(paths))

        def work(some: slice) -> None:
            self._kernels.loaded_paths(
                paths[some],
                unloaded[some],
                controls.mean[some],
                self._points,
                self._widths,
                controls.strain[some],
                self._segment,
                self._floor,
                reached[some],
            )

        self._share(work, len(paths))
        found = (reached == 1) | controls.collapsed
        rough = found & ~(PointShapes(self.Z, paths).defect <= DEFECT)
        # What two meshes do not find is not there; what one does not resolve, finer ones may.
        lost = ~found if self._halvings < HALVINGS else np.zeros_like(found)
        lost |= rough if self._halvings == 0 else False
        lost &= ~controls.collapsed
        if np.any(lost) and self.strict:
            first = int(np.argmax(lost))
            raise self._not_found(int(number[first]), controls, float(reached[first]))
        paths[lost | controls.collapsed] = np.nan
        again = np.flatnonzero((rough | ~found) & ~(lost | controls.collapsed))
        if again.size:
            some = _Controls(
                controls.batch,
                controls.activation[again],
                controls.head[again],
                controls.strain[again],
                controls.mean[again],
                controls.collapsed[again],
            )
            base = self._finer._unloaded(some)
            fine = np.where(found[again, None, None], _halved(paths[again]), base)
            self._finer._solve(some, fine, base, number[again])
            paths[again] = fine[:, ::2]

    def _not_found(self, index: int, controls: _Controls, reached: float) -> StaticsError:
        count = math.prod(controls.batch)
        which = f"shape {index + 1} of {count}: " if count > 1 else ""
        if reached < 1:
            return StaticsError(
                f"{which}no equilibrium found beyond {100 * reached:.1f} % of the load; the trunk "
                "may bend too sharply, coil, buckle or be squeezed to nothing. Reduce the load or "
                "the activation.",
                reached,
            )
        return StaticsError(
            f"{which}the shape bends too sharply for {self._widths.size} steps; reduce the load, "
            "or take more steps.",
            reached,
        )

    def _slopes(self, controls: _Controls, paths: np.ndarray) -> np.ndarray:
        """Derivatives (B, n, 6, muscles + 2) of r and d_3."""
        B, n, S = len(paths), self.Z.size, self.trunk.segments
        base = np.zeros((B, 2, 10))
        r0, q0 = base_slopes(self.trunk.head, controls.head)
        base[:, :, :4], base[:, :, 7:] = q0.swapaxes(-1, -2), r0.swapaxes(-1, -2)
        T, gap = np.empty((B, 2 + S, n, 4, 10)), np.empty(B)

        def work(some: slice) -> None:
            self._kernels.tangent_paths(
                paths[some],
                controls.mean[some],
                self._points,
                self._widths,
                controls.strain[some],
                self._segment,
                base[some],
                T[some],
                gap[some],
            )

        self._share(work, B)
        columns = T.transpose(0, 2, 4, 1, 3).reshape(B, n, 10, 4 * (2 + S))
        # m(0) is what keeps m(L) at zero.
        by_moment, others = columns[..., :3], columns[..., 3:]
        at_tip = np.linalg.solve(by_moment[:, -1, 4:7], others[:, -1, 4:7])
        total = others - by_moment @ at_tip[:, None]
        d3 = tangent_slope(paths[..., :4]) @ total[..., :4, :]
        slopes: np.ndarray = np.concatenate([total[..., 7:, :], d3], axis=-2) @ self._chain
        bad = np.flatnonzero(gap > 10 * DEFECT)
        if bad.size and self._halvings:
            activation, head = controls.activation[bad], controls.head[bad]
            near = PointShapes(self._finer.Z, _halved(paths[bad]))
            finer = self._finer(activation, head, near)
            slopes[bad] = np.concatenate(self._finer.jacobian(finer, activation, head), -2)[:, ::2]
        return slopes

    @cached_property
    def _chain(self) -> np.ndarray:
        """Derivative of the tangents' parameters by activations and head, (5 + 4 S, muscles + 2).

        In the order of `shooting.tangent_paths`: mean extension, head angles, two zeros, strains.
        """
        A = strain_matrix(self.trunk)
        S, muscles = A.shape[0], A.shape[2]
        chain = np.zeros((5 + 4 * S, muscles + 2))
        chain[0, :muscles] = segment_fractions(self.trunk) @ A[:, 0]
        chain[1:3, muscles:] = np.eye(2)
        chain[5:, :muscles] = A.reshape(4 * S, muscles)
        return chain

    def _shapes(self, paths: np.ndarray, batch: tuple[int, ...]) -> PointShapes:
        return PointShapes(self.Z, paths.reshape(*batch, *paths.shape[1:]))

    def _share(self, work: Callable[[slice], None], count: int) -> None:
        """Work on every shape of a batch, shared among threads."""
        parts = min(self.threads, count)
        if parts <= 1:
            work(slice(None))
            return
        bounds = np.linspace(0, count, parts + 1).astype(int)
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(work, [slice(a, b) for a, b in itertools.pairwise(bounds)]))


def _check_arguments(trunk: Trunk, at: Sequence[float], steps: int, threads: int) -> None:
    """Raise InputError for arguments of a map that are not what they should be."""
    check(int(steps), "elements", "steps")
    check(int(threads), "processes", "threads")
    points = real_array(at, "at")
    if points.ndim != 1:
        raise InputError(f"at = {at!r}: expected a list of points Z in m.")
    points_on(trunk, points)


def _halved(paths: np.ndarray) -> np.ndarray:
    """Guess of paths (B, 2 n - 1, 10) for halved steps: the mean between every two points."""
    fine = np.empty((len(paths), 2 * paths.shape[1] - 1, paths.shape[2]))
    fine[:, ::2] = paths
    fine[:, 1::2] = (paths[:, 1:] + paths[:, :-1]) / 2
    return fine


def _kernels() -> ModuleType:
    try:
        from . import shooting_kernels as shooting
    except ModuleNotFoundError as error:
        raise TrunkError(
            "ShapeMap needs numba, which is not installed: pip install trunk_ocp[fast]. "
            "solve_statics works without."
        ) from error
    return shooting
