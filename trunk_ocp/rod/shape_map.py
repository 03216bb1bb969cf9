"""Loaded shapes and their Jacobians in microseconds, for controllers and large samples.

The same rod as in `statics` and `tip_jacobian`, solved by the compiled method of
`shooting_kernels`. Needs numba: `pip install numba`.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from ..errors import InputError, StaticsError, TrunkError
from ..model.activation import segment_at, segment_fractions, stiffness, strain_matrix
from ..model.anatomy import Trunk
from ..model.head import base_pose, base_slopes
from ..model.loads import Loads
from ..model.quaternions import tangent_slope
from .arguments import Controls, check_map_arguments, check_points, check_start
from .collocation import mesh_for
from .equations import (
    COUPLE,
    FORCE,
    MOMENT,
    ORIENTATION,
    POSITION,
    RATES,
    is_hung,
    point_parameters,
)
from .point_shapes import PointShapes
from .shape import points_on

MAX_DEFECT = 1e-7  # of a shape that counts as resolved; see PointShapes.defect
MAX_HALVINGS = 4  # of the steps, where a shape bends too sharply for them


class ShapeMap:
    """Equilibrium shapes of one trunk under one set of loads, for any activations and head.

    Compiled at its first use on a machine, which takes some seconds, and loaded from the user's
    cache folder afterward; see `warm_up`.

    Parameters
    ----------
    loads : Loads
        Default: weight alone.
    at : (n,)
        Points Z in m to report, in addition to the edges of the integration steps.
    steps : int
        Integration steps from base to tip. Shapes that they do not resolve
        (`PointShapes.defect` above 1e-7) are solved again with the steps halved. Five are enough
        for errors below 1e-6 L, and a third faster.
    threads : int
        Number of threads that share a batch. Results do not depend on it.
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
        For points off the trunk, a contact force on a lever, and other invalid arguments.

    Notes
    -----
    Under loads of several times the trunk's weight there may be several equilibria. Which one
    is found depends on the start and on the steps, here as in `solve_statics`; none is checked
    for stability. To follow one, raise the load or the activation gradually, with `start`.
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
        if is_hung(loads):
            raise InputError(
                "loads.contact_lever: ShapeMap has no contact force on a lever; use solve_statics."
            )
        check_map_arguments(trunk, at, steps, threads)
        self.trunk, self.loads, self.threads, self.strict = trunk, loads, threads, strict
        self._kernels, self._halvings = _kernels(), MAX_HALVINGS
        edges = mesh_for(trunk, self.loads.contact_from, steps, degree=1).edges
        points = points_on(trunk, np.asarray(at, dtype=float)).tolist()
        self._set_steps(np.array(sorted({*edges, *points})))

    def __getstate__(self) -> dict[str, Any]:
        """State for pickle and deepcopy, without the compiled kernels and the derived map."""
        derived = ("_kernels", "_finer")
        return {name: value for name, value in self.__dict__.items() if name not in derived}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _kernels=_kernels())

    def _set_steps(self, edges: np.ndarray) -> None:
        """Prepare everything that does not depend on the activation: steps and parameters."""
        self.Z, self._widths = edges, np.diff(edges)
        stages = edges[:-1, None] + self._widths[:, None] * self._kernels.NODES
        p = point_parameters(self.trunk, self.loads, stages.ravel())
        p[FORCE] += np.asarray(self.loads.tip_force)[:, None]
        self._points = np.ascontiguousarray(p.T).reshape(*stages.shape, len(p))
        if self.loads.contact_from is not None:
            # The last stages of a step that ends where contact starts are at Z_w themselves, and
            # would feel a couple that acts only beyond.
            self._points[stages[:, 0] < self.loads.contact_from, :, COUPLE] = 0.0
        self._segment = segment_at(self.trunk, edges[:-1] + self._widths / 2)
        self._taper = np.asarray(self.trunk.taper(edges))
        self._floor = 1e-3 * float(stiffness(self.trunk, 0.0)[1]) / self.trunk.length

    @cached_property
    def _finer(self) -> ShapeMap:
        """The map with halved steps, which may be halved once less often."""
        finer = copy.copy(self)
        finer._halvings = self._halvings - 1
        middle = self.Z[:-1] + self._widths / 2
        finer._set_steps(np.sort(np.concatenate([self.Z, middle])))
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
            Shapes near the requested ones, such as a controller's last one: fewer iterations,
            and the same branch where there are several equilibria. Default: the unloaded shapes,
            also in place of those of `start` that are NaN.

        Raises
        ------
        InputError
            For wrong shapes, or an activation that collapses a segment.
        StaticsError
            If no equilibrium is found, or none that the finest steps resolve; gives the fraction of
            the load that was reached.
        """
        controls = Controls.of(self.trunk, activation, head, self.strict)
        unloaded = self._unloaded(controls)
        paths = unloaded.copy()
        if start is not None:
            check_points(self.Z, start)
            check_start(start, controls.batch)
            guess = np.broadcast_to(start.path, (*controls.batch, *unloaded.shape[1:]))
            guess = guess.reshape(unloaded.shape)
            usable = np.isfinite(guess).all(axis=(1, 2))
            paths[usable] = guess[usable]
            # Newton leaves the base where the head has it.
            for part in (ORIENTATION, POSITION):
                paths[:, 0, part] = unloaded[:, 0, part]
        self._solve(controls, paths, unloaded, np.arange(len(paths)))
        return self._shapes(paths, controls.batch)

    def warm_up(self) -> None:
        """Load or compile everything now, so that no later call waits for it.

        Compiling takes some seconds, once per machine. What is compiled is kept in `trunk_ocp` in
        the user's cache folder, such as `~/.cache`, or in NUMBA_CACHE_DIR; loading it takes
        tenths of a second. Where the folder is not writable or not the user's own, every process
        compiles in memory.
        """
        nothing = np.zeros((0, len(self.trunk.muscles)))
        self.jacobian(self(nothing), nothing)

    def unloaded(
        self, activation: np.ndarray, head: np.ndarray | tuple[float, float] = (0.0, 0.0)
    ) -> PointShapes:
        """Shapes without any load, in closed form; arguments and errors as for loaded ones."""
        controls = Controls.of(self.trunk, activation, head, self.strict)
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
        check_points(self.Z, shapes)
        controls = Controls.of(self.trunk, activation, head, self.strict, shapes.path.shape[:-2])
        # A copy: kernels are compiled for arrays that can be written.
        paths = np.broadcast_to(shapes.path, (*controls.batch, self.Z.size, RATES)).copy()
        slopes = self._slopes(controls, paths.reshape(-1, self.Z.size, RATES))
        slopes = slopes.reshape(*controls.batch, *slopes.shape[1:])
        return slopes[..., :3, :], slopes[..., 3:, :]

    def _unloaded(self, controls: Controls) -> np.ndarray:
        """Unloaded paths (B, n, 10)."""
        r, q = base_pose(self.trunk.head, controls.head[:, 0], controls.head[:, 1])
        paths = np.zeros((len(controls.head), self.Z.size, RATES))
        for i, value in enumerate((*q, 0.0, 0.0, 0.0, *r)):
            paths[:, 0, i] = value
        k = float(self.trunk.taper_rate)

        def work(part: slice) -> None:
            self._kernels.unloaded_paths(
                paths[part], controls.strain[part], self._segment, self.Z, self._taper, k
            )

        self._share(work, len(paths))
        return paths

    def _solve(
        self, controls: Controls, paths: np.ndarray, unloaded: np.ndarray, number: np.ndarray
    ) -> None:
        """Solve for loaded paths (B, n, 10), in place of guesses.

        number : (B,), of each in the whole batch, for errors.
        """
        reached = np.empty(len(paths))

        def work(part: slice) -> None:
            rods, start, share = self._rods(controls[part]), unloaded[part], reached[part]
            self._kernels.loaded_paths(paths[part], start, *rods, self._floor, share)

        self._share(work, len(paths))
        found = (reached == 1) | controls.collapsed
        rough = found & ~(PointShapes(self.Z, paths).defect <= MAX_DEFECT)
        # A shape is given up when two meshes do not find it, but not before the finest one fails to
        # resolve it.
        lost = ~found if self._halvings < MAX_HALVINGS else np.zeros_like(found)
        lost |= rough if self._halvings == 0 else False
        lost &= ~controls.collapsed
        if np.any(lost) and self.strict:
            first = int(np.argmax(lost))
            raise self._not_found(int(number[first]), controls, float(reached[first]))
        paths[lost | controls.collapsed] = np.nan
        again = np.flatnonzero((rough | ~found) & ~(lost | controls.collapsed))
        if again.size:
            base = self._finer._unloaded(controls[again])
            fine = np.where(found[again, None, None], _halved(paths[again]), base)
            self._finer._solve(controls[again], fine, base, number[again])
            paths[again] = fine[:, ::2]

    def _rods(self, controls: Controls) -> tuple[np.ndarray, ...]:
        """Arguments that kernels for loaded rods share."""
        return controls.mean, self._points, self._widths, controls.strain, self._segment

    def _not_found(self, index: int, controls: Controls, reached: float) -> StaticsError:
        count = math.prod(controls.batch)
        which = f"shape {index + 1} of {count}: " if count > 1 else ""
        message = (
            f"no equilibrium found beyond {100 * reached:.1f} % of the load; the trunk may bend "
            "too sharply, coil, buckle or be compressed to nothing. Reduce the load or activation."
            if reached < 1
            else f"the shape bends too sharply for {self._widths.size} steps; reduce the load, or "
            "use more steps."
        )
        return StaticsError(which + message, reached)

    def _slopes(self, controls: Controls, paths: np.ndarray) -> np.ndarray:
        """Derivatives (B, n, 6, muscles + 2) of r and d_3."""
        B, n, S = len(paths), self.Z.size, self.trunk.segments
        base = np.zeros((B, 2, RATES))
        r0, q0 = base_slopes(self.trunk.head, controls.head)
        base[..., ORIENTATION], base[..., POSITION] = q0.swapaxes(-1, -2), r0.swapaxes(-1, -2)
        T, gap = np.empty((B, 2 + S, n, 4, RATES)), np.empty(B)

        def work(part: slice) -> None:
            rods = self._rods(controls[part])
            self._kernels.tangent_paths(paths[part], *rods, base[part], T[part], gap[part])

        self._share(work, B)
        columns = T.transpose(0, 2, 4, 1, 3).reshape(B, n, RATES, 4 * (2 + S))
        # m(0) follows the other parameters so that m(L) stays zero.
        by_moment, others = columns[..., :3], columns[..., 3:]
        at_tip = np.linalg.solve(by_moment[:, -1, MOMENT], others[:, -1, MOMENT])
        total = others - by_moment @ at_tip[:, None]
        d3 = tangent_slope(paths[..., ORIENTATION]) @ total[..., ORIENTATION, :]
        slopes: np.ndarray = np.concatenate([total[..., POSITION, :], d3], -2) @ self._by_controls
        # Shapes that were solved with halved steps do not fit these: their slopes need those, too.
        bad = np.flatnonzero(gap > 10 * MAX_DEFECT)
        if bad.size and self._halvings:
            activation, head = controls.activation[bad], controls.head[bad]
            near = PointShapes(self._finer.Z, _halved(paths[bad]))
            finer = self._finer(activation, head, near)
            slopes[bad] = np.concatenate(self._finer.jacobian(finer, activation, head), -2)[:, ::2]
        return slopes

    @cached_property
    def _by_controls(self) -> np.ndarray:
        """Derivative of the tangents' parameters by activations and head, (5 + 4 S, muscles + 2).

        In the order of `shooting_kernels.tangent_paths`: mean extension, head angles, two zeros,
        strains.
        """
        A = strain_matrix(self.trunk)
        S, muscles = A.shape[0], A.shape[2]
        slopes = np.zeros((5 + 4 * S, muscles + 2))
        slopes[0, :muscles] = segment_fractions(self.trunk) @ A[:, 0]
        slopes[1:3, muscles:] = np.eye(2)
        slopes[5:, :muscles] = A.reshape(4 * S, muscles)
        return slopes

    def _shapes(self, paths: np.ndarray, batch: tuple[int, ...]) -> PointShapes:
        return PointShapes(self.Z, paths.reshape(*batch, *paths.shape[1:]))

    def _share(self, work: Callable[[slice], None], count: int) -> None:
        """Do the work for a batch, split among threads."""
        parts = min(self.threads, count)
        if parts <= 1:
            work(slice(None))
            return
        bounds = np.linspace(0, count, parts + 1).astype(int)
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(work, [slice(a, b) for a, b in itertools.pairwise(bounds)]))


def _halved(paths: np.ndarray) -> np.ndarray:
    """Guess of paths (B, 2 n - 1, 10) for halved steps: the mean of neighbors in between."""
    fine = np.empty((len(paths), 2 * paths.shape[1] - 1, paths.shape[2]))
    fine[:, ::2] = paths
    fine[:, 1::2] = (paths[:, 1:] + paths[:, :-1]) / 2
    return fine


def _kernels() -> ModuleType:
    try:
        from . import shooting_kernels
    except ModuleNotFoundError as error:
        raise TrunkError(
            "ShapeMap needs numba, which is not installed: pip install numba. "
            "solve_statics works without it."
        ) from error
    return shooting_kernels
