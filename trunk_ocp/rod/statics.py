"""The forward problem: the equilibrium shape of an activated, loaded trunk.

Newton's method on the collocation equations of `collocation`, for one shape or many at
once. Each element is condensed onto the state at its left edge; chained from base to tip that
leaves the three components of m(0), fixed by m(L) = 0. Where rounding errors would grow on that
way, `block_gaps` solves for the states at all edges together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from .._support.arguments import check_arguments, real_array
from .._support.deferred_signals import deferred_interrupts
from ..errors import InputError, StaticsError
from ..model.activation import mean_extension, segment_at, stiffness, strains
from ..model.anatomy import Trunk, check_activation
from ..model.head import base_pose
from ..model.loads import Loads
from ..model.quaternions import directors
from .block_gaps import close_gaps
from .collocation import Mesh, gauss, mesh_for
from .equations import STATES, point_parameters, rates
from .refining import followed, resampled, settled
from .unloaded import unloaded_states

MAX_ITERATIONS = 30
FULL_TURN = 2 * np.pi  # larger head angles are most likely in degrees
TOLERANCE = 1e-7  # on the last Newton step, relative; the error after it is its square
MESHES = (6, 12, 24, 48)  # elements of the default mesh, the first that resolves the shape
DEFECT = 1e-5  # with which a shape counts as resolved; see Shape.defect
MOST_GROWTH = 1e4  # of rounding errors from base to tip; some 200 on the elephant's trunk
UNRESOLVED = 0.95  # defect of a shape whose frames have shrunk to nothing, which no rod has


@dataclass(frozen=True, repr=False, eq=False)
class Shape:
    """Equilibrium shapes of a trunk, with any leading batch axes (...).

    Positions are in m and space axes, moments in N m and in the directors.
    """

    trunk: Trunk
    mesh: Mesh
    states: np.ndarray
    """(..., elements, degree + 1, 7): q and m at each element's left edge and Gauss points."""
    edges: np.ndarray
    """(..., elements + 1, 3): centerline at the element edges."""
    slopes: np.ndarray
    """(..., elements, degree, 3): dr/dZ at the Gauss points."""

    def __repr__(self) -> str:
        batch = self.states.shape[:-3]
        return f"<Shape of {self.trunk.name}: batch {batch}, {self.mesh.elements} elements>"

    def __getitem__(self, index: int | slice | tuple[int, ...] | np.ndarray) -> Shape:
        """Some shapes of a batch, by its first axis."""
        return replace(
            self, states=self.states[index], edges=self.edges[index], slopes=self.slopes[index]
        )

    def position(self, Z: np.ndarray) -> np.ndarray:
        """Centerline r(Z), (..., n, 3) m, at points Z (n,) in m."""
        element, tau = self._locate(Z)
        weights = gauss(self.mesh.degree).integral(tau) * self.mesh.widths[element, None]
        inside = np.einsum("nd,...ndc->...nc", weights, self.slopes[..., element, :, :])
        return self.edges[..., element, :] + inside

    def directors(self, Z: np.ndarray) -> np.ndarray:
        """Directors, (..., n, 3, 3): row i is d_i in space axes."""
        q = self.state(Z)[..., :4]
        q = q / np.linalg.norm(q, axis=-1, keepdims=True)
        rows = directors(tuple(np.moveaxis(q, -1, 0)))
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def moment(self, Z: np.ndarray) -> np.ndarray:
        """Internal moment m(Z), (..., n, 3) N m, in the directors."""
        return self.state(Z)[..., 4:]

    def state(self, Z: np.ndarray) -> np.ndarray:
        """State (q, m) at points Z, (..., n, 7); |q| = 1 to collocation accuracy."""
        element, tau = self._locate(Z)
        weights = gauss(self.mesh.degree).value(tau)
        return np.einsum("nd,...ndx->...nx", weights, self.states[..., element, :, :])

    @property
    def defect(self) -> np.ndarray:
        """Largest | |q|^2 - 1 | at the Gauss points, (...,): how well the mesh resolves the shape.

        Collocation keeps |q| at element edges exactly and inside to its own accuracy, so this
        costs nothing and estimates the error: for this trunk, positions are off by about
        0.02 to 2 times as much (in m) on every mesh and load tried.
        """
        norms = np.sum(self.states[..., :4] ** 2, axis=-1)
        return np.asarray(np.abs(norms - 1).max(axis=(-1, -2)))

    @property
    def extension(self) -> np.ndarray:
        """Loaded extension zeta, (..., elements, degree): dr/dZ . d_3 at the Gauss points."""
        return _extension(self.states[..., 1:, :4], self.slopes)

    def on(self, mesh: Mesh) -> Shape:
        """The same shapes on another mesh, with the same state and centerline at its points."""
        starts = np.asarray(mesh.edges[:-1])[:, None]
        points = np.hstack([starts, mesh.points])
        element, tau = self._locate(mesh.points.ravel())
        weights = gauss(self.mesh.degree).from_nodes(tau)
        slopes = np.einsum("nd,...ndc->...nc", weights, self.slopes[..., element, :, :])
        batch = self.states.shape[:-3]
        return Shape(
            self.trunk,
            mesh,
            self.state(points.ravel()).reshape(*batch, *points.shape, STATES),
            self.position(np.asarray(mesh.edges)),
            slopes.reshape(*batch, *mesh.points.shape, 3),
        )

    def _locate(self, Z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = np.atleast_1d(real_array(Z, "Z"))
        if points.ndim != 1:
            raise InputError(f"Z = {Z!r}: expected points of the trunk in m, one number or (n,).")
        return self.mesh.locate(points_on(self.trunk, points))


def points_on(trunk: Trunk, Z: np.ndarray) -> np.ndarray:
    """Points Z (n,) of a trunk in m; rounding errors beyond its ends are cut off.

    Raises
    ------
    InputError
        For a point that is not on the trunk, or no number.
    """
    Z = trunk.clipped(Z)
    outside = Z[~((Z >= 0) & (Z <= trunk.length))]
    if outside.size:
        raise InputError(f"Z = {outside[0]:.12g}: expected 0 <= Z <= L = {trunk.length:.12g} m.")
    return Z


@check_arguments
@deferred_interrupts()
def solve_statics(
    trunk: Trunk,
    activation: np.ndarray,
    head: np.ndarray | tuple[float, float] = (0.0, 0.0),
    loads: Loads | Sequence[Loads] | None = None,
    mesh: Mesh | None = None,
    near: Shape | None = None,
) -> Shape:
    """Equilibrium shape under activation and loads (eqs. 14, 15).

    Starts from the unloaded shape, which is known in closed form. Where Newton's method
    does not get from there to the full load, the load is raised in steps. Of several equilibria,
    as there may be under heavy loads, `near` says which; see `stability`.

    Parameters
    ----------
    activation : (..., muscles)
        Negative values contract. Leading axes make a batch.
    head : (..., 2)
        psi_Z, psi_Y in radians.
    loads : Loads or one for each shape of the batch
        Default: weight alone.
    mesh : Mesh, optional
        Default: `mesh_for(trunk, contact_from)`, refined until `Shape.defect` is below 1e-5,
        in the end only where the shape needs it.
    near : Shape, optional
        One for each of the batch, to start from; its mesh is used.

    Raises
    ------
    InputError
        For wrong shapes, an activation that collapses a segment, or mixed contact regions.
    StaticsError
        If no equilibrium is found, or none that the finest default mesh resolves; if the loads
        compress the trunk to nothing, zeta <= 0. Names the load fraction reached.
    """
    activation, head = check_controls(trunk, activation, head)
    every = [loads or Loads()] if isinstance(loads, Loads | None) else list(loads)
    batch = _batch(activation.shape[:-1], head.shape[:-1], len(every))
    contacts = {load.contact_from for load in every}
    if near is not None:
        mesh = near.mesh
        if near.states.shape[:-3] != batch:
            raise InputError(f"near: expected shapes {batch}, got {near.states.shape[:-3]}.")
    if mesh is None and len(contacts) > 1:
        raise InputError("loads: a batch must share one contact_from, or bring its own mesh.")
    activation = np.broadcast_to(activation, (*batch, activation.shape[-1]))
    head = np.broadcast_to(head, (*batch, 2))
    if mesh is not None:
        check_mesh(mesh, trunk, every)
        return _solve_on(mesh, trunk, activation, head, every, near)
    for elements in MESHES:
        mesh = mesh_for(trunk, every[0].contact_from, elements)
        problem = _Problem.of(mesh, trunk, activation, head, every)
        states, errors = problem.solve(problem.unloaded())
        shape = problem.shape(states, batch)
        if np.all(shape.defect <= DEFECT):
            return shape
        if errors:
            break
    return _refined(problem, states, batch)


def refined(shape: Shape, activation: np.ndarray, head: np.ndarray, loads: Loads) -> Shape:
    """The equilibrium of one rod again, on a mesh that is halved until it resolves the shape.

    Raises
    ------
    StaticsError
        If no such mesh is found.
    """
    problem = _Problem(shape.trunk, shape.mesh, activation[None], head[None], [loads])
    found = settled(problem, shape.states[None], DEFECT)
    if not isinstance(found[0], Mesh):
        raise StaticsError("; ".join(found), 1.0)
    return replace(problem, mesh=found[0]).shape(found[1], ())


def check_controls(
    trunk: Trunk,
    activation: np.ndarray,
    head: np.ndarray | tuple[float, float],
    collapsed: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Activations (..., muscles) and head angles (..., 2) as float arrays.

    collapsed : whether activations that collapse a segment may pass.

    Raises
    ------
    InputError
        For wrong shapes, values that are not finite, or an activation that collapses a segment.
    """
    activation = check_activation(trunk, activation)
    head = real_array(head, "head")
    if head.shape[-1:] != (2,) or not np.all(np.isfinite(head)):
        raise InputError("head: expected finite angles (psi_Z, psi_Y), shape (..., 2).")
    if np.abs(head).max(initial=0.0) > FULL_TURN:
        raise InputError(f"head: expected radians, got {np.abs(head).max():g}; is that in degrees?")
    zeta = strains(trunk, activation)[..., 0]
    if np.any(zeta <= 0) and not collapsed:
        worst = np.unravel_index(np.argmin(zeta), zeta.shape)[:-1]
        which = f"[{', '.join(map(str, worst))}]" if worst else ""
        raise InputError(
            f"activation{which}: contracts a segment to {zeta.min():.3g} of its length; "
            "the extension must stay above 0."
        )
    return activation, head


def _solve_on(
    mesh: Mesh,
    trunk: Trunk,
    activation: np.ndarray,
    head: np.ndarray,
    loads: list[Loads],
    near: Shape | None = None,
) -> Shape:
    """Shapes of checked arguments, activation (..., muscles) and head (..., 2), on a mesh."""
    problem = _Problem.of(mesh, trunk, activation, head, loads)
    start = problem.unloaded()
    if near is not None:
        base = start[:, 0, 0, :4].copy()  # Newton leaves the base where the head has it
        start = near.states.reshape(start.shape).copy()
        start[:, 0, 0, :4] = base
    states, errors = problem.solve(start)
    for index, error in errors.items():
        raise problem.named(error, index)
    shape = problem.shape(states, activation.shape[:-1])
    if np.any(shape.defect > UNRESOLVED):
        raise StaticsError(
            f"the shape bends too sharply for the {mesh.elements} elements of its mesh; reduce the "
            "load, or bring a finer mesh.",
            1.0,
        )
    return shape


def _refined(problem: _Problem, states: np.ndarray, batch: tuple[int, ...]) -> Shape:
    """Shapes on one mesh, finer where some rod needs it; from states (B, ...), NaN if not found."""
    mesh, found = problem.mesh, {}
    norms = np.sum(states[..., :4] ** 2, axis=-1)
    for index in np.flatnonzero(~(np.abs(norms - 1).max(axis=(1, 2)) <= DEFECT)).tolist():
        try:
            found[index] = followed(problem.only(index), DEFECT)
        except StaticsError as error:
            raise problem.named(error, index) from None
    edges = np.unique(np.concatenate([mesh.edges, *(own.edges for own, _ in found.values())]))
    finer = Mesh(tuple(edges.tolist()), mesh.degree)
    start = resampled(states, mesh, finer)
    for index, (own, its) in found.items():
        start[index] = resampled(its, own, finer)[0]
    problem = replace(problem, mesh=finer)
    states, errors = problem.solve(start)
    for index, lost in errors.items():
        raise problem.named(lost, index)
    return problem.shape(states, batch)


def _batch(activation: tuple[int, ...], head: tuple[int, ...], loads: int) -> tuple[int, ...]:
    """Leading axes of the result, the loads along the last of them."""
    try:
        batch = np.broadcast_shapes(activation, head, () if loads == 1 else (loads,))
    except ValueError:
        batch = (0,)
    if loads == 0 or 0 in batch or (loads > 1 and batch[-1] != loads):
        raise InputError(
            f"activation, head and loads: expected leading axes that match, got {activation} "
            f"and {head} with {loads} loads."
        )
    return batch


def check_mesh(mesh: Mesh, trunk: Trunk, loads: Sequence[Loads]) -> None:
    """Raise InputError unless a mesh covers the trunk, with an edge on every jump."""
    jumps = {*trunk.edges} | {x.contact_from for x in loads if x.contact_from is not None}
    ends = (mesh.edges[0], mesh.edges[-1])
    grows = bool(np.all(mesh.widths > 0))
    if not grows or ends != (0.0, trunk.length) or not jumps <= {*mesh.edges}:
        raise InputError(
            f"mesh: expected edges from 0 to {trunk.length:g} m, with one on every segment end and "
            "start of contact; mesh_for makes such a mesh."
        )


def shape_of_states(
    trunk: Trunk, mesh: Mesh, x: np.ndarray, loads: Sequence[Loads], states: np.ndarray
) -> Shape:
    """Shapes (H,) from states already known, such as those of an optimal plan.

    x : (H, muscles + 2), activations and head angles; states : (H, elements, degree + 1, 7).
    """
    problem = _Problem(trunk, mesh, x[:, :-2], x[:, -2:], list(loads))
    return problem.shape(states, (len(x),))


def unloaded_shape(trunk: Trunk, mesh: Mesh, x: np.ndarray, loads: Sequence[Loads]) -> Shape:
    """Shapes (H,) without loads in closed form, where no equation need be solved; x (H, ...)."""
    none = [load.scaled(0.0) for load in loads]
    problem = _Problem(trunk, mesh, x[:, :-2], x[:, -2:], none)
    return problem.shape(problem.unloaded(), (len(x),))


@dataclass(frozen=True, eq=False)
class _Problem:
    """A batch of B rods: activation (B, muscles), head (B, 2), one load each."""

    trunk: Trunk
    mesh: Mesh
    activation: np.ndarray
    head: np.ndarray
    loads: list[Loads]

    @classmethod
    def of(
        cls, mesh: Mesh, trunk: Trunk, activation: np.ndarray, head: np.ndarray, loads: list[Loads]
    ) -> _Problem:
        """Rods with checked arguments (..., muscles) and (..., 2), their axes made one."""
        count = int(np.prod(activation.shape[:-1]))
        loads = loads * (count // len(loads))
        return cls(trunk, mesh, activation.reshape(count, -1), head.reshape(count, 2), loads)

    def named(self, error: StaticsError, index: int) -> StaticsError:
        """An error that says which rod of the batch it is about."""
        count = len(self.loads)
        which = f"shape {index + 1} of {count}: " if count > 1 else ""
        return StaticsError(f"{which}{error}", error.load_fraction)

    def only(self, index: int) -> _Problem:
        """The problem of one rod of the batch."""
        one = slice(index, index + 1)
        return replace(
            self, activation=self.activation[one], head=self.head[one], loads=self.loads[one]
        )

    def unloaded(self) -> np.ndarray:
        """Unloaded states (B, elements, degree + 1, 7): the start of Newton's method."""
        points = np.hstack([np.asarray(self.mesh.edges[:-1])[:, None], self.mesh.points])
        _, q = unloaded_states(self.trunk, self.activation, self.head, points.ravel())
        states = np.zeros((len(self.loads), *points.shape, STATES))
        states[..., :4] = q.reshape(*states.shape[:-1], 4)
        return states

    def inputs(self) -> tuple[np.ndarray, np.ndarray]:
        """What `rates` needs besides the states: (8, B, E, d) of w and (11, B, E, d) of p."""
        strain = strains(self.trunk, self.activation)
        B, E, d = len(self.loads), self.mesh.elements, self.mesh.degree
        w = np.empty((8, B, E, d))
        of_element = segment_at(self.trunk, self.mesh.points[:, 0])
        w[:4] = np.moveaxis(strain[:, of_element, :], -1, 0)[..., None]
        w[4] = mean_extension(self.trunk, strain)[:, None, None]
        tip = np.array([load.tip_force for load in self.loads]).reshape(B, 3)
        w[5:] = tip.T[:, :, None, None]
        known: dict[Loads, np.ndarray] = {}
        for load in self.loads:
            if load not in known:
                known[load] = point_parameters(self.trunk, load, self.mesh.points.ravel())
        p = np.empty((11, B, E, d))
        for i, load in enumerate(self.loads):
            p[:, i] = known[load].reshape(11, E, d)
        return w, p

    def solve(self, start: np.ndarray) -> tuple[np.ndarray, dict[int, StaticsError]]:
        """States from guesses, or else by raising the load; NaN and an error where not found."""
        states, converged = self.newton(start)
        errors: dict[int, StaticsError] = {}
        for index in np.flatnonzero(~converged | self.squeezed(states)).tolist():
            try:
                states[index] = self.only(index).continuation()
            except StaticsError as error:
                states[index], errors[index] = np.nan, error
        return states, errors

    def squeezed(self, states: np.ndarray) -> np.ndarray:
        """Whether the loaded extension is not above zero somewhere, (B,)."""
        w, p = self.inputs()
        with np.errstate(all="ignore"):
            (rate,) = _evaluate(rates(), states[..., 1:, :], w, p)
            zeta = _extension(states[..., 1:, :4], rate[..., STATES:])
            ends = np.einsum("ij,bkj->bki", gauss(self.mesh.degree).from_nodes(_ENDS), zeta)
        return np.asarray(np.any(zeta <= 0, axis=(1, 2)) | np.any(ends <= 0, axis=(1, 2)))

    def newton(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Newton's method on all rods together: states and which of them converged (B,)."""
        w, p = self.inputs()
        states = states.copy()
        active = np.arange(len(self.loads))
        converged = np.zeros(len(self.loads), dtype=bool)
        floor = 1e-3 * stiffness(self.trunk, 0.0)[1] / self.trunk.length  # N m, for tiny loads
        with np.errstate(all="ignore"):  # a rod that diverges is dropped, not reported
            for _ in range(MAX_ITERATIONS):
                change = self._step(states[active], w[:, active], p[:, active])
                states[active] += change
                size = np.abs(change).max(axis=(1, 2, 3), initial=0.0, where=_IS_Q)
                moment = np.abs(states[active][..., 4:]).max(axis=(1, 2, 3)) + floor
                size = np.maximum(size, np.abs(change[..., 4:]).max(axis=(1, 2, 3)) / moment)
                converged[active[size < TOLERANCE]] = True
                active = active[(size >= TOLERANCE) & (size < 1e6)]  # NaN drops out as well
                if not active.size:
                    break
        return states, converged

    def _step(self, states: np.ndarray, w: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Newton step for states (B, E, d + 1, 7)."""
        B, E, n, d = (*states.shape[:2], self.mesh.degree * STATES, self.mesh.degree)
        element, h = gauss(d), self.mesh.widths
        rate, slope = _evaluate(_rates_and_slope(), states[..., 1:, :], w, p)
        slope = slope.reshape(B, E, d, STATES, STATES)
        residual = (
            np.einsum("ij,...jx->...ix", element.derivative, states)
            - h[:, None, None] * (rate[..., :STATES])
        )
        # Element matrix d(residual)/d(values at the Gauss points), (B, E, d, 7, d, 7).
        matrix = np.zeros((B, E, d, STATES, d, STATES))
        same = np.arange(STATES)
        matrix[:, :, :, same, :, same] = element.derivative[:, 1:]
        for j in range(d):
            matrix[:, :, j, :, j, :] -= h[:, None, None] * slope[:, :, j]
        right = np.zeros((B, E, d, STATES, 1 + STATES))
        right[..., 0] = -residual
        right[..., same, 1 + same] = -element.derivative[:, 0][:, None]
        inner = _solve(matrix.reshape(B, E, n, n), right.reshape(B, E, n, -1))
        inner = inner.reshape(B, E, d, STATES, 1 + STATES)
        return self._chain(states, inner)

    def _chain(self, states: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """Assemble the step from each element's response to its left edge (columns 1:)."""
        edge, growth = self._marched(states, inner)
        steep = np.flatnonzero(~(growth <= MOST_GROWTH))
        if steep.size:
            edge[steep] = self._closed(states[steep], inner[steep])
        step = np.empty_like(states)
        step[:, :, 0] = edge
        step[:, :, 1:] = inner[..., 0] + np.einsum("bkjxc,bkc->bkjx", inner[..., 1:], edge)
        return step

    def _marched(self, states: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps (B, E, 7) at the left edges, marching from base to tip, and the growth of errors.

        That is the largest derivative (B,) of a state by m(0), in `edge_units`: rounding errors of
        m(0) grow by as much on their way.
        """
        B, E = states.shape[:2]
        at_end = gauss(self.mesh.degree).value(1.0)
        # Step at each left edge as offset + (7, 3) matrix times the unknown change of m(0).
        left = np.zeros((B, E + 1, STATES, 4))
        left[:, 0, 4:, 1:] = np.eye(3)
        for k in range(E):
            response = np.einsum("j,bjxc->bxc", at_end[1:], inner[:, k])
            response[..., 1:] += at_end[0] * np.eye(STATES)
            left[:, k + 1] = response[..., 1:] @ left[:, k]
            left[:, k + 1, :, 0] += response[..., 0]
            if k + 1 < E:  # close any gap between this element's end and the next one's start
                end = np.einsum("j,bjx->bx", at_end, states[:, k])
                left[:, k + 1, :, 0] += end - states[:, k + 1, 0]
        tip = np.einsum("j,bjx->bx", at_end, states[:, -1])[:, 4:]
        dm0 = _solve(left[:, -1, 4:, 1:], -(tip + left[:, -1, 4:, 0])[..., None])
        edge = left[:, :-1, :, 0] + (left[:, :-1, :, 1:] @ dm0[:, None])[..., 0]
        unit = edge_units(self.trunk, self.mesh)
        growth = np.abs(left[..., 1:] * (unit[0, 4:] / unit[:, :, None])).max(axis=(1, 2, 3))
        return edge, growth

    def _closed(self, states: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """Steps (B, E, 7) at the left edges, all equations at once: slower, good anywhere."""
        at_end = gauss(self.mesh.degree).value(1.0)
        response = np.einsum("j,bkjxc->bkxc", at_end[1:], inner)
        response[..., 1:] += at_end[0] * np.eye(STATES)
        ends = np.einsum("j,bkjx->bkx", at_end, states)
        gaps = response[..., 0]
        gaps[:, :-1] += ends[:, :-1] - states[:, 1:, 0]  # this element's end, the next one's start
        gaps[:, -1, 4:] += ends[:, -1, 4:]  # m(L) vanishes after the step
        unit = edge_units(self.trunk, self.mesh)
        maps = response[..., 1:] * unit[:-1, None] / unit[1:, :, None]
        return close_gaps(maps, (gaps / unit[1:])[..., None])[:, :-1, :, 0] * unit[:-1]

    def continuation(self) -> np.ndarray:
        """States of the single rod of this problem, its load raised from zero in steps."""
        return followed(self)[1][0]

    def shape(self, states: np.ndarray, batch: tuple[int, ...]) -> Shape:
        """Shape with the centerline integrated from the base."""
        w, p = self.inputs()
        (rate,) = _evaluate(rates(), states[..., 1:, :], w, p)
        slopes = rate[..., STATES:]
        over = gauss(self.mesh.degree).integral(1.0)
        steps = np.einsum("d,bkdc->bkc", over, slopes) * self.mesh.widths[:, None]
        r0, _ = base_pose(self.trunk.head, self.head[:, 0], self.head[:, 1])
        edges = np.concatenate([np.stack(r0, axis=-1)[:, None], steps], axis=1).cumsum(axis=1)
        return Shape(
            self.trunk,
            self.mesh,
            states.reshape(*batch, *states.shape[1:]),
            edges.reshape(*batch, *edges.shape[1:]),
            slopes.reshape(*batch, *slopes.shape[1:]),
        )


def edge_units(trunk: Trunk, mesh: Mesh) -> np.ndarray:
    """Units (elements + 1, 7) of states at the edges: 1 and E I(Z) / L, for pivots to compare."""
    unit = np.ones((mesh.elements + 1, STATES))
    unit[:, 4:] = stiffness(trunk, np.asarray(mesh.edges))[:, 1:2] / trunk.length
    return unit


_IS_Q = np.arange(STATES) < 4
_ENDS = np.array([0.0, 1.0])


def _extension(q: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Extension (...) of a rod with dr/dZ (..., 3) along d_3 of quaternions (..., 4)."""
    d3 = np.stack(directors(tuple(np.moveaxis(q, -1, 0)))[2], axis=-1)
    norm = np.sum(d3**2, axis=-1)  # not quite 1 between the edges of elements
    return np.asarray(np.sum(slope * d3, axis=-1) / norm)


def _solve(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve the systems of every rod (axis 0); NaN for those that are singular."""
    try:
        return np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate(
            [_solve(matrices[i : i + 1], right[i : i + 1]) for i in range(len(right))]
        )


@cache
def _rates_and_slope() -> ca.Function:
    """`rates` with the Jacobian of (q', m') by the state, both as columns."""
    w, p = ca.SX.sym("w", 15), ca.SX.sym("p", 11)
    value = rates()(w, p)
    slope = ca.jacobian(value[:STATES], w)[:, :STATES]
    return ca.Function("rates_and_slope", [w, p], [value, ca.vec(ca.densify(slope.T))])


def _evaluate(
    function: ca.Function, states: np.ndarray, w: np.ndarray, p: np.ndarray
) -> list[np.ndarray]:
    """Outputs (B, E, d, ...) of a function like `rates` at Gauss-point states (B, E, d, 7)."""
    where = states.shape[:3]
    columns = np.concatenate([np.moveaxis(states, -1, 0), w]).reshape(15, -1)
    sizes = [function.size1_out(i) for i in range(function.n_out())]
    if not states.size:
        return [np.zeros((*where, size)) for size in sizes]
    values = function.call([columns, p.reshape(11, -1)])
    return [np.asarray(value).T.reshape(*where, -1) for value in values]
