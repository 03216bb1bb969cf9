"""Second derivatives of the loaded shape, along a direction."""

import numpy as np

# <cut>
from driver import (
    INPUTS,
    KNOWN,
    POINT_KNOWN,
    _at_base,
    _first,
    _in_parts,
    _kernel,
    _point_states,
    _rates,
    _solve,
    spread,
)
from tables import (
    EDGE,
    EDGE_SECTION,
    SECTION,
    base_second,
    rates_second,
    report_second,
    report_slopes,
)


# </cut>
def second(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Derivative of the Jacobian along v: d/de J(x + e v) at e = 0, (..., n, 19, size).

    x and v are (..., size). By symmetry this is also the product of the second derivatives with v.
    Raises the errors of `loaded`.
    """
    return _in_parts(lambda x, v: (_second(x, v),), x, v)[0]


def _second(x, v):
    inside, edges = _solve(x)
    slopes, d_inside, d_edges, _ = _first(x, inside, edges)
    w, _, _ = _rates(x, inside)
    # First derivatives of the inputs of the rates, with respect to x and along v.
    columns = _with_known(d_inside, KNOWN)
    forcing = _twice(rates_second, w, SECTION, columns, v, 10)
    start = np.zeros((len(x), 10, x.shape[1]), forcing.dtype)
    head = np.eye(2)[None, :, :] + np.zeros((len(x), 1, 1))
    pose = _twice(base_second, x[:, INPUTS["head"]], np.empty(0), head, v[:, INPUTS["head"]], 7)
    start[..., INPUTS["head"]] = _at_base(pose)
    _, d2_edges = spread(slopes[..., :7], start, forcing)
    w, p = _point_states(x, edges), EDGE_SECTION[EDGE]
    columns = _with_known(d_edges[:, EDGE, :7], POINT_KNOWN)
    second = _kernel(report_slopes, w, p, (16,), (16, 15))[1][..., :7] @ d2_edges[:, EDGE, :7]
    second = second + _twice(report_second, w, p, columns, v, 16)
    return np.concatenate([d2_edges[:, EDGE, 7:], second], axis=-2)


def _with_known(states, known):
    known = np.broadcast_to(known, (*states.shape[:-2], *known.shape[-2:]))
    return np.concatenate([states, known], axis=-2)


def _twice(kernel, w, p, columns, v, size):
    """Second derivative (B, ..., size, K) of a kernel along each of `columns` (B, ..., w, K), v."""
    along = columns @ v.reshape(len(v), *[1] * (columns.ndim - 3), -1, 1)
    p = p[..., None, :] if p.shape[-1] else p
    pair = (columns.swapaxes(-1, -2), along.swapaxes(-1, -2))
    return _kernel(kernel, w[..., None, :], p, (size,), along=pair)[0].swapaxes(-1, -2)
