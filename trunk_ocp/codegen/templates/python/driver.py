"""Shape of a muscular trunk under load, with exact derivatives, using only NumPy.

<about>

    x = pack(activation, head=(0.1, 0.0), gravity=9.8)
    y = loaded(x)                   # (n, 19)
    y, J = jacobian(x)              # (n, 19), (n, 19, x.size)
    split(y)["position"]            # (n, 3)

All arrays may have leading axes: many shapes in one call are much faster than one call each. A
complex x gives complex results, so derivatives can be checked by complex steps.

How it works. Along the trunk the orientation q (a quaternion), the internal moment M (in space
axes) and the position r follow y' = rates(y, Z), collocated at the Gauss points of each element.
Each Newton step solves a linear problem of this kind for the new values (`spread`). By the implicit
function theorem, derivatives of the shape solve linear problems with the same matrix. This file has
the numbers of the trunk, then the program, then its kernels: rates and their slopes as plain
assignments.
"""

import numpy as np

# <cut>
from tables import (
    DEFAULTS,
    EDGE,
    EDGE_FORCE,
    EDGE_SECTION,
    ENDS,
    FORCE,
    FRACTIONS,
    INPUTS,
    OUTPUTS,
    SECTION,
    SEGMENT,
    STRAIN,
    WEIGHTS,
    WIDTHS,
    A,
    base_slopes,
    rates_slopes,
    report_slopes,
)

# </cut>
MAX_STEPS = 30  # of Newton's method
STEP_TOL = 1e-9  # size of the last step; the error after it is about its square
MIN_LOAD_STEP = 1e-4
MAX_DEFECT = 1e-5  # largest | |q|^2 - 1 | of a resolved shape: an error of 1e-6 of its length
BATCH = 128  # shapes solved together, to bound memory
Q, M, R = slice(0, 4), slice(4, 7), slice(7, 10)  # rows of a state


class NoShape(ArithmeticError):  # noqa: N818
    """No equilibrium was found: `index` of the shape, and `fraction` of the load that was reached.

    With a fraction of 1 there is one, but it bends too sharply for the elements of this export.
    """

    def __init__(self, index: tuple[int, ...], fraction: float) -> None:
        what = f"no equilibrium beyond {fraction:.4g} of the load; reduce the load."
        coarse = "bends too sharply for its elements; reduce the load, or export with --elements."
        super().__init__(f"shape {index}: {what if fraction < 1 else coarse}")
        self.index, self.fraction = index, fraction


def pack(activation: np.ndarray, head: np.ndarray = (0.0, 0.0), **loads: np.ndarray) -> np.ndarray:
    """Vectors x (..., size) from their parts (..., size of the part).

    `head` is in rad; omitted loads have the values of the export.
    """
    values = {"activation": activation, "head": head} | loads
    unknown = values.keys() - INPUTS.keys()
    if unknown:
        raise ValueError(f"{min(unknown)}: expected one of {', '.join(INPUTS)}.")
    parts = []
    for name, where in INPUTS.items():
        part, size = np.asarray(values.get(name, DEFAULTS.get(name))), where.stop - where.start
        part = part[..., None] if size == 1 and part.shape[-1:] != (1,) else part
        if part.shape[-1:] != (size,):
            raise ValueError(f"{name}: expected {size} numbers, got shape {part.shape}.")
        parts.append(part)
    batch = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
    return np.concatenate([np.broadcast_to(p, (*batch, p.shape[-1])) for p in parts], axis=-1)


def split(y: np.ndarray) -> dict[str, np.ndarray]:
    """Named parts of y (..., n, 19 or 16): directors are (..., n, 3, 3), row i is d_i."""
    parts = {name: y[..., at] for name, at in OUTPUTS.items() if at.stop <= y.shape[-1]}
    return parts | {"directors": parts["directors"].reshape(*y.shape[:-1], 3, 3)}


def loaded(x: np.ndarray) -> np.ndarray:
    """Equilibrium shapes y (..., n, 19) under load.

    Raises
    ------
    ValueError
        If x has a wrong length or non-finite numbers, or shortens a segment to zero length.
    NoShape
        If no equilibrium is found.
    """
    return _in_parts(lambda part: (_shape(part, _solve(part)),), x)[0]


def jacobian(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shapes y (..., n, 19) and their derivatives dy/dx (..., n, 19, size); errors as `loaded`."""
    return _in_parts(_jacobian, x)


def _in_parts(function, *inputs):
    """Apply a function of (B, size) arrays to any leading axes, in batches."""
    inputs = np.broadcast_arrays(*(_checked(x) for x in inputs))
    batch, size = inputs[0].shape[:-1], inputs[0].shape[-1]
    flat = [x.reshape(-1, size) for x in inputs]
    results = []
    for first in range(0, max(len(flat[0]), 1), BATCH):
        try:
            results.append(function(*(x[first : first + BATCH] for x in flat)))
        except NoShape as error:
            where = np.unravel_index(first + error.index[0], batch) if batch else ()
            raise NoShape(tuple(map(int, where)), error.fraction) from None
    joined = [np.concatenate(parts) for parts in zip(*results, strict=True)]
    return tuple(part.reshape(*batch, *part.shape[1:]) for part in joined)


def _checked(x):
    x, size = np.asarray(x), max(part.stop for part in INPUTS.values())
    x = x if np.iscomplexobj(x) else x.astype(float)
    if x.shape[-1:] != (size,):
        raise ValueError(f"x: expected shape (..., {size}), got {x.shape}.")
    if not np.all(np.isfinite(x)):
        raise ValueError("x: expected finite numbers.")
    return x


def _known_part(strain, force, shape):
    """Quantities linear in x, zeta_hat, c, mean extension, N, l: constant (11), slopes (11, size).

    strain (..., 4, muscles); force (..., 3): mass, share of contact force, density of couple.
    """
    size = max(part.stop for part in INPUTS.values())
    slopes = np.zeros((*shape, 11, size))
    slopes[..., 0:4, INPUTS["activation"]] = strain
    slopes[..., 4, INPUTS["activation"]] = FRACTIONS @ STRAIN[:, 0]
    slopes[..., 7, INPUTS["gravity"]] = force[..., :1]  # weight acts along e_Z
    slopes[..., 5:8, INPUTS["tip_force"]] = np.eye(3)
    if "contact_force" in INPUTS:
        slopes[..., 5:8, INPUTS["contact_force"]] = force[..., 1, None, None] * np.eye(3)
        slopes[..., 8:11, INPUTS["contact_couple"]] = force[..., 2, None, None] * np.eye(3)
    return np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]), slopes


CONSTANT, KNOWN = _known_part(STRAIN[SEGMENT][:, None], FORCE, SECTION.shape[:2])
_, POINT_KNOWN = _known_part(STRAIN[SEGMENT[ENDS]], EDGE_FORCE[EDGE], (len(EDGE),))
POINT_KNOWN = POINT_KNOWN[:, :8]  # l does not enter a report


def _solve(x):
    """States at the Gauss points (B, E, d, 7) and the edges (B, E + 1, 10) for x (B, size)."""
    if np.any((CONSTANT + np.einsum("edkx,bx->bedk", KNOWN, x))[..., 0].real <= 0):
        raise ValueError("activation: shortens a segment to zero length.")
    start = _unbent(x)
    inside, edges, converged = _newton(x, start)
    for i in np.flatnonzero(~converged):
        inside[i], edges[i] = _raise_load(x[i : i + 1], start[i : i + 1], i)
    defect = np.abs((inside[..., Q] ** 2).sum(axis=-1).real - 1).max(axis=(1, 2), initial=0.0)
    for i in np.flatnonzero(~(defect <= MAX_DEFECT)):
        raise NoShape((int(i),), 1.0)
    return inside, edges


def _loads_times(x, fraction):
    x = x.copy()
    x[:, INPUTS["gravity"].start :] *= fraction
    return x


def _unbent(x):
    """Shapes without loads: M is zero, so the equations are linear and one step solves them."""
    none = np.zeros((len(x), *SECTION.shape[:2], 7), x.dtype)
    none[..., 0] = 1
    return _step(_loads_times(x, 0), none)[0]


def _newton(x, inside):
    """Newton's method on all shapes at once: states, and which of them converged (B,)."""
    B, E = inside.shape[:2]
    inside, edges = inside.copy(), np.zeros((B, E + 1, 10), x.dtype)
    active, converged = np.arange(B), np.zeros(B, bool)
    with np.errstate(all="ignore"):  # shapes that diverge are dropped
        for _ in range(MAX_STEPS):
            if not active.size:
                break
            old = inside[active]
            inside[active], edges[active] = _step(x[active], old)
            change = np.abs(inside[active] - old)
            moment = np.abs(inside[active][..., M]).max(axis=(1, 2, 3)) + 1e-3
            size = np.maximum(
                change[..., Q].max(axis=(1, 2, 3)), change[..., M].max(axis=(1, 2, 3)) / moment
            )
            converged[active[size < STEP_TOL]] = True
            active = active[(size >= STEP_TOL) & (size < 1e6)]  # NaN drops out as well
    return inside, edges, converged


def _raise_load(x, inside, index):
    """One shape (1, ...): raise the load in steps, starting from the shape without loads."""
    reached, ahead, edges = 0.0, 0.25, None
    while reached < 1:
        target = min(1.0, reached + ahead)
        trial, trial_edges, converged = _newton(_loads_times(x, target), inside)
        if converged[0]:
            reached, ahead, inside, edges = target, 2 * ahead, trial, trial_edges
        elif ahead > MIN_LOAD_STEP:
            ahead /= 2
        else:
            raise NoShape((int(index),), reached)
    return inside[0], edges[0]


def _step(x, inside):
    """One Newton step: states that solve the equations linearized at `inside`."""
    _, value, slopes = _rates(x, inside)
    start = _kernel(base_slopes, x[:, INPUTS["head"]], np.empty(0), (7,), (7, 2))[0]
    forcing = value - np.einsum("...ij,...j->...i", slopes[..., :7], inside)
    new, edges = spread(slopes[..., :7], _at_base(start)[..., None], forcing[..., None])
    return new[..., 0], edges[..., 0]


def _rates(x, inside):
    """At the Gauss points: inputs w (B, E, d, 18) of the rates, the rates, and their slopes."""
    known = CONSTANT + np.einsum("edkx,bx->bedk", KNOWN, x)
    w = np.concatenate([inside, known], axis=-1)
    return w, *_kernel(rates_slopes, w, SECTION, (10,), (10, 18))


def _at_base(pose):
    """State (B, 10, ...) at the base from q and r there (B, 7, ...); M there is unknown."""
    return np.concatenate([pose[:, :4], 0 * pose[:, :3], pose[:, 4:]], axis=1)


def spread(slopes, start, forcing):
    """Solve y' = slopes y + forcing along the trunk, y(0) = start, M(0) such that M(L) = 0.

    slopes (B, E, d, 10, 7) by q and M; start (B, 10, K) for K problems at once; forcing
    (B, E, d, 10, K). Returns q, M at the Gauss points (B, E, d, 7, K) and q, M, r at the element
    edges (B, E + 1, 10, K).
    """
    B, E, d, _, K = forcing.shape
    hA = WIDTHS[:, None, None] * A
    # Condense each element: its states from q, M at its start (7 columns) and forcing (K).
    matrix = -hA[:, :, None, :, None] * slopes[..., :7, :].swapaxes(2, 3)[:, :, None]
    matrix[:, :, range(d), :, range(d)] += np.eye(7)
    right = np.empty((B, E, d, 7, 7 + K), matrix.dtype)
    right[..., :7] = np.eye(7)
    right[..., 7:] = np.einsum("eij,bejxk->beixk", hA, forcing[..., :7, :])
    matrix, flat = matrix.reshape(B, E, 7 * d, 7 * d), right.reshape(B, E, 7 * d, 7 + K)
    inside = _solved(matrix, flat).reshape(right.shape)
    rate = slopes @ inside
    rate[..., 7:] += forcing
    change = np.einsum("ej,bejxk->bexk", WIDTHS[:, None] * WEIGHTS, rate)
    # March from base to tip with M(0) unknown: 3 columns for it, then K.
    state = np.concatenate([np.zeros((B, 10, 3)), start], axis=-1)
    state[:, M, :3] = np.eye(3)
    states = [state]
    for e in range(E):
        state = state + change[:, e, :, :7] @ state[:, :7]
        state[..., 3:] += change[:, e, :, 7:]
        states.append(state)
    moment = -_solved(state[:, M, :3], state[:, M, 3:])
    states = np.stack(states, axis=1)
    edges = states[..., 3:] + states[..., :3] @ moment[:, None]
    return inside[..., :7] @ edges[:, :-1, None, :7] + inside[..., 7:], edges


def _solved(matrix, right):
    """Solutions of linear equations (..., m, m); NaN where the matrix is singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        if matrix.ndim == 2:
            return np.full_like(right, np.nan)
        return np.stack([_solved(*pair) for pair in zip(matrix, right, strict=True)])


def _point_states(x, edges):
    """At the points Z: inputs w (B, n, 15) of a report."""
    known = CONSTANT[:8] + np.einsum("nkx,bx->bnk", POINT_KNOWN, x)
    return np.concatenate([edges[:, EDGE, :7], known], axis=-1)


def _shape(x, solution):
    """Outputs y (B, n, 19)."""
    _, edges = solution
    w = _point_states(x, edges)
    report = _kernel(report_slopes, w, EDGE_SECTION[EDGE], (16,), (16, 15))[0]
    return np.concatenate([edges[:, EDGE, R], report], axis=-1)


def _jacobian(x):
    inside, edges = _solve(x)
    J = _first(x, inside, edges)[-1]
    return _shape(x, (inside, edges)), J


def _first(x, inside, edges):
    """Derivatives with respect to x: q, M inside (B, E, d, 7, size), edges, y; slopes first."""
    _, _, slopes = _rates(x, inside)
    start = np.zeros((len(x), 10, x.shape[1]), x.dtype)
    pose = _kernel(base_slopes, x[:, INPUTS["head"]], np.empty(0), (7,), (7, 2))[1]
    start[..., INPUTS["head"]] = _at_base(pose)
    d_inside, d_edges = spread(slopes[..., :7], start, slopes[..., 7:] @ KNOWN)
    w = _point_states(x, edges)
    by_w = _kernel(report_slopes, w, EDGE_SECTION[EDGE], (16,), (16, 15))[1]
    J = by_w[..., :7] @ d_edges[:, EDGE, :7] + by_w[..., 7:] @ POINT_KNOWN
    return slopes, d_inside, d_edges, np.concatenate([d_edges[:, EDGE, R], J], axis=-2)


def _kernel(kernel, w, p, *shapes, along=()):
    """Outputs (..., *shape) of a kernel at w (..., inputs), p (..., parameters)."""
    inputs = [np.moveaxis(part, -1, 0) for part in (w, p, *along)]
    batch = np.broadcast_shapes(*(part.shape[1:] for part in inputs if len(part)))
    outputs = [np.empty((int(np.prod(shape)), *batch), w.dtype) for shape in shapes]
    kernel(*inputs, *outputs, np)
    return [_arranged(out, shape) for out, shape in zip(outputs, shapes, strict=True)]


def _arranged(output, shape):
    """A kernel's output (entries, ...), column by column, as (..., *shape)."""
    last = np.moveaxis(output, 0, -1).reshape(*output.shape[1:], *shape[::-1])
    return last.swapaxes(-1, -2) if len(shape) > 1 else last
